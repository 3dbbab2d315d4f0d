"""The table of a fleet: whole whatever happens, one line for what is wrong with it, never two who write it."""

import csv
import io
import shutil
import sqlite3

import pytest
from conftest import broad
from fleets import QUICK, Here, asked, made, ran

from session.io.errors import FormatError, StorageError
from tinygc import CalibrationError
from tinygc.annexes.lots.fleet_row import empty
from tinygc.annexes.lots.fleet_run import run_fleet, session_folders
from tinygc.annexes.lots.fleet_session import Outcome
from tinygc.annexes.lots.fleet_summary import to_check, unit_results, write_csv
from tinygc.annexes.lots.fleet_table import NAME, VERSION, open_table, read_table

pytestmark = pytest.mark.broad


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return made(tmp_path_factory.mktemp("fleet"), 3)


@pytest.fixture
def out(fleet, tmp_path):
    """A folder with a table."""
    ran(fleet, tmp_path / "out")
    return tmp_path / "out"


def refused(out, error=FormatError) -> str:
    """What both a run and a reader say, in one line."""
    said = []
    for opened in (open_table, read_table):
        with pytest.raises(error) as caught, opened(out):
            pass
        said.append(str(caught.value))
    assert said[0] == said[1]
    assert "\n" not in said[0]
    return said[0]


def test_another_programs_file_is_left_alone(tmp_path):
    connection = sqlite3.connect(tmp_path / NAME)
    with connection:
        connection.execute("CREATE TABLE results (key TEXT)")
    connection.close()
    before = (tmp_path / NAME).read_bytes()
    assert "is no table of `calibrate.py fleet`; give --out another folder" in refused(tmp_path)
    assert (tmp_path / NAME).read_bytes() == before


@pytest.mark.broad
def test_another_forms_table_is_left_alone(out):
    connection = sqlite3.connect(out / NAME)
    connection.execute(f"PRAGMA user_version = {VERSION + 1}")
    connection.close()
    before = (out / NAME).read_bytes()
    assert f"form {VERSION + 1}" in refused(out)
    assert (out / NAME).read_bytes() == before


@pytest.mark.parametrize("spoil", [lambda whole: b"no database at all" * 100, lambda whole: whole[:100] + b"\xff" * (len(whole) - 100)])
def test_a_broken_table_is_said(out, spoil):
    whole = (out / NAME).read_bytes()
    (out / NAME).write_bytes(spoil(whole))
    assert f"{out / NAME}: is broken, or no table" in refused(out)


