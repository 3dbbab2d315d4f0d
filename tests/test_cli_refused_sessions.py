"""One clear line and exit code 2 for a session that cannot be calibrated: its rests, its settings, its dials, its closure run."""

import pytest
from commandline import QUICK, refused
from conftest import Table, write_session


def test_few_segments(run, tmp_path):
    refused(run("fit", write_session(tmp_path / "s", Table().tumble(4).samples()), *QUICK), "4 usable segments")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[sensor]", "[sensor", ("broken TOML",)),
        ("odr_hz = 104.0", 'odr_hz = "fast"', ("sensor.odr_hz", "fast")),
        ('reference = "gravity"', 'reference = "table"', ("attitudes.csv", "not found")),
    ],
)
def test_bad_session_toml(run, folder, old, new, words):
    path = folder / "session.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    refused(run("fit", folder, *QUICK), *words)
