"""Several units as one gyroscope: weights, fused rate, and the file format ``tinygc-array-model/1``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.numeric import sigmas_in
from session.base.records import record_from, record_of, table_of
from session.base.results import Array, Keys, Maybe, Number, Text, read_json, require_schema, shown
from session.log.config import OWN_UNITS, Accelerometer, Sensor
from tinygc.features.arrays.clocks import UnitClock, UnitPlace
from tinygc.features.arrays.feature import MOST_UNITS
from tinygc.features.arrays.names import SCHEMA
from tinygc.models.files import UNITS
from tinygc.models.linear import LinearModel
from tinygc.models.model import (
    ACCELEROMETER,
    COVARIANCE,
    FACTOR,
    MATRIX,
    RATE,
    ROUNDING,
    SECONDS,
    certain,
    covariance,
    sensor_table,
)

# The best linear unbiased combination of units that measure one rate (Gauss and Markov; Aitken for correlated noise).
#
#     omega = sum_i W_i x_i,   sum_i W_i = I,   W = (A^T Q^-1 A)^-1 A^T Q^-1,   covariance (A^T Q^-1 A)^-1
#
# x_i is a unit's calibrated rate in the array's frame, Q the noise covariance of all of them, A identities stacked vertically.

#: ratio of eigenvalues to the largest one below which a covariance is singular
SINGULAR = 1e-12


def best_weights(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``(weights (N, 3, 3), covariance of the combination (3, 3))`` for a noise covariance (3 N, 3 N) of the units, unit by unit.

    Raises CalibrationError where the covariance is singular.  Weights may be negative where noise is correlated.
    """
    count = len(covariance) // 3
    scale = sigmas_in(covariance)
    if not (scale > 0).all():
        raise CalibrationError("a unit's noise is 0: no best combination; give the noise of every axis")
    whitened = covariance / np.outer(scale, scale)
    if np.linalg.eigvalsh(whitened)[0] <= SINGULAR:
        raise CalibrationError("the units' noise covariance is singular (two units with the same noise): no best combination")
    stacked = np.tile(np.eye(3), (count, 1)) / scale[:, None]
    solved = np.linalg.solve(whitened, stacked)  # of Q^-1 A, its rows times their scale
    fused = np.linalg.inv(stacked.T @ solved)
    fused = (fused + fused.T) / 2
    weights = fused @ (solved / scale[:, None]).T
    weights = weights.reshape(3, count, 3).transpose(1, 0, 2)
    return weights, fused


