"""The watch: run lengths to a false alarm beside the stated, recorded rests.

python benchmarks/watch.py run-lengths | turns | recorded
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common import markdown, progress

import tinygc
from session.base.files import read_npz
from session.base.units import DEG, DEG_PER_HOUR, NS_PER_S, G
from tinygc.deploy.apply import Applicable
from tinygc.features.unit.watch.bars import bar_of, squares_run_length
from tinygc.features.unit.watch.detector import Window, ZeroFilter
from tinygc.features.unit.watch.expectation import BLOCKS, WATCHED_S, AtRest, Expectation, Settings, settings
from tinygc.features.unit.watch.turns import MOST_SQUARE, RATIO
from tinygc.features.unit.watch.watch import Watch
from tinygc.fitting.unit_state import UnitState, read_state
from tinygc.inference.noise import TIMES_S, wander_covariance
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_of

WILD = Path(__file__).resolve().parent.parent.parent / "shared" / "wild"
#: an ASM330LHH: N 0.21 °/√h, B 3 °/h, at 104 Hz
WHITE, INSTABILITY, ACCEL_WHITE, ACCEL_INSTABILITY = 6.2e-5, 3 * DEG_PER_HOUR, 4.3e-4, 1e-4
WINDOW_S = WATCHED_S * BLOCKS
RATE_HZ = 104.0


def flicker_drift(instability: float):
    """(3,) mean square of the drift of flicker noise, between two means."""

    def drift(elapsed_s: float, span_s: float) -> np.ndarray:
        covariance = wander_covariance(np.array([0.0, elapsed_s]), span_s, instability_rps=instability)
        return np.full(3, covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1])

    return drift


def expectation(walk: float = 0.0) -> Expectation:
    """A sensor's figures; walk: K, rad/s/sqrt(s)."""
    gyro = flicker_drift(INSTABILITY)
    return Expectation(
        RATE_HZ,
        AtRest(np.full(3, WHITE), lambda t, span: gyro(t, span) + walk**2 * t, np.full(3, 0.14 * DEG), 0.002 * DEG, 0.01 * DEG),
        AtRest(np.full(3, ACCEL_WHITE), flicker_drift(ACCEL_INSTABILITY), np.full(3, 0.02), 1e-3, 1e-3),
        None,
        0.0,
        G,
        np.diag(np.r_[np.full(9, 1e-8), np.full(3, 1e-10)]),
    )


class Flicker:
    """Flicker noise of independent series, a step of a window at a time: octaves of Gauss-Markov processes, as ``closure.floor`` has it."""

    def __init__(self, instability: float, shape: tuple[int, ...], step_s: float, rng: np.random.Generator):
        times = np.array([time for time in TIMES_S if time >= step_s / 2])
        self._sigma, self._decay = instability * np.sqrt(np.log(2) / np.pi), np.exp(-step_s / times)
        self._rng = rng
        self._parts = self._sigma * rng.normal(size=(len(times), *shape))

    def next(self) -> np.ndarray:
        """The next values."""
        decay = self._decay.reshape(-1, *[1] * (self._parts.ndim - 1))
        self._parts = decay * self._parts + self._sigma * np.sqrt(1 - decay**2) * self._rng.normal(size=self._parts.shape)
        return self._parts.sum(axis=0)


