"""Simulate a whole session: hand, table, Earth, unit, noise, registers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import numpy as np

from session.base.units import DEG, DEG_PER_HOUR, G
from session.log.registers import RegisterUnits
from session.log.sensors.profile import REGISTER_MAX
from tinygc.simulation import movement
from tinygc.simulation.movement import MovementPlan, hand_plan
from tinygc.simulation.options import GYRO_LPF2_HZ, SimulatedUnit, SimulationOptions, draw_unit

# Sensor noise: white noise, and flicker, which a datasheet calls bias instability.  Terms and Allan floor: IEEE 952, annex C.

FLICKER_KNOTS_HZ = 16.0  #: flicker is drawn at this rate and interpolated; above it white noise dominates
FLICKER_TIMES_S = 2.0 ** np.arange(-1, 12)  #: time constants by octaves, 0.5 s to 2048 s: flat Allan floor from about 1 s to 2000 s


def white(density: float, rate_hz: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """White noise (count, 3) of one-sided ``density`` (unit/sqrt(Hz)) sampled at rate_hz: standard deviation N sqrt(fs/2)."""
    return density * np.sqrt(rate_hz / 2) * rng.standard_normal((count, 3))


def bias_instability(coefficient: float, rate_hz: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Flicker noise (count, 3) in the unit of ``coefficient`` B, sampled at rate_hz.

    Its one-sided density is ``B^2 / (pi f)``; its Allan deviation is flat at ``sqrt(2 ln 2 / pi) B = 0.664 B``.  It is the sum of
    stationary Gauss-Markov processes with time constants an octave apart.  Each has the density 4 sigma^2 T / (1 + (2 pi f T)^2);
    summed over octaves that is sigma^2 / (ln 2 f), so sigma = B sqrt(ln 2 / pi).  The sum has a 1-sigma spread of 1.7 B, most
    of it slower than a session, where it only adds a little turn-on bias.
    """
    return _between_knots(_flicker_knots(coefficient, count / rate_hz, rng), np.arange(count) / rate_hz)


def _flicker_knots(coefficient: float, duration_s: float, rng: np.random.Generator) -> np.ndarray:
    """The noise (3, K) at its knots."""
    from scipy.signal import lfilter  # imported here: the import takes longer than a fit

    knots = int(duration_s * FLICKER_KNOTS_HZ) + 2
    sigma = coefficient * np.sqrt(np.log(2) / np.pi)
    total = np.zeros((3, knots))
    for time_s in FLICKER_TIMES_S:
        keep = np.exp(-1 / (FLICKER_KNOTS_HZ * time_s))
        drive = sigma * rng.standard_normal((3, knots))
        drive[:, 1:] *= np.sqrt(1 - keep**2)  # except the first, which has the stationary spread already
        total += lfilter([1.0], [1.0, -keep], drive)
    return total


