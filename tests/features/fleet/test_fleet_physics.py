"""A fleet of sessions: what a row says, each computed once, failures are rows, a table that is whole whatever happens, who computes."""

import csv
import io
import json
import os
import shutil
import signal
from itertools import islice
from pathlib import Path

import numpy as np
import processes
import pytest
from fleets import FIT, NAME, QUICK, Here, asked, content, made, put, ran
from formats_page import CODE, rows, strangers
from html_pages import parsed
from processes import CALIBRATE, PIPE, started, until
from scipy import stats

from session.base.errors import FormatError, StorageError
from tinygc import CalibrationError, check, fit
from tinygc.explanation.engine import explain_session
from tinygc.features.fleet.fleet_row import COLUMNS, FIGURES, LONG, FleetOptions, Job, _failing_at, compute, key_of
from tinygc.features.fleet.fleet_run import Processes, run_fleet, session_folders
from tinygc.features.fleet.fleet_summary import fleet_html, results_of, summarise, to_check, write_csv
from tinygc.features.fleet.fleet_table import EACH, VERSION, open_table, read_table

HOSTILE = '<script>alert(1)</script>"\x1b[2J\n&'


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """Three units; read only."""
    return made(tmp_path_factory.mktemp("fleet"), 3)


@pytest.fixture(scope="module")
def whole(fleet, tmp_path_factory):
    """Its table."""
    out = tmp_path_factory.mktemp("whole")
    assert ran(fleet, out, FIT)[0].done == 3
    return out


@pytest.fixture
def copied(fleet, tmp_path):
    """The same, to be spoilt."""
    return shutil.copytree(fleet, tmp_path / "copied")


@pytest.fixture
def out(whole, tmp_path):
    """Its table, to be spoilt."""
    return shutil.copytree(whole, tmp_path / "table")


# What a row says.


@pytest.mark.broad
def test_a_row_says_what_check_fit_and_explain_say(fleet, tmp_path):
    """To the last bit, though they share what they begin with."""
    folder, out = shutil.copytree(fleet / "unit1", tmp_path / "place" / "one"), tmp_path / "out"
    ran(tmp_path / "place", out, FleetOptions())
    names = "held_out_deg, floor_deg, use, segments, verdict, p_value, first_look, E_xx, sigma_B_z, accel_bias_x, sigma_accel_scale_z"
    (row,) = asked(out, f"SELECT {names}, answer, answer_within FROM results")
    alone, why = fit(folder, methods=("least_squares",)), explain_session(folder)
    table = alone.to_json()
    held_out = table["methods"]["least_squares"]["holdout"]["tilt_rms_deg"]
    assert row[:4] == (held_out, table["noise"]["closure_floor_rms_deg"], table["use"]["method"], table["segments"]["used"])
    assert row[4:7] == (why.verdict, why.p_value, max((f.level for f in check(folder)), key=("ok", "note", "warning", "error").index))
    assert row[7:9] == (alone.parameters["E_xx"].value, alone.parameters["B_z"].sigma)
    own = alone.accelerometer_parameters
    np.testing.assert_allclose(row[9:11], [own["bias_x"].value, own["scale_z"].sigma], rtol=1e-12)
    assert row[11:] == (alone.result.verdict(None).answer, alone.result.verdict(90.0).answer)
    with read_table(out) as opened:
        for limit in (row[0] * (1 - 1e-9), row[0] * (1 + 1e-9)):
            found, answer = summarise(opened, limit), alone.result.verdict(limit).answer
            assert [found.passed, found.undecided, found.missed] == [answer.endswith("pass"), answer == "not decided", answer == "fail"]


def test_what_was_injected_is_recovered_within_the_sigmas(fleet, whole):
    """Chi-square of each unit's twelve numbers against the truth that the simulator drew."""
    with read_table(whole) as opened:
        found, total = list(results_of(opened)), 0.0
    assert [each.session for each in found] == [f"unit{n}" for n in range(3)]
    for each in found:
        truth = json.loads((fleet / each.session / "truth.json").read_text())
        off = each.values[:12] - np.concatenate([np.ravel(truth["E"]), np.radians(truth["B_dps"])])
        total += off @ np.linalg.solve(each.covariance[:12, :12], off)
        assert each.serial == f"SIM-{truth['options']['seed']}"
        np.testing.assert_array_equal(each.covariance, each.covariance.T)
    assert 0.001 < stats.chi2.sf(total, 36) < 0.999


