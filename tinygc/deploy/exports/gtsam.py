"""GTSAM: the covariances of its preintegration, as JSON and as Python that sets them.

They are squares of continuous densities (gtsam/navigation, ImuFactor and CombinedImuFactor): a step of dt divides the covariances of the
readings by dt, and multiplies those of the biases by dt:

    gyroscopeCovariance = N^2, accelerometerCovariance = N^2, biasOmegaCovariance = K^2, biasAccCovariance = K^2.

``integrationCovariance`` is no noise of the sensor, but the error of integration: m^2/s.  Older releases also have the covariance of the
bias at which one preintegrates, which the prior of the graph has; its default there, the identity, would drown all noise.
"""

from __future__ import annotations

import numpy as np

from session.base.records import json_text
from session.base.texts import command_line
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import densities, noise_remarks
from tinygc.deploy.exports._text import remarks
from tinygc.models.model import Model

NAME = "gtsam"
#: m^2/s: 0.1 mm after a second, which keeps the covariance of a short preintegration regular
INTEGRATION = 1e-8
KEYS = {"gyro": ("gyroscopeCovariance", "biasOmegaCovariance"), "accel": ("accelerometerCovariance", "biasAccCovariance")}
UNITS = {
    "gyroscopeCovariance": "rad^2/s",
    "accelerometerCovariance": "m^2/s^3",
    "integrationCovariance": "m^2/s",
    "biasOmegaCovariance": "rad^2/s^3",
    "biasAccCovariance": "m^2/s^5",
}
CODE = '''
import json
from pathlib import Path

import gtsam
import numpy as np


def preintegration_params(n_gravity, path=Path(__file__).with_name("gtsam_imu.json")):
    """PreintegrationCombinedParams with the noise of this unit; n_gravity: gravity in its frame, m/s^2: (0, 0, -9.81) for Z up."""
    covariances = {key: np.array(value) for key, value in json.loads(path.read_text(encoding="utf-8"))["covariances"].items()}
    params = gtsam.PreintegrationCombinedParams(np.array(n_gravity, dtype=float))
    params.setGyroscopeCovariance(covariances["gyroscopeCovariance"])
    params.setAccelerometerCovariance(covariances["accelerometerCovariance"])
    params.setIntegrationCovariance(covariances["integrationCovariance"])
    params.setBiasOmegaCovariance(covariances["biasOmegaCovariance"])
    params.setBiasAccCovariance(covariances["biasAccCovariance"])
    if hasattr(params, "setBiasAccOmegaInit"):  # older releases: of the bias at which one preintegrates, which is the prior's
        params.setBiasAccOmegaInit(np.zeros((6, 6)))
    return params
'''


def export(model: Model, context: Context) -> dict[str, str]:
    """Export the noise; of the model nothing, since GTSAM has no intrinsics."""
    context.remark(f"gtsam has no intrinsics: calibrate the readings before they are preintegrated (`{command_line('apply')}`, or --to c)")
    return export_noise(context)


def export_noise(context: Context) -> dict[str, str]:
    """Export the noise, which needs no model."""
    found = densities(context, NAME)
    table, sources = {"integrationCovariance": np.eye(3) * INTEGRATION}, {"integrationCovariance": "not of the sensor"}
    for kind, names in KEYS.items():
        for name, density in zip(names, (found[kind].white, found[kind].walk), strict=True):
            table[name] = np.diag(density.each**2)
            sources[name] = "; ".join(density.sources)
    lines = (
        "gyroscopeCovariance = N^2, accelerometerCovariance = N^2, biasOmegaCovariance = K^2, biasAccCovariance = K^2: squares of",
        "continuous densities on each axis, which GTSAM itself divides by dt (N) or multiplies by dt (K).",
        f"integrationCovariance = {INTEGRATION:g} I is no noise of the sensor; GTSAM's default, I, would drown all else.",
        "If your driver turns the axes by R, a covariance C becomes R C R^T.",
        "GTSAM calibrates nothing of the sensor but its biases: give it calibrated readings.",
        *noise_remarks(context, found),
    )
    head = remarks(context, *lines)
    written = {
        "comment": [line.removeprefix("# ") for line in head.splitlines()],
        "units": {name: UNITS[name] for name in table},
        "sources": sources,
        "covariances": {name: matrix.tolist() for name, matrix in table.items()},
    }
    return {"gtsam_imu.json": json_text(written) + "\n", "gtsam_imu.py": head + CODE}
