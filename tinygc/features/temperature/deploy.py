"""Export of a calibration over temperature to C, PX4 and ArduPilot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from session.base.texts import significant
from session.base.units import DEG
from tinygc.deploy import ExportError
from tinygc.deploy.exports._autopilots import Zero, remark_on_scale
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import LinearPart
from tinygc.effects.device import Stage
from tinygc.features.temperature.model import ThermalModel, time_and_share, weights

#: what a linear format cannot carry, and which formats can
CARRIED = "a calibration over temperature; px4 and ardupilot carry its zero, c and json all of it"

# A calibration over temperature in single precision: Horner's rule for zero and E, and the elements' temperatures where there is a lag.
#
# With a lag of minutes at hundreds of samples a second, a step changes the state by less than single precision resolves.  The state is
# therefore two numbers, the second of which is the rounding error of the first (Kahan 1965).

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
_MEMORY: dict[str, Any] = {
    "state": "    float element[3];\n    float lost[3];\n    float reading;\n    float warm;\n",
    "state_bytes": 32,
    "start": "state->warm = 0.0f;\nstate->reading = 0.0f;\nfor (int i = 0; i < 3; i++)\n    state->element[i] = state->lost[i] = 0.0f;",
}
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


def stage(model: ThermalModel, rate_hz: float | None) -> Stage:
    """r = E(T) (r - zero(T_e)) as x + (E(T) - I) x."""
    matrices = model.E_terms.copy()
    matrices[0] -= np.eye(3)
    constants = {"THERMAL_C": np.array([model.reference_c, *model.range_c]), "THERMAL_ZERO": model.zero_terms, "THERMAL_E": matrices}
    zero, matrix = len(model.zero_terms) - 1, len(matrices) - 1
    follow, memory = "for (int i = 0; i < 3; i++)\n    element[i] = in->temp_c;\n", {}
    if model.lag_s.any():
        if rate_hz is None:
            raise ExportError("a lag of the temperature needs the data rate; give the session's sensor.odr_hz")
        constants["THERMAL_LAG"] = np.array([_lag(float(tau), rate_hz) for tau in model.lag_s])
        follow, memory = _FOLLOW, _MEMORY
    formula = "r = E(T) (r - zero(T_e)), polynomials of the temperature"
    return Stage(formula, _BODY.format(follow=follow, zero=zero, matrix=matrix), constants, _calibrated, _HELD, **memory)


def _calibrated(c: dict[str, np.ndarray], rate: np.ndarray, inputs: Any) -> np.ndarray:
    """What the body does to rates (N, 3) float32, in the same order of operations."""
    t, at = (
        np.minimum(np.maximum(celsius, c["THERMAL_C"][1]), c["THERMAL_C"][2]) - c["THERMAL_C"][0]
        for celsius in (_elements(c.get("THERMAL_LAG"), inputs.temp_c), inputs.temp_c)
    )
    zero = np.broadcast_to(c["THERMAL_ZERO"][-1], t.shape)
    for terms in c["THERMAL_ZERO"][-2::-1]:
        zero = zero * t + terms
    x = rate - zero
    E = np.broadcast_to(c["THERMAL_E"][-1], (len(x), 3, 3))
    for matrix in c["THERMAL_E"][-2::-1]:
        E = E * at[:, None, None] + matrix
    s = np.zeros_like(x)
    for j in range(3):
        s = s + E[:, :, j] * x[:, j : j + 1]
    return x + s


def _elements(lag: np.ndarray | None, reading: np.ndarray) -> np.ndarray:
    """(N, 3) float32, one sample after the other."""
    if lag is None or not len(reading):
        return np.repeat(reading[:, None], 3, axis=1)
    out = np.zeros((len(reading), 3), dtype=np.float32)
    a, new, share = lag.T
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


# A zero over temperature in the format of PX4 and ArduPilot: a cubic about a fixed temperature, without lag.

#: their highest power
CUBIC = 3
#: dps: a lag is reported if ignoring it costs more than this at 1 degC a minute
WORTH_DPS = 1e-4


def cubic_about(terms: np.ndarray, reference_c: float, range_c: tuple[float, float], about_c: float) -> tuple[np.ndarray, float]:
    """Return (4, 3) terms per degC^n about another temperature, from terms (n, 3) about ``reference_c``, and the largest error.

    Exact up to the third order; beyond it the least-squares cubic, with uniform weight over the range.
    """
    out, lost = np.zeros((CUBIC + 1, 3)), 0.0
    at = np.linspace(*range_c, 201)
    for axis in range(3):
        own = Polynomial(terms[:, axis])
        near = own if own.trim().degree() <= CUBIC else Polynomial.fit(at - reference_c, own(at - reference_c), CUBIC).convert()
        lost = max(lost, float(np.abs(near(at - reference_c) - own(at - reference_c)).max()))
        moved = near(Polynomial([about_c - reference_c, 1.0])).coef
        out[: len(moved), axis] = moved
    return out, lost


def zero(model: ThermalModel, context: Context, name: str, about_c: float | None) -> Zero:
    """Return what an autopilot holds of the model, and report what it does not; about_c: of its terms, else the model's reference."""
    reference, linear = model.reference_c, model.at(model.reference_c)
    about_c = reference if about_c is None else about_c
    terms, lost_rps = cubic_about(model.zero_terms, reference, model.range_c, about_c)
    remark_on_scale(context, name, model.E(np.array(model.range_c)))
    if lost_rps > 0:
        context.remark(f"{name} has no power beyond the third: the nearest cubic is off by up to {significant(lost_rps / DEG, 2)} dps")
    slope = np.abs(model.zero_terms[1]) if len(model.zero_terms) > 1 else np.zeros(3)
    behind = float(np.max(np.abs(model.lag_s) * slope)) / 60 / DEG
    if behind > WORTH_DPS:
        lags, off = ", ".join(f"{lag:.0f}" for lag in model.lag_s), significant(behind, 2)
        context.remark(f"{name} has no lag ({lags} s): while the temperature changes by 1 °C a minute the zero is off by up to {off} dps")
    part = LinearPart(linear.E, linear.B, np.zeros((3, 3)), np.zeros(3), reference)
    change = np.asarray(context.table.get("accel_change_mps2") or np.zeros((0, 3)), dtype=float)  # from rest logs
    accel = cubic_about(np.vstack([np.zeros(3), change]), reference, model.range_c, about_c)[0] if len(change) else None
    return Zero(part, terms, reference, model.range_c, accel)
