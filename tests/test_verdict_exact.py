"""Each rule of a verdict at its limit, one step below and above; its figures and p-values by hand."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG
from linear_twin import PRIORS, effect, linear_twin, stepped
from scipy import stats

from session.io.config import NominalRate
from session.io.errors import FitError
from tinygc.closure.floor import wander_covariance
from tinygc.estimation import systematic
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.choice import (
    AgainstRaw,
    against_raw,
    closure_figures,
    model_to_use,
    rmse,
    run_figures,
    worse_in_table,
)
from tinygc.estimation.model_tests import EFFECT, GRAVITY, NOISE, RUN, TURNS, ModelTest
from tinygc.estimation.promise import Promise
from tinygc.estimation.repeatability import BiasRepeatability
from tinygc.estimation.systematic import Systematic, systematic_of
from tinygc.estimation.verdict import BELOW_95, GIVEN, JudgedFit, decide, require_plausible, run_p_values, too_good, too_wide
from tinygc.models.linear import LinearModel

# Figures


def test_figures_are_root_mean_squares_in_degrees_and_yaw_is_of_the_turns_that_know_it():
    angles = np.array([[3.0, 4.0, 0.0], [1.0, 2.0, 6.0], [2.0, 2.0, -8.0]]) * DEG
    figures = closure_figures(angles)
    assert figures["roll_rms_deg"] == pytest.approx(np.sqrt(14 / 3))
    assert figures["pitch_rms_deg"] == pytest.approx(np.sqrt(24 / 3))
    assert figures["tilt_rms_deg"] == pytest.approx(np.sqrt(38 / 3)) == pytest.approx(tilt_rms(angles) / DEG)
    assert figures["yaw_rms_deg"] == pytest.approx(np.sqrt(50))
    assert closure_figures(angles[:, :2])["yaw_rms_deg"] is None
    assert closure_figures(angles * [1, 1, 0])["yaw_rms_deg"] is None
    assert rmse(angles[0]) == pytest.approx(5 / np.sqrt(3) * DEG)
    assert run_figures(angles[1]) == pytest.approx({"roll_deg": 1.0, "pitch_deg": 2.0, "yaw_deg": 6.0, "rmse_deg": np.sqrt(41 / 3)})


# Against raw, and which model to use


@pytest.mark.parametrize(
    ("held_out", "worse", "failed"),
    [
        ({"least_squares": 0.9, "pso": 1.1}, ("pso",), False),
        ({"least_squares": 1.2, "pso": 1.1}, ("least_squares", "pso"), True),
        ({"least_squares": 1.0}, (), False),
        ({"least_squares": float("nan")}, ("least_squares",), True),
        ({}, (), False),
    ],
)
def test_nothing_better_than_raw_is_a_fail_and_one_that_is_worse_is_said(held_out, worse, failed):
    for segments, enough in ((13, True), (12, False)):
        against = AgainstRaw("raw_bias_removed", 1.0, held_out, segments)
        assert (against.worse, against.failed) == (worse, failed and enough)
        assert [against.condemns(tilt) for tilt in (1.0, 1.0001)] == [False, enough]
        assert bool(against.words) == bool(worse)
        if worse:
            whom = "do not apply these" if not failed else "nothing that was fitted is worth applying"
            assert f"{held_out[worse[0]]:.4f}°" in against.words
            assert (whom if enough else "by 12 turns this is not decided") in against.words
        assert against.to_json() == {
            "method": "raw_bias_removed",
            "tilt_rms_deg": 1.0,
            "worse": list(worse),
            "passed": not (failed and enough),
        }


def fitted(angles, parameters=12, undone=()):
    return SimpleNamespace(held_out=np.asarray(angles, dtype=float), parameters=parameters, model=SimpleNamespace(undone=undone))


def test_raw_is_the_better_of_two_that_fit_nothing():
    flat = np.full((4, 2), DEG)
    fits = {"raw": fitted(2 * flat), "least_squares": fitted(flat)}
    with patch(
        "tinygc.estimation.choice.run_method", lambda name, problem, options: fitted((3 if name == "raw_bias_removed" else 9) * flat)
    ):
        found = against_raw(SimpleNamespace(used=[None] * 4), None, fits)
    assert (found.method, found.segments) == ("raw", 4)
    assert found.tilt_rms_deg == pytest.approx(2 * np.sqrt(2))
    assert found.held_out == pytest.approx({"least_squares": np.sqrt(2)})


@pytest.mark.parametrize(
    ("mine", "raw", "segments", "worse"),
    [
        (1.1, 1.0, 13, True),
        (1.0, 1.0, 13, False),
        (1.1, 1.0, 12, False),
        (None, 1.0, 13, True),
        (1.0, None, 13, False),
        (None, None, 13, True),
    ],
)
def test_a_file_says_whether_its_method_is_worse_than_raw(mine, raw, segments, worse):
    table = {"methods": {"pso": {"holdout": {"tilt_rms_deg": mine}}}, "against_raw": {"tilt_rms_deg": raw}, "segments": {"used": segments}}
    given = tuple(np.inf if value is None else value for value in (mine, raw))
    assert worse_in_table(table, "pso") == (given if worse else None)
    assert worse_in_table(table, "tinygc") is None
    assert worse_in_table({**table, "methods": {}}, "pso") is None
    del table["against_raw"]
    assert worse_in_table(table, "pso") is None


def used(tilts: dict[str, float], segments=40, raw_deg=5.0, numbers=None, undone=()):
    """Each method closes all segments alike but for a part in ten thousand, so that Wilcoxon's p is a power of two."""
    parameters = {"raw": 0, "least_squares": 12, "tinygc": 27, "tinygc_denoised": 195, "physics": 15, "pso": 12}
    shape = np.linspace(1, 1.0001, segments)[:, None] * [0.6, 0.8]
    fits = {name: fitted(tilt * DEG * shape, parameters[name], undone if name == "physics" else ()) for name, tilt in tilts.items()}
    held = {name: closure_figures(fit.held_out)["tilt_rms_deg"] for name, fit in fits.items()}
    return model_to_use(fits, AgainstRaw("raw", raw_deg, held, segments), numbers or {name: list(range(segments)) for name in fits})


