"""``record --rest``: the guide of a rest, its logs and their replay, and how it goes on beside turns in the same recording."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest
from conftest import Table, config
from processes import PATIENCE_S
from recording_wires import caught_up, make_wire, record, replayed
from streams import frame_list, sent
from test_guided import INFO, Port, Said, chunks, pulled

from session.bench import live
from session.bench.events import Trouble
from session.bench.guide import Guide
from session.bench.guided_session import GuidedRecording
from session.bench.messages import Kind, Stage
from session.bench.rawfile import RecordingDecision
from session.bench.recorder import Recorder
from session.bench.rest_guide import RestAnswer, RestGuide, in_words
from session.bench.screen import view
from tinygc.cli.recording import counted, rest_guide
from tinygc.reporting.terminal import as_text

wire = pytest.fixture(make_wire, name="wire")
REST, BEGIN = Table().rest(6), RecordingDecision("begin", "rest")


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.SHOW_EVERY_S", -1.0)


class Script(Port):
    """A recorder that keeps decisions, with what it had given before each."""

    def __init__(self, steps, resumed=()):
        super().__init__(steps, resumed)
        self.polled, self.decided = 0, []

    def poll(self):
        self.polled += 1
        return super().poll()

    def decide(self, decision):
        self.decided.append((self.polled, decision))


class Figures:
    """Stand for the annex: the answer changes when so many samples have come."""

    def __init__(self, answers=()):
        self.samples = self.logs = 0
        self._answers = dict(answers)

    def add(self, samples):
        self.samples += len(samples)

    def new_log(self):
        self.logs += 1

    def answer(self):
        due = [count for count in self._answers if count <= self.samples]
        return self._answers.pop(due[0]) if due else None


def led(port, guide, **options):
    said = Said()
    GuidedRecording(guide, port, lambda info, waited_s: config() if info else None, None, said).lead(**options)
    return said


def test_a_rest_of_some_seconds_takes_every_sample_into_its_log():
    """The log begins before the first sample; the guide ends with the block in which the time is reached."""
    port, figures = Script([INFO, *chunks(REST)]), Figures()
    guide = RestGuide(config().protocol, 4.0, figures)
    said = led(port, guide)
    assert port.decided == [(0, BEGIN)]
    assert 4.0 <= guide.rested_s < 4.11
    assert figures.samples / 208 == pytest.approx(guide.rested_s, abs=0.01)
    assert said.texts(Kind.DONE) == ["done: 4 s of rest"]
    assert not said.texts(Kind.WARNING)
    assert guide.moved_s == guide.accepted == 0
    assert {instruction.do for instruction in said.instructions if instruction.stage is Stage.HOLD_STILL} == {
        "a rest: leave the board alone, and the table too"
    }


def test_enough_is_said_once_and_ends_it_where_that_was_asked():
    answers = {300: RestAnswer(("B after 3.1 h",)), 500: RestAnswer(("all known",), True), 700: RestAnswer(("still known",), True)}
    guide, said = RestGuide(config().protocol, 5.0, Figures(answers)), Said()
    said = led(Script([INFO, *chunks(REST)]), guide)
    assert [text for text in said.texts(Kind.STAGE) if "B" in text or "known" in text] == ["B after 3.1 h", "all known", "still known"]
    assert said.texts(Kind.READY) == ["enough: 2 s of rest shows the noise as precisely as was asked"]
    assert said.texts(Kind.DONE) == ["done: 5 s of rest"]
    assert any(instruction.do.startswith("enough") for instruction in said.instructions)
    shown = as_text(view(guide, "folder", said.changes[-2:]))
    assert re.search(r"rest +5 s of 5 s\n *noise +still known", shown), shown
    assert "segments" not in shown
    stopping = RestGuide(config().protocol, None, Figures(answers), stop_at_target=True)
    said = led(Script([INFO, *chunks(REST)]), stopping)
    assert said.texts(Kind.DONE) == ["done: 2 s of rest, and the noise is known"]


def test_an_unplugged_board_goes_on_in_a_new_log_and_its_figures_know():
    def plugged(port):
        port.connected, port.why = True, ""
        return [Trouble("reconnect"), INFO]

    figures = Figures()
    guide = RestGuide(config().protocol, 8.0, figures)
    said = led(Script([INFO, *chunks(REST)[:15], pulled, plugged, *chunks(REST, seed=1)]), guide)
    assert figures.logs == 1
    assert guide.rested_s == pytest.approx(8.0, abs=0.11)
    assert said.texts(Kind.WARNING) == ["the port was opened again: a new log begins"]


def test_what_moves_is_counted_and_said_once(monkeypatch):
    """Behind the minute in which the sensor's own noise becomes known."""
    monkeypatch.setattr("session.bench.rest_guide.CEILING_S", 2.0)
    guide = RestGuide(config().protocol, 12.0)
    table = Table().rest(5).turn(20, (0, 0, 1), 1.0).rest(3).turn(20, (0, 1, 0), 1.0).rest(3)
    said = led(Script([INFO, *chunks(table)]), guide)
    (warning,) = said.texts(Kind.WARNING)
    assert warning.startswith("it moves: ")
    assert guide.moved_s == pytest.approx(2.0, abs=0.5)


