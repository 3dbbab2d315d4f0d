"""What the commands say: the worst first and the verdict last, one sign for one number, help and version, what is left when quiet."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import spoil

from session import VERSION
from session.base.console import PlainConsole
from session.detect.findings import Finding
from tinygc.reporting.fit_screen import next_line
from tinygc.reporting.tables import finding_lines, verdict_line
from tinygc.verdict.model_tests import ModelTest


def printed(renderable):
    console = PlainConsole(width=200)
    with console.capture() as captured:
        console.print(renderable)
    return captured.get().splitlines()


# check


def test_the_first_look_has_the_worst_first_each_level_in_its_order():
    levels = ["ok", "note", "error", "ok", "warning", "error"]
    findings = [Finding(level, f"log{number}.csv", "what", "says", "do it") for number, level in enumerate(levels)]
    rows = [line.split()[:2] for line in printed(finding_lines(findings, everything=True)) if "do:" not in line]
    rows = [[level, where.rstrip(":")] for level, where in rows]
    places = [("error", 2), ("error", 5), ("warning", 4), ("note", 1), ("ok", 0), ("ok", 3)]
    assert rows == [[level, f"log{number}.csv"] for level, number in places]
    assert str(verdict_line(findings)) == (
        "FAIL: fix 2 errors before fitting (2 errors, 1 warning, 1 note, 2 ok): log2.csv: what: says; do it"
    )
    assert str(verdict_line(findings[:1])) == "READY (1 ok)"
    assert str(verdict_line([])) == "READY (nothing was checked)"


def test_check_begins_with_its_verdict_and_ends_with_what_to_do_next(run, folder):
    """Between them stands what is not ok; ``--all`` shows the rest; quiet, the verdict and the worst in full."""
    code, out, _ = run("check", folder)
    verdict, *between, following = out.strip().splitlines()
    assert (code, verdict.startswith("READY")) == (0, True)
    assert following == f"next: python calibrate.py fit {folder}"
    assert not [line for line in between if line.startswith("ok")]
    assert run("check", folder, "--quiet")[1].startswith(verdict + ": ")
    spoil(folder, lambda lines: lines[:2])
    code, out, _ = run("check", folder)
    verdict, first, *_, following = out.strip().splitlines()
    assert (code, verdict.startswith("FAIL: fix 1 error before fitting (1 error")) == (2, True)
    assert (first.startswith("error"), "no samples" in first) == (True, True)
    assert following == f"next: correct the errors, then python calibrate.py check {folder}"


# the rest


def test_the_name_alone_shows_the_help_and_is_no_success(run):
    assert run("--version") == (0, f"TinyGC {VERSION}\n", "")
    code, out, err = run()
    assert (code, err) == (2, "")
    assert out.startswith("Calibrate a MEMS gyroscope")
    assert "Begin with:  python calibrate.py fit data/session1\n" in out


@pytest.mark.parametrize(
    ("suspected", "latitude_deg", "answer", "following"),
    [
        (["earth.rotation", "gyro.drift"], None, "not decided", "fit s --latitude DEG"),
        (["earth.rotation"], 48.0, "not decided", "fit s --physics auto"),
        (["gyro.drift", "earth.rotation"], None, "not decided", "fit s --latitude DEG"),
        ([], None, "no limit", "report s"),
        ([], None, "pass", "report s"),
        ([], None, "reported", "apply s s -o calibrated.csv\n  or: python calibrate.py export s --to c"),
    ],
)
def test_fit_and_report_name_what_is_next_in_their_last_line(suspected, latitude_deg, answer, following, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s" / "fit").mkdir(parents=True)
    (tmp_path / "s" / "fit" / "fit.json").touch()
    config = SimpleNamespace(site=SimpleNamespace(latitude_deg=latitude_deg))
    session = SimpleNamespace(folder=Path("s"), config=config, logs=(None,))
    allowed = SimpleNamespace(suspected=suspected)
    result = SimpleNamespace(session=session, file_to_use="m.json", tests=[], allowed=allowed, physics=None)
    decision = SimpleNamespace(passed=True, answer=answer)
    assert next_line(result, decision, reported=answer == "reported").plain == f"next: python calibrate.py {following}"


def test_what_fit_says_to_run_next_has_the_effects_that_it_was_given(tmp_path):
    def says(*effects):
        tests = [ModelTest("turns", 0.009, 0.01, "")]
        result = SimpleNamespace(session=SimpleNamespace(folder=Path("s")), file_to_use="m.json", tests=tests, allowed=None)
        return next_line(result, SimpleNamespace(passed=True, answer="pass"), effects).plain

    assert says() == "next: python calibrate.py explain s"
    assert (
        says(Path("one/explain/effects"), Path("my own"))
        == "next: python calibrate.py explain s --effects one/explain/effects --effects 'my own'"
    )
