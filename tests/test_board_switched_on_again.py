"""A board that takes commands resets itself while its port stays open: it is set again, and nothing that it sent meanwhile counts."""

from __future__ import annotations

import pytest
from processes import PATIENCE_S
from streams import INFO, frame_list, sent
from test_board_setting import Wire
from test_stream_physics import board_frame

from session.bench import frames, port
from session.bench.port import BoardSetup, Closed, Opened, Port, Received, RequestedSettings

OTHER = frames.encode_info(0, INFO)  # 500 dps, 4 g: what the board is switched on with
WANTED = RequestedSettings(odr_hz=833.0, gyro_fs_dps=2000.0)


@pytest.fixture
def set_board(monkeypatch):
    """A setting that has just set a board, long enough ago to be sure of it."""
    made = BoardSetup(WANTED)
    assert made(Wire()) == b""
    monkeypatch.setattr(port, "MEANS_IT_S", 0.0)
    return made


def as_set() -> bytes:
    return frames.encode_info(7, type(INFO)(2000.0, INFO.accel_fs_g, 833.0 * 1.013, INFO.serial))


@pytest.mark.parametrize("step", [1, 7, 30, 10_000])
def test_where_it_says_so_is_found_however_the_bytes_are_cut(set_board, step):
    before = as_set() + b"".join(frame_list(*sent(50)))
    stream = before + OTHER + board_frame() + b"".join(frame_list(*sent(20)))
    kept = b""
    for start in range(0, len(stream), step):
        data = stream[start : start + step]
        place = set_board.forgotten(data)
        kept += data[:place]
        if place is not None:
            break
    # what had come of the frame in earlier reads is kept already, and is no frame
    assert kept[: len(before)] == before
    assert len(kept) - len(before) < frames.INFO_BYTES + 1
    assert place is not None


def test_what_is_as_it_was_set_is_left_alone(set_board):
    assert set_board.forgotten(as_set() + b"".join(frame_list(*sent(100))) + board_frame() + as_set()) is None


def test_a_board_that_says_so_right_after_it_was_set_means_it():
    made = BoardSetup(WANTED)
    made(Wire())
    assert made.forgotten(OTHER) is None
    assert made.forgotten(OTHER) is None


def test_a_board_that_takes_no_commands_is_never_set_again():
    made = BoardSetup(WANTED)
    made(Wire(speaks=False))
    assert made.forgotten(OTHER) is None


class Restarting(Wire):
    """Switched on again after so many reads: it says first what it is, as it was made."""

    def __init__(self, after: int):
        super().__init__()
        self._after, self.asked_before, self.is_set = after, 0, False

    def read(self, count: int) -> bytes:
        if self.is_set and not self.asked_before and self._turn > self._after:
            self.asked_before, self.is_set = len(self.asked), False
            return OTHER + board_frame() + self._samples[0]
        return super().read(count)

    def write(self, data: bytes) -> None:
        super().write(data)
        self.is_set = {0x11, 0x12} <= {kind for kind, _ in self.asked[self.asked_before :]}

    def _say(self) -> bytes:
        return as_set() + board_frame(odr_hz=833.0) if self.is_set else super()._say()

    def close(self) -> None:
        """As a port's."""


def test_the_port_sets_it_again_and_begins_another_connection(monkeypatch):
    wire = Restarting(60)
    monkeypatch.setattr(port, "MEANS_IT_S", 0.0)
    monkeypatch.setattr(port.serial, "Serial", lambda *args, **how: wire)
    made = BoardSetup(WANTED)
    opened = Port("wire", setup=made)
    items = []
    while sum(isinstance(item, Opened) for item in items) < 2:
        items.append(opened.items.get(timeout=PATIENCE_S))
    opened.close()
    states = [type(item) for item in items if not isinstance(item, Received)]
    assert states == [Opened, Closed, Opened]
    assert "switched on again" in next(item.why for item in items if isinstance(item, Closed))
    assert OTHER not in b"".join(item.data for item in items if isinstance(item, Received))
    again = [kind for kind, _ in wire.asked[wire.asked_before :]]
    assert again == [0x11, 0x12]
