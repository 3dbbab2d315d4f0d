"""Effects of a lot: weak in each unit, found by pooling; nothing where there is nothing; one odd unit does not speak for the lot."""

import json
from dataclasses import replace

import numpy as np
import pytest
from explained_sessions import G_SENSITIVITY
from lots import lot
from processes import calibrate

import tinygc
from session.io.units import DEG, G
from tinygc import CalibrationError, SimulationOptions
from tinygc.annexes.lots.explanation import LotEffects, effects_of
from tinygc.annexes.lots.lot import PooledEffect
from tinygc.annexes.lots.report import read_lot, write_lot
from tinygc.effects import catalogue
from tinygc.explanation.engine import explain_session
from tinygc.explanation.evidence import component_names, linear_estimate
from tinygc.simulation.write import write_session


def test_the_linear_estimate_is_that_of_least_squares_with_everything():
    """Exactly: with the other columns in one design; its covariance is the inverse's block."""
    rng = np.random.default_rng(9)
    J, own = rng.standard_normal((60, 7)), rng.standard_normal((60, 3))
    truth = np.array([0.3, -0.2, 0.1])
    r = -(own @ truth) + J @ rng.standard_normal(7) + rng.standard_normal(60)
    theta, covariance = linear_estimate(r, J, own, 1e6)
    whole = np.concatenate([own, J], axis=1)
    np.testing.assert_allclose(theta, np.linalg.lstsq(whole, -r, rcond=None)[0][:3], rtol=1e-6)
    np.testing.assert_allclose(covariance, np.linalg.inv(whole.T @ whole)[:3, :3], rtol=1e-6)


def g_sensitive(t_s, rate, force, temp_c):
    return rate + force / G @ (np.array(G_SENSITIVITY) * DEG).T


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A session with g-sensitivity, strong enough to be told from one."""
    options = SimulationOptions(segments=16, closure_s=0.0, seed=5, odr_hz=104.0)
    return write_session(options, tmp_path_factory.mktemp("effects") / "s", distort=g_sensitive)


def test_a_session_tells_of_every_effect_and_recovers_the_one_that_is_there(session):
    """All that has columns, named or not; the injected matrix within four of its sigmas, as if nothing had been named."""
    found = effects_of(explain_session(session))
    kinds = {name: effect.kind for name, effect in catalogue().items()}
    assert {name for name in found if kinds[name] in ("rate", "force")} == {
        name for name, kind in kinds.items() if kind in ("rate", "force")
    }
    told = found["gyro.g_sensitivity"]
    assert told.named
    assert tuple(told.estimates) == component_names(catalogue()["gyro.g_sensitivity"])
    truth, x, sigma = (np.ravel(each) for each in (np.array(G_SENSITIVITY) * DEG, [*told.estimates.values()], [*told.sigmas.values()]))
    assert np.abs((x - truth) / sigma).max() < 4
    assert not found["gyro.scale_asymmetry"].named


def of_lot(**effects) -> object:
    return lot(effects={f"gyro.{name}": effect for name, effect in effects.items()})


@pytest.mark.slow
def test_explain_with_a_lot_says_how_probable_its_effect_is_here_and_what_it_is_worth(session, tmp_path):
    names = component_names(catalogue()["gyro.g_sensitivity"])
    truth = dict(zip(names, map(float, np.ravel(G_SENSITIVITY) * DEG), strict=True))
    wrong = {name: -3 * value for name, value in truth.items()}
    small = dict.fromkeys(names, 0.005 * DEG)
    path = tmp_path / "lot.json"
    write_lot(path, of_lot(g_sensitivity=PooledEffect(0.6, truth, small, 1e-9, 50, ("gyro.g2_sensitivity",))))
    assert read_lot(path).effects["gyro.g_sensitivity"].equivalent == ("gyro.g2_sensitivity",)
    done = calibrate("explain", session, "--lot", path, "--no-pictures", "--out", tmp_path / "e", "--json", tmp_path / "e.json")
    assert done.returncode == 0, done.stderr
    (told,) = json.loads((tmp_path / "e.json").read_text())["lot_effects"]
    assert told["id"] == "gyro.g_sensitivity"
    assert told["probability"] > 0.99
    assert told["worth_closure_deg"] > 0.05
    assert told["worth_sigmas"] > 10
    assert np.allclose(told["parameters"]["matrix_dps_per_g"], G_SENSITIVITY, atol=0.02)
    assert "of the lot: gyro.g_sensitivity: 60% of the lot have it" in " ".join(done.stdout.split())
    other = tinygc.explain(session, lot=of_lot(g_sensitivity=PooledEffect(0.6, wrong, small, 1e-9, 50))).explanation
    assert other.of_lot[0].probability < 0.01


def test_a_lot_of_another_sensor_is_refused(session):
    with pytest.raises(CalibrationError, match="a lot of LSM6DSO, and the session's sensor is ASM330LHH"):
        tinygc.explain(session, lot=replace(lot(), sensor="LSM6DSO"))
    assert LotEffects(of_lot(bias_drift=PooledEffect(1.0, {}, {}, 0.01, 50))).odds == {"gyro.bias_drift": pytest.approx(19.0)}
