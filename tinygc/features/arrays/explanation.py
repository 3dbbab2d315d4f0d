"""``explain`` of an array, and its text in the terminal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from session import VERSION
from session.base.errors import CalibrationError
from session.base.files import result_folder
from session.base.numeric import rms_of
from session.base.progress import Progress, untold
from session.base.records import plain, table_of, write_whole
from session.base.texts import printable
from session.base.units import DEG, NS, G
from session.detect.events import find_impacts
from tinygc.effects import Effect
from tinygc.estimation.choice import run_figures
from tinygc.explanation.engine import Explanation, explain_session
from tinygc.explanation.families import SLOW_ZERO
from tinygc.explanation.faulty_readings import FALSE, proposed, without_false_readings
from tinygc.explanation.result import to_json
from tinygc.features.arrays.fit import ArrayFit, UnitFit, begins_s, event_to_json, fit_array, split_to_json
from tinygc.features.arrays.joint import COMMON_STILL, COMMON_TURN, ArrayEvent
from tinygc.features.arrays.recording import ArraySession
from tinygc.features.arrays.rest_noise import SharedNoise, noise_at_rest
from tinygc.features.arrays.slow_zero import PooledSlowZero, slow_zero_of
from tinygc.features.arrays.standings import Part, Parts, parts_of
from tinygc.features.arrays.traits import ALIKE, COMMON, DIFFERS, READINGS, Trait, traits_of
from tinygc.inference.choose import Standing, Statement
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.tables import degrees_text
from tinygc.reporting.terminal import Group, Text, one_line

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
        calm = without_false_readings(session, events)
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
    # Merge simultaneous steps of several units that all felt into one knock, that of the unit with the largest step
    kept: list[Moment] = []
    for step in sorted(leaps, key=lambda moment: -moment.size_rps):
        same = [k for k, one in enumerate(kept) if one.what == step.what == KNOCK and abs(one.at_s - step.at_s) < TOGETHER_S]
        if same:
            one = kept[same[0]]
            kept[same[0]] = replace(one, units=tuple(sorted({*one.units, *step.units})))
        else:
            kept.append(step)
    leaps = kept
    # Impacts that more than half of the accelerometers show at once, without those already found as a step
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
    return sorted([*leaps, *moments], key=lambda moment: moment.at_s)


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


# Explanation of an array: its parts, what its units share, and whose each named effect is.


@dataclass(frozen=True, eq=False)
class ArrayExplanation:
    """Explanation of an array.

    fit; explanations of the units by number; not_explained: the reason why a unit has none, by number; parts; traits; slow_zero: the family
    of slow motions of the zero-rate offsets, None where no unit names a member, or all units can have none; rest_noise: what the
    units' noise at rest has in common, by sensor; moments.
    """

    fit: ArrayFit
    explanations: dict[int, Explanation]
    not_explained: dict[int, str]
    parts: Parts
    traits: tuple[Trait, ...]
    slow_zero: PooledSlowZero | None
    rest_noise: dict[str, SharedNoise]
    moments: tuple[Moment, ...]

    @property
    def statements(self) -> tuple[Statement, ...]:
        """Return all statements that the verdict follows from: the parts that all units and single units miss by, then the effects."""
        slow = () if self.slow_zero is None else (self.slow_zero.statement,)
        return self.parts.common.statement, self.parts.all_own.statement, *slow, *(trait.statement for trait in self.traits)

    @property
    def evidence(self) -> tuple[Statement, ...]:
        """Return those with evidence for them; where there is none, the two parts, with what is excluded of them."""
        there = tuple(statement for statement in self.statements if statement.standing is Standing.FOR)
        return there or self.statements[:2]

    @property
    def verdict(self) -> str:
        """Return where the evidence is: ``common``, ``own`` or ``common_and_own``; ``no_mismatch`` where both parts are bounded, else
        ``undecided``."""
        events = self.fit.joint.events
        at_once = {len(event.together(events)) for event in events}  # 1: a unit alone; 0 (all of them) and several: not one unit's own
        stated = {trait.scope for trait in self.traits if trait.statement.standing is Standing.FOR}
        moves = self.slow_zero is not None and self.slow_zero.statement.standing is Standing.FOR
        standings = [statement.standing for statement in self.statements[:2]]
        common = standings[0] is Standing.FOR or bool(stated & {COMMON, ALIKE}) or bool(at_once - {1}) or moves
        own = standings[1] is Standing.FOR or bool(stated & {DIFFERS, READINGS}) or 1 in at_once
        if common or own:
            return "common_and_own" if common and own else "common" if common else "own"
        return "no_mismatch" if all(standing is Standing.BOUNDED for standing in standings) else "undecided"


def explain_array(
    array: ArraySession,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Progress = untold,
) -> ArrayExplanation:
    """Fit the array, explain each unit as a session of its own, and state of each effect whether units share it, by tests.

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
    progress("what is common", 0, 1)
    parts = parts_of(fit.joint, fit.split, np.array([unit.floor_rad for unit in fit.units]), fit.numbers)
    places = [unit.place for unit in fit.units]
    of_gyros = [place.mounting @ unit.model.E for place, unit in zip(places, fit.units, strict=True)]
    rest_noise = noise_at_rest(
        [unit.session for unit in fit.units], [place.clock for place in places], of_gyros, [place.mounting for place in places]
    )
    slow = slow_zero_of(explanations, lambda unit: progress(f"slow motions of the zero-rate offset, unit {unit}", 0, 1))

    def shared(effect: Effect) -> float:
        # The share of the variance of the units' closure that they have in common
        single = np.mean([unit.floor_rad**2 + part.size_rad**2 for unit, part in zip(fit.units, parts.own, strict=True)])
        of_turns, at_rest = float(parts.common.size_rad**2 / (parts.common.size_rad**2 + single)), rest_noise.get("gyro")
        of_stills = 0.0 if at_rest is None else max(at_rest.value, 0.0)
        return max([of_turns] * ("turn" in effect.observable_in) + [of_stills] * ("still" in effect.observable_in) + [0.0])

    traits = traits_of(explanations, fit, shared, tuple(failed), set() if slow is None else set(SLOW_ZERO))
    return ArrayExplanation(fit, explanations, failed, parts, traits, slow, rest_noise, tuple(moments_of(fit)))


