"""A calibration over temperature in single precision: Horner's rule for zero and E, and the elements' temperatures where there is a lag.

A lag of minutes at hundreds of samples a second moves its state by less than single precision can hold, so the state is two numbers, of
which the second is what the first has lost (Kahan 1965).
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.embedded.stage import Cost, Inputs, ProgramStage, single
from tinygc.deploy.errors import ExportError
from tinygc.models.element_temperature import time_and_share, weights
from tinygc.models.thermal import ThermalModel

_HELD = """\
/* The temperature within the range that was measured, less the reference. */
static float held(float celsius)
{
    float t = celsius;
    if (t < THERMAL_C[1])
        t = THERMAL_C[1];
    if (t > THERMAL_C[2])
        t = THERMAL_C[2];
    return t - THERMAL_C[0];
}
"""
_FOLLOW = """\
const float reading = in->temp_c;
if (!state->warm) {
    for (int i = 0; i < 3; i++) {
        state->element[i] = reading;
        state->lost[i] = 0.0f;
    }
    state->reading = reading;
    state->warm = 1.0f;
}
for (int i = 0; i < 3; i++) {
    const float step = THERMAL_LAG[i][0] * ((state->reading - state->element[i]) - state->lost[i])
        + THERMAL_LAG[i][1] * (reading - state->reading);
    const float lost = state->lost[i] + step;
    const float sum = state->element[i] + lost;
    state->lost[i] = lost - (sum - state->element[i]);
    state->element[i] = sum;
    element[i] = sum + THERMAL_LAG[i][2] * (reading - sum);
}
state->reading = reading;
"""
_BODY = """\
float element[3], x[3], s[3];
{follow}for (int i = 0; i < 3; i++) {{
    const float t = held(element[i]);
    float zero = THERMAL_ZERO[{zero}][i];
    for (int n = {zero} - 1; n >= 0; n--)
        zero = zero * t + THERMAL_ZERO[n][i];
    x[i] = r[i] - zero;
}}
const float at = held(in->temp_c);
for (int i = 0; i < 3; i++) {{
    s[i] = 0.0f;
    for (int j = 0; j < 3; j++) {{
        float e = THERMAL_E[{matrix}][i][j];
        for (int n = {matrix} - 1; n >= 0; n--)
            e = e * at + THERMAL_E[n][i][j];
        s[i] += e * x[j];
    }}
}}
for (int i = 0; i < 3; i++)
    r[i] = x[i] + s[i];"""


class Thermal(ProgramStage):
    """r = E(T) (r - zero(T_e)) as x + (E(T) - I) x."""

    def __init__(self, model: ThermalModel, rate_hz: float | None):
        matrices = model.E_terms.copy()
        matrices[0] -= np.eye(3)
        self._E, self._zero = single(matrices, "E over temperature"), single(model.zero_terms, "the zero over temperature")
        self._c = single([model.reference_c, *model.range_c], "the temperatures")
        self.says = "r = E(T) (r - zero(T_e)), polynomials of the temperature"
        self.constants = {"THERMAL_C": self._c, "THERMAL_ZERO": self._zero, "THERMAL_E": self._E}
        self.functions, follow = _HELD, "for (int i = 0; i < 3; i++)\n    element[i] = in->temp_c;\n"
        powers = len(self._zero) - 1, len(self._E) - 1
        self.cost = Cost(3 * powers[0] + 9 * (powers[1] + 1), 3 * powers[0] + 9 * (powers[1] + 1) + 10, 8)
        self._lag: np.ndarray | None = None
        if model.lag_s.any():
            if rate_hz is None:
                raise ExportError("a lag of the temperature needs the data rate; give the session's sensor.odr_hz")
            self._lag = single([_lag(float(tau), rate_hz) for tau in model.lag_s], "the lag")
            self.constants["THERMAL_LAG"] = self._lag
            self.state, self.state_bytes = "    float element[3];\n    float lost[3];\n    float reading;\n    float warm;\n", 32
            self.start, follow = "state->warm = 0.0f;\nstate->reading = 0.0f;\n", _FOLLOW
            self.start += "for (int i = 0; i < 3; i++)\n    state->element[i] = state->lost[i] = 0.0f;"
            self.cost = self.cost + Cost(9, 27, 1)
        self.body = _BODY.format(follow=follow, zero=powers[0], matrix=powers[1])

    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does to rates (N, 3) float32, in the same order."""
        element = self._elements(inputs.temp_c)
        t = self._held(element)
        zero = np.broadcast_to(self._zero[-1], t.shape)
        for terms in self._zero[-2::-1]:
            zero = zero * t + terms
        x, at = rate - zero, self._held(inputs.temp_c)
        E = np.broadcast_to(self._E[-1], (len(x), 3, 3))
        for matrix in self._E[-2::-1]:
            E = E * at[:, None, None] + matrix
        s = np.zeros_like(x)
        for j in range(3):
            s = s + E[:, :, j] * x[:, j : j + 1]
        return x + s

    def _held(self, celsius: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(celsius, self._c[1]), self._c[2]) - self._c[0]

    def _elements(self, reading: np.ndarray) -> np.ndarray:
        """(N, 3) float32, one sample after the other."""
        if self._lag is None or not len(reading):
            return np.repeat(reading[:, None], 3, axis=1)
        out = np.zeros((len(reading), 3), dtype=np.float32)
        a, new, share = self._lag.T
        state, lost = np.full(3, reading[0]), np.zeros(3, dtype=np.float32)
        before = reading[0]
        for n, now in enumerate(reading):
            step = a * ((before - state) - lost) + new * (now - before)
            carried = lost + step
            total = state + carried
            lost, state, before = carried - (total - state), total, now
            out[n] = total + share * (now - total)
        return out


def _lag(tau_s: float, rate_hz: float) -> tuple[float, float, float]:
    """(1 - c, new, r) of an axis; without a lag the element has the reading's temperature."""
    a_s, share = time_and_share(tau_s)
    if a_s == 0:
        return 1.0, 1.0, 0.0
    c, new, _ = weights(a_s, 1 / rate_hz)
    return 1 - c, new, share