@pytest.mark.parametrize(
    ("tilts", "segments", "method", "best", "p"),
    [
        ({"least_squares": 1.0}, 40, "least_squares", "least_squares", None),
        ({"tinygc": 0.9901, "least_squares": 1.0}, 40, "least_squares", "tinygc", None),
        ({"tinygc": 0.9899, "least_squares": 1.0}, 40, "tinygc", "tinygc", 2.0**-40),
        # the sigma of a root mean square of 80 angles is 0.0791 of it
        ({"tinygc_denoised": 0.922, "least_squares": 1.0}, 40, "least_squares", "tinygc_denoised", None),
        ({"tinygc_denoised": 0.920, "least_squares": 1.0}, 40, "tinygc_denoised", "tinygc_denoised", 2.0**-40),
        ({"tinygc": 0.5, "least_squares": 1.0}, 5, "tinygc", "tinygc", 1 / 32),
        ({"tinygc": 0.5, "least_squares": 1.0}, 4, "least_squares", "tinygc", 1 / 16),
        ({"tinygc": 0.5, "physics": 1.0, "least_squares": 1.0}, 5, "least_squares", "tinygc", 1 / 32),
        ({"tinygc": 0.5, "physics": 1.0, "least_squares": 1.0}, 6, "tinygc", "tinygc", 1 / 64),
        ({"tinygc": 0.5, "physics": 0.7, "least_squares": 1.0}, 40, "tinygc", "tinygc", 2.0**-40),
        ({"tinygc": 0.695, "physics": 0.7, "least_squares": 1.0}, 40, "physics", "tinygc", 2.0**-40),
        ({"pso": 1.0, "least_squares": 1.0}, 40, "least_squares", "least_squares", None),
        ({"raw": 0.1, "tinygc": 6.0, "least_squares": 1.0}, 40, "least_squares", "least_squares", None),
        ({"tinygc": 6.0, "least_squares": 7.0}, 40, None, "tinygc", None),
        ({"raw": 0.1}, 40, None, None, None),
    ],
)
def test_the_simplest_model_that_no_other_betters_by_a_hundredth_and_more_than_chance(tilts, segments, method, best, p):
    """One of twenty, divided by the number of others."""
    found = used(tilts, segments)
    assert (found.method, found.best) == (method, best)
    assert found.p_value == (p if p is None else pytest.approx(p))
    assert found.to_json() == {"method": method, "best": best, "p_value": found.p_value, "why": found.why}


