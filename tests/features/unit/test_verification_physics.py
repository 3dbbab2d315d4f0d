"""``verify``'s statistics, expected changes and verdicts: each term against linear algebra and SciPy's distributions."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import config
from noise_records import axis, figures, sensor
from scipy import stats
from scipy.linalg import block_diag

from session.base import rotation
from session.base.units import DEG, MG, G
from session.detect import accelerometer
from tinygc import models
from tinygc.closure.floor import BiasInstability
from tinygc.effects import AppliedEffect, Conditions, effect_of
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.estimation.spread import ACCELEROMETER, COUNT, END_S, GYROSCOPE, USUAL, USUAL_PER_K, ZERO, Spread
from tinygc.features.fleet.fit import LotFile
from tinygc.features.unit.options import VerifyOptions as Options
from tinygc.features.unit.verification import verdict
from tinygc.features.unit.verification.causes import Cause, Evidence, StatedCause, beyond_linear, candidate_causes, diagnose
from tinygc.features.unit.verification.cost import _BOUND, Bound, Cost, bound_deg, cost_of, left_open, uses
from tinygc.features.unit.verification.questions import (
    DRAWS,
    GRAVITY,
    NOISE,
    PLAUSIBLE,
    B,
    E,
    ExpectedPart,
    Question,
    ask,
    expected_parts,
    todays_noise,
)
from tinygc.features.unit.verification.rows import CLOSURE, LENGTH, STILL, Rows
from tinygc.fitting.unit_state import UnitState, read_state, spread_between, spread_of, variance_and_freedom
from tinygc.inference.choose import PRIOR_ODDS, STEPS, factors_by_freedom, level_of_each, tail
from tinygc.inference.decide import FAILS, HOLDS, UNDECIDED
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import MATRIX, LinearModel
from tinygc.models.model import accelerometer_table
from tinygc.models.physics import PhysicsModel
from tinygc.noise.components import TURN, Component, SessionNoise
from tinygc.planning.proposals import TARGETS

SIZES = {CLOSURE: 24, STILL: 18, LENGTH: 12}


def made_rows(seed=0, change=None, noise=1.0, with_turns=True, **more):
    """r = noise - A change: closures by E and B and the accelerometer, rates at rest by E and B, lengths by the accelerometer.

    change (21,): in plausible sizes.
    """
    rng, edges = np.random.default_rng(seed), np.cumsum([0, *SIZES.values()])
    n, kinds = edges[-1], {name: slice(*edges[i : i + 2]) for i, name in enumerate(SIZES)}
    A, sigma = np.zeros((n, COUNT)), np.full(n, 0.5)
    A[kinds[CLOSURE]] = rng.normal(size=(SIZES[CLOSURE], COUNT))
    A[kinds[STILL], GYROSCOPE] = 5 * np.tile(np.hstack([np.kron(np.eye(3), np.full(3, 1e-4)), np.eye(3)]), (SIZES[STILL] // 3, 1))
    A[kinds[LENGTH], ACCELEROMETER] = rng.normal(size=(SIZES[LENGTH], 9))
    A *= 20 / PLAUSIBLE
    r = noise * sigma * rng.normal(size=n)
    made = Rows(
        r=r if change is None else r - A @ (change * PLAUSIBLE),
        parameters=A,
        known=np.zeros((n, 0)),
        spans_s=np.ones(n),
        white=np.diag(sigma**2),
        noise=SessionNoise((), [np.arange(n)], None, np.zeros(0), np.zeros(0)),
        kinds=kinds,
        blank=np.zeros(n, dtype=bool),
        duration_s=60.0,
        temp_c=25.0,
        stills=SIZES[STILL] // 3,
        turns=SIZES[CLOSURE] // 2 * with_turns,
        noise_freedom=1e6,
        rest_rps=np.zeros(3),
        session=None,
        steps_s=np.zeros(0),
        in_time=lambda profile: np.zeros((n, 3)),
    )
    return replace(made, **more)


def part(rows, which, sigma, freedom=np.inf, name="switch-on"):
    """An expected change of some of the parameters."""
    into = np.zeros((COUNT, len(sigma)))
    into[which] = np.diag(sigma)
    return ExpectedPart(name, rows.parameters @ into, into, freedom)


OLD = SimpleNamespace(accelerometer=object(), goodness=None, at_rest={}, linear=LinearModel(np.eye(3), np.zeros(3)), temperature_c=None)


MATRIX_OF_21 = np.r_[GYROSCOPE][MATRIX]


def asked(rows, parts=(), old=OLD, noise=None):
    return {question.name: question for question in ask(rows, parts, noise or todays_noise(rows), old)}


def unknown_e(rows):
    """The rows at rest, and the covariance of all rows by a plausible E."""
    loose = rows.parameters[:, MATRIX_OF_21] * PLAUSIBLE[MATRIX_OF_21]
    return np.arange(len(rows.r))[rows.kinds[STILL]], loose @ loose.T


def changed_by(*ones):
    """A change (21,) of these entries, in plausible sizes."""
    change = np.zeros(COUNT)
    for column, size in ones:
        change[column] = size
    return change


# Questions


def test_a_statistic_beyond_all_draws_has_the_smallest_probability_that_they_show():
    drawn = [(np.eye(2), factors_by_freedom(5.0, 0, DRAWS))]
    least = tail(1e9, np.zeros((2, 2)), drawn)
    assert (least, tail(0.0, np.zeros((2, 2)), drawn)) == pytest.approx((1 / (DRAWS + 1), 1.0), rel=1e-9)
    assert [Question(E, 1e9, 2, p, 0.0127).beyond_draws for p in (least, 1e-6)] == [True, False]
    # A variance that rounding makes negative is none.
    found = tail(4.0, np.diag([-0.5, 1.0]), [(np.zeros((2, 2)), np.ones(DRAWS))])
    assert found == pytest.approx(stats.chi2.sf(4.0, 1), rel=0.05)


def test_the_printed_chi_square_has_the_printed_p():
    for rank, p in ((3, 0.05), (42, 8e-54)):
        assert stats.chi2.sf(Question(E, 1e9, rank, p, 0.0127).chi_square, rank) == pytest.approx(p, rel=1e-9)
    assert Question(E, 5e3, 3, 0.0, 0.0127).chi_square == 5e3  # below the smallest number there is
    assert Question(E, 7.8, 3, 0.05, 0.05).holds


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
    assert found.p_value == pytest.approx(stats.chi2.sf(expected, k), rel=1e-6, abs=0)


def test_what_is_left_follows_chi_square_and_the_old_fits_own_excess():
    rows = made_rows(5, noise=2.0, spans_s=np.full(54, 4.0))
    keep = np.arange(len(rows.r))[rows.kinds[CLOSURE]]
    A = rows.parameters[keep] * PLAUSIBLE
    left = rows.r[keep] - A @ np.linalg.lstsq(A, rows.r[keep], rcond=None)[0]
    chi_square, freedom = float(np.sum(left**2)) / 0.25, len(keep) - COUNT
    for goodness, own, excess in (
        (None, 1e6, 1.0),
        ((400.0, 100), 50.0, 4.0),
        ((150.0, 100), 1e6, 1.5),  # any excess of the old fit counts
        ((4.0, 1), 1e6, 4.0),
        ((50.0, 100), 1e6, 1.0),  # less than noise is no yardstick
        ((0.0, 0), 1e6, 1.0),
    ):
        found = asked(replace(rows, noise_freedom=own), old=SimpleNamespace(accelerometer=None, goodness=goodness, at_rest={}))["noise"]
        assert (found.statistic, found.rank) == (pytest.approx(chi_square, rel=1e-6), freedom)
        both = 1 / (1 / own + (1 / goodness[1] if excess > 1 else 0.0))
        assert found.p_value == pytest.approx(stats.f.sf(chi_square / freedom / excess, freedom, both), rel=1e-4, abs=0)
        assert found.left_rps == pytest.approx(np.sqrt(np.sum(left**2) / freedom) / 4)
    nothing = asked(replace(rows, blank=np.ones(len(rows.r), bool)))["noise"]
    assert (nothing.statistic, nothing.rank, nothing.p_value, nothing.left_rps) == (0.0, 0, 1.0, 0.0)
    # Noise of each turn, which the old fit had as well, is no excuse; any other is.
    for name, share in ((TURN, 1.0), ("other", 0.25 / (0.25 + 1.5**2))):
        noise = asked(rows, noise=with_component(rows, name, CLOSURE, 1.5, 0.1))["noise"]
        assert noise.statistic == pytest.approx(chi_square * share, rel=1e-6)


def test_without_turns_the_rates_at_rest_are_asked_with_a_plausible_e_and_what_is_known():
    """Beside any change of the zero and the accelerometer, which here is alone in the lengths."""
    rows = made_rows(5, with_turns=False, known=np.random.default_rng(2).normal(size=(54, 2)))
    keep = slice(0, rows.kinds[LENGTH].start)
    rows.parameters[keep, ACCELEROMETER] = 0.0
    inverse = np.linalg.inv((rows.white + rows.known @ rows.known.T + unknown_e(rows)[1])[keep, keep])
    A, r = (rows.parameters[:, ZERO] * PLAUSIBLE[ZERO])[keep], rows.r[keep]
    left = r - A @ np.linalg.solve(A.T @ inverse @ A, A.T @ inverse @ r)
    found = asked(rows)["noise"]
    assert (found.statistic, found.rank) == (pytest.approx(left @ inverse @ left, rel=1e-6), len(r) - 3)


def test_rows_of_rests_leave_e_unasked():
    rows = made_rows(11)
    rows.parameters[rows.kinds[CLOSURE]] = 0.0
    found = asked(rows)
    assert (found[E].tested, found[B].tested) == (False, True)
    assert found[B].level == pytest.approx(level_of_each(0.05, sum(each.tested for each in found.values())))


def with_component(rows, name, kind, s, sigma):
    """Noise of rows with one component beyond white, of all rows of a kind."""
    V = np.zeros((len(rows.r), len(rows.r)))
    own = rows.kinds[kind]
    V[own, own] = np.eye(own.stop - own.start)
    return replace(rows.noise, components=(Component(name, V, 1.0, "", 1.0, ""),), s=np.array([s]), sigma=np.array([sigma]))


@pytest.mark.parametrize(("sigma", "heavier"), [(1e-6, False), (1.0, True)])
def test_the_zero_is_asked_of_the_rates_at_rest_with_its_spread_and_the_uncertainty_of_the_noise(sigma, heavier):
    rows = made_rows(13, changed_by((ZERO, [0.015, -0.01, 0.0075])))
    spread, noise = part(rows, np.r_[ZERO], np.full(3, 1e-4)), with_component(rows, "noise.still_rate", STILL, 1.0, sigma)
    still, loose = unknown_e(rows)
    S = rows.covariance(noise) + spread.columns @ spread.columns.T + loose
    expected, k = gls(rows, np.r_[ZERO], np.zeros(0, dtype=int), still, S)
    rows.r[rows.kinds[CLOSURE]] += 100.0  # closures are of no matter
    found = asked(rows, [spread], noise=noise)[B]
    assert (found.statistic, found.rank) == (pytest.approx(expected, rel=1e-6), k)
    known = stats.chi2.sf(expected, k)
    assert found.p_value > 1.5 * known if heavier else found.p_value == pytest.approx(known, rel=0.05)


def test_a_zero_whose_spread_is_of_few_sessions_is_asked_by_fishers_f():
    rows = made_rows(13, changed_by((ZERO, [0.015, -0.01, 0.0075])))
    spread = replace(part(rows, np.r_[ZERO], np.full(3, 2e-4)), freedom=5.0)
    found = asked(rows, [spread])[B]
    assert found.p_value == pytest.approx(stats.f.sf(found.statistic / 3, 3, 5), rel=0.03)


@pytest.mark.parametrize(("share", "drawn"), [(0.98e-3, False), (1.02e-3, True)])
def test_a_size_counts_as_known_where_it_adds_a_thousandth_at_most(share, drawn):
    """To the variance of T's three numbers together: trace of their covariance by the component."""
    rows = made_rows(13)
    still, loose = unknown_e(rows)
    inverse, X = np.linalg.inv((rows.white + loose)[np.ix_(still, still)]), rows.parameters[still, ZERO]
    trace = np.trace(np.linalg.solve(X.T @ inverse @ X, X.T @ inverse @ inverse @ X))
    found = asked(rows, noise=with_component(rows, "noise.still_rate", STILL, 0.0, np.sqrt(share / trace)))[B]
    assert (found.p_value != pytest.approx(stats.chi2.sf(found.statistic, 3), rel=1e-9, abs=0)) == drawn


