"""Which folders a fleet finds, which of their files decide a key, and in which order they were made."""

import os
import shutil
from itertools import islice
from pathlib import Path

import pytest
from fleets import QUICK, Here, asked, made, ran

from tinygc import CalibrationError
from tinygc.annexes.lots.fleet_row import FleetOptions, empty, key_of
from tinygc.annexes.lots.fleet_run import listed_folders, run_fleet, session_folders
from tinygc.annexes.lots.fleet_session import Job, Outcome, compute
from tinygc.annexes.lots.fleet_summary import unit_results
from tinygc.annexes.lots.fleet_table import open_table

pytestmark = pytest.mark.broad

FOREIGN = Path(__file__).parents[1] / "foreign_effects"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """Two units; read only."""
    return made(tmp_path_factory.mktemp("fleet"), 2)


@pytest.fixture
def copied(fleet, tmp_path):
    """The same, to change."""
    shutil.copytree(fleet, tmp_path / "place")
    return tmp_path / "place"


def test_sessions_are_found_at_any_depth_and_as_they_are_asked_for(fleet, tmp_path, monkeypatch):
    for name in ("b/deep/down/one", "a", ".hidden/three", "c/logs"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("b/deep/down/one/session.toml", "a/session.toml", ".hidden/three/session.toml", "c/logs/log0001.csv", "b/notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "a" / "inside").mkdir()
    (tmp_path / "a" / "inside" / "session.toml").touch()
    assert [str(each.relative_to(tmp_path)) for each in session_folders([tmp_path])] == ["a", "b/deep/down/one", "c/logs"]
    looked = []
    scandir = os.scandir
    monkeypatch.setattr(os, "scandir", lambda folder: looked.append(folder) or scandir(folder))
    assert len(list(islice(session_folders([tmp_path]), 1))) == 1
    assert len(looked) == 2


def test_links_lead_to_sessions_and_never_round_and_round(fleet, tmp_path):
    (tmp_path / "round").symlink_to(tmp_path, target_is_directory=True)
    (tmp_path / "one").symlink_to(fleet / "unit0", target_is_directory=True)
    assert [each.name for each in session_folders([tmp_path])] == ["one"]


def test_a_link_to_itself_hides_nothing_that_lies_beside_it(fleet, tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "one").symlink_to(fleet / "unit0", target_is_directory=True)
    assert [each.name for each in session_folders([tmp_path])] == ["one"]


def test_somebodys_notes_hide_no_session(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "session.toml").touch()
    (tmp_path / "logbook.csv").touch()
    assert list(session_folders([tmp_path])) == [tmp_path, tmp_path / "one", tmp_path / "two"]


def test_names_of_inputs_are_those_of_any_system(copied):
    folder = copied / "unit0"
    keys = {key_of(folder, QUICK)}
    for name in ("LOG0002.CSV", "log\n3.csv", "turns.csv", "rest1.csv"):
        (folder / name).write_text("x")
        keys.add(key_of(folder, QUICK))
    (folder / "notes.csv").write_text("x")
    assert len(keys | {key_of(folder, QUICK)}) == 5


@pytest.mark.parametrize(
    ("noted", "kept"),
    [
        ("2026-01-05", "2026-01-05"),
        ("2026-01-05T10:00:00+02:00", "2026-01-05T08:00:00+00:00"),
        ("20260105", "2026-01-05T00:00:00"),
        ("May 5 2026", None),
    ],
)
def test_what_is_no_date_orders_nothing(fleet, tmp_path, noted, kept):
    folder = tmp_path / "place" / "one"
    shutil.copytree(fleet / "unit0", folder)
    with (folder / "session.toml").open("a", encoding="utf-8") as file:
        file.write(f'\n[notes]\ndate = "{noted}"\n')
    ran(tmp_path / "place", tmp_path / "out")
    assert asked(tmp_path / "out", "SELECT recorded FROM results") == [(kept,)]


def test_without_times_names_count_as_their_numbers_do(tmp_path):
    with open_table(tmp_path / "out") as table:
        for name in ("s10", "s2", "s1", "t1", "s002b"):
            table.put(Outcome(name, None), empty() | {"status": "done", "held_out_deg": 0.1}, [tmp_path / name])
    assert [each.session for each in unit_results(tmp_path / "out")] == ["s1", "s2", "s002b", "s10", "t1"]


def test_effects_that_change_during_a_run_end_it(fleet, tmp_path):
    folder = tmp_path / "effects"
    shutil.copytree(FOREIGN, folder)
    options, one = FleetOptions(steps=("check",), effects=(str(folder),)), fleet / "unit0"
    assert compute(Job(str(one), key_of(one, options), options)).row["status"] == "done"
    (folder / "_parts").mkdir()
    (folder / "_parts" / "inner.py").write_text("x = 1")
    assert FleetOptions(steps=("check",), effects=(str(folder),)).text != options.text
    with pytest.raises(CalibrationError, match="effects have changed"):
        compute(Job(str(one), key_of(one, options), options))


def test_a_list_of_anything_fails_with_its_lines(tmp_path):
    lines = listed_folders(["a\0b\n", f"{tmp_path}/none\n"])
    with open_table(tmp_path / "out") as table:
        assert run_fleet(lines, table, Here(), QUICK).failed == 2
    assert {error.split(": ")[-1] for (error,) in asked(tmp_path / "out", "SELECT error FROM folders")} == {
        "is no name of a folder; expected a session folder",
        "No such file or directory; expected a session folder",
    }


def test_a_place_that_is_not_there_is_said(tmp_path):
    with pytest.raises(CalibrationError, match="not found; give a folder"):
        list(session_folders([tmp_path / "nowhere"]))
    with pytest.raises(CalibrationError, match="nothing"):
        FleetOptions(steps=("fit", "nothing"))
