"""A curve without a name that does better than every name: then no name is given."""

import numpy as np
import pytest

from session.io.units import DEG
from tinygc import SimulationOptions
from tinygc.explanation.engine import explain_session
from tinygc.simulation.write import write_session

OPTIONS = SimulationOptions(segments=30, closure_s=0.0, warm_up_c=12.0, seed=5)
MIDDLE_C = OPTIONS.temperature_start_c + 6.0
CURVE = np.array([0.002, -0.003, 0.0025]) * DEG  # rad/s per K^2


def explained(folder, distort):
    return explain_session(write_session(OPTIONS, folder / "session", distort=distort))


@pytest.mark.slow
def test_a_zero_with_a_turning_point_in_temperature_is_given_no_name(tmp_path):
    """Steps, drifts and lines can be put together so that they take up 98 % of it: a smooth curve takes up all, with half the numbers."""
    result = explained(tmp_path, lambda t, rate, force, temp: rate + np.outer((temp - MIDDLE_C) ** 2, CURVE))
    assert result.verdict == "unexplained"
    assert result.claimed == []
    assert [finding.effect.id for finding in result.findings] == ["unknown.curve_over_temperature"]


@pytest.mark.slow
def test_a_weak_curve_is_no_step(tmp_path):
    """So weak that a step describes it nearly as well as the curve that it is: a step may stand beside the curve, never alone."""
    result = explained(tmp_path, lambda t, rate, force, temp: rate + np.outer((temp - MIDDLE_C) ** 2, 0.11 * CURVE))
    told = [*result.claimed, *result.findings]
    assert told
    for claim in told:
        assert "unknown.curve_over_temperature" in (claim.effect.id, *claim.equivalent)