@pytest.mark.parametrize(("sigmas", "rank"), [(0.99, 0), (1.01, 1)])
def test_a_change_is_asked_about_where_a_plausible_one_shows_by_a_sigma(sigmas, rank):
    rows = made_rows()
    rows.parameters[:] = 0.0
    rows.parameters[3, MATRIX_OF_21[4]] = sigmas * 0.5 / 0.01  # 1 % of E, in a row of sigma 0.5
    found, statistic = asked(rows)[E], rank * (rows.r[3] / 0.5) ** 2
    assert (found.statistic, found.rank, found.left_rps) == (pytest.approx(statistic), rank, 0.0)
    assert found.p_value == pytest.approx(stats.chi2.sf(statistic, rank) if rank else 1.0)


@pytest.mark.parametrize("known", [8.0, np.inf])
def test_noise_that_the_old_fit_found_has_the_freedom_of_its_estimate(known):
    """24 closures of variance 0.25; 18 rates at rest with 1.5^2 more, as the old fit found it, with 8 degrees of freedom."""
    rows = made_rows(16, noise=2.0)
    old, noise = SimpleNamespace(**vars(OLD)), with_component(rows, "noise.still_rate", STILL, 1.0, 0.1)
    old.at_rest = {"noise.still_rate": (1.5**2, known)}
    found = asked(rows, old=old, noise=noise)["noise"]
    share = 18 * 1.5**2 / (0.25 + 1.5**2) / 42
    other = 1 / (1 / rows.noise_freedom + share**2 / known)
    assert found.p_value == pytest.approx(stats.f.sf(found.statistic / found.rank, found.rank, other), rel=1e-6, abs=0)


