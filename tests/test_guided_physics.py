"""A guided recording without a port, a clock or a terminal: what is said of port, board and coach, and what keys decide."""

import contextlib
import threading
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from coached_hand import guide_of
from conftest import Table, config
from processes import PATIENCE_S
from streams import INFO as BOARD_INFO

from session.base.errors import FormatError, OtherSensor
from session.bench.board import RESET_WORDS, BoardReporter
from session.bench.clocks import ClockRatio
from session.bench.events import FAULTS, Event, Info, SampleChunk
from session.bench.guide import _ANY_TURN, Guide
from session.bench.guided_session import (
    GuidedRecording,
    _CoachThread,
)
from session.bench.messages import Advice, Kind, Stage
from session.bench.rawfile import raw_event
from session.bench.rest_guide import RestAnswer, RestGuide
from session.log.registers import accel_mps2_per_lsb, gyro_rps_per_lsb
from tinygc import CalibrationError

INFO = Info(500.0, 4.0, 208.0, "1")


#: three turns, at seconds 2 to 3.5, 5.5 to 7, 9 to 10.5
SESSION = Table().rest(2).turn(120, (1, 0, 0), 1.5).rest(2).turn(120, (0, 1, 0), 1.5).rest(2).turn(120, (0, 0, 1), 1.5).rest(2.5)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent, and no coach late, unless a test wants it so; each state is shown."""
    monkeypatch.setattr("session.bench.guided_session.SHOW_EVERY_S", -1.0)
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.LAST_WORD_S", PATIENCE_S)


class Port:
    """Stands for a recorder: each poll gives what the next step of a script says."""

    def __init__(self, steps, resumed=(), typed=()):
        self._steps, self._resumed, self.typed = iter(steps), list(resumed), list(typed)
        self.connected, self.why = True, ""
        self.port = SimpleNamespace(name="/dev/ttyACM0")
        self.decoder = SimpleNamespace(garbage=0, crc_errors=0)
        self.clock = SimpleNamespace(measured=None)
        self.raw = SimpleNamespace(path=Path("raw.bin"))
        self.logs = SimpleNamespace(paths=[SimpleNamespace(name="log0001.csv")], present="log0002.csv")
        self.decided, self.now_s, self.ended = [], 0.0, False

    def catch_up(self):
        yield from ([event] for event in self._resumed)

    def poll(self):
        step = next(self._steps, None)
        assert step is not None, "the guide waits for what never comes"
        if isinstance(step, SampleChunk):
            self.now_s = step.t_us[-1] * 1e-6
        return step(self) or [] if callable(step) else [step]

    def decide(self, decision):
        self.decided.append(decision)

    def keys(self):
        """What was typed until now: texts at seconds of device time."""
        due = [text for at_s, text in self.typed if at_s <= self.now_s]
        self.typed = [(at_s, text) for at_s, text in self.typed if at_s > self.now_s]
        return "".join(due)


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


@cache
def chunks(table, seed=0):
    samples = table.samples(seed=seed)
    rows = np.column_stack([samples.gyro / gyro_rps_per_lsb(500), samples.accel / accel_mps2_per_lsb(4), 256 * (samples.temp_c - 25)])
    rows, t_us = np.rint(rows).astype(np.int16), samples.t_ns // 1000
    return [SampleChunk(t_us[i : i + 50], rows[i : i + 50]) for i in range(0, len(rows), 50)]


def led(port, segments=3, guide=None, coach=None, configure=lambda info, waited_s: config() if info else None, notes=None):
    said, guide = Said(), guide or Guide(config().protocol, segments)
    with contextlib.suppress(KeyboardInterrupt):
        GuidedRecording(guide, port, configure, coach, said, notes, port.keys).lead(lambda: port.ended)
    return guide, said


#: what a port gives of the whole session, and of its first two seconds
WHOLE = [INFO, *chunks(SESSION)]
BEGUN = WHOLE[:10]


def pulled(port):
    port.connected, port.why = False, "Input/output error"


def plugged(port):
    port.connected, port.why = True, ""
    return [Event("reconnect"), INFO]


@pytest.mark.parametrize(("at", "accepted"), [(1, 0), (25, 1)])
def test_pulled_and_reset_anywhere(at, accepted):
    """From before the check is over to the second turn: what was accepted stays, and the rest is asked for again."""
    for steps in ([pulled, plugged], [Event("reset"), INFO]):
        port = Port([*WHOLE[: at + 1], *steps, *chunks(SESSION, seed=1)])
        guide, said = led(port, segments=3 + accepted)
        assert guide.accepted == 3 + accepted
        (warning,) = [change for change in said.changes if "a new log begins" in change.text]
        assert warning.at_s == pytest.approx(at * 50 / 208 if at > 4 else 0.0, abs=0.3)


def test_a_board_that_says_nothing_of_its_ranges_is_not_guessed():
    with pytest.raises(CalibrationError, match="10 s of samples whose ranges are not known: give --gyro-fs"):
        led(Port(chunks(Table().rest(12))))
    assert led(Port([*WHOLE[1:5], INFO, *WHOLE[5:]]))[0].accepted == 3
    assert led(Port(WHOLE[1:]), configure=lambda info, waited_s: config() if waited_s >= 3 else None)[0].accepted == 3


def test_another_sensor_has_no_place_in_the_recording():
    """Neither when it is resumed nor behind a pulled cable; a word that was damaged on the wire is not repeated."""
    other = Info(500.0, 4.0, 208.0, "2")
    swapped = [Event("reconnect"), other]
    for port in (
        Port([lambda port: plugged(port) and swapped, *BEGUN[1:], other], resumed=BEGUN),
        Port([*BEGUN, pulled, lambda port: plugged(port) and swapped, other]),
        Port([*BEGUN, INFO, other, other]),  # behind the same wire
    ):
        with pytest.raises(OtherSensor, match=r"serial=2, this recording is of 1; .*--out; log0002.csv holds its samples.*--resume"):
            led(port)
    # What an earlier recording held of it counts no more.
    assert led(Port([Event("reconnect"), *WHOLE], resumed=[*BEGUN, *swapped, other]))[0].accepted == 3
    nameless = Info(500.0, 4.0, 208.0, "0")
    for steps in ([*BEGUN, other, *WHOLE[10:]], [INFO, nameless, nameless, *WHOLE[1:]]):
        assert led(Port(steps))[0].accepted == 3


@pytest.mark.parametrize(("ratio", "says"), [(1.0009, ""), (0.985, "15000 ± 58 ppm slow"), (4.0, "")])
def test_a_clock_that_runs_wrong_is_said_once(ratio, says):
    port = Port(WHOLE)
    port.clock = SimpleNamespace(measured=ClockRatio(ratio, 5e-5, 30.0))
    guide, said = led(port, segments=1)
    assert [says in text for text in said.texts(Kind.WARNING)] == [True] * bool(says)
    assert (guide.health.info_odr_hz, guide.health.odr_by_host_hz) == (208.0, pytest.approx(208 * ratio, rel=1e-3))


def test_a_coach_that_fails_does_not_end_the_recording():
    def coach(taken):
        raise ValueError("no idea")

    guide, said = led(Port(WHOLE), coach=coach)
    assert (guide.accepted, said.texts(Kind.DONE)) == (3, ["done: 3 turns"])
    assert said.texts(Kind.WARNING) == ["the coach has failed (ValueError: no idea); any turn will do"]


# Keys.


#: turns of 120, 130, 140 and 150 degrees, at seconds 2 to 3.5, 6 to 7.5, 10 to 11.5, 14 to 15.5
TURNS = [(120, (1, 0, 0)), (130, (0, 1, 0)), (140, (0, 0, 1)), (150, (1, 1, 0))]


def session(turns):
    table = Table().rest(2)
    for degrees, axis in TURNS[:turns]:
        table.turn(degrees, axis, 1.5).rest(2.5)
    return table


class Notes:
    def __init__(self):
        self.notes, self.rows = [], []

    def note(self, text, when):
        if text == "no place":
            raise FormatError("session.toml: no place")
        self.notes.append(text)

    def exclude(self, *row):
        self.rows.append(row)

    def excludes(self, *row):
        return row in self.rows


def end(port):
    port.ended = True


def keyed(turns, *typed, resumed=(), segments=4, notes=None, steps=()):
    """A session of so many turns at which these keys are pressed: the port, the guide, what was said, notes."""
    live, notes = [INFO, *steps, *chunks(session(turns))] if turns else [], notes or Notes()
    port = Port([*live, end], resumed, typed)
    return port, *led(port, segments, notes=notes), notes


def test_the_last_turn_is_dropped_where_it_moved():
    """Pressed in the rest behind the second turn, or in it; twice, it does not drop the turn before."""
    port, guide, said, notes = keyed(3, (9.7, "dd"), segments=3)
    assert (guide.accepted, guide.dropped) == (2, 1)
    ((log, at_s),) = notes.rows
    assert log == "log0001.csv"
    assert 6 < at_s < 7.5
    assert [raw_event(decision) for decision in port.decided] == [f"drop {round(at_s * 1e6)}"]
    assert any(text.startswith("the last turn is dropped (130° in 1.") for text in said.texts(Kind.STAGE))
    assert "the last turn does not count" in said.texts(Kind.WARNING)
    _, guide, said, notes = keyed(2, (7.1, "d"))
    assert (guide.accepted, guide.dropped) == (1, 1)
    assert 6 < notes.rows[0][1] < 7.5
    assert "turn 1 dropped, as requested" in said.texts(Kind.STAGE)


def test_f_before_the_targets_are_met_ends_nothing_and_names_the_way_to_end():
    port, guide, shown, _ = keyed(2, (7.1, "f"))
    assert (guide.accepted, port.decided) == (2, [])
    assert "f ends the turns once every number is good enough; Ctrl-C ends them now and keeps all" in shown.texts(Kind.WARNING)


def test_paused_nothing_is_judged():
    """The second of four turns is made in a pause: nobody counts it, and the first still after the pause is a new log's."""
    port, guide, said, _ = keyed(4, (5.9, "p"), (7.7, "p"))
    assert [raw_event(decision) for decision in port.decided] == ["pause", "begin log"]
    assert [text.split(":")[1].split(" in ")[0] for text in said.texts(Kind.ACCEPTED)] == [" 120°", " 140°", " 150°"]
    assert guide.log == 1
    assert {now.do for now in said.instructions if now.stage is Stage.PAUSED} == {"paused: nothing is examined"}