def test_every_column_is_on_the_page_of_formats():
    """Parameters and their sigmas by the first and the last of each sensor."""
    listed = {word for row in rows("Table of a fleet") for word in CODE.findall(row[0])}
    shown = {"E_xx", "B_z", "accel_scale_x", "accel_bias_z", "sigma_E_xx", "sigma_accel_bias_z"}
    assert {"key", *FIGURES, *LONG} | shown <= listed <= {"key", *COLUMNS}


# Each is computed once, by what is in it.


def test_only_what_has_changed_is_computed_again(copied, tmp_path):
    out = tmp_path / "out"
    assert ran(copied, out)[1] == ["unit0", "unit1", "unit2"]
    before = content(out)
    tally, computed = ran(copied, out)
    assert (computed, tally.reused, tally.done, content(out)) == ([], 3, 0, before)
    config = copied / "unit2" / "session.toml"
    config.write_text(config.read_text() + '[notes]\noperator = "A"\ndate = "2026-01-05T10:00:00+02:00"\n')
    (copied / "unit1" / "truth.json").write_text("{}")  # which no command reads
    (copied / "unit1" / "fit").mkdir()  # and what one derived
    (copied / "unit0").rename(copied / "elsewhere")  # known by what is in it
    shutil.copytree(copied / "unit1", copied / "unit1copy")
    assert ran(copied, out)[1] == ["unit2"]
    assert asked(out, "SELECT operator, recorded FROM results WHERE operator IS NOT NULL") == [("A", "2026-01-05T08:00:00+00:00")]
    assert asked(out, f"SELECT count(*) FROM {EACH}") == [(3,)]  # a copy is no further measurement


def test_a_key_follows_from_every_input_and_option(copied, tmp_path):
    folder = copied / "unit0"
    others = ({}, {"steps": ("fit",)}, {"seed": 1}, {"earth": False}, {"accelerometer": "fit"})
    keys = [key_of(folder, FleetOptions(**other)) for other in others]
    for text in ("", "# changed\n"):
        (tmp_path / "mine.py").write_text(text)
        keys.append(key_of(folder, FleetOptions(effects=(str(tmp_path),))))
    (folder / "fit").mkdir()
    for name in ("LOG0002.CSV", "log\n3.csv", "turns.csv", "rest1.csv", "fit/noise.json"):
        (folder / name).write_text("x")
        keys.append(key_of(folder, FleetOptions()))
    for name in ("notes.csv", "fit/fit.json"):
        (folder / name).write_text("x")
    assert len(set(keys)) == len(keys) == 12
    assert key_of(folder, FleetOptions()) == keys[-1]
    with pytest.raises(CalibrationError, match="nothing"):
        FleetOptions(steps=("fit", "nothing"))


def test_what_changes_while_it_is_read_is_not_kept(copied, tmp_path):
    shutil.rmtree(copied / "unit2")

    class Slow(Here):
        def finished(self):
            config = copied / "unit0" / "session.toml"
            config.write_text(config.read_text() + "# later\n")
            return super().finished()

    tally, _ = ran(copied, tmp_path / "out", executor=Slow())
    assert tally.failed >= 1
    assert asked(tmp_path / "out", "SELECT count(*) FROM folders WHERE key IS NULL AND error LIKE '%changed while%'") == [(1,)]
    assert ran(copied, tmp_path / "out")[1] == ["unit0"]
    effects = shutil.copytree(Path(__file__).parents[2] / "foreign_effects", tmp_path / "effects")
    options, one = FleetOptions(steps=("check",), effects=(str(effects),)), copied / "unit1"
    job = Job(str(one), key_of(one, options), options)
    assert compute(job).row["status"] == "done"
    (effects / "_parts").mkdir()
    (effects / "_parts" / "inner.py").write_text("x = 1")
    with pytest.raises(CalibrationError, match="effects have changed"):
        compute(job)


