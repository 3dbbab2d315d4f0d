"""Another board was plugged in once: its bytes stay, apart, and the recording goes on."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import broad
from processes import CALIBRATE, PIPE, started, until
from recording_wires import caught_up, make_wire, replayed
from streams import INFO, frame_list, samples, sent

from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import Info
from session.bench.logwriter import LogWriter
from session.bench.rawfile import read_marks
from session.bench.recorder import Recorder, stream
from tinygc import read_session
from tinygc.simulation.terminal import Terminal

OTHER = replace(INFO, serial="78")
wire = pytest.fixture(make_wire, name="wire")
SECOND = 1667


def said_by(info: Info, seconds: int, seed: int = 0, start_us: int = 1_000_000) -> list[bytes]:
    """What a board sends in so many seconds, second by second: its info, then its samples."""
    t_us, registers = sent(SECOND * seconds, start_us, seed)
    rows = frame_list(t_us, registers)
    return [frames.encode_info(0, info) + b"".join(rows[SECOND * i : SECOND * (i + 1)]) for i in range(seconds)]


def logs_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.csv*"))}


def registers_of(text: bytes) -> np.ndarray:
    return np.array([line.split(b",")[1:] for line in text.splitlines() if line[:1].isdigit()], int)


@pytest.fixture
def port(tmp_path):
    with Terminal(tmp_path / "port", 2**24) as terminal:
        yield terminal


def recorded(terminal: Terminal, recorder: Recorder, data: bytes) -> list:
    """Send, and take in until it is decoded."""
    wanted, events = recorder._decoded + len(data), []
    until(lambda: recorder.connected, lambda: events.extend(recorder.poll(0.02)))
    terminal.write(data)
    until(lambda: recorder._decoded >= wanted, lambda: (terminal.write(b""), events.extend(recorder.poll(0.02))))
    return events


def exchanged(terminal: Terminal, recorder: Recorder) -> list:
    """Pull the cable, and plug another board's."""
    events = []
    terminal.unplug()
    until(lambda: not recorder.connected, lambda: events.extend(recorder.poll(0.02)))
    terminal.plug()
    until(lambda: recorder.connected, lambda: events.extend(recorder.poll(0.02)))
    return events


def test_its_logs_get_another_name_and_no_replay_gives_its_events(port, tmp_path):
    """Live, resumed and replayed, it is the same; the recording's own logs hold its own samples, all of them, and no other."""
    own, other, later = said_by(INFO, 3), said_by(OTHER, 2, 1), said_by(INFO, 2, 2)
    recorder = Recorder(tmp_path / "s", str(port.name))
    for part in own:
        recorded(port, recorder, part)
    exchanged(port, recorder)  # behind 3 infos: the 4th landmark
    for part in other:
        recorded(port, recorder, part)
    assert recorder.set_apart(4) == ["foreign0001.csv"]
    assert recorder.samples == 3 * SECOND
    recorder.close()
    live = logs_of(tmp_path / "s")
    assert list(live) == ["foreign0001.csv", "log0001.csv"]
    assert np.array_equal(registers_of(live["foreign0001.csv"]), sent(2 * SECOND, seed=1)[1])

    port.unplug()
    port.plug()
    again = Recorder(tmp_path / "s", str(port.name))
    resumed = caught_up(again)
    assert np.array_equal(samples(resumed)[1], sent(3 * SECOND)[1])
    assert OTHER not in resumed
    assert again.decoder.info == INFO
    for part in later:
        recorded(port, again, part)
    assert again.samples == 5 * SECOND
    again.close()
    assert logs_of(tmp_path / "s") == live | {"log0002.csv": logs_of(tmp_path / "s")["log0002.csv"]}
    assert np.array_equal(registers_of(logs_of(tmp_path / "s")["log0002.csv"]), sent(2 * SECOND, seed=2)[1])
    assert (tmp_path / "s" / "raw.bin").read_bytes() == b"".join([*own, *other, *later])
    replayed(tmp_path / "s" / "raw.bin", tmp_path / "again")
    assert logs_of(tmp_path / "again") == logs_of(tmp_path / "s")


def test_where_it_begins_does_not_depend_on_how_the_bytes_were_cut(tmp_path, monkeypatch):
    """Also where no connection began: another board behind the same adapter, its clock anew."""
    (tmp_path / "s").mkdir()
    own, other = said_by(INFO, 2, start_us=90_000_000), said_by(OTHER, 2, 1)
    (tmp_path / "s" / "raw.bin").write_bytes(b"".join([*own, *other]))
    (tmp_path / "s" / "raw.times").write_text("host_ns,bytes,event\n1,0,open 2026 port\n9,0,foreign 3\n")
    monkeypatch.setattr("session.bench.recorder.BLOCK", 97)
    decoder, logs = StreamDecoder(), LogWriter(tmp_path / "s")
    events = [event for _, part in stream(tmp_path / "s" / "raw.bin", decoder, logs) for event in part]
    logs.write(decoder.finish())
    logs.close()
    assert np.array_equal(samples(events)[1], sent(2 * SECOND)[1])
    there = logs_of(tmp_path / "s")
    assert list(there) == ["foreign0001.csv", "log0001.csv"]
    assert np.array_equal(registers_of(there["log0001.csv"]), sent(2 * SECOND)[1])
    assert np.array_equal(registers_of(there["foreign0001.csv"]), sent(2 * SECOND, seed=1)[1])


