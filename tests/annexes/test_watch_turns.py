"""Turns between two rests as closures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import DEG
from watched import RATE_HZ, G, flat, known, of_kind, turning, watched

from tinygc.annexes.watch.turns import Turn, TurnTest
from tinygc.attitude import rotation
from tinygc.models.linear import LinearModel


def test_a_turn_is_the_product_of_its_steps():
    rng, turn = np.random.default_rng(1), Turn()
    omega, dt = rng.normal(size=(200, 3)), np.full(200, 0.01)
    for part in (slice(0, 1), slice(1, 77), slice(77, 200)):
        turn.add(omega[part], omega[part], dt[part])
    expected = rotation.compose(rotation.steps(omega[None], dt[None, 1:]))[0]
    np.testing.assert_allclose(np.abs(turn.q @ expected), 1, atol=1e-12)
    assert turn.seconds == pytest.approx(1.99)


def test_its_slope_is_that_of_the_attitude():
    """Against finite differences of each element of E, and of a zero."""
    measured, dt = 2 * np.sin(np.arange(400)[:, None] / [50, 70, 90] + [0, 1, 2]), np.full(400, 0.0025)

    def end(E: np.ndarray, zero: np.ndarray) -> Turn:
        turn = Turn()
        turn.add(measured @ E.T + zero, measured, dt)
        return turn

    base = end(np.eye(3), np.zeros(3))
    step = 1e-6
    for k in range(9):
        E = np.eye(3)
        E.flat[k] += step
        moved = rotation.log(rotation.multiply(end(E, np.zeros(3)).q, rotation.conjugate(base.q))) / step
        np.testing.assert_allclose(moved, base.slope[:, k], atol=0.01 * np.abs(base.slope).max())
    for k in range(3):
        moved = rotation.log(rotation.multiply(end(np.eye(3), step * np.eye(3)[k]).q, rotation.conjugate(base.q))) / step
        np.testing.assert_allclose(moved, base.lever[:, k], atol=0.01)


def closures(count: int, seed: int, E_sigma: float, noise: float, wider: float = 1.0) -> tuple[np.ndarray, list[bool]]:
    """Chi-squares of turns of one stream, drawn from the stated errors; wider: of the noise that each turn has."""
    rng = np.random.default_rng(seed)
    expected = flat(
        parameters=np.diag(np.r_[np.full(9, E_sigma**2), np.zeros(3)]),
        accel_offset=np.full(3, 0.005),
        turn_rad=noise,
        white=np.full(3, 1e-9),
        accel_attitude=0.0,
        accel_white=np.full(3, 1e-9),
    )
    test = TurnTest(expected, 1e6)
    prior = np.linalg.cholesky(test.P + 1e-30 * np.eye(12))
    error = prior @ rng.normal(size=12)
    squares, alarms = [], []
    for _ in range(count):
        turn = Turn()
        axis = rng.normal(size=3)
        rate = np.ones((60, 1)) * axis / np.linalg.norm(axis) * rng.uniform(0.5, 3)
        turn.add(rate, rate, np.full(60, 0.05))
        R = rotation.matrix(turn.q)
        start = rng.normal(size=3)
        start /= np.linalg.norm(start)
        tilt = turn.slope @ error[:9] + wider * noise * rng.normal(size=3)
        end = R.T @ rotation.matrix(rotation.exp(tilt)) @ start  # the true rotation is the integrated one less its error
        found = test.judge(turn, start + error[9:] / G, end + error[9:] / G, 0.0, 1.92)
        squares.append(found.square)
        alarms.append(found.alarm)
    return np.array(squares), alarms


def test_turns_with_the_stated_errors_have_the_stated_chi_square():
    """One draw of E for each stream: the mean of 2 degrees of freedom, turn after turn."""
    squares = np.array([closures(12, seed, 3e-4, 2e-4)[0] for seed in range(40)])
    assert squares.mean() == pytest.approx(2.0, abs=5 * 2 / np.sqrt(squares.size))
    assert squares[:, 0].mean() == pytest.approx(2.0, abs=5 * 2 / np.sqrt(40))
    assert squares[:, -1].mean() == pytest.approx(2.0, abs=5 * 2 / np.sqrt(40))


def test_turns_that_close_worse_alarm_and_others_do_not():
    assert not any(closures(100, 1, 3e-4, 2e-4)[1])
    assert any(closures(60, 1, 3e-4, 2e-4, wider=4.0)[1])


def test_one_turn_alone_never_alarms():
    assert closures(1, 3, 3e-4, 2e-4, wider=1000.0)[1] == [False]


def test_turns_of_a_stream_close_and_a_scale_error_shows():
    _, good = watched(turning(8, 1))
    turns = of_kind(good, "turn")
    assert len(turns) == 8
    assert [event.table["angle_deg"] for event in turns] == pytest.approx([180] * 8, abs=2)
    assert all(event.table["chi_square"] < 14 for event in turns)
    assert not of_kind(good, "alarm")
    _, bad = watched(turning(8, 1, scale=(1.02, 0.98, 1.01)))
    alarms = of_kind(bad, "alarm")
    assert alarms
    assert {event.table["channel"] for event in alarms} == {"closure"}


def test_the_model_is_applied():
    """A sensor with a scale error of 3 % closes by the model that corrects it."""
    E = np.diag([1 / 1.03, 1 / 0.97, 1.0])
    _, events = watched(turning(6, 2, scale=(1.03, 0.97, 1.0)), known=known(model=LinearModel(E, np.zeros(3))))
    assert len(of_kind(events, "turn")) == 6
    assert not of_kind(events, "alarm")


def test_the_zero_of_the_rest_is_taken_off():
    """0.05 dps over a turn of 3 s would be 0.15°."""
    readings = turning(3, 3)
    _, events = watched(dataclasses.replace(readings, gyro=readings.gyro + 0.05 * DEG))
    assert all(event.table["tilt_deg"] < 0.05 for event in of_kind(events, "turn"))


def test_a_hand_that_begins_and_ends_softly_closes():
    """Blocks in which it turns slower than a rest may: they are of the turn, not of the rests beside it."""
    _, events = watched(turning(3, 4, turn_s=30.0, rest_s=6.0))
    turns = of_kind(events, "turn")
    assert len(turns) == 3
    assert all(event.table["chi_square"] < 14 for event in turns)
    assert all(event.table["angle_deg"] == pytest.approx(180, abs=2) for event in turns)


def test_what_hardly_turns_is_no_turn():
    _, events = watched(turning(2, 5, angle_deg=5.0))
    assert not of_kind(events, "turn")


# What was found in use


def test_a_turn_states_the_sum_of_its_errors():
    """Without E and a zero of the accelerometer: readings of both rests, white noise, the turn's own, the Earth, the lever of the zero."""
    expected = flat(
        parameters=np.zeros((12, 12)),
        white=np.array([2e-4, 1e-4, 3e-4]),
        attitude=np.full(3, 4e-5),
        turn_rad=5e-4,
        accel_white=np.array([1e-3, 2e-3, 1e-3]),
        accel_attitude=3e-3,
        accel_offset=np.zeros(3),
    )
    turn = Turn()
    turn.add(np.tile([0.0, 0.0, 0.5], (401, 1)), np.zeros((401, 3)), np.full(401, 0.01))  # 4 s about the vertical, E without a slope
    own = (3e-4**2) * 4.0 + (4e-5 * 4.0) ** 2 + 5e-4**2 + 2 * (3e-3**2 + 2e-3**2 / 2.0) / G**2
    lever2 = (2 * np.sin(0.5 * 4.0 / 2) / 0.5) ** 2  # s^2: |integral of a vector that turns with 0.5 rad/s|
    down = np.array([0.0, 0.0, -1.0])
    for variance in (0.0, 1e-8):
        found = TurnTest(expected, 1e6).judge(turn, down, down, variance, 2.0)
        assert found.sigma_rad == pytest.approx(np.sqrt(own + variance * lever2), rel=1e-4)


