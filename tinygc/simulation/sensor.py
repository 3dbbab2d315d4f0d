"""From the signal that a sensing element feels to the registers that the chip puts out."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfreqz

from session.sensor.profiles.profile import REGISTER_MAX
from session.sensor.registers import RegisterUnits
from tinygc.simulation.noise import white

ACCEL_BANDWIDTH_ODR = 0.25  #: accelerometer's LPF2 at its usual setting, ODR/4 (asm330lhh_reg.h)
LOWEST_FINE_HZ = 1600.0  #: the grid on which filters and effects work: fast beside tremor and filters
LOWEST_OVERSAMPLING = 4
RUN_UP_S = 0.2  #: the fine grid begins this much before the first sample: many times the slowest filter's memory
TEMPERATURE_NOISE_C = 0.01  #: 1 sigma of one reading
TEMPERATURE_SETTLES_S = 150.0  #: time constant of self-heating on a small board


def oversampling(odr_hz: float) -> int:
    """Fine grid points per output sample."""
    return max(LOWEST_OVERSAMPLING, int(np.ceil(LOWEST_FINE_HZ / odr_hz)))


def low_pass(signal: np.ndarray, bandwidth_hz: float, density: float, odr_hz: float, factor: int, rng: np.random.Generator) -> np.ndarray:
    """Noise, low-pass and decimation of one element.

    signal (N, 3) on the fine grid of factor * odr_hz; bandwidth_hz (-3 dB) of a second-order Butterworth; density of the white
    noise in the output near zero frequency, one-sided.  Returns (N / factor, 3): grid points 0, factor, 2 factor, …
    The noise enters before the filter, like the element's own, so it is coloured as in the chip.  The filter begins in the steady
    state of the first (noiseless) value.
    """
    fine_hz = factor * odr_hz
    sos = butter(2, bandwidth_hz, fs=fine_hz, output="sos")
    # Decimation folds the noise at every multiple of the output rate onto zero: so much less must go in.
    _, response = sosfreqz(sos, odr_hz * np.arange(factor), fs=fine_hz)
    folded = np.sqrt(np.sum(np.abs(response) ** 2))
    noisy = signal + white(density / folded, fine_hz, len(signal), rng)
    steady = sosfilt_zi(sos)[:, :, None] * signal[0]
    filtered, _ = sosfilt(sos, noisy, axis=0, zi=steady)
    return filtered[::factor]


def registers_of(value: np.ndarray, full_scale: float, per_lsb: float) -> np.ndarray:
    """Register values (N, 3) int16 of measured rates or forces in SI: rounded, cut at full scale and at what 16 bits hold."""
    largest = min(round(full_scale / per_lsb), REGISTER_MAX)
    return np.clip(np.rint(value / per_lsb), -largest, largest).astype(np.int16)


def temperature(t_s: np.ndarray, start_c: float, warm_up_c: float) -> np.ndarray:
    """Temperature (N,) degC of a board that heats itself: exponential towards start + warm-up; t_s (N,) since the first sample."""
    return start_c + warm_up_c * -np.expm1(-t_s / TEMPERATURE_SETTLES_S)


def temperature_registers(temp_c: np.ndarray, rng: np.random.Generator, units: RegisterUnits) -> np.ndarray:
    """Register values (N,) int16 of a temperature, with the thermometer's noise; zeros where the register's meaning is not known."""
    noisy = temp_c + TEMPERATURE_NOISE_C * rng.standard_normal(len(temp_c))
    return np.clip(np.rint(units.temperature_lsb(noisy, len(noisy))), -REGISTER_MAX, REGISTER_MAX).astype(np.int16)
