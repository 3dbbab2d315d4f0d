"""``calibrate.py explain``: its files, and the picture of every kind of verdict."""

import json

import pytest
from explained_sessions import make_explained, make_session

from tinygc.reporting.explanation_text import ExplanationReport

session = pytest.fixture(make_session, scope="module", name="session")
explained = pytest.fixture(make_explained, scope="module", name="explained")


@pytest.mark.broad
def test_strict_passes_where_there_is_none(session, run, tmp_path):
    code, out, _ = run("explain", session("nothing"), "--strict", "--no-pictures", "--out", tmp_path / "explain")
    assert code == 0
    assert "no mismatch was found" in " ".join(out.split())
    assert sorted(path.name for path in (tmp_path / "explain").iterdir()) == ["explain.json"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nothing", "saturation", "oscillating", "bandwidth"])
def test_there_is_a_picture_of_every_kind_of_verdict(explained, tmp_path, name):
    from matplotlib.image import imread

    explanation, result = explained(name)
    folder = ExplanationReport(explanation).save(tmp_path / "made")
    assert json.loads((folder / "explain.json").read_text()) == result
    picture = imread(folder / "explain.png")
    assert picture.shape[0] > 500
    assert picture.shape[1] > 800
    assert picture[..., :3].std() > 0.05  # not blank
