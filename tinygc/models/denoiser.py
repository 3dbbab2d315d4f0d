"""TinyGC-Net's denoising subnet: per axis, causal, three convolutions, 168 parameters; and its file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from session.base.errors import FormatError
from session.base.results import Array, Keys, Number, require
from tinygc.models.model import FACTOR, Model, Stream

# TinyGC-Net's denoising subnet: per axis, causal, three convolutions 1 -> 2 -> 2 -> 1 of kernel 7, no biases: 14 + 28 + 14 = 56 weights.
#
#     y1 = conv1 * x,  y2 = conv2 * y1,  f(x) = conv3 * y2
#
# Dilations 1, 2, 5 give a receptive field of 1 + 6 (1 + 2 + 5) = 49 samples, the largest for kernel 7 within the paper's window of N = 50;
# the oldest of the 50 has no weight.
#
# **Unit gain.**  f of a constant 1 is the gain at *every* constant rate.  ``normalised`` divides conv3 by it, so constant rates pass
# unchanged.
#
# **The integral of any signal.**  The unit gain holds for constant rates.  The integral of a changing rate, which determines the attitude,
# is preserved for every signal if and only if f is linear.  So the slope of the leaky ReLUs is 1: the subnet is a filter of 49 taps made of
# three short ones.  A smaller slope (the paper's) does not preserve the integral, and being homogeneous it cannot separate rest from motion
# by magnitude.
#
# The input before the first sample equals the first sample, so a log that begins at rest begins without a transient.

WINDOW = 50
KERNEL = 7
DILATIONS = (1, 2, 5)
SHAPES = {"conv1": (3, 2, 1, KERNEL), "conv2": (3, 2, 2, KERNEL), "conv3": (3, 1, 2, KERNEL)}
#: parameters of all three axes: 56 each
PARAMETERS = 168
#: samples before the newest one that have a weight
REACH = (KERNEL - 1) * sum(DILATIONS)


@dataclass(frozen=True, eq=False)
class Denoiser:
    """The subnet's weights (axis, channel out, channel in, tap), the last tap on the newest sample.

    conv1 (3, 2, 1, 7), conv2 (3, 2, 2, 7), conv3 (3, 1, 2, 7).
    """

    conv1: np.ndarray
    conv2: np.ndarray
    conv3: np.ndarray

    @classmethod
    def identity(cls) -> Denoiser:
        """The exact identity: the newest sample, through the first channels."""
        weights = {name: np.zeros(shape) for name, shape in SHAPES.items()}
        for weight in weights.values():
            weight[:, 0, 0, -1] = 1.0
        return cls(weights["conv1"], weights["conv2"], weights["conv3"]).normalised()

    @classmethod
    def from_vector(cls, vector: np.ndarray) -> Denoiser:
        """Build from weights (3, 56): conv1, conv2, conv3 of each axis."""
        parts, at = [], 0
        for shape in SHAPES.values():
            size = int(np.prod(shape[1:]))
            parts.append(vector[:, at : at + size].reshape(shape))
            at += size
        conv1, conv2, conv3 = parts
        return cls(conv1, conv2, conv3)

    @property
    def vector(self) -> np.ndarray:
        """(3, 56) weights of each axis."""
        return np.concatenate([getattr(self, name).reshape(3, -1) for name in SHAPES], -1)

    @property
    def gain(self) -> np.ndarray:
        """(3,) gain at a constant rate; 1 if normalised."""
        return self._net(np.ones((3, 1, REACH + 1), self.conv1.dtype))[:, 0, 0]

    def normalised(self) -> Denoiser:
        """Scale to exactly unit gain at every constant rate.  Raises ValueError if the gain is not positive."""
        gain = self.gain
        if not bool((gain > 1e-9).all()):
            raise ValueError("the denoiser passes no constant rate on some axis")
        return replace(self, conv3=self.conv3 / gain[:, None, None, None])

    def __call__(self, rate: np.ndarray) -> np.ndarray:
        """Denoised rate (..., N, 3) rad/s at every sample; the input is constant before its first sample."""
        return self.windowed(np.concatenate([rate[..., :1, :]] * REACH + [rate], -2))

    def windowed(self, rate: np.ndarray) -> np.ndarray:
        """Denoised rate (..., N - REACH, 3), with the first ``REACH`` samples as history only: a window of 50 gives its newest two."""
        x = np.moveaxis(rate, -1, -2)[..., None, :]
        return np.moveaxis(self._net(x)[..., 0, :], -2, -1)

    def taps(self) -> np.ndarray:
        """(3, REACH + 1): impulse response, newest sample first."""
        impulse = np.zeros((2 * REACH + 1, 3))
        impulse[REACH] = 1.0
        return self.windowed(impulse).T

    @property
    def delay_samples(self) -> np.ndarray:
        """(3,) delay of the response to a steady ramp, in samples."""
        ramp = np.arange(-REACH, 1.0)[:, None] + np.full(3, 1e3)
        return 1e3 - self.windowed(ramp)[-1]

    def _net(self, x: np.ndarray) -> np.ndarray:
        """f(x) (..., 3, 1, N - REACH) of x (..., 3, 1, N)."""
        for weight, dilation in zip((self.conv1, self.conv2, self.conv3), DILATIONS, strict=True):
            length = x.shape[-1] - (KERNEL - 1) * dilation
            x = sum(weight[..., i] @ x[..., i * dilation : i * dilation + length] for i in range(KERNEL))
        return x


@dataclass(frozen=True, eq=False)
class DenoisedNet(Model):
    """The whole TinyGC-Net: first ``calibration``, any map of rates (27 parameters), then ``denoiser`` (168), made for rate_hz.

    Called on rates (..., N, 3) in the order of time it gives the microcontroller's output: causal, with the denoiser's delay.
    """

    kind: ClassVar[str] = "tinygc_denoised"
    pointwise: ClassVar[bool] = False
    calibration: Model
    denoiser: Denoiser
    rate_hz: float

    @property
    def parameters(self) -> int:
        """Number of parameters of both subnets."""
        return PARAMETERS + self.calibration.parameters

    @property
    def delay_samples(self) -> int:
        """Output delay in whole samples, averaged over the axes."""
        return round(float(self.denoiser.delay_samples.mean()))

    @property
    def made_for_hz(self) -> float:
        """The sampling rate of the session that it was trained on."""
        return self.rate_hz

    def without_denoiser(self) -> Model:
        """The calibration alone."""
        return self.calibration

    def with_bias_moved(self, change: np.ndarray) -> DenoisedNet:
        """Increase the calibration's bias by ``change`` (3,) rad/s; the denoiser has none."""
        return replace(self, calibration=self.calibration.with_bias_moved(change))

    @property
    def delay_s(self) -> float:
        """Output delay in s, averaged over the axes."""
        return float(self.denoiser.delay_samples.mean()) / self.rate_hz

    def __call__(self, rate: np.ndarray) -> np.ndarray:
        """Calibrated and denoised rate (..., N, 3) rad/s."""
        return self.denoiser(self.calibration(rate))

    def stream(self, rate_hz: float | None) -> Stream | None:
        """Each rate from its window; before the log the first rate is repeated."""
        tail: np.ndarray | None = None  # calibrated rates

        def push(raw: np.ndarray, temp_c: object) -> np.ndarray:
            nonlocal tail
            if not len(raw):
                return np.zeros((0, 3))
            rate = self.calibration(raw)
            held = np.concatenate([np.repeat(rate[:1], REACH, axis=0) if tail is None else tail, rate])
            tail = held[len(held) - REACH :]
            return self.denoiser.windowed(held)

        return push

    def undelayed(self, rate: np.ndarray) -> np.ndarray:
        """Output with the delay removed; the last values are repeated (for attitudes in post-processing)."""
        late, lag = self(rate), max(self.delay_samples, 0)
        return np.concatenate([late[..., lag:, :]] + [late[..., -1:, :]] * min(lag, late.shape[-2]), -2)


