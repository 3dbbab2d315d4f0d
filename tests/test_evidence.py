"""The evidence of a hypothesis: the true name has the most of it."""

import numpy as np
import pytest
from explained_sessions import lagging, warm
from simulated_twins import make_twin_of

from tinygc.effects import catalogue
from tinygc.explanation.evidence import Evidence

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
G_SENSITIVITY, ASYMMETRY = "gyro.g_sensitivity", "gyro.scale_asymmetry"


@pytest.fixture(scope="module")
def evidence_of(twin_of):
    """Of a small session, made once for each thing that is concealed in it."""
    made = {}

    def make(distort=None, **options) -> Evidence:
        key = distort, tuple(options.items())
        if key not in made:
            made[key] = Evidence(twin_of(distort, **{"segments": 16, "seed": 5, **options})[0])
        return made[key]

    return make


def hypothesis(evidence, *names):
    return evidence.of(tuple(catalogue()[name] for name in names), evidence.nothing)


@pytest.mark.parametrize(
    ("distort", "options", "true", "alike"),
    [
        (lagging, {}, "gyro.bandwidth", "gyro.angular_acceleration"),
        (warm, {"warm_up_c": 12.0}, "gyro.thermal_bias", "gyro.bias_drift"),
    ],
)
def test_the_true_one_of_two_lookalikes_has_more_evidence_where_it_is_strong(evidence_of, distort, options, true, alike):
    """Odds of twenty at least, and both are better than nothing."""
    evidence = evidence_of(distort, **options)
    right, wrong = hypothesis(evidence, true), hypothesis(evidence, alike)
    assert right.score < wrong.score - 2 * np.log(20)
    assert wrong.score < evidence.nothing.score
