"""A person's own defaults: what is taken of them, that it is said, that the command line and a session's own file win, what is refused."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import pytest
from commandline import refused
from formats_page import CODE, rows
from streams import INFO

from session.bench.session_file import SessionFile
from session.io.config import Site, read_config
from tinygc.cli import defaults, recording
from tinygc.cli.arguments import parser
from tinygc.cli.commands import COMMANDS
from tinygc.cli.defaults import ENVIRONMENT, place, take_defaults

WHOLE = """schema = "tinygc-defaults/1"
[record]
port = "/dev/ttyACM7"
[site]
latitude_deg = 48.14
gravity_mps2 = 9.8073
[limits]
closure_deg = 1e-5
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """``own(text)``: writes the file, and lets it be read."""

    def write(text=WHOLE) -> Path:
        path = tmp_path / "tinygc.toml"
        path.write_text(text, encoding="utf-8")
        monkeypatch.setenv(ENVIRONMENT, str(path))
        return path

    return write


def asked(*words) -> argparse.Namespace:
    args = parser().parse_args([str(word) for word in words])
    take_defaults(args)
    return args


def test_tests_see_nobodys_defaults():
    assert os.environ[ENVIRONMENT] == ""
    assert place() is None
    assert asked("fit", "x").defaults is None


@pytest.mark.broad
def test_a_limit_is_taken_said_and_beaten_by_the_command_line(run, own, folder):
    path, words = own(), ("fit", folder, "--methods", "least_squares")
    code, _, err = run(*words, "--json", folder / "fit-said.json")
    assert code == 1  # nothing closes to 0.01 millidegrees
    assert f"of {path}: limits.closure_deg = 1e-05 (--no-defaults leaves it out)" in err
    assert f"above --limit 1e-05 deg (limits.closure_deg of {path}): " in err
    assert json.loads((folder / "fit-said.json").read_text())["defaults"] == {"file": str(path), "limits": {"closure_deg": 1e-5}}
    assert "defaults" not in json.loads((folder / "fit" / "fit.json").read_text())  # it changes no number there
    for more in (("--limit", "45"), ("--no-defaults",)):
        args = asked(*words, *more)
        assert args.defaults is None
        assert args.limit == (45.0 if more[0] == "--limit" else None)
    assert run("check", folder)[2] == ""  # which takes nothing


def test_a_recording_takes_port_and_site_unless_something_nearer_says_them(own, tmp_path):
    path = own()
    args = asked("record", "--quiet")
    assert (args.port, recording.bench(args)) == ("/dev/ttyACM7", Site(48.14, 9.8073))
    assert args.defaults.to_json() == {
        "file": str(path),
        "record": {"port": "/dev/ttyACM7"},
        "site": {"latitude_deg": 48.14, "gravity_mps2": 9.8073},
    }
    args = asked("record", "--quiet", "--port", "COM3", "--like", tmp_path / "bench.toml")  # which says where the table stands
    assert (args.port, args.defaults, recording.bench(args)) == ("COM3", None, Site())
    (tmp_path / "session.toml").write_text("")
    assert asked("record", "--quiet", "--out", tmp_path, "--resume").defaults.used == {"record.port": "/dev/ttyACM7"}
    own(WHOLE.replace("[site]", 'like = "bench/session.toml"\n[site]'))
    args = asked("record", "--quiet")
    assert (args.like, recording.bench(args)) == (tmp_path / "bench" / "session.toml", Site())


def test_the_site_stands_in_the_session_that_is_written(tmp_path):
    for name, bench in (("with", Site(48.14, 9.8073)), ("without", None)):
        folder = tmp_path / name
        folder.mkdir()
        SessionFile(folder, None, None, None, None, bench=bench).configure(INFO)
        assert read_config(folder / "session.toml").site == (bench or Site())
    like = tmp_path / "like.toml"
    like.write_text((tmp_path / "with" / "session.toml").read_text().replace("48.14", "-10.5"))
    (tmp_path / "third").mkdir()
    SessionFile(tmp_path / "third", like, None, None, None, bench=Site(48.14, 9.8)).configure(INFO)
    assert read_config(tmp_path / "third" / "session.toml").site == Site(-10.5, 9.8073)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "schema is missing"),
        (WHOLE.replace("defaults/1", "defaults/2"), "expected one of tinygc-defaults/1"),
        (WHOLE.replace("48.14", "148.14"), "site.latitude_deg is 148.14, expected a number within 90"),
        (WHOLE.replace("1e-5", '"small"'), "limits.closure_deg is "),
        (WHOLE.replace('"/dev/ttyACM7"', "7"), "record.port is 7, expected text"),
        ("schema = ", "broken TOML"),
    ],
)
def test_what_is_not_sound_is_one_line_with_file_and_key(run, own, tmp_path, text, said):
    path = own(text)
    refused(run("fit", tmp_path), str(path), said)
    assert "session.toml" in run("fit", tmp_path, "--no-defaults")[2]  # that far it then comes


def test_a_key_that_is_not_known_is_said_with_the_nearest(own, capsys, tmp_path):
    own(WHOLE.replace("closure_deg", "closure_degs"))
    assert asked("fit", tmp_path).limit is None
    assert "limits.closure_degs is not known, and ignored; did you mean limits.closure_deg?" in capsys.readouterr().err


def test_where_it_is_looked_for(run, monkeypatch, tmp_path):
    monkeypatch.delenv(ENVIRONMENT)
    monkeypatch.setattr(defaults.sys, "platform", "linux")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    assert place() == tmp_path / "config" / "tinygc.toml"
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")  # which the specification says to ignore
    assert place() == Path("~/.config/tinygc.toml").expanduser()
    monkeypatch.setattr(defaults.sys, "platform", "win32")
    monkeypatch.setenv("APPDATA", str(tmp_path / "roaming"))
    assert place() == tmp_path / "roaming" / "tinygc.toml"
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path / "gone.toml"))
    refused(run("fit", tmp_path), "gone.toml: not found", ENVIRONMENT)


def test_the_page_has_the_keys_and_no_others(own):
    page = [CODE.findall(row[0])[0] for row in rows("Defaults")]
    taken = {key for command in ("record", "fit", "report") for key in parser_takes(command).values()}
    assert set(page) == taken
    assert len(page) == len(set(page))


def parser_takes(command: str) -> dict[str, str]:
    from importlib import import_module

    return import_module(COMMANDS[command]).DEFAULTS
