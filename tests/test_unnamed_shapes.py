"""Shapes without a name: each is the function that its equation states, and is tried on the recordings that can show it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG

from tinygc.attitude.earth import no_earth, with_heading
from tinygc.effects import Movement
from tinygc.explanation.search import curves_like, line_frequencies, lines_end_hz, slow_candidates, unknown_candidates

FS = 500 * DEG
NOWHERE = no_earth()


def movement(temp_c=25.0, began_s=0.0, seconds=200.0, force=(0.6, -0.48, 0.64)) -> Movement:
    t_s = began_s + np.linspace(0, 100, 101)
    rate = FS * np.column_stack([np.linspace(-0.9, 0.9, 101), np.full(101, 0.5), np.linspace(0.2, -0.4, 101)])
    return Movement(t_s, 1.0, rate, np.tile(force, (101, 1)), np.full(101, temp_c), np.zeros(101), seconds, FS, 25.0)


def twin_of(*movements, stills=10, earth=NOWHERE, latitude_deg=47.0):
    site = SimpleNamespace(latitude_deg=latitude_deg)
    problem = SimpleNamespace(earth=earth, session=SimpleNamespace(config=SimpleNamespace(site=site)))
    axes = [np.full((101, 6), float(number + 1)) for number in range(len(movements))]
    return SimpleNamespace(movements=list(movements), stills=[None] * stills, problem=problem, level_axes=axes)


def shapes(twin, name):
    return [each for each in slow_candidates(twin) if each.id == f"unknown.{name}"]


def test_which_shapes_are_tried_with_how_many_numbers():
    twin = twin_of(movement(20.0), movement(30.0), earth=with_heading(47.0, 20.0))
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
        bare = [each.id for each in slow_candidates(twin_of(*map(movement, logs)))]
        assert bare.count("unknown.warm_up") == 10
        assert not {"unknown.curve_over_temperature", "unknown.world_direction"} & set(bare)  # the catalogue has the Earth's rate
    for change, tried in ((0.49, 0), (0.51, 4)):
        assert len(shapes(twin_of(movement(25.0), movement(25.0 + change)), "curve_over_temperature")) == tried


def test_slow_lines_and_warm_ups_span_the_session():
    """From its length to a little over twice the time between stills: twenty seconds, and at least half of it."""
    twin = twin_of(movement(np.nan))
    hz = [each.shape["frequency_hz"] for each in shapes(twin, "periodic")]
    seconds = [each.shape["time_constant_s"] for each in shapes(twin, "warm_up")]
    np.testing.assert_allclose(hz, 1 / np.geomspace(200.0, 44.0, 40))
    np.testing.assert_allclose(seconds, np.geomspace(40.0, 200.0, 10))
    for stills in (1, 2):
        few = shapes(twin_of(movement(np.nan), stills=stills), "periodic")
        assert few[-1].shape["frequency_hz"] == pytest.approx(1 / 220)


def test_fast_lines_begin_where_stills_alias_them_and_a_long_session_has_the_slowest():
    twin = twin_of(movement())
    hz = line_frequencies(twin)
    np.testing.assert_allclose(hz, np.arange(0.025, 3.0, 0.005))
    assert lines_end_hz(twin) is None
    lines = [each for each in unknown_candidates(twin) if each.id == "unknown.periodic"]
    np.testing.assert_allclose([each.shape["frequency_hz"] for each in lines[40:]], hz)
    for rows, count in ((400_000_000, 5), (666_666_667, 2), (4_000_000_000, 1)):
        long = SimpleNamespace(t_s=range(rows), duration_s=200.0)
        twin = SimpleNamespace(movements=[long], stills=[None] * 10)
        np.testing.assert_allclose(line_frequencies(twin), hz[:count])
        assert lines_end_hz(twin) == pytest.approx(hz[count - 1])
    for rows, end in ((int(2e9 / 595.5), None), (int(2e9 / 594.5), hz[593])):  # the last but one line is too short by one
        twin = SimpleNamespace(movements=[SimpleNamespace(t_s=range(rows), duration_s=200.0)], stills=[None] * 10)
        assert lines_end_hz(twin) == end


def test_each_shape_is_what_its_equation_says():
    moved = movement(22.0, began_s=50.0)
    twin = twin_of(movement(20.0), movement(30.0))
    x = 2 * moved.t_s / 200 - 1
    for order, curve in zip((2, 3, 4, 5), shapes(twin, "curve_over_time"), strict=True):
        expected = np.stack([np.polynomial.legendre.Legendre.basis(n)(x) for n in range(1, order + 1)], axis=1)
        np.testing.assert_allclose(curve.basis(moved), expected, atol=1e-12)
        assert curve.equation == f"ω += smooth curve of time, Legendre order {order}"
    curve = shapes(twin, "curve_over_temperature")[0]
    np.testing.assert_allclose(curve.basis(moved), np.tile([-0.6, (3 * 0.36 - 1) / 2], (101, 1)))
    np.testing.assert_allclose(curve.basis(movement(40.0)), 1.0)  # beyond what the session had
    line = shapes(twin, "periodic")[0]
    assert line.equation == "ω += a cos(2π f t) + b sin(2π f t), f = 0.0050 Hz"
    assert line.describe(np.array([0.5, -2.0]) * DEG) == (
        "the zero-rate offset oscillates with a period of 200.0 s (up to 2.000 dps); nothing in the catalogue does this"
    )
    np.testing.assert_allclose(
        line.basis(moved), np.stack([np.cos(np.pi * moved.t_s / 100), np.sin(np.pi * moved.t_s / 100)], axis=1), atol=1e-12
    )
    warm = shapes(twin_of(movement(np.nan)), "warm_up")[0]
    np.testing.assert_allclose(warm.basis(moved), np.exp(-moved.t_s / 40)[:, None])
    assert warm.equation == "ω += b exp(−t / τ), τ = 40 s"
    a, b, c = moved.force_g[0]
    quadratic, cubic = (each.basis(moved) for each in shapes(twin, "attitude"))
    squares = [a * a, a * b, a * c, b * b, b * c, c * c]
    np.testing.assert_allclose(np.sort(quadratic[50]), np.sort(squares))
    cubes = [a**i * b**j * c**k for i in range(4) for j in range(4) for k in range(4) if i + j + k == 3]
    np.testing.assert_allclose(np.sort(cubic[50]), np.sort(squares + cubes))
    (products,) = shapes(twin, "rate_products")
    u = moved.rate / FS
    columns = products.columns(moved)
    for number, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        for axis in range(3):
            expected = np.zeros((101, 3))
            expected[:, axis] = FS * u[:, i] * u[:, j]
            np.testing.assert_allclose(columns[:, :, 3 * number + axis], expected)
    laws = {
        "sign(ω_i) |ω_i / FS|^1.5": (1.5, 1),
        "|ω_i / FS|^2": (2, 0),
        "sign(ω_i) |ω_i / FS|^2": (2, 1),
        "sign(ω_i) |ω_i / FS|^5": (5, 1),
    }
    curves = shapes(twin, "curve_over_rate")
    assert [each.equation for each in curves] == [f"ω_i += c_i FS {law}" for law in laws]
    for each, (power, odd) in zip(curves, laws.values(), strict=True):
        expected = FS * np.sign(u) ** odd * np.abs(u) ** power
        np.testing.assert_allclose(np.einsum("nii->ni", each.columns(moved)), expected)
        assert np.count_nonzero(each.columns(moved)) == np.count_nonzero(expected)
        assert each.describe(np.ones(3)).startswith("the scale bends" if odd else "the zero bends")


def test_an_attitude_reads_no_farther_than_it_states():
    """A changed force at one sample changes the columns up to the stated reach on either side, or three samples less."""
    (quadratic, _) = shapes(twin_of(movement()), "attitude")
    force = np.tile((0.6, -0.48, 0.64), (301, 1))
    slow = Movement(np.arange(301) / 1e3, 1e-3, np.zeros((301, 3)), force, np.full(301, 25.0), np.zeros(301), 0.3, FS, 25.0)
    other = replace(slow, force_g=force + (np.arange(301) == 150)[:, None])
    changed = np.flatnonzero(np.abs(quadratic.basis(other) - quadratic.basis(slow)).max(axis=1) > 1e-9)
    before, after = quadratic.reach.rows(1e3)
    assert after - 3 <= 150 - changed[0] <= after
    assert before - 3 <= changed[-1] - 150 <= before


def test_a_field_fixed_in_the_world_is_that_of_the_log():
    first, second = movement(), movement(began_s=100.0)
    (field,) = shapes(twin_of(first, second), "world_field")
    assert (field.basis(first) == 1.0).all()
    assert (field.basis(second) == 2.0).all()


def test_terms_of_a_curve_are_of_one_variable_and_one_symmetry():
    twin = twin_of(movement())
    odd, even = shapes(twin, "curve_over_rate")[0], shapes(twin, "curve_over_rate")[1]
    assert [each.equation[-3:] for each in curves_like(twin, odd)] == ["1.5", "|^2", "|^5"]
    assert [each.equation for each in curves_like(twin, even)] == [even.equation]
    assert len(curves_like(twin, shapes(twin, "curve_over_time")[0])) == 4
    assert curves_like(twin, shapes(twin, "rate_products")[0]) == []


@pytest.mark.parametrize(
    ("true_deg", "share", "said_deg", "latitude"),
    [(36.9, 1.0, 47.0, True), (37.1, 1.0, 47.0, False), (57.1, 1.0, 47.0, True), (-47.0, 1.0, 47.0, True),
     (20.0, 1.24, 47.0, True), (20.0, 1.26, 47.0, False), (20.0, 0.76, 47.0, True), (20.0, 0.74, 47.0, False), (20.0, 1.0, None, False)],
)  # fmt: skip
def test_a_rate_fixed_in_the_world_is_the_earths_if_as_long_at_another_latitude(true_deg, share, said_deg, latitude):
    """At least ten degrees from what session.toml says, and as long as the Earth's within a quarter."""
    earth = with_heading(47.0, 30.0)
    (world,) = shapes(twin_of(movement(), earth=earth, latitude_deg=said_deg), "world_direction")
    theta = share * with_heading(true_deg, 200.0).rate_t - earth.rate_t
    said = world.describe(theta)
    if latitude:
        assert f"at a latitude of about {true_deg:.0f} deg, session.toml says 47: " in said
    else:
        assert said == f"{np.linalg.norm(theta) / DEG:.4f} dps is fixed in the world beyond the Earth's: does the table turn?"
    np.testing.assert_array_equal(world.columns(movement()), np.zeros((101, 3, 3)))
