"""Readings of a simulated sensor on a virtual table: from the tracks of its axes to registers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.units import DEG, DEG_PER_HOUR, G
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.mechanics import AxisTrack, TableErrors, true_attitudes
from tinygc.simulation import movement
from tinygc.simulation.options import GYRO_LPF2_HZ, SimulatedUnit, SimulationOptions
from tinygc.simulation.simulator import (
    ACCEL_BANDWIDTH_ODR,
    Distort,
    LowPass,
    RegisterLog,
    oversampling,
    registers_of,
    temperature,
    temperature_registers,
)


class SensorOnTable:
    """A stream of samples, ``take`` after ``take``; the same seed and the same tracks give the same registers.

    options: noise, ranges, gravity, latitude (of its bias instability only 0 is simulated as none, else a random walk of its size);
    unit: linear errors and rate; distort: hidden physics of the gyroscope, as ``simulate_session`` takes it.
    """

    def __init__(
        self,
        table: Description,
        errors: TableErrors,
        options: SimulationOptions,
        unit: SimulatedUnit,
        distort: Distort | None = None,
    ):
        self._table, self._errors, self._options, self._unit, self._distort = table, errors, options, unit, distort
        gyro_rng, accel_rng, self._walk_rng, self._temperature_rng = np.random.default_rng(options.seed).spawn(4)
        odr_hz, self._factor = unit.odr_hz, oversampling(unit.odr_hz)
        self._gyro = LowPass(GYRO_LPF2_HZ[options.odr_hz], options.gyro_noise_dps_rthz * DEG, odr_hz, self._factor, gyro_rng)
        accel_noise = options.accel_noise_ug_rthz * 1e-6 * G
        self._accel = LowPass(ACCEL_BANDWIDTH_ODR * odr_hz, accel_noise, odr_hz, self._factor, accel_rng)
        self._walk = np.zeros(3)
        self._taken = self._first = 0

    @property
    def taken(self) -> int:
        """Samples so far."""
        return self._taken - self._first

    def skip_to(self, t_s: float) -> None:
        """The next sample is the one at that time of the tracks: the board was switched on later than the table."""
        self._taken = self._first = round(t_s * self._unit.odr_hz)

    def take(self, tracks: Sequence[AxisTrack], count: int) -> RegisterLog:
        """The next ``count`` samples; time counts from the first, in seconds of the tracks."""
        options, unit, odr_hz, factor = self._options, self._unit, self._unit.odr_hz, self._factor
        step = 1 / (factor * odr_hz)
        t_s = np.arange(self._taken * factor, (self._taken + count) * factor) * step
        # Rate against inertial space and specific force (N, 3), temperature (N,); rates are means over a step, about each time
        edges = np.append(t_s, t_s[-1] + step) - step / 2
        said, sense = np.stack([track.said_and_sense(edges) for track in tracks], axis=-1)
        attitude = true_attitudes(self._table, self._errors, said, sense)
        body = Rotation.from_matrix(attitude)
        rate = (body[:-1].inv() * body[1:]).as_rotvec() / step
        middle = (body[:-1] * Rotation.from_rotvec(rate * step / 2)).as_matrix()
        earth_t = movement.earth_rate_table(options.latitude_deg * DEG, unit.heading_deg * DEG)
        acceleration = np.gradient(rate, step, axis=0)
        lever = np.array(options.lever_m)
        force = np.cross(acceleration, lever) + np.cross(rate, np.cross(rate, lever))
        force = force - np.einsum("nji,j->ni", middle, np.array([0.0, 0.0, options.gravity_mps2]))
        rate = rate + np.einsum("nji,j->ni", middle, earth_t)
        temp_c = temperature(t_s, options.temperature_start_c, options.warm_up_c)
        if self._distort is not None:
            rate = self._distort(t_s, rate, force, temp_c)
        walk = options.bias_instability_dph * DEG_PER_HOUR / 10 * self._walk_rng.normal(size=(count, 3)) / np.sqrt(odr_hz)
        self._walk = (bias := self._walk + np.cumsum(walk, axis=0))[-1]
        units = options.register_units
        times_us = np.rint(np.arange(self._taken, self._taken + count) / odr_hz * 1e6).astype(np.int64)
        self._taken += count
        return RegisterLog(
            times_us,
            registers_of(self._gyro(unit.measured_rate(rate)) + bias, options.gyro_fs_dps * DEG, units.gyro_rps),
            registers_of(self._accel(unit.measured_force(force)), options.accel_fs_g * G, units.accel_mps2),
            temperature_registers(temp_c[::factor], self._temperature_rng, units),
        )
