"""The command line: one clear line and exit code 2 for whatever is wrong; results that other programs can read."""

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import processes
import pytest
from commandline import HEADER, QUICK, refused, spoil
from conftest import ROOT, broad

# Streams


def command_line(*arguments, shell="", **environment):
    """The command line in a process and shell of its own; ``shell`` is what follows the command, such as a redirection."""
    words = " ".join(shlex.quote(str(word)) for word in (sys.executable, ROOT / "calibrate.py", *arguments))
    return processes.run(["bash", "-c", f"{words} {shell}"], capture_output=True, env=processes.environment(**environment))


@pytest.mark.broad
def test_json_in_an_encoding_without_our_signs_loses_none(folder):
    spoilt = folder / "session.toml"
    spoilt.write_text(spoilt.read_text() + "é = 1\n", encoding="utf-8")  # broken TOML, quoted in the finding
    spoilt.write_text(spoilt.read_text().replace("é", '"é"'), encoding="utf-8")
    done = command_line("check", folder, "--json", "-", PYTHONIOENCODING="ascii")
    assert any("é" in finding["description"] for finding in json.loads(done.stdout)["findings"])


@pytest.mark.parametrize("closed", [">&- 2>&-", broad(">&-"), broad("2>&-")])
def test_closed_streams_are_no_error(folder, closed):
    done = command_line("check", folder, shell=closed)
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False)


@pytest.mark.broad
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
    assert (code, json.loads(out)["schema"]) == (0, "tinygc-check/2")
    assert json.loads(run("fit", folder, *QUICK[:2], "--folds", "2", "--json", "-")[1])["schema"] == "tinygc-fit/2"
    assert json.loads(run("simulate", "--out", tmp_path / "made", "--segments", 3, "--closure", 0, "--json", "-")[1])["folder"]


def test_what_a_file_holds_is_never_printed_raw(run, folder):
    spoil(folder, lambda lines: [lines[0], "\x1b[31m\x07" + HEADER.replace("gx", "g\x1b[0m"), *lines[2:]])
    refused(run("fit", folder, *QUICK), "\\x1b[31m")
    assert "\x1b" not in run("fit", folder, *QUICK)[2] + run("check", folder)[1]
    spoil(folder, lambda lines: ["# serial=\x1b[31mS", HEADER, *lines[2:]])
    assert "\\x1b[31mS" in run("check", folder)[1]


def test_square_brackets_are_printed_as_they_are(run, folder):
    path = folder / "session.toml"
    path.write_text(path.read_text() + '[notes]\n"[red]" = [1]\n')
    assert "notes.[red] is a list of 1, expected text" in " ".join(run("check", folder)[1].split())


# What comes out


def test_json_has_the_keys_of_formats(run, folder, tmp_path):
    path = tmp_path / "fit.json"
    assert run("fit", folder, "--quiet", "--json", path, "--methods", "raw,least_squares,tinygc") == (0, "", "")
    table = json.loads(path.read_text())
    assert {"schema", "session", "stills", "segments", "noise", "methods", "closure_runs"} <= set(table)
    assert table["schema"] == "tinygc-fit/2"
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


def test_limit_is_exit_code_1_and_says_which_figure_failed(run, folder):
    code, out, err = run("fit", folder, *QUICK, "--limit", "1e-6")
    assert (code, out, err.count("\n")) == (1, "", 1)
    for words in ("--limit 1e-06", "segments, held out, rms of tilt: 0.0", "closure0001.csv.gz, RMSE: 0.0"):
        assert words in err
    assert run("fit", folder, *QUICK, "--limit", "45") == (0, "", "")


def test_check_has_exit_codes_and_json(run, folder, tmp_path):
    path = tmp_path / "check.json"
    assert run("check", folder, "--quiet", "--json", path)[0] == 0
    table = json.loads(path.read_text())
    assert table["schema"] == "tinygc-check/2"
    assert {"level", "where", "what", "description", "advice"} == set(table["findings"][0])
    spoil(folder, lambda lines: lines[:2])
    code, out, err = run("check", folder)
    assert code == 2
    assert "no samples" in out
    assert "Traceback" not in err


@pytest.mark.broad
def test_a_reader_that_has_gone_is_no_error(folder):
    script = f"{sys.executable} {ROOT / 'calibrate.py'} check {folder} | true; exit ${{PIPESTATUS[0]}}"
    done = processes.run(["bash", "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def modules_after(code):
    script = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import calibrate\n{code}\nprint(' '.join(sys.modules), file=sys.stderr)"
    done = processes.run([sys.executable, "-c", script], capture_output=True, text=True)
    return set(done.stderr.strip().split("\n")[-1].split())


@pytest.mark.parametrize("command", ["", "fit"])
def test_help_imports_nothing_heavy(command):
    arguments = [*command.split(), "--help"]
    loaded = modules_after(f"try: calibrate.main({arguments!r})\nexcept SystemExit as e: assert e.code == 0")
    assert "calibrate" in loaded
    assert {"torch", "scipy", "numpy", "rich.console"}.isdisjoint(loaded)
