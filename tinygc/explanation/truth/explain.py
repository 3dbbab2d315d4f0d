"""``explain`` where the reference is a truth file: what is wrong with the sensor, what with the truth, what with their clocks.

A table's twin rests on stills; a vehicle has hardly any, but its attitude is known at any two moments, all three angles of it.  So one
channel, the closure between moments of truth (``truth_twin.py``), is looked at in five ways:

- its columns: the catalogue's rate effects and the truth's clock, weighed as for any recording (``names.py``);
- its growth: closure against length tells the truth's own noise (constant) from the gyro's (root of time) and from a bias (time);
- its neighbours: a wrong moment of truth is missed by the segment before it and made good by the one after;
- its clock and its frame, as they were found before anything was fitted (``session/alignment``): a rotation between gyro and truth that
  a gyro may have itself is the truth's where the accelerometer asks for the same one;
- its bias: in motion, against the mean rate at rest, which the truth is not needed for.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from session.common.units import DEG
from session.log.folder import Session
from session.log.truth_reading import FOUND, TruthAlignment
from tinygc.closure.least_squares import fit_least_squares
from tinygc.explanation.truth.evidence import (
    Force,
    force_against_truth,
    growth,
    neighbours_correlation,
    noises,
    zero_at_rest,
)
from tinygc.explanation.truth.names import name_beside_truth
from tinygc.explanation.truth.recorded_clock import with_recorded_clock
from tinygc.explanation.truth.truth_effects import FRAME, MOUNTED, wrong_moments
from tinygc.explanation.truth.truth_explanation import TruthClaim, TruthExplanation
from tinygc.explanation.truth.wrong_moments import without_wrong_moments
from tinygc.problem.prepared import Prepared, prepare
from tinygc.problem.widened import weighed_down

#: a rotation of the frame is claimed if it is as large (a zero-g offset of 10 mg turns the vertical by 0.6 deg, so that no accelerometer
#: could confirm less), as sure (by chance once in 60 000), and leaves at most this of the accelerometer's bias (not critical: as above)
FRAME_RAD, FRAME_SIGMAS, FRAME_LEAVES = 0.5 * DEG, 5.0, 0.7


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
    alignment = sound.session.alignment
    names = with_recorded_clock(sound, name_beside_truth(sound, seed, lambda what: progress(what, 2, 5)), alignment)
    progress("growth and clocks", 3, 5)
    lengths, closures = growth(sound, fit.model)
    truth_rad, walk_rad = noises(lengths, closures)
    progress("frames and rests", 4, 5)
    force = force_against_truth(sound, *_stands_and_turned(alignment))
    claims = _frame_claim(alignment, force) + names.claims
    if jumps:
        began = problem.began_s
        at_s = np.array([round(float(began[log]) + at, 3) for log, at in jumps])
        claims = [TruthClaim(wrong_moments(len(at_s)), at_s, None, jumps_p, None), *claims]
    return TruthExplanation(
        problem=sound,
        model=fit.model,
        jumps=jumps,
        claims=claims,
        refused=names.refused,
        p_value=names.p_value,
        angles=names.angles,
        held_out=names.held_out,
        excess=names.excess,
        noise=names.decision.noise,
        considered=names.decision.considered,
        lengths_s=lengths,
        closure_rad=closures,
        truth_rad=truth_rad,
        walk_rad=walk_rad,
        gyro_rad=float(np.mean(sound.noise.angle_random_walk)),
        neighbours=(neighbours_correlation(sound, names.angles[0]), neighbours_correlation(sound, names.angles[1])),
        alignment=alignment,
        rests=zero_at_rest(sound, fit.model),
        force=force,
        warnings=prepared.warnings + weighed_down(prepared.session.name, problem.widened),
    )


def _not_taken_off(alignment: TruthAlignment | None) -> np.ndarray:
    """(3,) rad of the rotation from the gyro's axes to the truth's body, beyond the mounting that the problem reckons with."""
    if alignment is None or not np.isfinite(alignment.turned).all():
        return np.zeros(3)
    return (Rotation.from_matrix(alignment.reading.mounting).inv() * Rotation.from_rotvec(alignment.turned)).as_rotvec()


def _stands_and_turned(alignment: TruthAlignment | None) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) each: from the sensor's axes to those of the problem's attitudes, without a mounting that was found, and as the gyro asks."""
    asked = Rotation.from_rotvec(_not_taken_off(alignment)).as_matrix()
    if alignment is None or alignment.source["mounting"] != FOUND:
        return np.eye(3), asked
    return alignment.reading.mounting.T, asked


def _frame_claim(alignment: TruthAlignment | None, force: Force | None) -> list[TruthClaim]:
    """The truth's frame is turned if the gyro says so by more than it can be misaligned, or the accelerometer's apparent bias becomes less
    with it."""
    if alignment is None or not np.isfinite([alignment.turned, alignment.turned_sigma]).all():
        return []
    turned, sigma = _not_taken_off(alignment), alignment.turned_sigma
    if alignment.source["mounting"] == FOUND:
        sure = float(np.sum((alignment.turned / sigma) ** 2))
        return [TruthClaim(MOUNTED, alignment.turned, sigma, float(stats.chi2.sf(sure, 3)), None)]
    size = float(np.linalg.norm(turned))
    sure = float(np.sum((turned / sigma) ** 2))
    if size < FRAME_RAD or sure < FRAME_SIGMAS**2 or force is None:
        return []
    if np.linalg.norm(force.turned) > FRAME_LEAVES * np.linalg.norm(force.bias):
        return []
    return [TruthClaim(FRAME, turned, sigma, float(stats.chi2.sf(sure, 3)), None)]
