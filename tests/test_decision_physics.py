"""What is reported: held-out rows by exact refits, what is proved and handed on, and each p-value and probability by hand."""

from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG
from linear_twin import effect, linear_twin, stepped
from numpy.testing import assert_allclose
from scipy import stats

from tinygc.explanation import decision
from tinygc.explanation.decision import (
    NEAR_FLOOR,
    FitClosure,
    Naming,
    Proof,
    _expected_rms,
    _no_worse,
    _part_of_a_curve,
    _per_segment,
    _undersampled_claim,
    _with_linear,
    confirmed,
    decided,
    fold_rows,
    held_out,
    improvement_p,
    leaves_more,
    left_out,
    separated,
    tilt_rms,
)
from tinygc.explanation.evidence import Guess
from tinygc.explanation.search import NAMELESS
from tinygc.inference.prove import folds_of
from tinygc.models.linear import LinearModel
from tinygc.noise.components import MOST_FACTOR, STILL_RATE, TURN, UNDERSAMPLED, Component
from tinygc.noise.refit import prior_sigmas

A, B, C = effect("a", 2), effect("b", 3), effect("c")


def twin_with(*spoilt, seed=5, **options):
    twin = linear_twin(seed=seed, turns=12, **options)
    for each, theta in spoilt:
        twin.spoil(each, theta)
    return twin


# Held out.


def test_every_tenth_segment_is_held_out_with_the_stills_at_its_ends():
    """Rows of twelve turns and thirteen stills; a segment's misfit is counted with the still at which it begins."""
    assert [held.tolist() for held in folds_of(12)] == [[0, 10], [1, 11], *([k] for k in range(2, 10))]
    assert [held.tolist() for held in folds_of(3)] == [[0], [1], [2]]
    twin, moving = twin_with(), twin_with(resting=False)
    have, there = twin.evidence().nothing, moving.evidence().nothing
    gone = [2, 3, 22, 23, *(24 + 3 * still + axis for still in (1, 2, 11, 12) for axis in range(3)), 64, 65, 74, 75]
    assert np.flatnonzero(~fold_rows(twin, have.whiten, np.array([1, 11]))).tolist() == gone
    assert np.flatnonzero(~fold_rows(moving, there.whiten, np.array([1, 11]))).tolist() == [2, 3, 22, 23]
    rows = np.random.default_rng(0).normal(size=twin.n)
    rows[5] = np.nan  # in no fold
    square = np.nan_to_num((rows / np.sqrt(np.diag(have.whiten.covariance))) ** 2)
    expected = [square[2 * k : 2 * k + 2].sum() + square[24 + 3 * k : 27 + 3 * k].sum() + square[63 + k] for k in range(12)]
    assert_allclose(_per_segment(twin, have, rows), expected)
    sigma = np.sqrt(np.diag(there.whiten.covariance))
    assert_allclose(_per_segment(moving, there, rows[6:30]), ((rows[6:30] / sigma) ** 2).reshape(12, 2).sum(axis=1))


def refit_without(twin, have, J, r, held):
    """Rows that are held out, and what normal equations of the others predict there, with penalties of the distance from the fit of all."""
    whiten, seen, balance = have.whiten, fold_rows(twin, have.whiten, held), J.T @ r  # of the priors at the fit of all rows
    columns, rows = whiten.back(J), whiten.back(r)
    solved = np.linalg.solve(whiten.covariance[np.ix_(seen, seen)], columns[seen])
    step = np.linalg.solve(columns[seen].T @ solved + np.eye(J.shape[1]), balance - solved.T @ rows[seen])
    return ~seen, (rows + columns @ step)[~seen]


def refitted_without(twin, have, J, r):
    """(n,) each fold's rows predicted by the others."""
    found = np.full(twin.n, np.nan)
    for held in folds_of(len(twin.segments)):
        gone, rows = refit_without(twin, have, J, r, held)
        found[gone] = rows
    return found


