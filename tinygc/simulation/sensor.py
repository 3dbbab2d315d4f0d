"""A simulated sensor: from a motion to registers and stamps, each imperfection by itself.

The motion gives what the elements feel as exact functions of time.  On a grid fine next to filters and tremor hidden physics is added, then
the unit's linear errors; each element has white noise and a low-pass; the output is decimated, and has flicker, full scale and steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.base.units import DEG, DEG_PER_HOUR, G
from session.log.registers import RegisterUnits
from session.log.sensors import REGISTER_MAX
from tinygc.simulation.options import GYRO_LPF2_HZ, SimulatedUnit, SimulationOptions

#: What a sensor feels: t_s (N,) s, increasing -> rate against inertial space (N, 3) rad/s, specific force (N, 3) m/s^2 and temperature
#: (N,) degC, in its axes.  t_s counts from the first sample of the first log.
Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
#: Physics beyond the linear model: ``distort(t_s (N,), rate (N, 3), force (N, 3), temp_c (N,)) -> rate (N, 3)``, SI, on the fine
#: grid, before linear errors, noise and low-pass.
Distort = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
#: Changes the accelerometer's input alone: ``disturb(t_s (N,), force (N, 3)) -> force (N, 3)``, SI, on the same grid.
Disturb = Callable[[np.ndarray, np.ndarray], np.ndarray]

# Sensor noise: white noise, and flicker, which a datasheet calls bias instability.  Terms and Allan floor: IEEE 952, annex C.

FLICKER_KNOTS_HZ = 16.0  #: flicker is drawn at this rate and interpolated; above it white noise dominates
FLICKER_TIMES_S = 2.0 ** np.arange(-1, 12)  #: time constants by octaves, 0.5 s to 2048 s: flat Allan floor from about 1 s to 2000 s


def white(density: float, rate_hz: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """White noise (count, 3) of one-sided ``density`` (unit/sqrt(Hz)) sampled at rate_hz: standard deviation N sqrt(fs/2)."""
    return density * np.sqrt(rate_hz / 2) * rng.standard_normal((count, 3))


class Flicker:
    """Flicker noise (N, 3) in the unit of ``coefficient`` B, at times t_s (N,) s from 0, increasing from call to call.

    Its one-sided density is ``B^2 / (pi f)``; its Allan deviation is flat at ``sqrt(2 ln 2 / pi) B = 0.664 B``.  It is the sum of
    stationary Gauss-Markov processes with time constants an octave apart.  Each has the density 4 sigma^2 T / (1 + (2 pi f T)^2);
    summed over octaves that is sigma^2 / (ln 2 f), so sigma = B sqrt(ln 2 / pi).  The sum has a 1-sigma spread of 1.7 B, most
    of it slower than a session, where it only adds a little turn-on bias.  It is drawn for ``stretch_s`` at a time.
    """

    def __init__(self, coefficient: float, stretch_s: float, rng: np.random.Generator):
        self._sigma, self._rng = coefficient * np.sqrt(np.log(2) / np.pi), rng
        self._stretch = int(stretch_s * FLICKER_KNOTS_HZ) + 2
        self._knots = np.zeros((3, 0))
        self._states = np.zeros((len(FLICKER_TIMES_S), 3, 1))

    def __call__(self, t_s: np.ndarray) -> np.ndarray:
        """(N, 3) at t_s (N,) s."""
        while self._knots.shape[1] < t_s[-1] * FLICKER_KNOTS_HZ + 1:
            self._knots = np.concatenate([self._knots, self._drawn()], axis=1)
        knots_s = np.arange(self._knots.shape[1]) / FLICKER_KNOTS_HZ
        return np.stack([np.interp(t_s, knots_s, axis) for axis in self._knots], axis=-1)

    def _drawn(self) -> np.ndarray:
        """The noise (3, K) at the next knots."""
        from scipy.signal import lfilter  # imported here: the import takes longer than a fit

        total, begun = np.zeros((3, self._stretch)), self._knots.shape[1] > 0
        for time_s, state in zip(FLICKER_TIMES_S, self._states, strict=True):
            keep = np.exp(-1 / (FLICKER_KNOTS_HZ * time_s))
            drive = self._sigma * self._rng.standard_normal((3, self._stretch))
            drive[:, 0 if begun else 1 :] *= np.sqrt(1 - keep**2)  # the very first has the stationary spread already
            noise, state[:] = lfilter([1.0], [1.0, -keep], drive, zi=state)
            total += noise
        return total


# From the signal at a sensing element to the registers of the chip.

ACCEL_BANDWIDTH_ODR = 0.25  #: accelerometer's LPF2 at its usual setting, ODR/4 (asm330lhh_reg.h)
LOWEST_FINE_HZ = 1600.0  #: least rate of the grid for filters and effects: fast compared with tremor and filters
LOWEST_OVERSAMPLING = 4
TEMPERATURE_NOISE_C = 0.01  #: 1 sigma of one reading
TEMPERATURE_SETTLES_S = 150.0  #: time constant of self-heating on a small board
FLICKER_STRETCH_S = 3600.0  #: of a stream without an end


def oversampling(odr_hz: float) -> int:
    """Number of fine grid points per output sample."""
    return max(LOWEST_OVERSAMPLING, int(np.ceil(LOWEST_FINE_HZ / odr_hz)))


def fine_times(odr_hz: float, first: int, last: int) -> np.ndarray:
    """Times (N,) s of the grid from the sample ``first`` to before ``last``."""
    factor = oversampling(odr_hz)
    return np.arange(first * factor, last * factor) / (factor * odr_hz)


class LowPass:
    """Noise, low-pass and decimation of one element, of a signal that comes in pieces.

    bandwidth_hz (-3 dB) of a second-order Butterworth; density of the white noise in the output near zero frequency, one-sided.
    The noise enters before the filter, as in the chip, and is coloured by it.  The filter starts in the steady
    state of the first (noiseless) value.
    """

    def __init__(self, bandwidth_hz: float, density: float, odr_hz: float, rng: np.random.Generator):
        from scipy.signal import butter, sosfreqz

        self._factor, self._rng = oversampling(odr_hz), rng
        self._fine_hz = self._factor * odr_hz
        self._sos = butter(2, bandwidth_hz, fs=self._fine_hz, output="sos")
        # Decimation folds the noise at every multiple of the output rate onto zero, so the input noise is reduced accordingly.
        _, response = sosfreqz(self._sos, odr_hz * np.arange(self._factor), fs=self._fine_hz)
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


def temperature_registers(noisy_c: np.ndarray, units: RegisterUnits) -> np.ndarray:
    """Register values (N,) int16 of a temperature with its noise; zeros if the register's meaning is unknown."""
    return np.clip(np.rint(units.temperature_lsb(noisy_c, len(noisy_c))), -REGISTER_MAX, REGISTER_MAX).astype(np.int16)


