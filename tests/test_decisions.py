"""What is decided at the table stands in raw.times: a replay, and a recording that is resumed, decide it again."""

from __future__ import annotations

import pytest
from recording_wires import caught_up, make_wire, record, replayed
from streams import frame_list, sent

from session.bench.rawfile import Mark, RecordingDecision, decision_of, name_kept
from session.bench.recorder import Recorder

wire = pytest.fixture(make_wire, name="wire")
BEGIN, KEEP, PAUSE = RecordingDecision("begin", "unclosed"), RecordingDecision("keep", "closure"), RecordingDecision("pause")


def parts(count=6, size=300):
    t_us, registers = sent(count * size)
    frames = frame_list(t_us, registers)
    return t_us, [b"".join(frames[i * size : (i + 1) * size]) for i in range(count)]


def logs_of(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.csv")}


def stamps(text: bytes) -> list[int]:
    return [int(line.split(b",")[0]) for line in text.splitlines() if line[:1].isdigit()]


def test_pause_keeps_bytes_and_no_log_and_a_whole_run_gets_its_name(wire, tmp_path):
    master, name = wire
    t_us, data = parts()
    recorder = Recorder(tmp_path / "s", name)
    decisions = [PAUSE, RecordingDecision("begin", "log"), BEGIN, BEGIN, KEEP]
    for bytes_, decision in zip(data, [*decisions, None], strict=True):
        record(recorder, master, bytes_)
        if decision:
            recorder.decide(decision)
    recorder.close()
    there = logs_of(tmp_path / "s")
    assert sorted(there) == ["closure0001.csv", "log0001.csv", "log0002.csv", "unclosed0001.csv"]
    for log, part in (("log0001", 0), ("log0002", 2), ("unclosed0001", 3), ("closure0001", 4)):
        assert stamps(there[f"{log}.csv"]) == t_us[300 * part : 300 * (part + 1)].tolist()
    assert (tmp_path / "s" / "raw.bin").read_bytes() == b"".join(data)  # what was paused, and what came behind the run, as well
    replayed(tmp_path / "s" / "raw.bin", tmp_path / "again")
    assert logs_of(tmp_path / "again") == there


def test_resumed_it_goes_on_with_the_same_files_and_tells_the_decisions(wire, tmp_path):
    master, name = wire
    t_us, data = parts(4)
    recorder = Recorder(tmp_path / "s", name)
    for bytes_, decision in zip(data[:3], [RecordingDecision("drop", "123456"), BEGIN, KEEP], strict=True):
        record(recorder, master, bytes_)
        recorder.decide(decision)
    recorder.decide(RecordingDecision("note", "a, b; c=d"))
    recorder.close()
    before = logs_of(tmp_path / "s")
    again = Recorder(tmp_path / "s", name)
    told = [event for event in caught_up(again) if isinstance(event, RecordingDecision)]
    assert [decision.text for decision in told] == ["drop 123456", "begin unclosed", "keep closure", "note a, b; c=d"]
    assert [decision.log for decision in told[:2]] == ["log0001.csv", "log0001.csv"]
    again.decide(RecordingDecision("begin", "log"))
    record(again, master, data[3])
    again.close()
    after = logs_of(tmp_path / "s")
    assert {name: after[name] for name in before} == before
    assert stamps(after["log0002.csv"]) == t_us[900:].tolist()


def test_killed_between_the_mark_and_the_name_it_has_it_when_resumed(wire, tmp_path):
    """The mark is written first: the run is in raw.bin, and is made again under its name."""
    master, name = wire
    t_us, data = parts(2)
    recorder = Recorder(tmp_path / "s", name)
    recorder.decide(BEGIN)
    record(recorder, master, data[0])
    recorder.logs.keep = lambda stem: None  # killed here
    recorder.decide(KEEP)
    recorder.close()
    assert sorted(logs_of(tmp_path / "s")) == ["unclosed0001.csv"]
    again = Recorder(tmp_path / "s", name)
    caught_up(again)
    again.close()
    assert stamps(logs_of(tmp_path / "s")["closure0001.csv"]) == t_us[:300].tolist()


def test_a_file_in_the_way_is_put_aside(wire, tmp_path):
    master, name = wire
    recorder = Recorder(tmp_path / "s", name)
    (tmp_path / "s" / "closure0001.csv").write_text("somebody's")
    recorder.decide(BEGIN)
    record(recorder, master, parts(1)[1][0])
    recorder.decide(KEEP)
    recorder.close()
    assert (tmp_path / "s" / "closure0001.csv.changed1").read_text() == "somebody's"
    assert (tmp_path / "s" / "closure0001.csv").stat().st_size > 1000


def test_marks_that_make_no_sense_decide_nothing():
    for event in ("", "open then /dev/x", "close gone", "begin", "begin ../x", "keep a b", "drop -3", "drop x", "pauses", "unknown"):
        assert decision_of(Mark(0, 0, event)) is None
    assert decision_of(Mark(0, 0, "pause")) == PAUSE
    marks = [
        Mark(0, i, event) for i, event in enumerate(["begin a", "open x", "keep closure", "begin b", "note n", "keep closure", "begin c"])
    ]
    assert [name_kept(marks, i) for i in (0, 3, 6)] == [None, "closure", None]
