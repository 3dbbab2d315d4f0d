"""How to apply the result: formula, direction, units, code with its numbers, and numbers to try it with."""

from __future__ import annotations

from base64 import b64encode

import numpy as np

from session.io.results import json_text
from session.io.units import DEG
from tinygc.deploy.calibration import Calibration
from tinygc.models.physics import PhysicsModel
from tinygc.reporting.html.evidence import Evidence, model_table
from tinygc.reporting.html.markup import Section, code, escape, fixed, paragraph, table

#: measured rates to try an implementation with, dps
TRY_DPS = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0], [12.5, -250.0, 87.25]])


def section(evidence: Evidence) -> Section:
    """All that a colleague needs who has nothing but this page."""
    adopted = evidence.adopted
    model = adopted.in_use
    linear = model.linear if isinstance(model, PhysicsModel) else model
    E, B = linear.E, linear.B
    html = '<p class="formula"><i>ω</i> = <i>E</i> <i>m</i> + <i>B</i></p>'
    html += paragraph(
        "<strong>Direction:</strong> from what the sensor reads, <i>m</i>, to what it feels, <i>ω</i>. <strong>Units:</strong> "
        "rad/s on both sides. "
        "<strong>B is added</strong>: it is not the bias but what removes it. <strong>Order:</strong> row <i>i</i> of <i>E</i> "
        "makes axis <i>i</i> of <i>ω</i>. "
        f"{_measured(evidence)}"
    )
    html += _at_end(evidence) + _by_this_tool(evidence)
    html += f"<h3>Python</h3>{code(_python(evidence, E, B))}<h3>C</h3>{code(_c(evidence, E, B))}"
    if model.undone:
        html += "<h3>And the physics</h3>" + _effects(evidence)
    html += _force(evidence)
    rows = []
    for m in TRY_DPS:
        omega = (E @ (m * DEG) + B) / DEG
        rows.append((", ".join(f"{v:g}".replace("-", "−") for v in m), *(fixed(v, 6) for v in omega)))
    html += "<h3>Try it</h3>" + table(
        ("m, dps", "ω x, dps", "ω y, dps", "ω z, dps"), rows, "Linear part: what an implementation must give, to its own precision."
    )
    html += paragraph(
        f"On a still, <i>ω</i>{', the effects taken off,' if model.undone else ''} must be the Earth’s rotation, at most 4.2 "
        "mdps on any axis, within the noise. If it is about twice the raw bias, <i>B</i> was subtracted. "
        "The bias of a MEMS gyroscope is another one after each switch-on and at another temperature: <i>E</i> lasts; take <i>B"
        "</i> anew from a still, as minus <i>E</i> times its mean rate plus the Earth’s."
    )
    data = b64encode(json_text(model_table(adopted, evidence.fit)).encode()).decode()
    name = f"model_{adopted.method}.json"
    html += (
        f'<p><a class="download" download="{name}" href="data:application/json;base64,{data}">{name}</a><span class="soft">all '
        "digits, with the covariance where there is one</span></p>"
    )
    return Section("apply", "Apply it", html)


def _force(evidence: Evidence) -> str:
    """The accelerometer's own calibration, in the same body frame."""
    accelerometer = evidence.adopted.accelerometer
    if accelerometer.source == "none":
        return ""
    rows = ",\n              ".join(f"[{row}]" for row in _rows(accelerometer.matrix))
    return "<h3>The accelerometer</h3>" + code(
        f"M = np.array([{rows}])\nb = np.array([{_rows(accelerometer.bias_mps2)[0]}])  # m/s^2\n"
        "f = (a - b) @ M.T  # (N, 3) m/s^2: a as measured, f the specific force in the axes of omega"
    )


def _at_end(evidence: Evidence) -> str:
    """What a drift or a step of that one session is, once it is over."""
    if not (bygone := evidence.adopted.follows_session):
        return ""
    words = escape(", ".join(bygone))
    return paragraph(
        f"<strong>{words} followed the time of this session</strong>, and nobody knows how it goes on. What is given here keeps the bias "
        "of the session’s end; among the parameters it is that of its beginning. Take the bias afresh before each use."
    )


