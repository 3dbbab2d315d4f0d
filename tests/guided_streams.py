"""Simulated streams, played to a guide portion by portion."""

import numpy as np
from conftest import DEG, config

from session.bench.guide import Guide
from session.bench.messages import Kind
from session.detect.segments import cut_segments
from session.detect.stills import find_stills
from session.io.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.samples import Samples
from tinygc import SimulationOptions
from tinygc.simulation.simulator import simulate_session


def guide_of(segments=40, odr_hz=208.0, **options) -> Guide:
    guide = Guide(config().protocol, segments, **options)
    guide.begin(config(odr_hz=odr_hz).sensor)
    return guide


def play(guide: Guide, samples: Samples, portion: int = 50) -> list:
    changes = []
    for first in range(0, len(samples), portion):
        changes += guide.feed(samples.between(first, first + portion))
    return changes


def said(changes, kind: Kind) -> list[str]:
    return [change.text for change in changes if change.kind is kind]


def simulated(segments=10, **options) -> Samples:
    log = simulate_session(SimulationOptions(segments=segments, closure_s=0.0, **options)).log
    gyro, accel = log.gyro * gyro_rps_per_lsb(500), log.accel * accel_mps2_per_lsb(4)
    return Samples(log.t_us * 1000, gyro, accel, RegisterUnits(DEFAULT, None, None).temperature_c(log.temp.astype(float)))


def offline(samples: Samples, odr_hz=208.0):
    stills, _ = find_stills(samples)
    return cut_segments(samples, stills, config(odr_hz=odr_hz).sensor, config().protocol)


def with_hand(samples: Samples, start_s: float, stop_s: float, dps: float = 0.4) -> Samples:
    """A hand that trembles on the table."""
    gyro, inside = samples.gyro.copy(), (samples.t_s >= start_s) & (samples.t_s < stop_s)
    gyro[inside] += np.random.default_rng(1).normal(size=(inside.sum(), 3)) * dps * DEG
    return Samples(samples.t_ns, gyro, samples.accel, samples.temp_c)
