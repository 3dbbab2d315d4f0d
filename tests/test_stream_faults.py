"""The stream decoder under every fault that a wire has: nothing comes out that was not sent."""

from __future__ import annotations

import numpy as np
import pytest
from streams import BOTH, PERIOD_US, decode, frame_list, line_list, rng, same, samples, sent, strangers, troubles

from session.bench import frames
from session.bench.events import Trouble
from tinygc.simulation.virtual_board import flipped


def test_five_percent_lost_frames_are_counted_exactly():
    t_us, registers = sent(20_000)
    messages = np.array(frame_list(t_us, registers), dtype=object)
    kept = rng(4).random(len(messages)) >= 0.05
    kept[[0, -1]] = True
    decoder, events = decode(b"".join(messages[kept]))
    assert same(events, t_us[kept], registers[kept])
    assert decoder.lost == np.count_nonzero(~kept) > 900
    assert troubles(events) == {"lost": decoder.lost}


@BOTH
def test_torn_messages_cost_only_themselves(encode):
    t_us, registers = sent(5000)
    messages = encode(t_us, registers)
    torn = np.zeros(5000, bool)
    torn[rng(7).choice(np.arange(10, 4900, 10), 200, replace=False)] = True
    data = b"".join(m[: rng(k).integers(1, len(m) - 1)] if t else m for k, (m, t) in enumerate(zip(messages, torn, strict=True)))
    decoder, events = decode(data)
    assert strangers(events, t_us, registers) == 0
    if encode is frame_list:
        assert same(events, t_us[~torn], registers[~torn])
    else:  # the next line has no beginning of its own; the line before a gap is doubted
        assert decoder.samples >= 5000 - 3 * 200
    assert decoder.garbage > 0


@BOTH
def test_garbage_before_the_first_message(encode):
    t_us, registers = sent(500)
    for seed in range(30):
        decoder, events = decode(rng(seed).bytes(3000) + b"".join(encode(t_us, registers)))
        got_us, _ = samples(events)
        assert strangers(events, t_us, registers) == 0
        assert len(got_us) >= 498
        assert 2500 < decoder.garbage < 3200


@BOTH
def test_a_baud_rate_that_was_wrong_for_a_moment(encode):
    """Bytes of other lengths and values, in which zeros and line ends are as frequent as any."""
    t_us, registers = sent(4000)
    messages = encode(t_us, registers)
    first, wrong, rest = (b"".join(part) for part in (messages[:1000], messages[1000:2000], messages[2000:]))
    bits = np.unpackbits(np.frombuffer(wrong, np.uint8))[::3]
    decoder, events = decode(first + np.packbits(bits).tobytes() + rest)
    got_us, _ = samples(events)
    assert strangers(events, t_us, registers) == 0
    assert len(got_us) >= 2990
    assert decoder.resets == 0
    assert 1000 <= decoder.lost <= 1010


@BOTH
def test_a_reset_in_the_middle(encode):
    first, second = sent(1000, 50_000_000), sent(1000, 1234, seed=1)
    data = b"".join(encode(*first))[:-7] + b"# boot\r\n" + b"".join(encode(*second))
    decoder, events = decode(data)
    kinds = [event.kind for event in events if isinstance(event, Trouble) and event.kind == "reset"]
    assert kinds == ["reset"]
    at = next(k for k, event in enumerate(events) if isinstance(event, Trouble) and event.kind == "reset")
    got_us, _ = samples(events[:at])
    assert np.array_equal(got_us, first[0][: len(got_us)])
    assert len(got_us) >= 998
    got_us, _got = samples(events[at:])
    assert np.array_equal(got_us, second[0][-len(got_us) :])
    assert len(got_us) >= 999
    assert decoder.resets == 1


