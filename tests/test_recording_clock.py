"""What a recording knows of the device's clock: against the host's, and from the info frames."""

from __future__ import annotations

import numpy as np
import pytest
from recording_wires import make_wire, record
from streams import INFO, frame_list, sent

from session.bench import frames
from session.bench.events import Info
from session.bench.logwriter import MOST, ClockComparison
from session.bench.recorder import Recorder

wire = pytest.fixture(make_wire, name="wire")


def test_the_devices_clock_is_compared_with_the_hosts():
    """0.3 % fast, arrivals late by up to 20 ms."""
    rng, clock = np.random.default_rng(0), ClockComparison()
    for k in range(2000):
        host_s = 0.01 * k
        clock.add(round((host_s + rng.exponential(0.005)) * 1e9), round(1.003 * host_s * 1e6))
        if k == 100:
            assert clock.device_seconds_per_second is None
    assert clock.device_seconds_per_second == pytest.approx(1.003, abs=1e-4)


@pytest.mark.broad
def test_a_day_of_arrivals_is_compared_in_bounded_memory():
    """30 ppm slow, arrivals late by 20 ms as the exponential has it; each of all that is kept is the least late of its stretch."""
    rng, clock = np.random.default_rng(1), ClockComparison()
    host_s = np.arange(0, 86400, 0.4)
    late_s = rng.exponential(0.02, len(host_s))
    for at_s, delay_s in zip(host_s, late_s, strict=True):
        clock.add(round((at_s + delay_s) * 1e9), round(0.99997 * at_s * 1e6))
    assert len(clock._earliest) <= MOST
    assert clock.compared_s == pytest.approx(86400, abs=300)
    assert clock.device_seconds_per_second == pytest.approx(0.99997, abs=1e-8)
    kept = np.array(clock._earliest, np.int64)
    assert np.max(kept[:, 0] - kept[:, 1] * 1000 / 0.99997) < 5e6  # ns: one of a hundred has hardly waited


def test_info_is_an_event_of_its_own(wire, tmp_path):
    recorder = Recorder(tmp_path / "s", wire[1])
    events = record(recorder, wire[0], b"".join(frame_list(*sent(100))) + frames.encode_info(100, INFO))
    assert [event for event in events if isinstance(event, Info)] == [INFO]
    assert recorder.decoder.info.odr_hz == INFO.odr_hz
    recorder.close()
