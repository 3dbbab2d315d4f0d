"""An array's positions with their covariance, and what its fit says and saves: injected and recovered, in its units."""

import json
import math
from dataclasses import replace
from functools import reduce
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from formats_page import strangers
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from session.base.errors import CalibrationError
from session.base.numeric import sigma_of
from session.log.config import LeftOut
from tinygc import SimulationOptions, models
from tinygc.closure.least_squares import OBSERVED_BELOW
from tinygc.closure.residual import closure_angles
from tinygc.features.arrays.events import ArrayEvent
from tinygc.features.arrays.feature import ArrayOptions
from tinygc.features.arrays.fit import (
    fit_array,
)
from tinygc.features.arrays.model import load_array_model
from tinygc.features.arrays.positions import ArrayMotion, _solve_position, positions
from tinygc.features.arrays.recording import read_array
from tinygc.features.arrays.simulation import simulate_array, write_array
from tinygc.features.arrays.units import same_stills
from tinygc.inference.choose import Standing, Statement
from tinygc.models.linear import NAMES, PRIOR_SIGMA
from tinygc.noise.components import undersampling
from tinygc.noise.twin import Twin

G = 9.80665


# Positions.


RATE_HZ = 200.0


TRUTH_M = np.array([0.03, -0.05, 0.02])


def motion(delay_s, turns):
    """Smooth turns of 3 s about all axes; unit 1 sits at TRUTH_M; both forces are late by delay_s."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 4 * turns, 1 / RATE_HZ)
    frequency, phase, size = rng.uniform(0.2, 1.5, (3, 4)), rng.uniform(0, 2 * np.pi, (3, 4)), rng.uniform(0.5, 2, (3, 4))
    w = 2 * np.pi * frequency

    def rate(t, by_time=False):
        at = w * t[:, None, None] + phase
        return (size * (w * np.cos(at) if by_time else np.sin(at))).sum(-1)

    late, force = t - delay_s, 9.8 * Rotation.from_euler("xyz", t[:, None] * [0.3, 0.5, 0.7]).as_matrix()[..., 2]
    omega = rate(late)
    lever = np.cross(rate(late, by_time=True), TRUTH_M) + np.cross(omega, np.cross(omega, TRUTH_M))
    spans = [(0, t[(t > 4 * k + 0.5) & (t < 4 * k + 3.5)]) for k in range(turns)]
    return ArrayMotion([[CubicSpline(t, rate(t))]] * 2, [[CubicSpline(t, force)], [CubicSpline(t, force + lever)]], spans)


def axis_rows(values):
    """Turns (T, n, P) that each show the P numbers directly."""
    return [(np.tile(np.eye(np.shape(turn)[1]), (len(turn), 1)), np.asarray(turn, dtype=float).ravel()) for turn in values]


def test_turns_that_scatter_evenly_have_the_mean_and_its_sigma():
    """Six turns a either side of a mean: all weigh alike; a^2 / 6 times 6 / 4, and half a per cent of the length of three numbers."""
    mean, a = np.array([0.03, -0.04, 0.0, 7.0]), 2e-4
    _, left, (position, covariance) = _solve_position(axis_rows([[mean + s * a] for s in (1, -1, 1, -1, 1, -1)]))
    assert_allclose(position, mean[:3], atol=1e-12)
    assert_allclose(np.diag(covariance), a**2 / 4 + (0.005 * 0.05) ** 2)
    assert_allclose(covariance - np.diag(np.diag(covariance)), a**2 / 4 * (1 - np.eye(3)), atol=1e-15)  # the axes go together
    assert_allclose(np.abs(left), a)


def test_rows_far_off_weigh_less_by_the_cauchy_distribution():
    """The optimum of sum log(1 + (e / bar)^2), bar twice the residuals' robust sigma, by a search; the sandwich of its weights."""
    rng = np.random.default_rng(1)
    values = 0.01 * rng.normal(size=(8, 5, 3))
    values[3, 2] += 5.0
    x, _, (_, covariance) = _solve_position(axis_rows(values))
    flat = values.reshape(-1, 3)
    bar = 2 * float(sigma_of((flat - x).ravel()))
    best = minimize(lambda x: np.log1p(((flat - x) / bar) ** 2).sum(), np.zeros(3), method="Nelder-Mead", tol=1e-9)
    assert_allclose(x, best.x, atol=1e-5)
    e = values - x
    w = 1 / (1 + (e / bar) ** 2)
    scores = (w * e).sum(axis=1) / w.sum(axis=(0, 1))
    sandwich = scores.T @ scores * 8 / 6
    covariance = covariance - np.eye(3) * (0.005 * np.linalg.norm(x)) ** 2
    assert_allclose(covariance, sandwich, rtol=1e-3)


