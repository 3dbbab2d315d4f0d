"""An array's model as a file, ``tinygc-array-model/1`` (docs/formats.md); loading executes nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from session.common.errors import FormatError
from session.common.version import VERSION
from session.files.results import read_json
from session.files.shapes import Array, Keys, ListOf, Maybe, Number, Text, require, shown
from session.log.config import Sensor
from tinygc.array.fused.model import EQUATION, INSTABILITY, WHITE, ArrayModel, Disagreement, FusedUnit
from tinygc.array.fused.weights import divisible
from tinygc.array.places.place import UnitClock, UnitPlace
from tinygc.models.accelerometer import accelerometer_of, accelerometer_table, sensor_table
from tinygc.models.linear import LinearModel
from tinygc.models.shapes import COVARIANCE, FACTOR, MATRIX, RATE, SECONDS, certain, covariance

SCHEMA, UNITS = "tinygc-array-model/1", "rad/s in, rad/s out"
#: of a rotation, and of weights that sum to identity
ROUNDING = 1e-6
#: the greatest number of a unit (session/log/array_names.py), and of units
LARGEST_NUMBER, MOST_UNITS = 9999, 64


def _rotation(matrix: np.ndarray) -> str:
    sound = np.abs(matrix @ matrix.T - np.eye(3)).max() < ROUNDING and np.linalg.det(matrix) > 0
    return "" if sound else "is no rotation, expected an orthogonal matrix that keeps a right-handed triad right-handed"


def _correlation(matrix: np.ndarray) -> str:
    if wrong := certain(matrix):
        return wrong
    return "" if np.abs(np.diag(matrix) - 1).max() < ROUNDING else "has a diagonal other than 1, expected a correlation"


_SIGMA = Number(0, RATE.high)
_CLOCK = Keys(
    dict.fromkeys(("offset_s", "about_s"), SECONDS) | {"rate": Number(-0.5, 0.5)},
    dict.fromkeys(("offset_sigma_s", "rate_sigma"), Number(0)),
)
_SPACE = Array((3, 3), sound=covariance)
_SENSOR = Keys(
    {"odr_hz": Number(0, above=True), "gyro_fs_dps": Number(0, above=True), "accel_fs_g": Number(0, above=True)},
    {"model": Maybe(Text()), "serial": Maybe(Text())},
)
_UNIT = Keys(
    {
        "number": Number(0, LARGEST_NUMBER, whole=True),
        "E": MATRIX,
        "B": Array((3,), RATE),
        "mounting": Array((3, 3), FACTOR, _rotation),
        "clock": _CLOCK,
        "noise_density_rps_rthz": Array((3,), Number(0, RATE.high, above=True)),
        "weights": Array((3, 3), FACTOR),
    },
    {
        "mounting_covariance": _SPACE,
        "position_m": Maybe(Array((3,), Number(-1e3, 1e3))),
        "position_covariance": Maybe(_SPACE),
        "bias_instability_rps": Maybe(Array((3,), Number(0, RATE.high, above=True))),
        "covariance": Maybe(Array((12, 12), sound=covariance)),
        "accel_noise_density_mps2_rthz": Maybe(Number(0, above=True)),
        "sensor": Maybe(_SENSOR),
        "sha256": ListOf(Text()),
    },
)
SHAPE = Keys(
    {"rate_hz": Number(0, 1e6, above=True), "units": ListOf(_UNIT), "best_for": Text((WHITE, INSTABILITY))},
    {
        "reason": Text(),
        "session": Text(),
        "version": Text(),
        "noise_correlation": Maybe(Array((None, None), Number(-1 - ROUNDING, 1 + ROUNDING), _correlation)),
        "joint_covariance": Maybe(COVARIANCE),
        "disagreement": Keys({"bias_rps": _SIGMA, "scale": Number(0, 10), "delay_s": Number(0, 10)}),
    },
)


def to_table(model: ArrayModel) -> dict:
    """JSON-ready."""
    wander, own = model.bias_instability, model.parameter_sigma()
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "equation": EQUATION,
        "rates": UNITS,
        "session": model.session,
        "rate_hz": model.rate_hz,
        "best_for": model.best_for,
        "reason": model.reason,
        "units": [_unit_table(unit, weights) for unit, weights in zip(model.units, model.weights, strict=True)],
        "noise_correlation": _listed(model.correlation),
        "joint_covariance": _listed(model.joint_covariance),
        "disagreement": {
            "bias_rps": model.disagreement.bias_rps,
            "scale": model.disagreement.scale,
            "delay_s": model.disagreement.delay_s,
        },
        "fused": {
            "noise_density_rps_rthz": model.noise_density.tolist(),
            "bias_instability_rps": _listed(wander),
            "bias_sigma_rps": _listed(own),
        },
    }


def _listed(array: np.ndarray | None) -> list | None:
    return None if array is None else np.asarray(array).tolist()


def _unit_table(unit: FusedUnit, weights: np.ndarray) -> dict:
    place, clock = unit.place, unit.place.clock
    table = {
        "number": unit.number,
        "E": unit.model.E.tolist(),
        "B": unit.model.B.tolist(),
        "covariance": _listed(unit.covariance),
        "mounting": place.mounting.tolist(),
        "mounting_covariance": place.mounting_covariance.tolist(),
        "position_m": _listed(place.position_m),
        "position_covariance": _listed(place.position_covariance),
        "clock": {
            "offset_s": clock.offset_s,
            "rate": clock.rate,
            "about_s": clock.about_s,
            "offset_sigma_s": clock.offset_sigma_s,
            "rate_sigma": clock.rate_sigma,
        },
        "noise_density_rps_rthz": np.asarray(unit.noise_density).tolist(),
        "bias_instability_rps": _listed(unit.bias_instability),
        "accel_noise_density_mps2_rthz": unit.accel_noise_density,
        "weights": weights.tolist(),
        "sha256": list(unit.sha256),
    }
    table["sensor"] = None if unit.sensor is None else sensor_table(unit.sensor)
    table["accelerometer"] = None if unit.accelerometer is None else accelerometer_table(unit.accelerometer)
    return table


def load_array_model(path: Path | str) -> ArrayModel:
    """Read a file.  FormatError, in one line, for what is no array's model."""
    return from_table(read_json(Path(path)), str(path))


