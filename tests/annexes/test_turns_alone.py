"""A gyroscope alone on a turntable: injected scale, bias, asymmetry and play come back within their sigmas; lost turns are found."""

import dataclasses

import numpy as np
import pytest
from annex import annex
from conftest import broad
from turntables import Turned, turn_session, within_one_sigma

import tinygc
from session.io.units import DEG

folder = annex("session.annexes.turntable.folder")
library = annex("tinygc.annexes.turntable.library")

#: x both ways, z one way only
PLAN = tuple((axis, sign * angle, 90.0) for angle in (90, 180, 360) for axis, sign in ((0, 1), (0, -1), (2, 1), (2, 1)))
FAR = PLAN + tuple((axis, sign * 1800, 180.0) for axis, sign in ((0, 1), (0, -1), (2, 1), (2, 1)))
ERRORS = {"plus": (0.01, 0.0, -0.004), "minus": (0.013, 0.0, 0.0), "bias": (0.01, -0.02, 0.005)}
EXACT = Turned(PLAN, **ERRORS, stop_deg=1e-9)
SEEDS = range(40)


def true_scale(turned, scale):
    return (turned.plus if scale.sense > 0 else turned.minus)[scale.axis]


def test_turns_without_noise_give_the_scales_and_the_bias_exactly():
    found = tinygc.fit_turns(EXACT.session())
    assert [(scale.axis, scale.sense) for scale in found.scales] == [(0, 1), (0, -1), (2, 1)]
    for scale in found.scales:
        assert scale.value == pytest.approx(true_scale(EXACT, scale), abs=1e-8)
    np.testing.assert_allclose(found.bias.mean, EXACT.bias, rtol=0, atol=1e-15)
    for angle in found.angles:
        gain = 1 + (EXACT.plus if angle.sense > 0 else EXACT.minus)[angle.axis]
        assert angle.measured_rad == pytest.approx(gain * angle.stated_rad, rel=1e-11)
    value, _ = found.asymmetry[0]
    assert value == pytest.approx((0.01 - 0.013) / 1.0115, abs=1e-9)


def test_the_model_undoes_what_was_injected():
    turned = dataclasses.replace(EXACT, minus=EXACT.plus)
    model = tinygc.fit_turns(turned.session()).model
    _, readings = turned.arrays()
    _, true = dataclasses.replace(turned, plus=(0, 0, 0), minus=(0, 0, 0), bias=(0, 0, 0)).arrays()
    np.testing.assert_allclose(model(readings), true, rtol=0, atol=1e-9)


def test_an_axis_and_a_sense_that_were_not_turned_are_not_claimed():
    one = Turned(((1, -90, 90.0), (1, -180, 90.0)), noise=1e-3)
    found = tinygc.fit_turns(one.session())
    assert [(scale.axis, scale.sense) for scale in found.scales] == [(1, -1)]
    assert found.asymmetry == {}
    assert set(found.unobserved) == {f"E_{i}{j}" for i in "xyz" for j in "xyz"} - {"E_yy"}
    np.testing.assert_array_equal(np.diag(found.model.E)[[0, 2]], 1)
    assert "scale of x, z: not known" in found.summary()
    assert "the other sense of y" in found.summary()


@pytest.mark.parametrize(
    "change",
    [
        {"noise": 0.002, "play": 0.3 * DEG},
        broad({"noise": 0.002}),
        broad({"noise": 0.02, "stop_deg": 0.02}),
        broad({"noise": 0.002, "play": 1.0 * DEG, "plan": FAR}),
        broad({"noise": 0.002, "stop_deg": 0.02, "lean": (0.0, 3 * DEG, 0.0)}),
        broad({"noise": 0.01, "stop_deg": 0.005, "rest_s": 0.4}),
        broad({"noise": 0.004, "stop_deg": 0.02, "wander": 0.002}),
    ],
    ids=str,
)
def test_scales_asymmetry_and_bias_are_within_their_sigmas_as_often_as_stated(change):
    scales, asymmetries, biases, named = [], [], [], 0
    for seed in SEEDS:
        turned = Turned(**({"plan": PLAN} | ERRORS | change | {"seed": seed}))
        found = tinygc.fit_turns(turned.session())
        scales += [(scale.value - true_scale(turned, scale)) / scale.sigma for scale in found.scales]
        value, sigma = found.asymmetry[0]
        asymmetries.append((value - (0.01 - 0.013) / 1.0115) / sigma)
        biases += list((found.bias.mean - turned.bias) / found.bias.sigma)
        named += int((~found.estimate.used).sum())
    assert within_one_sigma(scales)
    assert within_one_sigma(asymmetries)
    assert within_one_sigma(biases) or turned.wander
    assert np.abs(scales).max() < 5
    assert named == 0  # of 480 good turns and more