@pytest.mark.parametrize(
    ("tilts", "segments", "says"),
    [
        ({"least_squares": 1.0}, 40, "held out 1.0001°, the only one fitted"),
        ({"least_squares": 1.0, "tinygc": 6.0}, 40, "held out 1.0001°, the only one that is better than the raw rates"),
        ({"least_squares": 1.0, "tinygc": 0.995}, 40, "held out 1.0001°, the simplest model within 1 % of the best"),
        (
            {"least_squares": 1.0, "tinygc": 0.5},
            40,
            "held out 0.5000° instead of 1.0001° (least squares), significantly better (p = 9.1e-13)",
        ),
        (
            {"least_squares": 1.0, "tinygc": 0.5},
            4,
            "held out 1.0001°, the simplest model; none is significantly better (TinyGC-Net 0.5000°, p = 0.062)",
        ),
        ({"least_squares": 6.0}, 40, "nothing that was fitted closes held-out turns better than the raw rates"),
        (
            {"least_squares": 6.0},
            12,
            "nothing that was fitted closes held-out turns better than the raw rates, which 12 turns do not decide",
        ),
        ({"raw": 0.1}, 12, "nothing was fitted"),
    ],
)
def test_it_says_why(tilts, segments, says):
    assert used(tilts, segments).why.lower() == says.lower()


@pytest.mark.parametrize(("partly_observed", "method"), [(False, "physics"), (True, "least_squares")])
def test_a_law_of_which_closure_does_not_observe_a_part_is_not_recommended(partly_observed, method):
    law = SimpleNamespace(effect=SimpleNamespace(partly_observed=partly_observed))
    found = used({"least_squares": 1.0, "physics": 0.5}, undone=(law,))
    assert (found.method, found.best) == (method, "physics")
    assert ("not recommended" in found.why) == partly_observed


def test_models_are_compared_on_the_segments_that_both_have():
    numbers = {"least_squares": [0, 1, 2, 3, 4, 5], "tinygc": [9, 1, 2, 3, 4, 5]}
    assert used({"least_squares": 1.0, "tinygc": 0.5}, 6, numbers=numbers).p_value == pytest.approx(1 / 32)
    numbers["tinygc"] = [10, 11, 12, 13, 14, 15]
    assert used({"least_squares": 1.0, "tinygc": 0.5}, 6, numbers=numbers).method == "least_squares"


# Rules


def judged(times=1.0, segments=40, **known):
    figures = {"angles": np.full((segments, 2), times * 1e-3 / np.sqrt(2)), "numbers": list(range(segments)), "vector": np.zeros(12)}
    figures |= {"floor_rms": 1e-3, "closure_p": 0.5, "closure_freedom": 68, "run_errors": [], "run_p": [], "run_losses": []}
    return JudgedFit(**figures | known)


SHEET = Promise(5.0, 10.0, "an X1's data sheet")


def run(error=1e-3, p=0.5, lost=""):
    return {"run_errors": [np.full(3, error)], "run_p": [p], "run_losses": [lost]}


@pytest.mark.parametrize(
    ("known", "limit_deg", "answer"),
    [
        ({}, None, "pass"),
        ({"closure_p": 0.0100}, None, "pass"),
        ({"closure_p": 0.0099}, None, "fail"),
        (run(p=0.0100), None, "pass"),
        (run(p=0.0099), None, "fail"),
        ({"angles": np.full((40, 2), [2.0, 0.0]), "floor_rms": 1.0}, None, "pass"),
        ({"times": 2.0001}, None, "not decided"),
        ({"segments": 13}, None, "pass"),
        ({"segments": 12}, None, "not decided"),
        ({"angles": np.full((40, 2), [2.0, 0.0]), "floor_rms": 1.0}, 2.0 / DEG, "pass"),
        ({}, 0.9999e-3 / DEG, "fail"),
        (run(error=2.0), 2.0 / DEG, "pass"),
        (run(error=2.001e-3), 2e-3 / DEG, "fail"),
        ({"closure_p": 1e-9}, 1.0, "pass"),
        ({"segments": 12}, 1.0, "doubtful pass"),
        ({"times": 2.0001}, 1.0, "doubtful pass"),
    ],
)
def test_each_rule_holds_up_to_its_limit(known, limit_deg, answer):
    found = decide(judged(**known), ["closure0001.csv"] * len(known.get("run_p", [])), limit_deg, promise=SHEET)
    assert found.answer == answer
    assert found.passed == (answer != "fail")
    assert found.by_limit == (limit_deg is not None)
    assert len(found.conformities) == (0 if limit_deg is None else 1 + len(known.get("run_p", [])))
    assert found.word == {"pass": "PASS", "doubtful pass": "PASS, with doubts", "not decided": "NOT DECIDED", "fail": "FAIL"}[answer]
    assert all(met for met, _ in found.reasons) == (answer != "fail")
    assert found.to_json() == {
        "answer": answer,
        "headline": found.headline,
        "rule": found.rule,
        "limit_deg": pytest.approx(20 / DEG if limit_deg is None else limit_deg),
        "limit_from": f"twice {SHEET.source}" if limit_deg is None else GIVEN,
        "reasons": [{"met": met, "reason": text} for met, text in found.reasons],
        "doubts": found.doubts,
        "undecided": found.undecided,
        "tests": [],
        "conformity": [each.to_json() for each in found.conformities],
    }


