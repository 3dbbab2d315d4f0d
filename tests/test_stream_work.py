"""Whatever comes over the wire: the decoder's work grows with the number of bytes, and with nothing else.

Work is counted, not timed: bytes looked at (``examined``), and calls of functions, Python's and C's.
"""

from __future__ import annotations

import sys

import pytest
from adversarial_streams import ADVERSARIAL, ORDINARY
from streams import line_list, same, sent

from session.bench.decoder import StreamDecoder

pytestmark = pytest.mark.broad

EXAMINED = 3.0  #: times that a byte is looked at
CALLS = 4.0  #: of functions, for each byte
AT_ONCE = 4096
KEPT = 600  #: bytes that may be kept from one portion to the next, and are looked at again
CALLS_EACH = 1500  #: of functions, for each portion


class Calls:
    """A context that counts calls of functions."""

    count = 0

    def __enter__(self) -> Calls:
        self._before = sys.getprofile()
        sys.setprofile(self._seen)
        return self

    def __exit__(self, *error: object) -> None:
        sys.setprofile(self._before)

    def _seen(self, frame: object, event: str, argument: object) -> None:
        self.count += event in ("call", "c_call")


def work(data: bytes, at_once: int = AT_ONCE) -> tuple[float, float]:
    """Bytes looked at and functions called, for each byte, less what each portion may cost."""
    decoder = StreamDecoder()
    with Calls() as calls:
        for start in range(0, len(data), at_once):
            decoder.feed(data[start : start + at_once])
        decoder.finish()
    portions = 1 + len(data) // at_once
    return (decoder.examined - KEPT * portions) / len(data), (calls.count - CALLS_EACH * portions) / len(data)


@pytest.mark.parametrize("name", [*ORDINARY, *ADVERSARIAL])
def test_the_work_for_a_byte_is_bounded_on_every_stream(name):
    size = 60_000
    data = {**ORDINARY, **ADVERSARIAL}[name](size, 1)
    for at_once in (AT_ONCE, size):
        examined, calls = work(data, at_once)
        assert examined <= EXAMINED
        assert calls <= CALLS


T_US, REGISTERS = sent(40)


@pytest.mark.parametrize("padding", [b"\0", b"\0\0\0", b"\0" * 40])
def test_zeros_behind_each_line_cost_no_sample(padding):
    """Firmware that sends ``sizeof`` a string, or a whole buffer."""
    t_us, registers = sent(3000)
    decoder = StreamDecoder()
    data = b"".join(line + padding for line in line_list(t_us, registers))
    events = [event for start in range(0, len(data), 700) for event in decoder.feed(data[start : start + 700])] + decoder.finish()
    assert same(events, t_us, registers)
    assert (decoder.garbage, decoder.lost, decoder.resets) == (0, 0, 0)
