"""Sessions of one unit, compared by their uncertainties: what moved is found, and called by its name."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, config
from scipy import stats

import calibrate
from session.base.errors import FormatError
from session.base.units import MG, STANDARD_GRAVITY_MPS2
from session.detect.accelerometer import PARAMETERS, units
from session.log.config import Accelerometer
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.spread import USUAL
from tinygc.features.unit.history.comparison import compare_calibrated, compare_triads
from tinygc.fitting.unit_state import UnitState, fitted_state
from tinygc.inference.choose import agreement
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_table


def test_two_sessions_are_judged_by_their_difference():
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(2, 5, 5)) * np.array([1e-6, 1e-3, 1, 1, 10])[None, :, None]
    covariances, vectors = roots @ roots.transpose(0, 2, 1), rng.normal(size=(2, 5))
    found, d = agreement(vectors, covariances), vectors[0] - vectors[1]
    assert found.chi_square == pytest.approx(d @ np.linalg.solve(covariances.sum(axis=0), d), rel=1e-6)
    assert (found.freedom, found.p_value) == (5, pytest.approx(stats.chi2.sf(found.chi_square, 5)))


@pytest.fixture(scope="module")
def monday(tmp_path_factory):
    """A simulated session, fitted by the command line."""
    folder = tmp_path_factory.mktemp("days") / "monday"
    for words in (
        ["simulate", "--out", str(folder), "--seed", "1", "--segments", "9", "--closure", "0", "--odr-hz", "62.5"],
        ["fit", str(folder), "--methods", "least_squares"],
    ):
        assert calibrate.main([*words, "--quiet"]) == 0
    return folder


def test_what_moved_is_found_with_its_size_and_a_bias_is_another_one_after_each_switch_on(monday):
    """Whoever left it on asks for it."""
    first = fitted_state(monday)
    sigma = np.sqrt(np.diag(first.covariance))
    scale, bias = np.zeros((2, len(sigma)))
    scale[0], bias[10] = -30 * sigma[0], 60 * sigma[10]

    def tuesday(moved):
        model = LinearModel.from_vector(first.vector + moved)
        return replace(first, folder=first.folder.with_name("tuesday"), model=model, table=first.table | {"sha256": {"log": "x"}})

    found = compare_calibrated([first, tuesday(scale)])
    moved = found.moved[0]
    assert found.verdict == found.lasting
    assert found.lasting.p_value < 1e-6
    assert (moved.session, moved.name, moved.component, moved.unit) == ("tuesday", "scale factor error", "x", "ppm")
    assert moved.by == pytest.approx(1e6 * 30 * sigma[0] / first.vector[0] ** 2, rel=0.02)
    assert abs(moved.sigmas) > 30 / np.sqrt(2)  # what both have of one given accelerometer is no difference
    found = compare_calibrated([first, tuesday(bias)])
    assert found.lasting.p_value > 0.01 > 1e-6 > found.bias.p_value
    assert (found.verdict == found.lasting, found.moved) == (True, ())
    asked = compare_calibrated([first, tuesday(bias)], bias=True)
    assert (asked.moved[0].name, asked.moved[0].component) == ("bias", "y")
    assert asked.moved[0].by == pytest.approx(-60 * sigma[10] / DEG, rel=0.05)


def test_the_command_says_whether_they_agree_and_what_a_session_does_not_observe(monday, tmp_path, run):
    path = shutil.copytree(monday, tmp_path / "flat")
    model, fit = path / "fit" / "model_least_squares.json", path / "fit" / "fit.json"
    model.write_text(json.dumps({**json.loads(model.read_text()), "unobserved": ["E_xy"], "sha256": {"log": "another file"}}))
    code, out, _ = run("history", monday, path, "--compare", "--json", tmp_path / "table.json")
    table = json.loads((tmp_path / "table.json").read_text())
    assert (code, table["agree"], table["sessions"]) == (0, True, ["monday", "flat"])
    assert ("AGREE: scale factors, misalignments (p" in out, "E_xy" in out) == (True, True)
    fit.write_text("{")
    with pytest.raises(FormatError, match=r"fit\.json"):
        fitted_state(path)


def test_bad_input_gets_one_line(monday, tmp_path, run):
    unfitted = shutil.copytree(monday, tmp_path / "unfitted", ignore=shutil.ignore_patterns("fit"))
    broken = shutil.copytree(monday, tmp_path / "broken")
    path = broken / "fit" / "model_least_squares.json"
    table = json.loads(path.read_text())
    for covariance, word in ((None, "12 x 12"), ((-np.eye(12)).tolist(), "positive")):
        path.write_text(json.dumps({**table, "covariance": covariance}))
        code, _, err = run("history", monday, broken, "--compare")
        assert (code, err.count("\n"), word in err) == (2, 1, True)
    for others, word in (
        ([], "two sessions"),
        ([tmp_path / "none"], "no such folder"),
        ([unfitted], "calibrate.py fit"),
        ([monday], "same log"),
    ):
        code, _, err = run("history", monday, *others, "--compare")
        assert (code, err.count("\n"), word in err) == (2, 1, True)


def test_triads_of_different_frames_are_compared_with_the_sensors_own_sigmas():
    """A bias of the sensor's x has moved, beside a session in another frame, which knows it as well as its own y's; each session is one
    draw of what a switch-on does."""
    upper = np.eye(3) + 0.01 * np.array([[1, -1, 0.5], [0, -0.5, 1], [0, 0, 0.7]])
    sigmas_mps2 = MG * np.array([0.02, 0.05, 0.08, 0.11, 0.14, 0.17, 0.20, 0.23, 0.26])
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    covariance = np.diag((sigmas_mps2 * units(STANDARD_GRAVITY_MPS2)) ** 2)
    moved = np.array([10.0 * MG, 0, 0])
    one, other = (
        AccelerometerFit("fit", Accelerometer(turn @ upper, bias), covariance)
        for turn, bias in ((np.eye(3), np.zeros(3)), (quarter, moved))
    )
    sessions = []
    for triad in (one, other):
        joint = np.pad(covariance, (0, 12))
        table = {"accelerometer": accelerometer_table(triad.calibration), "joint_covariance": {"matrix": joint}}
        sessions.append(UnitState(Path(), LinearModel(np.eye(3), np.zeros(3)), table, {"accelerometer": {"mode": "fit"}}, Path(), config()))
    sigma = np.sqrt(one.sigmas[6] ** 2 + other.sigmas[6] ** 2 + 2 * USUAL.scatter[6] ** 2)
    found = compare_triads(sessions)
    assert found.freedom == PARAMETERS
    assert found.chi_square == pytest.approx((10 * MG / sigma) ** 2, rel=0.03)
