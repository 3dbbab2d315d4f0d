"""The delay between gyro and accelerometer from turns between two stills: its sigma, its bar and its odds."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtr
from scipy.stats import wilcoxon
from simulated_twins import make_twin_of

from tinygc.explanation.claims import offset_claim
from tinygc.noise.refit import refit
from tinygc.noise.turn_gravity import TurnGravity, _TurnEquations, _turns, lever_equations, turn_gravity, velocity_equations


def equations(seed, noise=0.1):
    rng = np.random.default_rng(seed)
    columns, truth = rng.standard_normal((7, 5, 4)), np.array([0.3, -0.2, 0.1, 0.5])
    values = columns @ truth + noise * rng.standard_normal((7, 5))
    normal, right = np.einsum("sai,saj->sij", columns, columns), np.einsum("sai,sa->si", columns, values)
    return _TurnEquations(normal, right, np.sum(values**2, axis=1), np.full(7, 5)), columns, values


def solved(columns, values, without=()):
    """Least squares of all turns but these."""
    columns, values = (np.concatenate(np.delete(each, without, axis=0)) for each in (columns, values))
    return np.linalg.lstsq(columns, values, rcond=None)[0]


def test_the_sigma_is_the_jackknife_of_whole_turns():
    found, columns, values = equations(1)
    without = [solved(columns, values, [s])[3] for s in range(7)]
    assert found.solve() == pytest.approx(solved(columns, values))
    assert found.sigma_s() == pytest.approx(np.sqrt(6 / 7 * np.sum((without - np.mean(without)) ** 2)))
    some = [_TurnEquations(found.normal[:n], found.right[:n], found.square[:n], found.count[:n]) for n in (1, 2)]
    assert some[0].sigma_s() == np.inf
    assert some[1].sigma_s() == pytest.approx(abs(np.subtract(*(solved(columns[:2], values[:2], [s])[3] for s in (0, 1)))) / 2)


def test_a_delay_is_claimed_beyond_filters_and_beyond_chance():
    of = lambda offset_s, sigma_s: TurnGravity(np.zeros(3), offset_s, sigma_s, 1.0, 1.0, 0.004, 24, 0.001)  # noqa: E731
    assert 2 * (1 - stdtr(20, of(0, 0.002).bar_s / 0.002)) == pytest.approx(1e-3)
    assert of(0.0041, 1e-4).is_offset
    assert not of(0.0039, 1e-4).is_offset
    assert not of(0.0075, 0.002).is_offset
    assert of(0.0078, 0.002).is_offset
    assert not replace(of(0.0078, 0.002), held_out_p=0.06).is_offset


def test_the_claimed_sigma_has_the_filters_share():
    found = TurnGravity(np.zeros(3), 0.012, 0.002, 1.0, 1.0, 0.0045, 24, 0.001)
    assert found.whole_sigma_s == pytest.approx(0.0025)
    (claim,) = offset_claim(found)
    assert claim.std == {"seconds": pytest.approx(0.0025)}


def test_the_gain_of_a_turn_is_of_a_fit_to_all_others():
    """By hand, with each turn left out of both fits: signed ranks of the residuals' squares."""
    found, columns, values = equations(3, noise=2.0)
    left = [[values[s] - columns[s, :, :n] @ solved(columns[..., :n], values, [s]) for s in range(7)] for n in (3, 4)]
    gains = np.sum(np.square(left[0]) - np.square(left[1]), axis=1)
    assert found.improvement_p() == wilcoxon(gains, alternative="greater", method="exact").pvalue
    assert 0.01 < found.improvement_p() < 0.9


twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


@pytest.fixture(scope="module")
def replayed(twin_of):
    twin, whiten = twin_of(segments=8)
    return twin, refit(twin, whiten, [], twin.start())


def test_gravity_before_and_after_is_the_mean_square_of_a_value(replayed):
    """An arm of 1, 2, 3 m and a delay in exact equations: before is the rms of the force, after that of its noise."""
    found, lever = turn_gravity(*replayed), lever_equations(*replayed)
    size = round(0.025 * 104)
    assert lever.count.sum() == 3 * sum((segment.stop - segment.start) // size for segment in replayed[0].segments)
    np.testing.assert_array_equal(found.lever_m, lever.at(found.offset_s)[:3])
    assert found.before_mps2**2 * lever.count.sum() == pytest.approx(lever.square.sum(), rel=1e-9)
    noise = 60e-6 * 9.80665 * np.sqrt(104 / 2 / size)  # of the simulated accelerometer, in means of a block
    assert found.after_mps2 == pytest.approx(noise, rel=0.25)
    assert found.filters_s == pytest.approx(replayed[0].seen.logs[0].samples.period_s / 2)


def test_a_hand_that_accelerates_with_the_turn_makes_no_delay(replayed):
    """It pushes level as the turn tilts gravity, and stops again: no turn's change of velocity, from two samples before 2 % of its fastest
    rate to two behind, is another.  The specific force itself takes it for a delay."""
    twin, fit = replayed
    logs, before = [np.array(log.samples.accel) for log in twin.seen.logs], 0.0
    for (attitude, rate, force, dt_s), segment in zip(_turns(twin, fit), twin.segments, strict=True):
        rows = np.flatnonzero(np.linalg.norm(rate, axis=1) > 0.02 * np.linalg.norm(rate, axis=1).max())
        window = slice(rows[0] - 2, rows[-1] + 3)
        before += np.sum(np.trapezoid(np.einsum("tij,tj->ti", attitude[:, :2], force)[window], dx=dt_s, axis=0) ** 2)
        push = np.einsum("tij,tj->ti", attitude, np.gradient(attitude[:, 2], axis=0)) * [1, 1, 0]
        push[: rows[0]] = push[rows[-1] + 1 :] = 0
        push -= np.outer(np.sum(push**2, axis=1) / np.sum(push**2), push.sum(axis=0))
        logs[segment.log][segment.start : segment.stop] -= 30 * np.einsum("tji,tj->ti", attitude, push)
    moved = copy.copy(twin)
    moved.__dict__.pop("movements", None)
    seen = [replace(log, samples=log.samples.with_accel(accel)) for log, accel in zip(twin.seen.logs, logs, strict=True)]
    moved.seen = replace(twin.seen, logs=seen)
    usual, pushed = (velocity_equations(each, fit) for each in (twin, moved))
    assert usual.square.sum() == pytest.approx(before, rel=1e-9)
    np.testing.assert_allclose(pushed.square, usual.square, rtol=1e-6)
    apart = [of(moved, fit).solve()[3] - of(twin, fit).solve()[3] for of in (lever_equations, velocity_equations)]
    assert abs(apart[0]) > 4e-3
    assert abs(apart[1]) < 0.1 * abs(apart[0])
