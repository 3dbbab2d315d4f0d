"""``check`` and ``explain`` of an array, and their text in the terminal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from session import VERSION
from session.annexes.arrays.recording import ArraySession
from session.detect.check_references import with_own_accelerometer
from session.detect.events import find_impacts
from session.detect.findings import Finding, worst
from session.detect.first_look import check_session
from session.detect.stills import SessionStills
from session.io.errors import CalibrationError
from session.io.files import result_folder
from session.io.folder import Session
from session.io.results import write_whole
from session.io.texts import printable
from session.io.units import DEG, NS, G
from tinygc.annexes.arrays.clocks import ClockFit
from tinygc.annexes.arrays.extrinsics import clock_fits
from tinygc.annexes.arrays.fit import ArrayFit, UnitFit, begins_s, event_to_json, fit_array, split_to_json
from tinygc.annexes.arrays.joint import COMMON_STILL, COMMON_TURN, OWN_P, OWN_TURN, ArrayEvent
from tinygc.annexes.arrays.model import ArrayModel
from tinygc.estimation.choice import run_figures
from tinygc.explanation.engine import Explanation, explain_session
from tinygc.explanation.faulty_readings import FALSE, bridged, proposed
from tinygc.explanation.result import to_json
from tinygc.reporting.terminal import Group, RenderableType, Table, Text, one_line

# ``check`` and ``explain`` of an array: each unit by itself, and by comparison with the others.

# Check of an array: each unit as a session of its own, then whether all units are on one body.

WHAT = "one body"
PPM = 1e6


def check_array(array: ArraySession, further: Callable[[Session, SessionStills], list[Finding]]) -> list[Finding]:
    """Return the findings of every unit, ``where`` beginning with its number, and of the array.

    further: a check of a unit's whole session and its stills, run where the unit has no error so far.
    """
    findings: list[Finding] = []
    for number, unit in zip(array.numbers, array.units, strict=True):
        session, own = with_own_accelerometer(unit)
        found = SessionStills(session)
        mine = own + check_session(session, found)
        if worst(mine) != "error":
            mine += further(session, found)
        findings += [replace(finding, where=f"unit {number}: {finding.where}") for finding in mine]
    return findings + check_one_body(array)


def check_one_body(array: ArraySession) -> list[Finding]:
    """Check that all units felt the same motion, and report their clocks."""
    try:
        fits = clock_fits(array)
    except CalibrationError as error:
        return [Finding("error", array.name, WHAT, str(error), "")]
    return [
        Finding("ok", f"unit {number}", WHAT, _said(fit, array.numbers[0]), "")
        for number, fit in list(zip(array.numbers, fits, strict=True))[1:]
    ]


def _said(fit: ClockFit, first: int) -> str:
    clock = fit.clock
    way = "slow" if clock.rate > 0 else "fast"
    rate = f"{abs(clock.rate) * PPM:.1f} ± {clock.rate_sigma * PPM:.1f} ppm {way}"
    return (
        f"its rates follow unit {first}'s by {fit.agreement:.4f} of 1; against it its clock is {clock.offset_s * 1e3:+.2f} ± "
        f"{clock.offset_sigma_s * 1e3:.2f} ms and " + (rate if clock.rate else "as fast")
    )


# Steps in one unit's register: did the other units feel them? A false reading is in one unit, a knock in all.

FALSE_READING, KNOCK = "false reading", "knock"
#: share of the step below which the others have not felt it (benchmarks/array_fit.py: knocks agree to a tenth)
FELT = 0.5
#: samples around the step in which the others may see it, by their clocks
BESIDE = 1
#: s around a step that are read from the others
NEAR_S = 0.1
#: s, duration of a board's impact: steps of several units within it are one knock
TOGETHER_S = 0.05


@dataclass(frozen=True, eq=False)
class Moment:
    """A false reading or a knock.

    what: ``false reading`` or ``knock``; at_s of the array's clock; unit: number of the unit with the step, or with the largest one of a
    knock; size_rps of the step, 0 for a knock that only accelerometers show; felt: share of it that the other units feel; units: numbers of
    those in which a detector found it.
    """

    what: str
    at_s: float
    unit: int
    size_rps: float
    felt: float
    units: tuple[int, ...]

    @property
    def words(self) -> str:
        """Return whether it belongs to one unit or to all."""
        leap, felt = f"leaps by {self.size_rps / DEG:.3g}°/s", f"{100 * max(self.felt, 0.0):.0f} % of it"
        if self.what == FALSE_READING:
            return f"unit {self.unit} alone {leap}, the others feel {felt}: a false reading"
        if self.size_rps:
            return f"unit {self.unit} {leap}, and the others feel {felt}: a knock, no false reading"
        return f"{len(self.units)} units' specific force jumps at once: a knock that all felt"


def moments_of(fit: ArrayFit) -> list[Moment]:
    """Return the steps found by any unit's detector, and the impacts, in order of time."""
    leaps = []
    for i, unit in enumerate(fit.prepared):
        session = unit.problem.session
        events = [event for event in proposed(session) if event.id == FALSE]
        calm = bridged(session, events)
        for event in events:
            rows = np.arange(event.row, event.row + event.samples)
            samples, smooth = (each.logs[event.log].samples for each in (session, calm))
            t_s = samples.t_ns[rows] * NS
            leap = _in_array(fit, i, np.asarray(samples.gyro)[rows] - np.asarray(smooth.gyro)[rows], bias=False)
            usual = _in_array(fit, i, np.asarray(smooth.gyro)[rows])
            felt = _felt(fit, i, event.log, t_s, leap, usual, samples.period_s)
            if felt is None:
                continue
            what = KNOCK if felt > FELT else FALSE_READING
            size = float(np.linalg.norm(leap, axis=1).max())
            leaps.append(Moment(what, float(t_s.mean()), unit.number, size, felt, (unit.number,)))
    leaps = _one_knock_each(leaps)
    return sorted([*leaps, *_impacts(fit, leaps)], key=lambda moment: moment.at_s)


