"""PASS, NOT DECIDED or FAIL: the verdict on a calibration, by the one rule that ``fit``, ``report`` and ``fleet`` apply.

With a limit, neither the held-out closure of the segments nor the error of any closure run may exceed it.  Without a limit, both must agree
with noise (p at least 0.01), and the limit of the closure is what the sensor's data sheet promises for such turns (``promise_of``): its own
noise would pass a noisy unit.  Without a data sheet there is no PASS, but the closure in words.  Either way a calibration fails
if held-out segments close worse with it than with the raw rates, and does not pass where the recording contradicts the model
(``model_tests.py``).  Requirements of session.toml, or of a file, count as well; whether a value meets its limits is decided in
``inference.decide``.

A pass needs evidence.  With few segments a fit follows almost anything, so held-out closure must be near its floor on enough segments.  A
closure far below its floor means that noise or references are not what they are taken for.  An error that is common to all references, or a
data rate that was not measured, biases E without any effect on closure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from session.base.numeric import rms_of, sigmas_in
from session.base.records import plain
from session.base.texts import degrees, probability, significant
from session.base.units import DEG, DEG_PER_HOUR, MDPS, MG
from session.detect.accelerometer import PARAMETERS as ACCELEROMETER_PARAMETERS
from session.detect.check_stills import ENOUGH_SEGMENTS
from session.log.requirements import CLOSURE, CLOSURE_RUN, Requirements, Rule
from tinygc.closure.floor import ACCEL_NOISE, GYRO_NOISE, SINGLE_SEGMENTS, STAMPS
from tinygc.closure.problem import Problem
from tinygc.closure.runs import ClosureRun
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.choice import AgainstRaw
from tinygc.estimation.options import METHODS
from tinygc.estimation.spread import USUAL, ZERO, Spread, drift_between
from tinygc.estimation.systematic import Systematic
from tinygc.inference.choose import MISMATCH_P, chi_square_above
from tinygc.inference.decide import KINDS, Conformity, Fact
from tinygc.inference.noise import wander_covariance
from tinygc.inference.solve import Source, known_sources
from tinygc.models.linear import BIAS, PARAMETERS, field_facts
from tinygc.verdict.model_tests import RUN, TURNS, ModelTest, contradictions
from tinygc.verdict.requirements import (
    attitude_measured,
    closure_measured,
    conformity,
    rule_words,
    run_measured,
    sensor_measured,
)

#: above this ratio to its floor, held-out closure is not noise, whatever the residuals of the fit
NEAR_FLOOR = 2.0
#: probability that noise leaves as little as the fitted segments do; below it the noise or the references are not what they seem
TOO_GOOD_P = 1e-4
#: where the limit of the closure is from that ``limit_deg`` gives
GIVEN = "limit of the closure, as it was given to the program"


# What a sensor's data sheet promises for the turns of a session: the limit of their closure where none is given.
#
#     variance of a turn's tilt, rad^2:   N^2 T  +  2 T^2 C_ii(B)  +  references
#
# N: one-sided density of white noise, of which each of two axes has half; T: the turn's seconds; C(B): covariance of flicker noise of the
# stated bias instability at the turns' middles, about their mean; references: the accelerometer's stated noise over the stills at both
# ends, or a truth's sigma; errors of a log's stamps are none of it.  Figures of session.toml take the place of the data sheet's.  ST states
# no nonlinearity; where a sheet does, as 0.1 or 0.2 % of full scale, it bounds the whole range, of which E takes up all that a session's
# turns share: no limit of a turn follows from it.

#: ratio of the noise of a unit to that of its data sheet, above which it is no such unit: units differ by 1.4 at most (``check_noise``)
NOISIER = 1.4
#: figures of a data sheet that a promise is made of
GYRO_DENSITY, ACCEL_DENSITY, INSTABILITY = "gyro_noise_mdps_rthz", "accel_noise_ug_rthz", "gyro_bias_instability_dph"


@dataclass(frozen=True)
class Promise:
    """turn_s: median duration of the turns; tilt_rms, rad, that they close to by ``source``, None where the sensor's noise is not
    known; noisier: how much more this unit has, in words, empty where it has no more than units do."""

    turn_s: float
    tilt_rms: float | None = None
    source: str = ""
    noisier: str = ""


def promise_of(problem: Problem) -> Promise:
    """What is promised for the used segments of a problem."""
    sensor, turn_s = problem.session.config.sensor, float(np.median(problem.batch.duration_s))
    named = problem.session.config.model_given
    typical, accel, drifts = (sensor.typical(name) if named else None for name in (GYRO_DENSITY, ACCEL_DENSITY, INSTABILITY))
    if sensor.gyro_noise_mdps_rthz is not None:
        density, source = sensor.gyro_noise_mdps_rthz, "the noise in session.toml"
    elif typical is not None:
        source, density = f"{'an' if typical[0][0] in 'AEFHILMNORSX' else 'a'} {typical[0]}'s data sheet", typical[1]
    else:
        return Promise(turn_s)
    unit_accel = float(np.mean(problem.noise.accel**2))
    shares = dict.fromkeys((GYRO_NOISE, SINGLE_SEGMENTS, STAMPS), 0.0)
    shares[ACCEL_NOISE] = 1.0 if accel is None else (accel[1] * 1e-3 * MG) ** 2 / unit_accel
    drift = np.zeros(len(problem.used))
    instability = sensor.gyro_bias_instability_dph or (0.0 if drifts is None else drifts[1])
    if instability:
        of_turns = wander_covariance(problem.middle_s, instability_rps=instability * DEG_PER_HOUR)
        drift = np.diag(of_turns) - 2 * of_turns.mean(axis=0) + of_turns.mean()
    tilt = (density * MDPS) ** 2 * problem.batch.duration_s + 2 * problem.batch.duration_s**2 * drift
    for cause, part in problem.floor.parts.items():
        tilt = tilt + shares.get(cause, 1.0) * (part.own[:, 0, 0] + part.own[:, 1, 1])
    unit = rms_of(problem.noise.gyro) / MDPS
    noisier = f"this unit has {significant(unit, 2)} mdps/√Hz of noise, its data sheet {density:g}" if unit > NOISIER * density else ""
    return Promise(turn_s, float(np.sqrt(np.mean(tilt))), source, noisier)


@dataclass(frozen=True, eq=False)
class CandidateFit:
    """The figures of a calibration that a verdict looks at.

    angles (S, d) rad held out, of the segments with these numbers; vector of its parameters; floor_rms rad of tilt that noise alone leaves;
    closure_p: p-value of the closure on fitted segments, with its degrees of freedom (None: with more data than these segments); of each
    closure run the errors (3,) rad, the p-value, and a sentence where samples seem lost.  For requirements: run_floors (3,)
    rad of each run, one sigma from noise alone; covariance (P, P) of the vector, its sources, names of parameters that are not observed,
    and what one missing effect may have moved, None where that is not known.
    """

    angles: np.ndarray
    numbers: list[int]
    vector: np.ndarray
    floor_rms: float
    closure_p: float
    closure_freedom: int | None
    run_errors: list[np.ndarray]
    run_p: list[float]
    run_losses: list[str]
    run_floors: list[np.ndarray] = field(default_factory=list)
    covariance: np.ndarray | None = None
    sources: tuple[Source, ...] = ()
    unobserved: tuple[str, ...] = ()
    allowed: Systematic | None = None


@dataclass(frozen=True)
class Acceptance:
    """Verdict on a calibration.

    passed; rule, one sentence; reasons, a sentence for each figure and whether it meets the rule, None where that is not decided; doubts, a
    sentence for each reason why a pass is weak evidence; by_limit: whether a limit of the closure was given;
    closure: what closes to what, in words; conformities: each value that has limits, against them; undecided: a sentence for
    each that is neither PASS nor FAIL; unsound: reasons not met that no limit has: noise does not explain the closure, the recording
    contradicts the model, or the raw rates close better, so that the uncertainties may not hold; limit_deg of the closure, in use, and
    where it is from, None without one; tests of the model by the recording.
    """

    passed: bool
    rule: str
    reasons: list[tuple[bool | None, str]]
    doubts: list[str]
    by_limit: bool
    closure: str = ""
    conformities: list[Conformity] = field(default_factory=list)
    undecided: list[str] = field(default_factory=list)
    unsound: list[str] = field(default_factory=list)
    limit_deg: float | None = None
    limit_from: str | None = None
    tests: tuple[ModelTest, ...] = ()

    @property
    def answer(self) -> str:
        """One of pass, doubtful pass, no limit, not decided, fail.  A given limit decides; doubts are stated with the result."""
        if not self.passed:
            return "fail"
        if self.undecided:
            return "not decided"
        if self.doubts:
            return "doubtful pass" if self.by_limit else "not decided"
        return "pass" if self.by_limit or self.limit_deg is not None or self.conformities else "no limit"

    @property
    def word(self) -> str:
        """The answer in words for the user."""
        return KINDS[self.answer].word

    def to_json(self) -> dict:
        """Return ``verdict`` of ``tinygc-fit/2``."""
        return {
            "answer": self.answer,
            "headline": self.headline,
            "rule": self.rule.replace("\n", " "),
            "limit_deg": self.limit_deg,
            "limit_from": self.limit_from,
            "reasons": [{"met": met, "reason": text} for met, text in self.reasons],
            "doubts": self.doubts,
            "undecided": self.undecided,
            "tests": plain(self.tests),
            "conformity": [each.to_json() for each in self.conformities],
        }

    @property
    def headline(self) -> str:
        """The answer and its first reason, in one line."""
        return f"{self.word}: {[*self._reasons, self.closure][0]}"

    @property
    def further(self) -> list[str]:
        """Its other reasons."""
        return self._reasons[1:]

    @property
    def _reasons(self) -> list[str]:
        missed = [text for met, text in self.reasons if met is False]
        return [*missed, *self.undecided] or self.doubts

    @property
    def risks(self) -> list[str]:
        """A sentence for each value that has limits: what it is, with U, and the risk that the answer is wrong."""
        return [each.words for each in self.conformities]


def decide(
    candidate: CandidateFit,
    files: Sequence[str],
    limit_deg: float | None,
    raw: AgainstRaw | None = None,
    accelerometer: AccelerometerFit | None = None,
    doubts: Sequence[str] = (),
    requirements: Requirements | None = None,
    tests: Sequence[ModelTest] = (),
    promise: Promise | None = None,
) -> Acceptance:
    """Decide whether the calibration passes.

    files: the names of the closure runs; raw: comparison with the raw rates; accelerometer that gives the references; doubts: further
    reasons for which a pass is weak evidence; requirements: limits, of which limit_deg takes the place of those of the closure; tests of
    this model; promise: what the sensor's data sheet states for these turns.
    """
    tilt, times = tilt_rms(candidate.angles), tilt_rms(candidate.angles) / candidate.floor_rms
    closure_p = candidate.closure_p if np.isfinite(tilt) else float("nan")
    held_out = f"held-out turns close to {degrees(tilt)}"
    required = requirements or Requirements()
    if limit_deg is not None:
        closes = Requirements(dict.fromkeys((CLOSURE, CLOSURE_RUN), (-np.inf, limit_deg)), Rule(), GIVEN)
    else:
        closes = replace(required, limits={key: required.limits[key] for key in (CLOSURE, CLOSURE_RUN) if key in required.limits})
    segments = conformity(closes, [closure_measured(candidate.angles, candidate.numbers)])
    floors = [*candidate.run_floors, *[None] * (len(files) - len(candidate.run_floors))]
    runs = conformity(closes, [run_measured(*each) for each in zip(files, candidate.run_errors, floors, strict=True)])
    others = conformity(required, _others(candidate, accelerometer)) if set(required.limits) - {CLOSURE, CLOSURE_RUN} else []
    promised_rad = None if promise is None else promise.tilt_rms
    rules = []
    reasons: list[tuple[bool | None, str]]
    if segments:
        reasons = [_against(held_out, segments[0])]
    else:
        reasons = [_by_chance("the turns close", closure_p, f"to {significant(times, 2)} × their noise floor, ")]
        if reasons[0][0]:  # of the fitted segments; the held-out ones are a little further from the floor
            reasons = [(True, f"residuals look like noise ({probability(closure_p)})")]
    if runs:
        reasons += [
            _against(f"{f} is off by {degrees(rms_of(e))}", each) for f, e, each in zip(files, candidate.run_errors, runs, strict=True)
        ]
    else:
        for file, error, p in zip(files, candidate.run_errors, candidate.run_p, strict=True):
            size = rms_of(error)
            reasons.append(_by_chance(f"{file} is off", p if np.isfinite(size) else float("nan"), f"by {degrees(size)}, "))
    if limit_deg is not None:
        rules.append(f"Rule: held-out turns and closure runs close to at most {significant(limit_deg, 3)}°.")
    elif not segments or (len(files) and not runs):
        least = min((p for p in (closure_p, *candidate.run_p) if np.isfinite(p)), default=float("nan"))
        turns = f"turns {len(candidate.numbers)} (at least {ENOUGH_SEGMENTS})"
        rules.append(f"Rule: residuals like noise ({probability(least)}, at least {MISMATCH_P:g}), {turns}.")
    if required.limits and (others or limit_deg is None):
        rules += [f"Requirements of {required.source or 'the user'}.", rule_words(required.rule)]
    rule = "\n".join(rules)
    reasons = [(met, f"{text}; {lost}" if lost else text) for (met, text), lost in zip(reasons, ["", *candidate.run_losses], strict=True)]
    by_chance = [each for each, by in zip(reasons, [segments, *[runs] * len(files)], strict=True) if not by]
    unsound = [text for met, text in by_chance if not met]
    reasons += [_against(f"{each.measured.name}: {each.value_words}", each) for each in others]
    if raw is not None and raw.condemns(tilt / DEG):
        named = METHODS[raw.method].title
        reasons.append((False, f"{held_out}, worse than the {significant(raw.tilt_rms_deg, 2)}° of the raw rates ({named})"))
        unsound.append(reasons[-1][1])
        rule += "\nWorse than the raw rates is a fail in any case."
    limit, source = limit_deg, None if limit_deg is None else GIVEN
    if segments:
        most = segments[0].limits[1]
        limit, source = (float(most), required.source if limit_deg is None else GIVEN) if np.isfinite(most) else (None, None)
    elif promise is not None and promised_rad is not None:
        limit, source = NEAR_FLOOR * promised_rad / DEG, f"twice {promise.source}"
    against = contradictions(tests)
    decided = [*segments, *runs, *others]
    by_limit = {TURNS: segments, RUN: runs}  # without a limit they are reasons above
    undecided = [test.description for test in against if by_limit.get(test.name, True)]
    undecided += [test.description for test in tests if test.leaves_open]
    unsound += undecided
    if not segments and limit is not None and tilt / DEG > limit:
        more = f"; {promise.noisier}" if promise is not None and promise.noisier else ""
        undecided.append(f"{held_out}, limit {significant(limit, 2)}°{more}")
    closure = f"{held_out} (noise {degrees(tilt / times)})" if limit is None else f"{held_out} (limit {significant(limit, 2)}°)"
    if len(files):
        run = ("run" if limit is None else "closure run") + "s" * (len(files) > 1)
        closure += f", {run} to {degrees(max(map(rms_of, candidate.run_errors)))}"
    found = [*_doubts(candidate, times, accelerometer), *doubts]
    if not segments and promise is not None and promise.noisier:
        found.append(f"noisier than {promise.source}: {promise.noisier}")
    unclear = [each for each in decided if each.answer == "not decided"]
    undecided += [f"{each.measured.name.partition(',')[0]} is {each.value_words} ({_undecided(each)})" for each in unclear]
    undecided += [text for met, text in by_chance if met is None]
    passed = all(met is not False for met, _ in reasons)
    if passed and limit is None and not (decided or undecided or found):
        rule += "\nPASS needs a limit: --sensor NAME or --limit DEG."
    return Acceptance(passed, rule, reasons, found, bool(segments), closure, decided, undecided, unsound, limit, source, tuple(tests))


def _others(candidate: CandidateFit, accelerometer: AccelerometerFit | None) -> list[Fact]:
    """The values other than the closure that may have limits."""
    found = [] if accelerometer is None else sensor_measured("accel", accelerometer.facts)
    if candidate.covariance is not None:
        vector, covariance = candidate.vector[:PARAMETERS], candidate.covariance[:PARAMETERS, :PARAMETERS]
        moved = None if candidate.allowed is None else candidate.allowed.of
        errors = field_facts(vector, covariance, candidate.unobserved, moved, candidate.sources)
        attitude = attitude_measured(vector, known_sources(candidate.sources, covariance), candidate.unobserved)
        found = [*sensor_measured("gyro", errors), *found, attitude]
    return found


def _undecided(each: Conformity) -> str:
    if each.rule.least_ratio is not None and each.measured.observed and np.isfinite(each.measured.value):
        return f"{each.limit_words}: its test uncertainty ratio is below {each.rule.least_ratio:g}"
    return each.limit_words


def _doubts(candidate: CandidateFit, times_floor: float, accelerometer: AccelerometerFit | None) -> list[str]:
    """Reasons why a pass is weak evidence.  An accelerometer's error is common to all references, so closure does not show it."""
    doubts, in_numbers = [], f"{len(candidate.numbers)} segments for {len(candidate.vector)} parameters"
    if len(candidate.numbers) < ENOUGH_SEGMENTS:
        doubts.append(f"{len(candidate.numbers)} turns for {len(candidate.vector)} parameters: record at least {ENOUGH_SEGMENTS}")
    if times_floor > NEAR_FLOOR:
        doubts.append(f"held-out turns close to {significant(times_floor)} times what noise alone leaves ({in_numbers})")
    if accelerometer is None:
        return doubts
    if accelerometer.unobserved:
        none = len(accelerometer.unobserved) == ACCELEROMETER_PARAMETERS
        left = f"not observed: {'all of its numbers' if none else ', '.join(accelerometer.unobserved)}"
        doubts.append(f"accelerometer: {left}; its errors there are in E, unseen by the closure: rest it on more sides")
    return doubts


