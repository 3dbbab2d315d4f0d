"""What is reported: held-out rows by exact refits, thresholds one step below and above, and each p-value by hand."""

import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG, GRAVITY, Table, session_of
from linear_twin import effect, fixed_columns, linear_twin, stepped
from scipy import stats

from session.io.samples import Samples
from session.io.units import G
from tinygc import SimulationOptions, read_session
from tinygc.closure.build import build_problem
from tinygc.effects import catalogue
from tinygc.estimation.options import FitOptions
from tinygc.explanation import decision
from tinygc.explanation.decision import (
    FitClosure,
    Naming,
    Proof,
    Prover,
    beyond_the_catalogue,
    borne_out,
    cleared,
    decide,
    decided,
    fold_rows,
    folds_of,
    held_out,
    improvement_p,
    left_out,
    left_out_and_searched,
    no_worse,
    numbers_before,
    part_of_a_curve,
    per_segment,
    tilt_rms,
    told_apart,
    undersampled_claim,
    with_linear,
    without_effects,
)
from tinygc.explanation.evidence import Evidence, Guess
from tinygc.explanation.families import motion
from tinygc.explanation.search import NAMELESS, probabilities, slow_candidates
from tinygc.models.linear import LinearModel
from tinygc.noise.components import MOST_FACTOR, TURN, UNDERSAMPLED, Component
from tinygc.noise.refit import prior_sigmas, refit
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener
from tinygc.simulation.write import write_session

A, B, C = effect("a", 2), effect("b", 3), effect("c")
ROWS = {"closure": slice(0, 24), "still": slice(24, 24 + 39), "length": slice(63, 76)}  # of twelve turns and thirteen stills


def twin_with(*spoilt, seed=5, **options):
    twin = linear_twin(seed=seed, turns=12, **options)
    for each, theta in spoilt:
        twin.spoil(each, theta)
    return twin


# Held out


def test_every_tenth_segment_is_held_out_with_the_stills_at_its_ends():
    assert [held.tolist() for held in folds_of(12)] == [[0, 10], [1, 11], *([k] for k in range(2, 10))]
    assert [held.tolist() for held in folds_of(3)] == [[0], [1], [2]]
    twin = twin_with()
    rows = fold_rows(twin, twin.evidence().nothing.whiten, np.array([1, 11]))
    gone = [2, 3, 22, 23, *(24 + 3 * still + axis for still in (1, 2, 11, 12) for axis in range(3)), 64, 65, 74, 75]
    assert np.flatnonzero(~rows).tolist() == gone
    moving = twin_with(resting=False)
    assert np.flatnonzero(~fold_rows(moving, moving.evidence().nothing.whiten, np.array([1, 11]))).tolist() == [2, 3, 22, 23]


def refitted_without(twin, have, prior, J, r) -> tuple[np.ndarray, np.ndarray]:
    """(n,) rows predicted by normal equations of the others: with penalties of distance from the fit of all rows, and from the start."""
    whiten, found = have.whiten, np.full(twin.n, np.nan)
    stacked_J, stacked_r = whiten.back(J), whiten.back(r)
    for held in folds_of(len(twin.segments)):
        seen = fold_rows(twin, whiten, held)
        inverse = np.linalg.inv(whiten.covariance[np.ix_(seen, seen)])
        normal = stacked_J[seen].T @ inverse @ stacked_J[seen] + np.eye(J.shape[1])
        balance = J.T @ r  # of the priors at the fit of all rows
        step = np.linalg.solve(normal, balance - stacked_J[seen].T @ inverse @ stacked_r[seen])
        found[~seen] = (stacked_r + stacked_J @ step)[~seen]
    return found


def test_leaving_out_by_algebra_is_refitting_without_those_rows():
    twin = twin_with((A, [6.0, -4.0]), wide=True)
    evidence = twin.evidence()
    have = evidence.of((A,), evidence.nothing)
    prior = prior_sigmas(twin, [A])
    exact = refitted_without(twin, have, prior, have.fit.J * prior, have.fit.r)
    np.testing.assert_allclose(left_out(twin, have.whiten, have.fit.r, have.fit.J * prior), exact, rtol=1e-6, atol=1e-9)
    angles = held_out(twin, have.whiten, have.fit)
    np.testing.assert_allclose(angles, exact[:24].reshape(12, 2), rtol=1e-6, atol=1e-9)
    assert tilt_rms(angles) == pytest.approx(np.sqrt(np.mean(exact[:24:2] ** 2 + exact[1:24:2] ** 2)))


def test_the_misfit_of_a_segment_is_counted_with_the_still_at_which_it_begins():
    twin = twin_with()
    have = twin.evidence().nothing
    rows = np.random.default_rng(0).normal(size=twin.n)
    rows[5] = np.nan  # in no fold
    square = np.nan_to_num((rows / np.sqrt(np.diag(have.whiten.covariance))) ** 2)
    expected = [square[2 * k : 2 * k + 2].sum() + square[24 + 3 * k : 27 + 3 * k].sum() + square[63 + k] for k in range(12)]
    np.testing.assert_allclose(per_segment(twin, have, rows), expected)
    moving = twin_with(resting=False)
    have = moving.evidence().nothing
    sigma = np.sqrt(np.diag(have.whiten.covariance))
    np.testing.assert_allclose(per_segment(moving, have, rows[6:30]), ((rows[6:30] / sigma) ** 2).reshape(12, 2).sum(axis=1))


