"""Whether a recording contradicts the model, asked once: each test at its bar, the data sheet's promise, and what ``explain`` says."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG
from scipy.signal import lfilter

import tinygc
from session.detect.check_stills import NO_STILLS, check_unseen
from session.io.config import Accelerometer
from session.io.units import DEG_PER_HOUR, MG
from tinygc.closure.floor import wander_covariance
from tinygc.closure.uncertainty import GoodnessOfFit
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.model_tests import EFFECT, GRAVITY, NOISE, RUN, TURNS, ModelTest, contradictions, least_p, model_tests, none_missing
from tinygc.estimation.physics import PART_NAMED
from tinygc.estimation.promise import promise_of
from tinygc.estimation.results import FitResult
from tinygc.estimation.systematic import SURE, SUSPECTED, Systematic
from tinygc.explanation.claims import DIFFERS, VERDICTS
from tinygc.explanation.decision import expected_rms
from tinygc.explanation.engine import Explanation, _verdict
from tinygc.noise.components import STILL_RATE, TURN, WANDER
from tinygc.reporting.fit_text import accelerometer_table

MDPS = 1e-3 * DEG
FINE = GoodnessOfFit(60.0, 60, 0.5)


def noise(p=0.5, beyond="each turn 2 deg, where 1 deg is usual"):
    return SimpleNamespace(unusual_p=p, noise=SimpleNamespace(beyond_words=beyond))


def odds(log_odds, **others):
    return Systematic({}, np.zeros((0, 2, 12)), {"gyro.bias_drift": log_odds, "gyro.noise": -1.0, **others})


@pytest.mark.parametrize(("p", "contradicted"), [(0.0099, True), (0.0101, False)])
def test_turns_runs_and_noise_contradict_below_one_in_a_hundred(p, contradicted):
    for name, found in {
        TURNS: model_tests(GoodnessOfFit(99.0, 60, p), {}, None, None, None),
        RUN: model_tests(FINE, {"a.csv": 0.5, "b.csv": p}, None, None, None),
        NOISE: model_tests(FINE, {}, noise(p), None, None),
    }.items():
        assert [test.name for test in contradictions(found)] == [name] * contradicted
    assert "closure of the fitted segments, 60 degrees of freedom: p = 0.50" in model_tests(FINE, {}, None, None, None)[0].says
    assert "b.csv: p = 0.0" in model_tests(FINE, {"b.csv": p}, None, None, None)[1].says
    said = model_tests(FINE, {}, noise(p), None, None)[1].says
    differs = "turns or stills differ by more than the noise of such a sensor" if contradicted else "the noise may be that of such a sensor"
    assert said.startswith(f"{differs} (each turn 2 deg, where 1 deg is usual): p = 0.")
    assert model_tests(FINE, {}, noise(1.0, ""), None, None)[1].says == "the noise may be that of such a sensor: p = 1.0"


def test_the_probability_that_no_effect_is_missing_is_a_p_value_where_it_decides():
    """With even odds it is 0.5, below the p of the turns; with odds of 571 to 1 and prior odds of 1 to 30 it is the least."""
    turns = GoodnessOfFit(60.0, 60, 0.7)
    assert least_p(model_tests(turns, {}, None, odds(np.log(30)), None)) == [0.7]
    (p,) = least_p(model_tests(turns, {}, None, odds(np.log(571)), None))
    assert p == pytest.approx(30 / (30 + 571))
    assert least_p(()) == []


def test_an_effect_contradicts_where_it_is_there_with_95_percent():
    """With prior odds of 1 to 30, odds of 570."""
    assert (none_missing(SURE), none_missing(SUSPECTED)) == (pytest.approx(0.05), pytest.approx(0.5))
    assert none_missing(np.log(30)) == pytest.approx(0.5)
    assert (none_missing(1e9), none_missing(-np.inf)) == (pytest.approx(0.0, abs=1e-300), 1.0)
    above, below = np.log(571), np.log(569)
    (found,) = contradictions(model_tests(FINE, {}, None, odds(above), None))
    assert (found.name, found.says) == (EFFECT, "an effect is probably missing: gyro.bias_drift (probability that none is 0.05)")
    assert contradictions(model_tests(FINE, {}, None, odds(below), None)) == []
    # From there to even odds, 30 to 1 with the prior ones, it is open, as names of explain are more probable than not.
    opened = [model_tests(FINE, {}, None, odds(np.log(each)), None)[1].leaves_open for each in (571, 569, 31, 29)]
    assert opened == [False, True, True, False]
    assert not ModelTest(TURNS, 0.2, 0.01, "").leaves_open


def test_effects_that_are_not_told_apart_count_together():
    """Sixteen and ten and five to one, of which none is even with the prior odds; one within exp(3) of the best is the last to count."""
    alike = odds(np.log(16), step=np.log(10), warmth=np.log(5), far=np.log(0.79), against=-0.1)
    assert alike.likeliest == alike.suspected == ["gyro.bias_drift", "step", "warmth"]
    assert none_missing(alike.log_odds_of_any) == pytest.approx(30 / 61)
    assert odds(np.log(400), near=np.log(20), far=np.log(19.9)).likeliest == ["gyro.bias_drift", "near"]
    fewer = odds(np.log(16), step=np.log(10), warmth=np.log(3.9))
    assert (fewer.suspected, model_tests(FINE, {}, None, fewer, None)[1].leaves_open) == ([], False)
    assert odds(-0.5).log_odds_of_any == -np.inf


@pytest.mark.parametrize(
    ("mode", "p", "tested", "contradicted"),
    [("prior", 0.99e-4, 1, 1), ("given", 0.99e-4, 1, 1), ("prior", 1.01e-4, 1, 0), ("prior", None, 0, 0), ("fit", 1e-9, 0, 0)],
)
def test_a_given_calibration_of_the_accelerometer_is_tested_where_it_is_in_use(mode, p, tested, contradicted):
    found = model_tests(FINE, {}, None, None, SimpleNamespace(mode=mode, p_value=p))[1:]
    assert (len(found), len(contradictions(found))) == (tested, contradicted)
    assert all(test.name == GRAVITY for test in found)
    assert [test.to_json()["says"].startswith("accelerometer: the given calibration no longer holds") for test in found] == [
        bool(contradicted)
    ] * tested


@pytest.mark.parametrize(
    ("mode", "p", "said"), [("prior", 0.5, "agrees with"), ("prior", 0.99e-4, "no longer holds"), ("prior", None, ""), ("fit", None, "")]
)
def test_the_table_of_the_accelerometer_says_what_the_test_says(mode, p, said):
    caption = accelerometer_table(AccelerometerFit(mode, Accelerometer(), p_value=p), "").caption or ""
    assert said in caption
    assert ("agrees" in caption, "no longer" in caption) == (said == "agrees with", said == "no longer holds")


def test_the_least_probable_is_told_first():
    tests = [ModelTest("a", 0.5, 0.01, ""), ModelTest("b", 1e-3, 0.01, ""), ModelTest("c", 1e-9, 0.01, "")]
    assert [test.name for test in contradictions(tests)] == ["c", "b"]


# What a data sheet promises


def problem(model="ASM330LHH", given=True, noise_mdps=None, dph=None, instability=3.0, unit_mdps=7.1):
    """Three turns of 4, 5 and 9 s beside an accelerometer twice as noisy as its data sheet says."""
    figures = {"gyro_noise_mdps_rthz": 5.0, "accel_noise_ug_rthz": 60.0, "gyro_bias_instability_dph": instability}
    sensor = SimpleNamespace(
        gyro_noise_mdps_rthz=noise_mdps,
        gyro_bias_instability_dph=dph,
        typical=lambda name: (model, figures[name]) if model and figures[name] else None,
    )
    part = lambda variance: SimpleNamespace(own=np.tile(np.diag([variance, 2 * variance, 7.0]), (3, 1, 1)))  # noqa: E731
    parts = {"white noise of the gyroscope": part(1.0), "white noise of the accelerometer": part(4e-8), "truth file": part(1e-8)}
    return SimpleNamespace(
        session=SimpleNamespace(config=SimpleNamespace(sensor=sensor, model_given=given)),
        batch=SimpleNamespace(duration_s=np.array([4.0, 5.0, 9.0])),
        middle_s=np.array([10.0, 20.0, 40.0]),
        used=[0, 1, 2],
        floor=SimpleNamespace(parts=parts | {"bridged readings and impacts": part(3.0), "rounding and jitter of the stamps": part(5.0)}),
        noise=SimpleNamespace(gyro=np.full(3, unit_mdps * MDPS), accel=np.full(3, 120e-6 * 1e3 * MG)),
    )


@pytest.mark.parametrize(("noise_mdps", "dph"), [(None, None), (8.0, None), (None, 12.0), (8.0, 12.0)])
def test_a_data_sheet_promises_noise_drift_and_references(noise_mdps, dph):
    """N^2 T of both axes, B about its mean over the session, a quarter of the measured noise of the accelerometer, and the truth's."""
    found = promise_of(problem(noise_mdps=noise_mdps, dph=dph))
    seconds, at = np.array([4.0, 5.0, 9.0]), np.array([10.0, 20.0, 40.0])
    about_mean = np.eye(3) - 1 / 3
    drift = np.diag(about_mean @ wander_covariance(at, instability_rps=(dph or 3.0) * DEG_PER_HOUR) @ about_mean)
    variance = ((noise_mdps or 5.0) * MDPS) ** 2 * seconds + 2 * seconds**2 * drift + 3 * 4e-8 / 4 + 3 * 1e-8
    assert found.tilt_rms == pytest.approx(np.sqrt(np.mean(variance)))
    assert found.turn_s == 5.0
    assert found.source == ("the noise in session.toml" if noise_mdps else "an ASM330LHH's data sheet")
    assert found.noisier == ("" if noise_mdps else "this unit has 7.1 mdps/√Hz of noise, 5 there")
    assert promise_of(problem(unit_mdps=6.9)).noisier == ""  # units differ by 1.4


