"""Signals with a memory: known answers, the same at any data rate, in thinned rows, without a temperature."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG
from scipy.spatial.transform import Rotation

from tinygc.effects import Movement, signals
from tinygc.effects.catalogue import short_movement


def hand(rate_hz: float = 208.0, length_s: float = 40.0, began_s: float = 0.0) -> Movement:
    """A still of two seconds, ten turns of three seconds about changing axes with a rest of one after each, warming up."""
    t_s = began_s + np.arange(0, length_s, 1 / rate_hz)
    since = np.clip(t_s - 2, 0, None)
    along, number = np.minimum(since % 4, 3), np.minimum(since // 4, 9).astype(int)
    axes = Rotation.random(10, random_state=3).as_matrix()[:, 0]
    rate = 90 * DEG * np.sin(np.pi * along / 3)[:, None] * axes[number]
    temp_c = 25 + 5 * -np.expm1(-np.maximum(t_s, 0) / 30)
    force = np.tile([0.3, -0.2, -0.93], (len(t_s), 1))
    return Movement(t_s, 1 / rate_hz, rate, force, temp_c, 0 * t_s, length_s, 500 * DEG, 25.0)


def test_a_lag_of_a_ramp_is_the_ramp_late_by_tau():
    t_s = np.arange(0, 30, 0.01)
    late = signals.lagged(2 * t_s, 1.5, t_s)
    assert np.abs(late[1000:] - 2 * (t_s[1000:] - 1.5)).max() < 0.01
    # Exactly, with what is left of the beginning: dy/dt = (x - y) / tau from y(0) = 0.
    assert late == pytest.approx(2 * (t_s - 1.5 * -np.expm1(-t_s / 1.5)), abs=1e-9)


def test_a_lag_begins_as_if_nothing_had_changed():
    assert signals.lagged(np.full((50, 3), 7.0), 0.5, np.arange(50) / 104) == pytest.approx(np.full((50, 3), 7.0), abs=1e-12)


def test_a_lag_looks_back_no_farther_than_its_reach():
    t_s, rng = np.arange(0, 60, 0.01), np.random.default_rng(0)
    values = rng.normal(size=len(t_s))
    behind, ahead = signals.lag_reach(0.5).rows(100.0)
    other = values.copy()
    other[: len(t_s) - behind - 1] = rng.normal(size=len(t_s) - behind - 1)
    assert ahead == 0
    assert abs(signals.lagged(values, 0.5, t_s)[-1] - signals.lagged(other, 0.5, t_s)[-1]) < 1e-11


def test_a_lag_of_rows_that_are_not_equally_far_apart_is_that_of_all_rows():
    """As the twin has long rests: a row a second, turns in full."""
    t_s = np.arange(0, 60, 0.01)
    values = np.where((t_s > 20) & (t_s < 25), np.sin(t_s * 3), 0.0)
    keep = np.flatnonzero(((t_s > 19.5) & (t_s < 25.5)) | (np.arange(len(t_s)) % 100 == 0))
    whole, thin = signals.lagged(values, 2.0, t_s), signals.lagged(values[keep], 2.0, t_s[keep])
    assert np.abs(thin - whole[keep]).max() < 1e-9


@pytest.mark.parametrize("values", [np.full(50, np.nan), np.where(np.arange(50) == 20, np.nan, 3.0)], ids=["none", "a gap"])
def test_a_lag_of_what_is_not_known_is_not_known_there_alone(values):
    found = signals.lagged(values, 0.1, np.arange(50) / 104)
    assert np.array_equal(np.isnan(found), np.isnan(values))
    assert found[np.isfinite(values)] == pytest.approx(3.0)


def test_the_rate_of_temperature_of_a_ramp_and_of_none():
    movement = hand()
    ramp = replace(movement, temp_c=25 + 0.3 * movement.t_s)
    assert signals.temperature_rate(ramp)[movement.t_s > 10.01] == pytest.approx(0.3, abs=1e-9)
    assert signals.temperature_rate(replace(movement, temp_c=np.full(len(movement.t_s), 31.0))) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(signals.temperature_rate(replace(movement, temp_c=np.full(len(movement.t_s), np.nan)))).all()


def test_the_rate_of_temperature_looks_back_no_farther_than_its_reach():
    movement = hand()
    behind, ahead = signals.SLOPE.rows(208.0)
    other = movement.temp_c.copy()
    other[: len(other) - behind - 1] += 7.0
    assert ahead == 0
    assert abs(signals.temperature_rate(replace(movement, temp_c=other))[-1] - signals.temperature_rate(movement)[-1]) < 1e-9


def test_seconds_at_rest_count_from_the_end_of_a_turn():
    movement = hand(began_s=100.0)
    movement = replace(
        movement, rate=np.where(((movement.t_s > 105) & (movement.t_s < 107))[:, None], [0.0, 0.5, 0.0], [0.01, 0.02, -0.01])
    )
    rest, t_s = signals.seconds_at_rest(movement), movement.t_s
    assert rest[t_s <= 105] == pytest.approx(t_s[t_s <= 105] - 100)  # it has not turned yet
    assert not rest[(t_s > 105) & (t_s < 107)].any()
    assert rest[t_s > 107.01] == pytest.approx(t_s[t_s > 107.01] - 107, abs=0.01)


def test_the_last_sense_stays_after_a_turn_and_is_nothing_before_one():
    movement = hand()
    sense, size = signals.last_sense(movement), np.abs(movement.rate)
    assert set(np.unique(sense)) <= {-1.0, 0.0, 1.0}
    assert not sense[movement.t_s < 2].any()
    turning = size > signals.TURNING_RPS
    assert np.array_equal(sense[turning], np.sign(movement.rate[turning]))
    for axis in range(3):
        last = np.maximum.accumulate(np.where(turning[:, axis], np.arange(len(size)), -1))
        assert np.array_equal(sense[last >= 0, axis], np.sign(movement.rate[last[last >= 0], axis]))


def test_a_latch_keeps_the_sign_of_what_was_last_beyond_its_threshold():
    values = np.array([0.0, 0.9, 1.1, 0.2, -0.9, -1.2, 0.0, 1.0, 3.0, -0.5])
    expected = [0, 0, 1, 1, 1, -1, -1, -1, 1, 1]
    assert signals.latched(values, 1.0).tolist() == expected
    assert signals.latched(np.outer(values, [1.0, -1.0]), 1.0).T.tolist() == [expected, [-each for each in expected]]


def test_the_angle_turned_about_one_axis_is_that_angle():
    movement = hand()
    turned = signals.angle_turned(replace(movement, rate=np.outer(np.sin(movement.t_s), [1.0, 0, -2.0])))
    assert turned == pytest.approx(np.outer(1 - np.cos(movement.t_s), [1.0, 0, -2.0]), abs=1e-4)


@pytest.mark.broad
def test_level_directions_by_another_program():
    """scipy's rotations, step by step, from gravity at the beginning."""
    movement = hand(208.0, 20.0)
    up = -movement.force_g[0] / np.linalg.norm(movement.force_g[0])  # the specific force at rest points against z, which is down
    first = np.cross(np.cross(up, [1.0, 0, 0]), up)
    first /= np.linalg.norm(first)
    attitude, expected = Rotation.identity(), []
    for number, rate in enumerate(movement.rate):
        if number:
            attitude *= Rotation.from_rotvec((rate + movement.rate[number - 1]) / 2 / 208)
        expected.append(attitude.inv().apply([first, np.cross(up, first)]).T)
    assert signals.level_directions(movement) == pytest.approx(np.array(expected), abs=1e-9)


