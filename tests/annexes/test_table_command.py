"""``table``: makes, descriptions, what would be sent, and a virtual table at a port."""

import json
import sys
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from commandline import refused
from formats_page import strangers
from processes import CALIBRATE, DEVNULL, PIPE, heard, started

from session.annexes.machines.makes import makes
from session.annexes.machines.template import template


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


def test_makes_are_listed(run, tmp_path):
    code, out, _ = run("table", "list", "--json", tmp_path / "makes.json")
    assert code == 0
    told = json.loads((tmp_path / "makes.json").read_text())
    assert [row["name"] for row in told["makes"]] == list(makes()) == [line.split()[0] for line in out.splitlines()]
    assert not strangers(told)


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


def test_an_angle_that_is_not_known_yet_is_no_number(run, table, monkeypatch, tmp_path):
    """While it searches its marks a machine may say none."""
    at_rest = SimpleNamespace(angles=np.array([np.nan]), moving=False, table_s=None)
    monkeypatch.setattr("session.annexes.machines.makes.open_table", lambda *given, **options: None)
    monkeypatch.setattr(
        "session.annexes.machines.safety.Guarded", lambda machine: nullcontext(SimpleNamespace(where=lambda: at_rest, description=None))
    )
    code, out, _ = run("table", "where", "--json", tmp_path / "x.json")
    assert (code, out.splitlines()[0]) == (0, "outer  not known yet")
    assert json.loads((tmp_path / "x.json").read_text())["axes"] == [{"name": "outer", "angle_deg": None}]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["turn", "outer"], "expected turn AXIS DEG"),
        (["turn", "inner", "3"], "no axis 'inner'"),
        (["turn", "outer", "x"], "'x' is no number"),
        (["turn", "outer", "nan"], "'nan' is no number"),
        (["spin", "outer", "0", "1"], "expected a rate in deg/s that is not 0"),
        (["where", "other.toml"], "other.toml"),
        (["new", "nothing"], "no make 'nothing'"),
        (["list", "x"], "expected list"),
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
        assert "nobody can confirm it" in err.splitlines()[-1]
        refused(run("table", "turn", "outer", "200", "--yes"), "expected -180 to 180")
        code, out, err = run("table", "turn", "outer", "12", "--home", "--rate", "30", "--yes")
        assert (code, out.splitlines()) == (0, ["outer  12.000 deg", "it rests"])
        assert err.splitlines()[1:3] == [
            "  1. all axes (outer) search their reference marks, at the machine's own rate",
            "  2. outer to 12 deg at up to 30 dps (limits -180 to 180 deg)",
        ]
        code, out, _ = run("table", "spin", "outer", "-20", "0.6", "--yes", "--json", table.parent / "x.json")
        told = json.loads((table.parent / "x.json").read_text())
        assert not strangers(told)
        assert -4 < told["axes"][0]["angle_deg"] < 5
        assert told["moving"] is False
        assert told["table_s"] > 0
        assert run("table", "stop")[0] == 0
        assert run("table", "clear", "--yes")[0] == 0
