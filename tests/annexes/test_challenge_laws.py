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
    draw_expression,
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

OPTIONS = SimulationOptions(segments=6, closure_s=0.0, warm_up_c=10.0, seed=3)
FULL_SCALE = OPTIONS.gyro_fs_dps * DEG


@pytest.fixture(scope="module")
def signals():
    """t, rate, force, temp of a short session on a grid of 500 Hz."""
    plan = plan_of(OPTIONS)
    t = np.arange(-0.2, plan.log_s, 0.002)
    return t, *true_signals(OPTIONS, unit_of(OPTIONS), plan, t)


def law(name, seed=1, strength=1.0):
    return LAWS[name](Scene(np.random.default_rng(seed), strength, OPTIONS, plan_of(OPTIONS)))


def by_hand(name, rate=None, force=None, temp=None, dt_s=0.01, count=3000):
    """Truth, times and what the law adds to constant or given signals."""
    t = np.arange(count) * dt_s

    def whole(values, default):
        return np.array(np.broadcast_to(default if values is None else values, (count, np.size(default)))).astype(float)

    rate, force = whole(rate, np.zeros(3)), whole(force, np.array([0, 0, G]))
    temp = np.full(count, OPTIONS.temperature_start_c) if temp is None else temp(t)
    hidden = law(name)
    return hidden.truth, t, hidden.distort(t, rate, force, temp) - rate


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


def test_beyond_linear_is_least_squares():
    rng = np.random.default_rng(0)
    rate = rng.normal(size=(500, 3))
    linear = rate @ rng.normal(size=(3, 3)) + [1, 2, 3]
    other = rng.normal(size=(500, 3))
    left = beyond_linear(rate, linear + other)
    assert left == pytest.approx(other - np.column_stack([np.ones(500), rate]) @ _fitted(rate, other), abs=1e-9)


def _fitted(rate, other):
    return np.linalg.lstsq(np.column_stack([np.ones(len(rate)), rate]), other, rcond=None)[0]


# By hand


def test_magnetic_zero_turns_with_the_body():
    """Half a turn about the vertical turns the field's horizontal part round, and leaves its dip."""
    truth, _, added = by_hand("law.magnetic_zero", rate=[0, 0, np.pi / 29.99])
    field = np.linalg.solve(np.array(truth["matrix_rps"]), added[[0, -1]].T).T
    assert field[:, 2] == pytest.approx(-np.sin(truth["dip_rad"]), abs=1e-9)
    assert field[1, :2] == pytest.approx(-field[0, :2], abs=1e-6)
    assert np.tan(truth["dip_rad"]) == pytest.approx(2 * np.tan(OPTIONS.latitude_deg * DEG))


def test_magnetic_induction_is_the_slope_of_the_field():
    _, t, added = by_hand("law.magnetic_induction", rate=[0.3, -0.2, 0.5])
    moved = seen_by_body(np.array([0.0, 0.0, 1.0]), t, np.tile([0.3, -0.2, 0.5], (len(t), 1)), np.tile([0, 0, G], (len(t), 1)))
    slope = np.gradient(moved, t, axis=0)
    assert slope[5:-5] == pytest.approx(np.cross(moved, [0.3, -0.2, 0.5])[5:-5], abs=1e-4)
    assert rms(added) > 0


def test_supply():
    truth, t, added = by_hand("law.switched_load")
    on = np.abs(added[:, 0]) > 0
    assert added[on].max(axis=0) == pytest.approx(added[on].min(axis=0))
    assert np.unique(np.abs(added[:, 1])) == pytest.approx([0, abs(truth["rps"][1])])
    whole = t < np.floor(t[-1] / truth["period_s"]) * truth["period_s"]
    assert on[whole].mean() == pytest.approx(truth["duty"], abs=0.01)
    truth, t, added = by_hand("law.ratiometric_scale", rate=[1.0, 2.0, 0.0])
    assert np.abs(added).max(axis=0) == pytest.approx(np.abs(truth["share"]) * [1, 2, 0])
    truth, t, added = by_hand("law.sag_recovery")
    assert added[0] == pytest.approx(truth["rps"])
    assert np.log(added[0] / added[1000]) == pytest.approx(10 / truth["tau_s"])