def windows(
    chosen: Settings, copies: int, rng: np.random.Generator, rest: int | None, walk: float = 0.0
) -> Iterator[tuple[np.ndarray, ...]]:
    """rate (3, S) and gravity (S,), normalised, direction (3, S), whether a new rest begins; rest: windows of one, None for one alone."""
    unit, g_unit = chosen.rate_sigma_rps[:, None], chosen.gravity_sigma
    offset = rng.normal(size=(3, copies)) * np.sqrt(chosen.rate.offset)
    zero = rng.normal(size=(3, copies)) * np.sqrt(chosen.gravity.offset)
    gyro, accel = Flicker(INSTABILITY, (3, copies), WINDOW_S, rng), Flicker(ACCEL_INSTABILITY, (copies,), WINDOW_S, rng)
    number = 0
    while True:
        if number == 0 or (rest is not None and number % rest == 0):
            attitude = rng.normal(size=(3, copies)) * np.sqrt(chosen.rate.attitude)
            own = rng.normal(size=copies) * np.sqrt(chosen.gravity.attitude)
            direction = rng.normal(size=(3, copies))
            direction /= np.linalg.norm(direction, axis=0)
        offset += rng.normal(size=(3, copies)) * walk * np.sqrt(WINDOW_S) / unit
        rate = offset + gyro.next() / unit + attitude + rng.normal(size=(3, copies))
        gravity = np.sum(direction * zero, axis=0) + accel.next() / G / g_unit + own + rng.normal(size=copies)
        yield rate, gravity, direction, rest is not None and number > 0 and number % rest == 0
        number += 1


def result(chosen: Settings, rate: np.ndarray, gravity: np.ndarray, direction: np.ndarray) -> Window:
    """A window as the detector has it."""
    copies = rate.shape[1]
    return Window(rate, gravity, direction, np.zeros(copies), np.ones((2, copies)))


def run_lengths() -> None:
    """Mean run length to a false alarm, of many streams side by side."""
    rows = []
    cases = [("rest", 1000, None, 0.0), ("rest", 10_000, None, 0.0), ("rests of 10 s", 1000, 5, 0.0), ("random walk", 1000, None, 3e-7)]
    for name, stated, rest, walk in cases:
        copies, most = (400, 4 * stated) if stated < 5000 else (400, stated)
        chosen, rng = settings(expectation(walk), stated * WINDOW_S), np.random.default_rng(1)
        filters, alarms, total, squares = ZeroFilter(chosen, copies), np.zeros(copies), 0, 0.0
        first = np.zeros(copies, dtype=int)
        channels = np.zeros(4)
        for number, (rate, gravity, direction, new) in zip(range(most), windows(chosen, copies, rng, rest, walk), strict=False):
            if number % 100 == 0:
                progress(f"{name} {number}")
            filters.predict()
            if new:
                filters.new_rest()
            found = filters.evaluate(result(chosen, rate, gravity, direction))
            alarms += (found.alarm != 0).any(axis=0)
            channels += (found.alarm != 0).sum(axis=1)
            hit = (found.alarm != 0).any(axis=0) & (first == 0)
            first[hit] = number + 1
            total += copies
            squares += float(np.mean(found.z**2))
        events = int(alarms.sum())
        mean = total / max(events, 1)
        early = np.mean((first > 0) & (first <= stated))
        measured, by_channel = f"{mean:.0f} ± {mean / np.sqrt(max(events, 1)):.0f}", " ".join(f"{each:.0f}" for each in channels)
        rows.append([name, f"{stated}", measured, f"{100 * early:.0f} %", f"{np.sqrt(squares / most):.3f}", by_channel])
    progress("")
    print(markdown(["streams", "stated, windows", "measured", "alarmed within it", "rms z", "alarms by channel"], rows))


