"""What a change costs, what this recording cannot tell, and which turns would.

The cost is the error of the end attitude after a minute: of today's own first minute of motion, exact, between the old calibration and
today's best estimate.  What today's data leave open of a parameter is its posterior under a wide prior of plausible changes,

    W = (A' C^-1 A + D^-2)^-1,        C: covariance of noise and references,  D: ``questions.PLAUSIBLE``

and it matters where a minute of use may miss more than a limit by it: one full turn about an axis for E, a minute at rest for B, the tilt
of any attitude for the accelerometer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.detect.accelerometer import IDENTITY
from session.io.units import DEG, STANDARD_GRAVITY_MPS2
from tinygc.annexes.verification.expected import ZERO
from tinygc.annexes.verification.old import ACCELEROMETER, COUNT, GYROSCOPE
from tinygc.annexes.verification.questions import GRAVITY, PLAUSIBLE, B, E, TodaysNoise
from tinygc.annexes.verification.rows import CLOSURE, LENGTH, Rows
from tinygc.attitude import rotation
from tinygc.closure.joint import tilt_columns
from tinygc.closure.least_squares import solve_lower
from tinygc.closure.motion import MINUTE_S, Motion, at_rest, motion_of
from tinygc.models.linear import BIAS, MATRIX, LinearModel
from tinygc.planning.proposals import Known, Proposal, best_turns
from tinygc.planning.turns import SIDES

#: degrees: what a change may cost in a minute before it matters
LIMIT_DEG = 1.0
#: sigmas of a bound of 95 %
BOUND = 1.959963984540054
#: turns that are proposed at most
MOST_TURNS = 10
#: sigma of the closure of one turn by hand where no turn shows it, degrees (docs/measured/accuracy.md); of gravity's length in a still,
#: m/s^2
USUAL_TURN_DEG, USUAL_LENGTH_MPS2 = 0.05, 1e-3
#: s of a full turn in a minute of use
TURN_S = 4.0


@dataclass(frozen=True, eq=False)
class Cost:
    """Error of the end attitude after a motion, rad, axes of the start: with the old calibration as it is, with B taken anew, each with its
    sigma (3,); motion, in words."""

    motion: str
    as_it_is: np.ndarray
    sigma: np.ndarray
    bias_anew: np.ndarray
    bias_anew_sigma: np.ndarray


@dataclass(frozen=True)
class Bound:
    """What today's data leave open: name of the question; degrees that a minute of use may miss by it (95 %); limit; what the use is."""

    name: str
    bound_deg: float
    limit_deg: float
    use: str

    @property
    def is_seen(self) -> bool:
        """Whether a change that matters would have been seen."""
        return self.bound_deg <= self.limit_deg


def minute_of(rows: Rows) -> Motion:
    """Today's first minute from the first turn on; a minute at rest where there are only rests."""
    if rows.twin is None:
        return resting(rows)
    first = rows.twin.segments[0]
    return motion_of(rows.session.logs[first.log :], MINUTE_S, first.start_s)


def resting(rows: Rows) -> Motion:
    """A minute at rest, with what the gyroscope reads there."""
    return at_rest(LinearModel(np.eye(3), -rows.rest_rps), MINUTE_S)


def cost_of(
    rows: Rows, old: LinearModel, change: np.ndarray, covariance: np.ndarray, anew: np.ndarray, anew_covariance: np.ndarray
) -> Cost:
    """Cost of a change (21,) with its covariance (21, 21); anew (3,): the change of B that is taken, with its covariance (3, 3)."""
    motion = minute_of(rows)
    today, moved = LinearModel.from_vector(old.vector + change[GYROSCOPE]), old.with_bias_moved(anew)
    slope = motion.slope(today)
    own = covariance[GYROSCOPE, GYROSCOPE]
    # B anew and today's B share their error: what is left is E's, and how far the two estimates of B differ.
    matrix, bias = slope[:, MATRIX], slope[:, BIAS]
    left = matrix @ own[MATRIX, MATRIX] @ matrix.T + bias @ anew_covariance @ bias.T
    return Cost(
        motion.words,
        motion.error(old, today),
        np.sqrt(np.diag(slope @ own @ slope.T)),
        motion.error(moved, today),
        np.sqrt(np.diag(left)),
    )


def full_turn(axis: int, rate_hz: float = 50.0) -> Motion:
    """One full turn about an axis of the sensor."""
    t = np.arange(round(TURN_S * rate_hz) + 1) / rate_hz
    rate = np.zeros((len(t), 3))
    rate[:, axis] = 2 * np.pi / TURN_S * (1 - np.cos(2 * np.pi * t / TURN_S))
    return Motion(rate, np.diff(t), f"one turn about {'xyz'[axis]}")


