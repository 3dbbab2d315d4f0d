"""``calibrate.py explain``: detect, locate, name, refuse, refit, prove (DESIGN, explaining a mismatch)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy import stats

from session.check import Finding, check_session
from session.errors import DataError
from session.folder import Session, read_session
from tinygc.effects import catalogue
from tinygc.effects._effect import Effect
from tinygc.explain.gauge import in_gauge
from tinygc.explain.mending import Mended, mend
from tinygc.explain.naming import Naming, candidates, name_effects
from tinygc.explain.parameters import readable
from tinygc.explain.proof import Proof, prove
from tinygc.explain.rivals import BETTER, best_rival
from tinygc.explain.selection import FAMILY_WISE, SHAPE_SHARE
from tinygc.explain.turn_gravity import TurnGravity, turn_gravity
from tinygc.explain.twin import Twin
from tinygc.explain.unknown import slow_candidates, unknown_candidates
from tinygc.explain.whitening import Whitener
from tinygc.methods import closure_angles
from tinygc.problem import Problem, build_problem

#: what is left after naming is judged at this level, channel by channel
LEFT_P = 1e-3
#: a right name takes up nearly all of the misfit; what it may leave, for what its model simplifies
RIGHT_SHARE = 0.975
MOST_FINDINGS = 2


@dataclass(frozen=True, eq=False)
class Claimed:
    """One effect that is claimed: parameters and their std in people's units, p-value, what could stand in for it."""

    effect: Effect
    parameters: dict
    std: dict
    p_value: float
    gain: float
    equivalent: tuple[str, ...]
    says: str


@dataclass(eq=False)
class Explanation:
    """All that was found; see ``tinygc-explain/1`` in FORMATS for the verdicts."""

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
    claimed: list[Claimed] = field(default_factory=list)
    findings: list[Claimed] = field(default_factory=list)
    left: dict[str, float] = field(default_factory=dict)
    channel_p: dict[str, float] = field(default_factory=dict)
    warnings: list[Finding] = field(default_factory=list)


def explain_session(
    folder: Path, *, seed: int = 0, use_earth: bool = True, progress: Callable[[str, int, int], None] = lambda what, done, of: None
) -> Explanation:
    """Explain a session's mismatch.  Raises what ``read_session`` and ``build_problem`` raise, and DataError for a boring cause."""
    session = read_session(folder, lambda name: progress(f"reading {name}", 0, 6))
    progress("boring causes first", 1, 6)
    findings = check_session(session)
    for finding in findings:
        if finding.level == "error":
            raise DataError(f"{finding.where}: {finding.what}: {finding.says}" + (f"; {finding.do}" if finding.do else ""))
    problem = build_problem(session, use_earth=use_earth)
    mended = mend(problem, lambda what: progress(what, 2, 6))
    progress("digital twin", 3, 6)
    twin = Twin(mended.problem)
    whiten = Whitener(twin)
    misfit = _first_misfit(problem) if mended.found else 0.0
    naming = name_effects(twin, whiten, candidates(twin), seed, lambda what: progress(what, 4, 6), explained=misfit)
    channel_p = channel_p_values(twin, whiten, naming.first.r, naming.first.J)
    detected = detection_p(naming.first_p, channel_p)
    left = channel_p_values(twin, whiten, naming.fit.r, naming.fit.J)
    naming, unknown, left = _refuse(twin, whiten, naming, misfit, detected, left, seed, lambda what: progress(what, 4, 6))
    naming = replace(naming, fit=in_gauge(twin, whiten, naming.fit))
    gravity = turn_gravity(twin, naming.fit)
    progress("proof on held-out segments", 5, 6)
    proof = prove(problem, twin, whiten, naming.fit)
    claimed = _register_claims(mended) + _offset_claim(gravity) + _named_claims(twin, naming)
    if claimed and any(claim.effect.kind == "register" for claim in claimed):
        detected = min([detected, *(claim.p_value for claim in claimed)])
    explanation = Explanation(
        session, problem, mended, twin, whiten, naming, gravity, proof, "", detected, claimed, unknown, left, channel_p
    )
    explanation.warnings = [finding for finding in findings if finding.level == "warning"]
    explanation.verdict = _verdict(explanation)
    return explanation


def channel_p_values(twin: Twin, whiten: Whitener, r: np.ndarray, nuisance: np.ndarray) -> dict[str, float]:
    """Goodness of fit of each channel against the measured noise, which is itself only known from so many blocks (Fisher's F)."""
    q, _ = np.linalg.qr(nuisance / np.linalg.norm(nuisance, axis=0))
    taken = np.sum(q**2, axis=1)
    noise_freedom = 3 * sum(still.duration_s for _, still in twin.stills) / 0.1 * 0.66
    p = {}
    for name, part in whiten.parts.items():
        freedom = max(part.stop - part.start - taken[part].sum(), 1.0)
        p[name] = float(stats.f.sf(np.sum(r[part] ** 2) / freedom, freedom, noise_freedom))
    return p


