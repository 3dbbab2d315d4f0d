"""Screens of every command, as a reader meets them: in a pseudo-terminal of 80 columns and 24 lines.

A row of SCREENS is a command, and what its first line, the answer, must match; whatever the command, no line is longer than 80 columns, or
has an ellipsis, an exponent or a word of DIALECT, and the screen has no more lines than stated.  To add a command, add a row; it runs in a
folder that holds ``good`` (16 simulated turns) and what ``before`` commands make there.  One that takes more than a second is ``slow``.
"""

from __future__ import annotations

import functools
import os
import re
import select
import shutil
import struct
import subprocess
import sys
from dataclasses import dataclass

import processes
import pytest
from conftest import ROOT
from recording_wires import virtual_boards

import tinygc
from session.log.requirements import Rule
from tinygc.cli.commands import commands
from tinygc.cli.commands.sensors import _lines
from tinygc.library.known import sensors
from tinygc.verdict.requirements import rule_words

WIDTH, HEIGHT = 80, 24
#: words that no screen has, since a reader of the field has others
DIALECT = re.compile(
    r"\b(?:says?|said|saying|tells?|told|telling|besides?|asked|mend(?:s|ed|ing)?|anew|nobody|err(?:s|ed)?|ow(?:e|es|ed)|borne|"
    r"judge[ds]?|lacks|lasts|undo|undoes)\b",
    re.IGNORECASE,
)
#: an exponent, as programs and as books write it
EXPONENT = re.compile(r"\d[eE][-+−]?\d|10\s*\^|10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]")
#: what a terminal is sent: a sequence of control characters, or text
TOKEN = re.compile(r"\x1b\[[?0-9;]*[A-Za-z]|\r|\n|[^\x1b\r\n]+")


@dataclass(frozen=True)
class Screen:
    """words: of the command; first: pattern of its first line; lines: at most; code: its exit code; before: a command run once before it;
    slow: left to ``.ci/run``; night: and not there."""

    words: str
    first: str
    lines: int = HEIGHT
    code: int = 0
    before: str = ""
    slow: bool = False
    night: bool = False


ARRAY = "simulate --out array --units 3 --segments 16 --odr-hz 104"
FITTED = "fit good --methods least_squares"
#: outputs of a sensor on a rate table, V
RATES = "rate_dps,output_v\n-60,-1.2001\n-40,-0.7998\n-20,-0.4001\n0,0.0002\n20,0.3999\n40,0.8001\n60,1.1999\n"

