"""The delay between gyro and accelerometer from turns between two stills: its sigma, and a hand that accelerates."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtr
from scipy.stats import wilcoxon
from simulated_twins import make_twin_of

from tinygc import closure
from tinygc.attitude import rotation
from tinygc.explanation.claims import offset_claim
from tinygc.noise.refit import refit
from tinygc.noise.turn_gravity import TurnEquations, TurnGravity, lever_equations, turn_gravity, velocity_equations

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


def equations(seed, turns=7, noise=0.1):
    rng = np.random.default_rng(seed)
    columns, truth = rng.standard_normal((turns, 5, 4)), np.array([0.3, -0.2, 0.1, 0.5])
    values = columns @ truth + noise * rng.standard_normal((turns, 5))
    normal, right = np.einsum("sai,saj->sij", columns, columns), np.einsum("sai,sa->si", columns, values)
    return TurnEquations(normal, right, np.sum(values**2, axis=1), np.full(turns, 5)), columns, values


def test_the_sigma_is_the_jackknife_of_whole_turns():
    found, columns, values = equations(1)
    without = [
        np.linalg.lstsq(np.delete(columns, s, 0).reshape(-1, 4), np.delete(values, s, 0).ravel(), rcond=None)[0][3] for s in range(7)
    ]
    assert found.sigma_s() == pytest.approx(np.sqrt(6 / 7 * np.sum((without - np.mean(without)) ** 2)))


def test_a_delay_that_one_turn_alone_shows_has_no_sigma():
    found, _, _ = equations(1)
    found.normal[1:, 3], found.normal[1:, :, 3], found.right[1:, 3] = 0, 0, 0
    assert found.sigma_s() == np.inf
    assert found.improvement_p() == 1.0


def test_two_of_three_estimates_are_within_their_sigma():
    pulls = np.array([(found.solve()[3] - 0.5) / found.sigma_s() for found in (equations(seed)[0] for seed in range(400))])
    assert np.mean(np.abs(pulls) < 1) == pytest.approx(0.68, abs=0.07)


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


@pytest.mark.parametrize("t", [3.9, 5.0])
def test_the_odds_of_a_delay_are_those_of_its_likelihood(t):
    """Likelihood ratio of Student's t with 20 degrees of freedom, a prior of 1 in 30, ten scales, and the prior's own e^-1/2."""
    found = TurnGravity(np.zeros(3), 0.01, 0.01 / t, 1.0, 1.0, 0.001, 24, 0.001)
    (claim,) = offset_claim(found)
    odds = (1 + t**2 / 20) ** (20 / 2) / 30 / 10 * np.exp(-1 / 2)
    assert claim.probability == pytest.approx(odds / (1 + odds), rel=1e-9)
    assert claim.p_value == pytest.approx(2 * stdtr(20, -t), rel=1e-9)


def test_the_gain_of_a_turn_is_of_a_fit_to_all_others():
    """By hand, with each turn left out of both fits: signed ranks of the residuals' squares."""
    found, columns, values = equations(3, noise=2.0)
    gains = []
    for s in range(7):
        left = []
        for count in (3, 4):
            rest = (np.delete(each, s, 0).reshape(30, *each.shape[2:]) for each in (columns[..., :count], values))
            solution = np.linalg.lstsq(*rest, rcond=None)[0]
            left.append(np.sum((values[s] - columns[s, :, :count] @ solution) ** 2))
        gains.append(left[0] - left[1])
    assert found.improvement_p() == wilcoxon(gains, alternative="greater", method="exact").pvalue
    assert 0.01 < found.improvement_p() < 0.9


def test_gravity_before_and_after_is_the_mean_square_of_a_value(twin_of):
    """An arm of 1, 2, 3 m and a delay in exact equations: before is the rms of the force, after that of its noise."""
    twin, whiten = twin_of()
    fit = refit(twin, whiten, [], twin.start())
    found, lever = turn_gravity(twin, fit), lever_equations(twin, fit)
    size = round(0.025 * 104)
    assert lever.count.sum() == 3 * sum((segment.stop - segment.start) // size for segment in twin.segments)
    assert found.before_mps2**2 * lever.count.sum() == pytest.approx(lever.square.sum(), rel=1e-9)
    noise = 60e-6 * 9.80665 * np.sqrt(104 / 2 / size)  # of the simulated accelerometer, in means of a block
    assert found.after_mps2 == pytest.approx(noise, rel=0.25)


def pushed(twin, fit, size):
    """The twin with a hand that accelerates level as the turn tilts gravity, and stops again before each still."""
    batch, state = twin.batch_at(fit.state), fit.state
    turns = rotation.matrix(closure.attitudes(batch, twin.padded(twin.rates(state))))
    logs = [np.array(log.samples.accel) for log in twin.problem.logs]
    for i, segment in enumerate(twin.segments):
        turn = turns[i, : segment.stop - segment.start]
        along = np.einsum("tij,tj->ti", turn, np.gradient(-state.gravity_mps2 * turn[:, 2], axis=0))
        along[:, 2] = 0
        moving = np.linalg.norm(along, axis=1)
        moving *= moving > 0.05 * moving.max()
        push = along * (moving > 0)[:, None]
        push -= (moving**2 / max(np.sum(moving**2), 1e-30))[:, None] * push.sum(axis=0)  # the velocity ends at zero
        logs[segment.log][segment.start : segment.stop] += size * np.einsum("tji,tj->ti", turn, push)
    made = copy.copy(twin)
    made.__dict__.pop("movements", None)
    samples = [replace(log.samples, accel=accel) for log, accel in zip(twin.seen.logs, logs, strict=True)]
    made.seen = replace(twin.seen, logs=[replace(log, samples=each) for log, each in zip(twin.seen.logs, samples, strict=True)])
    return made


def test_a_hand_that_accelerates_with_the_turn_makes_no_delay(twin_of):
    """The specific force itself takes it for one, as on ../shared/mikov."""
    twin, whiten = twin_of()
    fit = refit(twin, whiten, [], twin.start())
    moved = pushed(twin, fit, size=3.0)
    naive = lever_equations(moved, fit).solve()[3] - lever_equations(twin, fit).solve()[3]
    assert abs(naive) > 4e-3
    apart = velocity_equations(moved, fit).solve()[3] - velocity_equations(twin, fit).solve()[3]
    assert abs(apart) < 0.1 * abs(naive)


@pytest.mark.parametrize("folder", ["imu0", "imu2", "imu4"])
@pytest.mark.slow
def test_a_real_delay_agrees_with_differences_of_accelerometers(shared, folder):
    """7.3 to 7.8 ms, within 3 sigma; the specific force itself gave 12.5 ms, with a sigma of 1 ms, in imu0."""
    from tinygc.closure.prepared import prepare
    from tinygc.noise.components import known_whitener
    from tinygc.noise.twin import Twin

    twin = Twin(prepare(shared / "mikov" / folder).as_given().problem)
    found = turn_gravity(twin, refit(twin, known_whitener(twin), [], twin.start()))
    assert 1e3 * found.offset_s == pytest.approx(7.55, abs=3 * np.hypot(0.3, 1e3 * found.sigma_s))
