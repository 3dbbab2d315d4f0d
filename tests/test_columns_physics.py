"""The twin's columns are the slopes of its exact residuals; shapes without a name are the functions that their equations state."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from numpy.testing import assert_allclose, assert_array_equal
from simulated_twins import make_twin_of
from small_turns import numeric_jacobian

from session.base.units import EARTH_RATE_RPS, MG
from tinygc.closure.earth import no_earth, with_heading
from tinygc.effects import AppliedEffect, Movement, catalogue
from tinygc.explanation.search import _line_frequencies, curves_like, lines_end_hz, slow_candidates, unknown_candidates
from tinygc.noise.refit import candidates

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


# Columns.


def slopes(twin, state, first, count, step):
    """(n, count) central differences of the exact residuals along some numbers of ``State.vector``."""
    vector = state.vector
    some = np.eye(len(vector))[first : first + count]
    return numeric_jacobian(lambda part: twin.residuals(state.with_vector(vector + part @ some)).stacked(), np.zeros(count), step)


def errors(columns, exact):
    return np.linalg.norm(columns - exact, axis=0) / np.linalg.norm(exact, axis=0)


def test_columns_of_the_linear_model_of_gravity_and_of_the_earth(twin_of):
    twin, _ = twin_of(warm_up_c=6.0, segments=8)
    state = twin.start()
    columns = twin.linear_columns(twin.sensitivity(state, twin.rates(state))).stacked()
    assert errors(columns[:, :9], slopes(twin, state, 0, 9, 1e-6)).max() < 2e-3
    assert errors(columns[:, 9:], slopes(twin, state, 9, 3, 1e-3 * DEG)).max() < 2e-3
    assert_allclose(twin.gravity_columns().stacked(), slopes(twin, state, 14, 1, 1e-3), atol=1e-9)
    assert errors(twin.earth_columns().stacked() @ state.axes.T, slopes(twin, state, 12, 2, 0.1 * EARTH_RATE_RPS)).max() < 2e-3
    two = [AppliedEffect(catalogue()[name], np.arange(size)) for name, size in (("gyro.g_sensitivity", 9), ("gyro.thermal_bias", 3))]
    state = replace(state, claims=tuple(two))
    assert_array_equal(state.with_vector(state.vector).vector, state.vector)
    with pytest.raises(ValueError, match=r"gyro\.thermal_bias: theta has shape \(2,\)"):
        AppliedEffect(catalogue()["gyro.thermal_bias"], np.zeros(2))


def test_columns_of_each_effect(twin_of):
    """At zero, where naming looks at them; of a claimed lag where it stands: from the corrected rate they miss what all axes share."""
    twin, _ = twin_of(warm_up_c=6.0, segments=8)
    bare = twin.start()
    rates = twin.rates(bare)
    sensitivity, lag = twin.sensitivity(bare, rates), np.array([0.01, 0.02, 0.015])
    steps = {"earth.rotation": 1e-2 * EARTH_RATE_RPS, "reference.accelerometer": 0.1 * MG}
    for name, effect in catalogue().items():
        if effect.kind in ("register", "motion"):
            continue
        if effect.scan:
            effect = effect.variants(np.array([twin.movements[0].duration_s * 0.4]))[0]
        size = effect.parameter.size
        state = replace(bare, claims=(AppliedEffect(effect, np.zeros(size)),))
        exact = slopes(twin, state, 15, size, steps.get(name, 1e-4 * effect.parameter.plausible))
        assert errors(twin.effect_columns(effect, bare, sensitivity, rates).stacked(), exact).max() < 1e-2, name
        if name == "gyro.bandwidth":
            state = replace(bare, claims=(AppliedEffect(effect, lag),))
            there = twin.rates(state)
            columns = twin.effect_columns(effect, state, twin.sensitivity(state, there), there).stacked()
            assert errors(columns, slopes(twin, state, 15, 3, 1e-5)).max() < 1e-2


def test_columns_are_sums_over_the_samples_of_each_turn_where_a_few_are_taken_at_once(twin_of, monkeypatch):
    twin, _ = twin_of(warm_up_c=6.0, segments=8)
    monkeypatch.setattr("tinygc.noise.twin.AT_ONCE", 10)
    monkeypatch.setattr("tinygc.closure.residual.parts", lambda count: [slice(first, first + 3) for first in range(0, count, 3)])
    state = twin.start()
    (rate,) = rates = twin.rates(state)
    sensitivity, moved = twin.sensitivity(state, rates), twin.movements[0].with_rate(rate)
    tried = [each for each in [*catalogue().values(), *slow_candidates(twin)[::9]] if each.kind == "rate" and not each.on_readings]
    assert {(each.needs_rate_hz, each.basis is None) for each in tried} == {(a, b) for a in (True, False) for b in (True, False)}
    for effect in tried:
        columns, found = effect.columns(moved), twin.effect_columns(effect, state, sensitivity, rates)
        turns = [
            np.einsum("tdi,tip->dp", s[: k.stop - k.start], columns[k.start : k.stop])
            for s, k in zip(sensitivity, twin.segments, strict=True)
        ]
        assert_allclose(found.closure, -np.array(turns), atol=1e-12 * np.abs(turns).max(), err_msg=effect.id)
        stills = [-columns[still.start : still.stop].mean(axis=0) for _, still in twin.stills]
        assert_allclose(found.still, stills, atol=1e-12 * np.abs(columns).max(), err_msg=effect.id)


def test_means_over_stills_are_of_all_readings_where_rows_are_means(twin_of, monkeypatch):
    twin, _ = twin_of(warm_up_c=6.0, segments=8)
    monkeypatch.setattr("tinygc.noise.thinned.LONG", 100)
    monkeypatch.setattr("tinygc.noise.thinned.MEANS_AT_ONCE", 500)
    long = type(twin)(twin.problem)
    assert np.unique(long.counts(0)).size > 2
    assert_allclose(long._mean_readings, twin._mean_readings, rtol=1e-9)


def test_a_basis_is_its_columns_and_undoes_what_it_adds(twin_of):
    """The short way, which sums each curve once for all axes, and the long one.  What a shape does not declare is not shown to it."""
    twin, _ = twin_of(warm_up_c=6.0, segments=8)
    state = twin.start()
    rates = twin.rates(state)
    sensitivity = twin.sensitivity(state, rates)
    effects = {str(e.equation): e for e in slow_candidates(twin) + candidates(twin)[::7] if e.basis is not None}
    assert {e.id for e in effects.values()} >= {"unknown.curve_over_temperature", "unknown.attitude", "unknown.periodic"}
    for effect in list(effects.values())[::3]:
        short = twin.effect_columns(effect, state, sensitivity, rates).stacked()
        long = twin.effect_columns(replace(effect, basis=None), state, sensitivity, rates).stacked()
        assert_allclose(short, long, atol=1e-12 * np.abs(long).max())
        theta = np.random.default_rng(1).normal(0, 0.1, effect.parameter.size)
        moved = twin.movements[0].with_rate(rates[0])
        distorted = effect.distort(moved, theta)
        assert_allclose(distorted, replace(effect, basis=None).distort(moved, theta), atol=1e-13)
        assert_allclose(effect.correct(distorted, moved, theta), rates[0], atol=1e-13)


# Shapes without a name.

FS = 500 * DEG


def movement(temp_c=25.0, began_s=0.0):
    t_s = began_s + np.linspace(0, 100, 101)
    rate = FS * np.column_stack([np.linspace(-0.9, 0.9, 101), np.full(101, 0.5), np.linspace(0.2, -0.4, 101)])
    force = np.tile([0.6, -0.48, 0.64], (101, 1))
    return Movement(t_s, 1.0, rate, force, np.full(101, temp_c), np.zeros(101), 200.0, FS, 25.0)


def session_of_movements(*movements, stills=10, earth=None, latitude_deg=47.0):
    site = SimpleNamespace(latitude_deg=latitude_deg)
    problem = SimpleNamespace(earth=earth or no_earth(), session=SimpleNamespace(config=SimpleNamespace(site=site)))
    axes = [np.full((101, 6), float(number + 1)) for number in range(len(movements))]
    thermometer = all(np.isfinite(each.temp_c).all() for each in movements)
    return SimpleNamespace(movements=list(movements), stills=[None] * stills, problem=problem, level_axes=axes, has_thermometer=thermometer)


def shapes(twin, name):
    return [each for each in slow_candidates(twin) if each.id == f"unknown.{name}"]


def test_which_shapes_are_tried_with_how_many_numbers():
    twin = session_of_movements(movement(20.0), movement(30.0), earth=with_heading(47.0, 20.0))
    counts = {}
    for each in slow_candidates(twin):
        counts.setdefault(each.id.removeprefix("unknown."), []).append(each.parameter.size)
        assert (each.parameter.unit, each.parameter.si, each.parameter.plausible) == ("dps", DEG, 5 * DEG)
    assert counts == {
        "periodic": [6] * 40,
        "curve_over_time": [6, 9, 12, 15],
        "curve_over_temperature": [6, 9, 12, 15],
        "attitude": [18, 48],
        "rate_products": [9],
        "world_field": [18],
        "world_direction": [3],
        "curve_over_rate": [3] * 4,
    }
    for logs in ((np.nan,), (20.0, np.nan), (np.nan, 20.0)):
        bare = [each.id for each in slow_candidates(session_of_movements(*map(movement, logs)))]
        assert bare.count("unknown.warm_up") == 10
        assert not {"unknown.curve_over_temperature", "unknown.world_direction"} & set(bare)  # the catalogue has the Earth's rate
    for change, tried in ((0.49, 0), (0.51, 4)):
        assert len(shapes(session_of_movements(movement(25.0), movement(25.0 + change)), "curve_over_temperature")) == tried


def test_lines_and_warm_ups_span_the_session_and_fast_lines_begin_where_stills_alias_them():
    """From its length to a little over twice the time between stills: twenty seconds, and at least half of it.  A long session has the
    slowest alone, as many as there is time for."""
    twin = session_of_movements(movement(np.nan))
    frequencies = [each.shape["frequency_hz"] for each in shapes(twin, "periodic")]
    assert_allclose(frequencies, 1 / np.geomspace(200.0, 44.0, 40))
    assert_allclose([each.shape["time_constant_s"] for each in shapes(twin, "warm_up")], np.geomspace(40.0, 200.0, 10))
    few = shapes(session_of_movements(movement(np.nan), stills=1), "periodic")
    assert few[-1].shape["frequency_hz"] == pytest.approx(1 / 220)
    hz = np.arange(0.025, 3.0, 0.005)
    assert_allclose(_line_frequencies(twin), hz)
    assert lines_end_hz(twin) is None
    lines = [each.shape["frequency_hz"] for each in unknown_candidates(twin) if each.id == "unknown.periodic"]
    assert_allclose(lines[40:], hz)
    for rows, count in ((400_000_000, 5), (666_666_667, 2), (4_000_000_000, 1), (int(2e9 / 594.5), 594), (int(2e9 / 595.5), 595)):
        long = SimpleNamespace(movements=[SimpleNamespace(t_s=range(rows), duration_s=200.0)], stills=[None] * 10)
        assert_allclose(_line_frequencies(long), hz[:count])
        assert lines_end_hz(long) == (None if count == 595 else pytest.approx(hz[count - 1]))


def test_each_shape_is_what_its_equation_says():
    moved, twin = movement(22.0, began_s=50.0), session_of_movements(movement(20.0), movement(30.0))
    legendre = np.polynomial.legendre.Legendre.basis
    for order, curve in zip((2, 3, 4, 5), shapes(twin, "curve_over_time"), strict=True):
        expected = [legendre(n)(2 * moved.t_s / 200 - 1) for n in range(1, order + 1)]
        assert_allclose(curve.basis(moved), np.stack(expected, axis=1), atol=1e-12)
        assert curve.equation == f"ω += smooth curve of time, Legendre order {order}"
    curve, *_ = shapes(twin, "curve_over_temperature")
    assert_allclose(curve.basis(moved), np.tile([-0.6, (3 * 0.36 - 1) / 2], (101, 1)))
    assert_allclose(curve.basis(movement(40.0)), 1.0)  # beyond what the session had
    line, phase = shapes(twin, "periodic")[0], np.pi * moved.t_s / 100
    assert line.equation == "ω += a cos(2π f t) + b sin(2π f t), f = 0.0050 Hz"
    assert "a period of 200.0 s (up to 2.000 dps); nothing in the catalogue" in line.describe(np.array([0.5, -2.0]) * DEG)
    assert_allclose(line.basis(moved), np.stack([np.cos(phase), np.sin(phase)], axis=1), atol=1e-12)
    warm = shapes(session_of_movements(movement(np.nan)), "warm_up")[0]
    assert_allclose(warm.basis(moved), np.exp(-moved.t_s / 40)[:, None])
    assert warm.equation == "ω += b exp(−t / τ), τ = 40 s"
    a, b, c = moved.force_g[0]
    quadratic, cubic = (np.sort(each.basis(moved)[50]) for each in shapes(twin, "attitude"))
    powers = {n: [a**i * b**j * c ** (n - i - j) for i in range(n + 1) for j in range(n + 1 - i)] for n in (2, 3)}
    assert_allclose(quadratic, np.sort(powers[2]))
    assert_allclose(cubic, np.sort(powers[2] + powers[3]))
    (products,), u = shapes(twin, "rate_products"), moved.rate / FS
    pairs = FS * u[:, [0, 0, 1]] * u[:, [1, 2, 2]]
    expected = np.einsum("nk,ij->nikj", pairs, np.eye(3)).reshape(101, 3, 9)
    assert_allclose(products.columns(moved), expected)
    for each, power, odd in zip(shapes(twin, "curve_over_rate"), (1.5, 2, 2, 5), (1, 0, 1, 1), strict=True):
        assert each.equation == f"ω_i += c_i FS {'sign(ω_i) ' * odd}|ω_i / FS|^{power}"
        assert_allclose(each.columns(moved), (FS * np.sign(u) ** odd * np.abs(u) ** power)[:, :, None] * np.eye(3))
        assert each.describe(np.ones(3)).startswith("the scale bends" if odd else "the zero bends")


def test_terms_of_a_curve_are_of_one_variable_and_one_symmetry():
    twin = session_of_movements(movement())
    odd, even, *_ = shapes(twin, "curve_over_rate")
    assert [each.equation[-3:] for each in curves_like(twin, odd)] == ["1.5", "|^2", "|^5"]
    assert [each.equation for each in curves_like(twin, even)] == [even.equation]
    assert len(curves_like(twin, shapes(twin, "curve_over_time")[0])) == 4
    assert curves_like(twin, shapes(twin, "rate_products")[0]) == []


@pytest.mark.parametrize(
    ("true_deg", "share", "said_deg", "latitude"),
    [(36.9, 1.0, 47.0, True), (37.1, 1.0, 47.0, False), (-47.0, 1.0, 47.0, True), (20.0, 1.24, 47.0, True), (20.0, 1.26, 47.0, False),
     (20.0, 0.74, 47.0, False), (20.0, 1.0, None, False)],
)  # fmt: skip
def test_a_rate_fixed_in_the_world_is_the_earths_if_as_long_at_another_latitude(true_deg, share, said_deg, latitude):
    """At least ten degrees from what session.toml says, and as long as the Earth's within a quarter."""
    earth = with_heading(47.0, 30.0)
    (world,) = shapes(session_of_movements(movement(), earth=earth, latitude_deg=said_deg), "world_direction")
    theta = share * with_heading(true_deg, 200.0).rate_t - earth.rate_t
    said = world.describe(theta)
    if latitude:
        assert f"at a latitude of about {true_deg:.0f} deg, session.toml has 47: " in said
    else:
        assert said == f"{np.linalg.norm(theta) / DEG:.4f} dps is fixed in the world beyond the Earth's: does the table turn?"
    assert_array_equal(world.columns(movement()), np.zeros((101, 3, 3)))