def test_level_directions_stay_level_and_at_right_angles():
    movement = hand(208.0, 20.0)
    x, y = np.moveaxis(signals.level_directions(movement), 2, 0)
    assert np.linalg.norm(x, axis=1) == pytest.approx(1.0)
    assert np.abs(np.sum(x * y, axis=1)).max() < 1e-12
    still = movement.t_s < 2
    assert np.abs(np.sum(x * movement.force_g, axis=1)[still]).max() < 1e-9


@pytest.mark.parametrize("name", ["seconds_at_rest", "last_sense", "angle_turned", "level_directions", "temperature_rate"])
def test_signals_are_those_of_a_finer_grid_that_begins_before_the_log(name):
    """The simulation's: so many points for each sample, from 0.2 s before the first on."""
    signal, coarse = getattr(signals, name), hand(208.0)
    fine = hand(208.0 * 8, 40.2, began_s=-0.2)
    at = np.searchsorted(fine.t_s, coarse.t_s - 1e-9)
    differs = np.abs(signal(fine)[at] - signal(coarse)).reshape(len(at), -1).max(axis=1)
    # A threshold is crossed between two samples: then they differ for one of them.
    assert np.quantile(differs, 0.99) < 1 / 208
    assert np.mean(differs > 0.05) < 0.01


@pytest.mark.parametrize("name", ["seconds_at_rest", "last_sense", "angle_turned", "level_directions", "temperature_rate"])
def test_signals_of_a_short_movement_are_finite(name):
    assert np.isfinite(getattr(signals, name)(short_movement())).all()
