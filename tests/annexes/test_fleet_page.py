"""The page of a fleet, its JSON and its line on the terminal: right, small, and nothing of a file's text gets out of its place."""

import json

import numpy as np
import pytest
from fleets import FIT, made, ran
from formats_page import CODE, rows, strangers
from html_pages import parsed

from tinygc.annexes.lots.fleet_command import Meter
from tinygc.annexes.lots.fleet_page import page
from tinygc.annexes.lots.fleet_row import COLUMNS, FIGURES, LONG, VALUES, empty
from tinygc.annexes.lots.fleet_run import Tally
from tinygc.annexes.lots.fleet_session import Outcome
from tinygc.annexes.lots.fleet_summary import MOST_LISTED, distribution, summarise
from tinygc.annexes.lots.fleet_table import open_table, read_table
from tinygc.reporting.html.markup import Section

pytestmark = pytest.mark.broad

HOSTILE = '<script>alert(1)</script>"\x1b[2J\n&'


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Three sessions that are done and one that fails."""
    where = made(tmp_path_factory.mktemp("fleet"), 4)
    (where / "unit3" / "session.toml").write_text("nothing = [")
    ran(where, where / "out", FIT)
    return where / "out"


def filled(out, count: int) -> None:
    """A table with so many rows, drawn."""
    rng = np.random.default_rng(0)
    with open_table(out) as table:
        table._connection.execute("BEGIN")
        for number in range(count):
            row = empty() | {"serial": f"S{number}", "status": "done", "held_out_deg": float(rng.gamma(4, 0.01)), "use": "least_squares"}
            row["judged"] = ("pass", "not decided", "fail", "doubtful pass", "no limit")[number % 5]
            row["judged_within"] = ("pass", "not decided", "fail", "doubtful pass", "doubtful pass")[number % 5]
            row |= dict(zip(VALUES, rng.normal(size=len(VALUES)), strict=True))
            row |= {"verdict": "explained", "effects": '[{"id":"gyro.bias_step"}]'} if number % 5 == 0 else {"verdict": "no_mismatch"}
            if number % 4 == 1:
                row = empty() | {"status": "failed", "step": "check", "error": f"log{number}.csv: {number} rows {HOSTILE}"}
            marks = ", ".join("?" * (len(row) + 1))
            table._connection.execute(f"INSERT INTO results VALUES ({marks})", (str(number), *row.values()))
            table._connection.execute("INSERT INTO folders VALUES (?, ?, NULL)", (f"/data/{number:05d}", str(number)))
        table._connection.execute("COMMIT")
        table.put(Outcome("odd", None, cpu_s=9.0), empty() | {"status": "died", "error": "ended"}, [out / HOSTILE.replace("/", "")])


def test_a_page_of_many_is_small_and_well_formed(tmp_path):
    filled(tmp_path, 4000)
    with read_table(tmp_path) as table:
        summary = summarise(table, limit_deg=0.05)
    text = page(summary, [Section("lot", "The lot", "<p>of a lot</p>")])
    found = parsed(text)
    assert "script" not in found.tags
    assert len(text) < 400_000
    assert {"counts", "closure", "parameters", "lot", "failures"} <= set(found.ids)
    assert found.ids.index("parameters") < found.ids.index("lot") < found.ids.index("failures")
    assert text.count("/data/") <= MOST_LISTED + 20
    assert (summary.done, summary.failed, summary.died, summary.units) == (3000, 1000, 1, 3000)
    assert summary.reasons[0][2] == 1000, "one cause, whatever the numbers in its line"
    assert summary.effects == {"gyro.bias_step": 600}


def test_pass_and_fail_are_counted_by_the_limit(tmp_path):
    filled(tmp_path, 400)
    with read_table(tmp_path) as table:
        values = table.rows("SELECT held_out_deg, judged_within FROM results WHERE held_out_deg IS NOT NULL")
        for limit in (0.03, 0.05):
            summary = summarise(table, limit)
            within = [word for value, word in values if value <= limit]
            assert summary.passed == sum(word.endswith("pass") for word in within)
            assert summary.undecided == within.count("not decided") > 0
            assert summary.passed + summary.undecided + summary.missed == len(values) == 300
        judged = [word for (word,) in table.rows("SELECT judged FROM results WHERE judged IS NOT NULL")]
        summary = summarise(table)  # without a limit by the verdict of each fit
        counts = [sum(map(judged.count, words)) for words in (("pass", "doubtful pass"), ("not decided", "no limit"), ("fail",))]
        assert [summary.passed, summary.undecided, summary.missed] == counts
        assert min(counts) > 0


def test_a_distribution_is_that_of_the_values():
    values = np.random.default_rng(1).normal(size=10_000)
    found = distribution(values)
    assert found.counts.sum() + found.below + found.above == found.count == 10_000
    np.testing.assert_allclose(found.quantiles[1:4], [-1, 0, 1], atol=0.05)
    alone = distribution(np.array([3.0]))
    assert alone.counts.sum() == 1
    assert distribution(np.array([])) is None


@pytest.mark.broad
def test_the_command_says_it_and_writes_it(out, run, tmp_path):
    path = tmp_path / "fleet.json"
    code, said, err = run("fleet", "--out", out, "--json", path, "--csv", tmp_path / "rows.csv")
    assert (code, err) == (0, "")
    assert "4 folders, 4 different sessions of 3 serial numbers; 3 done, 1 failed" in said
    table = json.loads(path.read_text())
    assert table["schema"] == "tinygc-fleet/1"
    assert strangers(table) == []
    assert table["run"] == {"done": 0, "failed": 0, "reused": 0}
    assert len((tmp_path / "rows.csv").read_text().splitlines()) == 5
    found = parsed((out / "fleet.html").read_text())
    assert any("session.toml" in word for word in found.words)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("--strict",), 1, "failed: 1 of 4 sessions"),
        (("--limit", "1e-6"), 1, "3 of 3 fitted sessions"),
        (("--limit", "100"), 0, ""),
        (("--only", "fit,nothing"), 2, "choose among check,fit,explain"),
        (("--only", "fit", "--without", "fit", "--from", "-"), 2, "leave no step"),
    ],
)
def test_exit_codes(out, run, words, code, says):
    found, _, err = run("fleet", "--out", out, *words)
    assert found == code
    assert says in err
    assert len(err.splitlines()) == bool(says)


def test_every_column_is_on_the_page_of_formats():
    """Parameters and their sigmas by the first and the last of each sensor."""
    page = {word for row in rows("Table of a fleet") for word in CODE.findall(row[0])}
    assert page <= {"key", *COLUMNS}
    assert {"key", *FIGURES, *LONG} <= page
    assert {"E_xx", "B_z", "accel_scale_x", "accel_bias_z", "sigma_E_xx", "sigma_accel_bias_z"} <= page


def test_progress_says_what_was_done_at_which_rate_and_how_long_it_takes():
    meter = Meter(True, None)
    assert meter.words(Tally(done=90, failed=10, reused=300), 50.0) == "90 done, 10 failed, 300 reused, 2/s"
    meter._found, meter._counted = 1600, True
    assert meter.words(Tally(done=90, failed=10, reused=300), 50.0).endswith(", 2/s, 10 min left")
    assert meter.words(Tally(reused=7), 1.0) == "0 done, 0 failed, 7 reused, 0/s"


def test_no_session_is_said(run, tmp_path):
    (tmp_path / "empty").mkdir()
    code, _, err = run("fleet", tmp_path / "empty", "--out", tmp_path / "out")
    assert code == 2
    assert "no session folder there; one holds session.toml and log*.csv" in err
    code, _, err = run("fleet", tmp_path / "nowhere", "--out", tmp_path / "out")
    assert code == 2
    assert "nowhere: not found" in err
