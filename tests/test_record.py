"""``record`` end to end: a virtual board on a pseudo-terminal, the recorder, the files; how it ends, goes on and is read again."""

from __future__ import annotations

import json
import re
import signal
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import Table
from conftest import write_session as write_samples
from processes import CALIBRATE, PIPE, calibrate, started, until
from recording_wires import CONFIG, LEAD_S, make_wire, send, virtual_boards
from streams import INFO, frame_list, line_list, sent

from session.bench import frames
from tinygc import SimulationOptions, read_session
from tinygc.cli import recording
from tinygc.cli.results import Interruption, ended_by_signals
from tinygc.simulation.write import write_session


@pytest.fixture
def board(tmp_path):
    with virtual_boards(tmp_path) as start:
        yield start


@pytest.mark.broad
def test_from_the_board_to_the_session(board, run, tmp_path):
    """Nothing is lost, every turn is accepted, and the session is, sample by sample, the one that can be read from its file."""
    spare = 2  # turns, so that one that is missed fails here and not by waiting for ever
    port = board("--rate", 104, "--segments", 2 + spare, "--speed", 20)
    words = ["--port", port, "--out", tmp_path / "s", "--like", tmp_path / "bench.toml", "--segments", 2, "--json", "-"]
    result = calibrate("record", *words)
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["done"]
    assert told["segments"] == {"wanted": 2, "accepted": 2, "rejected": 0, "dropped": 0}
    assert told["lost"] == told["crc_errors"] == told["garbage_bytes"] == told["implausible"] == told["resets"] == 0
    assert "\x1b" not in result.stderr
    (log,) = read_session(tmp_path / "s").logs
    samples = log.samples
    assert len(samples) == told["samples"]
    options = SimulationOptions(segments=2 + spare, closure_s=0.0, odr_hz=104)
    (file,) = read_session(write_session(options, tmp_path / "file")).logs
    lead = round(LEAD_S * (len(samples) - 1) / samples.duration_s)  # still before the first turn
    count = min(len(samples) - lead, len(file.samples))
    mine, theirs = samples.between(lead, lead + count), file.samples.between(0, count)
    for name in ("gyro", "accel", "temp_c"):
        assert np.array_equal(getattr(mine, name), getattr(theirs, name))
    assert np.abs((mine.t_ns - mine.t_ns[0]) - (theirs.t_ns - theirs.t_ns[0])).max() <= 1000
    assert run("record", *words)[0] == 2
    code, again, said = run("record", *words, "--resume")
    assert code == 0, said
    assert json.loads(again)["segments"] == told["segments"]  # all of it is there, and nothing is asked for any more


def test_every_signal_ends_a_recording_like_ctrl_c(wire, tmp_path):
    """Started behind nohup and an ``&``, which ignore SIGHUP and SIGINT."""
    ignored = (signal.SIGINT, signal.SIGHUP)
    data, raw = frames.encode_info(0, INFO) + b"".join(frame_list(*sent(3000))), tmp_path / "s" / "raw.bin"

    def inherited():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)

    command = [*CALIBRATE, "record", "--no-coach", "--port", wire[1], "--out", tmp_path / "s"]
    with started(command, stdout=PIPE, stderr=PIPE, text=True, preexec_fn=inherited) as process:
        until(lambda: raw.with_name("raw.times").exists() and "open" in raw.with_name("raw.times").read_text())
        threading.Thread(target=send, args=(wire[0], data), daemon=True).start()
        until(lambda: raw.stat().st_size == len(data) and raw.with_name("session.toml").exists())
        process.send_signal(signal.SIGHUP)
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        out, said = process.communicate()
    assert process.returncode == 130
    assert "3000 samples" in out
    assert re.match(r"Interrupted: 0 turns; everything received is kept\.\n", out)
    assert re.search(r"\nnext:\n  python \S*calibrate\.py record --resume --out", out)
    assert "Traceback" not in said
    assert raw.read_bytes() == data


def test_a_board_names_its_port_before_it_simulates_and_ends_quietly(tmp_path):
    command = [*CALIBRATE, "board", "--link", tmp_path / "port", "--segments", 2000]  # simulated for longer than this test lasts
    with started(command, stdout=PIPE, stderr=PIPE, text=True) as process:
        assert process.stdout.readline() == f"{tmp_path / 'port'}\n"
        assert (tmp_path / "port").is_symlink()
        assert process.stderr.readline() == "start record in another terminal; Ctrl-C ends the board\n"
        process.send_signal(signal.SIGINT)
        _, more = process.communicate()
    assert (process.returncode, more) == (0, "")
    assert not (tmp_path / "port").exists()