#: an effect that no linear model has
ODD = 'simulate --out odd --segments 30 --effect gyro.g_sensitivity={"matrix_dps_per_g":[[0.05,0,0],[0,0.05,0],[0,0.03,0.08]]}'
SCREENS = (
    Screen("explain good", r"OK: nothing beyond the model shows \(p = 0\.\d+\)\.$", slow=True),
    Screen("challenge --cases 1", r"3 of 3 effects found in simulation, 0 wrong names\.$", night=True),
    Screen("import good/log0001.csv.gz --out own --latitude 31", r"own: 16 turns, 17 stills, 62\.\d+ Hz\.", lines=12),
    Screen("check good/log0001.csv.gz", r"READY"),
    Screen("fit good/log0001.csv.gz --latitude 31 --methods least_squares", r"PASS: held-out turns close to ", slow=True),
    Screen("budget good", r"Attitude after 60 s: within [\d.]+° \(95 %\), 100 % from bias of another switch-on\.", slow=True),
    Screen("budget good --of bias_x", r"bias x: [-\d.]+ ± [\d.]+ dps \(95 %, k = [\d.]+, \d+ dof\)", slow=True),
    Screen("verify good good", r"UNDECIDED: the model was fitted to this very recording\.", code=5, before=FITTED, slow=True),
    Screen("watch good good/log0001.csv.gz", r"HOLDS: no alarm in \d+ rests, ", before=FITTED, slow=True),
    Screen("report good --certificate", r"calibrate: no certificate: time base not calibrated; give sensor.clock", 1, code=2, slow=True),
    Screen("noise good", r"Noise: [\d.]+ mdps/√Hz \(data sheet 5: within\)\.", slow=True),
    Screen("fleet good --out fleet --only check,fit", r"1 (PASS|FAIL|NOT DECIDED): 1 session of 1 serial number\.", slow=True),
    Screen("temperature good --out thermal", r"Scale is that of \d+ °C everywhere: add sessions at other temperatures\.", slow=True),
    Screen("history good", r"ASM330LHH \S+: 1 session; drift needs 4 or more\.", before=FITTED, slow=True),
    Screen("--help", r"Calibrate a MEMS gyroscope"),
    Screen("fit nowhere", r"calibrate: nowhere: no such folder$", 1, code=2),
    Screen("check nowhere", r"calibrate: nowhere: no such folder$", 1, code=2, slow=True),
    Screen("check good", r"READY"),
    Screen("simulate --out made --segments 2 --closure 0 --odr-hz 62.5", r"made: 2 turns simulated; the truth is in truth.json$", 3),
    Screen("check good --all", r"READY \(30 ok\)$", 60, slow=True),
    Screen("view good --out view.html", r"written: view\.html$", 1),
    Screen("check several", r"1 session, 0 fitted$", before="simulate --out several/one --segments 2 --closure 0 --odr-hz 62.5"),
    Screen("fit good", r"PASS: held-out turns close to [\d.]+° \(limit [\d.]+°\), closure run to [\d.]+°$", 21),
    Screen("fit good --methods least_squares --limit 0.001", r"FAIL: held-out turns close to", code=1, slow=True),
    Screen("fit limited --methods least_squares", r"FAIL: held-out turns close to [\d.]+°, above 0\.00100°$", code=1, slow=True),
    Screen("demo --out tried", r"PASS: ", slow=True),
    Screen("table list", r"grbl  ", 4),
    Screen("rates rates.csv", r"rates: a straight line; it leaves 0\.000135 V rms$", slow=True),
    Screen("fit array", r"3 units: closure 0\.\d+ to 0\.\d+° \(floor 0\.\d+°\); together 1\.\d+ × less noise$", before=ARRAY, slow=True),
    Screen("explain array", r"OK: nothing beyond the model shows", before=ARRAY, slow=True),
    Screen(
        "fit odd",
        r"FAIL: closure0001.csv.gz is off by ",
        code=1,
        before=ODD,
        slow=True,
    ),
    Screen("sensors", r"20 sensors; "),
    Screen("sensors mpu6050", r"MPU-6050, MPU-6000$", 13, slow=True),
    Screen("export good --to px4", r"written: good/export/px4.params", before=FITTED, slow=True),
    Screen("apply good good/log0001.csv.gz -o out.csv", r"out.csv: 5508 samples, calibrated ", before=FITTED, slow=True),
    Screen("report good", r"PASS: ", slow=True),
    Screen("fit good --accelerometer alone", r"good: 17 stills in 9 attitudes; ", slow=True),
)


def shown(sent):
    """The lines that stay: carriage returns, moves upwards and erased lines carried out."""
    lines, row, column = [""], 0, 0
    for token in TOKEN.findall(sent):
        if token == "\n":
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif token == "\r":
            column = 0
        elif token.startswith("\x1b"):
            if token[-1] == "A":
                row = max(0, row - int(token[2:-1] or 1))
            elif token[-1] == "K":
                lines[row] = "" if token[2:-1] == "2" else lines[row][:column]
        else:
            lines[row] = lines[row][:column].ljust(column) + token + lines[row][column + len(token) :]
            column += len(token)
    lines = [line.rstrip() for line in lines]
    while lines and not lines[-1]:
        lines.pop()
    return lines


@functools.cache
def screen_of(words, folder):
    """Exit code and screen of a command that runs in a folder, once."""
    import fcntl
    import pty
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", HEIGHT, WIDTH, 0, 0))
    environment = processes.environment(TERM="xterm-256color")
    for name in ("COLUMNS", "LINES"):
        environment.pop(name, None)
    command = [sys.executable, "calibrate.py", *words.split()]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment, cwd=folder) as process:
        os.close(theirs)
        sent = b""
        while True:
            if not select.select([ours], [], [], 300)[0]:
                process.kill()  # it asks, or hangs
                break
            try:
                part = os.read(ours, 1 << 16)
            except OSError:  # as Linux ends it
                break
            if not part:
                break
            sent += part
    os.close(ours)
    return process.returncode, shown(sent.decode())