def test_a_note_has_its_text_and_says_that_it_is_kept():
    port, guide, said, notes = keyed(1, (2.0, "nthe cable "), (2.5, "rubs\r"), (2.7, "nno place\r"), segments=1)
    assert notes.notes == ["the cable rubs"]
    assert port.decided[0] == Event("note", text="the cable rubs")
    assert "noted: the cable rubs" in said.texts(Kind.STAGE)
    assert said.texts(Kind.WARNING) == ["session.toml: no place"]  # and no recording ends by it
    assert guide.accepted == 1  # the letters of a note are no commands


def test_resumed_it_is_where_it_was_and_a_drop_that_was_taken_back_is_taken_back():
    port, _, _, notes = keyed(2, (9.7, "d"))
    drop = port.decided[0]
    for kept, accepted in ((notes, 1), (Notes(), 2)):
        _, guide, said, _ = keyed(0, resumed=[INFO, *chunks(session(2)), drop], notes=kept)
        assert guide.accepted == accepted
        assert f"resumed: {accepted} turn{'s' * (accepted > 1)} so far" in said.texts(Kind.STAGE)
    # A pause ends with the recording: what comes next goes to a log again.
    past = [INFO, *chunks(session(2)), Event("pause")]
    port, guide, _, _ = keyed(1, resumed=past, segments=3, steps=[Event("reconnect")])
    assert port.decided == [Event("begin", text="log")]
    assert guide.accepted == 3


