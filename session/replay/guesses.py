"""What a log does not state, or states wrongly, as far as physics shows it: units, exchanged sensors, columns without names.

At rest an accelerometer shows gravity's length, which decides its unit.  In turns the rates must move gravity as the accelerometer sees it
move, which decides the unit of the rates and that of the clock together.  Where several units fit, or none, nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError, FormatError
from session.base.numeric import median_length
from session.base.questions import QuestionsError
from session.base.units import DEG, LARGEST_DPS, TIME, G, parse_unit
from session.detect.axes import EXPLAINED, agreement
from session.detect.stills import find_stills
from session.log.samples import Samples
from session.log.stamps import FASTEST_HZ, SLOWEST_HZ, fresh, pace_of
from session.replay.answers import with_comments
from session.replay.dialects import TableLayout
from session.replay.join import Joined, MissingSensorError, join
from session.replay.options import Answers
from session.replay.recognise import UnknownColumnsError
from session.replay.sources import sources_of

#: rows that are looked at: forty minutes at 104 Hz
MOST_ROWS = 250_000
#: stills, between whose first turns gravity is looked at
MOST_STILLS = 31
#: units in which any numbers can be read before their unit is known
ANY = {"gyro": "0.01dps", "accel": "g/10000"}
#: units, and what a register counts with its full scale: of MPU, ICM and BMI sensors in dps, of ST's in mdps, of all in g
UNITS = {"gyro": ("dps", "rad/s", "mdps"), "accel": ("g", "m/s2", "mg")}
COUNTS: dict[str, dict[str, float]] = {
    "gyro": {
        f"dps/{count:g}": float(scale) for count, scale in zip((262.4, 131, 65.5, 32.8, 16.4), (125, 250, 500, 1000, 2000), strict=True)
    }
    | {f"{scale * 0.035:.6g}mdps": float(scale) for scale in (125, 250, 500, 1000, 2000)},
    "accel": {f"g/{count}": 32768 / count for count in (16384, 8192, 4096, 2048)},
}
#: option that a register's full scale is
SCALES = {"gyro": "gyro_fs_dps", "accel": "accel_fs_g"}
#: of gravity's length, how far the median of readings may be from it: cheap sensors miss it by a fifth, the next unit is twice as large
NEAR = 0.25
#: factor by which gravity's movement may differ from what the rates make of it: the next unit is 57 times as large, the next count 13 %
WITHIN, WITHIN_COUNTS = 2.0, 1.06
#: lengths of readings: the 10th percentile of the 90th, of an accelerometer and of a gyroscope that turns
STEADY, UNSTEADY = 0.75, 0.25
#: Hz, in place of a rate that is not known yet
TENTATIVE_HZ = 100.0
#: Hz; no one turns a sensor so slowly that fewer samples show it
SLOWEST_TURNS_HZ = 1.0
#: of gravity's movement, what columns without names may leave unexplained
UNPROVEN = 0.2
#: how a unit is known, in words
BY_GRAVITY, BY_RATES = "by gravity", "by the sensors' rates"
#: option of a question -> kinds of units that answer it
KINDS = {"--time-unit": {"time"}, "--gyro-unit": {"gyro"}, "--accel-unit": {"accel"}, "--gyro-fs": {"gyro"}, "--accel-fs": {"accel"}}
KINDS |= {"--sensor": {"gyro", "accel"}}


@dataclass(frozen=True)
class Guess:
    """Units by kind (time, gyro, accel) that are decided, and what decides them; exchanged: whether the columns named for one sensor hold
    the other's readings; columns: of a table without names; full_scales: of registers, by option."""

    units: dict[str, str] = field(default_factory=dict)
    by: dict[str, str] = field(default_factory=dict)
    exchanged: bool = False
    columns: str | None = None
    full_scales: dict[str, float] = field(default_factory=dict)

    def answers(self, answers: Answers) -> Answers:
        """The answers with which the log is read."""
        found: dict[str, Any] = {name: value for name, value in self.full_scales.items() if getattr(answers, name) is None}
        for kind, unit in self.units.items():
            found[f"{kind}_unit"] = ANY[kind] if self.exchanged and kind in ANY else unit
        return replace(answers, columns=self.columns or answers.columns, **found)

    def layout(self, layout: TableLayout) -> TableLayout:
        """The layout of a source that was read with these answers."""
        if self.exchanged:
            triads: dict[str, Any] = {"gyro": layout.accel, "accel": layout.gyro}
            units = {kind: parse_unit(kind, self.units[kind]) for kind in triads}
            layout = replace(layout, **{kind: each and replace(each, unit=units[kind]) for kind, each in triads.items()})
        return replace(layout, sources={**layout.sources, **self.by})


