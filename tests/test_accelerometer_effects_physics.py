"""Effects of the accelerometer: equations by hand, undone exactly, seen beside nine numbers of the same stills."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import GRAVITY
from known_effects import measured_force, movement

from session.base.units import MG, G
from session.detect.accelerometer import IDENTITY, corrected, fit_lengths, length_columns
from tinygc.effects import Movement, catalogue
from tinygc.estimation.accelerometer import of_lengths
from tinygc.noise.twin import Twin

FORCE = np.array([0.5, -0.8, 0.3])  #: g


#: one of each number (1, 2, 3, …) in its unit, at 250 s of 1000 s and 5 degC above the first temperature; mg that it adds to x, y, z
BY_HAND = {
    "accelerometer.zero_drift": [-0.25, -0.5, -0.75],
    "accelerometer.thermal_zero": [5, 10, 15],
    "accelerometer.thermal_scale": [5 * 0.5e-3, 10 * -0.8e-3, 15 * 0.3e-3],
    "accelerometer.scale_asymmetry": [0.5e-3, 2 * 0.8e-3, 3 * 0.3e-3],
    "accelerometer.nonlinearity": [0.25, 2 * 0.64, 3 * 0.09],
    # x with y and z, y with z and x, z with x and y
    "accelerometer.cross_coupling": [0.5 * (-0.8 + 2 * 0.3), -0.8 * (3 * 0.3 + 4 * 0.5), 0.3 * (5 * 0.5 + 6 * -0.8)],
}


def at_rest(up, t_s, duration_s):
    count = np.zeros(len(up))
    return Movement(t_s, 1.0, np.zeros_like(up), up, 25 + t_s / 50, count, duration_s, 1.0, 25.0)


def attitudes(count, rng):
    up = rng.normal(size=(count, 3))
    return up / np.linalg.norm(up, axis=1, keepdims=True)


@pytest.mark.parametrize("name", BY_HAND)
def test_each_adds_what_its_equation_says(name):
    effect = catalogue()[name]
    moved = at_rest(FORCE[None], np.array([250.0]), 1000.0)
    theta = np.arange(1, effect.parameter.size + 1) * effect.parameter.si
    np.testing.assert_allclose((effect.bent(moved) @ theta)[0] / MG, BY_HAND[name], rtol=1e-12)


@pytest.mark.parametrize("name", [*BY_HAND, "reference.accelerometer"])
def test_what_it_adds_is_said_of_what_is_measured(name):
    effect, moved = catalogue()[name], movement()
    for form in effect.variants(np.zeros(0)):
        theta = 0.3 * form.parameter.plausible * np.random.default_rng(1).normal(size=form.parameter.size)
        measured = measured_force(form, moved, theta)
        assert np.abs(measured - moved.force_g).max() > 1e-4
        added = form.bent(replace(moved, force_g=measured)) @ theta / G
        np.testing.assert_allclose(measured - added, moved.force_g, atol=1e-11)


def test_nine_numbers_of_the_same_stills_take_up_a_part_of_an_effect():
    """What is left in the lengths after the nine were fitted is what the twin says of the effect, to first order."""
    rng = np.random.default_rng(3)
    up, t_s = attitudes(24, rng), np.linspace(20, 980, 24)
    for name in BY_HAND:
        effect = catalogue()[name]
        theta = 1e-2 * effect.parameter.plausible * rng.normal(size=effect.parameter.size)
        force = G * measured_force(effect, at_rest(up, t_s, 1000.0), theta)
        x = IDENTITY.copy()
        for _ in range(5):
            x = x - np.linalg.lstsq(length_columns(x, force), np.linalg.norm(corrected(x, force), axis=1) - G, rcond=None)[0]
        now = corrected(x, force)
        twin = SimpleNamespace(own_accelerometer=True, force=now, rests=at_rest(now / G, t_s, 1000.0), problem=SimpleNamespace(joint=None))
        twin._taken_up = lambda effect, twin=twin: Twin._taken_up(twin, effect)
        twin.segments, twin.batch, twin._known_taken_up = [], SimpleNamespace(angles=2), {}
        left = np.linalg.norm(now, axis=1) - G
        says = np.einsum("qi,qi->q", up, Twin.bent(twin, effect, twin.rests) @ theta)
        np.testing.assert_allclose(says, left, atol=0.02 * np.abs(left).max())
        twin.own_accelerometer = False
        np.testing.assert_array_equal(Twin.bent(twin, effect, twin.rests), effect.bent(twin.rests))


def test_a_fit_states_the_drift_in_mg_per_1000_s():
    rng = np.random.default_rng(1)
    up, t_s = attitudes(24, rng), 30.0 * (np.arange(24) + 0.5)
    force = GRAVITY * up + (t_s / 720 - 0.5)[:, None] * [0.04, -0.03, 0.05] + 0.1 * MG * rng.normal(size=up.shape)
    found = fit_lengths(force, GRAVITY, middle_s=t_s, duration_s=720.0)
    said, per_1000s = of_lengths(found).to_json()["zero_drift"], 1000 / 720 / MG
    np.testing.assert_allclose(said["mg_per_1000s"], found.drift.mps2 * per_1000s)
    np.testing.assert_allclose(said["sigma"], found.drift.sigma_mps2 * per_1000s)
    assert (said["significant"], said["p_value"]) == (True, found.drift.p_value)