def test_a_table_that_breaks_while_it_is_read_is_said(fleet, out):
    whole = bytearray((out / NAME).read_bytes())
    whole[len(whole) // 2 :] = b"\xff" * (len(whole) - len(whole) // 2)
    (out / NAME).write_bytes(whole)
    with pytest.raises(FormatError, match="is broken"):
        content_of_each(out)


def content_of_each(out):
    with read_table(out) as table:
        return [list(table.each(f"SELECT * FROM {name}")) for name in ("results", "folders", "durations")]


def test_no_table_is_said(tmp_path):
    with pytest.raises(FormatError, match=r"not found; `.*fleet DIR --out"), read_table(tmp_path):
        pass


def test_two_runs_at_once_are_refused_and_a_reader_is_not(fleet, out):
    with open_table(out):
        with pytest.raises(CalibrationError, match="another run is writing it; wait for its end"), open_table(out):
            pass
        with read_table(out) as table:
            assert table.one("SELECT count(*) FROM results") == 3
    assert ran(fleet, out)[0].reused == 3


def test_a_full_disk_keeps_what_is_finished_and_says_so(fleet, tmp_path):
    """A table that may not grow says what one on a full disk does."""

    class Full(Here):
        def finished(self):
            if len(self.computed) == 1:
                table._connection.execute(f"PRAGMA max_page_count = {table.one('PRAGMA page_count')}")
            found = super().finished()
            found[0].outcome.row["findings"] = "x" * 100_000
            return found

    out = tmp_path / "out"
    with pytest.raises(StorageError, match="full; free space there and run again, what is finished is kept"), open_table(out) as table:
        run_fleet(session_folders([fleet]), table, Full(), QUICK)
    assert asked(out, "SELECT count(*) FROM results") == [(1,)]
    assert ran(fleet, out)[1] == ["unit1", "unit2"]


def test_what_cannot_be_written_is_said(fleet, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fleet.lock").mkdir()
    with pytest.raises(StorageError, match=r"fleet\.lock: cannot be written .*; give --out another folder"):
        ran(fleet, tmp_path / "out")


def test_a_table_is_one_file_when_the_run_is_over(out):
    assert sorted(path.name for path in out.iterdir()) == ["fleet.lock", NAME]
    assert asked(out, "PRAGMA journal_mode") == [("delete",)]


@pytest.mark.parametrize("spoil", [broad("covariance = x'00'"), "E_xx = 'one'"])
def test_a_row_of_another_program_is_said(out, spoil):
    connection = sqlite3.connect(out / NAME)
    with connection:
        connection.execute(f"UPDATE results SET held_out_deg = 0.1, {spoil}")
    connection.close()
    with pytest.raises(FormatError, match=r"the row of .*unit0 holds what fleet does not write"):
        list(unit_results(out))


@pytest.mark.parametrize(
    ("table", "spoil", "named"),
    [
        ("results", "E_xx = 'one'", "E_xx"),
        broad("results", "floor_deg = 9e999", "floor_deg"),
        broad("results", "status = 'fine'", "status"),
        ("results", "status = 'failed', error = NULL", "error"),
        broad("results", "serial = x'00'", "serial"),
        broad("results", "segments = 'many'", "segments"),
        ("folders", "key = NULL, error = NULL", "error"),
        broad("durations", "cpu_s = 'long'", "cpu_s"),
    ],
)
def test_an_edited_table_ends_a_run_in_one_line(out, run, table, spoil, named):
    connection = sqlite3.connect(out / NAME)
    with connection:
        connection.execute(f"UPDATE {table} SET {spoil}")
    connection.close()
    code, _, err = run("fleet", "--out", out)
    assert code == 2
    assert err.count("\n") == 1
    assert f"holds what fleet does not write ({named}); delete it" in err


@pytest.mark.parametrize("anew", [False, True])
def test_a_table_that_is_taken_away_ends_the_run_within_seconds(fleet, tmp_path, monkeypatch, anew):
    """While sessions finish, and while none does."""
    monkeypatch.setattr("tinygc.annexes.lots.fleet_table.WATCH_S", 0.0)
    out = tmp_path / "out"

    class Idle(Here):
        def finished(self):
            shutil.rmtree(out, ignore_errors=True)
            if anew:
                out.mkdir()
                (out / NAME).touch()
            return []

    with pytest.raises(StorageError, match="was removed or replaced during the run"):
        ran(fleet, out, executor=Idle())


def test_csv_has_a_line_for_each_folder(out, fleet):
    with open_table(out) as table:
        table.put_folder(fleet / "zzz", None, "not found")
        row = empty() | {"status": "done", "serial": 'a,"b"\n', "E_xx": 1.0000000000000002, "effects": '[{"id":"gyro.bias_step"}]'}
        table.put(Outcome("k", None), row, [fleet / "yyy"])
        file = io.StringIO()
        assert write_csv(table, file) == 5
    lines = list(csv.DictReader(io.StringIO(file.getvalue())))
    assert [line["folder"].rsplit("/", 1)[1] for line in lines] == ["unit0", "unit1", "unit2", "yyy", "zzz"]
    assert [line["status"] for line in lines] == ["done"] * 4 + ["failed"]
    assert lines[4]["error"] == "not found"
    assert float(lines[3]["E_xx"]) == row["E_xx"]
    assert lines[3]["serial"] == row["serial"]
    assert lines[3]["effects"] == "gyro.bias_step"
    assert "turns" in lines[0]["findings"]


def test_a_named_effect_is_offered_to_the_units_other_sessions(tmp_path):
    """One session of each unit that names something and has others; none of a sensor without a serial number."""
    named, nothing = '[{"id":"gyro.bias_step"}]', "[]"
    rows = [("b", "1", named), ("a", "1", nothing), ("c", "1", named), ("d", "2", named), ("e", "3", nothing), ("f", "3", nothing)]
    rows += [("g", "", named), ("h", "", nothing), ("i", "1", nothing), ("j", "1", nothing)]
    with open_table(tmp_path) as table:
        for folder, serial, effects in rows:
            row = empty() | {"status": "done", "serial": serial, "effects": effects}
            table.put(Outcome(f"k{folder}", None), row, [tmp_path / folder])
        found = to_check(table)
    assert found == [(str(tmp_path / "b"), [str(tmp_path / name) for name in ("a", "c", "i")])]