def _by_this_tool(evidence: Evidence) -> str:
    """The command, and the line of Python, with just the arguments that this model asks for."""
    adopted = evidence.adopted
    needs, name = Calibration(adopted.in_use, 1.0).needs, f"model_{adopted.method}.json"
    load = f'"{name}", rate_hz={evidence.fit.session.config.sensor.odr_hz:g}' if "rate_hz" in needs else f'"{name}"'
    given = ", ".join(["m", *(f"{what}={what}" for what in ("acc", "temp") if what in needs)])
    said = {"acc": "<i>acc</i> in m/s², calibrated (<code>model.force</code>)", "temp": "<i>temp</i> in °C"}
    units = ", ".join(words for what, words in said.items() if what in needs)
    units = f" ({units})" if units else ""
    return paragraph(
        f"With the file below, for logs of any length: <code>calibrate.py apply {name} LOG.csv -o OUT.csv</code>; in Python "
        f"<code>omega = tinygc.load({escape(load)})({given})</code>{units}. Without this tool:"
    )


def _lsb_rps(evidence: Evidence) -> float | None:
    """rad/s per register's unit, where the logs hold registers."""
    sensor = evidence.fit.session.config.sensor
    return sensor.register_units.gyro_rps if all(log.raw for log in evidence.fit.session.logs) else None


def _measured(evidence: Evidence) -> str:
    per_lsb = _lsb_rps(evidence)
    if per_lsb is None:
        return "<i>m</i> is the measured rate as the log has it."
    return (
        f"<i>m</i> is the register times {1e3 * per_lsb / DEG:g} mdps ({per_lsb:.9g} rad/s), at "
        f"±{evidence.fit.session.config.sensor.gyro_fs_dps:g} dps."
    )


def _rows(matrix: np.ndarray) -> list[str]:
    return [", ".join(f"{value: .9e}" for value in row) for row in np.atleast_2d(matrix)]


def _python(evidence: Evidence, E: np.ndarray, B: np.ndarray) -> str:
    rows = ",\n              ".join(f"[{row}]" for row in _rows(E))
    per_lsb = _lsb_rps(evidence)
    measured = f"registers * {per_lsb:.9e}  # (N, 3) LSB -> rad/s" if per_lsb is not None else "...  # (N, 3) rad/s, as measured"
    return (
        f"import numpy as np\n\nE = np.array([{rows}])\nB = np.array([{_rows(B)[0]}])  # rad/s\nm = {measured}\nomega = m @ E.T "
        "+ B  # (N, 3) rad/s"
    )


def _c(evidence: Evidence, E: np.ndarray, B: np.ndarray) -> str:
    rows = ",\n    ".join("{" + ", ".join(f"{value: .9e}f" for value in row) + "}" for row in E)
    offset = ", ".join(f"{value: .9e}f" for value in B)
    return (
        f"static const float E[3][3] = {{\n    {rows}}};\nstatic const float B[3] = {{{offset}}}; /* rad/s */\n\n"
        "/* m[3]: measured rate, rad/s -> omega[3]: rad/s */\n"
        "for (int i = 0; i < 3; i++)\n    omega[i] = E[i][0] * m[0] + E[i][1] * m[1] + E[i][2] * m[2] + B[i];"
    )


def _effects(evidence: Evidence) -> str:
    """The physics that comes after the linear part."""
    claims = evidence.adopted.in_use.undone
    lines = "".join(f"<li><code>{escape(claim.effect.equation)}</code> ({escape(claim.effect.id)})</li>" for claim in claims)
    html = paragraph(
        "That was the linear part. The sensor also does what follows, in the true rate, before its linear errors; take each off "
        "again, in this order. "
        "Where it depends on the rate itself, begin with the linear result and repeat three times."
    )
    html += f"<ul>{lines}</ul>"
    force = [claim for claim in claims if claim.effect.linear_in == "force"]
    for claim in force:
        rows = ",\n              ".join(f"[{row}]" for row in _rows(claim.theta.reshape(3, 3)))
        html += code(
            f"K = np.array([{rows}])  # rad/s per g, of 9.80665 m/s²\n"
            "omega = m @ E.T + B - f_g @ K.T  # f_g: (N, 3) specific force in g, calibrated"
        )
    html += paragraph(
        "The file below has all parameters; <code>calibrate.py fit --physics auto</code> saves the same model.",
        "soft",
    )
    return html