def test_a_board_that_changes_from_text_to_frames_and_back():
    parts = [line_list(*sent(100, 0)), frame_list(*sent(100, 10_000_000)), line_list(*sent(100, 20_000_000))]
    decoder, events = decode(b"".join(b"".join(part) for part in parts))
    assert decoder.samples >= 295
    assert (
        strangers(events, np.concatenate([sent(100, start)[0] for start in (0, 10_000_000, 20_000_000)]), np.tile(sent(100)[1], (3, 1)))
        == 0
    )


@pytest.mark.parametrize(
    "field", [{"sequence": 300}, {"t_us": 2_000_000_000}, {"t_us": 1_000_000 + 500 * PERIOD_US + 900}, {"sequence": 501, "t_us": 77}]
)
def test_a_damaged_frame_with_a_good_check_and_a_wrong_number_or_stamp_is_left_out(field):
    t_us, registers = sent(1000)
    messages = frame_list(t_us, registers)
    sequence, stamp = field.get("sequence", 500), field.get("t_us", int(t_us[500]))
    messages[500] = frames.encode_samples(np.array([sequence]), np.array([stamp]), registers[500:501])[0].tobytes()
    _, events = decode(b"".join(messages))
    others = np.arange(1000) != 500
    assert same(events, t_us[others], registers[others])
    assert troubles(events) == {"implausible": 1, "lost": 1}


def test_of_many_damaged_frames_none_enters():
    """The worst case for number and stamp: only the registers are damaged.  benchmarks/stream.py does this with a million."""
    count = 60_000
    t_us, registers = sent(count)
    coded = frames.encode_samples(np.arange(count), t_us, registers)
    hit = np.flatnonzero(rng(9).random(count) < 0.9)
    bodies, _ = frames.decode_blocks(coded[hit, :-1])
    bodies[:, 7:] = rng(10).integers(0, 256, (len(hit), 14))
    false = rng(11).choice(len(hit), 40, replace=False)  # as many as pass in 2.6 million
    spoilt = frames.encode_blocks(bodies)
    checks = spoilt[false, -3:-1].copy()
    spoilt[:, -3:-1] = rng(12).integers(1, 256, (len(hit), 2))
    spoilt[false, -3:-1] = checks
    coded[hit] = spoilt
    decoder, events = decode(coded.tobytes())
    assert strangers(events, t_us, registers) == 0
    assert decoder.implausible >= 38
    assert decoder.samples == count - len(hit)


def test_motion_and_knocks_are_not_doubted_on_a_bad_wire(simulated):
    """Simulated hand turns at 104 Hz, where steps are largest, with a damaged frame in seven: every whole frame arrives."""
    from tinygc.simulation.virtual_board import recorded

    source = recorded(simulated())
    t_us = np.rint(np.arange(len(source.rows)) * 1e6 / source.info.odr_hz).astype(np.int64)
    messages = frame_list(t_us, source.rows)
    damaged = rng(13).random(len(messages)) < 1 / 7
    damaged[:3] = damaged[-2:] = False
    data = b"".join(m[:-9] + bytes([m[-9] ^ 1 or 3]) + m[-8:] if hit else m for m, hit in zip(messages, damaged, strict=True))
    decoder, events = decode(data)
    assert decoder.implausible == 0
    assert same(events, t_us[~damaged], source.rows[~damaged])


def test_a_frame_that_passes_its_check_and_differs_in_low_bits_alone_cannot_be_told():
    """The limit of what a CRC of 16 bits, number, stamp and the step filter can do; the docs and the messages say so."""
    t_us, registers = sent(1000)
    low, high = registers.copy(), registers.copy()
    low[500, 0] ^= 0x40  # 64 LSB, a fourth of the bar
    high[500, 0] ^= 0x4000
    for wrong, entered in ((low, True), (high, False)):
        messages = frame_list(t_us, wrong)  # with a check that is right
        messages[400] = flipped(messages[400][:-1], 0.1, rng(8)) + b"\0"  # the wire is bad
        got_us, got = samples(decode(b"".join(messages))[1])
        place = np.flatnonzero(got_us == t_us[500])
        assert len(place) == entered
        assert not entered or got[place[0], 0] == low[500, 0] != registers[500, 0]