@pytest.mark.parametrize(("turns", "size", "known"), [(4, 1e-3, False), (5, 1e-3, True), (6, 0.0999, True), (6, 0.1001, False)])
def test_fewer_than_five_turns_or_a_sigma_beyond_5_cm_tell_no_position(turns, size, known):
    """Of six turns that are size / sqrt(3) off, variance 3 a^2 / 4 along the diagonal."""
    signs = np.resize([1.0, -1.0], turns)
    found = _solve_position(axis_rows([[[s * size / np.sqrt(3)] * 3] for s in signs]))
    assert (found is not None and found[2] is not None) == known


def test_rows_are_the_force_of_a_lever_and_its_delays():
    """Exact derivatives of two sines: alpha x r + omega x (omega x r), an offset, the first force's change, and the delay's column."""
    t = np.arange(0, 4, 0.005)
    size, w, of_force, r, delay_s = np.array([[1.0, -2, 1.5], [3, 2, 4], [1, 2, 3], [0.1, -0.2, 0.3], [0.0075, 0, 0]])
    omega, force, delay_s = size * np.sin(w * t[:, None]), np.cos(t[:, None] * of_force), delay_s[0]
    moving = ArrayMotion(
        [[CubicSpline(t + delay_s, omega)], [CubicSpline(t + delay_s, 3 * omega)]],  # the mean is twice as fast
        [[CubicSpline(t, force)], [CubicSpline(t, 2 * force)]],
        [(0, t[200:600]), (0, t[:9]), (0, t[:10]), (0, t[-100:] - 0.0025)],
    )
    rows = moving.rows(1, -delay_s, r)
    # the splines' ends, less the longest delay, bound the others: 6 and 4 readings are too near; of the second turn, fewer than 4 are left
    assert [len(values) for _, values in rows] == [3 * 400, 3 * 4, 3 * 96]
    design, values = rows[0]
    at = t[200:600, None]
    omega, alpha, jerk = 2 * size * np.array([np.sin(w * at), w * np.cos(w * at), -(w**2) * np.sin(w * at)])
    lever = np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
    delayed = np.cross(jerk, r) + np.cross(alpha, np.cross(omega, r)) + np.cross(omega, np.cross(alpha, r))
    assert_array_equal(design[:, 3:6], np.tile(np.eye(3), (400, 1)))
    for found, expected, atol in (
        (values, force[200:600], 1e-6),
        (design[:, :3] @ r, lever, 1e-5),
        (design[:, 6], -np.sin(at * of_force) * of_force, 1e-5),
        (design[:, 7], delayed, 1e-2),
    ):
        assert_allclose(found, expected.ravel(), atol=atol)
    assert moving.rows(1, -delay_s)[0][0].shape == (1200, 7)


def test_positions_of_several_units_with_one_delay_of_all():
    """The third unit stands where the second does; four turns tell none."""
    moved = motion(0.008, turns=6)
    found = positions(ArrayMotion(moved.rate + moved.rate[:1], moved.force + moved.force[1:], moved.turns))
    assert not any(each.any() for each in found[0])
    for position, covariance in found[1:]:
        assert_allclose(position, TRUTH_M, atol=2e-4)
        assert np.sqrt(np.trace(covariance)) < 1e-3
    assert positions(ArrayMotion(moved.rate, moved.force, moved.turns[:4]))[1] is None


# One fit from its files on.


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    options = SimulationOptions(segments=9, closure_s=20, odr_hz=62.5, seed=1, still_s=1.0)
    made = simulate_array(options, ArrayOptions(units=2, clock_rate=0.01))
    folder = write_array(made, tmp_path_factory.mktemp("array") / "a")
    told = []
    return made, fit_array(read_array(folder), bias="ends", progress=told.append), told


