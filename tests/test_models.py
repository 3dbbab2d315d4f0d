"""The linear model's words of the field against sensors built by hand; models as files: what is written is read, and nothing else is."""

import json

import numpy as np
import pytest
from small_turns import numeric_jacobian

from session.base.errors import FormatError
from session.base.units import DEG
from tinygc import models
from tinygc.models.linear import WORDS, LinearModel, field_facts, field_vector
from tinygc.models.nets import CalibrationNet


def calibration_of(M, b=(0.0, 0.0, 0.0)):
    """``LinearModel.vector`` that undoes m = M omega + b."""
    E = np.linalg.inv(M)
    return np.concatenate([E.ravel(), -E @ b])


LEAN, TURN = 7e-3, 5e-3
LEANING = np.array([[np.cos(LEAN), np.sin(LEAN), 0], [0, 1, 0], [0, 0, 1]])
#: rows: input axes, turned by +TURN about z
TURNED = np.array([[np.cos(TURN), np.sin(TURN), 0], [-np.sin(TURN), np.cos(TURN), 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("M", "b", "expected"),
    [
        (np.diag([1.01, 0.998, 1.0]), (0.02, 0, -0.01), {"scale factor error x": 1e4, "scale factor error y": -2e3, "bias z": -0.01 / DEG}),
        # half of an axis that leans is the triad's rotation
        (LEANING, (0, 0, 0), {"misalignment x to y": 7, "nonorthogonality xy": 7, "triad rotation z": 7 * (1 + LEAN**2 / 24) / 2}),
        (TURNED, (0, 0, 0), {"triad rotation z": 5, "misalignment x to y": 5, "misalignment y to x": -5}),
    ],
)
def test_errors_in_the_words_of_the_field_are_those_of_a_sensor_with_them_alone(M, b, expected):
    """The others are nothing, but for what the words state twice."""
    found = {f"{q.word} {q.component}": q.value for q in field_facts(calibration_of(M, np.array(b)), np.zeros((12, 12)))}
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-4)
    if M is TURNED:
        assert [found[f"nonorthogonality {pair}"] for pair in ("xy", "yz", "zx")] == pytest.approx([0, 0, 0], abs=1e-9)


def test_their_uncertainties_are_the_derivatives_times_the_covariance():
    rng = np.random.default_rng(5)
    vector = calibration_of(np.eye(3) + 0.02 * rng.standard_normal((3, 3)), 0.01 * rng.standard_normal(3))
    root = 1e-4 * rng.standard_normal((12, 12))
    slope = numeric_jacobian(field_vector, vector)
    units = np.concatenate([[si] * len(components) for _, components, _, si in WORDS])
    expected = np.sqrt(np.diag(slope @ root @ root.T @ slope.T)) / units
    assert [q.sigma for q in field_facts(vector, root @ root.T)] == pytest.approx(expected, rel=1e-6)


def test_what_no_turn_shows_is_said():
    hidden = ("E_xy", "E_yy", "E_zy")
    found = field_facts(calibration_of(np.eye(3)), np.eye(12), hidden)
    shown = {(q.word, q.component): q.observed for q in found}
    for q, there in {
        ("scale factor error", "y"): 0,
        ("nonorthogonality", "yz"): 0,
        ("nonorthogonality", "zx"): 1,
        ("bias", "y"): 1,
    }.items():
        assert shown[q] == there


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