def test_without_a_profile_or_a_name_nothing_is_promised():
    for each in (problem(model=""), problem(given=False)):
        found = promise_of(each)
        assert (found.turn_s, found.tilt_rms, found.source, found.noisier) == (5.0, None, "", "")
    # session.toml has the noise and no name: nothing of a profile counts, and the accelerometer's share is the unit's own.
    own = promise_of(problem(noise_mdps=8.0, given=False))
    seconds = np.array([4.0, 5.0, 9.0])
    assert own.tilt_rms == pytest.approx(np.sqrt(np.mean((8.0 * MDPS) ** 2 * seconds + 3 * 4e-8 + 3 * 1e-8)))
    still = promise_of(problem(model="BMI088", instability=None))  # its drift is not known, and is none
    assert still.source == "a BMI088's data sheet"
    assert still.tilt_rms < promise_of(problem()).tilt_rms


# What ``explain`` makes of it


def explained(tests=(), named=(), findings=(), unusual=False, after=1.0, decided=True, first_p=0.5, turn=0.0, beyond=(), worse=False):
    """Expected without an error of each turn: a floor of 1 and a drift of sqrt(3) on two axes together, which is 2."""
    claims = [SimpleNamespace(effect=SimpleNamespace(id=name), equivalent=equivalent) for name, equivalent in dict(named).items()]
    sizes = {TURN: turn, STILL_RATE: 5.0, WANDER: np.sqrt(1.5)}

    def covariance(names):
        return sum((sizes[name] ** 2 for name in names), 0.0) * np.eye(6)

    def without(name, kept=tuple(sizes)):
        names = [each for each in kept if each != name]
        return SimpleNamespace(covariance=covariance(names), without=lambda other: without(other, names))

    noise = SimpleNamespace(without=without, beyond=[(SimpleNamespace(name=name), 2.0, 1.0) for name in beyond])
    e = SimpleNamespace(
        decision=SimpleNamespace(tests=tests) if decided else None,
        contradictions=contradictions(tests),
        claimed=claims,
        findings=findings,
        naming=SimpleNamespace(
            unusual=unusual,
            first_p=first_p,
            beyond=findings,
            noise=noise,
            whiten=SimpleNamespace(parts={"closure": slice(0, 6)}),
        ),
        proof=SimpleNamespace(after=np.array([[after, 0.0]] * 3), floor_rms=1.0, worse=worse),
        noise=noise,
        twin=SimpleNamespace(batch=SimpleNamespace(angles=2)),
    )
    e.verdict = _verdict(e)
    return e


