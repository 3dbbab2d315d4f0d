"""TinyGC-Net with its denoiser as JSON: the calibration's own table, and the three convolutions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from session.common.errors import FormatError
from tinygc.models.denoiser import KERNEL, SHAPES, WINDOW, DenoisedNet, Denoiser

EQUATION = (
    "omega = calibration(m); per axis y1 = L(conv1 * omega), y2 = L(conv2 * y1), g = L(conv3 * y2), L(h) = h if h >= 0 else slope * h; "
    "denoised = (g(omega) - g(-omega)) / 2, which is g(omega) where slope is 1"
)
#: a constant rate must pass unchanged; what rounding to seven digits may do
GAIN_WITHIN = 1e-6


def to_table(model: DenoisedNet, write: Callable[..., dict]) -> dict:
    """Weights (axis, channel out, channel in, tap), the last tap on the newest sample, each tap ``dilation`` samples older."""
    net = model.denoiser
    table: dict[str, Any] = {"window": WINDOW, "dilations": list(net.dilations), "slope": net.slope}
    table |= {name: np.asarray(getattr(net, name)).tolist() for name in SHAPES}
    return {
        "equation": EQUATION,
        "rate_hz": model.rate_hz,
        "delay_s": model.delay_s,
        "calibration": write(model.calibration),
        "denoiser": table,
    }


def from_table(table: dict, where: str, read: Callable[..., Any]) -> DenoisedNet:
    """The model; FormatError says what is wrong with the table."""
    try:
        entries = table["denoiser"]
        rate_hz, slope = float(table["rate_hz"]), float(entries["slope"])
        dilations = tuple(_whole(value) for value in entries["dilations"])
        weights = {name: np.asarray(entries[name], dtype=float) for name in SHAPES}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FormatError(f"{where}: the denoiser cannot be read: {error}") from None
    for name, shape in SHAPES.items():
        if weights[name].shape != shape or not np.isfinite(weights[name]).all():
            raise FormatError(f"{where}: denoiser.{name} has shape {weights[name].shape}, expected {shape} of finite numbers")
    if len(dilations) != 3 or min(dilations) < 1 or 1 + (KERNEL - 1) * sum(dilations) > WINDOW:
        raise FormatError(f"{where}: denoiser.dilations are {list(dilations)}, expected three that reach at most {WINDOW} samples")
    if not (0 <= slope <= 1 and 0 < rate_hz < float("inf")):
        raise FormatError(f"{where}: slope {slope:g} or rate_hz {rate_hz:g} is out of range")
    denoiser = Denoiser(**weights, slope=slope, dilations=dilations)
    if not np.abs(denoiser.gain - 1).max() <= GAIN_WITHIN:
        raise FormatError(f"{where}: the denoiser's gain at a constant rate is {denoiser.gain}, expected 1: it would miscalibrate")
    calibration = read(table.get("calibration"), f"{where}: calibration")
    if not calibration.pointwise:
        raise FormatError(f"{where}: the denoiser's calibration is of a kind that it does not follow")
    return DenoisedNet(calibration, denoiser, rate_hz)


def _whole(value: object) -> int:
    """A dilation is a number of samples: 2.5 of them must not pass for 2."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value != int(value):
        raise ValueError(f"dilations hold {value!r}, expected whole numbers of samples")
    return int(value)
