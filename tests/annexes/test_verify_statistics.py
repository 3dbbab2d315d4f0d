"""Each term of ``verify``'s statistics, against linear algebra and SciPy's distributions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from verify_rows import made_rows, part

from session.detect import accelerometer
from session.io.units import DEG, MG
from tinygc.annexes.verification import causes, questions
from tinygc.annexes.verification import rows as rows_module
from tinygc.annexes.verification.causes import Cause, Evidence, diagnose
from tinygc.annexes.verification.cost import BOUND, bounds, cost_of, left_open
from tinygc.annexes.verification.expected import ZERO
from tinygc.annexes.verification.old import ACCELEROMETER, COUNT, GYROSCOPE, variance_and_freedom
from tinygc.annexes.verification.questions import (
    DRAWS,
    PLAUSIBLE,
    B,
    E,
    NoisePart,
    Question,
    TodaysNoise,
    ask,
    by_freedom,
    by_size,
    level_of,
    tail,
    todays_noise,
)
from tinygc.annexes.verification.rows import CLOSURE, LENGTH, STILL
from tinygc.attitude import rotation
from tinygc.estimation.expected_zero import USUAL_SPREAD
from tinygc.estimation.systematic import PRIOR_ODDS
from tinygc.models.linear import MATRIX, LinearModel
from tinygc.noise.components import TURN, Component
from tinygc.noise.reml import ComponentEstimate

OLD = SimpleNamespace(accelerometer=object(), goodness=None, noise={}, linear=LinearModel(np.eye(3), np.zeros(3)))
MATRIX_OF_21 = np.r_[GYROSCOPE][MATRIX]


def asked(rows, parts=(), old=OLD, **more):
    return {question.name: question for question in ask(rows, parts, todays_noise(rows), old, **more)}


def test_the_levels_of_all_questions_make_the_stated_rate():
    for count in (1, 2, 4):
        assert (1 - level_of(0.05, count)) ** count == pytest.approx(0.95, rel=1e-12)


def test_a_known_covariance_has_the_tail_of_chi_square():
    assert tail(12.0, np.eye(5), []) == pytest.approx(stats.chi2.sf(12.0, 5), rel=1e-9)


def test_one_estimated_variance_has_the_tail_of_fisher():
    factors = by_freedom(4.0, 0)
    assert tail(12.0, np.zeros((3, 3)), [(np.eye(3), factors)]) == pytest.approx(stats.f.sf(4.0, 3, 4), rel=0.06)
    assert np.mean(1 / factors) == pytest.approx(1.0, rel=0.02)


def test_a_statistic_beyond_all_draws_has_the_smallest_probability_that_they_show():
    assert tail(1e9, np.zeros((2, 2)), [(np.eye(2), by_freedom(5.0, 0))]) == pytest.approx(1 / (DRAWS + 1), rel=1e-9)
    assert tail(0.0, np.zeros((2, 2)), [(np.eye(2), by_freedom(5.0, 0))]) == pytest.approx(1.0, rel=1e-9)


def test_the_printed_chi_square_has_the_printed_p():
    for rank, p in ((3, 0.05), (42, 8e-54), (1, 0.99)):
        assert stats.chi2.sf(Question(E, 1e9, rank, p, 0.0127).chi_square, rank) == pytest.approx(p, rel=1e-9)
    assert Question(E, 5e3, 3, 0.0, 0.0127).chi_square == 5e3  # below the smallest number there is
    assert Question(E, 7.8, 3, 0.05, 0.05).holds
    drawn = Question(E, 1e9, 2, tail(1e9, np.zeros((2, 2)), [(np.eye(2), by_freedom(5.0, 0))]), 0.0127)
    assert (drawn.beyond_draws, Question(E, 1e9, 2, 1e-6, 0.0127).beyond_draws) == (True, False)


def test_a_variance_that_rounding_makes_negative_is_none():
    found = tail(4.0, np.diag([-0.5, 1.0]), [(np.zeros((2, 2)), np.ones(DRAWS))])
    assert found == pytest.approx(stats.chi2.sf(4.0, 1), rel=0.05)


def test_half_an_estimated_variance_lies_between_both():
    found = tail(9.0, 0.5 * np.eye(3), [(0.5 * np.eye(3), by_freedom(4.0, 0))])
    assert stats.chi2.sf(9.0, 3) < found < stats.f.sf(3.0, 3, 4)


def test_a_component_of_the_noise_varies_with_its_size():
    factors = by_size(2.0, 0.1, 0)
    assert len(factors) == DRAWS
    assert np.mean(factors) == pytest.approx(4.01, rel=2e-3)
    assert np.std(np.sqrt(factors)) == pytest.approx(0.1, rel=0.02)
    assert by_size(0.0, 1.0, 0).min() == 0.0


def gls(rows, which, free, keep, S):
    """T of a change of ``which`` beside free ones, from the normal equations."""
    A = rows.parameters[np.ix_(keep, np.r_[which, free])] * PLAUSIBLE[np.r_[which, free]]
    inverse = np.linalg.inv(S[np.ix_(keep, keep)])
    covariance = np.linalg.inv(A.T @ inverse @ A)
    found = -covariance @ A.T @ inverse @ rows.r[keep]
    k = len(which)
    return found[:k] @ np.linalg.solve(covariance[:k, :k], found[:k]), k


def test_e_is_asked_with_zero_and_accelerometer_free():
    rows = made_rows(1)
    expected, k = gls(rows, MATRIX_OF_21, np.r_[ZERO, ACCELEROMETER], np.arange(len(rows.r)), rows.white)
    found = asked(rows)[E]
    assert (found.statistic, found.rank) == (pytest.approx(expected, rel=1e-6), k)
    assert found.p_value == pytest.approx(stats.chi2.sf(expected, k), rel=1e-6)


def test_no_other_change_touches_the_question_of_e():
    change = np.zeros(COUNT)
    change[ZERO], change[ACCELEROMETER] = [3, -5, 8], 0.7
    assert asked(made_rows(2, change))[E].statistic == pytest.approx(asked(made_rows(2))[E].statistic, rel=1e-6)
    change[:] = 0
    change[MATRIX_OF_21[4]] = 0.3
    assert asked(made_rows(2, change))[E].p_value < 1e-6


def test_the_zero_is_asked_of_the_rates_at_rest_with_its_expected_spread():
    rows = made_rows(3)
    spread = part(rows, np.r_[ZERO], np.full(3, 0.5 * DEG))
    still = np.arange(len(rows.r))[rows.kinds[STILL]]
    loose = rows.parameters[:, MATRIX_OF_21] * PLAUSIBLE[MATRIX_OF_21]
    S = rows.white + spread.columns @ spread.columns.T + loose @ loose.T
    expected, k = gls(rows, np.r_[ZERO], np.zeros(0, dtype=int), still, S)
    found = asked(rows, [spread])[B]
    assert (found.statistic, found.rank) == (pytest.approx(expected, rel=1e-6), k)
    rows.r[rows.kinds[CLOSURE]] += 100.0  # closures are of no matter
    assert asked(rows, [spread])[B].statistic == pytest.approx(expected, rel=1e-6)


def test_a_change_as_large_as_the_spread_is_no_alarm():
    change = np.zeros(COUNT)
    change[ZERO] = [0.5, -0.4, 0.3]
    rows = made_rows(4, change)
    assert asked(rows)[B].p_value < 1e-9
    assert asked(rows, [part(rows, np.r_[ZERO], np.full(3, 0.5 * DEG))])[B].holds


def test_what_is_left_follows_chi_square_and_the_old_fits_own_excess():
    rows = made_rows(5, noise=2.0)
    keep = np.arange(len(rows.r))[rows.kinds[CLOSURE]]
    A = rows.parameters[keep] * PLAUSIBLE
    left = rows.r[keep] - A @ np.linalg.lstsq(A, rows.r[keep], rcond=None)[0]
    chi_square, freedom = float(np.sum(left**2)) / 0.25, len(keep) - COUNT
    found = asked(replace(rows, spans_s=np.full(len(rows.r), 4.0)))["noise"]
    assert (found.statistic, found.rank) == (pytest.approx(chi_square, rel=1e-6), freedom)
    assert found.left_rps == pytest.approx(np.sqrt(np.sum(left**2) / freedom) / 4)
    assert found.p_value == pytest.approx(stats.f.sf(chi_square / freedom, freedom, 1e6), rel=1e-4)
    before = SimpleNamespace(accelerometer=object(), goodness=(400.0, 100), noise={})
    for own in (50.0, 1e6):
        both, rows = 1 / (1 / own + 1 / 100), replace(rows, noise_freedom=own)
        assert asked(rows, old=before)["noise"].p_value == pytest.approx(stats.f.sf(chi_square / freedom / 4, freedom, both), rel=1e-4)
    nearly = SimpleNamespace(accelerometer=object(), goodness=(150.0, 100), noise={})  # any excess of the old fit counts
    assert asked(rows, old=nearly)["noise"].p_value == pytest.approx(stats.f.sf(chi_square / freedom / 1.5, freedom, both), rel=1e-4)
    few = SimpleNamespace(accelerometer=object(), goodness=(4.0, 1), noise={})
    one = 1 / (1 / 1e6 + 1)
    assert asked(rows, old=few)["noise"].p_value == pytest.approx(stats.f.sf(chi_square / freedom / 4, freedom, one), rel=1e-4)
    calm = SimpleNamespace(accelerometer=object(), goodness=(50.0, 100), noise={})  # less than noise is no yardstick
    none = SimpleNamespace(accelerometer=object(), goodness=(0.0, 0), noise={})
    for old in (calm, none):
        assert asked(rows, old=old)["noise"].p_value == pytest.approx(found.p_value, rel=1e-6)
    nothing = asked(replace(rows, blank=np.ones(len(rows.r), bool)))["noise"]
    assert (nothing.statistic, nothing.rank, nothing.p_value, nothing.left_rps) == (0.0, 0, 1.0, 0.0)


def test_without_turns_the_rates_at_rest_are_asked_with_a_plausible_e_and_what_is_known():
    """Beside any change of the zero and the accelerometer, which here is alone in the lengths."""
    rows = made_rows(5, with_turns=False)
    rows.parameters[:, ACCELEROMETER][: rows.kinds[LENGTH].start] = 0.0
    rows = replace(rows, known=np.random.default_rng(2).normal(size=(54, 2)))
    keep, loose = slice(0, rows.kinds[LENGTH].start), rows.parameters[:, MATRIX_OF_21] * PLAUSIBLE[MATRIX_OF_21]
    inverse = np.linalg.inv((rows.white + rows.known @ rows.known.T + loose @ loose.T)[keep, keep])
    A, r = (rows.parameters[:, ZERO] * PLAUSIBLE[ZERO])[keep], rows.r[keep]
    left = r - A @ np.linalg.solve(A.T @ inverse @ A, A.T @ inverse @ r)
    found = asked(rows)["noise"]
    assert (found.statistic, found.rank) == (pytest.approx(left @ inverse @ left, rel=1e-6), len(r) - 3)


def single(rows, name="one", column=MATRIX_OF_21[0], size=1.0) -> Cause:
    into = np.zeros((COUNT, 1))
    into[column] = size * PLAUSIBLE[column]
    return Cause(name, name, rows.parameters @ into, into, np.array([size * PLAUSIBLE[column]]), "", 1.0, ("",), f"mend {name}")


def test_evidence_is_that_of_normal_distributions_over_all_scales():
    change = np.zeros(COUNT)
    change[MATRIX_OF_21[0]] = 0.2
    rows = made_rows(6, change)
    spread = part(rows, np.r_[ZERO], np.full(3, 0.1 * DEG))
    cause, evidence = single(rows), Evidence(rows, [spread])
    S = rows.white + spread.columns @ spread.columns.T
    X = cause.columns

    def log_p(covariance):
        return stats.multivariate_normal(cov=covariance).logpdf(rows.r)

    expected = np.log(np.mean([np.exp(log_p(S + s**2 * X @ X.T) - log_p(S)) for s in causes.STEPS])) + np.log(PRIOR_ODDS)
    assert evidence.of([cause]).log_evidence - evidence.of([]).log_evidence == pytest.approx(expected, rel=1e-9)


def test_the_estimate_beside_what_is_expected_is_that_of_least_squares():
    change = np.zeros(COUNT)
    change[MATRIX_OF_21[0]] = 0.2
    rows = made_rows(7, change, noise=1e-3)
    found = Evidence(rows, []).of([single(rows)])
    assert found.theta == pytest.approx([0.2 * PLAUSIBLE[MATRIX_OF_21[0]]], rel=1e-2)
    assert found.change[MATRIX_OF_21[0]] == pytest.approx(found.theta[0], rel=1e-12)
    assert np.sqrt(found.covariance[MATRIX_OF_21[0], MATRIX_OF_21[0]]) == pytest.approx(np.sqrt(found.theta_covariance[0, 0]), rel=1e-9)


def test_the_right_cause_is_found_and_its_double_is_not_told_apart():
    change = np.zeros(COUNT)
    change[MATRIX_OF_21[0]] = 0.2
    rows = made_rows(8, change)
    right, double, wrong = single(rows), single(rows, "double"), single(rows, "wrong", MATRIX_OF_21[5])
    found = diagnose(Evidence(rows, []), [right, wrong])
    assert found.best.names == ("one",)
    assert found.rivals == {"one": ()}
    assert found.probability > 0.9
    both = diagnose(Evidence(rows, []), [right, double, wrong])
    assert set(both.best.names) | set(both.rivals[both.best.names[0]]) == {"one", "double"}


def test_a_cause_that_was_sought_at_many_times_pays_for_them_alone_and_beside_others():
    change = np.zeros(COUNT)
    change[MATRIX_OF_21[0]], change[ACCELEROMETER.start] = 0.2, 0.3
    rows = made_rows(8, change)
    right, two = single(rows), single(rows, "two", ACCELEROMETER.start)
    useless = [single(rows, "one", column) for column in MATRIX_OF_21[[3, 5, 7]]]
    once, often = (diagnose(Evidence(rows, []), causes) for causes in ([right, two], [*useless, right, two]))
    assert once.alone["one"] - often.alone["one"] == pytest.approx(np.log(4), rel=1e-3)
    assert set(often.best.names) == {"one", "two"}
    assert once.best.log_evidence - often.best.log_evidence == pytest.approx(np.log(4), rel=1e-3)


def test_two_causes_are_found_together():
    change = np.zeros(COUNT)
    change[MATRIX_OF_21[0]], change[ACCELEROMETER.start] = 0.2, 0.3
    rows = made_rows(9, change)
    found = diagnose(Evidence(rows, []), [single(rows), single(rows, "two", ACCELEROMETER.start), single(rows, "three", MATRIX_OF_21[8])])
    assert set(found.best.names) == {"one", "two"}


def test_without_data_a_turn_may_miss_what_a_plausible_change_makes():
    rows = made_rows(10)
    rows.parameters[:] = 0.0
    W = left_open(rows, todays_noise(rows))
    assert pytest.approx(np.diag(PLAUSIBLE**2)) == W
    of_e, of_b, of_g = bounds(rows, OLD.linear, W, 1.0, True)
    # A turn of 2 pi about x: the end is off by 2 pi x 1 % along it, and by less across it.
    assert of_e.bound_deg == pytest.approx(BOUND * 2 * np.pi * 0.01 / DEG, rel=1e-3)
    assert of_b.bound_deg == pytest.approx(BOUND * 60 * 1.0, rel=1e-6)
    assert not of_e.is_seen
    assert of_g.bound_deg == pytest.approx(BOUND * np.hypot(0.01, 0.01) / DEG, rel=0.05)


def test_gravity_is_asked_of_where_the_old_calibration_has_an_accelerometer():
    alone = SimpleNamespace(**{**vars(OLD), "accelerometer": None})
    assert [set(asked(made_rows(), old=old)) for old in (OLD, alone)] == [{E, B, "gravity's length", "noise"}, {E, B, "noise"}]


def test_rows_of_rests_leave_e_unasked():
    rows = made_rows(11)
    rows.parameters[rows.kinds[CLOSURE]] = 0.0
    found = asked(rows)
    assert not found[E].asked
    assert found[B].asked
    assert found[B].level == pytest.approx(questions.level_of(0.05, sum(each.asked for each in found.values())))
    assert rows.kinds[LENGTH].stop == len(rows.r)


def test_a_spread_of_few_sessions_has_students_tails_on_each_axis():
    change = np.zeros(COUNT)
    change[ZERO] = [1.5, -1.0, 1.2]
    rows = made_rows(12, change, noise=0.1)
    spreads = [part(rows, [axis], np.array([0.5 * DEG]), freedom=4.0) for axis in np.r_[ZERO]]  # far above the noise
    found = asked(rows, spreads)[B]
    drawn = np.sum(np.random.default_rng(3).standard_t(4.0, (400_000, 3)) ** 2, axis=1)
    assert found.p_value == pytest.approx(np.mean(drawn >= found.statistic), rel=0.08)
    assert found.p_value > 5 * stats.chi2.sf(found.statistic, 3)


def with_component(rows, name, kind, s, sigma):
    """Noise of rows with one component beyond white, of all rows of a kind."""
    V = np.zeros((len(rows.r), len(rows.r)))
    own = rows.kinds[kind]
    V[own, own] = np.eye(own.stop - own.start)
    return TodaysNoise(rows.white + s**2 * V, (NoisePart(name, V, s, sigma),), todays_noise(rows).found, 1e6)


@pytest.mark.parametrize(("sigma", "heavier"), [(1e-6, False), (1.0, True)])
def test_noise_beyond_white_counts_with_the_uncertainty_of_its_size(sigma, heavier):
    change = np.zeros(COUNT)
    change[ZERO] = [0.012, -0.008, 0.006]
    rows = made_rows(13, change)
    noise = with_component(rows, "noise.still_rate", STILL, 1.0, sigma)
    still = np.arange(len(rows.r))[rows.kinds[STILL]]
    loose = rows.parameters[:, MATRIX_OF_21] * PLAUSIBLE[MATRIX_OF_21]
    expected, k = gls(rows, np.r_[ZERO], np.zeros(0, dtype=int), still, noise.covariance + loose @ loose.T)
    found = {question.name: question for question in ask(rows, [], noise, OLD)}[B]
    assert found.statistic == pytest.approx(expected, rel=1e-6)
    known = stats.chi2.sf(expected, k)
    assert found.p_value > 1.5 * known if heavier else found.p_value == pytest.approx(known, rel=0.05)


@pytest.mark.parametrize(("share", "drawn"), [(0.98e-3, False), (1.02e-3, True)])
def test_a_size_counts_as_known_where_it_adds_a_thousandth_at_most(share, drawn):
    """To the variance of T's three numbers together: trace of their covariance by the component."""
    rows = made_rows(13)
    still = np.arange(len(rows.r))[rows.kinds[STILL]]
    loose = rows.parameters[np.ix_(still, MATRIX_OF_21)] * PLAUSIBLE[MATRIX_OF_21]
    inverse = np.linalg.inv(rows.white[np.ix_(still, still)] + loose @ loose.T)
    X = rows.parameters[np.ix_(still, np.r_[ZERO])]
    trace = np.trace(np.linalg.solve(X.T @ inverse @ X, X.T @ inverse @ inverse @ X))
    noise = with_component(rows, "noise.still_rate", STILL, 0.0, np.sqrt(share / trace))
    found = {question.name: question for question in ask(rows, [], noise, OLD)}[B]
    assert (found.p_value != pytest.approx(stats.chi2.sf(found.statistic, 3), rel=1e-9)) == drawn


