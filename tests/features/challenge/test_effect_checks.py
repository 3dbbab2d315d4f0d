"""The proof of an effect: each of the catalogue passes it, and one that is broken in one way fails that part of it and no other."""

from dataclasses import replace

import numpy as np
import pytest

from tinygc.effects import Conditions, EffectError, Parameter, ReferenceConditions, StageC, catalogue, diagonal
from tinygc.effects.testing import check

PARTS = ("columns", "inverse", "recover", "units", "picture", "live", "c")
RATE = sorted(name for name, effect in catalogue().items() if effect.kind == "rate")
DRIFT, ASYMMETRY = catalogue()["gyro.bias_drift"], catalogue()["gyro.scale_asymmetry"]


@pytest.mark.parametrize("name", RATE)
def test_columns_undo_and_units_of_each_effect_of_the_rate(name):
    report = check(catalogue()[name], parts=("columns", "inverse", "units"))
    assert report.ok, str(report)


@pytest.mark.slow
@pytest.mark.parametrize("name", RATE)
def test_the_effects_of_the_rate_pass(name):
    """Before one is added: ``-k`` and its name."""
    report = check(catalogue()[name])
    assert report.ok, str(report)
    assert tuple(part.name for part in report.parts) == PARTS
    unchecked = {part.name for part in report.parts if part.result == "not checked"}
    assert unchecked == ({"recover", "picture"} if name == "gyro.vibration_rectification" else set())


def test_of_the_others_words_and_units_are_proved_and_the_rest_is_said_not_to_be():
    for name in sorted(set(catalogue()) - set(RATE)):
        report = check(catalogue()[name])
        assert report.ok, str(report)
        assert {part.name for part in report.parts if part.result == "not checked"} == set(PARTS) - {"units", "c"}
        assert report["recover"].text == f"not proven: of kind {catalogue()[name].kind}, and only an effect of the rate is tried"
        assert report["c"].text.startswith("none: ")


def _previous(movement):
    """(N, 3) size of the rate one sample ago."""
    return np.abs(np.concatenate([movement.rate[:1], movement.rate[:-1]]))


def _ahead(movement):
    return diagonal(np.abs(np.concatenate([movement.rate[1:], movement.rate[-1:]])))


def _partly(share):
    return lambda measured, m, theta: measured - share * (DRIFT.distort(m.with_rate(measured), theta) - measured)


def _other_c(device):
    """Its C with the opposite sign, and the NumPy that belongs to it."""
    stage = device.stage(np.ones(3), Conditions(1.0, 1.0, 25.0))
    body = stage.body.replace("w = r[i] -", "w = r[i] +")
    return StageC(stage.formula, body, lambda theta, known: {device.name: theta}, stage.numpy)


STEP, DEVICE = catalogue()["gyro.bias_step"], ASYMMETRY.device
#: part -> effect that is broken in it, and what the part says
BROKEN = [
    ("columns", replace(DRIFT, basis=None, columns=lambda m: 1e-12 * diagonal(np.ones(len(m.rate)))), "parameter 0 changes nothing"),
    ("columns", replace(ASYMMETRY, columns=lambda m: 1.01 * ASYMMETRY.columns(m), exact_distort=ASYMMETRY.distort), ""),
    ("inverse", replace(DRIFT, exact_correct=_partly(0.99)), ""),
    ("units", replace(DRIFT, parameter=Parameter("dps_over_log", (3,), "dps", 1.0, plausible=DRIFT.parameter.plausible)), ""),
    ("units", replace(DRIFT, describe=lambda theta: "a sentence without one"), "expected one sentence with a number"),
    ("units", replace(DRIFT, parameter=replace(DRIFT.parameter, name="theta_si")), "its model file gives"),
    ("units", replace(DRIFT, parameter=replace(DRIFT.parameter, unit="ppm", si=1.0)), "unit 'ppm' is 1e-06 in SI, and si is 1"),
    ("units", replace(STEP, scan=replace(STEP.scan, name="dps")), "its model file gives"),
    ("live", replace(ASYMMETRY, columns=lambda m: diagonal(_previous(m)), device=DRIFT.device), ""),
    ("live", replace(ASYMMETRY, columns=_ahead, device=DRIFT.device), "does reach cover all that it reads?"),
    ("c", replace(ASYMMETRY, device=replace(DEVICE, numpy=lambda c, w, inputs: -DEVICE.numpy(c, w, inputs))), "differs from correct"),
    ("c", replace(ASYMMETRY, device=_other_c(DEVICE)), "its C differs from its NumPy"),
]


@pytest.mark.parametrize(("part", "effect", "says"), BROKEN)
def test_a_broken_effect_fails_its_part(part, effect, says):
    report = check(effect, parts=(part,))
    assert report.failed == (part,)
    assert says in report[part].text
    with pytest.raises(AssertionError, match=f"{part} +failed"):
        report.require()


@pytest.mark.broad
def test_a_bias_of_the_fit_fails():
    """What is undone by three quarters alone is found a third too large."""
    (part,) = check(replace(DRIFT, exact_correct=_partly(0.75)), parts=("recover",)).parts
    assert part.result == "failed"
    assert "more than the stated sigmas" in part.text


def test_what_no_simulated_session_has_is_said_not_to_be_proven():
    """What follows the size of the force is seen: a hand adds to gravity, so that the specific force is not always 1 g long."""
    fast = replace(DRIFT, reference_conditions=ReferenceConditions(fs_rps=30.0))
    (part,) = check(fast, parts=("recover",)).parts
    assert part.result == "not checked"
    assert part.text.startswith("not proven: no session is simulated for vibration")
    sized = replace(catalogue()["gyro.g2_sensitivity"], columns=lambda m: diagonal(np.linalg.norm(m.force_g, axis=1) - 1))
    assert check(sized, parts=("columns", "inverse")).ok


def test_what_is_no_effect_or_no_part_is_refused_and_a_report_is_read_by_name():
    for effect, how, says in (
        (3, {}, "expected tinygc"),
        (DRIFT, {"parts": ("colums",)}, "'colums' is no part of a check; choose among columns, inverse"),
        (DRIFT, {"parts": ("units",), "size": 0.0}, "size is 0.0, expected more than 0"),
        (DRIFT, {"parts": ("units",), "size": float("nan")}, "size is nan, expected more than 0"),
        (replace(catalogue()["gyro.thermal_bias"], inputs=()), {}, "reads movement.temp_c, which it does not declare"),
    ):
        with pytest.raises(EffectError, match=says) as caught:
            check(effect, **how)
        assert "\n" not in str(caught.value)
    report = check(ASYMMETRY, parts=("columns", "units"))
    assert report.require() is report
    assert report["units"].text.startswith("unit 'fraction' is 1 SI")
    assert [line.split()[0] for line in str(report).splitlines()] == ["gyro.scale_asymmetry", "columns", "units"]
