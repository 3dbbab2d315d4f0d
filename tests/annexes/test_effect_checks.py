"""The proof of an effect: each of the catalogue passes it, and one that is broken in one way fails that part of it and no other."""

from dataclasses import replace

import numpy as np
import pytest

from tinygc import CalibrationError
from tinygc.annexes.challenge import proofs
from tinygc.deploy.calibration import Calibration
from tinygc.effects import Cost, EffectError, Parameter, ReferenceConditions, StageC, catalogue, diagonal
from tinygc.effects.testing import check

pytestmark = pytest.mark.broad

PARTS = ("columns", "undo", "recover", "units", "picture", "live", "c")
RATE = sorted(name for name, effect in catalogue().items() if effect.kind == "rate")
#: a term of C, a moment that is scanned; the others are proved at night
BY_DAY = {"gyro.scale_asymmetry": pytest.mark.broad, "gyro.bias_step": pytest.mark.broad}
DRIFT, ASYMMETRY = catalogue()["gyro.bias_drift"], catalogue()["gyro.scale_asymmetry"]


def by_night(names, by_day) -> list:
    """Parameters, of which all but some are slow."""
    return [pytest.param(name, marks=by_day.get(name, pytest.mark.slow)) for name in names]


def unchecked(report) -> set[str]:
    return {part.name for part in report.parts if part.result == "not checked"}


@pytest.mark.parametrize("name", by_night(RATE, BY_DAY))
def test_the_effects_of_the_rate_pass(name):
    report = check(catalogue()[name])
    assert report.ok, str(report)
    assert tuple(part.name for part in report.parts) == PARTS
    assert unchecked(report) == ({"recover", "picture"} if name == "gyro.vibration_rectification" else set())


@pytest.mark.parametrize("name", sorted(set(catalogue()) - set(RATE)))
def test_of_the_others_words_and_units_are_proved_and_the_rest_is_said_not_to_be(name):
    report = check(catalogue()[name])
    assert report.ok, str(report)
    assert unchecked(report) == set(PARTS) - {"units", "c"}
    assert report["recover"].says == f"not proven: of kind {catalogue()[name].kind}, and only an effect of the rate is tried"
    assert report["c"].says.startswith("none: ")


def _previous(movement) -> np.ndarray:
    """(N, 3) size of the rate one sample ago."""
    return np.abs(np.concatenate([movement.rate[:1], movement.rate[:-1]]))


def _mostly(measured, movement, theta) -> np.ndarray:
    return measured - 0.99 * (DRIFT.distort(movement.with_rate(measured), theta) - measured)


BROKEN = {
    "columns": replace(
        ASYMMETRY, columns=lambda m: 1.01 * ASYMMETRY.columns(m), exact_distort=ASYMMETRY.distort, exact_correct=ASYMMETRY.correct
    ),
    "undo": replace(DRIFT, exact_correct=_mostly),
    "recover": replace(DRIFT, known_to=20.0),
    "units": replace(DRIFT, parameter=Parameter("dps_over_log", (3,), "dps", 1.0, plausible=DRIFT.parameter.plausible)),
    "picture": replace(DRIFT, picture=lambda data, left, right: left.set_title("nothing else")),
    "live": replace(ASYMMETRY, columns=lambda m: diagonal(_previous(m)), device=DRIFT.device),
    "c": replace(ASYMMETRY, device=replace(ASYMMETRY.device, term="SCALE_ASYMMETRY[i] * (w < 0.0f ? w : -w)")),
}


@pytest.mark.parametrize("part", by_night(PARTS, {"undo": pytest.mark.broad}))
def test_a_broken_effect_fails_just_its_part(part):
    report = check(BROKEN[part])
    assert report.failed == (part,), str(report)
    assert not report.ok
    with pytest.raises(AssertionError, match=f"{part} +failed"):
        report.require()


def quick(effect, *parts, **how) -> str:
    """What one part says, failed."""
    (part,) = check(effect, parts=parts, **how).parts
    assert part.result == "failed", part
    return part.says


