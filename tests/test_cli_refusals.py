"""One clear line and exit code 2 for whatever is wrong with a folder, a log, a session, or where results go."""

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from commandline import HEADER, QUICK, refused, set_cell, spoil
from conftest import SESSION_TOML, Table, write_session

from tinygc import models
from tinygc.cli import arguments as arguments_of

# What a folder can lack


def test_missing_folder(run, tmp_path):
    refused(run("fit", tmp_path / "none", *QUICK), "none", "not found")


def test_file_for_a_folder(run, folder):
    refused(run("fit", folder / "session.toml", *QUICK), "that is a file")


def test_no_log(run, folder):
    (folder / "log0001.csv").unlink()
    refused(run("fit", folder, *QUICK), "no log")


def test_no_session_toml(run, folder):
    (folder / "session.toml").unlink()
    refused(run("fit", folder, *QUICK), "session.toml", "not found")


def test_log_both_packed_and_not(run, folder):
    (folder / "log0001.csv.gz").write_bytes(gzip.compress((folder / "log0001.csv").read_bytes()))
    refused(run("fit", folder, *QUICK), "log0001.csv.gz", "keep one")


def test_log_is_a_folder(run, folder):
    (folder / "log0002.csv").mkdir()
    refused(run("fit", folder, *QUICK), "log0002.csv")


# What a log can hold


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: [], ("empty",)),
        (lambda lines: ["", "", "# nothing"], ("empty",)),
        (lambda lines: lines[:2], ("header", "no samples")),
        (lambda lines: [lines[0], "time,rate_x,rate_y,rate_z,a,b,c,d", *lines[2:]], ("line 2", "no time column")),
        (lambda lines: [lines[0], *lines[2:]], ("no header line",)),
        (lambda lines: [lines[0], HEADER.replace("gx,gy,gz", "gx_rpm,gy_rpm,gz_rpm"), *lines[2:]], ("unknown unit", "gx_rpm")),
        (lambda lines: [lines[0], HEADER.replace("ax", "ax_lbf"), *lines[2:]], ("unknown unit", "ax_lbf")),
        (set_cell(500, 3, "hello"), ("line 501", "gz", "hello")),
        (set_cell(500, 3, ""), ("line 501", "gz")),
        (set_cell(700, 1, "nan"), ("line 701", "gx", "nan")),
        (set_cell(700, 1, "40000"), ("line 701", "gx", "40000")),
        (lambda lines: [*lines[:900], "1,2,3", *lines[900:]], ("line 901", "3 columns")),
        (lambda lines: [*lines[:600], *lines[300:]], ("line 601", "backward")),
        (lambda lines: lines[:3], ("single sample",)),
        (lambda lines: lines[:40], ("still",)),
        (lambda lines: ["\x00\x01\x02PNG" * 50], ("not a text log",)),
    ],
    ids=[
        "empty", "blank", "header only", "wrong header", "no header", "gyro unit", "accel unit", "text", "hole", "nan", "no register",
        "short row", "backward", "one sample", "too short", "binary",
    ],
)  # fmt: skip
def test_bad_log(run, folder, change, words):
    spoil(folder, change)
    refused(run("fit", folder, *QUICK), "log0001.csv" if words != ("still",) else "", *words)


def test_nan_in_a_log_of_units_is_named(run, tmp_path):
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "session.toml").write_text(SESSION_TOML)
    rows = ["t_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g", *(f"{i / 100},0.1,0.2,0.3,0,0,-1" for i in range(500))]
    rows[321] = "3.2,0.1,nan,0.3,0,0,-1"
    (folder / "log1.csv").write_text("\n".join(rows))
    refused(run("fit", folder, *QUICK), "line 322", "gy_dps", "nan")


def test_not_gzip(run, folder):
    (folder / "log0001.csv").rename(folder / "log0001.csv.gz")
    refused(run("fit", folder, *QUICK), "not a gzip file")


def test_truncated_last_line_is_left_out_and_said(run, folder):
    spoil(folder, lambda lines: [*lines[:-2], lines[-2][:9]])
    code, out, _ = run("check", folder)
    assert "cut off" in out
    assert run("fit", folder, *QUICK)[0] == 0
    assert code in (0, 1)


def test_truncated_gzip_is_used_and_said(run, simulated, tmp_path):
    folder = tmp_path / "s"
    shutil.copytree(simulated(), folder)
    data = (folder / "log0001.csv.gz").read_bytes()
    (folder / "log0001.csv.gz").write_bytes(data[: int(len(data) * 0.95)])
    (folder / "closure0001.csv.gz").unlink()
    assert "breaks off" in run("check", folder)[1]
    assert run("fit", folder, *QUICK)[0] == 0


# What a session can be


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
        ("latitude_deg = 31.03", "latitude_deg = nan", ("latitude_deg", "nan")),
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


# What cannot be written


def test_models_cannot_be_written(run, folder, monkeypatch):
    """A session folder that may only be read (root may write anywhere, so the refusal is made)."""
    make = Path.mkdir

    def refuse(self, *args, **settings):
        if self.name == "fit":
            raise PermissionError(13, "Permission denied", str(self))
        return make(self, *args, **settings)

    monkeypatch.setattr(Path, "mkdir", refuse)
    refused(run("fit", folder, *QUICK), "Permission denied", str(folder))