def _between_knots(knots: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """The noise (N, 3) at t_s (N,) s."""
    knots_s = np.arange(knots.shape[1]) / FLICKER_KNOTS_HZ
    return np.stack([np.interp(t_s, knots_s, axis) for axis in knots], axis=-1)


# From the signal at a sensing element to the registers of the chip.

ACCEL_BANDWIDTH_ODR = 0.25  #: accelerometer's LPF2 at its usual setting, ODR/4 (asm330lhh_reg.h)
LOWEST_FINE_HZ = 1600.0  #: least rate of the grid for filters and effects: fast compared with tremor and filters
LOWEST_OVERSAMPLING = 4
RUN_UP_S = 0.2  #: time on the fine grid before the first sample: many times the slowest filter's memory
PIECE = 1 << 14  #: samples that are simulated at a time: about 40 MB on the fine grid
TEMPERATURE_NOISE_C = 0.01  #: 1 sigma of one reading
TEMPERATURE_SETTLES_S = 150.0  #: time constant of self-heating on a small board


def oversampling(odr_hz: float) -> int:
    """Number of fine grid points per output sample."""
    return max(LOWEST_OVERSAMPLING, int(np.ceil(LOWEST_FINE_HZ / odr_hz)))


class LowPass:
    """Noise, low-pass and decimation of one element, of a signal that comes in pieces.

    bandwidth_hz (-3 dB) of a second-order Butterworth; density of the white noise in the output near zero frequency, one-sided.
    The noise enters before the filter, as in the chip, and is coloured by it.  The filter starts in the steady
    state of the first (noiseless) value.
    """

    def __init__(self, bandwidth_hz: float, density: float, odr_hz: float, factor: int, rng: np.random.Generator):
        from scipy.signal import butter, sosfreqz

        self._fine_hz, self._factor, self._rng = factor * odr_hz, factor, rng
        self._sos = butter(2, bandwidth_hz, fs=self._fine_hz, output="sos")
        # Decimation folds the noise at every multiple of the output rate onto zero, so the input noise is reduced accordingly.
        _, response = sosfreqz(self._sos, odr_hz * np.arange(factor), fs=self._fine_hz)
        self._density = density / np.sqrt(np.sum(np.abs(response) ** 2))
        self._state: np.ndarray | None = None

    def __call__(self, signal: np.ndarray) -> np.ndarray:
        """(N / factor, 3): grid points 0, factor, 2 factor, … of the next part (N, 3) of the signal on the fine grid."""
        from scipy.signal import sosfilt, sosfilt_zi

        if self._state is None:
            self._state = sosfilt_zi(self._sos)[:, :, None] * signal[0]
        noisy = signal + white(self._density, self._fine_hz, len(signal), self._rng)
        filtered, self._state = sosfilt(self._sos, noisy, axis=0, zi=self._state)
        return filtered[:: self._factor]


def registers_of(value: np.ndarray, full_scale: float, per_lsb: float) -> np.ndarray:
    """Register values (N, 3) int16 of measured rates or forces in SI: rounded, clipped at full scale and at the 16-bit range."""
    largest = min(round(full_scale / per_lsb), REGISTER_MAX)
    return np.clip(np.rint(value / per_lsb), -largest, largest).astype(np.int16)


def temperature(t_s: np.ndarray, start_c: float, warm_up_c: float) -> np.ndarray:
    """Temperature (N,) degC of a self-heating board: exponential towards start + warm-up; t_s (N,) since the first sample."""
    return start_c + warm_up_c * -np.expm1(-t_s / TEMPERATURE_SETTLES_S)


def temperature_registers(temp_c: np.ndarray, rng: np.random.Generator, units: RegisterUnits) -> np.ndarray:
    """Register values (N,) int16 of a temperature, with the thermometer's noise; zeros if the register's meaning is unknown."""
    noisy = temp_c + TEMPERATURE_NOISE_C * rng.standard_normal(len(temp_c))
    return np.clip(np.rint(units.temperature_lsb(noisy, len(noisy))), -REGISTER_MAX, REGISTER_MAX).astype(np.int16)


# A whole session from its options: hand, table, Earth, unit, noise, registers.

#: Physics beyond the linear model: ``distort(t_s (N,), rate (N, 3), force (N, 3), temp_c (N,)) -> rate (N, 3)``, SI, on the fine
#: grid, before linear errors, noise and low-pass.  rate and force are the true inputs of the elements (Earth and lever arm included).
#: t_s counts from the log's first sample, begins ``RUN_UP_S`` before it and continues through the closure run.
Distort = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
#: Changes the accelerometer's input alone: ``disturb(t_s (N,), force (N, 3)) -> force (N, 3)``, SI, on the same grid.
Disturb = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class RegisterLog:
    """One log as register values.

    t_us (N,) int64 since the session's first sample; gyro, accel (N, 3) and temp (N,) int16 registers.
    """

    t_us: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp: np.ndarray

    def part(self, start: int, stop: int) -> RegisterLog:
        """Samples start <= i < stop."""
        return RegisterLog(self.t_us[start:stop], self.gyro[start:stop], self.accel[start:stop], self.temp[start:stop])


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated session and its truth.  closure is None without a closure run."""

    options: SimulationOptions
    plan: MovementPlan
    unit: SimulatedUnit
    log: RegisterLog
    closure: RegisterLog | None


def simulate_session(
    options: SimulationOptions,
    distort: Distort | None = None,
    *,
    plan: MovementPlan | None = None,
    disturb: Disturb | None = None,
    unit: SimulatedUnit | None = None,
) -> Simulation:
    """Simulate a session; the same arguments give the same registers.

    distort: hidden physics of the gyro; disturb: hidden physics of the accelerometer; plan: replaces the movement of ``plan_of``;
    unit: replaces the sensor of ``draw_unit``.
    """
    unit, plan = unit or unit_of(options), plan or plan_of(options)
    log_count, closure_count = (int(np.ceil(seconds * unit.odr_hz)) for seconds in (plan.log_s, options.closure_s))
    pieces = list(record_pieces(options, unit, plan, log_count + closure_count, distort, disturb))
    whole = RegisterLog(*(np.concatenate([getattr(piece, field.name) for piece in pieces]) for field in fields(RegisterLog)))
    log, closure = whole.part(0, log_count), whole.part(log_count, log_count + closure_count)
    return Simulation(options, plan, unit, log, closure if closure_count else None)


def unit_of(options: SimulationOptions) -> SimulatedUnit:
    """Draw the sensor for the session of these options."""
    return draw_unit(options, _streams(options)[0])


def plan_of(options: SimulationOptions) -> MovementPlan:
    """Draw the movement for the session of these options."""
    return hand_plan(options, _streams(options)[1])


def _streams(options: SimulationOptions) -> list[np.random.Generator]:
    """One random stream per purpose; append new purposes last, which keeps the streams of the others."""
    streams = np.random.default_rng(options.seed).spawn(6)
    return [np.random.default_rng(options.unit_drawn_from).spawn(1)[0], *streams[1:]]


def record_pieces(
    options: SimulationOptions,
    unit: SimulatedUnit,
    plan: MovementPlan,
    count: int,
    distort: Distort | None = None,
    disturb: Disturb | None = None,
) -> Iterator[RegisterLog]:
    """Simulate the first ``count`` samples of the chip, log and closure run without a break, in constant memory.

    Hidden physics may look at the whole movement, so with it there is a single piece.
    """
    _, _, gyro_rng, accel_rng, flicker_rng, temperature_rng = _streams(options)
    odr_hz, units = unit.odr_hz, options.register_units
    factor, run_up = oversampling(odr_hz), run_up_samples(odr_hz)
    gyro_noise, accel_noise = options.gyro_noise_dps_rthz * DEG, options.accel_noise_ug_rthz * 1e-6 * G
    gyro_element = LowPass(GYRO_LPF2_HZ[options.odr_hz], gyro_noise, odr_hz, factor, gyro_rng)
    accel_element = LowPass(ACCEL_BANDWIDTH_ODR * odr_hz, accel_noise, odr_hz, factor, accel_rng)
    knots = _flicker_knots(options.bias_instability_dph * DEG_PER_HOUR, count / odr_hz, flicker_rng)
    size = run_up + (PIECE if distort is None and disturb is None else count)
    for first in range(-run_up, count, size):
        t_fine = fine_times(odr_hz, first, min(first + size, count))
        rate, force, temp_c = _true_signals(options, unit, plan, t_fine)
        if distort is not None:
            rate = _checked("distort", distort(t_fine, rate, force, temp_c), rate.shape)
        if disturb is not None:
            force = _checked("disturb", disturb(t_fine, force), force.shape)
        skipped = max(-first, 0)
        t_s = np.arange(first + skipped, min(first + size, count)) / odr_hz
        gyro = gyro_element(unit.measured_rate(rate))[skipped:] + _between_knots(knots, t_s)
        accel = accel_element(unit.measured_force(force))[skipped:]
        yield RegisterLog(
            t_us=np.rint(t_s * 1e6).astype(np.int64),
            gyro=registers_of(gyro, options.gyro_fs_dps * DEG, units.gyro_rps),
            accel=registers_of(accel, options.accel_fs_g * G, units.accel_mps2),
            temp=temperature_registers(temp_c[skipped * factor :: factor], temperature_rng, units),
        )


def run_up_samples(odr_hz: float) -> int:
    """Number of samples in the run-up."""
    return int(np.ceil(RUN_UP_S * odr_hz))


def fine_times(odr_hz: float, first: int, last: int) -> np.ndarray:
    """Times (N,) s of the grid from the sample ``first`` to before ``last``."""
    factor = oversampling(odr_hz)
    return np.arange(first * factor, last * factor) / (factor * odr_hz)


def _true_signals(
    options: SimulationOptions, unit: SimulatedUnit, plan: MovementPlan, t_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inputs of the elements at times t_s (N,) s: rate against inertial space (N, 3) rad/s and specific force (N, 3) m/s^2, both
    in b, and temperature (N,) degC."""
    motion = movement.move(plan, t_s)
    earth_t = movement.earth_rate_table(options.latitude_deg * DEG, unit.heading_deg * DEG)
    rate = motion.rate + movement.table_to_body(motion.angles, earth_t)
    force = movement.specific_force(motion, options.gravity_mps2, np.array(options.lever_m))
    return rate, force, temperature(t_s, options.temperature_start_c, options.warm_up_c)


def _checked(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} must return finite values of shape {shape}, got shape {values.shape}")
    return values
