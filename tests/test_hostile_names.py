"""Folders, files and options as no careful person gives them: names that are no UTF-8, that hold line ends or escape sequences; no name."""

import argparse
import json
import os
import re
import shutil
import tomllib

import pytest
from processes import refused

from session.base.options import file_written, folder_written, log_written, path_read
from session.log.config import read_config
from session.log.logfile import read_log
from tinygc.cli.arguments import parser

#: bytes that are no UTF-8, line ends, a title for the terminal, rich's markup, HTML, a formula
EVIL = os.fsdecode(b"caf\xe9\nINJECTED\x1b]0;t\x07[red]<b>$\\frac$ \xe2\x80\xa8x")
SHOWN = r"caf\xe9\nINJECTED\x1b]0;t\x07[red]<b>$\frac$ \u2028x"
FIT = ("--methods", "least_squares")


@pytest.fixture
def evil(simulated, tmp_path):
    """A simulated session in a folder of that name, whose session.toml and log have such texts, too."""
    folder = tmp_path / EVIL
    try:
        shutil.copytree(simulated(), folder)
    except OSError:
        pytest.skip("this disk takes no such name")
    (folder / "log0001.csv.gz").rename(folder / os.fsdecode(b"log\xe9\nINJECTED [bold].csv.gz"))
    path = folder / "session.toml"
    text = re.sub(
        r'serial = "[^"]*"', r'serial = "s\\nINJECTED\\u001B[31m[/red]</h1><script>\\u202E*/\\u2028#"', path.read_text(encoding="utf-8")
    )
    path.write_text(text + '\n[notes]\n"<i>\\nINJECTED\\u001B[2J" = "</dd>\\u2029[link=x]"\n', encoding="utf-8")
    return folder


def clean(result, code=0):
    """Nothing but lines of text on both streams, and no traceback."""
    found, out, err = result
    assert found == code, err
    assert "Traceback" not in out + err
    assert [line for line in (out + err).split("\n") if not line.isprintable() or line.strip().startswith("INJECTED")] == []
    return out


@pytest.mark.broad
def test_every_command_takes_a_name_that_is_no_text(evil, simulated, run):
    """fit used to end in a traceback after all its work; what it leaves is read by the rest."""
    assert SHOWN in clean(run("fit", evil, *FIT, "--json", evil / "fit.json"))
    assert json.loads((evil / "fit.json").read_text(encoding="utf-8"))["session"] == SHOWN
    model = json.loads((evil / "fit" / "model_least_squares.json").read_text(encoding="utf-8"))
    assert "log\\xe9\nINJECTED [bold].csv.gz" in model["sha256"]
    clean(run("check", evil))
    clean(run("export", evil, "--to", "json"))
    clean(run("apply", evil / "fit" / "model_least_squares.json", next(evil.glob("log*")), "-o", evil / "calibrated.csv"))
    assert SHOWN in clean(run("explain", evil, "--verbose"))


@pytest.mark.parametrize("serial", ['a\nb\r\n[x] \x1b[31m \x7f \u2028\x85 😀 "\\ Ø-12 µ', os.fsdecode(b"\xe9")])
def test_replay_reads_again_the_serial_number_that_it_wrote(serial, folder, tmp_path, run):
    made = tmp_path / "made"
    clean(run("import", folder / "log0001.csv", "--out", made, "--gyro-fs", "500", "--accel-fs", "4", "--serial", serial))
    assert read_config(made / "session.toml").sensor.serial == (serial if "\udce9" not in serial else r"\xe9")
    clean(run("check", made))


@pytest.mark.parametrize("axes", [(), ("--gyro-axes", "y,-x,z")])
def test_the_name_of_a_log_says_nothing_of_it(axes, folder, tmp_path, run):
    """A line end in it made lines of session.toml, and a ``key=value`` a statement of the log's own."""
    log = folder / 'l\nmodel = "x"\n gyro_fs_dps=125 stamps=counted \u2028.csv'
    (folder / "log0001.csv").rename(log)
    made = tmp_path / "made"
    clean(
        run("import", log, "--out", made, "--gyro-fs", "500", "--accel-fs", "4", *axes), 2 if axes else 0
    )  # axes that gravity contradicts
    table = tomllib.loads((made / "session.toml").read_text(encoding="utf-8"))
    assert set(table) == {"schema", "sensor", "site", "protocol"}
    assert table["sensor"]["gyro_fs_dps"] == 500
    said = read_log(made / "log0001.csv", read_config(made / "session.toml").sensor).comments
    assert said.get("gyro_fs_dps") != "125"
    assert "stamps" not in said


def _commands():
    (commands,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    return commands.choices


@pytest.mark.parametrize("name", sorted(_commands()))
def test_no_path_of_any_command_is_empty(name, capsys):
    """``--out ""``, a variable of the shell that was never set, wrote into the folder that one stood in."""
    command = _commands()[name]
    paths = [action for action in command._actions if action.type in (path_read, file_written, log_written, folder_written)]
    assert paths
    for action in paths:
        for text in ("", " "):
            with pytest.raises(argparse.ArgumentError, match="empty name"):
                command._get_values(action, [text]) if action.nargs is None else command._get_value(action, text)


@pytest.mark.parametrize(
    "arguments",
    [
        ("record", "--port", "none", "--odr", "1e308"),
        ("explain", "x", "--seed", "1" + "0" * 30),
        ("simulate", "--out", "x", "--turn-s", "1e-308"),
        ("simulate", "--out", "x", "--rest-cycles", "1", "--rest-lag-s=1e308"),
    ],
    ids=lambda arguments: " ".join(arguments)[:60],
)
def test_numbers_beyond_any_sensor_are_refused(arguments, tmp_path, run, monkeypatch, recwarn):
    monkeypatch.chdir(tmp_path)
    refused(run(*arguments))
    assert not list(tmp_path.iterdir())
    assert not recwarn.list