@pytest.mark.parametrize(("share", "segments", "failed"), [(0.9999, 13, True), (1.0001, 13, False), (0.9999, 12, False)])
@pytest.mark.parametrize("limit_deg", [None, 5.0])
def test_worse_than_raw_is_a_fail_whatever_the_limit(share, segments, failed, limit_deg):
    found = decide(judged(), [], limit_deg, AgainstRaw("raw", share * 1e-3 / DEG, {}, segments))
    assert (found.answer == "fail") == failed
    assert any("worse than the 0.057° of the raw rates" in text for met, text in found.reasons if not met) == failed


@pytest.mark.parametrize(
    ("candidate", "files", "limit", "says"),
    [
        (judged(), 0, None, "PASS: held out 0.0573° over 5 s (twice an X1's data sheet: 1\u202f146°)"),
        (judged(), 0, 1.0, "PASS: held out 0.0573° (1.0 × noise, 40 segments)"),
        (judged(**run()), 1, None, "PASS: held out 0.0573° over 5 s (twice an X1's data sheet: 1\u202f146°), closure run 0.0573°"),
        (
            judged(run_errors=[np.full(3, 1e-3), np.full(3, 2e-3)], run_p=[0.5, 0.5], run_losses=["", ""]),
            2,
            None,
            "PASS: held out 0.0573° over 5 s (twice an X1's data sheet: 1\u202f146°), worst of 2 closure runs 0.115°",
        ),
        (
            judged(**run(2e-3, 1e-5, "lost")),
            1,
            None,
            "FAIL: closure0001.csv: off by 0.115°: p = 1 × 10⁻⁵, more than noise allows; lost",
        ),
        (
            judged(closure_p=1e-9),
            0,
            None,
            "FAIL: closure of the fitted segments, 68 degrees of freedom: p = 1 × 10⁻⁹, more than noise allows (held out 1.0 × the floor)",
        ),
        (
            judged(closure_p=1e-3, closure_freedom=None),
            0,
            None,
            "FAIL: closure of the fitted segments: p = 0.0010, more than noise allows (held out 1.0 × the floor)",
        ),
        (judged(), 0, 0.01, "FAIL: segments, held out, rms of tilt: 0.0573°, above 0.0100°"),
        (judged(segments=5), 0, None, "NOT DECIDED: 5 segments for 12 parameters, expected 13 segments or more: record more turns"),
        (judged(times=2.5), 0, None, "NOT DECIDED: held-out closure is 2.50 times what noise alone leaves (40 segments for 12 parameters)"),
    ],
)  # fmt: skip
def test_the_first_line_gives_the_answer_and_its_reason(candidate, files, limit, says):
    assert decide(candidate, ["closure0001.csv"] * files, limit, promise=SHEET).headline == says


