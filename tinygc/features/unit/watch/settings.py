"""The numbers of the detector: what a rest is, coefficients of its filters, bars of its tests.

Rates are in units of the axis's own white noise over one window, so that one filter covariance serves all three axes; where axes differ,
the largest ratio of wander, offset or attitude to white noise holds for all.  The wander is a walk and two Gauss-Markov processes, no
smaller than the figures at any time from a window to a day.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.detect.stills import QUIET_ACCEL_RATIO, QUIET_VARIANCE_RATIO
from tinygc.estimation.expected_zero import END_S
from tinygc.features.unit.watch.bars import bar_of
from tinygc.features.unit.watch.expectation import Expectation, Wander

#: s of a block, in which stillness is judged, and blocks of a window, whose mean is one reading of the zero
WATCHED_S, BLOCKS = 0.125, 16
#: samples of a block: fewer say nothing of its scatter
FEWEST = 4
#: means of a block beyond these belong to no rest: rad/s, share of gravity of the force
REST_RATE_RPS, FORCE_WITHIN = 10 * DEG, 0.25
#: s, correlation times of the Gauss-Markov processes: with a walk they follow flicker noise from a window to a day within 7 %
TIMES_S = (5.0, 200.0)
#: shifts, in sigmas of a window, that the tests look for; both signs, on three axes and on gravity
SHIFTS = (0.25, 1.0, 2.0, 4.0)
CHANNELS = ("zero x", "zero y", "zero z", "gravity")
#: tests that share the rate of false alarms: those of the detector, and one of turns
TESTS = 2 * len(CHANNELS) * len(SHIFTS) + 1
#: sigmas: a window further off changes no estimate, and counts as this many; two of them are needed for an alarm
CLIP = 5.0
#: windows over which the sensor's own noise is averaged, and how much larger than stated a window's scatter may be
NOISE_WINDOWS, MOST_SCATTER = 64, 9.0
#: blocks of a gap that count: a day
MOST_GAP = round(END_S / WATCHED_S)


@dataclass(frozen=True, eq=False)
class Settings:
    """What the detector needs.

    samples: of a block; gyro_limit, accel_limit: bars of the variance of a block's samples, (rad/s)^2 and (m/s^2)^2; gyro_scatter,
    accel_scatter: stated variance of a block's mean; gravity_mps2, earth_rps: the Earth's vertical rate; rate_sigma_rps (3,),
    gravity_sigma: one sigma of a window's white noise, of an axis and as a share of gravity, by which readings are normalised; reference_c:
    the coefficient's zero; walk, decay (2,), drive (2,): of the wander a window; offset, attitude, per_k: prior variances; accel_*: the
    same of gravity; shift, bar (4,): of the tests.
    """

    samples: int
    gyro_limit: float
    accel_limit: float
    gyro_scatter: float
    accel_scatter: float
    gravity_mps2: float
    earth_rps: float
    rate_sigma_rps: np.ndarray
    gravity_sigma: float
    reference_c: float
    walk: float
    decay: np.ndarray
    drive: np.ndarray
    offset: float
    attitude: float
    per_k: float
    accel_walk: float
    accel_drive: np.ndarray
    accel_offset: float
    accel_attitude: float
    accel_per_k: float
    shift: np.ndarray
    bar: np.ndarray

    @property
    def window_samples(self) -> int:
        """Samples of one window."""
        return self.samples * BLOCKS


def settings(expected: Expectation, false_alarm_every_s: float, reference_c: float | None = None) -> Settings:
    """The detector's numbers; false_alarm_every_s: mean time at rest to a false alarm, s; reference_c: where none is expected.

    Raises CalibrationError for a data rate that leaves a block without scatter, and a time of less than a hundred windows.
    """
    samples = round(WATCHED_S * expected.rate_hz)
    if samples < FEWEST:
        raise CalibrationError(
            f"watch: {expected.rate_hz:.4g} samples a second; expected {FEWEST / WATCHED_S:g} or more, so that a block of {WATCHED_S:g} s "
            "shows whether the sensor rests; record faster"
        )
    block_s = samples / expected.rate_hz
    window_s = block_s * BLOCKS
    if false_alarm_every_s < 100 * window_s:
        raise CalibrationError(f"watch: a false alarm every {false_alarm_every_s:g} s is asked for; expected at least {100 * window_s:g} s")
    white = expected.white**2 / window_s
    gravity = expected.gravity_mps2
    accel_sigma = float(np.sqrt(np.max(expected.accel_white**2) / window_s)) / gravity
    walk, drive = _wander(expected.wander, window_s, white)
    accel_white = np.full(3, (gravity * accel_sigma) ** 2)
    accel_walk, accel_drive = _wander(expected.accel_wander, window_s, accel_white)
    length = TESTS * false_alarm_every_s / window_s
    reference = expected.reference_c if expected.reference_c is not None else reference_c
    gyro, accel = float(np.sum(expected.white**2)), float(np.sum(expected.accel_white**2))
    return Settings(
        samples,
        QUIET_VARIANCE_RATIO * gyro * expected.rate_hz,
        QUIET_ACCEL_RATIO * accel * expected.rate_hz,
        gyro / block_s,
        accel / block_s,
        gravity,
        expected.earth_rps,
        np.sqrt(white),
        accel_sigma,
        0.0 if reference is None else reference,
        walk,
        np.exp(-window_s / np.array(TIMES_S)),
        drive,
        float(np.max(expected.offset**2 / white)),
        float(np.max(expected.attitude**2 / white)),
        0.0 if reference is None else float(np.max(expected.per_k**2 / white)),
        accel_walk,
        accel_drive,
        float(np.max(expected.accel_offset**2) / accel_white[0]),
        float(expected.accel_attitude**2 / accel_white[0]),
        0.0 if reference is None else float(expected.accel_per_k**2 / accel_white[0]),
        np.array(SHIFTS),
        np.array([bar_of(each, length) for each in SHIFTS]),
    )


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
