"""TinyGC-Net's denoising subnet: per axis, causal, three convolutions, 168 parameters; and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from session.io.errors import FormatError
from session.io.results import Array, Keys, Number, require
from tinygc.attitude import rotation
from tinygc.models.model import FACTOR, BaseModel, Model

# TinyGC-Net's denoising subnet: per axis, causal, three convolutions 1 -> 2 -> 2 -> 1 of kernel 7, no biases: 14 + 28 + 14 = 56 weights.
#
#     y1 = L(conv1 * x),  y2 = L(conv2 * y1),  g(x) = L(conv3 * y2),      L(h) = h where h >= 0, slope h below
#     f(x) = (g(x) - g(-x)) / 2
#
# Dilations 1, 2, 5 reach 1 + 6 (1 + 2 + 5) = 49 samples back, the most that kernel 7 can within the paper's window of N = 50; the oldest
# of the 50 has no weight.
#
# **Either sign alike.**  A leaky ReLU treats negative rates otherwise than positive ones.  f is exactly odd, whatever the weights: the
# half-difference of the net run on x and on -x.  Without biases f is also homogeneous, f(c x) = c f(x) for every c, so one number per
# axis, f of a constant 1, is the gain at *every* constant rate.  ``normalised`` divides conv3 by it: each passes unchanged, exactly.
#
# **The mean of any signal.**  That holds for constants.  Of a moving rate the integral, which is what an attitude is made of, is kept for
# every signal if and only if f is linear: the default slope is 1, where L passes both signs as they are, f(x) = g(x), one pass is
# enough, and the subnet is a filter of 49 taps made of three short ones.  A smaller slope may be had (the paper's); it does not keep
# that promise, and being homogeneous it cannot tell rest from motion by size.
#
# Before the first sample the input is taken to have stood at its value: a log that begins at rest begins without a transient.

WINDOW = 50
KERNEL = 7
DILATIONS = (1, 2, 5)
SHAPES = {"conv1": (3, 2, 1, KERNEL), "conv2": (3, 2, 2, KERNEL), "conv3": (3, 1, 2, KERNEL)}
#: of all three axes: 56 each
PARAMETERS = 168


@dataclass(frozen=True, eq=False)
class Denoiser:
    """The subnet's weights, NumPy or torch, (axis, channel out, channel in, tap), the last tap on the newest sample.

    It is called on what is of the library that its weights are of: the types say ``Any`` where either may stand.

    conv1 (3, 2, 1, 7), conv2 (3, 2, 2, 7), conv3 (3, 1, 2, 7); slope of the three leaky ReLUs, fixed; dilations of the three layers.
    """

    conv1: np.ndarray
    conv2: np.ndarray
    conv3: np.ndarray
    slope: float = 1.0
    dilations: tuple[int, int, int] = DILATIONS

    @classmethod
    def identity(cls, slope: float = 1.0) -> Denoiser:
        """No smoothing, exactly: the newest sample, through the first channels."""
        weights = {name: np.zeros(shape) for name, shape in SHAPES.items()}
        for weight in weights.values():
            weight[:, 0, 0, -1] = 1.0
        return cls(weights["conv1"], weights["conv2"], weights["conv3"], slope).normalised()

    @classmethod
    def from_vector(cls, vector: Any, slope: float = 1.0, dilations: tuple[int, int, int] = DILATIONS) -> Denoiser:
        """From (3, 56): each axis's conv1, conv2, conv3."""
        parts, at = [], 0
        for shape in SHAPES.values():
            size = int(np.prod(shape[1:]))
            parts.append(vector[:, at : at + size].reshape(shape))
            at += size
        conv1, conv2, conv3 = parts
        return cls(conv1, conv2, conv3, slope, dilations)

    @property
    def vector(self) -> Any:
        """(3, 56)."""
        xp = rotation.namespace(self.conv1)
        return xp.concatenate([getattr(self, name).reshape(3, -1) for name in SHAPES], -1)

    @property
    def reach(self) -> int:
        """Samples before the newest that have a weight."""
        return (KERNEL - 1) * sum(self.dilations)

    @property
    def gain(self) -> Any:
        """(3,) of a constant rate; 1 once normalised."""
        xp = rotation.namespace(self.conv1)
        one = xp.ones_like(self.conv1[:, 0, :, :1])
        return self._odd(xp.concatenate([one] * (self.reach + 1), -1))[:, 0, 0]

    def normalised(self) -> Denoiser:
        """The same with unit gain at every constant rate, exactly.  Raises ValueError where the gain is not positive."""
        gain = self.gain
        if not bool((gain > 1e-9).all()):
            raise ValueError("the denoiser passes no constant rate on some axis")
        return replace(self, conv3=self.conv3 / gain[:, None, None, None])

    def __call__(self, rate: Any) -> Any:
        """Denoised rate (..., N, 3) rad/s at every sample, each from its own window; the input stands before its first sample."""
        xp = rotation.namespace(rate)
        held = xp.concatenate([rate[..., :1, :]] * self.reach + [rate], -2)
        return self.windowed(held)

    def windowed(self, rate: Any) -> Any:
        """The same (..., N - reach, 3) where the first ``reach`` samples are only history: a window of 50 gives its newest two."""
        xp = rotation.namespace(rate)
        x = xp.moveaxis(rate, -1, -2)[..., None, :]
        return xp.moveaxis(self._odd(x)[..., 0, :], -2, -1)

    def stream(self) -> DenoiserStream:
        """A filter that is fed sample by sample, as a microcontroller is."""
        return DenoiserStream(self)

    def taps(self) -> np.ndarray:
        """(3, reach + 1): the response to a unit impulse, newest sample first; all there is to know where slope is 1 (NumPy only)."""
        impulse = np.zeros((2 * self.reach + 1, 3))
        impulse[self.reach] = 1.0
        return self.windowed(impulse).T

    @property
    def delay_samples(self) -> np.ndarray:
        """(3,) by how much the answer to a steady ramp lags, in samples (NumPy only)."""
        ramp = np.arange(-self.reach, 1.0)[:, None] + np.full(3, 1e3)
        return 1e3 - self.windowed(ramp)[-1]

    def _layers(self) -> Iterator[tuple[np.ndarray, int]]:
        return zip((self.conv1, self.conv2, self.conv3), self.dilations, strict=True)

    def _odd(self, x: Any) -> Any:
        if self.slope == 1:
            return self._net(x)
        return (self._net(x) - self._net(-x)) / 2

    def _net(self, x: Any) -> Any:
        """g of x (..., 3, 1, N): (..., 3, 1, N - reach)."""
        for weight, dilation in self._layers():
            length = x.shape[-1] - (KERNEL - 1) * dilation
            x = self._leaky(sum(weight[..., i] @ x[..., i * dilation : i * dilation + length] for i in range(KERNEL)))
        return x

    def _leaky(self, h: Any) -> Any:
        if self.slope == 1:
            return h
        return rotation.namespace(h).where(h >= 0, h, self.slope * h)


