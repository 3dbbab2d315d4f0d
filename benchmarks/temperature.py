"""Rest logs: how true the sigmas are, and what is claimed where temperature does nothing.

    python benchmarks/temperature.py cover [--seeds 100]            # errors of slope, bend and lag in their own sigmas
    python benchmarks/temperature.py nulls [--seeds 100]            # share in which a dependence, or a lag, is claimed
    python benchmarks/temperature.py knots [--seeds 30]             # cover with fewer and with more knots
    python benchmarks/temperature.py steps [--seeds 20]             # sweeps of half an hour by thermometers with steps and failed readings
    python benchmarks/temperature.py walks [--seeds 100]            # what is claimed where the zero walks, and temperature does nothing

cover and nulls draw block means of a second directly, with code of their own: white noise, flicker, a random walk; steps and walks
single readings, ten a second.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from session.base.units import DEG, DEG_PER_HOUR, G
from session.log.rests import RestLog, rest_from_samples
from session.log.samples import Samples
from session.log.thermometer import Sound
from tinygc.features.temperature import axis_fit
from tinygc.features.temperature.axis_fit import AxisFit, fit_axis, make_knots
from tinygc.features.temperature.sweeps import sweeps_of

#: step of the thermometer, degC, its own noise, degC, and share of its readings that fail
THERMOMETERS = {
    "0.01 °C": (0.01, 0.0, 0.0),
    "0.1 °C": (0.1, 0.0, 0.0),
    "0.1 °C, noise 0.05 °C": (0.1, 0.05, 0.0),
    "0.5 °C": (0.5, 0.0, 0.0),
    "1 °C": (1.0, 0.0, 0.0),
    "1 °C, noise 0.2 °C": (1.0, 0.2, 0.0),
    "0.01 °C, 1 % fail": (0.01, 0.0, 0.01),
    "0.5 °C, 5 % fail": (0.5, 0.0, 0.05),
    "1 °C, 5 % fail": (1.0, 0.0, 0.05),
}
#: share of the range at a share of half an hour
PATHS = {
    "up": lambda x: x,
    "up, and settles": lambda x: (1 - np.exp(-4 * x)) / (1 - np.exp(-4)),
    "up and down": lambda x: (1 - np.cos(2 * np.pi * x)) / 2,
}
SLOPES, RANGE_C, FAILED_C = (0.020, -0.012, 0.003), (20.0, 45.0), (-40.0, 0.0, 85.0, 128.0)
WALKS = {"none": 0.0, "6 mdps in an hour": 1e-4, "60 mdps in an hour": 1e-3, "0.3 dps in an hour": 5e-3}

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
    noise += flicker(rng, len(t_s), 1.0, flicker_dph)
    gyro = (ZERO + (SLOPE * away + BEND * away**2)[:, None] + noise) * DEG
    sd = np.full((len(t_s), 3), 0.035 * DEG)
    accel = np.tile([0.0, 0.0, -G], (len(t_s), 1))
    number = np.arange(len(t_s))
    reading = reading + 0.003 * rng.standard_normal(len(t_s))
    return RestLog(Path("rest0001.csv"), number, 1.0, reading, gyro, accel, sd, sd, np.full(len(t_s), 100), 100 * len(t_s), 0.01)


def flicker(rng: np.random.Generator, count: int, step_s: float, dph: float) -> np.ndarray:
    """(count, 3) dps, of a bias instability: Gauss-Markov processes an octave apart."""
    found = np.zeros((count, 3))
    for time_s in 2.0 ** np.arange(13):
        keep = np.exp(-step_s / time_s)
        drive = dph * DEG_PER_HOUR / DEG * np.sqrt(np.log(2) / np.pi) * rng.standard_normal((count, 3))
        drive[1:] *= np.sqrt(1 - keep**2)
        found += lfilter([1.0], [1.0, -keep], drive, axis=0)
    return found


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


def read_out(seed: int, path: str, thermometer: str, slopes: tuple[float, ...] = SLOPES, walk: float = 0.0) -> RestLog:
    """Half an hour of single readings: white noise of 0.03 dps a reading, a bias instability of 3 °/h, the zero's walk, dps/sqrt(s), and
    what the thermometer says."""
    rng = np.random.default_rng([seed, list(PATHS).index(path), list(THERMOMETERS).index(thermometer)])
    step_c, noise_c, fail = THERMOMETERS[thermometer]
    t_s = np.arange(18_000) * 0.1
    low, high = np.array(RANGE_C) + rng.uniform(-0.5, 0.5)  # another place between two steps
    heat = low + (high - low) * PATHS[path](t_s / t_s[-1])
    reading = np.round((heat + noise_c * rng.standard_normal(len(heat))) / step_c) * step_c
    out = rng.random(len(heat)) < fail
    reading[out] = rng.choice(FAILED_C, size=out.sum())
    wander = walk * np.sqrt(0.1) * np.cumsum(rng.standard_normal((len(heat), 3)), axis=0)
    wander += flicker(rng, len(heat), 0.1, 3.0)
    gyro = (0.3 + np.outer(heat - ABOUT_C, slopes) + wander + 0.03 * rng.standard_normal((len(heat), 3))) * DEG
    force = np.tile([0.0, 0.0, -G], (len(heat), 1))
    return rest_from_samples(Samples(np.round(t_s * 1e9).astype(np.int64), gyro, force, Sound()(reading)))


def slopes_of(log: RestLog) -> list[tuple[str, float, float]]:
    """Of each axis what is claimed, slope at 40 degC and its sigma, dps per degC."""
    knots = make_knots([log], sweeps_of(log.temp_c))
    found = []
    for axis in range(3):
        fit = fit_axis(knots, log.gyro[:, axis])
        if fit.order:
            away = (ABOUT_C - knots.reference_c) ** np.arange(fit.order) * np.arange(1, fit.order + 1)
            slope, sigma = away @ fit.terms[1:], np.sqrt(away @ fit.covariance[1:-1, 1:-1] @ away)
            found.append(("line" if fit.order == 1 else "curve", float(slope) / DEG, float(sigma) / DEG))
        else:
            assert fit.line is not None
            found.append(("either" if fit.line.order else "constant", fit.line.slope / DEG, fit.line.sigma / DEG))
    return found


def steps(seeds: int) -> None:
    print(f"{'':40} line, curve, line or walk, constant; within 1 / 2 sigmas, rms; sigma, dps/°C ({3 * seeds} axes each)")
    total = []
    for path in PATHS:
        for thermometer in THERMOMETERS:
            rows = [row for seed in range(seeds) for row in zip(slopes_of(read_out(seed, path, thermometer)), SLOPES, strict=True)]
            z = np.array([(slope - truth) / sigma for (_, slope, sigma), truth in rows])
            total.append(z)
            sigma, says = np.median([row[0][2] for row in rows]), claims([row[0] for row in rows])
            print(f"{f'{path}; {thermometer}':40} {says}  {shares(z)}; {sigma:.1e}", flush=True)
    print(f"{'all':40} {shares(np.concatenate(total))}")


def walks(seeds: int) -> None:
    print(f"{'':40} line, curve, line or walk, constant; slope 0 within 1 / 2 sigmas, rms ({3 * seeds} axes each)")
    for path in PATHS:
        for thermometer in ("0.01 °C", "1 °C, 5 % fail"):
            for walk, size in WALKS.items():
                rows = [row for seed in range(seeds) for row in slopes_of(read_out(seed, path, thermometer, (0.0, 0.0, 0.0), size))]
                z = np.array([slope / sigma for _, slope, sigma in rows])
                print(f"{f'{path}; {thermometer}; walk {walk}':60} {claims(rows)}  {shares(z)}", flush=True)


def claims(rows: list[tuple[str, float, float]]) -> str:
    return "  ".join(f"{sum(row[0] == kind for row in rows):3}" for kind in ("line", "curve", "either", "constant"))


def shares(z: np.ndarray) -> str:
    return f"{np.mean(np.abs(z) < 1):.2f} / {np.mean(np.abs(z) < 2):.2f}, {np.sqrt(np.mean(z**2)):.2f}"


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
    arguments.add_argument("part", choices=("cover", "nulls", "knots", "steps", "walks"))
    arguments.add_argument("--seeds", type=int, default=100)
    chosen = arguments.parse_args()
    {"cover": cover, "nulls": nulls, "knots": knots, "steps": steps, "walks": walks}[chosen.part](chosen.seeds)