def test_a_session_that_may_only_be_read_is_fitted_with_out(run, folder, monkeypatch, tmp_path):
    """--out DIR takes models and figures, makes its parents, and leaves the session as it was."""
    make = Path.mkdir

    def refuse(self, *args, **settings):
        if folder in (self, *self.parents):
            raise PermissionError(13, "Permission denied", str(self))
        return make(self, *args, **settings)

    monkeypatch.setattr(Path, "mkdir", refuse)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    out = tmp_path / "results" / "first"
    code, said, _ = run("fit", folder, "--methods", "raw,least_squares", "--out", out)
    assert code == 0
    assert f"models: {out}" in said
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert sorted(path.name for path in out.iterdir()) == ["fit.json", "fitted.json", "model_least_squares.json", "model_raw.json"]
    assert set(json.loads((out / "fit.json").read_text())["methods"]) == {"raw", "least_squares"}
    assert models.load(out / "model_least_squares.json").vector.shape == (12,)


def test_out_twice_replaces_and_out_a_file_is_refused(run, folder, tmp_path):
    out = tmp_path / "out"
    assert run("fit", folder, *QUICK, "--out", out)[0] == 0
    (out / "fit.json").write_text("old")
    (out / "notes.txt").write_text("mine")
    assert run("fit", folder, *QUICK, "--out", out)[0] == 0
    assert json.loads((out / "fit.json").read_text())["schema"] == "tinygc-fit/1"
    assert (out / "notes.txt").read_text() == "mine"
    refused(run("fit", folder, *QUICK, "--out", out / "notes.txt"), "notes.txt", "exists")
    assert (out / "notes.txt").read_text() == "mine"


def test_fit_is_a_file(run, folder):
    (folder / "fit").write_text("mine")
    refused(run("fit", folder, *QUICK), "fit", "exists")
    assert (folder / "fit").read_text() == "mine"


def test_json_cannot_be_written(run, folder, tmp_path):
    refused(run("fit", folder, *QUICK, "--json", tmp_path / "none" / "x.json"), "x.json", "--json")
    refused(run("check", folder, "--quiet", "--json", tmp_path), "cannot be written")


@pytest.mark.parametrize("command", ["fit", "explain"])
def test_what_cannot_be_written_is_found_before_the_work(run, folder, tmp_path, monkeypatch, command):
    def worked(*args, **settings):
        raise AssertionError("the work began")

    monkeypatch.setattr("tinygc.library.fit.fit_session", worked)
    monkeypatch.setattr("tinygc.library.explain.explain_session", worked)
    (tmp_path / "file").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    refused(run(command, folder, "--out", tmp_path / "file" / "sub"), "file", "--out")
    refused(run(command, folder, "--json", tmp_path / "none" / "x.json"), "x.json", "--json")
    refused(run(command, folder, "--json", tmp_path), "--json")
    with pytest.raises(AssertionError, match="the work began"):
        run(command, folder, "--out", tmp_path / "new" / "er", "--json", tmp_path / "new" / "er" / "x.json")
    assert sorted(tmp_path.rglob("*")) == before  # no trial leaves a trace


def test_simulate_does_not_overwrite(run, folder):
    (folder / "truth.json").unlink()
    refused(run("simulate", "--out", folder), "not empty")
    refused(run("simulate", "--out", folder, "--force"), "truth.json is missing")
    assert (folder / "log0001.csv").exists()


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--odr-hz", 200),
        ("--latitude-deg", 95),
        ("--gyro-fs-dps", 300),
        ("--segments", 0),
        ("--closure", 3),
        ("--segments", 2001),
        ("--closure", 1e9),
        ("--still-s", 1e6),
        ("--gyro-noise-dps-rthz", "inf"),
        ("--accel-noise-ug-rthz", "nan"),
        ("--gyro-bias-dps", "inf"),
        ("--temperature-start-c", "nan"),
        ("--heading-deg", "inf"),
        ("--vigour", "inf"),
    ],
)
def test_simulate_refuses_what_no_sensor_or_bench_has(run, tmp_path, option, value):
    refused(run("simulate", "--out", tmp_path / "s", option, value))
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("fly",),
        ("fit",),
        ("fit", "x", "--methods", "magic"),
        ("fit", "x", "--methods", ","),
        ("fit", "x", "--folds", "1"),
        ("fit", "x", "--seed", "-1"),
        ("fit", "x", "--limit", "0"),
        ("fit", "x", "--limit", "nan"),
        *(("board", flag, bad) for flag in ("--rate", "--lead", "--tail", "--uptime", "--closure") for bad in ("nan", "inf", "-1")),
        ("board", "--uptime", "1e300"),
        ("fit", "x", "--epochs", "many"),
        ("simulate",),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(run, arguments):
    refused(run(*arguments), "; see --help")


@pytest.mark.parametrize(
    ("arguments", "expected"), [((), []), (("--exclude", "3,4"), [3, 4]), (("--exclude", "3", "--exclude=4, 5"), [3, 4, 5])]
)
def test_excluded_numbers_stand_with_commas_and_may_be_repeated(arguments, expected):
    args = arguments_of.parser().parse_args(["fit", *arguments, "folder"])
    assert (args.folder, args.exclude) == (Path("folder"), expected)


@pytest.mark.parametrize("text", ["", "3 4", "-1", "3,,4", "three", "1_0"])
def test_excluded_numbers_that_are_none_are_refused(run, text):
    refused(run("fit", "folder", f"--exclude={text}"), "--exclude", "no list of segment numbers")
