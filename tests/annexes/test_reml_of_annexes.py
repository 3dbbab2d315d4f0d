"""An array's form of the restricted likelihood against its definition with full matrices, and against ``noise.reml``."""

import numpy as np
import pytest

from tinygc.annexes.arrays.system import System
from tinygc.noise.reml import estimate


@pytest.fixture(scope="module")
def system():
    """Twelve rows, of which one is rejected, three unknowns with priors about a point, two components."""
    rng = np.random.default_rng(2)
    V = np.stack([np.repeat([1.0, 0.0], 6), np.repeat([0.0, 2.0], 6)])
    out = np.arange(12) == 4
    return System(
        rng.normal(size=(12, 3)), rng.normal(size=12), np.full(12, 0.1), V, np.array([0.5, 2.0, 10.0]), np.array([0.3, 0, -1.0]), out
    )


T = np.array([0.4, 0.7])


def dense(system, t):
    """Residual of the expected values, and covariance, of the rows that count: the unknowns are random effects about their priors."""
    kept = ~system.out
    design, variance = system.design[kept], (system.base + t @ system.V)[kept]
    return system.values[kept] + design @ system.pull, np.diag(variance) + design @ np.diag(system.prior**2) @ design.T


def test_the_likelihood_of_an_array_is_its_definition(system):
    residual, C = dense(system, T)
    assert system.solved(T).value == pytest.approx(np.linalg.slogdet(C)[1] + residual @ np.linalg.solve(C, residual), rel=1e-12)


def test_the_solution_of_an_array_is_the_conditional_mean_with_its_covariance(system):
    residual, C = dense(system, T)
    gain = np.diag(system.prior**2) @ system.design[~system.out].T @ np.linalg.inv(C)
    found = system.solved(T)
    assert found.x == pytest.approx(system.pull - gain @ residual, rel=1e-10)
    assert found.covariance == pytest.approx(np.diag(system.prior**2) - gain @ system.design[~system.out] @ np.diag(system.prior**2))


def test_the_slope_of_an_arrays_likelihood_is_its_derivative(system):
    step = 1e-5 * np.eye(2)
    numeric = [-(system.solved(T + h).value - system.solved(T - h).value) / 2 / 2e-5 for h in step]
    assert system.solved(T).score()[0] == pytest.approx(numeric, rel=1e-6)


def test_the_sigma_of_an_arrays_component_is_the_expected_information(system):
    """Half the trace of (P V_g P V_h); with priors, P is the inverse of the whole covariance."""
    inverse = np.linalg.inv(dense(system, T)[1])
    V = [np.diag(v[~system.out]) for v in system.V]
    information = np.array([[np.trace(inverse @ a @ inverse @ b) / 2 for b in V] for a in V])
    assert system.solved(T).sigma() == pytest.approx(np.sqrt(np.diag(np.linalg.inv(information))), rel=1e-10)


def test_an_array_and_the_core_find_the_same_components(system):
    """Six rows a component make a flat likelihood; the search of either ends within a thousandth of the other's."""
    kept = ~system.out
    n = int(kept.sum())
    residual = system.values[kept] + system.design[kept] @ system.pull
    J, base = system.design[kept] * system.prior, np.diag(system.base[kept])
    V = [np.diag(v[kept]) for v in system.V]
    found = estimate(residual, J, base, V, np.ones(2), [None] * 2, [np.arange(n)], steps=200)
    assert system.estimated(np.ones(2)).t == pytest.approx(found.s**2, rel=5e-3, abs=1e-3)
    assert system.estimated(np.ones(2)).value == pytest.approx(found.value, abs=1e-3)
