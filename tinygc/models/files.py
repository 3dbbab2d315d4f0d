"""Calibrations as files: JSON that says what it means, and whose loading executes nothing."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.files.results import read_json
from tinygc.models import network_files
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import LinearModel
from tinygc.models.published_net import PublishedNet

SCHEMA, UNITS = "tinygc-model/1", "rad/s in, rad/s out"
EQUATIONS = {
    "linear": "omega = E @ m + B, m the measured rate in rad/s",
    "tinygc": "h = W1 @ m + b1; omega = m + W2 @ (h if h >= 0 else slope * h) + b2, m the measured rate in rad/s",
}


def to_dict(model: LinearModel | CalibrationNet, **more) -> dict:
    """JSON-ready, with schema, equation and units; ``more`` is added as it is."""
    writer = _writer(model)
    if writer is not None:
        return {"schema": SCHEMA, "units": UNITS, **writer(model), **more}
    kind = "tinygc" if isinstance(model, CalibrationNet) else "linear"
    weights = {field.name: np.asarray(getattr(model, field.name)).tolist() for field in fields(model)}
    return {"schema": SCHEMA, "kind": kind, "equation": EQUATIONS[kind], "units": UNITS, "weights": weights, **more}


def _writer(model):
    """What makes the table of a kind that is not plain weights."""
    if hasattr(model, "denoiser"):
        from tinygc.models.denoiser_files import denoised_to_dict

        return denoised_to_dict
    if isinstance(model, PublishedNet):
        return network_files.published_to_dict
    if hasattr(model, "known") and not hasattr(model, "claims"):
        return network_files.conditions_to_dict
    if hasattr(model, "calibrate"):
        from tinygc.models.physics_files import physics_to_dict

        return physics_to_dict
    return None


def from_dict(table: dict, where: str = "model") -> LinearModel | CalibrationNet:
    """The model; FormatError says what is wrong with the table."""
    if not isinstance(table, dict) or table.get("schema") != SCHEMA:
        raise FormatError(f'{where}: no model of this tool, expected "schema": "{SCHEMA}"')
    if (units := table.get("units", UNITS)) != UNITS:
        raise FormatError(f'{where}: units are {units!r}, expected "{UNITS}"; convert the numbers, or fit again')
    kind = table.get("kind")
    if kind in ("physics", "tinygc_physics"):
        from tinygc.models.physics_files import physics_from_dict

        return physics_from_dict(table, where, from_dict)
    if kind == "tinygc_denoised":
        from tinygc.models.denoiser_files import denoised_from_dict

        return denoised_from_dict(table, where, from_dict)
    if kind == "tinygc_published":
        return network_files.published_from_dict(table, where)
    if kind == "tinygc_conditions":
        return network_files.conditions_from_dict(table, where, from_dict)
    cls = {"linear": LinearModel, "tinygc": CalibrationNet}.get(kind) if isinstance(kind, str) else None
    if cls is None:
        raise FormatError(f"{where}: kind is {kind!r}, expected linear or tinygc")
    shapes = {"E": (3, 3), "W1": (3, 3), "W2": (3, 3)}
    weights = {}
    for field in fields(cls):
        try:
            array = np.asarray(table["weights"][field.name], dtype=float)
        except (KeyError, TypeError, ValueError):
            raise FormatError(f"{where}: weights.{field.name} is missing or not made of numbers") from None
        if array.shape != shapes.get(field.name, (3,)) or not np.isfinite(array).all():
            raise FormatError(f"{where}: weights.{field.name} has shape {array.shape} or is not finite")
        weights[field.name] = array
    return cls(**weights)


def load(path: Path | str) -> LinearModel | CalibrationNet:
    """Read a model file."""
    table = read_json(Path(path))
    try:
        return from_dict(table, str(path))
    except RecursionError:
        raise FormatError(f"{path}: models nested too deeply, expected at most a model within a model") from None
