"""An accelerometer's nine numbers from stills: recovered within what noise allows, unmoved by a bad still, refused where not fixed."""

import tomllib

import numpy as np
import pytest
from conftest import GRAVITY, Table

from session.detect.accelerometer import attitudes_of, fit_lengths, from_stills, with_section
from session.io.config import Accelerometer
from session.io.errors import FormatError
from session.io.units import MG

MATRIX = np.array([[0.99, 0.01, -0.02], [0, 1.01, 0.005], [0, 0, 0.995]])
BIAS = np.array([0.3, -0.2, 0.5])
SIGMA = 2e-4  #: of a still's force, of gravity


def measured(count, rng):
    """What the sensor with these errors reads (S, 3) m/s^2 in stills of random attitudes."""
    up = rng.normal(size=(count, 3))
    force = GRAVITY * (up / np.linalg.norm(up, axis=1, keepdims=True) + rng.normal(0, SIGMA, (count, 3)))
    return as_measured(force)


def as_measured(force):
    return force @ np.linalg.inv(MATRIX).T + BIAS


def left_mg(accelerometer, rng):
    """rms of what the calibration leaves of the errors, over all attitudes."""
    up = rng.normal(size=(500, 3))
    force = GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True)
    return np.sqrt(np.mean((accelerometer.correct(as_measured(force)) - force) ** 2)) / MG


@pytest.mark.parametrize("seed", range(8))
def test_nine_numbers_are_recovered(seed):
    rng = np.random.default_rng(seed)
    found = fit_lengths(measured(24, rng), GRAVITY).accelerometer
    assert left_mg(found, rng) < 0.3
    np.testing.assert_array_equal(found.matrix, np.triu(found.matrix))


@pytest.mark.parametrize("bad", [1, 2])
@pytest.mark.parametrize("seed", range(8))
def test_a_bad_still_moves_nothing(seed, bad):
    rng = np.random.default_rng(seed)
    force = measured(24, rng)
    force[:bad] *= 1 + rng.choice([-1, 1], (bad, 1)) * rng.uniform(0.005, 0.05, (bad, 1))
    assert left_mg(fit_lengths(force, GRAVITY).accelerometer, rng) < 0.6


def test_exact_forces_give_the_exact_numbers():
    up = np.random.default_rng(0).normal(size=(30, 3))
    found = fit_lengths(as_measured(GRAVITY * up / np.linalg.norm(up, axis=1, keepdims=True)), GRAVITY).accelerometer
    np.testing.assert_allclose(found.matrix, MATRIX, atol=1e-7)
    np.testing.assert_allclose(found.bias_mps2, BIAS, atol=1e-6)


FACES = GRAVITY * np.concatenate([np.eye(3), -np.eye(3)])


def test_six_faces_fix_six_numbers_and_say_which_they_leave():
    """Shears are seen by no face: of a sensor that has none, all else is exact."""
    matrix = np.diag(np.diag(MATRIX))
    found = fit_lengths(FACES @ np.linalg.inv(matrix).T + BIAS, GRAVITY)
    assert found.rung.count == 6
    assert found.unobserved == ("nonorthogonality xy", "nonorthogonality xz", "nonorthogonality yz")
    np.testing.assert_allclose(found.accelerometer.matrix, matrix, atol=1e-9)
    np.testing.assert_allclose(found.accelerometer.bias_mps2, BIAS, atol=1e-8)


def test_five_faces_fix_a_bias_and_one_scale():
    found = fit_lengths(0.99 * FACES[:5] + BIAS, GRAVITY)
    assert found.rung.count == 4
    np.testing.assert_allclose(found.accelerometer.matrix, np.eye(3) / 0.99, atol=1e-9)
    np.testing.assert_allclose(found.accelerometer.bias_mps2, BIAS, atol=1e-8)


@pytest.mark.parametrize("force", [np.zeros((12, 3)), np.zeros((0, 3)), np.repeat(FACES[:1], 9, axis=0), FACES[:3]])
def test_one_pose_fixes_nothing_and_nothing_is_changed(force):
    found = fit_lengths(force, GRAVITY)
    assert found.rung is None
    assert found.unobserved == ("all of them",)
    np.testing.assert_array_equal(found.accelerometer.correct(force), force)


