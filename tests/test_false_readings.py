"""What a broken interface really writes: values of its own in each sample, zeros or ones in all channels, the last row again."""

from dataclasses import replace

import numpy as np
import pytest

from session.io.units import DEG
from tinygc.explanation.faulty_readings import find_glitches, without_glitches


@pytest.fixture(scope="module")
def samples():
    from conftest import Table

    table = Table().rest(3)
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)):
        table.turn(120, axis).rest(3)
    return table.samples(odr_hz=208)


def spoilt(samples, rows, kind, rng):
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    for row in rows:
        if kind == "differing":
            gyro[row : row + 3] += rng.choice([-1, 1], (3, 3)) * rng.uniform(20, 70, (3, 3)) * DEG
        elif kind == "one axis":
            gyro[row : row + 2, rng.integers(3)] += rng.choice([-1, 1], 2) * rng.uniform(20, 70, 2) * DEG
        elif kind == "zeros":
            gyro[row : row + 2], accel[row : row + 2] = 0, 0
        elif kind == "stuck":
            gyro[row : row + 5], accel[row : row + 5] = gyro[row - 1], accel[row - 1]
    return replace(samples, gyro=gyro, accel=accel)


@pytest.mark.parametrize(
    ("kind", "length", "accel"), [("differing", 3, False), ("one axis", 2, False), ("zeros", 2, True), ("stuck", 5, True)]
)
def test_false_readings_of_every_kind_are_found_and_bridged(samples, kind, length, accel):
    rows = np.array([200, 610, 1000, 1450, 2200, 2900])
    bad = spoilt(samples, rows, kind, np.random.default_rng(4))
    glitches = find_glitches(bad)
    np.testing.assert_array_equal(glitches.rows, rows)
    np.testing.assert_array_equal(glitches.samples, length)
    assert (glitches.accel == accel).all()
    repaired = without_glitches(bad, glitches)
    inside = (rows[:, None] + np.arange(length)).ravel()
    assert np.abs(repaired.gyro - samples.gyro)[inside].max() < 2 * DEG  # a line over 30 ms of a turn, and noise
    others = np.delete(np.arange(len(samples)), inside)
    np.testing.assert_array_equal(repaired.gyro[others], samples.gyro[others])
    np.testing.assert_array_equal(repaired.accel[others], samples.accel[others])
