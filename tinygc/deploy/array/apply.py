"""An array's model applied to an array's recording of any length: one log with the fused rate and specific force."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.common.errors import DataError, FormatError
from session.common.units import DEG, NS
from session.dialects.layout import Answers
from session.files.fixed_point import rows
from session.log.array_logs import array_log_paths
from session.log.array_reading import read_array
from session.log.hashes import sha256_of
from tinygc.array.fused.model import ArrayModel
from tinygc.array.fused.model_files import load_array_model
from tinygc.array.places.place import UnitClock
from tinygc.array.places.places import ONE_READER, clocks_found
from tinygc.deploy.apply import DECIMALS, opened
from tinygc.deploy.array.force import force_weights, fused_force
from tinygc.deploy.array.live import LiveArray
from tinygc.deploy.array.sources import ArrayLogs, UnitLog
from tinygc.deploy.array.voting import Event

Progress = Callable[[str, int, int], None]
#: of a log, by which it is seen whether one reader gave them
FIRST_STAMPS = 1000


@dataclass(frozen=True, eq=False)
class ArrayApplied:
    """out; which log; rows; left_out moments at which no unit gave a rate; at_end rows at which every unit read its end; used: share of the
    rows that each unit is in; events of the vote, with their s from the log's first sample; clocks: ``model``, ``same`` or ``found``;
    noise_density (3,) rad/s/sqrt(Hz) while all are in; force: whether there is any; notes."""

    out: Path
    which: str
    rows: int
    left_out: int
    at_end: int
    used: dict[int, float]
    events: tuple[tuple[float, Event], ...]
    clocks: str
    noise_density: np.ndarray
    force: bool
    notes: tuple[str, ...]


def apply_array(
    model_path: Path,
    folder: Path,
    out: Path,
    answers: Answers,
    which: str | None = None,
    unit: str = "rps",
    progress: Progress = lambda what, done, of: None,
    *,
    vote: bool = True,
) -> ArrayApplied:
    """Fuse one log of an array's folder; which: its name without the unit, needed where there are several.

    Memory is that of a piece of each unit's file; where clocks must be found, the recording is read whole once before.
    Raises FormatError, DataError, CalibrationError.
    """
    model = load_array_model(model_path)
    logs = array_log_paths(folder)
    which = _chosen(folder, logs, which)
    clocks, source, notes = _clocks(model, folder, logs[which], answers)
    if strangers := sorted(set(logs[which]) - set(model.numbers)):
        notes.append(f"the model has no unit {', '.join(map(str, strangers))}: left out")
    reading = ArrayLogs(model, clocks, logs[which], answers)
    force = any(each.has_force for each in reading.units)
    live = LiveArray(model, vote=vote)
    counts: Counter[str] = Counter()
    used = np.zeros(len(model))
    events: list[tuple[float, Event]] = []
    notes += _force_notes(model, reading, force)

    def fused() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        begins, before = None, 0
        for part in reading.moments():
            found = live(part.rate)
            begins = int(part.t_ns[0]) if begins is None else begins
            for event in found.events:
                events.append((float(part.t_ns[event.sample - before] - begins) * NS, event))
            before += len(part.t_ns)
            counts["at_end"] += int(np.isinf(found.sigma).any(axis=1).sum())
            yield part.t_ns, found.rate, part.force, found.used
            progress("applying", *reading.progress)

    with opened(out) as file:
        names = ["t_ns", *(f"g{axis}_{unit}" for axis in "xyz"), *([f"a{axis}_mps2" for axis in "xyz"] if force else [])]
        file.write((",".join(names) + f"\n# calibrated={'gyro,accel' if force else 'gyro'}\n").encode())
        for t_ns, rate, units_force, in_use, change in _with_change(fused()):
            columns, decimals = [t_ns, *(rate / (DEG if unit == "dps" else 1.0)).T], [0, *[DECIMALS[unit]] * 3]
            there = np.isfinite(rate).all(axis=1)
            if force:
                one = fused_force(model, units_force, rate, change, in_use)
                there &= np.isfinite(one).all(axis=1)
                columns, decimals = [*columns, *one.T], [*decimals, *[DECIMALS["mps2"]] * 3]
            counts["rows"] += int(there.sum())
            counts["left_out"] += int((~there).sum())
            used += in_use[there].sum(axis=0)
            if there.any():
                file.write(rows([column[there] for column in columns], decimals))
        if not counts["rows"]:
            raise DataError(f"{folder}: {which} has no moment at which a unit gives a rate; is it this array's?")
    if counts["left_out"]:
        notes.append(f"{counts['left_out']} moments at which no unit that is believed gave a sample are left out")
    if counts["at_end"]:
        notes.append(f"{counts['at_end']} samples are at the end of every unit's range: the rate was at least as great as written")
    share = {number: float(value) for number, value in zip(model.numbers, used / counts["rows"], strict=True)}
    return ArrayApplied(
        out,
        which,
        counts["rows"],
        counts["left_out"],
        counts["at_end"],
        share,
        tuple(events),
        source,
        model.noise_density,
        force,
        tuple(notes + reading.notes),
    )


def _chosen(folder: Path, logs: dict[str, dict[int, Path]], which: str | None) -> str:
    if which is None and len(logs) == 1:
        return next(iter(logs))
    if which not in logs:
        said = f"no {which}" if which is not None else f"{len(logs)} logs"
        raise FormatError(f"{folder}: {said}; give --which one of {', '.join(logs)}")
    return which


def _clocks(model: ArrayModel, folder: Path, paths: dict[int, Path], answers: Answers) -> tuple[dict[int, UnitClock], str, list[str]]:
    """Of this recording, by number: the model's where it was made of it, or where it needs none; else found anew; and notes."""
    own = {unit.number: unit.place.clock for unit in model.units}
    if all(clock.offset_s == 0 and clock.rate == 0 for clock in own.values()) and _at_the_same_moments(model, paths, answers):
        return own, "same", []
    if all(unit.number in paths and sha256_of(paths[unit.number]) in unit.sha256 for unit in model.units):
        return own, "model", []
    array = read_array(folder)
    order = [array.numbers.index(number) for number in model.numbers if number in array.numbers]
    ours = replace(array, numbers=tuple(array.numbers[i] for i in order), units=tuple(array.units[i] for i in order))
    clocks, why = clocks_found(ours)
    return clocks, "found", [f"no clock, so no samples: {said}" for said in why.values()]


