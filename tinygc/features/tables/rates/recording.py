"""A recording on a machine that steps its rate or swings: ``rates*.csv``, ``table.toml``, ``table.csv`` (docs/formats/tables.md).

The machine's angles give each dwell: a stretch in which one axis turns at one rate.  The rate is the slope of what the machine reports; the
output is the sensor's mean over the settled part, over whole turns where there is one, so that the Earth's rate and gravity cancel about a
tilted axis.  Its sigma is that of means of blocks, which holds for noise of any colour that is shorter than a block, with that of the rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.files import require_file
from session.base.names import log_paths
from session.base.progress import Progress
from session.base.texts import printable
from session.base.units import DEG, NS
from session.log.config import read_config
from session.log.logfile import read_log
from session.log.samples import Samples
from tinygc.features.tables.machines.angles import NAME as ANGLES
from tinygc.features.tables.machines.angles import AngleLog, on_its_clock, read_angles
from tinygc.features.tables.machines.description import NAME as TABLE
from tinygc.features.tables.machines.description import Description, body_axes, read_description
from tinygc.features.tables.rates.points import Points, points_of
from tinygc.features.tables.rates.sweep import LEAST, Response
from tinygc.features.tables.recording import MARGIN_RAD
from tinygc.inference.solve import solve

STEM = "rates"
#: key of ``[settings]`` in table.toml: how late the machine's angles are, s
LATENCY = "latency_s"
#: s: shortest dwell; left out at both of its ends, as the machine and the sensor's filter settle and the angles are late
LEAST_DWELL_S, SETTLE_S = 1.0, 0.3
#: share of a dwell that settles at most
MOST_SETTLING = 0.25
#: answers over which a rate is taken, and by how much it may vary within a dwell, of itself and °/s
ANSWERS, RATE_WITHIN, RATE_WITHIN_DPS = 3, 0.05, 0.2
#: angle over a dwell, in declared sigmas, that is none
AT_REST = 3.0
#: means that give the sigma of a dwell's mean
BLOCKS = 16
#: a swing: least number of cycles, by how much its half periods may differ, and the share of the largest rate that is no noise
LEAST_CYCLES, PERIOD_WITHIN, LEAST_SWING = 3, 0.15, 0.05
#: least share of an axis' rate that a gyroscope axis must see
LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Dwell:
    """A stretch of one log at one rate: axis of the table; answers ``start`` to ``stop`` of its angles; its rate, rad/s, roughly."""

    axis: int
    start: int
    stop: int
    rate: float


def read_recording(folder: Path, progress: Progress) -> tuple[list[Points], list[Response], list[str]]:
    """Points of each gyroscope axis that the table turned, responses of its sweeps, and remarks, of a recording's folder.

    Raises FormatError or DataError, which name what is missing or wrong.
    """
    for path in (folder / TABLE, folder / ANGLES):
        if not path.exists():
            raise FormatError(f"{path}: not found; a recording of rates has {STEM}*.csv, {TABLE} and {ANGLES} (docs/formats/tables.md)")
        require_file(path)
    paths = log_paths(folder, STEM)
    if not paths:
        raise FormatError(f"{folder}: no log; expected {STEM}0001.csv and so on next to {TABLE}")
    config, table = read_config(folder / "session.toml"), read_description(folder / TABLE)
    angles = read_angles(folder / ANGLES, table)
    steps: dict[int, list[tuple[str, float, float, float]]] = {}
    swings: list[Response] = []
    remarks: list[str] = []
    for number, path in enumerate(paths):
        progress(path.name, number, len(paths))
        name = path.name.removesuffix(".gz")
        own = angles.get(name) or angles.get(path.name)
        if own is None:
            raise FormatError(f"{folder / ANGLES}: no angle of {name}; expected rows whose first column is {name}")
        own = on_its_clock(own)
        samples = read_log(path, config.sensor).samples
        found = list(_steps(name, samples, own, table))
        for axis, rate, mean, sigma in found:
            steps.setdefault(axis, []).append((name, rate, mean, sigma))
        response = _sweep(name, samples, own, table)
        if response is not None:
            swings.append(response)
        if not found and response is None:
            remarks.append(f"{name}: no dwell of {LEAST_DWELL_S:g} s at one rate, and no swing at {LEAST} frequencies: left out.")
    if not steps and not swings:
        raise DataError(f"{folder}: no rate step and no sweep in {len(paths)} logs; expected dwells of some seconds, or swings")
    points = []
    for axis, rows in sorted(steps.items()):
        columns = np.array([row[1:] for row in rows])
        if len(np.unique(np.round(columns[:, 0], 3))) < LEAST:
            remarks.append(f"gyroscope {'xyz'[axis]}: fewer than {LEAST} rates: left out.")
            continue
        points.append(points_of(f"gyroscope {'xyz'[axis]}", "°/s", columns[:, 0], columns[:, 1], [row[0] for row in rows], columns[:, 2]))
    if points:
        remarks.append("The table's mounting is taken as declared: a tilt of 1° against its axis is 150 ppm of the scale.")
    return points, swings, remarks


def dwells(own: AngleLog) -> list[Dwell]:
    """Stretches in which at most one axis turns, at one rate, by what the machine reported."""
    t_s = (own.t_ns - own.t_ns[0]) * NS
    if len(t_s) < 2 * ANSWERS or t_s[-1] < LEAST_DWELL_S:
        return []
    unwrapped = np.unwrap(own.angles, axis=0)
    span_s = np.maximum(t_s[ANSWERS:] - t_s[:-ANSWERS], 1e-6)
    rates = (unwrapped[ANSWERS:] - unwrapped[:-ANSWERS]) / span_s[:, None]  # (M, K), over answers i to i + ANSWERS
    found: list[Dwell] = []
    start = 0
    for stop in range(1, len(rates) + 1):
        if stop < len(rates) and _steady(rates[start : stop + 1]):
            continue
        if t_s[stop - 1 + ANSWERS] - t_s[start] >= LEAST_DWELL_S and stop - start >= ANSWERS:
            axis = int(np.argmax(np.abs(np.median(rates[start:stop], axis=0))))
            rows = slice(start, stop + ANSWERS)
            slope = float(unwrapped[rows, axis][-1] - unwrapped[rows, axis][0]) / float(t_s[rows][-1] - t_s[rows][0])
            others = np.delete(np.abs(np.median(rates[start:stop], axis=0)), axis)
            if not (others > RATE_WITHIN_DPS * DEG).any():
                found.append(Dwell(axis, start, stop - 1 + ANSWERS, slope))
        start = stop
    return found


def _steady(rates: np.ndarray) -> bool:
    """Whether rates (M, K) stay at one."""
    middle = np.median(rates[-40:], axis=0)
    return bool((np.abs(rates[-1] - middle) <= RATE_WITHIN * np.abs(middle) + RATE_WITHIN_DPS * DEG).all())


def _steps(name: str, samples: Samples, own: AngleLog, table: Description) -> Iterator[tuple[int, float, float, float]]:
    """Gyroscope axis, rate °/s, mean °/s and its sigma of each dwell of a log."""
    found = [dwell for dwell in dwells(own) if not _is_way_back(own, dwell, table)]
    turned = [dwell.axis for dwell in found if abs(dwell.rate) > RATE_WITHIN_DPS * DEG]
    if not turned:
        return
    for dwell in found:
        table_axis = dwell.axis if abs(dwell.rate) > RATE_WITHIN_DPS * DEG else max(set(turned), key=turned.count)
        seen = body_axes(table, own.angles[dwell.start : dwell.start + 1])[0, table_axis]  # (3,) of the body per rate of the axis
        axis = int(np.argmax(np.abs(seen)))
        if abs(seen[axis]) < LEAST_SHARE:
            raise DataError(
                f"{printable(name)}: the axis {table.axes[table_axis].name} lies across all axes of the gyroscope; mount one along it"
            )
        settled = _settled(samples, own, dwell, table.axes[dwell.axis].sigma_rad)
        if settled is not None:
            rate, mean, sigma = settled
            yield axis, rate * float(seen[axis]) / DEG, float(mean[axis]) / DEG, float(sigma[axis]) / DEG


def _is_way_back(own: AngleLog, dwell: Dwell, table: Description) -> bool:
    """Whether a stretch ends in a rest at a limit of its axis: it brings the axis to where the next step begins; no step goes so far."""
    axis = table.axes[dwell.axis]
    after = own.angles[dwell.stop :, dwell.axis]
    moves = np.flatnonzero(np.abs(np.diff(after)) <= AT_REST * axis.sigma_rad)
    if abs(dwell.rate) <= RATE_WITHIN_DPS * DEG or not len(moves) or axis.is_endless:
        return False
    rests = float(np.unwrap([axis.least_rad, after[moves[0]]])[1])
    return min(abs(rests - axis.least_rad), abs(rests - axis.most_rad)) < MARGIN_RAD / 2


def _settled(samples: Samples, own: AngleLog, dwell: Dwell, sigma_rad: float) -> tuple[float, np.ndarray, np.ndarray] | None:
    """Over the settled part of a dwell: the table's rate, mean (3,) of the gyroscope and its sigma (3,), rad/s; None where it is short."""
    begin, end = own.t_ns[dwell.start] * NS, own.t_ns[dwell.stop] * NS
    guard = min(SETTLE_S, MOST_SETTLING * (end - begin))
    begin, end = begin + guard, end - guard
    turn_s = 2 * np.pi / abs(dwell.rate) if dwell.rate else np.inf
    if end - begin >= turn_s:
        begin = end - turn_s * np.floor((end - begin) / turn_s)
    inside = slice(*np.searchsorted(samples.t_ns, [int(begin / NS), int(end / NS)]))
    gyro = np.asarray(samples.gyro[inside])
    answers = slice(*np.searchsorted(own.t_ns, [int(begin / NS), int(end / NS) + 1]))
    if len(gyro) < 2 * BLOCKS or answers.stop - answers.start < 2:
        return None
    t_s = (own.t_ns[answers] - own.t_ns[answers][0]) * NS
    reported, since = np.unwrap(own.angles[answers, dwell.axis]), t_s - t_s.mean()
    rate = float(np.polyfit(since, reported, 1)[0])
    off = reported - reported.mean() - rate * since
    rate_sigma = float(np.sqrt(np.sum(off**2) / max(len(off) - 2, 1) / np.sum(since**2)))
    if abs(rate) * (end - begin) < AT_REST * sigma_rad:
        rate = rate_sigma = 0.0
    means = np.stack([part.mean(axis=0) for part in np.array_split(gyro, BLOCKS)])
    return rate, gyro.mean(axis=0), np.hypot(means.std(axis=0, ddof=1) / np.sqrt(BLOCKS), rate_sigma)


