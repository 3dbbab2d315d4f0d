"""Every JSON that the tool reads is held against one validator: whatever stands where, one line says file, key and what was expected."""

import copy
import json

import numpy as np
import pytest
from annex import annex
from conftest import broad
from models_in_use import KNOWN, LINEAR, MODELS, SAMPLES

import tinygc
from session.io.errors import FormatError
from session.io.results import Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Text, read_json, read_required, require, write_whole
from tinygc import CalibrationError, models
from tinygc.effects import AppliedEffect, catalogue
from tinygc.estimation.results import read_fit
from tinygc.models.model import accelerometer_table
from tinygc.models.physics import PhysicsModel

SHAPE = Keys(
    {"name": Text(), "E": Array((3, 3)), "count": Number(1, 9, whole=True)},
    {"kind": Text(("a", "b")), "rows": ListOf(Keys({"x": Number(0, above=True)})), "fine": Flag(), "of": MapOf(Maybe(Number(0, 1)))},
)
GOOD = {
    "name": "n",
    "E": np.eye(3).tolist(),
    "count": 3,
    "kind": "a",
    "rows": [{"x": 1.5}],
    "fine": True,
    "of": {"q": None, "r": 0.5},
    "z": 7,
}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"name": None}, "name is null, expected text"),
        ({"name": 3}, "name is 3, expected text"),
        ({"E": None}, "E is null, expected 3 x 3 numbers"),
        ({"E": [[1, 0], [0, 1]]}, "E has shape 2 x 2, expected 3 x 3 numbers"),
        ({"E": [[1, 0, 0], [0, 1], [0, 0, 1]]}, "E[1] has 2 entries, expected 3 x 3 numbers"),
        ({"E": [[1, 0, 0], [0, "1", 0], [0, 0, 1]]}, 'E[1][1] is "1", expected a number'),
        ({"E": [[1, 0, 0], [0, True, 0], [0, 0, 1]]}, "E[1][1] is true, expected a number"),
        ({"E": [[1, 0, 0], [0, float("nan"), 0], [0, 0, 1]]}, "E[1][1] is NaN, which is not finite; expected a number"),
        ({"E": [[1, 0, 0], [0, 1e308, 0], [0, 0, 1]]}, "E[1][1] is 1e+308, expected a number within 1e+12"),
        ({"E": []}, "E has shape 0, expected 3 x 3 numbers"),
        ({"count": 2.5}, "count is 2.5, expected a whole number from 1 to 9"),
        ({"count": 10}, "count is 10, expected a whole number from 1 to 9"),
        ({"count": True}, "count is true, expected a whole number"),
        ({"count": float("inf")}, "count is Infinity, which is not finite"),
        ({"kind": "c"}, 'kind is "c", expected one of a, b'),
        ({"rows": {}}, "rows is a table, expected a list"),
        ({"rows": [{"x": 1}, {}]}, "rows[1].x is missing, expected a number above 0"),
        ({"rows": [{"x": 0}]}, "rows[0].x is 0, expected a number above 0"),
        ({"fine": 1}, "fine is 1, expected true or false"),
        ({"of": {"q": 2}}, "of.q is 2, expected a number from 0 to 1"),
        ({"of": []}, "of is a list of 0, expected a table"),
    ],
)
def test_what_does_not_fit_is_said_with_its_key(changes, says):
    require(GOOD, SHAPE, "x.json")
    with pytest.raises(FormatError) as caught:
        require(GOOD | changes, SHAPE, "x.json", "mend it")
    said = str(caught.value)
    assert said.startswith(f"x.json: {says}")
    assert said.endswith("; mend it")
    assert "\n" not in said


def test_a_key_that_stands_twice_is_refused(tmp_path):
    path = tmp_path / "m.json"
    path.write_text('{"weights": {"E": [1], "E": [2]}}')
    with pytest.raises(FormatError, match=r'm\.json: broken JSON: the key "E" stands twice in one table; keep one'):
        read_json(path)
    with pytest.raises(FormatError, match=r"keep one; mend it"):
        read_required(path, Keys(), "mend it")


#: what somebody, or a broken disk, may leave in the place of any value
BAD = (None, "x", True, -1, 0, 1e308, -1e308, float("nan"), float("inf"), [], {}, [1], 2.5)
OVER_TEMPERATURE = (np.array([np.eye(3), 1e-4 * np.eye(3)]), np.full((3, 3), 1e-3), np.array([20.0, 0.0, -20.0]), 25.0, (10.0, 40.0))
OF_ANNEXES = {"thermal": found.ThermalModel(*OVER_TEMPERATURE)} if (found := annex("tinygc.annexes.temperature.model")) else {}
WITH_MORE = {
    "covariance": (1e-6 * np.eye(12)).tolist(),
    "unobserved": ["E_xx"],
    "bias_sigma_rps": [1e-3] * 3,
    "sha256": {"log0001.csv": "0"},
    "joint_covariance": {"parameters": ["a"], "matrix": np.eye(21).tolist(), "shared": np.zeros((21, 21)).tolist()},
    "sensor": {"model": "ASM330LHH", "gyro_fs_dps": 500.0, "accel_fs_g": 4.0, "temp_at_zero_c": 25.0},
    "began_s": {"log0001.csv": 0.0},
    "temperature_c": 25.0,
}


