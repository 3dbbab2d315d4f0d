"""Explain a session whose reference is a truth file: wrong attitudes, the truth's clock, the sensor's effects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, fdtrc, gammaincinv

from session.base.numeric import median_length
from session.base.progress import Progress, untold
from session.base.units import DEG
from session.log.folder import Session
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import Prepared, prepare
from tinygc.closure.problem import Problem, weighed_down
from tinygc.explanation.claims import common_delays
from tinygc.explanation.evidence import Evidence
from tinygc.features.truth.evidence import (
    Force,
    TruthClaim,
    TruthExplanation,
    error_angles,
    force_against_truth,
    growth,
    neighbours,
    neighbours_correlation,
    noises,
    truth_claim,
    zero_at_rest,
)
from tinygc.features.truth.reading import FOUND, TruthAlignment
from tinygc.features.truth.twin import (
    FRAME,
    LIKE_AN_OUTAGE,
    MOUNTED,
    OFFSET,
    TruthTwin,
    excess_of,
    held_out,
    name_beside_truth,
    outages,
    wrong_moments,
)
from tinygc.noise.measured import measured_noise
from tinygc.noise.refit import refit

# Single wrong attitudes of a truth file: the segments before and after miss by opposite rotations.

#: both segments at a wrong moment miss by this many times the median (normal errors: less than 1e-7 a moment by ``chance_of``), in opposite
#: directions: misses of five times the noise are within about 16 degrees of opposite, and 45 are allowed
JUMP = 5.0
OPPOSITE = -0.7


#: median length of a vector of three normal deviates; and the effective number of squares in a scale from the median of N such lengths,
#: over N
MEDIAN_LENGTH, FREEDOM_SHARE = float(np.sqrt(2 * gammaincinv(1.5, 0.5))), 1.58


def without_wrong_moments(problem: Problem) -> tuple[Problem, list[tuple[int, float]], float]:
    """The problem without the segments on both sides of a wrong moment of truth, log and s of each such moment, and an upper bound of the
    probability that noise alone makes one as large as the largest; 1 if there is none."""
    model = problem.first
    keep = np.ones(len(problem.batch), dtype=bool)
    for _ in range(3):
        model = fit_least_squares(problem.batch.pick(keep), problem.floor.sigma[keep], model).model
        angles = error_angles(problem.batch, model)
        usual = median_length(angles)
        at = neighbours(problem)
        before, after = angles[at], angles[at + 1]
        size = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
        cosine = np.sum(before * after, axis=1) / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-12)
        wrong = at[(size > JUMP * usual) & (cosine < OPPOSITE)]
        keep = np.ones(len(problem.batch), dtype=bool)
        keep[wrong] = keep[wrong + 1] = False
    if not len(wrong) or keep.sum() < len(keep) / 2:
        return problem, [], 1.0
    jumps = [(problem.used[i].log, problem.used[i].start_s + problem.used[i].duration_s) for i in wrong]
    kept = problem.without(~keep, "one of its moments of truth is wrong")
    return kept, jumps, _chance_of(float(size[np.isin(at, wrong)].max() / usual), len(at), len(angles))


def _chance_of(times_usual: float, pairs: int, segments: int) -> float:
    """Upper bound of the probability that normal errors miss on both sides of one of ``pairs`` moments by this many times the median
    length. The scale of the errors is estimated from the median length of ``segments`` of them.  The bound is the probability that one side
    of one moment does, over all moments (Bonferroni)."""
    ratio = (times_usual * MEDIAN_LENGTH) ** 2 / 3
    return float(min(1.0, pairs * fdtrc(3, FREEDOM_SHARE * segments, ratio)))


# The truth's clock as recorded: an offset found before any fit, or together with a delay of the gyro's axes, is a claim like any other.

#: sigmas above which a clock offset fitted only because of a delay is reported: exceeded by chance once in 370
SAID_SIGMAS = 3.0


def _with_recorded_clock(names: TruthExplanation) -> TruthExplanation:
    """Put the whole clock offset among the claims.  If an offset was found before the fit, "before" is the recording with the clock set
    back."""
    alignment = names.alignment
    found_s = alignment.reading.offset_s if alignment.source["offset_s"] == FOUND else 0.0
    named = next((claim for claim in names.claimed if claim.effect.id == OFFSET.id), None)
    others = [claim for claim in names.claimed if claim is not named]
    left_s, sigma_s = _left(names)
    if found_s and not np.isfinite(sigma_s):
        sigma_s = alignment.offset_sigma_s
    whole_s = found_s + left_s
    if not found_s and named is not None:
        return names
    if not abs(whole_s) > SAID_SIGMAS * sigma_s and named is None:
        return replace(names, claimed=others)
    first_share, names = _set_back(names, found_s) if found_s else (0.0, names)
    others = [replace(claim, share=None if claim.share is None else claim.share * (1 - first_share)) for claim in others]
    p_value = float(chdtrc(1, (whole_s / sigma_s) ** 2))
    theta, sigma = np.array([whole_s]), np.array([sigma_s])
    claim = truth_claim(OFFSET, theta, sigma, p_value, share=first_share, equivalent=common_delays())
    if named is not None:
        share = first_share + (named.share or 0.0) * (1 - first_share)
        chances = {"probability": named.probability, "rivals": named.rivals, "equivalent": named.equivalent}
        claim = truth_claim(OFFSET, theta, sigma, min(p_value, named.p_value), share=share, **chances)
    return replace(names, claimed=sorted([claim, *others], key=lambda c: -(c.share or 0.0)), p_value=min(names.p_value, p_value))


def _left(names: TruthExplanation) -> tuple[float, float]:
    """Clock offset (s) in the last fit, and its sigma; 0 and nan if the clock is not one of its claims."""
    for number, claim in enumerate(names.fit.state.claims):
        if claim.effect.id == OFFSET.id:
            return float(claim.theta[0]), float(np.sqrt(names.fit.theta_covariance(number)[0, 0]))
    return 0.0, float("nan")


def _set_back(names: TruthExplanation, found_s: float) -> tuple[float, TruthExplanation]:
    """The share of chi-square that a clock offset found before the fit removes, and the names with the state before that correction."""
    problem, whiten = names.problem, names.naming.whiten
    twin = TruthTwin(problem)
    start = twin.start()
    back = TruthTwin(replace(problem, batch=twin.later(problem.batch, start, -found_s)))
    first = refit(back, whiten, [], start)
    angles = back.residuals(first.state).closure
    share = float(np.clip(1 - names.naming.first.chi_square / first.chi_square, 0, 1))
    return share, replace(
        names,
        angles=(angles, names.angles[1]),
        held_out=(held_out(back, whiten, first), names.held_out[1]),
        excess=(excess_of(problem, angles, 0), names.excess[1]),
    )


# ``explain`` with a truth file: errors of the sensor, of the truth, and of their clocks.
#
# A table's twin rests on stills; a vehicle has hardly any, but its attitude, with all three angles, is known at any two moments.  So one
# channel, the closure between moments of truth (``TruthTwin``), is analysed in five ways:
#
# - its columns: the catalogue's rate effects and the truth's clock, selected as for any recording (``name_beside_truth``);
# - its growth: closure against length separates the truth's noise (constant) from the gyro's (root of time) and from a bias (time);
# - its neighbours: a wrong moment of truth makes the segments before and after it miss by opposite rotations;
# - its clock and its frame, found before any fit: a rotation between gyro and truth that could be the gyro's own misalignment is attributed
#   to the truth if the accelerometer shows the same rotation;
# - its bias: in motion, compared with the mean rate at rest, which does not need the truth.

#: a rotation of the frame is claimed if it is this large (a zero-g offset of 10 mg turns the vertical by 0.6 deg, so that no accelerometer
#: could confirm less), this significant (by chance once in 60 000), and leaves at most this share of the accelerometer's bias (not
#: critical: as above)
FRAME_RAD, FRAME_SIGMAS, FRAME_LEAVES = 0.5 * DEG, 5.0, 0.7


def explain_truth(
    session: Session | Path,
    *,
    seed: int = 0,
    use_earth: bool = True,
    progress: Progress = untold,
    prepared: Prepared | None = None,
    noise: Path | None = None,
) -> TruthExplanation:
    """Explain a session with a truth file.  prepared: the session, if it has been prepared already; noise: figures at rest of the unit.
    Raises what ``prepare`` raises."""
    prepared = prepared or prepare(session, use_earth=use_earth, at_rest=measured_noise(noise), progress=lambda what: progress(what, 0, 5))
    problem = prepared.problem
    progress("moments of truth", 1, 5)
    sound, jumps, jumps_p = without_wrong_moments(problem)
    progress("naming", 2, 5)
    fit = fit_least_squares(sound.batch, sound.floor.sigma, problem.first)
    twin = TruthTwin(sound)
    names = _with_recorded_clock(name_beside_truth(twin, Evidence(twin), seed, lambda what: progress(what, 2, 5)))
    progress("growth and clocks", 3, 5)
    lengths, closures = growth(sound, fit.model)
    truth_rad, walk_rad = noises(lengths, closures)
    progress("frames and rests", 4, 5)
    force = force_against_truth(sound, *_stands_and_turned(names.alignment))
    claims = _outage_claims(problem) + _frame_claim(names.alignment, force) + names.claimed
    if jumps:
        began = problem.began_s
        at_s = np.array([round(float(began[log]) + at, 3) for log, at in jumps])
        claims = [truth_claim(wrong_moments(len(at_s)), at_s, None, jumps_p), *claims]
    return replace(
        names,
        claimed=claims,
        jumps=jumps,
        lengths_s=lengths,
        closure_rad=closures,
        truth_rad=truth_rad,
        walk_rad=walk_rad,
        gyro_rad=float(np.mean(sound.noise.angle_random_walk)),
        neighbours=(neighbours_correlation(sound, names.angles[0]), neighbours_correlation(sound, names.angles[1])),
        rests=zero_at_rest(sound, fit.model),
        force=force,
        warnings=prepared.warnings + weighed_down(prepared.session.name, problem.widened),
    )


def _outage_claims(problem: Problem) -> list[TruthClaim]:
    """Claim the outages that ``without_outages`` has found: those of the truth, and those that may be the gyro's."""
    began, claims = problem.began_s, []
    found = [(float(began[log]), outage) for log, truth in enumerate(problem.session.reference.truths) for outage in truth.outages]
    for sure in (True, False):
        here = [(start_s, outage) for start_s, outage in found if outage.sure == sure]
        if not here:
            continue
        spans_s = np.round([(start_s + outage.from_s, start_s + outage.to_s) for start_s, outage in here], 3).ravel()
        p_value = min(_chance_of(outage.times_usual, outage.spans, outage.spans) for _, outage in here)
        effect = outages(len(here), [float(f"{outage.size_rps / DEG:.4g}") for _, outage in here], sure)
        claims.append(truth_claim(effect, spans_s, None, p_value, equivalent=() if sure else LIKE_AN_OUTAGE))
    return claims


