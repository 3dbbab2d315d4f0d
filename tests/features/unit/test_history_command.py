"""``history`` from the command line and in Python: folders, fleets, dates, files, exit codes, and what it refuses."""

import json
import shutil

import numpy as np
import pytest
from formats_page import strangers
from processes import refused

import tinygc
from session.base.units import DEG
from tinygc.estimation.spread import ZERO


def moved_copies(folder, parent, biases_dps, dates=None):
    """Copies of a fitted folder as other sessions of its unit: another bias in the fit, another log by a remark at its end."""
    made = []
    for number, moved in enumerate(biases_dps):
        at = parent / f"day{number + 1}"
        shutil.copytree(folder, at)
        log = at / "log0001.csv"
        log.write_text(f"{log.read_text()}# {number}\n")
        if dates is not None:
            (at / "session.toml").write_text(f'{(at / "session.toml").read_text()}\n[notes]\ndate = "{dates[number]}"\n')
        path = at / "fit" / "model_least_squares.json"
        table = json.loads(path.read_text())
        table["sha256"] = {name: f"{number}" * 64 for name in table["sha256"]}
        table["weights"]["B"] = (np.array(table["weights"]["B"]) + moved * DEG).tolist()
        path.write_text(json.dumps(table))
        made.append(at)
    return made


DATES = ("2024-01-01", "2024-07-01", "2025-01-01", "2025-07-01", "2026-01-01")
BIASES = (0.0, 0.02, -0.01, 0.015, 0.005)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """One fitted session, whose copies are others of its unit."""
    folder = tmp_path_factory.mktemp("history") / "day0"
    tinygc.simulate(segments=8, closure_s=0.0, odr_hz=62.5, seed=1).session.save(folder)
    tinygc.fit(folder, methods=("least_squares",)).save()
    return folder


@pytest.fixture
def days(fitted, tmp_path):
    moved_copies(fitted, tmp_path / "unit", BIASES, DATES)
    return tmp_path / "unit"


def test_the_screen_the_files_and_the_json(days, tmp_path, run):
    (days / "day3").rename(days / "<b>[bold]$x^$\x1b")
    code, out, _ = run(
        "history",
        days,
        "--out",
        tmp_path / "out",
        "--no-pictures",
        "--accuracy",
        "20deg/60s",
        "--require",
        "bias 1 mdps",
        "--today",
        "2026-02-01",
    )
    assert code == 1
    for words in (
        "5 sessions over 2.0 years; no drift found.",
        "OK until ",
        "Recalibrate: met at the next switch-on with ",
    ):
        assert words in out, words
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"history.json", "history.html"}
    table, html = json.loads((tmp_path / "out" / "history.json").read_text()), (tmp_path / "out" / "history.html").read_text()
    assert not strangers(table)
    (unit,) = table["units"]
    assert [session["date"][:10] for session in unit["sessions"]] == list(DATES)
    x = next(number for number in unit["numbers"] if (number["name"], number["component"]) == ("bias", "x"))
    np.testing.assert_allclose(np.diff(x["values"]), -np.diff(BIASES), atol=1e-3)  # b = -E^-1 B
    assert (html.count("<svg") >= 14, "OK until" in html, "<b>" in html) == (True, True, False)


def test_what_is_no_history_is_refused(days, tmp_path, run):
    (tmp_path / "empty").mkdir()
    dates = tmp_path / "dates.csv"
    for words, says in (
        ((tmp_path / "nowhere",), "not found; expected a fitted session folder"),
        ((tmp_path / "empty",), "holds no fitted session"),
        ((days / "day1", days / "day1"), "hold the same log"),
        ((days, "--serial", "other"), "--serial other: no session of that serial number"),
        ((days, "--accuracy", "1"), "such as 1deg/60s"),
    ):
        refused(run("history", *words, "--quiet"), says)
    for text, says in (
        ("day1,2024-13-01\n", "dates.csv:1: 'day1,2024-13-01' is no session with its date"),
        ("day1,2024-01-01\nday1,2024-02-01\n", "day1 has a date already"),
        ("day9,2024-01-01\n", "--dates: day9 is no session of these"),
    ):
        dates.write_text(text)
        refused(run("history", days, "--dates", dates, "--quiet"), says)
    dates.write_text("session,date\n# by hand\n" + "".join(f"day{k},2024-0{6 - k}-01\n" for k in range(1, 6)))
    assert [session.name for session in tinygc.history(days, dates=dates).units[0].sessions] == [f"day{k}" for k in (5, 4, 3, 2, 1)]
    shutil.rmtree(days / "day2" / "fit")
    refused(run("history", days / "day2", "--quiet"), "run `")


def test_a_comparison_leaves_no_file(run):
    refused(run("history", "a", "b", "--compare", "--out", "h"), "--out: of no use with --compare; leave it out")


def test_several_sessions_without_a_serial_number_are_no_unit_and_each_serial_is_one(days, run):
    for name, change in (("day1", ("SIM-", "OTHER-")), ("day2", ("SIM-", "OTHER-"))):
        for path in (days / name / "session.toml", days / name / "fit" / "model_least_squares.json"):
            path.write_text(path.read_text().replace(*change))
    assert [len(unit.sessions) for unit in tinygc.history(days).units] == [2, 3]
    for path in (days / "day3" / "session.toml", days / "day3" / "fit" / "model_least_squares.json"):
        path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.strip().startswith(("serial", '"serial'))))
    refused(run("history", days, "--quiet"), "day3: names no serial number; give sensor.serial")
    code, out, _ = run("history", days / "day3", "--require", "bias 5 dps", "--quiet", "--today", "2026-02-01")
    assert (code, "Undecided" in out) == (5, True)  # one session is of one unit


def test_fit_budget_history_and_verify_take_one_spread_of_the_zero(fitted, tmp_path):
    """Six sessions with a step of the zero of z: it is taken out everywhere, and named by all."""
    moved = np.array([0.0, 0.02, -0.01, 0.015, 0.005, -0.012])
    folders = moved_copies(fitted, tmp_path, moved[:, None] * [1.0, -0.5, 0.7] + np.outer(np.arange(6) > 2, [0.0, 0.0, 1.0]))
    fit = tinygc.fit(fitted, methods=("least_squares",), history=folders)
    in_fit = fit.result.spread.at(ZERO)
    assert (in_fit.source, in_fit.freedom.tolist()) == ("6 other sessions of this unit, less drift and 1 step", [4, 4, 3])
    assert max(in_fit.scatter) < 0.05 * DEG
    np.testing.assert_array_equal(tinygc.history(folders).units[0].any_session.scatter, in_fit.scatter)
    verified = tinygc.verify(folders[0] / "fit" / "model_least_squares.json", fitted, history=folders)
    parts = [part for part in verified.parts if part.name == "switch-on" and part.into[-3:].any()]
    assert [part.freedom for part in parts] == [4, 4, 3]
    two = 2 * in_fit.scatter**2
    for axis, variance in zip(tinygc.budget(fit, motion="rest", seconds=1.0).attitude, two, strict=False):
        (row,) = (row for row in axis.rows if row.source == "bias of another switch-on")
        assert row.variance == pytest.approx(variance, rel=0.1)  # E apart
