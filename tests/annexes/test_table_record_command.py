"""``record --table`` as a command: what is refused before anything moves, and what its last lines say."""

from __future__ import annotations

import os
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from commandline import refused
from table_recordings import Bench, table_toml

from session.annexes.machines.description import read_description
from tinygc import CalibrationError
from tinygc.annexes.machines.recording import TurnedRecording, require_table_of
from tinygc.cli.arguments import parser
from tinygc.cli.commands import record


@pytest.mark.parametrize(
    "given",
    [
        ["--table", "t.toml", "--home", "--stop-at-target", "--segments", "12", "--closure", "30", "--table-port", "p"],
        ["--rest", "2", "--stop-at-target", "--known-to", "10"],
        ["--table", "t.toml", "--rates", "10,20", "--dwell", "5", "--axis", "inner"],
    ],
)
def test_the_printed_command_goes_on_with_what_was_asked(given):
    """Without --stop-at-target a machine would go on to the last of its segments."""
    words = ["record", "--out", "s", "--port", "p", *given]
    args = parser(words).parse_args(words)
    again = shlex.split(record._again(args, Path("s"), "p"))
    again = again[again.index("record") :]
    assert vars(parser(again).parse_args(again)) == vars(args) | {"resume": True}


@pytest.fixture
def table(tmp_path):
    """A table.toml whose port does not exist: whoever opens it is told so."""
    text = table_toml("middle", "inner").replace('make = "grbl"', f'make = "grbl"\nport = "{tmp_path / "table-port"}"')
    (tmp_path / "table.toml").write_text(text)
    return tmp_path / "table.toml"


def test_a_board_that_is_not_there_is_refused_before_the_table_is_opened(run, table, tmp_path):
    """--home would turn it first."""
    code, _, err = run("record", "--table", table, "--home", "--yes", "--port", tmp_path / "board-port", "--out", tmp_path / "s")
    assert (code, err.count("\n")) == (3, 1)
    assert "board-port: cannot be opened" in err


@pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal is POSIX's")
def test_a_refusal_counts_nothing_that_was_not_taken_in(run, table, tmp_path, monkeypatch):
    """It said that 0 segments and no log were kept, of a folder that has both."""
    folder, (master, slave) = tmp_path / "s", os.openpty()
    folder.mkdir()
    (folder / "raw.bin").write_bytes(b"x")

    def refuses(folder, guide):
        raise CalibrationError("this table is another one")

    monkeypatch.setattr(record, "turned", lambda *given: nullcontext(SimpleNamespace(mover=refuses, moves=None)))
    with os.fdopen(master), os.fdopen(slave):
        code, _, err = run("record", "--resume", "--table", table, "--port", os.ttyname(slave), "--out", folder)
    assert (code, err) == (2, "calibrate: this table is another one\n")


@pytest.mark.parametrize(
    ("old", "new"), [('name = "inner"', 'name = "other"'), ('make = "grbl"', 'make = "line"'), ("[[axis]]", "[settings]\nx = 1\n[[axis]]")]
)
def test_a_recording_of_another_table_is_refused_before_this_one_is_opened(run, table, tmp_path, old, new):
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "raw.bin").write_bytes(b"x")
    (folder / "table.toml").write_text(table.read_text().replace(old, new, 1))
    words = ("record", "--resume", "--table", table, "--home", "--yes", "--port", tmp_path / "board-port", "--out", folder)
    refused(run(*words), "a session is of one table")


def test_a_description_that_was_corrected_goes_on_with_its_session(tmp_path):
    """The comparison says that direction or mounting is wrong: whoever mends them goes on, and all attitudes are of the new ones."""
    right = table_toml("middle", "inner")
    bench = Bench(tmp_path, right)
    wrong = right.replace("direction = [0, 1, 0]", "direction = [0, -1, 0]").replace("direction = [1, 0, 0]", "direction = [-1, 0, 0]")
    bench.file.write_text(wrong)
    _, said = bench.record(segments=4, interrupted=lambda guide: guide.accepted == 3)
    assert any("the other way round: the sign of the axis, or the mounting, is wrong" in text for text in said.texts)
    bench.file.write_text(right)
    assert "takes its place" in require_table_of(bench.file, bench.folder)
    guide, said = bench.record(segments=4)
    assert guide.accepted == 4
    assert not any("the other way round" in text for text in said.texts)
    assert (bench.folder / "table.toml").read_text() == right
    assert [path.read_text() for path in bench.folder.glob("table.toml.*")] == [wrong]


def test_a_table_turned_by_hand_is_refused_before_anything_is_asked(tmp_path):
    (tmp_path / "hand.toml").write_text(table_toml("middle", make="hand"))
    assert read_description(tmp_path / "hand.toml").make == "hand"
    with pytest.raises(CalibrationError, match="record asks a person for each turn by itself: leave --table out"):
        TurnedRecording(tmp_path / "hand.toml")
