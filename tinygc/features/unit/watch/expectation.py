"""What a calibrated sensor may read at rest while its calibration holds, with the source of each size, and the detector's numbers from it.

    zero      calibrated rate at rest - Earth's vertical rate = offset + wander(t) + attitude + coefficient (T - T_fit) + noise
    gravity   |f| / g - 1 = direction . zero of the accelerometer + attitude + coefficient (T - T_rest) + noise

offset is one draw for each stream (covariance of B, switch-on), attitude one for each rest, wander goes on through the
stream.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from session.base.errors import CalibrationError
from session.base.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS, MDPS, MG, STANDARD_GRAVITY_MPS2, G
from session.detect.accelerometer import BIASES
from session.detect.stills import QUIET_ACCEL_RATIO, QUIET_VARIANCE_RATIO
from session.log.config import Config
from tinygc.closure.floor import BiasInstability
from tinygc.estimation.spread import END_S, USUAL_ACCEL_PER_K, USUAL_PER_K, ZERO, wander_variance
from tinygc.features.unit.watch.bars import bar_of, run_length
from tinygc.fitting.unit_state import UnitState, spread_of
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import BIAS, PARAMETERS
from tinygc.noise.components import REFERENCE, STILL_RATE, TURN
from tinygc.noise.figures import NoiseFigures
from tinygc.noise.whitening import PRECALIBRATION_MPS2

#: usual of MEMS gyroscopes where neither the fit nor the sensor's record has it: two-sided white density, bias instability, and spread of
#: B that a fit without a covariance leaves
USUAL_WHITE, USUAL_INSTABILITY, USUAL_COVARIANCE_RPS = 10 * MDPS / np.sqrt(2), 10 * DEG_PER_HOUR, 0.01 * DEG
#: the same of accelerometers
USUAL_ACCEL_WHITE, USUAL_ACCEL_INSTABILITY_MPS2 = 150e-6 * G / np.sqrt(2), 0.1 * MG
#: zero of a rest that depends on its attitude (g-sensitivity), where the fit's stills do not show it
USUAL_ATTITUDE_RPS = 0.002 * DEG
#: how a spread that is not the unit's own is called
SPREAD = "spread of the zero between switch-ons"
#: degC: others are no temperature
MOST_TEMPERATURE_C = 200.0
#: gravity at sea level lies within 0.026 m/s^2 of its mean, one sigma of an unknown place
UNKNOWN_GRAVITY_MPS2 = 0.015


Wander = Callable[[float, float], np.ndarray]


@dataclass(frozen=True, eq=False)
class AtRest:
    """What three axes of a sensor may read at rest, SI.

    white (3,), two-sided density; wander: (t, span) -> (3,), mean square of the drift between two means over span, s t apart; offset (3,),
    attitude, per_k: one sigma in a stream, of a rest, and of the coefficient of temperature.
    """

    white: np.ndarray
    wander: Wander
    offset: np.ndarray
    attitude: np.ndarray | float
    per_k: np.ndarray | float


@dataclass(frozen=True, eq=False)
class Expectation:
    """SI, of the calibrated axes.

    rate_hz of the samples; gyro, accel: of both sensors; reference_c: the coefficient's zero, None where temperature is taken off or not
    known; earth_rps: the Earth's vertical rate; gravity_mps2; parameters (12, 12): covariance of E and B; turn_rad: error of a turn by
    itself; assumed: what is not this unit's own.
    """

    rate_hz: float
    gyro: AtRest
    accel: AtRest
    reference_c: float | None
    earth_rps: float
    gravity_mps2: float
    parameters: np.ndarray
    turn_rad: float = 0.0
    assumed: tuple[str, ...] = ()


def expect(known: UnitState, rate_hz: float) -> Expectation:
    """What the model's sensor may read at rest, at this data rate."""
    assumed: list[str] = []
    fit_noise, figures, config = known.fit.get("noise") or {}, known.figures, known.config

    def white(kind: str, key: str, si: float, usual: float, words: str) -> np.ndarray:
        """(3,) two-sided density: N of the figures, else the one-sided density of the fit's stills over sqrt(2)."""
        sensor = None if figures is None else figures.sensors().get(kind)
        if sensor is not None and np.all(sensor.values("N") > 0):
            return sensor.values("N")
        if (stills := fit_noise.get(key)) is not None:
            return np.asarray(stills, dtype=float) * si / np.sqrt(2)
        assumed.append(f"white noise of the {words}")
        return np.full(3, usual)

    own = known.covariance[:PARAMETERS, :PARAMETERS]
    if not len(own):
        assumed.append("covariance of the calibration")
        own = np.diag(np.r_[np.full(9, 1e-3**2), np.full(3, USUAL_COVARIANCE_RPS**2)])
    spread = spread_of(config, known.table)
    if spread.at(ZERO).is_usual:
        assumed.append(SPREAD)
    instability = _instability(fit_noise, config)
    if figures is None and instability is None:
        assumed.append("bias instability of the gyroscope")
        instability = BiasInstability(USUAL_INSTABILITY, "usual of MEMS gyroscopes")
    usual = BiasInstability(USUAL_ACCEL_INSTABILITY_MPS2, "usual of MEMS accelerometers")
    accel = None if figures is None or figures.accel is None else replace(figures, gyro=figures.accel)
    if accel is None:
        assumed.append("bias instability of the accelerometer")
    attitude, reference = known.largest(STILL_RATE), known.largest(REFERENCE)
    latitude, gravity = (None, None) if config is None else (config.site.latitude_deg, config.site.gravity_mps2)
    across = EARTH_RATE_RPS * (np.cos(latitude * DEG) if latitude is not None else 1.0) / np.sqrt(2 if latitude is not None else 3)
    thermal = known.model.kind == "thermal"
    if gravity is None:
        assumed.append("gravity of the place")
    if not thermal:
        assumed.append("change of the zero with temperature")
        if known.temperature_c is None:
            assumed.append("temperature of the calibration")
    return Expectation(
        rate_hz,
        AtRest(
            white("gyro", "gyro_dps_rthz", DEG, USUAL_WHITE, "gyroscope"),
            lambda elapsed_s, span_s: _drift(elapsed_s, span_s, figures, instability),
            spread.at(ZERO).any_session(np.diag(own)[BIAS]),
            float(np.hypot(across, USUAL_ATTITUDE_RPS if attitude is None else attitude)),
            USUAL_PER_K,
        ),
        AtRest(
            white("accel", "accel_g_rthz", G, USUAL_ACCEL_WHITE, "accelerometer"),
            lambda elapsed_s, span_s: _drift(elapsed_s, span_s, accel, usual),
            np.sqrt(2) * spread.sigma[BIASES],
            float(np.hypot(PRECALIBRATION_MPS2 if reference is None else reference, 0.0 if gravity is not None else UNKNOWN_GRAVITY_MPS2)),
            USUAL_ACCEL_PER_K,
        ),
        None if thermal else known.temperature_c,
        0.0 if latitude is None else float(EARTH_RATE_RPS * np.sin(latitude * DEG)),
        STANDARD_GRAVITY_MPS2 if gravity is None else gravity,
        own,
        known.largest(TURN) or 0.0,
        tuple(assumed),
    )


