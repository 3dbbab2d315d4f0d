"""The estimate from measured turns against another way to the same numbers: dense normal densities, turn by turn."""

import dataclasses
import itertools

import numpy as np
import pytest
from annex import annex
from scipy.special import logsumexp
from scipy.stats import chi2
from turntables import Turned

from session.io.units import DEG

folder = annex("session.annexes.turntable.folder")
angles = annex("tinygc.annexes.turntable.angles")
estimate = annex("tinygc.annexes.turntable.estimate")


def turn(measured_deg, stated_deg=360.0, axis=2, sense=1, log="log1", **more):
    """A measured turn with 0.2 deg of the gyroscope and 0.1 deg of the stop."""
    known = Turned(((axis, sense * stated_deg, 90.0),)).known()[0]
    variance = dict.fromkeys(angles.TERMS, 0.0) | {"white": (0.2 * DEG) ** 2}
    return angles.TurnAngle(
        known,
        log,
        axis,
        sense,
        stated_deg * DEG,
        measured_deg * DEG,
        np.eye(3)[axis] * sense,
        4.0,
        90 * DEG,
        0.01,
        variance | more.pop("variance", {}),
        **more,
    )


KNOWN = np.hypot(0.2, 0.1) * DEG


def evidence(turns, good):
    """log of the probability of the data where the turns of ``good`` are good: dense covariances, and a grid of its own."""
    A = np.array([each.stated_rad for each in turns])
    r = np.array([each.measured_rad for each in turns]) - A
    vibration = np.array([each.variance["vibration"] for each in turns])
    size, share = np.geomspace(0.1, 200, 60), np.geomspace(0.03, 1, 12)
    even = [np.gradient(np.log(x)) / (1 + (x / 10) ** 2) for x in (size, share)]
    even = [each / each.sum() for each in even]
    play, repeat = (np.concatenate([[1 - there], there * even[0]]) for there in (0.8, 0.2))
    part = np.concatenate([[0.2], 0.8 * even[1]]) if vibration.any() else np.ones(1)
    size, share = np.concatenate([[0], size]), np.concatenate([[0], share])[: len(part)]
    groups = [(each.axis, each.sense) for each in turns]
    J = np.array([[a * (group == g) for g in dict.fromkeys(groups)] for a, group in zip(A, groups, strict=True)]) * 0.2
    i, j, k = (each.ravel() for each in np.meshgrid(*map(np.arange, (len(size), len(size), len(share))), indexing="ij"))
    sigmas = [size[i][:, None] * KNOWN, size[j][:, None] * np.median(KNOWN / A) * A, share[k][:, None] * np.sqrt(vibration)]
    C = (KNOWN**2 + sum(sigma**2 for sigma in sigmas))[:, good, None] * np.eye(good.sum()) + (J @ J.T)[np.ix_(good, good)]
    square = np.linalg.solve(C, np.broadcast_to(r[good, None], (len(C), good.sum(), 1)))[..., 0] @ r[good]
    density = -0.5 * (square + np.linalg.slogdet(C)[1] + good.sum() * np.log(2 * np.pi))
    return logsumexp(density + np.log(play[i] * repeat[j] * part[k])) + np.sum(np.log(0.01 / 0.99) - np.log(2 * A[~good]))


@pytest.mark.parametrize(
    ("measured", "lost"),
    [((360.4, 360.2, 360.1, 362.0), 0), ((360.4, 360.2, 360.1, 340.0), 1), ((360.4, 360.2, 330.1, 340.0, 360.3, 360.2), 2)],
)
def test_the_lost_turns_are_the_most_probable_set_of_all(measured, lost):
    turns = [turn(each) for each in measured]
    found = estimate.estimate(turns)
    sets = [np.array(good) for good in itertools.product((True, False), repeat=len(turns))]
    values = [evidence(turns, good) for good in sets]
    np.testing.assert_array_equal(found.used, sets[int(np.argmax(values))])
    assert np.count_nonzero(~found.used) == lost
    for i in range(len(turns)):
        other = found.used.copy()
        other[i] = not other[i]
        good, bad = (found.used, other) if found.used[i] else (other, found.used)
        odds = evidence(turns, good) - evidence(turns, bad)
        assert found.lost[i] == pytest.approx(1 / (1 + np.exp(odds)), rel=0.05)


def test_a_turn_that_is_only_probably_lost_is_named_and_used():
    others = [turn(360.0 + x, log=f"log{i}") for i, x in enumerate((0.3, -0.2, 0.1, 0.25, -0.3, 0.0, 0.1, -0.1))]
    probabilities = {True: [], False: []}
    for miss in np.arange(1.0, 6.0, 0.1):
        found = estimate.estimate([*others, turn(360.0 - miss)])
        probabilities[bool(found.used[-1])].append(found.lost[-1])
        assert found.used[:-1].all()
    assert 0.5 < max(probabilities[True]) < 10 / 11 < min(probabilities[False])


def test_two_axes_and_vibration_in_the_same_way():
    turns = [
        turn(90.3, 90, 0),
        turn(90.2, 90, 0),
        turn(361, 360, 0),
        turn(181, 180, 2, variance={"vibration": (3 * DEG) ** 2}),
        turn(178, 180, 2),
    ]
    found = estimate.estimate(turns)
    every = np.ones(5, dtype=bool)
    assert found.used.all()
    for i in range(5):
        odds = evidence(turns, every) - evidence(turns, every & (np.arange(5) != i))
        assert found.lost[i] == pytest.approx(1 / (1 + np.exp(odds)), rel=0.2)


