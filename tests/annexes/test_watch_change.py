"""What an alarm is called: a step or a drift where one is twenty times likelier, its moment, its size and its sigma."""

from __future__ import annotations

import numpy as np
import pytest
from watched import chosen

from tinygc.annexes.watch.change import WindowRecord, change_of

COUNT, BEGAN = 40, 25


def records(mean: np.ndarray, sigma: float = 1.0) -> list[WindowRecord]:
    """Windows 2 s apart with these innovations of gravity, in sigmas."""
    none = np.zeros(5)
    return [WindowRecord(2.0 * i, np.array([0.0, 0.0, 0.0, z]), np.array([1.0, sigma]), none, 0.0, True) for i, z in enumerate(mean)]


def gains(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log likelihood ratios (N,) of a step and of a ramp from each moment on, against none."""
    step, ramp = [], []
    for moment in range(len(z)):
        for found, form in ((step, np.ones(len(z) - moment)), (ramp, 2.0 * np.arange(len(z) - moment))):
            found.append((z[moment:] @ form) ** 2 / 2 / max(form @ form, 1e-12))
    return np.array(step), np.array(ramp)


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


def test_a_step_has_its_moment_its_size_and_the_sigma_of_a_mean():
    """Of 15 windows, each of which errs by half a unit."""
    found = change_of(records(3 * shape("step") / 0.5, sigma=0.5), 3, COUNT - 1 - BEGAN, chosen())
    assert (found.kind, found.began_s, found.earlier) == ("step", 2.0 * (BEGAN - 1), False)
    assert (found.size, found.sigma) == pytest.approx((3.0, 0.5 / np.sqrt(COUNT - BEGAN)))


def test_a_ramp_has_its_growth_until_now():
    """By 0.3 a window: what it has come to by the last one."""
    found = change_of(records(0.3 * shape("ramp")), 3, COUNT - 1 - BEGAN, chosen())
    t_s = 2.0 * np.arange(COUNT - BEGAN)
    assert (found.kind, found.began_s) == ("ramp", 2.0 * (BEGAN - 1))
    assert found.size == pytest.approx(0.3 * (COUNT - 1 - BEGAN))
    assert found.sigma == pytest.approx(t_s[-1] / np.sqrt(t_s @ t_s))
