"""Explain a session from end to end (docs/explain.md)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from session.detect.findings import Finding
from session.io.folder import Session
from session.io.units import DEG
from tinygc.annexes.lots.explanation import LotEffect, lot_effects, odds_of
from tinygc.annexes.lots.lot import Lot, Weighed
from tinygc.closure.prepared import Prepared, prepare
from tinygc.closure.problem import Problem, weighed_down
from tinygc.effects import Effect, catalogue
from tinygc.explanation.claims import Claim, Considered, considered_of, mended_claims, named_claims, offset_claim
from tinygc.explanation.data_repair import Mended, mend
from tinygc.explanation.decision import NamingDecision, Proof, decide, prove, tilt_rms
from tinygc.explanation.evidence import FAMILY_WISE, WIDE, candidates, component_names, linear_estimate, without_claim
from tinygc.explanation.search import Naming, seen_from
from tinygc.noise.channels import TurnGravity, WithinStills, channel_p_values, in_gauge, own_p_values, turn_gravity, within_stills
from tinygc.noise.refit import Replay
from tinygc.noise.session_noise import SessionNoise
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# ``calibrate.py explain``: detect, locate, name, refuse, refit, prove (docs/explain.md).


@dataclass(eq=False)
class Explanation:
    """All that was found; see docs/explain.md for the verdicts.

    channel_p, left: of the channels under one calibration, before and after what is claimed; own_p: of each by itself, both;
    seen_from: effect id -> size in its parameter's unit from which it would have shown; of_lot: what its lot knows of its effects.
    """

    session: Session
    problem: Problem
    mended: Mended
    twin: Twin
    whiten: Whitener
    naming: Naming
    gravity: TurnGravity
    proof: Proof
    verdict: str
    p_value: float
    claimed: list[Claim] = field(default_factory=list)
    findings: list[Claim] = field(default_factory=list)
    left: dict[str, float] = field(default_factory=dict)
    channel_p: dict[str, float] = field(default_factory=dict)
    own_p: dict[str, tuple[float, float]] = field(default_factory=dict)
    warnings: list[Finding] = field(default_factory=list)
    seen_from: dict[str, float] = field(default_factory=dict)
    within: WithinStills | None = None
    noise: SessionNoise | None = None
    unusual: bool = False
    considered: list[Considered] = field(default_factory=list)
    of_lot: list[LotEffect] = field(default_factory=list)

    @cached_property
    def replay(self) -> Replay:
        """Of the last fit, which pictures ask for again and again."""
        return Replay(self.twin, self.naming.fit)

    def __repr__(self) -> str:
        return f"<Explanation {self.session.name}: {self.verdict}>"


def explain_session(
    session: Session | Path,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
    prepared: Prepared | None = None,
    lot: Lot | None = None,
) -> Explanation:
    """Explain a session's mismatch.  prepared: the session, where somebody has it already; lot: whose effects the unit may have.
    Raises what ``prepare`` raises.

    A calibration of the accelerometer that is given is taken as it is: whether it holds is one of the hypotheses.
    """
    prepared = prepared or prepare(session, use_earth=use_earth, progress=lambda what: progress(what, 0, 6))
    prepared = prepared.as_given()
    session, problem = prepared.session, prepared.problem
    mended = mend(problem, lambda what: progress(what, 2, 6))
    twin, decision, naming, proof = _decided(problem, mended, seed, progress, lot)
    # Without a still that creeps two turns are one, which is longer and closes worse for that alone.
    in_turns = mended.found.keys() - {"reference.not_still"}
    if in_turns and tilt_rms(proof.after) > tilt_rms(proof.before):
        mended = replace(mended, problem=problem, found={}, p_value={}, misfit=0.0)  # what makes the closure worse mends nothing
        twin, decision, naming, proof = _decided(problem, mended, seed, progress, lot)
    whiten, gravity = decision.whiten, turn_gravity(twin, naming.fit)
    beyond_noise = naming.first.chi_square - (len(naming.first.r) - naming.first.J.shape[1])
    named = named_claims(naming.fit, naming.named, beyond_noise)
    before_the_fit = mended_claims(mended) + offset_claim(gravity, named)
    beyond = named_claims(naming.fit, decision.beyond, beyond_noise)
    claimed = before_the_fit + named + decision.undersampled
    p_value = min([decision.p_value, *(claim.p_value for claim in before_the_fit)])
    explanation = Explanation(session, problem, mended, twin, whiten, naming, gravity, proof, "", p_value, claimed, beyond)
    explanation.noise, explanation.unusual = decision.noise, decision.unusual
    explanation.considered = considered_of(mended, decision.considered)
    explanation.channel_p, explanation.left = (channel_p_values(twin, whiten, fit.r, fit.J) for fit in (naming.first, naming.fit))
    before, after = (own_p_values(twin, whiten, fit) for fit in (naming.first, naming.fit))
    explanation.own_p = {name: (before[name], after[name]) for name in before}
    explanation.within = within_stills(twin)
    explanation.seen_from = seen_from(twin, whiten, naming.fit)
    explanation.warnings = prepared.warnings + weighed_down(session.name, problem.widened) + _heading_not_used(problem)
    explanation.of_lot = [] if lot is None else lot_effects(twin, whiten, naming.fit, lot)
    explanation.verdict = _verdict(explanation)
    return explanation


def _decided(
    problem: Problem, mended: Mended, seed: int, progress: Callable[[str, int, int], None], lot: Lot | None
) -> tuple[Twin, NamingDecision, Naming, Proof]:
    """What is left to explain after the mends, what is named in it, and the proof of both."""
    progress("digital twin", 3, 6)
    twin = Twin(mended.problem)
    decision = decide(twin, seed, lambda what: progress(what, 4, 6), mended.reference, odds_of(lot))
    naming = replace(decision.naming, fit=in_gauge(twin, decision.whiten, decision.naming.fit))
    progress("proof on held-out segments", 5, 6)
    return twin, decision, naming, prove(problem, twin, decision.whiten, naming.fit, decision.before)


def _heading_not_used(problem: Problem) -> list[Finding]:
    """A warning where the stills contradict the heading that session.toml gives, so that theirs was taken."""
    given, earth = problem.session.config.site.heading_deg, problem.earth
    if given is None or earth.source != "estimated" or earth.heading_rad is None:
        return []
    seen = f"{earth.heading_rad / DEG:.0f}° ± {earth.heading_sigma_rad / DEG:.0f}°"
    says = f"site.heading_deg = {given:g}, the stills say {seen}, which was used"
    return [Finding("warning", "session.toml", "heading", says, "did the sensor begin at the table's index?")]


def _verdict(explanation: Explanation) -> str:
    unusual = explanation.unusual
    if not explanation.claimed:
        unnamed = explanation.p_value <= FAMILY_WISE or explanation.findings or unusual
        return "unexplained" if unnamed else "no_mismatch"
    clocks_alone = [claim.effect.id for claim in explanation.claimed] == ["timing.gyro_accel_offset"]
    if explanation.findings or unusual or (clocks_alone and explanation.naming.first_p <= FAMILY_WISE):
        return "partly_explained"
    if any(claim.equivalent for claim in explanation.claimed):
        return "ambiguous"
    return "explained"


# What a session says of every effect of the catalogue, named or not, as a lot pools it (docs/lots.md).
#
# An effect that is weak in each of many units is named in none of them; the estimate is there all the same.  It is that of the effect's
# columns beside the calibration and the other names, linear around the fit: no selection, so that many of them average to the truth.

#: of that prior's sigma, above which a number is not told
SEEN = 0.3
CLOCKS = "timing.gyro_accel_offset"


def effects_of(explanation: Explanation) -> dict[str, Weighed]:
    """Effect id -> what this session says of it, SI; NaN for numbers that it does not tell.

    What is mended before any fit (lost samples, glitches) has no columns and is not among them.  Delays are told by what the axes differ
    by.  An effect whose shape is searched for (the moment of a step) is taken in the middle of what is tried: where it takes up most its
    estimate would be a chosen one.  The delay between gyro and accelerometer is what is beyond the filters' own.  chi_square is that of
    all its numbers together.
    """
    twin, fit, whiten = explanation.twin, explanation.naming.fit, explanation.whiten
    claims = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    chances = {each.id: each.probability for each in explanation.considered}
    chances |= {claim.effect.id: claim.probability for claim in explanation.claimed}
    replay, found = Replay(twin, fit), dict[str, Weighed]()
    forms: dict[str, list[Effect]] = {}
    for effect in candidates(twin):
        forms.setdefault(effect.id, []).append(effect)
    for name, shapes in forms.items():
        effect = shapes[0] if shapes[0].scan is None else shapes[len(shapes) // 2]
        beside = fit if name not in claims else without_claim(fit, claims[name])
        columns = whiten(replay.columns(effect).stacked())
        theta, covariance = linear_estimate(beside.r, beside.J, columns, effect.parameter.plausible)
        told = _told(effect)
        theta, covariance = told @ theta, told @ covariance @ told.T
        chi_square = float(theta @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ theta)
        sigma = np.sqrt(np.diag(covariance))
        unseen = sigma > SEEN * WIDE * effect.parameter.plausible
        theta, sigma = np.where(unseen, np.nan, theta), np.where(unseen, np.nan, sigma)
        found[name] = _weighed(effect, theta, sigma, chi_square, name in claims, chances.get(name))
    gravity, clocks = explanation.gravity, catalogue().get(CLOCKS)
    if clocks is not None and np.isfinite(gravity.offset_s) and np.isfinite(gravity.sigma_s) and gravity.sigma_s > 0:
        beyond = np.sign(gravity.offset_s) * max(abs(gravity.offset_s) - gravity.bar_s, 0.0)
        offset, sigma = np.array([beyond]), np.array([gravity.sigma_s])
        named = any(claim.effect.id == CLOCKS for claim in explanation.claimed)
        found[CLOCKS] = _weighed(clocks, offset, sigma, float((offset / sigma)[0] ** 2), named, chances.get(CLOCKS))
    return found


def _told(effect: Effect) -> np.ndarray:
    """(P, P): the projection on what a closure tells of theta: of delays, what the axes differ by, not what they share."""
    told = np.eye(effect.parameter.size)
    if effect.gauge is not None and effect.gauge.delays:
        told[np.ix_(effect.gauge.delays, effect.gauge.delays)] -= 1 / len(effect.gauge.delays)
    return told


def _weighed(effect: Effect, theta: np.ndarray, sigma: np.ndarray, chi_square: float, named: bool, probability: float | None) -> Weighed:
    names = component_names(effect)
    values, sigmas = (dict(zip(names, map(float, each), strict=True)) for each in (theta, sigma))
    return Weighed(values, sigmas, chi_square, named, probability)
