"""Still phases of a played table: found where it rested, and nothing taken for rest that is none; thresholds: test_stills_exact.py."""

import numpy as np
import pytest
from conftest import Table, broad

from session.detect.stills import find_stills
from session.io.samples import Samples
from session.io.units import MDPS, MG

BENCHES = [(100.0, 10.0), (208.0, 5.0), (208.0, 3.0), (833.0, 5.0), (1600.0, 7.0)]


def edges(samples, stills):
    return np.array([[still.start_s, still.start_s + still.duration_s] for still in stills])


@pytest.mark.parametrize(("odr_hz", "mdps"), BENCHES)
def test_every_rest_is_found_and_its_edges_are_right(odr_hz, mdps):
    table = Table().tumble(10, rest_s=1.6, seed=1)
    samples = table.samples(odr_hz, mdps, seed=1)
    stills, _ = find_stills(samples)
    assert [still.problem for still in stills] == [None] * len(table.rests)
    np.testing.assert_allclose(edges(samples, stills), table.rests, atol=0.2)


@pytest.mark.parametrize(("odr_hz", "mdps", "ug"), [(100.0, 10.0, 120.0), (208.0, 5.0, 60.0), broad(1600.0, 3.0, 60.0)])
def test_the_noise_densities_are_recovered(odr_hz, mdps, ug):
    """168 s of rest tell them to 3 % an axis (1 sigma), three axes to 2 %."""
    _, noise = find_stills(Table().tumble(20, rest_s=8.0).samples(odr_hz, mdps, ug, registers=False))
    for found, true in ((noise.gyro / MDPS, mdps), (noise.accel / MG * 1e3, ug)):
        np.testing.assert_allclose(found, true, rtol=0.1)
        assert np.mean(found) == pytest.approx(true, rel=0.06)


def covered(samples, stills, start, stop):
    """Seconds of (start, stop) that lie in good stills."""
    good = edges(samples, [still for still in stills if still.problem is None])
    return np.clip(np.minimum(good[:, 1], stop) - np.maximum(good[:, 0], start), 0, None).sum()


@pytest.mark.parametrize("axis", [(1, 0, 0), (1, 1, 0)])
def test_a_slow_creep_between_turns_is_no_reference(axis):
    """0.1 dps about a horizontal axis turns gravity by 0.2 deg in 2 s: sixteen times what a segment closes to."""
    table = Table().rest(2).turn(80, (1, 0, 0)).rest(2).turn(-80, (1, 0, 0))
    start = table.duration_s
    table.steady(0.1, axis, 2.0).turn(-120, (0, 1, 0)).rest(2).turn(50, (0, 0, 1)).rest(2)
    samples = table.samples()
    stills, _ = find_stills(samples)
    assert covered(samples, stills, start, start + 2.0) == 0
    (creeping,) = [still for still in stills if still.problem]
    assert float(creeping.problem.split()[1]) == pytest.approx(0.1, abs=0.02)
    assert start - 0.1 < creeping.start_s < start + 0.3
    for rest in table.rests:
        assert covered(samples, stills, *rest) > 1.6


@pytest.mark.parametrize("dps", [-10.0, 40.0])
def test_a_steady_turn_about_the_vertical_is_no_still(dps):
    """Gravity does not move in it and its rate is as quiet as rest: only the rest of the log tells."""
    table = Table().rest(2).turn(90, (1, 0, 0)).rest(2).turn(-90, (1, 0, 0)).rest(2)
    start = table.duration_s
    table.steady(dps, (0, 0, 1), 5.0).rest(2).turn(50, (0, 1, 0)).rest(2)
    samples = table.samples()
    stills, _ = find_stills(samples)
    np.testing.assert_allclose(edges(samples, stills), table.rests, atol=0.2)
    assert all(still.start_s + still.duration_s < start + 0.2 or still.start_s > start + 4.8 for still in stills)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1)])
def test_a_log_that_never_rests_has_no_still(axis):
    table = Table()
    for i in range(20):
        table.turn(150 * (-1) ** i, np.roll(axis, i), 2.5)
    stills, noise = find_stills(table.samples())
    assert [still for still in stills if still.problem is None] == []
    assert noise is None


@pytest.mark.parametrize("count", [0, 1, 2, 5, 30])
def test_a_log_of_a_few_samples_has_no_stills_and_no_failure(count):
    samples = Table().rest(1).samples().between(0, max(count, 2))
    assert find_stills(samples) == ([], None)


def test_registers_that_never_move_hold_no_stills():
    """A sensor without noise is a sensor that does not answer: nothing is rest, and no noise is claimed."""
    samples = Table().rest(10).samples()
    frozen = Samples(samples.t_ns, np.zeros_like(samples.gyro), np.zeros_like(samples.accel) + np.array([0, 0, -9.8]))
    assert find_stills(frozen) == ([], None)
