"""The denoising subnet in single precision: three causal convolutions per axis with a ring of samples each, never a whole window again.

A layer keeps the (kernel - 1) dilation + 1 newest samples of its own input.  Before the first sample the input is taken to have stood at
its value.  Where the leaky ReLUs bend (slope < 1) the net runs on x and on -x, with a ring for either sign.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.embedded.stage import Cost, Inputs, ProgramStage, single
from tinygc.models.denoiser import Denoiser

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
    """The three axes' convolutions; the weights (axis, tap, out, in), the oldest tap first, as the C reads them."""

    def __init__(self, denoiser: Denoiser):
        self._weights = [single(w, "the denoiser") for w in (denoiser.conv1, denoiser.conv2, denoiser.conv3)]
        self._dilations = tuple(denoiser.dilations)
        self._slope = None if denoiser.slope == 1 else single(denoiser.slope, "the denoiser")
        self._signs = 1 if self._slope is None else 2
        shapes = [weight.shape[1:3] for weight in self._weights]
        self._slots = [(w.shape[-1] - 1) * dilation + 1 for w, dilation in zip(self._weights, self._dilations, strict=True)]
        self.says = f"r = conv3(conv2(conv1(r))) per axis, dilations {self._dilations}"
        if self._slope is not None:
            self.says = f"r = (g(r) - g(-r)) / 2, g the three convolutions, leaky ReLUs of slope {denoiser.slope:g}"
        self.constants = {f"CONV{n}": w.transpose(0, 3, 1, 2).reshape(3, -1) for n, w in enumerate(self._weights, 1)}
        if self._slope is not None:
            self.constants["LEAK"] = self._slope.reshape(1)
        self.state = "".join(
            f"    float ring{n}[{self._signs}][3][{slots}][{inputs}];\n"
            for n, (slots, (_, inputs)) in enumerate(zip(self._slots, shapes, strict=True), 1)
        )
        self.state += "    unsigned char newest[3];\n    unsigned char running;\n"
        rings = sum(slots * inputs for slots, (_, inputs) in zip(self._slots, shapes, strict=True))
        self.functions, self.body = "\n".join(self._layer(n) for n in range(3)), self._statements()
        self.state_bytes = 4 * 3 * self._signs * rings + 4
        products = sum(w.size for w in self._weights) * self._signs
        bends = sum(w.shape[1] for w in self._weights) * 3 * self._signs if self._signs == 2 else 0
        self.cost = Cost(products + bends + (3 if bends else 0), products + (3 if bends else 0), bends)

    start = "state->newest[0] = state->newest[1] = state->newest[2] = 0;\nstate->running = 0;"

    def _layer(self, n: int) -> str:
        _, outputs, inputs, kernel = self._weights[n].shape
        products = [f"y{o} += w[{o * inputs + i}] * v[{i}];" for o in range(outputs) for i in range(inputs)]
        bent = "y{o}" if self._slope is None else "y{o} >= 0.0f ? y{o} : LEAK[0] * y{o}"
        return _LAYER.format(
            number=n + 1,
            inputs=inputs,
            outputs=outputs,
            kernel=kernel,
            dilation=self._dilations[n],
            slots=self._slots[n],
            stride=inputs * outputs,
            accumulators=", ".join(f"y{o} = 0.0f" for o in range(outputs)),
            store="\n".join(f"        ring[newest + n][{i}] = x[{i}];" for i in range(inputs)),
            products="\n".join(f"        {product}" for product in products),
            results="\n".join(f"    y[{o}] = {bent.format(o=o)};" for o in range(outputs)),
        )

    def _statements(self) -> str:
        """Run the layers of each axis; then, since all axes share the rings' positions, move these on."""
        fills = [f"state->running ? 1 : {slots}" for slots in self._slots]
        channels = [weight.shape[1] for weight in self._weights]
        call = [
            f"layer{n}(CONV{n}[i], state->ring{n}[sign][i], state->newest[{n - 1}], {fill}, {source}, {target});"
            for n, (fill, source, target) in enumerate(zip(fills, ("x", "y1", "y2"), ("y1", "y2", "y3"), strict=True), 1)
        ]
        locals_ = ", ".join(f"y{n}[{count}]" for n, count in enumerate(channels, 1))
        if self._signs == 1:
            lines = ["for (int i = 0; i < 3; i++) {", f"    float x[1] = {{r[i]}}, {locals_};"]
            lines += [f"    {line.replace('[sign]', '[0]')}" for line in call] + ["    r[i] = y3[0];", "}"]
        else:
            lines = ["for (int i = 0; i < 3; i++) {", "    float odd[2];", "    for (int sign = 0; sign < 2; sign++) {"]
            lines += [f"        float x[1] = {{sign ? -r[i] : r[i]}}, {locals_};"] + [f"        {line}" for line in call]
            lines += ["        odd[sign] = y3[0];", "    }", "    r[i] = (odd[0] - odd[1]) * 0.5f;", "}"]
        for n, slots in enumerate(self._slots):
            lines.append(f"state->newest[{n}] = (unsigned char)(state->newest[{n}] + 1u < {slots}u ? state->newest[{n}] + 1u : 0u);")
        return "\n".join([*lines, "state->running = 1;"])

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        if self._slope is None:
            return self._net(rate)
        return (self._net(rate) - self._net(-rate)) * np.float32(0.5)

    def _net(self, rate: np.ndarray) -> np.ndarray:
        x = rate.T[:, None, :]  # (axis, channel, sample)
        count = x.shape[-1]
        for weight, dilation in zip(self._weights, self._dilations, strict=True):
            _, outputs, channels, kernel = weight.shape
            held = np.concatenate([np.repeat(x[..., :1], (kernel - 1) * dilation, axis=-1), x], axis=-1)
            y = np.zeros((3, outputs, count), dtype=np.float32)
            for tap in range(kernel):
                for channel in range(channels):
                    at = tap * dilation
                    y = y + weight[:, :, channel, tap, None] * held[:, channel, None, at : at + count]
            x = y if self._slope is None else np.where(y >= 0, y, self._slope * y)
        return x[:, 0, :].T
