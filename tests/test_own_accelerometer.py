"""A session whose session.toml gives no accelerometer: its own stills give it, and what cannot be known is said."""

import shutil
from pathlib import Path

import pytest

from session.detect.findings import worst
from session.detect.first_look import check_folder
from tinygc import FitOptions
from tinygc.estimation.fit import fit_session
from tinygc.explanation.decision import tilt_rms

SESSION1 = Path(__file__).resolve().parent.parent / "data" / "session1"


@pytest.fixture
def bare(tmp_path):
    """``data/session1`` without ``[accelerometer]``."""
    folder = shutil.copytree(SESSION1, tmp_path / "bare", ignore=shutil.ignore_patterns("fit", "explain"))
    text = (folder / "session.toml").read_text()
    before, rest = text.split("[accelerometer]")
    (folder / "session.toml").write_text(before + "[" + rest.split("\n[", 1)[1])
    return folder


@pytest.mark.broad
def test_its_own_stills_make_the_reference_that_the_given_one_was(bare):
    plain, own = (fit_session(folder, FitOptions(methods=("least_squares",))) for folder in (SESSION1, bare))
    held_out = [tilt_rms(result.linear.held_out) for result in (plain, own)]
    assert held_out[1] < 1.05 * held_out[0]
    said = [w for w in own.warnings if w.what == "accelerometer"]
    assert len(said) == 1
    assert "41 stills" in said[0].says
    assert not [w for w in plain.warnings if w.what == "accelerometer"]


def test_check_says_so_and_finds_nothing_wrong_with_gravity(bare):
    findings = check_folder(bare)
    assert worst(findings) != "error"
    levels = {f.what: f.level for f in findings}
    assert levels["accelerometer"] == "note"
    assert levels["gravity"] == "ok"
    assert levels["gravity spread"] in ("ok", "note")