class DenoiserStream:
    """A denoiser's memory: ``step`` takes one rate (3,) rad/s and gives the denoised one (3,); ``reset`` forgets."""

    def __init__(self, denoiser: Denoiser):
        self._denoiser = denoiser
        self._signs = np.array([1.0] if denoiser.slope == 1 else [1.0, -1.0])
        self.reset()

    def reset(self) -> None:
        """As before the first sample."""
        self._memory: list[np.ndarray] | None = None

    def step(self, rate: np.ndarray) -> np.ndarray:
        """One sample in, one out."""
        y = self._signs[:, None, None] * np.asarray(rate, dtype=float)[None, :, None]  # (sign, axis, channel)
        if self._memory is None:
            self._memory = self._stand(y)
        for number, (weight, dilation) in enumerate(self._denoiser._layers()):
            memory = np.concatenate([self._memory[number][..., 1:], y[..., None]], axis=-1)
            self._memory[number] = memory
            y = self._denoiser._leaky(np.einsum("aoci,saci->sao", weight, memory[..., ::dilation]))
        return np.tensordot(self._signs, y[..., 0], 1) / len(self._signs)

    def _stand(self, y: np.ndarray) -> list[np.ndarray]:
        """Each layer's memory after the input has stood at y for long."""
        memory = []
        for weight, dilation in self._denoiser._layers():
            memory.append(np.repeat(y[..., None], (KERNEL - 1) * dilation + 1, axis=-1))
            y = self._denoiser._leaky(np.einsum("aoci,saci->sao", weight, memory[-1][..., ::dilation]))
        return memory


@dataclass(frozen=True, eq=False)
class DenoisedNet(BaseModel):
    """TinyGC-Net whole: first ``calibration``, any map of rates (27 parameters), then ``denoiser`` (168), made for rate_hz.

    Called on rates (..., N, 3) in the order of time it gives what the microcontroller would: causal, late by the denoiser's delay.
    """

    kind: ClassVar[str] = "tinygc_denoised"
    pointwise: ClassVar[bool] = False
    calibration: Model
    denoiser: Denoiser
    rate_hz: float

    @property
    def parameters(self) -> int:
        """Of both subnets."""
        return PARAMETERS + self.calibration.parameters

    @property
    def delay_samples(self) -> int:
        """Whole samples that the rate comes late, the mean over the axes."""
        return round(float(self.denoiser.delay_samples.mean()))

    @property
    def made_for_hz(self) -> float:
        """The sampling rate of the session that it was trained on."""
        return self.rate_hz

    def without_denoiser(self) -> Model:
        """The calibration alone."""
        return self.calibration

    def with_bias_moved(self, change: np.ndarray) -> DenoisedNet:
        """The calibration's bias greater by ``change`` (3,) rad/s; the denoiser has none."""
        return replace(self, calibration=self.calibration.with_bias_moved(change))

    @property
    def delay_s(self) -> float:
        """Mean over the axes."""
        return float(self.denoiser.delay_samples.mean()) / self.rate_hz

    def __call__(self, rate: Any) -> Any:
        """Calibrated and denoised rate (..., N, 3) rad/s."""
        return self.denoiser(self.calibration(rate))

    def undelayed(self, rate: Any) -> Any:
        """The same, each answer at the sample that it belongs to; the last ones stand (for attitudes after the event)."""
        xp = rotation.namespace(rate)
        late, lag = self(rate), max(self.delay_samples, 0)
        return xp.concatenate([late[..., lag:, :]] + [late[..., -1:, :]] * min(lag, late.shape[-2]), -2)


# TinyGC-Net with its denoiser as JSON: the calibration's own table, and the three convolutions.

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
