"""An array live: noise as predicted, and a vote that finds who is wrong, and nobody else."""

import numpy as np
import pytest
from array_faults import FAULTS, with_fault
from simulated_array import DEG, DENSITY, measured, model_of, motion, units

from tinygc import CalibrationError
from tinygc.annexes.arrays.voting import LiveArray

BEGIN, END, COUNT = 1500, 3000, 4200


@pytest.fixture(scope="module")
def eight():
    model = model_of(units(8, density=np.linspace(1, 2, 8) * DENSITY))
    omega = motion(COUNT, seed=7)
    return model, omega, measured(model, omega)


def outs(fused) -> set:
    return {event.unit for event in fused.events if event.what == "out"}


def test_nobody_is_voted_out_where_nobody_lies(eight):
    model, omega, raw = eight
    fused = LiveArray(model)(raw)
    assert fused.events == ()
    assert fused.used.all()
    off = (fused.rate - omega) / fused.sigma
    assert 0.95 < off.std() < 1.05


@pytest.mark.parametrize("name", [name if name == "step" else pytest.param(name, marks=pytest.mark.broad) for name in FAULTS])
def test_each_fault_is_voted_out_said_and_forgiven(eight, name):
    model, omega, raw = eight
    live = LiveArray(model)
    fused = live(with_fault(raw, 3, name, BEGIN, END))
    first = fused.events[0]
    assert outs(fused) == {3}
    assert BEGIN <= first.sample < END
    if name in ("dead", "stuck"):
        assert {"dead": "no samples", "stuck": "same reading"}[name] in first.reason
    else:
        assert first.size_rps > first.bar_rps > 0
    assert live.out == {}  # it agrees again, and is back
    assert np.abs(fused.rate - omega).max() < 6 * fused.sigma.max() + 0.2 * DEG
    without = LiveArray(model, vote=False)(with_fault(raw, 3, name, BEGIN, END))
    if name != "dead":
        assert np.abs(without.rate - omega).max() > 2 * np.abs(fused.rate - omega).max()


def test_another_shape_is_refused():
    with pytest.raises(CalibrationError, match=r"raw has shape \(3, 3\), expected \(2, 3\)"):
        LiveArray(model_of(units(2)))(np.zeros((3, 3)))
