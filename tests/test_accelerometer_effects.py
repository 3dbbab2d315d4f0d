"""Effects of the accelerometer: equations by hand, undone exactly, seen beside nine numbers of the same stills; a zero that drifts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import GRAVITY, broad
from known_effects import measured_force, movement

from session.detect.accelerometer import DRIFT_P, IDENTITY, LengthFit, corrected, fit_lengths, length_columns
from session.io.config import Accelerometer
from session.io.units import MG, G
from tinygc.closure.prepared import prepare
from tinygc.effects import Movement, catalogue
from tinygc.estimation.accelerometer import accelerometer_fit, of_lengths
from tinygc.noise.twin import Twin
from tinygc.reporting.fit_text import accelerometer_table

FORCE = np.array([0.5, -0.8, 0.3])  #: g
#: one of each number (1, 2, 3, …) in its unit, at 250 s of 1000 s and 5 degC above the first temperature; mg that it adds to x, y, z
BY_HAND = {
    "accelerometer.zero_drift": [-0.25, -0.5, -0.75],
    "accelerometer.thermal_zero": [5, 10, 15],
    "accelerometer.thermal_scale": [5 * 0.5e-3, 10 * -0.8e-3, 15 * 0.3e-3],
    "accelerometer.scale_asymmetry": [0.5e-3, 2 * 0.8e-3, 3 * 0.3e-3],
    "accelerometer.nonlinearity": [0.25, 2 * 0.64, 3 * 0.09],
    # x with y and z, y with z and x, z with x and y
    "accelerometer.cross_coupling": [0.5 * (-0.8 + 2 * 0.3), -0.8 * (3 * 0.3 + 4 * 0.5), 0.3 * (5 * 0.5 + 6 * -0.8)],
}
#: the accelerometer's matrix and zero, as a correction
TRIANGLE, ZERO = np.array([[1.01, 0.004, -0.003], [0, 0.99, 0.002], [0, 0, 1.02]]), np.array([0.3, -0.2, 0.1])
SHEARS = [1, 2, 4]


def at_rest(up: np.ndarray, t_s: np.ndarray, duration_s: float) -> Movement:
    count = np.zeros(len(up))
    return Movement(t_s, 1.0, np.zeros_like(up), up, 25 + t_s / 50, count, duration_s, 1.0, 25.0)


def attitudes(count: int, rng) -> np.ndarray:
    up = rng.normal(size=(count, 3))
    return up / np.linalg.norm(up, axis=1, keepdims=True)


@pytest.mark.parametrize("name", BY_HAND)
def test_each_adds_what_its_equation_says(name):
    effect = catalogue()[name]
    moved = at_rest(FORCE[None], np.array([250.0]), 1000.0)
    theta = np.arange(1, effect.parameter.size + 1) * effect.parameter.si
    np.testing.assert_allclose((effect.bent(moved) @ theta)[0] / MG, BY_HAND[name], rtol=1e-12)


@pytest.mark.parametrize("name", [*BY_HAND, "reference.accelerometer"])
def test_what_it_adds_is_said_of_what_is_measured(name):
    effect, moved = catalogue()[name], movement()
    for form in effect.variants(np.zeros(0)):
        theta = 0.3 * form.parameter.plausible * np.random.default_rng(1).normal(size=form.parameter.size)
        measured = measured_force(form, moved, theta)
        assert np.abs(measured - moved.force_g).max() > 1e-4
        added = form.bent(replace(moved, force_g=measured)) @ theta / G
        np.testing.assert_allclose(measured - added, moved.force_g, atol=1e-11)


def test_nine_numbers_of_the_same_stills_take_up_a_part_of_an_effect():
    """What is left in the lengths after the nine were fitted is what the twin says of the effect, to first order."""
    rng = np.random.default_rng(3)
    up, t_s = attitudes(24, rng), np.linspace(20, 980, 24)
    for name in BY_HAND:
        effect = catalogue()[name]
        theta = 1e-2 * effect.parameter.plausible * rng.normal(size=effect.parameter.size)
        force = G * measured_force(effect, at_rest(up, t_s, 1000.0), theta)
        x = IDENTITY.copy()
        for _ in range(5):
            x = x - np.linalg.lstsq(length_columns(x, force), np.linalg.norm(corrected(x, force), axis=1) - G, rcond=None)[0]
        now = corrected(x, force)
        twin = SimpleNamespace(own_accelerometer=True, force=now, rests=at_rest(now / G, t_s, 1000.0), problem=SimpleNamespace(joint=None))
        twin._taken_up = lambda effect, twin=twin: Twin._taken_up(twin, effect)
        twin.segments, twin.batch, twin._known_taken_up = [], SimpleNamespace(angles=2), {}
        left = np.linalg.norm(now, axis=1) - G
        says = np.einsum("qi,qi->q", up, Twin.bent(twin, effect, twin.rests) @ theta)
        np.testing.assert_allclose(says, left, atol=0.02 * np.abs(left).max())
        twin.own_accelerometer = False
        np.testing.assert_array_equal(Twin.bent(twin, effect, twin.rests), effect.bent(twin.rests))


# A drift of the zero beside the nine numbers


def drifting(count: int, seed: int, drift_mg: float, noise_mg: float = 0.1) -> tuple[LengthFit, LengthFit, np.ndarray]:
    """The fit with the stills' times and without; and the drift, m/s^2 over the session, in the sensor's axes."""
    rng = np.random.default_rng(seed)
    up, t_s = attitudes(count, rng), 30.0 * (np.arange(count) + 0.5)
    drift = drift_mg * MG * rng.choice((-1, 1), 3) * rng.uniform(0.5, 1.5, 3)
    force = GRAVITY * up @ np.linalg.inv(TRIANGLE).T + ZERO + (t_s / (30 * count) - 0.5)[:, None] * drift
    force = force + noise_mg * MG * rng.normal(size=force.shape)
    return fit_lengths(force, GRAVITY, middle_s=t_s, duration_s=30.0 * count), fit_lengths(force, GRAVITY), drift


def test_a_drift_is_found_and_is_no_nonorthogonality():
    found, unnamed, drift = drifting(24, 1, 4.0)
    assert found.drift.significant
    assert found.drift.duration_s == 720
    assert np.abs((found.drift.mps2 - drift) / found.drift.sigma_mps2).max() < 3
    assert found.drift.sigma_mps2.max() < 0.5 * MG
    true = TRIANGLE[np.triu_indices(3)][SHEARS]
    assert np.abs(unnamed.x[SHEARS] - true).max() > 5 * np.abs(found.x[SHEARS] - true).max()
    assert np.abs((found.x[SHEARS] - true) / np.sqrt(np.diag(found.covariance))[SHEARS]).max() < 3
    np.testing.assert_allclose(found.x[6:], ZERO, atol=0.2 * MG)  # the zero at the middle of the session
    assert np.std(found.after) < 0.3 * np.std(unnamed.after)
    assert "mg on" in found.drift.words


def test_a_constant_zero_is_bounded_and_widens_the_sigmas():
    """What is not significant may still be there."""
    found, plain, _ = drifting(24, 2, 0.0)
    assert not found.drift.significant
    assert found.drift.p_value > DRIFT_P == 0.01
    assert (np.diag(found.covariance) / found.sigma_mps2**2 > 0.95 * np.diag(plain.covariance) / plain.sigma_mps2**2).all()
    assert np.abs((found.x - plain.x) / np.sqrt(np.diag(found.covariance))).max() < 2
    assert plain.drift is None
    assert drifting(14, 2, 4.0)[0].drift is None  # five stills to spare
    assert drifting(15, 2, 4.0)[0].drift is not None


def test_a_fit_states_the_drift_in_mg_per_1000_s():
    found, *_ = drifting(24, 1, 4.0)
    said, per_1000s = of_lengths(found).to_json()["zero_drift"], 1000 / 720 / MG
    np.testing.assert_allclose(said["mg_per_1000s"], found.drift.mps2 * per_1000s)
    np.testing.assert_allclose(said["sigma"], found.drift.sigma_mps2 * per_1000s)
    assert (said["significant"], said["p_value"]) == (True, found.drift.p_value)
    table = accelerometer_table(of_lengths(found), "title")
    row = [list(column.cells)[-1] for column in table.columns]
    assert row[0] == "drift of the bias, mg/1000s"
    assert row[1].startswith(f"{said['mg_per_1000s'][0]:.2f} ± ")


def test_a_drift_is_in_the_axes_of_the_sensor():
    """Under a calibration that turns the frame by a quarter, it is the same drift of what was measured."""
    rng = np.random.default_rng(4)
    up, t_s = attitudes(30, rng), np.arange(30.0)
    drift = MG * np.array([5.0, -1.0, 2.0])
    measured = GRAVITY * up + (t_s / 30 - 0.5)[:, None] * drift + 1e-3 * MG * rng.normal(size=up.shape)
    turned = Accelerometer(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), np.zeros(3))
    found = fit_lengths(turned.correct(measured), GRAVITY, turned, middle_s=t_s, duration_s=30.0)
    np.testing.assert_allclose(found.drift.mps2, drift, atol=0.02 * MG)
    assert np.abs((found.drift.mps2 - drift) / found.drift.sigma_mps2).max() < 4


@pytest.mark.slow
def test_eight_sensors_on_one_board_drift_and_keep_their_axes(shared, tmp_path):
    """mimu, its seventh day: every zero falls, gravity's length then fits, and nonorthogonality is that of the fifth day."""
    from benchmarks.public import mimu

    if not (source := shared / "wild" / "mimu").exists():
        pytest.skip("no ../shared/wild/mimu: recordings of eight MPU-9150")
    folders = {folder.name: folder for folder in mimu.write(source, tmp_path)}
    apart = {"with": [], "without": []}
    for unit in range(8):
        days = [prepare(folders[f"e{day}u{unit}"]) for day in (5, 7)]
        drift = days[1].problem.joint.drift
        size, sigma = drift.mps2 / MG * 500 / drift.duration_s, drift.sigma_mps2 / MG * 500 / drift.duration_s
        axis = int(np.argmax(np.abs(size) / sigma))
        assert -6 < size[axis] < -1
        assert size[axis] < -2.5 * sigma[axis]
        with_it, without = (np.std(each.joint.after[:-1]) for each in (days[1].problem, days[1].given))
        assert with_it < 0.7 * without
        for name, problems in (("with", [day.problem for day in days]), ("without", [day.given for day in days])):
            apart[name].append(np.subtract(*(_values(problem) for problem in problems)))
    assert np.std(apart["with"]) < 0.4 * np.std(apart["without"])


def _values(problem) -> np.ndarray:
    return accelerometer_fit(problem.session.config.accelerometer, problem.joint, None, GRAVITY).values[SHEARS]


@pytest.mark.parametrize("seed", [5, broad(6)])
def test_a_still_that_misses_by_far_makes_no_drift(seed):
    """A knock moves the zero of the last still alone, which leans on a line in time more than any other."""
    rng = np.random.default_rng(seed)
    up, t_s = attitudes(21, rng), np.r_[25.0 * np.arange(20), 600.0]
    force = GRAVITY * up + 0.1 * MG * rng.normal(size=up.shape)
    force[-1] += 5 * MG * up[-1]
    assert not fit_lengths(force, GRAVITY, middle_s=t_s, duration_s=610.0).drift.significant