def test_a_mark_is_of_its_connection_alone_and_nonsense_is_passed_over(wire, tmp_path):
    folder = tmp_path / "s"
    folder.mkdir()
    parts = [b"".join(said_by(info, 1, seed)) for seed, info in enumerate([OTHER, INFO, INFO])]
    (folder / "raw.bin").write_bytes(b"".join(parts))
    first, second = len(parts[0]), len(parts[0]) + len(parts[1])
    marks = ["1,0,open a", f"2,{first},open b", f"3,{second},open c", "4,0,foreign 0", f"5,{second},foreign x", "6,0,foreign"]
    (folder / "raw.times").write_text("\n".join(["host_ns,bytes,event", *marks, ""]))
    recorder = Recorder(folder, wire[1])
    resumed = caught_up(recorder)
    recorder.close()
    assert np.array_equal(samples(resumed)[1], np.concatenate([sent(SECOND, seed=seed)[1] for seed in (1, 2)]))
    assert sorted(logs_of(folder)) == ["foreign0001.csv", "log0001.csv", "log0002.csv"]


def recording(*words):
    """The command, in a process of its own."""
    return started([*CALIBRATE, "record", "--no-coach", *words], stdout=PIPE, stderr=PIPE, text=True)


def ended(process) -> tuple[int, str, str]:
    out, err = process.communicate()
    assert "Traceback" not in err
    return process.returncode, out, err


def feed(terminal: Terminal, folder: Path, data: bytes, opened: int) -> None:
    """Send to a recorder in another process that has opened the port for the n-th time, until the bytes are on the disk."""
    until(lambda: sum(mark.event.startswith("open") for mark in read_marks(folder / "raw.bin")) == opened)
    size = (folder / "raw.bin").stat().st_size
    terminal.write(data)
    until(lambda: (folder / "raw.bin").stat().st_size >= size + len(data), lambda: terminal.write(b""))


def pour(terminal: Terminal, folder: Path, data: bytes, opened: int, process) -> None:
    """Send to a recorder that has opened the port for the n-th time, until it ends by itself."""
    until(lambda: sum(mark.event.startswith("open") for mark in read_marks(folder / "raw.bin")) == opened)
    terminal.write(data)
    until(lambda: process.poll() is not None, lambda: terminal.write(b""))


@pytest.mark.parametrize("other", [OTHER, broad(replace(INFO, gyro_fs_dps=1000.0))], ids=["serial", "range"])
@pytest.mark.parametrize("noticed", [True, broad(False)], ids=["noticed", "killed before"])
def test_the_command_goes_on_with_resume(other, noticed, port, tmp_path):
    """Though it was killed before it noticed: the next one sets the bytes apart, and goes on by itself."""
    folder = tmp_path / "s"
    words = ["--port", port.name, "--out", folder]
    with recording(*words) as process:
        feed(port, folder, b"".join(said_by(INFO, 4)), 1)
        until(lambda: (folder / "session.toml").exists())
        if not noticed:
            process.send_signal(signal.SIGINT)
            assert ended(process)[0] == 130
        port.unplug()
        until(lambda: not noticed or any(mark.event.startswith("close") for mark in read_marks(folder / "raw.bin")))
        port.plug()
        if noticed:
            pour(port, folder, b"".join(said_by(other, 3, 1)), 2, process)
            code, _, said = ended(process)
            assert code == 2
            last = said.splitlines()[-1]
            assert "its bytes stay apart (raw.bin, foreign0001.csv); --resume goes on with the own board" in last
            assert len(last.replace(str(folder), "")) < 230
            assert last.count("foreign0001.csv") == 1
            assert "kept in" in said
            assert list(logs_of(folder)) == ["foreign0001.csv", "log0001.csv"]
        else:  # what a killed one would have left
            size = (folder / "raw.bin").stat().st_size
            with (folder / "raw.bin").open("ab") as raw, (folder / "raw.times").open("a") as times:
                times.write(f"99,{size},open 2026 port\n")
                raw.write(b"".join(said_by(other, 3, 1)))
    raw = (folder / "raw.bin").read_bytes()
    port.unplug()
    port.plug()
    with recording(*words, "--resume", "--json", tmp_path / "told.json") as process:
        opened = 3 if noticed else 4  # it begins again once it has set the bytes apart
        feed(port, folder, b"".join(said_by(INFO, 4, 2)), opened)
        until(lambda: (folder / "log0002.csv").exists())
        process.send_signal(signal.SIGINT)
        code, _, said = ended(process)
    assert code == 130, said
    assert "resumed: 0 segments so far" in said
    assert (folder / "raw.bin").read_bytes().startswith(raw)
    there = logs_of(folder)
    assert [name for name in there if "changed" not in name] == ["foreign0001.csv", "log0001.csv", "log0002.csv"]
    assert np.array_equal(registers_of(there["foreign0001.csv"])[:SECOND], sent(SECOND, seed=1)[1])
    session = read_session(folder)
    assert sum(len(log.samples) for log in session.logs) == json.loads((tmp_path / "told.json").read_text())["samples"]
    assert session.config.sensor.serial == INFO.serial