def test_resonance_is_a_second_order_response():
    """At the resonance the response is Q, a quarter of a period late: what is added is share (-i Q - 1) of the rate."""
    hidden = law("law.resonance")
    share, hz, quality = (np.array(hidden.truth[name]) for name in ("share", "hz", "quality"))
    t = np.arange(0, 20, 5e-4)
    rate = np.sin(2 * np.pi * t[:, None] * hz)
    added = (hidden.distort(t, rate, rate, t) - rate)[len(t) // 2 :]
    assert np.abs(added).max(axis=0) == pytest.approx(np.abs(share) * np.hypot(1, quality), rel=0.01)


def test_element():
    still = [0.3 * FULL_SCALE, 0.4 * FULL_SCALE, 0.0]
    truth, _, added = by_hand("law.drive_droop", rate=still)
    assert added[0] == pytest.approx(-np.array(truth["at_fs"]) * still * 0.5)
    truth, _, added = by_hand("law.drive_recovery", rate=still)
    assert added[-1] == pytest.approx(-np.array(truth["at_fs"]) * still * 0.25)
    truth, _, added = by_hand("law.dead_zone", rate=[0.01 * DEG, -1.0, 1.0])
    assert added[0] == pytest.approx([-0.01 * DEG, truth["rps"][1], -truth["rps"][2]])
    truth, _, added = by_hand("law.root_scale", rate=[FULL_SCALE / 4] * 3)
    assert added[0] == pytest.approx(np.array(truth["at_fs"]) * FULL_SCALE / 8)
    truth, _, added = by_hand("law.soft_limit", rate=[FULL_SCALE] * 3)
    assert added[0] == pytest.approx(-(FULL_SCALE**3) / (3 * np.square(truth["rps"])), rel=0.1)


def test_memory():
    rate = np.zeros((3000, 3))
    rate[500:600, 0] = 2.0  # 2 rad within a second
    truth, t, added = by_hand("law.last_turn", rate=rate)
    left = truth["rps_per_rad"][0] * 2 * np.exp(-(t[2000] - 5.5) / truth["tau_s"])
    assert added[2000] == pytest.approx([left, 0, 0], rel=1e-2)
    truth, t, added = by_hand("law.turn_hysteresis", rate=rate)
    assert added[0] == pytest.approx(0)
    assert added[-1] == pytest.approx([truth["rps"][0], 0, 0])
    truth, t, added = by_hand("law.overload", rate=rate * 2)
    assert added[499] == pytest.approx(0)
    assert added[599] == pytest.approx(np.array(truth["rps"]) * (1 - np.exp(-1 / truth["tau_s"])), rel=1e-2)
    force = np.tile([0.0, 0, G], (3000, 1))
    force[1000:] = [G, 0, 0]
    truth, t, added = by_hand("law.gravity_creep", force=force)
    toward = -np.expm1(-(t[2000] - 10) / truth["tau_s"])
    assert added[2000] == pytest.approx(np.array(truth["matrix_rps_per_g"]) @ [toward, 0, 1 - toward], rel=5e-3)


def test_package():
    start, warm = OPTIONS.temperature_start_c, 10.0
    truth, _, added = by_hand("law.temperature_rate", temp=lambda t: start + 0.1 * t)
    assert added[5] == pytest.approx(0.1 * np.array(truth["rps_per_cps"]))
    truth, _, added = by_hand("law.package_strain", temp=lambda t: start + 0.1 * t)
    tau_s = truth["tau_s"]
    assert added[2000] == pytest.approx(np.array(truth["rps_per_c"]) * 0.1 * tau_s * -np.expm1(-20 / tau_s), rel=1e-2)
    truth, _, added = by_hand("law.temperature_curve", temp=lambda t: np.full(len(t), start + warm))
    assert added[0] == pytest.approx(25 * np.array(truth["rps_per_c2"]))
    truth, _, added = by_hand("law.warm_gravity", force=[0, 0, -G], temp=lambda t: np.full(len(t), start + 2))
    assert added[0] == pytest.approx([0, 0, -2 * truth["rps_per_g_c"][2]])
    truth, _, added = by_hand("law.warm_square", rate=[-FULL_SCALE / 2, 0, 0], temp=lambda t: np.full(len(t), start + 2))
    assert added[0] == pytest.approx([truth["rps_per_c_at_fs"][0] / 2, 0, 0])


def test_rectification():
    rate = np.array([0.1, 0.2, 0.4]) * FULL_SCALE
    truth, _, added = by_hand("law.rate_product", rate=rate)
    assert added[0] == pytest.approx(np.array(truth["at_fs"]) * FULL_SCALE * [0.08, 0.04, 0.02])
    truth, _, added = by_hand("law.rate_squares", rate=rate)
    assert added[0] == pytest.approx(np.array(truth["at_fs"]) * FULL_SCALE * [0.2, 0.17, 0.05])
    truth, _, added = by_hand("law.cross_cube", rate=rate)
    assert added[0] == pytest.approx(np.array(truth["at_fs"]) * FULL_SCALE * [0.008, 0.064, 0.001])
    truth, _, added = by_hand("law.rectified_acceleration", rate=np.outer(np.arange(3000) * 0.01, [0.3, -0.4, 0]))
    assert added[10] == pytest.approx(0.5 * np.array(truth["s"]))
    truth, _, added = by_hand("law.anisoelastic", force=[G, 2 * G, 3 * G])
    assert added[0] == pytest.approx(np.array(truth["rps_per_g2"]) * [6, 3, 2])
    truth, _, added = by_hand("law.force_scale", rate=[1.0, 1, 1], force=[0, -G, 2 * G])
    assert added[0] == pytest.approx(np.array(truth["per_g"]) * [0, -1, 2])


def test_the_scale_follows_the_vibration_that_the_accelerometer_feels(signals):
    t, rate, force, temp = signals
    hidden = law("law.vibration_scale")
    shaken = hidden.disturb(t, force) - force
    scale = hidden.distort(t, np.ones_like(rate), force, temp) - 1
    assert scale.mean(axis=0) == pytest.approx(np.array(hidden.truth["per_g2"]) * np.mean((shaken / G) ** 2), rel=0.02)


def test_chance():
    hidden = law("law.telegraph")
    t = np.arange(0, plan_of(OPTIONS).log_s, 0.01)
    added = hidden.distort(t, np.zeros((len(t), 3)), None, None)
    at_s = hidden.truth["at_s"]
    assert np.flatnonzero(np.diff(added[:, 0])) * 0.01 == pytest.approx(at_s, abs=0.011)
    truth, _, added = by_hand("law.quantised", rate=np.outer(np.linspace(-1, 1, 3000), [1, 1, 1]))
    assert np.abs(added).max(axis=0) == pytest.approx(np.array(truth["rps"]) / 2, rel=0.02)


# Drawn


def test_drawn_laws_have_the_chosen_size_beyond_a_linear_calibration(signals):
    t, rate = signals[:2]
    inside = t >= 0
    for seed in range(12):
        hidden = law("law.random", seed)
        added = (hidden.distort(*signals) - rate)[inside]
        assert rms(beyond_linear(rate[inside], added)) == pytest.approx(hidden.truth["rps_rms"], rel=0.01), hidden.truth


def test_the_grammar_is_wide():
    texts = {draw_expression(np.random.default_rng(seed))[0] for seed in range(150)}
    assert len(texts) > 140
    joined = " ".join(texts)
    for part in ("tanh", "log(", "exp(", "sqrt", "lag[", "/(1 +", "turned", "angle", "|a|", "T", "v", "max("):
        assert part in joined
    assert max(text.count(" × ") for text in texts) == 2
