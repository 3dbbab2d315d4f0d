"""What a recording knows of the device's clock: against the host's, and from the info frames."""

from __future__ import annotations

import numpy as np
import pytest
from recording_wires import make_wire, record
from streams import INFO, frame_list, sent

from session.bench import frames
from session.bench.board_clock import ClockComparison, ClockRatio
from session.bench.events import Info
from session.bench.recorder import Recorder

wire = pytest.fixture(make_wire, name="wire")


def in_frames(sent_s, rng):
    """A port that is asked each ms by the host's clock, whatever the board's."""
    return (np.ceil(sent_s * 1e3 + rng.random())) * 1e-3


def in_bursts(sent_s, rng):
    """An adapter that hands over each 16 ms, by a quartz of its own."""
    bursts = np.ceil(sent_s / 16.0005e-3).astype(int)
    return bursts * 16.0005e-3 + rng.exponential(2e-4, bursts.max() + 1)[bursts]


#: laws of the delay between a sample and its arrival
LATE = {
    "USB's frames": in_frames,
    "within 1 ms": lambda sent_s, rng: sent_s + rng.uniform(0, 1e-3, len(sent_s)),
    "bursts of 16 ms": in_bursts,
    "a tail of 5 ms": lambda sent_s, rng: sent_s + rng.exponential(5e-3, len(sent_s)),
    "a busy host": lambda sent_s, rng: sent_s + rng.exponential(2e-4, len(sent_s)) + 0.3 * (rng.random(len(sent_s)) < 0.003),
}


def compared(ppm, lasts_s, late, rng, odr_hz=118.7, drift_ppm=0.0):
    """The comparison with a board whose clock is so many ppm fast on average, and drifts over the recording."""
    clock, stamp_s = ClockComparison(), np.arange(0, lasts_s, 1 / odr_hz)
    sent_s = stamp_s / (1 + ppm * 1e-6) - drift_ppm * 1e-6 * (stamp_s**2 / (2 * lasts_s) - stamp_s / 2)
    arrived_s = np.maximum.accumulate(late(sent_s, rng))
    last = np.flatnonzero(np.append(np.diff(arrived_s) > 2e-5, True))  # of what came together
    for row, count in zip(last, np.diff(last, prepend=-1), strict=True):
        clock.add(round(arrived_s[row] * 1e9), round(stamp_s[row] * 1e6), int(count))
    return clock.measured


@pytest.mark.parametrize("drift_ppm", [0.0, pytest.param(5.0, marks=pytest.mark.broad)])
@pytest.mark.parametrize("late", LATE)
def test_the_devices_clock_is_compared_with_the_hosts(late, drift_ppm):
    """Clocks of quartz and of resonators: no error beyond what the sigma allows, which is below 70 ppm after 33 s and 10 after minutes."""
    rng = np.random.default_rng(len(late))
    for lasts_s, most_ppm in ((33.0, 70.0), (150.0, 10.0)):
        pulls = []
        for _ in range(6):
            ppm, odr_hz = rng.choice([rng.uniform(-5000, 5000), rng.uniform(-50, 50)]), rng.choice([100.0, 118.7, 416.7])
            found = compared(ppm, lasts_s, LATE[late], rng, odr_hz, drift_ppm)
            pulls.append((found.ratio - 1 - ppm * 1e-6) / found.sigma)
            assert found.sigma < most_ppm * 1e-6
        assert np.sqrt(np.mean(np.square(pulls))) < 1.45  # six of sigma 1 reach it once in 20


def test_there_is_no_result_of_a_few_seconds_and_one_of_both_sides_of_a_reset():
    rng, clock = np.random.default_rng(0), ClockComparison()
    for begins_s in (0.0, 40.0):
        for k in range(3000):
            host_s = begins_s + 0.01 * k
            clock.add(round((host_s + rng.exponential(0.005)) * 1e9), round(1.003 * 0.01 * k * 1e6))
            assert k > 900 or begins_s or clock.measured is None
        clock.restart()
    assert clock.measured.ratio == pytest.approx(1.003, abs=3 * clock.measured.sigma)
    assert clock.measured.over_s == pytest.approx(60.0, abs=2.0)
    apart = ClockRatio.of([ClockRatio(1.001, 1e-5, 30.0), ClockRatio(1.003, 1e-5, 30.0)])
    assert (apart.ratio, apart.sigma) == (pytest.approx(1.002), pytest.approx(1e-3, rel=1e-6))  # they differ by far more than they say


def test_info_is_an_event_of_its_own(wire, tmp_path):
    recorder = Recorder(tmp_path / "s", wire[1])
    events = record(recorder, wire[0], b"".join(frame_list(*sent(100))) + frames.encode_info(100, INFO))
    assert [event for event in events if isinstance(event, Info)] == [INFO]
    assert recorder.decoder.info.odr_hz == INFO.odr_hz
    recorder.close()


def test_a_clock_that_stands_or_is_hardly_seen_tells_nothing():
    clock = ClockComparison()
    for k in range(3000):
        clock.add(round(1e7 * k), 12345)
    assert clock.measured is None
    assert not ClockRatio(1.0005, 4e-4, 12.0).tells
    assert ClockRatio(1.00001, 2e-5, 33.0).tells
    assert ClockRatio(1.005, 1e-3, 12.0).tells