def test_degrees_of_freedom_of_a_size_with_a_sigma():
    assert variance_and_freedom(3.0, 0.3) == pytest.approx((9.09, 2 * 9.09**2 / 3.2562))
    assert variance_and_freedom(0.0, 2.0) == pytest.approx((4.0, 1.0))
    assert variance_and_freedom(2.0, 0.0) == (4.0, np.inf)


# Causes and costs


def single(rows, name="one", column=MATRIX_OF_21[0], size=1.0):
    into = np.zeros((COUNT, 1))
    into[column] = size * PLAUSIBLE[column]
    return Cause(name, name, rows.parameters @ into, into, np.array([size * PLAUSIBLE[column]]), "", 1.0, ("",), f"mend {name}")


def test_evidence_is_that_of_normal_distributions_over_all_scales():
    rows = made_rows(6, changed_by((MATRIX_OF_21[0], 0.2)))
    spread = part(rows, np.r_[ZERO], np.full(3, 0.1 * DEG))
    cause, evidence = single(rows), Evidence(rows, [spread])
    S, X = rows.white + spread.columns @ spread.columns.T, cause.columns
    p = [stats.multivariate_normal(cov=S + s**2 * X @ X.T).logpdf(rows.r) for s in (0, *STEPS)]
    expected = np.log(np.mean(np.exp(np.array(p[1:]) - p[0]))) + np.log(PRIOR_ODDS)
    assert evidence.of([cause]).log_evidence - evidence.of([]).log_evidence == pytest.approx(expected, rel=1e-9)


