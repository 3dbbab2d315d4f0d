"""What a calibration that holds may differ by, and what a model file says of itself."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import config
from verify_rows import made_rows

from session.io.errors import FormatError
from session.io.units import DEG, MG, G
from tinygc import models
from tinygc.annexes.verification.expected import ACCELEROMETER_ZERO, ZERO, Spread, expected_parts, spread_of_unit
from tinygc.annexes.verification.old import ACCELEROMETER, COUNT, GYROSCOPE, facts, read_old, with_bias_moved
from tinygc.annexes.verification.rows import LENGTH
from tinygc.closure.floor import BiasInstability, wander_covariance
from tinygc.effects import AppliedEffect, Conditions, effect_of
from tinygc.estimation.accelerometer import USUAL_SPREAD as USUAL_ACCELEROMETER
from tinygc.estimation.compare import Calibrated, SessionTriad
from tinygc.estimation.expected_zero import USUAL_PER_K, USUAL_SPREAD
from tinygc.models.linear import LinearModel
from tinygc.models.model import accelerometer_table
from tinygc.models.physics import PhysicsModel
from tinygc.planning.proposals import TARGETS

E = np.array([[1.02, 0.01, 0], [0, 0.98, -0.01], [0.005, 0, 1.01]])
B = np.array([0.01, -0.02, 0.005])


def written(tmp_path, model=None, **more):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(models.to_dict(model or LinearModel(E, B), **more)))
    return read_old(path)


def rows_with(repeatability=None, temp_c=25.0):
    made = config()
    sensor = replace(made.sensor, gyro_bias_repeatability_dps=repeatability)
    return replace(made_rows(), session=SimpleNamespace(config=replace(made, sensor=sensor)), temp_c=temp_c)


def total(parts):
    return sum(part.into @ part.into.T for part in parts)


def test_a_joint_covariance_is_taken_whole(tmp_path):
    root = np.random.default_rng(0).normal(size=(COUNT, COUNT)) * 1e-4
    joint = {"matrix": (root @ root.T).tolist()}
    old = written(tmp_path, joint_covariance=joint, accelerometer=accelerometer_table(config().accelerometer))
    assert not old.own_lengths
    none = Spread(np.full(COUNT, np.nan), np.inf, "")
    for each in expected_parts(old, replace(rows_with(), known=np.zeros((54, 2))), none):
        assert each.into.shape == (COUNT, each.columns.shape[1])
        assert each.assumed == (each.name not in ("calibration", "references"))
    found = expected_parts(old, rows_with(), Spread(np.full(COUNT, np.nan), np.inf, ""))
    assert total([part for part in found if part.name == "calibration"]) == pytest.approx(root @ root.T, rel=1e-6, abs=1e-16)


def test_a_covariance_without_a_direction_is_none_there(tmp_path):
    """Whose eigenvalues rounding makes negative."""
    one = np.outer(*[np.random.default_rng(0).normal(size=COUNT) * 1e-4] * 2)
    for more in ({"accelerometer": accelerometer_table(config().accelerometer)}, {}):
        old = replace(written(tmp_path, **more), covariance=one)
        found = expected_parts(old, rows_with(), Spread(np.full(COUNT, np.nan), np.inf, ""))
        assert total([part for part in found if part.name == "calibration"])[GYROSCOPE, GYROSCOPE] == pytest.approx(
            one[GYROSCOPE, GYROSCOPE], abs=1e-20
        )


def test_the_error_of_a_given_accelerometer_is_in_lengths_and_not_in_e(tmp_path):
    own, shared = np.diag(np.full(12, 4e-8)), np.diag(np.r_[np.full(9, 3e-8), np.zeros(3)])
    old = written(tmp_path, covariance=own.tolist(), accelerometer_covariance=shared.tolist())
    rows = rows_with()
    parts = {part.name: part for part in expected_parts(old, rows, Spread(np.full(COUNT, np.nan), np.inf, ""))}
    assert total([parts["calibration"]])[GYROSCOPE, GYROSCOPE] == pytest.approx(own - shared, abs=1e-16)
    given = parts["accelerometer's calibration"]
    assert np.sqrt(np.diag(total([given]))[ACCELEROMETER]) == pytest.approx(np.r_[np.full(6, 0.1 * MG / G), np.full(3, 0.1 * MG)])
    assert not given.columns[: rows.kinds[LENGTH].start].any()
    assert given.columns[rows.kinds[LENGTH]].any()


def test_both_sessions_are_draws_of_the_spread(tmp_path):
    variance = np.full(COUNT, np.nan)
    variance[ZERO] = [1e-6, 4e-6, 9e-6]
    parts = [p for p in expected_parts(written(tmp_path), rows_with(), Spread(variance, 3.0, "own")) if p.name == "switch-on"]
    assert np.diag(total(parts))[ZERO] == pytest.approx(2 * variance[ZERO])
    assert [part.freedom for part in parts] == [3.0] * 3  # each axis' variance is estimated by itself
    none = expected_parts(written(tmp_path), rows_with(), Spread(variance, 3.0, "own"), switched_on_since=False)
    assert not [part for part in none if part.name == "switch-on"]


def test_an_accelerometers_zero_moves_by_the_usual_where_nothing_shows_its_spread(tmp_path):
    variance = np.full(COUNT, np.nan)
    old, name = written(tmp_path), "accelerometer's switch-on"
    usual = {p.name: p for p in expected_parts(old, rows_with(), Spread(variance, 3.0, "own"))}
    assert np.sqrt(np.diag(total([usual[name]]))[ACCELEROMETER]) == pytest.approx(np.sqrt(2) * USUAL_ACCELEROMETER.spread)
    assert np.sqrt(np.diag(total([usual[name]]))[ACCELEROMETER_ZERO]) == pytest.approx(np.full(3, 2 * MG))
    assert usual[name].assumed
    assert name not in {p.name for p in expected_parts(old, rows_with(), Spread(variance, 3.0, "own"), switched_on_since=False)}
    variance[ACCELEROMETER] = 1e-6
    variance[ACCELEROMETER.start + 6] = np.nan  # of one number alone: the others have their own, once
    some = expected_parts(old, rows_with(), Spread(variance, 3.0, "own"))
    own = np.where(np.arange(9) == 6, USUAL_ACCELEROMETER.spread[6], 1e-3)
    both = total([p for p in some if p.name in (name, "switch-on")])
    assert np.sqrt(np.diag(both)[ACCELEROMETER]) == pytest.approx(np.sqrt(2) * own)
    variance[ACCELEROMETER] = 1e-6
    assert name not in {p.name for p in expected_parts(old, rows_with(), Spread(variance, 3.0, "own"))}


def test_where_the_spread_is_from(tmp_path):
    old = written(tmp_path)
    usual = spread_of_unit(old, rows_with())
    assert usual.assumed
    assert usual.variance[ZERO] == pytest.approx(USUAL_SPREAD.rps**2)
    assert np.isnan(usual.variance[ACCELEROMETER]).all()
    given = spread_of_unit(old, rows_with(repeatability=0.02))
    assert (given.assumed, given.variance[ZERO].tolist()) == (False, [pytest.approx((0.02 * DEG) ** 2)] * 3)
    triad = spread_of_unit(written(tmp_path, accelerometer_spread=(np.arange(9) * 1e-3).tolist()), rows_with())
    assert triad.variance[ACCELEROMETER] == pytest.approx((np.arange(9) * 1e-3) ** 2)
    both = written(tmp_path, accelerometer_spread=[1e-3] * 9)
    for more, source, assumed in ((None, USUAL_SPREAD.source, True), (0.02, "given in session.toml", False)):
        rows = rows_with(repeatability=more)
        parts = [part for part in expected_parts(both, rows, spread_of_unit(both, rows)) if part.name == "switch-on"]
        assert np.diag(total(parts))[ACCELEROMETER] == pytest.approx(np.full(9, 2e-6), rel=1e-12)
        told = [(part.source, part.assumed) for part in parts]
        assert sorted(told) == sorted([(source, assumed)] * 3 + [("stated in the model file", False)] * 9)
    stated = spread_of_unit(written(tmp_path, bias_sigma_rps=[1e-3, 2e-3, 3e-3]), rows_with())
    assert stated.variance[ZERO] == pytest.approx(np.array([1e-6, 4e-6, 9e-6]))


def test_temperature_counts_for_zero_and_accelerometer(tmp_path):
    none = Spread(np.full(COUNT, np.nan), np.inf, "")
    warm = {p.name: p for p in expected_parts(written(tmp_path), rows_with(temp_c=35.0), none, temp_then_c=25.0)}
    assert np.sqrt(np.diag(total([warm["temperature"]]))[ZERO]) == pytest.approx(np.full(3, 10 * USUAL_PER_K))
    assert np.sqrt(np.diag(total([warm["accelerometer's temperature"]]))[ACCELEROMETER][6:]) == pytest.approx(np.full(3, 1.0 * MG))
    same = {p.name: p for p in expected_parts(written(tmp_path), rows_with(), none)}
    assert "temperature" not in same
    # where it is not known, and within one degree, a tenth of a milligram
    assert np.sqrt(np.diag(total([same["accelerometer's temperature"]]))[ACCELEROMETER]) == pytest.approx(
        np.r_[np.full(6, 0.1 * MG / G), np.full(3, 0.1 * MG)]
    )


def test_the_drift_that_session_and_today_share_is_in_neither(tmp_path):
    """Today's noise and the old fit each have the drift's variance: of their difference, twice its covariance is taken away."""
    none, own = Spread(np.full(COUNT, np.nan), np.inf, ""), np.diag(np.r_[np.full(9, 1e-10), np.full(3, 1e-8)])
    old = written(tmp_path, covariance=own.tolist())
    rows = replace(rows_with(), twin=SimpleNamespace(problem=SimpleNamespace(instability=BiasInstability(2e-5, "given"))))

    def of_zero(elapsed_s):
        parts = expected_parts(old, rows, none, switched_on_since=False, elapsed_s=elapsed_s)
        return np.diag(sum(total([part]) for part in parts if part.name in ("calibration", "wander")))[ZERO]

    t, span = rows.duration_s, rows.duration_s
    for elapsed_s in (1.0, 600.0):
        both = wander_covariance(np.array([0.0, t + elapsed_s]), span, instability_rps=2e-5)[0, 1]
        assert 0 < both < 5e-9
        assert of_zero(elapsed_s) == pytest.approx(np.full(3, 1e-8 - 2 * both), rel=1e-9)
    assert of_zero(1e7) == pytest.approx(np.full(3, 1e-8), rel=1e-9)


def test_a_lots_repeatability_is_in_the_order_of_the_parameters(tmp_path, monkeypatch):
    lot = SimpleNamespace(repeatability=np.sqrt(np.arange(1.0, 22.0)), sessions=30, units=10)
    annex = SimpleNamespace(lot_for=lambda path, sensor: SimpleNamespace(lot=lot))
    monkeypatch.setattr("tinygc.annexes.verification.expected.need", lambda service, option: annex)
    found = spread_of_unit(written(tmp_path), rows_with(), lot=tmp_path / "lot.json")
    assert found.variance[GYROSCOPE] == pytest.approx(np.arange(1, 13))  # a lot has the gyroscope first
    assert found.variance[ACCELEROMETER] == pytest.approx(np.arange(13, 22))
    assert (found.freedom.tolist(), found.assumed) == ([20.0] * COUNT, False)
    # B of session.toml goes before the lot's, and the model file's after it; E and the accelerometer have the lot's in each case.
    stated = written(tmp_path, bias_sigma_rps=[2e-3] * 3, accelerometer_spread=[9.0] * 9)
    own = spread_of_unit(stated, rows_with(repeatability=0.02), lot=tmp_path / "lot.json")
    assert own.variance[ZERO] == pytest.approx(np.full(3, (0.02 * DEG) ** 2))
    lot.sessions = 10
    assert spread_of_unit(written(tmp_path), rows_with(), lot=tmp_path / "lot.json").freedom[0] == 1.0
    lot.sessions = 30
    lot.repeatability[9:12] = np.nan
    hidden = spread_of_unit(stated, rows_with(), lot=tmp_path / "lot.json")
    assert hidden.variance[ZERO] == pytest.approx(np.full(3, 4e-6))
    for each, words in ((own, "given in session.toml"), (hidden, "stated in the model file")):
        others = np.r_[0 : ZERO.start]
        assert each.variance[others] == pytest.approx(found.variance[others])
        assert [each.sources[k] for k in (0, 9, ZERO.start)] == ["30 sessions of 10 units of a lot"] * 2 + [words]
        assert [each.freedom[k] for k in (0, 9, ZERO.start)] == [20.0, 20.0, np.inf]
    assert spread_of_unit(written(tmp_path), rows_with(), lot=tmp_path / "lot.json").assumed


def test_a_history_of_one_shows_no_spread(tmp_path):
    with pytest.raises(FormatError, match="two or more"):
        spread_of_unit(written(tmp_path), rows_with(), [tmp_path])


def of_unit(tmp_path, monkeypatch, vectors, matrices=None, serial=None):
    """The spread by other sessions of the unit, without errors of their own; matrices: of their accelerometers, None for given ones."""
    sessions, made = {}, config()
    made = replace(made, sensor=replace(made.sensor, serial=serial))
    for number, vector in enumerate(vectors):
        calibration = replace(made.accelerometer, matrix=np.eye(3) if matrices is None else matrices[number])
        triad = SessionTriad(calibration=calibration, covariance=None if matrices is None else 1e-20 * np.eye(9))
        folder = tmp_path / f"2026-01-{20 - number}"  # the last one first
        sessions[folder] = Calibrated(folder, made, vector, 1e-20 * np.eye(12), (), (), (), triad=triad)
    monkeypatch.setattr("tinygc.annexes.verification.expected.read_calibrated", sessions.__getitem__)
    old = written(tmp_path, accelerometer=accelerometer_table(config().accelerometer), sensor={"serial": "mine"})
    return spread_of_unit(old, rows_with(), list(sessions)), [each.triad.fit.values for each in sessions.values()]


def test_the_spread_between_sessions_is_their_sample_variance(tmp_path, monkeypatch):
    vectors = 1e-3 * np.random.default_rng(1).normal(size=(3, 12))
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    found, _ = of_unit(tmp_path, monkeypatch, vectors)
    assert found.variance[GYROSCOPE] == pytest.approx(vectors.var(axis=0, ddof=1))
    assert np.isnan(found.variance[ACCELEROMETER]).all()  # all given: they show no spread of theirs
    assert found.freedom[GYROSCOPE].tolist() == [2.0] * 12
    assert (found.source, found.note, found.assumed) == ("3 other sessions of this unit", "", False)
    matrices = [np.diag(np.r_[1 + 1e-3 * number, 1, 1]) @ turn for number in (0, 2, 1)]
    found, values = of_unit(tmp_path, monkeypatch, vectors, matrices)
    turned = [np.r_[(turn.T @ each[:9].reshape(3, 3)).ravel(), turn.T @ each[9:]] for each in vectors]  # into the frame of the old one
    assert found.variance[GYROSCOPE] == pytest.approx(np.var(turned, axis=0, ddof=1))
    assert found.variance[ACCELEROMETER] == pytest.approx(np.var(values, axis=0, ddof=1), abs=1e-15)


def test_a_step_among_the_other_sessions_is_no_spread(tmp_path, monkeypatch):
    vectors = 1e-5 * np.random.default_rng(1).normal(size=(8, 12))
    vectors[:4, 9:11] += 0.1  # from the fifth last on
    found, _ = of_unit(tmp_path, monkeypatch, vectors)
    assert (found.variance[ZERO] < 1e-9).all()
    assert found.freedom[GYROSCOPE].tolist() == [6.0] * 9 + [5.0, 5.0, 6.0]
    assert "a step in B_x, B_y between 2026-01-16 and 2026-01-17: it is taken out" in found.note


def test_a_history_of_another_unit_is_refused(tmp_path, monkeypatch):
    with pytest.raises(FormatError, match=r"2026-01-\d+: of 'other', expected 'mine'"):
        of_unit(tmp_path, monkeypatch, np.zeros((2, 12)), serial="other")
    assert of_unit(tmp_path, monkeypatch, np.eye(12)[:2], serial="mine")[0].variance[GYROSCOPE.start] == pytest.approx(0.5)


def test_without_a_covariance_that_of_a_usual_session_is_assumed(tmp_path):
    old = written(tmp_path)
    assert np.diag(old.covariance)[GYROSCOPE] == pytest.approx(TARGETS**2)
    assert any("no covariance" in line for line in old.lacks)


def test_another_kind_of_model_is_a_correction_of_its_own_rates(tmp_path):
    """omega' = E' omega + B' of calibrated rates: what a changed E and B of the model are to it, by finite differences."""
    effect = effect_of("gyro.g_sensitivity")
    model = PhysicsModel(LinearModel(E, B), (AppliedEffect(effect, np.full(9, 1e-4)),), Conditions(60.0, 10.0, 25.0))
    sigma = np.r_[np.full(9, 1e-3), np.full(3, 1e-4), np.full(9, 1e-6)]
    old = written(tmp_path, model, covariance=np.diag(sigma**2).tolist())
    assert old.linear.vector == pytest.approx(np.r_[np.eye(3).ravel(), np.zeros(3)])
    assert old.bias == pytest.approx(B)
    measured = np.random.default_rng(1).normal(size=(5, 3))
    omega = measured @ E.T + B
    expected = np.zeros((12, 12))
    columns = np.concatenate([np.kron(np.eye(3), omega[:, None, :]).reshape(5, 3, 9), np.broadcast_to(np.eye(3), (5, 3, 3))], axis=2)
    for k, step in enumerate(np.diag(sigma[:12])):
        moved = LinearModel.from_vector(np.r_[E.ravel(), B] + step)
        change = (measured @ moved.E.T + moved.B - omega).ravel()
        expected[:, k] = np.linalg.lstsq(columns.reshape(15, 12), change, rcond=None)[0]
    assert old.covariance[GYROSCOPE, GYROSCOPE] == pytest.approx(expected @ expected.T, rel=1e-6, abs=1e-14)
    assert pytest.approx(B + 1) == with_bias_moved(model, np.ones(3)).linear.B


def test_settings_that_differ_are_facts(tmp_path):
    old = written(tmp_path, sensor={"model": "X", "serial": "1", "gyro_fs_dps": 250.0, "odr_hz": 104.0})
    sensor = replace(config().sensor, model="X", serial="2", gyro_fs_dps=500.0, odr_hz=104.0)
    said, other = facts(old, SimpleNamespace(config=replace(config(), sensor=sensor)))
    assert other
    assert [line.split(":")[0] for line in said] == ["full scale of the gyroscope", "serial of the sensor"]