def test_sessions_are_found_at_any_depth_and_as_they_are_asked_for(tmp_path):
    """Links lead to them, and never round and round; somebody's notes hide none."""
    for name in ("b/deep/down/one/session.toml", "a/session.toml", "a/inside/session.toml", ".hidden/session.toml", "c/logs/log0001.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "b" / "logbook.csv").touch()
    (tmp_path / "c" / "round").symlink_to(tmp_path, target_is_directory=True)
    (tmp_path / "c" / "loop").symlink_to("loop")
    (tmp_path / "d").symlink_to(tmp_path / "a", target_is_directory=True)
    found = [str(each.relative_to(tmp_path)) for each in session_folders([tmp_path])]
    assert found == ["a", "b", "b/deep/down/one", "c/logs", "d"]
    assert len(list(islice(session_folders([tmp_path]), 1))) == 1
    with pytest.raises(CalibrationError, match="not found; give a folder"):
        list(session_folders([tmp_path / "nowhere"]))


# Failures are rows.


def test_failures_are_rows_with_their_line(copied, tmp_path):
    """unit0 has a broken log, unit1 no session.toml and unit2 is well."""
    out, log = tmp_path / "out", next((copied / "unit0").glob("log*"))
    log.write_bytes(log.read_bytes()[:100])
    (copied / "unit1" / "session.toml").unlink()
    tally, _ = ran(copied, out)
    assert (tally.done, tally.failed) == (1, 2)
    *failed, well = asked(out, "SELECT status, step, results.error FROM folders JOIN results USING (key) ORDER BY folder")
    assert [row[:2] for row in failed] == [("failed", "check")] * 2
    assert not any("\n" in error or str(copied) in error for _, _, error in failed), "another copy lies elsewhere"
    assert "log0001.csv.gz" in failed[0][2]
    assert well == ("done", None, None)
    assert ran(copied, out)[1] == []  # nor are failures computed twice
    assert sorted(ran(copied, out, retry=True)[1]) == ["unit0", "unit1"]


def test_an_unforeseen_error_fails_one_row_and_not_the_fleet():
    row = {}
    with _failing_at("fit", row, Path("/data/one")):
        raise ZeroDivisionError("in /data/one/log0001.csv")
    assert row == {"status": "failed", "step": "fit", "error": "internal error: ZeroDivisionError: in log0001.csv"}
    with pytest.raises(MemoryError), _failing_at("fit", row, Path("/data/one")):  # whose process is not to be trusted
        raise MemoryError


# The table.


def refusal(out):
    """The one line of a run and of a reader, which leave the file as it is."""
    lines, before = set(), (out / NAME).read_bytes()
    for opened in (open_table, read_table):
        with pytest.raises(FormatError) as caught, opened(out):
            pass
        lines.add(str(caught.value))
    assert (out / NAME).read_bytes() == before
    (line,) = lines
    assert "\n" not in line
    return line


def test_another_programs_table_another_form_and_a_broken_one_are_refused(out, tmp_path):
    asked(tmp_path, "CREATE TABLE results (key TEXT)")
    assert "is no table of `calibrate.py fleet`; give --out another folder" in refusal(tmp_path)
    whole = (out / NAME).read_bytes()
    asked(out, f"PRAGMA user_version = {VERSION + 1}")
    assert f"form {VERSION + 1}" in refusal(out)
    (out / NAME).write_bytes(whole)
    asked(out, "ALTER TABLE results ADD COLUMN further")
    assert f"is a table of form {VERSION} with" in refusal(out)
    for broken in (b"no database at all" * 100, whole[:100] + b"\xff" * (len(whole) - 100)):
        (out / NAME).write_bytes(broken)
        assert f"{out / NAME}: is broken, or no table" in refusal(out)


def test_two_runs_at_once_are_refused_and_a_reader_is_not(fleet, out):
    assert sorted(path.name for path in out.iterdir()) == ["fleet.lock", NAME]
    assert asked(out, "PRAGMA journal_mode") == [("delete",)]
    with open_table(out):
        with pytest.raises(CalibrationError, match="another run is writing it; wait for its end"), open_table(out):
            pass
        with read_table(out) as table:
            assert table.one("SELECT count(*) FROM results") == 3
    (out / "fleet.lock").unlink()
    (out / "fleet.lock").mkdir()
    with pytest.raises(StorageError, match=r"fleet\.lock: cannot be written .*; give --out another folder"):
        ran(fleet, out)


def test_a_full_disk_keeps_what_is_finished_and_says_so(fleet, tmp_path):
    """A table that may not grow says what one on a full disk does."""

    class Full(Here):
        def finished(self):
            if len(self.computed) == 1:
                table._connection.execute(f"PRAGMA max_page_count = {table.one('PRAGMA page_count')}")
            found = super().finished()
            found[0][1].row["findings"] = "x" * 100_000
            return found

    out = tmp_path / "out"
    with pytest.raises(StorageError, match="full; free space there and run again, what is finished is kept"), open_table(out) as table:
        run_fleet(session_folders([fleet]), table, Full(), QUICK)
    assert asked(out, "SELECT count(*) FROM results") == [(1,)]
    assert ran(fleet, out)[1] == ["unit1", "unit2"]


def test_csv_has_a_line_for_each_folder(out, fleet):
    with open_table(out) as table:
        table.put_folder(fleet / "zzz", None, "not found")
        put(table, fleet / "yyy", "k", serial='a,"b"\n', E_xx=1.0000000000000002, effects='[{"id":"gyro.bias_step"}]')
        file = io.StringIO()
        assert write_csv(table, file) == 5
    lines = list(csv.DictReader(io.StringIO(file.getvalue())))
    assert [line["folder"].rsplit("/", 1)[1] for line in lines] == ["unit0", "unit1", "unit2", "yyy", "zzz"]
    assert [line["status"] for line in lines] == ["done"] * 4 + ["failed"]
    assert lines[4]["error"] == "not found"
    assert (float(lines[3]["E_xx"]), lines[3]["serial"], lines[3]["effects"]) == (1.0000000000000002, 'a,"b"\n', "gyro.bias_step")


def test_sessions_have_an_order_and_a_named_effect_is_offered_to_the_units_other_sessions(tmp_path):
    """One session of each unit that names something and has others; none of a sensor without a serial number; names count as numbers do."""
    named, nothing = '[{"id":"gyro.bias_step"}]', "[]"
    each = [("s10", "1", named), ("s2", "1", nothing), ("t1", "1", named), ("s002b", "2", named), ("s1", "3", nothing), ("u", "", named)]
    with open_table(tmp_path) as table:
        for folder, serial, effects in each:
            put(table, tmp_path / folder, f"k{folder}", serial=serial, effects=effects, held_out_deg=0.1)
        assert to_check(table) == [(str(tmp_path / "s10"), [str(tmp_path / name) for name in ("s2", "t1")])]
    with read_table(tmp_path) as opened:
        names = [each.session for each in results_of(opened)]
    assert names == ["s1", "s2", "s002b", "s10", "t1", "u"]


# The page and the command.


def test_a_page_is_escaped_and_counts_by_the_verdicts(tmp_path):
    answers = ("pass", "not decided", "fail", "doubtful pass", "no limit")
    with open_table(tmp_path) as table:
        for n in range(100):
            told = {"status": "failed", "step": "check", "error": f"log{n}.csv: {n} rows {HOSTILE}"}
            if n % 4 != 1:
                told = {"held_out_deg": n / 1000, "answer": answers[n % 5], "answer_within": answers[min(n % 5, 3)], "E_xx": 1.0 + n}
                told |= {"verdict": "explained", "effects": '[{"id":"gyro.bias_step"}]'} if n % 5 == 0 else {}
            put(table, Path(f"/data/{n:05d}"), str(n), serial=f"S{n}", **told)
        summary, strict = summarise(table), summarise(table, 0.05)
    text = fleet_html(summary, [("lot", "The lot", "<p>of a lot</p>")])
    found = parsed(text)
    assert "script" not in found.tags
    assert {"counts", "closure", "parameters", "lot", "failures"} <= set(found.ids)
    assert (summary.done, summary.failed, summary.units, summary.effects) == (75, 25, 100, {"gyro.bias_step": 15})
    assert summary.reasons[0][2] == 25, "one cause, whatever the numbers in its line"
    assert [summary.passed, summary.undecided, summary.missed] == [30, 30, 15]
    assert [strict.passed, strict.undecided, strict.missed] == [23, 7, 45]
    assert summary.distributions["E_xx"].count == 75
    assert summary.distributions["E_xx"].quantiles[2] == 51.0


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("--csv AT/rows.csv", 0, ""),
        ("--limit 100", 0, ""),
        ("--strict", 1, "failed: 1 of 4 sessions"),
        ("--only fit,nothing", 2, "'nothing' is no choice, expected some of check,fit,explain"),
        ("AT/nowhere", 2, "nowhere: not found"),
        ("AT", 2, "no session folder there; one holds session.toml and log*.csv"),
    ],
)
def test_the_command_sums_up_with_its_exit_codes(out, run, tmp_path, words, code, says):
    (tmp_path / "x").mkdir()
    with open_table(out) as table:
        put(table, tmp_path / "bad", "bad", status="failed", step="check", error="session.toml: broken")
    told = tmp_path / "x" / "fleet.json"
    found, said, err = run("fleet", *words.replace("AT", str(tmp_path / "x")).split(), "--out", out, "--json", told)
    assert found == code
    assert says in err
    assert len(err.splitlines()) == bool(says)
    if code == 0:
        assert "4 folders, 4 different sessions; 3 done, 1 failed" in said
        table = json.loads(told.read_text())
        assert (table["schema"], strangers(table), table["run"]) == ("tinygc-fleet/1", [], {"done": 0, "failed": 0, "reused": 0})
        assert any("session.toml" in word for word in parsed((out / "fleet.html").read_text()).words)