@pytest.mark.parametrize(
    ("sheet", "answer", "says"),
    [
        (Promise(5.0, 0.501e-3, "an X1's data sheet"), "pass", "PASS: held out 0.0573° over 5 s (twice an X1's data sheet: 0.057°)"),
        (
            Promise(5.0, 0.499e-3, "an X1's data sheet", "this unit has 9 mdps/√Hz, 5 there"),
            "not decided",
            "NOT DECIDED: held out 0.0573° over 5 s, more than twice an X1's data sheet, 0.057°; this unit has 9 mdps/√Hz, 5 there",
        ),
        (Promise(5.0), "no limit", "no limit: closure 0.0991° over 5 s (95 %), 1.0 × noise, 40 segments"),
    ],
)
def test_without_a_limit_it_is_twice_what_the_data_sheet_promises(sheet, answer, says):
    """Of tilts about two axes alike 5 % are above sqrt(-ln 0.05) = 1.73 times their rms."""
    found = decide(judged(), [], None, promise=sheet)
    assert (found.answer, found.headline) == (answer, says)
    assert decide(judged(), [], 0.06, promise=sheet).answer == "pass"  # a limit that is given decides
    noisy = decide(judged(), [], None, promise=replace(sheet, tilt_rms=1.0, noisier="9 mdps/√Hz, 5 there"))
    assert (noisy.answer, noisy.doubts) == ("not decided", [f"noisier than {sheet.source}: 9 mdps/√Hz, 5 there"])
    assert decide(judged(closure_p=1e-3), [], None, promise=sheet).answer == "fail"
    assert decide(judged(segments=5), [], None, promise=Promise(5.0)).answer == "not decided"
    assert pytest.approx(np.sqrt(-np.log(0.05)), abs=2e-3) == BELOW_95


@pytest.mark.parametrize(("name", "limit", "answer"), [
    (TURNS, None, "pass"), (TURNS, 1.0, "not decided"), (RUN, None, "pass"), (RUN, 1.0, "not decided"),
    (NOISE, None, "not decided"), (NOISE, 1.0, "not decided"), (EFFECT, 1.0, "not decided"), (GRAVITY, None, "not decided"),
])  # fmt: skip
def test_what_contradicts_the_model_never_passes(name, limit, answer):
    """Without a limit the p-values of turns and runs are reasons by themselves."""
    for p, expected in ((0.0099, answer), (0.5 if name == EFFECT else 0.0100, "pass")):
        found = decide(judged(**run()), ["c.csv"], limit, tests=[ModelTest(name, p, 0.01, "it does")], promise=SHEET)
        assert found.answer == expected
        assert found.unsound == (["it does"] if expected == "not decided" else [])
        assert [test["contradicts"] for test in found.to_json()["tests"]] == [p < 0.01]
    assert decide(judged(), [], 0.01, tests=[ModelTest(name, 0.0, 0.01, "it does")]).answer == "fail"


@pytest.mark.parametrize("limit", [None, 1.0])
def test_an_effect_that_is_more_probable_than_not_is_no_pass_and_no_contradiction(limit):
    found = decide(judged(), [], limit, tests=[ModelTest(EFFECT, 0.499, 0.05, "it may be")], promise=SHEET)
    assert (found.answer, found.undecided, found.unsound) == ("not decided", ["it may be"], ["it may be"])
    assert not found.to_json()["tests"][0]["contradicts"]


@pytest.mark.parametrize(
    ("accelerometer", "says"),
    [
        ({"unobserved": ("bias x", "bias y")}, ["accelerometer: not observed: bias x, bias y; "]),
        ({"unobserved": tuple("abcdefghi")}, ["accelerometer: not observed: all of its numbers; "]),
        ({}, []),
    ],
)
def test_an_accelerometer_that_closure_does_not_show_is_a_doubt(accelerometer, says):
    given = SimpleNamespace(**{"unobserved": (), "mode": "fit", "p_value": None} | accelerometer)
    doubts = decide(judged(), [], None, accelerometer=given).doubts
    assert len(doubts) == len(says)
    for doubt, expected in zip(doubts, says, strict=True):
        assert doubt.startswith(expected)
    assert decide(judged(), [], None, doubts=["another"]).doubts == ["another"]


@pytest.mark.parametrize(("white_p", "doubted"), [(1 - 1.01e-4, False), (1 - 0.99e-4, True), (1e-4, False)])
def test_less_than_noise_is_in_doubt_where_it_happens_once_in_ten_thousand(white_p, doubted):
    assert bool(too_good(white_p)) == doubted


def test_a_calibration_that_an_effect_may_have_moved_too_far_is_in_doubt():
    raw = AgainstRaw("raw", 0.5, {})
    for limit_deg, than in ((0.2, "more than the limit"), (None, "more than what the raw rates leave")):
        most = (limit_deg or 0.5) * DEG
        assert too_wide(most * (1 - 1e-9), limit_deg, raw) == too_wide(DEG, limit_deg and 1.0, AgainstRaw("raw", 1.0, {})) == []
        (doubt,) = too_wide(most * (1 + 1e-9), limit_deg, raw)
        assert doubt.endswith(than)