@pytest.mark.parametrize("alarm", [False, True])
def test_a_turn_is_taken_by_the_textbooks_filter_and_an_alarm_opens_it(alarm):
    """By as much as the turn's square is of what the prior makes of it; a quarter turn about x, with z down before it."""
    none, prior = np.zeros(3), np.diag(np.r_[np.full(9, 1e-4**2 + 2e-4**2), np.full(3, 0.02**2)])
    expected = flat(white=none, attitude=none, turn_rad=5e-4, accel_white=none, accel_attitude=0.0)
    test, turn = TurnTest(expected, 1e6), Turn()
    assert pytest.approx(prior) == test.P
    turn.add(np.tile([np.pi / 2, 0, 0], (101, 1)), np.tile([np.pi / 2, 0, 0], (101, 1)), np.full(101, 0.01))
    R = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    down, tilt = np.array([0, 0, -1.0]), np.array([0.0, 2.5e-3, 0])
    test.sum = test.bar if alarm else 0.0
    found = test.judge(turn, down, R.T @ (down + np.cross(tilt, down)), 0.0, 2.0)
    y, H = tilt[:2] / np.hypot(1, 2.5e-3), np.zeros((2, 12))
    H[:, :9] = turn.slope[:2]
    H[:, 9:] = np.array([[0.0, 1, 0], [-1, 0, 0]]) @ (R - np.eye(3)) / G  # down x v
    share = (y @ y) / np.trace(H[:, :9] @ prior[:9, :9] @ H[:, :9].T) if alarm else 0.0

    def scatter(P):
        return H @ P @ H.T + (expected.turn_rad**2 + np.trace(turn.slope @ P[:9, :9] @ turn.slope.T) ** 2) * np.eye(2)

    square = y @ np.linalg.solve(scatter(prior), y)
    assert (found.square, found.alarm) == (pytest.approx(square, rel=1e-4), alarm)
    assert found.sigma_rad == pytest.approx(np.sqrt(np.trace(scatter(prior)) / 2), rel=1e-6)
    assert test.sum == pytest.approx(0.0 if alarm else max(0.0, 0.375 * square - 2 * np.log(2)), rel=1e-4)
    P = (1 + share) * prior
    gain = P @ H.T @ np.linalg.inv(scatter(P))
    assert test.x == pytest.approx(gain @ y, rel=1e-3, abs=1e-9)
    assert pytest.approx(P - gain @ H @ P, rel=1e-6, abs=1e-15) == test.P


def test_a_scale_that_has_changed_alarms_once_or_twice_and_is_followed():
    """After an alarm the turns are held against the E that they show."""
    readings, zero = turning(30, 1, scale=(1.03, 0.97, 1.02)), np.array([2.0, -2.0, 1.0]) * DEG
    used = known(model=LinearModel(np.eye(3), -zero))
    _, events = watched(dataclasses.replace(readings, gyro=readings.gyro + zero), known=used)
    alarms, turns = of_kind(events, "alarm"), of_kind(events, "turn")
    assert 1 <= len(alarms) <= 2
    assert np.mean([event.table["chi_square"] for event in turns[-10:]]) < 6


def test_a_zero_that_jumps_within_a_turn_is_no_closure():
    readings = turning(12, 1)
    rate = readings.gyro.copy()
    rate[round(22.5 * RATE_HZ) :] += 1.0 * DEG  # within the third turn
    _, events = watched(dataclasses.replace(readings, gyro=rate))
    assert all(event.table["chi_square"] < 14 for event in of_kind(events, "turn"))
    assert {event.table["channel"] for event in of_kind(events, "alarm")} <= {"zero x", "zero y", "zero z"}
    assert len(of_kind(events, "alarm")) == 1
