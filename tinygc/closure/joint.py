"""Accelerometer and gyroscope in one estimation; a problem with another accelerometer calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.base import rotation
from session.base.numeric import rms_of, sigma_of, sigmas_in
from session.base.units import MG
from session.detect.accelerometer import (
    BIAS,
    DRIFTS,
    IDENTITY,
    PARAMETERS,
    SPREAD_MPS2,
    UPPER,
    after,
    corrected,
    fit_lengths,
    force_columns,
    force_of,
    length_columns,
    shares,
    times_of,
    units,
    unobserved_of,
)
from session.detect.stills import Still, references
from tinygc.closure import residual
from tinygc.closure.build import tilt_excess
from tinygc.closure.problem import ACCELEROMETER, COUNT, DRIFT, GRAVITY, GYROSCOPE, JointFit, JointSystem, Problem, bent
from tinygc.inference.choose import chi_square_above
from tinygc.models import linear
from tinygc.models.linear import PRIOR_SIGMA, LinearModel

# Joint estimation of accelerometer and gyroscope from gravity's length in every still and the closure of every turn.
#
# The parameters are nine of the accelerometer (``session/detect/accelerometer.py``), twelve of the gyroscope and, with a given calibration,
# the length of gravity.  A change df of a still's specific force tilts its attitude by R df / g about the horizontal, and with it the ends
# of the adjoining turns; so turns observe what the lengths do not.  The residual sigmas of lengths and turns are estimated as well; single
# outliers (a knock, a still in motion) get little weight.  Where enough stills are to spare (``fit_lengths``), a drift of the
# accelerometer's zero within the session is among the parameters: unnamed it would be taken for nonorthogonality.

#: sigma of a given calibration, at zero g and at one g, where session.toml states none
GIVEN_SIGMA_MG = 0.1
#: sigma of a drift of the zero within a session: that of the zero itself.  MPU-9150 drift by 1 to 5 mg within 500 s, known to 0.5 to 1 mg:
#: what is not known to a tenth of its prior stays at its centre
DRIFT_MPS2 = 60 * MG
#: sigma of gravity's length at the site, with a given calibration, which has a scale of its own
GRAVITY_SIGMA_MPS2 = 20 * MG
KNOWN_MPS2 = 1e-9 * GRAVITY_SIGMA_MPS2
#: a given calibration is rejected below this p-value
REFUTED_P = 1e-4
RELINEARISED, ROUNDS = 4, 12
BAR_SIGMAS = 2.0
SETTLED_MPS2 = 1e-3 * MG


def fit_joint(problem: Problem, mode: str, sigma_mg: float = GIVEN_SIGMA_MG, tested: bool = True, drifts: bool = True) -> JointFit | None:
    """Estimate accelerometer and gyroscope together, in a problem whose reference is gravity.

    mode: ``fit`` assumes only the accelerometer's type; ``prior`` takes the calibration that the problem was built with as a prior, with
    sigma_mg of each parameter at one g.  tested: whether to compute the p-value of that calibration, which takes another fit.  drifts:
    whether the zero may drift within the session, where enough stills are to spare.
    Returns None for a further reference, or without stills or used segments.
    """
    stills = references(problem.stills)
    number = {id(still): q for q, still in enumerate(stills)}
    if problem.session.reference is not None or not stills or not problem.used:
        return None
    first, last = (np.array([number[id(getattr(s, end))] for s in problem.used]) for end in ("first", "last"))
    force = force_of(stills)
    gravity = problem.session.config.site.expected_gravity_mps2
    noise = np.array([float(np.mean(problem.logs[log].noise.velocity_random_walk ** 2)) for log, _ in problem.references])
    white = np.sqrt(noise / np.array([still.duration_s for still in stills]))
    middle_s, duration_s = times_of([references(log.stills) for log in problem.logs], [log.samples for log in problem.logs])
    share = shares(middle_s, duration_s)
    lengths = fit_lengths(force, gravity, None, 0.0, rms_of(white), middle_s, duration_s)
    drifts = drifts and lengths.drift is not None
    spread = SPREAD_MPS2 if mode == "fit" else np.full(PARAMETERS, sigma_mg * MG)
    site = problem.session.config.site
    length = max(site.gravity_sigma_mps2, KNOWN_MPS2) if mode == "fit" else GRAVITY_SIGMA_MPS2
    prior = np.concatenate([spread * units(gravity), PRIOR_SIGMA, [length], [DRIFT_MPS2] * (DRIFTS * drifts)])
    # The prior's centre: no accelerometer correction, and the model of the first gyroscope fit.
    centre = np.concatenate([IDENTITY, problem.first.vector, [gravity], np.zeros(DRIFTS * drifts)])
    x = np.zeros(len(centre))
    for _ in range(RELINEARISED):
        at = centre + x
        system = _weighed(problem, at, x, prior, force, first, last, white, share)
        moved = system.solve() - x
        x = x + moved
        if np.abs(moved[ACCELEROMETER] / units(gravity)).max() < SETTLED_MPS2:
            break
    found = centre[ACCELEROMETER] + x[ACCELEROMETER]
    accelerometer = after(found, problem.session.config.accelerometer, "stills" if mode == "fit" else "prior")
    # A parameter is observed if it would be with gravity's length known.
    prior_alone = replace(system, prior=np.where(np.arange(len(prior)) == GRAVITY, KNOWN_MPS2, prior)).covariance
    whole = np.concatenate([(accelerometer.matrix @ accelerometer.frame.T)[UPPER], accelerometer.matrix @ accelerometer.bias_mps2])
    hidden = unobserved_of(whole - IDENTITY, sigmas_in(prior_alone)[ACCELEROMETER], gravity)  # in the body's axes, as x is
    drift, zero = lengths.drift, np.zeros(DRIFTS)
    if drift is not None and drifts:
        zero = x[DRIFT]
        drift = replace(drift, mps2=zero, covariance=system.covariance[DRIFT, DRIFT])
    now = corrected(found, force - share[:, None] * zero)
    return JointFit(
        mode=mode,
        accelerometer=accelerometer,
        x=found,
        model=LinearModel.from_vector((centre + x)[GYROSCOPE]),
        unobserved=() if mode == "prior" else hidden,
        p_value=None if mode == "fit" or not tested else _improbable(problem, prior, drifts),
        system=replace(system, x=x, values=system.values + system.design @ moved),
        first=first,
        last=last,
        force=now,
        before=np.linalg.norm(force, axis=1) - gravity,
        after=np.linalg.norm(now, axis=1) - (centre + x)[GRAVITY],
        share=share,
        drift=None if drift is None else drift.turned(problem.session.config.accelerometer),
    )


def _weighed(
    problem: Problem,
    at: np.ndarray,
    x: np.ndarray,
    prior: np.ndarray,
    force: np.ndarray,
    first: np.ndarray,
    last: np.ndarray,
    white: np.ndarray,
    share: np.ndarray,
) -> JointSystem:
    """Linear system at a point, with weights from the estimated residual sigmas."""
    number = at[ACCELEROMETER]
    if len(at) > COUNT:
        force = force - share[:, None] * at[DRIFT]
    batch = bent(problem.batch, first, last, corrected(number, force))
    model = LinearModel.from_vector(at[GYROSCOPE])
    rate = model(batch.rate)
    d, rows = batch.angles, len(batch) * batch.angles
    end, sensitivity = residual.end_and_sensitivity(batch, rate)
    angles = residual.error_angles(residual.batch_residual(batch, end))
    design = np.zeros((rows + len(force), len(at)))
    design[:rows, GYROSCOPE] = linear.columns(sensitivity, batch.rate)[:, :d].reshape(rows, -1)
    starts, ends = tilt_columns(batch.start, number, force[first]), tilt_columns(batch.end, number, force[last])
    tilted = starts - ends
    design[:rows, ACCELEROMETER] = tilted[:, :d].reshape(rows, -1)
    design[rows:, ACCELEROMETER] = length_columns(number, force)
    if len(at) > COUNT:  # a drift moves the bias of each still by its share
        starts, ends = starts[:, :, BIAS] * share[first][:, None, None], ends[:, :, BIAS] * share[last][:, None, None]
        design[:rows, DRIFT] = (starts - ends)[:, :d].reshape(rows, -1)
        design[rows:, DRIFT] = design[rows:, BIAS] * share[:, None]
    design[rows:, GRAVITY] = -1.0
    values = np.concatenate([angles.ravel(), np.linalg.norm(corrected(number, force), axis=1) - at[GRAVITY]])
    sigma = np.concatenate([replace(problem.floor, tilt_excess=1.0).sigma.ravel(), white])  # the tilt's excess is estimated below
    system = JointSystem(design, values, 1 / sigma, prior, x, vague=prior[GRAVITY] < GRAVITY_SIGMA_MPS2)
    # A known angle has its stop's sigma; the misfit of the tilt does not apply to it.
    stops = np.arange(2, rows, d) if batch.turns is not None else np.arange(0)
    ends = np.setdiff1d(np.arange(rows), stops)
    together = len(ends) // len(batch)
    for _ in range(ROUNDS):
        left = values + design @ (system.solve() - x)
        scaled, taken = design * system.root[:, None] * prior, system.covariance / np.outer(prior, prior)
        used = np.einsum("np,pq,nq->n", scaled, taken, scaled)
        root = 1 / (sigma * np.sqrt(1 + (left / sigma / BAR_SIGMAS) ** 2))
        for part in (ends, np.arange(rows, len(values))):
            spare = max(1 - float(np.mean(used[part])), 0.1)
            miss = left[part] / sigma[part]
            size = max(1.0, float(sigma_of(miss)) / np.sqrt(spare))
            if part is ends:  # the angles of a turn are weighted together
                miss = np.repeat(np.linalg.norm(miss.reshape(-1, together), axis=1) / np.sqrt(together), together)
            root[part] = 1 / (sigma[part] * size * np.sqrt(1 + (miss / (BAR_SIGMAS * size)) ** 2))
        settled = np.abs(root / system.root - 1).max() < 1e-3
        system = replace(system, root=root)
        if settled:
            break
    return system


def _improbable(problem: Problem, prior: np.ndarray, drifts: bool) -> float:
    """P-value of the given calibration: how probable so large a correction is if its errors have the prior's sigmas (P,).

    The weights come from the residuals under the fitted calibration: under a wrong one its error would count as noise.
    """
    free = fit_joint(problem, "fit", drifts=drifts)
    assert free is not None  # the same problem was fitted before
    system = replace(free.system, prior=prior)
    scaled = system.design * system.root[:, None] * system.prior
    known = scaled.T @ scaled
    pull = scaled.T @ (system.root * (system.design @ system.x - system.values))
    rest = slice(PARAMETERS, len(prior))
    inner = np.linalg.inv(known[rest, rest] + np.eye(len(prior) - PARAMETERS))
    information = known[ACCELEROMETER, ACCELEROMETER] - known[ACCELEROMETER, rest] @ inner @ known[rest, ACCELEROMETER]
    score = pull[ACCELEROMETER] - known[ACCELEROMETER, rest] @ inner @ pull[rest]
    # If the calibration errors follow the prior, score has the covariance information + information information.
    size, axes = np.linalg.eigh(information)
    seen = size > 1e-6
    chi_square = float(np.sum((axes.T @ score)[seen] ** 2 / (size + size**2)[seen]))
    return chi_square_above(chi_square, int(seen.sum()))


def tilt_columns(q_tb: np.ndarray, x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 3, 9) rad: rotation of attitudes (S, 4), levelled by forces (S, 3), per parameter, about the table's axes; zero about z.

    R f stays -g z.  So a rotation phi of the attitude compensates the horizontal part of R df: R df = g phi x z there.
    """
    moved = rotation.matrix(q_tb) @ force_columns(x, force) / np.linalg.norm(corrected(x, force), axis=1)[:, None, None]
    return np.stack([-moved[:, 1], moved[:, 0], np.zeros_like(moved[:, 0])], axis=1)


