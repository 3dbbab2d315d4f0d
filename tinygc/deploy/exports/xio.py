"""x-io: misalignment, sensitivity and offset of Fusion's inertial sensor model and of the x-IMU3's settings.

The header names each element of a matrix and each axis of a vector.  ``FusionMatrix.array`` is ``float[3][3]`` before Fusion 1.3.0 and
``float[9]`` since, and a compiler only warns where the braces are those of the other; the elements' names are the same in every release.
"""

from __future__ import annotations

import numpy as np

from session.base.records import json_text
from session.base.units import DEG, G
from tinygc.deploy import ExportError
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import linear_part, remarks
from tinygc.models.model import Model

NAME = "xio"
#: smallest diagonal factor of an axis, which divides a column of the misalignment
LEAST = 1e-3


def export(model: Model, context: Context) -> dict[str, str]:
    """Export linear models."""
    part = linear_part(model, NAME)
    accelerometer = context.accelerometer
    triads = {
        "gyroscope": (*factor(part.E), part.bias / DEG),
        "accelerometer": (*factor(accelerometer.matrix), accelerometer.bias_mps2 / G),
    }
    lines = (
        "calibrated = misalignment * (sensitivity o (uncalibrated - offset))        o: element by element; deg/s, g",
        "calibrated = FusionModelInertial(uncalibrated, misalignment, sensitivity, offset);",
        "(FusionCalibrationInertial before Fusion 1.3.0; the header is right for both)",
        f"accelerometer: {context.accelerometer_words}",
        part.example(),
    )
    header = remarks(context, *lines, mark="//")
    table = {"comment": [line.removeprefix("// ") for line in header.splitlines()]}
    for name, (misalignment, sensitivity, offset) in triads.items():
        rows = ",\n    ".join(_members(row, f"{axis}{{}}") for axis, row in zip("xyz", misalignment, strict=True))
        header += f"static const FusionMatrix {name}Misalignment = {{.element = {{\n    {rows}\n}}}};\n"
        for word, vector in (("Sensitivity", sensitivity), ("Offset", offset)):
            header += f"static const FusionVector {name}{word} = {{.axis = {{{_members(vector, '{}')}}}}};\n"
        table |= {f"{name}Misalignment": misalignment.ravel().tolist(), f"{name}Sensitivity": sensitivity.tolist()}
        table[f"{name}Offset"] = offset.tolist()
    return {"fusion_calibration.h": header, "ximu3_settings.json": json_text(table) + "\n"}


def factor(E: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(misalignment, sensitivity) with ``E = misalignment @ diag(sensitivity)``; the misalignment has ones on its diagonal."""
    sensitivity = np.diag(E)
    if not (np.abs(sensitivity) > LEAST).all():
        raise ExportError("xio scales each axis by itself, and one of the model's has nothing of its own; json and c carry it")
    return E / sensitivity, sensitivity


def _members(values: np.ndarray, name: str) -> str:
    return ", ".join(f".{name.format(axis)} = {_float(value)}" for axis, value in zip("xyz", values, strict=True))


def _float(value: float) -> str:
    text = f"{value:.9g}"
    return (text if "." in text or "e" in text else text + ".0") + "f"
