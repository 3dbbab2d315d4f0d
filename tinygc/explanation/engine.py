"""Explain a session from end to end (docs/explain.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from session.detect.findings import Finding
from session.io.folder import Session
from session.io.units import DEG
from tinygc.closure.prepared import Prepared, prepare
from tinygc.closure.problem import Problem, weighed_down
from tinygc.explanation.claims import Claim, Considered, considered_of, named_claims, offset_claim, repair_claims
from tinygc.explanation.data_repair import RepairedProblem, repair
from tinygc.explanation.decision import Naming, Proof, decide, prove, tilt_rms
from tinygc.explanation.evidence import FAMILY_WISE
from tinygc.explanation.search import seen_from
from tinygc.noise.channels import TurnGravity, WithinStills, channel_p_values, in_gauge, own_p_values, turn_gravity, within_stills
from tinygc.noise.refit import Refit, Replay
from tinygc.noise.session_noise import SessionNoise
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener


class KnownEffect(Protocol):
    """An effect that units of this kind are known to have, as this recording shows it."""

    @property
    def words(self) -> str:
        """One line."""
        ...

    def to_json(self) -> dict[str, Any]:
        """One of ``lot_effects`` of ``tinygc-explain/1``."""
        ...


class KnownEffects(Protocol):
    """What is known of the effects of a kind of unit before one of them is recorded."""

    @property
    def odds(self) -> Mapping[str, float]:
        """Prior odds that a unit has an effect, by the effect's id."""
        ...

    def in_unit(self, twin: Twin, whiten: Whitener, fit: Refit) -> Sequence[KnownEffect]:
        """Each of them in the recorded unit, beside a fit; the most probable first."""
        ...


@dataclass(eq=False)
class Explanation:
    """All that was found; see docs/explain.md for the verdicts.

    findings: what has no name; channel_p, left: of the channels under one calibration, before and after what is claimed; own_p: of each by
    itself, both; seen_from: effect id -> size in its parameter's unit from which it would have shown; of_lot: effects that its kind is
    known to have.
    """

    session: Session
    problem: Problem
    mended: RepairedProblem
    twin: Twin
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
    considered: list[Considered] = field(default_factory=list)
    of_lot: Sequence[KnownEffect] = ()

    @property
    def whiten(self) -> Whitener:
        """With the noise that was estimated."""
        return self.naming.whiten

    @property
    def noise(self) -> SessionNoise:
        """Its components."""
        return self.naming.noise

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
    known: KnownEffects | None = None,
) -> Explanation:
    """Explain a session's mismatch.  prepared: the session, where somebody has it already; known: effects that its kind may have.
    Raises what ``prepare`` raises.

    A calibration of the accelerometer that is given is taken as it is: whether it holds is one of the hypotheses.
    """
    prepared = prepared or prepare(session, use_earth=use_earth, progress=lambda what: progress(what, 0, 6))
    prepared = prepared.as_given()
    session, problem = prepared.session, prepared.problem
    mended = repair(problem, lambda what: progress(what, 2, 6))
    twin, naming, proof = _decided(problem, mended, seed, progress, known)
    # Without a still that creeps two turns are one, which is longer and closes worse for that alone.
    in_turns = mended.found.keys() - {"reference.not_still"}
    if in_turns and tilt_rms(proof.after) > tilt_rms(proof.before):
        mended = replace(mended, problem=problem, found={}, p_value={})  # what makes the closure worse mends nothing
        twin, naming, proof = _decided(problem, mended, seed, progress, known)
    whiten, gravity = naming.whiten, turn_gravity(twin, naming.fit)
    beyond_noise = naming.first.chi_square - (len(naming.first.r) - naming.first.J.shape[1])
    named = named_claims(naming.fit, naming.named, beyond_noise)
    before_the_fit = repair_claims(mended) + offset_claim(gravity, named)
    beyond = named_claims(naming.fit, naming.beyond, beyond_noise)
    claimed = before_the_fit + named + naming.undersampled
    p_value = min([naming.p_value, *(claim.p_value for claim in before_the_fit)])
    explanation = Explanation(session, problem, mended, twin, naming, gravity, proof, "", p_value, claimed, beyond)
    explanation.considered = considered_of(mended, naming.considered)
    explanation.channel_p, explanation.left = (channel_p_values(twin, whiten, fit.r, fit.J) for fit in (naming.first, naming.fit))
    before, after = (own_p_values(twin, whiten, fit) for fit in (naming.first, naming.fit))
    explanation.own_p = {name: (before[name], after[name]) for name in before}
    explanation.within = within_stills(twin)
    explanation.seen_from = seen_from(twin, whiten, naming.fit)
    explanation.warnings = prepared.warnings + weighed_down(session.name, problem.widened) + _heading_not_used(problem)
    explanation.of_lot = () if known is None else known.in_unit(twin, whiten, naming.fit)
    explanation.verdict = _verdict(explanation)
    return explanation


def _decided(
    problem: Problem, mended: RepairedProblem, seed: int, progress: Callable[[str, int, int], None], known: KnownEffects | None
) -> tuple[Twin, Naming, Proof]:
    """What is left to explain after the mends, what is named in it, and the proof of both."""
    progress("digital twin", 3, 6)
    twin = Twin(mended.problem)
    naming = decide(twin, seed, lambda what: progress(what, 4, 6), mended.reference, {} if known is None else known.odds)
    naming = replace(naming, fit=in_gauge(twin, naming.whiten, naming.fit))
    progress("proof on held-out segments", 5, 6)
    return twin, naming, prove(problem, twin, naming.whiten, naming.fit, naming.before)


def _heading_not_used(problem: Problem) -> list[Finding]:
    """A warning where the stills contradict the heading that session.toml gives, so that theirs was taken."""
    given, earth = problem.session.config.site.heading_deg, problem.earth
    if given is None or earth.source != "estimated" or earth.heading_rad is None:
        return []
    seen = f"{earth.heading_rad / DEG:.0f}° ± {earth.heading_sigma_rad / DEG:.0f}°"
    says = f"site.heading_deg = {given:g}, the stills say {seen}, which was used"
    return [Finding("warning", "session.toml", "heading", says, "did the sensor begin at the table's index?")]


def _verdict(explanation: Explanation) -> str:
    unusual = explanation.naming.unusual
    if not explanation.claimed:
        unnamed = explanation.p_value <= FAMILY_WISE or explanation.findings or unusual
        return "unexplained" if unnamed else "no_mismatch"
    clocks_alone = [claim.effect.id for claim in explanation.claimed] == ["timing.gyro_accel_offset"]
    if explanation.findings or unusual or (clocks_alone and explanation.naming.first_p <= FAMILY_WISE):
        return "partly_explained"
    if any(claim.equivalent for claim in explanation.claimed):
        return "ambiguous"
    return "explained"