# A rest.


REST, BEGIN = Table().rest(6), Event("begin", text="rest")


class Figures:
    """Stand for the feature: the answer changes when so many samples have come."""

    def __init__(self, answers=()):
        self.samples, self._answers = 0, dict(answers)

    def add(self, samples):
        self.samples += len(samples)

    def new_log(self):
        pass

    def answer(self):
        due = [count for count in self._answers if count <= self.samples]
        return self._answers.pop(due[0]) if due else None


def test_a_rest_of_some_seconds_takes_every_sample_into_its_log():
    """The log begins before the first sample; the guide ends with the block in which the time is reached."""
    port, figures = Port([INFO, *chunks(REST)]), Figures()
    guide, said = led(port, guide=RestGuide(config().protocol, 4.0, figures))
    assert port.decided == [BEGIN]
    assert 4.0 <= guide.rested_s < 4.11
    assert figures.samples / 208 == pytest.approx(guide.rested_s, abs=0.01)
    assert said.texts(Kind.DONE) == ["done: 4 s of rest"]
    assert not said.texts(Kind.WARNING)
    assert guide.moved_s == guide.accepted == 0
    assert {now.do for now in said.instructions if now.stage is Stage.HOLD_STILL} == {"a rest: leave the board alone, and the table too"}


def test_a_rest_that_moves_is_warned_of_once_in_ten_minutes():
    moved = Table().rest(62).turn(60, (1, 0, 0), 1).rest(2).turn(60, (0, 1, 0), 1).rest(3)
    guide, said = led(Port([INFO, *chunks(moved)]), guide=RestGuide(config().protocol, 68.0))
    assert guide.moved_s > 1
    assert len(said.texts(Kind.WARNING)) == 1


