"""The stages of an embedded program in single precision: linear, nets, convolutions, effects."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tinygc.deploy import ExportError
from tinygc.effects import AppliedEffect, Conditions, Cost, MatrixC, NoC, PerAxisC, StageC
from tinygc.models.denoiser import DILATIONS, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet

# The interface of a stage of an embedded program, and helpers that all stages share.

__all__ = ["Cost", "Inputs", "ProgramStage", "single"]


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of N samples on a device, all float32: rate (N, 3) rad/s, force (N, 3) m/s^2 pre-calibrated, temp_c (N,)."""

    rate: np.ndarray
    force: np.ndarray
    temp_c: np.ndarray

    @classmethod
    def of(cls, rate: ArrayLike, force: ArrayLike | None = None, temp_c: ArrayLike | None = None) -> Inputs:
        """Round to float32; missing inputs are zero."""
        rates = np.asarray(rate, dtype=np.float32)
        zeros = np.zeros_like(rates)
        return cls(
            rates,
            zeros if force is None else np.asarray(force, dtype=np.float32),
            zeros[:, 0] if temp_c is None else np.asarray(temp_c, dtype=np.float32),
        )


class ProgramStage(ABC):
    """One step of a program: it changes ``float r[3]`` in place, and may read ``in`` and change ``state``.

    formula: a line of the header's formula; constants: name in C -> float32 array; body: C statements; functions: C functions that the
    body calls; state: C members, state_bytes their size, start: C statements that reset the state; cost of one sample.
    """

    formula: str
    constants: dict[str, np.ndarray]
    body: str
    functions = state = start = ""
    state_bytes = 0
    cost: Cost

    @abstractmethod
    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to N samples at once, in the same order of operations: (N, 3) float32 from (N, 3) float32."""


def single(values: ArrayLike, what: str) -> np.ndarray:
    """Convert to float32; raises ExportError where float32 cannot represent a value."""
    with np.errstate(over="ignore"):
        rounded = np.asarray(values, dtype=float).astype(np.float32)
    if not np.isfinite(rounded).all():
        raise ExportError(f"{what} holds numbers beyond single precision; C cannot carry it, json can")
    return rounded


# The linear model in single precision: a correction that is added to the rate.
#
#     y = x + (D x + b),  D = E - I
#
# The small part is computed separately and added last.  Its rounding error is smaller than the rate's by the size of the correction, so a
# rate has one rounding error, where E x + b would have six.

#: cost of one affine map of three components
COST = Cost(multiply=9, add=9)
FUNCTION = """\
/* y = W x + b; b is the last column of w. */
static void affine(const float w[3][4], const float x[3], float y[3])
{
    for (int i = 0; i < 3; i++) {
        float s = w[i][3];
        s += w[i][0] * x[0];
        s += w[i][1] * x[1];
        s += w[i][2] * x[2];
        y[i] = s;
    }
}
"""
ADD = "for (int i = 0; i < 3; i++)\n    r[i] += s[i];"


def affine(w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """W x + b, in the order of operations of the C code: w (3, 4), x (N, 3), all float32."""
    y = np.broadcast_to(w[:, 3], x.shape)
    for j in range(3):
        y = y + w[:, j] * x[:, j : j + 1]
    return y


def table(matrix: np.ndarray, bias: np.ndarray, what: str) -> np.ndarray:
    """(3, 4) float32 of a matrix and a bias."""
    return single(np.column_stack([matrix, bias]), what)


class Linear(ProgramStage):
    """omega = E m + B as m + (D m + B)."""

    cost = COST + Cost(add=3)

    def __init__(self, model: LinearModel, name: str, formula: str):
        self._w = table(np.asarray(model.E, dtype=float) - np.eye(3), model.B, formula)
        self.formula, self.constants = formula, {name: self._w}
        self.body = f"float s[3];\naffine({name}, r, s);\n{ADD}"

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to rates (N, 3) float32, in the same order of operations."""
        return rate + affine(self._w, rate)


# The calibration subnet in single precision.


