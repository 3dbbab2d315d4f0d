"""What a lot tells the coach of the board on the table, and whether the board belongs to it, by the turns so far.

Linear, as everything that the coach knows: the closure that the lot's mean leaves on each turn, its bias taken from the stills.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import EARTH_RATE_RPS
from session.guide.messages import AcceptedTurn
from tinygc.closure.residual import Batch, closure_angles
from tinygc.lot.lot import Lot
from tinygc.lot.prior import Belonging, Prior, belonging, farthest, prior_of
from tinygc.models.linear import BIAS, MATRIX, PARAMETERS, LinearModel

#: of a bias that a still shows, beside the Earth's rate, whose direction the coach does not know
STILL_BIAS_RPS = EARTH_RATE_RPS
#: probability of belonging below which the lot tells the coach nothing, as ``fit`` has it for what is open
BELONGS = 0.95


@dataclass(frozen=True, eq=False)
class LotWord:
    """prior: what is known beforehand, None where the board does not belong, or may not; says: one line of that, or nothing."""

    prior: Prior | None
    says: str


def word_of(
    lot: Lot, turns: tuple[AcceptedTurn, ...], columns: np.ndarray, noise: np.ndarray, directions: np.ndarray, by_turns: bool = True
) -> LotWord:
    """What the lot tells of a board by its turns: columns (S, 2, 12) and noise (S, 2, 2) of each; directions (S, 2, 4): attitudes of its
    ends.

    Where the lot has no mean for a number, that is as open as without it.  by_turns: whether the turns' closure is asked, too: beside an
    accelerometer that nobody has calibrated it would show that one's errors, and the stills' rates alone say whether the board belongs.
    """
    stills = np.array([still.gyro_mean for turn in turns for still in turn.segment.stills])
    bias = stills.mean(axis=0)
    start = LinearModel(np.eye(3), -bias)
    prior = prior_of(lot, start.vector)
    model = LinearModel(prior.centre[MATRIX].reshape(3, 3), np.zeros(3))
    angles = np.array([_angles(turn, model, ends) for turn, ends in zip(turns, directions, strict=True)])
    weight, design = np.linalg.inv(noise), columns[:, :, MATRIX] * by_turns
    known = np.einsum("sdp,sde,seq->pq", design, weight, design)
    own = np.linalg.inv(prior.covariance[MATRIX, MATRIX])
    inverse = np.linalg.inv(known + own)
    moved, kept, covariance = np.zeros(PARAMETERS), np.eye(PARAMETERS), np.zeros((PARAMETERS, PARAMETERS))
    moved[MATRIX] = -inverse @ np.einsum("sdp,sde,se->p", design, weight, angles)
    kept[MATRIX, MATRIX] = inverse @ known
    covariance[MATRIX, MATRIX] = inverse @ known @ inverse
    moved[BIAS] = -model.E @ bias - prior.centre[BIAS]
    covariance[BIAS, BIAS] = np.eye(3) * STILL_BIAS_RPS**2
    found = belonging(prior, moved, covariance, kept, lot.tails)
    if found.probability >= BELONGS:
        return LotWord(prior, "")
    return LotWord(None, _words(lot, found, prior.centre + moved, covariance, kept))


def _words(lot: Lot, found: Belonging, vector: np.ndarray, covariance: np.ndarray, kept: np.ndarray) -> str:
    off = farthest(lot, vector, covariance, np.diag(kept) > 0.5)
    far = "" if off is None else f": {off[0]} is {off[1]:+.1f} of its sigmas from its mean"
    return f"this board seems not to be of the lot (probability that it is: {found.probability:.2g}){far}; the lot is not reckoned with"


def _angles(turn: AcceptedTurn, model: LinearModel, ends: np.ndarray) -> np.ndarray:
    """(2,) rad: what the lot's mean leaves of a turn's tilt, the bias of its own stills taken off."""
    measured = turn.samples.gyro[None]
    bias = (turn.segment.stills[0].gyro_mean + turn.segment.stills[1].gyro_mean) / 2
    batch = Batch(measured - bias, turn.samples.dt_s[None], np.zeros_like(measured), ends[:1], ends[1:], yaw_known=False)
    return np.asarray(closure_angles(batch, model)[0, :2])