def test_leaving_out_by_algebra_is_refitting_without_those_rows():
    twin = twin_with((A, [6.0, -4.0]), wide=True)
    evidence = twin.evidence()
    have = evidence.of((A,), evidence.nothing)
    J = have.fit.J * prior_sigmas(twin, [A])
    exact = refitted_without(twin, have, J, have.fit.r)
    assert_allclose(left_out(twin, have.whiten, have.fit.r, J), exact, rtol=1e-6, atol=1e-9)
    angles = held_out(twin, have.whiten, have.fit)
    assert_allclose(angles, exact[:24].reshape(12, 2), rtol=1e-6, atol=1e-9)
    assert tilt_rms(angles) == pytest.approx(np.sqrt(np.mean(exact[:24:2] ** 2 + exact[1:24:2] ** 2)))


def test_the_improvement_is_wilcoxons_of_exact_refits_with_and_without_the_claim():
    twin = twin_with((A, [1.5, -1.0]))
    evidence = twin.evidence()
    have = evidence.of((A, C), evidence.nothing)
    prior = evidence.prior(have.fit)
    J = have.fit.J * prior
    for number, part in ((0, slice(15, 17)), (1, slice(17, 18))):
        fewer = np.delete(J, part, axis=1)
        r = have.fit.r - have.fit.J[:, part] @ have.fit.state.claims[number].theta
        r = r - fewer @ np.linalg.solve(fewer.T @ fewer + np.eye(fewer.shape[1]), fewer.T @ r)
        gains = [_per_segment(twin, have, refitted_without(twin, have, *each)) for each in ((fewer, r), (J, have.fit.r))]
        expected = stats.wilcoxon(gains[0] - gains[1], alternative="greater").pvalue
        assert improvement_p(twin, have, prior, number) == pytest.approx(expected)
        assert (expected < 0.05) == (number == 0)


def test_a_scanned_shape_moves_with_the_rows_that_are_seen():
    """By what half the way between the neighbours of its value changes; at an end of the grid, to the one that there is."""
    step = stepped("step", np.array([1.0, 2.0, 4.0]), size=2)
    for at, near in ((2.0, (1.0, 4.0)), (1.0, (1.0, 2.0)), (4.0, (2.0, 4.0))):
        twin = twin_with((step.at(at), [3.0, -4.0]))
        evidence = twin.evidence()
        have = evidence.of((step.at(at),), evidence.nothing)
        before, after = (have.whiten(evidence.columns(step.at(each))) for each in near)
        moved, prior = (after - before) @ have.fit.state.claims[0].theta / 2, evidence.prior(have.fit)
        with patch.object(decision, "left_out", wraps=decision.left_out) as kept:
            expected = improvement_p(twin, have, prior, 0, moved)
        with patch.object(decision, "improvement_p", return_value=expected) as asked:
            assert confirmed(evidence, have, 0) == (expected < 0.05)
        assert_allclose(asked.call_args.args[-1], moved)
        J = have.fit.J * prior
        fewer, wider = np.delete(J, slice(15, 17), axis=1), np.column_stack([J, moved])
        r = have.fit.r - have.fit.J[:, 15:17] @ have.fit.state.claims[0].theta
        settled = [x - y @ np.linalg.solve(y.T @ y + np.eye(y.shape[1]), y.T @ x) for y, x in ((fewer, r), (wider, have.fit.r))]
        for call, columns in zip(kept.call_args_list, (fewer, wider), strict=True):
            assert_allclose(call.args[-1], columns)
        gains = [_per_segment(twin, have, refitted_without(twin, have, *each)) for each in zip((fewer, wider), settled, strict=True)]
        assert expected == pytest.approx(stats.wilcoxon(gains[0] - gains[1], alternative="greater").pvalue)


# What is proved, and handed on.


def proof_of(before, named, before_numbers, named_numbers, floor_rms, changed=True):
    return Proof(before, named, before_numbers, named_numbers, floor_rms, changed, FitClosure(), FitClosure(), None)