def test_enough_is_said_once_and_ends_it_where_that_was_asked():
    answers = {300: RestAnswer(("B after 3.1 h",)), 500: RestAnswer(("all known",), True), 700: RestAnswer(("still known",), True)}
    _, said = led(Port([INFO, *chunks(REST)]), guide=RestGuide(config().protocol, 5.0, Figures(answers)))
    assert [text for text in said.texts(Kind.STAGE) if "B" in text or "known" in text] == ["B after 3.1 h", "all known", "still known"]
    assert said.texts(Kind.READY) == ["enough: 2 s of rest shows the noise as precisely as requested"]
    assert said.texts(Kind.DONE) == ["done: 5 s of rest"]
    assert any(instruction.do.startswith("enough") for instruction in said.instructions)
    stopping = RestGuide(config().protocol, None, Figures(answers), stop_at_target=True)
    _, said = led(Port([INFO, *chunks(REST)]), guide=stopping)
    assert said.texts(Kind.DONE) == ["done: 2 s of rest"]


def test_resumed_after_turns_the_rest_has_its_own_log_and_no_turn_counts():
    """What the port still held of the turns goes to no log; the rest's log begins with the new connection."""
    turns = Table().rest(3).turn(120, (1, 0, 0), 3).rest(3)
    port = Port([Event("reconnect"), INFO, *chunks(REST, seed=1)], resumed=[INFO, *chunks(turns)])
    guide, _ = led(port, guide=RestGuide(config().protocol, 4.0))
    assert port.decided == [Event("pause"), BEGIN]
    assert 4.0 <= guide.rested_s < 4.11


# What the board reports of itself.


def test_what_a_board_has_counted_is_counted_once_over_connections():
    """A cable that was pulled, or --resume: the board goes on counting unless it was switched on again."""
    words, lines = BoardReporter(), []
    for counts in ({"lost": 4, "hang": 1}, {"lost": 163, "hang": 1, "parity": 3, "reset": 1}):
        lines += words.hear(Event("faults", numbers=tuple(counts.get(name, 0) for name in FAULTS)))
    words.new_connection()
    whole = {"lost": 159, "parity": 3, "reset": 1}  # none of before the recording
    assert words.counted == whole
    assert words.hear(Event("faults", numbers=words.faults)) == []
    assert words.counted == whole
    words.new_connection()
    assert len(words.hear(Event("faults", numbers=tuple(int(name == "parity") for name in FAULTS)))) == 1  # they fell: switched on again
    assert words.counted == whole | {"parity": 4}
    assert [line.startswith("before this recording") for line in lines] == [True, False]


