"""The numbers of the detector, in float32: scales of its integers, coefficients of its filters, bars of its tests.

Rates are in units of the axis's own white noise over one window, so that one filter covariance serves all three axes; where axes differ,
the largest ratio of wander, offset or attitude to white noise holds for all.  The wander is a walk and two Gauss-Markov processes, no
smaller than the figures at any time from a window to a day.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from session.detect.stills import QUIET_ACCEL_RATIO, QUIET_VARIANCE_RATIO
from session.io.errors import CalibrationError
from session.io.units import DEG
from tinygc.annexes.watch.bars import bar_of
from tinygc.annexes.watch.expectation import Expectation, Wander
from tinygc.estimation.expected_zero import END_S

#: s of a block, in which stillness is judged, and blocks of a window, whose mean is one reading of the zero
BLOCK_S, BLOCKS = 0.125, 16
#: samples of a block: fewer say nothing of its scatter, more would overflow the sums of a window
FEWEST, MOST = 4, 500
#: integers in a rad/s and in a m/s^2: 2^-20 rad/s is 0.00005 dps, 2^-14 m/s^2 6 ug
RATE_BITS, FORCE_BITS, TEMPERATURE_BITS = 20, 14, 8
#: readings beyond these belong to no rest: rad/s and m/s^2 of a sample, rad/s of a block's mean, share of gravity of a block's force
MOST_RATE_RPS, MOST_FORCE_MPS2, REST_RATE_RPS, FORCE_WITHIN = 0.5, 32.0, 10 * DEG, 0.25
#: s, correlation times of the Gauss-Markov processes: with a walk they follow flicker noise from a window to a day within 7 %
TIMES_S = (5.0, 200.0)
#: shifts, in sigmas of a window, that the tests look for; both signs, on three axes and on gravity
SHIFTS = (0.25, 1.0, 2.0, 4.0)
CHANNELS = ("zero x", "zero y", "zero z", "gravity")
#: tests that share the rate of false alarms: those of the detector, and one of turns, which the controller lacks
TESTS = 2 * len(CHANNELS) * len(SHIFTS) + 1
#: sigmas: a window further off changes no estimate, and counts as this many; two of them are needed for an alarm
CLIP = 5.0
#: windows over which the sensor's own noise is averaged, and how much larger than stated a window's scatter may be
NOISE_WINDOWS, MOST_SCATTER = 64, 9.0
#: blocks of a gap that count: a day
MOST_GAP = round(END_S / BLOCK_S)
#: steps of Heron's root from (1 + S) / 2 on: enough for S from 1 to 10^7
ROOT_STEPS = 20


@dataclass(frozen=True, eq=False)
class Settings:
    """What the detector needs, as it stands in the C.

    samples: of a block; *_scale: integers per SI; gyro_limit, accel_limit: bars of a block's scatter, gravity_low and gravity_high: of
    its squared force, rate_limit of each mean, all in integers; rate_unit (3,), force_unit, temperature_unit, reference: from a window's
    sums to normalised rates, g, and K from the reference; earth (3,): the Earth's vertical rate, normalised; gravity_unit: (|f|^2 - 1) to
    sigmas; gyro_scatter, accel_scatter: from a window's scatter to its ratio to the stated noise; walk, decay (2,), drive (2,): of the
    wander a window; offset, attitude, per_k: prior variances; accel_*: the same of gravity; shift, half, bar (4,): of the tests.
    """

    samples: int
    rate_limit: int
    gyro_limit: int
    accel_limit: int
    gravity_low: int
    gravity_high: int
    rate_scale: np.float32
    force_scale: np.float32
    rate_unit: np.ndarray
    force_unit: np.float32
    temperature_unit: np.float32
    reference: np.float32
    earth: np.ndarray
    gravity_unit: np.float32
    gyro_scatter: np.float32
    accel_scatter: np.float32
    walk: np.float32
    decay: np.ndarray
    drive: np.ndarray
    offset: np.float32
    attitude: np.float32
    per_k: np.float32
    accel_walk: np.float32
    accel_drive: np.ndarray
    accel_offset: np.float32
    accel_attitude: np.float32
    accel_per_k: np.float32
    shift: np.ndarray
    half: np.ndarray
    bar: np.ndarray

    @property
    def window_samples(self) -> int:
        """Samples of one window."""
        return self.samples * BLOCKS

    @property
    def rate_sigma_rps(self) -> np.ndarray:
        """(3,) rad/s: one unit of a normalised rate."""
        return self.rate_unit.astype(float) ** -1 * 2.0**-RATE_BITS / self.window_samples

    @property
    def gravity_sigma(self) -> float:
        """Share of gravity: one unit of its normalised length."""
        return 0.5 / float(self.gravity_unit)


def settings(expected: Expectation, false_alarm_every_s: float, reference_c: float | None = None) -> Settings:
    """The detector's numbers; false_alarm_every_s: mean time at rest to a false alarm, s; reference_c: where none is expected.

    Raises CalibrationError for a data rate that leaves a block without scatter, and a time of less than a hundred windows.
    """
    samples = round(BLOCK_S * expected.rate_hz)
    if not FEWEST <= samples <= MOST:
        raise CalibrationError(
            f"watch: {expected.rate_hz:.4g} samples a second; expected {FEWEST / BLOCK_S:g} to {MOST / BLOCK_S:g}, so that a block of "
            f"{BLOCK_S:g} s shows whether the sensor rests; record faster, or leave samples out"
        )
    block_s = samples / expected.rate_hz
    window_s = block_s * BLOCKS
    if false_alarm_every_s < 100 * window_s:
        raise CalibrationError(f"watch: a false alarm every {false_alarm_every_s:g} s is asked for; expected at least {100 * window_s:g} s")
    white = expected.white**2 / window_s
    sigma = np.sqrt(white)
    gravity = expected.gravity_mps2
    accel_sigma = float(np.sqrt(np.max(expected.accel_white**2) / window_s)) / gravity
    walk, drive = _wander(expected.wander, window_s, white)
    accel_white = np.full(3, (gravity * accel_sigma) ** 2)
    accel_walk, accel_drive = _wander(expected.accel_wander, window_s, accel_white)
    count = samples * BLOCKS
    rate_scale, force_scale = 2.0**RATE_BITS, 2.0**FORCE_BITS
    pairs = BLOCKS * (BLOCKS - 1) * samples**2 / block_s  # of the scatter of a window's blocks, for densities of 1
    own = samples * (samples - 1) * expected.rate_hz  # of the scatter of a block's samples, for white noise up to half the data rate
    force = (gravity * force_scale * samples) ** 2
    length = TESTS * false_alarm_every_s / window_s
    shift = np.array(SHIFTS)
    reference = expected.reference_c if expected.reference_c is not None else reference_c

    def single(value: float | np.ndarray) -> np.float32:
        return np.float32(value)

    return Settings(
        samples,
        int(REST_RATE_RPS * rate_scale * samples),
        _whole(QUIET_VARIANCE_RATIO * own * np.sum(expected.white**2 * rate_scale**2 + 1 / 12 / expected.rate_hz)),
        _whole(QUIET_ACCEL_RATIO * own * np.sum(expected.accel_white**2 * force_scale**2 + 1 / 12 / expected.rate_hz)),
        _whole((1 - FORCE_WITHIN) ** 2 * force),
        _whole((1 + FORCE_WITHIN) ** 2 * force),
        single(rate_scale),
        single(force_scale),
        (1 / (rate_scale * count * sigma)).astype(np.float32),
        single(1 / (force_scale * count * gravity)),
        single(1 / (2**TEMPERATURE_BITS * count)),
        single(0.0 if reference is None else reference),
        (expected.earth_rps / sigma).astype(np.float32),
        single(0.5 / accel_sigma),
        single(1 / (pairs * rate_scale**2 * float(np.sum(expected.white**2)))),
        single(1 / (pairs * force_scale**2 * float(np.sum(expected.accel_white**2)))),
        single(walk),
        np.exp(-window_s / np.array(TIMES_S)).astype(np.float32),
        drive.astype(np.float32),
        single(np.max(expected.offset**2 / white)),
        single(np.max(expected.attitude**2 / white)),
        single(0.0 if reference is None else np.max(expected.per_k**2 / white)),
        single(accel_walk),
        accel_drive.astype(np.float32),
        single(np.max(expected.accel_offset**2) / accel_white[0]),
        single(expected.accel_attitude**2 / accel_white[0]),
        single(0.0 if reference is None else expected.accel_per_k**2 / accel_white[0]),
        shift.astype(np.float32),
        (shift**2 / 2).astype(np.float32),
        np.array([bar_of(each, length) for each in SHIFTS]).astype(np.float32),
    )


def _whole(value: float) -> int:
    """An integer that 64 bits hold."""
    return int(min(value, 2.0**62))


def _wander(wander: Wander, window_s: float, white: np.ndarray) -> tuple[float, np.ndarray]:
    """Variance of the walk in a window, and (2,) of what drives the Gauss-Markov processes, normalised: the smallest that are nowhere below
    the mean square of the drift from a window to a day."""
    lags = np.geomspace(window_s, END_S, 40)
    drift = np.array([np.max(wander(lag, window_s) / white) for lag in lags])
    if not drift.any():
        return 0.0, np.zeros(len(TIMES_S))
    columns = np.column_stack([lags / window_s, *(2 * -np.expm1(-lags / time) for time in TIMES_S)])
    weight = 1 / np.maximum(drift, 1e-12 * drift.max())
    size, _ = nnls(columns * weight[:, None], drift * weight)
    size *= np.max(drift / np.maximum(columns @ size, 1e-300))
    return float(size[0]), size[1:] * -np.expm1(-2 * window_s / np.array(TIMES_S))
