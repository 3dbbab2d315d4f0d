"""An array's model of a joint fit: its units, their noise, and how much they differed in the recording itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from session.common.units import NS
from session.detect.stills import Noise
from session.log.array_session import ArraySession
from session.log.config import Accelerometer
from session.log.folder import Session
from session.log.hashes import hash_of_log
from tinygc.array.fused.build_model import build_array_model
from tinygc.array.fused.model import ArrayModel, FusedUnit
from tinygc.array.fused.resample import Resampler
from tinygc.array.places.place import UnitPlace
from tinygc.closure.bias_wander import BiasInstability
from tinygc.models.linear import PARAMETERS, LinearModel


class FittedUnit(Protocol):
    """What a joint fit says of a unit; covariance (K, K), K at least 12, begins with E row by row, then B."""

    @property
    def number(self) -> int: ...  # noqa: D102
    @property
    def session(self) -> Session: ...  # noqa: D102
    @property
    def place(self) -> UnitPlace: ...  # noqa: D102
    @property
    def model(self) -> LinearModel: ...  # noqa: D102
    @property
    def accelerometer(self) -> Accelerometer: ...  # noqa: D102
    @property
    def covariance(self) -> np.ndarray: ...  # noqa: D102
    @property
    def noise(self) -> Noise: ...  # noqa: D102
    @property
    def instability(self) -> BiasInstability: ...  # noqa: D102


def array_model_of(array: ArraySession, fitted: Sequence[FittedUnit], covariance: np.ndarray | None = None) -> ArrayModel:
    """The model of fitted units; covariance (K N, K N) of all their numbers, unit by unit, as each unit's own is ordered.

    Raises CalibrationError as ``build_array_model``.
    """
    units = [
        FusedUnit(
            unit.place,
            unit.model,
            np.asarray(unit.noise.gyro, dtype=float),
            np.full(3, unit.instability.rps) if unit.instability.rps > 0 else None,
            unit.covariance[:PARAMETERS, :PARAMETERS],
            unit.session.config.sensor,
            None if unit.accelerometer.source == "none" else unit.accelerometer,
            float(np.sqrt(np.mean(np.square(unit.noise.accel)))) or None,
            tuple(hash_of_log(log) for log in (*unit.session.logs, *unit.session.closures)),
        )
        for unit in fitted
    ]
    joint = None
    if covariance is not None:
        each = len(covariance) // len(units)
        rows = np.concatenate([np.arange(PARAMETERS) + each * i for i in range(len(units))])
        joint = covariance[np.ix_(rows, rows)]
    rate_hz = 1 / fitted[0].session.logs[0].samples.period_s
    measured = together([unit.session for unit in fitted], [unit.place for unit in fitted])
    return build_array_model(units, rate_hz, joint_covariance=joint, measured=measured, session=array.name)


def together(sessions: Sequence[Session], places: Sequence[UnitPlace]) -> np.ndarray:
    """(T, N, 3) rad/s that units measured at the first one's moments, all logs one after the other; NaN where one has none."""
    whole = []
    for logs in zip(*(session.logs for session in sessions), strict=True):
        begins_ns = int(logs[0].samples.t_ns[0])
        moments = (logs[0].samples.t_ns - begins_ns) * NS  # the array's clock is the first unit's
        columns = []
        for log, place in zip(logs, places, strict=True):
            since, clock = (log.samples.t_ns - begins_ns) * NS, place.clock
            resampler = Resampler(3)
            resampler.push(since + clock.offset_s + clock.rate * (since + (begins_ns * NS - clock.about_s)), log.samples.gyro)
            columns.append(resampler.at(moments))
        whole.append(np.stack(columns, axis=1))
    return np.concatenate(whole)
