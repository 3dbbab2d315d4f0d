"""What a board without a sensor sends never passes for a sensor's: it is said, kept in a log of its own, and refused beside a sensor's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Table, write_session
from emulator.build import build
from emulator.machine import Machine
from emulator.sensor import Asm330lhh, AtRest, Fault, SensorPort
from f405_programs import tools_missing

import calibrate
from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import SENSOR, STANDIN, BoardStatus
from session.bench.guided_session import FOUND, NO_SENSOR, BoardReporter
from session.bench.logwriter import LogWriter
from session.detect.check_samples import check_standin
from session.io.logfile import Log

pytestmark = pytest.mark.emulation


def log(name: str, source: str | None) -> Log:
    samples = Table().rest(0.1).samples()
    return Log(Path(name), samples, comments={} if source is None else {"source": source})


def test_a_log_without_a_sensor_is_a_warning_and_beside_one_an_error():
    real, made, foreign = log("log0001.csv", "sensor"), log("log0002.csv", "stand-in"), log("log0003.csv", None)
    assert check_standin((real, foreign)) == []
    (alone,) = check_standin((made, foreign))
    assert (alone.level, alone.where) == ("warning", "log0002.csv")
    (mixed,) = check_standin((real, made, foreign))
    assert (mixed.level, mixed.where) == ("error", "log0002.csv")
    assert "log0001.csv is a sensor's; take it out of the folder" in mixed.line


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """``board(*faults)``: a machine with the recorder and a sensor."""
    if trouble := tools_missing():
        pytest.skip(trouble)
    folder = tmp_path_factory.mktemp("recorder")
    elf = build("recorder.elf", folder, folder / "build", ODR_HZ="208")
    return lambda *faults: Machine(elf, SensorPort(Asm330lhh(AtRest(), faults=faults)))


ABSENT = Fault("hang", 0.0, 3.5)  # longer than the board looks for it


def logs_of(streams, folder) -> list[str]:
    decoder, logs = StreamDecoder(), LogWriter(folder)
    for stream in streams:
        logs.write(decoder.feed(stream))
    logs.write(decoder.finish())
    logs.close()
    return [path.read_text() for path in logs.paths]


def assert_apart(texts: list[str]) -> None:
    """Two logs: the stand-in's, whose gravity is 8197 upside down, and the sensor's; each says whose it is."""
    first, second = texts
    assert "source=stand-in" in first
    assert "source=sensor" not in first
    assert "source=sensor" in second
    assert "source=stand-in" not in second
    rows = [np.array([line.split(",") for line in text.splitlines() if line[0].isdigit()], int) for text in texts]
    assert min(map(len, rows)) > 200
    assert np.abs(rows[0][:, 6] + 8197).max() <= 8
    assert np.all(rows[1][:, 6] == 8197)


@pytest.fixture(scope="module")
def late(board):
    """A machine whose sensor was not there at power-up, and what it has sent so far: all made up."""
    machine = board(ABSENT)
    machine.run_until(4.0)
    return machine, machine.usart1.take()


def test_a_sensor_that_comes_late_begins_a_log_of_its_own(late, tmp_path):
    """It is found by the next command that sets something, within one count of samples and of microseconds."""
    machine, made_up = late
    machine.usart1.feed(frames.encode_command(frames.RANGES, 1, 500, 4))
    machine.run_until(6.0)
    assert machine.bus.objections == {}
    assert_apart(logs_of([made_up, machine.usart1.take()], tmp_path))


def test_a_board_that_is_switched_on_again_says_whose_samples_follow(board, late, tmp_path):
    """Before the first of them: at the same port, its adapter never lost its cable."""
    machine = board()
    machine.run_until(1.5)
    assert_apart(logs_of([late[1], machine.usart1.take()], tmp_path))


def test_whoever_turns_the_table_is_told():
    words = BoardReporter()
    boards = [BoardStatus(source, True, True, "1.0.0", 0x6B * source, 0, bytes(10), 921600, 208.0) for source in (STANDIN, SENSOR)]
    assert words.hear(boards[0]) == [NO_SENSOR]
    assert not words.changes_source(boards[0])
    assert words.changes_source(boards[1])
    assert words.hear(boards[1]) == [FOUND]
    assert words.hear(boards[1]) == []


def test_fit_refuses_a_folder_with_both(tmp_path, capsys):
    for name, source in (("log0001.csv", "stand-in"), ("log0002.csv", "sensor")):
        write_session(tmp_path, Table().tumble(6, seed=len(source)).samples(seed=len(source)), name)
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(f"# board source={source} firmware=1.0.0\n{text}")
    assert calibrate.main(["fit", str(tmp_path), "--methods", "least_squares", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "log0001.csv: sensor: the board had no sensor" in said
    assert "log0002.csv is a sensor's" in said
