"""The one loop of AdamW: it goes on where it was interrupted, to the bit, and from nothing else."""

import json

import numpy as np
import pytest
import torch
from formats_page import strangers

from session.io.errors import FitError
from tinygc.estimation import adamw
from tinygc.estimation.adamw import forget, minimise
from tinygc.estimation.options import Checkpoint

START = np.array([3.0, -2.0, 1.0])


def loss_of(weights):
    return ((weights - torch.arange(3.0, dtype=torch.float64)) ** 4).sum()


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(adamw, "EPOCHS", 40)


def run(checkpoint=None, progress=lambda done, of: None, identity=(), loss=loss_of, learning_rate=0.1):
    return minimise(loss, START, learning_rate=learning_rate, identity=list(identity), checkpoint=checkpoint, progress=progress)


def interrupted(path, at=17, **more):
    def stop(done, of):
        if done == at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(checkpoint=Checkpoint(path), progress=stop, **more)


def test_it_minimises_and_gives_best_and_losses(monkeypatch):
    monkeypatch.setattr(adamw, "EPOCHS", 200)
    last, best, losses = run()
    assert losses[0] == pytest.approx(81 + 81 + 1)
    assert losses[-1] < 1e-2 * losses[0]
    assert float(loss_of(torch.as_tensor(best))) == pytest.approx(min(losses))
    np.testing.assert_allclose(last, [0, 1, 2], atol=0.7)


def test_resumed_equals_uninterrupted(tmp_path):
    path = tmp_path / "deep" / "checkpoint.json"
    whole = run()
    interrupted(path)
    kept = json.loads(path.read_text())
    assert len(kept["losses"]) == 17
    assert strangers(kept) == []
    resumed = run(checkpoint=Checkpoint(path, resume=True))
    for a, b in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_has_ended_is_not_trained_again_until_it_is_forgotten(tmp_path):
    """A fit is many trainings: one that is resumed in the second must not repeat the first."""
    checkpoint, seen = Checkpoint(tmp_path / "checkpoint_first.json", resume=True), []
    first = run(checkpoint=checkpoint)
    again = run(checkpoint=checkpoint, progress=lambda done, of: seen.append(done))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert seen == []
    (tmp_path / "model.json").write_text("{}")
    forget(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]


def test_without_resume_it_begins_anew(tmp_path):
    path = tmp_path / "checkpoint.json"
    interrupted(path)
    seen = []
    run(checkpoint=Checkpoint(path), progress=lambda done, of: seen.append(done))
    assert seen[0] == 1


@pytest.mark.parametrize("more", [{"learning_rate": 0.2}, {"identity": [np.ones(3)]}])
def test_other_data_or_settings_are_refused(tmp_path, more):
    path = tmp_path / "checkpoint.json"
    interrupted(path)
    with pytest.raises(FitError, match="other data or settings"):
        run(**more, checkpoint=Checkpoint(path, resume=True))


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"schema": "tinygc-checkpoint/2"}', '{"schema": "tinygc-checkpoint/1", "weights": "x"}']
)
def test_broken_checkpoints_are_refused(tmp_path, text):
    path = tmp_path / "checkpoint.json"
    path.write_text(text)
    with pytest.raises(FitError, match=r"checkpoint\.json"):
        run(checkpoint=Checkpoint(path, resume=True))


def test_a_loss_that_is_not_finite_is_refused():
    with pytest.raises(FitError, match="finite"):
        run(loss=lambda weights: weights.sum() * float("nan"))
