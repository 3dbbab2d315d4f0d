"""``compare``: accelerometers side by side, and calibrations of rates that were fitted in different body frames."""

import re
import shutil
import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calibrate
from session.detect.accelerometer import PARAMETERS
from session.io.config import Accelerometer
from tinygc.estimation.compare import SessionTriad, agreement, compare, into_frame_of, read_calibrated
from tinygc.models.linear import BIAS, MATRIX

TURN = Rotation.from_rotvec([0.010, -0.006, 0.008])


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Two days of one unit; the second also with another frame, without a calibration, and with an accelerometer that has moved."""
    top = tmp_path_factory.mktemp("days")
    for name, seed in (("monday", 1), ("tuesday", 2)):
        options = ["--segments", "20", "--closure", "0", "--odr-hz", "104", "--quiet", "--unit-seed", "9"]
        assert calibrate.main(["simulate", "--out", str(top / name), "--seed", str(seed), *options]) == 0
    for name in ("turned", "bare", "unlike"):
        shutil.copytree(top / "tuesday", top / name)
    text = (top / "tuesday" / "session.toml").read_text()
    given = tomllib.loads(text)["accelerometer"]
    turned = (TURN.as_matrix() @ np.array(given["matrix"])).tolist()
    (top / "turned" / "session.toml").write_text(re.sub(r"matrix = .*", f"matrix = {turned}", text))
    head, rest = text.split("[accelerometer]")
    (top / "bare" / "session.toml").write_text(head + "[" + rest.split("\n[", 1)[1])
    for name in ("monday", "tuesday", "turned", "bare"):
        assert calibrate.main(["fit", str(top / name), "--methods", "least_squares", "--folds", "2", "--quiet"]) == 0
    return top


def read(days, *names):
    return [read_calibrated(days / name) for name in names]


@pytest.mark.slow
@pytest.mark.parametrize("other", ["turned", "bare"])
def test_sessions_in_different_body_frames_are_compared_in_one(days, other):
    """The same log with another frame of the given matrix, or in its own triad's: E is the same sensor's."""
    same, there = compare(read(days, "monday", "tuesday")), compare(read(days, "monday", other))
    for word in ("lasting", "bias"):
        assert getattr(there, word).chi_square == pytest.approx(getattr(same, word).chi_square, abs=0.5)
    assert (np.abs(there.values - same.values) < 0.3 * same.sigmas).all()
    assert any("another body frame" in note for note in there.notes)
    assert not any("another body frame" in note for note in same.notes)
    # As they stand, they are far apart: ten milliradians of misalignment.
    monday, tuesday = read(days, "monday", other)
    apart = agreement(*(np.array([getattr(s, name) for s in (monday, tuesday)]) for name in ("vector", "covariance")))
    assert apart.p_value < 1e-6


@pytest.mark.slow
def test_the_accelerometers_of_one_sensor_agree_and_one_that_moved_does_not(days):
    for names in (("monday", "tuesday"), ("monday", "turned"), ("monday", "bare")):
        assert compare(read(days, *names)).triads.agreement.p_value > 0.01, names
    monday, bare = read(days, "monday", "bare")
    moved = Accelerometer(
        bare.triad.calibration.matrix, bare.triad.calibration.bias_mps2 + np.array([0.2, 0, 0])
    )  # 20 mg, ten times what a switch-on does
    object.__setattr__(bare, "triad", SessionTriad("fit", moved, bare.triad.covariance, bare.triad.shared))
    assert compare([monday, bare]).triads.agreement.p_value < 1e-6


@pytest.mark.slow
def test_what_was_given_to_both_is_shared_and_what_each_estimated_is_not(days):
    same, own = compare(read(days, "monday", "tuesday")), compare(read(days, "monday", "bare"))
    scale = [label[:2] == ("scale factor error", "x") for label in same.labels]
    assert (same.sigmas[1, scale] <= own.sigmas[1, scale]).all()
    monday, bare = read(days, "monday", "bare")
    assert monday.triad.mode == "prior"
    assert np.linalg.eigvalsh(monday.triad.covariance - monday.triad.shared).min() > -1e-18
    assert bare.triad.mode == "fit"
    assert not bare.triad.shared.any()
    # 0.1 mg at one g of the scale that all axes share cancels between sessions that were given it, and nothing is left to compare.
    assert same.triads.agreement.freedom == PARAMETERS - 1
    assert own.triads.agreement.freedom == PARAMETERS


def test_a_turn_into_one_frame_is_exact():
    upper = np.array([[1.01, 0.002, -0.004], [0, 0.99, 0.003], [0, 0, 1.005]])
    one, other = SessionTriad("given", Accelerometer(upper)), SessionTriad("given", Accelerometer(TURN.as_matrix() @ upper))
    rng = np.random.default_rng(0)
    E, B, m = np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.01 * rng.normal(size=3), rng.normal(size=3)
    vector = np.concatenate([E.ravel(), B])
    turned = into_frame_of(one, other) @ vector
    omega = turned[MATRIX].reshape(3, 3) @ m + turned[BIAS]
    np.testing.assert_allclose(omega, TURN.as_matrix().T @ (E @ m + B), atol=1e-15)
    np.testing.assert_array_equal(into_frame_of(one, one) @ vector, vector)
