"""The best combination of units, how it is chosen, and its file."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from formats_page import strangers
from simulated_array import DENSITY, RATE_HZ, model_of, motion, units

from session.io.errors import FormatError
from tinygc import CalibrationError
from tinygc.annexes.arrays.fusion import build_array_model, save_array_model
from tinygc.annexes.arrays.model import best_weights, combined, from_table, load_array_model, to_table

RNG = np.random.default_rng(16)


def some_covariance(size: int) -> np.ndarray:
    root = RNG.normal(size=(size, size))
    return root @ root.T + size * np.eye(size)


def test_no_other_unbiased_combination_has_less_noise():
    """Gauss and Markov: any other weights that sum to identity have a covariance greater by a positive matrix."""
    covariance = some_covariance(12)
    weights, fused = best_weights(covariance)
    np.testing.assert_allclose(weights.sum(axis=0), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(combined(weights, covariance), fused, rtol=1e-10)
    for _ in range(50):
        change = RNG.normal(size=(4, 3, 3)) * 0.1
        other = weights + change - change.mean(axis=0)
        assert np.linalg.eigvalsh(combined(other, covariance) - fused)[0] > 0


def test_equal_units_gain_the_root_of_their_number_and_correlated_ones_less():
    count, rho = 8, 0.1
    _, fused = best_weights(np.eye(3 * count))
    np.testing.assert_allclose(fused, np.eye(3) / count, atol=1e-15)
    alike = np.kron((1 - rho) * np.eye(count) + rho, np.eye(3))
    _, fused = best_weights(alike)
    np.testing.assert_allclose(fused, np.eye(3) * (1 + (count - 1) * rho) / count, atol=1e-14)


@pytest.mark.parametrize("covariance", [np.zeros((6, 6)), np.kron(np.ones((2, 2)), np.eye(3))])
def test_noise_that_no_combination_is_best_for_is_refused(covariance):
    with pytest.raises(CalibrationError, match="no best combination"):
        best_weights(covariance)


def test_the_combination_of_clean_readings_is_the_rate():
    model = model_of(units(5))
    omega = motion(200)
    clean = np.einsum("nij,tnj->tni", np.linalg.inv(model.matrices), omega[:, None] - model.offsets)
    np.testing.assert_allclose(model(clean), omega, atol=1e-12)


def test_weights_are_best_for_what_is_greater_over_a_turn():
    quiet_slow = [replace(unit, bias_instability=np.full(3, 1e-6 * (1 + i))) for i, unit in enumerate(units(3))]
    noisy_slow = [replace(unit, bias_instability=np.full(3, 1e-3 * (1 + i))) for i, unit in enumerate(units(3))]
    white, slow = model_of(quiet_slow), model_of(noisy_slow)
    assert white.best_for == "white"
    assert "best for white noise" in white.reason
    assert slow.best_for == "instability"
    assert slow.weights[0, 0, 0] > 0.6 > white.weights[0, 0, 0]
    assert model_of([replace(unit, bias_instability=None) for unit in quiet_slow]).best_for == "white"


def test_the_parameters_sigma_is_that_of_drawn_parameters():
    """Monte Carlo over E and B of all units, at a rate at which both matter."""
    model, omega = model_of(units(3)), np.array([2.0, -1.0, 0.5])
    clean = np.einsum("nij,nj->ni", np.linalg.inv(model.matrices), omega - model.offsets)
    draws = 20_000
    total = np.zeros((draws, 3))
    for i, unit in enumerate(model.units):
        off = RNG.multivariate_normal(np.zeros(12), unit.covariance, draws)
        body = off[:, :9].reshape(-1, 3, 3) @ clean[i] + off[:, 9:]
        total += body @ (model.weights[i] @ unit.place.mounting).T
    np.testing.assert_allclose(total.std(axis=0), model.parameter_sigma(omega), rtol=4 / np.sqrt(2 * draws))


def test_the_file_gives_the_model_back_and_stands_on_the_page(tmp_path):
    found = [replace(unit, sha256=("0" * 64, "1" * 64)) for unit in units(3)]
    model = replace(model_of(found, joint_covariance=np.eye(36) * 1e-8, session="a\nb"), correlation=np.eye(9))
    save_array_model(model, tmp_path / "array.json")
    again = load_array_model(tmp_path / "array.json")
    assert to_table(again) == to_table(model)
    raw = RNG.normal(size=(5, 3, 3))
    np.testing.assert_array_equal(again(raw), model(raw))
    assert not strangers(json.loads((tmp_path / "array.json").read_text()))


WRONG = {
    "schema": (lambda table: table.update(schema="tinygc-model/1"), "schema is"),
    "rates": (lambda table: table.update(rates="dps"), "rates are"),
    "one unit": (lambda table: table.update(units=table["units"][:1]), "units has 1 entries, expected 2"),
    "twice": (lambda table: table["units"][0].update(number=1), "unit 1 stands twice"),
    "singular": (lambda table: table["units"][1].update(E=[[1, 0, 0], [1, 0, 0], [0, 0, 1]]), r"units\[1\].E is singular"),
    "shape": (lambda table: table["units"][1].update(B=[0, 0]), r"units\[1\].B has shape 2, expected 3 numbers"),
    "not finite": (lambda table: table["units"][1].update(B=[0, 0, float("nan")]), "not finite"),
    "no rotation": (lambda table: table["units"][2].update(mounting=[[1, 0, 0], [0, 1, 0], [0, 0, 1.01]]), "is no rotation"),
    "mirrored": (lambda table: table["units"][2].update(mounting=np.diag([1, 1, -1]).tolist()), "is no rotation"),
    "no noise": (lambda table: table["units"][0].update(noise_density_rps_rthz=[0, 1, 1]), "noise_density_rps_rthz.0. is 0"),
    "sum": (lambda table: table["units"][0].update(weights=np.eye(3).tolist()), "miss identity by"),
    "negative": (
        lambda table: [unit.update(weights=(np.eye(3) * w).tolist()) for unit, w in zip(table["units"], (1.5, -1.0, 0.5), strict=True)],
        "not positive",
    ),
    "correlation": (lambda table: table.update(noise_correlation=np.eye(6).tolist()), "noise_correlation has 6 rows, expected 9"),
    "diagonal": (lambda table: table.update(noise_correlation=(np.eye(9) / 2).tolist()), "diagonal other than 1"),
    "covariance": (lambda table: table["units"][0].update(covariance=(-np.eye(12)).tolist()), "not positive"),
    "rate": (lambda table: table.update(rate_hz=0), "rate_hz is 0"),
    "missing": (lambda table: table["units"][0].pop("clock"), "clock is missing"),
    "clock": (lambda table: table["units"][0]["clock"].update(rate=3), "clock.rate is 3"),
    "accelerometer": (lambda table: table["units"][0].update(accelerometer={"matrix": 3}), "accelerometer"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_model_is_refused_in_one_line(name):
    table = copy.deepcopy(to_table(model_of(units(3))))
    change, said = WRONG[name]
    change(table)
    with pytest.raises(FormatError, match=said) as caught:
        from_table(table, "array.json")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("array.json")


def test_fewer_than_two_units_and_two_of_one_number_are_refused():
    found = units(2, density=DENSITY)
    with pytest.raises(CalibrationError, match="array of 1 unit"):
        build_array_model(found[:1], RATE_HZ)
    with pytest.raises(CalibrationError, match="stands twice"):
        build_array_model([found[0], found[0]], RATE_HZ)
