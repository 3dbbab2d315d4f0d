"""``benchmarks/damaged_sessions.py`` in small: damages that must be refused or warned of, and a session without any."""

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import broad

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))

from damaged_families import FAMILIES
from damaged_sessions import one_case, outcome


def test_many_families_are_tried():
    assert len(FAMILIES) >= 30


@pytest.mark.parametrize(
    ("family", "outcomes"),
    [
        broad("clean", {"silent, right"}),
        ("gyro axes swapped", {"refused"}),
        ("one rate 5 ms late", {"warned, right", "warned, wrong"}),
        broad("accelerometer not calibrated", {"silent, right", "warned, right"}),
    ],
)
def test_a_damaged_session_is_not_certified(family, outcomes):
    case = one_case((family, 10))
    assert outcome(case) in outcomes
    assert (case["z"] is None) == (outcome(case) == "refused")
    if outcome(case).endswith("right"):
        assert np.abs(case["z"]).max() < 3
