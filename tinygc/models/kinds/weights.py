"""Kinds that are nothing but arrays of weights: the linear model, TinyGC-Net, and the net of the authors' published code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from session.files.shapes import Array, Keys, require
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.linear import LinearModel
from tinygc.models.published_net import PublishedNet
from tinygc.models.shapes import FACTOR, MATRIX, RATE

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
    require(table, Keys({"weights": Keys({name: weight(name, shape) for name, shape in cls.SHAPES.items()})}), where)
    return cls(**{name: np.asarray(table["weights"][name], dtype=float) for name in cls.SHAPES})


def weight(name: str, shape: tuple[int, ...]) -> Array:
    """What an array of weights must hold: E can be undone, what is added to a rate (B, b1, b2) is a rate, all else a factor."""
    return MATRIX if name == "E" else Array(shape, RATE if name.lower().startswith("b") else FACTOR)