def _against(what: str, each: Conformity) -> tuple[bool | None, str]:
    """Whether a value meets its limits, None where that is not decided, and how it stands to them."""
    if each.answer == "not decided":
        return None, f"{what}, required {_undecided(each)}"
    lower, upper = each.limits
    if np.isfinite(lower):
        return each.answer == "pass", f"{what}, {'within' if each.answer == 'pass' else 'outside'} {each.limit_words}"
    unit = each.measured.unit if each.measured.unit == "°" else f" {each.measured.unit}"
    return each.answer == "pass", f"{what}, {'within' if each.answer == 'pass' else 'above'} {significant(upper, 3)}{unit}"


def _by_chance(what: str, p: float, size: str) -> tuple[bool | None, str]:
    if not np.isfinite(p):
        return None, f"{what} by a number that is not finite"
    return agrees(p), f"{what} {size}{'as noise explains' if agrees(p) else 'more than noise'} ({probability(p)})"


def agrees(p_value: float) -> bool:
    """Whether noise explains the residual."""
    return p_value >= MISMATCH_P


def too_good(white_p: float) -> list[str]:
    """Doubt about a closure below what white noise alone leaves; white_p: p-value of the closure against that noise."""
    if 1 - white_p >= TOO_GOOD_P:
        return []
    return [
        "the fitted turns close better than the noise at rest allows: it is not their noise, or rates and references depend on each other"
    ]


