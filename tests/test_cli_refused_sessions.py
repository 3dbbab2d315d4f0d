"""One clear line and exit code 2 for a session that cannot be calibrated: its rests, its settings, its dials, its closure run."""

import gzip

import numpy as np
import pytest
from commandline import QUICK, refused
from conftest import Table, write_session


def test_no_still_phase(run, tmp_path):
    samples = Table().turn(700, (1, 2, 0), 20).turn(-700, (0, 1, 1), 20).samples(odr_hz=208)
    refused(run("fit", write_session(tmp_path / "s", samples), *QUICK), "still")


def test_a_single_still(run, tmp_path):
    refused(run("fit", write_session(tmp_path / "s", Table().rest(6).samples()), *QUICK), "still")


def test_few_segments(run, tmp_path):
    refused(run("fit", write_session(tmp_path / "s", Table().tumble(4).samples()), *QUICK), "4 usable segments")


def test_all_segments_rejected(run, folder):
    refused(
        run("fit", folder, *QUICK, "--exclude", "0,1,2,3,4", "--exclude", "5,6,7,8,9"),
        "all 10 segments are rejected",
        "left out by request",
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("tinygc-session/1", "tinygc-session/9", ("schema", "tinygc-session/9")),
        ("[sensor]", "[sensor", ("broken TOML",)),
        ("odr_hz = 104.0", 'odr_hz = "fast"', ("sensor.odr_hz", "fast")),
        ("odr_hz = 104.0", "", ("sensor.odr_hz is missing",)),
        ("gyro_fs_dps = 500", "gyro_fs_dps = 300", ("300", "full scale")),
        ("gyro_fs_dps = 500", "gyro_fs_dps = -1", ("gyro_fs_dps",)),
        ('reference = "gravity"', 'reference = "stars"', ("reference", "stars")),
        ('reference = "gravity"', 'reference = "table"', ("attitudes.csv", "not found")),
        ("latitude_deg = 31.03", "latitude_deg = 131.03", ("latitude_deg", "131.03")),
        ("latitude_deg = 31.03", "latitude_deg = nan", ("latitude_deg", "NaN")),
        ("still_s = 1.0", "still_s = 0", ("still_s",)),
    ],
)
def test_bad_session_toml(run, folder, old, new, words):
    path = folder / "session.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    refused(run("fit", folder, *QUICK), *words)


@pytest.mark.parametrize(
    "content",
    [
        "still,roll_deg,pitch_deg,yaw_deg\n0,0,0,0\n99999999999999,0,0,0\n",
        "",
        "still,roll\n0,1\n",
        "still,roll_deg,pitch_deg,yaw_deg\n",
        "still,roll_deg,pitch_deg,yaw_deg\n0,a,b,c\n",
    ],
)
def test_bad_dial_readings(run, folder, content):
    path = folder / "session.toml"
    path.write_text(path.read_text().replace('"gravity"', '"table"'))
    (folder / "attitudes.csv").write_text(content)
    refused(run("fit", folder, *QUICK), "attitudes.csv")


def test_closure_run_that_does_not_return(run, folder):
    """It stops halfway and rests there: the first second's readings again, in the attitude of that moment."""
    path = folder / "closure0001.csv.gz"
    lines = gzip.decompress(path.read_bytes()).decode().split("\n")
    rows = np.array([line.split(",") for line in lines[2:-1]], dtype=int)
    half, rest = len(rows) // 2, rows[:110].copy()
    rest[:, 0] += rows[half, 0] + 9615 - rows[0, 0]
    rest[:, 4:7] += rows[half, 4:7] - rows[0, 4:7]
    text = "\n".join([*lines[:2], *(",".join(map(str, row)) for row in [*rows[: half + 1], *rest])]) + "\n"
    path.write_bytes(gzip.compress(text.encode()))
    refused(run("fit", folder, *QUICK), "closure0001.csv.gz", "does not return", "deg")


def test_closure_run_that_stops_halfway(run, folder):
    lines = gzip.decompress((folder / "closure0001.csv.gz").read_bytes()).decode().split("\n")
    (folder / "closure0001.csv.gz").write_bytes(gzip.compress("\n".join(lines[: len(lines) // 2]).encode()))
    refused(run("fit", folder, *QUICK), "closure0001.csv.gz", "still phases")
