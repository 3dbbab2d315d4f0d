"""What a person decides in a guided recording, with keys: pause, drop, note; and the same again when the recording is resumed."""

from __future__ import annotations

import contextlib
from types import SimpleNamespace

import pytest
from conftest import Table, config
from processes import PATIENCE_S
from test_guided import INFO, Said, chunks

from session.bench.events import Trouble
from session.bench.guide import Guide
from session.bench.guided_session import GuidedRecording
from session.bench.messages import Advice, Kind, Stage
from session.bench.rawfile import RecordingDecision
from session.io.errors import FormatError

pytestmark = pytest.mark.broad

#: four turns, with moments in which each of them moves, s: 3 to 6, 8.5 to 11.5, 14 to 17, 19.5 to 22.5
TURNS = [(120, (1, 0, 0)), (130, (0, 1, 0)), (140, (0, 0, 1)), (150, (1, 1, 0))]
MOVING = [(3.0, 6.0), (8.5, 11.5), (14.0, 17.0), (19.5, 22.5)]


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent, and no coach late, unless a test wants it so."""
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.LAST_WORD_S", PATIENCE_S)


def session(turns=4) -> Table:
    table = Table().rest(3)
    for degrees, axis in TURNS[:turns]:
        table.turn(degrees, axis, 3).rest(2.5)
    return table


class Wire:
    """Stands for a recorder: chunks, and keys that are pressed at a second of device time."""

    def __init__(self, pieces, keys=(), resumed=()):
        self._pieces, self._keys, self._resumed = iter([INFO, *pieces]), list(keys), list(resumed)
        self.connected, self.why, self.port = True, "", SimpleNamespace(name="/dev/ttyACM0")
        self.decoder = SimpleNamespace(garbage=0, crc_errors=0)
        self.clock = SimpleNamespace(measured=None)
        self.logs = SimpleNamespace(paths=[SimpleNamespace(name="log0001.csv")])
        self.decided, self.now_s, self.ended = [], 0.0, False

    def catch_up(self):
        yield from ([event] for event in self._resumed)

    def poll(self):
        piece = next(self._pieces, None)
        if piece is None:
            self.ended = True
            return []
        if hasattr(piece, "registers"):
            self.now_s = piece.t_us[-1] * 1e-6
        return [piece]

    def decide(self, decision):
        self.decided.append(decision)

    def keys(self) -> str:
        """What was typed until now."""
        due = [text for at_s, text in self._keys if at_s <= self.now_s]
        self._keys = [(at_s, text) for at_s, text in self._keys if at_s > self.now_s]
        return "".join(due)


class Notes:
    def __init__(self):
        self.notes, self.rows = [], []

    def note(self, text, when):
        self.notes.append(text)

    def exclude(self, log, at_s):
        self.rows.append((log, at_s))

    def excludes(self, log, at_s):
        return (log, at_s) in self.rows


def led(wire, segments=4, notes=None, coach=None):
    said, guide, notes = Said(), Guide(config().protocol, segments), notes or Notes()
    guided = GuidedRecording(guide, wire, lambda info, waited_s: config(), coach, said, notes, wire.keys)
    with contextlib.suppress(KeyboardInterrupt):
        guided.lead(lambda: wire.ended)
    return guide, said, notes


def test_the_last_turn_is_dropped_where_it_moved():
    """Pressed in the rest behind the second turn: it counts no more, its moment is written down, and the rest goes on."""
    wire = Wire(chunks(session()), keys=[(13.9, "d")])
    guide, said, notes = led(wire)
    assert guide.accepted == 3
    assert guide.dropped == 1
    ((log, at_s),) = notes.rows
    assert log == "log0001.csv"
    assert MOVING[1][0] < at_s < MOVING[1][1]
    assert [decision.text for decision in wire.decided] == [f"drop {round(at_s * 1e6)}"]
    assert any(text.startswith("the last turn is dropped (130° in 3.0 s)") for text in said.texts(Kind.STAGE))
    assert len(said.texts(Kind.ACCEPTED)) == 4


def test_a_turn_in_progress_is_dropped_when_it_ends():
    guide, said, notes = led(Wire(chunks(session()), keys=[(10.5, "d")]))
    assert (guide.accepted, guide.dropped) == (3, 1)
    ((_, at_s),) = notes.rows
    assert MOVING[1][0] < at_s < MOVING[1][1]
    assert "turn 2 dropped, as requested" in said.texts(Kind.STAGE)
    assert "turn 3 accepted" in " ".join(said.texts(Kind.ACCEPTED))


@pytest.mark.parametrize(("at_s", "says"), [(2.5, "no accepted turn yet"), (0.4, "no turn to drop now")])
def test_where_there_is_nothing_to_drop_it_says_so(at_s, says):
    wire = Wire(chunks(session(1)), keys=[(at_s, "d")])
    _, said, notes = led(wire, segments=1)
    assert any(says in text for text in said.texts(Kind.WARNING))
    assert (notes.rows, wire.decided) == ([], [])


def test_pressed_twice_it_does_not_drop_the_turn_before():
    guide, said, notes = led(Wire(chunks(session()), keys=[(13.9, "dd")]))
    assert (guide.accepted, len(notes.rows)) == (3, 1)
    assert "the last turn does not count" in said.texts(Kind.WARNING)


def test_paused_nothing_is_judged(monkeypatch):
    """The second of four turns is made in a pause: nobody counts it, and the first still after the pause is a new log's."""
    monkeypatch.setattr("session.bench.guided_session.SHOW_EVERY_S", -1.0)
    wire = Wire(chunks(session()), keys=[(8.4, "p"), (11.7, "p")])
    guide, said, _ = led(wire)
    assert [decision.text for decision in wire.decided] == ["pause", "begin log"]
    assert [text.split(":")[1].split(" in ")[0] for text in said.texts(Kind.ACCEPTED)] == [" 120°", " 140°", " 150°"]
    assert guide.log == 1
    shown = [now for now in said.instructions if now.stage is Stage.PAUSED]
    assert len(shown) > 5
    assert {now.do for now in shown} == {"paused: nothing is examined"}