def turns() -> None:
    """Chi-squares of turns by a hand through the whole watch, nothing changed since the fit, and the run lengths of their test."""
    squares = []
    for unit in range(4):
        with tempfile.TemporaryDirectory() as name:
            fitted = tinygc.simulate(segments=30, seed=100 + unit, unit_seed=unit, closure_s=0.0, odr_hz=RATE_HZ)
            folder = fitted.save(name + "/session")
            tinygc.fit(folder, methods=("least_squares",)).save()
            known = read_state(Path(folder) / "fit" / "model_least_squares.json")
        accelerometer = accelerometer_of(known.table, "a benchmark")
        assert accelerometer is not None
        for stream in range(6):
            progress(f"unit {unit} stream {stream}")
            session = tinygc.simulate(
                segments=150, seed=1000 * unit + stream, unit_seed=unit, closure_s=0.0, odr_hz=RATE_HZ, still_s=4.0
            ).session
            s, watch = session.logs[0].samples, Watch(known)
            force = accelerometer.correct(np.asarray(s.accel[:], dtype=float))
            temp_c = None if s.temp_c is None else np.asarray(s.temp_c[:], dtype=float)
            found = [*watch.take(Applicable(np.asarray(s.t_ns[:]), np.asarray(s.gyro[:], dtype=float), force, temp_c)), *watch.end()]
            squares.append([event.table["chi_square"] for event in found if event.kind == "turn"])
    progress("")
    rows, every = [], np.concatenate(squares)
    for stated in (30, 100, 300, 1000):
        bar, alarms = bar_of(squares_run_length, stated, RATIO, 2), 0
        for stream in squares:
            total = 0.0
            for square in stream:
                total = max(0.0, total + min(square, MOST_SQUARE) * (1 - RATIO**-2) / 2 - 2 * np.log(RATIO))
                if total >= bar:
                    alarms, total = alarms + 1, 0.0
        measured = f"{len(every) / alarms:.0f} ± {len(every) / alarms**1.5:.0f}" if alarms else f"none in {len(every)}"
        rows.append([f"{stated}", measured])
    print(f"{len(every)} turns in {len(squares)} streams; chi-square of 2 degrees of freedom: mean {every.mean():.2f}")
    print(f"by the third of a stream: {' '.join(f'{np.mean([np.mean(np.array_split(s, 3)[k]) for s in squares]):.2f}' for k in range(3))}")
    print(markdown(["stated, turns", "measured"], rows))


def recorded() -> None:
    """Three ADIS16405 at rest: figures of one half by ``noise``, its mean as B, and the other half watched."""
    import tinygc.features.unit.watch.watch as module

    usual, rows = module.expect, []
    for number in (1, 2, 3):
        values = read_npz(WILD / f"adis16405_imu{number}.npz", ("gyro_dps", "accel_g", "rate_hz"))
        rate, force = values["gyro_dps"].astype(float) * DEG, values["accel_g"].astype(float) * G
        rate_hz = float(np.ravel(values["rate_hz"])[0])
        t_s = np.arange(len(rate)) / rate_hz
        halves = (slice(0, len(rate) // 2), slice(len(rate) // 2, len(rate)))
        for known, seen in (halves, halves[::-1]):
            progress(f"imu{number}")
            figures = tinygc.estimate_noise((t_s[known] - t_s[known][0], rate[known], force[known]))
            gravity = float(np.linalg.norm(force[known].mean(axis=0)))
            module.expect = lambda model, hz, gravity=gravity: dataclasses.replace(usual(model, hz), gravity_mps2=gravity)
            model = LinearModel(np.eye(3), -rate[known].mean(axis=0))
            watch, events = Watch(UnitState(Path("imu"), model, figures=figures)), []
            for begin in range(seen.start, seen.stop, 60_000):
                part = slice(begin, min(begin + 60_000, seen.stop))
                stamps = np.rint(t_s[part] * NS_PER_S).astype(np.int64)
                events += [each for each in watch.take(Applicable(stamps, rate[part], force[part], None)) if each.kind == "alarm"]
            list(watch.end())
            z = np.array([result.z[:, 0] for _, result in watch._records])
            channels = ", ".join(f"{each.table['channel']} at {each.t_s + t_s[seen.start]:.0f} s" for each in events) or "none"
            which = "first" if seen.start == 0 else "second"
            rms = " ".join(f"{each:.2f}" for each in np.sqrt(np.mean(z**2, axis=0)))
            rows.append([f"imu{number}, {which} half", str(watch.windows), rms, channels])
    progress("")
    print(markdown(["watched", "windows", "rms of the innovations x y z gravity", "alarms"], rows))


def main() -> None:
    commands = {"run-lengths": run_lengths, "turns": turns, "recorded": recorded}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=commands)
    commands[parser.parse_args().what]()


if __name__ == "__main__":
    main()