@pytest.mark.parametrize(("sigmas", "rank"), [(0.99, 0), (1.01, 1)])
def test_a_change_is_asked_about_where_a_plausible_one_shows_by_a_sigma(sigmas, rank):
    rows = made_rows()
    rows.parameters[:] = 0.0
    rows.parameters[3, MATRIX_OF_21[4]] = sigmas * 0.5 / 0.01  # 1 % of E, in a row of sigma 0.5
    found, statistic = asked(rows)[E], rank * (rows.r[3] / 0.5) ** 2
    assert (found.statistic, found.rank, found.left_rps) == (pytest.approx(statistic), rank, 0.0)
    assert found.p_value == pytest.approx(stats.chi2.sf(statistic, rank) if rank else 1.0)


def test_a_size_without_a_sigma_has_the_usual_one_or_itself(monkeypatch):
    V = np.eye(54)
    components = [Component(name, V, 0.5, "", 1.0, "") for name in "abc"]
    found = ComponentEstimate(np.array([0.2, 3.0, 3.0]), np.array([np.nan, np.inf, 0.1]), 0.0)
    monkeypatch.setattr(questions, "noise_beside", lambda *given, **more: found)
    noise = todays_noise(made_rows(components=components))
    assert [(each.s, each.sigma) for each in noise.parts] == [(0.2, 0.5), (3.0, 3.0), (3.0, 0.1)]
    assert np.diag(noise.covariance) == pytest.approx(np.full(54, 0.25 + 0.04 + 9 + 9))