# Who computes does not matter.

posix = pytest.mark.skipif(not processes.HAS_GROUPS, reason="signals and groups as POSIX has them")


@pytest.mark.broad
@posix
def test_a_process_that_is_killed_loses_nothing_and_one_that_always_is_fails_alone(fleet, whole, tmp_path):
    """unit1's process is killed whenever it begins with it, and unit2's the first time."""
    killed = []

    class Deadly(Processes):
        def _hand_out(self):
            before = [worker.job for worker in self._workers]
            super()._hand_out()
            for job, worker in zip(before, self._workers, strict=True):
                name = os.path.basename(worker.job.folder) if worker.job is not None and worker.job is not job else ""
                if name == "unit1" or (name == "unit2" and name not in killed):
                    killed.append(name)
                    os.kill(worker.process.pid, signal.SIGKILL)

    pool = Deadly(1)
    try:
        tally, _ = ran(fleet, tmp_path, FIT, pool)
    finally:
        pool.close()
    assert sorted(killed) == ["unit1", "unit1", "unit2"]
    assert (tally.done, tally.failed) == (2, 1)
    ((key, error),) = asked(tmp_path, "SELECT key, error FROM results WHERE status = 'died'")
    assert "SIGKILL" in error
    others = [[row for row in content(at)["results"] if row[0] != key] for at in (whole, tmp_path)]
    assert others[0] == others[1]
    assert ran(fleet, tmp_path, FIT, retry=True)[1] == ["unit1"]
    assert content(tmp_path) == content(whole)


def rows_of(out):
    """So far; none while the table is being made."""
    try:
        with read_table(out) as table:
            return table.one("SELECT count(*) FROM results")
    except CalibrationError:
        return 0


@pytest.mark.broad
@posix
def test_a_run_that_is_interrupted_goes_on(fleet, tmp_path):
    """It waits for more folders when that happens; one is written, and two are under way."""
    out = tmp_path / "out"
    command = [*CALIBRATE, "fleet", "--from", "-", "--out", out, "--jobs", 1, "--only", "check"]
    with started(command, stdin=PIPE, stderr=PIPE, stdout=PIPE, text=True) as running:
        running.stdin.write("".join(f"{fleet}/unit{number}\n" for number in range(3)))
        running.stdin.flush()
        until(lambda: rows_of(out) == 1, what="the first row")
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does: to all of the group
        _, said = running.communicate()
    assert running.returncode == 130
    assert "Traceback" not in said
    assert len(ran(fleet, out)[1]) == 2
    ran(fleet, tmp_path / "again")
    assert content(out) == content(tmp_path / "again")
