"""The interface of all calibrations, the accelerometer and sensor in a model file, and the file's schema."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from session.base.errors import CalibrationError
from session.base.names import CLOCKS
from session.base.results import Array, Keys, ListOf, MapOf, Maybe, Number, Text, require
from session.base.units import DEG, G
from session.log.config import OWN_UNITS, Accelerometer, Sensor

if TYPE_CHECKING:
    from session.log.samples import Samples
    from tinygc.effects.effect import AppliedEffect


# The keys shared by all kinds of model, with the ranges of their values (``session/base/results.py``).

#: greatest factor on a rate or a force: it includes mixed-up units, such as mdps for dps
FACTOR = Number(-1e4, 1e4)
#: limits beyond any gyroscope and accelerometer (session/base/units.py), rad/s and m/s^2
RATE, FORCE = Number(-1e5 * DEG, 1e5 * DEG), Number(-1e4 * G, 1e4 * G)
CELSIUS = Number(-1e4, 1e4)
SECONDS = Number(-1e9, 1e9)
#: least ratio of a matrix's smallest to its largest response: below, one axis lies within half a degree of the plane of the others
SINGULAR = 1e-2
#: tolerance for correlations
ROUNDING = 1e-6


def invertible(matrix: np.ndarray) -> str:
    """Describe why a matrix (3, 3) is not invertible; empty if it is."""
    responses = np.linalg.svd(matrix, compute_uv=False)
    if responses[-1] <= SINGULAR * responses[0]:
        return "is singular, expected a matrix that keeps all three axes apart"
    return "mirrors the axes, expected a matrix that turns a right-handed triad into one" if np.linalg.det(matrix) < 0 else ""


def covariance(matrix: np.ndarray) -> str:
    """Describe why a matrix (n, n) is not a covariance; empty if it is."""
    if matrix.shape[0] != matrix.shape[1]:
        return f"has shape {matrix.shape[0]} x {matrix.shape[1]}, expected as many rows as columns"
    variance = np.diag(matrix)
    if (variance < 0).any():
        return "is not positive: it has a variance below 0; expected a covariance"
    sigma = np.sqrt(np.where(variance > 0, variance, 1.0))
    limit = np.outer(sigma, sigma)  # from sigmas: the product of variances of 1e-300 underflows
    with np.errstate(over="ignore"):
        if (np.abs(matrix - matrix.T) > ROUNDING * limit).any():
            return "is not symmetric, expected a covariance"
    sound = (np.abs(matrix) <= (1 + ROUNDING) * limit).all() and np.linalg.eigvalsh(matrix / limit).min() > -ROUNDING
    return "" if sound else "is not positive, expected a covariance"


def certain(matrix: np.ndarray) -> str:
    """As ``covariance``, but each variance must be positive."""
    return covariance(matrix) or ("" if (np.diag(matrix) > 0).all() else "has a variance of 0, expected a covariance of uncertain numbers")


MATRIX = Array((3, 3), FACTOR, invertible)
COVARIANCE = Array((None, None), sound=covariance)
ORIGIN = {"method": Maybe(Text()), "session": Maybe(Text()), "sha256": Maybe(MapOf(Text()))}
#: in addition to the keys of each kind
MODEL = Keys(
    may={
        **ORIGIN,
        "equation": Text(),
        "version": Text(),
        "clock": Text(CLOCKS),
        "covariance": Maybe(COVARIANCE),
        "covariance_of": ListOf(Text()),
        "covariance_units": Text(),
        "accelerometer_covariance": COVARIANCE,
        "joint_covariance": Maybe(
            Keys({"matrix": Array((None, None), sound=certain)}, {"parameters": ListOf(Text()), "shared": COVARIANCE})
        ),
        "unobserved": Maybe(ListOf(Text())),
        "bias_sigma_rps": Maybe(Array((3,), Number(0, RATE.high))),
        "accelerometer_spread": Maybe(Array((9,), Number(0, FORCE.high))),
        "began_s": MapOf(SECONDS),
        "temperature_c": Maybe(CELSIUS),
        "stored": Maybe(Keys(may=ORIGIN)),
        "remaining_rps": Maybe(ListOf(Maybe(Number(0, RATE.high)))),
        "accel_change_mps2": Maybe(ListOf(Array((3,), FORCE))),
        "delay_s": SECONDS,
    }
)


# The accelerometer and the sensor in a model file.

EQUATION = "f = matrix @ (measured - bias_mps2), m/s^2"
SOURCES = ("given", "prior", "stills", "none")
FULL_SCALES = ("gyro_fs_dps", "accel_fs_g")
_ABOVE_0 = Maybe(Number(0, above=True))
_SENSOR = Keys(
    may={
        "model": Maybe(Text()),
        "serial": Maybe(Text()),
        "odr_hz": _ABOVE_0,
        **dict.fromkeys((*FULL_SCALES, *OWN_UNITS), _ABOVE_0),
        "temp_at_zero_c": Maybe(Number(-1e4, 1e4)),
    }
)


def accelerometer_table(accelerometer: Accelerometer) -> dict:
    """The table ``accelerometer`` of ``tinygc-model/1``."""
    return {
        "equation": EQUATION,
        "matrix": accelerometer.matrix.tolist(),
        "bias_mps2": accelerometer.bias_mps2.tolist(),
        "source": accelerometer.source,
    }


class OfAccelerometer(Keys):
    """The table ``accelerometer``."""

    written = staticmethod(accelerometer_table)

    def made(self, value: Any) -> Accelerometer | None:
        """None where it is uncalibrated."""
        found = Accelerometer(**{key: each for key, each in super().made(value).items() if key != "equation"})
        return None if found.source == "none" else found


ACCELEROMETER = OfAccelerometer({"matrix": MATRIX, "bias_mps2": Array((3,), FORCE)}, {"source": Text(SOURCES), "equation": Text()})


def accelerometer_of(table: dict, where: str = "model") -> Accelerometer | None:
    """Read the accelerometer of a model file; None if absent or uncalibrated.  Raises FormatError for an invalid calibration."""
    entry = table.get("accelerometer")
    if entry is None:
        return None
    require(table, Keys({"accelerometer": ACCELEROMETER}), where)
    return ACCELEROMETER.made(entry)


def sensor_table(sensor: Sensor) -> dict:
    """The table ``sensor`` of ``tinygc-model/1``."""
    return {
        "model": sensor.model,
        "serial": sensor.serial,
        "odr_hz": sensor.odr_hz,
        "gyro_fs_dps": sensor.gyro_fs_dps,
        "accel_fs_g": sensor.accel_fs_g,
    } | {name: value for name, value in sensor.own_units.items() if value is not None}


@dataclass(frozen=True)
class KnownSensor:
    """The sensor of a model file: full scales, model, its own register units (``OWN_UNITS``); None if not stated."""

    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None
    model: str | None = None
    own_units: dict[str, float | None] = field(default_factory=dict)


def sensor_of(table: dict, where: str = "model") -> KnownSensor:
    """Read the sensor of a model file.  Raises FormatError for what is no number."""
    entry = table.get("sensor")
    if entry is None:
        return KnownSensor()
    require(table, Keys({"sensor": _SENSOR}), where)
    gyro, accel = (entry.get(key) for key in FULL_SCALES)
    own: dict[str, float | None] = {key: float(entry[key]) for key in OWN_UNITS if entry.get(key) is not None}
    return KnownSensor(None if gyro is None else float(gyro), None if accel is None else float(accel), entry.get("model") or None, own)


# The interface of all calibrations.


#: rates (N, 3) rad/s and temperatures (N,) degC, None where the model needs none, of the next samples of a log -> calibrated rates (N, 3)
Stream = Callable[[np.ndarray, Any], np.ndarray]


class Model:
    """A map from measured rates to calibrated ones.

    kind: its name in the model file (``tinygc/models/files.py``); pointwise: whether each rate is calibrated by itself, so that the model
    may be called on rates (..., 3); rates_only: whether its only input is rates (a denoiser has memory and is called on
    (..., N, 3) in time order); parameters: number of fitted parameters; undone: the effects that it removes; conditions: names of its
    other inputs; made_for_hz: the sampling rate that it was made for, None for any; delay_s: its output delay; session_s: duration of
    its session in s if it is valid only in that session's time, None otherwise.
    """

    kind: ClassVar[str]
    pointwise: ClassVar[bool] = True
    rates_only: ClassVar[bool] = True

    @property
    def parameters(self) -> int:
        """Number of fitted parameters."""
        raise NotImplementedError

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """The effects that the model removes, in order."""
        return ()

    @property
    def conditions(self) -> tuple[str, ...]:
        """Names of the model's inputs other than the rate: ``temperature``, ``force``."""
        return ()

    @property
    def made_for_hz(self) -> float | None:
        """The sampling rate in Hz that the model was made for; None for any."""
        return None

    @property
    def delay_s(self) -> float:
        """Seconds by which an answer comes late."""
        return 0.0

    @property
    def session_s(self) -> float | None:
        """Duration in s of the session if the model is valid only in that session's time; None otherwise."""
        return None

    def at_end(self) -> Model:
        """The same for any time, as it stood at its session's end."""
        return self

    def __call__(self, rate: Any) -> Any:
        """Calibrated rate (..., 3) rad/s from the measured one, for a kind that needs only rates."""
        raise CalibrationError(f"a model of kind {self.kind} needs whole samples, not rates alone; use calibrate")

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log, each at its own sample; samples with the pre-calibrated force; began_s: session time at the
        log's start; live: causal, without smoothing of the temperature."""
        return self.undelayed(samples.gyro)

    def stream(self, rate_hz: float | None) -> Stream | None:
        """Function that calibrates a log piece by piece, of a kind without memory; None for one that needs whole samples."""
        return (lambda rate, temp_c: self(rate)) if self.rates_only else None

    def undelayed(self, rate: Any) -> Any:
        """The model's output (N, 3) rad/s for measured rates (N, 3), with its delay removed."""
        return self(rate)

    def without_denoiser(self) -> Model:
        """The calibration alone."""
        return self

    def with_bias_moved(self, change: np.ndarray) -> Self:
        """The model with its calibrated rate increased by ``change`` (3,) rad/s everywhere.  Raises CalibrationError if it has no bias."""
        raise CalibrationError("the stored model is of a kind whose bias cannot be moved; give a linear model or a TinyGC-Net")
