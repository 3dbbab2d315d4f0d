"""An array live: noise as predicted, and a vote that finds who is wrong, and nobody else."""

import numpy as np
import pytest
from array_faults import FAULTS, with_fault
from simulated_array import DEG, DENSITY, RATE_HZ, measured, model_of, motion, units

from tinygc import CalibrationError
from tinygc.annexes.arrays.model import best_weights
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


def test_weights_are_shared_out_among_those_that_are_left(eight):
    """Exactly the best combination of the seven others, where noise is independent."""
    model, _, raw = eight
    wrong = with_fault(raw, 3, "dead", 0, COUNT)
    live = LiveArray(model)
    fused = live(wrong)
    left = [i for i in range(8) if i != 3]
    white = model.density.reshape(8, 3, 8, 3)[np.ix_(left, range(3), left, range(3))].reshape(21, 21)
    weights, covariance = best_weights(white)
    units_rate = np.einsum("nij,tnj->tni", model.matrices, raw) + model.offsets
    np.testing.assert_allclose(fused.rate, np.einsum("nij,tnj->ti", weights, units_rate[:, left]), atol=1e-12)
    expected = np.sqrt(np.diag(covariance) * RATE_HZ / 2 + model.parameter_sigma() ** 2)
    np.testing.assert_allclose(fused.sigma, np.tile(expected, (COUNT, 1)), rtol=1e-9)
    assert live.out == {3: "gives no samples"}


@pytest.mark.broad
def test_two_liars_of_eight_are_both_found(eight):
    model, omega, raw = eight
    raw = with_fault(with_fault(raw, 2, "step", BEGIN, END), 6, "scale", BEGIN - 300, END)
    fused = LiveArray(model)(raw)
    assert outs(fused) == {2, 6}
    assert np.abs(fused.rate - omega).max() < 1.0 * DEG


@pytest.mark.broad
def test_what_reads_its_end_is_neither_believed_nor_blamed():
    """Units of another range on one body: those that clip say nothing, the others carry the rate."""
    small, large = units(6, full_scale=125), units(6, full_scale=2000)
    model = model_of(small[:3] + large[3:])
    omega = motion(COUNT, top_dps=400)
    raw = measured(model, omega)
    raw[:, :3] = np.clip(raw[:, :3], -125 * DEG, 125 * DEG)
    fused = LiveArray(model)(raw)
    assert outs(fused) == set()
    assert np.abs(fused.rate - omega).max() < 7 * fused.sigma.max()
    assert (~fused.used[:, :3]).mean() > 0.2
    all_clip = LiveArray(model_of(small))(np.clip(raw, -125 * DEG, 125 * DEG)[:, :6])
    assert outs(all_clip) == set()
    ends = np.isinf(all_clip.sigma).any(axis=1)
    assert ends.any()
    assert np.isfinite(all_clip.rate[ends]).all()


def test_another_shape_is_refused():
    with pytest.raises(CalibrationError, match=r"raw has shape \(3, 3\), expected \(2, 3\)"):
        LiveArray(model_of(units(2)))(np.zeros((3, 3)))