AGAINST, FOR = ModelTest(NOISE, 1e-9, 0.01, ""), ModelTest(TURNS, 0.5, 0.01, "")


@pytest.mark.parametrize(
    ("known", "verdict"),
    [
        ({"tests": [FOR]}, "no_mismatch"),
        ({"tests": [FOR, AGAINST]}, "unexplained"),
        ({"tests": [FOR], "first_p": 1e-3, "unusual": True}, "no_mismatch"),  # asked once, by the tests
        ({"decided": False, "first_p": 0.05}, "unexplained"),  # where there is no fit
        ({"decided": False, "first_p": 0.051}, "no_mismatch"),
        ({"decided": False, "unusual": True}, "unexplained"),
        ({"tests": [FOR], "findings": ["a shape"]}, "unexplained"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}}, "explained"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ("gyro.bias_step",)}}, "ambiguous"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}, "unusual": True}, "partly_explained"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}, "findings": ["a shape"]}, "partly_explained"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}, "worse": True}, "partly_explained"),
        ({"tests": [AGAINST], "named": {"timing.gyro_accel_offset": ()}}, "partly_explained"),
        ({"tests": [FOR], "named": {"timing.gyro_accel_offset": ("gyro.bandwidth",)}}, "ambiguous"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}, "after": 3.99}, "explained"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}, "after": 4.01}, "partly_explained"),
        ({"tests": [AGAINST], "named": {"gyro.bias_drift": ()}, "after": 4.01, "turn": 9.0}, "partly_explained"),
    ],
)
def test_what_explain_says_follows_the_tests_of_fit(known, verdict):
    """Explained: what is left is at most twice what noise with a cause leaves, which an error of each turn is not."""
    e = explained(**known)
    assert e.verdict == verdict
    assert expected_rms(e.twin, e.naming, e.proof) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("tests", "beyond", "differs"),
    [([AGAINST], [TURN], True), ([AGAINST], [WANDER], False), ([AGAINST, ModelTest(TURNS, 1e-9, 0.01, "")], [TURN], False)],
)
def test_turns_that_differ_by_more_than_noise_are_a_verdict(tests, beyond, differs):
    e = explained(tests=tests, beyond=beyond)
    words = Explanation.words.fget(e)
    assert words == ((DIFFERS, VERDICTS["unexplained"][1]) if differs else VERDICTS["unexplained"])


