"""``explain`` of an array: each unit as a session of its own, and statements of what its units share and whose each effect is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, DataError
from session.base.files import result_folder
from session.base.progress import Progress, no_report
from session.base.records import plain, write_whole
from session.base.texts import printable
from session.base.units import DEG, NS
from session.detect.events import find_impacts
from tinygc.effects import Effect
from tinygc.explanation.families import SLOW_ZERO
from tinygc.explanation.faulty_readings import FALSE, proposed, without_false_readings
from tinygc.features.arrays.checks import noise_at_rest
from tinygc.features.arrays.events import FALSE_READING, KNOCK, ArrayEvent
from tinygc.features.arrays.fit import NAME, ArrayFit, events_and_left_out, fit_array, sentence
from tinygc.features.arrays.recording import ArraySession
from tinygc.features.arrays.traits import ALIKE, COMMON, DIFFERS, READINGS, slow_zero_of, traits_of
from tinygc.inference.choose import Standing, Statement
from tinygc.inference.decide import Answer
from tinygc.library.explanations import Why, explain
from tinygc.library.records import Shown
from tinygc.reporting.checked_text import checked_page
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.tables import degrees_text
from tinygc.reporting.terminal import Group, Text, one_line

# Steps in one unit's register: did the other units feel them? A false reading is in one unit, a knock in all.

#: share of the step below which the others have not felt it (benchmarks/array_fit.py: knocks agree to a tenth)
FELT = 0.5
#: samples around the step in which the others may see it, by their clocks
NEIGHBOURS = 1
#: s around a step that are read from the others
NEAR_S = 0.1
#: s, duration of a board's impact: steps of several units within it are one knock
TOGETHER_S = 0.05


def steps_of(fit: ArrayFit) -> tuple[ArrayEvent, ...]:
    """Return the steps found by any unit's detector, and the impacts, in order of time."""
    leaps = []
    for i, unit in enumerate(fit.units):
        session = unit.problem.session
        events = [event for event in proposed(session) if event.id == FALSE]
        calm = without_false_readings(session, events)
        for event in events:
            rows = slice(event.row, event.row + event.samples)
            samples, smooth = (each.logs[event.log].samples for each in (session, calm))
            t_s = samples.t_ns[rows] * NS
            leap = _in_array(fit, i, np.asarray(samples.gyro)[rows] - np.asarray(smooth.gyro)[rows], bias=False)
            usual = _in_array(fit, i, np.asarray(smooth.gyro)[rows])
            felt = _felt(fit, i, event.log, t_s, leap, usual, samples.period_s)
            if felt is not None:
                what, size = KNOCK if felt > FELT else FALSE_READING, float(np.linalg.norm(leap, axis=1).max())
                leaps.append(ArrayEvent(what, unit.number, float(t_s.mean()), size, felt=felt, units=(unit.number,)))
    # Simultaneous steps of several units that all felt are one knock, that of the unit with the largest step.
    kept: list[ArrayEvent] = []
    for step in sorted(leaps, key=lambda each: -each.size):
        same = [k for k, one in enumerate(kept) if one.what == step.what == KNOCK and abs(one.at_s - step.at_s) < TOGETHER_S]
        if same:
            kept[same[0]] = replace(kept[same[0]], units=tuple(sorted({*kept[same[0]].units, *step.units})))
        else:
            kept.append(step)
    # Impacts that more than half of the accelerometers show at once, without those already found as a step
    logs = [(unit.number, log.samples) for unit in fit.units for log in unit.problem.session.logs]
    found = sorted((float(samples.t_ns[each.row] * NS), number) for number, samples in logs for each in find_impacts(samples))
    for at_s, _ in found:
        who = tuple(sorted({number for other_s, number in found if abs(other_s - at_s) < TOGETHER_S}))
        known = any(abs(each.at_s - at_s) < TOGETHER_S for each in kept)
        if fit.same.time_s[0, 0] <= at_s <= fit.same.time_s[-1, 1] and not known and len(who) > len(fit.units) / 2:
            kept.append(ArrayEvent(KNOCK, who[0], at_s, 0.0, felt=1.0, units=who))
    return tuple(sorted(kept, key=lambda each: each.at_s))


def _in_array(fit: ArrayFit, i: int, rate: np.ndarray, bias: bool = True) -> np.ndarray:
    """Convert measured rates (K, 3) of the i-th unit, or their differences, to rates of the body in the array's axes."""
    unit = fit.units[i]
    return np.asarray((rate @ unit.model.E.T + (unit.model.B if bias else 0.0)) @ unit.place.mounting.T)


