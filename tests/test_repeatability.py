"""The bias of another session: its spread, from which sessions, and where it goes."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandline import refused
from conftest import config
from scipy.stats import kstest, t

import calibrate
from session.io.errors import FormatError
from session.io.folder import Session, hash_of_log
from session.io.logfile import Log
from session.io.samples import Samples
from session.io.units import DEG
from tinygc import models
from tinygc.estimation.between_sessions import ONE_SIGMA
from tinygc.estimation.repeatability import BiasRepeatability, accelerometer_between, between_sessions, repeatability_of
from tinygc.models.linear import BIAS, LinearModel


def test_a_sigma_is_the_two_thirds_of_a_normal_variable():
    assert t.cdf(1, 1e9) - t.cdf(-1, 1e9) == pytest.approx(ONE_SIGMA, abs=1e-9)


@pytest.mark.parametrize("count", [2, 3])
def test_two_of_three_of_the_next_sessions_lie_within_it(count):
    """Draws of the small problem: the next session's difference over its sigma is Student's t, scaled to 68 % within one."""
    rng = np.random.default_rng(count)
    z = []
    for _ in range(1000):
        spread = between_sessions(rng.normal(size=(count, 3)), np.zeros((count, 3, 3)), [None] * count)
        assert spread.freedom.tolist() == [count - 1] * 3
        z.append((rng.normal(size=3) - rng.normal(size=3)) / spread.sigma(np.zeros((3, 3))))
    z = np.ravel(z)
    assert np.mean(np.abs(z) < 1) == pytest.approx(ONE_SIGMA, abs=5 * np.sqrt(0.68 * 0.32 / len(z)))
    assert kstest(z * t.ppf((1 + ONE_SIGMA) / 2, count - 1), t(count - 1).cdf).pvalue > 1e-3


def test_what_the_fits_own_sigmas_explain_is_no_spread():
    biases = np.array([[1.0, 1.0, 0], [-1, -1, 0], [0, 0, 0]])
    own = np.tile(np.diag([1 / 3, 10.0, 0]), (3, 1, 1))
    found = between_sessions(biases, own, [None] * 3)
    np.testing.assert_allclose(found.scatter_rps, [np.sqrt(2 / 3), np.sqrt(0.1), 0])
    np.testing.assert_allclose(found.rps, t.ppf((1 + ONE_SIGMA) / 2, 2) * found.scatter_rps)


def test_another_session_s_bias_differs_by_two_draws_from_the_spread():
    rps, own = np.array([1.0, 2, 3]), np.diag(np.arange(12.0))
    own[9, 10] = own[10, 9] = 0.5
    found = BiasRepeatability(rps * DEG, "said")
    more = found.any_session(own) - own
    np.testing.assert_allclose(more, np.diag([0.0] * 9 + [2 * DEG**2, 8 * DEG**2, 18 * DEG**2]), rtol=1e-9, atol=1e-15)
    assert own[9, 9] == 9  # it is left as it was
    np.testing.assert_allclose(found.sigma(own[BIAS, BIAS]), np.sqrt(np.diag(found.any_session(own))[BIAS]), rtol=1e-12)
    known = {"spread_dps": pytest.approx([1, 2, 3]), "degrees_of_freedom": [None] * 3, "source": "said"}
    assert found.to_json(np.zeros((3, 3))) == known | {"sigma_dps": pytest.approx(np.sqrt(2) * rps)}
    assert BiasRepeatability(rps, "", np.full(3, 2.0)).to_json(own[BIAS, BIAS])["degrees_of_freedom"] == [2.0] * 3


@pytest.fixture
def unit(tmp_path):
    """``session(number)``, of one unit, and ``fitted(name, …)``, the folder of a fit of it: only what the spread is read from."""

    def session(number=0, serial="test"):
        samples = Samples(np.arange(9) * 10_000_000, np.full((9, 3), float(number)), np.ones((9, 3)))
        made = config()
        made = replace(made, sensor=replace(made.sensor, serial=serial, gyro_bias_repeatability_dps=0.5 if number < 0 else None))
        return Session(tmp_path / "today", made, (Log(Path("log.csv"), samples, in_memory=True),), ())

    def fitted(name, bias=(0.0, 0.0, 0.0), covariance=None, **more):
        (tmp_path / name / "fit").mkdir(parents=True)
        model = LinearModel(np.eye(3), np.array(bias))
        told = {"sha256": {"log.csv": name, "session.toml": "same"}, "sensor": {"model": "ASM330LHH", "serial": "test"}}
        told |= ({} if covariance is False else {"covariance": (np.zeros((12, 12)) if covariance is None else covariance).tolist()}) | more
        (tmp_path / name / "fit" / "model_least_squares.json").write_text(json.dumps(models.to_dict(model, **told)))
        return tmp_path / name

    return session, fitted


def test_the_spread_is_of_the_biases_of_fitted_sessions_less_their_own_variances(unit):
    session, fitted = unit
    covariance = np.diag(np.arange(12.0)) * 1e-3
    folders = [fitted("a", (1.0, 2.0, 0.0), covariance), fitted("b", (-1.0, 2.0, 1.0), covariance), fitted("c", (0, 2.1, -1), covariance)]
    found = repeatability_of(session(), folders)
    widened = t.ppf((1 + ONE_SIGMA) / 2, 2)
    expected = [np.sqrt(1 - 0.009), np.sqrt(0.1 * 0.01 / 3), np.sqrt(1 - 0.011)]
    np.testing.assert_allclose(found.rps, widened * np.array(expected), rtol=1e-9)
    assert found.source == "3 other sessions of this unit"
    assert repeatability_of(session(), folders[:2]).source == "2 other sessions of this unit"
    given = repeatability_of(session(-1))
    assert (given.rps.tolist(), given.source) == ([0.5 * DEG] * 3, "given in session.toml")
    assert repeatability_of(session()) is None


def test_the_accelerometers_spread_is_of_its_numbers_in_fitted_sessions(unit):
    """Three sessions, two degrees of freedom: the scatter beyond their own sigmas, widened; two without one show none."""
    _, fitted = unit
    values = np.array([0.3, -0.1, 0.7])

    def triad(number, sigma):
        given = {"equation": "f", "matrix": np.eye(3).tolist(), "bias_mps2": [values[number], 0.0, 0.0], "source": "stills"}
        return {"accelerometer": given, "joint_covariance": {"matrix": (np.eye(21) * sigma**2).tolist()}}

    folders = [fitted(f"t{number}", **triad(number, 1e-6)) for number in range(3)]
    found = accelerometer_between(folders)
    assert found.source == "3 other sessions of this unit"
    assert not found.usual
    assert found.spread[6] == pytest.approx(t.ppf((1 + ONE_SIGMA) / 2, 2) * values.std(ddof=1), rel=1e-4)
    assert found.spread[7] < 1e-5
    own = accelerometer_between([fitted(f"w{number}", **triad(number, 10.0)) for number in range(3)])
    assert own.spread[6] == pytest.approx(t.ppf((1 + ONE_SIGMA) / 2, 2) * np.sqrt(0.1) * values.std(ddof=1), rel=1e-4)
    assert accelerometer_between([folders[0], fitted("bare")]) is None
    assert accelerometer_between([]) is None


def test_a_history_shows_no_spread_where_it_is_of_one_session_twice_or_of_another_unit(unit):
    session, fitted = unit
    one, two = fitted("a"), fitted("b")
    digest = hash_of_log(session().logs[0])
    bad = {
        "one session does not show a spread": [one],
        "a folder is given twice": [one, two, one],
        "holds the same log as .*today": [one, fitted("mine", sha256={"log.csv": digest})],
        "holds the same log as .*a;": [one, fitted("copy", sha256={"other.csv": "a"})],
        "'other', expected ASM330LHH 'test'": [one, fitted("other", sensor={"model": "ASM330LHH", "serial": "other"})],
        "of BMI088 'test', expected": [one, fitted("model", sensor={"model": "BMI088", "serial": "test"})],
        "no linear model with a covariance": [one, fitted("none", covariance=False)],
        "fit the session first": [one, one.parent],
    }
    for said, folders in bad.items():
        with pytest.raises(FormatError, match=said):
            repeatability_of(session(), folders)
    with pytest.raises(FormatError, match="names no serial number"):
        repeatability_of(session(serial=""), [one, two])
    assert repeatability_of(session(), [one, two]).rps.tolist() == [0, 0, 0]  # session.toml alike is no same log


@pytest.fixture
def days(folder, tmp_path):
    """Three fitted sessions of one unit: one, and two whose bias was moved in the file of their fit."""
    folders = []
    for number, moved in enumerate((0.0, 0.1, -0.1)):
        at = tmp_path / f"day{number}"
        shutil.copytree(folder, at)
        folders.append(at)
        if number == 0:
            assert calibrate.main(["fit", str(at), "--methods", "least_squares", "--quiet"]) == 0
            continue
        shutil.copytree(folders[0] / "fit", at / "fit")
        path = at / "fit" / "model_least_squares.json"
        table = json.loads(path.read_text())
        table["sha256"] = {name: f"{number}" * 64 for name in table["sha256"]}
        table["weights"]["B"] = (np.array(table["weights"]["B"]) + moved * DEG).tolist()
        path.write_text(json.dumps(table))
    return folders


@pytest.mark.broad
def test_the_history_of_a_unit_goes_into_model_exports_and_apply(days, tmp_path, run):
    today, *others = days
    words = [word for other in others for word in ("--history", other)]
    code, out, _ = run("fit", today, "--methods", "least_squares", *words)
    assert code == 0
    spread = t.ppf((1 + ONE_SIGMA) / 2, 1) * 0.1 * np.sqrt(2)
    (said,) = re.findall(r"the bias of any other session: ± ([\d.]+) dps", " ".join(out.split()))
    assert float(said) == pytest.approx(np.sqrt(2) * spread, rel=0.01)
    assert "(2 other sessions of this unit)" in " ".join(out.split())
    fit = json.loads((today / "fit" / "fit.json").read_text())
    assert fit["bias_any_session"]["spread_dps"] == pytest.approx([spread] * 3, rel=1e-3)
    model = today / "fit" / "model_least_squares.json"
    table = json.loads(model.read_text())
    assert run("export", today, "--to", "json", "--out", tmp_path / "out", "--quiet")[0] == 0
    (path,) = (tmp_path / "out").glob("*.json")
    exported = json.loads(path.read_text())
    more = np.array(exported["any_session_covariance"]) - table["covariance"]
    np.testing.assert_allclose(more, np.diag([0.0] * 9 + [2 * (spread * DEG) ** 2] * 3), rtol=1e-3, atol=1e-15)
    code, out, _ = run("apply", model, *today.glob("log0001.csv"), "-o", tmp_path / "x.csv")
    assert (code, f"differs by up to {np.sqrt(2) * spread:.2g} dps" in out) == (0, True)


@pytest.mark.broad
def test_it_may_be_given_and_is_else_as_usual(folder, run):
    usual = " ".join(run("fit", folder, "--methods", "least_squares")[1].split())
    assert "this bias is of this session; the bias of any other session: ± 0.14" in usual
    assert "usual of MEMS gyroscopes" in usual
    assert json.loads((folder / "fit" / "fit.json").read_text())["bias_any_session"] is None
    toml = folder / "session.toml"
    toml.write_text(toml.read_text().replace("[sensor]\n", "[sensor]\ngyro_bias_repeatability_dps = 0.05\n"))
    assert "the bias of any other session: ± 0.07" in " ".join(run("fit", folder, "--methods", "least_squares")[1].split())
    assert json.loads((folder / "fit" / "fit.json").read_text())["bias_any_session"]["source"] == "given in session.toml"


@pytest.mark.broad
def test_what_is_no_history_is_refused(days, run):
    today, one, other = days
    words = ("fit", today, "--methods", "least_squares", "--quiet", "--history")
    refused(run(*words, one), "one session does not show a spread")
    refused(run(*words, one, "--history", one), "a folder is given twice")
    path = other / "fit" / "model_least_squares.json"
    path.write_text(path.read_text().replace('"serial": "', '"serial": "not-'))
    refused(run(*words, one, "--history", other), "this session's")
    shutil.rmtree(one / "fit")
    refused(run(*words, one, "--history", other), "fit the session first")
    shutil.copytree(today, other.parent / "copy")
    assert run("fit", other.parent / "copy", "--methods", "least_squares", "--quiet")[0] == 0
    refused(run(*words, other.parent / "copy", "--history", other), "holds the same log as")
