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
from tinygc.annexes.lots.effects import FAMILY_WISE, pooled
from tinygc.annexes.lots.explanation import LotEffects, effects_of
from tinygc.annexes.lots.lot import PooledEffect, UnitResult, Weighed
from tinygc.annexes.lots.report import read_lot, write_lot
from tinygc.effects import catalogue
from tinygc.explanation.engine import explain_session
from tinygc.explanation.evidence import component_names, linear_estimate
from tinygc.simulation.write import write_session

#: effect -> how many numbers; as a session tells them
NUMBERS = {"a.nine": 9, "b.three": 3, "c.three": 3, "d.one": 1, "e.nine": 9, "f.three": 3}
SIZE = sum(NUMBERS.values())


def design(rng) -> np.ndarray:
    """(SIZE, SIZE): a root of the covariance of a session's estimates, which are correlated across effects."""
    return np.linalg.cholesky(np.eye(SIZE) + 0.3 * (raw := rng.standard_normal((SIZE, SIZE)) / np.sqrt(SIZE)) @ raw.T)


def units(rng, count, add=None, root=None) -> list[UnitResult]:
    """Units whose estimates have errors of about one sigma; add(unit) -> (SIZE,) what is truly there."""
    root = design(rng) if root is None else root
    found = []
    for number in range(count):
        sigma = np.exp(0.3 * rng.standard_normal(SIZE))
        noise = np.sqrt(np.sum(root**2, axis=1))
        x = root @ rng.standard_normal(SIZE) / noise * sigma + (0 if add is None else add(number))
        effects, at = {}, 0
        for name, size in NUMBERS.items():
            own = slice(at, at := at + size)
            keys = [str(i) for i in range(size)]
            told = (dict(zip(keys, map(float, values[own]), strict=True)) for values in (x, sigma))
            effects[name] = Weighed(*told, chi_square=float(np.sum((x[own] / sigma[own]) ** 2)), named=False)
        empty = np.full((21, 21), np.nan)
        found.append(UnitResult(f"u{number}", f"u{number}", f"s{number}", empty[0], empty, effects=effects))
    return found


def at(name: str, values) -> np.ndarray:
    """(SIZE,) with an effect's numbers, nothing of the others."""
    start = sum(size for other, size in NUMBERS.items() if other < name)
    made = np.zeros(SIZE)
    made[start : start + NUMBERS[name]] = values
    return made


@pytest.mark.slow
def test_a_lot_with_nothing_in_it_names_nothing(monkeypatch):
    """Family-wise 5 %: of 120 lots of 30 units at most 5 % + 3 sigmas of that (binomial) name anything."""
    monkeypatch.setattr("tinygc.annexes.lots.effects.DRAWS", 400)
    rng = np.random.default_rng(11)
    root = design(rng)
    named = sum(bool(pooled(units(rng, 30, root=root), seed=k)) for k in range(120))
    assert named <= 120 * (FAMILY_WISE + 3 * np.sqrt(FAMILY_WISE * (1 - FAMILY_WISE) / 120))


@pytest.mark.parametrize(("name", "values"), [("b.three", [1.5, 0, 0]), ("a.nine", [1.5, *[0] * 8]), ("d.one", [1.5])])
def test_what_is_weak_in_each_of_fifty_units_is_found(name, values):
    """z = 1.5 in each: named in none of them by itself, and its mean recovered within three of its sigmas."""
    rng = np.random.default_rng(3)
    found = pooled(units(rng, 50, lambda number: at(name, values)))
    assert list(found) == [name]
    assert found[name].p_value < 1e-3
    assert found[name].units == 50
    assert found[name].share == 1.0
    mean = np.array(list(found[name].mean.values()))
    assert np.abs(mean).argmax() == 0
    assert mean[0] == pytest.approx(1.5, abs=3 / np.sqrt(50))


def test_units_with_either_sign_have_no_mean_and_are_found_by_their_spread():
    rng = np.random.default_rng(4)
    found = pooled(units(rng, 80, lambda number: at("c.three", 2.5 * rng.standard_normal(3))))
    assert list(found) == ["c.three"]
    assert min(found["c.three"].spread.values()) > 1


def test_one_odd_unit_does_not_speak_for_the_lot():
    """300 sigmas in one of thirty, as a board that fell."""
    rng = np.random.default_rng(5)
    assert pooled(units(rng, 30, lambda number: at("a.nine", 300.0) if number == 7 else 0)) == {}


def test_a_part_of_the_units_has_it():
    """Half of two hundred units, 4 sigmas: the share within 15 %, the mean that of those that have it."""
    rng = np.random.default_rng(6)
    found = pooled(units(rng, 200, lambda number: at("b.three", [4.0, 0, 0]) if number % 2 else 0))
    assert list(found) == ["b.three"]
    assert found["b.three"].share == pytest.approx(0.5, abs=0.15)
    assert found["b.three"].mean["0"] == pytest.approx(4.0, rel=0.3)


def test_what_an_effect_leaves_in_the_columns_of_another_is_not_named_for_itself():
    """Estimates of f follow those of b with 0.9: one is named, the other may as well be it, or goes unsaid."""
    rng = np.random.default_rng(7)
    root = np.eye(SIZE)
    b, f = (np.flatnonzero(at(name, 1.0)) for name in ("b.three", "f.three"))
    root[f, b], root[f, f] = 0.9, np.sqrt(1 - 0.81)
    found = pooled(units(rng, 60, lambda number: at("b.three", [2.0, 0, 0]) + at("f.three", [1.8, 0, 0]), root))
    assert len(found) == 1
    ((name, effect),) = found.items()
    assert {name, *effect.equivalent} == {"b.three", "f.three"}
    apart = pooled(units(rng, 60, lambda number: at("b.three", [2.0, 0, 0]) + at("e.nine", [0, 2.0, *[0] * 7])))
    assert set(apart) == {"b.three", "e.nine"}


def test_few_units_tell_nothing():
    rng = np.random.default_rng(8)
    assert pooled(units(rng, 5, lambda number: at("d.one", 9.0))) == {}
    assert pooled([]) == {}


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
