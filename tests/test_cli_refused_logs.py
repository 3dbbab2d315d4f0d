"""One clear line and exit code 2 for whatever is wrong with a folder's files or a log."""

import gzip
import shutil

import pytest
from commandline import HEADER, QUICK, refused, set_cell, spoil
from conftest import SESSION_TOML

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


@pytest.mark.broad
def test_truncated_gzip_is_used_and_said(run, simulated, tmp_path):
    folder = tmp_path / "s"
    shutil.copytree(simulated(), folder)
    data = (folder / "log0001.csv.gz").read_bytes()
    (folder / "log0001.csv.gz").write_bytes(data[: int(len(data) * 0.95)])
    (folder / "closure0001.csv.gz").unlink()
    assert "breaks off" in run("check", folder)[1]
    assert run("fit", folder, *QUICK)[0] == 0