def test_stops_as_good_as_stated_leave_no_play_and_worse_ones_a_chi_square():
    good = tinygc.fit_turns(Turned(FAR, stop_deg=0.2, noise=0.002, seed=3).session()).estimate
    bad = tinygc.fit_turns(Turned(FAR, stop_deg=0.2, play=1.0 * DEG, noise=0.002, seed=3).session()).estimate
    assert good.p_value > 1e-3
    assert good.play.upper < 0.4 * DEG
    assert bad.p_value < 1e-6
    assert bad.play.low > 0.3 * DEG
    assert (good.dof, bad.dof) == (len(FAR) - 3, len(FAR) - 3)


@pytest.mark.parametrize("share", [0.2, broad(0.7)])
def test_lost_turns_are_found_and_do_not_move_the_scale(share):
    for seed in range(5):
        lost = {2: share * 90, 9: share * 360, 11: share * 360}
        turned = Turned(PLAN, play=0.3 * DEG, noise=0.002, seed=seed, lost=lost, **ERRORS)
        found = tinygc.fit_turns(turned.session())
        assert set(np.flatnonzero(~found.estimate.used)) == set(lost)
        assert (found.estimate.lost[list(lost)] > 0.99).all()
        for number, angle_deg in lost.items():
            angle = found.angles[number]
            miss = (1 + (turned.plus if angle.sense > 0 else turned.minus)[angle.axis]) * angle_deg * DEG
            assert abs(found.estimate.residual_rad[number] + miss) < 4 * found.estimate.predicted_rad[number]
        for scale in found.scales:
            assert abs(scale.value - true_scale(turned, scale)) < 0.004  # with them the mean would be off by 3 % and more
        words = [line for line in found.to_json()["remarks"] if "misses by" in line]
        assert len(words) == len(lost)
        assert all("lost with probability above 0.9999" in line for line in words)
        assert all("no gap in its stamps: lost samples or lost steps of the table, undecided" in line for line in words)


def test_turns_of_one_sense_leave_the_tables_backlash_open():
    one = tuple((2, angle, 90.0) for angle in (90, 180, 360, 360))
    word = "backlash of the table: not known"
    assert any(word in line for line in tinygc.fit_turns(Turned(one, noise=0.002).session()).to_json()["remarks"])
    assert not any(word in line for line in tinygc.fit_turns(EXACT.session()).to_json()["remarks"])


def test_a_turn_that_went_too_far_is_no_lost_sample():
    found = tinygc.fit_turns(Turned(PLAN, noise=0.002, lost={5: -30.0}).session())
    assert list(np.flatnonzero(~found.estimate.used)) == [5]
    assert "it turned by more than is stated" in found.summary()


