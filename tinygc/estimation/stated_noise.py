"""The noise of a fit by its sources, the covariance of least squares' parameters under it, and the uncertainty that a fit states."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import FitError
from session.base.texts import command_line, significant
from session.detect.accelerometer import PARAMETERS as ACCELEROMETER_PARAMETERS
from session.detect.rounding import lsb_of, rounding_of_mean
from session.detect.stills import BLOCK_S, NOISE_BLOCKS
from tinygc.closure import residual
from tinygc.closure.build import bias_shares
from tinygc.closure.earth import unseen_covariance
from tinygc.closure.floor import ACCEL_NOISE, GYRO_NOISE, allan_freedom
from tinygc.closure.least_squares import PriorUse
from tinygc.closure.problem import GYROSCOPE, JointFit, Problem
from tinygc.closure.uncertainty import BIAS_DRIFT, EARTH, GoodnessOfFit, closure_goodness, covariance_parts, goodness
from tinygc.inference.solve import Kind, Source, freedom_of, solve_lower, total
from tinygc.models import linear
from tinygc.models.linear import BIAS, MATRIX, PARAMETERS, PRIOR_SIGMA, LinearModel
from tinygc.noise.components import (
    GIVEN_SPREAD,
    REFERENCE,
    STILL_RATE,
    TURN,
    TYPICAL_SPREAD,
    UNDERSAMPLED,
    WANDER,
    SessionNoise,
    first_noise,
    noise_with,
)
from tinygc.noise.refit import prior_sigmas, refit
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import ACCEL_INSTABILITY_MPS2, OPEN_MPS2, PRECALIBRATION_MPS2, Whitener

# The noise of a fit: the white floor, and the non-white noise estimated from the recording (``explanation/noise``).
#
# It is estimated once in a fit.  Without stills between turns (a further reference), with a bias for each log, and in sessions of
# more than ``MOST_SEGMENTS`` segments, only the floor and the bias instability are used.

#: largest session with a dense covariance of all channels: its inverse costs the cube of the session (benchmarks/whole_process.py)
MOST_SEGMENTS = 400
#: names of sources of variance: of components, by their names; of the accelerometer's calibration and of gravity's length at the site
COMPONENTS = {
    WANDER: BIAS_DRIFT,
    STILL_RATE: "zero differs between rests",
    REFERENCE: "accelerometer, with attitude",
    TURN: "unexplained, turn to turn",
    UNDERSAMPLED: "motion between the readings",
}
CALIBRATION, GRAVITY_LENGTH = "calibration of the accelerometer", "gravity of the site"
#: those of the 12 ``precalibration_columns`` that gravity's length in stills determines: the bias, and the matrix' upper triangle
FROM_LENGTHS = np.array([0, 1, 2, *(3 + 3 * i + j for i, j in zip(*np.triu_indices(3), strict=True))])


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """The estimated noise: its components; white (n, n): white noise alone of the stacked channels (``Channels.stacked``); accelerometer
    (n, 12): one sigma of each error of its pre-calibration, constant over the session; twin that it was estimated with; unusual_p:
    probability that such a sensor has noise of this size (``SessionNoise.unusual_p``); first (n, n): the covariance before anything is
    estimated; rows: residuals (n,), columns (n, p) and white covariance (n, n) of the estimate."""

    twin: Twin
    noise: SessionNoise
    white: np.ndarray
    accelerometer: np.ndarray
    unusual_p: float = 1.0
    first: np.ndarray | None = None
    rows: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def gain_of(self, columns: np.ndarray) -> float:
        """-2 log of the restricted likelihood by which an effect with columns (n, P), in units of its plausible size, beats none, the noise
        estimated again: what it takes over from a component counts for it."""
        assert self.rows is not None  # an estimate of this recording
        r, J, base = self.rows
        factor = np.linalg.cholesky(base + self.noise.covariance)
        found = noise_with(self.noise, lambda values: solve_lower(factor, values), base, r, J, columns, self.noise.s)
        return self.noise.value - found.value

    @property
    def covariance(self) -> np.ndarray:
        """Total covariance (n, n) in rad^2, (rad/s)^2, (m/s^2)^2."""
        return self.white + self.noise.covariance + self.accelerometer @ self.accelerometer.T

    def sources(self) -> Iterator[Source]:
        """Yield the sources of the channels' errors, (n, n) each: white noise by its cause, then each component that is there.

        Their sum is ``covariance`` without the accelerometer's pre-calibration.
        """
        left, lengths = self.white, slice(len(self.white) - len(self.twin.stills), None)
        for cause, part in self.twin.problem.floor.parts.items():
            if cause == GYRO_NOISE:
                continue
            channels = np.zeros_like(self.white)
            channels[self.closure, self.closure] = part.dense()
            if cause == ACCEL_NOISE:
                channels[lengths, lengths] = self.white[lengths, lengths]
            left = left - channels
            yield Source(cause, *kind_of(cause, self.twin.problem), channels)
        yield Source(GYRO_NOISE, *kind_of(GYRO_NOISE, self.twin.problem), left)
        for s, sigma, component in zip(self.noise.s, self.noise.sigma, self.noise.components, strict=True):
            if s > 0:
                channels = np.zeros_like(self.white)
                component.add_to(channels, s)
                yield Source(COMPONENTS[component.name], "A" if component.prior is None else "B", freedom_of(s, sigma), channels)

    @property
    def named(self) -> np.ndarray:
        """Covariance (n, n) without the independent error of each turn, which no cause explains."""
        known = replace(self.noise, s=np.where([c.name == TURN for c in self.noise.components], 0.0, self.noise.s))
        return self.white + known.covariance + self.accelerometer @ self.accelerometer.T

    @property
    def closure(self) -> slice:
        """Rows of the closure channel."""
        return slice(0, len(self.twin.segments) * self.twin.batch.angles)

    @property
    def tilt_rms(self) -> float:
        """Rms tilt error from noise over the segments, rad; errors of the accelerometer's pre-calibration are absorbed by E."""
        variance = np.diag(self.white + self.noise.covariance)[self.closure].reshape(len(self.twin.segments), -1)
        if (wider := self.twin.problem.floor.wider) is not None:  # the reference uncertainty of single turns is not noise
            variance = variance - np.diagonal(wider, axis1=1, axis2=2)
        return float(np.sqrt(np.mean(variance[:, 0] + variance[:, 1])))

    def to_json(self) -> list[dict]:
        """Return ``noise.components`` of ``tinygc-fit/2``."""
        return self.noise.to_json()

    @property
    def words(self) -> str:
        """Describe the components in one line."""
        return self.noise.words