def test_the_right_cause_is_found_and_its_double_is_not_told_apart():
    rows = made_rows(8, changed_by((MATRIX_OF_21[0], 0.2)))
    right, double, wrong = single(rows), single(rows, "double"), single(rows, "wrong", MATRIX_OF_21[5])
    found = diagnose(Evidence(rows, []), [right, wrong])
    assert (found.best.names, found.rivals, found.probability > 0.9) == (("one",), {"one": ()}, True)
    both = diagnose(Evidence(rows, []), [right, double, wrong])
    assert set(both.best.names) | set(both.rivals[both.best.names[0]]) == {"one", "double"}


def test_a_cause_that_was_sought_at_many_times_pays_for_them_alone_and_beside_others():
    rows = made_rows(8, changed_by((MATRIX_OF_21[0], 0.2), (ACCELEROMETER.start, 0.3)))
    right, two = single(rows), single(rows, "two", ACCELEROMETER.start)
    useless = [single(rows, "one", column) for column in MATRIX_OF_21[[3, 5, 7]]]
    once, often = (diagnose(Evidence(rows, []), causes) for causes in ([right, two], [*useless, right, two]))
    assert once.alone["one"] - often.alone["one"] == pytest.approx(np.log(4), rel=1e-3)
    assert set(often.best.names) == {"one", "two"}
    assert once.best.log_evidence - often.best.log_evidence == pytest.approx(np.log(4), rel=1e-3)


def test_without_data_a_turn_may_miss_what_a_plausible_change_makes():
    rows = made_rows(10)
    rows.parameters[:] = 0.0
    W = left_open(rows, todays_noise(rows))
    assert pytest.approx(np.diag(PLAUSIBLE**2)) == W
    of_e, of_b, of_g = (
        Bound(name, bound_deg(slopes, np.zeros(COUNT), W), 1.0, words) for name, slopes, words in uses(rows, OLD.linear, True)
    )
    # A turn of 2 pi about x: the end is off by 2 pi x 1 % along it, and by less across it.
    assert of_e.bound_deg == pytest.approx(_BOUND * 2 * np.pi * 0.01 / DEG, rel=1e-3)
    assert of_b.bound_deg == pytest.approx(_BOUND * 60 * 1.0, rel=1e-6)
    assert not of_e.is_seen
    assert of_g.bound_deg == pytest.approx(_BOUND * np.hypot(0.01, 0.01) / DEG, rel=0.05)


def of_name(rows, name):
    old = SimpleNamespace(linear=LinearModel(np.eye(3), np.array([0.01, -0.02, 0.03])), accelerometer=object(), temperature_c=None)
    (found,) = [cause for cause in candidate_causes(rows, old) if cause.name == name][:1]
    return found


def of_session(**more):
    session = SimpleNamespace(reference=None, config=SimpleNamespace(protocol=SimpleNamespace(reference="accelerometer")))
    return made_rows(session=session, **more)


def test_an_accelerometer_that_reads_too_much_has_a_scale_above_zero():
    found = of_name(of_session(), "accelerometer's scale")
    assert (found.into[ACCELEROMETER][accelerometer.SCALES, [0, 1, 2]] < 0).all()  # its correction is less


def test_a_drift_counts_with_its_mean_over_the_minute():
    rows = of_session(steps_s=np.array([15.0]), duration_s=100.0)
    step = of_name(rows, "step")
    assert np.diag(step.into[ZERO]) / -step.sizes == pytest.approx(np.full(3, 0.75))
    warm = of_name(rows, "warm-up")
    assert np.diag(warm.into[ZERO]) / -warm.sizes == pytest.approx(np.full(3, np.mean(np.exp(-np.linspace(0, 60, 100_001) / 10))), rel=1e-3)


