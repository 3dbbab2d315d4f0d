"""Explain a session from end to end (docs/explain.md)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base import features
from session.base.errors import CalibrationError
from session.base.progress import Progress, no_report
from session.base.units import DEG
from session.detect.findings import Finding, as_arguments
from session.log.folder import Session
from tinygc.closure.prepared import Prepared, prepare
from tinygc.closure.problem import Problem, weighed_down
from tinygc.estimation.options import FitOptions
from tinygc.explanation.claims import DIFFERS, Claim, Considered, common_delays, named_claims, offset_claim
from tinygc.explanation.data_repair import CREEPING, RepairedProblem, repair
from tinygc.explanation.decision import FitClosure, Naming, Proof, Prover, cleared, decide, leaves_more, tilt_rms
from tinygc.explanation.search import detection_limits
from tinygc.fitting.fit import fit_session
from tinygc.fitting.results import FitResult
from tinygc.inference.choose import LEVEL
from tinygc.inference.decide import KINDS
from tinygc.noise.channels import in_gauge, own_p_values, within_stills
from tinygc.noise.components import STILL_RATE, TURN, UNDERSAMPLED, SessionNoise
from tinygc.noise.measured import measured_noise
from tinygc.noise.refit import Refit, Replay, over_shapes, refit
from tinygc.noise.turn_gravity import TurnGravity, turn_gravity
from tinygc.noise.twin import State, Twin, twin_of
from tinygc.noise.whitening import Whitener
from tinygc.verdict.acceptance import Acceptance
from tinygc.verdict.model_tests import NOISE, ModelTest, contradictions, least_p

#: a delay that is measured without the twin
DELAY = "timing.gyro_accel_offset"


@dataclass(eq=False)
class Explanation:
    """The result of an explanation, against any reference; docs/explain.md defines the verdicts.

    gravity: during the turns, where stills bound them. findings: shapes without a name. own_p: p-values of each channel by itself, before
    and after. detection_limits: effect id -> detection limit in its parameter's unit. decision: the verdict of ``fit`` on this session,
    which is explained here; None where no fit was possible, and with a further reference. shown: what such a reference, or a machine
    that turned the sensor, shows as well (``REFERENCE`` of session/base/features.py).
    """

    session: Session
    problem: Problem
    repaired: RepairedProblem
    twin: Twin
    naming: Naming
    gravity: TurnGravity | None
    proof: Proof
    verdict: str
    p_value: float
    claimed: list[Claim] = field(default_factory=list)
    findings: list[Claim] = field(default_factory=list)
    own_p: dict[str, tuple[float, float]] = field(default_factory=dict)
    warnings: list[Finding] = field(default_factory=list)
    detection_limits: dict[str, float] = field(default_factory=dict)
    within: dict[str, np.ndarray] = field(default_factory=dict)
    considered: list[Considered] = field(default_factory=list)
    decision: Acceptance | None = None
    shown: Any = None

    @property
    def whiten(self) -> Whitener:
        """Whitener with the estimated noise."""
        return self.naming.whiten

    @property
    def noise(self) -> SessionNoise:
        """The estimated noise and its components."""
        return self.naming.noise

    @property
    def fit(self) -> Refit:
        """The fit with what is claimed."""
        return self.naming.fit

    @property
    def measured(self) -> dict[str, tuple[np.ndarray, np.ndarray] | None]:
        """id of an effect that no channel of the twin shows -> its parameters and their covariance: the delay between two clocks, None
        where it is not known."""
        if self.gravity is None:
            found: dict[str, tuple[np.ndarray, np.ndarray] | None] = self.shown.measured
            return found
        return {DELAY: (np.array([self.gravity.offset_s]), np.array([[self.gravity.whole_sigma_s**2]]))}

    def closure_without(self, state: State) -> float | None:
        """Held-out closure rms, rad, that ``fit`` states without the effects of a state; None where it does not settle."""
        stated = self.proof.stated
        angles = FitClosure.of(cleared(stated.base(self.problem, self.twin, state), self.twin, state), stated.options).held_out
        return None if angles is None else tilt_rms(angles)

    @property
    def contradictions(self) -> list[ModelTest]:
        """The tests of ``fit`` by which the recording contradicts its model."""
        return [] if self.decision is None else contradictions(self.decision.tests)

    @property
    def words(self) -> tuple[str, str]:
        """The verdict in words, and its style."""
        differs = {component.name for component, _, _ in self.noise.beyond} & {TURN, STILL_RATE, UNDERSAMPLED}
        if self.verdict == "unexplained" and [test.name for test in self.contradictions] == [NOISE] and differs:
            return DIFFERS, KINDS[self.verdict].style
        return KINDS[self.verdict][:2]

    @cached_property
    def replay(self) -> Replay:
        """Replay of the last fit, cached for the plots."""
        return Replay(self.twin, self.naming.fit) if self.naming.replay is None else self.naming.replay.of(self.naming.fit)

    def __repr__(self) -> str:
        return f"<Explanation {self.session.name}: {self.verdict}>"


def explain_session(
    session: Session | Path,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Progress = no_report,
    prepared: Prepared | None = None,
    noise: Path | None = None,
    fit: FitResult | None = None,
) -> Explanation:
    """Explain a session's mismatch.  prepared: the session, if it has been prepared already; noise:
    figures at rest of the unit (``noise.measured.measured_noise``); fit: of the session, if it was fitted, whose verdict is explained.
    Raises what ``prepare`` raises.

    A given calibration of the accelerometer is not changed: whether it is correct is one of the hypotheses.
    """
    prepared = prepared or prepare(session, use_earth=use_earth, at_rest=measured_noise(noise), progress=lambda what: progress(what, 0, 6))
    progress("least squares", 1, 6)
    fitted, reference = prepared.problem, prepared.session.reference
    fit = fit.without_physics if fit is not None else _fitted(prepared, use_earth) if reference is None else None
    prepared = prepared.as_given()
    session, problem = prepared.session, prepared.problem
    repaired, twin, naming, proof = named_in(problem, FitClosure.stated_by(fit, fitted), seed, progress)
    whiten, gravity = naming.whiten, turn_gravity(twin, naming.fit) if twin.stills else None
    shown = None if reference is None else reference.shown(repaired, twin, naming.first, naming.fit, naming.noise)
    beyond_noise = naming.first.chi_square - (len(naming.first.r) - naming.first.J.shape[1])
    named = named_claims(naming.fit, naming.named, beyond_noise)
    before_the_fit = [*repaired.found.values(), *([] if gravity is None else offset_claim(gravity))]
    beyond = named_claims(naming.fit, naming.beyond, beyond_noise)
    claimed = before_the_fit + named + naming.undersampled
    claimed = claimed if shown is None else shown.all_claims(claimed)
    # What is detected along the catalogue's columns is a mismatch where it has a name; else the tests of ``fit`` decide.
    decision = None if fit is None or reference is not None else fit.verdict()
    p_values = [claim.p_value for claim in claimed] + ([naming.p_value] if claimed or beyond or decision is None else [])
    p_value = min([*p_values, *([] if decision is None else least_p(decision.tests))])
    explanation = Explanation(session, problem, repaired, twin, naming, gravity, proof, "", p_value, claimed, beyond)
    explanation.decision, explanation.shown = decision, shown
    rejected = [*(Considered(name, p) for name, p in naming.considered.items()), *repaired.considered]
    explanation.considered = sorted(rejected, key=lambda each: -each.probability)
    before, after = (own_p_values(twin, whiten, fit) for fit in (naming.first, naming.fit))
    explanation.own_p = {name: (before[name], after[name]) for name in before}
    explanation.within = within_stills(twin)
    explanation.detection_limits = detection_limits(twin, whiten, naming.fit, explanation.replay)
    explanation.warnings = prepared.warnings + weighed_down(session.name, problem.widened) + _heading_not_used(problem)
    explanation.verdict = _verdict(explanation)
    if reference is None:
        explanation.shown = features.first("explanation of what turned", explanation, seed)
    return explanation


def _fitted(prepared: Prepared, use_earth: bool) -> FitResult | None:
    """What ``fit`` makes of the session; None where it does not settle."""
    try:
        return fit_session(prepared.session, FitOptions(methods=("least_squares",), earth=use_earth), prepared=prepared)
    except CalibrationError:
        return None


def named_in(problem: Problem, stated: FitClosure, seed: int, progress: Progress) -> tuple[RepairedProblem, Twin, Naming, Proof]:
    """Repair a problem, select the effects, and prove them; stated: by ``fit`` for this session."""
    repaired = repair(problem, lambda what: progress(what, 2, 6))
    if repaired.recorded is not None:
        problem, stated = repaired.recorded, FitClosure.of(repaired.recorded, stated.options)
    twin, naming, proof = _decided(problem, repaired, seed, progress, stated)
    # Removing a creeping still joins two turns into one, which is longer and for that reason alone closes worse.
    if repaired.found.keys() - {CREEPING} and proof.worse:
        repaired = replace(repaired, problem=problem, found={})  # a repair that makes the closure worse is rejected
        twin, naming, proof = _decided(problem, repaired, seed, progress, stated)
    return repaired, twin, naming, proof


def _decided(
    problem: Problem,
    repaired: RepairedProblem,
    seed: int,
    progress: Progress,
    stated: FitClosure,
) -> tuple[Twin, Naming, Proof]:
    """Build the twin of the repaired problem, select its effects, and prove both on held-out segments."""
    progress("digital twin", 3, 6)
    twin = stated.twin if stated.twin is not None and stated.twin.problem is repaired.problem else twin_of(repaired.problem)
    prove = Prover(problem, twin, stated)
    naming = decide(twin, seed, lambda what: progress(what, 4, 6), repaired.reference, prove)
    naming = replace(naming, fit=settled(twin, naming.whiten, naming.fit))
    progress("proof on held-out segments", 5, 6)
    fit = naming.fit
    if naming.beyond:  # an unnamed shape is not part of a model: what is handed on has no such shape
        fit = settled(twin, naming.whiten, refit(twin, naming.whiten, [named.effect for named in naming.named], twin.start()))
    return twin, naming, prove(naming.whiten, fit)


def settled(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """The fit in the gauge of its effects, with the covariance that unknown shapes leave it.  The reference's clock takes what a delay of
    the sensor has common to all axes."""
    effects = [claim.effect for claim in fit.state.claims]
    if twin.clock is not None and twin.clock not in effects and any(effect.id in common_delays() for effect in effects):
        fit = refit(twin, whiten, [twin.clock, *effects], fit.state)
    return over_shapes(twin, whiten, in_gauge(twin, whiten, fit))


def _heading_not_used(problem: Problem) -> list[Finding]:
    """Warn if the stills contradict the heading in session.toml, so that the heading from the stills was used."""
    given, earth = problem.session.config.site.heading_deg, problem.earth
    if given is None or earth.source != "estimated" or earth.heading_rad is None:
        return []
    seen = f"{earth.heading_rad / DEG:.0f}° ± {earth.heading_sigma_rad / DEG:.0f}°"
    text = f"site.heading_deg = {given:g}, the stills give {seen}, which was used"
    finding = Finding("warning", "session.toml", "heading", text, "did the sensor begin at the table's index?")
    return [as_arguments(finding) if problem.session.in_memory else finding]


def _verdict(explanation: Explanation) -> str:
    e = explanation
    if e.decision is None:
        contradicted = e.naming.unusual or e.naming.first_p <= LEVEL
    else:  # as ``fit`` answers, but for a limit: what meets none may well have no mismatch
        failed = [text for met, text in e.decision.reasons if met is False]
        contradicted = bool(e.contradictions) or not set(failed).isdisjoint(e.decision.unsound)
    if not e.claimed:
        return "unexplained" if contradicted or e.findings else "no_mismatch"
    clocks_alone = [claim.effect.id for claim in e.claimed] == [DELAY]
    if leaves_more(e.twin, e.naming, e.proof) or (clocks_alone and contradicted):
        return "partly_explained"
    return "ambiguous" if any(claim.equivalent for claim in e.claimed) else "explained"
