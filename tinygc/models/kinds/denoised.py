"""TinyGC-Net with its denoiser as JSON: the calibration's own table, and the three convolutions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from session.common.errors import FormatError
from session.files.shapes import Array, Keys, Number, require
from tinygc.models.denoiser import KERNEL, SHAPES, WINDOW, DenoisedNet, Denoiser
from tinygc.models.shapes import FACTOR

EQUATION = (
    "omega = calibration(m); per axis y1 = L(conv1 * omega), y2 = L(conv2 * y1), g = L(conv3 * y2), L(h) = h if h >= 0 else slope * h; "
    "denoised = (g(omega) - g(-omega)) / 2, which is g(omega) where slope is 1"
)
#: a constant rate must pass unchanged; what rounding to seven digits may do
GAIN_WITHIN = 1e-6
_NET = Keys(
    {
        "slope": Number(0, 1),
        "dilations": Array((3,), Number(1, WINDOW, whole=True)),
        **{name: Array(shape, FACTOR) for name, shape in SHAPES.items()},
    }
)
_DENOISED = Keys({"rate_hz": Number(0, 1e6, above=True), "denoiser": _NET, "calibration": Keys()})


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
    require(table, _DENOISED, where)
    entries = table["denoiser"]
    weights = {name: np.asarray(entries[name], dtype=float) for name in SHAPES}
    first, second, third = map(int, entries["dilations"])
    if 1 + (KERNEL - 1) * (first + second + third) > WINDOW:
        raise FormatError(f"{where}: denoiser.dilations reach farther than the {WINDOW} samples of the window; fit again")
    denoiser = Denoiser(**weights, slope=float(entries["slope"]), dilations=(first, second, third))
    if not np.abs(denoiser.gain - 1).max() <= GAIN_WITHIN:
        raise FormatError(f"{where}: the denoiser's gain at a constant rate is {denoiser.gain}, expected 1: it would miscalibrate")
    calibration = read(table.get("calibration"), f"{where}: calibration")
    if not calibration.pointwise:
        raise FormatError(f"{where}: the denoiser's calibration is of a kind that it does not follow")
    return DenoisedNet(calibration, denoiser, float(table["rate_hz"]))
