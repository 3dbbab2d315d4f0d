"""Random samples, models that other programs can carry, and how their rates are compared with what was read back."""

from dataclasses import replace

import numpy as np
from conftest import DEG, config

from session.io.samples import Samples
from tinygc.deploy.exports._context import Context
from tinygc.effects import AppliedEffect, Conditions, catalogue
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import PhysicsModel

RNG = np.random.default_rng(11)
MEASURED, FORCE = RNG.uniform(-8, 8, (10_000, 3)), RNG.uniform(-20, 20, (10_000, 3))
CELSIUS = RNG.uniform(22, 30, 10_000)
LINEAR = LinearModel(np.eye(3) + 0.02 * RNG.normal(size=(3, 3)), 0.02 * RNG.normal(size=3))
OFFSETS = LinearModel(np.eye(3), 0.02 * RNG.normal(size=3))
SHAKEN = 1e-2 * np.r_[RNG.normal(size=12), 0, 0, 0, RNG.normal(size=12)]
UNBENT = CalibrationNet.from_vector(CalibrationNet.from_linear(LINEAR).vector + SHAKEN)
KNOWN = Conditions(duration_s=200.0, fs_rps=500 * DEG, first_temp_c=25.5)


def physics(linear, *ids):
    effects = [catalogue()[name] for name in ids]
    return PhysicsModel(
        linear, tuple(AppliedEffect(effect, 0.1 * DEG * RNG.normal(size=effect.parameter.size)) for effect in effects), KNOWN
    )


def context(said=None, **changes):
    noise = {"gyro_dps_rthz": [5e-3, 6e-3, 4e-3], "accel_g_rthz": [6e-5] * 3}
    made = Context("s", "m", config(), {"covariance": np.eye(12).tolist()}, {"noise": noise}, {})
    return replace(made, say=(said if said is not None else []).append, **changes)


def rates(model):
    """Of the model itself, for a log of independent samples."""
    if not model.undone:
        return model(MEASURED)
    stamps = np.arange(len(MEASURED)) * 10_000_000_000  # so far apart that nothing is averaged
    return model.calibrate(Samples(stamps, MEASURED, FORCE, CELSIUS))


def agree(there, model):
    expected = rates(model)
    assert np.abs(there - expected).max() <= 1e-6 * np.abs(expected).max()


MODELS = {
    "linear": LINEAR,
    "net that does not bend": UNBENT,
    "g-sensitivity": physics(LINEAR, "gyro.g_sensitivity"),
}