def test_an_error_of_each_turn_is_no_excuse_for_what_is_left():
    rows = made_rows(14, noise=3.0)
    quiet = {question.name: question for question in ask(rows, [], todays_noise(rows), OLD)}["noise"]
    with_turn, with_other = (
        {q.name: q for q in ask(rows, [], with_component(rows, name, CLOSURE, 1.5, 0.1), OLD)}["noise"] for name in (TURN, "other")
    )
    assert with_turn.statistic == pytest.approx(quiet.statistic, rel=1e-9)
    assert with_other.statistic == pytest.approx(quiet.statistic * 0.25 / (0.25 + 1.5**2), rel=1e-6)


def test_noise_that_the_old_fit_found_has_the_freedom_of_its_estimate():
    """24 closures of variance 0.25; 18 rates at rest with 1.5^2 more, as the old fit found it, with 8 degrees of freedom."""
    rows = made_rows(16, noise=2.0)
    noise = with_component(rows, "noise.still_rate", STILL, 1.0, 0.1)
    for known in (8.0, np.inf):
        old = SimpleNamespace(**{**vars(OLD), "noise": {"noise.still_rate": (1.5**2, known)}})
        found = {question.name: question for question in ask(rows, [], noise, old)}["noise"]
        share = 18 * 1.5**2 / (0.25 + 1.5**2) / 42
        other = 1 / (1 / noise.freedom + share**2 / known)
        assert found.p_value == pytest.approx(stats.f.sf(found.statistic / found.rank, found.rank, other), rel=1e-6)