def _one_knock_each(leaps: list[Moment]) -> list[Moment]:
    """Merge simultaneous steps of several units that all felt into one knock, that of the unit with the largest step."""
    kept: list[Moment] = []
    for leap in sorted(leaps, key=lambda moment: -moment.size_rps):
        same = [k for k, one in enumerate(kept) if one.what == leap.what == KNOCK and abs(one.at_s - leap.at_s) < TOGETHER_S]
        if same:
            one = kept[same[0]]
            kept[same[0]] = replace(one, units=tuple(sorted({*one.units, *leap.units})))
        else:
            kept.append(leap)
    return kept


def _in_array(fit: ArrayFit, i: int, rate: np.ndarray, bias: bool = True) -> np.ndarray:
    """Convert measured rates (K, 3) of the i-th unit, or their differences, to rates of the body in the array's axes."""
    unit = fit.units[i]
    return np.asarray((rate @ unit.model.E.T + (unit.model.B if bias else 0.0)) @ unit.place.mounting.T)


def _felt(fit: ArrayFit, i: int, log: int, t_s: np.ndarray, leap: np.ndarray, usual: np.ndarray, period_s: float) -> float | None:
    """Return the share of the step in the mean of the others; None where no other unit has data."""
    shares = []
    for late in np.arange(-BESIDE, BESIDE + 1) * period_s / 2:
        others = []
        for j, other in enumerate(fit.prepared):
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


def _impacts(fit: ArrayFit, leaps: list[Moment]) -> list[Moment]:
    """Return impacts that more than half of the accelerometers show at once, without those already found as a step."""
    found: list[tuple[float, int]] = []
    for unit in fit.prepared:
        for log in unit.problem.session.logs:
            found += [(log.samples.t_ns[each.row] * NS, unit.number) for each in find_impacts(log.samples)]
    moments: list[Moment] = []
    spans = [(float(a), float(b)) for a, b in fit.same.time_s]
    for at_s, _ in sorted(found):
        who = tuple(sorted({number for other_s, number in found if abs(other_s - at_s) < TOGETHER_S}))
        inside = spans[0][0] <= at_s <= spans[-1][1]
        told = any(abs(moment.at_s - at_s) < TOGETHER_S for moment in (*leaps, *moments))
        if inside and not told and len(who) > len(fit.units) / 2:
            moments.append(Moment(KNOCK, float(at_s), who[0], 0.0, 1.0, who))
    return moments


# Explanation of an array: each unit by itself, and by comparison with the others.
#
# An effect in one unit only is that unit's own. An effect in all units is not a sensor error: it comes from the motion, the table or the
# reference.

OWN, SOME, COMMON, ALIKE = "own", "some", "common", "alike"
#: effects of motion and of stills, which belong to the body and not to a sensor
OF_THE_BODY = ("motion", "still", "reference", "earth")