def _not_taken_off(alignment: TruthAlignment) -> np.ndarray:
    """(3,) rad of the rotation from the gyro's axes to the truth's body, beyond the mounting that the problem already includes."""
    if not np.isfinite(alignment.turned).all():
        return np.zeros(3)
    return (Rotation.from_matrix(alignment.reading.mounting).inv() * Rotation.from_rotvec(alignment.turned)).as_rotvec()


def _stands_and_turned(alignment: TruthAlignment) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) each: from the sensor's axes to those of the problem's attitudes, without an estimated mounting, and with the rotation
    estimated from the gyro."""
    asked = Rotation.from_rotvec(_not_taken_off(alignment)).as_matrix()
    if alignment.source["mounting"] != FOUND:
        return np.eye(3), asked
    return alignment.reading.mounting.T, asked


def _frame_claim(alignment: TruthAlignment, force: Force | None) -> list[TruthClaim]:
    """Claim a rotation of the truth's frame if the gyro shows more than its misalignment can be, or if the rotation reduces the
    accelerometer's apparent bias."""
    if not np.isfinite([alignment.turned, alignment.turned_sigma]).all():
        return []
    turned, sigma = _not_taken_off(alignment), alignment.turned_sigma
    if alignment.source["mounting"] == FOUND:
        sure = float(np.sum((alignment.turned / sigma) ** 2))
        return [truth_claim(MOUNTED, alignment.turned, sigma, float(chdtrc(3, sure)))]
    size = float(np.linalg.norm(turned))
    sure = float(np.sum((turned / sigma) ** 2))
    if size < FRAME_RAD or sure < FRAME_SIGMAS**2 or force is None:
        return []
    if np.linalg.norm(force.turned) > FRAME_LEAVES * np.linalg.norm(force.bias):
        return []
    return [truth_claim(FRAME, turned, sigma, float(chdtrc(3, sure)))]