def test_a_note_has_its_text_and_says_that_it_is_kept():
    wire = Wire(chunks(session(1)), keys=[(2.0, "nthe cable "), (2.5, "rubs\r")])
    guide, said, notes = led(wire, segments=1)
    assert notes.notes == ["the cable rubs"]
    assert wire.decided == [RecordingDecision("note", "the cable rubs")]
    assert "noted: the cable rubs" in said.texts(Kind.STAGE)
    assert guide.accepted == 1  # the letters of a note are no commands


def test_what_cannot_be_written_down_ends_no_recording():
    class Full(Notes):
        def note(self, text, when):
            raise FormatError("session.toml: no place")

    guide, said, _ = led(Wire(chunks(session(1)), keys=[(2.0, "nx\r")]), segments=1, notes=Full())
    assert said.texts(Kind.WARNING) == ["session.toml: no place"]
    assert guide.accepted == 1


def test_resumed_it_is_where_it_was_and_a_drop_that_was_taken_back_is_taken_back():
    wire, notes = Wire(chunks(session(2)), keys=[(13.9, "d")]), Notes()
    led(wire, notes=notes)
    (drop,) = wire.decided
    drop = RecordingDecision(drop.word, drop.rest, "log0001.csv")
    for kept, accepted in ((notes, 1), (Notes(), 2)):
        again = Wire([], resumed=[INFO, *chunks(session(2)), drop])
        guide, said, _ = led(again, notes=kept)
        assert guide.accepted == accepted
        assert f"resumed: {accepted} segments so far" in said.texts(Kind.STAGE)
    # A pause ends with the recording: what comes next goes to a log again.
    paused = Wire([Trouble("reconnect"), *chunks(session(1), seed=1)], resumed=[INFO, *chunks(session(2)), RecordingDecision("pause")])
    guide, _, _ = led(paused, segments=3)
    assert paused.decided == [RecordingDecision("begin", "log")]
    assert guide.accepted == 3


def test_the_coach_hears_of_a_dropped_turn():
    heard = []

    def coach(progress):
        heard.append(len(progress.turns))
        return Advice("turn", "because")

    led(Wire(chunks(session()), keys=[(13.9, "d")]), segments=3, coach=coach)
    assert heard[-1] == 3  # of four turns
    assert max(heard) == 3
