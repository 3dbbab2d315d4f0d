"""A log in the place of a session folder: it is imported next to itself once, and asked at a terminal for what it does not state."""

import io
import json
import sys
import tomllib

import numpy as np
import pytest
from conftest import Table
from models_in_use import LINEAR

from session.base.errors import FormatError
from session.base.texts import command_line
from session.base.units import DEG, G
from session.replay.importing import session_next_to
from session.replay.options import Answers
from tinygc import models, read_session
from tinygc.cli.logs import _fill_in

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
    folder, read_as, made_now = session_next_to([log], Answers(gyro_fs_dps=500.0))
    assert (folder, read_as, made_now) == (log.parent / "own", "read as: time in ms (52 Hz), gyro in dps, accelerometer in g", True)
    made = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    for answers in (Answers(), Answers(gyro_fs_dps=500.0)):
        assert session_next_to([log], answers) == (folder, read_as, False)
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == made
    with pytest.raises(FormatError, match="own: exists, and was made with other options than --gyro-fs 250; move it, or leave them out"):
        session_next_to([log], Answers(gyro_fs_dps=250.0))
    log.write_text(STAMPED + STAMPED.splitlines()[-1] + "\n")
    with pytest.raises(FormatError, match=r"own: exists, and was not made of own\.log\.txt as it is now; move it, or import with"):
        session_next_to([log], Answers())


def telephone(folder):
    files = []
    for name, values, unit in (("Gyroscope", MOVED.gyro, "rad/s"), ("Accelerometer", MOVED.accel, "m/s^2")):
        files.append(folder / f"{name}.csv")
        rows = (",".join(f"{x:.9f}" for x in (t, *row)) for t, row in zip(MOVED.t_s, values, strict=True))
        files[-1].write_text("\n".join([f"Time (s),{name} x ({unit}),{name} y ({unit}),{name} z ({unit})", *rows, ""]))
    return files


def test_commands_take_a_log_and_a_telephones_two(run, tmp_path):
    files = telephone(tmp_path)
    code, out, err = run("fit", *files, "--methods", "least_squares")
    assert code in (0, 1), err
    assert "read as: time in s (52 Hz), gyro in rad/s, accelerometer in m/s^2" in out
    assert (tmp_path / "Gyroscope" / "fit" / "fit.json").exists()
    assert run("check", tmp_path / "Gyroscope" / "log0001.csv")[0] == 0
    bare, half = [tmp_path / name for name in ("w.csv", "f.csv")], tmp_path / "half.csv"
    for file, values in zip(bare, (MOVED.gyro, MOVED.accel), strict=True):
        np.savetxt(file, np.column_stack([MOVED.t_s, values]), delimiter=",")
    half.write_text(STAMPED)
    for words, complaint in (
        (("check", *files), f"unrecognized arguments: {files[1]}; `fit LOG LOG` takes a telephone's two; see --help"),
        (("fit", *bare), "w.csv: no header, 4 columns of numbers; name them by number, --columns t_UNIT=1,"),
        (("fit", *bare), "; `import` takes --columns once for each file"),
        (("fit", half, "--gyro-unit", "0.5dps"), "calibrate: half.csv: gyro scale: gravity requires rates x 2 "),
        (("fit", tmp_path / "Gyroscope", "--odr", "52"), "a folder states its units itself; leave the options of a log out"),
        (("fit", files[0], tmp_path / "Gyroscope"), "a folder, among logs; give logs or folders"),
        (("fit", files[0], tmp_path / "no.csv"), "no.csv: not found, among logs; give logs or folders"),
        (("import", tmp_path / "no.csv", "--out", tmp_path), "no.csv: not found; give the log's file"),
    ):
        code, _, err = run(*words)
        assert code == 2
        assert complaint in err


def test_apply_takes_a_log_a_telephones_two_and_a_session_folder_as_the_log_of_that_session(run, tmp_path):
    files, log, model = telephone(tmp_path), tmp_path / "own.log.txt", tmp_path / "model.json"
    log.write_text(STAMPED)
    model.write_text(json.dumps(models.to_dict(LINEAR)))
    for first, logs, read_as in (
        ("Gyroscope", files, "read as: time in s (52 Hz), gyro in rad/s, accelerometer in m/s^2"),
        ("own", [log], "read as: time in ms (52 Hz), gyro in dps, accelerometer in g"),
    ):
        written = []
        folder = tmp_path / first
        for number, given in enumerate((logs, logs, logs[:1], [folder], [folder / "log0001.csv"])):
            out = tmp_path / f"{first}{number}.csv"
            code, printed, err = run("apply", model, *given, "-o", out)
            assert (code, read_as in printed) == (0, number < 3), err
            written.append(out.read_bytes())
        assert set(written) == {written[-1]}
        assert [path.name for path in folder.glob("*.csv")] == ["log0001.csv"]
        assert run("apply", model, *logs, "-o", folder / "log0001.csv", "--force")[0] == 2


