"""A short log and what the model makes of it, for whoever writes the model anew."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from session.log.config import Sensor
from tinygc.deploy.calibration import Calibration
from tinygc.models.model import Model

#: beyond the longest memory that a model has
SAMPLES = 64
SEED = 20240302
#: of the full scale
FILLED = 0.8


def self_test(model: Model, sensor: Sensor, samples: int = SAMPLES) -> dict:
    """Consecutive samples at the nominal data rate, drawn with a fixed seed: inputs and outputs, all SI."""
    rng = np.random.default_rng(SEED)
    full_scale = sensor.gyro_fs_dps * DEG
    raw = rng.uniform(-FILLED * full_scale, FILLED * full_scale, (samples, 3))
    raw[0] = 0.0
    force = rng.uniform(-G, G, (samples, 3))
    temperature = 25 + np.linspace(0, 2, samples)
    omega = Calibration(model, sensor.odr_hz)(raw, force, temperature)
    return {
        "rate_hz": sensor.odr_hz,
        "measured_rps": raw.tolist(),
        "specific_force_mps2": force.tolist(),
        "temperature_c": temperature.tolist(),
        "omega_rps": omega.tolist(),
    }