def kind_of(cause: str, problem: Problem) -> tuple[Kind, float]:
    """Kind and degrees of freedom of a cause of a floor's ``parts`` or of ``covariance_parts``.

    White noise is measured by overlapping differences of ``NOISE_BLOCKS`` blocks within the stills; without stills, in motion, its freedom
    is not known.  The drift has its prior's spread.
    """
    if cause in (GYRO_NOISE, ACCEL_NOISE):
        counts = np.array([still.duration_s for still in problem.stills]) / BLOCK_S
        freedom = sum(allan_freedom(counts[counts >= 2 * NOISE_BLOCKS] + 1, NOISE_BLOCKS))
        return "A", freedom or np.inf
    if cause == BIAS_DRIFT:
        known = problem.instability
        spread = TYPICAL_SPREAD if known.source.startswith("typical") else GIVEN_SPREAD
        sigma = spread * known.rps if known.sigma_rps is None else known.sigma_rps
        return "A" if known.of_unit else "B", freedom_of(known.rps, sigma)
    return "B", np.inf


def stated_noise(problem: Problem) -> StatedNoise | None:
    """Estimate the noise of a problem with measured rates; None where it is not estimated."""
    if problem.session.reference is not None or len(problem.used) > MOST_SEGMENTS:
        return None
    twin = Twin(problem)
    whiten = Whitener(twin)
    first = first_noise(twin, whiten)
    whiten = whiten.with_more(first.covariance)
    fit = refit(twin, whiten, [], twin.start())
    start = twin.start()
    columns = twin.precalibration_columns(start, twin.rates(start)).stacked()
    joint, own = problem.joint, from_own_stills(problem)
    J = whiten.back(fit.J) * prior_sigmas(twin, [])
    # The nine accelerometer parameters absorbed part of the lengths' scatter, which the residuals no longer contain.
    if joint is not None:
        J = np.concatenate([J, joint_columns(problem, joint) * joint.system.prior[joint.own]], axis=1)
    elif own:
        J = np.concatenate([J, columns * OPEN_MPS2], axis=1)
    white = whiten.white - PRECALIBRATION_MPS2**2 * columns @ columns.T
    if joint is not None:
        # Where the accelerometer is estimated, its uncertainty is the estimate's, instead of that of a sensor of its class.
        lengths = np.arange(len(white))[whiten.parts["length"]]
        white[lengths, lengths] -= ACCEL_INSTABILITY_MPS2**2
    base, r = whiten.white if joint is None else white, whiten.back(fit.r)
    noise = first.estimated(base, r, J, with_sigma=True)
    unusual_p = noise.unusual_p(base, r, J)
    if joint is None:
        factor = _accelerometer_factor(columns[whiten.parts["length"]], noise, own)
        return StatedNoise(twin, noise, white, columns @ factor, unusual_p, whiten.covariance, (r, J, base))
    from_rows = joint_response(problem, joint)
    known = from_rows @ (white + noise.covariance) @ from_rows.T + joint.beforehand @ joint.beforehand.T
    by_joint = joint_columns(problem, joint) @ np.linalg.cholesky(known)
    return StatedNoise(twin, noise, white, by_joint, unusual_p, whiten.covariance, (r, J, base))