def test_what_a_log_does_not_state_is_asked_at_a_terminal_and_refused_elsewhere(run, tmp_path, monkeypatch):
    log = tmp_path / "own.txt"
    log.write_text("\n".join([*ROWS, ""]))
    for words in (("check", log), ("apply", log, log, "-o", tmp_path / "out.csv")):
        code, _, err = run(*words)
        assert code == 2
        assert "own.txt (no header) does not state its data rate, as it has no time stamps; give --odr HZ" in err
    assert err.endswith(f"give --odr HZ; these are options of `{command_line('fit', log)}`\n")
    monkeypatch.setattr(sys, "stdin", Terminal("x\n52\n"))
    asked = Terminal()
    monkeypatch.setattr(sys, "stderr", asked)
    assert run("check", log)[0] == 2
    assert run("check", log)[0] == 0
    prompt = "own.txt: what is its data rate, as it has no time stamps? (HZ) "
    assert asked.getvalue().count(prompt) == 2
    assert "'x' is no answer; give --odr HZ" in asked.getvalue()
    assert read_session(tmp_path / "own").config.sensor.odr_hz == 52.0


def test_fit_and_import_ask_for_the_latitude_once_and_take_it_later_as_an_option(run, tmp_path, monkeypatch):
    log, prompt = tmp_path / "own.csv", "your latitude in degrees, for the Earth's rotation (Enter: unknown)? "
    log.write_text(STAMPED)
    config, fit = tmp_path / "own" / "session.toml", ("fit", log, "--methods", "least_squares")
    terminal = Terminal()
    with monkeypatch.context() as at_terminal:
        at_terminal.setattr(sys, "stdin", Terminal("here\n91\n\n33,9° S\n"))
        at_terminal.setattr(sys, "stderr", terminal)
        assert run(*fit)[0] in (0, 1)
        assert (terminal.getvalue().count(prompt), read_session(tmp_path / "own").config.site.latitude_deg) == (3, None)
        assert "91 is no latitude; give a number such as 48.1, or -33.9 in the south" in terminal.getvalue()
        assert run(*fit)[0] in (0, 1)  # of a folder that is there nothing is requested
        assert terminal.getvalue().count(prompt) == 3
        code, out, _ = run("import", log, "--out", tmp_path / "south")
    assert (code, terminal.getvalue().count(prompt), "optional" in out) == (0, 4, False)
    assert read_session(tmp_path / "south").config.site.latitude_deg == -33.9
    before = config.read_text()
    assert run(*fit, "--latitude", "48.1")[0] in (0, 1)
    with_place = config.read_text()
    assert "\n[site]\nlatitude_deg = 48.1\n\n# [accelerometer]" in with_place
    assert [line for line in with_place.splitlines() if line in before.splitlines()] == [
        line for line in before.splitlines() if not line.startswith("# optional: latitude_deg")
    ]
    assert run("fit", tmp_path / "own", "--latitude", "48.1", "--sensor", "mpu6050", "--methods", "least_squares")[0] in (0, 1)
    assert config.read_text() == with_place.replace('"unknown"', '"MPU-6050"')
    for words, complaint in (
        (("--latitude", "48"), "session.toml: site.latitude_deg is 48.1, not 48.0; correct it there, or leave the option out"),
        (("--sensor", "BMI270"), "session.toml: sensor.model is MPU-6050, not BMI270; correct it there, or leave the option out"),
    ):
        for path in (log, tmp_path / "own"):
            code, _, err = run("fit", path, *words)
            assert (code, complaint in err) == (2, True)


def test_the_default_sensor_is_filled_in_where_no_file_names_it(tmp_path):
    file = tmp_path / "session.toml"
    file.write_text('schema = "tinygc-session/1"\n[sensor]\nserial = "A"\nodr_hz = 208.0\ngyro_fs_dps = 500\naccel_fs_g = 4\n')
    _fill_in(tmp_path, None, "asm330lhh")
    assert tomllib.loads(file.read_text())["sensor"]["model"] == "ASM330LHH"