def combined(weights: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return (3, 3), the covariance of a combination by any weights (N, 3, 3) of units with covariance (3 N, 3 N)."""
    row = weights.transpose(1, 0, 2).reshape(3, -1)
    return row @ covariance @ row.T


def divisible(weights: np.ndarray, fused: np.ndarray) -> bool:
    """Return whether the weights of any subset can be renormalised: ``fused^-1 W_i``, a unit's information, is positive for each.

    Sums of such matrices have a positive symmetric part, so they can be inverted.
    """
    information = np.linalg.solve(fused, weights)
    return bool(np.linalg.eigvalsh((information + information.transpose(0, 2, 1)) / 2).min() > 0)


def blocks(matrices: np.ndarray) -> np.ndarray:
    """Return (N k, N k) with matrices (N, k, k) along the diagonal."""
    count, size, _ = matrices.shape
    whole = np.zeros((count, size, count, size))
    whole[np.arange(count), :, np.arange(count), :] = matrices
    return whole.reshape(count * size, count * size)


# Several units as one gyroscope: each unit's model and noise, and the best linear combination.
#
#     omega = sum_i W_i R_i (E_i m_i + B_i),   sum_i W_i = I
#
# m_i is the rate that unit i measures (register x sensitivity, rad/s), R_i its mounting, omega the rate in the array's frame.

EQUATION = "omega = sum_i weights_i @ mounting_i @ (E_i @ m_i + B_i), m_i the measured rate of unit i in rad/s"
#: noise for which the weights can be optimal
WHITE, INSTABILITY = "white", "instability"


@dataclass(frozen=True, eq=False)
class FusedUnit:
    """One unit of the fused gyroscope.

    place (number, clock, mounting, position); model, omega = E m + B in its own body frame; sensor; accelerometer, None where it is
    uncalibrated; noise_density (3,) rad/s/sqrt(Hz), one-sided, of its own axes; bias_instability (3,) rad/s, None where it is not known;
    covariance (12, 12) of E row by row, then B, rad/s, None where it is not known; accel_noise_density m/s^2/sqrt(Hz); sha256 of the logs
    that it was fitted to.
    """

    place: UnitPlace
    model: LinearModel
    noise_density: np.ndarray
    bias_instability: np.ndarray | None = None
    covariance: np.ndarray | None = None
    sensor: Sensor | None = None
    accelerometer: Accelerometer | None = None
    accel_noise_density: float | None = None
    sha256: tuple[str, ...] = ()

    @property
    def number(self) -> int:
        """Return the unit's number, as its files name it."""
        return self.place.number

    @cached_property
    def matrix(self) -> np.ndarray:
        """Return (3, 3), which takes the measured rate to the array's frame."""
        return self.place.mounting @ self.model.E

    @cached_property
    def offset(self) -> np.ndarray:
        """Return (3,) rad/s in the array's frame."""
        return self.place.mounting @ self.model.B

    def in_array(self, per_axis: np.ndarray) -> np.ndarray:
        """Return the covariance (3, 3) in the array's frame of independent noise with sigmas (3,) on the unit's own axes."""
        return self.matrix @ np.diag(np.square(per_axis)) @ self.matrix.T

    def parameter_columns(self, rate: np.ndarray) -> np.ndarray:
        """Return (3, 12): derivatives by E and B of the rate in the array's frame, at a true rate (3,) rad/s there."""
        measured = np.linalg.solve(self.model.E, self.place.mounting.T @ rate - self.model.B)
        return self.place.mounting @ np.hstack([np.kron(np.eye(3), measured), np.eye(3)])


@dataclass(frozen=True, eq=False)
class ArrayModel:
    """Model of an array as one gyroscope.

    units; weights (N, 3, 3); rate_hz of the samples; best_for, ``white`` or ``instability``, and the reason; correlation (3 N, 3 N) of the
    units' white noise in the array's frame, None where it is independent; joint_covariance (12 N, 12 N) of all units' E and
    B, None where only the units' own are known; session it comes from.
    """

    units: tuple[FusedUnit, ...]
    weights: np.ndarray
    rate_hz: float
    best_for: str = WHITE
    reason: str = ""
    correlation: np.ndarray | None = None
    joint_covariance: np.ndarray | None = None
    session: str = ""

    def __len__(self) -> int:
        return len(self.units)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the units' numbers."""
        return tuple(unit.number for unit in self.units)

    @cached_property
    def density(self) -> np.ndarray:
        """Return (3 N, 3 N) (rad/s)^2/Hz, one-sided: the white noise of all units in the array's frame."""
        return white_covariance(self.units, self.correlation)

    @cached_property
    def fused_density(self) -> np.ndarray:
        """Return (3, 3) (rad/s)^2/Hz, one-sided, of the combination."""
        return combined(self.weights, self.density)

    @property
    def best_covariance(self) -> np.ndarray:
        """Return the covariance (3, 3) of the combination for the noise ``best_for``; of white noise where no bias instability is known."""
        wander = instability_covariance(self.units)
        return self.fused_density if self.best_for == WHITE or wander is None else combined(self.weights, wander)

    @property
    def noise_density(self) -> np.ndarray:
        """Return (3,) rad/s/sqrt(Hz), one-sided, of the combination."""
        return sigmas_in(self.fused_density)

    @property
    def bias_instability(self) -> np.ndarray | None:
        """Return (3,) rad/s of the combination, with independent units; None where a unit's is not known."""
        wander = instability_covariance(self.units)
        return None if wander is None else sigmas_in(combined(self.weights, wander))

    def parameter_sigma(self, rate: np.ndarray | None = None) -> np.ndarray | None:
        """Return (3,) rad/s, the combination's sigma from the parameters' uncertainty at a true rate (3,) rad/s, at rest by default.

        None where a unit's covariance is not known.
        """
        rate = np.zeros(3) if rate is None else rate
        columns = np.stack([unit.parameter_columns(rate) for unit in self.units])
        row = (self.weights @ columns).transpose(1, 0, 2).reshape(3, -1)
        if self.joint_covariance is not None:
            return sigmas_in(row @ self.joint_covariance @ row.T)
        own = [unit.covariance for unit in self.units]
        if any(each is None for each in own):
            return None
        return sigmas_in(row @ blocks(np.stack([each for each in own if each is not None])) @ row.T)

    def __call__(self, measured: np.ndarray) -> np.ndarray:
        """Combine all units' measured rates (..., N, 3) rad/s of the same times into (..., 3) rad/s in the array's frame."""
        return np.einsum("nij,...nj->...i", self.weights @ self.matrices, measured) + np.einsum("nij,nj->i", self.weights, self.offsets)

    @cached_property
    def matrices(self) -> np.ndarray:
        """Return (N, 3, 3) of ``FusedUnit.matrix``."""
        return np.stack([unit.matrix for unit in self.units])

    @cached_property
    def offsets(self) -> np.ndarray:
        """Return (N, 3) rad/s of ``FusedUnit.offset``."""
        return np.stack([unit.offset for unit in self.units])


def white_covariance(units: tuple[FusedUnit, ...], correlation: np.ndarray | None = None) -> np.ndarray:
    """Return (3 N, 3 N) (rad/s)^2/Hz of the units' white noise in the array's frame; correlation (3 N, 3 N) between units, None for
    none."""
    whole = blocks(np.stack([unit.in_array(unit.noise_density) for unit in units]))
    if correlation is None:
        return whole
    sigma = sigmas_in(whole)
    return correlation * np.outer(sigma, sigma)


def instability_covariance(units: tuple[FusedUnit, ...]) -> np.ndarray | None:
    """Return (3 N, 3 N) (rad/s)^2 of the units' bias instability in the array's frame; None where a unit's is not known."""
    known = [unit.in_array(unit.bias_instability) for unit in units if unit.bias_instability is not None]
    return blocks(np.stack(known)) if len(known) == len(units) else None


# File of an array's model, ``tinygc-array-model/1`` (docs/formats.md); loading executes nothing.

#: largest number of a unit (session/log/folder.py), and most units
LARGEST_NUMBER = 9999


def _rotation(matrix: np.ndarray) -> str:
    sound = np.abs(matrix @ matrix.T - np.eye(3)).max() < ROUNDING and np.linalg.det(matrix) > 0
    return "" if sound else "is no rotation, expected an orthogonal matrix that keeps a right-handed triad right-handed"


def _correlation(matrix: np.ndarray) -> str:
    if wrong := certain(matrix):
        return wrong
    return "" if np.abs(np.diag(matrix) - 1).max() < ROUNDING else "has a diagonal other than 1, expected a correlation"


class _OfSensor(Keys):
    """The table ``sensor`` of a unit."""

    written = staticmethod(sensor_table)

    def made(self, value: Any) -> Sensor:
        """Of a table that was checked."""
        return Sensor(**{"model": "", "serial": ""} | {key: each for key, each in super().made(value).items() if each is not None})


#: of a table of JSON: an offset that is missing is none
_CLOCK = replace(
    record_of(UnitClock),
    must=dict.fromkeys(("offset_s", "about_s"), SECONDS) | {"rate": Number(-0.5, 0.5)},
    may=dict.fromkeys(("offset_sigma_s", "rate_sigma"), Number(0)),
)
_SPACE = Array((3, 3), sound=covariance)
_SENSOR = _OfSensor(
    {"odr_hz": Number(0, above=True), "gyro_fs_dps": Number(0, above=True), "accel_fs_g": Number(0, above=True)},
    {"model": Maybe(Text()), "serial": Maybe(Text()), **dict.fromkeys(OWN_UNITS, Number())},
)
_SIGMAS = Array((3,), Number(0, RATE.high, above=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class UnitEntry:
    """One of ``units``, as ``FusedUnit``; weights (3, 3) of the unit."""

    number: Annotated[int, Number(0, LARGEST_NUMBER, whole=True)]
    E: Annotated[np.ndarray, MATRIX]
    B: Annotated[np.ndarray, Array((3,), RATE)]
    covariance: Annotated[np.ndarray | None, Array((12, 12), sound=covariance)] = None
    mounting: Annotated[np.ndarray, Array((3, 3), FACTOR, _rotation)]
    mounting_covariance: Annotated[np.ndarray, _SPACE] = field(default_factory=lambda: np.zeros((3, 3)))
    position_m: Annotated[np.ndarray | None, Array((3,), Number(-1e3, 1e3))] = None
    position_covariance: Annotated[np.ndarray | None, _SPACE] = None
    clock: Annotated[UnitClock, _CLOCK]
    noise_density_rps_rthz: Annotated[np.ndarray, _SIGMAS]
    bias_instability_rps: Annotated[np.ndarray | None, _SIGMAS] = None
    accel_noise_density_mps2_rthz: Annotated[float | None, Number(0, above=True)] = None
    weights: Annotated[np.ndarray, Array((3, 3), FACTOR)]
    sha256: tuple[str, ...] = ()
    sensor: Annotated[Sensor | None, _SENSOR] = None
    accelerometer: Annotated[Accelerometer | None, ACCELEROMETER] = None

    @classmethod
    def of(cls, unit: FusedUnit, weights: np.ndarray) -> UnitEntry:
        """The entry of a unit."""
        return cls(
            **vars(unit.place),
            E=unit.model.E,
            B=unit.model.B,
            covariance=unit.covariance,
            noise_density_rps_rthz=unit.noise_density,
            bias_instability_rps=unit.bias_instability,
            accel_noise_density_mps2_rthz=unit.accel_noise_density,
            weights=weights,
            sha256=unit.sha256,
            sensor=unit.sensor,
            accelerometer=unit.accelerometer,
        )

    @property
    def unit(self) -> FusedUnit:
        """The unit of an entry."""
        return FusedUnit(
            UnitPlace(**{name: getattr(self, name) for name in UnitPlace.__dataclass_fields__}),
            LinearModel(self.E, self.B),
            self.noise_density_rps_rthz,
            self.bias_instability_rps,
            self.covariance,
            self.sensor,
            self.accelerometer,
            self.accel_noise_density_mps2_rthz,
            self.sha256,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayFile:
    """``model_array.json``, as ``ArrayModel``; fused: of the combination, for people."""

    schema = SCHEMA
    version: str = VERSION
    equation: str = EQUATION
    rates: str = UNITS
    session: str = ""
    rate_hz: Annotated[float, Number(0, 1e6, above=True)]
    best_for: Annotated[str, Text((WHITE, INSTABILITY))]
    reason: str = ""
    units: tuple[UnitEntry, ...]
    noise_correlation: Annotated[np.ndarray | None, Array((None, None), Number(-1 - ROUNDING, 1 + ROUNDING), _correlation)] = None
    joint_covariance: Annotated[np.ndarray | None, COVARIANCE] = None
    fused: Annotated[Mapping[str, np.ndarray | None], Keys()] = field(default_factory=dict)


def to_table(model: ArrayModel) -> dict:
    """Return a JSON-ready table."""
    file = ArrayFile(
        session=model.session,
        rate_hz=model.rate_hz,
        best_for=model.best_for,
        reason=model.reason,
        units=tuple(map(UnitEntry.of, model.units, model.weights)),
        noise_correlation=model.correlation,
        joint_covariance=model.joint_covariance,
        fused={
            "noise_density_rps_rthz": model.noise_density,
            "bias_instability_rps": model.bias_instability,
            "bias_sigma_rps": model.parameter_sigma(),
        },
    )
    return table_of(file)


def load_array_model(path: Path | str) -> ArrayModel:
    """Read a model file.  Raises FormatError, in one line, for a file that is no array's model."""
    return from_table(read_json(Path(path)), str(path))


def from_table(table: Any, where: str = "array model") -> ArrayModel:
    """Return the model; raises FormatError, which describes the error in the table."""
    require_schema(table, SCHEMA, where)
    if (units := table.get("rates", UNITS)) != UNITS:
        raise FormatError(f'{where}: rates are {shown(units)}, expected "{UNITS}"; convert the numbers, or fit again')
    file = record_from(ArrayFile, table, where)
    count = len(file.units)
    if not 2 <= count <= MOST_UNITS:
        raise FormatError(f"{where}: units has {count} entries, expected 2 to {MOST_UNITS}; fit again")
    numbers = [entry.number for entry in file.units]
    if twice := next((number for number in numbers if numbers.count(number) > 1), None):
        raise FormatError(f"{where}: unit {twice} stands twice, expected each number once; fit again, or mend the file")
    for key, each in (("noise_correlation", 3), ("joint_covariance", 12)):
        matrix = getattr(file, key)
        if matrix is not None and matrix.shape != (each * count, each * count):
            raise FormatError(f"{where}: {key} has {len(matrix)} rows, expected {each * count}, {each} of each unit; fit again")
    weights = np.array([entry.weights for entry in file.units])
    if (off := np.abs(weights.sum(axis=0) - np.eye(3)).max()) > ROUNDING:
        raise FormatError(f"{where}: the units' weights miss identity by {off:.2g}, expected weights that sum to identity; fit again")
    model = ArrayModel(
        tuple(entry.unit for entry in file.units),
        weights,
        file.rate_hz,
        file.best_for,
        file.reason,
        file.noise_correlation,
        file.joint_covariance,
        file.session,
    )
    if not divisible(weights, model.best_covariance):
        raise FormatError(f"{where}: a unit's weights are not positive, so that they cannot be shared out when a unit is out; fit again")
    return model
