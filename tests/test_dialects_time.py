"""Stamps of foreign logs: exact, repeated, coarse, come round, gone back."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from dialect_logs import (
    ACCEL,
    ARTEMIS,
    EPOCH_NS,
    EUROC,
    GYRO,
    SAMPLES,
    T_US,
    clock,
    inertial,
    make,
    rows,
    same,
    triads,
)

from session.io.clock import exact_ns
from session.io.errors import DataError, FormatError
from session.io.stamps import span_of_counter
from tinygc import read_session

pytestmark = pytest.mark.broad

# Time


def test_stamps_stay_exact(tmp_path):
    """Nanoseconds of an epoch, seconds of an epoch with nine decimals: a float64 would round both by some 100 ns."""
    ns = EPOCH_NS + np.arange(0, 2 * 10**9, 4_800_001)
    some = np.column_stack([np.zeros((len(ns), 5)), np.full(len(ns), -1.0)]).T
    euroc = make(tmp_path, EUROC + rows(ns, *some))
    seconds = [f"{t // 10**9}.{t % 10**9:09d}" for t in ns.tolist()]
    decimal = make(tmp_path, "Time,G_x [mdps],G_y [mdps],G_z [mdps],A_x [g],A_y [g],A_z [g]\n" + rows(seconds, *some), out="decimal")
    for made in (euroc, decimal):
        np.testing.assert_array_equal(read_session(made.folder).logs[0].samples.t_ns, ns)


def test_duplicate_and_irregular_stamps_are_ordinary(tmp_path):
    lines = inertial().split("\n")
    lines.insert(50, lines[50])
    made = make(tmp_path, "\n".join(lines[:100] + lines[103:]))
    log = read_session(made.folder).logs[0]
    assert len(log.samples) == len(SAMPLES) - 3
    assert any("repeat the row before" in note for note in log.notes)


def test_coarse_stamps_over_lost_samples_are_refused(tmp_path):
    keep = np.r_[0:300, 360 : len(T_US)]
    columns = [np.array(c)[keep].tolist() for c in (clock(T_US, 2), *map(list, ACCEL["mg"].T), *map(list, GYRO["dps"].T))]
    text = ARTEMIS + rows(["1/1/2024"] * len(keep), *columns, *[["0"] * len(keep)] * 5)
    with pytest.raises(DataError, match="--odr"):
        make(tmp_path, text)
    assert any("counted at 104" in note for note in make(tmp_path, text, odr_hz=104.0).notes)


def test_micros_come_round(tmp_path):
    wrapped = (T_US + 2**32 - 3_000_000) % 2**32
    text = inertial().split("\n", 1)[0] + "\n" + rows(wrapped, *triads("dps", "g"))
    made = make(tmp_path, text)
    assert any("came round 1x" in note for note in made.notes)
    same(made)


@pytest.mark.parametrize(("back_s", "start_ns"), [(3.0, EPOCH_NS), (3.9, EPOCH_NS), (4.0, 0), (3.0, 60 * 10**9)])
def test_nanoseconds_that_step_back_are_no_counter(back_s, start_ns, tmp_path):
    """A 32-bit counter of ns would come round every 4.3 s."""
    t_ns = start_ns + T_US * 1000
    t_ns[len(t_ns) // 2 :] -= round(back_s * 1e9)
    if start_ns == 0:
        t_ns += 10**9
    text = inertial().split("\n", 1)[0].replace("us", "ns") + "\n" + rows(t_ns, *triads("dps", "g"))
    with pytest.raises(FormatError, match="goes backward by"):
        make(tmp_path, text)


def test_a_counter_with_a_sign_comes_round(tmp_path):
    wrapped = (T_US + 2**31 - 3_000_000 + 2**31) % 2**32 - 2**31
    made = make(tmp_path, inertial().split("\n", 1)[0] + "\n" + rows(wrapped, *triads("dps", "g")))
    assert any("came round 1x" in note for note in made.notes)
    same(made)


TABLE = "gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n"


def table(stamps, name="t_us"):
    return f"{name},{TABLE}" + rows(stamps, *triads("dps", "g"))


@pytest.mark.parametrize(
    ("name", "unit_ns", "bits", "begins", "signed"),
    [
        ("t_us", 1000, 21, 1_900_000, False),
        ("t_ms", 1_000_000, 12, 4000, True),
        ("t_ms", 1_000_000, 10, 0, False),
        ("cycles", 15.625, 24, 12_345_678, False),
        ("ticks", 125 / 9, 27, 0, False),  # of 72 MHz
        ("micros", 1000, 32, 2**32 - 2_500_000, False),
    ],
)
def test_a_counter_of_any_width_comes_round(name, unit_ns, bits, begins, signed, tmp_path):
    counts = (np.rint(SAMPLES.t_ns / unit_ns).astype(np.int64) + begins) % 2**bits
    counts -= 2**bits * (signed & (counts >= 2 ** (bits - 1)))
    told = {"time_unit": f"{unit_ns}ns"} if name in ("cycles", "ticks") else {}
    made = make(tmp_path, table(counts, name), **told)
    t_ns = read_session(made.folder).logs[0].samples.t_ns
    assert np.abs(t_ns - t_ns[0] - SAMPLES.t_ns).max() <= unit_ns + 1
    assert any("came round" in note for note in made.notes)


def test_micros_that_are_written_in_ms_come_round_as_they_do(tmp_path):
    ms = (T_US + 2**32 - 3_000_000) % 2**32 // 1000
    made = make(tmp_path, table(ms, "t_ms"))
    t_ns = read_session(made.folder).logs[0].samples.t_ns
    assert np.abs(t_ns - t_ns[0] - SAMPLES.t_ns).max() <= 1_000_001


@pytest.mark.parametrize(
    ("fall", "highest", "span"),
    [
        (2**16 - 10, 2**16 - 5, 2**16),
        (2**16 - 25, 2**16 - 5, 2**16),
        (2**16 - 26, 2**16 - 5, None),  # more than 2.5 steps are lost there
        (2**16, 2**16 - 5, None),
        (2**16 - 10, 2**16, None),  # beyond such a counter
        (30, 30, None),  # three rows a round
        (31, 31, None),
        (54, 60, 64),
    ],
)
def test_a_counter_falls_by_a_power_of_two_less_a_usual_step(fall, highest, span):
    assert span_of_counter(fall, 10, 0, highest, 1) == span
    if span:
        assert span_of_counter(fall, 10, -span / 2, highest - span / 2, 1) == span


def iso(hours, zone):
    """Stamps of a clock ``hours`` east of UTC, before and behind a moment in the middle."""
    half, texts = int(T_US[len(T_US) // 2]), []
    for t_us in T_US.tolist():
        east = hours[t_us >= half]
        moment = datetime(2026, 3, 29, 1, tzinfo=UTC) + timedelta(microseconds=t_us - half, hours=east)
        texts.append(moment.strftime("%Y-%m-%dT%H:%M:%S.%f") + (f"{east:+03d}:00" if zone else ""))
    return texts


@pytest.mark.parametrize("hours", [(1, 2), (2, 1), (-5, -4), (-4, -5)])
def test_summer_time_begins_and_ends_unseen_where_there_is_a_zone_and_is_named_where_there_is_none(hours, tmp_path):
    same(make(tmp_path, table(iso(hours, True), "time")))
    way = "forward, as where summer time begins" if hours[1] > hours[0] else "back, as where summer time ends"
    with pytest.raises(FormatError, match=rf"line {len(T_US) // 2 + 2}: time leaps 3600 s {way}; write the stamps in UTC.*--odr"):
        make(tmp_path, table(iso(hours, False), "time"), out="local")


@pytest.mark.parametrize("value", [0, 2**30, 17])
def test_a_single_bad_stamp_is_named_and_taken_as_the_middle(value, tmp_path):
    bad = T_US.copy()
    bad[[70, 300]] = value
    made = make(tmp_path, table(bad))
    assert any(
        f"line 72: t_us is {value}, beyond both neighbours: taken as 673077" in note and "1 more such" in note for note in made.notes
    )
    t_ns = read_session(made.folder).logs[0].samples.t_ns
    assert np.abs(t_ns - SAMPLES.t_ns).max() <= 1000


def test_stamps_in_the_wrong_order_are_not_put_right(tmp_path):
    swapped = T_US.copy()
    swapped[[70, 71]] = swapped[[71, 70]]
    with pytest.raises(FormatError, match=r"line 73: t_us goes backward by .*; split the log there"):
        make(tmp_path, table(swapped))


def rows_of(stamps, part):
    return rows(stamps, *(column[part] for column in triads("dps", "g")))


@pytest.mark.parametrize("words", [[], ["ets Jul 29 2019 12:21:46", "", "rst:0x1 (POWERON_RESET),boot:0x13"], ["Init, 3, ok"]])
@pytest.mark.parametrize("header_again", [True, False])
def test_a_board_that_starts_again_has_made_two_pieces(words, header_again, tmp_path):
    half = len(T_US) // 2
    first, second = (
        rows_of(T_US[part] - T_US[part][0] + begins, part) for part, begins in ((slice(half), 9_000_000), (slice(half, None), 412))
    )
    head = f"t_us,{TABLE}"
    text = head + first + "".join(f"{word}\n" for word in words) + header_again * head + second
    line = half + 2 + (0 if words else header_again)
    with pytest.raises(FormatError, match=rf"line {line}: .*t_us begins again at 0.000412 s.*two pieces: split the log there"):
        make(tmp_path, text)


@pytest.mark.parametrize("lost", [0.01, 0.05])
def test_lost_samples_leave_the_data_rate_as_it_is(lost, tmp_path):
    text = inertial().split("\n")
    kept = np.random.default_rng(1).random(len(text)) >= lost
    kept[:2] = True
    made = make(tmp_path, "\n".join(line for line, keep in zip(text, kept, strict=True) if keep) + "\n")
    assert read_session(made.folder).config.sensor.odr_hz == pytest.approx(104, rel=2e-4)


# The folder


@pytest.mark.parametrize("text", ["nan", "inf", "1e999999", "1e400000", "", "1:2", "a:b:c", "::"])
def test_what_is_no_time(text):
    with pytest.raises(ValueError, match=r"no time|unpack|invalid"):
        exact_ns(text, 10**9)