def joint_columns(problem: Problem, joint: JointFit) -> np.ndarray:
    """Return the derivative (n, 9) of the stacked channels by the accelerometer's parameters, (n, 12) with a drift; a still's rate does not
    depend on them."""
    rows = len(problem.used) * problem.batch.angles
    design = joint.system.design[:, joint.own]
    return np.concatenate([design[:rows], np.zeros((3 * len(joint.force), design.shape[1])), design[rows:]])


def joint_response(problem: Problem, joint: JointFit) -> np.ndarray:
    """Return the response (9, n) of the accelerometer's parameters to an error of the stacked channels, (12, n) with a drift."""
    rows = len(problem.used) * problem.batch.angles
    response = joint.system.response[joint.own]
    return np.concatenate([response[:, :rows], np.zeros((len(response), 3 * len(joint.force))), response[:, rows:]], axis=1)


def _accelerometer_factor(lengths: np.ndarray, noise: SessionNoise, own: bool) -> np.ndarray:
    """Return a root (12, 12) m/s^2 of the covariance of the pre-calibration; lengths (Q, 12): its columns of the stills' lengths.

    A given calibration has the assumed uncertainty, but no less than stills with these errors would give.  A calibration made from the
    same stills has their errors in the nine parameters that the lengths determine, in its own frame.
    """
    each = float(np.hypot(noise.size(REFERENCE), ACCEL_INSTABILITY_MPS2))
    if not own:
        return np.eye(12) * max(PRECALIBRATION_MPS2, noise.size(REFERENCE) / np.sqrt(len(lengths)))
    fixed = lengths[:, FROM_LENGTHS]
    _, size, vt = np.linalg.svd(fixed, full_matrices=False)
    root = np.zeros((12, 12))
    root[np.ix_(FROM_LENGTHS, FROM_LENGTHS)] = vt.T @ np.diag(each / np.maximum(size, each / OPEN_MPS2)) @ vt
    return root