def test_chi_square_is_that_of_a_weighted_fit_of_a_scale():
    measured = np.array([90.5, 180.9, 361.0, 1804.5, 90.1])
    A = np.array([90, 180, 360, 1800, 90.0])
    found = estimate.estimate([turn(m, a) for m, a in zip(measured, A, strict=True)])
    r, w = (measured - A) * DEG, 1 / KNOWN**2
    a = A * DEG
    expected = w * (r @ r) - w * (a @ r) ** 2 / (a @ a)
    assert found.chi2 == pytest.approx(expected, rel=1e-4)  # the prior of 20 % bends it by no more
    assert found.dof == 4
    assert found.p_value == pytest.approx(chi2.sf(expected, 4), rel=1e-4)


def test_a_single_turn_has_the_sum_of_its_known_errors_and_all_of_its_vibration():
    found = estimate.estimate([turn(361.0, variance={"vibration": (0.5 * DEG) ** 2})])
    assert found.scale == pytest.approx([1 / 360], rel=1e-4)
    assert np.sqrt(found.covariance) == pytest.approx(np.sqrt(KNOWN**2 + (0.5 * DEG) ** 2) / (360 * DEG), rel=1e-4)
    assert not found.play.estimated
    assert found.dof == 0
    assert np.isnan(found.p_value)


def test_many_turns_without_play_have_the_sigma_of_their_known_errors():
    rng = np.random.default_rng(4)
    A = np.tile([90, 180, 360, 1800.0], 50)
    found = estimate.estimate([turn(a + KNOWN / DEG * rng.normal(), a, log=f"log{i}") for i, a in enumerate(A)])
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(KNOWN / np.sqrt(np.sum((A * DEG) ** 2)), rel=0.15)
    assert found.repeat.upper < KNOWN / (360 * DEG)
    assert found.play.median < 0.5 * KNOWN


def test_play_and_repeat_are_told_apart_by_many_turns():
    rng = np.random.default_rng(5)
    A = np.tile([90, 180, 360, 1800.0], 60)
    own = A + KNOWN / DEG * rng.normal(size=len(A))
    draws = rng.normal(size=len(A))
    play = estimate.estimate([turn(m + x, a) for m, a, x in zip(own, A, draws, strict=True)])
    repeat = estimate.estimate([turn(m + 0.003 * a * x, a) for m, a, x in zip(own, A, draws, strict=True)])
    assert play.play.low < draws.std() * DEG < play.play.upper
    assert play.repeat.upper < 0.001
    assert repeat.repeat.low < 0.003 * draws.std() < repeat.repeat.upper
    assert repeat.play.upper < 1.0 * DEG


@pytest.mark.broad
def test_the_interval_of_play_holds_it_as_often_as_it_says():
    held, medians = 0, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        A = np.repeat([90, 180, 360, 1800.0], 4)
        play = estimate.estimate([turn(a + np.hypot(1.0, KNOWN / DEG) * rng.normal(), a) for a in A]).play
        held += play.low < 1.0 * DEG < play.high
        medians.append(play.median)
    assert 30 <= held <= 52  # 41, of 60 and 68 %
    assert np.median(medians) == pytest.approx(1.0 * DEG, rel=0.12)


def test_slow_turns_show_a_rate_that_rounding_hides():
    """Five of 4 s and five of 60 s, all off by 0.05 dps: a scale alone would miss by 60 s times that."""
    shared = {"shared_rps2": (0.1 * DEG) ** 2}
    fast = [turn(360.36 + 0.05 * 4, **shared) for _ in range(5)]
    slow = [dataclasses.replace(turn(360.36 + 0.05 * 60, **shared), duration_s=60.0) for _ in range(5)]
    found = estimate.estimate([*fast, *slow])
    assert found.scale[0] == pytest.approx(0.001, abs=0.0002)
    assert np.abs(found.residual_rad).max() < 0.2 * DEG
    assert np.sqrt(found.covariance[0, 0]) > KNOWN / np.sqrt(10) / (360 * DEG)


def test_a_group_of_which_every_turn_is_lost_is_not_claimed():
    turns = [turn(360.0 + 0.1 * i, log=f"log{i}") for i in range(6)] + [turn(20.0, axis=0), turn(-300.0 + 60.0, axis=0, log="log8")]
    found = estimate.estimate(turns)
    assert found.groups == ((2, 1),)
    assert list(found.used) == [True] * 6 + [False] * 2
    assert np.isnan(found.residual_rad[6:]).all()
    assert (found.lost[6:] > 0.5).all()


def test_turns_with_a_problem_change_nothing():
    good = [turn(360.2), turn(360.5), turn(360.1)]
    bad = dataclasses.replace(turn(100.0), problem="no rest")
    one, other = estimate.estimate(good), estimate.estimate([good[0], bad, *good[1:]])
    np.testing.assert_array_equal(one.scale, other.scale)
    assert list(other.used) == [True, False, True, True]
    assert np.isnan(other.lost[1])


def test_lost_turns_that_agree_with_each_other_are_found():
    """From all turns as good, a play as large as the miss explains them; from those near the median of each axis, nothing has to."""
    good = [turn(360.0 * 1.1 + x, axis=0, log=f"log{i}") for i, x in enumerate((0.1, -0.2, 0.3, 0.0, -0.1))]
    good += [turn(360.0 * 0.9 + x, axis=2, log=f"log{i + 5}") for i, x in enumerate((0.2, -0.1, 0.0, 0.1, -0.3))]
    lost = [turn(360.0 * 1.1 - 60 + x, axis=0, log=f"log{i + 10}") for i, x in enumerate((0.1, 0.2, -0.1))]
    found = estimate.estimate([*good, *lost])
    assert list(found.used) == [True] * 10 + [False] * 3
    assert found.scale == pytest.approx([0.1, -0.1], abs=0.003)
