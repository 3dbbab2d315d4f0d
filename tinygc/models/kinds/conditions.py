"""TinyGC-Net that is told temperature or force, as JSON: the net's own table, and how the conditions move it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from session.common.errors import FormatError
from session.files.shapes import Array, Keys, ListOf, Text, require
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.conditions_net import CONDITIONS, ConditionsModel, ConditionsNet
from tinygc.models.kinds.known import CONDITIONS_TABLE, known_of
from tinygc.models.shapes import FACTOR

EQUATION = "omega = net(m) + bias @ c + m * (gain @ c), c: temperature less conditions.first_temp_c in degC, force in g"


def to_table(model: ConditionsModel, write: Callable[..., dict]) -> dict:
    """equation, inputs by name, what they refer to, bias and gain (3, K), and the net."""
    return {
        "equation": EQUATION,
        "inputs": list(model.net.names),
        "conditions": {name: value if np.isfinite(value) else None for name, value in asdict(model.known).items()},
        "weights": {name: np.asarray(getattr(model.net, name)).tolist() for name in ("bias", "gain")},
        "net": write(model.net.net),
    }


def from_table(table: dict, where: str, read: Callable[..., Any]) -> ConditionsModel:
    """The model; FormatError says what is wrong with the table."""
    require(table, Keys({"inputs": ListOf(Text(tuple(CONDITIONS))), "conditions": CONDITIONS_TABLE}), where)
    names = tuple(table["inputs"])
    if not names or len(set(names)) < len(names):
        raise FormatError(f"{where}: inputs name {len(names)} conditions, expected each of {', '.join(CONDITIONS)} once at most; fit again")
    count = sum(CONDITIONS[name][0] for name in names)
    require(table, Keys({"weights": Keys({name: Array((3, count), FACTOR) for name in ("bias", "gain")})}), where)
    bias, gain = (np.asarray(table["weights"][name], dtype=float) for name in ("bias", "gain"))
    known = known_of(table, {"temperature"} & set(names), where)
    net = read(table.get("net"), f"{where}: net")
    if not isinstance(net, CalibrationNet):
        raise FormatError(f"{where}: net is of another kind, expected tinygc")
    return ConditionsModel(ConditionsNet(net, bias, gain, names), known)