@pytest.mark.parametrize(
    ("gain", "sigma", "refused"),
    [(1.2499, 1e-9, False), (1.2501, 1e-9, True), (0.8001, 1e-9, False), (0.7999, 1e-9, True), (1.25 + 0.0299, 0.01, False),
     (1.25 + 0.0301, 0.01, True), (0.8 - 0.0299, 0.01, False), (0.8 - 0.0301, 0.01, True), (1e-6, 1e-9, True), (-1.0, 1e-9, False)],
)  # fmt: skip
def test_no_gyroscope_has_such_a_scale(gain, sigma, refused, tmp_path):
    """Along a slanted direction, whose sigma by the covariance of E is ``sigma``: three of them beyond a quarter."""
    along = np.array([2.0, -1.0, 2.0]) / 3
    model = LinearModel(np.eye(3) + (gain - 1) * np.outer(along, along), np.zeros(3))
    slope = np.outer(along, along).ravel()
    covariance = 1e-18 * np.eye(12)
    covariance[:9, :9] += sigma**2 * np.outer(slope, slope)
    covariance[9:, 9:] = np.eye(3)
    if not refused:
        return require_plausible(model, covariance, tmp_path)
    with pytest.raises(FitError, match="no gyroscope has this calibration: it multiplies rates about"):
        require_plausible(model, covariance, tmp_path)
    with pytest.raises(FitError):
        require_plausible(LinearModel(np.eye(3), np.zeros(3)), np.full((12, 12), np.nan), tmp_path)


# Closure runs


def test_a_run_is_judged_by_noise_parameters_heading_and_drift():
    """Chi-square of three errors, with every part of their covariance added up by hand."""
    rng = np.random.default_rng(0)
    slopes, vector, root = rng.normal(size=(3, 12)), rng.normal(size=12), 0.01 * rng.normal(size=(12, 12))
    covariance, heading = root @ root.T, np.diag([1e-4, 4e-4, 0.0])
    closures = [SimpleNamespace(path=SimpleNamespace(name=name), counted=name == "a.csv") for name in ("a.csv", "b.csv")]
    session = SimpleNamespace(closures=closures, nominal_rate=None, clock=None, rate_of=lambda log: 208.0 if log.counted else None)
    problem = SimpleNamespace(
        session=session,
        middle_s=np.array([10.0, 50.0, 90.0]),
        batch=SimpleNamespace(duration_s=np.array([3.0, 5.0, 4.0])),
        instability=SimpleNamespace(rps=0.02),
    )
    floor = np.array([0.01, 0.02, 0.03])
    runs = [
        SimpleNamespace(file=name, floor_rad=floor, heading_covariance=heading, time_known=known, began_s=200.0, duration_s=60.0)
        for name, known in (("a.csv", True), ("b.csv", False))
    ]

    def errors(trial, run):
        return slopes @ (trial - vector) + [0.04, -0.05, 0.03]

    W = wander_covariance(np.array([230.0, 10.0, 50.0, 90.0]), np.array([60.0, 3.0, 5.0, 4.0]), instability_rps=0.02)
    drift = W[0, 0] - 2 * W[0, 1:].mean() + W[1:, 1:].mean()
    assert drift > 1e-5

    def p(known, error=(0.04, -0.05, 0.03)):
        whole = np.diag(floor**2) + heading + slopes @ known @ slopes.T + drift * slopes[:, 9:] @ slopes[:, 9:].T
        return stats.chi2.sf(np.dot(error, np.linalg.solve(whole, error)), 3)

    given = (vector, covariance, errors)
    assert run_p_values(problem, runs, *given) == pytest.approx([p(covariance)] * 2, rel=1e-6)
    spread = BiasRepeatability(np.array([0.01, 0.02, 0.03]), "given")
    other = covariance + np.diag(np.r_[np.zeros(9), 2e-4, 8e-4, 18e-4])
    assert run_p_values(problem, runs, *given, spread) == pytest.approx([p(covariance), p(other)], rel=1e-6)
    session.nominal_rate = session.clock = NominalRate(208.0, 0.003, "")
    counted = covariance - 9e-6 * np.outer(vector, vector)
    assert run_p_values(problem, runs, *given) == pytest.approx([p(counted), p(covariance)], rel=1e-6)
    session.nominal_rate = session.clock = None
    left = [np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 0.2])]
    assert run_p_values(problem, runs, *given, left=left) == pytest.approx([p(covariance, each) for each in left], rel=1e-6)