def answered(paths: Sequence[Path], answers: Answers, columns: Sequence[str], cause: QuestionsError | UnknownColumnsError) -> Guess:
    """What physics answers of all that a log does not state.  Raises the questions that are left, and ``cause`` where it answers none."""
    nameless = isinstance(cause, UnknownColumnsError)
    if isinstance(cause, UnknownColumnsError):
        if len(paths) != 1 and not columns:
            raise FormatError(f"{cause}; `import` takes --columns once for each file")
        if columns or answers.columns or not cause.columns:
            raise cause
        answers, units = replace(answers, columns=cause.columns), cause.time_units
        options = {} if cause.stamped or answers.odr_hz else {cause.rate: "--odr"}
        kinds = {"gyro", "accel", *(["time"] if units else [])}
    else:
        options = {question: question.option.split()[0] for question in cause.questions}
        units = next((question.units for question in cause.questions if question.units), ())
        kinds = {kind for option in options.values() for kind in KINDS.get(option, ())}
    rate = [question for question, option in options.items() if option == "--odr"]
    kinds -= {kind for kind in kinds if getattr(answers, f"{kind}_unit") is not None}
    if ("time" in kinds and not units) or not set(options.values()) <= {*KINDS, "--odr"}:
        raise cause
    tentative_hz = TENTATIVE_HZ if rate else None
    placed: dict[str, Any] = {f"{kind}_unit": ANY.get(kind) or units[0] for kind in kinds}
    try:
        with sources_of(paths, replace(answers, **placed, odr_hz=answers.odr_hz or tentative_hz), columns) as sources:
            joined = join(sources, with_comments(answers, sources).odr_hz or tentative_hz)
    except MissingSensorError:
        raise
    except CalibrationError:  # what is wrong with the log is reported where it is read in its units
        raise cause from None
    guess = decide(joined, kinds, units, bool(rate), nameless)
    if guess is None:
        raise cause
    if left := [each for each, option in options.items() if not KINDS.get(option, {"rate"}) <= set(guess.by)]:
        raise QuestionsError(cause.file, cause.dialect, left)
    return replace(guess, columns=answers.columns)


def contradicted(joined: Joined, answers: Answers) -> Guess | None:
    """The units, of those that no one has given, that make sense of readings that make none as they were read; None where they do."""
    gyro, accel = joined.gyro_layout, joined.accel_layout
    assert gyro.gyro is not None and accel.accel is not None  # noqa: PT018  # ``join`` chose the files that have them
    if answers.columns or joined.counted or gyro.gyro.unit.si is None or accel.accel.unit.si is None:
        return None
    free = {kind for kind in ("time", "gyro", "accel") if getattr(answers, f"{kind}_unit") is None}
    rate_hz = pace_of(joined.t_ns).rate_hz
    units: tuple[str, ...] = ()
    if "time" in free and gyro.time is not None and not gyro.clock:
        units = tuple(unit for unit in ("s", "ms", "us", "ns") if SLOWEST_HZ <= rate_hz * gyro.time_ns / TIME[unit] <= 32_000)
    doubt = {"time"} if units and not SLOWEST_HZ <= rate_hz <= FASTEST_HZ else set()
    steady = _steadiness(joined.accel) > STEADY  # else there is no gravity in it
    if steady and not 1 / WITHIN < median_length(joined.accel[:MOST_ROWS]) * accel.accel.unit.si / G < WITHIN:
        doubt |= {"accel"}
    if _steadiness(joined.gyro) > STEADY and _steadiness(joined.accel) < UNSTEADY:
        doubt |= {"gyro", "accel"}
    if doubt <= {"accel"}:
        known = decide(joined, doubt, ()) if doubt else None
        accel_si = accel.accel.unit.si if known is None else _si("accel", known.units["accel"])
        scale = _scale(joined, gyro.gyro.unit.si, accel_si)
        if scale is not None and not 1 / WITHIN < scale < WITHIN:
            doubt |= {"gyro", *(["time"] if units else [])}
    guess = decide(joined, doubt & free, units) if doubt and doubt <= free else None
    return guess if guess is not None and doubt <= set(guess.by) else None


