"""The further kinds of the calibration subnet as JSON: the authors' published one, and the one with conditions."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from session.common.errors import FormatError
from tinygc.models.published_net import SHAPES, PublishedNet

EQUATIONS = {
    "tinygc_published": "h = P1(W1 @ m + b1); omega = m + P2(W2 @ h + b2), P(x) = x if x >= 0 else slope * x, m the measured rate in rad/s",
    "tinygc_conditions": "omega = net(m) + bias @ c + m * (gain @ c), c: temperature less conditions.first_temp_c in degC, force in g",
}


def published_to_dict(net: PublishedNet) -> dict:
    """JSON-ready."""
    weights = {name: np.asarray(getattr(net, name)).tolist() for name in SHAPES}
    return {"kind": "tinygc_published", "equation": EQUATIONS["tinygc_published"], "weights": weights}


def published_from_dict(table: dict, where: str) -> PublishedNet:
    """The net; FormatError says what is wrong with the table."""
    return PublishedNet(**{name: _array(table.get("weights"), name, shape, f"{where}: weights") for name, shape in SHAPES.items()})


def conditions_to_dict(model) -> dict:
    """JSON-ready, of a ``ConditionsModel``."""
    from tinygc.models.files import to_dict

    known = {name: value if np.isfinite(value) else None for name, value in asdict(model.known).items()}
    weights = {name: np.asarray(getattr(model.net, name)).tolist() for name in ("bias", "gain")}
    return {
        "kind": "tinygc_conditions",
        "equation": EQUATIONS["tinygc_conditions"],
        "inputs": list(model.net.names),
        "conditions": known,
        "weights": weights,
        "net": to_dict(model.net.net),
    }


def conditions_from_dict(table: dict, where: str, model_from_dict):
    """The model; FormatError says what is wrong with the table."""
    from tinygc.effects import Conditions
    from tinygc.models.calibration_net import CalibrationNet
    from tinygc.models.conditions_net import CONDITIONS, ConditionsModel, ConditionsNet

    names = table.get("inputs")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name in CONDITIONS for name in names):
        raise FormatError(f"{where}: inputs are {names!r}, expected some of {', '.join(CONDITIONS)}")
    count = sum(CONDITIONS[name][0] for name in names)
    weights = {name: _array(table.get("weights"), name, (3, count), f"{where}: weights") for name in ("bias", "gain")}
    try:
        known = Conditions(**{name: float("nan") if value is None else float(value) for name, value in table["conditions"].items()})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FormatError(f"{where}: the conditions cannot be read: {error}") from None
    net = model_from_dict(table.get("net"), f"{where}: net")
    if not isinstance(net, CalibrationNet):
        raise FormatError(f"{where}: net is of another kind, expected tinygc")
    return ConditionsModel(ConditionsNet(net, weights["bias"], weights["gain"], tuple(names)), known)


def _array(weights, name: str, shape: tuple[int, ...], where: str) -> np.ndarray:
    try:
        array = np.asarray(weights[name], dtype=float)
    except (KeyError, TypeError, ValueError):
        raise FormatError(f"{where}.{name} is missing or not made of numbers") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise FormatError(f"{where}.{name} has shape {array.shape}, expected {shape} of finite numbers")
    return array
