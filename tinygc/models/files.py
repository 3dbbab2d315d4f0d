"""Calibrations as files: self-describing JSON; loading executes no code.

A kind is a line in ``KINDS`` and a module with two functions: ``to_table(model, write)`` returns the keys of the kind, arrays and records
as they are, ``from_table(table, where, read)`` the model; ``write`` and ``read`` handle a model within the model.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from session.base import features
from session.base.errors import FormatError
from session.base.records import plain
from session.base.results import read_json, require, require_schema, shown
from tinygc.models.model import MODEL, Model, accelerometer_of, sensor_of

SCHEMA, UNITS = "tinygc-model/1", "rad/s in, rad/s out"
#: kinds whose covariance has exactly one row per parameter
ALL_COVARIED = ("linear", "physics")
#: kind in the file -> its module, imported on first use
KINDS = {
    "linear": "tinygc.models.nets",
    "tinygc": "tinygc.models.nets",
    "tinygc_denoised": "tinygc.models.denoiser",
    "physics": "tinygc.models.physics",
    "tinygc_physics": "tinygc.models.physics",
}


def to_dict(model: Model, **more: Any) -> dict:
    """Convert to a JSON-ready table with schema, kind, equation and units; ``more`` is added."""
    return plain({"schema": SCHEMA, "kind": model.kind, "units": UNITS, **_module(model.kind).to_table(model, to_dict), **more})


def from_dict(table: Any, where: str = "model") -> Model:
    """Read a model of any kind from its table.  Raises FormatError for an invalid table."""
    require_schema(table, SCHEMA, where)
    if (units := table.get("units", UNITS)) != UNITS:
        raise FormatError(f'{where}: units are {shown(units)}, expected "{UNITS}"; convert the numbers, or fit again')
    kind = table.get("kind")
    module = _module(kind) if isinstance(kind, str) else None
    if module is None:
        known = ", ".join((*KINDS, *features.names("kinds")))
        raise FormatError(f"{where}: kind is {shown(kind)}, expected one of {known}; fit again")
    require(table, MODEL, where)
    return module.from_table(table, where, from_dict)


def load(path: Path | str) -> Model:
    """Read a model file.  Raises FormatError, with a message of one line, for anything else."""
    return load_with_table(path)[0]


def load_with_table(path: Path | str) -> tuple[Model, dict]:
    """Read a model and the full table of its file (covariance, hashes of its sources, …)."""
    table, where = read_json(Path(path)), str(path)
    try:
        model = from_dict(table, where)
    except RecursionError:
        raise FormatError(f"{path}: models nested too deeply, expected at most a model within a model") from None
    if model.kind in ALL_COVARIED and (rows := len(table.get("covariance") or ())) not in (0, model.parameters):
        raise FormatError(f"{where}: covariance has {rows} rows, expected {model.parameters}, one for each parameter; fit again")
    accelerometer_of(table, where)
    sensor_of(table, where)
    return model, table


def _module(kind: str) -> Any:
    return importlib.import_module(KINDS[kind]) if kind in KINDS else features.named("kinds", kind)