@pytest.mark.slow
def test_a_picture_without_labels_or_with_an_empty_panel_fails():
    def one_panel(data, left, right):
        left.plot(data.stills_s, data.before)
        left.set(xlabel="t", ylabel="rate")

    def no_labels(data, left, right):
        for axes in (left, right):
            axes.plot(data.stills_s, data.before)

    assert "right panel is empty, or has an axis without a label" in quick(replace(DRIFT, picture=one_panel), "picture")
    assert "left panel is empty, or has an axis without a label" in quick(replace(DRIFT, picture=no_labels), "picture")


def test_a_bias_of_the_fit_fails():
    """What is undone by three quarters alone is found a third too large."""
    wrong = replace(
        DRIFT, exact_correct=lambda measured, m, theta: measured - 0.75 * (DRIFT.distort(m.with_rate(measured), theta) - measured)
    )
    assert "more than the stated sigmas" in quick(wrong, "recover")


def test_what_no_simulated_session_has_is_said_not_to_be_proven():
    fast = replace(DRIFT, reference_conditions=ReferenceConditions(fs_rps=30.0))
    (part,) = check(fast, parts=("recover",)).parts
    assert part.result == "not checked"
    assert part.says.startswith("not proven: no session is simulated for vibration")


def test_what_follows_the_size_of_the_force_is_seen():
    """A hand adds to gravity, so that the specific force is not always 1 g long."""
    sized = replace(catalogue()["gyro.g2_sensitivity"], columns=lambda m: diagonal(np.linalg.norm(m.force_g, axis=1) - 1))
    assert check(sized, parts=("columns", "undo", "live")).ok


def test_rounding_is_no_change():
    tiny = replace(DRIFT, basis=None, columns=lambda m: 1e-12 * diagonal(np.ones(len(m.rate))))
    assert "parameter 0 changes nothing" in quick(tiny, "columns")


def test_parameters_that_change_nothing_fail():
    blind = replace(DRIFT, columns=lambda m: DRIFT.columns(m) * [1, 0, 1])
    assert "parameter 1 changes nothing" in quick(blind, "columns")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"describe": lambda theta: "a sentence without one"}, "expected one sentence with a number"),
        ({"describe": lambda theta: "1\n2"}, "expected one sentence with a number"),
        ({"parameter": replace(DRIFT.parameter, name="theta_si")}, "its model file gives"),
        ({"parameter": replace(DRIFT.parameter, unit="ppm", si=1.0)}, "unit 'ppm' is 1e-06 in SI, and si says 1"),
    ],
)
def test_words_names_and_units_are_looked_at(changes, says):
    assert says in quick(replace(DRIFT, **changes), "units")


def test_a_shape_that_does_not_come_back_from_json_fails():
    step = catalogue()["gyro.bias_step"]
    taken = replace(step, scan=replace(step.scan, name="dps"))
    assert "its model file gives" in quick(taken, "units")
    minutes = replace(step, scan=replace(step.scan, unit="min"))
    assert "unit 'min' is 60 in SI" in quick(minutes, "units")


def test_an_input_that_is_not_declared_is_no_silent_nan():
    thermal = replace(catalogue()["gyro.thermal_bias"], inputs=())
    with pytest.raises(EffectError, match=r"reads movement\.temp_c, which it does not declare; add inputs=\(\"temperature\",\)"):
        check(thermal)


def test_looking_ahead_without_a_word_fails():
    """One sample ahead, live and in pieces."""

    def ahead(m):
        return diagonal(np.abs(np.concatenate([m.rate[1:], m.rate[-1:]])))

    undeclared = replace(ASYMMETRY, columns=ahead, device=DRIFT.device)
    assert "does reach say all that it looks at?" in quick(undeclared, "live")
    declared = replace(ASYMMETRY, columns=ahead, device=DRIFT.device, reach=catalogue()["gyro.bandwidth"].reach)
    (part,) = check(declared, parts=("live",)).parts
    assert part.result == "passed"
    assert part.says.startswith(f"in pieces as whole; refused live: {ASYMMETRY.id} is undone from what comes after a sample")


class Elsewhere(Calibration):
    """Refuses for another reason than that it looks ahead."""

    def live(self):
        raise CalibrationError("no memory left")


