"""What every calibration offers, the accelerometer and sensor beside it, and the shapes of its file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from session.io.config import OWN_UNITS, Accelerometer, Sensor
from session.io.errors import CalibrationError
from session.io.results import Array, Keys, ListOf, MapOf, Maybe, Number, Text, require
from session.io.units import DEG, G

if TYPE_CHECKING:
    from session.io.samples import Samples
    from tinygc.effects.effect import AppliedEffect


# What the keys that all kinds of model share must hold, and the ranges that their numbers have (``session/io/results.py``).

#: of a factor on a rate or a force: even units that are mixed up, or mdps for dps, are within it
FACTOR = Number(-1e4, 1e4)
#: what no gyroscope and no accelerometer measures (session/io/units.py), rad/s and m/s^2
RATE, FORCE = Number(-1e5 * DEG, 1e5 * DEG), Number(-1e4 * G, 1e4 * G)
CELSIUS = Number(-1e4, 1e4)
SECONDS = Number(-1e9, 1e9)
#: of a matrix's smallest response to its largest: below, one of its axes lies within half a degree of the plane of the others
SINGULAR = 1e-2
#: of correlations
ROUNDING = 1e-6


def invertible(matrix: np.ndarray) -> str:
    """What is wrong with a matrix (3, 3) that must be undone; empty for none."""
    responses = np.linalg.svd(matrix, compute_uv=False)
    if responses[-1] <= SINGULAR * responses[0]:
        return "is singular, expected a matrix that keeps all three axes apart"
    return "mirrors the axes, expected a matrix that turns a right-handed triad into one" if np.linalg.det(matrix) < 0 else ""


def covariance(matrix: np.ndarray) -> str:
    """What is wrong with a covariance (n, n); empty for nothing."""
    if matrix.shape[0] != matrix.shape[1]:
        return f"has shape {matrix.shape[0]} x {matrix.shape[1]}, expected as many rows as columns"
    variance = np.diag(matrix)
    if (variance < 0).any():
        return "is not positive: it has a variance below 0; expected a covariance"
    sigma = np.sqrt(np.where(variance > 0, variance, 1.0))
    limit = np.outer(sigma, sigma)  # of sigmas: variances of 1e-300 have no product
    with np.errstate(over="ignore"):
        if (np.abs(matrix - matrix.T) > ROUNDING * limit).any():
            return "is not symmetric, expected a covariance"
    sound = (np.abs(matrix) <= (1 + ROUNDING) * limit).all() and np.linalg.eigvalsh(matrix / limit).min() > -ROUNDING
    return "" if sound else "is not positive, expected a covariance"


def certain(matrix: np.ndarray) -> str:
    """The same, where each of the numbers must be uncertain by something."""
    return covariance(matrix) or ("" if (np.diag(matrix) > 0).all() else "has a variance of 0, expected a covariance of uncertain numbers")


MATRIX = Array((3, 3), FACTOR, invertible)
COVARIANCE = Array((None, None), sound=covariance)
ORIGIN = {"method": Maybe(Text()), "session": Maybe(Text()), "sha256": Maybe(MapOf(Text()))}
#: beside what a kind has of its own
MODEL = Keys(
    may={
        **ORIGIN,
        "equation": Text(),
        "version": Text(),
        "covariance": Maybe(COVARIANCE),
        "covariance_of": ListOf(Text()),
        "covariance_units": Text(),
        "accelerometer_covariance": COVARIANCE,
        "joint_covariance": Maybe(
            Keys({"matrix": Array((None, None), sound=certain)}, {"parameters": ListOf(Text()), "shared": COVARIANCE})
        ),
        "unobserved": Maybe(ListOf(Text())),
        "bias_sigma_rps": Maybe(Array((3,), Number(0, RATE.high))),
        "began_s": MapOf(SECONDS),
        "stored": Maybe(Keys(may=ORIGIN)),
        "remaining_rps": Maybe(ListOf(Maybe(Number(0, RATE.high)))),
        "accel_change_mps2": Maybe(ListOf(Array((3,), FORCE))),
        "delay_s": SECONDS,
    }
)


# The accelerometer and the sensor that stand beside a calibration of rates in its file.

EQUATION = "f = matrix @ (measured - bias_mps2), m/s^2"
SOURCES = ("given", "prior", "stills", "none")
FULL_SCALES = ("gyro_fs_dps", "accel_fs_g")
_KEYS = Keys({"matrix": MATRIX, "bias_mps2": Array((3,), FORCE)}, {"source": Text(SOURCES), "equation": Text()})
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
    """``accelerometer`` of ``tinygc-model/1``."""
    return {
        "equation": EQUATION,
        "matrix": accelerometer.matrix.tolist(),
        "bias_mps2": accelerometer.bias_mps2.tolist(),
        "source": accelerometer.source,
    }


def accelerometer_of(table: dict, where: str = "model") -> Accelerometer | None:
    """That of a model file; None where it has none, or nobody has calibrated it.  FormatError for what is no calibration."""
    entry = table.get("accelerometer")
    if entry is None:
        return None
    require(table, Keys({"accelerometer": _KEYS}), where)
    matrix, bias = (np.asarray(entry[key], dtype=float) for key in ("matrix", "bias_mps2"))
    source = entry.get("source", "given")
    return None if source == "none" else Accelerometer(matrix, bias, source)


def sensor_table(sensor: Sensor) -> dict:
    """``sensor`` of ``tinygc-model/1``."""
    return {
        "model": sensor.model,
        "serial": sensor.serial,
        "odr_hz": sensor.odr_hz,
        "gyro_fs_dps": sensor.gyro_fs_dps,
        "accel_fs_g": sensor.accel_fs_g,
    } | {name: value for name, value in sensor.own_units.items() if value is not None}


@dataclass(frozen=True)
class KnownSensor:
    """What a model file says of its sensor's registers: full scales, model, units of its own (``OWN_UNITS``); None where it does not."""

    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None
    model: str | None = None
    own_units: dict[str, float | None] = field(default_factory=dict)