def from_own_stills(problem: Problem) -> bool:
    """Whether the accelerometer was calibrated from gravity's length in stills: the matrix is then upper triangular."""
    matrix = problem.session.config.accelerometer.matrix
    return not np.tril(matrix, -1).any() and bool(np.triu(matrix, 1).any())


# The covariance of least squares' parameters, with all estimated noise.
#
# The fit is linear in its errors: theta - truth = L y, y the stacked channels' errors (closure, still rates).  So its covariance is
# L C L', whatever C is (the sandwich of ``closure/uncertainty.py`` with a dense filling).


def stated_covariance(problem: Problem, model: LinearModel, noise: StatedNoise) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance (12, 12) of the linear model's vector, fitted to this problem's batch; and its part from the accelerometer's
    pre-calibration, which sessions with the same one share."""
    sources = stated_sources(problem, model, noise)
    if problem.joint is not None:
        sources = [source.of(GYROSCOPE) for source in sources]
    return total(sources), shared_part(problem, sources)


def stated_joint_covariance(problem: Problem, model: LinearModel, noise: StatedNoise) -> np.ndarray:
    """Return the covariance (21, 21) of the accelerometer's nine parameters and the gyroscope's twelve, estimated jointly.

    An error of a channel changes both; the accelerometer's change also alters the references that the gyroscope is fitted to.
    """
    return total(stated_sources(problem, model, noise))


def stated_sources(problem: Problem, model: LinearModel, noise: StatedNoise) -> list[Source]:
    """Return the sources (12, 12) of the linear model's vector, or (21, 21) of both sensors where they were estimated jointly: L C L' of
    each source of the channels, and what was known beforehand."""
    joint = problem.joint
    if joint is None:
        rows = _response(problem, model)
        return [source.through(rows) for source in channel_sources(problem, noise)]
    rows, beforehand = _joint_parts(problem, model)
    known = {CALIBRATION: beforehand[:, :-1], GRAVITY_LENGTH: beforehand[:, -1:]}
    found = [source.through(rows) for source in channel_sources(problem, noise)]
    return found + [Source(name, "B", np.inf, columns @ columns.T) for name, columns in known.items()]


def channel_sources(problem: Problem, noise: StatedNoise) -> Iterator[Source]:
    """Yield the sources of the channels' errors, (n, n) each: the noise, what the Earth's rate leaves out, and the accelerometer's
    pre-calibration where it is taken as it is."""
    yield from noise.sources()
    if problem.earth.source in ("estimated", "unknown"):
        yield Source(EARTH, "B", np.inf, _earth(problem, noise))
    if problem.joint is None:
        own, spare = from_own_stills(problem), max(1.0, len(noise.twin.stills) - len(FROM_LENGTHS))
        yield Source(CALIBRATION, "A" if own else "B", spare if own else np.inf, noise.accelerometer @ noise.accelerometer.T)


def shared_part(problem: Problem, sources: Iterable[Source]) -> np.ndarray:
    """Return the part of sources (P, P) that sessions with the same accelerometer calibration share; zero where this session made it."""
    shared = [source for source in sources if source.name in (CALIBRATION, GRAVITY_LENGTH)]
    return total(shared) * (problem.joint is None or problem.joint.mode == "prior")


def _joint_parts(problem: Problem, model: LinearModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the responses (21, n) and (21, k) of the parameters to an error of each channel, and to one sigma of each prior."""
    joint = problem.joint
    assert joint is not None
    gyroscope = _response(problem, model)
    columns, accelerometer = joint_columns(problem, joint), joint_response(problem, joint)
    through = gyroscope @ columns
    nine = slice(0, ACCELEROMETER_PARAMETERS)  # a drift is no parameter of the sensor, but its error is in those that are
    rows = np.concatenate([accelerometer[nine], gyroscope + through @ accelerometer])
    return rows, np.concatenate([joint.beforehand[nine], through @ joint.beforehand])


