"""How to apply the result: formula, direction, units, code with its numbers, and test values."""

from __future__ import annotations

from base64 import b64encode

import numpy as np

from session.base.records import json_text
from session.base.texts import fixed
from session.base.units import DEG
from tinygc.deploy.calibration import Calibration
from tinygc.explanation.reported import ReportData, model_table
from tinygc.models.physics import PhysicsModel
from tinygc.reporting.html.markup import Section, render

#: measured rates as test input, dps
TRY_DPS = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0], [12.5, -250.0, 87.25]])


def section(evidence: ReportData) -> Section:
    """Section of all that is needed to apply the calibration from this page alone."""
    adopted, session = evidence.adopted, evidence.fit.session
    model, accelerometer = adopted.in_use, adopted.accelerometer
    linear = model.linear if isinstance(model, PhysicsModel) else model
    E, B = linear.E, linear.B
    # Only if the logs hold registers.
    per_lsb = session.config.sensor.register_units.gyro_rps if all(log.raw for log in session.logs) else None
    tries = [[", ".join(f"{v:g}".replace("-", "−") for v in m), *(fixed(v, 6) for v in (E @ (m * DEG) + B) / DEG)] for m in TRY_DPS]
    html = render(
        "application.html",
        e=evidence,
        per_lsb=per_lsb,
        deg=DEG,
        name=f"model_{adopted.method}.json",
        needs=Calibration(model, 1.0).needs,
        python=_python(E, B, per_lsb),
        c=_c(E, B),
        undone=model.undone,
        force=[_force(claim.theta.reshape(3, 3)) for claim in model.undone if claim.effect.linear_in == "force"],
        accelerometer="" if accelerometer.source == "none" else _accelerometer(accelerometer.matrix, accelerometer.bias_mps2),
        tries=tries,
        data=b64encode(json_text(model_table(adopted, evidence.fit)).encode()).decode(),
    )
    return Section("apply", "Apply it", html)


def _numpy(matrix: np.ndarray) -> str:
    return "np.array([" + ",\n              ".join(f"[{', '.join(f'{value: .9e}' for value in row)}]" for row in matrix) + "])"


def _vector(values: np.ndarray, end: str = "") -> str:
    return ", ".join(f"{value: .9e}{end}" for value in values)


def _python(E: np.ndarray, B: np.ndarray, per_lsb: float | None) -> str:
    measured = f"registers * {per_lsb:.9e}  # (N, 3) LSB -> rad/s" if per_lsb is not None else "...  # (N, 3) rad/s, as measured"
    return (
        f"import numpy as np\n\nE = {_numpy(E)}\nB = np.array([{_vector(B)}])  # rad/s\nm = {measured}\nomega = m @ E.T + B  # (N, 3) rad/s"
    )


def _force(K: np.ndarray) -> str:
    """The g-sensitivity term, applied after the linear part."""
    return (
        f"K = {_numpy(K)}  # rad/s per g, of 9.80665 m/s²\nomega = m @ E.T + B - f_g @ K.T  # f_g: (N, 3) specific force in g, calibrated"
    )


def _accelerometer(M: np.ndarray, b: np.ndarray) -> str:
    """The accelerometer's calibration, in the same body frame."""
    return (
        f"M = {_numpy(M)}\nb = np.array([{_vector(b)}])  # m/s^2\n"
        "f = (a - b) @ M.T  # (N, 3) m/s^2: a as measured, f the specific force in the axes of omega"
    )


def _c(E: np.ndarray, B: np.ndarray) -> str:
    rows = ",\n    ".join(f"{{{_vector(row, 'f')}}}" for row in E)
    return (
        f"static const float E[3][3] = {{\n    {rows}}};\nstatic const float B[3] = {{{_vector(B, 'f')}}}; /* rad/s */\n\n"
        "/* m[3]: measured rate, rad/s -> omega[3]: rad/s */\n"
        "for (int i = 0; i < 3; i++)\n    omega[i] = E[i][0] * m[0] + E[i][1] * m[1] + E[i][2] * m[2] + B[i];"
    )