def _felt(fit: ArrayFit, i: int, log: int, t_s: np.ndarray, leap: np.ndarray, usual: np.ndarray, period_s: float) -> float | None:
    """Return the share of the step in the mean of the others; None where no other unit has data."""
    shares = []
    for late in np.arange(-NEIGHBOURS, NEIGHBOURS + 1) * period_s / 2:
        others = []
        for j, other in enumerate(fit.units):
            if j == i or log >= len(other.problem.session.logs):
                continue
            samples = other.problem.session.logs[log].samples
            theirs = samples.t_ns * NS
            near = slice(*np.searchsorted(theirs, [t_s[0] - NEAR_S, t_s[-1] + NEAR_S]))
            if not theirs[near].size or theirs[near][0] > t_s[0] + late or theirs[near][-1] < t_s[-1] + late:
                continue
            rate = _in_array(fit, j, np.asarray(samples.gyro[near]))
            others.append(np.column_stack([np.interp(t_s + late, theirs[near], axis) for axis in rate.T]) - usual)
        if others:
            shares.append(float(np.sum(np.median(others, axis=0) * leap) / np.sum(leap**2)))
    return max(shares) if shares else None


# What an array shows next to the explanations of its units: what they share, and whose each named effect is.

SCHEMA = "tinygc-array-explain/3"
#: scopes of statements that speak for a common cause, and for one unit's own
OF_ALL, OF_ONE = {COMMON, ALIKE}, {"own", DIFFERS, READINGS}
#: largest share of the units' errors that is taken to be one error of all
NEARLY_ALL = 0.99


@dataclass(frozen=True, eq=False, repr=False)
class ArrayShown(Shown):
    """Explanations of an array's units, and statements of the array, in SI; ``summary()``, ``to_json()``, ``save(folder)``.

    fit, whose split states the parts of the closure; units: the explanation of each by its number, which holds the checks on other
    recordings; not_explained: the reason why a unit has none, by number; statements: of the parts of the closure, of the noise at rest, of
    slow motions of the zero-rate offsets, and of each effect that a unit names; steps of readings.
    """

    fit: ArrayFit
    units: dict[int, Why]
    not_explained: dict[int, str]
    statements: list[Statement]
    steps: tuple[ArrayEvent, ...]

    def __repr__(self) -> str:
        return f"<ArrayShown {self.fit.array.name}: {self.verdict}>"

    @cached_property
    def verdict(self) -> str:
        """Return where the evidence is: ``common``, ``own`` or ``common_and_own``; ``no_mismatch`` where both parts are bounded, else
        ``undecided``."""
        events = self.fit.joint.events
        at_once = {len(event.together(events)) for event in events}  # 1: a unit alone; 0 (all of them) and several: not one unit's own
        scopes = {each.figures.get("scope") for each in self.statements if each.standing is Standing.FOR}
        common, own = bool(scopes & OF_ALL or at_once - {1}), bool(scopes & OF_ONE or 1 in at_once)
        if common or own:
            return "_and_".join(["common"] * common + ["own"] * own)
        split = self.fit.split
        return "no_mismatch" if {split.common.standing, split.alone.standing} == {Standing.BOUNDED} else "undecided"

    @property
    def line(self) -> Text:
        """Return the verdict, and what there is evidence for."""
        stated = [each for each in self.statements if each.standing is Standing.FOR and each.figures.get("scope") in OF_ALL | OF_ONE]
        units = f"{len(self.fit.units)} units"
        if self.verdict == "no_mismatch":
            return one_line(f"OK: nothing beyond the model shows in {units}.", "bold")
        answer = Answer(self.verdict, "; ".join(each.what for each in stated) or f"{units}, each alone and all together")
        return one_line(answer.headline, "bold")

    @property
    def page(self) -> Group:
        """Return the command's output: verdict, statements, events, each unit's own excess, and the checks on other recordings."""
        header = ("unit", "own error, °", "95 % below", "effects in its own session")
        rows, checked = [], []
        for number, part in zip(self.fit.numbers, self.fit.split.own, strict=True):
            named = self.not_explained.get(number)
            if (why := self.units.get(number)) is not None:
                named = ", ".join(each.id for each in (*why.effects, *why.findings))
                checked += [one_line(f"Unit {number}", "bold"), *checked_page(why.checked)] if why.checked else []
            rows.append([number, degrees_text(part.value / DEG), degrees_text(part.upper / DEG), named or None])
        lines = [one_line(sentence(each)) for each in self.statements]
        table = Table("", header, rows, left=(0, 3))
        return screen([self.line, *lines, *events_and_left_out(self.fit, self.steps), table, *checked])

    def to_json(self) -> dict:
        """Return ``tinygc-array-explain/3`` (docs/formats.md); times in seconds of the array's clock from its first sample."""
        fit = self.fit
        return plain(
            {
                "schema": SCHEMA,
                "array": fit.array.name,
                "verdict": self.verdict,
                "statements": [each.table() for each in self.statements],
                "split": fit.split.table(),
                "units": [self._unit(number, part) for number, part in zip(fit.numbers, fit.split.own, strict=True)],
                "events": [event.table(fit.begins_s) for event in fit.joint.events],
                "moments": [step.table(fit.begins_s) for step in self.steps],
                "left_out": fit.left_out_table,
                "version": VERSION,
            }
        )

    def _unit(self, number: int, part: Statement) -> dict:
        why = self.units.get(number)
        verdict, file = (None, None) if why is None else (why.verdict, f"unit{number}/explain.json")
        return {"number": number, "verdict": verdict, "error": self.not_explained.get(number), "own": part.table(), "explained": file}

    def save(self, folder: Path | str | None = None) -> Path:
        """Write ``array.json``, and each unit's ``unit3/explain.json``, into a folder (``explain`` in the array's); return it."""
        folder = self.fit.array.own_folder("explain") if folder is None else Path(folder)
        with result_folder(folder):
            for number, why in self.units.items():
                why.save(folder / f"unit{number}", pictures=False)
            write_whole(folder / NAME, self.to_json())
        return folder


