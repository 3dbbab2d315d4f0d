"""A log in the place of a session folder: it is imported next to itself once, and asked at a terminal for what it does not state."""

import io
import sys

import numpy as np
import pytest
from conftest import Table

from session.base.errors import FormatError
from session.base.units import DEG, G
from session.replay.importing import session_next_to
from session.replay.options import Answers
from tinygc import read_session

MOVED = Table().tumble(16, seed=3, turn_s=3.0).samples(odr_hz=52)
ROWS = [",".join(f"{x:.5f}" for x in row) for row in np.column_stack([MOVED.accel / G, MOVED.gyro / DEG])]
STAMPED = "\n".join(["time_ms,ax,ay,az,gx,gy,gz", *(f"{t // 10**6},{row}" for t, row in zip(MOVED.t_ns, ROWS, strict=True)), ""])


class Terminal(io.StringIO):
    """Standard input or error of a person."""

    def isatty(self):
        return True


def test_a_folder_is_made_next_to_the_log_and_used_again_while_log_and_options_are_the_same(tmp_path):
    log = tmp_path / "bench" / "own.log.txt"
    log.parent.mkdir()
    log.write_text(STAMPED)
    folder, read_as = session_next_to([log], Answers(gyro_fs_dps=500.0))
    assert (folder, read_as) == (log.parent / "own", "read as: time in ms (52 Hz), gyro in dps, accelerometer in g")
    made = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    for answers in (Answers(), Answers(gyro_fs_dps=500.0)):
        assert session_next_to([log], answers) == (folder, read_as)
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == made
    with pytest.raises(FormatError, match="own: exists, and was made with other options than --gyro-fs 250; move it, or leave them out"):
        session_next_to([log], Answers(gyro_fs_dps=250.0))
    log.write_text(STAMPED + STAMPED.splitlines()[-1] + "\n")
    with pytest.raises(FormatError, match=r"own: exists, and was not made of own\.log\.txt as it is now; move it, or import with"):
        session_next_to([log], Answers())


def test_commands_take_a_log_and_a_telephones_two(run, tmp_path):
    files = []
    for name, values, unit in (("Gyroscope", MOVED.gyro, "rad/s"), ("Accelerometer", MOVED.accel, "m/s^2")):
        files.append(tmp_path / f"{name}.csv")
        rows = (",".join(f"{x:.9f}" for x in (t, *row)) for t, row in zip(MOVED.t_s, values, strict=True))
        files[-1].write_text("\n".join([f"Time (s),{name} x ({unit}),{name} y ({unit}),{name} z ({unit})", *rows, ""]))
    code, out, err = run("fit", *files, "--methods", "least_squares")
    assert code in (0, 1), err
    assert "read as: time in s (52 Hz), gyro in rad/s, accelerometer in m/s^2" in out
    assert (tmp_path / "Gyroscope" / "fit" / "fit.json").exists()
    assert run("check", tmp_path / "Gyroscope" / "log0001.csv")[0] == 0
    for words, complaint in (
        (("fit", tmp_path / "Gyroscope", "--odr", "52"), "a folder states its units itself; leave the options of a log out"),
        (("fit", files[0], tmp_path / "Gyroscope"), "a folder, among logs; give logs or folders"),
        (("fit", files[0], tmp_path / "no.csv"), "no.csv: not found, among logs; give logs or folders"),
        (("import", tmp_path / "no.csv", "--out", tmp_path), "no.csv: not found; give the log's file"),
    ):
        code, _, err = run(*words)
        assert code == 2
        assert complaint in err


def test_what_a_log_does_not_state_is_asked_at_a_terminal_and_refused_elsewhere(run, tmp_path, monkeypatch):
    log = tmp_path / "own.txt"
    log.write_text("\n".join([*ROWS, ""]))
    code, _, err = run("check", log)
    assert code == 2
    assert "own.txt (no header) does not state its data rate, as it has no time stamps; give --odr HZ" in err
    monkeypatch.setattr(sys, "stdin", Terminal("x\n52\n"))
    asked = Terminal()
    monkeypatch.setattr(sys, "stderr", asked)
    assert run("check", log)[0] == 2
    assert run("check", log)[0] == 0
    prompt = "own.txt: what is its data rate, as it has no time stamps? (HZ) "
    assert asked.getvalue().count(prompt) == 2
    assert "'x' is no answer; give --odr HZ" in asked.getvalue()
    assert read_session(tmp_path / "own").config.sensor.odr_hz == 52.0
