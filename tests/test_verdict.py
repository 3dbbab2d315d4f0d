"""PASS, NOT DECIDED or FAIL: one rule in the fit, its file and its exit code; what no gyroscope can be is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import SESSION_TOML, Table, write_session

import calibrate
import tinygc
from session.io.errors import FitError
from session.io.units import DEG, EARTH_RATE_RPS
from tinygc.attitude.earth import estimate_heading, no_earth, unseen_covariance, vertical_only, with_heading
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.verdict import run_p_values
from tinygc.models.linear import LinearModel


@pytest.mark.broad
def test_less_than_noise_is_in_doubt(fitted):
    assert fitted.doubts == []
    louder = replace(fitted, problem=fitted.problem.changed(floor=replace(fitted.problem.floor, own=25 * fitted.problem.floor.own)))
    (doubt,) = louder.doubts
    assert "close better than the noise at rest allows" in doubt
    assert louder.verdict().answer == "not decided"


def test_an_accelerometer_that_never_moves_is_refused_by_check_and_by_fit():
    simulated = tinygc.simulate(segments=8, closure_s=0.0, odr_hz=104.0, seed=3).session
    log, rng = simulated.logs[0], np.random.default_rng(0)
    level = np.mean(log.samples.accel[:50], axis=0) + rng.normal(0, 6e-3, (len(log.samples), 3))
    dead = replace(simulated, logs=(replace(log, samples=log.samples.with_accel(level)),))
    (finding,) = [f for f in tinygc.check(dead) if f.level == "error" and f.what == "gravity moves"]
    assert "in 8 of 8 turns in which the rates tilt it by" in finding.says
    with pytest.raises(tinygc.CalibrationError, match="gravity moves: stays within"):
        tinygc.fit(dead, methods=("least_squares",))
    assert not [f for f in tinygc.check(simulated) if f.what == "gravity moves"]


def test_a_fit_whose_residuals_are_fine_is_refused_if_no_gyroscope_has_its_scale():
    """One axis reads too much and one too little: the scale common to all axes looks right."""
    simulated = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=3).session
    log = simulated.logs[0]
    wrong = replace(simulated, logs=(replace(log, samples=replace(log.samples, gyro=log.samples.gyro * [1.0, 1.35, 0.74])),))
    with pytest.raises(FitError, match="no gyroscope has this calibration: it multiplies rates about"):
        tinygc.fit(wrong, methods=("least_squares",))


@pytest.mark.broad
def test_stamps_that_look_counted_leave_the_scale_undecided(tmp_path):
    """Every step exactly the declared period: nothing tells the true rate, unless session.toml says that it was measured."""
    toml = SESSION_TOML.replace("odr_hz = 208.0", "odr_hz = 200.0")
    folder = write_session(tmp_path / "s", Table().tumble(10, seed=1).samples(odr_hz=200.0), toml=toml)
    (doubt,) = tinygc.fit(folder, methods=("least_squares",)).result.doubts
    assert doubt.startswith("log0001.csv: the stamps look counted")
    (folder / "session.toml").write_text(toml.replace("[sensor]\n", "[sensor]\nodr_sigma = 0.0\n"))
    assert tinygc.fit(folder, methods=("least_squares",)).result.doubts == []


# Closure runs whose heading is not known.


def test_the_unknown_heading_leaves_the_spread_of_all_headings():
    """Against the mean over all headings: what is left of the Earth's rate beside the part that is taken off."""
    headings = np.arange(0, 360, 0.5)
    rates = np.array([with_heading(47.0, heading).rate_t for heading in headings])
    left = rates - vertical_only(47.0).rate_t
    np.testing.assert_allclose(unseen_covariance(vertical_only(47.0), 47.0), left.T @ left / len(left), atol=1e-20)
    assert not unseen_covariance(with_heading(47.0, 30.0), 47.0).any()
    np.testing.assert_allclose(unseen_covariance(no_earth(), 47.0), rates.T @ rates / len(rates), atol=1e-20)
    np.testing.assert_allclose(np.trace(unseen_covariance(no_earth(), None)), EARTH_RATE_RPS**2)


