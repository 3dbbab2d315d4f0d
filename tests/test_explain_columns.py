"""The twin's columns: the slopes of its exact residuals."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_twins import make_twin_of

from session.io.units import DEG, EARTH_RATE_RPS, MG
from tinygc.effects import AppliedEffect, catalogue
from tinygc.explanation.search import slow_candidates, unknown_candidates
from tinygc.explanation.truth_names import wander
from tinygc.noise.candidates import candidates
from tinygc.noise.twin import State, Twin

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


def slope(twin: Twin, state: State, direction: np.ndarray, step: float) -> np.ndarray:
    """Central difference of the exact residuals along a direction of ``State.vector``."""
    there, back = (state.with_vector(state.vector + sign * step * direction) for sign in (1, -1))
    return (twin.residuals(there).stacked() - twin.residuals(back).stacked()) / (2 * step)


def errors(columns: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return np.linalg.norm(columns - exact, axis=0) / np.linalg.norm(exact, axis=0)


def along(twin: Twin, state: State, first: int, count: int, step: float) -> np.ndarray:
    directions = np.eye(len(state.vector))[first : first + count]
    return np.stack([slope(twin, state, direction, step) for direction in directions], axis=-1)


def test_columns_of_the_linear_model(twin_of):
    twin, _ = twin_of()
    state = twin.start()
    columns = twin.linear_columns(twin.sensitivity(state, twin.rates(state))).stacked()
    assert errors(columns[:, :9], along(twin, state, 0, 9, 1e-6)).max() < 2e-3
    assert errors(columns[:, 9:], along(twin, state, 9, 3, 1e-3 * DEG)).max() < 2e-3


def test_columns_of_gravity_and_of_the_earth(twin_of):
    twin, _ = twin_of()
    state = twin.start()
    np.testing.assert_allclose(twin.gravity_columns().stacked(), along(twin, state, 14, 1, 1e-3), atol=1e-9)
    horizontal = twin.earth_columns().stacked() @ state.axes.T
    assert errors(horizontal, along(twin, state, 12, 2, 0.1 * EARTH_RATE_RPS)).max() < 2e-3


def test_shapes_without_a_name_read_only_what_they_declare(twin_of):
    """What they do not declare is not shown to them."""
    twin, _ = twin_of(warm_up_c=6.0)
    tried = [*unknown_candidates(twin), wander(np.linspace(0, twin.movements[0].duration_s, 5))]
    assert {effect.id for effect in tried} >= {"unknown.curve_over_temperature", "unknown.attitude", "unknown.slow_bias"}
    for effect in tried:
        theta = np.full(effect.parameter.size, 1e-3)
        assert np.isfinite(effect.correct(twin.movements[0].rate, twin.movements[0], theta)).all()


@pytest.mark.parametrize("name", sorted(set(catalogue()) - {n for n, e in catalogue().items() if e.kind in ("register", "motion")}))
def test_columns_of_each_effect(twin_of, name):
    """At zero, where naming looks at them."""
    twin, _ = twin_of(warm_up_c=6.0)
    effect = catalogue()[name]
    if effect.scan:
        effect = effect.variants(np.array([twin.movements[0].duration_s * 0.4]))[0]
    state = replace(twin.start(), claims=(AppliedEffect(effect, np.zeros(effect.parameter.size)),))
    rates = twin.rates(state)
    bare = replace(state, claims=())
    columns = twin.effect_columns(effect, bare, twin.sensitivity(state, rates), rates).stacked()
    step = {"earth.rotation": 1e-2 * EARTH_RATE_RPS, "reference.accelerometer": 0.1 * MG}.get(name, 1e-4 * effect.parameter.plausible)
    exact = along(twin, state, 15, effect.parameter.size, step)
    assert errors(columns, exact).max() < 1e-2, errors(columns, exact)


def test_a_basis_is_its_columns_and_undoes_what_it_adds(twin_of):
    """The short way, which sums each curve once for all axes, and the long one; and the exact rate, which needs no repetition."""
    twin, _ = twin_of()
    state = twin.start()
    rates = twin.rates(state)
    sensitivity = twin.sensitivity(state, rates)
    effects = {str(e.equation): e for e in slow_candidates(twin) + candidates(twin) if e.basis is not None}
    assert len(effects) > 40
    for effect in effects.values():
        short = twin.effect_columns(effect, state, sensitivity, rates)
        long = twin.effect_columns(replace(effect, basis=None), state, sensitivity, rates)
        np.testing.assert_allclose(short.stacked(), long.stacked(), atol=1e-12 * np.abs(long.stacked()).max())
        theta = np.random.default_rng(1).normal(0, 0.1, effect.parameter.size)
        movement = twin.movements[0].with_rate(rates[0])
        np.testing.assert_allclose(effect.distort(movement, theta), replace(effect, basis=None).distort(movement, theta), atol=1e-13)
        np.testing.assert_allclose(effect.correct(effect.distort(movement, theta), movement, theta), rates[0], atol=1e-13)


def test_columns_of_a_claimed_lag_are_those_where_it_stands(twin_of):
    """A lag's linear columns, taken from the corrected rate, would not see what all axes have in common."""
    twin, _ = twin_of()
    effect = catalogue()["gyro.bandwidth"]
    state = replace(twin.start(), claims=(AppliedEffect(effect, np.array([0.01, 0.02, 0.015])),))
    rates = twin.rates(state)
    columns = twin.effect_columns(effect, state, twin.sensitivity(state, rates), rates).stacked()
    exact = along(twin, state, 15, 3, 1e-5)
    assert errors(columns, exact).max() < 1e-2


def test_the_state_is_its_vector(twin_of):
    twin, _ = twin_of()
    effects = [catalogue()["gyro.g_sensitivity"], catalogue()["gyro.thermal_bias"]]
    state = replace(twin.start(), claims=tuple(AppliedEffect(effect, np.arange(effect.parameter.size, dtype=float)) for effect in effects))
    np.testing.assert_array_equal(state.with_vector(state.vector).vector, state.vector)
    assert len(state.vector) == 15 + 9 + 3
    with pytest.raises(ValueError, match=r"gyro\.thermal_bias: theta has shape \(2,\)"):
        AppliedEffect(effects[1], np.zeros(2))
