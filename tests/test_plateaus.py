"""Rates that are clipped before the linear errors, the filter and the noise: no register value repeats."""

import pytest
from conftest import Table
from spoilt_registers import session_of_logs

from session.io.units import DEG
from tinygc.closure.build import build_problem
from tinygc.explanation.clipped_turns import find_plateaus
from tinygc.explanation.data_repair import repair

FS = 500 * DEG


def test_a_motor_turns_at_one_rate_and_is_not_clipped():
    """Its strokes are flat and alike, but its segments close."""
    table = Table().rest(3)
    for number, axis in enumerate(((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)) * 3):
        table.steady(70, axis, 1.2 + 0.1 * number).rest(3)
    samples = table.samples(odr_hz=208)
    ceiling = find_plateaus(samples, FS)
    assert ceiling.level == pytest.approx(70 * DEG, rel=0.03)
    assert "gyro.saturation" not in repair(build_problem(session_of_logs(samples))).found


def test_a_stroke_of_two_samples_is_looked_at_like_any_other():
    """The height of a stroke is one of its readings, not a value between two."""
    samples = Table().rest(4).steady(200, (1, 0, 0), 0.011).rest(4).samples(odr_hz=208)
    assert find_plateaus(samples, FS) is None