def too_wide(tilt_rms_rad: float, limit_deg: float | None, raw: AgainstRaw) -> list[str]:
    """Doubt about a calibration that one effect may have moved by more than the limit allows, or by more than it corrects; tilt_rms_rad: by
    which other turns like these would then be missed."""
    most_deg = raw.tilt_rms_deg if limit_deg is None else limit_deg
    if tilt_rms_rad / DEG <= most_deg:
        return []
    than = "what the raw rates leave" if limit_deg is None else "the limit"
    return [f"one effect missing from the model may have moved E and B by {degrees(tilt_rms_rad)} of a turn, more than {than}"]


# Closure runs against everything that is known to be uncertain in them.


def run_p_values(
    problem: Problem,
    runs: Sequence[ClosureRun],
    vector: np.ndarray,
    covariance: np.ndarray,
    errors: Callable[[np.ndarray, ClosureRun], np.ndarray],
    spread: Spread = USUAL,
    left: Sequence[np.ndarray] | None = None,
) -> list[float]:
    """P-value of each closure run's error: noise, the parameters' uncertainty, the Earth's unknown heading, bias drift since the session.

    vector (P,), covariance (P, P) of the calibration, the 12 linear parameters first; errors: roll, pitch, yaw (3,) rad of a run under a
    trial vector; spread: of the unit between sessions, for a run whose clock began again, where it is the unit's own; left: the
    errors to test, those of ``vector`` if None.
    """
    found, sigma, session = [], sigmas_in(covariance), problem.session
    by_same = {log.path.name for log in session.closures if session.nominal_rate is None or session.rate_of(log) is not None}
    for number, run in enumerate(runs):
        error, known = errors(vector, run), covariance
        if session.clock is not None and run.file in by_same:  # what a wrong clock does to the scale cancels in such a run
            known = covariance - session.clock.covariance(vector)
        slope = np.stack([(errors(vector + step, run) - error) / step.max() for step in np.diag(sigma)], axis=1)
        drift = slope[:, BIAS] * np.sqrt(_wander_since(problem, run))
        if not (run.time_known or spread.at(ZERO).is_usual):  # the sensor may have been switched off
            known = known.copy()
            known[BIAS, BIAS] += spread.at(ZERO).two_draws
        expected = np.diag(run.floor_rad**2) + run.heading_covariance + slope @ known @ slope.T + drift @ drift.T
        residual = error if left is None else left[number]
        found.append(chi_square_above(float(residual @ np.linalg.solve(expected, residual)), 3))
    return found


def _wander_since(problem: Problem, run: ClosureRun) -> float:
    """Variance, (rad/s)^2, of the bias in the run less its mean in the session."""
    middle_s = run.began_s + run.duration_s / 2
    return drift_between(problem.middle_s, problem.batch.duration_s, middle_s, run.duration_s, problem.instability.rps).change
