"""Models as files: what is written is read again, and nothing else is."""

import json
from pathlib import Path

import numpy as np
import pytest

from session.io.errors import FormatError
from tinygc import models
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet

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


@pytest.mark.parametrize("model", [LINEAR, NET], ids=["linear", "tinygc"])
def test_file_says_what_it_means(model):
    table = models.to_dict(model)
    assert table["schema"] == "tinygc-model/1"
    assert table["units"] == "rad/s in, rad/s out"
    assert "omega" in table["equation"]
    json.dumps(table, allow_nan=False)


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


def test_loading_has_no_way_to_execute():
    """The whole module names no unpickler."""
    text = Path(models.__file__).read_text(encoding="utf-8")
    assert not any(word in text for word in ("pickle", "torch.load", "eval(", "exec(", "np.load"))
