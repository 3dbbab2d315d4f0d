"""What is bridged is no claim: in a log with gaps, a clipped peak or impacts, nothing of it is named as the sensor's physics."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from test_bridges import fast_rows

from tinygc import SimulationOptions, read_session
from tinygc.explanation.engine import explain_session
from tinygc.explanation.result import to_json
from tinygc.simulation.write import write_session

NOT_THERE = {"timing.dropped_samples", "data.glitches", "gyro.saturation"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    chosen = SimulationOptions(segments=24, closure_s=0.0, seed=5, odr_hz=104.0)
    return write_session(chosen, tmp_path_factory.mktemp("bridged") / "unit")


def said(folder, change) -> dict:
    session = read_session(folder)
    (log,) = session.logs
    return to_json(explain_session(replace(session, logs=(replace(log, samples=change(log.samples)),))))


def with_gaps(samples):
    keep = np.ones(len(samples), dtype=bool)
    for number, row in enumerate(fast_rows(samples, 10, 2, 40.0)):
        keep[row : row + 1 + number % 3] = False
    return replace(samples, t_ns=samples.t_ns[keep], gyro=samples.gyro[keep], accel=samples.accel[keep], temp_c=samples.temp_c[keep])


def with_a_jolt(samples):
    gyro = samples.gyro.copy()
    gyro[fast_rows(samples, 10, 2, 40.0)[4], 2] = 32767 * 17.5e-3 * DEG
    return replace(samples, gyro=gyro)


def with_impacts(samples):
    accel = samples.accel.copy()
    for row in fast_rows(samples, 6, 3, 40.0):
        accel[row] *= 3.5
    return replace(samples, accel=accel)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "cause"), [(with_gaps, "gap"), (with_a_jolt, "clipped"), (with_impacts, "impact")], ids=["gaps", "jolt", "impacts"]
)
def test_nothing_is_named_that_is_not_there_and_what_was_done_is_said(folder, change, cause):
    table = said(folder, change)
    named = {effect["id"] for effect in table["effects"]}
    assert not named & NOT_THERE
    assert table["verdict"] == "no_mismatch"
    assert any(warning["what"] == f"weighed down ({cause})" for warning in table["warnings"])
