"""A public rate table: three gyroscopes, of which two clip and one is an open-loop interferometer."""

import numpy as np
import pytest

from tinygc.annexes.rates.choice import choose
from tinygc.annexes.rates.points import read_points
from tinygc.annexes.rates.terms import terms

pytestmark = pytest.mark.broad


@pytest.fixture(scope="module")
def sensors(shared):
    path = shared / "wild" / "rate_table.csv"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    return {points.sensor.split()[0]: choose(points) for points in read_points(path)[0]}


@pytest.mark.parametrize(("name", "line"), [("TG100", 0.678), ("CRH02", 0.298)])
def test_two_sensors_clip(sensors, name, line):
    choice = sensors[name]
    assert choice.fit.hypothesis.name == "line, clipped below and above"
    assert choice.line.rms == pytest.approx(line, abs=1e-3)
    assert choice.fit.rms < 1e-3
    rows = {row.key: row for row in terms(choice)}
    # the nonlinearity that a line finds is a clip: within the linear range none shows
    assert rows["straight_line"].value > 20
    assert rows["nonlinearity"].value is None
    assert rows["nonlinearity"].at_most < 500


def test_the_interferometer_is_predicted_on_ranges_that_it_was_not_fitted_to(sensors):
    choice = sensors["VG910"]
    assert choice.line.rms == pytest.approx(1.92, abs=0.01)
    assert choice.fit.rms < 0.02
    name = choice.fit.hypothesis.name
    for curve in choice.points.curves[:3]:
        left = {one.hypothesis: one.rms for one in choice.held_out if one.curve == curve}
        assert left[name] < 0.02
        assert left[name] == min(left.values())
    # within its linear part it is a sine: the phase is pi / 2 near 400 °/s
    assert choice.fit.shape[0] * np.pi / 2 == pytest.approx(400, rel=0.05)