# An array's explanation as ``tinygc-array-explain/2`` (docs/formats.md).

SCHEMA = "tinygc-array-explain/2"
NAME = "array.json"


def explained_to_json(found: ArrayExplanation) -> dict:
    """Return the whole result, JSON-ready; times in seconds of the array's clock from its first sample."""
    fit = found.fit
    return plain(
        {
            "schema": SCHEMA,
            "array": fit.array.name,
            "verdict": found.verdict,
            "statements": [_part(part) for part in (found.parts.common, found.parts.fast, found.parts.all_own) if part is not None],
            "split": split_to_json(fit.split),
            "units": [
                {
                    "number": unit.number,
                    "verdict": found.explanations[unit.number].verdict if unit.number in found.explanations else None,
                    "error": found.not_explained.get(unit.number),
                    "own_rms_deg": unit.own_rad[0] / DEG,
                    "own_sigma_deg": unit.own_rad[1] / DEG if np.isfinite(unit.own_rad[1]) else None,
                    "own_p_value": float(p),
                    "own_upper95_deg": part.upper_rad / DEG,
                    "own_standing": part.standing.value,
                    "explained": f"unit{unit.number}/explain.json" if unit.number in found.explanations else None,
                }
                for unit, p, part in zip(fit.units, fit.split.own_p, found.parts.own, strict=True)
            ],
            "traits": [_trait(trait) for trait in found.traits],
            "slow_zero": None if found.slow_zero is None else _slow_zero(found.slow_zero),
            "rest_noise": {name: _rest_noise(name, shared) for name, shared in found.rest_noise.items()},
            "events": [event_to_json(event, fit) for event in fit.joint.events],
            "moments": [
                {
                    "what": moment.what,
                    "at_s": moment.at_s - begins_s(fit),
                    "unit": moment.unit,
                    "units": moment.units,
                    "size_dps": moment.size_rps / DEG,
                    "felt_by_others": moment.felt,
                    "description": moment.words,
                }
                for moment in found.moments
            ],
            "left_out": [{"number": number, "why": why} for number, why in fit.left_out.items()],
            "version": VERSION,
        }
    )


def _part(part: Part) -> dict:
    sizes = {"size_deg": part.size_rad / DEG, "upper95_deg": part.upper_rad / DEG}
    return {"what": part.statement.what, **table_of(part.statement), **sizes}


def _trait(trait: Trait) -> dict:
    by_unit = [
        {"number": number, "named": each.named, "value": each.theta, "std": each.sigma} for number, each in (trait.estimates or {}).items()
    ]
    stated = table_of(trait.statement) | {"description": trait.words}
    scope = {"scope": trait.scope, "apart": trait.apart, "equivalent": trait.instead}
    return {"id": trait.id, "units": trait.units, **scope, **stated, "of_units": trait.says, "by_unit": by_unit}


def _slow_zero(slow: PooledSlowZero) -> dict:
    sizes = [{"number": n, "size_dps": rps / DEG, "named": slow.named[n]} for n, rps in slow.sizes_rps.items()]
    return {**table_of(slow.statement), "shares": slow.shares, "by_unit": sizes}


def _rest_noise(name: str, shared: SharedNoise) -> dict:
    correlation = {"correlation": shared.value, "correlation_sigma": shared.sigma, "source": shared.source}
    return {**table_of(shared.statement(name)), **correlation}