def test_what_was_injected_comes_back_and_the_others_tell_more_of_each(fitted):
    made, fit, told = fitted
    for unit, true, place in zip(fit.units, made.units, made.truths, strict=True):
        assert np.abs((unit.model.vector - np.append(true.unit.E.ravel(), true.unit.B)) / unit.sigma).max() < 5
        assert np.abs((unit.alone.vector - unit.model.vector) / unit.sigma_alone).max() < 5
        assert (unit.sigma[:9] < unit.sigma_alone[:9]).all()
        assert unit.place.clock.rate == pytest.approx(place.clock.rate, abs=1e-5)
        assert Rotation.from_matrix(unit.place.mounting @ place.mounting.T).magnitude() < 0.05 * DEG
    place, off = fit.units[1].place, fit.units[1].place.position_m - made.truths[1].position_m
    assert np.abs(off).max() < min(1e-3, 5 * np.sqrt(np.linalg.eigvalsh(place.position_covariance)[-1]))
    assert not fit.units[0].place.mounting_covariance.any()
    assert_array_equal(place.mounting_covariance, fit.covariance[45:48, 45:48])
    assert_array_equal(fit.units[1].covariance, fit.covariance[24:48, 24:48])
    assert {"clocks and mountings", "motion beyond the data rate", "positions", "unit 1 alone"} < set(told)
    predicted = []
    for i, unit in enumerate(fit.units):  # figures are rms of tilt: a yaw has no part
        problem = fit.units[i].problem
        tilt = closure_angles(problem.batch, problem.first)[:, :2]
        assert unit.closure_rad == pytest.approx(np.sqrt(np.sum(tilt**2) / len(tilt)))
        assert unit.problem.floor.tilt_rms == pytest.approx(np.sqrt(np.mean([np.trace(own[:2, :2]) for own in problem.floor.white])))
        predicted.append(undersampling(Twin(problem)).predicted_rad)
        assert fit.split.floors_rad[i] == unit.problem.floor.tilt_rms
    assert_allclose(fit.joint.missed_rad, np.sqrt(np.mean(np.square(predicted), axis=0)))


def test_a_turn_left_out_in_one_unit_counts_in_none(fitted):
    fit = fitted[1]
    first, second = fit.units
    problem = second.problem
    out = LeftOut(problem.session.logs[0].path.name, fit.same.time_s[[4, 5], [1, 0]].mean())
    session = replace(problem.session, config=replace(problem.session.config, exclude=(out,)))
    without = replace(second, prepared=replace(second.prepared, problem=replace(problem, session=session)))
    same = same_stills([first, without])
    assert [len(rows) for made in (same_stills(list(fit.units)), same) for rows in made.turns] == [9, 9, 8, 8]
    assert [4, 5] not in same.spans.tolist()


