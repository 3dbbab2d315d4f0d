"""``history`` from the command line and in Python: folders, fleets, dates, files, exit codes, and what it refuses."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from commandline import refused
from fleets import FIT, ran
from formats_page import strangers
from unit_sessions import moved_copies
from verify_rows import made_rows

import tinygc
from session.io.folder import read_session
from session.io.units import DEG
from tinygc.annexes.budget.use import ZERO_OF_USE, Use, sources_in_use
from tinygc.annexes.history.library import FILE, PAGE
from tinygc.annexes.verification.expected import ZERO, expected_parts, spread_of_unit
from tinygc.annexes.verification.old import read_old
from tinygc.closure.motion import at_rest
from tinygc.estimation.repeatability import repeatability_of

DATES = ("2024-01-01", "2024-07-01", "2025-01-01", "2025-07-01", "2026-01-01")
BIASES = (0.0, 0.02, -0.01, 0.015, 0.005)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """One fitted session, whose copies are others of its unit."""
    folder = tmp_path_factory.mktemp("history") / "day0"
    tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session.save(folder)
    tinygc.fit(folder, methods=("least_squares",)).save()
    return folder


@pytest.fixture
def days(fitted, tmp_path):
    moved_copies(fitted, tmp_path / "unit", BIASES, DATES)
    return tmp_path / "unit"


def test_the_screen_the_files_and_the_json(days, tmp_path, run):
    code, out, _ = run("history", days, "--out", tmp_path / "out", "--no-pictures", "--accuracy", "20deg/60s", "--today", "2026-02-01")
    assert code == 0
    for words in (
        "5 sessions, 2024-01-01 to 2026-01-01 (2.0 years)",
        "the bias of any other session: ±",
        "a drift is undecided in every number",
        "a shock is undecided in every interval",
        "dates are from notes.date",
        "20deg/60s: holds until",
        "written:",
    ):
        assert words in out, words
    assert {path.name for path in (tmp_path / "out").iterdir()} == {FILE, PAGE}
    table = json.loads((tmp_path / "out" / FILE).read_text())
    assert not strangers(table)
    (unit,) = table["units"]
    assert [session["date"][:10] for session in unit["sessions"]] == list(DATES)
    x = next(number for number in unit["numbers"] if (number["name"], number["component"]) == ("bias", "x"))
    np.testing.assert_allclose(np.diff(x["values"]), -np.diff(BIASES), atol=1e-3)  # b = -E^-1 B
    html = (tmp_path / "out" / PAGE).read_text()
    assert html.count("<svg") >= 14
    assert "holds until" in html


def test_names_of_folders_are_text_wherever_they_go(fitted, tmp_path, run):
    first, *_ = moved_copies(fitted, tmp_path / "unit", BIASES[:2])
    first.rename(first.with_name("<b>[bold]$x^$\x1b"))
    code, out, _ = run("history", tmp_path / "unit", "--out", tmp_path / "out")
    assert code == 0
    assert "<b>[bold]$x^$\\x1b" in out
    assert "<b>" not in (tmp_path / "out" / PAGE).read_text()


def test_exit_codes_say_whether_it_holds(days, tmp_path, run):
    today = ("--quiet", "--today", "2026-02-01")
    assert run("history", days, "--require", "bias 5 dps", *today)[0] == 0
    code, out, _ = run("history", days, "--require", "bias 1 mdps", *today)
    assert (code, "bias 1 mdps: does not hold" in out) == (1, True)
    code, out, _ = run("history", days / "day1", days / "day2", "--require", "bias 5 dps", *today)
    assert (code, "undecided" in out) == (5, True)
    assert run("history", days / "day1", *today)[0] == 0


@pytest.mark.broad
def test_dates_may_be_given(fitted, tmp_path, run):
    moved_copies(fitted, tmp_path / "unit", BIASES[:4])
    dates = tmp_path / "dates.csv"
    dates.write_text("session,date\n# by hand\n" + "".join(f"day{5 - k},{day}\n" for k, day in enumerate(DATES[:4], 1)))
    found = tinygc.history(tmp_path / "unit", dates=dates)
    assert [session.name for session in found.units[0].sessions] == ["day4", "day3", "day2", "day1"]
    assert found.units[0].span_years == pytest.approx(1.5, abs=0.01)
    same = tinygc.history([tmp_path / "unit"], dates={f"day{5 - k}": day for k, day in enumerate(DATES[:4], 1)})
    assert same.to_json() == found.to_json()
    bad = {
        "day1,2024-13-01\n": "dates.csv:1: 'day1,2024-13-01' is no session with its date",
        "day1\n": "is no session with its date",
        "day1,2024-01-01\nday1,2024-02-01\n": "day1 has a date already",
        "day9,2024-01-01\n": "--dates: day9 is no session of these",
    }
    for text, words in bad.items():
        dates.write_text(text)
        refused(run("history", tmp_path / "unit", "--dates", dates, "--quiet"), words)


def test_what_is_no_history_is_refused(days, tmp_path, run):
    refused(run("history", tmp_path / "nowhere", "--quiet"), "not found; expected a fitted session folder")
    (tmp_path / "empty").mkdir()
    refused(run("history", tmp_path / "empty", "--quiet"), "holds no fitted session")
    refused(run("history", days / "day1", days / "day1", "--quiet"), "hold the same log")
    refused(run("history", days, "--serial", "other", "--quiet"), "--serial other: no session of that serial number")
    refused(run("history", days, "--accuracy", "1", "--quiet"), "such as 1deg/60s")
    shutil.rmtree(days / "day2" / "fit")
    refused(run("history", days / "day2", "--quiet"), "run `")
    code, out, _ = run("history", days)
    assert (code, "day2 is passed over: it is not fitted" in out) == (0, True)
    assert run("history", days, "--today", "soon")[0] == 2


def test_several_sessions_without_a_serial_number_are_no_unit(fitted, tmp_path, run):
    folders = moved_copies(fitted, tmp_path / "unit", BIASES[:2])
    for folder in folders:
        for path in (folder / "session.toml", folder / "fit" / "model_least_squares.json"):
            path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.strip().startswith(("serial", '"serial'))))
    refused(run("history", tmp_path / "unit", "--quiet"), "day1: names no serial number; give sensor.serial")
    assert run("history", folders[0], "--quiet")[0] == 0  # one session is of one unit


@pytest.mark.broad
def test_a_fleets_table_is_a_history_too(fitted, tmp_path):
    place, out = tmp_path / "sessions", tmp_path / "out"
    for day, seed in (("d20250101", 1), ("d20260101", 2)):
        tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=seed, unit_seed=1).session.save(place / day)
    ran(place, out, FIT)
    (unit,) = tinygc.history(out).units
    assert [session.moment.day for session in unit.sessions] == ["2025-01-01", "2026-01-01"]
    for day in place.iterdir():
        tinygc.fit(day, methods=("least_squares",)).save()
    (same,) = tinygc.history(place).units
    for one, other in zip(unit.numbers, same.numbers, strict=True):
        np.testing.assert_allclose(one.values, other.values, atol=1e-2 * other.sigmas.max())


def test_fit_budget_history_and_verify_take_one_spread_of_the_zero(fitted, tmp_path):
    """Six sessions with a step of the zero of z: it is taken out everywhere, and named by all."""
    moved = np.array([0.0, 0.02, -0.01, 0.015, 0.005, -0.012])
    steps = np.outer(np.arange(6) > 2, [0.0, 0.0, 1.0])
    folders = moved_copies(fitted, tmp_path, moved[:, None] * [1.0, -0.5, 0.7] + steps)
    session = read_session(fitted)
    in_fit = repeatability_of(session, folders)
    assert in_fit.source == "6 other sessions of this unit, less drift and 1 step"
    assert max(in_fit.scatter_rps) < 0.05 * DEG
    in_history = tinygc.history(folders).units[0].any_session
    np.testing.assert_array_equal(in_history.scatter_rps, in_fit.scatter_rps)
    old, rows = read_old(folders[0] / "fit" / "model_least_squares.json"), replace(made_rows(), session=session)
    in_verify = spread_of_unit(old, rows, folders)
    np.testing.assert_allclose(np.sqrt(in_verify.variance[ZERO]), in_fit.scatter_rps, rtol=1e-6)
    assert in_verify.freedom[ZERO].tolist() == in_fit.freedom.tolist() == [4, 4, 3]
    assert "a step in B_z between day3 and day4" in in_verify.note
    parts = [part for part in expected_parts(old, rows, in_verify) if part.name == "switch-on" and part.into[ZERO].any()]
    assert [part.freedom for part in parts] == [4, 4, 3]
    result = replace(tinygc.fit(session, methods=("least_squares",)).result, repeatability=in_fit)
    motion = at_rest(result.linear.model, 1.0)
    (source,) = (each for each in sources_in_use(result, Use("rest", 1.0), motion)[0] if each.name == ZERO_OF_USE["switch-on"])
    assert (source.kind, source.freedom) == ("A", 3)
    np.testing.assert_allclose(np.diag(source.covariance), 2 * in_fit.scatter_rps**2, rtol=1e-6)


@pytest.mark.broad
def test_the_report_has_it_where_other_sessions_are_named(days, run, tmp_path):
    words = [word for name in ("day1", "day2", "day3") for word in ("--history", days / name)]
    page = tmp_path / "report.html"
    assert run("fit", days / "day5", "--methods", "least_squares", "--quiet", *words)[0] in (0, 1)
    assert run("report", days / "day5", "--methods", "least_squares", "--no-explain", "--out", page, "--quiet", *words)[0] in (0, 1)
    assert 'id="history"' in page.read_text()
    assert "4 sessions, 2024-01-01 to 2026-01-01" in page.read_text()
    fit = json.loads((days / "day5" / "fit" / "fit.json").read_text())["bias_any_session"]
    sizes = " ".join(f"{size:.2g}" for size in fit["sigma_dps"])
    assert f"the bias of any other session: ± {sizes} dps" in " ".join(page.read_text().split())
    assert f"({fit['source']})" in page.read_text()
