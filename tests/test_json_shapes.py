"""Models and results that anybody may have written: whatever stands where, one line says file, key and what was expected."""

import copy
import json
import warnings

import numpy as np
import pytest
from feature import feature
from models_in_use import KNOWN, LINEAR, MODELS, SAMPLES

import tinygc
from session.base.errors import FormatError
from tinygc import CalibrationError, models
from tinygc.effects import AppliedEffect, catalogue
from tinygc.models.physics import PhysicsModel


def place(table, path):
    for key in path:
        table = table[key]
    return table


def places(value, path=()):
    """Of every key, and of the first entry of every list."""
    if path:
        yield path
    for key in value if isinstance(value, dict) else range(min(len(value), 1)) if isinstance(value, list) else ():
        yield from places(value[key], (*path, key))


#: what somebody, or a broken disk, may leave in the place of any value
BAD = (None, "x", True, -1, 1e308, float("nan"), [], {}, [1], 2.5)
OVER_TEMPERATURE = (np.array([np.eye(3), 1e-4 * np.eye(3)]), np.full((3, 3), 1e-3), np.array([20.0, 0.0, -20.0]), 25.0, (10.0, 40.0))
OF_FEATURES = {"thermal": found.ThermalModel(*OVER_TEMPERATURE)} if (found := feature("tinygc.features.temperature.model")) else {}
WITH_MORE = {
    "covariance": (1e-6 * np.eye(12)).tolist(),
    "unobserved": ["E_xx"],
    "bias_sigma_rps": [1e-3] * 3,
    "sha256": {"log0001.csv": "0"},
    "joint_covariance": {"parameters": ["a"], "matrix": np.eye(21).tolist(), "shared": np.zeros((21, 21)).tolist()},
    "sensor": {"model": "ASM330LHH", "gyro_fs_dps": 500.0, "accel_fs_g": 4.0, "temp_at_zero_c": 25.0},
    "began_s": {"log0001.csv": 0.0},
    "temperature_c": 25.0,
    "accelerometer": {"matrix": np.eye(3).tolist(), "bias_mps2": [0.0] * 3, "source": "given"},
}
TABLES = {name: models.to_dict(model) for name, model in (MODELS | OF_FEATURES).items()}
TABLES["linear with all that stands beside it"] = models.to_dict(LINEAR) | WITH_MORE


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", TABLES)
def test_any_value_in_any_place_of_a_model_is_read_or_refused_in_one_line(name, tmp_path):
    text = json.dumps(TABLES[name])
    told = {"acc": SAMPLES.accel[:5], "temp": np.full(5, 25.0), "began_s": 0.0}
    refused, count, said = 0, 0, []
    for at in list(places(json.loads(text))):
        for n, bad in enumerate((*BAD, KeyError)):
            if len(at) > 3 and n % 3:
                continue
            changed = json.loads(text)
            if bad is KeyError:
                del place(changed, at[:-1])[at[-1]]
            else:
                place(changed, at[:-1])[at[-1]] = bad
            path = tmp_path / f"{count}.json"  # to empty one that is there costs more than all else
            path.write_text(json.dumps(changed))
            count += 1
            try:
                loaded = tinygc.load(path, rate_hz=104.0)
            except FormatError as error:
                said.append(str(error))
                refused += said[-1].startswith(str(path))
                continue
            try:
                assert np.isfinite(loaded(SAMPLES.gyro[:5], **told)).all()
            except CalibrationError as error:
                said.append(str(error))
    assert refused > count / 2
    assert not any("\n" in line for line in said)


def changed(name="linear", **weights):
    """A model's table, its weights or the part that is named changed."""
    table = copy.deepcopy(TABLES[name])
    part = table["denoiser" if "dilations" in weights else "conditions" if "first_temp_c" in weights else "weights"]
    part.update({key: np.asarray(value, dtype=float).tolist() if key in "EB" else value for key, value in weights.items()})
    return json.dumps(table)


SINGULAR = (np.zeros((3, 3)), np.ones((3, 3)), np.diag([1e-9, 1.0, 1.0]), [[0, 0.006, 0.013], [0, 1, 0], [0, 0, 1]])
WARM = PhysicsModel(LINEAR, (AppliedEffect(catalogue()["gyro.thermal_bias"], np.full(3, 1e-4)),), KNOWN)
TABLES["warm"] = models.to_dict(WARM)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        ("{", "broken JSON"),
        ('{"weights": {"E": [1], "E": [2]}}', 'broken JSON: the key "E" stands twice in one table; keep one'),
        (changed().replace("]}", "]"), "broken JSON"),
        (json.dumps(TABLES["linear"] | {"weights": {"E": np.eye(3).tolist(), "B": [0, 0, int("9" * 400)]}}), "weights.B"),
        (
            json.dumps(TABLES["linear"] | {"units": "deg/s in, deg/s out"}),
            'units are "deg/s in, deg/s out", expected "rad/s in, rad/s out"',
        ),
        *((changed(E=E), "weights.E is singular, expected a matrix that keeps all three axes apart; fit again") for E in SINGULAR),
        *((changed(E=E), "weights.E mirrors the axes, expected ") for E in (np.diag([-1.0, 1, 1]), np.eye(3)[[1, 0, 2]])),
        (changed("warm", first_temp_c=None), "conditions.first_temp_c is null, expected a number: the model follows temperature"),
        *(
            (changed("denoised", dilations=[1, bad, 2]), "expected a whole number from 1 to 50")
            for bad in (2.5, True, "2", float("inf"), float("nan"))
        ),
    ],
)
def test_a_model_that_is_none_is_one_line(text, says, tmp_path):
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(FormatError, match=r"m\.json: ") as caught:
        tinygc.load(tmp_path / "m.json")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("corner", "says"),
    [
        (np.diag([1e-300, 5e-324]), None),  # the product of two variances of 1e-300 is 0
        (np.array([[1e-300, 1.0], [1.0, 1.0]]), "covariance is not positive"),
        (np.array([[1.0, 1e308], [-1e308, 1.0]]), "covariance"),
        (np.array([[1.0, 0.99], [0.99, 0.9]]), "covariance is not positive"),
    ],
)
def test_a_covariance_of_any_size_is_judged_without_a_warning(corner, says, tmp_path):
    matrix = np.eye(12)
    matrix[:2, :2] = corner
    (tmp_path / "m.json").write_text(json.dumps(TABLES["linear"] | {"covariance": matrix.tolist()}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if says is None:
            tinygc.load(tmp_path / "m.json")
        else:
            with pytest.raises(FormatError, match=says):
                tinygc.load(tmp_path / "m.json")
