"""Laws that stand in no catalogue: each is what it says at numbers that a hand can check, and the same seed draws the same."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from session.io.units import DEG, G
from tinygc import SimulationOptions
from tinygc.annexes.challenge.laws import (
    BY_HAND,
    LAWS,
    attitudes,
    beyond_linear,
    lagged,
    last_sign,
    rms,
    running_products,
    seen_by_body,
)
from tinygc.annexes.challenge.rate_effects import Scene
from tinygc.effects import catalogue
from tinygc.simulation.movement import move, table_to_body
from tinygc.simulation.simulator import plan_of, true_signals, unit_of

pytestmark = pytest.mark.broad

OPTIONS = SimulationOptions(segments=6, closure_s=0.0, warm_up_c=10.0, seed=3)


@pytest.fixture(scope="module")
def signals():
    """t, rate, force, temp of a short session on a grid of 500 Hz."""
    plan = plan_of(OPTIONS)
    t = np.arange(-0.2, plan.log_s, 0.002)
    return t, *true_signals(OPTIONS, unit_of(OPTIONS), plan, t)


def law(name, seed=1, strength=1.0):
    return LAWS[name](Scene(np.random.default_rng(seed), strength, OPTIONS, plan_of(OPTIONS)))


# All of them


@pytest.mark.parametrize("name", sorted(LAWS))
def test_each_law_is_finite_bends_the_rate_fades_and_is_seeded(name, signals):
    rate = signals[1]
    strong, weak = ((law(name, 5, strength).distort(*signals) - rate) for strength in (1.0, 0.2))
    assert strong.shape == rate.shape
    assert np.isfinite(strong).all()
    sizes = [rms(beyond_linear(rate, added)) / DEG for added in (strong, weak)]
    assert sizes[0] > 1.5 * sizes[1] > 0
    assert sizes[0] < 1.0
    assert np.array_equal(law(name, 5).distort(*signals) - rate, strong)
    assert not np.array_equal(law(name, 6).distort(*signals) - rate, strong)
    json.dumps(law(name, 5).truth)


def test_no_law_has_an_id_of_the_catalogue():
    assert len(BY_HAND) >= 16
    assert all(name.startswith("law.") for name in LAWS)
    assert not set(LAWS) & set(catalogue())


def test_a_law_only_looks_back(signals):
    """What comes later changes nothing before; a derivative needs its neighbour."""
    t, rate, force, temp = signals
    half = len(t) // 2
    for name in sorted(BY_HAND):
        early = law(name).distort(t[:half], rate[:half], force[:half], temp[:half])
        if law(name).disturb is None:
            assert np.allclose(law(name).distort(*signals)[: half - 1], early[:-1], atol=1e-9), name


# Attitude


def test_attitudes_are_scipy_s_products():
    rng = np.random.default_rng(2)
    t = np.arange(300) * 1e-3
    rate, force = rng.normal(size=(300, 3)), np.tile(rng.normal(size=3), (300, 1))
    whole = attitudes(t, rate, force)
    now = whole[0]
    assert now.apply(force[0]) == pytest.approx([0, 0, np.linalg.norm(force[0])], abs=1e-12)
    for i in range(1, 300):
        now = now * Rotation.from_rotvec((rate[i] + rate[i - 1]) / 2 * 1e-3)
        assert (now.inv() * whole[i]).magnitude() < 1e-12
    q = Rotation.random(7, rng=rng).as_quat()
    expected = Rotation.from_quat(q[0])
    for i, one in enumerate(running_products(q)):
        expected = expected * Rotation.from_quat(q[i]) if i else expected
        assert (expected.inv() * Rotation.from_quat(one)).magnitude() < 1e-12


def test_a_vector_of_the_world_is_seen_as_the_table_s_gimbals_turn_it(signals):
    """The simulation's own kinematics, by another way; the Earth turns by 0.1° meanwhile."""
    t, rate, force, _ = signals
    seen = seen_by_body(np.array([0.0, 0.0, 1.0]), t, rate, force)
    up = table_to_body(move(plan_of(OPTIONS), t).angles, np.array([0.0, 0.0, -1.0]))
    assert np.abs(np.linalg.norm(seen, axis=1) - 1).max() < 1e-12
    assert np.degrees(np.abs(seen - up).max()) < 0.3


# Helpers


def test_a_lag_settles_as_an_exponential():
    t = np.arange(5000) * 1e-3
    y = lagged(t, (t >= 1).astype(float), 0.5)
    assert y[999] == 0
    assert y[1499] == pytest.approx(1 - np.exp(-1), abs=1e-3)


def test_last_sign():
    assert last_sign(np.array([[0.0], [3], [1], [-1], [-4], [2], [0]]), 2.0).ravel().tolist() == [0, 1, 1, 1, -1, -1, -1]


# By hand


def test_the_scale_follows_the_vibration_that_the_accelerometer_feels(signals):
    t, rate, force, temp = signals
    hidden = law("law.vibration_scale")
    shaken = hidden.disturb(t, force) - force
    scale = hidden.distort(t, np.ones_like(rate), force, temp) - 1
    assert scale.mean(axis=0) == pytest.approx(np.array(hidden.truth["per_g2"]) * np.mean((shaken / G) ** 2), rel=0.02)


# Drawn


def test_drawn_laws_have_the_chosen_size_beyond_a_linear_calibration(signals):
    t, rate = signals[:2]
    inside = t >= 0
    for seed in range(12):
        hidden = law("law.random", seed)
        added = (hidden.distort(*signals) - rate)[inside]
        assert rms(beyond_linear(rate[inside], added)) == pytest.approx(hidden.truth["rps_rms"], rel=0.01), hidden.truth
