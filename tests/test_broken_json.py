"""JSON that anybody may have written: what is wrong with it is said in one line, whatever it is."""

import json
import warnings

import numpy as np
import pytest

import calibrate
import tinygc
from session.io import numeric
from session.io.errors import FormatError
from session.io.results import read_json
from tinygc import models
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.model import covariance
from tinygc.models.nets import CalibrationNet

LINEAR = models.to_dict(LinearModel(np.eye(3), np.zeros(3)))


def text_with(**weights) -> str:
    return json.dumps(LINEAR | {"weights": LINEAR["weights"] | weights})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        ("{", "broken JSON"),
        (text_with(B=[0, 0, int("9" * 400)]), "weights.B"),
        (text_with(B=[0, 0, 10**30]).replace("]}", "]"), "broken JSON"),
        (json.dumps(LINEAR | {"units": "deg/s in, deg/s out"}), 'units are "deg/s in, deg/s out", expected "rad/s in, rad/s out"'),
        (json.dumps(LINEAR | {"units": None}), "units are null"),
    ],
)
def test_a_model_that_cannot_be_read_is_said_in_one_line(tmp_path, text, says, capsys):
    path = tmp_path / "m.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=r"m\.json: ") as caught:
        tinygc.load(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    log = tmp_path / "log.csv"
    log.write_text("t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "".join(f"{i / 100},0,0,0,0,0,-1\n" for i in range(50)))
    assert calibrate.main(["apply", str(path), str(log), "-o", str(tmp_path / "out.csv"), "--quiet"]) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    assert says in said


def test_models_within_models_without_end_are_refused(tmp_path):
    table = LINEAR
    for _ in range(250):
        table = models.to_dict(DenoisedNet(CalibrationNet.identity(), Denoiser.identity(), 208.0)) | {"calibration": table}
    (tmp_path / "m.json").write_text(json.dumps(table))
    with pytest.raises(FormatError):
        tinygc.load(tmp_path / "m.json")


@pytest.mark.parametrize("dilations", [[1, 2.5, 5], [1, True, 2], [1, "2", 2], [1, float("inf"), 2], [1, float("nan"), 2]])
def test_a_dilation_is_a_whole_number_of_samples(tmp_path, dilations):
    table = models.to_dict(DenoisedNet(CalibrationNet.identity(), Denoiser.identity(), 208.0))
    (tmp_path / "good.json").write_text(json.dumps(table))
    assert isinstance(models.load(tmp_path / "good.json"), DenoisedNet)
    table["denoiser"]["dilations"] = dilations
    (tmp_path / "m.json").write_text(json.dumps(table))
    with pytest.raises(FormatError, match=r"m\.json: denoiser\.dilations\[1\] is .*expected a whole number from 1 to 50"):
        models.load(tmp_path / "m.json")


def test_long_integers_become_floats_and_short_ones_stay(tmp_path):
    (tmp_path / "x.json").write_text('{"short": 123, "long": ' + "1" * 30 + ', "huge": ' + "9" * 5000 + "}")
    table = read_json(tmp_path / "x.json")
    assert table["short"] == 123
    assert isinstance(table["short"], int)
    assert table["long"] == pytest.approx(1.1111111e29)
    assert table["huge"] == float("inf")


def test_a_number_that_no_text_can_hold_is_refused_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match="cannot be written"):
            numeric.decimal_rows([np.array([1e300, 1.0])], [9])


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (np.diag([1e-300, 5e-324, 1.0]), ""),
        (np.diag([1e300, 1e-300, 0.0]), ""),
        (np.array([[1e-300, 1.0], [1.0, 1.0]]), "is not positive"),
        (np.array([[1.0, 1e308], [-1e308, 1.0]]), "is not symmetric"),
        (np.array([[1.0, 0.99], [0.99, 0.9]]), "is not positive"),
    ],
)
def test_a_covariance_of_any_size_is_judged_without_a_warning(matrix, says):
    """Found by fuzzing: the product of two variances of 1e-300 is 0, and was divided by."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert covariance(matrix).startswith(says)
    assert bool(covariance(matrix)) == bool(says)