def test_json_has_degrees_and_seconds_of_the_arrays_clock(fitted):
    _, fit, _ = fitted
    begins, log = 2.5, SimpleNamespace(samples=SimpleNamespace(t_ns=np.array([2_500_000_000])))
    turn = ArrayEvent("turn", 1, fit.same.time_s[2, 1], 2.0 * DEG, 1e-4, 2, 3, rival=0)
    still = ArrayEvent("common still", None, fit.same.time_s[4, 0], 0.03 * G, 1e-3, 4, 4)
    step = ArrayEvent("knock", 1, 7.5, 3 * DEG, felt=0.9, units=(0, 1))
    assert step.table(begins) == {
        "what": "knock", "unit": 1, "at_s": 5.0, "units": (0, 1), "size_dps": pytest.approx(3.0), "felt_by_others": 0.9,
        "description": "unit 1 leaps by 3.00°/s, and the others feel 90 % of it: a knock, no false reading",
    }  # fmt: skip
    split = replace(fit.split)
    vars(split).update(
        turn_rad=np.array([3 * DEG, 0.5 * DEG]), fast_rad=np.array([4 * DEG, np.inf]), predicted_rad=2 * DEG,
        gains={"turn": 20.0, "undersampled": 30.0}, minus_mean_rad=np.full(2, math.nan),
        common=Statement("what", Standing.FOR, "test", 0.01, "", "", value=5 * DEG, upper=6 * DEG),
    )  # fmt: skip
    common, sigma, own = split.turns()
    level = np.array(fit.joint.component(-1)) / G * 1e3
    array = SimpleNamespace(name="a", units=[SimpleNamespace(logs=[log])])
    told = replace(fit, array=array, joint=replace(fit.joint, events=(turn, still)), split=split)
    table, time_s, unit, last = json.loads(json.dumps(told.to_json())), fit.same.time_s, fit.units[1], fit.same.spans[-1]

    def at(path):
        return reduce(lambda part, key: part[int(key) if isinstance(part, list) else key], path.split("."), table)

    place, rotation = unit.place, Rotation.from_matrix(unit.place.mounting)
    for path, expected in {
        "events.0.what": "turn", "events.0.unit": 1, "events.0.rival": 0, "events.0.unit_of_size": "deg", "events.0.p_value": 1e-4,
        "events.1.what": "common still", "events.1.unit": None, "events.1.rival": None, "events.1.unit_of_size": "mg",
        "split.minus_mean_rms_deg": None,
        "units.1.closure.minus_mean_rms_deg": None, "split.undersampled_deg.sigma": None, "split.is_fast_motion": True,
        "split.description": split.common.words, "split.common_p_value": 0.01,
    }.items():  # fmt: skip
        assert at(path) == expected, path
    for path, expected in {
        "events.0.at_s": time_s[2, 1] - begins,
        "events.1.at_s": time_s[4, 0] - begins,
        "events.0.size": 2.0,
        "events.1.size": 30.0,
        "split.equal_in_all_turns_deg.size": 3.0,
        "split.equal_in_all_turns_deg.sigma": 0.5,
        "split.level_acceleration_mg.size": level[0],
        "split.level_acceleration_mg.sigma": level[1],
        "split.common_rms_deg": 5.0,
        "split.common_upper95_deg": 6.0,
        "split.undersampled_deg.size": 4.0,
        "split.undersampled_deg.predicted": 2.0,
        "turns.-1.at_s": time_s[last[0], 1] - begins,
        "turns.-1.common_deg": np.linalg.norm(common[-1]) / DEG,
        "turns.-1.common_sigma_deg": np.linalg.norm(sigma[-1]) / DEG,
        "turns.-1.own_deg": own[-1] / DEG,
        "units.1.closure.alone_rms_deg": unit.closure_rad / DEG,
        "units.1.closure.floor_rms_deg": unit.problem.floor.tilt_rms / DEG,
        "units.1.closure.own_rms_deg": split.own_rad[1, 0] / DEG,
        "units.1.closure.own_sigma_deg": split.own_rad[1, 1] / DEG,
        "units.1.noise.gyro_dps_rthz": unit.problem.noise.gyro / DEG,
        "units.1.noise.accel_g_rthz": unit.problem.noise.accel / G,
        "units.1.noise.bias_instability_dph": unit.problem.instability.rps / DEG * 3600,
        "units.1.B_dps": unit.model.B / DEG,
        "units.1.B_sigma_dps": unit.sigma[9:] / DEG,
        "units.1.B_sigma_alone_dps": unit.sigma_alone[9:] / DEG,
        "units.1.clock.rate_ppm": place.clock.rate * 1e6,
        "units.1.clock.rate_sigma_ppm": place.clock.rate_sigma * 1e6,
        "units.1.mounting.rotvec_deg": rotation.as_rotvec(degrees=True),
        "units.1.mounting.sigma_deg": np.sqrt(np.diag(place.mounting_covariance)) / DEG,
        "units.1.position.sigma_m": np.sqrt(np.diag(place.position_covariance)),
    }.items():
        assert_allclose(at(path), expected, rtol=1e-9, err_msg=path)


def test_saved_models_are_by_the_units_own_clocks(fitted, tmp_path):
    """In seconds of its own clock, which runs 1 % off; the array's and the units' files are the fit's JSON."""
    _, fit, _ = fitted
    folder = fit.save(tmp_path / "out")
    table = json.loads((folder / "array.json").read_text())
    assert table == json.loads(json.dumps(fit.to_json()))
    assert not strangers(table)
    fused = load_array_model(folder / "model_array.json")
    assert fused.numbers == (0, 1)
    assert np.allclose(fused.joint_covariance[:12, :12], fit.units[0].covariance[:12, :12])
    for unit, row in zip(fit.units, table["units"], strict=True):
        model, pace = json.loads((folder / row["model"]).read_text()), 1 + unit.place.clock.rate
        assert not strangers(model)
        assert_allclose(models.from_dict(model).vector, unit.model.vector * pace)
        assert_allclose(model["covariance"], unit.covariance[:12, :12] * pace**2)
        assert model["unobserved"] == list(unit.unobserved) == []
    assert abs(pace - 1) > 1e-3
    sigma = np.append(OBSERVED_BELOW * PRIOR_SIGMA * np.resize([0.999, 1.001], 12), np.ones(12))
    assert replace(fit.units[0], covariance=np.diag(sigma**2)).unobserved == NAMES[1::2]
    assert fit.save() == fit.array.folder / "fit"
    with pytest.raises(CalibrationError, match="made of arrays, it has no folder of its own"):
        replace(fit, array=replace(fit.array, folder=tmp_path / "nowhere")).save()


def test_synchronous_units_have_the_same_stamps():
    options = SimulationOptions(segments=1, closure_s=0, odr_hz=62.5, seed=7)
    first, second = simulate_array(options, ArrayOptions(units=2, synchronous=True)).units
    assert np.array_equal(first.log.t_us, second.log.t_us)
