"""The virtual board: what it streams, what it spoils, that it never waits for its reader, and that it never streams a copy."""

from __future__ import annotations

import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import PATIENCE_S

import calibrate
from session.detect.check_samples import check_copies
from session.log.logfile import Log
from session.log.samples import Samples
from tinygc import CalibrationError, SimulationOptions
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.terminal import Terminal
from tinygc.simulation.virtual_board import (
    LineFaults,
    flipped,
    next_take,
    recorded,
    remember,
    simulated,
    spoil,
    taken,
)
from tinygc.simulation.write import write_simulation


def test_a_folder_is_streamed_to_the_register(tmp_path):
    made = simulate_session(SimulationOptions(segments=2, closure_s=0.0, odr_hz=104.0))
    rows = recorded(write_simulation(made, tmp_path / "session")).rows
    np.testing.assert_array_equal(rows, np.column_stack([made.log.gyro, made.log.accel, made.log.temp]))


def test_a_reader_that_does_not_read_is_not_waited_for(tmp_path):
    with Terminal(tmp_path / "port") as terminal:
        assert not terminal.has_reader
        assert not terminal.write(b"nobody")
        reader = os.open(terminal.name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        assert terminal.has_reader
        writer = threading.Thread(target=lambda: [terminal.write(bytes(1000)) for _ in range(2000)], daemon=True)
        writer.start()
        writer.join(PATIENCE_S)
        assert not writer.is_alive()  # who waits for this reader waits for ever
        assert terminal.dropped > 1000
        os.close(reader)
        assert not terminal.has_reader
        reader = os.open(terminal.name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)  # opened again
        assert terminal.write(b"hello again")
        os.close(reader)
    assert not os.path.lexists(terminal.name)
    assert not list(tmp_path.iterdir())


def test_a_name_is_taken_by_one_board_only(tmp_path):
    (tmp_path / "port").symlink_to("/dev/null")  # left by a board that was killed
    with Terminal(tmp_path / "port") as terminal:
        assert os.readlink(terminal.name) != "/dev/null"
        with pytest.raises(CalibrationError, match="another virtual board"):
            Terminal(tmp_path / "port")
    with pytest.raises(CalibrationError, match="--link"):
        Terminal(tmp_path / "nowhere" / "port")


def test_faults_are_as_frequent_as_asked_and_repeat_with_the_seed():
    messages = [bytes([k % 256]) * 25 for k in range(20_000)]
    run = lambda **faults: spoil(messages, LineFaults(**faults), np.random.default_rng(1))  # noqa: E731
    assert len(run(lost=0.05)) == pytest.approx(0.95 * 500_000, rel=0.005)
    assert len(run(torn=0.1)) == pytest.approx(500_000 * (0.9 + 0.1 * 0.48), rel=0.01)
    data = np.frombuffer(b"".join(messages), np.uint8)
    changed = np.unpackbits(np.frombuffer(run(flip=0.01), np.uint8) ^ data).mean()
    assert changed == pytest.approx(0.01, rel=0.02)
    assert run(lost=0.05, flip=0.01, torn=0.1) == run(lost=0.05, flip=0.01, torn=0.1)
    assert flipped(b"", 0.5, np.random.default_rng(0)) == b""


OPTIONS = SimulationOptions(segments=1, closure_s=0.0, odr_hz=104.0, seed=7)


def log(session, name):
    recording = session.log
    return Log(Path(name), Samples(recording.t_us * 1000, recording.gyro.astype(float), recording.accel.astype(float)), raw=True)


def test_takes_are_of_one_sensor_and_no_copies_of_each_other():
    assert taken(OPTIONS, 1) == OPTIONS  # what a seed has always streamed
    takes = [taken(OPTIONS, take) for take in (1, 2)]
    sessions = [simulate_session(options) for options in takes]
    for name in ("E", "B", "accel_matrix", "accel_bias", "odr_hz"):
        assert np.array_equal(*(getattr(session.unit, name) for session in sessions))
    logs = tuple(log(session, f"log000{number}.csv") for number, session in enumerate(sessions, 1))
    assert not check_copies(logs)
    assert check_copies((logs[0], replace(logs[0], path=Path("again.csv"))))  # as a board without takes would have it
    assert simulated(takes[1]).info == simulated(OPTIONS).info  # serial number and rate: no other board
    assert taken(OPTIONS, 2) == taken(OPTIONS, 2) != taken(OPTIONS, 3)
    assert taken(replace(OPTIONS, seed=8), 2).seed != taken(OPTIONS, 2).seed


def test_a_link_remembers_the_takes_of_each_seed(tmp_path):
    link = tmp_path / "port"
    assert next_take(link, 0) == 1
    remember(link, 0, 1)
    remember(link, 5, 3)
    remember(link, 5, 2)  # asked for again
    assert (next_take(link, 0), next_take(link, 5), next_take(link, 6)) == (2, 4, 1)
    assert next_take(tmp_path / "other", 0) == 1
    for nonsense in ("0 x\n", "0 -5\n", "1 2 3\n", "\x00", "0 " + "9" * 5000):
        (tmp_path / "port.takes").write_text(nonsense)
        assert next_take(link, 0) == 1
    (tmp_path / "port.takes").unlink()
    (tmp_path / "port.takes").mkdir()
    remember(link, 0, 1)  # cannot be written: the board streams all the same
    assert next_take(link, 0) == 1


def test_a_folder_has_no_takes(tmp_path, capsys):
    assert calibrate.main(["board", str(tmp_path), "--take", "2"]) == 2
    assert "a folder is streamed as it was recorded" in capsys.readouterr().err