def decide(
    joined: Joined, kinds: Collection[str], time_units: Sequence[str], no_rate: bool = False, nameless: bool = False
) -> Guess | None:
    """The units of these kinds that make sense, each where one alone does; None where none is decided.

    time_units: plausible ones of the clock; no_rate: whether samples are counted at a tentative rate; nameless: whether gravity's movement
    must show what the columns are as well.
    """
    layouts = {"gyro": joined.gyro_layout.gyro, "accel": joined.accel_layout.accel}
    values = {"gyro": joined.gyro[:MOST_ROWS], "accel": joined.accel[:MOST_ROWS]}
    exchanged = {"gyro", "accel"} <= set(kinds) and _steadiness(values["gyro"]) > STEADY and _steadiness(values["accel"]) < UNSTEADY
    if exchanged:
        values = {"gyro": values["accel"], "accel": values["gyro"]}
    candidates: dict[str, dict[str, float]] = {}
    for kind, each in layouts.items():
        assert each is not None  # ``join`` chose the files that have them
        counts = () if (values[kind] % 1).any() else tuple(COUNTS[kind])
        open_units = {unit: _si(kind, unit) for unit in (*UNITS[kind], *counts)}
        candidates[kind] = {"": float(each.unit.si)} if kind not in kinds and each.unit.si is not None else open_units
    length = median_length(values["accel"])
    forces = [(abs(length * si / G - 1), unit) for unit, si in candidates["accel"].items() if abs(length * si / G - 1) < NEAR or not unit]
    if not forces or ("accel" in kinds and _steadiness(values["accel"]) < STEADY):
        return None
    force = min(forces)[1]
    per_ns, most = joined.gyro_layout.time_ns, float(np.abs(values["gyro"]).max(initial=0))
    moved = replace(joined, gyro=values["gyro"], accel=values["accel"])
    times = {time: TIME[time] / per_ns for time in time_units} if "time" in kinds else {"": 1.0}
    pairs = {
        (rate, time): (si, ratio)
        for (rate, si), (time, ratio) in product(candidates["gyro"].items(), times.items())
        if most * si < LARGEST_DPS * DEG * WITHIN
    }
    # Angles are proportional to the product of both: what it must be is known from any pair that explains gravity's movement.
    explained = (
        si * ratio * scale
        for si, ratio in pairs.values()
        if (scale := _scale(moved, si, candidates["accel"][force], ratio, UNPROVEN if nameless else EXPLAINED)) is not None
    )
    angle = next(explained, 0.0)
    found = []
    for (rate, time), (si, ratio) in pairs.items() if angle else ():
        within = WITHIN_COUNTS if rate in COUNTS["gyro"] else WITHIN
        if no_rate or 1 / within < angle / (si * ratio) < within:
            found.append((rate, time))
    rate_hz = pace_of(joined.t_ns).rate_hz
    found = [each for each in found if len(found) == 1 or rate_hz / times[each[1]] > SLOWEST_TURNS_HZ]  # mdps at 0.1 Hz are dps at 100 Hz
    by = {"accel": BY_GRAVITY} if "accel" in kinds else {}
    decided = {"accel": force} if "accel" in kinds else {}
    if len(found) == 1 or (found and no_rate):
        for kind, unit in zip(("gyro", "time"), found[0], strict=True):
            if kind in kinds:
                decided[kind], by[kind] = unit, BY_GRAVITY
    elif exchanged or nameless:
        return None
    elif "time" in kinds and len(time_units) == 1:
        decided["time"], by["time"] = time_units[0], BY_RATES
    scales = {name: COUNTS[kind][decided[kind]] for kind, name in SCALES.items() if decided.get(kind) in COUNTS[kind]}
    return Guess(decided, by, exchanged, None, scales) if by else None


def _si(kind: str, unit: str) -> float:
    """Of one of the units above."""
    parsed = parse_unit(kind, unit)
    assert parsed is not None and parsed.si is not None  # noqa: PT018
    return float(parsed.si)


def _steadiness(values: np.ndarray) -> float:
    """The 10th percentile of lengths (N, 3), of the 90th."""
    low, high = np.percentile(np.linalg.norm(values[:MOST_ROWS], axis=1), (10, 90))
    return float(low / high) if high > 0 else 0.0


def _scale(joined: Joined, gyro_si: float, accel_si: float, time: float = 1.0, most: float = EXPLAINED) -> float | None:
    """The factor on rates of this unit that gravity's movement asks for; None where they leave more than ``most`` of it unexplained, or
    nothing moves.

    time: on the stamps.
    """
    t_ns = np.rint((joined.t_ns[:MOST_ROWS] - joined.t_ns[0]) * time).astype(np.int64)
    later = fresh(t_ns)  # of some that a terminal received at once, one
    if np.count_nonzero(later) < 2 or (np.diff(t_ns) < 0).any():
        return None
    samples = Samples(t_ns[later], joined.gyro[:MOST_ROWS][later] * gyro_si, joined.accel[:MOST_ROWS][later] * accel_si)
    if not SLOWEST_HZ <= 1 / samples.period_s <= FASTEST_HZ:
        return None
    found = agreement(samples, find_stills(samples)[0][:MOST_STILLS])
    return None if found is None or found.misfit > most or found.scale <= 0 else found.scale
