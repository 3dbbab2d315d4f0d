"""The bias of the day on arrays: gravity's against an independent search by scipy, the first still's and the rests' by hand."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, GRAVITY, config, wxyz
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from small_sessions import EARTH_T, small_session
from small_turns import PERFECT, TRUE, angles_by_scipy

from session.detect.truth_segments import moments_inside
from session.io.errors import FitError, SegmentError
from session.io.folder import Session, hash_of_log
from session.io.logfile import Log, Truth
from session.io.samples import Samples
from tinygc import models
from tinygc.closure.least_squares import StillRates
from tinygc.estimation import bias_of_day
from tinygc.estimation.bias_of_day import (
    BiasOfDay,
    Origin,
    Rebiased,
    bias_from_gravity,
    false_stills,
    from_gravity,
    from_start,
    origin_of,
    rebias_session,
    rebias_to_json,
    remarks,
)

PERIOD_S, BLOCK = 0.05, 2


def run(gap_s=0.0, without=()):
    """Samples at 20 Hz of a body that turns and sways for 16 s, with noise and a bias; calibrated rates, and its first attitude.

    gap_s: longer than usual from block 80 to the next; without: slices of blocks without a force.
    """
    rng = np.random.default_rng(0)
    t = np.arange(321) * PERIOD_S
    t[80 * BLOCK :] += gap_s
    waves = np.sin(2 * np.pi * (rng.uniform(0.05, 0.3, (3, 4)) * t[:, None, None] + rng.uniform(0, 1, (3, 4)))).sum(axis=2)
    rate = 0.25 * waves
    q = Rotation.from_rotvec([0.3, -0.2, 1.0])
    truth = attitudes(q.as_matrix(), rate, t, None)
    sway = 0.15 * np.sin(2 * np.pi * rng.uniform(0.1, 0.4, 3) * t[:, None] + [0, 1, 2])
    force = np.einsum("tji,tj->ti", truth, sway - [0, 0, GRAVITY]) + [0.03, -0.05, 0.04] + 0.02 * rng.normal(size=rate.shape)
    gyro = rate + np.array([0.08, -0.05, 0.06]) * DEG + 1e-4 * rng.normal(size=rate.shape)
    for some in without:
        force[some.start * BLOCK : some.stop * BLOCK] = 0.0
    return Samples(np.rint(t * 1e9).astype(np.int64), gyro, force), gyro, wxyz(q)


def attitudes(first, rate, t, earth_n):
    """Matrices (N, 3, 3) from body to navigation axes: sensed rates turn it against inertial space, which the Earth's rate turns below."""
    dt = np.diff(t)[:, None]
    vectors = (rate[1:] + rate[:-1]) / 2 * dt + dt**2 / 6 * np.cross(rate[:-1], rate[1:])
    found = [first]
    for step in Rotation.from_rotvec(vectors).as_matrix():
        found.append(found[-1] @ step)
    found = np.array(found)
    if earth_n is None:
        return found
    return Rotation.from_rotvec(-t[:, None] * earth_n).as_matrix() @ found


