"""A verdict's rules at their limits, its figures and p-values by hand, the tests that contradict, and what one effect may have moved."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from linear_twin import PRIORS, effect, linear_twin, stepped
from numpy.testing import assert_allclose
from scipy import stats
from scipy.linalg import block_diag

from session.base.errors import FitError
from session.base.records import table_of
from session.base.units import DEG, DEG_PER_HOUR, MG
from session.detect.accelerometer import NAMES as ACCELEROMETER
from session.log.config import Accelerometer, NominalRate
from tinygc.closure.uncertainty import GoodnessOfFit
from tinygc.estimation import systematic
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.choice import (
    AgainstRaw,
    closure_figures,
    model_to_use,
    run_figures,
    worse_in_table,
)
from tinygc.estimation.spread import ZERO, Spread
from tinygc.estimation.stated_noise import require_plausible
from tinygc.estimation.systematic import MOST_WEIGHED, Systematic, _left_of, _promises, systematic_of
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import LinearModel
from tinygc.verdict.acceptance import GIVEN, CandidateFit, Promise, decide, promise_of, run_p_values, too_good, too_wide
from tinygc.verdict.model_tests import EFFECT, GRAVITY, NOISE, RUN, TURNS, ModelTest, contradictions, least_p, model_tests


def test_figures_are_root_mean_squares_in_degrees_and_yaw_is_of_the_turns_that_know_it():
    angles = np.array([[3.0, 4.0, 0.0], [1.0, 2.0, 6.0], [2.0, 2.0, -8.0]]) * DEG
    figures = closure_figures(angles)
    expected = {"roll_rms_deg": 14 / 3, "pitch_rms_deg": 24 / 3, "tilt_rms_deg": 38 / 3, "yaw_rms_deg": 50.0}
    assert figures == pytest.approx({name: np.sqrt(square) for name, square in expected.items()})
    assert closure_figures(angles[:, :2])["yaw_rms_deg"] is closure_figures(angles * [1, 1, 0])["yaw_rms_deg"] is None
    assert run_figures(angles[1]) == pytest.approx({"roll_deg": 1.0, "pitch_deg": 2.0, "yaw_deg": 6.0, "rmse_deg": np.sqrt(41 / 3)})


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
        assert (against.worse, against.failed, bool(against.words)) == (worse, failed and enough, bool(worse))
        assert [against.condemns(tilt) for tilt in (1.0, 1.0001)] == [False, enough]
        assert [table_of(against)[key] for key in ("worse", "passed")] == [list(worse), not (failed and enough)]


@pytest.mark.parametrize(
    ("mine", "raw", "segments", "worse"),
    [(1.1, 1.0, 13, True), (1.0, 1.0, 13, False), (1.1, 1.0, 12, False), (None, 1.0, 13, True), (1.0, None, 13, False)],
)
def test_a_file_says_whether_its_method_is_worse_than_raw(mine, raw, segments, worse):
    table = {"methods": {"pso": {"holdout": {"tilt_rms_deg": mine}}}, "against_raw": {"tilt_rms_deg": raw}, "segments": {"used": segments}}
    assert worse_in_table(table, "pso") == ((mine or np.inf, raw) if worse else None)
    for other, method in ((table, "tinygc"), ({**table, "methods": {}}, "pso"), ({**table, "against_raw": {}}, "tinygc")):
        assert worse_in_table(other, method) is None


def used(tilts, segments=40, numbers=None):
    """Each method closes all segments alike but for a part in ten thousand, so that Wilcoxon's p is a power of two."""
    parameters = {"raw": 0, "least_squares": 12, "tinygc": 27, "tinygc_denoised": 195, "physics": 15}
    shape, model = np.linspace(1, 1.0001, segments)[:, None] * [0.6, 0.8], SimpleNamespace(undone=())
    fits = {name: SimpleNamespace(held_out=tilt * DEG * shape, parameters=parameters[name], model=model) for name, tilt in tilts.items()}
    held = {name: closure_figures(fit.held_out)["tilt_rms_deg"] for name, fit in fits.items()}
    return model_to_use(fits, AgainstRaw("raw", 5.0, held, segments), numbers or {name: list(range(segments)) for name in fits})


