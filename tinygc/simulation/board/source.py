"""What the board's sensor reads: still, then a session, then still for as long as one likes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.common.errors import DataError
from session.common.units import DEG, G
from session.files.reading import MOST_TOML, read_text
from session.log.config import Sensor
from session.log.folder import Session, read_session
from session.log.samples import Samples
from session.sensor.known import DEFAULT
from session.sensor.registers import REGISTER_MAX, RegisterUnits
from session.stream.events import Info
from tinygc.simulation.board.mark import onto_the_mark
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulate import Recording, plan_of, simulate_session
from tinygc.simulation.unit import SimulatedUnit

#: the first and the last this much of a session is still
STILL_S = 0.8


@dataclass(frozen=True, eq=False)
class Source:
    """rows (n, 7) int16 registers of the session, at info.odr_hz; config: text of its session.toml, or None; units: what they mean, where
    the model and the full scales of ``info`` do not say it; number: which of a simulated sensor's movements (``takes``)."""

    rows: np.ndarray
    info: Info
    config: str | None = None
    units: RegisterUnits | None = None
    number: int | None = None

    def in_units(self, rows: np.ndarray) -> np.ndarray:
        """Registers (n, 7) in dps, g and degC; 0 degC where the temperature's meaning is not known."""
        values, info = rows.astype(float), self.info
        units = self.units or RegisterUnits(info.sensor or DEFAULT, info.gyro_fs_dps, info.accel_fs_g)
        temp_c = units.temperature_c(values[:, 6])
        temp_c = np.zeros(len(rows)) if temp_c is None else temp_c
        return np.column_stack([values[:, :3] * (units.gyro_rps / DEG), values[:, 3:6] * (units.accel_mps2 / G), temp_c])

    def take(self, start: int, stop: int, rng: np.random.Generator) -> np.ndarray:
        """Rows start <= i < stop; before 0 and behind the last, still ones: drawn from the first and the last still."""
        count = max(1, min(len(self.rows), round(STILL_S * self.info.odr_hz)))
        before = rng.integers(0, count, max(0, min(stop, 0) - start))
        behind = len(self.rows) - 1 - rng.integers(0, count, max(0, stop - max(start, len(self.rows))))
        return self.rows[np.concatenate([before, np.arange(max(start, 0), min(max(stop, 0), len(self.rows))), behind]).astype(np.int64)]


def simulated(options: SimulationOptions, calibrated: bool = True, unit: SimulatedUnit | None = None) -> Source:
    """A simulated session; before its closure run, if any, the table is set onto its index mark, and all follows without a break.

    calibrated: whether session.toml holds the accelerometer's pre-calibration; unit: another sensor than the one that is drawn.
    """
    from tinygc.simulation.write import config_text

    simulation = simulate_session(options, plan=onto_the_mark(options, plan_of(options)), unit=unit)
    parts = [part for part in (simulation.log, simulation.closure) if part is not None]
    info = Info(options.gyro_fs_dps, options.accel_fs_g, simulation.unit.odr_hz, str(options.unit_drawn_from), options.sensor)
    return Source(np.concatenate([_rows(part) for part in parts]), info, config_text(simulation, concealed=False, calibrated=calibrated))


def recorded(folder: Path) -> Source:
    """The logs of a session folder, one after the other, then its closure runs, as registers at the rate that their stamps show."""
    session = read_session(folder)
    logs = [log.samples for log in (*session.logs, *session.closures)]
    sensor = session.config.sensor
    odr_hz = (len(logs[0]) - 1) / logs[0].duration_s
    info = Info(sensor.gyro_fs_dps, sensor.accel_fs_g, odr_hz, sensor.serial, _word(sensor))
    rows = np.concatenate([_registers(samples, session) for samples in logs])
    return Source(rows, info, read_text(folder / "session.toml", MOST_TOML), sensor.register_units)


def _word(sensor: Sensor) -> str:
    """The model as one word of a comment; empty where it is none that is known."""
    return "" if sensor.profile is None else sensor.profile.name


def _rows(recording: Recording) -> np.ndarray:
    return np.column_stack([recording.gyro, recording.accel, recording.temp])


def _registers(samples: Samples, session: Session) -> np.ndarray:
    sensor = session.config.sensor
    units = sensor.register_units
    temp = units.temperature_lsb(samples.temp_c, len(samples))
    rows = np.rint(np.column_stack([samples.gyro / units.gyro_rps, samples.accel / units.accel_mps2, temp]))
    if np.abs(rows).max() > REGISTER_MAX + 1:
        raise DataError(f"{session.folder}: holds values beyond the registers of {sensor.gyro_fs_dps:g} dps and {sensor.accel_fs_g:g} g")
    return rows.astype(np.int16)
