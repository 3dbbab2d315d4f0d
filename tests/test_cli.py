"""The command line: one clear line and exit code 2 for whatever is wrong; results that other programs can read."""

import gzip
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, SESSION_TOML, Table, write_session

import calibrate
from tinygc import arguments as arguments_of
from tinygc import models
from tinygc.methods import METHODS

QUICK = ("--methods", "least_squares", "--quiet")
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"


@pytest.fixture
def run(capfd):
    """``run("fit", folder)``: exit code, standard output, standard error of the command line."""

    def call(*arguments):
        capfd.readouterr()
        try:
            code = calibrate.main([str(argument) for argument in arguments])
        except SystemExit as stopped:  # argparse
            code = stopped.code
        return code, *capfd.readouterr()

    return call


@pytest.fixture
def folder(simulated, tmp_path):
    """A simulated session of 10 turns that a test may spoil, its log unpacked."""
    made = tmp_path / "session"
    shutil.copytree(simulated(), made)
    packed = made / "log0001.csv.gz"
    (made / "log0001.csv").write_bytes(gzip.decompress(packed.read_bytes()))
    packed.unlink()
    return made


def spoil(folder, change, name="log0001.csv"):
    """Change the list of a log's lines (0: comment, 1: header)."""
    path = folder / name
    lines = path.read_text().split("\n")
    path.write_text("\n".join(change(lines)))


def refused(result, *words):
    """Exit code 2 and one line, without a traceback, that says every word."""
    code, out, err = result
    lines = err.strip().split("\n")
    assert code == 2, (code, err)
    assert len(lines) == 1, err
    assert lines[0].startswith("calibrate: "), err
    assert "Traceback" not in out + err
    for word in words:
        assert word in lines[0], (word, lines[0])


def set_cell(row, column, text):
    def change(lines):
        cells = lines[row].split(",")
        cells[column] = text
        return [*lines[:row], ",".join(cells), *lines[row + 1 :]]

    return change


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

    monkeypatch.setattr("tinygc.fit.fit_session", worked)
    monkeypatch.setattr("tinygc.explain.explain.explain_session", worked)
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


# Streams


def command_line(*arguments, shell="", **environment):
    """The command line in a process and shell of its own; ``shell`` is what follows the command, such as a redirection."""
    words = " ".join(shlex.quote(str(word)) for word in (sys.executable, ROOT / "calibrate.py", *arguments))
    settings = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", f"{words} {shell}"], capture_output=True, env=settings)