def detection_p(first_p: float, channel_p: dict[str, float]) -> float:
    """One p-value from the candidates' and the channels' own.

    The channels are judged against noise as it is stated, with allowances that most recordings do not use up, so their p-values are no
    uniform ones; they get so small a share of the level that only what is beyond doubt counts, and the whole stays uniform.
    """
    return min(1.0, first_p / SHAPE_SHARE, bonferroni(channel_p) / (1 - SHAPE_SHARE))


def bonferroni(p: dict[str, float]) -> float:
    return min(1.0, len(p) * min(p.values()))


def _refuse(twin, whiten, naming: Naming, mended_from: float, detected: float, left: dict[str, float], seed: int, progress):
    """Keep the names only if they leave what noise allows, or next to nothing, and no shape without a name does better; else say what
    is there without a name."""
    if not naming.named and detected > FAMILY_WISE:
        return naming, [], left
    progress("beyond the catalogue")
    enough = bonferroni(left) > LEFT_P or _share(twin, whiten, naming, mended_from) >= RIGHT_SHARE
    rival, lead = best_rival(twin, whiten, naming, slow_candidates(twin), seed) if enough and naming.named else (None, -np.inf)
    if enough and lead < BETTER:
        return (naming if rival is None else _with_stand_in(naming, rival)), [], left
    bare = Naming(naming.first, naming.first_p, naming.first)
    beyond = name_effects(twin, whiten, unknown_candidates(twin), seed, most=MOST_FINDINGS, stand_ins=False)
    findings = _named_claims(twin, beyond)
    return bare, findings, channel_p_values(twin, whiten, naming.first.r, naming.first.J)


def _with_stand_in(naming: Naming, rival: Effect) -> Naming:
    """A shape that alone does as well as all names: each of them could be a part of it."""
    return replace(naming, named=[replace(named, equivalent=(*named.equivalent, rival.id)) for named in naming.named])


def _first_misfit(problem: Problem) -> float:
    """Chi-square of the closure before anything was mended."""
    r = closure_angles(problem.batch, problem.first) / problem.floor.sigma
    return float(np.sum(r**2))


def _share(twin: Twin, whiten: Whitener, naming: Naming, mended_from: float) -> float:
    """Share of the excess misfit that mending and naming took up, in the channels that the gyro moves, and gravity's length if an
    effect of the reference is among the names."""
    end = whiten.parts["length" if any(n.effect.kind == "force" for n in naming.named) else "still"].stop
    before = max(float(np.sum(naming.first.r[:end] ** 2)), mended_from)
    after = float(np.sum(naming.fit.r[:end] ** 2))
    return (before - after) / (before - end) if before > 2 * end else 0.0


def _register_claims(mended: Mended) -> list[Claimed]:
    """What was found in the registers and stills; their bars leave no room for chance."""
    claims = []
    for name, (parameters, std) in mended.found.items():
        effect = catalogue()[name]
        value = parameters.get(effect.parameter.name)
        theta = np.array([len(value) if isinstance(value, list) else value * effect.parameter.si], dtype=float)
        claims.append(Claimed(effect, parameters, std, 1e-9, np.inf, (), effect.says(theta)))
    return claims


def _offset_claim(gravity: TurnGravity) -> list[Claimed]:
    if not gravity.is_offset:
        return []
    effect = catalogue()["timing.gyro_accel_offset"]
    sigma = float(np.hypot(gravity.sigma_s, gravity.bar_s / 3))
    p_value = float(2 * stats.norm.sf(abs(gravity.offset_s) / gravity.sigma_s))
    return [Claimed(effect, {"seconds": gravity.offset_s}, {"seconds": sigma}, p_value, 0.0, (), effect.says(np.array([gravity.offset_s])))]


def _named_claims(twin: Twin, naming: Naming) -> list[Claimed]:
    claims = []
    numbers = {claim.effect.id: i for i, claim in enumerate(naming.fit.state.claims)}
    freedom = max(len(naming.fit.r) - naming.fit.J.shape[1], 1)
    widen = max(1.0, naming.fit.chi_square / freedom)
    for named in naming.named:
        number = numbers[named.effect.id]
        claim = naming.fit.state.claims[number]
        theta, parameters, std = readable(claim, naming.fit.theta_covariance(number) * widen)
        says = claim.effect.says(theta)
        claims.append(Claimed(claim.effect, parameters, std, named.p_value, named.gain, named.equivalent, says))
    return claims


def _verdict(explanation: Explanation) -> str:
    if not explanation.claimed:
        return "unexplained" if explanation.p_value <= FAMILY_WISE else "no_mismatch"
    if explanation.findings or bonferroni(explanation.left) <= LEFT_P:
        return "partly_explained"
    if any(claim.equivalent for claim in explanation.claimed):
        return "ambiguous"
    return "explained"
