"""What a change costs, what this recording cannot test, and which turns would.

The cost is the largest error of the attitude within a minute (``tinygc/closure/motion.py``): of today's own first minute of motion, exact,
between the old calibration and today's best estimate.  What today's data leave open of a parameter is its posterior under a wide prior of
plausible changes,

    W = (A' C^-1 A + D^-2)^-1,        C: covariance of noise and references,  D: ``questions.PLAUSIBLE``

and it matters where a minute of use may miss more than a limit by it: a turn about an axis for E, at each quarter, and today's own minute;
a minute at rest for B; the tilt of any attitude for the accelerometer; for what is left, its rate over a minute.  A full turn alone would
not show a misalignment: about an axis that leans a little it closes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.records import Key, Size, Vector
from session.base.units import DEG, STANDARD_GRAVITY_MPS2
from session.detect.accelerometer import IDENTITY
from tinygc.closure.joint import tilt_columns
from tinygc.closure.motion import MINUTE_S, Motion, at_rest, motion_of
from tinygc.estimation.spread import ACCELEROMETER, COUNT, GYROSCOPE, ZERO
from tinygc.features.unit.verification.questions import GRAVITY, PLAUSIBLE, B, E
from tinygc.features.unit.verification.rows import CLOSURE, LENGTH, Rows
from tinygc.inference.solve import solve_lower
from tinygc.models.linear import BIAS, MATRIX, LinearModel
from tinygc.noise.components import SessionNoise
from tinygc.planning.proposals import Known, Proposal, best_turns
from tinygc.planning.turns import SIDES

#: sigmas of a bound of 95 %
_BOUND = 1.959963984540054
#: turns that are proposed at most
MOST_TURNS = 10
#: sigma of the closure of one turn by hand where no turn shows it, degrees (docs/measured.md); of gravity's length in a still,
#: m/s^2
USUAL_TURN_DEG, USUAL_LENGTH_MPS2 = 0.05, 1e-3
#: s of a full turn in a minute of use; where on the way it is looked at: a misalignment shows most half way round
TURN_S, RATE_HZ, ON_THE_WAY = 4.0, 50.0, (0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, eq=False)
class Cost:
    """Largest error of the attitude in a motion, rad, axes of the start: with the old calibration as it is, with the new bias, each with
    its sigma (3,), the larger of there and at the end; motion, in words."""

    motion: str
    as_it_is: Annotated[Vector, Key("as_it_is_deg", si=DEG)]
    sigma: Annotated[Vector, Key("sigma_deg", si=DEG)]
    with_new_bias: Annotated[Vector, Key("with_new_bias_deg", si=DEG)]
    with_new_bias_sigma: Annotated[Vector, Key("with_new_bias_sigma_deg", si=DEG)]


@dataclass(frozen=True)
class Bound:
    """What today's data leave open: name of the question; degrees that a minute of use may miss by it (95 %); limit; what the use is."""

    written = ("name", "bound_deg", "limit_deg", "use", "is_seen")
    name: str
    bound_deg: Size
    limit_deg: Size
    use: str

    @property
    def is_seen(self) -> Annotated[bool, Key("seen")]:
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
    rows: Rows, old: LinearModel, change: np.ndarray, covariance: np.ndarray, bias_change: np.ndarray, bias_covariance: np.ndarray
) -> Cost:
    """Cost of a change (21,) with its covariance (21, 21); bias_change (3,): of B that the new bias has, with its covariance (3, 3)."""
    motion = minute_of(rows)
    today, moved = LinearModel.from_vector(old.vector + change[GYROSCOPE]), old.with_bias_moved(bias_change)
    own = covariance[GYROSCOPE, GYROSCOPE]
    # The new bias and today's B share their error: what is left is E's, and how far the two estimates of B differ.
    left = np.zeros_like(own)
    left[MATRIX, MATRIX], left[BIAS, BIAS] = own[MATRIX, MATRIX], bias_covariance
    as_it_is, with_new_bias = (_largest(motion, each, today, known) for each, known in ((old, own), (moved, left)))
    return Cost(motion.words, *as_it_is, *with_new_bias)


def _largest(motion: Motion, model: LinearModel, today: LinearModel, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3,) largest error of a model, and its sigma from the covariance (12, 12) of today's."""
    part, error = motion.largest_error(model, today)
    slopes = [each.slope(today) for each in (part, motion)]
    return error, np.max([sigmas_in(slope @ covariance @ slope.T) for slope in slopes], axis=0)


def turn_about(axis: int, share: float) -> Motion:
    """A share of a full turn about an axis of the sensor."""
    t = np.arange(round(TURN_S * RATE_HZ) + 1) / RATE_HZ
    rate = np.zeros((len(t), 3))
    rate[:, axis] = share * 2 * np.pi / TURN_S * (1 - np.cos(2 * np.pi * t / TURN_S))
    return Motion(rate, np.diff(t), f"{360 * share:g}° about {'xyz'[axis]}")