@pytest.mark.parametrize("name", ["gyro.bandwidth", "gyro.scale_asymmetry"])
def test_only_looking_ahead_is_a_reason_to_refuse(name, monkeypatch):
    monkeypatch.setattr(proofs, "Calibration", Elsewhere)
    assert quick(catalogue()[name], "live") == "cannot go live: no memory left"


REMEMBERS = replace(
    ASYMMETRY,
    id="gyro.previous_size",
    columns=lambda m: diagonal(_previous(m)),
    exact_correct=lambda measured, m, theta: _one_by_one(measured, theta),
    reach=replace(catalogue()["gyro.bandwidth"].reach, before_samples=60, after_samples=0),
    device=StageC(
        formula="r -= k |r one sample ago|",
        body=(
            "for (int i = 0; i < 3; i++) {\n    if (!state->previous_begun)\n        state->previous[i] = r[i] * PREVIOUS_FIRST[i];\n"
            "    r[i] -= PREVIOUS_SIZE[i] * state->previous[i];\n    state->previous[i] = r[i] < 0.0f ? -r[i] : r[i];\n}\n"
            "state->previous_begun = 1.0f;"
        ),
        constants=lambda theta, known: {"PREVIOUS_SIZE": theta, "PREVIOUS_FIRST": np.zeros(3)},
        numpy=lambda c, rate, inputs: _one_by_one(rate, c["PREVIOUS_SIZE"], c["PREVIOUS_FIRST"]),
        cost=Cost(6, 3, 3),
        state="    float previous[3];\n    float previous_begun;\n",
        state_bytes=16,
        start="for (int i = 0; i < 3; i++)\n    state->previous[i] = 0.0f;\nstate->previous_begun = 0.0f;\n",
    ),
)


def _one_by_one(measured, k, first=0.0) -> np.ndarray:
    """The first sample stands after one of zero."""
    back, previous = np.empty_like(measured), np.abs(measured[0] * np.asarray(first, measured.dtype))
    for n, row in enumerate(measured):
        back[n] = row - k * previous
        previous = np.abs(back[n])
    return back


def test_c_with_a_memory_is_carried():
    (part,) = check(REMEMBERS, parts=("c",)).parts
    assert part.result == "passed", part
    assert part.says.startswith(("its C is its NumPy bit for bit", "no gcc"))


def test_c_that_does_not_compile_and_constants_without_a_name_fail():
    device = ASYMMETRY.device
    assert "does not compile" in quick(replace(ASYMMETRY, device=replace(device, term="SCALE_ASYMMETRY[i] * nothing")), "c")
    lower = replace(device, name="k", constants=lambda theta, known: {"k": theta}, numpy=lambda c, w, inputs: c["k"] * np.abs(w))
    assert "no name for a constant" in quick(replace(ASYMMETRY, device=lower), "c")


def test_numpy_that_is_not_what_correct_does_fails():
    half = replace(ASYMMETRY.device, numpy=lambda c, w, inputs: np.float32(0.5) * c["SCALE_ASYMMETRY"] * np.abs(w))
    assert "differs from correct" in quick(replace(ASYMMETRY, device=half), "c")


def test_what_is_no_effect_or_no_part_is_refused():
    with pytest.raises(EffectError, match="expected tinygc"):
        check(3)
    with pytest.raises(EffectError, match="'colums' is no part of a check; choose among columns, undo"):
        check(DRIFT, parts=("colums",))


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"size": 0.0}, "size is 0.0, expected more than 0"),
        ({"size": -1e-3}, "size is -0.001, expected more than 0"),
        ({"size": float("nan")}, "size is nan, expected more than 0"),
        ({"size": float("inf")}, "size is inf, expected more than 0"),
    ],
)
def test_a_size_that_cannot_be_is_refused(how, says):
    with pytest.raises(EffectError, match=says) as caught:
        check(DRIFT, parts=("units",), **how)
    assert "\n" not in str(caught.value)


def test_a_report_is_read_by_name_and_printed_by_lines():
    report = check(ASYMMETRY, parts=("columns", "units"))
    assert report.ok
    assert report.require() is report
    assert report["units"].says.startswith("unit 'fraction' is 1 SI")
    assert str(report).splitlines()[0] == "gyro.scale_asymmetry"
    assert len(str(report).splitlines()) == 3