# Sweeps: stretches in which an axis swings at one frequency.


def _sweep(name: str, samples: Samples, own: AngleLog, table: Description) -> Response | None:
    """Gain and phase of the gyroscope at each frequency of a log; None where it swings at fewer than four."""
    found = [row for axis in range(len(table.axes)) for row in _swings(samples, own, table, axis)]
    rows = np.array([row for row in found if np.isfinite(row).all()])
    if len(rows) < LEAST or len(np.unique(np.round(rows[:, 0], 2))) < LEAST:
        return None
    declared = table.settings.get(LATENCY)
    latency_s = float(declared) if isinstance(declared, int | float) and not isinstance(declared, bool) else None
    f, gain, phase, gain_sigma, phase_sigma = rows[np.argsort(rows[:, 0])].T
    if latency_s is not None:  # the angle is that of latency_s before
        phase = phase - 2 * np.pi * f * latency_s
    return Response(name, f, gain, phase, gain_sigma, phase_sigma, latency_s)


def _swings(samples: Samples, own: AngleLog, table: Description, axis: int) -> Iterator[tuple[float, float, float, float, float]]:
    """Frequency Hz, gain, phase, and the sigmas of both, of each stretch in which an axis swings."""
    t_s, angle = (own.t_ns - samples.t_ns[0]) * NS, np.unwrap(own.angles[:, axis])
    seen = body_axes(table, own.angles[:1])[0, axis]
    of = int(np.argmax(np.abs(seen)))
    if abs(seen[of]) < LEAST_SHARE or np.ptp(angle) < 1e-6:
        return
    sample_s, gyro = samples.t_s, np.asarray(samples.gyro)[:, of] / seen[of]
    for begin_s, end_s, guess in _stretches(sample_s, gyro - np.median(gyro)):
        rows, inside = (slice(*np.searchsorted(of_s, [begin_s, end_s])) for of_s in (t_s, sample_s))
        if min(rows.stop - rows.start, inside.stop - inside.start) < 8:
            continue
        f = _frequency(sample_s[inside], gyro[inside], guess)
        reported, reported_variance = _phasor(t_s[rows], angle[rows], f)
        rate, rate_variance = _phasor(sample_s[inside], gyro[inside], f)
        if not abs(reported) > 0 or not abs(rate) > 0:
            continue
        ratio = rate / (2j * np.pi * f * reported)
        relative = np.sqrt(rate_variance / abs(rate) ** 2 + reported_variance / abs(reported) ** 2)
        yield f, float(abs(ratio)), float(np.angle(ratio)), float(abs(ratio) * relative), float(relative)


