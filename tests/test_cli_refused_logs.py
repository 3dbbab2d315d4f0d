"""One clear line and exit code 2 for whatever is wrong with a folder's files or a log."""

import pytest
from commandline import QUICK, refused, set_cell, spoil

# What a folder can lack


def test_log_is_a_folder(run, folder):
    (folder / "log0002.csv").mkdir()
    refused(run("fit", folder, *QUICK), "log0002.csv")


# What a log can hold


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: lines[:2], ("log0001.csv", "header", "no samples")),
        (set_cell(500, 3, "hello"), ("log0001.csv", "line 501", "gz", "hello")),
        (lambda lines: lines[:40], ("still",)),
    ],
    ids=["header only", "text", "too short"],
)
def test_bad_log(run, folder, change, words):
    spoil(folder, change)
    refused(run("fit", folder, *QUICK), *words)


@pytest.mark.broad
def test_truncated_last_line_is_left_out_and_said(run, folder):
    spoil(folder, lambda lines: [*lines[:-2], lines[-2][:9]])
    code, out, _ = run("check", folder)
    assert "cut off" in out
    assert run("fit", folder, *QUICK)[0] == 0
    assert code in (0, 1)
