"""Several session folders for ``fit`` and ``report``, and ``list``: each by itself, the broken ones said, none in the way of another."""

from __future__ import annotations

import json
import os
import shutil

import pytest
from commandline import refused
from conftest import Table, write_session
from formats_page import strangers

QUICK = ("--methods", "least_squares")


@pytest.fixture
def three(folder, tmp_path):
    """A session, one whose log is damaged, and a copy of the first under another name."""
    top = tmp_path / "data"
    top.mkdir()
    for name in ("a", "broken", "c"):
        shutil.copytree(folder, top / name)
    (top / "broken" / "log0001.csv").write_text("t_us,gx\n")
    return top


@pytest.mark.broad
def test_one_that_fails_does_not_stop_the_others_and_the_worst_code_counts(run, three, tmp_path):
    folders = [three / name for name in ("a", "broken", "c")]
    code, out, err = run("fit", *folders, *QUICK, "--quiet", "--json", tmp_path / "fits.json", "--limit", "45")
    assert code == 2
    (line,) = err.strip().splitlines()
    assert line.startswith("calibrate: ")
    assert str(three / "broken") in line
    assert "FAILED" in out
    rows = {row.split()[0]: row for row in out.splitlines()[2:]}
    assert set(rows) == {str(folder) for folder in folders}
    assert "PASS, with doubts" in rows[str(three / "a")]
    table = json.loads((tmp_path / "fits.json").read_text())
    assert table["schema"] == "tinygc-fits/1"
    assert not strangers(table)
    assert [(entry["exit_code"], entry["error"] is None) for entry in table["sessions"]] == [(0, True), (2, False), (0, True)]
    for name, entry in zip("ac", table["sessions"][::2], strict=True):
        assert json.loads((three / name / "fit" / "fit.json").read_text()) == entry["result"]
    assert not (three / "broken" / "fit").exists()
    alone = json.loads((three / "a" / "fit" / "fit.json").read_text())
    assert run("fit", three / "a", *QUICK, "--quiet", "--limit", "45") == (0, "", "")
    again = json.loads((three / "a" / "fit" / "fit.json").read_text())
    for each in (alone, again):
        del each["methods"]["least_squares"]["seconds"]
    assert alone == again


def test_list_says_what_lies_there(run, three, tmp_path):
    assert run("fit", three / "a", *QUICK, "--quiet")[0] == 0
    (three / "deeper" / "still").mkdir(parents=True)
    shutil.copytree(three / "c", three / "deeper" / "still" / "d")
    (three / "deeper" / "still" / "d" / "raw.times").write_text("host_ns,bytes,event\n71,0,open 2026-03-02T10:20:30Z /dev/ttyACM0\n72,0,\n")
    with (three / "c" / "session.toml").open("a") as file:
        file.write("\n[notes]\ndate = 2026-01-31\n")
    (three / "broken" / "session.toml").write_text("[sensor")
    write_session(three / "lost", Table().rest(1).samples())
    (three / "lost" / "session.toml").unlink()
    (three / "c" / "fit").mkdir()
    (three / "c" / "fit" / "fit.json").write_text('{"schema": "tinygc-fit/2", "methods": 3}')
    (three / "no session").mkdir()
    code, out, err = run("list", three, "--json", tmp_path / "list.json")
    assert (code, err) == (0, "")
    table = json.loads((tmp_path / "list.json").read_text())
    assert not strangers(table)
    found = {os.path.relpath(entry["folder"], three): entry for entry in table["sessions"]}
    assert list(found) == ["a", "broken", "c", "deeper/still/d", "lost"]
    fitted = json.loads((three / "a" / "fit" / "fit.json").read_text())
    assert found["a"]["method"] == "least_squares"
    assert found["a"]["segments"] == fitted["segments"]["used"] == 10
    assert found["a"]["held_out_deg"] == fitted["methods"]["least_squares"]["holdout"]["tilt_rms_deg"]
    assert found["a"]["runs_deg"] == [fitted["closure_runs"][0]["least_squares"]["rmse_deg"]]
    assert (found["a"]["logs"], found["a"]["closures"], found["a"]["model"], found["a"]["date_from"]) == (1, 1, "ASM330LHH", "file")
    assert (found["deeper/still/d"]["date"], found["deeper/still/d"]["date_from"]) == ("2026-03-02T10:20:30+00:00", "port")
    assert (found["c"]["date"], found["c"]["date_from"]) == ("2026-01-31", "notes")
    assert "methods is 3" in found["c"]["problem"]
    assert "broken TOML" in found["broken"]["problem"]
    assert "session.toml: not found" in found["lost"]["problem"]
    for name in ("a", "broken", "deeper/still/d", "lost"):
        assert name in out
    assert "no session here" in run("list", three / "no session")[1]
    refused(run("list", three / "nowhere"), "no folder")