def searched(samples, rate, q_first, pieces, prior, rest=None, rest_sigma=0.05 * DEG, earth_n=None):
    """Mean bias, its covariance (3, 3), knots and walk: the model's words put down once more, numeric derivatives, all else scipy's.

    pieces: (first, last) block of each uninterrupted one.
    """
    t = samples.t_s - samples.t_s[0]
    blocks = len(t) // BLOCK
    knots = np.linspace(0, t[-1], max(2, round(t[-1] / 10) + 1))
    count, first = len(knots), Rotation.from_quat(q_first, scalar_first=True).as_matrix()
    shares = np.array([np.interp(t[: blocks * BLOCK], knots, hat).mean() for hat in np.eye(count)])

    def mean(values):
        return values[: blocks * BLOCK].reshape(blocks, BLOCK, 3).mean(axis=1)

    def residuals(x):
        walk, accel, tilt, starts = (
            x[: 3 * count].reshape(count, 3),
            x[3 * count : 3 * count + 3],
            x[3 * count + 3 : 3 * count + 5],
            x[3 * count + 5 :],
        )
        bias = np.stack([np.interp(t, knots, axis) for axis in walk.T], axis=1)
        turn = Rotation.from_rotvec([*tilt, 0]).as_matrix() @ attitudes(first, rate + bias, t, earth_n)
        pulled = mean(np.einsum("tij,tj->ti", turn, samples.accel - accel)) + np.array([0, 0, GRAVITY])
        parts = [(shares @ walk) / prior, np.diff(walk, axis=0) / (3e-5 * np.sqrt(np.diff(knots)))[:, None]]
        parts += [accel / 0.1, tilt / (0.5 * DEG), starts / 1.0]
        if rest is not None:
            parts.append((shares @ walk - rest) / rest_sigma)
        for (a, b), start in zip(pieces, starts.reshape(-1, 3), strict=True):
            velocity = start + np.cumsum(pulled[a:b] * BLOCK * PERIOD_S, axis=0)
            keep = np.exp(-BLOCK * PERIOD_S / 2.0)
            parts += [velocity[:1] / 0.5, (velocity[1:] - keep * velocity[:-1]) / (0.5 * np.sqrt(1 - keep**2))]
        return np.concatenate([np.ravel(part) for part in parts])

    scale = np.array([1e-3] * 3 * count + [0.1] * 3 + [0.01] * 2 + [1.0] * 3 * len(pieces))
    found = least_squares(residuals, np.zeros(len(scale)), x_scale=scale, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    to_mean = np.zeros((3, len(scale)))
    to_mean[:, : 3 * count] = np.kron(shares, np.eye(3))
    scaled = found.jac * scale
    covariance = to_mean * scale @ np.linalg.inv(scaled.T @ scaled) @ (to_mean * scale).T
    walk = found.x[: 3 * count].reshape(count, 3)
    return shares @ walk, covariance, knots, walk


def agrees(found, expected):
    change, covariance, knots, walk = expected
    variance, directions = np.linalg.eigh(covariance)
    np.testing.assert_allclose(found.knots_s, knots)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(covariance)), rtol=0.005)
    np.testing.assert_allclose(found.direction_sigma, np.sqrt(variance), rtol=0.005)
    np.testing.assert_allclose(np.abs(np.sum(found.directions * directions.T, axis=1)), 1, atol=0.01)
    np.testing.assert_allclose((found.change - change) / found.sigma, 0, atol=0.01)
    np.testing.assert_allclose((found.walk - walk) / found.sigma, 0, atol=0.01)


CASES = {
    "gravity alone": {},
    "a prior of each axis": {"prior": np.array([0.02, 0.1, 0.01]) * DEG},
    "a rest": {"rest": np.array([-0.1, 0.08, -0.03]) * DEG},
    "a rest of each axis": {"rest": np.array([-0.1, 0.08, -0.03]) * DEG, "rest_sigma": np.array([0.01, 0.02, 0.005]) * DEG},
    "an Earth": {"earth_n": np.array([0.03, 0.0, -0.02]) * DEG},
}


@pytest.mark.parametrize("case", CASES)
def test_gravity_s_bias_and_its_covariance_are_those_of_a_search_by_scipy(case):
    more = CASES[case]
    samples, rate, q_first = run()
    expected = searched(samples, rate, q_first, [(0, 160)], **({"prior": 0.1 * DEG} | more))
    agrees(bias_from_gravity(samples, rate, q_first, gravity_mps2=GRAVITY, **more), expected)


@pytest.mark.parametrize(
    ("gap_s", "without", "pieces"),
    [
        (0.04, [], [(0, 160)]),  # less than one and a half blocks from one to the next
        (0.06, [], [(0, 80), (80, 160)]),
        (0.0, [slice(40, 45), slice(64, 70)], [(0, 40), (70, 160)]),  # 1.9 s between them tell nothing
        (0.0, [slice(40, 45), slice(66, 70)], [(0, 40), (45, 66), (70, 160)]),
        (0.0, [slice(100, 160)], [(0, 100)]),
        (0.06, [slice(0, 79)], [(80, 160)]),  # one block before the gap, or behind it
        (0.06, [slice(81, 160)], [(0, 80)]),
    ],
)
def test_what_interrupts_a_run_leaves_a_velocity_of_its_own_to_each_piece_of_two_seconds(gap_s, without, pieces):
    samples, rate, q_first = run(gap_s, without)
    agrees(bias_from_gravity(samples, rate, q_first, gravity_mps2=GRAVITY), searched(samples, rate, q_first, pieces, 0.1 * DEG))