def sensor_of(table: dict, where: str = "model") -> KnownSensor:
    """That of a model file.  FormatError for what is no number."""
    entry = table.get("sensor")
    if entry is None:
        return KnownSensor()
    require(table, Keys({"sensor": _SENSOR}), where)
    gyro, accel = (entry.get(key) for key in FULL_SCALES)
    own: dict[str, float | None] = {key: float(entry[key]) for key in OWN_UNITS if entry.get(key) is not None}
    return KnownSensor(None if gyro is None else float(gyro), None if accel is None else float(accel), entry.get("model") or None, own)


# What every calibration offers, whatever kind it is of.


@runtime_checkable
class Model(Protocol):
    """A map from measured rates to calibrated ones.

    kind: its name in the model file (``tinygc/models/files.py``); pointwise: whether each rate is calibrated by itself, so that the model
    may be called on rates (..., 3) of NumPy or torch; rates_only: whether it needs nothing beside rates (a denoiser remembers some of
    them, and is called on (..., N, 3) in the order of time); parameters: how many numbers were fitted; undone: the effects that it takes
    off; conditions: names of what it is told beside the rate; made_for_hz: the sampling rate that it was made for, None for any; delay_s:
    by which its answers come late; session_s: seconds of its session, where it holds for that session's time alone, None for any time.
    """

    kind: ClassVar[str]
    pointwise: ClassVar[bool]
    rates_only: ClassVar[bool]

    def __call__(self, rate: Any) -> Any:
        """Calibrated rate (..., 3) rad/s from the measured one; CalibrationError of a kind that needs whole samples."""

    @property
    def parameters(self) -> int:
        """How many numbers were fitted."""

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """Effects that it takes off, in the order in which it does."""

    @property
    def conditions(self) -> tuple[str, ...]:
        """What it is told beside the rate."""

    @property
    def made_for_hz(self) -> float | None:
        """The sampling rate that it was made for; None for any."""

    @property
    def delay_s(self) -> float:
        """Seconds by which an answer comes late."""

    @property
    def session_s(self) -> float | None:
        """Seconds of the session whose time alone it holds for; None for any time."""

    def at_end(self) -> Model:
        """The same for any time, as it stood at its session's end."""

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log, each at its own sample; CalibrationError for other times than it holds for."""

    def stream(self, rate_hz: float | None) -> Callable[[np.ndarray, np.ndarray], np.ndarray] | None:
        """One log piece by piece, from rates (N, 3) rad/s and temperatures (N,) degC to calibrated rates, of a kind that remembers what it
        needs of earlier pieces; None of the others.  CalibrationError where it needs the data rate and has none."""

    def undelayed(self, rate: Any) -> Any:
        """Its answer (N, 3) rad/s to measured rates (N, 3), each at the sample that it belongs to."""

    def without_denoiser(self) -> Model:
        """The calibration alone."""

    def with_bias_moved(self, change: np.ndarray) -> Model:
        """The same model, its calibrated rate greater by ``change`` (3,) rad/s everywhere."""


class BaseModel:
    """What most kinds have in common; a kind overrides what is otherwise with it."""

    kind: ClassVar[str]
    pointwise: ClassVar[bool] = True
    rates_only: ClassVar[bool] = True

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """Effects that the model takes off, in the order in which it does."""
        return ()

    @property
    def conditions(self) -> tuple[str, ...]:
        """What the model is told beside the rate: ``temperature``, ``force``."""
        return ()

    @property
    def made_for_hz(self) -> float | None:
        """The sampling rate that the model was made for; None for any."""
        return None

    @property
    def delay_s(self) -> float:
        """Seconds by which an answer comes late."""
        return 0.0

    @property
    def session_s(self) -> float | None:
        """Seconds of the session whose time alone the model holds for; None for any time."""
        return None

    def at_end(self) -> Model:
        """The same for any time, as it stood at its session's end."""
        return self  # type: ignore[return-value]

    def __call__(self, rate: Any) -> Any:
        """Calibrated rate (..., 3) rad/s from the measured one; only of a kind that is pointwise or has a memory of rates alone."""
        raise CalibrationError(f"a model of kind {self.kind} needs whole samples, not rates alone; use calibrate")

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log, each at its own sample; samples with the pre-calibrated force; began_s of the session when
        the log began; live: only the past is known, and the temperature is taken as it comes."""
        return self.undelayed(samples.gyro)

    def stream(self, rate_hz: float | None) -> Callable[[np.ndarray, np.ndarray], np.ndarray] | None:
        """None: most kinds need whole samples, or nothing of earlier ones."""
        return None

    def undelayed(self, rate: Any) -> Any:
        """The model's answer (N, 3) rad/s to measured rates (N, 3), each at the sample that it belongs to."""
        return self(rate)

    def without_denoiser(self) -> Model:
        """The calibration alone."""
        return self  # type: ignore[return-value]

    def with_bias_moved(self, change: np.ndarray) -> Self:
        """The same model, its calibrated rate greater by ``change`` (3,) rad/s everywhere.  CalibrationError where it has no such bias."""
        raise CalibrationError("the stored model is of a kind whose bias cannot be moved; give a linear model or a TinyGC-Net")
