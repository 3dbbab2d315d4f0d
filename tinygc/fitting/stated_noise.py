"""The noise that a fit reckons with: the white floor, and what the recording itself shows beyond it (``explanation/noise``).

Estimated once a fit.  Where there are no stills between turns (a truth file), where each log has a bias of its own, and in sessions of
more than ``MOST_SEGMENTS`` segments, the floor and the bias instability stay all that is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.accelerometer.parameters import PARAMETERS
from tinygc.explanation.noise.components import REFERENCE, TURN
from tinygc.explanation.noise.restricted_likelihood import estimate
from tinygc.explanation.noise.session_noise import SessionNoise, first_noise
from tinygc.explanation.twin.refit import prior_sigmas, refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import ACCEL_INSTABILITY_MPS2, PRECALIBRATION_MPS2, Whitener
from tinygc.problem.joint_fit import ACCELEROMETER, JointFit
from tinygc.problem.problem import Problem

#: the covariance of all channels is dense: its inverse costs the cube of the session (benchmarks/fit_speed.py)
MOST_SEGMENTS = 400
#: m/s^2: prior of an accelerometer's numbers that were found from the same stills, far above what these leave open
OPEN_MPS2 = 100 * PRECALIBRATION_MPS2
#: of the 12 columns of ``precalibration_columns``, those that stills' lengths fix: the bias, and the upper triangle of the matrix
FROM_LENGTHS = np.array([0, 1, 2, *(3 + 3 * i + j for i, j in zip(*np.triu_indices(3), strict=True))])


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """noise: the components; white (n, n): white noise of the stacked channels (``Channels.stacked``), without any allowance; accelerometer
    (n, 12): one sigma each of what its pre-calibration may be wrong by, the same in the whole session; twin that it was estimated with."""

    twin: Twin
    noise: SessionNoise
    white: np.ndarray
    accelerometer: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) rad^2, (rad/s)^2, (m/s^2)^2 of everything."""
        return self.white + self.noise.covariance + self.accelerometer @ self.accelerometer.T

    @property
    def named(self) -> np.ndarray:
        """(n, n): the same without what each turn errs by itself, which is what nothing explains."""
        known = replace(self.noise, s=np.where([c.name == TURN for c in self.noise.components], 0.0, self.noise.s))
        return self.white + known.covariance + self.accelerometer @ self.accelerometer.T

    @property
    def closure(self) -> slice:
        """Rows of the closure."""
        return slice(0, len(self.twin.segments) * self.twin.batch.angles)

    @property
    def tilt_rms(self) -> float:
        """rad: the tilt error that noise leaves, over the segments; the accelerometer's pre-calibration is in E, and leaves none."""
        variance = np.diag(self.white + self.noise.covariance)[self.closure].reshape(len(self.twin.segments), -1)
        if (wider := self.twin.problem.floor.wider) is not None:  # single turns' own uncertainty is no noise
            variance = variance - np.diagonal(wider, axis1=1, axis2=2)
        return float(np.sqrt(np.mean(variance[:, 0] + variance[:, 1])))

    def to_json(self) -> list[dict]:
        """``noise.components`` of ``tinygc-fit/1``."""
        return self.noise.to_json()

    @property
    def words(self) -> str:
        """Those that are there, in one line."""
        return self.noise.words


def stated_noise(problem: Problem) -> StatedNoise | None:
    """Of a problem whose rates are as they were measured; None where it is not estimated."""
    if problem.session.truths is not None or len(problem.used) > MOST_SEGMENTS:
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
    # Its nine numbers took their share of the lengths' scatter, which what is left must not be taken for.
    if joint is not None:
        J = np.concatenate([J, joint_columns(problem, joint) * joint.prior], axis=1)
    elif own:
        J = np.concatenate([J, columns * OPEN_MPS2], axis=1)
    parts = first.components
    white = whiten.white - PRECALIBRATION_MPS2**2 * columns @ columns.T
    if joint is not None:
        # Beside an estimation of the accelerometer its remainder is one, too, instead of what a sensor of its class is allowed.
        lengths = np.arange(len(white))[whiten.parts["length"]]
        white[lengths, lengths] -= ACCEL_INSTABILITY_MPS2**2
    found = estimate(
        whiten.back(fit.r),
        J,
        whiten.white if joint is None else white,
        [c.V for c in parts],
        np.array([c.usual for c in parts]),
        [c.prior for c in parts],
        first.blocks,
        with_sigma=True,
    )
    noise = replace(first, s=found.s, sigma=found.sigma, value=found.value)
    if joint is None:
        return StatedNoise(twin, noise, white, columns @ accelerometer_factor(columns[whiten.parts["length"]], noise, own))
    from_rows = joint_response(problem, joint)
    known = from_rows @ (white + noise.covariance) @ from_rows.T + joint.beforehand @ joint.beforehand.T
    return StatedNoise(twin, noise, white, joint_columns(problem, joint) @ np.linalg.cholesky(known))


def joint_columns(problem: Problem, joint: JointFit) -> np.ndarray:
    """(n, 9): how the accelerometer's numbers change the stacked channels; a still's rate knows nothing of them."""
    rows = len(problem.used) * problem.batch.angles
    design = joint.system.design[:, ACCELEROMETER]
    return np.concatenate([design[:rows], np.zeros((3 * len(joint.force), PARAMETERS)), design[rows:]])


def joint_response(problem: Problem, joint: JointFit) -> np.ndarray:
    """(9, n): how the accelerometer's numbers follow an error of the stacked channels."""
    rows = len(problem.used) * problem.batch.angles
    response = joint.system.response[ACCELEROMETER]
    return np.concatenate([response[:, :rows], np.zeros((PARAMETERS, 3 * len(joint.force))), response[:, rows:]], axis=1)


def accelerometer_factor(lengths: np.ndarray, noise: SessionNoise, own: bool) -> np.ndarray:
    """(12, 12) m/s^2: a root of the covariance of the pre-calibration's numbers, whose columns of the stills' lengths are (Q, 12).

    A calibration that is given is as good as the tool allows for, and no better than stills that err as these do could make it.  One that
    was made from these very stills has their errors: those of the nine numbers that lengths fix, in the frame that it defines.
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
    """Whether the accelerometer's calibration is one that lengths of gravity in stills gave: upper triangular, since no more is fixed."""
    matrix = problem.session.config.accelerometer.matrix
    return not np.tril(matrix, -1).any() and bool(np.triu(matrix, 1).any())
