"""Accelerometer and gyroscope in one estimation, on a few turns made from arrays: design, estimate, covariance, weights and p-value beside
numeric derivatives, scipy's rotations and dense matrices."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import GRAVITY, config, wxyz
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from small_turns import TRUE, angles_by_scipy, numeric_jacobian, small_turns, turns_by_scipy, with_known_angles

from session.base.units import DEG, MG
from session.detect.accelerometer import NAMES
from session.detect.segments import Segment
from session.detect.stills import Noise, Still
from session.log.folder import Session
from tinygc.closure.build import tilt_excess
from tinygc.closure.floor import Floor
from tinygc.closure.joint import fit_joint, recalibrated
from tinygc.closure.least_squares import StillRates
from tinygc.closure.problem import Problem, bent
from tinygc.closure.stills import StillSet
from tinygc.models.linear import LinearModel

#: of the sensor's matrix, its upper triangle, and of its bias, m/s^2
OFF = np.array([1.004, 0.003, -0.002, 0.996, 0.004, 1.002, 0.05, -0.03, 0.04])
NEARLY = np.array([1.0005, 0, 0, 1, 0, 1, 0, 0, 0])
SIGMA_RAD = np.array([3e-4, 5e-4])  #: of an end's tilt, about x and y, in the floor
UNITS = np.array([1 / GRAVITY] * 6 + [1.0] * 3)
#: what is known beforehand: 2 % of scale, 1 % of shear, 60 mg; 20 % and 20 dps of the gyroscope
SPREAD = np.concatenate([MG * np.array([20, 10, 10, 20, 10, 20, 60, 60, 60]) * UNITS, [0.2] * 9, [20 * DEG] * 3])
STEP = np.concatenate([1e-5 * np.ones(6), 1e-4 * np.ones(3), 1e-5 * np.ones(12), [1e-4]])


def by_hand(x, force):
    return (force - x[6:9]) @ np.array([x[:3], [0, *x[3:5]], [0, 0, x[5]]]).T


def levelled(q, force):
    """Attitudes (S, 4), rotated the shortest way such that gravity is vertical in them."""
    there = Rotation.from_quat(q, scalar_first=True)
    down = there.apply(-force / np.linalg.norm(force, axis=1, keepdims=True))
    across = np.cross(down, [0, 0, 1.0])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return wxyz(Rotation.from_rotvec(across / np.maximum(size, 1e-15) * np.arctan2(size, down[:, 2:])) * there)


def small(turns=24, stated=False, noise=1.0, bad=0.0, one_axis=False, site_mps2=GRAVITY, off=OFF, seed=0):
    """A chain of turns in two logs, the second of another noise, each with a still more that is no reference; and its stills' noise (Q,).

    stated: net angles are known; noise: of stills and ends, in their sigmas; bad: sigmas by which the tenth still and third end miss.
    """
    rng = np.random.default_rng(seed)
    batch = small_turns(turns, samples=15, seed=seed)
    batch = replace(batch, dt=batch.dt / 10, rate=3 * batch.rate)
    if one_axis:  # all stills lie on one circle
        batch = replace(batch, rate=batch.rate * [1.0, 0, 0] / TRUE.E[0, 0], earth=0 * batch.earth)
    if stated:
        batch = with_known_angles(batch)
    attitudes = [Rotation.from_quat(batch.start[0], scalar_first=True)]
    for turn in turns_by_scipy(batch, TRUE):
        attitudes.append(attitudes[-1] * turn)
    up = Rotation.concatenate(attitudes).inv().apply([0, 0, -GRAVITY])
    seconds, second = rng.uniform(1, 3, turns + 1), np.arange(turns + 1) > turns // 2
    # one-sided densities, m/s^2/sqrt(Hz): half their square is what a mean over 1 s scatters by
    density = np.where(second[:, None], 6e-3 * np.array([0.9, 1.0, 1.1]), 2e-3 * np.array([1.0, 1.2, 0.8]))
    own = np.sqrt(np.mean(density**2, axis=1) / 2 / seconds)
    triangle = np.array([off[:3], [0, *off[3:5]], [0, 0, off[5]]])
    force = up @ np.linalg.inv(triangle).T + off[6:9] + noise * own[:, None] * rng.normal(size=up.shape)
    force[min(9, turns)] *= 1 + bad * own[min(9, turns)] / GRAVITY
    ends = noise * np.append(SIGMA_RAD, 0) * rng.normal(size=(turns, 3))
    ends[2, 0] += bad * SIGMA_RAD[0]
    q = Rotation.concatenate(attitudes)
    batch = replace(batch, start=wxyz(q[:-1]), end=wxyz(Rotation.from_rotvec(ends) * q[1:]))
    none = np.zeros(3)
    stills = [Still(10 * i, 10 * i + 5, 1.0 * i, seconds[i], none, none, f, none, none, 25.0) for i, f in enumerate(force)]
    creeping = replace(stills[0], accel_mean=np.array([1.0, 2.0, 3.0]), problem="creeps")
    segments = [Segment(i, int(second[i]), stills[i], stills[i + 1], 0, 1, 0.0, 1.0, 1.0, 90.0) for i in range(turns)]
    segments.insert(2, replace(segments[1], problem="left out"))
    parts = [[stills[0], creeping, *stills[1 : turns // 2 + 1]], [*stills[turns // 2 + 1 :], creeping]]
    rows = [density[0], density[-1]]
    samples = [SimpleNamespace(duration_s=turns + 5.0) for _ in rows]
    logs = [
        StillSet(*of, Noise(none, row), np.zeros((len(of[1]), 4)), np.zeros(len(of[1]), int))
        for *of, row in zip(samples, parts, rows, strict=True)
    ]
    own_floor = np.tile(np.diag(np.append(SIGMA_RAD**2, [1e-8] * stated)), (turns, 1, 1))
    floor = Floor(own_floor, np.zeros((turns - 1, *[2 + stated] * 2)), 7.0)  # the excess is estimated anew
    made = config()
    session = Session(Path("made"), replace(made, site=replace(made.site, gravity_mps2=site_mps2)), (), ())
    first = LinearModel.from_vector(TRUE.vector + 0.002 * rng.normal(size=12))
    return Problem(session, segments, batch, floor, {}, logs, first, None, None), force, own


def residuals(problem, force):
    """The closure's angles and the lengths as a function of the 22 numbers."""
    count = len(problem.batch)

    def rows(at):
        now = by_hand(at[:9], force)
        start, end = levelled(problem.batch.start, now[:count]), levelled(problem.batch.end, now[1 : count + 1])
        batch = replace(problem.batch, start=start, end=end)
        return np.concatenate([angles_by_scipy(batch, at[9:21]).ravel(), np.linalg.norm(now, axis=1) - at[21]])

    return rows