def test_a_gap_is_bridged_and_explains_only_what_it_lacks():
    turned = Turned(((2, 360, 90.0),) * 8, noise=0.002)
    t_ns, gyro = turned.arrays()
    first = int(np.flatnonzero(gyro[:, 2] > 1)[0])
    gap = slice(first + 100, first + 140)

    def fitted(stamps, readings):
        log = folder.GyroLog("log", np.delete(stamps, gap), np.delete(readings, gap, axis=0))
        return tinygc.fit_turns(turn_session([log], turned.known()))

    bridged = fitted(t_ns, gyro)
    assert bridged.estimate.used.all()  # at a constant rate the trapezoid takes in what is missing
    assert [angle.lost_s for angle in bridged.angles] == pytest.approx([0.4] + [0.0] * 7, abs=1e-9)
    stopped = gyro.copy()
    stopped[[gap.start - 1, gap.stop], 2] = 0  # the rate on either side tells nothing of the rate within
    unseen = fitted(t_ns, stopped)
    assert list(np.flatnonzero(~unseen.estimate.used)) == [0]
    assert "gaps in its stamps lack 0.40 s: lost samples" in unseen.to_json()["remarks"][0]
    hidden = t_ns.copy()
    hidden[gap.stop :] -= 350_000_000  # stamps that show 0.05 of 0.4 s
    short = fitted(hidden, gyro)
    assert list(np.flatnonzero(~short.estimate.used)) == [0]
    assert "gaps in its stamps lack only 0.050 s: lost samples or lost steps" in short.to_json()["remarks"][0]


def test_two_of_three_turns_decide_and_a_single_one_is_believed():
    three = tinygc.fit_turns(Turned(((0, 90, 90.0),) * 3, noise=0.002, lost={1: 20.0}).session())
    assert list(three.estimate.used) == [True, False, True]
    one = tinygc.fit_turns(Turned(((0, 90, 90.0),), noise=0.002, lost={0: 20.0}).session())
    assert one.estimate.used.all()
    assert not one.estimate.play.estimated
    assert "play is not known" in one.summary()


def test_a_lean_of_the_table_does_not_enter_the_scale():
    for lean in (0.0, 3.0, 10.0):
        turned = dataclasses.replace(EXACT, plus=(0.01,) * 3, minus=(0.01,) * 3, lean=(0.0, lean * DEG, 0.0))
        found = tinygc.fit_turns(turned.session())
        for scale in found.scales:
            assert scale.value == pytest.approx(0.01, abs=1e-8)  # by components it would be short by lean^2 / 2: 1.5 % at 10 deg
            assert scale.axis_bound == pytest.approx(np.sqrt(2) * (lean * DEG) ** 2, rel=1e-6, abs=1e-12)
        assert all(angle.lean_rad == pytest.approx(lean * DEG, abs=1e-6) for angle in found.angles)


def test_a_misalignment_moves_the_scale_by_no_more_than_the_bound():
    turned = dataclasses.replace(EXACT, lean=(0.0, 2 * DEG, 0.0))
    t_ns, gyro = dataclasses.replace(turned, plus=(0, 0, 0), minus=(0, 0, 0)).arrays()
    S = np.eye(3)
    S[0, 2], S[2, 0] = 1.5 * DEG, 1.0 * DEG
    found = tinygc.fit_turns(turn_session([folder.GyroLog("log", t_ns, (gyro - turned.bias) @ S.T)], turned.known()))
    for scale in found.scales:
        assert 1e-5 < abs(scale.value) < scale.axis_bound


def test_readings_rounded_to_two_decimals_are_covered():
    rng, scales, biases = np.random.default_rng(5), [], []
    for seed in SEEDS:
        bias = tuple(rng.uniform(-0.02, 0.02, 3))
        turned = Turned(PLAN, noise=0.001, lsb=0.01, bias=bias, stop_deg=0.02, seed=seed)
        found = tinygc.fit_turns(turned.session())
        scales += [scale.value / scale.sigma for scale in found.scales]
        biases += list((found.bias.mean - bias) / found.bias.sigma)
        assert found.estimate.used.all()
    assert np.mean(np.abs(scales) < 1) > 0.6
    assert np.mean(np.abs(scales) < 2) > 0.93
    assert within_one_sigma(np.array(biases) * 1.15)  # a rectangular distribution has 58 % within one sigma, and little beyond 1.7
    assert np.abs(biases).max() < 1.9


