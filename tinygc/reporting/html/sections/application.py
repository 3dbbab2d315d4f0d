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
    model = adopted.in_use
    linear = model.linear if isinstance(model, PhysicsModel) else model
    E, B = linear.E, linear.B
    # Only if the logs hold registers.
    per_lsb = session.config.sensor.register_units.gyro_rps if all(log.raw for log in session.logs) else None
    tries = [[", ".join(f"{v:g}".replace("-", "−") for v in m), *(fixed(v, 6) for v in (E @ (m * DEG) + B) / DEG)] for m in TRY_DPS]
    name = f"model_{adopted.method}.json"
    html = render(
        "application.html",
        e=evidence,
        per_lsb=per_lsb,
        deg=DEG,
        name=name,
        folder=session.folder,
        file=file if (file := session.folder / "fit" / name).is_file() else name,
        needs=Calibration(model, 1.0).needs,
        E=E,
        B=B,
        undone=model.undone,
        accelerometer=adopted.accelerometer,
        tries=tries,
        data=b64encode(json_text(model_table(adopted, evidence.fit)).encode()).decode(),
    )
    return Section("apply", "Apply it", html)
