"""Ctrl-C is heard between two slices of work, whatever is being caught up; what was not decoded yet is not lost."""

from __future__ import annotations

import pytest
from processes import until
from recording_wires import caught_up, make_wire, replayed
from streams import INFO, costly, frame_list, sent

from session.bench import frames
from session.bench import recorder as recorder_module
from session.bench.events import SampleChunk
from session.bench.guide import Guide
from session.bench.guided_session import GuidedRecording
from session.bench.port import Received
from session.bench.recorder import BLOCK, Recorder
from session.bench.session_file import SessionFile
from session.io.config import Protocol

wire = pytest.fixture(make_wire, name="wire")
READ = 4096  #: a read of the port


class Silent:
    """Stands for a screen."""

    def change(self, change) -> None:
        """Nothing."""

    def show(self, guide) -> None:
        """Nothing."""


def frames_of(count: int) -> bytes:
    return frames.encode_info(0, INFO) + b"".join(frame_list(*sent(count)))


def lead(recorder: Recorder, asked_before_stop: int) -> int:
    """Lead until somebody wants to stop; the times that were asked."""
    asked = 0

    def wanted() -> bool:
        nonlocal asked
        asked += 1
        return asked > asked_before_stop

    file = SessionFile(recorder.raw.path.parent, None, None, None, None)
    configure = lambda info, waited_s: file.configure(info, waited_s, recorder.logs.physical)  # noqa: E731
    with pytest.raises(KeyboardInterrupt):
        GuidedRecording(Guide(Protocol(), 40), recorder, configure, None, Silent()).lead(wanted)
    return asked


@pytest.mark.parametrize("name", ["frames", "a reset every 4 frames"])
def test_a_recording_that_is_resumed_is_caught_up_in_slices(name, wire, tmp_path):
    """Between two it is asked whether to stop; stopped, it leaves logs that the next time only grow."""
    data = frames_of(20_000) if name == "frames" else costly(500_000)[name]
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / "raw.bin").write_bytes(data)
    recorder = Recorder(folder, wire[1])
    lead(recorder, 2)
    assert recorder.decoder.taken <= 3 * BLOCK
    recorder.close()
    assert recorder.undecoded >= len(data) - 3 * BLOCK
    again = Recorder(folder, wire[1])
    caught_up(again)
    again.close()
    assert again.logs.put_aside == []
    assert again.undecoded == 0
    assert [path.read_bytes() for path in again.logs.paths] == replayed(folder / "raw.bin", tmp_path / "again")


def with_much_waiting(folder, port):
    """A recorder of which 20 000 samples wait to be decoded, and their bytes."""
    recorder = Recorder(folder, port)
    until(lambda: recorder.connected, lambda: recorder.poll(0.01))
    data = frames_of(20_000)
    for start in range(0, len(data), READ):
        recorder._keep(item := Received(1, data[start : start + READ]))
        recorder.port.items.put(item)
    return recorder, data


def test_what_waits_is_taken_in_slices(wire, tmp_path):
    recorder, data = with_much_waiting(tmp_path / "s", wire[1])
    before = recorder.decoder.taken
    while recorder.decoder.taken < len(data):
        recorder.poll(0)
        assert 0 < recorder.decoder.taken - before <= BLOCK + READ
        before = recorder.decoder.taken
    recorder.close()
    assert recorder.undecoded == 0


def test_what_waits_when_somebody_stops_is_in_the_raw_bytes_and_said(wire, tmp_path, monkeypatch):
    """However much it is: nothing is decoded for longer than that, and resumed it is all there."""
    monkeypatch.setattr(recorder_module, "LAST_S", 0.0)
    recorder, data = with_much_waiting(tmp_path / "s", wire[1])
    recorder.poll(0)
    recorder.close()
    assert recorder.undecoded > len(data) - 2 * BLOCK
    again = Recorder(tmp_path / "s", wire[1])
    events = caught_up(again)
    again.close()
    assert sum(len(event) for event in events if isinstance(event, SampleChunk)) == 20_000
    assert again.logs.put_aside == []