def stated_response(problem: Problem, model: LinearModel) -> np.ndarray:
    """Return the response (12, n) of the gyroscope's parameters to errors of the stacked channels, also through a jointly estimated
    accelerometer."""
    if problem.joint is None:
        return _response(problem, model)
    return _joint_parts(problem, model)[0][GYROSCOPE]


def stated_goodness(problem: Problem, model: LinearModel, noise: StatedNoise) -> tuple[GoodnessOfFit, float]:
    """Return the goodness of fit of the closure with all noise that has a cause; and the variance inflation, 1 or more, with all noise.

    The first excludes the independent error of each turn, which would absorb any misfit.
    """
    batch = problem.batch
    end, sensitivity = residual.end_and_sensitivity(batch, model(batch.rate))
    carry = _carry(problem, sensitivity)
    angles = residual.error_angles(residual.batch_residual(batch, end)).ravel()
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles].reshape(len(angles), PARAMETERS)
    if problem.rest_rps is not None:
        design = _about(design, problem.rest_rps)[:, MATRIX]
    earth = _earth(problem, noise)
    known = problem.batch.known.ravel()
    covariances = ((carry @ (given + earth) @ carry.T)[np.ix_(known, known)] for given in (noise.named, noise.covariance))
    named, whole = (closure_goodness(angles[known], design[known], covariance) for covariance in covariances)
    return named, whole.excess


def _response(problem: Problem, model: LinearModel) -> np.ndarray:
    """Return L (12, n) 1, rad/s: the response of the parameters to errors of the stacked channels."""
    count, q = len(problem.batch) * problem.batch.angles, len(problem.still_rates.rate)
    sensitivity, weighed, hessian, _ = _normal(problem, model)
    pull = weighed @ _carry(problem, sensitivity)
    found = -np.linalg.solve(hessian, pull)
    if problem.rest_rps is None:
        return found
    # B = mean over the stills of (earth - E m): it has the error of the stills, and that of E on the mean rate.
    found = np.concatenate([found, _bias_of(found, problem.rest_rps)])
    found[BIAS, count : count + 3 * q] -= np.tile(np.eye(3), q) / q
    return found


def _normal(problem: Problem, model: LinearModel) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the closure's sensitivity (S, T, d, 3), and the normal equations of least squares: weighed columns (p, S d), information
    (p, p), and the prior's part of it; p 12, or 9 of E alone where the bias is from the stills."""
    batch, rest, own = problem.batch, problem.rest_rps, slice(0, PARAMETERS)
    sensitivity = residual.sensitivity(batch, model(batch.rate))
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles].reshape(-1, PARAMETERS)
    if rest is not None:
        own = MATRIX
        design = _about(design, rest)[:, own]
    weighed = design * (1 / problem.floor.sigma.ravel() ** 2)[:, None]
    prior: np.ndarray = np.diag(1 / PRIOR_SIGMA[own] ** 2)
    if problem.prior is not None:
        prior = np.linalg.inv((problem.prior.covariance / problem.prior.weight)[own, own])
    hessian = design.T @ weighed + prior
    return sensitivity, weighed.T, hessian, prior


def prior_share(problem: Problem, model: LinearModel) -> np.ndarray:
    """Return K (12, 12): the response of the parameters to an error of the prior's centre.

    theta - truth = L y + K (centre - truth): a prior with covariance P adds K P K' to the covariance from noise.
    """
    _, _, hessian, prior = _normal(problem, model)
    share = np.linalg.solve(hessian, prior)
    if problem.rest_rps is None:
        return share
    return np.pad(np.concatenate([share, _bias_of(share, problem.rest_rps)]), ((0, 0), (0, 3)))


