"""The field's words, each against a sensor built by hand with that error alone; and their uncertainties by sampling."""

import numpy as np
import pytest

from session.io.units import DEG
from tinygc.models.linear import NAMES, WORDS, field_quantities, field_vector


def calibration_of(M, b=(0.0, 0.0, 0.0)):
    """``LinearModel.vector`` that undoes m = M omega + b."""
    E = np.linalg.inv(M)
    return np.concatenate([E.ravel(), -E @ b])


def quantities(M, b=(0.0, 0.0, 0.0)):
    found = field_quantities(calibration_of(np.asarray(M, float), np.asarray(b, float)), np.zeros((12, 12)))
    return {(q.word, q.component): q.value for q in found}


def test_a_perfect_sensor_has_no_errors():
    assert field_vector(calibration_of(np.eye(3))) == pytest.approx(np.zeros(18), abs=1e-12)


def test_an_axis_that_reads_too_much_has_a_positive_scale_factor_error():
    found = quantities(np.diag([1.01, 0.998, 1.0]), (0.02, 0.0, -0.01))
    assert found["scale factor error", "x"] == pytest.approx(10_000)
    assert found["scale factor error", "y"] == pytest.approx(-2000)
    assert found["bias", "x"] == pytest.approx(0.02 / DEG)
    assert found["bias", "z"] == pytest.approx(-0.01 / DEG)
    assert found["misalignment", "x to y"] == 0


def test_an_axis_that_leans_is_misaligned_and_not_orthogonal():
    angle = 7e-3
    M = np.eye(3)
    M[0] = np.cos(angle), np.sin(angle), 0
    found = quantities(M)
    assert found["misalignment", "x to y"] == pytest.approx(7)
    assert found["nonorthogonality", "xy"] == pytest.approx(7)
    assert found["scale factor error", "x"] == pytest.approx(0, abs=1e-6)
    assert found["misalignment", "y to x"] == pytest.approx(0, abs=1e-9)
    assert found["triad rotation", "z"] == pytest.approx(3.5, rel=1e-4)  # half of it is the triad's


def test_a_triad_that_is_only_turned_is_orthogonal():
    angle = 5e-3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    found = quantities(turn.T)  # rows: input axes, turned by +angle about z
    assert found["triad rotation", "z"] == pytest.approx(5)
    assert found["misalignment", "x to y"] == pytest.approx(5)
    assert found["misalignment", "y to x"] == pytest.approx(-5)
    for pair in ("xy", "yz", "zx"):
        assert found["nonorthogonality", pair] == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
def test_uncertainties_are_those_of_samples():
    rng = np.random.default_rng(5)
    M = np.eye(3) + 0.02 * rng.standard_normal((3, 3))
    vector = calibration_of(M, 0.01 * rng.standard_normal(3))
    root = 1e-4 * rng.standard_normal((12, 12))
    samples = np.array([field_vector(vector + root @ rng.standard_normal(12)) for _ in range(4000)])
    expanded = np.array([q.expanded for q in field_quantities(vector, root @ root.T)])
    units = np.concatenate([[si] * len(components) for _, components, _, si in WORDS])
    assert expanded == pytest.approx(2 * samples.std(axis=0) / units, rel=0.06)


def test_what_no_turn_shows_is_said():
    hidden = ("E_xy", "E_yy", "E_zy")
    found = field_quantities(calibration_of(np.eye(3)), np.eye(12), hidden)
    shown = {(q.word, q.component): q.observed for q in found}
    assert set(hidden) < set(NAMES)
    assert not shown["scale factor error", "y"]
    assert not shown["misalignment", "x to y"]
    assert not shown["nonorthogonality", "yz"]
    assert shown["scale factor error", "x"]
    assert shown["nonorthogonality", "zx"]
    assert shown["bias", "y"]