@dataclass(frozen=True)
class Trait:
    """A reported effect and the units it is in.

    whose: ``own`` of one unit, ``some``, ``common`` to all through the body, or ``alike`` in all; says: a description for each unit, in
    order; unknown: units that could not be explained.
    """

    id: str
    units: tuple[int, ...]
    whose: str
    says: tuple[str, ...]
    unknown: tuple[int, ...] = ()
    instead: tuple[str, ...] = ()  #: equivalent effects, which a unit's own data cannot separate from it

    @property
    def words(self) -> str:
        """Return a sentence that states which units have it."""
        if self.unknown:
            plural = "s" * (len(self.unknown) != 1)
            return f"{self._whose}; unit{plural} {', '.join(map(str, self.unknown))} could not be explained, and may have it too"
        return self._whose

    @property
    def _whose(self) -> str:
        named = ", ".join(map(str, self.units))
        if self.instead and self.whose in (OWN, SOME):
            where = f"unit {named} alone" if self.whose == OWN else f"units {named}, not in the others"
            either = " or ".join((self.id, *self.instead))
            return f"{either} in {where}: something of their own, and which of these the recording does not tell"
        if self.whose == OWN:
            whose = "readings" if self.id.startswith(("data.", "timing.")) else "physics"
            return f"{self.id} in unit {named} alone: that unit's own {whose} ({self.says[0]})"
        if self.whose == SOME:
            return f"{self.id} in units {named}, not in the others: these units' own physics"
        if self.whose == COMMON:
            return f"{self.id} in all units: what they have in common (motion, table, reference), no unit's sensor"
        return f"{self.id} in all units: what they share (motion, table, reference, temperature), or what sensors of this kind have"


@dataclass(frozen=True, eq=False)
class ArrayExplanation:
    """Explanation of an array.

    fit; explanations of the units by number; not_explained: the reason why a unit has none, by number; traits; moments.
    """

    fit: ArrayFit
    explanations: dict[int, Explanation]
    not_explained: dict[int, str]
    traits: tuple[Trait, ...]
    moments: tuple[Moment, ...]

    @property
    def verdict(self) -> str:
        """Return ``no_mismatch``, or where the effects are: ``common``, ``own``, or ``common_and_own``."""
        events = self.fit.joint.events
        at_once = {len(event.together(events)) for event in events}  # 1: a unit alone; 0 (all of them) and several: not one unit's own
        common = self.fit.split.p_value < 0.01 or any(trait.whose in (COMMON, ALIKE) for trait in self.traits) or bool(at_once - {1})
        own = any(trait.whose in (OWN, SOME) for trait in self.traits) or 1 in at_once
        own = own or bool((self.fit.split.own_p < OWN_P).any())
        if common and own:
            return "common_and_own"
        return "common" if common else "own" if own else "no_mismatch"


