"""Kinds that are nothing but arrays of weights: the linear model, TinyGC-Net, and the net of the authors' published code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from session.common.errors import FormatError
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import LinearModel
from tinygc.models.published_net import PublishedNet

CLASSES: dict[str, Any] = {each.kind: each for each in (LinearModel, CalibrationNet, PublishedNet)}
EQUATIONS = {
    "linear": "omega = E @ m + B, m the measured rate in rad/s",
    "tinygc": "h = W1 @ m + b1; omega = m + W2 @ (h if h >= 0 else slope * h) + b2, m the measured rate in rad/s",
    "tinygc_published": "h = P1(W1 @ m + b1); omega = m + P2(W2 @ h + b2), P(x) = x if x >= 0 else slope * x, m the measured rate in rad/s",
}


def to_table(model: Any, write: Callable[..., dict]) -> dict:
    """equation, and the weights by name."""
    return {"equation": EQUATIONS[model.kind], "weights": {name: np.asarray(getattr(model, name)).tolist() for name in model.SHAPES}}


def from_table(table: dict, where: str, read: Callable[..., Any]) -> LinearModel | CalibrationNet | PublishedNet:
    """The model; FormatError says what is wrong with the table."""
    cls = CLASSES[table["kind"]]
    return cls(**{name: array(table.get("weights"), name, shape, f"{where}: weights") for name, shape in cls.SHAPES.items()})


def array(weights: Any, name: str, shape: tuple[int, ...], where: str) -> np.ndarray:
    """One array of finite numbers; FormatError where it is missing, not made of numbers, or of another shape."""
    try:
        found = np.asarray(weights[name], dtype=float)
    except (KeyError, TypeError, ValueError):
        raise FormatError(f"{where}.{name} is missing or not made of numbers") from None
    if found.shape != shape:
        raise FormatError(f"{where}.{name} has shape {found.shape}, expected {shape}")
    if not np.isfinite(found).all():
        raise FormatError(f"{where}.{name} holds numbers that are not finite")
    return found