class CalibrationNetStage(ProgramStage):
    """The paper's 27 parameters: r + W2 PReLU(W1 r + b1) + b2, a slope per axis."""

    formula = "r += W2 h + b2, h = W1 r + b1 where positive, slope times that below"
    cost = COST + COST + Cost(multiply=3, add=3, compare=3)
    body = f"""\
float s[3], h[3];
affine(HIDDEN, r, s);
for (int i = 0; i < 3; i++)
    h[i] = s[i] >= 0.0f ? s[i] : SLOPE[i] * s[i];
affine(OUTER, h, s);
{ADD}"""

    def __init__(self, net: CalibrationNet):
        hidden, outer = table(net.W1, net.b1, "the net"), table(net.W2, net.b2, "the net")
        self.constants = {"HIDDEN": hidden, "SLOPE": single(net.slope, "the net"), "OUTER": outer}

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to rates (N, 3) float32, in the same order of operations."""
        # x where it is not negative, slope x below.
        x = affine(self.constants["HIDDEN"], rate)
        h = np.where(x >= 0, x, self.constants["SLOPE"] * x)
        return rate + affine(self.constants["OUTER"], h)


# The denoising subnet in single precision: three causal convolutions per axis, each with a ring buffer of samples, so that a window is
# never recomputed.
#
# A layer keeps the (kernel - 1) dilation + 1 newest samples of its own input.  Before the first sample the input is assumed constant at
# that sample's value.

_LAYER = """\
/* {number}: {inputs} channel(s) to {outputs}, kernel {kernel}, dilation {dilation}.  The oldest sample comes first. */
static void layer{number}(const float *w, float ring[{slots}][{inputs}], unsigned newest, unsigned fill, const float *x, float *y)
{{
    float {accumulators};
    unsigned slot = newest + 1 < {slots} ? newest + 1 : 0;
    for (unsigned n = 0; n < fill; n++) {{
{store}
    }}
    for (int tap = 0; tap < {kernel}; tap++, w += {stride}) {{
        const float *v = ring[slot];
{products}
        slot += {dilation};
        if (slot >= {slots})
            slot -= {slots};
    }}
{results}
}}
"""


class Denoise(ProgramStage):
    """Convolutions of the three axes; weights (axis, tap, out, in), the oldest tap first, as the C code reads them."""

    def __init__(self, denoiser: Denoiser):
        self._weights = [single(w, "the denoiser") for w in (denoiser.conv1, denoiser.conv2, denoiser.conv3)]
        shapes = [weight.shape[1:3] for weight in self._weights]
        self._slots = [(w.shape[-1] - 1) * dilation + 1 for w, dilation in zip(self._weights, DILATIONS, strict=True)]
        self.formula = f"r = conv3(conv2(conv1(r))) per axis, dilations {DILATIONS}"
        self.constants = {f"CONV{n}": w.transpose(0, 3, 1, 2).reshape(3, -1) for n, w in enumerate(self._weights, 1)}
        self.state = "".join(
            f"    float ring{n}[3][{slots}][{inputs}];\n" for n, (slots, (_, inputs)) in enumerate(zip(self._slots, shapes, strict=True), 1)
        )
        self.state += "    unsigned char newest[3];\n    unsigned char running;\n"
        rings = sum(slots * inputs for slots, (_, inputs) in zip(self._slots, shapes, strict=True))
        self.functions, self.body = "\n".join(self._layer(n) for n in range(3)), self._statements()
        self.state_bytes = 4 * 3 * rings + 4
        products = sum(w.size for w in self._weights)
        self.cost = Cost(products, products)

    start = "state->newest[0] = state->newest[1] = state->newest[2] = 0;\nstate->running = 0;"

    def _layer(self, n: int) -> str:
        _, outputs, inputs, kernel = self._weights[n].shape
        products = [f"y{o} += w[{o * inputs + i}] * v[{i}];" for o in range(outputs) for i in range(inputs)]
        return _LAYER.format(
            number=n + 1,
            inputs=inputs,
            outputs=outputs,
            kernel=kernel,
            dilation=DILATIONS[n],
            slots=self._slots[n],
            stride=inputs * outputs,
            accumulators=", ".join(f"y{o} = 0.0f" for o in range(outputs)),
            store="\n".join(f"        ring[newest + n][{i}] = x[{i}];" for i in range(inputs)),
            products="\n".join(f"        {product}" for product in products),
            results="\n".join(f"    y[{o}] = y{o};" for o in range(outputs)),
        )

    def _statements(self) -> str:
        """Return the C that runs the layers of each axis, then advances the ring positions, which all axes share."""
        fills = [f"state->running ? 1 : {slots}" for slots in self._slots]
        channels = [weight.shape[1] for weight in self._weights]
        call = [
            f"layer{n}(CONV{n}[i], state->ring{n}[i], state->newest[{n - 1}], {fill}, {source}, {target});"
            for n, (fill, source, target) in enumerate(zip(fills, ("x", "y1", "y2"), ("y1", "y2", "y3"), strict=True), 1)
        ]
        locals_ = ", ".join(f"y{n}[{count}]" for n, count in enumerate(channels, 1))
        lines = ["for (int i = 0; i < 3; i++) {", f"    float x[1] = {{r[i]}}, {locals_};"]
        lines += [f"    {line}" for line in call] + ["    r[i] = y3[0];", "}"]
        for n, slots in enumerate(self._slots):
            lines.append(f"state->newest[{n}] = (unsigned char)(state->newest[{n}] + 1u < {slots}u ? state->newest[{n}] + 1u : 0u);")
        return "\n".join([*lines, "state->running = 1;"])

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to rates (N, 3) float32, in the same order of operations."""
        x = rate.T[:, None, :]  # (axis, channel, sample)
        count = x.shape[-1]
        for weight, dilation in zip(self._weights, DILATIONS, strict=True):
            _, outputs, channels, kernel = weight.shape
            held = np.concatenate([np.repeat(x[..., :1], (kernel - 1) * dilation, axis=-1), x], axis=-1)
            y = np.zeros((3, outputs, count), dtype=np.float32)
            for tap in range(kernel):
                for channel in range(channels):
                    at = tap * dilation
                    y = y + weight[:, :, channel, tap, None] * held[:, channel, None, at : at + count]
            x = y
        return x[:, 0, :].T