def explain_array(
    array: ArraySession,
    *,
    seed: int = 0,
    use_earth: bool = True,
    on: Sequence[ArraySession] = (),
    progress: Progress = no_report,
) -> ArrayShown:
    """Fit the array, explain each unit as a session of its own, and state of each effect whether units share it, by their evidence.

    on: other recordings of the array, on which each unit's effects are checked, by its number.  Raises the errors of ``fit_array``, and
    DataError for another recording that has none of the units; a unit that cannot be explained alone is reported, and does not stop the
    others.
    """
    for other in on:
        if not {*array.numbers} & {*other.numbers}:
            have, want = (", ".join(map(str, each.numbers)) for each in (other, array))
            raise DataError(f"{other.folder}: it has units {have}, expected some of {want}; give another recording of the same array")
    fit = fit_array(array, use_earth=use_earth, progress=lambda what: progress(what, 0, 1))
    units: dict[int, Why] = {}
    failed: dict[int, str] = {}
    for done, unit in enumerate(fit.units):
        progress(f"explaining unit {unit.number}", done, len(fit.units))
        there = [other.units[other.numbers.index(unit.number)] for other in on if unit.number in other.numbers]
        try:
            units[unit.number] = explain(unit.session, check_on=there, seed=seed, earth=use_earth)
        except CalibrationError as error:
            failed[unit.number] = printable(str(error))
    progress("what is common", 0, 1)
    explanations = {number: why.explanation for number, why in units.items()}
    mountings = [unit.place.mounting for unit in fit.units]
    of_gyros = [mounting @ unit.model.E for mounting, unit in zip(mountings, fit.units, strict=True)]
    rest_noise = noise_at_rest([unit.session for unit in fit.units], [unit.place.clock for unit in fit.units], of_gyros, mountings)
    slow = slow_zero_of(explanations, lambda unit: progress(f"slow motions of the zero-rate offset, unit {unit}", 0, 1))

    def shared(effect: Effect) -> float:
        # The share of the variance of the units' closure that they have in common
        split, at_rest = fit.split, rest_noise.get("gyro")
        common, single = split.common_rad**2, np.mean(split.floors_rad**2 + split.own_rad[:, 0] ** 2)
        shares = {"turn": float(common / (common + single)), "still": 0.0 if at_rest is None else max(at_rest.value, 0.0)}
        return min(max((share for phase, share in shares.items() if phase in effect.observable_in), default=0.0), NEARLY_ALL)

    parts = [fit.split.common, fit.split.fast, fit.split.alone, *rest_noise.values(), slow]
    traits = traits_of(explanations, fit, shared, tuple(failed), set() if slow is None else set(SLOW_ZERO))
    return ArrayShown(fit, units, failed, [each for each in parts if each is not None] + traits, steps_of(fit))
