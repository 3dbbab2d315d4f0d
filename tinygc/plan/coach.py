"""The coach: after each segment, what is still known worst, and the movement from here that would help most.

It knows the segments only through the linear sensitivity (``closure.sensitivity``): each adds two angles, linear in the 12 parameters.
A movement's worth is what its two angles would leave of the sigmas, beside their targets, if it were made from where the sensor lies
now.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG_PER_HOUR
from session.detect.stills import Still
from session.guide.messages import AcceptedTurn, Advice, Progress
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.bias_wander import BiasWander
from tinygc.closure.floor import Floor, gyro_variance, still_tilt_variance
from tinygc.closure.residual import Batch
from tinygc.closure.uncertainty import covariance_from_columns
from tinygc.models import linear
from tinygc.plan.proposals import TARGETS, parameter_words
from tinygc.plan.turns import Turn, columns, turns_from

UNKNOWN = 10.0  #: times its target: while something is as uncertain, the volume of all uncertainty is made small (D-optimality)
UNSEEN = 100.0
#: rad/s, the bias instability that a session is planned with, whatever the sensor: no recording is there yet to take it from, and it
#: enters no uncertainty that is reported
PLANNED_INSTABILITY_RPS = 3 * DEG_PER_HOUR
SHARPNESS = 6  #: afterwards: power of the sigmas in what is made small: 2 would look at all alike, a large one at the worst alone


class Coach:
    """Call it with accepted segments, in order; it answers with ``Advice``."""

    def __init__(self, targets: np.ndarray = TARGETS):
        self._targets = targets
        self._columns: list[np.ndarray] = []
        self._own: list[np.ndarray] = []
        self._middle_s: list[float] = []

    def __call__(self, progress: Progress) -> Advice:
        """Advice on all segments so far (at least one)."""
        self._columns, self._own, self._middle_s = [], [], []
        taken = list(progress.turns)
        for segment in taken:
            self.add(segment)
        sigma = self.sigma
        worst = np.argsort(-sigma)
        missing = tuple(_said(i, sigma[i]) for i in worst if sigma[i] > 1)
        if not missing:
            return Advice("", f"every parameter has reached its target; the worst is at {sigma[worst[0]]:.2f} of it", reached=True)
        turn = self.best_turn(_stills(taken[-1])[1].accel_mean)
        return Advice(turn.words, f"it helps the {_said(worst[0], sigma[worst[0]])}", missing=missing)

    @property
    def covariance(self) -> np.ndarray:
        """(12, 12) as ``uncertainty.parameter_covariance`` gives it, less what neighbours share and the Earth's heading."""
        own = np.array(self._own)
        floor = Floor(own, np.zeros((len(own) - 1, 2, 2)))
        return covariance_from_columns(np.array(self._columns), floor, BiasWander(np.array(self._middle_s), PLANNED_INSTABILITY_RPS))

    @property
    def sigma(self) -> np.ndarray:
        """(12,) one sigma of each parameter in units of its target."""
        return np.sqrt(np.diag(self.covariance)) / self._targets

    def best_turn(self, accel: np.ndarray) -> Turn:
        """The turn to make where the accelerometer reads accel (3,)."""
        information = np.linalg.inv(self.covariance / np.outer(self._targets, self._targets))
        turns = turns_from(accel)
        rows = columns(accel, turns) * (self._targets / np.sqrt(np.mean([np.trace(own) / 2 for own in self._own])))
        after = information + rows.swapaxes(-1, -2) @ rows
        if self.sigma.max() > UNKNOWN:
            return turns[int(np.argmax(np.linalg.slogdet(after)[1]))]
        left = np.diagonal(np.linalg.inv(after), axis1=-2, axis2=-1)
        return turns[int(np.argmin((left ** (SHARPNESS / 2)).sum(-1)))]

    def add(self, taken: AcceptedTurn) -> None:
        """Take a segment in: its two angles' columns and their noise."""
        first, last = _stills(taken)
        measured = taken.samples.gyro[None]
        bias = (first.gyro_mean + last.gyro_mean) / 2
        start, end = (rotation.from_gravity(still.accel_mean)[None] for still in (first, last))
        # The Earth's place is taken by the bias: what is left is the turn, as nearly as the sensor's own errors of 1 % matter here.
        batch = Batch(measured, taken.samples.dt_s[None], np.broadcast_to(bias, measured.shape), start, end, yaw_known=False)
        own = gyro_variance(batch, closure.attitudes(batch, measured), [taken.noise])[0, :2, :2]
        tilt = sum(still_tilt_variance(still, taken.noise) for still in (first, last))
        self._columns.append(linear.columns(closure.sensitivity(batch, measured), measured)[0, :2])
        self._own.append(own + tilt * np.eye(2))
        self._middle_s.append(taken.middle_s)


def _stills(taken: AcceptedTurn) -> tuple[Still, Still]:
    """Between which a segment lies; a recording has no others."""
    first, last = taken.segment.first, taken.segment.last
    assert first is not None
    assert last is not None
    return first, last


def _said(parameter: int, sigma: float) -> str:
    """A parameter and how far it is from its target."""
    far = "not seen in any turn yet" if sigma >= UNSEEN else f"{sigma:.1f} times its target"
    return f"{parameter_words(linear.NAMES[parameter])} ({far})"