# What one effect may have moved


def test_the_largest_movement_by_one_effect_is_stated():
    a, b = np.zeros((12, 12)), np.zeros((12, 12))
    a[0, 0], a[9, 9] = 4e-8, (0.1 * DEG) ** 2
    b[0, 0] = b[4, 4] = 1e-8
    found = Systematic({"one": a, "two": b}, np.ones((3, 2, 12)))
    assert found.tilt_rms == pytest.approx(np.sqrt(2) * np.hypot(2e-4, 0.1 * DEG))
    assert found.sigma[[0, 4, 9]] == pytest.approx([2e-4, 1e-4, 0.1 * DEG])
    assert [found.to_json()["effects"][i] for i in (0, 4, 9)] == ["one", "two", "one"]
    tilts = np.zeros((2, 2, 12))
    tilts[:, :, 0] = [[1.0, 2.0], [3.0, 4.0]]
    assert Systematic({"one": a}, tilts).tilt_rms == pytest.approx(2e-4 * np.sqrt(30 / 2))


def test_it_is_the_second_moment_of_the_joint_normal_distribution():
    """Calibration and effect estimated together, theta's part taken out; a scanned shape is the mean weighed by the residuals' density."""
    a, step = effect("a", 2, plausible=0.7), stepped("step", np.array([1.0, 2.0, 3.0]))
    variants = [step.at(at) for at in (1.0, 2.0, 3.0)]
    twin = linear_twin(seed=6)
    twin.spoil(a, [0.5, -0.3])
    twin.spoil(variants[1], [0.4])
    covariance, response = np.diag(np.linspace(0.5, 2.0, twin.n)), np.random.default_rng(1).normal(size=(12, twin.n))
    noise = SimpleNamespace(twin=twin, covariance=covariance, first=np.eye(twin.n), gain_of=lambda columns: 60.0 + columns.shape[1])
    with (
        patch.object(systematic, "candidates", lambda twin: [a, *variants]),
        patch.object(systematic, "stated_response", lambda problem, model, still_rates: response),
    ):
        found = systematic_of(None, None, noise, 1.7, False)
    J = twin.calibration * np.where(np.arange(15) // 2 == 6, 0.0, PRIORS)

    def moments(each):
        prior, own = each.parameter.plausible, twin.columns_of(each)
        both = np.column_stack([J, own * prior])
        joint = np.linalg.inv(both.T @ np.linalg.solve(1.7 * covariance, both) + np.eye(both.shape[1]))
        theta = prior * (joint @ -(both.T @ np.linalg.solve(1.7 * covariance, twin.recorded)))[15:]
        square = response @ own @ (prior**2 * joint[15:, 15:] + np.outer(theta, theta)) @ own.T @ response.T
        return square, stats.multivariate_normal(np.zeros(twin.n), 1.7 * covariance + both @ both.T).logpdf(twin.recorded)

    np.testing.assert_allclose(found.by_effect["test.a"], moments(a)[0], rtol=1e-6)
    squares, log_p = zip(*map(moments, variants), strict=True)
    expected = np.average(squares, axis=0, weights=np.exp(np.array(log_p) - max(log_p)))
    np.testing.assert_allclose(found.by_effect["test.step"], expected, rtol=1e-6)
    twin.spoil(variants[1], [40.0])  # so strong that its evidence alone would overflow
    with (
        patch.object(systematic, "candidates", lambda twin: variants),
        patch.object(systematic, "stated_response", lambda problem, model, still_rates: response),
    ):
        strong = systematic_of(None, None, noise, 1.7, False)
    np.testing.assert_allclose(strong.by_effect["test.step"], moments(variants[1])[0], rtol=1e-6)
    np.testing.assert_allclose(found.tilts, twin.linear_columns(None).closure[:, :2])
    # With the noise estimated again: half of the gain, less the logarithms of ten scales and of three shapes, and a half for each number.
    expected = {"test.a": 30.0 - np.log(10.0), "test.step": 30.0 - np.log(30.0)}
    assert {name: found.log_odds[name] for name in expected} == pytest.approx(expected)