def _drift(elapsed_s: float, span_s: float, figures: NoiseFigures | None, instability: BiasInstability | None) -> np.ndarray:
    """(3,) (rad/s)^2: as ``wander_variance``, of means over a span, in which flicker noise faster than it is averaged away."""
    found = wander_variance(elapsed_s, figures, instability)
    sizes = [0.0 if instability is None else instability.rps] * 3 if figures is None else list(figures.gyro.values("B"))
    faster = _flicker(elapsed_s, 0.0) - _flicker(elapsed_s, span_s)
    return np.maximum(found - np.square(sizes) * faster, 0.0)


def _flicker(elapsed_s: float, span_s: float) -> float:
    """Mean square of the drift of flicker noise of an instability of 1, between two means."""
    covariance = wander_covariance(np.array([0.0, min(elapsed_s, END_S)]), span_s, instability_rps=1.0)
    return float(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1])


def _instability(fit_noise: dict, config: Config | None) -> BiasInstability | None:
    """Of session.toml, else of the fit, else typical of the sensor; None where it is not known."""
    if config is not None and config.sensor.gyro_bias_instability_dph is not None:
        return BiasInstability(config.sensor.gyro_bias_instability_dph * DEG_PER_HOUR, "given in session.toml")
    if (found := fit_noise.get("gyro_bias_instability_dph")) is not None:
        return BiasInstability(float(found) * DEG_PER_HOUR, str(fit_noise.get("gyro_bias_instability_source")))
    typical = None if config is None else config.sensor.typical("gyro_bias_instability_dph")
    return None if typical is None else BiasInstability(typical[1] * DEG_PER_HOUR, f"typical of {typical[0]}")