def centre_of(problem, gravity=GRAVITY):
    return np.concatenate([[1.0, 0, 0, 1, 0, 1, 0, 0, 0], problem.first.vector, [gravity]])


KINDS = {"bad": {"bad": 30.0}, "stated": {"stated": True, "seed": 4}, "nowhere": {"site_mps2": None}}


@pytest.mark.parametrize(("kind", "mode"), [("bad", "fit"), ("stated", "prior"), ("nowhere", "fit")])
def test_the_estimate_weighs_lengths_closures_and_what_is_known_beforehand(kind, mode):
    """Its rows are the numeric derivatives, its point the least sum of squares with the stated weights, its covariance (J'WJ + P^-1)^-1."""
    problem, force, _ = small(off=OFF if mode == "fit" else NEARLY, **KINDS[kind])
    found = fit_joint(problem, mode, 0.3, drifts=False)
    gravity, length = (9.80665, 0.02) if kind == "nowhere" else (GRAVITY, 1e-9 * 20 * MG)
    units = np.where(np.arange(9) < 6, 1 / gravity, 1.0)
    prior = np.append(SPREAD, length) if mode == "fit" else np.concatenate([0.3 * MG * units, SPREAD[9:], [20 * MG]])
    prior[:9] *= units / UNITS if mode == "fit" else 1.0
    assert_allclose(found.system.prior, prior)
    at, system = centre_of(problem, gravity) + found.system.x, found.system
    rows = residuals(problem, force)
    jacobian = numeric_jacobian(lambda steps: rows(at + STEP * steps), np.zeros(22), 1.0) / STEP
    off = np.abs(system.design - jacobian).max(axis=0) / np.abs(jacobian).max(axis=0)
    assert off[[*range(9), 21]].max() < 3e-4
    assert off[9:21].max() < (0.05 if kind == "stated" else 3e-3)  # of first order in the coning between two samples
    assert_allclose(system.values, rows(at), atol=2e-8)
    weight = jacobian.T * system.root**2
    covariance = np.linalg.inv(weight @ jacobian + np.diag(prior**-2))
    sigma = np.sqrt(np.diag(covariance))
    assert_allclose(system.covariance / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-2)
    assert_allclose(found.covariance, system.covariance[:9, :9])
    downhill = covariance @ (weight @ rows(at) + system.x / prior**2)
    assert np.abs(downhill / sigma).max() < 0.03
    assert_allclose(system.response, -covariance @ weight, atol=0.01 * np.abs(covariance @ weight).max())
    assert_allclose(found.beforehand, (covariance / prior)[:9, [*range(9), 21]], atol=0.01 * sigma[:9].min())
    assert found.accelerometer.source == ("stills" if mode == "fit" else "prior")
    assert_allclose(found.accelerometer.correct(force), found.force)
    assert_allclose(found.force, by_hand(found.x, force))
    assert_allclose(found.before, np.linalg.norm(force, axis=1) - gravity)
    assert_allclose(found.after, np.linalg.norm(found.force, axis=1) - at[21])