def test_the_sigma_of_the_cost_is_that_of_the_slopes():
    covariance = np.zeros((COUNT, COUNT))
    covariance[ZERO, ZERO] = np.diag([1e-8, 4e-8, 9e-8])
    covariance[MATRIX_OF_21, MATRIX_OF_21] = 0.04
    rows = of_session(twin=None, rest_rps=np.array([5e-4, 0, 0]))
    found = cost_of(rows, OLD.linear, np.zeros(COUNT), covariance, np.zeros(3), covariance[ZERO, ZERO])
    of_e = 60 * 5e-4 * 0.2  # of the x column of E
    expected = pytest.approx(np.sqrt((60 * np.array([1e-4, 2e-4, 3e-4])) ** 2 + of_e**2), rel=0.02)
    assert (found.sigma == expected, found.with_new_bias_sigma == expected) == (True, True)  # E's part stays with B anew


@pytest.mark.parametrize(
    ("change", "degrees"),
    [([[0, 0, 0], [0, 0, -0.02], [0, 0.02, 0]], 2 * 0.02 / DEG), (np.diag([0.01, 0, 0]), 3.6)],  # about y and z: twice the angle
)
def test_a_misalignment_shows_half_way_round_a_turn_though_a_full_one_closes(change, degrees):
    vector = np.r_[np.zeros(9), LinearModel(np.array(change), np.zeros(3)).vector]
    (_, slopes, _), *_ = uses(made_rows(), OLD.linear, True)
    assert bound_deg(slopes, vector, np.zeros((COUNT, COUNT))) == pytest.approx(degrees, rel=1e-3)


def test_an_effect_is_the_length_of_the_error_and_its_sigma_that_of_its_worst_direction():
    change, covariance = np.zeros(COUNT), np.zeros((COUNT, COUNT))
    change[-3:] = [3e-4, 4e-4, 0]
    covariance[-3:, -3:] = 1e-8 * np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]])
    found = {name: bound_deg(slopes, change, covariance) for name, slopes, _ in uses(made_rows(), OLD.linear, True)}
    assert found[B] == pytest.approx(60 * (5e-4 + _BOUND * 1e-4 * np.sqrt(1.9)) / DEG, rel=1e-3)


def test_what_a_rotation_is_beyond_its_linear_columns():
    old = LinearModel(np.eye(3) + 0.01 * np.arange(9).reshape(3, 3), np.array([0.01, -0.02, 0.03]))
    vector = np.array([0.1, -0.05, 0.08])
    R, cross = rotation.matrix(rotation.exp(vector)), np.array([[0, -0.08, -0.05], [0.08, 0, -0.1], [0.05, 0.1, 0]])
    expected = LinearModel((R - np.eye(3) - cross) @ old.E, (R - np.eye(3) - cross) @ old.B).vector
    assert beyond_linear(old, vector)[GYROSCOPE] == pytest.approx(expected, abs=1e-15)
    assert not beyond_linear(old, vector)[:9].any()


# Verdicts


def decided(matters=(), small=(), open_=(), as_it_is=0.2, anew=0.1, names=(), turned=True, anew_sigma=0.01):
    """The decision on a cost, degrees, with causes of these names."""
    bounds = [Bound(name, 2.0 if name in open_ else 0.1, 1.0, f"a use of {name}") for name in (E, B, GRAVITY)]
    sigma = np.full(3, 0.01 * DEG)
    cost = Cost("a minute", np.array([as_it_is, 0, 0]) * DEG, sigma, np.array([anew, 0, 0]) * DEG, np.array([0, anew_sigma, 0]) * DEG)
    found = [Cause(name, name, *[np.zeros(0)] * 3, "", 1.0, (), f"repair {name}") for name in names]
    diagnosis = SimpleNamespace(best=SimpleNamespace(causes=found, stated=[StatedCause(name, "x 1", ()) for name in names]))
    changed = dict.fromkeys(matters, 3.0) | dict.fromkeys(small, 0.87)
    return verdict._decide(changed, bounds, cost, diagnosis if changed else None, Options(), turned)


OPEN_E = {"as_it_is": 5.0, "open_": (E,)}
USE_NEW = "bias moved, as at a switch-on; error after the next minute 5.0°."
HELD = "error after the next minute 0.20°."
UNSEEN_E = "a scale error of up to 2.0° per turn would go unseen."


