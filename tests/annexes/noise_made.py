"""Noise estimates made by hand: their terms are known, and their Allan deviations follow from them."""

from __future__ import annotations

import dataclasses

import numpy as np

from session.io.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MG
from tinygc.annexes.noise.estimate import NoiseEstimate
from tinygc.noise.figures import TERMS, AllanBand, AxisNoise, NoiseFigures, SensorNoise, Term

#: a term that no log shows
ABSENT = Term(0.0, None, 0.01)


def axis(**chosen: Term) -> AxisNoise:
    """An axis with these terms, and no others."""
    return AxisNoise({name: chosen.get(name, ABSENT) for name in TERMS}, p_value=0.4)


def shown(value: float, relative: float, probability: float = 1.0, tau_s: float | None = None) -> Term:
    """A term of this size and relative sigma."""
    return Term(value, value * relative, probability, tau_s=tau_s, tau_sigma_s=None if tau_s is None else 0.2 * tau_s)


def hidden(at_most: float | None, probability: float = 0.02) -> Term:
    """A term that is not shown, with its upper limit."""
    return Term(0.0, None, probability, at_most)


N, H, WALK, UG = DEG_PER_SQRT_HOUR, DEG_PER_HOUR, DEG_PER_HOUR / 60, 1e-3 * MG


def figures(**changes) -> NoiseFigures:
    """A unit much like an ADIS16405, at rest for 10 000 s at 100 Hz."""
    gyro = SensorNoise(
        (
            axis(N=shown(2.41 * N, 0.002), B=shown(28.7 * H, 0.04), K=hidden(31 * WALK, 0.3)),
            axis(N=shown(2.54 * N, 0.002), B=shown(35.2 * H, 0.05), K=shown(119 * WALK, 0.07)),
            axis(N=shown(2.29 * N, 0.002), B=shown(26.5 * H, 0.06), K=shown(178 * WALK, 0.05, 0.9)),
        )
    )
    accel = SensorNoise(tuple(axis(N=shown(n / 60, 0.003), B=shown(120 * UG, 0.1), K=hidden(500 * UG / 60)) for n in (0.17, 0.18, 0.2)))
    made = NoiseFigures(gyro, accel, 100.0, 10_000.0, 1_000_000, ("imu1.npz",), "ADIS16405")
    return dataclasses.replace(made, **changes)


def estimate(of: NoiseFigures | None = None, said: tuple[str, ...] = (), seed: int = 1) -> NoiseEstimate:
    """An estimate with Allan deviations that scatter about the terms as those of a recording do."""
    of = figures() if of is None else of
    rng, tau_s, bands = np.random.default_rng(seed), np.geomspace(1 / of.rate_hz, of.duration_s / 3, 40), {}
    for kind, sensor in of.sensors().items():
        true = np.sqrt(np.column_stack([own.allan_variance(tau_s) for own in sensor.axes]))
        sigma = np.sqrt(tau_s / of.duration_s / 2)[:, None]
        seen = true * np.exp(sigma * rng.normal(size=true.shape))
        bands[kind] = AllanBand(tau_s, seen, seen * np.exp(-sigma), seen * np.exp(sigma))
    return NoiseEstimate(dataclasses.replace(of, allan=bands), said, 12.0)
