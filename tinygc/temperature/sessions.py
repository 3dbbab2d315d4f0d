"""A session with turns as one point over temperature: E and zero at its mean temperature, with their covariance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from session.common.errors import FitError
from session.log.config import Accelerometer
from session.log.folder import Session
from session.log.logfile import Log
from tinygc.fitting.compare_triads import Triad, into_frame_of
from tinygc.fitting.session import fit_session
from tinygc.methods.options import FitOptions
from tinygc.models.linear import BIAS, MATRIX, LinearModel
from tinygc.models.thermal import ThermalModel

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class SessionPoint:
    """name; temp_c: mean over its logs, from low_c to high_c; values (12,): E row by row, then the zero b = -E^-1 B, rad/s; covariance
    (12, 12) of them; segments used; accelerometer: the calibration that the fit rests on, in whose body frame E is."""

    name: str
    temp_c: float
    low_c: float
    high_c: float
    values: np.ndarray
    covariance: np.ndarray
    segments: int
    accelerometer: Accelerometer = field(default_factory=lambda: Accelerometer(source="none"))


def point_of(session: Session, shape: ThermalModel | None, progress: Progress = lambda what, done, of: None) -> SessionPoint:
    """Fit one session by least squares; shape: what rest logs tell of the zero, by which its readings are brought to its mean temperature.

    FitError where a log has no temperature; the errors of a fit besides.
    """
    temps = []
    for log in session.logs:
        if log.samples.temp_c is None:
            raise FitError(
                f"{session.name}: {log.path.name} has no temperature, which a model over temperature needs; leave the session out"
            )
        temps.append(log.samples.temp_c)
    temp = np.concatenate(temps)
    mean_c = float(temp.mean())
    if shape is not None:
        session = replace(session, logs=tuple(_brought_to(log, shape, mean_c) for log in session.logs), closures=())
    options = FitOptions(methods=("least_squares",))
    found = fit_session(session, options, lambda what, done, of: progress(f"{session.name}: {what}", done, of))
    model = found.linear.model
    assert isinstance(model, LinearModel)  # that is what least squares fits
    values, covariance = zero_form(model, found.covariance)
    low, high = np.quantile(temp, [0.005, 0.995])
    own = found.accelerometer.calibration
    return SessionPoint(session.name, mean_c, float(low), float(high), values, covariance, len(found.problem.used), own)


def in_frame_of_first(points: Sequence[SessionPoint]) -> tuple[SessionPoint, ...]:
    """All in the first one's body frame, as ``compare`` turns them; a zero is the sensor's own reading, and in no frame."""
    found = []
    for point in points:
        turn = np.eye(12)
        frames = Triad(calibration=points[0].accelerometer), Triad(calibration=point.accelerometer)
        turn[MATRIX, MATRIX] = into_frame_of(*frames)[MATRIX, MATRIX]
        found.append(replace(point, values=turn @ point.values, covariance=turn @ point.covariance @ turn.T))
    return tuple(found)


def _brought_to(log: Log, shape: ThermalModel, mean_c: float) -> Log:
    """The log as if it had been recorded at one temperature, as far as the zero goes."""
    samples = log.samples
    assert samples.temp_c is not None
    # Beyond the rest logs' range the shape holds still: better than a polynomial that nobody has seen there.
    element = np.column_stack([follow(samples.temp_c) for follow in shape.elements(samples.period_s)])
    change = shape.zero(element) - shape.zero(np.full((1, 3), mean_c))
    return replace(log, samples=replace(samples, gyro=samples.gyro - change))


def zero_form(model: LinearModel, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(12,) E row by row and b, where omega = E (m - b), and their covariance, from those of E and B."""
    inverse = np.linalg.inv(model.E)
    zero = -inverse @ model.B
    slope = np.eye(12)
    slope[BIAS, MATRIX] = -np.einsum("ij,k->ijk", inverse, zero).reshape(3, 9)
    slope[BIAS, BIAS] = -inverse
    return np.concatenate([model.E.ravel(), zero]), slope @ covariance @ slope.T