@pytest.mark.parametrize("kind", ["bad", "stated", "few"])
def test_a_row_weighs_as_its_sigma_and_the_misfit_of_its_kind_say(kind):
    """Lengths: the still's white noise; ends: the floor; both times the spread of their kind, as far as the 22 numbers leave it (a tenth at
    least), where that is above 1.  Cauchy's weights beyond twice that, of a turn's two angles together; a stated angle keeps its stop's
    sigma."""
    problem, _, own = small(**({"turns": 6, "noise": 3.0} if kind == "few" else KINDS[kind]))
    system, d = fit_joint(problem, "fit").system, problem.batch.angles
    count = len(problem.batch) * d
    tilt = np.tile(np.append(np.full(2, np.sqrt(np.mean(SIGMA_RAD**2))), [1e-4] * (d - 2)), count // d)
    sigma, miss = np.concatenate([tilt, own]), system.values / np.concatenate([tilt, own])
    # The share of each row that the fit takes up: the diagonal of the hat matrix, from the factor Q of the rows and the prior's.
    q, _ = np.linalg.qr(np.concatenate([system.design * system.root[:, None], np.diag(1 / system.prior)]))
    used = np.sum(q[: len(sigma)] ** 2, axis=1)
    stop = (np.arange(len(sigma)) % d == 2) & (np.arange(len(sigma)) < count)
    expected = np.empty(len(sigma))
    for kind_of_row in (np.flatnonzero(~stop[:count]), np.arange(count, len(sigma))):
        left = max(1 - used[kind_of_row].mean(), 0.1)
        size = max(1.0, np.median(np.abs(miss[kind_of_row])) / 0.6745 / np.sqrt(left))
        far = np.abs(miss[kind_of_row])
        if kind_of_row[0] == 0:
            far = np.repeat(np.sqrt(np.mean(far.reshape(-1, 2) ** 2, axis=1)), 2)
        expected[kind_of_row] = 1 / (sigma[kind_of_row] * size * np.sqrt(1 + (far / (2 * size)) ** 2))
    expected[stop] = 1 / (1e-4 * np.sqrt(1 + (miss[stop] / 2) ** 2))
    assert_allclose(system.root, expected, rtol=3e-3)


@pytest.mark.parametrize(("one_axis", "off", "sigma_mg"), [(0, NEARLY, 0.01), (1, NEARLY, 0.5)])
def test_the_p_value_of_a_given_calibration_is_that_of_a_dense_test(one_axis, off, sigma_mg):
    """The nine numbers by generalised least squares, all else having its prior: normal under the given ones with their covariance and the
    sigmas that were stated, in as many directions as the data see."""
    problem, _, _ = small(16, one_axis=one_axis, off=off)
    free = fit_joint(problem, "fit", drifts=False)
    system, stated = free.system, np.concatenate([sigma_mg * MG * UNITS, SPREAD[9:], [20 * MG]])
    own, rest = np.split(system.design * stated, [9], axis=1)
    data = system.values - system.design @ system.x
    scatter = np.diag(system.root**-2.0) + rest @ rest.T
    told = own.T @ np.linalg.solve(scatter, own)
    size, axes = np.linalg.eigh(told)
    axes = axes[:, size > 1e-6]
    estimate = np.linalg.solve(axes.T @ told @ axes, axes.T @ own.T @ np.linalg.solve(scatter, -data))
    covariance = np.linalg.inv(axes.T @ told @ axes) + np.eye(len(estimate))
    expected = chi2.sf(estimate @ np.linalg.solve(covariance, estimate), len(estimate))
    found = fit_joint(problem, "prior", sigma_mg, drifts=False)
    assert found.p_value == pytest.approx(expected, rel=1e-5, abs=1e-300)
    assert fit_joint(problem, "prior", tested=False, drifts=False).p_value is free.p_value is None


def test_a_number_is_observed_below_a_share_of_its_prior_with_gravity_known():
    """The noisier the stills, the fewer numbers are told: each by its own sigma of the dense covariance, gravity's length given."""
    left = []
    for noise in (1.0, 3.0, 6.0, 20.0):
        problem, _, _ = small(one_axis=True, noise=0.0, site_mps2=None)
        logs = [replace(log, noise=replace(log.noise, accel=noise * log.noise.accel)) for log in problem.logs]
        problem = replace(problem, logs=logs, floor=replace(problem.floor, own=problem.floor.own * noise**2))
        found = fit_joint(problem, "fit")
        design, prior = found.system.design[:, :21], found.system.prior[:21]
        sigma = np.sqrt(np.diag(np.linalg.inv((design.T * found.system.root**2) @ design + np.diag(prior**-2))))
        assert found.unobserved == tuple(np.array(NAMES)[sigma[:9] >= 0.1 * prior[:9]])
        left.append(len(found.unobserved))
    assert len(set(left)) > 2


def test_without_a_turn_a_still_or_gravity_there_is_nothing_to_estimate_together():
    problem, *_ = small(turns=10)
    nothing = [
        replace(problem, segments=[replace(s, problem="left out") for s in problem.segments]),
        replace(problem, logs=[replace(log, stills=[replace(s, problem="creeps") for s in log.stills]) for log in problem.logs]),
        replace(problem, session=replace(problem.session, reference=())),
    ]
    assert [fit_joint(each, "fit") for each in nothing] == [None] * 3


def drifting():
    """A problem whose zero drifts over its session; the drift, m/s^2; forces (Q, 3) and shares (Q,) of its stills."""
    problem, force, _ = small(30)
    stills = [still for log in problem.logs for still in log.stills if still.problem is None]
    middle_s = np.array([still.start_s + still.duration_s / 2 for still in stills]) + 35 * (np.arange(31) > 15)
    share, drift = middle_s / 70 - 0.5, np.array([8.0, -5.0, 6.0]) * MG
    moved = {id(still): replace(still, accel_mean=still.accel_mean + part * drift) for still, part in zip(stills, share, strict=True)}
    logs = [replace(log, stills=[moved.get(id(still), still) for still in log.stills]) for log in problem.logs]
    segments = [replace(s, first=moved[id(s.first)], last=moved[id(s.last)]) for s in problem.segments]
    return replace(problem, logs=logs, segments=segments), drift, force + share[:, None] * drift, share


def test_a_drift_of_the_zero_is_estimated_with_the_rest():
    problem, drift, force, share = drifting()
    found = fit_joint(problem, "fit")
    system, count = found.system, len(problem.batch)
    assert found.drift.significant
    assert system.design.shape[1] == len(system.prior) == 25
    assert_allclose(system.prior[22:], 60 * MG)
    rows = lambda at: residuals(problem, force - share[:, None] * at[22:])(at[:22])  # noqa: E731
    at = np.append(centre_of(problem), np.zeros(3)) + system.x
    step = np.append(STEP, [1e-4] * 3)
    jacobian = numeric_jacobian(lambda steps: rows(at + step * steps), np.zeros(25), 1.0) / step
    assert (np.abs(system.design - jacobian).max(axis=0) / np.abs(jacobian).max(axis=0))[[*range(9), *range(21, 25)]].max() < 3e-4
    assert_allclose(system.values, rows(at), atol=2e-8)
    assert np.abs((found.drift.mps2 - drift) / found.drift.sigma_mps2).max() < 4
    assert np.abs((found.x - OFF) / np.sqrt(np.diag(found.covariance))).max() < 4
    assert_allclose(found.moved(force, share), found.force)
    # Left out with the others' drift: what no segment is left out of does not move.
    nothing = np.zeros(count, dtype=bool)
    assert_allclose(found.without(nothing, problem.batch).end, bent(problem.batch, found.first, found.last, found.force).end)


def test_a_problem_with_the_new_calibration_has_its_stills_references_and_weights():
    problem, force, _ = small(turns=12, stated=True, seed=4, noise=4.0)
    attitudes = np.concatenate([problem.batch.start, problem.batch.end[-1:]])
    for log, rows in zip(problem.logs, ([0, 0, *range(1, 7)], [*range(7, 13), 0]), strict=True):
        log.q_tb[:] = attitudes[rows]
    later = SimpleNamespace(samples=lambda: ["a later", "b later"])
    found = SimpleNamespace(samples=lambda: [log.samples for log in problem.logs], recalibrated=lambda session: later)
    rates = StillRates(np.tile(-problem.first.B / np.diag(problem.first.E), (13, 1)), np.zeros((13, 3)), np.full((13, 3), 1e-3))
    joint = fit_joint(problem, "fit")
    now = recalibrated(replace(problem, found=found, still_rates=rates), joint)
    assert (now.found, now.joint, now.first, [log.samples for log in now.logs]) == (later, joint, joint.model, ["a later", "b later"])
    assert now.session.config.accelerometer is joint.accelerometer
    moved = joint.moved(force, joint.share)
    assert_allclose([still.accel_mean for log in now.logs for still in log.stills if still.problem is None], moved)
    assert [s.first.accel_mean @ s.last.accel_mean for s in now.used] == pytest.approx(np.sum(moved[:-1] * moved[1:], axis=1))
    assert_allclose(np.abs(np.sum(now.batch.start * levelled(problem.batch.start, moved[:-1]), axis=1)), 1, atol=1e-12)
    assert_allclose(np.abs(np.sum(now.still_rates.q_tb * levelled(attitudes, moved), axis=1)), 1, atol=1e-7)
    assert_allclose(now.logs[0].q_tb[[0, *range(2, 8)]], now.still_rates.q_tb[:7])
    # Stated angles weigh against tilts, whose excess is what the tilts miss beyond 12 numbers; without stated angles it is left alone.
    assert now.floor.tilt_excess > 2
    assert now.floor.tilt_excess == pytest.approx(
        tilt_excess(now.batch, replace(problem.floor, tilt_excess=1.0), joint.model, now.still_rates)
    )
