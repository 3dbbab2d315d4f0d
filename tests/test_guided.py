"""A guided recording without a port, a clock or a terminal: what reaches the guide, and what is said of port, stream, clock and coach."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import Table, broad, config
from processes import PATIENCE_S

from session.bench.board_clock import ClockRatio
from session.bench.events import SENSOR, BoardStatus, Comment, Info, SampleChunk, Trouble
from session.bench.guide import Guide
from session.bench.guided_session import RESET_SAYS, GuidedRecording
from session.bench.messages import Kind, Stage
from session.io.errors import OtherSensor
from session.io.registers import accel_mps2_per_lsb, gyro_rps_per_lsb
from tinygc import CalibrationError

INFO = Info(500.0, 4.0, 208.0, "1")
SESSION = Table().rest(3).turn(120, (1, 0, 0), 3).rest(2.5).turn(120, (0, 1, 0), 3).rest(2.5).turn(120, (0, 0, 1), 3).rest(3)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent, and no coach late, unless a test wants it so."""
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.LAST_WORD_S", PATIENCE_S)


class Port:
    """Stands for a recorder: each poll gives what the next step of a script says."""

    def __init__(self, steps, resumed=()):
        self._steps, self._resumed = iter(steps), list(resumed)
        self.connected, self.why = True, ""
        self.port = SimpleNamespace(name="/dev/ttyACM0")
        self.decoder = SimpleNamespace(garbage=0, crc_errors=0)
        self.clock = SimpleNamespace(measured=None)
        self.raw, self.apart = SimpleNamespace(path=Path("raw.bin")), []

    def set_apart(self, landmarks):
        self.apart.append(landmarks)
        return ["foreign0001.csv"]

    def catch_up(self):
        yield from ([event] for event in self._resumed)

    def poll(self):
        step = next(self._steps, None)
        assert step is not None, "the guide waits for what never comes"
        return step(self) or [] if callable(step) else [step]


class Said:
    """Stands for a screen."""

    def __init__(self):
        self.changes, self.instructions = [], []

    def change(self, change):
        self.changes.append(change)

    def show(self, guide):
        self.instructions.append(guide.instruction)

    def texts(self, kind):
        return [change.text for change in self.changes if change.kind is kind]


def chunks(table: Table, size: int = 50, seed: int = 0) -> list[SampleChunk]:
    samples = table.samples(seed=seed)
    rows = np.column_stack([samples.gyro / gyro_rps_per_lsb(500), samples.accel / accel_mps2_per_lsb(4), 256 * (samples.temp_c - 25)])
    rows, t_us = np.rint(rows).astype(np.int16), samples.t_ns // 1000
    return [SampleChunk(t_us[i : i + size], rows[i : i + size]) for i in range(0, len(rows), size)]


def led(port, segments=3, coach=None, configure=lambda info, waited_s: config() if info else None, **options):
    said = Said()
    guided = GuidedRecording(Guide(config().protocol, segments), port, configure, coach, said)
    guided.lead(**options)
    return guided.guide, said


def pulled(port):
    port.connected, port.why = False, "Input/output error"


def plugged(port):
    port.connected, port.why = True, ""
    return [Trouble("reconnect"), INFO]


def test_a_session_from_its_events():
    guide, said = led(Port([INFO, *chunks(SESSION)]))
    assert guide.accepted == 3
    assert guide.health.info_odr_hz == 208.0
    assert said.texts(Kind.DONE) == ["done: 3 segments"]
    assert not said.texts(Kind.WARNING)


@pytest.mark.parametrize("at", [1, broad(4), broad(9), 14, broad(19), 25, broad(33)])
def test_pulled_and_reset_anywhere(at):
    """From before the check is over to the second turn: what was accepted stays, and the rest is asked for again."""
    for steps in ([pulled, plugged], [Trouble("reset"), INFO]):
        port = Port([INFO, *chunks(SESSION)[:at], *steps, *chunks(SESSION, seed=1), *chunks(SESSION, seed=2)])
        guide, said = led(port, segments=4)
        assert guide.accepted == 4
        (warning,) = [change for change in said.changes if "a new log begins" in change.text]
        assert warning.at_s == pytest.approx(at * 50 / 208 if at > 4 else 0.0, abs=0.3)


def test_each_of_a_boards_resets_is_said_with_what_it_came_of():
    board = BoardStatus(SENSOR, True, True, "1.2.3", 0x6B, -4, bytes(10), 921600, 208.0)
    hung = replace(board, by_watchdog=True)
    steps = [INFO, board, *chunks(SESSION)[:14], hung, Trouble("reset"), *chunks(SESSION)[:14], Trouble("reset")]
    _, said = led(Port([*steps, *chunks(SESSION, seed=1)]))
    new_log = "the board was reset: a new log begins"
    assert said.texts(Kind.WARNING) == [RESET_SAYS["watchdog"], new_log, new_log, RESET_SAYS["watchdog"]]