def test_degrees_of_freedom_of_a_size_with_a_sigma():
    assert variance_and_freedom(3.0, 0.3) == pytest.approx((9.09, 2 * 9.09**2 / 3.2562))
    assert variance_and_freedom(0.0, 2.0) == pytest.approx((4.0, 1.0))
    assert variance_and_freedom(2.0, 0.0) == (4.0, np.inf)


def test_the_noise_is_estimated_beside_any_change_of_the_parameters():
    V = np.zeros((54, 54))
    V[24:42, 24:42] = np.eye(18)
    components = [Component("noise.still_rate", V, 0.5, "", 1.0, "")]
    change = np.zeros(COUNT)
    change[ZERO], change[ACCELEROMETER] = [0.5, -0.4, 0.3], 0.1
    same, moved = (todays_noise(made_rows(15, each, components=components)) for each in (None, change))
    assert moved.found.s == pytest.approx(same.found.s, rel=1e-2, abs=1e-2)
    assert same.covariance == pytest.approx(made_rows(15).white + same.found.s[0] ** 2 * V)


def test_the_bars_and_sizes_are_those_of_their_reasons():
    assert stats.norm.cdf(BOUND) - stats.norm.cdf(-BOUND) == pytest.approx(0.95, abs=1e-9)
    assert pytest.approx([10 * MG] * 3) == PLAUSIBLE[ACCELEROMETER][6:]
    assert pytest.approx(3.1e-6 * 30, rel=0.1) == rows_module.SITE_MPS2  # 30 m of height
    assert pytest.approx(20 * USUAL_SPREAD.rps) == causes.ZERO_RPS  # a large one is far beyond a switch-on