@pytest.mark.parametrize(
    ("found", "answer", "bias_serves", "headline"),
    [
        # A moved accelerometer costs a tilt, whatever the gyroscope costs in a minute.
        ({"open_": (E,)}, UNDECIDED, True, UNSEEN_E),
        ({"small": (GRAVITY,), "open_": (E,)}, UNDECIDED, True, UNSEEN_E),
        ({"small": (GRAVITY,)}, HOLDS, True, HELD),
        # A rest holds for what a rest shows.
        ({"open_": (E,), "turned": False}, HOLDS, True, f"bias and gravity are fine; {HELD}"),
        ({"open_": (E, GRAVITY), "turned": False}, HOLDS, True, f"bias is fine; {HELD}"),
        ({"open_": (E, B), "turned": False}, UNDECIDED, True, None),
        ({**OPEN_E, "turned": False}, UNDECIDED, True, None),
        ({"open_": (GRAVITY,)}, UNDECIDED, True, "a tilt error of up to 2.0° would go unseen."),
        # The new bias is used where that helps, and E left open where it was not tested.
        ({"as_it_is": 5.0}, verdict.BIAS, True, USE_NEW),
        (OPEN_E, UNDECIDED, True, USE_NEW),
        ({**OPEN_E, "matters": (B,)}, FAILS, True, None),
        ({"as_it_is": 5.0, "anew": 2.0}, FAILS, False, "error after the next minute 5.0°; with a new bias still 2.0°."),
        ({**OPEN_E, "anew": 2.0, "anew_sigma": 0.99}, FAILS, False, None),
        ({**OPEN_E, "anew": 2.0, "anew_sigma": 1.01}, UNDECIDED, True, USE_NEW),
        # That is no answer where another change matters, or the zero moved by another cause.
        ({"as_it_is": 5.0, "matters": (B, GRAVITY)}, FAILS, False, None),
        ({"as_it_is": 5.0, "matters": (B, E)}, FAILS, False, None),
        ({"as_it_is": 5.0, "matters": (B,), "names": ("step",)}, FAILS, False, "step: x 1."),
        ({"matters": (NOISE,)}, FAILS, False, "more than noise is left, of unknown cause, by up to 3.0°."),
        ({"matters": (NOISE, E)}, FAILS, False, "more than noise is left, of unknown cause, by up to 3.0°."),
    ],
)
def test_the_verdict_follows_from_what_changed_what_is_open_and_what_it_costs(found, answer, bias_serves, headline):
    decision, serves = decided(**found)
    assert (decision.kind, serves, headline or decision.line) == (answer, bias_serves, decision.line)
    assert ("--write" in decision.do) == ("bias moved" in decision.line)


# What a calibration that holds may differ by


E_OLD, B_OLD = np.array([[1.02, 0.01, 0], [0, 0.98, -0.01], [0.005, 0, 1.01]]), np.array([0.01, -0.02, 0.005])
NONE_KNOWN = Spread.of([], [], "")


def written(tmp_path, model=None, **more):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(models.to_dict(model or LinearModel(E_OLD, B_OLD), **more)))
    return read_state(path)


def rows_with(repeatability=None, **more):
    made = config()
    sensor = replace(made.sensor, gyro_bias_repeatability_dps=repeatability)
    return made_rows(session=SimpleNamespace(config=replace(made, sensor=sensor)), **more)


def total(parts, *names):
    """Covariance (21, 21) by the parts of these names together."""
    return sum(part.into @ part.into.T for part in parts if part.name in names)


#: what a tenth of a milligram is to each parameter of an accelerometer
TENTH_MG = 0.1 * np.r_[np.full(6, MG / G), np.full(3, MG)]


def test_a_joint_covariance_is_taken_whole(tmp_path):
    root = np.random.default_rng(0).normal(size=(COUNT, COUNT)) * 1e-4
    joint = {"matrix": (root @ root.T).tolist()}
    old = written(tmp_path, joint_covariance=joint, accelerometer=accelerometer_table(config().accelerometer))
    assert not old.own_lengths
    found = expected_parts(old, rows_with(known=np.zeros((54, 2))), NONE_KNOWN)
    assert all(part.assumed == (part.name not in ("calibration", "references")) for part in found)
    assert total(found, "calibration") == pytest.approx(root @ root.T, rel=1e-6, abs=1e-16)
    # Of a covariance without a direction, whose eigenvalues rounding makes negative, there is none.
    one = np.outer(root[0], root[0])
    found = total(
        expected_parts(replace(old, table=old.table | {"joint_covariance": {"matrix": one}}), rows_with(), NONE_KNOWN), "calibration"
    )
    assert found[GYROSCOPE, GYROSCOPE] == pytest.approx(one[GYROSCOPE, GYROSCOPE], abs=1e-20)
    assert np.diag(written(tmp_path).joint)[GYROSCOPE] == pytest.approx(TARGETS**2)  # that of a usual session, where a file has none


def test_the_error_of_a_given_accelerometer_is_in_lengths_and_not_in_e(tmp_path):
    own, shared = np.diag(np.full(12, 4e-8)), np.diag(np.r_[np.full(9, 3e-8), np.zeros(3)])
    old, rows = written(tmp_path, covariance=own.tolist(), accelerometer_covariance=shared.tolist()), rows_with()
    parts = expected_parts(old, rows, NONE_KNOWN)
    assert total(parts, "calibration")[GYROSCOPE, GYROSCOPE] == pytest.approx(own - shared, abs=1e-16)
    assert np.sqrt(np.diag(total(parts, "accelerometer's calibration"))[ACCELEROMETER]) == pytest.approx(TENTH_MG)
    (columns,) = (part.columns for part in parts if part.name == "accelerometer's calibration")
    assert (columns[: rows.kinds[LENGTH].start].any(), columns[rows.kinds[LENGTH]].any()) == (False, True)


