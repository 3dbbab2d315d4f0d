"""TinyGC-Net that is told temperature or force, as JSON: the net's own table, and how the conditions move it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from session.common.errors import FormatError
from tinygc.effects.conditions import Conditions
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.conditions_net import CONDITIONS, ConditionsModel, ConditionsNet
from tinygc.models.kinds.weights import array

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
    names = table.get("inputs")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name in CONDITIONS for name in names):
        raise FormatError(f"{where}: inputs are {names!r}, expected some of {', '.join(CONDITIONS)}")
    count = sum(CONDITIONS[name][0] for name in names)
    weights = {name: array(table.get("weights"), name, (3, count), f"{where}: weights") for name in ("bias", "gain")}
    try:
        known = Conditions(**{name: float("nan") if value is None else float(value) for name, value in table["conditions"].items()})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FormatError(f"{where}: the conditions cannot be read: {error}") from None
    net = read(table.get("net"), f"{where}: net")
    if not isinstance(net, CalibrationNet):
        raise FormatError(f"{where}: net is of another kind, expected tinygc")
    return ConditionsModel(ConditionsNet(net, weights["bias"], weights["gain"], tuple(names)), known)
