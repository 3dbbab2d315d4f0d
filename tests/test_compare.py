"""Sessions of one unit, compared by their uncertainties: what moved is found, and called by its name."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG
from scipy import stats

import calibrate
from session.io.errors import FormatError
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.uncertainty import goodness, parameter_covariance
from tinygc.estimation.compare import Calibrated, agreement, compare, read_calibrated
from tinygc.library.sessions import Simulated
from tinygc.models.linear import bias_only
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session, unit_of

SEGMENTS = 14


def calibrated(seed: int, scale_ppm: float = 0.0) -> Calibrated:
    """A session of one simulated unit, whose x axis reads ``scale_ppm`` more, fitted as ``fit`` does."""
    options = SimulationOptions(seed=seed, unit_seed=1, segments=SEGMENTS, closure_s=0.0, odr_hz=104.0)
    unit = unit_of(options)
    unit = replace(unit, E=unit.E @ np.diag([1 / (1 + 1e-6 * scale_ppm), 1, 1]))
    session = Simulated({}, simulate_session(options, unit=unit)).session
    problem = build_problem(session)
    fit = fit_least_squares(problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0]))
    found = goodness(problem.batch, problem.floor, fit.model, problem.wander)
    covariance = found.excess * parameter_covariance(problem.batch, problem.floor, fit.model, problem.earth, None, problem.wander)
    return Calibrated(Path(f"day{seed}"), session.config, fit.model.vector, covariance, fit.unobserved, (str(seed),), ())


@pytest.fixture(scope="module")
def unit():
    """Two quick sessions of one simulated unit: other movements, other noise, the bias wandering by itself in each."""
    return [calibrated(500 + i) for i in range(2)]


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [600.0, -900.0])
def test_a_changed_scale_factor_is_found_and_named(unit, ppm):
    changed = calibrated(700, ppm)
    for sessions in ([unit[0], changed], [unit[0], unit[1], changed]):
        found = compare(sessions)
        assert found.lasting.p_value < 1e-6
        moved = found.moved[0]
        assert (moved.session, moved.name, moved.component, moved.unit) == ("day700", "scale factor error", "x", "ppm")
        assert moved.by == pytest.approx(ppm, abs=4 * abs(moved.by / moved.sigmas))
        assert abs(moved.sigmas) > 5


@pytest.mark.slow
def test_a_changed_bias_is_no_changed_calibration(unit):
    """B is another one after each switch-on; whoever left it on asks for it."""
    other = replace(unit[1], vector=unit[1].vector + np.r_[np.zeros(9), 0, 0.5 * DEG, 0])
    found = compare([unit[0], other])
    assert found.lasting.p_value > 0.01
    assert found.verdict == found.lasting
    assert found.bias.p_value < 1e-6
    assert not found.moved
    asked = compare([unit[0], other], bias=True)
    assert asked.verdict.p_value < 1e-6
    assert (asked.moved[0].name, asked.moved[0].component) == ("bias", "y")


def test_two_sessions_are_judged_by_their_difference():
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(2, 5, 5)) * np.array([1e-6, 1e-3, 1, 1, 10])[None, :, None]
    covariances, vectors = roots @ roots.transpose(0, 2, 1), rng.normal(size=(2, 5))
    found, d = agreement(vectors, covariances), vectors[0] - vectors[1]
    assert found.chi_square == pytest.approx(d @ np.linalg.solve(covariances.sum(axis=0), d), rel=1e-6)
    assert found.freedom == 5
    assert found.p_value == pytest.approx(stats.chi2.sf(found.chi_square, 5))


# The command


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two days of one unit, and one of another, simulated and fitted by the command line."""
    top = tmp_path_factory.mktemp("days")
    for name, seed, unit_seed in (("monday", 1, 9), ("tuesday", 2, 9), ("other", 3, 10)):
        options = ["--segments", "14", "--closure", "0", "--odr-hz", "104", "--quiet"]
        assert calibrate.main(["simulate", "--out", str(top / name), "--seed", str(seed), "--unit-seed", str(unit_seed), *options]) == 0
        assert calibrate.main(["fit", str(top / name), "--methods", "least_squares", "--folds", "2", "--quiet"]) == 0
    return top


def run(folders, *names_and_options):
    return calibrate.main(["compare", *[str(folders / word) if not word.startswith("-") else word for word in names_and_options]])


@pytest.mark.broad
def test_command_says_whether_and_what(folders, capsys):
    assert run(folders, "monday", "tuesday", "--strict") == 0
    said = capsys.readouterr().out
    assert "misalignments agree" in said
    assert "Note" not in said
    assert run(folders, "monday", "other") == 0
    assert run(folders, "monday", "other", "--strict") == 1
    said = capsys.readouterr().out
    assert "DIFFER" in said
    assert "scale factor error" in said
    assert "another sensor by its session.toml" in said


@pytest.mark.broad
def test_limit_is_a_p_value(folders, capsys):
    command = ["compare", str(folders / "monday"), str(folders / "tuesday"), "--json", "-"]
    assert calibrate.main(command) == 0
    table = json.loads(capsys.readouterr().out)
    p = table["lasting"]["p_value"]
    assert table["agree"] is True
    assert table["sessions"] == ["monday", "tuesday"]
    assert len(table["quantities"]) == 12
    assert calibrate.main([*command, "--limit", str(p * 0.99)]) == 0
    assert calibrate.main([*command, "--limit", str(min(p * 1.01, 1.0))]) == 1


def test_bad_input_gets_one_line(folders, tmp_path, capsys):
    unfitted = tmp_path / "unfitted"
    shutil.copytree(folders / "monday", unfitted, ignore=shutil.ignore_patterns("fit"))
    without = tmp_path / "without"
    shutil.copytree(folders / "tuesday", without)
    path = without / "fit" / "model_least_squares.json"
    table = json.loads(path.read_text())
    for covariance, word in ((None, "12 x 12"), ((-np.eye(12)).tolist(), "positive")):
        path.write_text(json.dumps({**table, "covariance": covariance}))
        assert calibrate.main(["compare", str(folders / "monday"), str(without)]) == 2
        assert word in capsys.readouterr().err
    for arguments, word in (
        ([str(folders / "monday")], "two sessions"),
        ([str(folders / "monday"), str(tmp_path / "none")], "session.toml"),
        ([str(folders / "monday"), str(unfitted)], "calibrate.py fit"),
        ([str(folders / "monday"), str(folders / "monday")], "same log"),
    ):
        assert calibrate.main(["compare", *arguments]) == 2
        said = capsys.readouterr().err.strip()
        assert word in said
        assert len(said.splitlines()) == 1


def test_what_a_session_does_not_observe_is_said(folders, tmp_path):
    path = tmp_path / "flat"
    shutil.copytree(folders / "monday", path)
    model = path / "fit" / "model_least_squares.json"
    model.write_text(json.dumps({**json.loads(model.read_text()), "unobserved": ["E_xy"]}))
    found = compare([replace(read_calibrated(path), hashes=("x",)), read_calibrated(folders / "tuesday")])
    assert any("E_xy" in note for note in found.notes)
    (path / "fit" / "fit.json").write_text("{")
    with pytest.raises(FormatError, match=r"fit\.json"):
        read_calibrated(path)
