"""What an alarm is called: a step or a drift where one is twenty times likelier, its moment, its size and its sigma."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from watched import chosen, reading

from tinygc.annexes.watch.change import Change, WindowRecord, _response, change_of
from tinygc.annexes.watch.detector import ZeroFilter

COUNT, BEGAN = 40, 25


def records(mean: np.ndarray, sigma: float = 1.0) -> list[WindowRecord]:
    """Windows 2 s apart with these innovations of gravity, in sigmas."""
    none = np.zeros(5)
    return [WindowRecord(2.0 * i, np.array([0.0, 0.0, 0.0, z]), np.array([1.0, sigma]), none, 0.0, True) for i, z in enumerate(mean)]


def forms_of(count: int, ramp: bool, places: int = 200) -> np.ndarray:
    """(K, N) of a change of size one now that begins at any of so many places of each window."""
    since = np.arange(count) - np.arange(0, count - 1e-9, 1 / places)[:, None]
    return np.maximum(since, 0) / np.maximum(since[:, -1:], 1e-9) if ramp else np.clip(since + 1, 0, 1)


def gains(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log likelihood ratios (K,) of a step and of a ramp from each moment on, against none."""
    step, ramp = (
        (forms @ z) ** 2 / 2 / np.maximum(np.sum(forms**2, axis=1), 1e-12) for forms in (forms_of(len(z), ramp) for ramp in (False, True))
    )
    return step, ramp


def shape(name: str) -> np.ndarray:
    after = np.maximum(np.arange(COUNT) - BEGAN, -1.0)
    return np.where(after >= 0, 1.0 if name == "step" else after, 0.0)


@pytest.mark.parametrize("name", ["step", "ramp"])
def test_a_form_is_said_where_it_is_twenty_times_likelier(name):
    step, ramp = gains(shape(name))
    apart = abs(step.max() - ramp.max())
    for odds, said in ((19.0, "step or ramp"), (21.0, name)):
        z = shape(name) * np.sqrt(np.log(odds) / apart)
        assert change_of(records(z), 3, COUNT - 1 - BEGAN, chosen()).kind == said


def integrated(z: np.ndarray, forms: tuple[bool, ...], best: float) -> tuple[float, float]:
    """Mean and sigma of the size now, by direct integration over sizes, moments and forms (a ramp or none), with a normal prior of the
    size, three times the best one wide."""
    size = np.linspace(-12, 12, 4001) * best
    density = np.zeros(len(size))
    for ramp in forms:
        for form in forms_of(len(z), ramp, 20):
            left = z[:, None] - form[:, None] * size
            density += np.exp(-np.sum(left**2, axis=0) / 2 - (size / best / 3) ** 2 / 2)
    mean = np.sum(density * size) / density.sum()
    return float(mean), float(np.sqrt(np.sum(density * (size - mean) ** 2) / density.sum()))


@pytest.mark.parametrize(
    ("name", "sigmas", "kind", "forms"),
    [("step", 12.0, "step", (False,)), ("ramp", 12.0, "ramp", (True,)), ("ramp", 4.5, "step or ramp", (False, True))],
)
def test_a_size_is_the_mean_over_its_moments_and_over_forms_that_are_not_told_apart(name, sigmas, kind, forms):
    z = sigmas * shape(name) / np.linalg.norm(shape(name)) + 0.3 * np.random.default_rng(2).normal(size=COUNT)
    found = change_of(records(z / 1.0), 3, COUNT - 1 - BEGAN, chosen())
    assert found.kind == kind
    step, ramp = gains(z)
    form = forms_of(COUNT, bool(ramp.max() > step.max()))[np.argmax(max(step, ramp, key=np.max))]
    best = abs(z @ form / (form @ form))
    assert (found.size, found.sigma) == pytest.approx(integrated(z, forms, best), rel=1e-3)


def test_a_large_step_has_its_moment_its_size_and_the_sigma_of_a_mean():
    """Of 14 whole windows and a part of one, each of which errs by half a unit."""
    found = change_of(records(3 * shape("step") / 0.5, sigma=0.5), 3, COUNT - 1 - BEGAN, chosen())
    assert (found.kind, found.began_s, found.earlier) == ("step", pytest.approx(2.0 * (BEGAN - 1)), False)
    assert found.size == pytest.approx(3.0, abs=0.05)
    assert 0.5 / np.sqrt(COUNT - BEGAN) < found.sigma < 0.5 / np.sqrt(COUNT - BEGAN - 1)
    assert (found.size / 0.5, found.sigma / 0.5) == pytest.approx(integrated(6 * shape("step"), (False,), 6.0), rel=2e-3)