def test_a_zero_of_half_a_g_is_found():
    rng = np.random.default_rng(3)
    bias = GRAVITY * np.array([0.02, -0.05, 0.5])
    found = fit_lengths(measured(24, rng) + bias, GRAVITY)
    np.testing.assert_allclose(found.accelerometer.bias_mps2, BIAS + bias, atol=0.3 * MG * 3)


@pytest.mark.slow
def test_stated_sigmas_hold_what_is_found():
    """chi-square of nine numbers over many drawings, and 68 % within one sigma."""
    truth, within = [], []
    for seed in range(200):
        found = fit_lengths(measured(24, np.random.default_rng(1000 + seed)), GRAVITY)
        off = found.x - np.concatenate([MATRIX[np.triu_indices(3)], BIAS])
        truth.append(off @ np.linalg.solve(found.covariance, off))
        within.append(np.abs(off) < np.sqrt(np.diag(found.covariance)))
    assert abs(np.mean(within) - 0.68) < 0.05
    # Student's: the noise itself is estimated from 15 spare lengths.
    assert 8 < np.median(truth) < 11.5


@pytest.mark.parametrize("slant_deg", [0, 10, 30])
def test_turns_about_one_axis_alone_do_not_fix_all(slant_deg):
    about = np.radians(np.arange(0, 360, 15))
    slant = np.radians(slant_deg) * np.where(np.arange(24) % 2, 1, -1)
    up = np.stack([np.cos(slant) * np.cos(about), np.cos(slant) * np.sin(about), np.sin(slant)], axis=1)
    found = fit_lengths(as_measured(GRAVITY * up), GRAVITY)
    assert found.unobserved
    assert (found.rung is None) == (slant_deg == 0)


def test_a_correction_of_a_calibration_is_a_calibration():
    """From what another calibration gives, the same forces follow as from what was measured."""
    rng = np.random.default_rng(5)
    rough = Accelerometer(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), rng.normal(size=3) * 10 * MG)
    force = measured(24, rng)
    found = fit_lengths(rough.correct(force), GRAVITY, rough)
    expected = fit_lengths(force, GRAVITY)
    lengths = np.linalg.norm(found.accelerometer.correct(force), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(expected.accelerometer.correct(force), axis=1), atol=1e-8)


def test_attitudes_that_come_back_count_once():
    assert attitudes_of(GRAVITY * np.array([[0, 0, 1], [0, 0.05, 1], [0, 0, -1], [1, 0, 0], [0, 0, 1]])) == 3


def tumbled():
    table = Table().tumble(24, rest_s=1.6, turn_s=1.5, seed=5)
    samples = table.samples(100.0, registers=False)
    return samples.with_accel(as_measured(samples.accel))


def test_stills_are_found_before_the_accelerometer_is_calibrated():
    found = from_stills([tumbled()], GRAVITY)
    assert left_mg(found, np.random.default_rng(0)) < 0.3


MULTILINE = """schema = "tinygc-session/1"  # [accelerometer] is below

[sensor]
serial = "[odd]"
odr_hz = 208.0
gyro_fs_dps = 500
accel_fs_g = 4

[accelerometer]  # mine
matrix = [
  [1.0, 0.0, 0.0],
  [0.0, 1.0, 0.0],
  [0.0, 0.0, 1.0]
]
bias_mps2 = [0.1, 0.2, 0.3]

[[exclude]]
log = "log0001.csv"
at_s = 3.5

[notes]
said = '[protocol]'
"""


@pytest.mark.parametrize("text", [MULTILINE, MULTILINE.replace("[accelerometer]  # mine", "[other]"), MULTILINE.rstrip()])
def test_a_calibration_is_put_into_a_file_and_nothing_else_is_touched(text):
    made = with_section(text, Accelerometer(MATRIX, BIAS), "of its stills")
    before, after = tomllib.loads(text), tomllib.loads(made)
    found = after.pop("accelerometer")
    before.pop("accelerometer", None)
    assert before == after
    np.testing.assert_allclose(found["matrix"], MATRIX)
    np.testing.assert_allclose(found["bias_mps2"], BIAS)
    assert found["own_stills"] is True


def test_what_cannot_be_replaced_is_refused():
    with pytest.raises(FormatError, match="put this there by hand"):
        with_section('schema = "x"\naccelerometer = { bias_mps2 = [0, 0, 0] }\n', Accelerometer(MATRIX, BIAS), "")