# Named physics in single precision: each effect's own C (``tinygc.effects.device``) as a stage of a program.
#
# Effects that depend on the rate itself are inverted as in ``Effect.correct``, by PASSES substitutions of r <- r - term(r).


class Matrix(ProgramStage):
    """r -= K f, f in m/s^2."""

    cost = COST + Cost(add=3)

    def __init__(self, code: MatrixC, theta: np.ndarray, known: Conditions, name: str):
        self.formula = code.formula
        self._w = table(code.matrix(theta, known), np.zeros(3), name)
        self.constants = {code.name: self._w}
        self.body = f"float s[3];\naffine({code.name}, in->force, s);\nfor (int i = 0; i < 3; i++)\n    r[i] -= s[i];"

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to rates (N, 3) float32, in the same order of operations."""
        return rate - affine(self._w, inputs.force)


class PerAxis(ProgramStage):
    """One coefficient k per axis: r -= term, where the term, in C and in NumPy, may depend on the rate w."""

    def __init__(self, code: PerAxisC, theta: np.ndarray, known: Conditions):
        self._code, self.formula = code, code.formula
        self.constants = {name: single(value, code.formula) for name, value in code.values(theta, known).items()}
        self.body = self._statements()
        self.cost = sum([code.cost] * (3 * code.passes), Cost())

    def _statements(self) -> str:
        code = self._code
        if code.passes == 1:
            return f"for (int i = 0; i < 3; i++)\n    r[i] -= {code.term};"
        return (
            "for (int i = 0; i < 3; i++) {\n    float w = r[i];\n"
            f"    for (int pass = 0; pass < {code.passes}; pass++)\n        w = r[i] - {code.term};\n    r[i] = w;\n}}"
        )

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to rates (N, 3) float32, in the same order of operations."""
        w = rate
        for _ in range(self._code.passes):
            w = rate - self._code.numpy(self.constants, w, inputs)
        return w


class Own(ProgramStage):
    """A stage with an effect's own statements."""

    def __init__(self, code: StageC, theta: np.ndarray, known: Conditions):
        self._numpy = code.numpy
        self.formula, self.body, self.cost, self.functions = code.formula, code.body, code.cost, code.functions
        self.state, self.state_bytes, self.start = code.state, code.state_bytes, code.start
        self.constants = {name: single(value, code.formula) for name, value in code.constants(theta, known).items()}

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """Apply the body to rates (N, 3) float32, in the same order of operations."""
        return self._numpy(self.constants, rate, inputs)


def effect_stage(claim: AppliedEffect, known: Conditions) -> ProgramStage:
    """Return the stage that corrects a claimed effect.  Raises ExportError for one without C, with its reason, or with invalid C."""
    effect, code = claim.effect, claim.effect.device
    if isinstance(code, NoC):
        raise ExportError(f"{effect.id} cannot be exported to C: {code.why}; json carries it, or export another method's model")
    theta = np.asarray(claim.theta, dtype=float)
    if isinstance(code, MatrixC):
        stage: ProgramStage = Matrix(code, theta, known, effect.id)
    else:
        stage = PerAxis(code, theta, known) if isinstance(code, PerAxisC) else Own(code, theta, known)
    for name in stage.constants:
        if not re.fullmatch("[A-Z][A-Z0-9_]*", name):
            raise ExportError(f"{effect.id} cannot be exported to C: {name!r} is no name for a constant, expected capital letters")
    return stage
