"""Whatever comes over the wire: the decoder never raises, gives nothing that was not sent, and does not care how the bytes were cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from streams import INFO, decode, frame_list, line_list, samples, sent, strangers, troubles

from session.bench import frames
from session.bench.events import Comment, Info, SampleChunk

pytestmark = pytest.mark.broad

COUNT = 60
T_US, REGISTERS = sent(COUNT, start_us=2**32 - 20_000)
FRAMES = b"".join(frame_list(T_US, REGISTERS))
LINES = b"".join(line_list(T_US, REGISTERS))
INFO_FRAME = frames.encode_info(0, INFO)
SETTINGS = settings(max_examples=120)

cuts = st.lists(st.integers(0, 3000), max_size=12)
#: bytes that mean something to the decoder, more often than others
pieces = st.one_of(
    st.binary(max_size=80),
    st.text("0123456789,-# \r\n", max_size=80).map(str.encode),
    st.sampled_from(
        [b"\0", b"\n", b"\0\n", b"# ", b"t_us,gx,gy,gz,ax,ay,az,temp\n", FRAMES[:25], FRAMES[5:60], LINES[:41], LINES[7:90], INFO_FRAME]
    ),
)


def agree(data: bytes, where) -> list:
    """Decode whole and cut: the same; returns the events."""
    whole, events = decode(data)
    _, parts = decode(data, [place for place in where if place < len(data)])
    for a, b in zip(samples(events), samples(parts), strict=True):
        assert np.array_equal(a, b)
    assert troubles(events) == troubles(parts)
    for kind in (Comment, Info):
        assert [event for event in events if isinstance(event, kind)] == [event for event in parts if isinstance(event, kind)]
    assert whole.samples == sum(len(event) for event in events if isinstance(event, SampleChunk))
    got_us, _ = samples(events)
    assert "reset" in troubles(events) or (np.diff(got_us) > 0).all()
    return events


@pytest.mark.slow
@SETTINGS
@given(st.lists(pieces, max_size=40).map(b"".join), cuts)
def test_any_bytes(data, where):
    agree(data, where)


@SETTINGS
@given(st.lists(st.tuples(st.integers(0, len(FRAMES)), st.integers(0, 200), st.binary(max_size=60)), max_size=6), cuts)
def test_frames_with_bytes_cut_out_and_put_in(edits, where):
    data = FRAMES
    for place, length, inserted in edits:
        data = data[:place] + inserted + data[place + length :]
    assert strangers(agree(data, where), T_US, REGISTERS) == 0


@SETTINGS
@given(
    st.lists(
        st.tuples(st.integers(200, len(LINES) - 400), st.sampled_from([0, 45, 60, 150]), st.text("#x \r\n\0;", max_size=60)), max_size=2
    ),
    cuts,
)
def test_lines_with_stretches_lost_and_signs_put_in(edits, where):
    """A line has no check: what is lost here is longer than a line, and what is put in holds no digit."""
    data = LINES
    for place, length, inserted in edits:
        data = data[:place] + inserted.encode() + data[place + length :]
    events = agree(data, where)
    assert strangers([event for event in events if isinstance(event, SampleChunk)], T_US, REGISTERS) == 0