#: states of a board that streams its sensor: as switched on, behind its watchdog's reset, behind a fault of its core
ON, HUNG, ASTRAY = 3, 3 | 8, 3 | 16


WATCHDOG, FAULT = RESET_WORDS["watchdog"], RESET_WORDS["fault"]


def said(odr_hz):
    return replace(BOARD_INFO, odr_hz=odr_hz, serial="0")


def test_a_board_without_a_serial_number_is_another_where_its_rate_is_another():
    same = BoardReporter()
    same.require_same(said(421.06))
    same.require_same(said(432.4))  # within a connection nobody swaps a board: it has measured better
    same.new_connection()
    same.require_same(said(433.0))
    same.new_connection()
    with pytest.raises(OtherSensor, match="it has no serial number"):
        same.require_same(said(433.0 * 1.027))
    with pytest.raises(OtherSensor):  # it stays another's
        same.require_same(said(433.0 * 1.027))
    same.new_connection()
    same.require_same(said(433.0))


# The coach.


THINKS = "one moment: the coach evaluates the last turn"
TABLE = Table().rest(3).turn(120, (1, 0, 0), 3).rest(5).turn(90, (0, 1, 0), 3).rest(5)
REJECTED = Table().rest(3).turn(120, (1, 0, 0), 3).rest(5).turn(20, (0, 1, 0), 3).rest(5)


def followed(table, answers_at_s):
    """A session with a coach that answers at these moments: time, what is to be done, stills; and what the coach was asked of."""
    may, asked, seen = threading.Semaphore(0), [], []

    def coach(progress):
        asked.append((len(progress.turns), len(progress.stills)))
        may.acquire()
        return Advice(f"advice at still {len(progress.stills)}", "why")

    guide, thread, answers, samples = guide_of(), _CoachThread(coach), list(answers_at_s), table.samples()
    guide.coached = True
    for first in range(0, len(samples), 20):
        at_s = (first + 20) / 208
        guide.feed(samples.between(first, first + 20))
        if answers and at_s >= answers[0]:
            answers.pop(0)
            may.release()
            thread._pending.result(timeout=PATIENCE_S)
        thread.hear(guide)
        seen.append((at_s, guide.instruction.do, len(guide.taken.stills)))
    may.release(100)
    thread.close()
    return guide, seen, asked


def test_advice_is_never_shown_for_another_still_than_its_own():
    """Until it comes the guide says that the coach thinks; after two seconds any turn will do."""
    guide, seen, asked = followed(TABLE, [9.0, 18.5])
    assert asked == [(1, 2), (2, 3)]
    assert {(do, stills) for _, do, stills in seen if "advice" in do} == {(f"advice at still {stills}", stills) for stills in (2, 3)}
    third_s = next(at_s for at_s, _, stills in seen if stills == 3)
    after = [(at_s - third_s, do) for at_s, do, stills in seen if stills == 3]
    assert {do for after_s, do in after if after_s < 1.9} == {THINKS}
    assert {do for after_s, do in after if after_s > 2.1} == {_ANY_TURN, "advice at still 3"}
    assert guide.advice.words == "advice at still 3"


@pytest.mark.parametrize(("table", "rejected"), [(TABLE, 0), (REJECTED, 1)], ids=["accepted", "rejected"])
def test_an_answer_that_comes_a_turn_too_late_is_not_shown_and_the_coach_is_asked_again(table, rejected):
    """What it says of still 2 comes in still 3, be that of a turn that counts or of one too small."""
    guide, seen, asked = followed(table, [16.0, 16.5])
    assert guide.rejected == rejected
    assert asked == [(1, 2), (2 - rejected, 3)]
    assert {do for _, do, _ in seen if do.startswith("advice")} == {"advice at still 3"}
    assert guide.advice.words == "advice at still 3"