def _bias_of(matrix: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return the change (3, k) of B = -E rest with changes (9, k) of E."""
    return -np.kron(np.eye(3), rest) @ matrix


def _about(design: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return columns (n, 12) with those of E about the rate at rest, from which B = -E rest follows."""
    turned = design.copy()
    turned[:, MATRIX] -= np.einsum("na,j->naj", design[:, BIAS], rest).reshape(len(design), 9)
    return turned


def _carry(problem: Problem, sensitivity: np.ndarray) -> np.ndarray:
    """Return the map (S d, n) from errors of the channels to those of the closure; a still's rate error enters the turns around it, where
    their bias comes from it."""
    rows = len(problem.batch) * problem.batch.angles
    carry = np.zeros((rows, rows + 4 * len(problem.still_rates.rate)))
    carry[:, :rows] = np.eye(rows)
    if problem.rest_rps is not None:
        batch = problem.batch
        sensitivity = sensitivity[:, :, : batch.angles]
        first, last, share = bias_shares(problem)
        before = np.einsum("st,stij->sij", 1 - share, sensitivity)
        after = np.einsum("st,stij->sij", share, sensitivity)
        for s in range(len(batch)):
            own = slice(s * batch.angles, (s + 1) * batch.angles)
            for still, part in ((first[s], before[s]), (last[s], after[s])):
                carry[own, rows + 3 * still : rows + 3 * still + 3] -= part
    return carry


def _earth(problem: Problem, noise: StatedNoise) -> np.ndarray:
    """Return the covariance (n, n) of what an estimated heading, or an unknown one where the latitude is known, leaves out of the Earth's
    rate."""
    earth, latitude_deg = problem.earth, problem.session.config.site.latitude_deg
    if earth.source == "none":
        return np.zeros_like(noise.white)
    columns = noise.twin.earth_columns().stacked()
    return columns @ unseen_covariance(earth, latitude_deg) @ columns.T


# What rounding to a register's steps leaves in the bias, where the noise at rest is below half a step: no noise of the channels.


#: stills whose readings show the steps of the register
SHOW_STEPS = 20


def rounding_covariance(problem: Problem, model: LinearModel) -> np.ndarray:
    """Return the covariance (12, 12) of the linear model's vector from the rounding of readings at rest.

    All stills read nearly the same rate, so the mean of their readings is off by the same, and B by -E times that.  It counts whole, also
    where B is from the ends of the turns, whose rests are part of every segment.
    """
    covariance = np.zeros((PARAMETERS, PARAMETERS))
    rests = [(problem.logs[log].samples.gyro, still.start, still.stop) for log, still in problem.references]
    # One still after the other: together they may be a day.
    shown = [np.unique(gyro[start:stop]) for gyro, start, stop in rests[:SHOW_STEPS]]
    if rests and (lsb := lsb_of(np.concatenate(shown))) > 0:
        variance = np.mean([rounding_of_mean(gyro[start:stop], lsb) for gyro, start, stop in rests], axis=0)
        covariance[BIAS, BIAS] = (model.E * variance) @ model.E.T
    return covariance


# The uncertainty that a fit states, assembled from its sources: the covariance is their sum, in order, and nothing else.
#
#     noise, references, calibration of the accelerometer, Earth      C_i of each: through the response of the parameters
#     misfit beyond the noise                                         (f - 1) sum C_i, where the closure refutes that noise explains it
#     rounding, clock, prior                                          added as they are
#
# f is the variance inflation: chi-square of the closure over its degrees of freedom nu.  Its own uncertainty is f sqrt(2 / nu), so that
# the misfit's variance has nu ((f - 1) / f)^2 degrees of freedom.  What one unmodelled effect may have moved (``systematic``),
# and the bias of another switch-on (``repeatability``), are no part of it.

MISFIT, ROUNDING, CLOCK = "misfit beyond the noise", "rounding of the registers", "clock"


def stated_uncertainty(
    problem: Problem, level: Problem, model: LinearModel, noise: StatedNoise | None, prior: PriorUse | None = None
) -> dict[str, Any]:
    """Assemble the uncertainty of a model fitted to ``level``, the problem with the selected bias, as the fields of ``FitResult`` state it.

    Raises FitError for a calibration that no gyroscope has (``require_plausible``).
    """
    if noise is None:
        found = goodness(level.batch, level.floor, model, level.wander)
        widened = found.excess
        parts = covariance_parts(level.batch, level.floor, model, level.earth, level.wander, level.prior)
        sources = [Source(cause, *kind_of(cause, level), part) for cause, part in parts.items()]
    else:
        found, widened = stated_goodness(level, model, noise)
        sources = stated_sources(level, model, noise)
    if widened > 1:
        freedom = max(1.0, found.freedom * ((widened - 1) / widened) ** 2)
        sources = [*sources, Source(MISFIT, "A", freedom, (widened - 1) * total(sources))]
    joint = noise is not None and level.joint is not None
    gyroscope = [source.of(GYROSCOPE) for source in sources] if joint else sources
    require_plausible(model, total(gyroscope), problem.session.folder)
    more = list(_as_they_are(problem, model, prior))
    there = tuple(source for source in (*gyroscope, *more) if source.covariance.any())
    stated = {"goodness": found, "widened": widened, "sources": there, "covariance": total(there)}
    if noise is None:
        return stated
    shared = widened * shared_part(level, sources)
    if not joint:
        return stated | {"accelerometer_covariance": shared}
    whole = (*sources, *(_embedded(source, shared.shape) for source in more))
    stated |= {"joint_sources": whole, "joint_covariance": total(whole), "joint_shared": shared}
    return stated | {"accelerometer_covariance": shared[GYROSCOPE, GYROSCOPE]}


def _as_they_are(problem: Problem, model: LinearModel, prior: PriorUse | None) -> Iterator[Source]:
    yield Source(ROUNDING, "B", np.inf, rounding_covariance(problem, model))
    if prior is not None:
        yield Source(prior.source, "B", np.inf, prior.more)
    if (clock := problem.session.clock) is not None:
        yield Source(CLOCK, "B", np.inf, clock.covariance(model.vector))


def _embedded(source: Source, shape: tuple[int, ...]) -> Source:
    covariance = np.zeros(shape)
    covariance[GYROSCOPE, GYROSCOPE] = source.covariance
    return replace(source, covariance=covariance)


# A calibration that no gyroscope can have, whatever its residuals.

#: factor by which no gyroscope's sensitivity is off: data sheets allow 1 to 10 %, and the next usual mistake is a factor of 1.15 or 2
GAIN_WITHIN = 1.25
#: sigmas beyond that factor
CLEARLY = 3.0


def require_plausible(model: LinearModel, covariance: np.ndarray, folder: Path) -> None:
    """Refuse a calibration whose E stretches or shrinks the rates along some direction as no gyroscope's errors do.

    covariance (12, 12) of ``model.vector``: what the session hardly determines is not refused.  Raises FitError.
    """
    left, gains, right = np.linalg.svd(model.E)
    for gain, u, v in zip(gains, left.T, right, strict=True):
        slope = np.outer(u, v).ravel()  # of a singular value by the elements of E
        sigma = float(np.sqrt(slope @ covariance[MATRIX, MATRIX] @ slope))
        beyond = max(gain - GAIN_WITHIN, 1 / GAIN_WITHIN - gain)
        if not beyond <= CLEARLY * sigma:
            raise FitError(
                f"{folder}: no gyroscope has this calibration: it multiplies rates about ({', '.join(f'{x:.2f}' for x in v)}) by "
                f"{significant(gain)}, expected {1 / GAIN_WITHIN:g} to {GAIN_WITHIN:g}; rates or gravity are not as in session.toml: "
                f"look at {command_line('check', folder)}"
            )