def test_the_improvement_is_wilcoxons_of_exact_refits_with_and_without_the_claim():
    twin = twin_with((A, [1.5, -1.0]))
    evidence = twin.evidence()
    have = evidence.of((A, C), evidence.nothing)
    prior = evidence.prior(have.fit)
    J, claim = have.fit.J * prior, have.fit.state.claims
    for number, part in ((0, slice(15, 17)), (1, slice(17, 18))):
        fewer = np.delete(J, part, axis=1)
        r = have.fit.r - have.fit.J[:, part] @ claim[number].theta
        r = r - fewer @ np.linalg.lstsq(np.vstack([fewer, np.eye(fewer.shape[1])]), np.r_[r, np.zeros(fewer.shape[1])], rcond=None)[0]
        gains = [per_segment(twin, have, refitted_without(twin, have, prior, *each)) for each in ((fewer, r), (J, have.fit.r))]
        expected = stats.wilcoxon(gains[0] - gains[1], alternative="greater").pvalue
        assert improvement_p(twin, have, prior, number) == pytest.approx(expected)
    assert improvement_p(twin, have, prior, 0) < 0.05 < improvement_p(twin, have, prior, 1)


def test_a_scanned_shape_is_chosen_anew_by_the_rows_that_are_seen():
    """The best of three shapes in each fold, whichever group of candidates it comes in, by exact normal equations."""
    twin = twin_with((C, [2.0]))
    have = twin.evidence().nothing
    J, r = have.fit.J * prior_sigmas(twin, []), have.fit.r
    shapes = [have.whiten(twin.columns_of(each)) for each in (effect("d", 2), effect("e", 2), effect("f", 2))]
    with patch.object(decision, "TOGETHER", 2):
        found = left_out_and_searched(twin, have.whiten, r, J, shapes)
    stacked_r, expected = have.whiten.back(r), np.full(twin.n, np.nan)
    chosen = []
    for held in folds_of(12):
        seen = fold_rows(twin, have.whiten, held)
        trials = []
        for shape in shapes:
            columns = np.hstack([have.whiten.back(J), have.whiten.back(shape)])
            inverse = np.linalg.inv(have.whiten.covariance[np.ix_(seen, seen)])
            normal, right = columns[seen].T @ inverse @ columns[seen] + np.eye(17), columns[seen].T @ inverse @ stacked_r[seen]
            right[: J.shape[1]] -= J.T @ r  # of the priors at the fit of all rows
            theta = np.linalg.solve(normal, right)
            trials.append((-right @ theta, (stacked_r - columns @ theta)[~seen]))
        chosen.append(int(np.argmin([cost for cost, _ in trials])))
        expected[~seen] = trials[chosen[-1]][1]
    assert len(set(chosen)) > 1
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    for nothing in ([0 * shapes[0]], []):  # a shape that does nothing, and none
        np.testing.assert_allclose(
            left_out_and_searched(twin, have.whiten, r, J, nothing), left_out(twin, have.whiten, r, J), rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize(("p", "kept"), [(0.0499, True), (0.05, False)])
def test_a_claim_is_kept_if_chance_improves_held_out_rows_so_much_in_less_than_one_of_twenty(monkeypatch, p, kept):
    step = stepped("step", np.array([1.0, 2.0]))
    given = []
    monkeypatch.setattr(decision, "improvement_p", lambda twin, have, prior, number, shapes: given.append(shapes) or p)
    twin = twin_with()
    evidence = twin.evidence()
    assert borne_out(evidence, evidence.of((A,), evidence.nothing), 0) == kept
    have = evidence.of((step.at(1.0),), evidence.nothing)
    assert borne_out(evidence, have, 0) == kept
    assert given[0] is None
    for shape, at in zip(given[1], (1.0, 2.0), strict=True):
        np.testing.assert_allclose(shape, have.whiten(twin.columns_of(step.at(at))))


# What is proved


def stated(held_out, numbers=range(1, 13), **problem):
    """What a fit states that held out these angles."""
    used = [SimpleNamespace(number=number) for number in numbers]
    return FitClosure(SimpleNamespace(used=used, **problem), SimpleNamespace(held_out=held_out, model=None))


def proof_of(before, named, before_numbers, named_numbers, floor_rms, changed):
    return Proof(before, named, before_numbers, named_numbers, floor_rms, changed, FitClosure(), FitClosure(), None)


def test_before_is_the_figure_of_the_fit_that_is_explained(monkeypatch):
    """With its own options; a fit with a lot, or with a bias of each log, has another problem than the session's."""
    used = [SimpleNamespace(number=number) for number in (3, 5)]
    problem, of_it = SimpleNamespace(used=used), SimpleNamespace(held_out=np.ones((2, 2)))
    chosen = SimpleNamespace(used=used)
    monkeypatch.setattr(decision, "choose", lambda problem, options: (None, chosen, of_it))
    for lot, bias_per_log, folds in ((None, False, 3), ("lot", False, 5), (None, True, 5)):
        options = SimpleNamespace(lot=lot, bias_per_log=bias_per_log, folds=3)
        fit = SimpleNamespace(options=options, linear=of_it, problem=problem)
        found = FitClosure.stated_by(fit, problem)
        assert (found.options.folds, found.problem is problem, found.numbers) == (folds, folds == 3, [3, 5])
        assert found.held_out is of_it.held_out
    assert FitClosure.stated_by(None, problem).options is decision.AS_FIT


def test_a_drift_of_the_accelerometer_that_fit_states_is_weighed():
    drifts, steady = (SimpleNamespace(joint=SimpleNamespace(drift=drift)) for drift in (object(), None))
    found = [FitClosure(problem=problem).effects for problem in (drifts, steady, SimpleNamespace(joint=None), None)]
    assert [[each.id for each in one] for one in found] == [["accelerometer.zero_drift"], [], [], []]


@pytest.mark.parametrize(
    ("before", "after", "changed", "removed"),
    [
        (2.0, 1.0, True, 1.0),
        (2.0, np.sqrt(2.5), True, 0.5),
        (2.0, 0.5, True, 1.0),
        (2.0, 3.0, True, 1 - 8 / 3),
        (2.0, 1.0, False, None),
        (np.sqrt(1.51), 1.0, True, 1.0),
        (np.sqrt(1.49), 1.0, True, None),
    ],
)
def test_what_is_removed_is_a_share_of_the_excess_over_the_floor(before, after, changed, removed):
    """In variances; an excess of less than half of the floor's is no excess."""
    angles = [np.array([[0.6, 0.8, 9.0], [0.8, -0.6, 9.0]]) * 2 * size for size in (before, after)]
    proof = proof_of(*angles, [1, 2], [1, 2], 2.0, changed)
    assert proof.removed == (removed if removed is None else pytest.approx(removed))


def test_segments_keep_the_numbers_that_they_had_before_a_repair():
    """By the nearest middle in the same log; of a log without segments, in any."""

    def segment(log, start_s, duration_s, number=0):
        return SimpleNamespace(log=log, start_s=start_s, duration_s=duration_s, number=number)

    old = [segment(0, 0.0, 2.0, 1), segment(0, 4.0, 2.0, 2), segment(1, 0.0, 2.0, 3), segment(0, 8.0, 4.0, 4)]
    joined = [
        segment(0, 0.0, 2.0),
        segment(0, 4.5, 8.0),
        segment(1, 5.0, 9.0),
        segment(2, 4.0, 2.0),
        segment(0, 0.0, 7.0),
        segment(0, 0.0, 10.0),
    ]
    assert numbers_before(SimpleNamespace(segments=old), SimpleNamespace(segments=joined)) == [1, 4, 3, 2, 2, 2]


@pytest.mark.parametrize(
    ("named", "worse", "kept"), [(0.9, False, "named"), (1.0, False, "named"), (1.005, False, "before"), (1.02, True, "before")]
)
def test_what_is_handed_on_is_the_better_on_the_turns_of_both(named, worse, kept):
    """The second turn of before, which the repair left out, does not count, however badly it closes."""
    tilt = np.array([[0.6, 0.8], [30.0, 40.0], [0.8, -0.6]])
    proof = proof_of(tilt, named * tilt[[0, 2]], [4, 5, 7], [4, 7], 0.1, True)
    assert (proof.ratio, proof.worse) == (pytest.approx(named), worse)
    assert not replace(proof, floor_rms=1.001 * named).worse
    assert replace(proof, floor_rms=0.999 * named).worse == worse
    assert proof.after is getattr(proof, kept)
    assert proof.after_numbers == {"named": [4, 7], "before": [4, 5, 7]}[kept]


def test_before_is_what_fit_states_and_after_its_own_answer_without_the_effects(monkeypatch):
    twin = twin_with((A, [6.0, -4.0]))
    twin.problem.used = twin.problem.segments = twin.segments
    nothing = twin.evidence().nothing
    named = twin.evidence().of((A,), nothing)
    before, after, given = np.ones((12, 2)), 0.5 * np.ones((12, 2)), []
    monkeypatch.setattr(decision, "without_effects", lambda base, *_: given.append(base) or base)
    monkeypatch.setattr(FitClosure, "of", lambda problem, options: stated(after))
    fitted = stated(before)
    prove = Prover(twin.problem, twin, fitted)
    proof = prove(named.whiten, named.fit)
    assert (proof.before is before, proof.after is after, proof.changed, proof.floor_rms) == (True, True, True, np.sqrt(2.0))
    assert proof.before_numbers == proof.after_numbers == list(range(1, 13))
    assert given == [fitted.problem]
    assert prove(named.whiten, named.fit).named is proof.named  # the same fit is held out once
    assert len(given) == 1
    moved = replace(named.fit, state=named.fit.state.with_vector(named.fit.state.vector + 1e-6))  # as into the gauge
    assert prove(named.whiten, moved).fit.state.claims is moved.state.claims
    assert [given.pop(), len(given)] == [fitted.problem, 1]
    same = prove(nothing.whiten, nothing.fit)
    assert (same.changed, same.after is before, same.left is fitted, len(given)) == (False, True, True, 1)
    # Where fit used other turns, or another accelerometer was named, or the turns were repaired, the twin's own problem stands.
    Prover(twin.problem, twin, stated(before[1:], range(2, 13)))(named.whiten, named.fit)
    assert given.pop() is twin.problem
    other = SimpleNamespace(**vars(twin.problem))
    assert Prover(other, twin, fitted)(nothing.whiten, nothing.fit).changed
    assert given.pop() is twin.problem
    # Where fit does not settle, both are predictions of the twin.
    monkeypatch.setattr(FitClosure, "of", lambda problem, options: FitClosure())
    proof = Prover(twin.problem, twin, FitClosure())(named.whiten, named.fit)
    np.testing.assert_allclose(proof.before, held_out(twin, named.whiten, refit(twin, named.whiten, [], twin.start())))
    np.testing.assert_array_equal(proof.named, held_out(twin, named.whiten, named.fit))
    assert proof.fit is named.fit


def test_what_is_handed_on_has_the_covariance_of_both_estimates_for_the_same_errors(monkeypatch):
    """The effects by the twin's fit, the linear model by another response L: errors of all channels and of the effects' prior, by hand."""
    twin = twin_with((A, [6.0, -4.0]), wide=True)
    have = twin.evidence().of((A,), twin.evidence().nothing)
    L = np.random.default_rng(2).normal(size=(12, twin.n))
    monkeypatch.setattr(decision, "stated_response", lambda problem, model, still_rates: L)
    left = FitClosure(SimpleNamespace(), SimpleNamespace(model=LinearModel.from_vector(np.arange(12.0))))
    found = with_linear(twin, have.whiten, have.fit, left)
    np.testing.assert_array_equal(found.state.vector[:12], np.arange(12.0))
    np.testing.assert_array_equal(found.state.vector[12:], have.fit.state.vector[12:])
    C, prior = have.whiten.covariance, prior_sigmas(twin, [A])
    columns = have.whiten.back(have.fit.J)
    information = columns.T @ np.linalg.solve(C, columns) + np.diag(prior**-2.0)
    theta = np.linalg.inv(information)[15:]
    to_errors, to_prior = -theta @ np.linalg.solve(C, columns).T, theta / prior
    linear = L + L @ columns[:, 15:] @ to_errors, L @ columns[:, 15:] @ to_prior
    errors, priors = np.concatenate([linear[0], to_errors]), np.concatenate([linear[1], to_prior])
    index = [*range(12), 15, 16]
    np.testing.assert_allclose(found.covariance[np.ix_(index, index)], errors @ C @ errors.T + priors @ priors.T, rtol=1e-6, atol=1e-9)


def test_an_unknown_shape_widens_the_linear_model_that_is_handed_on(monkeypatch):
    """As a joint fit with a column of the shape says, where L is least squares of the linear model alone; by any L no variance of any sum
    is negative, and no number is known better for it."""
    twin = twin_with((A, [6.0, -4.0]), wide=True)
    have = twin.evidence().of((A,), twin.evidence().nothing)
    J, prior, rng = have.fit.J, np.r_[prior_sigmas(twin, [A]), 1.0], np.random.default_rng(4)
    shape = J[:, 15:] @ [3.0, 2.0] + 2 * J[:, 0] / np.linalg.norm(J[:, 0]) + 0.1 * rng.normal(size=twin.n)
    columns = np.column_stack([J, shape])
    joint = np.linalg.inv(columns.T @ columns + np.diag(prior**-2.0))
    widened = replace(have.fit, covariance=joint[:-1, :-1])
    left = FitClosure(SimpleNamespace(), SimpleNamespace(model=LinearModel.from_vector(np.arange(12.0))))
    least_squares = -np.linalg.solve(J[:, :12].T @ J[:, :12], J[:, :12].T)
    for L in (least_squares, rng.normal(size=least_squares.shape)):
        monkeypatch.setattr(decision, "stated_response", lambda *_, L=L: L @ have.whiten(np.eye(twin.n)))
        before, found = (
            np.delete(np.delete(with_linear(twin, have.whiten, fit, left).covariance, [12, 13, 14], 0), [12, 13, 14], 1)
            for fit in (have.fit, widened)
        )
        size = np.sqrt(np.diag(found))
        assert np.linalg.eigvalsh(found / np.outer(size, size)).min() > 0
        assert (size >= np.sqrt(np.diag(before)) * (1 - 1e-9)).all()
        if L is least_squares:
            assert size[0] > 1.7 * np.sqrt(before[0, 0])
            to_errors, to_prior = -joint[15:] @ columns.T, joint[15:] / prior
            errors = np.concatenate([L + L @ columns[:, 15:] @ to_errors, to_errors[:2]])
            priors = np.concatenate([L @ columns[:, 15:] @ to_prior, to_prior[:2]])
            by_hand = errors @ errors.T + priors @ priors.T
            np.testing.assert_allclose(found / np.outer(size, size), by_hand / np.outer(size, size), atol=1e-6)


def test_fit_on_what_is_left_closes_as_on_a_sensor_without_the_effect():
    """The zero follows gravity: with that taken out, held out, the session closes as the same one without it; nothing taken out changes
    nothing."""
    made = {}
    for name, per_g in (("clean", 0.0), ("bent", 0.05 * DEG)):
        options = SimulationOptions(segments=20, closure_s=0.0, seed=3, odr_hz=62.5)
        with tempfile.TemporaryDirectory() as folder:
            bent = lambda t, rate, force, temp, per_g=per_g: rate + per_g * force[:, [1, 2, 0]] / G  # noqa: E731
            made[name] = build_problem(read_session(write_session(options, Path(folder) / name, distort=bent)))
    twin = Twin(made["bent"])
    whiten = Whitener(twin)
    fit = refit(twin, whiten, [catalogue()["gyro.g_sensitivity"]], twin.start())
    clean, bent, left = (FitClosure.of(p) for p in (made["clean"], made["bent"], without_effects(made["bent"], twin, whiten, fit)))
    assert tilt_rms(bent.held_out) > 3 * tilt_rms(clean.held_out)
    assert tilt_rms(left.held_out) == pytest.approx(tilt_rms(clean.held_out), rel=0.35)
    nothing = refit(twin, whiten, [], twin.start())
    assert without_effects(made["bent"], twin, whiten, nothing) is made["bent"]
    same = cleared(made["bent"], twin, nothing.state)
    np.testing.assert_allclose(FitClosure.of(same).held_out, bent.held_out, atol=1e-6 * tilt_rms(bent.held_out))
    # The effect of a fold is that of the other turns.
    folds = without_effects(made["bent"], twin, whiten, fit).folds
    assert len(folds) == FitOptions().folds
    assert all(np.abs(fold.batch.rate - folds[0].batch.rate).max() > 0 for fold in folds[1:])


# Decisions


def moving(*spoilt, tried=(A, B, C), seed=5):
    """The evidence of twelve turns without stills."""
    twin = twin_with(*spoilt, seed=seed, resting=False)
    evidence = twin.evidence()
    evidence.will_try(list(tried))
    return evidence


def test_a_named_effect_has_walds_p_value_times_the_number_of_names_and_its_share_of_the_evidence():
    evidence = moving((B, [6.0, -4.0, 5.0]))
    best = evidence.of((B,), evidence.nothing)
    rival = Guess((C,), best.score + 9.9)
    far = Guess((A,), best.score + 10.1)
    evidence._guesses |= {"rival": rival, "far": far}
    naming = decided(evidence, best, 0.5, 7)
    (named,) = naming.named
    theta = best.fit.state.claims[0].theta
    wald = theta @ np.linalg.inv(best.fit.covariance[15:, 15:]) @ theta
    assert named.gain == pytest.approx(wald)
    assert named.p_value == pytest.approx(7 * stats.chi2.sf(wald, 3), rel=1e-9)
    weights = np.exp(-(np.array([best.score, rival.score, far.score, evidence.nothing.score]) - best.score) / 2)
    share = weights / weights.sum()
    assert named.probability == pytest.approx(share[0])
    assert named.rivals == pytest.approx({C.id: share[1], A.id: share[2]})
    assert named.equivalent == (C.id,)
    assert naming.considered == pytest.approx({C.id: share[1], A.id: share[2]})
    assert naming.p_value == named.p_value
    assert (naming.first_p, naming.beyond, naming.undersampled, naming.unusual) == (0.5, [], [], False)
    assert naming.fit is best.fit
    first = decided(evidence, best, 0.0, 7)
    assert first.p_value == 0.0
    assert not first.first.state.claims


def test_a_scanned_shape_counts_as_one_more_number():
    step = stepped("step", np.array([1.0, 2.0]), size=2)
    evidence = moving((step.at(1.0), [1.0, -1.2]))
    best = evidence.of((step.at(1.0),), evidence.nothing)
    with patch.object(decision, "borne_out", lambda *_: True), patch.object(decision, "SAID", 0.0):
        (named,) = decided(evidence, best, 0.5, 1).named
    assert named.p_value == pytest.approx(stats.chi2.sf(named.gain, 3), rel=1e-9)
    assert 1e-12 < named.p_value < 0.1
    with patch.object(decision, "borne_out", lambda *_: True), patch.object(decision, "SAID", 0.0):
        assert decided(evidence, best, 0.5, 10**15).named[0].p_value == 1.0


@pytest.mark.parametrize(
    ("mine", "equivalent", "kept"), [(0.501, 0.0, True), (0.499, 0.0, False), (0.3, 0.21, True), (0.3, 0.19, False), (0.5, 0.0, True)]
)
def test_a_name_is_said_if_it_and_its_equivalents_are_more_probable_than_not(mine, equivalent, kept):
    evidence = moving((A, [6.0, -4.0]))
    best = evidence.of((A,), evidence.nothing)
    chance = {A.id: mine, C.id: equivalent, "": 0.4, "test.other": 0.9, "unknown.line": 0.3}
    with (
        patch.object(decision, "probabilities", lambda weighed: chance),
        patch.object(decision, "rivals_of", lambda weighed, best, effect: {C.id: 5.0, "test.other": 10.0}),
    ):
        naming = decided(evidence, best, 0.001, 3)
    assert [n.effect for n in naming.named] == [A] * kept
    assert naming.considered == {C.id: equivalent, "test.other": 0.5} | ({} if kept else {A.id: mine})
    assert naming.refused == (not kept)
    assert bool(naming.fit.state.claims) == kept


def test_names_that_others_do_not_confirm_leave_the_rest_refitted():
    evidence = moving((A, [6.0, -4.0]), (C, [9.0]))
    best = evidence.of((C, A), evidence.nothing)
    with patch.object(decision, "borne_out", lambda evidence, have, number: number == 1):
        naming = decided(evidence, best, 0.5, 3)
    assert [n.effect for n in naming.named] == [A]
    assert [claim.effect for claim in naming.fit.state.claims] == [A]
    with patch.object(decision, "borne_out", lambda *_: True):
        naming = decided(evidence, best, 0.5, 3)
        assert naming.fit is best.fit
        assert [n.gain for n in naming.named] == sorted((n.gain for n in naming.named), reverse=True)
    with patch.object(decision, "part_of_a_curve", lambda *_: True):
        naming = decided(evidence, best, 0.5, 3)
        assert (naming.named, naming.fit) == ([], evidence.nothing.fit)
    with patch.object(decision, "NAMELESS", "test.c"):
        naming = decided(evidence, best, 0.5, 3)
        assert ([n.effect for n in naming.named], [n.effect for n in naming.beyond]) == ([A], [C])


@pytest.mark.parametrize(
    ("named", "undersampled", "p", "unusual", "refused"),
    [
        ([], [], 0.05, False, True),
        ([], [], 0.0501, False, False),
        ([], [], 1.0, True, True),
        ([1], [], 0.0, True, False),
        ([], [1], 0.0, True, False),
    ],
)
def test_what_no_effect_explains_is_refused(named, undersampled, p, unusual, refused):
    assert Naming(None, 1.0, None, named, None, None, [], {}, p, undersampled, unusual).refused == refused
    assert Naming(None, 1.0, None, [], None, None).p_value == 1.0


@pytest.mark.parametrize(("p", "unusual"), [(0.0099, True), (0.0101, False)])
def test_noise_is_unlike_a_sensors_below_one_in_a_hundred(p, unusual):
    evidence = moving()
    with patch("tinygc.noise.components.SessionNoise.unusual_p", lambda *_: p):
        assert decided(evidence, evidence.nothing, 0.5, 3).unusual == unusual


def test_effects_that_held_out_segments_do_not_confirm_are_taken_out_weakest_first():
    twin = twin_with((A, [6.0, -4.0]), (C, [9.0]))
    evidence = twin.evidence()
    at_rest = effect("rest", 1)
    object.__setattr__(at_rest, "observable_in", ("still",))
    best = evidence.of((A, C, at_rest), evidence.nothing)
    kept = [SimpleNamespace(effect=each, gain=gain) for each, gain in ((A, 30.0), (C, 20.0), (at_rest, 1.0))]
    assert no_worse(twin, best, kept, best.fit, lambda fit: 1.0) == (kept, best.fit)
    left, fit = no_worse(twin, best, kept, best.fit, lambda fit: 2.0)
    assert [n.effect for n in left] == [at_rest]
    assert [claim.effect for claim in fit.state.claims] == [at_rest]
    left, fit = no_worse(twin, best, kept, best.fit, lambda fit: 0.5 + (len(fit.state.claims) > 2))
    assert [n.effect for n in left] == [A, at_rest]
    both = effect("both", 1)
    object.__setattr__(both, "observable_in", ("still", "turn"))
    best = evidence.of((A, both), evidence.nothing)
    of_both, of_turns = (SimpleNamespace(effect=each, gain=gain) for each, gain in ((both, 1.0), (A, 30.0)))
    for ratio, alone, together in ((1.04, [both], [both]), (1.06, [], []), (0.99, [both], [A, both])):
        assert [n.effect for n in no_worse(twin, best, [of_both], best.fit, lambda fit, ratio=ratio: ratio)[0]] == alone
        assert [n.effect for n in no_worse(twin, best, [of_turns, of_both], best.fit, lambda fit, ratio=ratio: ratio)[0]] == together


def test_the_closure_that_fit_states_decides_what_held_out_segments_do_not_confirm():
    """Of the effects of each fit, against that without any."""
    twin = twin_with((A, [6.0, -4.0]))
    evidence = twin.evidence()
    best, tilts = evidence.of((A,), evidence.nothing), {0: 2.0, 1: 1.9}
    prove = lambda whiten, fit: SimpleNamespace(named=np.full((12, 2), tilts[len(fit.state.claims)]))  # noqa: E731
    with patch.object(decision, "borne_out", lambda *_: True), patch("tinygc.noise.components.SessionNoise.unusual_p", lambda *_: 1.0):
        assert [n.effect for n in decided(evidence, best, 0.5, 3, prove).named] == [A]
        tilts[1] = 2.1
        assert decided(evidence, best, 0.5, 3, prove).named == []


def test_a_recording_is_decided_from_the_search_to_the_name():
    """Two effects of four, beside a shape without a name: each has its probability by all subsets, and the p-value of the detection."""
    tried = [effect(name, size) for name, size in (("a", 2), ("b", 3), ("c", 1), ("d", 1))]
    line = effect("e", 2)
    object.__setattr__(line, "id", f"{NAMELESS}line")
    twin = twin_with((tried[0], [6.0, -4.0]), (tried[3], [8.0]), resting=False, columns=fixed_columns())
    said: list[str] = []
    by_nothing = lambda self, whiten, fit: SimpleNamespace(named=np.ones((12, 2)))  # noqa: E731
    with (
        patch("tinygc.explanation.evidence.first_noise", lambda twin, white: twin.noise(white)),
        patch.object(decision, "candidates", lambda twin: tried),
        patch.object(decision, "slow_candidates", lambda twin: [line]),
        patch.object(decision, "unknown_candidates", lambda twin: [line]),
    ):
        naming = decide(twin, 3, said.append)
        begun = decide(twin, 3, begin=(tried[0],))
        prove = Prover(twin.problem, twin, FitClosure())
        with patch.object(FitClosure, "effects", (effect("stated"),)), patch.object(Prover, "__call__", by_nothing):
            also = decide(twin, 3, prove=prove)
    assert [n.effect.id for n in naming.named] == ["test.d", "test.a"] or {n.effect.id for n in naming.named} == {"test.a", "test.d"}
    assert {n.effect.id for n in begun.named} == {"test.a", "test.d"}
    assert naming.beyond == []
    assert "test.stated" not in naming.considered
    assert 0 < also.considered["test.stated"] <= 0.5
    assert said[0] == "detecting"
    assert said[-2:] == ["lookalikes", "beyond the catalogue"]
    evidence = twin.evidence()
    evidence.will_try(tried)
    chance = probabilities(
        [evidence.of(tuple(each for each, bit in zip(tried, f"{k:04b}", strict=True) if bit == "1"), evidence.nothing) for k in range(16)]
    )
    for n in naming.named:
        assert n.probability == pytest.approx(chance[n.effect.id], abs=0.02)
    assert naming.first_p < 1e-3


@pytest.mark.parametrize(
    ("named", "near", "unusual", "first_p", "searched"),
    [
        (True, 59.9, False, 1.0, ["best", "nothing"]),
        (True, 60.0, False, 1.0, ["best"]),
        (False, 0.0, False, 1.0, ["best"]),
        (False, 0.0, False, 0.0499, ["best", "lines"]),
        (False, 0.0, False, 0.05, ["best"]),
        (True, 99.0, True, 1.0, ["best", "lines"]),
        (True, 99.0, False, 0.0, ["best"]),
    ],
)
def test_shapes_are_sought_beside_the_names_in_their_place_and_lines_where_something_remains(named, near, unusual, first_p, searched):
    """In their place if one alone comes within 60 of the best; lines if noise is unusual, or something is detected and has no name."""
    seen = []

    def h(name, score, effects):
        return SimpleNamespace(name=name, score=score, effects=effects, noise=SimpleNamespace(unusual=unusual))

    best, nothing = h("best", 100.0, [A] * named), h("nothing", 90.0, [])
    evidence = SimpleNamespace(twin=None, nothing=nothing)

    def search(evidence, shapes, begin, most):
        seen.append("lines" if shapes == "lines" else begin.name)
        assert most == (1 if shapes == "lines" else 2)
        return begin

    with (
        patch.object(decision, "slow_candidates", lambda twin: "slow"),
        patch.object(decision, "unknown_candidates", lambda twin: "lines"),
        patch.object(decision, "search", search),
        patch.object(decision, "guesses", lambda evidence, shapes, have: [Guess((), 100.0 + near), Guess((), 100.0 + near + 1)]),
    ):
        found = beyond_the_catalogue(evidence, "tried", best, first_p)
    assert seen == searched
    assert found.name == ("nothing" if "nothing" in searched else "best")


# Further terms of a curve


@pytest.mark.parametrize(("share", "alike"), [(0.91, True), (0.89, False)])
def test_an_effect_that_further_terms_of_a_curve_reproduce_is_one_of_them(share, alike):
    """Nine tenths of what it does beside all else that is fitted."""
    columns = fixed_columns()
    own = effect("own", 2, conditions=("rate", "dps"))
    curve = effect("curve", conditions=("rate", "dps"))
    object.__setattr__(curve, "id", f"{NAMELESS}curve_over_rate")
    term, other = effect("term"), effect("other")
    twin = twin_with(columns=lambda each: mixed if each is own else columns(each), resting=False)
    columns.rows = twin.n
    evidence = twin.evidence()
    rest = np.linalg.qr(np.hstack([twin.calibration[:, :2], columns(curve)]))[0]
    random = np.random.default_rng(1).normal(size=(twin.n, 2))
    q = np.linalg.qr(np.hstack([rest, columns(term), columns(other), random]))[0]
    mixed = np.sqrt(share) * q[:, 3:5] + np.sqrt(1 - share) * q[:, 5:]
    fit = SimpleNamespace(J=np.hstack([twin.calibration, mixed, columns(curve)]))
    fit.state = SimpleNamespace(claims=[SimpleNamespace(theta=np.ones(each.parameter.size), effect=each) for each in (own, curve)])
    best = SimpleNamespace(effects=(own, curve), fit=fit, whiten=lambda columns: columns)
    with patch.object(decision, "curves_like", lambda twin, shape: [term, other]):
        assert part_of_a_curve(evidence, best, 0) == alike
        assert not part_of_a_curve(evidence, best, 1)  # the curve itself
        best.effects = (effect("own", conditions=("time", "s")), curve)
        assert not part_of_a_curve(evidence, best, 0)
        best.effects = (effect("own"), curve)
        assert not part_of_a_curve(evidence, best, 0)
        best.effects = (own, effect("named", conditions=("rate", "dps")))
        assert not part_of_a_curve(evidence, best, 0)
    best.effects = (own, curve)
    with patch.object(decision, "curves_like", lambda twin, other: []):
        assert not part_of_a_curve(evidence, best, 0)


def test_slow_motions_that_cancel_are_one_which_states_their_sum():
    """The zero rises by 0.35 dps and no drift beside a warm-up is determined; a jump beside one is."""
    table, rng = Table().tumble(20, seed=4), np.random.default_rng(4)
    t_s = np.arange(0, table.duration_s, 1 / 52)
    rate, attitude = table.truth(t_s)
    u = t_s / t_s[-1]
    rise = np.outer(0.35 * DEG * (np.exp(1.5 * u) - 1) / (np.exp(1.5) - 1), [1.0, 0, 0])
    force = attitude.inv().apply([0, 0, -GRAVITY])
    found = {}
    for name, zero in (("rise", rise), ("jump", np.outer(0.3 * DEG * (u > 0.6), [1.0, 0, 0]) + rise)):
        gyro = rate + zero + 0.02 * DEG * rng.normal(size=rate.shape)
        samples = Samples(np.rint(t_s * 1e9).astype(np.int64), gyro, force + 2e-3 * rng.normal(size=force.shape), None)
        found[name] = Evidence(Twin(build_problem(session_of(samples, raw=False, odr_hz=52.0), use_earth=False)))
    evidence = found["rise"]
    (warm_up,) = [each for each in slow_candidates(evidence.twin) if "warm_up" in each.id][-1:]
    drift = catalogue()["gyro.bias_drift"]
    best = told_apart(evidence, evidence.of((drift, warm_up), evidence.nothing))
    (claim,) = best.fit.state.claims
    size, axis = motion(evidence.twin, [(claim.effect, claim.theta)])
    assert (size, axis) == (pytest.approx(0.35 * DEG, rel=0.25), 0)
    assert evidence.of(best.effects, None).score == min(evidence.of((each,), evidence.nothing).score for each in (drift, warm_up))
    evidence = found["jump"]
    step = max(catalogue()["gyro.bias_step"].variants(0.6 * t_s[-1:]), key=lambda each: each.shape["at_s"])
    both = evidence.of((step, warm_up), evidence.nothing)
    assert told_apart(evidence, both) is both


# Undersampling


def undersampled(factor=2.0, rms=0.8, gain=8.0, own=3.0, sigma=0.25):
    """The claim of a twin whose turns miss by ``own`` each, with the noise less probable by ``gain`` without it."""
    twin = twin_with(resting=False)
    twin.recorded = np.tile([0.6, 0.8], 12) * own
    evidence = twin.evidence()
    found = evidence.nothing
    missed = SimpleNamespace(
        rms_rad=rms,
        rate_hz=120.0,
        missed_rad=np.array([1.0, 2.0]),
        predicted_rad=np.linspace(0.1, 1.2, 12),
        exponent=2.0,
        rate_needed_hz=lambda size, floor: 1000 * size + floor,
    )
    noise = SimpleNamespace(
        missed=missed,
        size=lambda name: factor if name == UNDERSAMPLED else 7.0,
        value=100.0,
        sigma=np.array([9.0, sigma]),
        components=(Component(TURN, None, 1.0, "", 1.0, ""), Component(UNDERSAMPLED, None, 1.0, "", 1.0, "")),
    )
    passed = []
    fewer = SimpleNamespace(s="s", estimated=lambda *given: passed.append(given) or SimpleNamespace(value=100.0 + gain))
    noise.without = lambda name: fewer if name == UNDERSAMPLED else None
    with (
        patch.object(decision, "STEPS", (2, 4)),
        patch.object(twin, "residuals", lambda state: SimpleNamespace(closure=np.full((12, 2), own))),
    ):
        claims = undersampled_claim(evidence, found.whiten, found.fit, noise)
    if passed:
        whiten, r, J, s = passed[0]
        np.testing.assert_allclose(r, found.whiten.back(found.fit.r))
        np.testing.assert_allclose(J, found.whiten.back(found.fit.J) * evidence.prior(found.fit))
        assert (whiten, s) == (found.whiten, "s")
    return claims


def test_undersampling_is_claimed_with_what_it_predicts_for_every_rate():
    (claim,) = undersampled()
    size, own, floor = 1.6, 3 * np.sqrt(2), np.sqrt(2)
    each = 2 * np.sqrt(2) * np.linspace(0.1, 1.2, 12)
    assert claim.parameters == {
        "predicted_deg": pytest.approx(size / DEG),
        "share": pytest.approx(size**2 / (own**2 - floor**2)),
        "turns": [number for number, angle in enumerate(each, 1) if angle > floor],
        "rates_hz": pytest.approx([120.0, 60.0, 30.0]),
        "closure_deg": pytest.approx(np.sqrt(own**2 + np.array([0, 2.0, 8.0])) / DEG),
        "exponent": -2.0,
    }
    assert claim.std == {"predicted_deg": pytest.approx(0.25 * 0.8 / DEG)}
    assert claim.probability == pytest.approx(1 / (1 + np.exp(-4)))
    assert claim.p_value == pytest.approx(stats.chi2.sf(8.0, 1))
    assert claim.says.endswith("1601 Hz would have been enough")
    assert undersampled(sigma=np.inf)[0].std == {"predicted_deg": pytest.approx(0.8 / DEG)}
    assert undersampled(own=0.9)[0].parameters["share"] == 1.0  # below the floor
    assert undersampled(own=1.1)[0].parameters["share"] == 1.0  # more than all
    assert undersampled(own=1.2, rms=0.36)[0].parameters["share"] == pytest.approx(0.72**2 / (2 * 1.2**2 - 2))
    assert undersampled(gain=5000.0)[0].probability == 1.0


@pytest.mark.parametrize(
    ("known", "claimed"),
    [
        ({"rms": 0.501 * np.sqrt(2) / 2}, True),
        ({"rms": 0.499 * np.sqrt(2) / 2}, False),
        ({"factor": MOST_FACTOR - 1e-6}, True),
        ({"factor": MOST_FACTOR + 1e-6}, False),
        ({"gain": 3.85}, True),  # 5 % of chi-square with one degree of freedom are beyond 3.841
        ({"gain": 3.83}, False),
    ],
)
def test_undersampling_is_claimed_where_it_matters_and_is_significant(known, claimed):
    assert bool(undersampled(**known)) == claimed
