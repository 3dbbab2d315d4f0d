"""How an effect is taken off again: strong ones, such as look around, and those that follow an angular acceleration."""

from dataclasses import replace

import numpy as np
import pytest

from session.io.units import DEG
from tinygc.annexes.challenge.proofs import movement
from tinygc.effects import Effect, EffectError, NoC, Parameter, Reach, ReferenceConditions, diagonal, full, signals
from tinygc.effects.inversion import MOST_PASSES, substituted

AT = ReferenceConditions()
MOVED = movement(104.0, AT)


def effect_of(columns, size: int = 3, **more) -> Effect:
    shape = (3, 3) if size == 9 else (3,)
    return Effect("mine.law", "…", Parameter("dps", shape, "dps", DEG), ("turn",), columns, str, "turn", device=NoC("a test"), **more)


def left_of(effect: Effect, dps, moved=MOVED) -> float:
    """Of what it adds at most."""
    theta = np.array(dps, dtype=float) * DEG
    distorted = effect.distort(moved, theta)
    back = effect.correct(distorted, moved.with_rate(distorted), theta)
    return float(np.abs(back - moved.rate).max() / np.abs(distorted - moved.rate).max())


@pytest.mark.parametrize(
    ("columns", "dps"),
    [
        (lambda m: full(np.clip(m.rate / m.fs_rps, -0.2, 0.2)), [60, -30, 50, 25, 65, -30, 50, 30, -70]),  # a third of the rate, in sum
        (lambda m: diagonal(np.tanh(m.rate / (5 * DEG))), [6, 7, 8]),  # its slope at zero is above 1
        (lambda m: diagonal(m.rate**3 / m.fs_rps**2), [-20 / DEG / 100, 30, 60]),
    ],
)
def test_a_strong_effect_is_taken_off_to_the_last_digit(columns, dps):
    assert left_of(effect_of(columns, len(dps)), dps) < 1e-8


def test_where_it_jumps_the_nearest_rate_is_taken():
    """No rate gives a reading within the jump; the others are undone as if nothing were amiss."""
    effect = effect_of(lambda m: diagonal((m.rate > 20 * DEG).astype(float)))
    theta = np.full(3, 2.0) * DEG
    rate = np.linspace(10, 30, 201)[:, None] * DEG * np.ones(3)
    moved = replace(movement(104.0, AT, 201 / 104.0), rate=rate)
    back = effect.correct(rate, moved, theta)
    gap = (rate[:, 0] > 20 * DEG) & (rate[:, 0] <= 22 * DEG)
    assert np.abs(back + 2 * DEG * (back > 20 * DEG) - rate)[~gap].max() < 1e-9
    assert np.abs(back - rate).max() < 2.1 * DEG


def test_who_looks_around_takes_the_passes_that_it_declares():
    """As many of all rows, so that a log in pieces gives the same, and the declared number is how far it looks."""

    def columns(m):
        return full(signals.lagged(m.rate / m.fs_rps, 0.05, m.t_s))

    dps, reach = np.full(9, 60.0) * np.where(np.eye(3).ravel() > 0, 1, -1), signals.lag_reach(0.05)
    three, twelve = (effect_of(columns, 9, reach=reach, passes=passes) for passes in (None, 12))
    assert left_of(three, dps) > 5e-3
    assert left_of(twelve, dps) < 1e-4
    assert twelve.total_reach(dps).before_s == pytest.approx(4 * three.total_reach(dps).before_s)
    with pytest.raises(EffectError, match=f"passes is 99, expected a number from 1 to {MOST_PASSES}"):
        effect_of(columns, 9, reach=Reach(1), passes=99)


def test_what_does_not_follow_the_rate_is_asked_for_twice():
    asked = []

    def added(moved):
        asked.append(1)
        return 0.01 * moved.force_g

    assert substituted(MOVED.rate, MOVED, added) == pytest.approx(MOVED.rate - 0.01 * MOVED.force_g)
    assert len(asked) == 2


def test_an_angular_acceleration_is_the_same_at_any_data_rate():
    slow, fast = (movement(hz, AT) for hz in (104.0, 833.0))
    there = np.stack([np.interp(slow.t_s, fast.t_s, column) for column in signals.angular_acceleration(fast).T], axis=1)
    assert np.abs(signals.angular_acceleration(slow) - there).max() < 2e-3 * np.abs(there).max()
    noise = np.random.default_rng(0).standard_normal(fast.rate.shape)
    noisy = signals.angular_acceleration(fast.with_rate(noise))
    assert noisy[20:-20].std() < 0.15 * fast.with_rate(noise).acceleration[20:-20].std()
    jerk = signals.angular_jerk(fast)
    assert np.abs(jerk - np.gradient(np.gradient(fast.rate, fast.dt_s, axis=0), fast.dt_s, axis=0)).max() < 0.02 * np.abs(jerk).max()


def test_a_law_of_the_angular_acceleration_is_undone_at_833_hz():
    effect = effect_of(lambda m: diagonal(np.abs(signals.angular_acceleration(m))), reach=signals.DERIVATIVE)
    assert left_of(effect, np.array([1.5e-3, -1e-3, 1.2e-3]) / DEG, movement(833.0, AT)) < 1e-3


def test_the_rate_of_what_moves_begins_without_a_jump():
    dps = np.linspace(0, 6, 1201)
    rate = dps[:, None] * DEG * np.array([0.6, 0.0, 0.8])
    moved = signals.moving_rate(replace(movement(104.0, AT, 1201 / 104.0), rate=rate))
    size = np.linalg.norm(moved, axis=1) / DEG
    assert size[dps <= 1] == pytest.approx(0.0)
    assert size[dps >= 3] == pytest.approx(dps[dps >= 3])
    assert np.diff(size).max() < 4 * np.diff(dps).max()
