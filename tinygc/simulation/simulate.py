"""A whole session from its options: hand, table, Earth, unit, noise, registers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG, DEG_PER_HOUR, G
from tinygc.simulation import motion as table
from tinygc.simulation import sensor
from tinygc.simulation.noise import bias_instability
from tinygc.simulation.options import GYRO_LPF2_HZ, SimulationOptions
from tinygc.simulation.table_movement import Plan, hand_plan
from tinygc.simulation.unit import SimulatedUnit, draw_unit

#: Physics beyond the linear model: ``distort(t_s (N,), rate (N, 3), force (N, 3), temp_c (N,)) -> rate (N, 3)``, SI, on the fine
#: grid, before linear errors, noise and low-pass.  rate and force are what the elements truly feel (Earth and lever arm included).
#: t_s counts from the log's first sample, begins ``sensor.RUN_UP_S`` before it and goes on through the closure run.
Distort = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
#: What the accelerometer alone feels instead: ``disturb(t_s (N,), force (N, 3)) -> force (N, 3)``, SI, on the same grid.
Disturb = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Recording:
    """One log as the chip gives it.

    t_us (N,) int64 since the session's first sample; gyro, accel (N, 3) and temp (N,) int16 registers.
    """

    t_us: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp: np.ndarray

    def part(self, start: int, stop: int) -> Recording:
        """Samples start <= i < stop."""
        return Recording(self.t_us[start:stop], self.gyro[start:stop], self.accel[start:stop], self.temp[start:stop])


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated session and its truth.  closure is None where no closure run was asked for."""

    options: SimulationOptions
    plan: Plan
    unit: SimulatedUnit
    log: Recording
    closure: Recording | None


def simulate_session(
    options: SimulationOptions,
    distort: Distort | None = None,
    *,
    plan: Plan | None = None,
    disturb: Disturb | None = None,
    unit: SimulatedUnit | None = None,
) -> Simulation:
    """Simulate a session; ``distort`` conceals physics of the gyro in it, ``disturb`` of the accelerometer; ``plan``: another movement
    than ``plan_of`` draws; ``unit``: another sensor than ``draw_unit`` draws.  The same arguments give the same registers."""
    _, _, *signal_rngs = _streams(options)
    unit, plan = unit or unit_of(options), plan or plan_of(options)
    log_count, closure_count = (int(np.ceil(seconds * unit.odr_hz)) for seconds in (plan.log_s, options.closure_s))
    whole = _record(options, unit, plan, log_count + closure_count, distort, disturb, signal_rngs)
    log, closure = whole.part(0, log_count), whole.part(log_count, log_count + closure_count)
    return Simulation(options, plan, unit, log, closure if closure_count else None)


def unit_of(options: SimulationOptions) -> SimulatedUnit:
    """The sensor in the session of these options."""
    return draw_unit(options, _streams(options)[0])


def plan_of(options: SimulationOptions) -> Plan:
    """What the hand does in the session of these options."""
    return hand_plan(options, _streams(options)[1])


def _streams(options: SimulationOptions) -> list[np.random.Generator]:
    """One stream per purpose; a new purpose goes last, so that the others keep theirs."""
    streams = np.random.default_rng(options.seed).spawn(6)
    return [np.random.default_rng(options.unit_drawn_from).spawn(1)[0], *streams[1:]]


def _record(
    options: SimulationOptions,
    unit: SimulatedUnit,
    plan: Plan,
    count: int,
    distort: Distort | None,
    disturb: Disturb | None,
    rngs: list[np.random.Generator],
) -> Recording:
    """The first ``count`` samples of the chip, log and closure run without a break."""
    gyro_rng, accel_rng, flicker_rng, temperature_rng = rngs
    odr_hz = unit.odr_hz
    t_fine, factor, run_up = fine_grid(odr_hz, count)
    rate, force, temp_c = true_signals(options, unit, plan, t_fine)
    if distort is not None:
        rate = _checked("distort", distort(t_fine, rate, force, temp_c), rate.shape)
    if disturb is not None:
        force = _checked("disturb", disturb(t_fine, force), force.shape)

    gyro_noise, accel_noise = options.gyro_noise_dps_rthz * DEG, options.accel_noise_ug_rthz * 1e-6 * G
    gyro_hz, accel_hz = GYRO_LPF2_HZ[options.odr_hz], sensor.ACCEL_BANDWIDTH_ODR * odr_hz
    gyro = sensor.low_pass(unit.measured_rate(rate), gyro_hz, gyro_noise, odr_hz, factor, gyro_rng)[run_up:]
    accel = sensor.low_pass(unit.measured_force(force), accel_hz, accel_noise, odr_hz, factor, accel_rng)[run_up:]
    gyro += bias_instability(options.bias_instability_dph * DEG_PER_HOUR, odr_hz, count, flicker_rng)
    units = options.register_units
    return Recording(
        t_us=np.rint(np.arange(count) / odr_hz * 1e6).astype(np.int64),
        gyro=sensor.registers_of(gyro, options.gyro_fs_dps * DEG, units.gyro_rps),
        accel=sensor.registers_of(accel, options.accel_fs_g * G, units.accel_mps2),
        temp=sensor.temperature_registers(temp_c[run_up * factor :: factor], temperature_rng, units),
    )


def fine_grid(odr_hz: float, count: int) -> tuple[np.ndarray, int, int]:
    """Times (N,) s on which ``count`` samples are simulated, how many make a sample, and how many samples are the run-up: thrown away when
    the filters have seen them."""
    factor, run_up = sensor.oversampling(odr_hz), int(np.ceil(sensor.RUN_UP_S * odr_hz))
    return np.arange(-run_up * factor, count * factor) / (factor * odr_hz), factor, run_up


def true_signals(options: SimulationOptions, unit: SimulatedUnit, plan: Plan, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the elements feel at times t_s (N,) s: rate against inertial space (N, 3) rad/s and specific force (N, 3) m/s^2, both
    in b, and temperature (N,) degC."""
    motion = table.move(plan, t_s)
    earth_t = table.earth_rate_table(options.latitude_deg * DEG, unit.heading_deg * DEG)
    rate = motion.rate + table.table_to_body(motion.angles, earth_t)
    force = table.specific_force(motion, options.gravity_mps2, np.array(options.lever_m))
    return rate, force, sensor.temperature(t_s, options.temperature_start_c, options.warm_up_c)


def _checked(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} must return finite values of shape {shape}, got shape {values.shape}")
    return values
