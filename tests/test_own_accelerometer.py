"""A session whose session.toml gives no accelerometer: its own stills give it, and what cannot be known is said."""

import shutil
from pathlib import Path

import pytest

from session.detect.findings import worst
from session.detect.first_look import check_folder

SESSION1 = Path(__file__).resolve().parent.parent / "data" / "session1"


@pytest.fixture
def bare(tmp_path):
    """``data/session1`` without ``[accelerometer]``."""
    folder = shutil.copytree(SESSION1, tmp_path / "bare", ignore=shutil.ignore_patterns("fit", "explain"))
    text = (folder / "session.toml").read_text()
    before, rest = text.split("[accelerometer]")
    (folder / "session.toml").write_text(before + "[" + rest.split("\n[", 1)[1])
    return folder


def test_check_says_so_and_finds_nothing_wrong_with_gravity(bare):
    findings = check_folder(bare)
    assert worst(findings) != "error"
    levels = {f.what: f.level for f in findings}
    assert levels["accelerometer"] == "note"
    assert levels["gravity"] == "ok"
    assert levels["gravity spread"] in ("ok", "note")