@pytest.mark.parametrize("known", [[], [*range(9)], [0, 1, 2, 3, 4, 5, 7, 8]])
def test_an_accelerometers_zero_moves_by_the_usual_where_nothing_shows_its_spread(tmp_path, known):
    sigma = USUAL.scatter[ACCELEROMETER].copy()
    sigma[known] = 1e-3
    old, spread = written(tmp_path), Spread.of(known, 1e-3, "own", 3.0).or_else(USUAL)
    parts = [part for part in expected_parts(old, rows_with(), spread) if part.name == "switch-on"]
    assert np.sqrt(np.diag(total(parts, "switch-on"))[ACCELEROMETER]) == pytest.approx(np.sqrt(2) * sigma)
    assert [part.assumed for part in parts] == [part.source != "own" for part in parts]
    assert "switch-on" not in {part.name for part in expected_parts(old, rows_with(), spread, switched_on=False)}


@pytest.mark.parametrize("of_lot", [False, True])
@pytest.mark.parametrize("in_file", [{}, {"accelerometer_spread": [9.0] * 9}, {"bias_sigma_rps": [1e-3, 2e-3, 3e-3]}])
@pytest.mark.parametrize("own", [None, 0.02])
def test_where_the_spread_is_from(tmp_path, own, in_file, of_lot):
    """session.toml before the lot, that before the model file, and last the usual; a lot has the gyroscope first, and here lacks one."""
    lot = LotFile(SimpleNamespace(repeatability=np.r_[1.0:10.0, np.nan, 11.0:22.0], sessions=30, units=10), "lot.json", "")
    sigma, sources = np.full(COUNT, np.nan), [""] * COUNT
    for which, value, source in (
        (ZERO, USUAL.scatter[ZERO], USUAL.at(ZERO).source),
        (ACCELEROMETER, USUAL.scatter[ACCELEROMETER], USUAL.source),
        (ZERO, in_file.get("bias_sigma_rps"), "stated in the model file"),
        (ACCELEROMETER, in_file.get("accelerometer_spread"), "stated in the model file"),
        (
            np.delete(np.arange(COUNT), ZERO.start),
            np.r_[13.0:22.0, 1.0:10.0, 11.0:13.0] if of_lot else None,
            "30 sessions of 10 units of a lot",
        ),
        (ZERO, own and own * DEG, "given in session.toml"),
    ):
        if value is not None and value is not False:
            sigma[which] = value
            sources = [source if k in np.arange(COUNT)[which] else each for k, each in enumerate(sources)]
    old, rows = written(tmp_path, **in_file), rows_with(repeatability=own)
    found = spread_of(rows.session.config, old.table, lot=lot.spread if of_lot else None)
    assert found.scatter == pytest.approx(sigma, nan_ok=True)
    assert list(found.sources) == sources
    assert found.freedom.tolist() == [20.0 if "lot" in source else np.inf for source in sources]
    told = [(part.source, part.assumed) for part in expected_parts(old, rows, found) if part.name == "switch-on"]
    assert told == [(source, "usual" in source) for source, size in zip(sources, sigma, strict=True) if size > 0]


@pytest.mark.parametrize(("temp_c", "then_c", "of_zero", "tenths_mg"), [(35.0, 25.0, 10 * USUAL_PER_K, 10), (25.0, None, None, 1)])
def test_temperature_counts_for_zero_and_accelerometer(tmp_path, temp_c, then_c, of_zero, tenths_mg):
    """Where it is not known, and within one degree, a tenth of a milligram."""
    more = {} if then_c is None else {"temperature_c": then_c}
    parts = expected_parts(written(tmp_path, **more), rows_with(temp_c=temp_c), NONE_KNOWN)
    assert ("temperature" in {part.name for part in parts}) == (of_zero is not None)
    if of_zero:
        assert np.sqrt(np.diag(total(parts, "temperature"))[ZERO]) == pytest.approx(np.full(3, of_zero))
    assert np.sqrt(np.diag(total(parts, "accelerometer's temperature"))[ACCELEROMETER]) == pytest.approx(tenths_mg * TENTH_MG)
    assert np.array(JOINT_NAMES)[accelerometer.BIASES].tolist() == [f"accelerometer bias {axis}" for axis in "xyz"]


def test_the_drift_that_session_and_today_share_is_in_neither(tmp_path):
    """Today's noise and the old fit each have the drift's variance: of their difference, twice its covariance is taken away."""
    old = written(tmp_path, covariance=np.diag(np.r_[np.full(9, 1e-10), np.full(3, 1e-8)]).tolist())
    rows = rows_with(twin=SimpleNamespace(problem=SimpleNamespace(instability=BiasInstability(2e-5, "given"))))
    for elapsed_s in (1.0, 600.0, 1e7):
        moments = np.array([0.0, rows.duration_s + elapsed_s])
        both = wander_covariance(moments, rows.duration_s, instability_rps=2e-5)[0, 1] if elapsed_s < 1e7 else 0.0
        parts = expected_parts(old, rows, NONE_KNOWN, switched_on=False, elapsed_s=elapsed_s)
        found = np.diag(total(parts, "calibration", "wander"))[ZERO]
        assert found == pytest.approx(np.full(3, 1e-8 - 2 * both), rel=1e-9)