def is_array_model(path: Path) -> bool:
    """Whether a file is an array's model by its schema; what cannot be read is none."""
    try:
        table = read_json(path) if path.is_file() else None
    except (FormatError, OSError):
        return False
    return isinstance(table, dict) and table.get("schema") == SCHEMA


def from_table(table: Any, where: str = "array model") -> ArrayModel:
    """The model; FormatError says what is wrong with the table."""
    if not isinstance(table, dict) or table.get("schema") != SCHEMA:
        raise FormatError(f'{where}: no array\'s model of this tool, expected "schema": "{SCHEMA}"')
    if (units := table.get("rates", UNITS)) != UNITS:
        raise FormatError(f'{where}: rates are {shown(units)}, expected "{UNITS}"; convert the numbers, or fit again')
    require(table, SHAPE, where)
    count = len(table["units"])
    if not 2 <= count <= MOST_UNITS:
        raise FormatError(f"{where}: units has {count} entries, expected 2 to {MOST_UNITS}; fit again")
    numbers = [entry["number"] for entry in table["units"]]
    if twice := next((number for number in numbers if numbers.count(number) > 1), None):
        raise FormatError(f"{where}: unit {twice} stands twice, expected each number once; fit again, or mend the file")
    for key, each in (("noise_correlation", 3), ("joint_covariance", 12)):
        if table.get(key) is not None and np.shape(table[key]) != (each * count, each * count):
            raise FormatError(f"{where}: {key} has {len(table[key])} rows, expected {each * count}, {each} of each unit; fit again")
    weights = np.array([entry["weights"] for entry in table["units"]], dtype=float)
    if (off := np.abs(weights.sum(axis=0) - np.eye(3)).max()) > ROUNDING:
        raise FormatError(f"{where}: the units' weights miss identity by {off:.2g}, expected weights that sum to identity; fit again")
    model = ArrayModel(
        tuple(_unit(entry, f"{where}: units[{i}]") for i, entry in enumerate(table["units"])),
        weights,
        float(table["rate_hz"]),
        table["best_for"],
        table.get("reason", ""),
        _array(table.get("noise_correlation")),
        Disagreement(**{key: float(value) for key, value in table["disagreement"].items()}) if "disagreement" in table else Disagreement(),
        _array(table.get("joint_covariance")),
        table.get("session", ""),
    )
    if not divisible(weights, model.best_covariance):
        raise FormatError(f"{where}: a unit's weights are not positive, so that they cannot be shared out when a unit is out; fit again")
    return model


def _array(value: Any) -> np.ndarray | None:
    return None if value is None else np.asarray(value, dtype=float)


def _unit(entry: dict, where: str) -> FusedUnit:
    clock = UnitClock(**{key: float(value) for key, value in entry["clock"].items() if key in UnitClock.__dataclass_fields__})
    turned = _array(entry.get("mounting_covariance"))
    place = UnitPlace(
        entry["number"],
        clock,
        np.asarray(entry["mounting"], dtype=float),
        np.zeros((3, 3)) if turned is None else turned,
        _array(entry.get("position_m")),
        _array(entry.get("position_covariance")),
    )
    noise = np.asarray(entry["noise_density_rps_rthz"], dtype=float)
    model = LinearModel(np.asarray(entry["E"], dtype=float), np.asarray(entry["B"], dtype=float))
    return FusedUnit(
        place,
        model,
        noise,
        _array(entry.get("bias_instability_rps")),
        _array(entry.get("covariance")),
        _sensor(entry.get("sensor")),
        accelerometer_of(entry, where),
        entry.get("accel_noise_density_mps2_rthz"),
        tuple(entry.get("sha256", ())),
    )


def _sensor(entry: dict | None) -> Sensor | None:
    if entry is None:
        return None
    own = {key: entry[key] for key in ("gyro_mdps_per_lsb", "accel_mg_per_lsb", "temp_lsb_per_c", "temp_at_zero_c") if key in entry}
    return Sensor(entry.get("model") or "", entry.get("serial") or "", entry["odr_hz"], entry["gyro_fs_dps"], entry["accel_fs_g"], **own)