def left_open(rows: Rows, noise: TodaysNoise) -> np.ndarray:
    """(21, 21) W: what today's data leave open of each parameter, with plausible changes as prior."""
    factor = np.linalg.cholesky(noise.covariance + rows.known @ rows.known.T)
    J = solve_lower(factor, rows.parameters * PLAUSIBLE)
    return np.linalg.inv(J.T @ J + np.eye(COUNT)) * np.outer(PLAUSIBLE, PLAUSIBLE)


def uses(rows: Rows, old: LinearModel, with_accelerometer: bool) -> list[tuple[str, np.ndarray, str]]:
    """Of each question: its name, the derivative (Q, 21) of the angles of a minute of use by the parameters, rad, and the use in words."""
    turns, still = np.zeros((9, COUNT)), np.zeros((3, COUNT))
    turns[:, GYROSCOPE][:, MATRIX] = np.concatenate([full_turn(axis).slope(old)[:, MATRIX] for axis in range(3)])
    still[:, GYROSCOPE] = resting(rows).slope(old)
    found = [(E, turns, "one full turn about any axis"), (B, still, "a minute at rest")]
    if with_accelerometer:
        force = SIDES * STANDARD_GRAVITY_MPS2
        columns = tilt_columns(rotation.from_gravity(force), IDENTITY, force)[:, :2].reshape(-1, ACCELEROMETER.stop)
        found.append((GRAVITY, np.pad(columns, ((0, 0), (0, COUNT - ACCELEROMETER.stop))), "the tilt on any side"))
    return found


def bounds(rows: Rows, old: LinearModel, W: np.ndarray, limit_deg: float, with_accelerometer: bool) -> list[Bound]:
    """Bound of each question, from what is left open (21, 21)."""
    parts = uses(rows, old, with_accelerometer)
    return [Bound(name, float(_bounds_deg(slopes, np.zeros(COUNT), W).max()), limit_deg, words) for name, slopes, words in parts]


def effects_deg(rows: Rows, old: LinearModel, change: np.ndarray, covariance: np.ndarray, with_accelerometer: bool) -> dict[str, float]:
    """By question: degrees that a minute of use misses at most (95 %) by a change (21,) with its covariance (21, 21)."""
    parts = uses(rows, old, with_accelerometer)
    return {name: float(_bounds_deg(slopes, change, covariance).max()) for name, slopes, _ in parts}


def _bounds_deg(slopes: np.ndarray, change: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(Q,) bounds of the sizes of quantities with these slopes (Q, 21), degrees."""
    sigma = np.sqrt(np.einsum("qi,ij,qj->q", slopes, covariance, slopes))
    return np.asarray((np.abs(slopes @ change) + BOUND * sigma) / DEG)


def turns_that_tell(rows: Rows, noise: TodaysNoise, W: np.ndarray, limit_deg: float, count: int = MOST_TURNS) -> list[Proposal]:
    """Turns that bring what is open below the limit, the best first; none where nothing is open."""
    limit = limit_deg * DEG / BOUND
    wanted = np.full(COUNT, limit / (2 * np.pi * np.sqrt(3)))
    wanted[ACCELEROMETER] = np.r_[np.full(6, limit / np.sqrt(2)), np.full(3, limit * STANDARD_GRAVITY_MPS2 / np.sqrt(2))]
    wanted[ZERO] = limit / MINUTE_S
    return best_turns(_known(rows, noise, W, wanted), count)


def turns_that_separate(rows: Rows, noise: TodaysNoise, spans: list[np.ndarray], count: int = 3) -> list[Proposal]:
    """Turns that tell causes apart, each of which moves the parameters along its columns (21, k)."""
    together = np.concatenate(spans, axis=1)
    floor = np.diag((1e-4 * PLAUSIBLE) ** 2)
    covariance = together @ together.T + floor
    return best_turns(_known(rows, noise, covariance, np.sqrt(np.diag(covariance)) / 10 + 1e-5 * PLAUSIBLE), count)


def _known(rows: Rows, noise: TodaysNoise, covariance: np.ndarray, wanted: np.ndarray) -> Known:
    sigma = np.sqrt(np.diag(noise.covariance))
    closure, length = sigma[rows.kinds[CLOSURE]][~rows.blank[rows.kinds[CLOSURE]]], sigma[rows.kinds[LENGTH]]
    sigma_rad = float(np.median(closure)) if len(closure) else USUAL_TURN_DEG * DEG
    return Known(covariance, sigma_rad, float(np.median(length)) if len(length) else USUAL_LENGTH_MPS2, True, wanted)
