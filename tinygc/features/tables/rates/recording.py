"""A recording on a machine that steps its rate: ``rates*.csv``, ``table.toml``, ``table.csv`` (docs/formats/tables.md).

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
from tinygc.features.tables.rates.points import LEAST_RATES, Points, points_of
from tinygc.features.tables.recording import MARGIN_RAD

STEM = "rates"
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
#: least share of an axis' rate that a gyroscope axis must see
LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Dwell:
    """A stretch of one log at one rate: axis of the table; answers ``start`` to ``stop`` of its angles; its rate, rad/s, roughly."""

    axis: int
    start: int
    stop: int
    rate: float


def read_recording(folder: Path, progress: Progress) -> tuple[list[Points], list[str]]:
    """Points of each gyroscope axis that the table turned, and remarks, of a recording's folder.

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
        if not found:
            remarks.append(f"{name}: no dwell of {LEAST_DWELL_S:g} s at one rate: left out.")
    if not steps:
        raise DataError(f"{folder}: no rate step in {len(paths)} logs; expected dwells of some seconds")
    points = []
    for axis, rows in sorted(steps.items()):
        columns = np.array([row[1:] for row in rows])
        if len(np.unique(np.round(columns[:, 0], 3))) < LEAST_RATES:
            remarks.append(f"gyroscope {'xyz'[axis]}: fewer than {LEAST_RATES} rates: left out.")
            continue
        points.append(points_of(f"gyroscope {'xyz'[axis]}", "°/s", columns[:, 0], columns[:, 1], [row[0] for row in rows], columns[:, 2]))
    if points:
        remarks.append("The table's mounting is taken as declared: a tilt of 1° against its axis is 150 ppm of the scale.")
    return points, remarks


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