def test_a_knock_parts_no_rest():
    turned = Turned(PLAN[:4], noise=0.002)
    t_ns, gyro = turned.arrays()
    gyro[60:75, 1] += 0.5
    found = tinygc.fit_turns(turn_session([folder.GyroLog("log", t_ns, gyro)], turned.known()))
    assert found.estimate.used.all()
    assert len(found.logs[0].rests) == len(turned.plan) + 1
    assert len(found.logs[0].rests[0].spans) == 2


def test_a_slow_turn_at_constant_rate_is_no_rest():
    found = tinygc.fit_turns(Turned(((2, 90, 4.0), (2, 90, 4.0)), noise=0.002, rest_s=1.0).session())
    assert found.estimate.used.all()
    assert found.scales[0].turns == 2


def test_a_zero_larger_than_the_rate_of_slow_turns_is_still_the_zero():
    """Of turns at 5 dps against a zero of 5.2 dps the turn reads less than the rest."""
    plan = ((1, -30, 5.0), (0, 90, 90.0), (1, -30, 5.0), (1, -30, 5.0))
    found = tinygc.fit_turns(Turned(plan, noise=0.001, bias=(0.01, 0.09, -0.03), rest_s=2.0).session())
    assert found.estimate.used.all()
    np.testing.assert_allclose(found.bias.mean, (0.01, 0.09, -0.03), rtol=0, atol=5e-4)


def test_a_turn_that_the_log_begins_or_ends_in_is_named():
    turned = Turned(PLAN[:4], noise=0.002)
    t_ns, gyro = turned.arrays()
    log = folder.GyroLog("log", t_ns[200:-200], gyro[200:-200])
    found = tinygc.fit_turns(turn_session([log], turned.known()))
    assert list(found.estimate.used) == [False, True, True, False]
    assert "no rest before it" in found.angles[0].problem
    assert "no rest behind it" in found.angles[3].problem


@pytest.mark.parametrize(
    ("axis", "angle_deg", "words"),
    [(1, 90, "about (1.00"), (0, -90, "about (1.00"), (0, 90, None)],
)
def test_a_turn_about_another_axis_or_the_other_way_is_named(axis, angle_deg, words):
    turned = Turned(((0, 90, 90.0), (0, 90, 90.0)), noise=0.002)
    first, second = turned.known()
    stated = dataclasses.replace(first, axis=np.eye(3)[axis], words="xyz"[axis], angle_rad=angle_deg * DEG)
    found = tinygc.fit_turns(turn_session([folder.GyroLog("log", *turned.arrays())], [stated, second]))
    assert found.estimate.used[0] == (words is None)
    assert words is None or words in found.angles[0].problem


def test_clipped_turns_and_turns_that_are_not_there_are_named():
    turned = Turned(((0, 90, 90.0), (0, 180, 150.0)), noise=0.002)
    logs = [folder.GyroLog("log", *turned.arrays())]
    found = tinygc.fit_turns(turn_session(logs, turned.known(), gyro_fs_dps=125))
    assert [angle.problem is None for angle in found.angles] == [True, False]
    assert "reaches the full scale of 125 dps" in found.angles[1].problem
    beyond = [dataclasses.replace(turn, turn=turn.turn + 1) for turn in turned.known()]
    found = tinygc.fit_turns(turn_session(logs, beyond))
    assert "holds 2 turns" in found.angles[1].problem
    with pytest.raises(tinygc.FitError, match="none of 1 stated turns can be used"):
        tinygc.fit_turns(turn_session(logs, beyond[1:]))


def test_turns_are_counted_over_all_logs_where_no_log_is_named():
    one, two = Turned(PLAN[:2], noise=0.002), Turned(PLAN[2:5], noise=0.002, seed=1)
    logs = [folder.GyroLog("log1", *one.arrays()), folder.GyroLog("log2", *two.arrays())]
    known = [dataclasses.replace(turn, log=None) for turn in Turned(PLAN[:5]).known()]
    found = tinygc.fit_turns(turn_session(logs, known))
    assert found.estimate.used.all()
    assert [angle.log for angle in found.angles] == ["log1", "log1", "log2", "log2", "log2"]