def test_a_ramp_has_its_growth_until_now():
    """By 3 a window, each of which errs by one: what it has come to by the last one."""
    found = change_of(records(3 * shape("ramp")), 3, COUNT - 1 - BEGAN, chosen())
    assert (found.kind, found.began_s) == ("ramp", pytest.approx(2.0 * (BEGAN - 1)))
    grown = 3.0 * (COUNT - 1 - BEGAN)
    assert found.size == pytest.approx(grown, abs=0.05)
    assert (found.size, found.sigma) == pytest.approx(integrated(3 * shape("ramp"), (True,), grown), rel=3e-3)


@pytest.mark.parametrize(("part", "last"), [(0.5, 2), (0.1, 2), (0.7, 3), (0.95, 2)])
def test_a_large_step_amid_a_window_is_no_drift_and_has_its_size(part, last):
    """An alarm of two windows, the first of which the step moves by a part: a drift from before it would move them so, too."""
    mean = np.r_[np.zeros(COUNT - last), part, np.ones(last - 1)]
    found = change_of(records(300 * mean), 3, last, chosen())
    assert found.kind == ("step or ramp" if (part, last) in ((0.5, 2), (0.1, 2)) else "step")
    assert found.size == pytest.approx(300, abs=2)
    assert 0.5 < found.sigma < 1.5


@pytest.mark.parametrize("ramp", [False, True])
def test_the_response_is_what_the_filter_makes_of_a_change(ramp):
    """Of one unit, or one a second, from the 20th window on, with wander and temperature; the 25th window is not followed."""
    c = dataclasses.replace(chosen(1e9), walk=0.01, drive=np.array([0.2, 0.05]), per_k=1.0)
    filters, rows = ZeroFilter(c), []
    for number in range(COUNT):
        value = max(number - 20, -1) * 2e-3 if ramp else 1e-3  # so small that nothing clips
        filters.predict()
        before = filters.x, filters.P
        window = reading(np.array([[value * (number >= 20)], [0.0], [0.0]]), warmer=np.sin(number))
        judged = filters.judge(window)
        if number == 25:
            filters.x, filters.P = before
            judged = dataclasses.replace(judged, taken=np.array([False]))
        rows.append(WindowRecord.of(2.0 * number, window, judged))
    found = _response(rows, np.array([20]), ramp, 0, c)[:, 0]
    assert found == pytest.approx(1e3 * np.array([row.z[0] for row in rows]), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("began", [48, 49])
def test_a_change_is_looked_for_30_windows_before_the_tests_own_beginning(began):
    found = change_of(records(np.where(np.arange(100) >= began, 5.0, 0.0)), 3, 20, chosen())
    assert (found.kind, found.began_s, found.earlier) == ("step", 2.0 * 48, False)


def test_a_change_may_be_earlier_than_what_is_remembered():
    found = change_of(records(np.full(COUNT, 5.0)), 3, COUNT - 1, chosen())
    assert (found.began_s, found.earlier) == (0.0, True)
    assert not change_of(records(np.full(1, 5.0)), 3, 0, chosen()).earlier


def test_a_size_is_in_the_unit_of_its_sigma():
    z = 3 * shape("step") + 0.3 * np.random.default_rng(2).normal(size=COUNT)
    whole, small = (change_of(records(z, sigma), 3, COUNT - 1 - BEGAN, chosen()) for sigma in (1.0, 1e-3))
    assert (small.size, small.sigma) == pytest.approx((1e-3 * whole.size, 1e-3 * whole.sigma))
    assert change_of(records(np.zeros(COUNT)), 3, 10, chosen()).size == 0.0


@pytest.mark.parametrize(
    ("kind", "earlier", "said"),
    [
        ("step", False, "a step of 5 dps at 12 s"),
        ("ramp", True, "a drift since 12 s or earlier, by 5 dps so far"),
        ("step or ramp", False, "a change of 5 dps since 12 s, a step or a drift"),
    ],
)
def test_a_change_in_words(kind, earlier, said):
    assert Change(kind, 12.3, earlier, 5.0, 1.0).words("5 dps") == said