def test_a_memory_that_is_full_is_looked_at_every_tenth_block(monkeypatch):
    """Else a night of rest takes hours to replay."""
    calls, real = [], live.noise_variance
    monkeypatch.setattr(live, "noise_variance", lambda values: calls.append(len(values)) or real(values))
    stillness, samples = live.Stillness(1 / 208, memory=60), Table().rest(30).samples()
    for start in range(0, 200 * stillness.size, stillness.size):
        stillness.feed(samples.between(start, start + stillness.size))
    assert len(calls) == 2 * (49 + 16)  # of gyroscope and accelerometer: each of the first, then 50, 60, …
    assert max(calls) == 60


def test_resumed_after_turns_the_rest_has_its_own_log_and_no_turn_counts():
    """What the port still held of the turns goes to no log; the rest's log begins with the new connection."""
    turns = Table().rest(3).turn(120, (1, 0, 0), 3).rest(3)
    port = Script([Trouble("reconnect"), INFO, *chunks(REST, seed=1)], resumed=[INFO, *chunks(turns)])
    guide = RestGuide(config().protocol, 4.0)
    led(port, guide)
    assert [decision for _, decision in port.decided] == [RecordingDecision("pause"), BEGIN]
    assert port.decided[0][0] == 0
    assert 4.0 <= guide.rested_s < 4.11


def test_turns_that_are_resumed_after_a_rest_take_nothing_of_it():
    """Neither its samples nor that the operator had finished it."""
    turns = Table().rest(3).turn(120, (1, 0, 0), 3).rest(3)
    past = [INFO, *chunks(turns), BEGIN, *chunks(turns, seed=1), RecordingDecision("finish")]
    port = Script([Trouble("reconnect"), INFO, *chunks(turns, seed=2)], resumed=past)
    guide = Guide(config().protocol, 2)
    said = led(port, guide)
    assert [decision for _, decision in port.decided] == [RecordingDecision("pause"), RecordingDecision("begin", "log")]
    assert "resumed: 1 segments so far" in said.texts(Kind.STAGE)
    assert guide.accepted == 2
    finished = Guide(config().protocol, 1)
    led(Script([], resumed=past), finished)
    assert finished.stage is Stage.DONE


def test_a_finished_rest_is_resumed_and_becomes_longer():
    past = [BEGIN, INFO, *chunks(REST), RecordingDecision("finish"), Trouble("reconnect"), INFO, *chunks(REST, seed=1)]
    guide = RestGuide(config().protocol, 14.0)
    port = Script([Trouble("reconnect"), INFO, *chunks(REST, seed=2)], resumed=past)
    said = led(port, guide)
    assert not port.decided  # its last log was a rest's
    assert "resumed: 12 s of rest so far" in said.texts(Kind.STAGE)
    assert guide.rested_s == pytest.approx(14.0, abs=0.11)
    already = RestGuide(config().protocol, 5.0)
    led(Script([], resumed=past), already)  # nothing is polled
    assert already.rested_s == pytest.approx(5.0, abs=0.11)


