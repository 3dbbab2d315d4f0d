"""Noise at rest that units share: its correlation, sigma and limit where the truth is known, and on the real boards."""

import numpy as np
import pytest

from benchmarks.public import mikov
from session.annexes.arrays.recording import read_array
from session.detect.check_stills import ACCEL_NOISE, GYRO_NOISE
from session.detect.findings import Finding
from tinygc.annexes.arrays.checks import _with_source, noise_of_fits
from tinygc.annexes.arrays.extrinsics import clock_fits
from tinygc.annexes.arrays.rest_noise import SharedNoise, correlated
from tinygc.explanation.standing import Standing


def groups(common: float, units: int = 4, stills: int = 20, blocks: int = 40, seed: int = 0, own: float = 1.0):
    """Differences of neighbouring means: of a motion of the body, and of each unit's own noise, of these sigmas."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(stills):
        body = common * rng.normal(size=(blocks + 1, 3))
        found.append([np.diff(body + own * rng.normal(size=body.shape), axis=0) for _ in range(units)])
    return found


def test_the_sigma_of_independent_noise_is_that_of_differences():
    """A correlation of N differences has variance 1.5 / N: white noise's 1 / N, and twice a quarter for neighbours."""
    values = [correlated(groups(0.0, units=2, stills=5, seed=seed)).value for seed in range(300)]
    assert np.std(values) == pytest.approx(np.sqrt(1.5 / (3 * 5 * 40)), rel=3 / np.sqrt(600))


@pytest.mark.parametrize("common", [0.5, 1.0, 3.0])
def test_a_common_motion_is_found_at_its_share_of_the_power(common):
    shared = correlated(groups(common))
    assert shared.value == pytest.approx(common**2 / (1 + common**2), abs=4 * shared.sigma)
    assert shared.statement("gyro").standing is Standing.FOR
    assert shared.is_common is (common == 3.0) or common == 1.0
    assert shared.is_own is (common == 0.5)


def test_too_few_differences_say_nothing():
    assert correlated(groups(0.0, stills=1, blocks=49)) is None
    assert correlated(groups(0.0, stills=1, blocks=50)) is not None


def test_absence_is_stated_with_its_limit_only():
    shared = SharedNoise(0.01, 0.02)
    assert shared.upper == pytest.approx(0.01 + 1.6449 * 0.02, abs=1e-4)
    assert shared.statement("gyro").words.startswith("motion of the body in the gyro noise at rest: below 4.3 % with 95 %")
    unknown = SharedNoise(0.2, 0.3)
    assert unknown.statement("gyro").standing is Standing.UNDECIDED
    assert unknown.source.endswith("is not told")


def test_a_units_warning_says_what_the_others_tell_of_it():
    finding = Finding("warning", "unit 1: log", GYRO_NOISE, "9 times as much", "does the table vibrate?")
    own = _with_source(finding, {GYRO_NOISE: SharedNoise(0.0, 0.01)})
    assert "this sensor's own" in own.do
    assert "a hand moves the body" in _with_source(finding, {GYRO_NOISE: SharedNoise(0.9, 0.01)}).do
    assert _with_source(finding, {GYRO_NOISE: SharedNoise(0.4, 0.3)}) is finding
    assert _with_source(finding, {ACCEL_NOISE: SharedNoise(0.0, 0.01)}) is finding


def test_the_mikov_body_moves_at_rest(shared, tmp_path):
    (folder,) = mikov.write_array(shared / "mikov", tmp_path / "mikov")
    array = read_array(folder)
    noise = noise_of_fits(array, clock_fits(array))
    assert noise[GYRO_NOISE].is_common
    assert noise[ACCEL_NOISE].is_own