def tables():
    from session.io.config import Accelerometer

    yield from ((name, models.to_dict(model)) for name, model in (MODELS | OF_ANNEXES).items())
    more = WITH_MORE | {"accelerometer": accelerometer_table(Accelerometer(source="given"))}
    yield "linear with all that stands beside it", json.loads(json.dumps(models.to_dict(LINEAR) | more))


def places(value, path=()):
    """Of every key, and of the first entry of every list."""
    if path:
        yield path
    if isinstance(value, dict):
        for key in value:
            yield from places(value[key], (*path, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*path, 0))


def with_value(table, path, bad):
    changed = copy.deepcopy(table)
    at = changed
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = bad
    return changed


def without(table, path):
    changed = copy.deepcopy(table)
    at = changed
    for key in path[:-1]:
        at = at[key]
    del at[path[-1]]
    return changed


LARGE = ("denoised", "net behind physics", "linear with all that stands beside it")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "table"), [(broad if name in LARGE else pytest.param)(name, table, id=name) for name, table in tables()])
def test_any_value_in_any_place_of_a_model_is_read_or_refused_in_one_line(name, table, tmp_path):
    path = tmp_path / "m.json"
    told = {"acc": SAMPLES.accel[:30], "temp": np.full(30, 25.0), "began_s": 0.0}
    said, refused = [], 0
    changed = [with_value(table, place, bad) for place in places(table) for bad in BAD] + [without(table, place) for place in places(table)]
    for each in changed:
        path.write_text(json.dumps(each))
        try:
            loaded = tinygc.load(path, rate_hz=104.0)
        except FormatError as error:
            refused += 1
            said.append(str(error).replace(str(path), "", 1) if str(error).startswith(str(path)) else f"\n{error}")
            continue
        try:
            assert np.isfinite(loaded(SAMPLES.gyro[:30], **told)).all()
        except CalibrationError as error:
            said.append(str(error))
    assert not [text for text in said if "\n" in text]
    assert refused > len(changed) / 2


@pytest.mark.parametrize(
    "E", [np.zeros((3, 3)), np.ones((3, 3)), np.diag([1.0, 1.0, 0.0]), np.diag([1e-9, 1.0, 1.0]), [[0, 0.006, 0.013], [0, 1, 0], [0, 0, 1]]]
)
def test_a_singular_matrix_is_no_calibration(E, tmp_path):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(models.to_dict(LINEAR) | {"weights": {"E": np.asarray(E, dtype=float).tolist(), "B": [0.0] * 3}}))
    with pytest.raises(FormatError, match=r"m\.json: weights\.E is singular, expected a matrix that keeps all three axes apart; fit again"):
        tinygc.load(path)


@pytest.mark.parametrize("E", [np.diag([-1.0, 1.0, 1.0]), -np.eye(3), np.eye(3)[[1, 0, 2]]])
def test_a_matrix_that_mirrors_the_axes_is_no_calibration(E, tmp_path):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(models.to_dict(LINEAR) | {"weights": {"E": E.tolist(), "B": [0.0] * 3}}))
    with pytest.raises(FormatError, match=r"m\.json: weights\.E mirrors the axes, expected .*; fit again"):
        tinygc.load(path)


def test_a_model_that_follows_temperature_says_from_which_one_on(tmp_path):
    effect = catalogue()["gyro.thermal_bias"]
    table = models.to_dict(PhysicsModel(LINEAR, (AppliedEffect(effect, np.full(3, 1e-4)),), KNOWN))
    table["conditions"]["first_temp_c"] = None
    (tmp_path / "m.json").write_text(json.dumps(table))
    with pytest.raises(FormatError, match=r"conditions\.first_temp_c is null, expected a number: the model follows temperature"):
        tinygc.load(tmp_path / "m.json")
    table["effects"] = []
    (tmp_path / "m.json").write_text(json.dumps(table))
    assert np.isfinite(tinygc.load(tmp_path / "m.json")(SAMPLES.gyro[:5])).all()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[]", "it is a list of 0, expected a table"),
        ("{}", "schema is missing"),
        ('{"schema": "tinygc-fit/3"}', 'schema is "tinygc-fit/3", expected one of tinygc-fit/2'),
        ('{"schema": "tinygc-fit/1"}', 'schema is "tinygc-fit/1", expected one of tinygc-fit/2; run `calibrate.py fit` again'),
        ('{"schema": "tinygc-fit/2", "noise": {"gyro_dps_rthz": "x"}}', 'noise.gyro_dps_rthz is "x", expected 3 numbers'),
        ('{"schema": "tinygc-fit/2", "goodness": {"p_value": NaN}}', "goodness.p_value is NaN, which is not finite"),
        ('{"schema": "tinygc-fit/2", "goodness": {"p_value": true}}', "goodness.p_value is true, expected a number from 0 to 1"),
    ],
)
def test_a_damaged_fit_is_said_in_one_line(text, says, tmp_path):
    path = tmp_path / "fit.json"
    path.write_text(text)
    with pytest.raises(FormatError) as caught:
        read_fit(path, "run `calibrate.py fit` again")
    assert str(caught.value).startswith(f"{path}: {says}")
    assert str(caught.value).endswith("; run `calibrate.py fit` again")


def test_a_number_that_is_not_finite_is_written_as_null(tmp_path):
    write_whole(tmp_path / "x.json", {"a": [1.5, float("nan")], "b": {"c": float("inf")}, "d": "NaN"})
    assert read_json(tmp_path / "x.json") == {"a": [1.5, None], "b": {"c": None}, "d": "NaN"}