# A problem with another accelerometer calibration: the same stills and turns with other references.


def recalibrated(problem: Problem, joint: JointFit) -> Problem:
    """Apply the accelerometer calibration and the linear model of a joint fit to a problem.

    A calibration is affine, so it maps a still's mean as it maps each sample; the choice of still samples does not depend on it.
    """
    session = replace(problem.session, config=replace(problem.session.config, accelerometer=joint.accelerometer))
    found = problem.found.recalibrated(session)
    samples = dict(zip(map(id, problem.found.samples()), found.samples(), strict=True))
    logs = []
    now: dict[int, Still] = {}
    middle_s, duration_s = times_of([log.stills for log in problem.logs], [log.samples for log in problem.logs])
    edges = np.cumsum([len(log.stills) for log in problem.logs])[:-1]
    parts = np.split(shares(middle_s, duration_s), edges)
    moved = {id(log): joint.moved(force_of(log.stills), part) for log, part in zip(problem.logs, parts, strict=True)}
    for log in problem.logs:
        stills = [replace(still, accel_mean=force) for still, force in zip(log.stills, moved[id(log)], strict=True)]
        now |= {id(old): new for old, new in zip(log.stills, stills, strict=True)}
        q_tb = rotation.nearest_yaw(log.q_tb, rotation.from_gravity(force_of(stills)))
        logs.append(replace(log, samples=samples[id(log.samples)], stills=stills, q_tb=q_tb))
    segments = [replace(s, first=now[id(s.first)], last=now[id(s.last)]) for s in problem.segments]
    references = np.concatenate([log.references.q_tb for log in logs])
    batch, floor = bent(problem.batch, joint.first, joint.last, joint.force), problem.floor
    if batch.turns is not None:
        floor = replace(floor, tilt_excess=1.0)
        floor = replace(floor, tilt_excess=tilt_excess(batch, floor, joint.model, problem.still_rates))
    return replace(
        problem,
        session=session,
        segments=segments,
        batch=batch,
        floor=floor,
        logs=logs,
        first=joint.model,
        still_rates=replace(problem.still_rates, q_tb=references),
        found=found,
        joint=joint,
    )