def _at_the_same_moments(model: ArrayModel, paths: dict[int, Path], answers: Answers) -> bool:
    """Whether a log's first stamps are all units' own, as one reader gives them: to a tenth of a period, by their median."""
    stamps = []
    for unit in model.units:
        if unit.number in paths:
            piece = next(UnitLog(unit, UnitClock(), paths[unit.number], answers).pieces(), None)
            stamps.append(np.zeros(0, np.int64) if piece is None else piece.t_ns[:FIRST_STAMPS])
    ours = stamps[0] if stamps else np.zeros(0, np.int64)
    if len(ours) < 2:
        return True
    limit_ns = ONE_READER * float(np.median(np.diff(ours)))
    after = [np.clip(np.searchsorted(ours, theirs), 1, len(ours) - 1) for theirs in stamps[1:] if len(theirs)]
    far = [np.minimum(np.abs(ours[k] - t), np.abs(ours[k - 1] - t)) for k, t in zip(after, (t for t in stamps[1:] if len(t)), strict=True)]
    return all(float(np.median(each)) <= limit_ns for each in far)


def _force_notes(model: ArrayModel, reading: ArrayLogs, force: bool) -> list[str]:
    if not force:
        return ["specific force: left out, no unit with an accelerometer in its log has one that is calibrated"]
    weights = force_weights(model)
    mean = [str(unit.number) for unit, weight in zip(model.units, weights, strict=True) if weight > 0]
    without = [str(unit.number) for unit in model.units[1:] if unit.place.position_m is None and unit.accelerometer is not None]
    said = f"specific force: the mean of units {', '.join(mean)}"
    if without:
        return [f"{said}; the lever arms of units {', '.join(without)} are left out: no position is known"]
    return [f"{said}, at the first unit's accelerometer"]


def _with_change(
    parts: Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Each part with the rate's derivative (T, 3) rad/s^2, by central differences; a part's last row waits for the next one."""
    waiting: tuple[np.ndarray, ...] | None = None
    before: tuple[np.ndarray, np.ndarray] | None = None
    for part in parts:
        whole = part if waiting is None else tuple(np.concatenate([old, new]) for old, new in zip(waiting, part, strict=True))
        if len(whole[0]) < 2:
            waiting = whole
            continue
        yield (*(each[:-1] for each in whole), _change(whole[0], whole[1], before)[:-1])  # type: ignore[misc]
        before = (whole[0][-2:-1], whole[1][-2:-1])
        waiting = tuple(each[-1:] for each in whole)
    if waiting is not None:
        yield (*waiting, _change(waiting[0], waiting[1], before))  # type: ignore[misc]


def _change(t_ns: np.ndarray, rate: np.ndarray, before: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """(T, 3): one-sided at the ends of what is known."""
    if before is not None:
        t_ns, rate = np.concatenate([before[0], t_ns]), np.concatenate([before[1], rate])
    if len(t_ns) < 2:
        return np.zeros_like(rate)
    at = np.arange(len(t_ns))
    low, high = np.maximum(at - 1, 0), np.minimum(at + 1, len(at) - 1)
    change = (rate[high] - rate[low]) / ((t_ns[high] - t_ns[low]) * NS)[:, None]
    return change if before is None else change[1:]