def save_array_explanation(found: ArrayExplanation, folder: Path, table: dict) -> Path:
    """Write ``array.json`` with this table, and each unit's ``unit3/explain.json``, into a folder; return it."""
    with result_folder(folder):
        for number, explanation in found.explanations.items():
            with result_folder(folder / f"unit{number}"):
                write_whole(folder / f"unit{number}" / "explain.json", to_json(explanation))
        write_whole(folder / NAME, table)
    return folder


# Terminal output of an array's fit and explanation.

# Terminal output of an array's fit.


def array_page(fit: ArrayFit) -> Group:
    """Return the page: extrinsics, closure, common errors, events, and what was left out."""
    header = ("unit", "serial", "clock, ms", "rate, ppm", "mounting about x, y, z, deg", "± deg", "position, mm", "± mm")
    places = [_place(unit, unit is fit.units[0]) for unit in fit.units]
    table = Table("Units against the first: clock, mounting, position", header, places, left=(0, 1))
    parts: list[Any] = [table, "", _closure(fit), ""]
    parts.append(one_line(f"Common: {fit.split.words}."))
    where = {"ends": "from the ends of the turns", "stills": "of each turn from the stills around it"}[fit.bias]
    why = "as asked" if fit.bias_p is None else f"the stills are better by chance with p = {fit.bias_p:.2g}"
    turns = sum(len(rows) for rows in fit.same.turns)
    own = [1e3 * float(np.sqrt(np.mean(np.diag(unit.in_array(unit.noise_density_rps_rthz))))) / DEG for unit in fit.fused.units]
    fused, alone = 1e3 * rms_of(fit.fused.noise_density) / DEG, rms_of(own)
    count = len(fit.fused)
    parts += [
        one_line(f"Biases {where} ({why}). {turns} turns of {len(fit.units)} units, {len(fit.same.spans)} of the body."),
        one_line(
            f"All units as one gyroscope: {fused:.3g} mdps/rtHz of white noise, as far as they do not share it, where one has "
            f"{min(own):.3g} to {max(own):.3g}, rms {alone:.3g}: {alone / fused:.2f} times less than rms; {count} equal ones would have "
            f"{np.sqrt(count):.2f} times less."
        ),
    ]
    for unit in fit.units:
        runs = ", ".join(f"{run.file} {run_figures(error)['rmse_deg']:.4f}°" for run, error in unit.runs)
        parts += [one_line(f"Closure runs of unit {unit.number}, rms error at the return: {runs}.")] if runs else []
        parts += [one_line(f"Unit {unit.number}: not observed: {', '.join(unit.unobserved)}.", "yellow")] if unit.unobserved else []
    if fit.ages:
        ages = ", ".join(f"unit {each.number} ({each.beat_hz:.3g} Hz)" for each in fit.ages)
        parts.append(one_line(f"Readings wait for the reader, and their ages beat: {ages}; the stamps were corrected."))
    return screen([*parts, *_events_and_left_out(fit)])


def _place(unit: UnitFit, first: bool) -> list[Any]:
    place, clock = unit.place, unit.place.clock
    name = [unit.number, unit.session.config.sensor.serial]
    if first:
        return [*name, "0", "0", "0, 0, 0", None, "0, 0, 0", None]
    turn = Rotation.from_matrix(place.mounting).as_rotvec() / DEG
    sigma = float(np.sqrt(np.trace(place.mounting_covariance) / 3)) / DEG
    where, known = "not told by the motion", None
    if place.position_m is not None and place.position_covariance is not None:
        where = ", ".join(f"{x * 1e3:.1f}" for x in place.position_m)
        known = f"{float(np.sqrt(np.trace(place.position_covariance) / 3)) * 1e3:.1f}"
    return [
        *name,
        (clock.offset_s * 1e3, clock.offset_sigma_s * 1e3),
        (clock.rate * 1e6, clock.rate_sigma * 1e6),
        ", ".join(f"{x:.3f}" for x in turn),
        f"{sigma:.3f}",
        where,
        known,
    ]


def _closure(fit: ArrayFit) -> Table:
    title = "What turns miss by, degrees of tilt, rms a turn, and how much better the array knows each unit than it knows itself"
    header = ("unit", "closure alone", "white floor", "own excess", "unit minus mean", "scale, ppm: alone", "array")
    rows: list[list[Any]] = []
    for unit in fit.units:
        alone, array = (f"± {rms_of(s[[0, 4, 8]]) * 1e6:.0f}" for s in (unit.sigma_alone, unit.sigma))
        closure, floor, apart = (degrees_text(size / DEG) for size in (unit.closure_rad, unit.floor_rad, unit.minus_mean_rad))
        rows.append([unit.number, closure, floor, tuple(part / DEG for part in unit.own_rad), apart, alone, array])
    split = fit.split
    rows.append(["all", "", "", f"common {split.common / DEG:.4f}", degrees_text(split.minus_mean_rad / DEG), "", ""])
    return Table(title, header, rows, styles={len(fit.units): "bold"})


