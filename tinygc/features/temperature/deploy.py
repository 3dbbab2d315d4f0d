"""Export of a calibration over temperature to C, PX4 and ArduPilot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from session.base.units import DEG
from tinygc.deploy import ExportError
from tinygc.deploy.exports import ardupilot as ardupilot_format
from tinygc.deploy.exports import px4 as px4_format
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import LinearPart, cannot_scale, remarks
from tinygc.effects import Cost
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
    cost = Cost(3 * zero + 9 * (matrix + 1), 3 * zero + 9 * (matrix + 1) + 10, 8)
    follow, memory = "for (int i = 0; i < 3; i++)\n    element[i] = in->temp_c;\n", {}
    if model.lag_s.any():
        if rate_hz is None:
            raise ExportError("a lag of the temperature needs the data rate; give the session's sensor.odr_hz")
        constants["THERMAL_LAG"] = np.array([_lag(float(tau), rate_hz) for tau in model.lag_s])
        follow, memory, cost = _FOLLOW, _MEMORY, cost + Cost(9, 27, 1)
    formula = "r = E(T) (r - zero(T_e)), polynomials of the temperature"
    return Stage(formula, _BODY.format(follow=follow, zero=zero, matrix=matrix), constants, _calibrated, cost, _HELD, **memory)


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


def part_at_reference(model: ThermalModel) -> LinearPart:
    """Return the linear model at the reference temperature."""
    linear = model.at(model.reference_c)
    return LinearPart(linear.E, linear.B, np.zeros((3, 3)), np.zeros(3), model.reference_c)


def say_lost(model: ThermalModel, context: Context, name: str, lost_rps: float) -> None:
    """Report to the operator what the format cannot carry."""
    full_scale = context.config.sensor.gyro_fs_dps
    E = model.E(np.array(model.range_c))
    lost = np.abs(E - np.eye(3)).sum(axis=2).max()
    if lost > 0:  # rest logs alone do not determine E
        context.say(
            f"{name} carries the zero over temperature only, no scale and no misalignment: up to {100 * lost:.2f} % of the rate, "
            f"{lost * full_scale:.2g} dps at {full_scale:g} dps, stays uncorrected"
        )
    if lost_rps > 0:
        context.say(f"{name} has no power beyond the third: the nearest cubic is off by up to {lost_rps / DEG:.2g} dps")
    slope = np.abs(model.zero_terms[1]) if len(model.zero_terms) > 1 else np.zeros(3)
    behind = float(np.max(np.abs(model.lag_s) * slope)) / 60 / DEG
    if behind > WORTH_DPS:
        lags = ", ".join(f"{lag:.0f}" for lag in model.lag_s)
        context.say(
            f"{name} has no lag ({lags} s): while the temperature changes by 1 °C a minute the zero is off by up to {behind:.2g} dps"
        )


def accel_change(context: Context) -> np.ndarray | None:
    """(n + 1, 3) m/s^2 per degC^n about the reference: the accelerometer's change from rest logs; None where unknown."""
    change = context.table.get("accel_change_mps2")
    terms = np.asarray(change, dtype=float) if change else np.zeros((0, 3))
    return np.vstack([np.zeros(3), terms]) if terms.size and terms.ndim == 2 else None


def px4(model: ThermalModel, context: Context) -> str:
    """Return PX4's terms: the zero as a cubic about the model's own reference, and the accelerometer's change where known."""
    part, reference = part_at_reference(model), model.reference_c
    terms, lost = cubic_about(model.zero_terms, reference, model.range_c, reference)
    say_lost(model, context, px4_format.NAME, lost)
    values = {f"CAL_GYRO0_{axis}OFF": value for axis, value in zip("XYZ", terms[0], strict=True)}
    values |= _px4_terms("G", terms, model)
    accel = accel_change(context)
    switches: tuple[str, ...] = ("G",)
    if accel is not None:
        values |= _px4_terms("A", cubic_about(accel, reference, model.range_c, reference)[0], model)
        switches = ("G", "A")
    head = remarks(
        context,
        *cannot_scale(part),
        "corrected = measured - CAL_GYRO0_*OFF - (TC_G0_X1_* dT + TC_G0_X2_* dT^2 + TC_G0_X3_* dT^3),  dT = T - TC_G0_TREF, T held",
        "within TC_G0_TMIN to TC_G0_TMAX; rad/s, degC, in the sensor's axes before PX4 rotates the board.  TC_A0 likewise, m/s^2: what",
        "the accelerometer reads otherwise than at TC_A0_TREF in the one attitude in which it lay.  CAL_GYRO0_ID, TC_G0_ID and TC_A0_ID",
        "must hold this sensor's device ids: they are not known here.  Change the 0 if it is another instance.",
    )
    return head + px4_format.table(values, switches)


def _px4_terms(sensor: str, terms: np.ndarray, model: ThermalModel) -> dict[str, float]:
    values = {f"TC_{sensor}0_TMIN": model.range_c[0], f"TC_{sensor}0_TMAX": model.range_c[1], f"TC_{sensor}0_TREF": model.reference_c}
    return values | {f"TC_{sensor}0_X{power}_{axis}": terms[power, axis] if power else 0.0 for power in range(4) for axis in range(3)}


def ardupilot(model: ThermalModel, context: Context) -> str:
    """Return ArduPilot's terms: the zero as a cubic about 35 degC, its constant in the offsets, which hold at INS_GYR1_CALTEMP."""
    part, reference = part_at_reference(model), model.reference_c
    terms, lost = cubic_about(model.zero_terms, reference, model.range_c, ardupilot_format.ABOUT_C)
    say_lost(model, context, ardupilot_format.NAME, lost)
    values: dict[str, float] = {f"INS_GYROFFS_{axis}": value for axis, value in zip("XYZ", part.bias, strict=True)}
    values |= {"INS_TCAL1_ENABLE": 1, "INS_TCAL1_TMIN": model.range_c[0]}
    values |= {"INS_TCAL1_TMAX": max(model.range_c[1], model.range_c[0] + ardupilot_format.LEAST_C), "INS_GYR1_CALTEMP": reference}
    values |= _ardupilot_terms("GYR", terms)
    accel = accel_change(context)
    if accel is not None:
        values |= _ardupilot_terms("ACC", cubic_about(accel, reference, model.range_c, ardupilot_format.ABOUT_C)[0])
    head = remarks(
        context,
        *cannot_scale(part),
        "corrected = measured - INS_GYROFFS_* - p(T - 35) + p(INS_GYR1_CALTEMP - 35),  p(d) = 1e-6 (GYR1 d + GYR2 d^2 + GYR3 d^3),",
        "T and CALTEMP held within INS_TCAL1_TMIN to TMAX; rad/s, degC, in the axes of the first IMU as ArduPilot's driver turns them.",
        "INS_TCAL1_ACC* likewise, m/s^2; INS_ACC1_CALTEMP is set by ArduPilot's own accelerometer calibration, which comes first.",
        "It calibrates the gyro's offset anew at each boot unless INS_GYR_CAL is 0.",
        longest=ardupilot_format.LONGEST,
    )
    return head + ardupilot_format.table(values)


def _ardupilot_terms(sensor: str, terms: np.ndarray) -> dict[str, float]:
    return {
        f"INS_TCAL1_{sensor}{power}_{axis}": terms[power, i] * ardupilot_format.SCALE for power in (1, 2, 3) for i, axis in enumerate("XYZ")
    }