def explain_array(
    array: ArraySession,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> ArrayExplanation:
    """Fit the array, explain each unit as a session of its own, and attribute each effect to one unit or to all.

    Raises the errors of ``fit_array``; a unit that cannot be explained alone is reported, and does not stop the others.
    """
    fit = fit_array(array, use_earth=use_earth, progress=lambda what: progress(what, 0, 1))
    explanations: dict[int, Explanation] = {}
    failed: dict[int, str] = {}
    for done, unit in enumerate(fit.units):
        progress(f"explaining unit {unit.number}", done, len(fit.units))
        try:
            explanations[unit.number] = explain_session(unit.session, seed=seed, use_earth=use_earth)
        except CalibrationError as error:
            failed[unit.number] = printable(str(error))
    return ArrayExplanation(fit, explanations, failed, _traits(explanations, tuple(failed)), tuple(moments_of(fit)))


def _traits(explanations: dict[int, Explanation], unknown: tuple[int, ...]) -> tuple[Trait, ...]:
    """Attribute the effects to units; while any unit is unknown (could not be explained), no effect is reported as in all."""
    named: dict[str, dict[int, str]] = {}
    kinds: dict[str, str] = {}
    instead: dict[str, dict[str, None]] = {}
    for number, e in explanations.items():
        for claim in e.claimed:
            named.setdefault(claim.effect.id, {})[number] = claim.says
            kinds[claim.effect.id] = claim.effect.kind
            instead.setdefault(claim.effect.id, {}).update(dict.fromkeys(claim.equivalent))
    found = []
    for name, by_unit in named.items():
        if len(by_unit) == len(explanations) and len(by_unit) > 1 and not unknown:
            whose = COMMON if kinds[name] in OF_THE_BODY or name.split(".")[0] in OF_THE_BODY else ALIKE
        else:
            whose = OWN if len(by_unit) == 1 else SOME
        found.append(Trait(name, tuple(by_unit), whose, tuple(by_unit.values()), unknown, tuple(instead[name])))
    return tuple(found)


# An array's explanation as ``tinygc-array-explain/2`` (docs/formats.md).

SCHEMA = "tinygc-array-explain/2"
NAME = "array.json"


def explained_to_json(found: ArrayExplanation) -> dict:
    """Return the whole result, JSON-ready; times in seconds of the array's clock from its first sample."""
    fit = found.fit
    return {
        "schema": SCHEMA,
        "array": fit.array.name,
        "verdict": found.verdict,
        "split": split_to_json(fit.split),
        "units": [
            {
                "number": unit.number,
                "verdict": found.explanations[unit.number].verdict if unit.number in found.explanations else None,
                "error": found.not_explained.get(unit.number),
                "own_rms_deg": unit.own_rad[0] / DEG,
                "own_sigma_deg": unit.own_rad[1] / DEG if np.isfinite(unit.own_rad[1]) else None,
                "own_p_value": float(p),
                "explained": f"unit{unit.number}/explain.json" if unit.number in found.explanations else None,
            }
            for unit, p in zip(fit.units, fit.split.own_p, strict=True)
        ],
        "traits": [
            {"id": trait.id, "units": list(trait.units), "scope": trait.whose, "description": trait.words, "of_units": list(trait.says)}
            for trait in found.traits
        ],
        "events": [event_to_json(event, fit) for event in fit.joint.events],
        "moments": [_moment(moment, begins_s(fit)) for moment in found.moments],
        "left_out": [{"number": unit.number, "why": unit.why} for unit in fit.left_out],
        "version": VERSION,
    }


def _moment(moment: Moment, begins: float) -> dict:
    return {
        "what": moment.what,
        "at_s": moment.at_s - begins,
        "unit": moment.unit,
        "units": list(moment.units),
        "size_dps": moment.size_rps / DEG,
        "felt_by_others": moment.felt,
        "description": moment.words,
    }


def save_array_explanation(found: ArrayExplanation, folder: Path | None = None) -> Path:
    """Write ``array.json``, and each unit's ``unit3/explain.json``, into a folder, ``explain`` in the array's; return it.

    Raises CalibrationError if the array has no folder and none is given.
    """
    array = found.fit.array
    if folder is None and not array.folder.is_dir():
        raise CalibrationError(f"{array.name}: made of arrays, it has no folder of its own; give one to save to")
    folder = folder or array.folder / "explain"
    with result_folder(folder):
        for number, explanation in found.explanations.items():
            with result_folder(folder / f"unit{number}"):
                write_whole(folder / f"unit{number}" / "explain.json", to_json(explanation))
        write_whole(folder / NAME, explained_to_json(found))
    return folder


# Terminal output of an array's fit and explanation.

# Terminal output of an array's fit.


def array_page(fit: ArrayFit) -> Group:
    """Return the page: extrinsics, closure, common errors, events, and what was left out."""
    parts: list[RenderableType] = [_places(fit), "", _closure(fit), ""]
    parts.append(one_line(f"Common: {fit.split.words}."))
    parts += [one_line(_bias_words(fit)), one_line(_fused_words(fit.fused))]
    for unit in fit.units:
        runs = ", ".join(f"{run.file} {run_figures(error)['rmse_deg']:.4f}°" for run, error in unit.runs)
        parts += [one_line(f"Closure runs of unit {unit.number}, rms error at the return: {runs}.")] if runs else []
        parts += [one_line(f"Unit {unit.number}: not observed: {', '.join(unit.unobserved)}.", "yellow")] if unit.unobserved else []
    if fit.ages:
        ages = ", ".join(f"unit {each.number} ({each.beat_hz:.3g} Hz)" for each in fit.ages)
        parts.append(one_line(f"Readings wait for the reader, and their ages beat: {ages}; the stamps were corrected."))
    parts += [one_line(f"{line}.", "yellow") for line in event_lines(fit)]
    parts += [one_line(f"Left out: unit {unit.number}: {unit.why}", "bold red") for unit in fit.left_out]
    return Group(*parts)


def _places(fit: ArrayFit) -> Table:
    table = Table(title="Units against the first: clock, mounting, position", title_justify="left", box=None, padding=(0, 1))
    for column in ("unit", "serial", "clock, ms", "rate, ppm", "mounting about x, y, z, deg", "± deg", "position, mm", "± mm"):
        table.add_column(column, justify="left" if column == "serial" else "right", overflow="fold")
    for unit in fit.units:
        table.add_row(*_place(unit, unit is fit.units[0]))
    return table


def _place(unit: UnitFit, first: bool) -> list[str]:
    place, clock = unit.place, unit.place.clock
    name = [str(unit.number), printable(unit.session.config.sensor.serial)]
    if first:
        return [*name, "0", "0", "0, 0, 0", "–", "0, 0, 0", "–"]
    turn = Rotation.from_matrix(place.mounting).as_rotvec() / DEG
    sigma = float(np.sqrt(np.trace(place.mounting_covariance) / 3)) / DEG
    where, known = "not told by the motion", "–"
    if place.position_m is not None and place.position_covariance is not None:
        where = ", ".join(f"{x * 1e3:.1f}" for x in place.position_m)
        known = f"{float(np.sqrt(np.trace(place.position_covariance) / 3)) * 1e3:.1f}"
    return [
        *name,
        f"{clock.offset_s * 1e3:.3f} ± {clock.offset_sigma_s * 1e3:.3f}",
        f"{clock.rate * 1e6:.1f} ± {clock.rate_sigma * 1e6:.1f}",
        ", ".join(f"{x:.3f}" for x in turn),
        f"{sigma:.3f}",
        where,
        known,
    ]


def _closure(fit: ArrayFit) -> Table:
    title = "What turns miss by, degrees of tilt, rms a turn, and how much better the array knows each unit than it knows itself"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1))
    for column in ("unit", "closure alone", "white floor", "own excess", "unit minus mean", "scale, ppm: alone", "array"):
        table.add_column(column, justify="right", overflow="fold")
    for unit in fit.units:
        own, sigma = (part / DEG for part in unit.own_rad)
        diagonal = [0, 4, 8]
        alone, array = (float(np.sqrt(np.mean(s[diagonal] ** 2))) * 1e6 for s in (unit.sigma_alone, unit.sigma))
        table.add_row(
            str(unit.number),
            f"{unit.closure_rad / DEG:.4f}",
            f"{unit.floor_rad / DEG:.4f}",
            f"{own:.4f} ± {sigma:.4f}",
            f"{unit.minus_mean_rad / DEG:.4f}",
            f"± {alone:.0f}",
            f"± {array:.0f}",
        )
    split = fit.split
    table.add_row("all", "", "", f"common {split.common / DEG:.4f}", f"{split.minus_mean_rad / DEG:.4f}", "", "", style="bold")
    return table


