"""Ceilings and plateaus of the rate, and stills that turn: found in the readings, decided by closure."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from numpy.testing import assert_array_equal
from small_turns import PERFECT, angles_by_scipy, small_turns, turned_ends

from session.base import rotation
from session.log.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.explanation import clipped_turns
from tinygc.explanation.clipped_turns import (
    _find_plateaus,
    _plateaus_of,
    about_the_vertical,
    excess_of,
    find_clipping,
    find_reached_ceiling,
)
from tinygc.explanation.data_repair import (
    repair,
)

LSB = 17.5e-3 * DEG
FS = 500 * DEG


def samples_of(gyro):
    return Samples(np.arange(len(gyro)) * 10_000_000, gyro, np.tile([0.0, 0.0, -9.8], (len(gyro), 1)), None)


# Clipping


def strokes(level=200.0, flat=20, ramp=60, rest=100):
    """Three trapezoids on the x axis, dps, between rests, in registers."""
    up = np.linspace(0, level, ramp + 1)[1:-1]
    x = np.concatenate([np.zeros(rest), *[up, np.full(flat, level), up[::-1], np.zeros(rest)] * 3])
    gyro = np.random.default_rng(0).normal(0, 0.05, (len(x), 3))
    gyro[:, 0] += x
    return samples_of(np.rint(gyro / 17.5e-3) * LSB)


def test_a_ceiling_is_a_level_that_is_kept_for_longer_than_noise_keeps_it():
    """With three steps of noise, for seven readings; above a twentieth of full scale; negative ones count as positive; with corners."""
    quiet = strokes()
    level = np.rint(200 / 17.5e-3) * LSB - 2 * LSB
    clipped = replace(quiet, gyro=np.clip(quiet.gyro, -level, level))
    reached, mask = find_reached_ceiling(clipped, FS)
    assert reached == pytest.approx(level)
    at = (np.abs(clipped.gyro) >= level - 1.5 * LSB).any(axis=1)
    assert_array_equal(mask, at)
    short = np.array(clipped.gyro)
    short[50:52, 1], short[55, 2] = -level, level - 2 * LSB  # two readings at it on another axis, and one below
    assert_array_equal(find_reached_ceiling(replace(clipped, gyro=short), FS).mask, at | np.isin(np.arange(len(at)), [50, 51]))
    short[60:62, 1] = level + 2 * LSB  # an axis that exceeds it has no ceiling there
    assert_array_equal(find_reached_ceiling(replace(clipped, gyro=short), FS).mask, at)
    assert find_reached_ceiling(replace(clipped, gyro=-clipped.gyro), FS).level == pytest.approx(level)
    for share, found in ((19.9, True), (20.1, False)):
        assert (find_reached_ceiling(clipped, share * level) is not None) == found
    assert find_reached_ceiling(samples_of(np.zeros((50, 3))), FS) is None


def top(values, noise=0.0, least=1.0, shortest=5.0):
    return [(start, stop) for _, start, stop in _plateaus_of(np.asarray(values, dtype=float), noise, least, shortest)]


FLAT = np.r_[np.zeros(30), np.full(20, 100.0), np.zeros(30)]


@pytest.mark.parametrize(
    ("at", "value", "known", "kept"),
    [
        (slice(30, 30), 0, {"shortest": 20.0}, True),
        (slice(30, 30), 0, {"shortest": 20.5}, False),
        (slice(30, 30), 0, {"least": 99.9}, True),
        (slice(30, 30), 0, {"least": 100.0}, False),
        (slice(35, 37), 98.7, {}, True),  # out of 1.2 %
        (slice(35, 38), 98.7, {}, False),
        (slice(35, 45), 98.81, {}, True),
        (slice(35, 45), 98.7, {"noise": 0.22}, True),  # six of them
        (slice(35, 45), 98.7, {"noise": 0.21}, False),
        (10, 78.3, {}, True),  # 18 times 1.2 below
        (10, 78.5, {}, False),
        (69, 78.3, {}, True),
        (69, 78.5, {}, False),
    ],
)
def test_a_flat_top_stays_within_its_band_for_nine_of_ten_readings_and_falls_beyond(at, value, known, kept):
    values = FLAT.copy()
    values[at] = value
    assert (top(values, **known) == [(30, 50)]) == kept


def test_flat_tops_are_of_strokes_of_half_the_greatest_and_more():
    assert top(np.r_[FLAT, 0.6 * FLAT, 0.49 * FLAT]) == [(30, 50), (110, 130)]


def levels(tops, axes=(0,), fs=500.0):
    gyro = np.random.default_rng(0).normal(0, 1e-4, (80 * len(tops), 3))
    gyro[:, axes] += np.concatenate([FLAT * height / 100 for height in tops])[:, None]
    return _find_plateaus(samples_of(gyro * DEG), fs * DEG)


def test_clipped_strokes_have_one_height_that_none_exceeds():
    level, mask = levels([100, -100.5, 99])
    assert level == pytest.approx(100 * DEG, rel=1e-3)
    assert np.flatnonzero(mask).tolist() == [*range(30, 50), *range(110, 130), *range(190, 210)]
    assert levels([100, 100], axes=(0, 2)) is not None
    for tops, fs, found in (
        ([100, 100, 97.9], 500, False),  # two of three alike, of which three are needed
        ([100, 100, 100, 97.5, 102.5], 500, True),  # three of five
        ([100, 100, 100, 97.5, 102.5, 90], 500, False),
        ([100, 100, 100, 100, 103.9], 500, True),
        ([100, 100, 100, 100, 104.1], 500, False),
        ([100, 100, 100], 1999, True),
        ([100, 100, 100], 2001, False),
    ):
        assert (levels(tops, fs=fs) is not None) == found
    for height, at_it in ((98.1, True), (97.9, False)):
        assert levels([100, 100, 100, height])[1][270:290].tolist() == [at_it] * 20


# Clipping decided by closure


def test_clipped_turns_close_worse_than_the_others_by_the_model_of_the_others():
    """Twelve whole turns at least, else by the model of all; the others count as one at least."""
    batch, sigma = small_turns(count=16, noise_rad=1e-4), np.full((16, 2), 1e-4)
    by = np.zeros((16, 3))
    by[[3, 7]] = [0.03, 0.0, 0.0]
    segments = [SimpleNamespace(number=i + 1) for i in range(16)]
    floor = SimpleNamespace(sigma=sigma)
    problem = SimpleNamespace(batch=turned_ends(batch, by), floor=floor, first=PERFECT, used=segments, still_rates=None)
    hit = np.isin(np.arange(16), [3, 7])

    def sizes(own):
        model = fit_least_squares(problem.batch.pick(own), sigma[own], PERFECT).model
        return np.sqrt(np.mean((angles_by_scipy(problem.batch, model.vector) / sigma) ** 2, axis=1))

    size = sizes(~hit)
    assert np.median(size[~hit]) < 1
    assert excess_of(problem, [4, 8]) == pytest.approx(np.median(size[hit]), rel=1e-3)
    problem.floor.sigma = sigma / 10
    assert excess_of(problem, [4, 8]) == pytest.approx(np.median(size[hit]) / np.median(size[~hit]), rel=1e-3)
    many = [1, 2, 4, 8, 11]  # eleven are left
    assert excess_of(problem, many) == pytest.approx(np.median(10 * sizes(hit | ~hit)[np.subtract(many, 1)]), rel=1e-3)
    assert np.isnan(excess_of(problem, [99]))


def test_a_motor_turns_at_one_rate_and_is_not_clipped():
    """Its strokes are flat and alike, but its segments close.  The height of a stroke of two samples is one of its readings."""
    table = Table().rest(3)
    for number, axis in enumerate(((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1)) * 2):
        table.steady(70, axis, 1.2 + 0.1 * number).rest(3)
    samples = table.samples()
    assert _find_plateaus(samples, FS).level == pytest.approx(70 * DEG, rel=0.03)
    problem = build_problem(session_of(samples))
    found = find_clipping(problem)
    assert (found.confirmed, found.known_to) == (False, pytest.approx(0.02 * found.level))
    assert "gyro.saturation" not in repair(problem).found
    assert _find_plateaus(Table().rest(4).steady(200, (1, 0, 0), 0.011).rest(4).samples(), FS) is None


def test_a_still_turns_if_its_rate_is_ten_times_the_scatter_of_all_and_along_gravity():
    """Of a normal error in three axes, the median length is 1.54 sigmas; the bias that all have in common is none of it."""
    rate = np.kron(1.54 * np.eye(3), [[1.0], [-1.0], [1.0], [-1.0]])
    further = np.array([[0, 0, 9.9], [0, 0, -10.1], [0, 10.1, 10.1], [0, 3.6, -11.0], [0, -10.1, 0], [0, 0, -9.9]])
    rate = np.concatenate([rate, further]) * DEG + [0.3, -0.2, 5.0]
    fallen = rotation.exp(np.array([np.pi / 2, 0, 0]))  # whose z axis is level
    for q, expected in (([1.0, 0, 0, 0], [14, 16]), (fallen, [17])):
        twin = SimpleNamespace(start=lambda: None, residuals=lambda state: SimpleNamespace(still=rate), q_tb=np.tile(q, (len(rate), 1)))
        stills = [SimpleNamespace(problem="moves"), *(SimpleNamespace(problem=None) for _ in rate)]
        with patch.object(clipped_turns, "Twin", return_value=twin):
            assert about_the_vertical(SimpleNamespace(stills=stills)) == expected


def test_a_still_that_turns_about_the_vertical_is_rejected():
    """Gravity does not move in it: the gyro alone shows it, beside stills that agree; one that creeps is told beside it."""
    table, slow = Table().rest(2), []
    for number in range(12):
        table.turn(90 + 20 * (number % 3), np.random.default_rng(number).normal(size=3))
        if number == 5:
            start = table.duration_s
            _, attitude = table.truth(np.array([start]))
            table.steady(0.35, attitude[0].inv().apply([0, 0, 1]), 2.0)
            slow = [start, table.duration_s]
        else:
            table.rest(2)
    problem = build_problem(session_of(table.samples(gyro_mdps=1.0)))
    (moving,) = about_the_vertical(problem)
    still = problem.stills[moving]
    assert slow[0] - 0.5 < still.start_s < slow[1]