def self_heating(options: SimulationOptions, t_s: np.ndarray) -> np.ndarray:
    """Temperature (N,) degC of a self-heating board: exponential towards start + warm-up; t_s (N,) since the first sample."""
    return options.temperature_start_c + options.warm_up_c * -np.expm1(-t_s / TEMPERATURE_SETTLES_S)


@dataclass(frozen=True, eq=False)
class RegisterLog:
    """One log as register values.

    t_us (N,) int64 since the session's first sample; gyro, accel (N, 3) and temp (N,) int16 registers.
    """

    t_us: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp: np.ndarray

    @property
    def rows(self) -> np.ndarray:
        """The registers (N, 7) as a board sends them."""
        return np.column_stack([self.gyro, self.accel, self.temp])

    def part(self, start: int, stop: int) -> RegisterLog:
        """Samples start <= i < stop."""
        return RegisterLog(self.t_us[start:stop], self.gyro[start:stop], self.accel[start:stop], self.temp[start:stop])


def streams(options: SimulationOptions) -> list[np.random.Generator]:
    """Random streams of unit, movement, gyroscope, accelerometer, flicker and thermometer.

    Append new purposes last, which keeps the streams of the others.
    """
    drawn = np.random.default_rng(options.seed).spawn(6)
    return [np.random.default_rng(options.unit_drawn_from).spawn(1)[0], *drawn[1:]]


class SensorModel:
    """A stream of samples, ``take`` after ``take``; the same arguments give the same registers.

    options: noise, ranges and bandwidths; unit: linear errors and true data rate; distort, disturb: hidden physics of gyroscope and
    accelerometer; first: number of the first sample, those before 0 only let the filters run up; duration_s: of all of it, if known.
    """

    def __init__(
        self,
        options: SimulationOptions,
        unit: SimulatedUnit,
        motion: Motion,
        distort: Distort | None = None,
        disturb: Disturb | None = None,
        first: int = 0,
        duration_s: float = FLICKER_STRETCH_S,
    ):
        _, _, gyro_rng, accel_rng, flicker_rng, self._temperature_rng = streams(options)
        self._options, self._unit, self._motion, self._distort, self._disturb = options, unit, motion, distort, disturb
        gyro_noise, accel_noise = options.gyro_noise_dps_rthz * DEG, options.accel_noise_ug_rthz * 1e-6 * G
        self._gyro = LowPass(GYRO_LPF2_HZ[options.odr_hz], gyro_noise, unit.odr_hz, gyro_rng)
        self._accel = LowPass(ACCEL_BANDWIDTH_ODR * unit.odr_hz, accel_noise, unit.odr_hz, accel_rng)
        self._flicker = Flicker(options.bias_instability_dph * DEG_PER_HOUR, duration_s, flicker_rng)
        self.next = first  #: number of the next sample

    def take(self, count: int) -> RegisterLog:
        """The next ``count`` samples, less those of the run-up."""
        options, unit, odr_hz, first = self._options, self._unit, self._unit.odr_hz, self.next
        self.next += count
        t_fine = fine_times(odr_hz, first, self.next)
        rate, force, temp_c = self._motion(t_fine)
        if self._distort is not None:
            rate = _checked("distort", self._distort(t_fine, rate, force, temp_c), rate.shape)
        if self._disturb is not None:
            force = _checked("disturb", self._disturb(t_fine, force), force.shape)
        skipped, units = max(-first, 0), options.register_units
        t_s = np.arange(first + skipped, self.next) / odr_hz
        gyro = self._gyro((rate - unit.B) @ np.linalg.inv(unit.E).T)[skipped:] + self._flicker(t_s)
        accel = self._accel(unit.measured_force(force))[skipped:]
        read_c = temp_c[skipped * oversampling(odr_hz) :: oversampling(odr_hz)]
        return RegisterLog(
            t_us=np.rint(t_s * 1e6).astype(np.int64),
            gyro=registers_of(gyro, options.gyro_fs_dps * DEG, units.gyro_rps),
            accel=registers_of(accel, options.accel_fs_g * G, units.accel_mps2),
            temp=temperature_registers(read_c + TEMPERATURE_NOISE_C * self._temperature_rng.standard_normal(len(read_c)), units),
        )


def _checked(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} must return finite values of shape {shape}, got shape {values.shape}")
    return values