# TinyGC-Net with its denoiser as JSON: the calibration's table and the three convolutions.

EQUATION = "omega = calibration(m); per axis y1 = conv1 * omega, y2 = conv2 * y1, denoised = conv3 * y2"
#: tolerance of the gain at a constant rate, for rounding to seven digits
GAIN_WITHIN = 1e-6
_NET = Keys(
    {"dilations": Array((3,), Number(1, WINDOW, whole=True)), **{name: Array(shape, FACTOR) for name, shape in SHAPES.items()}},
    {"slope": Number(0, 1)},  # of earlier versions, 1 in all but experiments
)
_DENOISED = Keys({"rate_hz": Number(0, 1e6, above=True), "denoiser": _NET, "calibration": Keys()})


def to_table(model: DenoisedNet, write: Callable[..., dict]) -> dict:
    """Table of the weights (axis, channel out, channel in, tap), the last tap on the newest sample, taps ``dilation`` samples apart."""
    table = {"window": WINDOW, "dilations": DILATIONS, **{name: getattr(model.denoiser, name) for name in SHAPES}}
    return {
        "equation": EQUATION,
        "rate_hz": model.rate_hz,
        "delay_s": model.delay_s,
        "calibration": write(model.calibration),
        "denoiser": table,
    }


def from_table(table: dict, where: str, read: Callable[..., Any]) -> DenoisedNet:
    """Read the model from its table.  Raises FormatError for an invalid table."""
    require(table, _DENOISED, where)
    entries = table["denoiser"]
    weights = {name: each for name, each in _NET.made(entries).items() if name in SHAPES}
    if tuple(entries["dilations"]) != DILATIONS or entries.get("slope", 1) != 1:
        raise FormatError(f"{where}: the denoiser has other dilations than {DILATIONS}, or another slope than 1; fit again")
    denoiser = Denoiser(**weights)
    if not np.abs(denoiser.gain - 1).max() <= GAIN_WITHIN:
        raise FormatError(f"{where}: the denoiser's gain at a constant rate is {denoiser.gain}, expected 1: it would miscalibrate")
    calibration = read(table.get("calibration"), f"{where}: calibration")
    if not calibration.pointwise:
        raise FormatError(f"{where}: the denoiser's calibration is of a kind that it does not follow")
    return DenoisedNet(calibration, denoiser, float(table["rate_hz"]))