def of_name(rows, name, **more):
    old = SimpleNamespace(linear=LinearModel(np.eye(3), np.array([0.01, -0.02, 0.03])), accelerometer=object())
    (found,) = [cause for cause in causes.candidate_causes(rows, old, **more) if cause.name == name][:1]
    return found


def of_session(**more):
    session = SimpleNamespace(config=SimpleNamespace(protocol=SimpleNamespace(reference="accelerometer")))
    return replace(made_rows(), session=session, **more)


def test_a_rotation_turns_b_with_e():
    found = of_name(of_session(), "rotation")
    R = rotation.matrix(rotation.exp(np.array([1e-6, 0, 0])))
    assert found.into[ZERO, 0] / found.sizes[0] * 1e-6 == pytest.approx((R - np.eye(3)) @ [0.01, -0.02, 0.03], abs=1e-12)


def test_an_accelerometer_that_reads_too_much_has_a_scale_above_zero():
    found = of_name(of_session(), "accelerometer's scale")
    assert (found.into[ACCELEROMETER][accelerometer.SCALES, [0, 1, 2]] < 0).all()  # its correction is less


def test_a_drift_counts_with_its_mean_over_the_minute():
    rows = of_session(steps_s=np.array([15.0]), duration_s=100.0)
    step = of_name(rows, "step", minute_s=60.0)
    assert np.diag(step.into[ZERO]) / -step.sizes == pytest.approx(np.full(3, 0.75))
    warm = of_name(rows, "warm-up", minute_s=60.0)
    assert np.diag(warm.into[ZERO]) / -warm.sizes == pytest.approx(np.full(3, np.mean(np.exp(-np.linspace(0, 60, 100_001) / 10))), rel=1e-3)


def test_a_direction_is_free_from_a_tenth_of_a_sigma_on():
    columns = np.diag([0.05, 0.2, 1.0])
    assert questions.seen(columns).shape == (3, 2)


def test_the_sigma_of_the_cost_is_that_of_the_slopes():
    rows, covariance = of_session(twin=None), np.zeros((COUNT, COUNT))
    covariance[ZERO, ZERO] = np.diag([1e-8, 4e-8, 9e-8])
    covariance[MATRIX_OF_21, MATRIX_OF_21] = 0.04
    rows = replace(rows, rest_rps=np.array([5e-4, 0, 0]))
    found = cost_of(rows, OLD.linear, np.zeros(COUNT), covariance, np.zeros(3), covariance[ZERO, ZERO])
    of_e = 60 * 5e-4 * 0.2  # of the x column of E
    expected = np.sqrt((60 * np.array([1e-4, 2e-4, 3e-4])) ** 2 + of_e**2)
    assert found.sigma == pytest.approx(expected, rel=0.02)
    assert found.bias_anew_sigma == pytest.approx(expected, rel=0.02)  # E's part stays with B anew
