"""Apply an array's model to an array's recording of any length."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.numeric import decimal_rows, nearest_row
from session.base.progress import Progress, no_report
from session.base.units import DEG, NS
from session.log.folder import sha256_of
from tinygc.deploy.apply import DECIMALS, Applicable, Applied, LogSource, columns_of, opened
from tinygc.deploy.calibration import Surroundings
from tinygc.features.arrays.clocks import UnitClock
from tinygc.features.arrays.extrinsics import ONE_READER, clocks_found
from tinygc.features.arrays.model import ArrayModel, FusedUnit, Resampler, fuse, load_array_model
from tinygc.features.arrays.recording import array_log_paths, read_array
from tinygc.models.model import KnownSensor

# Read an array's logs piece by piece and resample all units at the sample times of the first unit.


class UnitLog:
    """One unit's log in SI, read piece by piece and resampled at any times."""

    def __init__(self, unit: FusedUnit, clock: UnitClock | None, path: Path):
        """clock is None for a unit with an unknown clock, which then contributes nothing.

        Raises FormatError for a file that is no gyroscope log, or is calibrated already.
        """
        source = LogSource(
            path, Surroundings(unit.sensor or KnownSensor(), unit.accelerometer, "none" if unit.accelerometer is None else "model", "")
        )
        self.unit, self.clock, self.reader = unit, clock, source.reader
        self.has_force = clock is not None and source.layout.accel is not None and unit.accelerometer is not None
        #: its own pieces; of the unit whose sample times are the array's, they are read as they are
        self.pieces = source.pieces()
        self._resampler, self._ended = Resampler(6), False

    def at(self, t_s: np.ndarray, begins_ns: int) -> np.ndarray:
        """Return (T, 6) rate and force at times (T,) s of the array's clock after begins_ns; each call continues where the last one
        ended."""
        if self.clock is None:
            return np.full((len(t_s), 6), np.nan)
        while not self._ended and self._resampler.ends < t_s[-1]:
            piece = next(self.pieces, None)
            if piece is None:
                self._ended = True
            else:
                # Stamps as times (K,) s of the array's clock after begins_ns
                since = (piece.t_ns - begins_ns) * NS
                moments = since + self.clock.offset_s + self.clock.rate * (since + (begins_ns * NS - self.clock.about_s))
                self._resampler.push(moments, as_six(piece, self.has_force))
        found = self._resampler.at(t_s)
        self._resampler.forget(float(t_s[-1]))
        return found


def as_six(piece: Applicable, with_force: bool) -> np.ndarray:
    """Stack rate and force to (K, 6); force is NaN where there is none."""
    force = piece.accel if with_force and piece.accel is not None else np.full_like(piece.gyro, np.nan)
    return np.hstack([piece.gyro, force])


