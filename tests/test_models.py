"""The linear model's words of the field against sensors built by hand; models as files: what is written is read, and nothing else is."""

import json

import numpy as np
import pytest

from session.io.errors import FormatError
from session.io.units import DEG
from tinygc import models
from tinygc.models.linear import NAMES, LinearModel, field_quantities
from tinygc.models.nets import CalibrationNet


def calibration_of(M, b=(0.0, 0.0, 0.0)):
    """``LinearModel.vector`` that undoes m = M omega + b."""
    E = np.linalg.inv(M)
    return np.concatenate([E.ravel(), -E @ b])


def quantities(M, b=(0.0, 0.0, 0.0)):
    found = field_quantities(calibration_of(np.asarray(M, float), np.asarray(b, float)), np.zeros((12, 12)))
    return {(q.word, q.component): q.value for q in found}


def test_an_axis_that_reads_too_much_has_a_positive_scale_factor_error():
    found = quantities(np.diag([1.01, 0.998, 1.0]), (0.02, 0.0, -0.01))
    assert found["scale factor error", "x"] == pytest.approx(10_000)
    assert found["scale factor error", "y"] == pytest.approx(-2000)
    assert found["bias", "x"] == pytest.approx(0.02 / DEG)
    assert found["bias", "z"] == pytest.approx(-0.01 / DEG)
    assert found["misalignment", "x to y"] == 0


def test_an_axis_that_leans_is_misaligned_and_not_orthogonal():
    angle = 7e-3
    M = np.eye(3)
    M[0] = np.cos(angle), np.sin(angle), 0
    found = quantities(M)
    assert found["misalignment", "x to y"] == pytest.approx(7)
    assert found["nonorthogonality", "xy"] == pytest.approx(7)
    assert found["scale factor error", "x"] == pytest.approx(0, abs=1e-6)
    assert found["misalignment", "y to x"] == pytest.approx(0, abs=1e-9)
    assert found["triad rotation", "z"] == pytest.approx(3.5, rel=1e-4)  # half of it is the triad's


def test_a_triad_that_is_only_turned_is_orthogonal():
    angle = 5e-3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    found = quantities(turn.T)  # rows: input axes, turned by +angle about z
    assert found["triad rotation", "z"] == pytest.approx(5)
    assert found["misalignment", "x to y"] == pytest.approx(5)
    assert found["misalignment", "y to x"] == pytest.approx(-5)
    for pair in ("xy", "yz", "zx"):
        assert found["nonorthogonality", pair] == pytest.approx(0, abs=1e-9)


def test_what_no_turn_shows_is_said():
    hidden = ("E_xy", "E_yy", "E_zy")
    found = field_quantities(calibration_of(np.eye(3)), np.eye(12), hidden)
    shown = {(q.word, q.component): q.observed for q in found}
    assert set(hidden) < set(NAMES)
    assert not shown["scale factor error", "y"]
    assert not shown["misalignment", "x to y"]
    assert not shown["nonorthogonality", "yz"]
    assert shown["scale factor error", "x"]
    assert shown["nonorthogonality", "zx"]
    assert shown["bias", "y"]


RATE = np.random.default_rng(0).normal(size=(20, 3))
LINEAR = LinearModel(np.eye(3) + 0.01 * RATE[:3], RATE[3])
NET = CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.1 * np.random.default_rng(1).normal(size=27))


def written(model, tmp_path, **more):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(models.to_dict(model, **more)))
    return path


@pytest.mark.parametrize("model", [LINEAR, NET], ids=["linear", "tinygc"])
def test_round_trip_keeps_every_digit(model, tmp_path):
    again = models.load(written(model, tmp_path, session="s", covariance=np.eye(model.parameters).tolist()))
    assert type(again) is type(model)
    np.testing.assert_array_equal(again.vector, model.vector)
    np.testing.assert_array_equal(again(RATE), model(RATE))


def test_equations_in_the_files_compute_the_models(tmp_path):
    """Whoever implements the file's equation gets the model's numbers."""
    for model in (LINEAR, NET):
        w = {name: np.array(value) for name, value in json.loads(written(model, tmp_path).read_text())["weights"].items()}
        for m in RATE:
            if model is LINEAR:
                omega = w["E"] @ m + w["B"]
            else:
                h = w["W1"] @ m + w["b1"]
                omega = m + w["W2"] @ np.where(h >= 0, h, w["slope"] * h) + w["b2"]
            np.testing.assert_allclose(model(m), omega, atol=1e-14)


@pytest.mark.parametrize("content", [b"", b"{", b"\x80\x04\x95\x10\x00\x00\x00", b"\xff\xfe\x00", b"cos\nsystem\n(S'true'\ntR."])
def test_other_files_are_refused_and_never_unpickled(content, tmp_path):
    path = tmp_path / "model.pt"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"model\.pt"):
        models.load(path)
