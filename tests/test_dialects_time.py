"""Stamps of foreign logs: exact, repeated, coarse, come round, gone back."""

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
    assert any("repeat the stamp" in note for note in log.notes)


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
