"""Whatever comes over the wire: the decoder's work grows with the number of bytes, and with nothing else.

Work is counted, not timed: bytes looked at (``examined``), and calls of functions, Python's and C's.
"""

from __future__ import annotations

import sys

import pytest
from adversarial_streams import ADVERSARIAL, ORDINARY
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import INFO, frame_list, line_list, same, sent

from session.bench import frames
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
MEANT = [
    *frame_list(T_US, REGISTERS)[:4],
    *line_list(T_US, REGISTERS)[:4],
    frames.encode_info(7, INFO),
    *[
        b"\0",
        b"\n",
        b"\n\0",
        b"#a\n",
        b"t_us,gx,gy,gz,ax,ay,az,temp\n",
        b"t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n",
        b"1,1,1,1,1,1,1,1\n",
    ],
    b"1" * 600,
]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.one_of(st.sampled_from(MEANT), st.binary(max_size=30)), min_size=1, max_size=12), st.sampled_from([512, 4096, 30_000]))
def test_the_work_for_a_byte_is_bounded_whatever_is_repeated(pieces, at_once):
    unit = b"".join(pieces) or b"\0"
    examined, calls = work((unit * (1 + 30_000 // len(unit)))[:30_000], at_once)
    assert examined <= EXAMINED
    assert calls <= CALLS


@pytest.mark.parametrize("name", ["text", "a zero behind each line"])
def test_text_is_looked_at_once(name):
    """Of the firmware that sends the zero behind its strings, too: it made the decoder look again and again at the same bytes."""
    data, decoder = {**ORDINARY, **ADVERSARIAL}[name](200_000, 1), StreamDecoder()
    decoder.feed(data)
    assert decoder.examined <= 1.2 * len(data)


@pytest.mark.parametrize("padding", [b"\0", b"\0\0\0", b"\0" * 40])
def test_zeros_behind_each_line_cost_no_sample(padding):
    """Firmware that sends ``sizeof`` a string, or a whole buffer."""
    t_us, registers = sent(3000)
    decoder = StreamDecoder()
    data = b"".join(line + padding for line in line_list(t_us, registers))
    events = [event for start in range(0, len(data), 700) for event in decoder.feed(data[start : start + 700])] + decoder.finish()
    assert same(events, t_us, registers)
    assert (decoder.garbage, decoder.lost, decoder.resets) == (0, 0, 0)