def test_the_signals_are_what_they_were_afterwards():
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    found = [signal.getsignal(number) for number in numbers]
    usual = [signal.default_int_handler, signal.SIG_DFL, signal.SIG_DFL]
    for number, handler in zip(numbers, usual, strict=True):
        signal.signal(number, handler)  # one that is ignored, as behind nohup, stays so
    try:
        with ended_by_signals(ignored_interrupt=True), Interruption() as wanted:
            assert not wanted()
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGHUP)
            assert wanted()
            with pytest.raises(KeyboardInterrupt):  # who asks three times is obeyed at once
                signal.raise_signal(signal.SIGINT)
        assert [signal.getsignal(number) for number in numbers] == usual
    finally:
        for number, handler in zip(numbers, found, strict=True):
            signal.signal(number, handler)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["--resume", "--out", "{new}"], 2, "no recording to resume"),
        (["--out", "{log}"], 2, "holds log0001.csv; give another --out"),
        (["--out", "{new}", "--like", "{new}/none.toml"], 2, "no such folder"),
        (["--out", "{new}"], 3, "no-port: No such file or directory; see record --port list"),
        (["--out", "{log}/log0001.csv"], 2, "log0001.csv"),
        (["--out", "{new}", "--closure", "4"], 2, "--closure is 4.0, expected a number from 5 to 3600 s"),
        (["--out", "{new}", "--view", "here"], 2, "'here' is no address of this computer"),
    ],
)
def test_what_cannot_be_is_one_line(run, tmp_path, words, code, says):
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "log0001.csv").write_text("t_us,gx,gy,gz,ax,ay,az,temp\n")
    places = {name: tmp_path / name for name in ("new", "log")}
    ended, _, said = run("record", "--port", tmp_path / "no-port", *(word.format(**places) for word in words))
    assert ended == code
    assert says in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "new").exists()


def test_the_bytes_of_a_port_make_a_session_folder(run, tmp_path):
    """With the session.toml next to them, or what the board reports, or what is given; that nothing turned in them is an error, exit 2."""
    t_us, registers = sent(2000)
    (tmp_path / "s").mkdir()
    raw, capture = tmp_path / "s" / "raw.bin", tmp_path / "capture.bin"
    raw.write_bytes(frames.encode_info(0, INFO) + b"".join(frame_list(t_us, registers, first=1)))
    assert run("import", raw, "--out", tmp_path / "a")[0] == 2
    session = read_session(tmp_path / "a")
    sensor = session.config.sensor
    assert (sensor.odr_hz, sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.serial) == (1666.5, 500, 4, "77")
    assert len(session.logs[0].samples) == 2000
    (tmp_path / "s" / "session.toml").write_text(CONFIG)
    assert run("import", raw, "--out", tmp_path / "b")[0] == 2
    assert (tmp_path / "b" / "session.toml").read_text() == CONFIG
    capture.write_bytes(b"".join(line_list(t_us, registers)))  # of any other program
    for out, words, says in (
        ("b", [], "give --out a new folder"),
        ("c", [], "--gyro-fs DPS --accel-fs G"),
        ("c", ["--gyro-fs", "500", "--accel-fs", "4"], ""),
    ):
        code, _, said = run("import", raw if out == "b" else capture, "--out", tmp_path / out, *words)
        assert code == 2
        assert says in said
    assert read_session(tmp_path / "c").config.sensor.odr_hz == pytest.approx(1666.5, rel=2e-4)  # as the stamps have it


def test_fit_refuses_a_folder_with_a_sensors_log_and_one_that_a_board_made_up(tmp_path, run):
    for name, source in (("log0001.csv", "stand-in"), ("log0002.csv", "sensor")):
        write_samples(tmp_path, Table().tumble(2, turn_s=1.5, seed=len(source)).samples(seed=len(source)), name)
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(f"# board source={source} firmware=1.0.0\n{text}")
    code, _, said = run("fit", tmp_path, "--methods", "raw", "--quiet")
    assert code == 2
    assert "log0001.csv: sensor: the board had no sensor" in said
    assert "log0002.csv is a sensor's" in said


wire = pytest.fixture(make_wire, name="wire")


@pytest.mark.parametrize(
    ("script", "report", "words"),
    [
        ("open(sys.argv[2] + '/report.html', 'w').write('it fails'); sys.exit(1)", "ready", "report.html"),
        ("print('calibrate: no segment', file=sys.stderr); sys.exit(2)", "failed", "calibrate: no segment"),
    ],
)
def test_the_page_makes_the_report_when_it_is_asked_for(tmp_path, monkeypatch, script, report, words):
    made, said, asked = tmp_path / "calibrate.py", [], threading.Event()
    made.write_text(f"import sys\nassert sys.argv[1] == 'report'\n{script}\n")
    monkeypatch.setattr(recording, "CALIBRATE", made)
    server = SimpleNamespace(visited=True, clients=1, wishes=SimpleNamespace(report=asked), publish=lambda _, content: said.append(content))
    asked.set()
    recording.stay(server, tmp_path, lambda: said[-1]["report"] in ("ready", "failed"))
    assert [each["report"] for each in said if each["report"] != "making"] == ["offered", report]
    assert words in said[-1]["words"]
    assert server.report() == (b"it fails" if report == "ready" else None)
