"""Named physics in single precision: the effects that one sample's own data can undo.

What follows the rate itself is undone as ``Effect.correct`` does it, by PASSES substitutions of r <- r - term(r).
"""

from __future__ import annotations

import numpy as np

from session.common.units import G
from tinygc.deploy.embedded.affine import COST, affine, table
from tinygc.deploy.embedded.stage import Cost, Inputs, Stage, single
from tinygc.deploy.exports import ExportError
from tinygc.effects.applied import Claim
from tinygc.effects.conditions import Conditions
from tinygc.effects.effect import PASSES

AHEAD, BYGONE = "it needs samples that are yet to come", "it belongs to the time of that one session"
#: why the others stay behind
REFUSED = {
    "gyro.angular_acceleration": AHEAD,
    "gyro.bandwidth": AHEAD,
    "timing.axis_skew": AHEAD,
    "gyro.vibration_rectification": AHEAD,
    "gyro.bias_drift": BYGONE,
    "gyro.bias_step": BYGONE,
}


class GSensitivity(Stage):
    """The bias follows specific force: r -= K f, f in m/s^2."""

    says = "r -= K f (gyro.g_sensitivity)"
    body = "float s[3];\naffine(G_SENSITIVITY, in->force, s);\nfor (int i = 0; i < 3; i++)\n    r[i] -= s[i];"
    cost = COST + Cost(add=3)

    def __init__(self, theta: np.ndarray, known: Conditions):
        self._w = table(theta.reshape(3, 3) / G, np.zeros(3), "gyro.g_sensitivity")
        self.constants = {"G_SENSITIVITY": self._w}

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        return rate - affine(self._w, inputs.force)


class PerAxis(Stage):
    """One coefficient k per axis: r -= term, where the term, in C and in NumPy, may follow the rate w."""

    name: str
    term_c: str
    passes = PASSES
    per_pass: Cost

    def __init__(self, theta: np.ndarray, known: Conditions):
        self._known = known
        self._k = single(self.scaled(theta), self.says)
        self.constants = {self.name: self._k}

    def scaled(self, theta: np.ndarray) -> np.ndarray:
        """The coefficients of ``term`` from the effect's SI parameters."""
        return theta

    def term(self, k: np.ndarray, w: np.ndarray, inputs: Inputs) -> np.ndarray:
        """What is taken off (N, 3), in the order of the C."""
        raise NotImplementedError

    @property
    def body(self) -> str:
        if self.passes == 1:
            return f"for (int i = 0; i < 3; i++)\n    r[i] -= {self.term_c};"
        return (
            "for (int i = 0; i < 3; i++) {\n    float w = r[i];\n"
            f"    for (int pass = 0; pass < {self.passes}; pass++)\n        w = r[i] - {self.term_c};\n    r[i] = w;\n}}"
        )

    @property
    def cost(self) -> Cost:
        return sum([self.per_pass] * (3 * self.passes), Cost())

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        w = rate
        for _ in range(self.passes):
            w = rate - self.term(self._k, w, inputs)
        return w


class G2Sensitivity(PerAxis):
    """The bias follows the square of the specific force along the axis."""

    says = "r -= k f^2 (gyro.g2_sensitivity)"
    name, term_c, passes, per_pass = "G2_SENSITIVITY", "G2_SENSITIVITY[i] * (in->force[i] * in->force[i])", 1, Cost(2, 1)

    def scaled(self, theta):
        return theta / G**2

    def term(self, k, w, inputs):
        return k * (inputs.force * inputs.force)


class Thermal(PerAxis):
    """What goes with the temperature above that of the calibration's first second."""

    def __init__(self, theta: np.ndarray, known: Conditions):
        super().__init__(theta, known)
        self._at = single([known.first_temp_c], self.says)
        self.constants |= {f"{self.name}_AT_C": self._at}

    def warmer(self, inputs: Inputs) -> np.ndarray:
        return (inputs.temp_c - self._at)[:, None]


class ThermalBias(Thermal):
    """The bias follows temperature."""

    says = "r -= k (T - T0) (gyro.thermal_bias)"
    name, passes, per_pass = "THERMAL_BIAS", 1, Cost(1, 2)
    term_c = "THERMAL_BIAS[i] * (in->temp_c - THERMAL_BIAS_AT_C[0])"

    def term(self, k, w, inputs):
        return k * self.warmer(inputs)


class ThermalScale(Thermal):
    """The sensitivity follows temperature."""

    says = "r -= k (T - T0) r (gyro.thermal_scale)"
    name, per_pass = "THERMAL_SCALE", Cost(2, 2)
    term_c = "THERMAL_SCALE[i] * (in->temp_c - THERMAL_SCALE_AT_C[0]) * w"

    def term(self, k, w, inputs):
        return k * self.warmer(inputs) * w


class ScaleAsymmetry(PerAxis):
    """Positive and negative turns differ in sensitivity."""

    says = "r -= k |r| (gyro.scale_asymmetry)"
    name, term_c, per_pass = "SCALE_ASYMMETRY", "SCALE_ASYMMETRY[i] * (w < 0.0f ? -w : w)", Cost(1, 1, 1)

    def term(self, k, w, inputs):
        return k * np.where(w < 0, -w, w)


class ScaleNonlinearity(PerAxis):
    """The sensitivity changes with the rate: a cubic."""

    says = "r -= k r^3 (gyro.scale_nonlinearity)"
    name, term_c, per_pass = "SCALE_NONLINEARITY", "SCALE_NONLINEARITY[i] * (w * w * w)", Cost(3, 1)

    def scaled(self, theta):
        return theta / self._known.fs_rps**2

    def term(self, k, w, inputs):
        return k * (w * w * w)


CARRIED = {
    "gyro.g_sensitivity": GSensitivity,
    "gyro.g2_sensitivity": G2Sensitivity,
    "gyro.thermal_bias": ThermalBias,
    "gyro.thermal_scale": ThermalScale,
    "gyro.scale_asymmetry": ScaleAsymmetry,
    "gyro.scale_nonlinearity": ScaleNonlinearity,
}


def effect_stage(claim: Claim, known: Conditions) -> Stage:
    """The stage that undoes a claimed effect.  ExportError for one that no device can undo sample by sample."""
    effect = claim.effect.id
    if effect not in CARRIED:
        why = REFUSED.get(effect, "there is no C for it")
        raise ExportError(f"{effect} cannot be exported to C: {why}; json carries it, or export another method's model")
    return CARRIED[effect](np.asarray(claim.theta, dtype=float), known)