@pytest.mark.parametrize(
    ("before", "after", "changed", "removed"),
    [
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
    found = proof_of(*angles, [1, 2], [1, 2], 2.0, changed).removed
    assert found == (removed if removed is None else pytest.approx(removed))


@pytest.mark.parametrize(
    ("named", "worse", "kept"), [(0.9, False, "named"), (1.0, False, "named"), (1.005, False, "before"), (1.02, True, "before")]
)
def test_what_is_handed_on_is_the_better_on_the_turns_of_both(named, worse, kept):
    """The second turn of before, which the repair left out, does not count, however badly it closes; nor does what is below the floor."""
    tilt = np.array([[0.6, 0.8], [30.0, 40.0], [0.8, -0.6]])
    for floor, found in ((0.1, worse), (1.001 * named, False), (0.999 * named, worse)):
        proof = proof_of(tilt, named * tilt[[0, 2]], [4, 5, 7], [4, 7], floor)
        assert (proof.ratio, proof.worse) == (pytest.approx(named), found)
    assert proof.after is getattr(proof, kept)
    assert proof.after_numbers == {"named": [4, 7], "before": [4, 5, 7]}[kept]
    assert proof_of(0 * tilt, tilt, [4, 5, 7], [4, 5, 7], 0.1).ratio == 1.0


def test_what_is_handed_on_has_the_covariance_of_both_estimates_for_the_same_errors():
    """The effects by the twin's fit, the linear model by another response L: errors of all channels and of the effects' prior, by hand."""
    twin = twin_with((A, [6.0, -4.0]), wide=True)
    have = twin.evidence().of((A,), twin.evidence().nothing)
    L = np.random.default_rng(2).normal(size=(12, twin.n))
    left = FitClosure(SimpleNamespace(), SimpleNamespace(model=LinearModel.from_vector(np.arange(12.0))))
    with patch.object(decision, "stated_response", lambda problem, model: L):
        found = _with_linear(twin, have.whiten, have.fit, left)
    np.testing.assert_array_equal(found.state.vector, [*range(12), *have.fit.state.vector[12:]])
    C, prior = have.whiten.covariance, prior_sigmas(twin, [A])
    columns = have.whiten.back(have.fit.J)
    solved = np.linalg.solve(C, columns)
    theta = np.linalg.inv(columns.T @ solved + np.diag(prior**-2.0))[15:]
    to_errors, to_prior, own = -theta @ solved.T, theta / prior, L @ columns[:, 15:]
    errors, priors = np.concatenate([L + own @ to_errors, to_errors]), np.concatenate([own @ to_prior, to_prior])
    index = [*range(12), 15, 16]
    assert_allclose(found.covariance[np.ix_(index, index)], errors @ C @ errors.T + priors @ priors.T, rtol=1e-6, atol=1e-9)


# Decisions.


def moving(*spoilt, tried=(A, B, C), seed=5):
    """The evidence of twelve turns without stills."""
    twin = twin_with(*spoilt, seed=seed, resting=False)
    evidence = twin.evidence()
    evidence.will_try(list(tried))
    return evidence


def test_a_named_effect_has_walds_p_value_times_the_number_of_names_and_its_share_of_the_evidence():
    evidence = moving((B, [6.0, -4.0, 5.0]))
    best = evidence.of((B,), evidence.nothing)
    evidence._guesses |= {"rival": Guess((C,), best.score + 9.9), "far": Guess((A,), best.score + 10.1)}
    naming = decided(evidence, best, 0.5, 7)
    (named,) = naming.named
    theta = best.fit.state.claims[0].theta
    wald = theta @ np.linalg.inv(best.fit.covariance[15:, 15:]) @ theta
    assert named.gain == pytest.approx(wald)
    assert named.p_value == pytest.approx(7 * stats.chi2.sf(wald, 3), rel=1e-9, abs=0)
    weights = np.exp(-np.array([0.0, 9.9, 10.1, evidence.nothing.score - best.score]) / 2)
    mine, rival, far, _ = weights / weights.sum()
    assert named.probability == pytest.approx(mine)
    assert named.rivals == pytest.approx({C.id: rival, A.id: far})
    assert named.equivalent == (C.id,)
    assert naming.considered == pytest.approx({C.id: rival, A.id: far})
    assert naming.p_value == named.p_value
    assert (naming.first_p, naming.beyond, naming.undersampled, naming.unusual) == (0.5, [], [], False)
    assert naming.fit is best.fit
    first = decided(evidence, best, 0.0, 7)
    assert (first.p_value, len(first.first.state.claims)) == (0.0, 0)


@pytest.mark.parametrize(("mine", "equivalent", "kept"), [(0.501, 0.0, True), (0.499, 0.0, False), (0.3, 0.21, True), (0.3, 0.19, False)])
def test_a_name_is_said_if_it_and_its_equivalents_are_more_probable_than_not(mine, equivalent, kept):
    """What is weighed beside it has these shares: an equivalent within ten of its score, and nothing."""
    D = effect("d")
    evidence = moving((A, [6.0, -4.0]), tried=(A, B, C, D))
    best = evidence.of((A,), evidence.nothing)
    for effects, share in (((C,), equivalent), ((B, D), 1 - mine - equivalent)):
        if share:
            evidence._guesses[effects] = Guess(effects, best.score - 2 * np.log(share / mine))
    naming = decided(evidence, best, 0.001, 3)
    assert [n.effect for n in naming.named] == [A] * kept
    considered = {B.id: 1 - mine - equivalent, D.id: 1 - mine - equivalent} | ({C.id: equivalent} if equivalent else {})
    considered |= {} if kept else {A.id: mine}
    assert naming.considered == pytest.approx({name: min(p, 0.5) for name, p in considered.items()}, rel=1e-4)
    assert (naming.unnamed, bool(naming.fit.state.claims)) == (not kept, kept)


def test_names_that_others_do_not_confirm_leave_the_rest_refitted_and_a_shape_is_no_name():
    """A scanned shape counts as one more number."""
    line, step = effect("line"), stepped("step", np.array([1.0, 2.0]), size=2)
    object.__setattr__(line, "id", f"{NAMELESS}line")
    for beside, named, beyond in ((None, [A], []), (C, [C, A], []), (line, [A], [line])):
        evidence = moving((A, [6.0, -4.0]), *([(beside, [9.0])] if beside else []))
        best = evidence.of((beside or C, A), evidence.nothing)
        naming = decided(evidence, best, 0.5, 3)
        assert {n.effect for n in naming.named} == set(named)
        assert [n.effect for n in naming.beyond] == beyond
        assert (naming.fit is best.fit) == (beside is not None)
        assert {claim.effect for claim in naming.fit.state.claims} == {*named, *beyond}
        assert [n.gain for n in naming.named] == sorted((n.gain for n in naming.named), reverse=True)
    evidence = moving((step.at(1.0), [3.0, -4.0]))
    best = evidence.of((step.at(1.0),), evidence.nothing)
    (named,) = decided(evidence, best, 0.5, 1).named
    assert named.p_value == pytest.approx(stats.chi2.sf(named.gain, 3), rel=1e-9, abs=0)


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
    assert Naming(None, 1.0, None, named, None, None, [], {}, p, undersampled, unusual).unnamed == refused
    assert not Naming(None, 1.0, None, [], None, None).unnamed


def test_effects_that_held_out_segments_do_not_confirm_are_taken_out_weakest_first():
    """Of those that turns show; what stills show as well may close a twentieth worse."""
    twin = twin_with((A, [6.0, -4.0]), (C, [9.0]))
    evidence = twin.evidence()
    at_rest, both = effect("rest", 1), effect("both", 1)
    object.__setattr__(at_rest, "observable_in", ("still",))
    object.__setattr__(both, "observable_in", ("still", "turn"))
    best = evidence.of((A, C, at_rest, both), evidence.nothing)
    gains = {A: 30.0, C: 20.0, at_rest: 1.0, both: 0.5}

    def left(some, ratio):
        kept = [SimpleNamespace(effect=each, gain=gains[each]) for each in some]
        kept, fit = _no_worse(twin, best, kept, best.fit, ratio)
        assert fit is best.fit or [claim.effect for claim in fit.state.claims] == [n.effect for n in kept]
        return [n.effect for n in kept]

    assert left((A, C, at_rest), lambda fit: 1.0) == [A, C, at_rest]
    assert left((A, C, at_rest), lambda fit: 2.0) == [at_rest]
    assert left((A, C, at_rest), lambda fit: 0.5 + (C in [claim.effect for claim in fit.state.claims])) == [A, at_rest]
    for ratio, alone, together in ((1.04, [both], [both]), (1.06, [], []), (0.99, [both], [A, both])):
        assert left((both,), lambda fit, ratio=ratio: ratio) == alone
        assert left((A, both), lambda fit, ratio=ratio: ratio) == together


@pytest.mark.parametrize("share", [0.91, 0.89])
def test_slow_motions_of_which_one_is_a_term_of_the_others_curve_are_one(share):
    """Where nine tenths of it are, by the angle between both beside all else; the one with the more evidence states their sum."""
    drift, curve = (effect(name, conditions=("time", "s")) for name in ("drift", "curve"))
    object.__setattr__(drift, "id", "gyro.bias_drift")
    object.__setattr__(curve, "id", "unknown.curve_over_time")
    twin = twin_with((drift, [9.0]), (curve, [6.0]))
    evidence = twin.evidence()
    best = evidence.of((drift, curve), evidence.nothing)
    own, rest = best.fit.J[:, 15:16], np.delete(best.fit.J, 15, axis=1)
    term, apart = effect("term"), np.random.default_rng(1).normal(size=own.shape)
    own, apart = (each - rest @ np.linalg.lstsq(rest, each, rcond=None)[0] for each in (own, apart))
    apart -= own * (own.T @ apart) / (own.T @ own)
    leans = np.sqrt(share) * own / np.linalg.norm(own) + np.sqrt(1 - share) * apart / np.linalg.norm(apart)
    evidence.replay._known[term] = best.whiten.back(leans)
    with patch.object(decision, "curves_like", lambda twin, shape: [term, curve] if shape is curve else []):
        assert _part_of_a_curve(evidence, best, 0) == (share > 0.9)
        assert not _part_of_a_curve(evidence, best, 1)
        alone = [evidence.of((each,), best) for each in (drift, curve)]
        assert separated(evidence, best) is (min(alone, key=lambda h: h.score) if share > 0.9 else best)
        assert _part_of_a_curve(evidence, evidence.of((drift,), best), 0) is False


def test_what_has_a_cause_is_expected_of_a_closure_and_more_has_no_name():
    """The floor, what bridged readings add, and what is estimated of all but each turn's and each still's own error."""
    noise, gone = SimpleNamespace(covariance=np.diag([1.0, 2, 3, 4, 5, 6, 99])), []
    noise.without = lambda name: gone.append(name) or noise
    naming = SimpleNamespace(noise=noise, whiten=SimpleNamespace(parts={"closure": slice(0, 6)}), beyond=[], unusual=False)
    original = SimpleNamespace(widened=[SimpleNamespace(cause="impact", sigma_rad=9.0)], used=range(3))
    twin = SimpleNamespace(batch=SimpleNamespace(angles=2), errors=(), original=original)
    proof = SimpleNamespace(floor_rms=3.0, worse=False)
    assert _expected_rms(SimpleNamespace(batch=twin.batch, errors=("own",)), naming, proof) == 3.0
    gone.clear()
    assert _expected_rms(twin, naming, proof) == pytest.approx(4.0)
    original.widened = [SimpleNamespace(cause="gap", sigma_rad=np.sqrt(each)) for each in (3.0, 6.0, 18.0)]
    assert _expected_rms(twin, naming, proof) == pytest.approx(5.0)
    original.widened, gone = [], gone[:2]
    assert gone == [TURN, STILL_RATE]
    for share, left in ((0.99, False), (1.01, True)):
        proof.after = np.full((5, 2), 4.0 * NEAR_FLOOR * share / np.sqrt(2))
        assert leaves_more(twin, naming, proof) == left
    proof.after *= 0
    for name, value in (("beyond", [1]), ("unusual", True)):
        assert leaves_more(twin, SimpleNamespace(**{**vars(naming), name: value}), proof)
    assert leaves_more(twin, naming, SimpleNamespace(**{**vars(proof), "worse": True}))


# Undersampling.


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
        claims = _undersampled_claim(evidence, found.whiten, found.fit, noise)
    if passed:
        white, r, J, s = passed[0]
        assert_allclose(r, found.whiten.back(found.fit.r))
        assert_allclose(J, found.whiten.back(found.fit.J) * evidence.prior(found.fit))
        assert white is found.whiten.base
        assert s == "s"
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
    assert claim.description.endswith("1601 Hz would have been enough")
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