def _bias_words(fit: ArrayFit) -> str:
    where = {"ends": "from the ends of the turns", "stills": "of each turn from the stills around it"}[fit.bias]
    why = "as asked" if fit.bias_p is None else f"the stills are better by chance with p = {fit.bias_p:.2g}"
    turns = sum(len(rows) for rows in fit.same.turns)
    return f"Biases {where} ({why}). {turns} turns of {len(fit.units)} units, {len(fit.same.spans)} of the body."


def _fused_words(model: ArrayModel) -> str:
    """Describe the fused noise with the units' own, and the gain of as many equal units."""
    own = [1e3 * float(np.sqrt(np.mean(np.diag(unit.in_array(unit.noise_density))))) / DEG for unit in model.units]
    fused, alone = 1e3 * float(np.sqrt(np.mean(model.noise_density**2))) / DEG, float(np.sqrt(np.mean(np.square(own))))
    count = len(model)
    return (
        f"All units as one gyroscope: {fused:.3g} mdps/rtHz of white noise, as far as they do not share it, where one has "
        f"{min(own):.3g} to {max(own):.3g}, rms {alone:.3g}: {alone / fused:.2f} times less than rms; {count} equal ones would have "
        f"{np.sqrt(count):.2f} times less."
    )


def event_words(event: ArrayEvent, fit: ArrayFit) -> str:
    """Describe an event, the units it belongs to, and its treatment."""
    at = fit.same.time_s[event.first, 1 if "turn" in event.what else 0] - begins_s(fit)
    if event.what == COMMON_TURN:
        return f"{at:.1f} s: all units miss this turn by {event.size / DEG:.2g}°: a knock or the motion, no unit's reading"
    if event.what == COMMON_STILL:
        return f"{at:.1f} s: all units feel {1e3 * event.size / G:.2g} mg in this still: the body was not at rest"
    assert event.unit is not None
    number = fit.units[event.unit].number
    if event.rival is not None:
        both = f"units {number} and {fit.units[event.rival].number}"
        size = f"{event.size / DEG:.2g}°" if event.what == OWN_TURN else f"{1e3 * event.size / G:.2g} mg"
        where = "turn" if event.what == OWN_TURN else "still"
        return f"{at:.1f} s: {both} differ by {size} in this {where}, and two do not tell which one errs; unit {number}'s does not count"
    spoilt = event.together(fit.joint.events)
    others = len(fit.units) - len(spoilt)
    if len(spoilt) > 1:
        return f"{at:.1f} s: {_several_words(spoilt, fit)}"
    whom = f"the other {others} do not" if others > 1 else "the other does not"
    if event.what == OWN_TURN:
        return f"{at:.1f} s: unit {number} misses this turn by {event.size / DEG:.2g}°, {whom}: its own readings; its turn does not count"
    return f"{at:.1f} s: unit {number} feels {1e3 * event.size / G:.2g} mg too much in this still, {whom}; its gravity there does not count"