@pytest.mark.parametrize(
    ("tilts", "segments", "method", "best", "p"),
    [
        ({"tinygc": 0.9901, "least_squares": 1.0}, 40, "least_squares", "tinygc", None),
        ({"tinygc": 0.9899, "least_squares": 1.0}, 40, "tinygc", "tinygc", 2.0**-40),
        # the sigma of a root mean square of 80 angles is 0.0791 of it
        ({"tinygc_denoised": 0.922, "least_squares": 1.0}, 40, "least_squares", "tinygc_denoised", None),
        ({"tinygc_denoised": 0.920, "least_squares": 1.0}, 40, "tinygc_denoised", "tinygc_denoised", 2.0**-40),
        ({"tinygc": 0.5, "least_squares": 1.0}, 5, "tinygc", "tinygc", 1 / 32),
        ({"tinygc": 0.5, "least_squares": 1.0}, 4, "least_squares", "tinygc", 1 / 16),
        ({"tinygc": 0.5, "physics": 1.0, "least_squares": 1.0}, 5, "least_squares", "tinygc", 1 / 32),
        ({"tinygc": 0.5, "physics": 1.0, "least_squares": 1.0}, 6, "tinygc", "tinygc", 1 / 64),
        ({"tinygc": 0.695, "physics": 0.7, "least_squares": 1.0}, 40, "physics", "tinygc", 2.0**-40),
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


def test_models_are_compared_on_the_segments_that_both_have():
    numbers = {"least_squares": [0, 1, 2, 3, 4, 5], "tinygc": [9, 1, 2, 3, 4, 5]}
    assert used({"least_squares": 1.0, "tinygc": 0.5}, 6, numbers=numbers).p_value == pytest.approx(1 / 32)
    numbers["tinygc"] = [10, 11, 12, 13, 14, 15]
    assert used({"least_squares": 1.0, "tinygc": 0.5}, 6, numbers=numbers).method == "least_squares"
    assert used({"raw": 0.1}).why == "nothing was fitted"
    assert used({"least_squares": 1.0}).why.endswith("the only one fitted")
    assert "within 1 % of the best" in used({"least_squares": 1.0, "tinygc": 0.995}).why


def judged(times=1.0, segments=40, **known):
    figures = {"angles": np.full((segments, 2), times * 1e-3 / np.sqrt(2)), "numbers": list(range(segments)), "vector": np.zeros(12)}
    figures |= {"floor_rms": 1e-3, "closure_p": 0.5, "closure_freedom": 68, "run_errors": [], "run_p": [], "run_losses": []}
    return CandidateFit(**figures | known)


SHEET = Promise(5.0, 10.0, "an X1's data sheet")


def run(error=1e-3, p=0.5):
    return {"run_errors": [np.full(3, error)], "run_p": [p], "run_losses": [""]}


@pytest.mark.parametrize(
    ("known", "limit_deg", "answer"),
    [
        ({}, None, "pass"),
        ({"closure_p": 0.0100}, None, "pass"),
        ({"closure_p": 0.0099}, None, "fail"),
        (run(p=0.0099), None, "fail"),
        ({"angles": np.full((40, 2), [2.0, 0.0]), "floor_rms": 1.0}, None, "pass"),
        ({"times": 2.0001}, None, "not decided"),
        ({"segments": 12}, None, "not decided"),
        ({"angles": np.full((40, 2), [2.0, 0.0]), "floor_rms": 1.0}, 2.0 / DEG, "pass"),
        ({}, 0.9999e-3 / DEG, "fail"),
        (run(error=2.001e-3), 2e-3 / DEG, "fail"),
        ({"closure_p": 1e-9}, 1.0, "pass"),
        ({"segments": 12}, 1.0, "doubtful pass"),
        ({"times": 2.0001}, 1.0, "doubtful pass"),
    ],
)
def test_each_rule_holds_up_to_its_limit(known, limit_deg, answer):
    found = decide(judged(**known), ["closure0001.csv"] * len(known.get("run_p", [])), limit_deg, promise=SHEET)
    assert found.answer == answer
    assert found.by_limit == (limit_deg is not None)
    assert len(found.conformities) == (0 if limit_deg is None else 1 + len(known.get("run_p", [])))
    assert all(met for met, _ in found.reasons) == (answer != "fail")
    table = found.to_json()
    assert (table["answer"], table["limit_deg"]) == (answer, pytest.approx(20 / DEG if limit_deg is None else limit_deg))
    assert table["limit_from"] == (f"twice {SHEET.source}" if limit_deg is None else GIVEN)


@pytest.mark.parametrize(
    ("sheet", "answer", "says"),
    [
        (Promise(5.0, 0.501e-3, "an X1's data sheet"), "pass", "PASS: held-out turns close to 0.0573° (limit 0.057°)"),
        (
            Promise(5.0, 0.499e-3, "an X1's data sheet", "this unit has 9 mdps/√Hz, 5 there"),
            "not decided",
            "NOT DECIDED: held-out turns close to 0.0573°, limit 0.057°; this unit has 9 mdps/√Hz, 5 there",
        ),
        (Promise(5.0), "no limit", "DOWN TO NOISE: held-out turns close to 0.0573° (noise 0.0573°)"),
    ],
)
def test_without_a_limit_it_is_twice_what_the_data_sheet_promises(sheet, answer, says):
    found = decide(judged(), [], None, promise=sheet)
    assert (found.answer, found.headline, "PASS needs a limit: --sensor NAME" in found.rule) == (answer, says, answer == "no limit")
    assert decide(judged(), [], 0.06, promise=sheet).answer == "pass"  # a limit that is given decides
    noisy = decide(judged(), [], None, promise=replace(sheet, tilt_rms=1.0, noisier="9 mdps/√Hz, 5 there"))
    assert (noisy.answer, noisy.doubts) == ("not decided", [f"noisier than {sheet.source}: 9 mdps/√Hz, 5 there"])


@pytest.mark.parametrize(("name", "limit", "answer"), [
    (TURNS, None, "pass"), (TURNS, 1.0, "not decided"), (RUN, None, "pass"), (RUN, 1.0, "not decided"),
    (NOISE, None, "not decided"), (NOISE, 1.0, "not decided"), (EFFECT, 1.0, "not decided"), (GRAVITY, None, "not decided"),
])  # fmt: skip
def test_what_contradicts_the_model_never_passes(name, limit, answer):
    """Without a limit the p-values of turns and runs are reasons by themselves."""
    for p, expected in ((0.0099, answer), (0.5 if name == EFFECT else 0.0100, "pass")):
        found = decide(judged(**run()), ["c.csv"], limit, tests=[ModelTest(name, p, 0.01, "it does")], promise=SHEET)
        assert (found.answer, found.unsound) == (expected, ["it does"] * (expected == "not decided"))
        assert [test["contradicts"] for test in found.to_json()["tests"]] == [p < 0.01]
    assert decide(judged(), [], 0.01, tests=[ModelTest(name, 0.0, 0.01, "it does")]).answer == "fail"


@pytest.mark.parametrize("limit", [None, 1.0])
def test_an_effect_that_is_more_probable_than_not_is_no_pass_and_no_contradiction(limit):
    found = decide(judged(), [], limit, tests=[ModelTest(EFFECT, 0.499, 0.05, "it may be")], promise=SHEET)
    assert (found.answer, found.undecided, found.unsound) == ("not decided", ["it may be"], ["it may be"])
    assert not found.to_json()["tests"][0]["contradicts"]


@pytest.mark.parametrize(
    ("unobserved", "doubts"), [((), []), (ACCELEROMETER[:2], [", ".join(ACCELEROMETER[:2])]), (ACCELEROMETER, ["all of its numbers"])]
)
def test_what_an_accelerometer_does_not_show_is_in_doubt(unobserved, doubts):
    found = decide(judged(), [], 1.0, None, AccelerometerFit("fit", Accelerometer(), unobserved=unobserved))
    assert [doubt.removeprefix("accelerometer: not observed: ").partition(";")[0] for doubt in found.doubts] == doubts


def test_a_calibration_that_an_effect_may_have_moved_too_far_is_in_doubt():
    raw = AgainstRaw("raw", 0.5, {})
    for limit_deg, than in ((0.2, "more than the limit"), (None, "more than what the raw rates leave")):
        most = (limit_deg or 0.5) * DEG
        assert too_wide(most * (1 - 1e-9), limit_deg, raw) == too_wide(DEG, limit_deg and 1.0, AgainstRaw("raw", 1.0, {})) == []
        (doubt,) = too_wide(most * (1 + 1e-9), limit_deg, raw)
        assert doubt.endswith(than)
    assert [len(too_good(1 - left)) for left in (0.99e-4, 1.01e-4)] == [1, 0]


@pytest.mark.parametrize(
    ("gain", "sigma", "refused"),
    [(1.25 + 0.0299, 0.01, False), (1.25 + 0.0301, 0.01, True), (0.8 - 0.0299, 0.01, False), (0.8 - 0.0301, 0.01, True),
     (-1.0, 1e-9, False)],
)  # fmt: skip
def test_no_gyroscope_has_such_a_scale(gain, sigma, refused, tmp_path):
    """Along a slanted direction, whose sigma by the covariance of E is ``sigma``: three of them beyond a quarter."""
    along = np.array([2.0, -1.0, 2.0]) / 3
    model = LinearModel(np.eye(3) + (gain - 1) * np.outer(along, along), np.zeros(3))
    slope = np.kron(along, along)
    covariance = block_diag(1e-18 * np.eye(9) + sigma**2 * np.outer(slope, slope), np.eye(3))
    if not refused:
        return require_plausible(model, covariance, tmp_path)
    with pytest.raises(FitError, match="no gyroscope has this calibration: it multiplies rates about"):
        require_plausible(model, covariance, tmp_path)
    with pytest.raises(FitError):
        require_plausible(LinearModel(np.eye(3), np.zeros(3)), np.full((12, 12), np.nan), tmp_path)


def test_a_run_is_judged_by_noise_parameters_heading_and_drift():
    """Chi-square of three errors, with every part of their covariance added up by hand."""
    rng = np.random.default_rng(0)
    slopes, vector, root = rng.normal(size=(3, 12)), rng.normal(size=12), 0.01 * rng.normal(size=(12, 12))
    covariance, heading = root @ root.T, np.diag([1e-4, 4e-4, 0.0])
    closures = [SimpleNamespace(path=SimpleNamespace(name=name)) for name in ("a.csv", "b.csv")]
    session = SimpleNamespace(closures=closures, nominal_rate=None, clock=None, rate_of=lambda log: 208.0 if log is closures[0] else None)
    problem = SimpleNamespace(
        session=session,
        middle_s=np.array([10.0, 50.0, 90.0]),
        batch=SimpleNamespace(duration_s=np.array([3.0, 5.0, 4.0])),
        instability=SimpleNamespace(rps=0.02),
    )
    floor, off = np.array([0.01, 0.02, 0.03]), np.array([0.04, -0.05, 0.03])
    run = SimpleNamespace(file="a.csv", floor_rad=floor, heading_covariance=heading, time_known=True, began_s=200.0, duration_s=60.0)
    runs = [run, SimpleNamespace(**vars(run) | {"file": "b.csv", "time_known": False})]
    W = wander_covariance(np.array([230.0, 10.0, 50.0, 90.0]), np.array([60.0, 3.0, 5.0, 4.0]), instability_rps=0.02)
    drift = W[0, 0] - 2 * W[0, 1:].mean() + W[1:, 1:].mean()
    assert drift > 1e-5

    def p(known, error=off):
        whole = np.diag(floor**2) + heading + slopes @ known @ slopes.T + drift * slopes[:, 9:] @ slopes[:, 9:].T
        return stats.chi2.sf(error @ np.linalg.solve(whole, error), 3)

    given = (vector, covariance, lambda trial, run: slopes @ (trial - vector) + off)
    assert run_p_values(problem, runs, *given) == pytest.approx([p(covariance)] * 2, rel=1e-6)
    spread = Spread.of(ZERO, [0.01, 0.02, 0.03], "given")
    other = covariance + np.diag(np.r_[np.zeros(9), 2e-4, 8e-4, 18e-4])
    assert run_p_values(problem, runs, *given, spread) == pytest.approx([p(covariance), p(other)], rel=1e-6)
    session.nominal_rate = session.clock = NominalRate(208.0, 0.003, "")
    counted = covariance - 9e-6 * np.outer(vector, vector)
    assert run_p_values(problem, runs, *given) == pytest.approx([p(counted), p(covariance)], rel=1e-6)
    session.nominal_rate = session.clock = None
    left = [3 * off, -off[::-1]]
    assert run_p_values(problem, runs, *given, left=left) == pytest.approx([p(covariance, each) for each in left], rel=1e-6)


def test_the_largest_movement_by_one_effect_is_stated():
    one, two, tilts = np.zeros((12, 12)), 1e-8 * np.diag([1.0, 0, 0, 0, 1] + [0] * 7), np.zeros((2, 2, 12))
    one[0, 0], one[9, 9], tilts[:, :, 0] = 4e-8, (0.1 * DEG) ** 2, [[1.0, 2.0], [3.0, 4.0]]
    found = Systematic({"one": one, "two": two}, tilts)
    assert found.tilt_rms == pytest.approx(2e-4 * np.sqrt(30 / 2))
    assert found.sigma[[0, 4, 9]] == pytest.approx([2e-4, 1e-4, 0.1 * DEG])
    assert [found.to_json()["effects"][i] for i in (0, 4, 9)] == ["one", "two", "one"]


def test_it_is_the_second_moment_of_the_joint_normal_distribution():
    """Calibration and effect estimated together, theta's part taken out; a scanned shape is the mean weighed by the residuals' density."""
    a, step = replace(effect("a", 2, plausible=0.7), inputs=("time",)), stepped("step", np.array([1.0, 2.0, 3.0]))
    variants = [step.at(at) for at in (1.0, 2.0, 3.0)]
    twin = linear_twin(seed=6)
    twin.spoil(a, [0.5, -0.3])
    twin.spoil(variants[1], [0.4])
    covariance, response = np.diag(np.linspace(0.5, 2.0, twin.n)), np.random.default_rng(1).normal(size=(12, twin.n))
    noise = SimpleNamespace(
        twin=twin, covariance=covariance, first=np.eye(twin.n), gain_of=lambda columns: columns.shape[1] + columns[0, 0] - 60.0
    )
    with (
        patch.object(systematic, "candidates", lambda twin: [a, *variants]),
        patch.object(systematic, "stated_response", lambda problem, model: response),
    ):
        found = systematic_of(None, None, noise, 1.7)
        with patch.object(systematic, "MOST_WEIGHED", 0):
            by_columns = systematic_of(None, None, noise, 1.7)
    J = twin.calibration * np.where(np.arange(15) // 2 == 6, 0.0, PRIORS)

    def moments(each):
        prior, own = each.parameter.plausible, twin.columns_of(each)
        both = np.column_stack([J, own * prior])
        joint = np.linalg.inv(both.T @ np.linalg.solve(1.7 * covariance, both) + np.eye(both.shape[1]))
        theta = prior * (joint @ -(both.T @ np.linalg.solve(1.7 * covariance, twin.recorded)))[15:]
        square = response @ own @ (prior**2 * joint[15:, 15:] + np.outer(theta, theta)) @ own.T @ response.T
        return square, stats.multivariate_normal(np.zeros(twin.n), 1.7 * covariance + both @ both.T).logpdf(twin.recorded)

    assert_allclose(found.by_effect["test.a"], moments(a)[0], rtol=1e-6)
    squares, log_p = zip(*map(moments, variants), strict=True)
    expected = np.average(squares, axis=0, weights=np.exp(np.array(log_p) - max(log_p)))
    assert_allclose(found.by_effect["test.step"], expected, rtol=1e-6)
    assert_allclose(found.tilts, twin.linear_columns(None).closure[:, :2])
    moved, sigma = np.sqrt(np.diag(moments(a)[0]))[:9], np.sqrt(1.7 * np.diag(response @ covariance @ response.T))[:9]
    for least in (0.999, 1.001):  # of the zero alone: no number of E is moved by more of its sigmas
        with (
            patch.object(systematic, "candidates", lambda twin: [a, *variants]),
            patch.object(systematic, "stated_response", lambda problem, model: response),
            patch.object(systematic, "HARMLESS", least * (moved / sigma).max()),
        ):
            assert systematic_of(None, None, noise, 1.7).of_zero == ({"test.a"} if least > 1 else set())
    # By linear columns what each promises; with the noise estimated again half of the gain, whatever was promised, less the logarithms of
    # ten scales and of three shapes, and a half for each number.
    factor = np.linalg.cholesky(1.7 * covariance)
    white = np.linalg.solve(factor, np.column_stack([twin.columns_of(each) for each in (a, *variants)] + [twin.recorded]))
    promised = _promises([a, *variants], np.array([0, 2, 3, 4, 5]), *_left_of(np.linalg.solve(factor, J), white))
    assert by_columns.log_odds == pytest.approx({name: promise / 2 for name, (promise, _) in promised.items()})
    of = {each.id: each.parameter.plausible * twin.columns_of(each)[0, 0] / 2 for each in (a, variants[1])}
    expected = {"test.a": of["test.a"] - 30.0 - np.log(10.0), "test.step": of["test.step"] - 30.0 - np.log(30.0)}
    assert {name: found.log_odds[name] for name in expected} == pytest.approx(expected)


def test_the_likeliest_effects_gain_most_less_what_their_scale_shapes_and_numbers_cost():
    """A ridge regression of what the calibration leaves; of an effect's shapes the best."""
    rng, step = np.random.default_rng(9), stepped("step", np.array([1.0, 2.0]))
    effects = [effect("a", 2, plausible=0.2), effect("b", 1, plausible=0.3), effect("c", 1, plausible=2.0)]
    effects += [effect("d", 1, plausible=0.05), step.at(1.0), step.at(2.0)]
    edges = np.cumsum([0, *(each.parameter.size for each in effects)])
    white = rng.normal(size=(30, edges[-1] + 1))
    white[:, -1] = 3 * white[:, -1] + white[:, :-1] @ rng.normal(size=edges[-1])
    J = rng.normal(size=(30, 4))

    def square(columns, prior):
        both = np.column_stack([J, columns * prior])
        return white[:, -1] @ np.linalg.solve(np.eye(30) + both @ both.T, white[:, -1])

    promise = {}
    for number, (each, begin) in enumerate(zip(effects, edges[:-1], strict=True)):
        size = each.parameter.size
        gain = square(white[:, :0], 1.0) - square(white[:, begin : begin + size], each.parameter.plausible)
        cost = 2 * np.log(10.0) + 2 * np.log(1 + (number > 3)) + size
        found = gain - size * np.log(max(gain / size, 1.0)) - cost
        promise[each.id] = max(promise.get(each.id, (-np.inf, 0)), (found, number))
    found = _promises(effects, edges, *_left_of(J, white))
    assert {name: number for name, (_, number) in found.items()} == {name: number for name, (_, number) in promise.items()}
    assert [found[name][0] for name in promise] == pytest.approx([each for each, _ in promise.values()])
    assert MOST_WEIGHED == 3


MDPS = 1e-3 * DEG
FINE = GoodnessOfFit(60.0, 60, 0.5)


def noise(p):
    return SimpleNamespace(unusual_p=p, noise=SimpleNamespace(beyond_words="each turn 2 deg, where 1 deg is usual"))


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
    assert "b.csv: p = 0.0" in model_tests(FINE, {"b.csv": p}, None, None, None)[1].description
    assert ("differ by more than such" in model_tests(FINE, {}, noise(p), None, None)[1].description) == contradicted


def test_the_probability_that_no_effect_is_missing_is_a_p_value_where_it_decides():
    """With even odds it is 0.5, below the p of the turns; with odds of 571 to 1 and prior odds of 1 to 30 it is the least."""
    turns = GoodnessOfFit(60.0, 60, 0.7)
    assert least_p(model_tests(turns, {}, None, odds(np.log(30)), None)) == [0.7]
    assert least_p(model_tests(turns, {}, None, odds(np.log(571)), None)) == pytest.approx([30 / (30 + 571)])
    assert least_p(()) == []


def test_an_effect_contradicts_where_it_is_there_with_95_percent():
    """With prior odds of 1 to 30, odds of 570."""
    tests = [model_tests(FINE, {}, None, odds(np.log(each)), None) for each in (571, 569, 31, 29)]
    (found,) = contradictions(tests[0])
    assert (found.name, found.description) == (EFFECT, "an effect is probably missing: gyro.bias_drift")
    assert contradictions(tests[1]) == []
    # From there to even odds, 30 to 1 with the prior ones, it is open, as names of explain are more probable than not.
    assert [each[1].leaves_open for each in tests] == [False, True, True, False]
    assert not ModelTest(TURNS, 0.2, 0.01, "").leaves_open


def test_the_earths_rotation_is_reported_in_plain_words_where_the_latitude_is_not_known():
    earth = odds(0.0, **{"earth.rotation": np.log(571)})
    for latitude_deg, text in (
        (None, "the Earth's rotation shows; give your latitude"),
        (48.0, "an effect is probably missing: earth.rotation"),
    ):
        (found,) = contradictions(model_tests(FINE, {}, None, earth, None, latitude_deg))
        assert (found.name, found.description) == (EFFECT, text)


def test_effects_that_are_not_told_apart_count_together():
    """Sixteen, thirteen and two to one, of which none is even with the prior odds; one within exp(3) of the best is the last to count."""
    alike = odds(np.log(16), step=np.log(13), warmth=np.log(2), far=np.log(0.79), against=-0.1)
    assert alike.likeliest == alike.suspected == ["gyro.bias_drift", "step", "warmth"]
    assert model_tests(FINE, {}, None, alike, None)[1].p_value == pytest.approx(30 / 61)
    assert odds(np.log(400), near=np.log(20), far=np.log(19.9)).likeliest == ["gyro.bias_drift", "near"]
    fewer = odds(np.log(16), step=np.log(10), warmth=np.log(3.9))
    assert (fewer.suspected, model_tests(FINE, {}, None, fewer, None)[1].leaves_open) == ([], False)
    assert odds(-0.5).log_odds_of_any == -0.5


def test_a_drift_of_the_zero_that_the_noise_has_taken_up_contradicts_nothing():
    """Odds of 3000 to one, and of 200 to one for an effect that may move scale and axes: a sixteenth of all."""
    among = replace(odds(np.log(3000), step=np.log(200)), of_zero=frozenset({"gyro.bias_drift"}))
    alone = replace(odds(np.log(3000)), of_zero=frozenset({"gyro.bias_drift"}))
    found = [model_tests(FINE, {}, None, each, None)[1] for each in (among, alone)]
    none = [30 / 3230, 30 / 3030]
    assert [each.p_value for each in found] == pytest.approx([none[0] + (1 - none[0]) * 3000 / 3200, 1.0])
    assert not any(each.contradicts or each.leaves_open for each in found)
    assert found[1].description.startswith("the zero drifts (gyro.bias_drift); no effect on scale or axes is probable")


@pytest.mark.parametrize(
    ("mode", "p", "tested", "contradicted"),
    [("prior", 0.99e-4, 1, 1), ("given", 0.99e-4, 1, 1), ("prior", 1.01e-4, 1, 0), ("prior", None, 0, 0), ("fit", 1e-9, 0, 0)],
)
def test_a_given_calibration_of_the_accelerometer_is_tested_where_it_is_in_use(mode, p, tested, contradicted):
    found = model_tests(FINE, {}, None, None, SimpleNamespace(mode=mode, p_value=p))[1:]
    assert (len(found), len(contradictions(found))) == (tested, contradicted)
    assert all(test.name == GRAVITY for test in found)


def problem(noise_mdps=None, dph=None, unit_mdps=7.1):
    """Three turns of 4, 5 and 9 s beside an accelerometer twice as noisy as its data sheet says."""
    figures = {"gyro_noise_mdps_rthz": 5.0, "accel_noise_ug_rthz": 60.0, "gyro_bias_instability_dph": 3.0}
    typical = lambda name: ("ASM330LHH", figures[name])  # noqa: E731
    sensor = SimpleNamespace(gyro_noise_mdps_rthz=noise_mdps, gyro_bias_instability_dph=dph, typical=typical)
    part = lambda variance: SimpleNamespace(own=np.tile(np.diag([variance, 2 * variance, 7.0]), (3, 1, 1)))  # noqa: E731
    parts = {"white noise of the gyroscope": part(1.0), "white noise of the accelerometer": part(4e-8), "truth file": part(1e-8)}
    return SimpleNamespace(
        session=SimpleNamespace(config=SimpleNamespace(sensor=sensor, model_given=True)),
        batch=SimpleNamespace(duration_s=np.array([4.0, 5.0, 9.0])),
        middle_s=np.array([10.0, 20.0, 40.0]),
        used=[0, 1, 2],
        floor=SimpleNamespace(parts=parts | {"bridged readings and impacts": part(3.0), "rounding and jitter of the stamps": part(5.0)}),
        noise=SimpleNamespace(gyro=np.full(3, unit_mdps * MDPS), accel=np.full(3, 120e-6 * 1e3 * MG)),
    )


@pytest.mark.parametrize(("noise_mdps", "dph"), [(8.0, None), (None, 12.0)])
def test_a_data_sheet_promises_noise_drift_and_references(noise_mdps, dph):
    """N^2 T of both axes, B about its mean over the session, a quarter of the measured noise of the accelerometer, and the truth's."""
    found = promise_of(problem(noise_mdps, dph))
    seconds, about_mean = np.array([4.0, 5.0, 9.0]), np.eye(3) - 1 / 3
    wander = wander_covariance(np.array([10.0, 20.0, 40.0]), instability_rps=(dph or 3.0) * DEG_PER_HOUR)
    drift = np.diag(about_mean @ wander @ about_mean)
    variance = ((noise_mdps or 5.0) * MDPS) ** 2 * seconds + 2 * seconds**2 * drift + 3 * 4e-8 / 4 + 3 * 1e-8
    assert found.tilt_rms == pytest.approx(np.sqrt(np.mean(variance)))
    assert found.turn_s == 5.0
    assert found.source == ("the noise in session.toml" if noise_mdps else "an ASM330LHH's data sheet")
    assert found.noisier == ("" if noise_mdps else "this unit has 7.1 mdps/√Hz of noise, its data sheet 5")
    assert promise_of(problem(unit_mdps=6.9)).noisier == ""  # units differ by 1.4
