"""The stages of an embedded program: the linear model, nets, convolutions, named physics."""

from __future__ import annotations

import re

import numpy as np

from tinygc.deploy import ExportError
from tinygc.effects import AppliedEffect, Conditions, NoC
from tinygc.effects.device import Stage, affine
from tinygc.models.denoiser import DILATIONS, SHAPES, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet

# The linear model: a correction that is added to the rate.
#
#     y = x + (D x + b),  D = E - I
#
# The small part is computed separately and added last.  Its rounding error is smaller than the rate's by the size of the correction, so a
# rate has one rounding error, where E x + b would have six.

ADD = "for (int i = 0; i < 3; i++)\n    r[i] += s[i];"


def linear(model: LinearModel, name: str, formula: str) -> Stage:
    """omega = E m + B as m + (D m + B)."""
    constants = {name: np.column_stack([np.asarray(model.E, dtype=float) - np.eye(3), model.B])}
    body = f"float s[3];\naffine({name}, r, s);\n{ADD}"
    return Stage(formula, body, constants, lambda c, rate, inputs: rate + affine(c[name], rate))


_NET = f"""\
float s[3], h[3];
affine(HIDDEN, r, s);
for (int i = 0; i < 3; i++)
    h[i] = s[i] >= 0.0f ? s[i] : SLOPE[i] * s[i];
affine(OUTER, h, s);
{ADD}"""


def calibration_net(net: CalibrationNet) -> Stage:
    """The paper's 27 parameters: r + W2 PReLU(W1 r + b1) + b2, a slope per axis."""

    def run(c: dict[str, np.ndarray], rate: np.ndarray, inputs: object) -> np.ndarray:
        x = affine(c["HIDDEN"], rate)
        return rate + affine(c["OUTER"], np.where(x >= 0, x, c["SLOPE"] * x))

    constants = {"HIDDEN": np.column_stack([net.W1, net.b1]), "SLOPE": net.slope, "OUTER": np.column_stack([net.W2, net.b2])}
    formula = "r += W2 h + b2, h = W1 r + b1 where positive, slope times that below"
    return Stage(formula, _NET, constants, run)


# The denoising subnet: three causal convolutions per axis, each with a ring buffer of samples, so that a window is never recomputed.
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


def denoise(denoiser: Denoiser) -> Stage:
    """Convolutions of the three axes; weights (axis, tap, out, in), the oldest tap first, as the C code reads them."""
    weights = [np.asarray(w) for w in (denoiser.conv1, denoiser.conv2, denoiser.conv3)]
    slots = [(w.shape[-1] - 1) * dilation + 1 for w, dilation in zip(weights, DILATIONS, strict=True)]
    inputs, outputs = ([w.shape[axis] for w in weights] for axis in (2, 1))
    state = "".join(f"    float ring{n}[3][{kept}][{count}];\n" for n, kept, count in zip((1, 2, 3), slots, inputs, strict=True))
    lines = ["for (int i = 0; i < 3; i++) {"]
    lines += [f"    float x[1] = {{r[i]}}, {', '.join(f'y{n}[{count}]' for n, count in enumerate(outputs, 1))};"]
    for n, kept, source in zip((1, 2, 3), slots, ("x", "y1", "y2"), strict=True):
        place = f"state->ring{n}[i], state->newest[{n - 1}], state->running ? 1 : {kept}"
        lines.append(f"    layer{n}(CONV{n}[i], {place}, {source}, y{n});")
    lines += ["    r[i] = y3[0];", "}"]
    for n, kept in enumerate(slots):  # the places in the rings, which all axes share
        lines.append(f"state->newest[{n}] = (unsigned char)(state->newest[{n}] + 1u < {kept}u ? state->newest[{n}] + 1u : 0u);")
    return Stage(
        f"r = conv3(conv2(conv1(r))) per axis, dilations {DILATIONS}",
        "\n".join([*lines, "state->running = 1;"]),
        {f"CONV{n}": w.transpose(0, 3, 1, 2).reshape(3, -1) for n, w in enumerate(weights, 1)},
        _denoised,
        "\n".join(_layer(n, *each) for n, each in enumerate(zip(weights, DILATIONS, slots, strict=True), 1)),
        state + "    unsigned char newest[3];\n    unsigned char running;\n",
        4 * 3 * sum(kept * count for kept, count in zip(slots, inputs, strict=True)) + 4,
        "state->newest[0] = state->newest[1] = state->newest[2] = 0;\nstate->running = 0;",
    )


def _layer(number: int, weight: np.ndarray, dilation: int, slots: int) -> str:
    _, outputs, inputs, kernel = weight.shape
    products = [f"y{o} += w[{o * inputs + i}] * v[{i}];" for o in range(outputs) for i in range(inputs)]
    return _LAYER.format(
        number=number,
        inputs=inputs,
        outputs=outputs,
        kernel=kernel,
        dilation=dilation,
        slots=slots,
        stride=inputs * outputs,
        accumulators=", ".join(f"y{o} = 0.0f" for o in range(outputs)),
        store="\n".join(f"        ring[newest + n][{i}] = x[{i}];" for i in range(inputs)),
        products="\n".join(f"        {product}" for product in products),
        results="\n".join(f"    y[{o}] = y{o};" for o in range(outputs)),
    )


def _denoised(c: dict[str, np.ndarray], rate: np.ndarray, inputs: object) -> np.ndarray:
    x = rate.T[:, None, :]  # (axis, channel, sample)
    count = x.shape[-1]
    for number, dilation in enumerate(DILATIONS, 1):
        _, outputs, channels, kernel = SHAPES[f"conv{number}"]
        weight = c[f"CONV{number}"].reshape(3, kernel, outputs, channels)
        held = np.concatenate([np.repeat(x[..., :1], (kernel - 1) * dilation, axis=-1), x], axis=-1)
        y = np.zeros((3, outputs, count), dtype=np.float32)
        for tap in range(kernel):
            for channel in range(channels):
                at = tap * dilation
                y = y + weight[:, tap, :, channel, None] * held[:, channel, None, at : at + count]
        x = y
    return x[:, 0, :].T


def effect_stage(claim: AppliedEffect, known: Conditions) -> Stage:
    """Return the stage that corrects a claimed effect.  Raises ExportError for one without C, with its reason, or with invalid C."""
    effect, code = claim.effect, claim.effect.device
    if isinstance(code, NoC):
        raise ExportError(f"{effect.id} cannot be exported to C: {code.why}; json carries it, or export another method's model")
    stage = code.stage(np.asarray(claim.theta, dtype=float), known)
    for name in stage.constants:
        if not re.fullmatch("[A-Z][A-Z0-9_]*", name):
            raise ExportError(f"{effect.id} cannot be exported to C: {name!r} is no name for a constant, expected capital letters")
    return stage