def test_an_encoding_without_our_signs_is_no_error(folder):
    done = command_line("fit", folder, "--methods", "least_squares", "--folds", "2", PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr
    assert b"held out" in done.stdout
    assert done.stdout.isascii()


def test_json_in_an_encoding_without_our_signs_loses_none(folder):
    spoilt = folder / "session.toml"
    spoilt.write_text(spoilt.read_text() + "é = 1\n", encoding="utf-8")  # broken TOML, quoted in the finding
    spoilt.write_text(spoilt.read_text().replace("é", '"é"'), encoding="utf-8")
    done = command_line("check", folder, "--json", "-", PYTHONIOENCODING="ascii")
    assert any("é" in finding["says"] for finding in json.loads(done.stdout)["findings"])


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_streams_are_no_error(folder, closed):
    done = command_line("check", folder, shell=closed)
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_standard_output_is_named_and_the_models_are_saved(folder):
    done = command_line("fit", folder, *QUICK[:2], "--folds", "2", shell=">/dev/full")
    assert done.returncode == 2
    assert done.stderr.decode().strip().split("\n")[-1] == "calibrate: standard output: No space left on device"
    assert (folder / "fit" / "model_least_squares.json").exists()
    done = command_line("check", folder, "--json", "-", shell=">/dev/full")
    assert (done.returncode, done.stderr.decode()) == (2, "calibrate: standard output: No space left on device\n")


def test_json_has_standard_output_to_itself_without_quiet(run, folder, tmp_path):
    code, out, _ = run("check", folder, "--json", "-")
    assert (code, json.loads(out)["schema"]) == (0, "tinygc-check/1")
    assert json.loads(run("fit", folder, *QUICK[:2], "--folds", "2", "--json", "-")[1])["schema"] == "tinygc-fit/1"
    assert json.loads(run("simulate", "--out", tmp_path / "made", "--segments", 3, "--closure", 0, "--json", "-")[1])["folder"]


def test_what_a_file_holds_is_never_printed_raw(run, folder):
    spoil(folder, lambda lines: [lines[0], "\x1b[31m\x07" + HEADER.replace("gx", "g\x1b[0m"), *lines[2:]])
    refused(run("fit", folder, *QUICK), "\\x1b[31m")
    assert "\x1b" not in run("fit", folder, *QUICK)[2] + run("check", folder)[1]
    spoil(folder, lambda lines: ["# serial=\x1b[31mS", HEADER, *lines[2:]])
    assert "\\x1b[31mS" in run("check", folder)[1]


def test_square_brackets_are_printed_as_they_are(run, folder):
    path = folder / "session.toml"
    path.write_text(path.read_text().replace("[sensor]", "sensor = 3\n[other]"))
    assert "[sensor] must be a table" in run("check", folder)[1]


# What comes out


def test_json_has_the_keys_of_formats(run, folder, tmp_path):
    path = tmp_path / "fit.json"
    assert run("fit", folder, "--quiet", "--json", path, "--methods", "raw,least_squares,tinygc") == (0, "", "")
    table = json.loads(path.read_text())
    assert {"schema", "session", "stills", "segments", "noise", "methods", "closure_runs"} <= set(table)
    assert table["schema"] == "tinygc-fit/1"
    assert table["stills"] == 11
    assert {key: table["segments"][key] for key in ("found", "used", "rejected")} == {"found": 10, "used": 10, "rejected": []}
    assert {"gyro_dps_rthz", "accel_g_rthz", "closure_floor_rms_deg"} <= set(table["noise"])
    assert [len(table["noise"][key]) for key in ("gyro_dps_rthz", "accel_g_rthz")] == [3, 3]
    assert {name: method["parameters"] for name, method in table["methods"].items()} == {"raw": 0, "least_squares": 12, "tinygc": 27}
    for method in table["methods"].values():
        assert set(method) == {"parameters", "seconds", "train", "holdout"}
        for part in ("train", "holdout"):
            assert set(method[part]) == {"tilt_rms_deg", "roll_rms_deg", "pitch_rms_deg", "yaw_rms_deg"}
            assert method[part]["yaw_rms_deg"] is None
    (closure_run,) = table["closure_runs"]
    assert closure_run["file"] == "closure0001.csv.gz"
    assert closure_run["duration_s"] > 15
    for name in ("raw", "least_squares", "tinygc"):
        figures = closure_run[name]
        assert set(figures) == {"roll_deg", "pitch_deg", "yaw_deg", "rmse_deg"}
        assert figures["rmse_deg"] == pytest.approx(np.sqrt(np.mean([figures[f"{a}_deg"] ** 2 for a in ("roll", "pitch", "yaw")])))
    assert sorted(p.name for p in (folder / "fit").iterdir()) == [
        "fit.json", "fitted.json", "model_least_squares.json", "model_raw.json", "model_tinygc.json",
    ]  # fmt: skip
    assert json.loads((folder / "fit" / "fit.json").read_text()) == table


def test_rejected_segments_are_listed_with_their_reason(run, folder):
    code, out, _ = run("fit", folder, *QUICK, "--exclude", "3", "--json", "-")
    assert code == 0
    segments = json.loads(out)["segments"]
    assert segments["used"] == 9
    assert segments["rejected"] == [{"segment": 3, "why": "left out by request"}]


def test_json_on_standard_output_is_all_there_is(run, folder):
    code, out, err = run("fit", folder, *QUICK, "--json", "-")
    assert code == 0
    assert json.loads(out)["session"] == "session"
    assert err == ""


def test_same_input_same_seed_same_numbers(run, folder):
    """All methods, the swarm among them, twice; only the seconds may differ."""

    def numbers():
        code, out, _ = run("fit", folder, "--quiet", "--folds", "2", "--seed", "5", "--json", "-")
        assert code == 0
        table = json.loads(out)
        for method in table["methods"].values():
            del method["seconds"]
        return table

    first = numbers()
    assert set(first["methods"]) == set(METHODS)
    assert first == numbers()


def test_limit_is_exit_code_1_and_says_which_figure_failed(run, folder):
    code, out, err = run("fit", folder, *QUICK, "--limit", "1e-6")
    assert (code, out, err.count("\n")) == (1, "", 1)
    for words in ("--limit 1e-06", "best held-out tilt is ", "(least_squares)", "closure0001.csv.gz's best RMSE is "):
        assert words in err
    assert run("fit", folder, *QUICK, "--limit", "45") == (0, "", "")


def test_no_earth_says_so(run, folder):
    _, out, _ = run("fit", folder, *QUICK, "--no-earth", "--json", "-")
    assert json.loads(out)["earth"]["source"] == "none"


def test_check_has_exit_codes_and_json(run, folder, tmp_path):
    path = tmp_path / "check.json"
    assert run("check", folder, "--quiet", "--json", path)[0] == 0
    table = json.loads(path.read_text())
    assert table["schema"] == "tinygc-check/1"
    assert {"level", "where", "what", "says", "do"} == set(table["findings"][0])
    spoil(folder, lambda lines: lines[:2])
    code, out, err = run("check", folder)
    assert code == 2
    assert "no samples" in out
    assert "Traceback" not in err


def test_simulate_makes_a_session_that_fit_reads(run, tmp_path):
    folder = tmp_path / "made"
    assert run("simulate", "--out", folder, "--segments", "8", "--closure", "0", "--seed", "2", "--odr-hz", "104", "--quiet") == (0, "", "")
    assert run("fit", folder, *QUICK)[0] == 0
    assert run("simulate", "--out", folder, "--segments", "8", "--closure", "0", "--force", "--quiet")[0] == 0


def test_report_names_methods_floor_and_parameters(run, folder):
    code, out, _ = run("fit", folder, "--methods", "raw,least_squares")
    assert code == 0
    for words in ("10 segments", "least squares", "noise floor", "closure0001.csv.gz", "scale correction, ppm", "±", "models:"):
        assert words in out


def test_piped_output_is_plain_text_and_progress_is_apart(folder):
    """No terminal: no escape sequences anywhere, and nothing but the report on standard output."""
    command = [sys.executable, ROOT / "calibrate.py", "fit", folder, "--methods", "least_squares"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stdout + done.stderr
    assert "reading log0001.csv" in done.stderr
    assert "reading" not in done.stdout
    assert "held out" in done.stdout


def test_a_reader_that_has_gone_is_no_error(folder):
    script = f"{sys.executable} {ROOT / 'calibrate.py'} check {folder} | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def modules_after(code):
    script = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import calibrate\n{code}\nprint(' '.join(sys.modules), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    return set(done.stderr.strip().split("\n")[-1].split())


@pytest.mark.parametrize("command", ["", "check", "fit", "simulate"])
def test_help_imports_nothing_heavy(command):
    arguments = [*command.split(), "--help"]
    loaded = modules_after(f"try: calibrate.main({arguments!r})\nexcept SystemExit as e: assert e.code == 0")
    assert "calibrate" in loaded
    assert {"torch", "scipy", "numpy", "rich.console"}.isdisjoint(loaded)


def test_least_squares_does_not_import_torch(folder):
    loaded = modules_after(
        f"assert calibrate.main(['fit', {str(folder)!r}, '--methods', 'raw,least_squares', '--quiet', '--folds', '2']) == 0"
    )
    assert "tinygc.least_squares" in loaded
    assert "torch" not in loaded


def test_methods_of_the_command_line_are_all_there_are():
    assert tuple(arguments_of.METHODS.split(",")) == METHODS