def test_a_port_that_is_gone_and_a_stream_that_is_none_are_said(monkeypatch):
    monkeypatch.setattr("session.bench.guided_session.SHOW_EVERY_S", -1.0)

    def silent(port):
        monkeypatch.setattr("session.bench.guided_session.SILENT_S", -1.0)

    def wrong_baud(port):
        port.decoder = SimpleNamespace(garbage=812, crc_errors=3)

    def right_again(port):
        monkeypatch.setattr("session.bench.guided_session.SILENT_S", 60.0)

    remark = Comment("nothing answers at 0x68")
    guide, said = led(Port([INFO, pulled, plugged, silent, remark, silent, INFO, wrong_baud, right_again, *chunks(SESSION)]))
    why = [now.why for now in said.instructions]
    assert "/dev/ttyACM0: Input/output error; it is tried again and again" in why
    assert any("no bytes arrive: is the board sending?" in words for words in why)
    assert any("the board says: nothing answers at 0x68" in words for words in why)
    assert any("812 bytes and 3 frames that are none: is the baud rate right?" in words for words in why)
    assert guide.accepted == 3


def test_a_board_that_says_nothing_of_its_ranges_is_not_guessed():
    with pytest.raises(CalibrationError, match="10 s of samples whose ranges are not known: give --gyro-fs"):
        led(Port(chunks(Table().rest(12))))
    late = [*chunks(SESSION)[:4], INFO, *chunks(SESSION)[4:]]
    assert led(Port(late))[0].accepted == 3
    assert led(Port(chunks(SESSION)), configure=lambda info, waited_s: config() if waited_s >= 3 else None)[0].accepted == 3


def swapped_in(events):
    return lambda port: plugged(port) and events


def test_a_file_that_contradicts_all_that_was_recorded_sets_nothing_apart():
    """It is the file that is wrong: somebody has changed it since."""

    def contradicted(info, waited_s):
        if info:
            raise OtherSensor("session.toml: sensor.gyro_fs_dps is 1000, the board says 500; correct the wrong one")

    port = Port([], resumed=[INFO, *chunks(SESSION)[:40], INFO, *chunks(SESSION)])
    with pytest.raises(OtherSensor, match=r"correct the wrong one$"):
        led(port, configure=contradicted)
    assert port.apart == []


def test_another_sensor_has_no_place_in_the_recording():
    """Neither when it is resumed nor behind a pulled cable; a word that was damaged on the wire is not repeated."""
    other = Info(500.0, 4.0, 208.0, "2")
    swapped = [Trouble("reconnect"), other]
    for port, sound in (
        (Port([swapped_in(swapped), *chunks(SESSION)[:9], other], resumed=[INFO, *chunks(SESSION)[:40]]), 2),
        (Port([INFO, *chunks(SESSION)[:9], pulled, swapped_in(swapped), other]), 2),
        (Port([INFO, *chunks(SESSION)[:9], INFO, other, other]), 2),  # behind the same wire: since the last word that was right
        (Port([], resumed=[INFO, *chunks(SESSION)[:40], *swapped, *chunks(SESSION)[:9], other]), 2),
    ):
        with pytest.raises(OtherSensor, match=r"serial=2, this recording is of 1; .*--out; its bytes stay apart \(raw.bin"):
            led(port)
        assert port.apart == [sound]
    damaged = [INFO, *chunks(SESSION)[:9], other, *chunks(SESSION)[9:]]
    guide, _ = led(Port(damaged))
    assert guide.accepted == 3
    nameless = Info(500.0, 4.0, 208.0, "0")
    assert led(Port([INFO, nameless, nameless, *chunks(SESSION)]))[0].accepted == 3


@pytest.mark.parametrize(("ratio", "says"), [(1.0009, ""), (0.985, "15000 ± 58 ppm slow"), (1.0045, "4500 ± 58 ppm fast"), (4.0, "")])
def test_a_clock_that_runs_wrong_is_said_once(ratio, says):
    port = Port([INFO, *chunks(SESSION)])
    port.clock = SimpleNamespace(measured=ClockRatio(ratio, 5e-5, 30.0))
    guide, said = led(port)
    assert [says in text for text in said.texts(Kind.WARNING)] == [True] * bool(says)
    assert guide.health.odr_by_host_hz == pytest.approx(208 * ratio, rel=1e-3)


def test_an_interruption_is_asked_for_between_two_polls():
    """All that was taken has reached the guide by then."""
    taken, port = [], Port([INFO, *chunks(SESSION)])
    poll = port.poll
    port.poll = lambda: taken.append(1) or poll()
    guided = GuidedRecording(Guide(config().protocol, 3), port, lambda info, waited_s: config() if info else None, None, Said())
    with pytest.raises(KeyboardInterrupt):
        guided.lead(lambda: len(taken) == 21)
    assert guided.guide.health.samples == 20 * 50
    assert guided.guide.accepted == 0


def test_what_an_earlier_recording_left_counts():
    port = Port([INFO, *chunks(SESSION, seed=1)], resumed=[INFO, *chunks(SESSION)[:40]])
    guide, said = led(port, segments=4)
    assert "resumed: 1 segments so far" in said.texts(Kind.STAGE)
    assert guide.accepted == 4
    done = Port([], resumed=[INFO, *chunks(SESSION)])
    assert led(done)[0].stage is Stage.DONE


def test_a_coach_that_fails_does_not_end_the_recording():
    def coach(taken):
        raise ValueError("no idea")

    guide, said = led(Port([INFO, *chunks(SESSION)]), coach=coach)
    assert guide.accepted == 3
    assert said.texts(Kind.WARNING) == ["the coach has failed (ValueError: no idea); any turn will do"]
