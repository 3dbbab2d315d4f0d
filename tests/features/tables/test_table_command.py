"""``table`` and ``table record`` as commands: what they print, what is refused before anything moves, and a table at a port."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from formats_page import strangers
from processes import CALIBRATE, DEVNULL, PIPE, heard, refused, started
from table_recordings import table_toml

from tinygc.cli.arguments import joined, options_of, parser
from tinygc.features.tables.machines.makes import template


@pytest.fixture
def table(tmp_path, monkeypatch):
    """A table.toml in the present folder, of firmware of one's own that listens at once."""
    monkeypatch.chdir(tmp_path)
    text = (
        template("line")
        .replace("/dev/ttyUSB0", str(tmp_path / "port"))
        .replace("# One [[axis]]", "[settings]\nopen_s = 0.1\n# One [[axis]]")
    )
    (tmp_path / "table.toml").write_text(text)
    return tmp_path / "table.toml"


def test_a_description_is_printed_and_checked(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run("table", "new", "grbl")
    assert code == 0
    (tmp_path / "table.toml").write_text(out)
    code, out, _ = run("table", "check")
    assert code == 0
    assert "sent for outer to -1 deg at 10 dps: $J=G53 G90 G21 X-1.000 F600.000" in out
    assert run("table", "check", "table.toml", "--json", tmp_path / "x.json")[0] == 0
    assert not strangers(json.loads((tmp_path / "x.json").read_text()))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["turn", "outer"], "expected turn AXIS DEG"),
        (["turn", "inner", "3"], "no axis 'inner'"),
        (["turn", "outer", "nan"], "'nan' is no number"),
        (["spin", "outer", "0", "1"], "expected a rate in deg/s that is not 0"),
        (["new", "nothing"], "no make 'nothing'"),
        (["list", "--rate", "3", "--yes", "--axes", "2"], "--axes, --rate, --yes: of no use with table list"),
        (["new", "grbl", "--axes", "2", "--home"], "--home: of no use with table new"),
    ],
)
def test_wrong_words_are_refused_in_one_line(words, expected, run, table):
    refused(run("table", *words), expected)


@pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal is POSIX's")
@pytest.mark.broad
def test_a_table_at_a_port(run, table):
    """Home, a turn, a turn at a rate and where, over a real port; limits and confirmation."""
    with started(
        [*CALIBRATE, "table", "virtual", table, "--link", table.parent / "port"], stdout=PIPE, stderr=DEVNULL, text=True
    ) as virtual:
        heard(virtual.stdout, lambda line: "port" in line)
        for _ in range(2):  # a greeting that comes after the port was opened reads as a restart, once
            code, _, err = run("table", "turn", "outer", "20")
            assert code == 2
            if "has restarted" not in err:
                break
        refused(run("table", "turn", "outer", "200", "--yes"))
        assert run("table", "turn", "outer", "12", "--home", "--rate", "30", "--yes")[0] == 0
        assert run("table", "spin", "outer", "-20", "0.6", "--yes", "--json", table.parent / "x.json")[0] == 0
        told = json.loads((table.parent / "x.json").read_text())
        assert not strangers(told)
        assert -4 < told["axes"][0]["angle_deg"] < 5
        assert told["moving"] is False
        assert told["table_s"] > 0
        assert run("table", "stop")[0] == 0
        assert run("table", "clear", "--yes")[0] == 0


# Recordings.


@pytest.mark.parametrize(
    "given",
    [
        "table record --table t.toml --home --segments 12 --closure 30 --table-port p",
        "noise record --hours 2 --stop-at-target --known-to 10",
    ],
)
def test_the_printed_command_goes_on_with_what_was_asked(given):
    """With its segments too, in whose place a machine would stop at its targets."""
    words = joined([*given.split(), "--out", "s", "--port", "p"])
    options = options_of(parser(words).parse_args(words))
    again = shlex.split(options.again(Path("s"), "p"))
    again = joined(again[again.index(given.split()[0]) :])
    assert options_of(parser(again).parse_args(again)) == replace(options, resume=True)


@pytest.fixture
def absent(tmp_path):
    """A table.toml whose port does not exist: whoever opens it is told so."""
    text = table_toml("middle", "inner").replace('make = "grbl"', f'make = "grbl"\nport = "{tmp_path / "table-port"}"')
    (tmp_path / "table.toml").write_text(text)
    return tmp_path / "table.toml"


def test_a_board_that_is_not_there_is_refused_before_the_table_is_opened(run, absent, tmp_path):
    """--home would turn it first."""
    code, _, err = run("table", "record", "--table", absent, "--home", "--yes", "--port", tmp_path / "board-port", "--out", tmp_path / "s")
    assert (code, err.count("\n")) == (3, 1)
    assert "board-port: No such file or directory; see record --port list" in err


@pytest.mark.parametrize(
    ("old", "new"), [('name = "inner"', 'name = "other"'), ('make = "grbl"', 'make = "line"'), ("[[axis]]", "[settings]\nx = 1\n[[axis]]")]
)
def test_a_recording_of_another_table_is_refused_before_this_one_is_opened(run, absent, tmp_path, old, new):
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "raw.bin").write_bytes(b"x")
    (folder / "table.toml").write_text(absent.read_text().replace(old, new, 1))
    words = ("table", "record", "--resume", "--table", absent, "--home", "--yes", "--port", tmp_path / "board-port", "--out", folder)
    refused(run(*words), "a session is of one table")