def left_open(rows: Rows, noise: SessionNoise) -> np.ndarray:
    """(21, 21) W: what today's data leave open of each parameter, with plausible changes as prior."""
    factor = np.linalg.cholesky(rows.covariance(noise) + rows.known @ rows.known.T)
    J = solve_lower(factor, rows.parameters * PLAUSIBLE)
    return np.linalg.inv(J.T @ J + np.eye(COUNT)) * np.outer(PLAUSIBLE, PLAUSIBLE)


def estimated_change(rows: Rows, noise: SessionNoise, W: np.ndarray) -> np.ndarray:
    """(21,) change of the parameters by today's data, with plausible changes as prior: W (21, 21) is its covariance (``left_open``)."""
    C = rows.covariance(noise) + rows.known @ rows.known.T
    return np.asarray(-W @ (rows.parameters.T @ np.linalg.solve(C, rows.r)))


def uses(rows: Rows, old: LinearModel, with_accelerometer: bool) -> list[tuple[str, np.ndarray, str]]:
    """Of each question: its name, the derivative (M, k, 21) of the errors of M uses, of k components, by the parameters, rad, and the use
    in words."""
    motions, still = [turn_about(axis, share) for axis in range(3) for share in ON_THE_WAY], np.zeros((1, 3, COUNT))
    words = "a turn about any axis"
    if rows.twin is not None:
        motions, words = [*motions, minute_of(rows)], f"{words}, or today's minute"
    turns = np.zeros((len(motions), 3, COUNT))
    turns[..., GYROSCOPE][..., MATRIX] = [motion.slope(old)[:, MATRIX] for motion in motions]
    still[..., GYROSCOPE] = resting(rows).slope(old)
    found = [(E, turns, words), (B, still, "a minute at rest")]
    if with_accelerometer:
        force = SIDES * STANDARD_GRAVITY_MPS2
        columns = tilt_columns(rotation.from_gravity(force), IDENTITY, force)[:, :2]
        found.append((GRAVITY, np.pad(columns, ((0, 0), (0, 0), (0, COUNT - ACCELEROMETER.stop))), "the tilt on any side"))
    return found


def bound_deg(slopes: np.ndarray, change: np.ndarray, covariance: np.ndarray) -> float:
    """Degrees that a minute of use misses at most (95 %) by a change (21,) with its covariance (21, 21): the largest of angles with these
    slopes (M, k, 21), each of k components, along its most uncertain direction."""
    sigma = np.sqrt(np.linalg.eigvalsh(slopes @ covariance @ slopes.transpose(0, 2, 1)).max(axis=1))
    return float((np.linalg.norm(slopes @ change, axis=1) + _BOUND * sigma).max() / DEG)


def turns_to_test(rows: Rows, noise: SessionNoise, W: np.ndarray, limit_deg: float) -> list[Proposal]:
    """Turns that bring what is open below the limit, the best first; none where nothing is open."""
    limit = limit_deg * DEG / _BOUND
    wanted = np.full(COUNT, limit / (2 * np.pi * np.sqrt(3)))
    wanted[ACCELEROMETER] = np.r_[np.full(6, limit / np.sqrt(2)), np.full(3, limit * STANDARD_GRAVITY_MPS2 / np.sqrt(2))]
    wanted[ZERO] = limit / MINUTE_S
    return best_turns(_known(rows, noise, W, wanted), MOST_TURNS)


def turns_to_separate(rows: Rows, noise: SessionNoise, spans: list[np.ndarray]) -> list[Proposal]:
    """Turns that separate causes, each of which moves the parameters along its columns (21, k)."""
    together = np.concatenate(spans, axis=1)
    floor = np.diag((1e-4 * PLAUSIBLE) ** 2)
    covariance = together @ together.T + floor
    return best_turns(_known(rows, noise, covariance, sigmas_in(covariance) / 10 + 1e-5 * PLAUSIBLE), 3)


def _known(rows: Rows, noise: SessionNoise, covariance: np.ndarray, wanted: np.ndarray) -> Known:
    sigma = sigmas_in(rows.covariance(noise))
    closure, length = sigma[rows.kinds[CLOSURE]][~rows.blank[rows.kinds[CLOSURE]]], sigma[rows.kinds[LENGTH]]
    sigma_rad = float(np.median(closure)) if len(closure) else USUAL_TURN_DEG * DEG
    return Known(covariance, sigma_rad, float(np.median(length)) if len(length) else USUAL_LENGTH_MPS2, True, wanted)