def _stretches(t_s: np.ndarray, rate: np.ndarray) -> Iterator[tuple[float, float, float]]:
    """Begin and end, s, and frequency, Hz, of stretches in which a rate crosses zero at even intervals."""
    moving = np.flatnonzero(np.abs(rate) > LEAST_SWING * np.abs(rate).max(initial=0.0))
    before, after = moving[:-1], moving[1:]
    crossing = np.sign(rate[before]) != np.sign(rate[after])
    before, after = before[crossing], after[crossing]
    at_s = t_s[before] + (t_s[after] - t_s[before]) * rate[before] / (rate[before] - rate[after])
    halves = np.diff(at_s)
    start = 0
    for stop in range(1, len(halves) + 1):
        usual_s = float(np.median(halves[start:stop]))
        if stop < len(halves) and abs(halves[stop] - usual_s) < PERIOD_WITHIN * usual_s:
            continue
        if stop - start >= 2 * LEAST_CYCLES:
            yield float(at_s[start]), float(at_s[stop]), 1 / (2 * float(np.mean(halves[start:stop])))
        start = stop


def _frequency(t_s: np.ndarray, rate: np.ndarray, guess: float) -> float:
    """The frequency, Hz, at which a sinusoid leaves least of the rates."""
    from scipy.optimize import minimize_scalar

    within = min(0.5 / max(float(np.ptp(t_s)), 1e-9), 0.2 * guess)

    def left(f: float) -> float:
        columns = _columns(t_s, f)
        return float(np.sum((rate - columns @ np.linalg.lstsq(columns, rate, rcond=None)[0]) ** 2))

    return float(minimize_scalar(left, bounds=(guess - within, guess + within), method="bounded", options={"xatol": 1e-7 * guess}).x)


def _columns(t_s: np.ndarray, f: float) -> np.ndarray:
    since = t_s - t_s.mean()
    return np.stack([np.cos(2 * np.pi * f * t_s), np.sin(2 * np.pi * f * t_s), np.ones(len(t_s)), since], axis=1)


def _phasor(t_s: np.ndarray, values: np.ndarray, f: float) -> tuple[complex, float]:
    """Complex amplitude of ``exp(2 pi i f t)`` in values, and the variance of each of its parts."""
    columns = _columns(t_s, f)
    found = solve(columns, values)
    left = values - columns @ found.shortest
    variance = float(left @ left) / max(len(values) - columns.shape[1], 1)
    return complex(found.value[0], -found.value[1]), variance * float(np.mean(np.diag(found.covariance)[:2]))
