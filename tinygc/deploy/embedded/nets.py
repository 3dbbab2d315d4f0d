"""The calibration subnet in single precision, in its three kinds: the paper's, the published one, and the one that is told conditions."""

from __future__ import annotations

from textwrap import indent

import numpy as np

from session.common.units import G
from tinygc.deploy.embedded.affine import ADD, COST, affine, table
from tinygc.deploy.embedded.stage import Cost, Inputs, ProgramStage, single
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.conditions_net import CONDITIONS, ConditionsModel
from tinygc.models.published_net import PublishedNet


def prelu(x: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """x where it is not negative, slope x below."""
    return np.where(x >= 0, x, slope * x)


class CalibrationNetStage(ProgramStage):
    """The paper's 27 parameters: r + W2 PReLU(W1 r + b1) + b2, a slope per axis."""

    says = "r += W2 h + b2, h = W1 r + b1 where positive, slope times that below"
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
        """What the body does to rates (N, 3) float32, in the same order."""
        h = prelu(affine(self.constants["HIDDEN"], rate), self.constants["SLOPE"])
        return rate + affine(self.constants["OUTER"], h)


class Published(ProgramStage):
    """The authors' 26 parameters: r + P2(W2 P1(W1 r + b1) + b2), one slope after each block."""

    says = "r += P2(W2 P1(W1 r + b1) + b2), P(x) = x where positive, slope x below"
    cost = COST + COST + Cost(multiply=6, add=3, compare=6)
    body = """\
float s[3], h[3];
affine(HIDDEN, r, s);
for (int i = 0; i < 3; i++)
    h[i] = s[i] >= 0.0f ? s[i] : SLOPES[0] * s[i];
affine(OUTER, h, s);
for (int i = 0; i < 3; i++)
    r[i] += s[i] >= 0.0f ? s[i] : SLOPES[1] * s[i];"""

    def __init__(self, net: PublishedNet):
        hidden, outer = table(net.W1, net.b1, "the net"), table(net.W2, net.b2, "the net")
        self.constants = {"HIDDEN": hidden, "OUTER": outer, "SLOPES": single([*net.slope1, *net.slope2], "the net")}

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        first, second = self.constants["SLOPES"]
        h = prelu(affine(self.constants["HIDDEN"], rate), first)
        return rate + prelu(affine(self.constants["OUTER"], h), second)


class Conditioned(ProgramStage):
    """A net of 27 beside what temperature and force do to its biases and gains: net(r) + bias c + r (gain c)."""

    says = "r = net(r) + bias c + r (gain c), c the temperature less T0 or the force, or both; in net(r):"

    def __init__(self, model: ConditionsModel):
        self._net, names = CalibrationNetStage(model.net.net), model.net.names
        units = np.concatenate([[1.0 / G if name == "force" else 1.0] * CONDITIONS[name][0] for name in names])
        self._bias, self._gain = (single(weight * units, "the conditions") for weight in (model.net.bias, model.net.gain))
        self._names = names
        self.says = f"{self.says} {self._net.says}"
        self.constants = {**self._net.constants, "CONDITION_BIAS": self._bias, "CONDITION_GAIN": self._gain}
        fill = []
        for name in names:
            if name == "temperature":
                self._at = single([model.known.first_temp_c], "the conditions")
                self.constants["CONDITION_AT_C"] = self._at
                fill.append("in->temp_c - CONDITION_AT_C[0]")
            else:
                fill += [f"in->force[{axis}]" for axis in range(3)]
        count = len(fill)
        self.cost = self._net.cost + Cost(multiply=6 * count + 3, add=6 * count + 6 + ("temperature" in names))
        self.body = f"""\
const float c[{count}] = {{{", ".join(fill)}}};
float more[3];
for (int i = 0; i < 3; i++) {{
    float bias = 0.0f, gain = 0.0f;
    for (int k = 0; k < {count}; k++) {{
        bias += CONDITION_BIAS[i][k] * c[k];
        gain += CONDITION_GAIN[i][k] * c[k];
    }}
    more[i] = bias + r[i] * gain;
}}
{{
{indent(self._net.body, "    ")}
}}
for (int i = 0; i < 3; i++)
    r[i] += more[i];"""

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        parts = [(inputs.temp_c - self._at)[:, None] if name == "temperature" else inputs.force for name in self._names]
        c = np.concatenate(parts, axis=1)
        bias = gain = np.zeros_like(rate)
        for k in range(c.shape[1]):
            bias = bias + self._bias[:, k] * c[:, k, None]
            gain = gain + self._gain[:, k] * c[:, k, None]
        more = bias + rate * gain
        return self._net.run(inputs, rate) + more