# The numbers of the detector: what a rest is, coefficients of its filters, bars of its tests.
#
# Rates are in units of the axis's own white noise over one window, so that one filter covariance serves all three axes; where axes differ,
# the largest ratio of wander, offset or attitude to white noise holds for all.  The wander is a walk and two Gauss-Markov processes, no
# smaller than the figures at any time from a window to a day.

#: s of a block, in which stillness is tested, and blocks of a window, whose mean is one reading of the zero
WATCHED_S, BLOCKS = 0.125, 16
#: samples of a block: fewer do not show its scatter
FEWEST = 4
#: means of a block beyond these belong to no rest: rad/s, share of gravity of the force
REST_RATE_RPS, FORCE_WITHIN = 10 * DEG, 0.25
#: s, correlation times of the Gauss-Markov processes: with a walk they follow flicker noise from a window to a day within 7 %
TIMES_S = (5.0, 200.0)
#: shifts, in sigmas of a window, that the tests look for; both signs, on three axes and on gravity
SHIFTS = np.array([0.25, 1.0, 2.0, 4.0])
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
class Sizes:
    """Variances of a filter's states, in those of a window's white noise: walk, drive (2,): of the wander a window; offset, attitude,
    per_k: before any window."""

    walk: float
    drive: np.ndarray
    offset: float
    attitude: float
    per_k: float


@dataclass(frozen=True, eq=False)
class Settings:
    """What the detector needs.

    expected; samples: of a block; limit, scatter (2,) of rate and force, (rad/s)^2 and (m/s^2)^2: bar of the variance of a block's samples,
    stated variance of a block's mean; rate_sigma_rps (3,), gravity_sigma: one sigma of a window's white noise, of an axis and as a share of
    gravity, by which readings are normalised; reference_c: the coefficient's zero; decay (2,) of the wander's processes in a window; rate,
    gravity: sizes of their states; bar (4,): of the tests.
    """

    expected: Expectation
    samples: int
    limit: np.ndarray
    scatter: np.ndarray
    rate_sigma_rps: np.ndarray
    gravity_sigma: float
    reference_c: float
    decay: np.ndarray
    rate: Sizes
    gravity: Sizes
    bar: np.ndarray

    @property
    def window_s(self) -> float:
        """Duration of one window, s."""
        return self.samples * BLOCKS / self.expected.rate_hz


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
        raise CalibrationError(f"watch: a false alarm every {false_alarm_every_s:g} s; expected at least {100 * window_s:g} s")
    white = expected.gyro.white**2 / window_s
    gravity_sigma = float(np.sqrt(np.max(expected.accel.white**2) / window_s)) / expected.gravity_mps2
    reference = expected.reference_c if expected.reference_c is not None else reference_c
    both = np.array([np.sum(each.white**2) for each in (expected.gyro, expected.accel)])
    warms = reference is not None
    return Settings(
        expected,
        samples,
        np.array([QUIET_VARIANCE_RATIO, QUIET_ACCEL_RATIO]) * both * expected.rate_hz,
        both / block_s,
        np.sqrt(white),
        gravity_sigma,
        reference or 0.0,
        np.exp(-window_s / np.array(TIMES_S)),
        _sizes(expected.gyro, white, window_s, warms),
        _sizes(expected.accel, np.full(3, (expected.gravity_mps2 * gravity_sigma) ** 2), window_s, warms),
        np.array([bar_of(run_length, TESTS * false_alarm_every_s / window_s, float(each)) for each in SHIFTS]),
    )


def _sizes(sensor: AtRest, white: np.ndarray, window_s: float, warms: bool) -> Sizes:
    """white (3,): variance of a window's white noise.  The walk, and what drives the Gauss-Markov processes, are the smallest that are
    nowhere below the mean square of the drift from a window to a day."""
    lags = np.geomspace(window_s, END_S, 40)
    drift = np.array([np.max(sensor.wander(lag, window_s) / white) for lag in lags])
    size = np.zeros(1 + len(TIMES_S))
    if drift.any():
        columns = np.column_stack([lags / window_s, *(2 * -np.expm1(-lags / time) for time in TIMES_S)])
        weight = 1 / np.maximum(drift, 1e-12 * drift.max())
        size, _ = nnls(columns * weight[:, None], drift * weight)
        size *= np.max(drift / np.maximum(columns @ size, 1e-300))
    offset, attitude, per_k = (float(np.max(np.square(each) / white)) for each in (sensor.offset, sensor.attitude, sensor.per_k))
    drive = size[1:] * -np.expm1(-2 * window_s / np.array(TIMES_S))
    return Sizes(float(size[0]), drive, offset, attitude, per_k if warms else 0.0)