def event_words(event: ArrayEvent, fit: ArrayFit) -> str:
    """Describe an event, the units it belongs to, and its treatment."""
    turn = "turn" in event.what
    at, where = f"{fit.same.time_s[event.first, int(turn)] - begins_s(fit):.1f} s:", "turn" if turn else "still"

    def size(of: ArrayEvent) -> str:
        return f"{of.size / DEG:.2g}°" if turn else f"{1e3 * of.size / G:.2g} mg"

    if event.what == COMMON_TURN:
        return f"{at} all units miss this turn by {size(event)}: a knock or the motion, no unit's reading"
    if event.what == COMMON_STILL:
        return f"{at} all units feel {size(event)} in this still: the body was not at rest"
    assert event.unit is not None
    number = fit.units[event.unit].number
    if event.rival is not None:
        both = f"units {number} and {fit.units[event.rival].number}"
        return f"{at} {both} differ by {size(event)} in this {where}, and two do not tell which one errs; unit {number}'s does not count"
    deviating = event.together(fit.joint.events)
    others = len(fit.units) - len(deviating)
    if len(deviating) > 1:
        named = sorted((fit.units[each.unit or 0].number, size(each)) for each in deviating)
        who, lost = ", ".join(f"unit {one} by {by}" for one, by in named), "their turns do not" if turn else "their gravity there does not"
        return (
            f"{at} {len(deviating)} of {len(fit.units)} units stand out in this {where}, each in its own way ({who}): several at "
            f"once are hardly their own readings: a blow that each unit feels or samples otherwise is more probable; {lost} count"
        )
    tested = f"against the other{'s' * (others > 1)} (F test, p = {event.p_value:.2g})"
    if turn:
        return f"{at} unit {number} misses this turn by {size(event)} {tested}: its own readings; its turn does not count"
    return f"{at} unit {number} feels {size(event)} too much in this still {tested}; its gravity there does not count"


def _events_and_left_out(fit: ArrayFit) -> list[Text]:
    """Return a line for each event, one for several units with events in one turn or still, and one for each unit that was left out."""
    events = dict.fromkeys(event_words(event, fit) for event in fit.joint.events)
    left_out = (f"Left out: unit {number}: {why}" for number, why in fit.left_out.items())
    return [*(one_line(f"{line}.", "yellow") for line in events), *(one_line(line, "bold red") for line in left_out)]


# Terminal output of an array's explanation.

#: most events listed one by one
MOST_MOMENTS = 12


def array_verdict_line(found: ArrayExplanation) -> Text:
    """Return one line: the verdict, and the statements that it follows from."""
    said = "; ".join(statement.words for statement in found.evidence)
    return one_line(f"{found.fit.array.name}: {found.verdict.replace('_', ' ')}: {said}", "bold")


def array_explain_page(found: ArrayExplanation) -> Group:
    """Return the page: the verdict, the parts, what is common at rest, whose each effect is, the events, and each unit's own excess."""
    fit = found.fit
    parts: list[Any] = [array_verdict_line(found), ""]
    stated = [part.statement.words for part in (found.parts.common, found.parts.fast, found.parts.all_own) if part is not None]
    stated += [f"{each.statement(name).words}; {each.source}" for name, each in found.rest_noise.items()]
    stated += [] if found.slow_zero is None else [found.slow_zero.statement.words]
    parts += [one_line(f"{words}.") for words in (*stated, *(trait.words for trait in found.traits))]
    begins = begins_s(fit)
    parts += [one_line(f"{moment.at_s - begins:.2f} s: {moment.words}.", "yellow") for moment in found.moments[:MOST_MOMENTS]]
    if len(found.moments) > MOST_MOMENTS:
        parts.append(one_line(f"… and {len(found.moments) - MOST_MOMENTS} moments more, in array.json."))
    parts += _events_and_left_out(fit)
    header = ("unit", "own excess, deg", "95 % below", "p", "standing", "named in its own session")
    rows = []
    for unit, part in zip(fit.units, found.parts.own, strict=True):
        explanation = found.explanations.get(unit.number)
        claims = [] if explanation is None else [*explanation.claimed, *explanation.findings]
        named = ", ".join(claim.effect.id for claim in claims) if explanation else found.not_explained[unit.number]
        sizes = degrees_text(part.size_rad / DEG), degrees_text(part.upper_rad / DEG), f"{part.statement.p_value:.2g}"
        rows.append([unit.number, *sizes, part.statement.standing.value, named or None])
    return screen([*parts, "", Table("Beyond the common part, by unit", header, rows, left=(0, 4, 5))])
