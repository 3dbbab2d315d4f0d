"""A person's own defaults: what is taken of them, that it is said, that the command line and a session's own file win, what is refused."""

import os
from pathlib import Path

import pytest
from conftest import SESSION_TOML
from formats_page import CODE, rows
from processes import refused

from session.base.options import declared
from session.log.config import Site
from tinygc.cli import defaults
from tinygc.cli.arguments import options_of, parser
from tinygc.cli.commands import command_module

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

    def write(text=WHOLE):
        path = tmp_path / "tinygc.toml"
        path.write_text(text, encoding="utf-8")
        monkeypatch.setenv("TINYGC_DEFAULTS", str(path))
        return path

    return write


def asked(*words):
    return options_of(parser().parse_args([str(word) for word in words]))


def test_a_limit_is_taken_said_and_beaten_by_the_command_line(own, capsys):
    assert (os.environ["TINYGC_DEFAULTS"], asked("fit", "x").defaults) == ("", None)  # tests see nobody's
    path = own()
    args = asked("fit", "x")
    assert (args.limit_deg, args.defaults) == (1e-5, {"file": str(path), "limits": {"closure_deg": 1e-5}})
    assert f"of {path}: limits.closure_deg = 1e-05 (TINYGC_DEFAULTS= leaves it out)" in capsys.readouterr().err
    args = asked("fit", "x", "--limit", "45")
    assert (args.defaults, args.limit_deg) == (None, 45.0)


def test_a_recording_takes_port_and_site_unless_something_nearer_says_them(own, tmp_path):
    path, site = own(), {"latitude_deg": 48.14, "gravity_mps2": 9.8073}
    args = asked("record", "--quiet")
    assert (args.port, Site(args.latitude_deg, args.gravity_mps2)) == ("/dev/ttyACM7", Site(**site))
    assert args.defaults == {"file": str(path), "record": {"port": "/dev/ttyACM7"}, "site": site}
    args = asked("record", "--quiet", "--port", "COM3", "--like", tmp_path / "bench.toml")  # which says where the table stands
    assert (args.port, args.defaults, Site(args.latitude_deg, args.gravity_mps2)) == ("COM3", None, Site())
    (tmp_path / "session.toml").write_text(SESSION_TOML)
    assert asked("record", "--quiet", "--out", tmp_path, "--resume").defaults["record"] == {"port": "/dev/ttyACM7"}
    own(WHOLE.replace("[site]", 'like = "bench/session.toml"\n[site]'))
    args = asked("record", "--quiet")
    assert (args.like, Site(args.latitude_deg, args.gravity_mps2)) == (tmp_path / "bench" / "session.toml", Site())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "schema is missing"),
        (WHOLE.replace("48.14", "148.14"), "site.latitude_deg is 148.14, expected a number within 90"),
        (WHOLE.replace('"/dev/ttyACM7"', "7"), "record.port is 7, expected text"),
        ("schema = ", "broken TOML"),
    ],
)
def test_what_is_not_sound_is_one_line_with_file_and_key(run, own, tmp_path, text, said):
    path = own(text)
    refused(run("fit", tmp_path), str(path), said)
    path.unlink()
    refused(run("fit", tmp_path), "tinygc.toml: not found", "TINYGC_DEFAULTS")


def test_a_key_that_is_not_known_is_said_with_the_nearest(own, capsys):
    own(WHOLE.replace("closure_deg", "closure_degs"))
    assert asked("fit", "x").limit_deg is None
    assert "limits.closure_degs is not known, and ignored; did you mean limits.closure_deg?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("system", "variable", "value", "expected"),
    [
        ("linux", "XDG_CONFIG_HOME", "{}/config", "{}/config/tinygc.toml"),
        ("linux", "XDG_CONFIG_HOME", "relative", "~/.config/tinygc.toml"),  # which the specification says to ignore
        ("win32", "APPDATA", "{}/roaming", "{}/roaming/tinygc.toml"),
    ],
)
def test_where_it_is_looked_for(monkeypatch, tmp_path, system, variable, value, expected):
    monkeypatch.delenv("TINYGC_DEFAULTS")
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setenv(variable, value.format(tmp_path))
    assert defaults.place() == Path(expected.format(tmp_path)).expanduser()


def test_the_page_has_the_keys_and_no_others():
    page = [CODE.findall(row[0])[0] for row in rows("Defaults")]
    kinds = [command_module(command).Options for command in ("fit", "report", "record")]
    keys = {rule.default_key for kind in kinds for _, rule in declared(kind)} - {""}
    assert set(page) == keys
    assert len(page) == len(set(page))