@pytest.mark.parametrize("elapsed_s", [600.0, None])
def test_within_one_switch_on_the_zero_walks(tmp_path, elapsed_s):
    noise = figures(sensor(axis(K=1e-6, B=2e-5)))
    parts = expected_parts(replace(written(tmp_path), figures=noise), rows_with(), USUAL, switched_on=False, elapsed_s=elapsed_s)
    assert total(parts, "wander")[ZERO, ZERO] == pytest.approx(np.eye(3) * 1e-12 * (elapsed_s or END_S), rel=1e-12)
    assert not {"wander", "switch-on"} & {part.name for part in expected_parts(written(tmp_path), rows_with(), USUAL, switched_on=False)}


def of_unit(vectors, matrices=None):
    """The spread by sessions of one unit, without errors of their own; matrices: of their accelerometers, None for given ones."""
    sessions, made = [], config()
    for number, vector in enumerate(vectors):
        calibration = replace(made.accelerometer, matrix=np.eye(3) if matrices is None else matrices[number])
        table = {"covariance": 1e-20 * np.eye(12), "accelerometer": accelerometer_table(calibration)}
        table |= {} if matrices is None else {"joint_covariance": {"matrix": 1e-20 * np.eye(21)}}
        folder = Path(f"2026-01-{20 - number}")  # the last one first
        sessions.append(UnitState(folder, LinearModel.from_vector(vector), table, folder=folder, config=made))
    return spread_between(sessions, config().accelerometer, "sessions"), [each.triad.values for each in sessions]


def test_the_spread_between_sessions_is_their_sample_variance():
    """In one frame; accelerometers that are all given show no spread of theirs."""
    vectors = 1e-3 * np.random.default_rng(1).normal(size=(3, 12))
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    found, _ = of_unit(vectors)
    assert found.scatter == pytest.approx(np.r_[np.full(9, np.nan), vectors.std(axis=0, ddof=1)], nan_ok=True)
    assert found.freedom[GYROSCOPE].tolist() == [2.0] * 12
    assert (set(found.sources[GYROSCOPE]), found.note) == ({"3 sessions"}, "")
    found, values = of_unit(vectors, [np.diag(np.r_[1 + 1e-3 * number, 1, 1]) @ turn for number in (0, 2, 1)])
    turned = vectors @ block_diag(np.kron(turn, np.eye(3)), turn)
    assert found.scatter[GYROSCOPE] == pytest.approx(np.std(turned, axis=0, ddof=1))
    assert found.scatter[ACCELEROMETER] == pytest.approx(np.std(values, axis=0, ddof=1), abs=1e-8)


def test_a_step_among_the_other_sessions_is_no_spread():
    vectors = 1e-5 * np.random.default_rng(1).normal(size=(8, 12))
    vectors[:4, 9:11] += 0.1  # from the fifth last on
    found, _ = of_unit(vectors)
    assert (found.scatter[ZERO] ** 2 < 1e-9).all()
    assert found.freedom[GYROSCOPE].tolist() == [6.0] * 9 + [5.0, 5.0, 6.0]
    assert found.sources[ZERO].tolist() == ["8 sessions, less drift and 2 steps"] * 3
    assert "a step in B_x, B_y between 2026-01-16 and 2026-01-17: it is taken out" in found.note


def test_another_kind_of_model_is_a_correction_of_its_own_rates(tmp_path):
    """omega' = E' omega + B' of calibrated rates: what a changed E and B of the model are to it, by finite differences."""
    bent = AppliedEffect(effect_of("gyro.g_sensitivity"), np.full(9, 1e-4))
    model = PhysicsModel(LinearModel(E_OLD, B_OLD), (bent,), Conditions(60.0, 10.0, 25.0))
    sigma = np.r_[np.full(9, 1e-3), np.full(3, 1e-4), np.full(9, 1e-6)]
    old = written(tmp_path, model, covariance=np.diag(sigma**2).tolist())
    assert (old.linear.vector, old.bias) == (pytest.approx(OLD.linear.vector), pytest.approx(B_OLD))
    measured = np.random.default_rng(1).normal(size=(5, 3))
    omega = model.linear(measured)
    columns = np.concatenate([np.kron(np.eye(3), omega[:, None, :]).reshape(5, 3, 9), np.broadcast_to(np.eye(3), (5, 3, 3))], axis=2)
    moved = [LinearModel.from_vector(model.linear.vector + step)(measured) - omega for step in np.diag(sigma[:12])]
    expected = np.linalg.lstsq(columns.reshape(15, 12), np.reshape(moved, (12, 15)).T, rcond=None)[0]
    assert old.joint[GYROSCOPE, GYROSCOPE] == pytest.approx(expected @ expected.T, rel=1e-6, abs=1e-14)
    assert pytest.approx(B_OLD + 1) == old.with_bias_moved(np.ones(3)).linear.B