def test_an_estimated_heading_leaves_its_own_spread():
    rng = np.random.default_rng(1)
    q = rng.normal(size=(40, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    sigma = np.full((40, 3), 4e-5)
    rate = with_heading(47.0, 30.0).in_body(q) + rng.normal(size=(40, 3)) * sigma
    earth = estimate_heading(47.0, q, rate, sigma)
    assert 5 * DEG < earth.heading_sigma_rad < 20 * DEG
    across, along = np.array([-earth.rate_t[1], earth.rate_t[0], 0]), np.array([*earth.rate_t[:2], 0])
    found = unseen_covariance(earth, 47.0)
    length = np.linalg.norm(with_heading(47.0, 0.0).rate_t[:2])
    np.testing.assert_allclose(across @ found @ across / (across @ across), (length * earth.heading_sigma_rad) ** 2, rtol=0.05)
    np.testing.assert_allclose(found @ along, 0, atol=1e-22)


@pytest.fixture(scope="module")
def fitted():
    return tinygc.fit("data/session1", methods=("least_squares",), bias="ends").result


def restarted(problem):
    """The session whose closure run was logged by a clock that began at 0 again."""
    log = problem.session.closures[0]
    again = replace(log, samples=replace(log.samples, t_ns=log.samples.t_ns - log.samples.t_ns[0]))
    return problem.changed(session=replace(problem.session, closures=(again,)))


def test_a_run_whose_clock_began_anew_is_judged_with_its_unknown_heading(fitted):
    """Only the vertical part of the Earth's rotation is taken off, which leaves 0.13°: less than the unknown heading allows."""
    (run,) = read_closure_runs(restarted(fitted.problem))
    assert (run.time_known, run.yaw_carried, run.earth.source) == (False, False, "unknown")
    vector, covariance = fitted.linear.model.vector, fitted.covariance

    def errors(trial, run):
        return run.errors(LinearModel.from_vector(trial))

    assert np.linalg.norm(errors(vector, run)) > 3 * np.linalg.norm(fitted.judged.run_errors[0])
    (p,) = run_p_values(fitted.problem, [run], vector, covariance, errors)
    assert p > 0.01
    (without,) = run_p_values(fitted.problem, [replace(run, heading_covariance=np.zeros((3, 3)))], vector, covariance, errors)
    assert without < 1e-3


def test_the_covariance_of_a_run_is_that_of_its_heading_times_its_length(fitted):
    """Against runs with all headings: the error moves by the horizontal rate times the seconds."""
    (run,) = read_closure_runs(restarted(fitted.problem))
    rate = fitted.linear.model(run.batch.rate)[0]
    known = replace(run, yaw_carried=True)
    moved = []
    for heading in range(0, 360, 15):
        more = with_heading(fitted.session.config.site.latitude_deg, float(heading)).rate_t * [1, 1, 0]
        moved.append(known.with_earth(more, rate).errors_at(rate) - run.errors_at(rate))
    np.testing.assert_allclose(np.mean([np.outer(x, x) for x in moved], axis=0), run.heading_covariance, rtol=0.001, atol=1e-7)


@pytest.mark.broad
def test_exit_codes(tmp_path, simulated, capsys):
    folder, table = simulated(segments=13, closure_s=0.0), tmp_path / "fit.json"
    usual = ["fit", str(folder), "--methods", "least_squares", "--json", str(table), "--out", str(tmp_path / "fit")]
    codes = {}
    for name, more in {"pass": [], "fail": ["--limit", "0.0001"], "doubtful pass": ["--exclude", "1,2", "--limit", "5"]}.items():
        codes[name] = calibrate.main([*usual, *more])
        assert json.loads(table.read_text())["verdict"]["answer"] == name
        assert capsys.readouterr().out.startswith({"pass": "PASS: ", "fail": "FAIL: ", "doubtful pass": "PASS, with doubts: "}[name])
    assert codes == {"pass": 0, "fail": 1, "doubtful pass": 0}
    undecided = [*usual, "--exclude", "1,2"]
    assert (calibrate.main(undecided), calibrate.main([*undecided, "--strict"])) == (0, 1)
    assert capsys.readouterr().out.startswith("NOT DECIDED: 11 segments")


@pytest.mark.broad
def test_the_first_screen_fits(capsys, tmp_path):
    """80 columns, 32 lines; no number is cut."""
    assert calibrate.main(["fit", "data/session1", "--out", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    headline = "PASS: held out 0.0143° over 5 s (twice an ASM330LHH's data sheet: 0.028°), closure run 0.0435°"
    assert " ".join(line.rstrip() for line in lines[:2]) == headline
    assert len(lines) <= 32
    assert max(len(line.rstrip()) for line in lines if str(tmp_path) not in line) <= 80
    assert not [line for line in lines if "…" in line]
    for method in ("raw ", "least squares ", "PSO ", "TinyGC-Net "):
        assert [len(line.split()) - len(method.split()) for line in lines if line.startswith(method)] == [8]