@pytest.mark.parametrize("count", [16, 8, 5])
def test_of_slow_samples_each_is_a_block_and_two_seconds_are_enough(count):
    samples = Samples(np.arange(count) * (2 * 10**9 // count), np.zeros((count, 3)), np.tile([0, 0, -GRAVITY], (count, 1)))
    level = np.array([1.0, 0, 0, 0])
    assert np.isfinite(bias_from_gravity(samples, samples.gyro, level, gravity_mps2=GRAVITY).sigma).all()
    with pytest.raises(FitError, match="no 2 s of the run"):
        bias_from_gravity(samples.between(0, count - 1), samples.gyro[1:], level, gravity_mps2=GRAVITY)


def test_a_run_without_forces_or_of_no_numbers_is_refused():
    samples, rate, q_first = run()
    with pytest.raises(FitError, match="no 2 s of the run"):
        bias_from_gravity(samples.with_accel(0 * samples.accel), rate, q_first)
    with pytest.raises(FitError, match="left the finite numbers"), np.errstate(all="ignore"):
        bias_from_gravity(samples.with_accel(1e200 * samples.accel), rate, q_first)


def test_a_walk_is_in_excess_by_its_steps_root_mean_square_in_their_own_sigmas():
    """3e-5 rad/s/sqrt(s)."""
    none, sigma = np.zeros(3), 3e-5 * np.sqrt([4.0, 9.0])
    walk = np.cumsum([none, sigma[0] * np.array([1, 2, 3]), sigma[1] * np.array([-2, 0, 4])], axis=0)
    found = BiasOfDay(none, none, np.eye(3), none, np.array([0.0, 4.0, 13.0]), walk)
    assert found.excess == pytest.approx(np.sqrt((1 + 4 + 9 + 4 + 16) / 6))
    assert replace(found, walk=walk / 10).excess == 1.0
    assert replace(found, walk=walk[:1], knots_s=np.zeros(1)).excess == 1.0


def stills_of(change_dps, sigma_dps=1e-6):
    """A problem whose stills read as if the bias had changed by these (Q, 3) dps."""
    change = np.array(change_dps) * DEG
    earth = np.arange(3.0 * len(change)).reshape(-1, 3) * 1e-3
    rate = np.linalg.solve(TRUE.E, (earth - change - TRUE.B).T).T
    return replace(small_session(), still_rates=StillRates(rate, earth, np.full(rate.shape, sigma_dps * DEG)))


def along_z(first, second, others, sigma=1e-6):
    change = np.zeros((2 + len(others), 3))
    change[:, 2] = [first, second, *others]
    return stills_of(change, sigma)


@pytest.mark.parametrize(
    ("others", "sigma", "median", "limit"),
    [
        # A drift: no step is unlike the others, so the distance from the median decides; of the deviations from 3, the median is 2.
        ([0.0, 1, 2, 3, 4, 5, 6], 2.0, 3.0, 5 * np.hypot(2.0, 1.4826 * 2)),
        # To and fro: half of the others are alike, so the step decides; of the deviations from a step of -2, the median is 4.
        ([1.0, -1, 1, -1, 1, -1, 1], 3.0, 1.0, 5 * np.hypot(3.0, 1.4826 * 4)),
    ],
)
def test_a_first_still_is_false_five_sigmas_from_the_others_and_from_its_neighbour(others, sigma, median, limit):
    for side in (-1, 1) if median == others[0] else (-1,):
        for size, false in ((0.9999, 0), (1.0001, 1)):
            found = false_stills(along_z(median + side * size * limit, *others[:1], others[1:], sigma), TRUE)
            assert len(found) == false
    if false:
        assert found == pytest.approx([limit * DEG], rel=1e-3)


@pytest.mark.parametrize("others", [[-1.0, 0, 0, 0, 0], [0.0, -1, -1, -1, -1]])
def test_a_first_still_that_is_just_five_sigmas_off_is_not_false(others):
    """From the others, or from its neighbour; of these, the scatter is nothing."""
    rate = -np.array([[0.0, 0, each] for each in (1.25, *others)])
    stills = StillRates(rate, 0 * rate, np.full(rate.shape, 0.25))
    for sigma, found in ((0.25, 0), (0.2499, 1)):
        problem = replace(small_session(), still_rates=replace(stills, sigma=np.full(rate.shape, sigma)))
        assert len(false_stills(problem, PERFECT)) == found


def test_false_stills_are_passed_over_until_one_agrees_and_of_four_none_is():
    quiet = [0.01, -0.01, 0.01, -0.01, 0.01]
    assert false_stills(along_z(9.0, 5.0, quiet), TRUE) == pytest.approx([9 * DEG - 0.01 * DEG, 5 * DEG - 0.01 * DEG])
    assert false_stills(along_z(9.0, -0.01, quiet[:3]), TRUE) == pytest.approx([9 * DEG], abs=0.011 * DEG)
    assert false_stills(along_z(9.0, -0.01, quiet[:2]), TRUE) == []


def test_the_first_still_that_is_not_false_gives_the_change_and_its_sigma():
    problem = along_z(9.0, 0.0, [0.01, -0.01, 0.01, -0.01])
    sigma = np.arange(1.0, 19).reshape(6, 3)
    problem = replace(problem, still_rates=replace(problem.still_rates, sigma=1e-12 * sigma))
    change, its = from_start(problem, TRUE)
    np.testing.assert_allclose(change, [0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(its, [4e-12, 5e-12, 6e-12])


def test_without_a_still_the_first_rest_gives_the_change_and_its_sigma():
    """2 s at rest between motions."""
    problem = small_session()
    rows = 240
    t_ns = np.arange(rows) * 25_000_000
    motion = np.roll(np.r_[np.zeros(80), np.sin(np.arange(160))], 40)[:, None]
    gyro, force = np.add(motion, [0.01, 0.02, -0.03]), np.add(20 * motion, [0.0, 0.0, -GRAVITY])
    log = replace(problem.logs[0], samples=Samples(t_ns, gyro, force))
    none = StillRates(*np.zeros((3, 0, 3)))
    change, sigma = from_start(replace(problem, still_rates=none, logs=[log]), TRUE)
    np.testing.assert_allclose(change, -(TRUE.E @ [0.01, 0.02, -0.03] + TRUE.B), rtol=1e-9)
    np.testing.assert_allclose(sigma, log.noise.angle_random_walk / np.sqrt(2.0), rtol=0.03)
    moving = replace(log, samples=Samples(t_ns[:100], gyro[120:220], force[120:220]))
    assert from_start(replace(problem, still_rates=none, logs=[moving]), TRUE) is None


def test_gravity_s_bias_of_one_log_is_the_prior_of_the_next_and_widens_with_the_excess(monkeypatch):
    """From the middle of each log's first reference still on; the median of its stills is its rest."""
    problem, seen, excess = small_session(), [], [3.0, 2.0]
    stills = [problem.logs[0].stills[1], *problem.logs[0].stills]  # the first one creeps
    q_tb = np.concatenate([problem.logs[0].q_tb[[1]], problem.logs[0].q_tb])
    group = np.zeros(len(stills), dtype=int)
    problem = replace(problem, logs=[replace(problem.logs[0], stills=stills, q_tb=q_tb, group=group), problem.logs[1]])

    def estimate(samples, rate, q_first, **more):
        number = len(seen)
        seen.append((samples, rate, q_first, more))
        steps = 3e-5 * excess[number] * np.array([[0.0] * 3, [1.0] * 3])
        return BiasOfDay(np.full(3, 0.01 + number), np.full(3, 0.5), np.eye(3), np.arange(3.0), np.arange(2.0), steps)

    monkeypatch.setattr(bias_of_day, "bias_from_gravity", estimate)
    found = from_gravity(problem, TRUE, 0.2)
    for number, (log, (samples, rate, q_first, more)) in enumerate(zip(problem.logs, seen, strict=True)):
        still = log.stills[int(number == 0)]
        row, before = (still.start + still.stop) // 2, 0.01 * number
        np.testing.assert_array_equal(samples.gyro, log.samples.gyro[row:])
        np.testing.assert_allclose(rate, samples.gyro @ TRUE.E.T + TRUE.B + before, rtol=1e-12)
        np.testing.assert_array_equal(q_first, log.q_tb[int(number == 0)])
        at_rest = [TRUE.E @ each.gyro_mean + TRUE.B for each in log.stills if each.problem is None]
        np.testing.assert_allclose(more.pop("rest"), -np.median(at_rest, axis=0) - before, atol=1e-15)
        np.testing.assert_array_equal(more.pop("prior"), 0.5 if number else 0.2)
        np.testing.assert_array_equal(more.pop("earth_n"), EARTH_T)
        assert more == {"gravity_mps2": GRAVITY}
    np.testing.assert_allclose(found.change, 1.02)
    np.testing.assert_allclose(found.sigma, 1.5)
    np.testing.assert_allclose(found.direction_sigma, [0, 3, 6])
    # Beside truths, from the sample nearest to the first of their moments within the log.
    t_ns, q = problem.logs[0].samples.t_ns, wxyz(Rotation.random(3, random_state=2))
    truths = tuple(Truth(Path("t.csv"), t_ns[0] + np.array([-1, 0.3, 0.9]) * 1e9, q) for _ in problem.logs)
    seen.clear()
    excess[:] = 0.5, 1.5
    beside = from_gravity(replace(problem, session=replace(problem.session, truths=truths)), TRUE)
    np.testing.assert_allclose(beside.sigma, 0.75)
    rows, at = moments_inside(problem.logs[0].samples, truths[0])
    np.testing.assert_array_equal(seen[0][0].t_ns, t_ns[rows[0] :])
    np.testing.assert_array_equal(seen[0][2], at[0])
    np.testing.assert_array_equal(seen[0][3]["earth_n"], EARTH_T)
    nowhere = replace(problem, logs=[replace(log, stills=[replace(each, problem="creeps") for each in log.stills]) for log in problem.logs])
    with pytest.raises(SegmentError, match="a log without a still"):
        from_gravity(nowhere, TRUE)


def test_a_stored_bias_is_as_certain_as_its_file_s_days_are_alike(monkeypatch, tmp_path):
    """0.1 dps where the file tells of no days; none is more alike than 1e-6 rad/s.  What the user gives is the reading at rest."""
    problem, change = small_session(), np.array([1e-3, -2e-3, 3e-3])
    found = BiasOfDay(change, np.full(3, 1e-4), np.eye(3), np.zeros(3), np.zeros(1), np.zeros((1, 3)))
    seen = []
    monkeypatch.setattr(bias_of_day, "prepare", lambda *_, **__: SimpleNamespace(problem=problem))
    monkeypatch.setattr(bias_of_day, "read_closure_runs", lambda _: [])
    monkeypatch.setattr(bias_of_day, "from_gravity", lambda problem, model, prior: seen.append(prior) or found)
    path = tmp_path / "m.json"
    for stated, prior in ((None, 0.1 * DEG), ([1e-3, 0.0, 2e-6], [1e-3, 1e-6, 2e-6])):
        path.write_text(json.dumps(models.to_dict(TRUE, bias_sigma_rps=stated)))
        result = rebias_session(tmp_path, path, "gravity", [0.1, -0.2, 0.3])
        np.testing.assert_allclose(seen.pop(), prior)
    assert list(result.changes) == ["start", "gravity", "given"]
    np.testing.assert_allclose(result.model.B, TRUE.B + change)
    np.testing.assert_allclose(result.changes["given"][0], -(TRUE.E @ np.array([0.1, -0.2, 0.3]) * DEG + TRUE.B))
    assert (result.changes["gravity"][1] is found.sigma, result.changes["given"][1]) == (True, None)
    for name, angles in result.angles.items():
        moved = TRUE.vector + np.r_[np.zeros(9), result.changes[name][0] if name in result.changes else np.zeros(3)]
        np.testing.assert_allclose(angles, angles_by_scipy(problem.batch, moved), atol=1e-5)
    none = replace(problem, still_rates=StillRates(*np.zeros((3, 0, 3))))
    monkeypatch.setattr(bias_of_day, "prepare", lambda *_, **__: SimpleNamespace(problem=none))
    with pytest.raises(SegmentError, match="no still and no rest"):
        rebias_session(tmp_path, path, "start")


def rebiased(**more):
    problem = small_session()
    changes = {"start": (np.array([1.0, 2, 3]) * DEG, np.array([3.0, 3, 4]) * DEG), "given": (np.array([0.5, 0, 0]) * DEG, None)}
    changes["gravity"] = (np.array([7.0, 2, 9]) * DEG, np.array([4.0, 4, 3]) * DEG)
    angles = {name: problem.batch.start[:, 1:3] * 1e-3 for name in ("stored", *changes)}
    made = Rebiased(problem, [], TRUE, changes, "start", angles, [], Path("m.json"), Origin("x", False, "said"))
    return replace(made, **more)


def test_start_and_gravity_disagree_by_sigmas_of_their_difference():
    made = rebiased()
    assert made.disagreement == pytest.approx(6 / 5)
    np.testing.assert_allclose(made.model.B, TRUE.B + np.array([1, 2, 3]) * DEG)
    assert replace(made, changes={name: made.changes[name] for name in ("start", "given")}).disagreement == 0
    assert len(remarks(made)) == 1
    for factor, said in ((4.15, 1), (4.18, 2)):  # five sigmas are 25 / 6 = 4.1667 times as much
        changes = {name: (factor * value, sigma) for name, (value, sigma) in made.changes.items()}
        assert len(remarks(replace(made, changes=changes))) == said
    assert "start and gravity differ by 5 sigmas" in remarks(replace(made, changes=changes))[1]


def test_figures_of_a_rebiased_model_are_in_degrees_and_all_held_out():
    made = rebiased()
    table = rebias_to_json(made)
    assert table["bias"]["change_dps"]["gravity"] == pytest.approx([7, 2, 9])
    assert table["bias"]["sigma_dps"] == {"start": pytest.approx([3, 3, 4]), "given": None, "gravity": pytest.approx([4, 4, 3])}
    assert set(table["methods"]) == {"stored", "stored_start", "stored_given", "stored_gravity"}
    rms = np.sqrt(np.mean(np.sum(made.angles["start"] ** 2, axis=1))) / DEG
    figures = table["methods"]["stored_start"]
    assert figures["holdout"]["tilt_rms_deg"] == pytest.approx(rms)
    assert (figures["seconds"], set(figures["train"].values())) == (0.0, {None})
    problem = made.problem
    assert table["segments"]["rejected"] == [{"segment": 0, "why": "left out"}]
    assert (table["segments"]["found"], table["segments"]["used"], table["stills"]) == (8, 7, 10)
    assert table["noise"]["gyro_dps_rthz"] == pytest.approx(problem.noise.gyro / DEG)
    assert table["noise"]["accel_g_rthz"] == pytest.approx(problem.noise.accel / 9.80665)
    assert table["noise"]["gyro_bias_instability_dph"] == pytest.approx(20)
    assert table["noise"]["closure_floor_rms_deg"] == pytest.approx(problem.floor.tilt_rms / DEG)


@pytest.mark.parametrize(
    ("table", "here", "says"),
    [
        ({"session": "made", "sha256": "own"}, True, "this very session"),
        ({"session": "x", "stored": {"session": "first", "sha256": "own"}}, True, "this very session"),
        ({"session": "made", "sha256": "other"}, None, "of the same name (made)"),
        ({"session": "other", "sha256": "other"}, False, "fitted to other logs (other)"),
        ({"sha256": "other"}, False, "fitted to other logs (of a session without a name)"),
        ({"session": "made", "sha256": None}, None, "of the same name (made)"),
        ({"session": "other", "sha256": None}, False, "another session by its name (other)"),
        (
            {"session": "x", "sha256": "own", "stored": {"session": "first", "sha256": "other"}},
            False,
            "had its bias from this very session",
        ),
        ({"session": "x", "sha256": "other", "stored": {"session": "first", "sha256": "other"}}, False, "fitted to other logs (first)"),
        ({}, None, "not known"),
        ({"sha256": [3], "session": ["x"], "stored": 7}, None, "not known"),
    ],
)
def test_what_a_stored_model_was_fitted_to(tmp_path, table, here, says):
    samples, *_ = run()
    session = Session(Path("made"), config(), (Log(Path("log0001.csv"), samples, raw=True, in_memory=True),), ())
    hashes = {"own": {"log0001.csv": hash_of_log(session.logs[0])}, "other": {"log0001.csv": "0" * 64}}

    def told(entry):
        return entry | ({"sha256": hashes.get(entry["sha256"], entry["sha256"])} if isinstance(entry.get("sha256"), str) else {})

    if isinstance(table.get("stored"), dict):
        table = table | {"stored": told(table["stored"])}
    (tmp_path / "m.json").write_text(json.dumps(told(table)))
    found = origin_of(tmp_path / "m.json", session)
    assert found.here is here
    assert says in found.says
    assert ("had its bias" in found.says) == ("had its bias" in says)