def at_fault(line):
    """Whether a line is too long, or has what no screen has."""
    return len(line) > WIDTH or "…" in line or "..." in line or bool(EXPONENT.search(line) or DIALECT.search(line))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder that the commands run in."""
    folder = tmp_path_factory.mktemp("screens")
    (folder / "calibrate.py").symlink_to(ROOT / "calibrate.py")
    tinygc.simulate(segments=16, closure_s=15.0, odr_hz=62.5, seed=2).save(folder / "good")
    shutil.copytree(folder / "good", folder / "limited")
    with (folder / "limited/session.toml").open("a", encoding="utf-8") as file:
        file.write('[requirements]\nrule = "guard band"\nclosure_deg.upper = 0.001\ngyro_bias_mdps.upper = 5000\n')
    (folder / "rates.csv").write_text(RATES, encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    "screen",
    [pytest.param(each, id=each.words, marks=[pytest.mark.broad] * each.slow + [pytest.mark.slow] * each.night) for each in SCREENS],
)
def test_a_screen_begins_with_its_answer_and_is_read_at_80_columns(folder, screen):
    if screen.before:
        screen_of(screen.before, folder)
    code, lines = screen_of(screen.words, folder)
    text = "\n".join(lines)
    assert code == screen.code, text
    assert re.match(screen.first, lines[0]), text
    faults = [line for line in lines if at_fault(line)]
    assert not faults, text
    assert len(lines) <= screen.lines, text


@pytest.mark.parametrize("name", commands())
def test_a_help_is_read_at_80_columns(run, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    code, out, _ = run(*name.split(), "--help")
    assert (code, out.startswith(f"usage: python calibrate.py {name} [options]")) == (0, True), out
    assert not [line for line in out.splitlines() if at_fault(line)]
    assert out.count("\n") <= 30


def test_a_recording_ends_with_its_answer_and_leaves_no_live_view(tmp_path):
    (tmp_path / "calibrate.py").symlink_to(ROOT / "calibrate.py")
    with virtual_boards(tmp_path) as board:
        port = board("--rate", 104, "--segments", 4, "--speed", 20)
        code, lines = screen_of(f"record --port {port.name} --like bench.toml --out s --segments 2 --mute", tmp_path)
    assert (code, re.sub(r"\d+", "N", lines[0])) == (0, "Ended: N of N numbers are good enough after N turns."), lines
    assert re.match(r"Worst: .* and \d+ more\.$", lines[1])
    assert re.match(r"s: log0001\.csv, \d+ samples$", lines[2])
    assert lines[3:5] == ["A fit needs 7 turns, a verdict 13.", "next, with the virtual board started again:"]
    assert lines[5:] == [f"  python calibrate.py record --resume --out s --port {port.name}"]  # without --segments: they are made
    assert not [line for line in lines if at_fault(line)]


def test_the_rules_find_what_they_forbid():
    assert all(EXPONENT.search(text) for text in ("1e-05", "3 × 10⁻⁷", "2.1E+06", "x 10^3"))
    assert not any(EXPONENT.search(text) for text in ("model1e.json", "10 000", "110"))
    assert DIALECT.search("it says so")
    assert not DIALECT.search("a verdict of essays")
    assert shown("step 1\r\x1b[2Kstep 2\r\n\x1b[1A\x1b[2KPASS\r\n") == ["PASS"]


def test_lines_that_are_not_wrapped_have_80_columns():
    lines = [line for profile in sensors() for line in _lines(profile)]
    rules = (Rule(least_ratio=4.0), Rule("guard band", risk=0.05), Rule("guard band", guard=0.75))
    assert not [line for line in [*lines, *map(rule_words, rules)] if at_fault(line)]
