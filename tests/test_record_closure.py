"""``record --closure`` and keys, end to end on a virtual board: a raw accelerometer, a pulled cable, Ctrl-C, ``fit``."""

import json
import os
import pty
import signal
from dataclasses import replace

import pytest
from processes import CALIBRATE, PIPE, calibrate, heard, started, until
from recording_wires import virtual_boards

from session.bench.rawfile import read_marks
from session.io.config import read_config
from tinygc import SimulationOptions, read_session
from tinygc.simulation.simulator import plan_of, simulate_session
from tinygc.simulation.virtual_board import onto_the_mark
from tinygc.simulation.write import config_text, write_files

SENSOR = ("--rate", 104, "--closure", 24, "--raw-accelerometer")
PLANNED = ("--closure", 15)
PAUSED_BYTES = 30_000  #: some seconds of the board's time


@pytest.fixture
def boards(tmp_path):
    with virtual_boards(tmp_path) as start:
        yield lambda name, *words: start(*words, "--speed", 8, name=name)


def recorded_twice(tmp_path):
    """Folders for a board to stream: three turns and a closure run begun on the mark; and such a run alone."""
    options = SimulationOptions(segments=3, closure_s=24.0, odr_hz=104)
    simulation = simulate_session(options, plan=onto_the_mark(options, plan_of(options)))
    write_files(simulation, tmp_path / "session", config_text(simulation, concealed=False))
    write_files(replace(simulation, log=simulation.closure, closure=None), tmp_path / "run", config_text(simulation, concealed=False))
    return tmp_path / "session", tmp_path / "run"


def fitted(folder) -> dict:
    result = calibrate("fit", folder, "--methods", "raw,least_squares", "--json", "-")
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.slow
def test_a_whole_session_with_a_raw_accelerometer(boards, tmp_path):
    """14 turns, the way to the mark, the run: what is recorded is fitted without an [accelerometer], and the run closes at its floor."""
    port = boards("a", *SENSOR, "--segments", 14)
    words = ["--like", tmp_path / "bench.toml", "--segments", 14, *PLANNED, "--note", "operator=Mara", "--json", "-"]
    result = calibrate("record", "--port", port, "--out", tmp_path / "s", *words)
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["done"]
    assert told["logs"] == ["log0001.csv", "closure0001.csv"]
    assert told["segments"] == {"wanted": 14, "accepted": 14, "rejected": 0, "dropped": 0}
    assert told["accelerometer"]["spread_mg"]["before"] > 10
    assert told["accelerometer"]["spread_mg"]["after"] < 0.1
    assert "the accelerometer is known" in result.stderr
    config = read_config(tmp_path / "s" / "session.toml")
    assert config.accelerometer.source == "none"
    assert config.notes == {"operator": "Mara"}
    fit = fitted(tmp_path / "s")
    assert fit["segments"]["used"] == 15  # the way to the mark is a turn as well
    assert fit["methods"]["least_squares"]["holdout"]["tilt_rms_deg"] < 0.05
    (run,) = fit["closure_runs"]
    assert run["least_squares"]["rmse_deg"] < 0.10
    assert run["raw"]["rmse_deg"] > 1


@pytest.mark.broad
def test_a_cable_pulled_in_the_run_and_ctrl_c_after_it_lose_nothing(boards, tmp_path):
    """The cable is pulled every 34 s of device time, which is in the run: no broken run bears its name; resumed, it asks for the run."""
    session, run = recorded_twice(tmp_path)
    folder, port = tmp_path / "s", boards("a", session, "--faults", "unplug=34")
    words = ["record", "--out", folder, "--like", session, "--segments", 3, *PLANNED]
    with started([*CALIBRATE, *words, "--port", port], text=True, stderr=PIPE) as process:
        heard(process.stderr, lambda line: "now the closure run" in line)
        heard(process.stderr, lambda line: "a new log begins" in line)
        process.send_signal(signal.SIGINT)
        _, seen = process.communicate()
    assert process.returncode == 130, seen
    assert f"--resume --out {folder} --port {port} --segments 3 --closure 15" in seen
    assert not list(folder.glob("closure*"))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert read_session(folder).closures == ()  # what is there can be read
    result = calibrate(*words, "--port", boards("b", run, "--lead", 12), "--resume", "--json", "-")
    assert result.returncode == 0, result.stderr
    assert "resumed: 3 segments so far" in result.stderr
    told = json.loads(result.stdout)
    assert told["segments"]["accepted"] == 3
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert all(after[name].startswith(data) for name, data in before.items())
    (closure,) = read_session(folder).closures
    assert closure.samples.duration_s > 20
    assert calibrate("import", folder / "raw.bin", "--out", tmp_path / "again").returncode == 0
    assert {path.name for path in (tmp_path / "again").glob("*.csv")} == {name for name in after if name.endswith(".csv")}
    again = calibrate(*words, "--port", boards("c", run), "--resume", "--json", "-")  # all of it is there
    assert json.loads(again.stdout)["done"]
    assert "resumed:" not in again.stderr  # nothing is asked for any more


@pytest.mark.slow
def test_keys_on_a_terminal(boards, tmp_path):
    """A note, a turn that is dropped, a pause: all of it stands where fit and a replay find it."""
    port = boards("a", "--rate", 104, "--segments", 60)
    words = ["record", "--port", port, "--out", tmp_path / "s", "--like", tmp_path / "bench.toml", "--segments", 10, "--no-coach"]
    master, slave = pty.openpty()
    raw = tmp_path / "s" / "raw.bin"
    with started([*CALIBRATE, *words], text=True, stdin=slave, stderr=PIPE, stdout=PIPE) as process:
        os.close(slave)
        for word, keys in (("turn 2 accepted", b"d"), ("turn 4 accepted", b"nthe table creaks\r"), ("turn 5 accepted", b"p")):
            heard(process.stderr, lambda line, word=word: word in line)
            os.write(master, keys)
        heard(process.stderr, lambda line: "paused: samples are stored" in line)
        before = raw.stat().st_size
        until(lambda: raw.stat().st_size > before + PAUSED_BYTES, what="bytes in the pause")
        os.write(master, b"p")
        stdout, seen = process.communicate()
        os.close(master)
    assert process.returncode == 0, seen
    assert "10 of 10 segments" in stdout
    config = read_config(tmp_path / "s" / "session.toml")
    assert list(config.notes.values()) == ["the table creaks"]
    (row,) = config.exclude
    assert row.log == "log0001.csv"
    events = [mark.event.split()[0] for mark in read_marks(tmp_path / "s" / "raw.bin") if mark.event]
    assert [word for word in events if word in ("drop", "note", "pause", "begin")] == ["drop", "note", "pause", "begin"]
    assert sorted(path.name for path in (tmp_path / "s").glob("*.csv")) == ["log0001.csv", "log0002.csv"]
    segments = fitted(tmp_path / "s")["segments"]
    assert segments["used"] in (10, 11)  # what came while it stopped may have completed one
    assert sum("left out in session.toml" in str(entry) for entry in segments["rejected"]) == 1
    assert calibrate("import", tmp_path / "s" / "raw.bin", "--out", tmp_path / "again").returncode == 0
    for path in (tmp_path / "s").glob("*.csv"):
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()
