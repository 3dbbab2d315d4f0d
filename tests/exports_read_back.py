"""Random samples, models and accelerometers that other programs can carry, and how what was read back is compared with them."""

from dataclasses import replace

import numpy as np
from conftest import DEG, config
from scipy.spatial.transform import Rotation

from session.log.config import Accelerometer
from session.log.samples import Samples
from tinygc.deploy.exports._context import Context
from tinygc.effects import AppliedEffect, Conditions, catalogue
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_table
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

UPPER, BIAS = np.array([[1.0102, 0.0021, -0.0043], [0, 0.9891, 0.0032], [0, 0, 1.0051]]), np.array([0.31, -0.22, 0.13])
ACCELEROMETERS = {
    "as measured": Accelerometer(),
    "triad": Accelerometer(UPPER, BIAS, "stills"),
    "with a turn of the frame": Accelerometer(Rotation.from_rotvec([0.004, -0.006, 0.003]).as_matrix() @ UPPER, BIAS, "prior"),
    "diagonal": Accelerometer(np.diag([1.01, 0.99, 1.005]), BIAS, "stills"),
}


def physics(linear, *ids):
    effects = [catalogue()[name] for name in ids]
    return PhysicsModel(
        linear, tuple(AppliedEffect(effect, 0.1 * DEG * RNG.normal(size=effect.parameter.size)) for effect in effects), KNOWN
    )


MODELS = {
    "linear": LINEAR,
    "net that does not bend": UNBENT,
    "g-sensitivity": physics(LINEAR, "gyro.g_sensitivity"),
}


def context(said=None, accelerometer=None, **changes):
    """accelerometer: of the fit; session.toml gives none."""
    noise = {"gyro_dps_rthz": [5e-3, 6e-3, 4e-3], "accel_g_rthz": [6e-5] * 3}
    made = Context("s", "m", config(), {"covariance": np.eye(12).tolist()}, {"noise": noise}, {})
    if accelerometer is not None:
        made.table["accelerometer"] = accelerometer_table(accelerometer)
    return replace(made, remark=(said if said is not None else []).append, **changes)


def rates(model):
    """Of the model itself, for a log of independent samples."""
    if not model.undone:
        return model(MEASURED)
    stamps = np.arange(len(MEASURED)) * 10_000_000_000  # so far apart that nothing is averaged
    return model.calibrate(Samples(stamps, MEASURED, FORCE, CELSIUS))


def agree(there, model):
    """Rates by a model, or forces by an accelerometer, to 1e-6 of the largest."""
    expected = model.correct(FORCE) if isinstance(model, Accelerometer) else rates(model)
    assert np.abs(there - expected).max() <= 1e-6 * np.abs(expected).max()


def autopilot_parameters(text):
    """Of PX4's or ArduPilot's file, in single precision."""
    rows = [line.split("\t")[2:4] if "\t" in line else line.split(",") for line in text.splitlines() if not line.startswith("#")]
    return {key: float(np.float32(value)) for key, value in rows}


def autopilot_zero(name, p, celsius, gyro=True):
    """What the program takes off at each temperature (N, 3): PX4 about TREF, ArduPilot about 35 degC, added again at CALTEMP."""
    if name == "px4":
        kind, own = "G" if gyro else "A", [p.get(f"CAL_GYRO0_{axis}OFF", 0.0) * gyro for axis in "XYZ"]
        if p.get(f"TC_{kind}_ENABLE") != 1:
            return np.tile(own, (len(celsius), 1))
        away = (np.clip(celsius, p[f"TC_{kind}0_TMIN"], p[f"TC_{kind}0_TMAX"]) - p[f"TC_{kind}0_TREF"])[:, None]
        return own + sum(np.array([p[f"TC_{kind}0_X{n}_{i}"] for i in range(3)]) * away**n for n in range(4))

    def poly(at):
        away = np.reshape(np.clip(at, p["INS_TCAL1_TMIN"], p["INS_TCAL1_TMAX"]) - 35, (-1, 1))
        rows = [np.array([p[f"INS_TCAL1_{'GYR' if gyro else 'ACC'}{n}_{axis}"] for axis in "XYZ"]) for n in (1, 2, 3)]
        return 1e-6 * sum(row * away**n for n, row in enumerate(rows, 1))

    own = np.array([p.get(f"INS_GYROFFS_{axis}", 0.0) * gyro for axis in "XYZ"])
    return own + (poly(celsius) - poly(p["INS_GYR1_CALTEMP"]) if p.get("INS_TCAL1_ENABLE") == 1 else np.zeros((len(celsius), 3)))
