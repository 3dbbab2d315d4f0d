"""Rest logs: how true the sigmas are, and what is claimed where temperature does nothing.

    python benchmarks/temperature.py cover [--seeds 100]            # errors of slope, bend and lag in their own sigmas
    python benchmarks/temperature.py nulls [--seeds 100]            # share in which a dependence, or a lag, is claimed
    python benchmarks/temperature.py knots [--seeds 30]             # cover with fewer and with more knots

cover and nulls draw block means of a second directly, with code of their own: white noise, flicker, a random walk.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from session.io.rests import RestLog
from session.io.units import DEG, DEG_PER_HOUR, G
from tinygc.annexes.temperature import axis_fit
from tinygc.annexes.temperature.axis_fit import AxisFit, fit_axis, make_knots
from tinygc.annexes.temperature.sweeps import sweeps_of

ZERO, SLOPE, BEND, ABOUT_C = 0.5, 0.034, 2e-4, 40.0
COVERED = {
    "4 cycles of 1 h, lag 40 s": {"lag_s": 40.0},
    "the same, random walk": {"lag_s": 40.0, "walk": 2e-5},
    "2 cycles of 1 h, lead 30 s, 10 °/h": {"cycles": 2.0, "lag_s": -30.0, "flicker_dph": 10.0},
}
NULLS = {
    "4 cycles of 1 h, 3 °/h": {},
    "the same, 20 °/h": {"flicker_dph": 20.0},
    "2 cycles, random walk 6 mdps in 1 h": {"cycles": 2.0, "walk": 1e-4},
    "1 cycle, the same walk": {"cycles": 1.0, "walk": 1e-4},
    "half a cycle, the same walk": {"cycles": 0.5, "walk": 1e-4},
}


def drawn(seed: int, cycles: float = 4.0, lag_s: float = 0.0, flicker_dph: float = 3.0, walk: float = 0.0, follows: bool = True) -> RestLog:
    """Blocks of a second, -5 to 86 degC in cycles of an hour; the same truth on each axis, with noise of its own."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(round(cycles * 3600.0)) + 0.5
    heat = 40.5 - 45.5 * np.cos(2 * np.pi * t_s / 3600)
    # The steady answer of a first-order lag to a cosine, and its start.
    w = 2 * np.pi / 3600
    late = 40.5 - 45.5 * (np.cos(w * t_s) + w * abs(lag_s) * np.sin(w * t_s)) / (1 + (w * lag_s) ** 2)
    start = 40.5 - 45.5 - (40.5 - 45.5 / (1 + (w * lag_s) ** 2))
    late = late + (start * np.exp(-t_s / abs(lag_s)) if lag_s else 0.0)
    element, reading = (heat, late) if lag_s < 0 else (late, heat)
    away = (element - ABOUT_C) * follows
    noise = 0.0035 * rng.standard_normal((len(t_s), 3)) + walk * np.cumsum(rng.standard_normal((len(t_s), 3)), axis=0)
    for time_s in 2.0 ** np.arange(13):
        keep = np.exp(-1 / time_s)
        drive = flicker_dph * DEG_PER_HOUR / DEG * np.sqrt(np.log(2) / np.pi) * rng.standard_normal((len(t_s), 3))
        drive[1:] *= np.sqrt(1 - keep**2)
        noise += lfilter([1.0], [1.0, -keep], drive, axis=0)
    gyro = (ZERO + (SLOPE * away + BEND * away**2)[:, None] + noise) * DEG
    sd = np.full((len(t_s), 3), 0.035 * DEG)
    accel = np.tile([0.0, 0.0, -G], (len(t_s), 1))
    number = np.arange(len(t_s))
    reading = reading + 0.003 * rng.standard_normal(len(t_s))
    return RestLog(Path("rest0001.csv"), number, 1.0, reading, gyro, accel, sd, sd, np.full(len(t_s), 100), 100 * len(t_s), 0.01)


def fitted(seed: int, **how: float) -> tuple[AxisFit, float]:
    """The fit of one axis, and the temperature that its terms are about."""
    log = drawn(seed, **how)
    knots = make_knots([log], sweeps_of(log.temp_c))
    return fit_axis(knots, log.gyro[:, 0]), knots.reference_c


def errors(seed: int, **how: float) -> list[float]:
    """Of slope, bend and lag, in sigmas; NaN where one was not claimed."""
    fit, about_c = fitted(seed, **how)
    apart = about_c - ABOUT_C
    truth = [SLOPE + 2 * BEND * apart, BEND]
    found = [(fit.terms[n] / DEG - truth[n - 1]) / (fit.sigma[n] / DEG) if fit.order >= n else np.nan for n in (1, 2)]
    return [*found, (fit.tau_s - how["lag_s"]) / fit.sigma[-1] if fit.tau_s else np.nan]


def cover(seeds: int) -> None:
    print(f"{'':36} share within 1 sigma / 2 sigmas, rms: slope, bend, lag ({seeds} seeds)")
    for name, how in COVERED.items():
        z = np.array([errors(seed, **how) for seed in range(seeds)])
        parts = [f"{np.mean(np.abs(c) < 1):.2f} / {np.mean(np.abs(c) < 2):.2f}, {np.sqrt(np.nanmean(c**2)):.2f}" for c in z.T]
        print(f"{name:36} {'   '.join(parts)}")


def nulls(seeds: int) -> None:
    print(f"{'':36} a dependence claimed, a lag claimed ({seeds} seeds)")
    for name, how in NULLS.items():
        fits = [fitted(1000 + seed, follows=False, **how)[0] for seed in range(seeds)]
        print(f"{name:36} {np.mean([fit.order > 0 for fit in fits]):.2f}   {np.mean([fit.tau_s != 0 for fit in fits]):.2f}")


def knots(seeds: int) -> None:
    for count in (80, 160, 320):
        axis_fit.MOST_KNOTS = count
        began = time.perf_counter()
        z = np.array([errors(seed, lag_s=40.0) for seed in range(seeds)])
        sigma = np.mean([fitted(seed, lag_s=40.0)[0].sigma[1] / DEG for seed in range(3)])
        seconds = (time.perf_counter() - began) / (seeds + 3)
        rms = ", ".join(f"{value:.2f}" for value in np.sqrt(np.nanmean(z**2, axis=0)))
        print(f"{count:4} knots: rms {rms}; slope ± {sigma:.2g}, {seconds:.2f} s each")


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("part", choices=("cover", "nulls", "knots"))
    arguments.add_argument("--seeds", type=int, default=100)
    chosen = arguments.parse_args()
    {"cover": cover, "nulls": nulls, "knots": knots}[chosen.part](chosen.seeds)