@pytest.mark.parametrize(
    ("rests", "said"),
    [
        ([(2.0, 3.0), (35.0, 36.0), (68.0, 69.0), (98.0, 99.0)], None),
        ([(2.0, 3.0), (36.4, 38.0), (70.0, 71.0), (98.0, 99.0)], "from 3 to 36 s, 33% of the log"),
        ([(2.0, 30.0), (40.0, 60.0)], "from 60 to 100 s, 40% of the log"),
        ([(45.0, 60.0), (70.0, 80.0)], "from 0 to 45 s, 45% of the log"),
        ([], None),
    ],
)
def test_a_third_of_a_log_without_a_still_is_told(rests, said):
    stills = [SimpleNamespace(start_s=a, duration_s=b - a, problem=None) for a, b in rests]
    log = SimpleNamespace(samples=SimpleNamespace(duration_s=100.0), path=Path("log0001.csv"))
    found = check_unseen([SimpleNamespace(log=log, stills=stills)])
    assert [finding.says for finding in found] == ([] if said is None else [f"{said}: nothing there is used"])
    assert all((finding.level, finding.what, finding.where) == ("warning", NO_STILLS, "log0001.csv") for finding in found)


@pytest.mark.broad
def test_a_zero_that_drifts_is_no_pass_and_is_named(tmp_path, simulated):
    """0.5 dps over the session: a drift of a hundred times such a sensor's had been its noise, with p = 1."""
    session = tinygc.simulate(segments=20, closure_s=0.0, odr_hz=104.0, seed=31).session
    log = session.logs[0]
    ramp = np.linspace(-0.25, 0.25, len(log.samples))[:, None] * DEG * [0.0, 0.0, 1.0]
    session = replace(session, logs=(replace(log, samples=replace(log.samples, gyro=log.samples.gyro + ramp)),))
    decision = tinygc.fit(session, methods=("least_squares",)).verdict()
    assert decision.answer == "not decided"
    assert {test.name for test in contradictions(decision.tests)} >= {NOISE, EFFECT}
    why = tinygc.explain(session)
    assert why.explanation.decision.headline == decision.headline
    assert "gyro.bias_drift" in [effect.id for effect in why.effects]


@pytest.mark.broad
def test_a_filter_that_changes_is_no_pass():
    session = tinygc.simulate(segments=20, closure_s=0.0, odr_hz=104.0, seed=31).session
    log, half = session.logs[0], len(session.logs[0].samples) // 2
    gyro = np.asarray(log.samples.gyro)
    gyro = np.concatenate([gyro[:half], lfilter(np.ones(4) / 4, 1, gyro, axis=0)[half:]])
    session = replace(session, logs=(replace(log, samples=replace(log.samples, gyro=gyro)),))
    fit = tinygc.fit(session, methods=("least_squares",))
    assert fit.verdict().answer != "pass"
    assert any("gyro filter from row" in doubt for doubt in fit.result.doubts)


@pytest.mark.parametrize(("method", "refused", "doubts"), [("physics", True, [PART_NAMED]), ("physics", False, []), ("pso", True, [])])
def test_what_is_left_beside_physics_is_a_doubt_of_fit_as_of_explain(method, refused, doubts):
    fit = SimpleNamespace(
        use=SimpleNamespace(method=method),
        physics=SimpleNamespace(refused=refused),
        judged=None,
        decided=lambda judged, is_linear, limit_deg, more: more,
    )
    assert FitResult.verdict(fit) == doubts
    assert VERDICTS["partly_explained"][0] == PART_NAMED
