"""``explain`` where the reference is a truth file: what is wrong with the sensor, what with the truth, what with their clocks.

The other twin rests on stills; a vehicle has hardly any, but its attitude is known at any two moments, all three angles of it.  So one
channel, the closure between moments of truth, is looked at in five ways:

- its columns: forward selection of the catalogue's rate effects and of the truth's clock, on Fisher's F (``selection.py``);
- its growth: closure against length tells the truth's own noise (constant) from the gyro's (root of time) and from a bias (time);
- its neighbours: a wrong moment of truth is missed by the segment before it and made good by the one after;
- its E: an antisymmetric part is a rotation between gyro and truth, and the accelerometer either asks for the same one or does not;
- its bias: in motion, against the mean rate at rest, which the truth is not needed for.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import stats

from session.common.units import DEG
from session.log.folder import Session
from tinygc import closure
from tinygc.closure.least_squares import fit_least_squares
from tinygc.effects import Effect, catalogue, movement_of
from tinygc.explanation.naming.selection import FAMILY_WISE, Selection, orthonormal
from tinygc.explanation.truth.evidence import (
    Force,
    error_angles,
    force_against_truth,
    growth,
    neighbours_correlation,
    noises,
    offset_columns,
    short_segments,
    zero_at_rest,
)
from tinygc.explanation.truth.truth_effects import FRAME, OFFSET, wander, wrong_moments
from tinygc.explanation.truth.truth_explanation import TruthClaim, TruthExplanation
from tinygc.explanation.truth.wrong_moments import without_wrong_moments
from tinygc.models import linear
from tinygc.models.linear import PRIOR_SIGMA, LinearModel
from tinygc.problem.conditions import conditions
from tinygc.problem.prepared import Prepared, prepare
from tinygc.problem.problem import Problem

MOST_EFFECTS, STEPS_TRIED = 4, 40  #: of work, as ``naming.forward`` has them
#: a further effect must be as sure, and take up this share of what is left (not critical: benchmarks/thresholds.py)
LATER_FAMILY_WISE, LATER_SHARE = 0.01, 0.03
#: a rotation of the frame is claimed if it is as large (a zero-g offset of 10 mg turns the vertical by 0.6 deg, so that no accelerometer
#: could confirm less), as sure (by chance once in 60 000), and leaves at most this of the accelerometer's bias (not critical: as above)
FRAME_RAD, FRAME_SIGMAS, FRAME_LEAVES = 0.5 * DEG, 5.0, 0.7
WANDER_S = 20.0  #: between knots: a shape, whose number of knots is priced by Fisher's F


def explain_truth(
    session: Session | Path,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
    prepared: Prepared | None = None,
) -> TruthExplanation:
    """Explain a session with a truth file.  prepared: the session, where somebody has it already.  Raises what ``prepare`` raises."""
    prepared = prepared or prepare(session, use_earth=use_earth, progress=lambda what: progress(what, 0, 5))
    problem = prepared.problem
    progress("moments of truth", 1, 5)
    sound, jumps, jumps_p = without_wrong_moments(problem)
    progress("naming", 2, 5)
    fit = fit_least_squares(sound.batch, sound.floor.sigma, problem.first)
    p_value, claims, refused, chi, rms, left = _select(sound, fit.model, seed)
    angles = error_angles(sound.batch, fit.model), (np.linalg.cholesky(sound.floor.dense()) @ left).reshape(-1, 3)
    progress("growth and clocks", 3, 5)
    lengths, closures = growth(sound, fit.model)
    truth_rad, walk_rad = noises(lengths, closures)
    offset, turned, turned_sigma = short_segments(sound, fit.model)
    progress("frames and rests", 4, 5)
    force = force_against_truth(sound, turned)
    claims = _frame_claim(turned, turned_sigma, force) + claims
    if jumps:
        began = problem.began_s
        at_s = np.array([round(float(began[log]) + at, 3) for log, at in jumps])
        claims = [TruthClaim(wrong_moments(len(at_s)), at_s, None, jumps_p, None), *claims]
    return TruthExplanation(
        problem=sound,
        model=fit.model,
        jumps=jumps,
        claims=claims,
        refused=refused,
        p_value=p_value,
        angles=angles,
        excess=chi,
        closure_rms=rms,
        lengths_s=lengths,
        closure_rad=closures,
        truth_rad=truth_rad,
        walk_rad=walk_rad,
        gyro_rad=float(np.mean(sound.noise.angle_random_walk)),
        neighbours=(neighbours_correlation(sound, angles[0]), neighbours_correlation(sound, angles[1])),
        offset=offset,
        turned=turned,
        turned_sigma=turned_sigma,
        rests=zero_at_rest(sound, fit.model),
        force=force,
        warnings=prepared.warnings,
    )


#: an effect as it was chosen, its p-value, and its share of chi-square
Chosen = tuple[Effect, float, float]


def _select(
    problem: Problem, model: LinearModel, seed: int
) -> tuple[float, list[TruthClaim], list[TruthClaim], tuple[float, float], tuple[float, float], np.ndarray]:
    """Forward selection: p-value of the first look, claims, what is refused, chi-square per freedom and closure rms rad before and after;
    what is left."""
    batch = problem.batch
    rate = model(batch.rate)
    sensitivity = closure.sensitivity(batch, rate)
    factor = np.linalg.cholesky(problem.floor.dense())

    def white(columns: np.ndarray) -> np.ndarray:
        return np.linalg.solve(factor, columns.reshape(factor.shape[0], -1))

    r = white(error_angles(batch, model))[:, 0]
    nuisance = white(linear.columns(sensitivity, batch.rate) * PRIOR_SIGMA)
    tried = {effect: white(columns) for effect, columns in _candidates(problem, model, sensitivity)}
    first_p: float | None = None
    claims: list[Chosen] = []
    refused: list[TruthClaim] = []
    q = orthonormal(nuisance)
    chi = float(np.sum((r - q @ (q.T @ r)) ** 2))
    freedom = max(len(r) - q.shape[1], 1)
    while len(claims) < MOST_EFFECTS:
        chosen = [effect for effect, _, _ in claims]
        ids = {effect.id for effect in chosen} | {claim.effect.id for claim in refused}
        rest = {effect: columns for effect, columns in tried.items() if effect.id not in ids}
        known = np.concatenate([nuisance, *(tried[effect] for effect in chosen)], axis=1)
        selection = Selection(known, rest, seed)
        if not selection.groups:
            break
        p_value = selection.p_value(r)
        first_p = p_value if first_p is None else first_p
        if p_value > (LATER_FAMILY_WISE if chosen else FAMILY_WISE):
            break
        best = selection.groups[int(np.argmin(selection.log_p(r)))].name
        gain = selection.gains(r)[best]
        if chosen and gain < LATER_SHARE * chi:
            break
        claim = (best, p_value, gain / chi)
        last = _together(r, nuisance, [*claims, claim], tried)[0][-1]
        if last.implausible:
            refused.append(last)
        else:
            claims.append(claim)
    while True:
        found, after, freedom_after = _together(r, nuisance, claims, tried)
        drop = [claim for claim in found if claim.idle or claim.implausible]
        if not drop:
            break
        refused += [drop[-1]] if drop[-1].implausible else []
        claims = [claim for claim in claims if claim[0] is not drop[-1].effect]
    before_rms, after_rms = (float(np.sqrt(np.mean(np.sum((factor @ x).reshape(-1, 3) ** 2, axis=1)))) for x in (r - q @ (q.T @ r), after))
    rms = before_rms, after_rms
    return 1.0 if first_p is None else first_p, found, refused, (chi / freedom, float(after @ after) / freedom_after), rms, after


def _together(
    r: np.ndarray, nuisance: np.ndarray, claims: list[Chosen], tried: dict[Effect, np.ndarray]
) -> tuple[list[TruthClaim], np.ndarray, int]:
    """All claims fitted at once, with what is left (n,) and its degrees of freedom."""
    whole = np.concatenate([nuisance, *(tried[effect] for effect, _, _ in claims)], axis=1)
    theta = np.linalg.lstsq(whole, -r, rcond=None)[0]
    after = r + whole @ theta
    freedom = max(len(r) - whole.shape[1], 1)
    covariance = np.linalg.pinv(whole.T @ whole) * float(after @ after) / freedom
    found, at = [], linear.PARAMETERS
    for effect, p_value, share in claims:
        size = effect.parameter.size
        found.append(TruthClaim(effect, theta[at : at + size], np.sqrt(np.diag(covariance)[at : at + size]), p_value, share))
        at += size
    return found, after, freedom


def _candidates(problem: Problem, model: LinearModel, sensitivity: np.ndarray) -> list[tuple[Effect, np.ndarray]]:
    """(S, 3, P) columns, in the closure, of each effect that can be tried: how the residual changes with its parameters."""
    known, began = conditions(problem), problem.began_s
    movements = [
        movement_of(log.samples, model(log.samples.gyro), known, start) for log, start in zip(problem.logs, began[:-1], strict=True)
    ]
    times = problem.middle_s[:: -(-len(problem.batch) // STEPS_TRIED)][1:-1]
    # A wander is no name, but what has none must not pass for one of the names.
    duration = float(began[-1])
    tried = [wander(np.linspace(0, duration, max(3, min(round(duration / WANDER_S) + 1, len(problem.batch) // 6))))]
    for effect in catalogue().values():
        if effect.kind != "rate" or ("temperature" in effect.inputs and any(log.samples.temp_c is None for log in problem.logs)):
            continue
        grid = None if effect.scan is None else effect.scan.grid
        tried += effect.variants(times if grid is None else grid(movements))
    found = []
    for effect in tried:
        columns = np.zeros((len(problem.batch), 3, effect.parameter.size))
        by_log = [effect.columns(movement) for movement in movements]
        for row, segment, turn in zip(columns, problem.used, sensitivity, strict=True):
            count = segment.stop - segment.start
            part = by_log[segment.log][segment.start : segment.stop]
            row[:] = -turn[:count].transpose(1, 0, 2).reshape(3, -1) @ part.reshape(-1, effect.parameter.size)
        if np.isfinite(columns).all() and columns.any():
            found.append((effect, columns))
    found.append((OFFSET, offset_columns(problem.batch, model)[..., None]))
    return found


def _frame_claim(turned: np.ndarray, sigma: np.ndarray, force: Force | None) -> list[TruthClaim]:
    """The truth's frame is turned if the gyro says so, and the accelerometer's apparent bias becomes less with it."""
    if not np.isfinite(turned).all():
        return []
    size = float(np.linalg.norm(turned))
    sure = float(np.sum((turned / sigma) ** 2))
    if size < FRAME_RAD or sure < FRAME_SIGMAS**2 or force is None:
        return []
    if np.linalg.norm(force.turned) > FRAME_LEAVES * np.linalg.norm(force.bias):
        return []
    return [TruthClaim(FRAME, turned, sigma, float(stats.chi2.sf(sure, 3)), None)]
