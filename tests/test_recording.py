"""A recording is a log, and its raw bytes replay to the same log."""

from __future__ import annotations

import json

import numpy as np
import pytest
from recording_wires import CONFIG, make_wire, record, replayed
from streams import INFO, frame_list, line_list, samples, sent

import calibrate
from session.bench import frames
from session.bench.events import Comment, SampleChunk, Trouble
from session.bench.logwriter import LogWriter
from session.bench.rawfile import RecordingDecision
from session.bench.recorder import Recorder
from session.io.config import read_config
from tinygc import read_session

wire = pytest.fixture(make_wire, name="wire")


@pytest.mark.parametrize("encode", [frame_list, line_list])
def test_a_recording_is_a_log_and_replays_bit_for_bit(encode, wire, tmp_path):
    master, name = wire
    t_us, registers = sent(3000)
    recorder = Recorder(tmp_path / "s", name)
    data = b"".join(encode(t_us, registers)) + frames.encode_info(3000, INFO) * (encode is frame_list)
    events = record(recorder, master, data)
    recorder.close()
    assert (tmp_path / "s" / "raw.bin").read_bytes() == data
    table = np.loadtxt(tmp_path / "s" / "log0001.csv", delimiter=",", comments="#", skiprows=1, dtype=np.int64)
    assert np.array_equal(table, np.column_stack([t_us, registers]))
    assert len(samples(events)[0]) >= 2999  # the last line counts when the next has come, or at the end
    assert replayed(tmp_path / "s" / "raw.bin", tmp_path / "again") == [(tmp_path / "s" / "log0001.csv").read_bytes()]


def test_replay_makes_a_session_folder(wire, tmp_path, capsys):
    """With the session.toml that lies beside the raw file, or what the board says, or what it must be told."""
    master, name = wire
    recorder = Recorder(tmp_path / "s", name)
    t_us, registers = sent(3000)
    record(recorder, master, frames.encode_info(0, INFO) + b"".join(frame_list(t_us, registers, first=1)))
    recorder.close()
    raw = str(tmp_path / "s" / "raw.bin")
    assert calibrate.main(["import", raw, "--out", str(tmp_path / "a"), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["samples"] == 3000
    assert (tmp_path / "a" / "log0001.csv").read_bytes() == (tmp_path / "s" / "log0001.csv").read_bytes()
    sensor = read_session(tmp_path / "a").config.sensor
    assert (sensor.odr_hz, sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.serial) == (1666.5, 500, 4, "77")
    (tmp_path / "s" / "session.toml").write_text(CONFIG)
    assert calibrate.main(["import", raw, "--out", str(tmp_path / "b")]) == 0
    assert (tmp_path / "b" / "session.toml").read_text() == CONFIG
    assert calibrate.main(["import", raw, "--out", str(tmp_path / "b")]) == 2
    assert "give --out a new folder" in capsys.readouterr().err
    capture = tmp_path / "capture.bin"  # of any other program
    capture.write_bytes(b"".join(line_list(t_us, registers)))
    assert calibrate.main(["import", str(capture), "--out", str(tmp_path / "c" / "d")]) == 2
    assert "--gyro-fs DPS --accel-fs G" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
    assert calibrate.main(["import", str(capture), "--out", str(tmp_path / "c"), "--gyro-fs", "500", "--accel-fs", "4"]) == 0
    assert read_config(tmp_path / "c" / "session.toml").sensor.odr_hz == pytest.approx(1666.5, rel=2e-4)  # as the stamps have it
    capture.write_bytes(np.random.default_rng(0).bytes(5000))
    assert calibrate.main(["import", str(capture), "--out", str(tmp_path / "e")]) == 2
    assert "no samples" in capsys.readouterr().err
    assert not (tmp_path / "e").exists()


def test_a_reset_begins_a_new_log_and_comments_are_kept(tmp_path):
    logs = LogWriter(tmp_path)
    chunk = SampleChunk(*sent(3))
    logs.write(
        [Comment("first words"), chunk, INFO, INFO, Trouble("implausible", 2, 5), Trouble("reset"), chunk, Trouble("reconnect"), chunk]
    )
    logs.begin("closure")
    logs.write([Comment(INFO.text), INFO, chunk])
    logs.close()
    assert [path.name for path in logs.paths] == ["log0001.csv", "log0002.csv", "log0003.csv", "closure0001.csv"]
    lines = logs.paths[0].read_text().split("\n")
    assert lines[:2] == ["# first words", "t_us,gx,gy,gz,ax,ay,az,temp"]
    assert lines[5] == f"# {INFO.text}" == "# gyro_fs_dps=500 accel_fs_g=4 odr_hz=1666.5000 serial=77"
    assert lines[6] == "# left out as implausible: 2 (t_us 5)"
    assert logs.paths[3].read_text().count(INFO.text) == 1
    (tmp_path / "session.toml").write_text(CONFIG)
    session = read_session(tmp_path)
    assert [len(log.samples) for log in session.logs] == [3, 3, 3]
    assert session.logs[0].comments["odr_hz"] == "1666.5000"


def test_where_a_closure_run_begins_replays_too(wire, tmp_path):
    master, name = wire
    recorder = Recorder(tmp_path / "s", name)
    messages = frame_list(*sent(2000))
    record(recorder, master, b"".join(messages[:1000]) + messages[1000][:11])
    recorder.decide(RecordingDecision("begin", "closure"))
    record(recorder, master, messages[1000][11:] + b"".join(messages[1001:]))
    recorder.close()
    there = [(tmp_path / "s" / name).read_bytes() for name in ("log0001.csv", "closure0001.csv")]
    assert [text.count(b"\n") for text in there] == [1001, 1001]
    assert replayed(tmp_path / "s" / "raw.bin", tmp_path / "again") == there