def _moments(units: list[UnitLog]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the first unit's samples piece by piece, with the other units resampled at the same times, in bounded memory.

    t_ns (T,) int64 of the first unit; rate as measured and force calibrated (T, N, 6), NaN where a unit has none.
    """
    begins: int | None = None
    first, *others = units
    for piece in first.pieces:
        if not len(piece.t_ns):
            continue
        begins = int(piece.t_ns[0]) if begins is None else begins
        t_s = (piece.t_ns - begins) * NS
        yield piece.t_ns, np.stack([as_six(piece, first.has_force), *(unit.at(t_s, begins) for unit in others)], axis=1)


# Fused specific force: each unit's force is rotated by its mounting, moved to one point, and averaged.
#
#     f_0 = R_i f_i - (domega/dt x r_i + omega x (omega x r_i))
#
# r_i is the unit's position relative to the first unit's accelerometer, omega the fused rate, its derivative the central difference. The
# lever arm of a unit with an unknown position is left out, and a note is written.


def _fused_force(model: ArrayModel, force: np.ndarray, rate: np.ndarray, change: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return (T, 3) m/s^2 in the array's frame, at the first unit's accelerometer where positions are known.

    force (T, N, 3) m/s^2 calibrated, in each unit's body frame, NaN for none; rate (T, 3) rad/s, change (T, 3) rad/s^2 of the array; used
    (T, N): units in the rate.  NaN where none of these has a force.
    """
    mountings = np.stack([unit.mounting for unit in model.units])
    turned = np.einsum("nij,tnj->tni", mountings, force)
    for i, unit in enumerate(model.units):
        if (at := unit.position_m) is not None:
            turned[:, i] -= np.cross(change, at) + np.cross(rate, np.cross(rate, at))
    weights = force_weights(model)
    share = np.where(used & np.isfinite(turned).all(axis=2), weights, 0.0)
    total = share.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.einsum("tn,tni->ti", share, np.nan_to_num(turned)) / np.where(total > 0, total, np.nan)[:, None]


def force_weights(model: ArrayModel) -> np.ndarray:
    """Return (N,) weights: 1 over the squared noise density if it is known of every calibrated accelerometer, else 1; 0 for an uncalibrated
    one."""
    there = np.array([unit.accelerometer is not None for unit in model.units])
    noise = [unit.accel_noise_density_mps2_rthz for unit in model.units]
    if all(value is not None for value, use in zip(noise, there, strict=True) if use):
        return np.array([1 / value**2 if use and value else 0.0 for value, use in zip(noise, there, strict=True)])
    return there.astype(float)


# Apply an array's model to a recording of any length; the result is one log with the fused rate and specific force.

#: samples of a log that are compared to find out whether one reader stamped all units
FIRST_STAMPS = 1000


@dataclass(frozen=True, eq=False)
class ArrayApplied(Applied):
    """Result of applying an array's model.

    log: which; left_out: sample times at which no unit gave a rate; at_end: rows in which every unit is saturated; used: share of the rows
    that include each unit; clocks: ``model``, ``same`` or ``found``; noise_density (3,) rad/s/sqrt(Hz) with all units.
    """

    log: str
    left_out: int
    at_end: int
    used: dict[int, float]
    clocks: str
    noise_density: np.ndarray

    @property
    def line(self) -> str:
        """What was written, in one line."""
        density = ", ".join(f"{1e3 * value / DEG:.3g}" for value in self.noise_density)
        return f"{self.out}: {self.rows} samples of {len(self.used)} units fused ({density} mdps/rtHz while all are in)"

    def to_json(self) -> dict:
        """Return ``tinygc-apply/1`` (docs/formats.md) of an array."""
        own = {name: getattr(self, name) for name in ("log", "clocks", "left_out", "at_end")}
        units = [{"number": number, "used_share": share} for number, share in self.used.items()]
        return super().to_json() | own | {"units": units}


def apply_array(
    model_path: Path,
    folder: Path,
    out: Path,
    which: str | None = None,
    unit: str = "rps",
    progress: Progress = no_report,
) -> ArrayApplied:
    """Fuse one log of an array's folder; which: its name without the unit, needed where there are several.

    Memory holds one piece of each unit's file; where clocks must be estimated, the whole recording is read once before. Raises FormatError,
    DataError, CalibrationError.
    """
    model = load_array_model(model_path)
    logs = array_log_paths(folder)
    which = _chosen(folder, logs, which)
    clocks, source, notes = _clocks(model, folder, logs[which])
    if strangers := sorted(set(logs[which]) - set(model.numbers)):
        notes.append(f"the model has no unit {', '.join(map(str, strangers))}: left out")
    if not set(logs[which]) >= set(model.numbers):
        there, wanted = (", ".join(map(str, sorted(numbers))) for numbers in (logs[which], model.numbers))
        raise FormatError(f"{next(iter(logs[which].values())).parent}: logs of units {there}, the model has units {wanted}; give its array")
    reading = [UnitLog(unit, clocks.get(unit.number), logs[which][unit.number]) for unit in model.units]
    force = any(each.has_force for each in reading)
    counts: Counter[str] = Counter()
    used = np.zeros(len(model))
    notes += _force_notes(model, force)

    def fused() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        reader = reading[0].reader
        size = max(reader.path.stat().st_size, 1)
        for t_ns, values in _moments(reading):
            rate, sigma, in_use = fuse(model, values[..., :3])
            counts["at_end"] += int(np.isinf(sigma).any(axis=1).sum())
            yield t_ns, rate, values[..., 3:], in_use
            progress("applying", min(reader.position, size), size)

    with opened(out) as file:
        done = ("gyro", "accel") if force else ("gyro",)
        file.write((",".join(columns_of(unit, force, False, done)) + "\n").encode())
        for t_ns, rate, units_force, in_use, change in _with_change(fused()):
            columns, decimals = [t_ns, *(rate / (DEG if unit == "dps" else 1.0)).T], [0, *[DECIMALS[unit]] * 3]
            there = np.isfinite(rate).all(axis=1)
            if force:
                one = _fused_force(model, units_force, rate, change, in_use)
                there &= np.isfinite(one).all(axis=1)
                columns, decimals = [*columns, *one.T], [*decimals, *[DECIMALS["mps2"]] * 3]
            columns, decimals = [*columns, *[np.ones(len(t_ns), np.int64)] * len(done)], [*decimals, *[0] * len(done)]
            counts["rows"] += int(there.sum())
            counts["left_out"] += int((~there).sum())
            used += in_use[there].sum(axis=0)
            if there.any():
                file.write(decimal_rows([column[there] for column in columns], decimals))
        if not counts["rows"]:
            raise DataError(f"{folder}: {which} has no moment at which a unit gives a rate; is it this array's?")
    if counts["left_out"]:
        notes.append(f"{counts['left_out']} moments at which no unit gave a sample are left out")
    if counts["at_end"]:
        notes.append(f"{counts['at_end']} samples are at the end of every unit's range: the rate was at least as great as written")
    share = {number: float(value) for number, value in zip(model.numbers, used / counts["rows"], strict=True)}
    remarks = (*notes, *(f"{unit.reader.path.name}: {note}" for unit in reading for note in unit.reader.notes))
    applied = (out, counts["rows"], "array", 0.0, "model" if force else "none", remarks, model_path.name)
    return ArrayApplied(*applied, which, counts["left_out"], counts["at_end"], share, source, model.noise_density)


def _chosen(folder: Path, logs: dict[str, dict[int, Path]], which: str | None) -> str:
    if which is None and len(logs) == 1:
        return next(iter(logs))
    if which not in logs:
        found = f"no {which}" if which is not None else f"{len(logs)} logs"
        raise FormatError(f"{folder}: {found}; give --which one of {', '.join(logs)}")
    return which


def _clocks(model: ArrayModel, folder: Path, paths: dict[int, Path]) -> tuple[dict[int, UnitClock], str, list[str]]:
    """Return this recording's clocks by unit number, and notes.

    The model's clocks are used if the model was made from this recording, or needs none; otherwise they are estimated.
    """
    own = {unit.number: unit.clock for unit in model.units}
    if all(clock.offset_s == 0 and clock.rate == 0 for clock in own.values()) and _at_the_same_moments(model, paths):
        return own, "same", []
    if all(unit.number in paths and sha256_of(paths[unit.number]) in unit.sha256 for unit in model.units):
        return own, "model", []
    array = read_array(folder)
    order = [array.numbers.index(number) for number in model.numbers if number in array.numbers]
    ours = replace(array, numbers=tuple(array.numbers[i] for i in order), units=tuple(array.units[i] for i in order))
    clocks, why = clocks_found(ours)
    return clocks, "found", [f"no clock, so no samples: {reason}" for reason in why.values()]


def _at_the_same_moments(model: ArrayModel, paths: dict[int, Path]) -> bool:
    """Return whether one reader stamped all units: the first stamps of a log agree to a tenth of a period, by their median."""
    stamps = []
    for unit in model.units:
        if unit.number in paths:
            piece = next(UnitLog(unit, UnitClock(), paths[unit.number]).pieces, None)
            stamps.append(np.zeros(0, np.int64) if piece is None else piece.t_ns[:FIRST_STAMPS])
    ours = stamps[0] if stamps else np.zeros(0, np.int64)
    if len(ours) < 2:
        return True
    limit_ns = ONE_READER * float(np.median(np.diff(ours)))
    far = [np.abs(ours[nearest_row(ours, theirs)] - theirs) for theirs in stamps[1:] if len(theirs)]
    return all(float(np.median(each)) <= limit_ns for each in far)


def _force_notes(model: ArrayModel, force: bool) -> list[str]:
    if not force:
        return ["specific force: left out, no unit with an accelerometer in its log has one that is calibrated"]
    weights = force_weights(model)
    mean = [str(unit.number) for unit, weight in zip(model.units, weights, strict=True) if weight > 0]
    without = [str(unit.number) for unit in model.units[1:] if unit.position_m is None and unit.accelerometer is not None]
    shared = f"specific force: the mean of units {', '.join(mean)}"
    if without:
        return [f"{shared}; the lever arms of units {', '.join(without)} are left out: no position is known"]
    return [f"{shared}, at the first unit's accelerometer"]


def _with_change(
    parts: Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
) -> Iterator[Any]:
    """Yield each part with the rate's derivative (T, 3) rad/s^2, by central differences, one-sided at the ends of the data; a part's last
    row waits for the next part."""
    waiting: tuple[np.ndarray, ...] | None = next(parts, None)
    if waiting is None:
        return
    given = 0
    for part in chain(parts, [None]):
        count = len(waiting[0])
        if (stop := count - (part is not None)) > given:
            at = np.arange(given, stop)
            low, high = np.maximum(at - 1, 0), np.minimum(at + 1, count - 1)
            t_ns, rate = waiting[:2]
            # of a single row 0
            yield (*(each[at] for each in waiting), (rate[high] - rate[low]) / (np.maximum(t_ns[high] - t_ns[low], 1) * NS)[:, None])
            waiting = tuple(each[max(stop - 1, 0) :] for each in waiting)
            given = min(stop, 1)
        if part is not None:
            waiting = tuple(np.concatenate([old, new]) for old, new in zip(waiting, part, strict=True))