def event_lines(fit: ArrayFit) -> list[str]:
    """Return a line for each event; one line for several units with events in one turn or still."""
    return list(dict.fromkeys(event_words(event, fit) for event in fit.joint.events))


def _several_words(events: tuple[ArrayEvent, ...], fit: ArrayFit) -> str:
    turn = events[0].what == OWN_TURN
    in_order = sorted(events, key=lambda event: fit.units[event.unit or 0].number)
    sizes = (f"{e.size / DEG:.2g}°" if turn else f"{1e3 * e.size / G:.2g} mg" for e in in_order)
    who = ", ".join(f"unit {fit.units[e.unit or 0].number} by {size}" for e, size in zip(in_order, sizes, strict=True))
    where, lost = ("turn", "their turns do not count") if turn else ("still", "their gravity there does not count")
    return (
        f"{len(events)} of {len(fit.units)} units stand out in this {where}, each in its own way ({who}): several at once are hardly "
        f"their own readings: a blow that each unit feels or samples otherwise is more probable; {lost}"
    )


# Terminal output of an array's explanation.

VERDICTS = {
    "no_mismatch": "no mismatch: every unit turns as its calibration says",
    "common": "what turns miss by is common to all units: none of the sensors",
    "own": "what turns miss by is the units' own",
    "common_and_own": "part of what turns miss by is common to all units, part is some units' own",
}
#: most events listed one by one
MOST_MOMENTS = 12


def array_verdict_line(found: ArrayExplanation) -> Text:
    """Return one line with the array's verdict."""
    return one_line(f"{found.fit.array.name}: {VERDICTS[found.verdict]}", "bold")


def array_explain_page(found: ArrayExplanation) -> Group:
    """Return the page: the verdict, the common part, the units of each effect, the events, and each unit's own verdict."""
    fit = found.fit
    parts: list[RenderableType] = [array_verdict_line(found), one_line(f"Common: {fit.split.words}.")]
    parts += [one_line(f"{trait.words}.") for trait in found.traits]
    begins = begins_s(fit)
    parts += [one_line(f"{moment.at_s - begins:.2f} s: {moment.words}.", "yellow") for moment in found.moments[:MOST_MOMENTS]]
    if len(found.moments) > MOST_MOMENTS:
        parts.append(one_line(f"… and {len(found.moments) - MOST_MOMENTS} moments more, in array.json."))
    parts += [one_line(f"{line}.", "yellow") for line in event_lines(fit)]
    table = Table(title="Each unit by itself", title_justify="left", box=None, padding=(0, 1))
    for column in ("unit", "own excess, deg", "verdict alone", "named"):
        table.add_column(column, justify="left" if column in ("verdict alone", "named") else "right", overflow="fold")
    for unit in fit.units:
        explanation = found.explanations.get(unit.number)
        named = ", ".join(claim.effect.id for claim in explanation.claimed) if explanation else found.not_explained[unit.number]
        own, sigma = (part / DEG for part in unit.own_rad)
        table.add_row(str(unit.number), f"{own:.4f} ± {sigma:.4f}", explanation.verdict if explanation else "not explained", named or "–")
    parts += ["", table]
    parts += [one_line(f"Left out: unit {unit.number}: {unit.why}", "bold red") for unit in fit.left_out]
    return Group(*parts)