def test_keys_pause_and_finish_it():
    port = Script([INFO, *chunks(REST), *chunks(REST, seed=1)])
    guide, said = RestGuide(config().protocol), Said()
    pressed = {15: "p", 20: "p", 30: "f"}
    GuidedRecording(
        guide, port, lambda info, waited_s: config() if info else None, None, said, keys=lambda: pressed.pop(port.polled, "")
    ).lead()
    assert [decision.text for _, decision in port.decided] == ["begin rest", "pause", "begin rest", "finish"]
    assert said.texts(Kind.DONE)[0].endswith("of rest, finished by the operator")
    assert guide.keys.startswith("keys: p pause   n note")


def test_a_rest_between_turns_replays_to_the_same_logs(wire, tmp_path):
    """Turns, a rest, turns again: three logs, and the raw bytes give them again; a resumed recorder reads the decisions."""
    master, name = wire
    recorder = Recorder(tmp_path / "s", name)
    try:
        for number, stem in enumerate((None, "rest", "log")):
            if stem is not None:
                recorder.decide(RecordingDecision("begin", stem))
            record(recorder, master, b"".join(frame_list(*sent(400, 1_000_000 * (number + 1), seed=number), first=400 * number)))
        assert counted(RestGuide(config().protocol), recorder).startswith("0 s of rest, ")
    finally:
        recorder.close()
    logs = ["log0001.csv", "rest0001.csv", "log0002.csv"]
    assert [path.name for path in recorder.logs.paths] == logs
    assert replayed(tmp_path / "s" / "raw.bin", tmp_path / "again") == [(tmp_path / "s" / log).read_bytes() for log in logs]
    resumed = Recorder(tmp_path / "s", name)
    try:
        decisions = [event for event in caught_up(resumed) if isinstance(event, RecordingDecision)]
    finally:
        resumed.close()
    assert [decision.text for decision in decisions] == ["begin rest", "begin log"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--rest", "1", "--closure"], "--closure is of turns, and with --rest nothing is turned"),
        (["--rest", "--view"], "--view is of turns"),
        (["--known-to", "10"], "--known-to says how well the noise of a rest is to be known; add --rest"),
        (["--rest", "-1"], "-1 is no time from 0 to 1000 h"),
        (["--rest", "--known-to", "0"], "0 is no share from 1 to 100 %"),
    ],
)
def test_what_cannot_be_is_one_line(run, tmp_path, words, says):
    code, _, said = run("record", "--port", tmp_path / "no-port", "--out", tmp_path / "s", *words)
    assert code == 2
    assert says in said
    assert not (tmp_path / "s").exists()


def test_without_the_annex_it_records_and_cannot_know_what_is_enough(run, tmp_path, monkeypatch):
    monkeypatch.setattr("tinygc.cli.recording.find", lambda service: None)
    monkeypatch.setattr("tinygc.cli.recording.is_present", lambda service: False)
    guide = rest_guide(SimpleNamespace(known_to=20.0, rest=0.5, stop_at_target=False), config().protocol)
    assert guide.rest_s == 1800.0
    with pytest.raises(KeyboardInterrupt):
        led(Script([INFO, *chunks(REST)]), guide, interrupted=lambda: guide.rested_s > 3)
    assert not guide.answer.lines
    code, _, said = run("record", "--port", tmp_path / "no-port", "--out", tmp_path / "s", "--rest", "--stop-at-target")
    assert code == 2
    assert "--stop-at-target needs the annex noise" in said


@pytest.mark.parametrize(("seconds", "words"), [(0, "0 s"), (119.4, "119 s"), (120, "2 min"), (7199, "120 min"), (11160, "3.1 h")])
def test_durations_in_words(seconds, words):
    assert in_words(seconds) == words
