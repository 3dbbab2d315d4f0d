"""``verify`` from the command line and in Python: verdicts, exit codes, files, and one line for what is wrong."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from formats_page import strangers
from scipy.stats import chi2
from verify_units import OPTIONS, SIGMA, rest_log, session_of, write

import tinygc
from session.io.units import DEG
from tinygc.annexes.verification.old import read_old
from tinygc.library.sessions import Simulated
from tinygc.models.linear import LinearModel
from tinygc.simulation.simulator import simulate_session, unit_of


@pytest.fixture(scope="module")
def unit():
    return unit_of(OPTIONS)


@pytest.fixture(scope="module")
def folder(unit, tmp_path_factory):
    """A session of the unit as it was calibrated."""
    return Simulated({"effects": {}}, simulate_session(OPTIONS, unit=unit)).save(tmp_path_factory.mktemp("verify") / "today")


@pytest.fixture(scope="module")
def model(unit, folder, tmp_path_factory):
    """The true model, with the covariance of a good fit; two sigmas off."""
    config = tinygc.read_session(folder).config
    rng = np.random.default_rng(0)
    vector = np.r_[unit.E.ravel(), unit.B] + SIGMA * rng.uniform(-1, 1, 12)
    return write(tmp_path_factory.mktemp("model") / "model.json", vector, config, covariance=np.diag(SIGMA**2).tolist())


def test_a_calibration_that_holds_says_so(model, folder, run, tmp_path):
    code, out, _ = run("verify", model, folder, "--json", tmp_path / "found.json")
    assert code == 0
    assert out.startswith("holds: ")
    found = json.loads((tmp_path / "found.json").read_text())
    assert strangers(found) == []
    assert [question["holds"] for question in found["questions"]] == [True, True, True, None]
    for question in found["questions"][:3]:
        assert chi2.sf(question["chi_square"], question["freedom"]) == pytest.approx(question["p_value"], rel=1e-6)
        assert question["statistic"] > 0
    assert found["false_alarm"] == 0.05
    assert np.abs(found["cost"]["as_it_is_deg"]).max() < 1.0


@pytest.mark.broad
def test_a_zero_that_moved_is_taken_anew_and_the_new_model_holds(model, unit, tmp_path):
    moved = np.array([1.0, -0.6, 0.8]) * DEG
    today = session_of(replace(unit, B=unit.B + moved))
    found = tinygc.verify(model, today)
    assert (found.answer, found.exit_code) == ("holds for E, take B anew", 1)
    assert found.bias_dps == pytest.approx((unit.B + moved) / DEG, abs=0.01)
    assert strangers(json.loads(json.dumps(found.to_json()))) == []
    assert found.result.diagnosis.best.names == ("zero",)
    assert "x -0.99" in found.result.diagnosis.best.words[0]  # it reads less where B is more
    written = found.save_model(tmp_path / "anew.json")
    assert pytest.approx(found.bias_dps) == tinygc.load(written).model.B / DEG
    assert tinygc.verify(written, today).answer == "holds"


def test_the_cost_is_that_of_the_true_change(model, unit):
    today = replace(unit, E=unit.E @ np.diag([1.02, 1, 1]))
    found = tinygc.verify(model, session_of(today))
    assert (found.answer, found.exit_code) == ("does not hold", 1)
    assert found.result.diagnosis.best.names == ("scale",)
    assert found.result.diagnosis.best.theta[0] == pytest.approx(1 / 1.02 - 1, abs=1e-3)  # the axis reads less
    from tinygc.annexes.verification.cost import minute_of

    _, truth = minute_of(found.result.rows).largest_error(read_old(model).linear, LinearModel(today.E, today.B))
    assert found.result.cost.as_it_is == pytest.approx(truth, abs=0.3 * np.linalg.norm(truth))
    assert np.linalg.norm(found.result.cost.bias_anew) > 0.5 * np.linalg.norm(truth)  # E is not mended by another B


def test_a_minute_at_rest_asks_the_zero_and_leaves_e_open(model, unit, run, tmp_path):
    log = rest_log(tmp_path / "rest.csv", session_of(unit))
    code, out, _ = run("verify", model, log)
    assert code == 0
    assert out.startswith("holds: this recording tells E to ")
    assert "the zero holds: " in out
    assert "scale and axes (E)" in out
    assert "Turns that would tell" in out
    code, out, _ = run("verify", model, rest_log(tmp_path / "moved.csv", session_of(unit), shift=2.0))
    assert code == 1
    assert "whether E holds stays open" in out


@pytest.mark.parametrize(("shift", "code"), [(0.0, 0), (0.15, 5), (4.0, 1)])
def test_verify_and_watch_say_the_same_of_a_rest(model, unit, run, tmp_path, shift, code):
    """Within the noise; as a switch-on may move it, and more than a minute bears; beyond any switch-on, by more than a turn in a minute."""
    log = rest_log(tmp_path / "rest.csv", session_of(unit), shift=shift)
    said = [run(command, model, log, *more)[:2] for command, more in (("verify", ["--quiet"]), ("watch", []))]
    assert [code for code, _ in said] == [code, code]
    costs = [float(re.search(r"(?:costs?|attitude by) ([\d.]+)°", " ".join(out.splitlines())).group(1)) for _, out in said]
    if shift:
        assert costs == pytest.approx([60 * np.sqrt(3) * shift] * 2, rel=0.05)
    else:
        assert max(costs) < 1.0


def test_another_sensors_recording_is_refused_unless_that_is_accepted(model, folder, run, tmp_path):
    table = json.loads(model.read_text())
    table["sensor"]["serial"] = "OTHER"
    path = tmp_path / "other.json"
    path.write_text(json.dumps(table))
    code, _, error = run("verify", path, folder, "--quiet")
    assert code == 2
    assert "--other-serial" in error
    assert error.count("\n") == 1
    assert run("verify", path, folder, "--other-serial")[0] == 0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [(("missing.json", "TODAY"), "cannot be read"), (("MODEL", "missing"), "not found"), (("TODAY", "TODAY"), "run `")],
)
def test_what_is_not_there_is_one_line(model, folder, run, wrong, said):
    code, _, error = run("verify", *({"MODEL": model, "TODAY": folder}.get(each, each) for each in wrong), "--quiet")
    assert code == 2
    assert said in error
    assert error.count("\n") == 1


def test_the_model_with_its_new_zero_is_written_where_that_is_possible(model, folder, run, tmp_path):
    path = tmp_path / "anew.json"
    assert run("verify", model, folder, "--write", path)[0] == 0
    assert pytest.approx(tinygc.load(model).model.E) == tinygc.load(path).model.E
    assert json.loads(path.read_text())["stored"]["method"] is None
    for wrong in (tmp_path, model, folder / "log0001.csv.gz"):
        code, _, error = run("verify", model, folder, "--write", wrong, "--quiet")
        assert code == 2
        assert error.count("\n") == 1


@pytest.mark.parametrize("option", [("--false-alarm", "0"), ("--false-alarm", "x"), ("--limit", "0"), ("--limit", "nan")])
def test_a_probability_and_a_limit_are_checked(model, folder, run, option):
    assert run("verify", model, folder, *option)[0] == 2
