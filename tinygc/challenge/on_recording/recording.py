"""A recording in which something is to be concealed: its movement as it was measured, and the step of its readings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from session.common.errors import DataError
from session.common.units import G
from session.dialects.reader import Reader
from session.log.folder import Session, read_session
from session.log.samples import Samples
from tinygc.effects import Movement, movement_of
from tinygc.problem.conditions import conditions
from tinygc.problem.prepared import prepare
from tinygc.problem.problem import Problem

#: of the differences between neighbouring values of a log, from below: one step; values that are rarely met differ by several
STEP_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Recording:
    """A session and its problem, with the answers that ``concealment.Place`` and ``concealment.Course`` ask for."""

    problem: Problem

    @property
    def session(self) -> Session:
        """As it was read."""
        return self.problem.session

    @property
    def log_s(self) -> float:
        """Of all logs, s."""
        return float(self.problem.began_s[-1])

    @property
    def turns(self) -> tuple[tuple[float, float], ...]:
        """(start, stop) of each used segment, s of the session."""
        began = self.problem.began_s
        return tuple((began[each.log] + each.start_s, began[each.log] + each.start_s + each.duration_s) for each in self.problem.used)

    @property
    def gyro_fs_dps(self) -> float:
        """Full scale, dps."""
        return self.session.config.sensor.gyro_fs_dps

    @property
    def latitude_deg(self) -> float:
        """As given, else the equator's."""
        return self.session.config.site.latitude_deg or 0.0

    @cached_property
    def movements(self) -> list[Movement]:
        """Of each log: the rate E m + B of the recording's linear model, as measured."""
        known, first = conditions(self.problem), self.problem.first
        pairs = zip(self.problem.logs, self.problem.began_s, strict=False)
        return [movement_of(log.samples, first(log.samples.gyro), known, float(began)) for log, began in pairs]

    @property
    def has_temperature(self) -> bool:
        """Whether every log has it."""
        return all(log.samples.temp_c is not None for log in self.session.logs)

    @property
    def odr_hz(self) -> float:
        """Data rate, by the stamps."""
        return 1 / float(np.median([movement.dt_s for movement in self.movements]))

    @property
    def temperature_start_c(self) -> float:
        """At the first sample, degC; 25 without a thermometer."""
        return float(self.movements[0].first_temp_c) if self.has_temperature else 25.0

    @property
    def warm_up_c(self) -> float:
        """From the first sample to the last, degC."""
        return float(self.movements[-1].temp_c[-1]) - self.temperature_start_c if self.has_temperature else 0.0

    def force(self, log: int) -> np.ndarray:
        """(N, 3) m/s^2, pre-calibrated."""
        return self.movements[log].force_g * G


@dataclass(frozen=True)
class Steps:
    """What one step of a log's readings is: gyro rad/s, accel m/s^2; and whether each is in registers."""

    gyro: float
    accel: float
    gyro_raw: bool
    accel_raw: bool


def steps_of(session: Session, log: int) -> Steps:
    """Of one log: a register's, or, of a log in physical units, the one that its values show."""
    layout, samples, sensor = Reader(session.logs[log].path, None).layout, session.logs[log].samples, session.config.sensor
    gyro_raw, accel_raw = (triad is not None and triad.unit.si is None for triad in (layout.gyro, layout.accel))
    return Steps(
        sensor.register_units.gyro_rps if gyro_raw else _step(samples.gyro),
        sensor.register_units.accel_mps2 if accel_raw else _step(samples.accel),
        gyro_raw,
        accel_raw,
    )


def recording_of(folder: Path) -> Recording:
    """The recording of a session folder.  Raises what ``read_session`` and ``prepare`` raise, and DataError beside truth files."""
    session = read_session(folder)
    if session.config.protocol.reference == "truth":
        raise DataError(
            f"{folder}: a recording beside truth files is not supported; give one whose stills are compared with gravity or dials"
        )
    return Recording(prepare(session).problem)


def with_gyro(samples: Samples, gyro: np.ndarray) -> Samples:
    """The same samples with other readings of the gyroscope (N, 3) rad/s."""
    return Samples(samples.t_ns, gyro, samples.accel, samples.temp_c)


def _step(values: np.ndarray) -> float:
    gaps = np.concatenate([np.diff(np.unique(axis)) for axis in values.T])
    return float(np.quantile(gaps, STEP_SHARE)) if len(gaps) else 1e-9
