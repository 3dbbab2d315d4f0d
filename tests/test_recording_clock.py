"""What a recording knows of the device's clock: against the host's, and from the info frames."""

from __future__ import annotations

import numpy as np
import pytest
from recording_wires import make_wire, record
from streams import INFO, frame_list, sent

from session.recording.clock import ComparisonOfClocks
from session.recording.recorder import Recorder
from session.stream import frames
from session.stream.events import Info

wire = pytest.fixture(make_wire, name="wire")


def test_the_devices_clock_is_compared_with_the_hosts():
    """0.3 % fast, arrivals late by up to 20 ms."""
    rng, clock = np.random.default_rng(0), ComparisonOfClocks()
    for k in range(2000):
        host_s = 0.01 * k
        clock.add(round((host_s + rng.exponential(0.005)) * 1e9), round(1.003 * host_s * 1e6))
        if k == 100:
            assert clock.device_seconds_per_second is None
    assert clock.device_seconds_per_second == pytest.approx(1.003, abs=1e-4)


def test_info_is_an_event_of_its_own(wire, tmp_path):
    recorder = Recorder(tmp_path / "s", wire[1])
    events = record(recorder, wire[0], b"".join(frame_list(*sent(100))) + frames.encode_info(100, INFO))
    assert [event for event in events if isinstance(event, Info)] == [INFO]
    assert recorder.odr_hz == INFO.odr_hz
    recorder.close()
