"""The search for a law: columns against the twin's, what chance promises, what is put away, and the rules by which a law is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from discovery_answers import DECIDED, LAWS, law_of, some_movement
from numpy.testing import assert_allclose, assert_array_equal
from simulated_twins import make_twin_of

from session.base.units import DEG
from tinygc.features.discovery import engine, search_state
from tinygc.features.discovery.detection_limits import learnable, learnable_from
from tinygc.features.discovery.enumeration import enumerated
from tinygc.features.discovery.form import PATTERNS, Factor, LawForm
from tinygc.features.discovery.law_effect import as_effect, correlation, left_by_calibration
from tinygc.features.discovery.projections import FAINT, Projection
from tinygc.features.discovery.quantities import largest_of
from tinygc.features.discovery.responses import Responses
from tinygc.features.discovery.screening import Chance, screened
from tinygc.features.discovery.search_state import (
    FEWEST,
    RUN,
    Unseen,
    parted,
    refused,
    taken,
)
from tinygc.features.discovery.selection import Constants, FormEvidence, _takes_calibration, exact, one_step
from tinygc.inference.choose import PRIOR_ODDS, SCALES, STAND_IN
from tinygc.inference.solve import left_of, orthonormal
from tinygc.noise.refit import Replay, refit
from tinygc.noise.twin import Twin, claim_slice

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")
ROOT_CUBE = LawForm((Factor("rate", "root_cube"),))
THETA = np.array([3.0, -2.0, 2.5]) * DEG
FS_RPS = 500 * DEG


@pytest.mark.parametrize(("worse", "chi_worse", "nearest"), [(4.0, np.inf, 4.0), (4.0, 1.0, 1.0), (-2.0, 1.0, -2.0)])
def test_a_rival_is_as_near_as_the_lesser_of_evidence_and_chi_square(worse, chi_worse, nearest):
    assert search_state.Rival(ROOT_CUBE, as_effect(ROOT_CUBE, "discovered.other", 1.0), worse, 0.9, chi_worse).nearest == nearest


class Seen:
    """A session, what is fitted to it, and forms; law(…): a fit whose residuals are noise and what a law adds."""

    def __init__(self, twin, whiten):
        self.twin, self.whiten = twin, whiten
        self.fit = refit(twin, whiten, [], twin.start())
        self.replay = Replay(twin, self.fit)
        self.responses = Responses(self.replay)
        largest = {name: size if name in ("force", "temperature") else 0.0 for name, size in largest_of(twin.movements).items()}
        every = [form for form in enumerated(largest) if form.size <= 9][::9]
        rates = [LawForm((Factor("rate", name),)) for name in ("square", "cube", "signed_root", "sign")]
        self.forms = [ROOT_CUBE, LawForm((Factor("rate", "dead_zone", 0.13),)), *rates, *every]

    def law(self, seed, form=None, theta=None):
        noise = np.random.default_rng(seed).standard_normal(self.responses.channels)
        return replace(self.fit, r=noise + (0.0 if form is None else self.whiten(self.responses.columns(form) @ theta)))

    def screened(self, fit, seed=1, forms=None, **options):
        forms = forms or self.forms
        return screened(self.replay, forms, [(self.whiten, fit)], seed, **options)


@pytest.fixture(scope="module")
def seen(twin_of):
    return Seen(*twin_of(warm_up_c=6.0, odr_hz=62.5))


# Columns and what is seen of them.


def of_every_pattern():
    plain, late = Factor("rate", "size"), Factor("acceleration", "itself", None, 0.15)
    yield from (
        LawForm((factor,), pattern) for factor, pattern in ((plain, "each"), (late, "full"), (Factor("force", "wave", 0.7), "cross"))
    )
    yield from (LawForm((Factor("rate"), Factor("force", "square")), pattern) for pattern in PATTERNS)
    yield LawForm((Factor("temperature", "root"), Factor("sense")))
    yield LawForm((Factor("rate"), Factor("rate")), "next")
    yield LawForm((Factor("time", "decay", 20.0),))


def test_columns_are_the_twins(seen):
    for form in of_every_pattern():
        expected = seen.replay.columns(as_effect(form)).stacked()
        size = np.linalg.norm(expected, axis=0)
        assert np.all(np.linalg.norm(seen.responses.columns(form) - expected, axis=0) <= 1e-9 * size), form


def test_gains_are_those_of_the_catalogues_ranking(seen):
    """``search.promises`` for each form by itself, in double precision."""
    fit = seen.law(2)
    screening, q = seen.screened(fit, draws=8), orthonormal(fit.J)
    for number in range(0, len(seen.forms), 13):
        basis = left_of(q, seen.whiten(seen.replay.columns(as_effect(seen.forms[number])).stacked()), FAINT)
        assert screening.rank[0, number] == basis.shape[1]
        assert screening.gain[0, number] == pytest.approx(np.sum((basis.T @ (fit.r - q @ (q.T @ fit.r))) ** 2), rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("rows", [None, np.r_[0:20, 30:60]], ids=["all", "some rows"])
def test_a_look_is_what_a_dense_projection_makes_of_it(seen, rows):
    """Whitening by a full matrix, and the nuisance taken out by I - q q': lengths and scalar products are the same to rounding."""
    fit = seen.law(8)
    projection, rows = Projection(seen.twin, seen.whiten, fit, rows), np.arange(len(fit.r)) if rows is None else rows
    whitening = np.linalg.inv(np.linalg.cholesky(seen.whiten.covariance[np.ix_(rows, rows)]))
    q = orthonormal(whitening @ seen.whiten.back(fit.J)[rows])
    columns = seen.responses.columns(LawForm((Factor("rate", "size"),), "full"))[rows]
    columns /= np.linalg.norm(columns, axis=0)
    expected, residual = ((each - q @ (q.T @ each)) for each in (whitening @ columns, whitening @ seen.whiten.back(fit.r)[rows]))
    free, dense = projection.seen(columns), projection.matrix()
    assert (projection.free, dense.dtype) == (len(rows) - q.shape[1], np.float32) == (len(free), dense.dtype)
    assert_allclose(free.T @ free, expected.T @ expected, rtol=0, atol=1e-9 * np.abs(expected.T @ expected).max())
    assert_allclose(free.T @ projection.residual, expected.T @ residual, rtol=1e-9)
    # The matrix has those rows first, then those along the nuisance, which have the rest of the length.
    assert_allclose(dense[: len(free)] @ columns, free, rtol=0, atol=1e-5 * np.abs(free).max())
    assert_allclose(np.linalg.norm(dense @ columns, axis=0), np.linalg.norm(projection.whitened(columns), axis=0), rtol=1e-5)


def test_a_law_that_is_put_in_promises_most_and_could_be_learnt_from_a_share_of_it(seen):
    screening = seen.screened(seen.law(3, ROOT_CUBE, THETA))
    best = screening.order[0]
    assert seen.forms[best] == ROOT_CUBE
    assert screening.chance.p(screening.tested[best]) < 1e-6
    assert screening.tested[best] == screening.best_after_last
    one, two = (learnable_from(screening, ROOT_CUBE, size * THETA, 0.01) for size in (1, 2))
    assert one < 2
    assert two == pytest.approx(one / 2, rel=0.05)
    sizes = learnable(screening, 0.01)
    assert {"rate", "force"} <= set(sizes)
    assert all(size is None or 1e-5 < size / DEG < 5 for size in sizes.values())


def test_noise_that_is_larger_than_stated_raises_no_alarm(seen):
    fit = seen.law(7)
    usual, loud = (seen.screened(replace(fit, r=scale * fit.r), draws=100) for scale in (1.0, 1.6))
    assert_allclose(loud.gain, 1.6**2 * usual.gain, rtol=1e-4, atol=1e-4)
    assert loud.promise.max() > usual.promise.max() + 5
    assert loud.tested.max() == pytest.approx(usual.tested.max(), abs=1.0)
    assert usual.chance.p(loud.tested.max()) > 0.01
    assert "no more than chance" in refused(answered(chance_p=usual.chance.p(usual.tested.max())), LAW)  # so no law is said


def test_the_tail_goes_on_where_draws_end():
    """Of a law whose tail is known: the largest of a thousand exponentials; within the draws, their own share."""
    drawn = np.sort(np.random.default_rng(0).exponential(2.0, (200, 1000)).max(axis=1))
    chance = Chance(drawn)
    for p in (1e-3, 1e-5):
        exact = -2.0 * np.log(-np.expm1(np.log1p(-p) / 1000))
        assert np.log10(chance.p(exact)) == pytest.approx(np.log10(p), abs=1.0)
    assert chance.p(np.median(drawn)) == chance.p(drawn[100]) == (1 + 100) / 201
    assert chance.level(0.5) == np.quantile(drawn, 0.5)
    assert chance.p(chance.level(0.01)) == pytest.approx(0.01)
    assert chance.p(-np.inf) == 1.0
    # 40 of 201 draws are beyond the tail's beginning, whose scale is a mean of theirs and of 20 of the prior's
    scale = (np.sum(drawn[-40:] - drawn[-40]) + 20 * 2.0) / (39 + 20)
    assert chance.p(drawn[-40] + 3.0) == pytest.approx(40 / 201 * np.exp(-3.0 / scale))


def test_forms_that_are_the_same_here_are_said_and_neighbours_differ_by_constants(seen):
    wide = LawForm((Factor("temperature", "within", 1e3),))
    twice, square = LawForm((Factor("temperature"), Factor("temperature"))), LawForm((Factor("temperature", "square"),))
    plain, zones = LawForm((Factor("temperature"),)), [LawForm((Factor("rate", "dead_zone", width),)) for width in (0.2, 0.1)]
    others = [form for form in seen.forms if "temperature" not in repr(form) and "dead_zone" not in repr(form)][:40]
    wider = [LawForm((Factor("temperature", "within", width),)) for width in np.arange(2, 10) * 1e3]
    screening = seen.screened(seen.fit, forms=[wide, twice, square, plain, *zones, *others, *wider], draws=64)
    assert screening.same_as(plain) == [wide, *wider[:7]]
    for form, other, alike in (wide, plain, True), (twice, square, True), (plain, square, False):
        assert (other in screening.same_as(form)) == alike
    assert screening.leaders[:4].tolist() == [0, 1, 1, 0]
    assert screening.distinct <= np.sum(screening.rank[-1] > 0) - 2
    assert screening.neighbours(zones[0].with_constants((0.12,))) == zones[::-1]


def test_a_form_that_needs_the_calibrations_place_is_told_from_a_law(seen):
    """What one turn alone has is said by the rate of all the others, and a scale factor that makes up for it."""
    first = LawForm((Factor("rate"), Factor("time", "beyond", 6.0)))
    for form, theta, takes in ((first, np.array([0.5, 0.5, -0.5]) * FS_RPS, True), (ROOT_CUBE, THETA, False)):
        fit = seen.law(4, form, theta)
        assert _takes_calibration(form, seen.responses, Projection(seen.twin, seen.whiten, fit), fit) == takes


# What is put away.


@pytest.mark.parametrize("turns", [(20,), (21,), (48,), (3,) * 10, (5,) * 6, (6,) * 4, (18, 9), (9, 9)])
def test_of_any_session_a_third_is_put_away_and_at_least_as_much_is_left(turns):
    """Many short logs are one session: none is counted anew.  Of several, the smallest that is enough for a test is put away whole."""
    used = [SimpleNamespace(log=number) for number, count in enumerate(turns) for _ in range(count)]
    problem = SimpleNamespace(used=used, without=lambda held: held)
    drawn = [parted(problem, seed) for seed in range(9)]
    for split in drawn:
        rest = sum(turns) - len(split.recording)
        assert FEWEST <= len(split.parts) <= rest / 3 + (RUN if rest > 20 else 1)
        assert np.count_nonzero(~split.seen) >= 2 * FEWEST
        assert np.flatnonzero(split.seen).tolist() == sorted([*split.parts, *split.recording])
        assert split.log == {(18, 9): 1, (5,) * 6: 0, (6,) * 4: 0}.get(turns)
    assert len({tuple(split.parts.tolist()) for split in drawn}) == 3


def test_a_problem_without_some_turns_is_the_same_problem_elsewhere(seen):
    """Its twin closes the turns that stay as the whole one does; neighbours across the gap share no still."""
    problem = seen.twin.problem
    held = np.isin(np.arange(12), [4, 5, 6, 7])
    part = problem.without(held)
    whole, fewer = (twin.residuals(twin.start()) for twin in (seen.twin, Twin(part)))
    assert_allclose(fewer.closure, whole.closure[~held], atol=1e-12)
    still = ~np.isin(np.arange(len(seen.twin.stills)), [5, 6, 7])  # the stills between two turns that go
    assert_allclose(fewer.still, whole.still[still], atol=1e-12)
    assert_array_equal(part.still_rates.rate, problem.still_rates.rate[still])
    assert np.all(part.floor.shared[3] == 0)
    assert_array_equal(part.floor.shared[[2, 4]], problem.floor.shared[[2, 8]])


def test_what_a_calibration_takes_up_does_not_make_two_laws_alike():
    movement = some_movement(6)
    rate = movement.rate
    scale, law = 0.01 * rate + 0.02, rate * np.abs(rate)
    assert correlation(left_by_calibration(law, [movement]), left_by_calibration(law + scale, [movement])) == pytest.approx(1)
    assert np.abs(left_by_calibration(scale, [movement])).max() < 1e-12
    assert abs(correlation(left_by_calibration(law, [movement]), left_by_calibration(np.roll(law, 1, axis=1), [movement]))) < 0.5
    assert correlation(law, 0 * law) == 0.0


def rectifying(t_s, rate, force, temp_c):
    """Two axes that turn together make the third read, and each axis is soft."""
    product = np.roll(rate, -1, axis=1) * np.roll(rate, -2, axis=1) / FS_RPS
    return rate + np.array([0.02, -0.015, 0.01]) * product


def soft(t_s, rate, force, temp_c):
    return rate + SIZE * np.tanh(rate / FS_RPS / 0.08)


SIZE = np.array([0.3, -0.25, 0.3]) * DEG


def test_a_law_holds_on_what_was_put_away_and_a_wrong_one_does_not(twin_of):
    whole = twin_of(rectifying, segments=16, odr_hz=62.5)[0]
    split = parted(whole.problem, 1)
    evidence = FormEvidence(Twin(split.seen), 17000)
    unseen = Unseen(whole, evidence.twin)
    product, force = LawForm((Factor("rate"), Factor("rate")), "next"), LawForm((Factor("force", "square"),))
    right, wrong = (evidence.of((evidence.effect_of(form),), evidence.nothing) for form in (product, force))
    held, worse = (unseen.assessed(evidence.nothing, law, split.parts) for law in (right, wrong))
    assert held.p_value < 0.05 < worse.p_value
    assert worse.removed < 0.5 < 0.99 < held.removed
    assert held.floor_rad < held.after_rad < 0.1 * held.before_rad
    floor = np.sqrt(np.mean(np.trace(whole.problem.floor.white[split.parts, :2, :2], axis1=1, axis2=2)))
    for found, law in (held, right), (worse, wrong):
        closures = [whole.residuals(each.fit.state).closure[split.parts] for each in (evidence.nothing, law)]
        before, after = (np.sqrt(np.mean(np.sum(closure[:, :2] ** 2, axis=1))) for closure in closures)
        assert (found.floor_rad, found.before_rad, found.after_rad) == pytest.approx((floor, before, after), rel=1e-9)
        assert found.removed == pytest.approx(1 - (after**2 - floor**2) / (before**2 - floor**2), rel=1e-9)
    assert held.segments == len(split.parts)
    assert worse.noise_p < search_state.NOISE_P < held.noise_p
    assert unseen.assessed(evidence.nothing, right, split.recording) is None
    law = evidence.effect_of(LawForm((Factor("rate", "cube"),)))
    assert evidence.price(law) == pytest.approx(2 * np.log(17000 * SCALES / PRIOR_ODDS) + 3)


def test_a_constant_is_recovered_with_its_uncertainty_which_is_part_of_the_coefficients(twin_of):
    """Begun a third off."""
    evidence = FormEvidence(twin_of(soft, segments=16, odr_hz=62.5)[0], 17000)
    law = evidence.effect_of(LawForm((Factor("rate", "soft", 0.11),)))
    began = evidence.of((law,), evidence.nothing)
    assert one_step(evidence, began, law, 1e6) == (began, law)
    have, law = exact(evidence, began, law)
    form = evidence.forms[law.id]
    known = Constants.of(evidence.twin, have, law, form)
    (constant,), (sigma,) = form.constants, known.sigmas(form)
    assert have.score < began.score
    assert constant == pytest.approx(0.08, abs=3.5 * sigma)
    part, held = claim_slice(have.fit.state.claims, 0), have.fit.covariance
    std = np.sqrt(np.diag(known.widened(held)))[part]
    assert np.all(np.abs(have.fit.state.claims[0].theta - SIZE) < 4 * std)
    assert np.all(std > np.sqrt(np.diag(held))[part])


def test_forms_that_take_up_as_much_in_any_projection_are_tried_the_plainest_first():
    """Beside the law without its lag, six in all; of one shape the one of the greatest gain."""
    cube, same = (LawForm((Factor("rate", "cube", None, lag_s),)) for lag_s in (0.1, 0.3))
    plain, sign, square, little = (LawForm((Factor("rate", name),)) for name in ("cube", "sign", "square", "signed_root"))
    two, full = LawForm((Factor("rate"), Factor("force"))), LawForm((Factor("rate", "size"),), "full")
    dead, less_dead, soft = (LawForm((Factor("rate", name, c),)) for name, c in (("dead_zone", 0.1), ("dead_zone", 0.2), ("soft", 0.1)))
    bar = (1 - search_state.MISSING_SHARE) * np.array([60.0, 120.0]) - STAND_IN - search_state.MARGIN
    gains = {
        cube: (50, 120), same: (60, 100), little: bar - 0.1, square: (bar[0] + 0.1, 0), sign: (0, bar[1] + 0.1), full: (300, 0),
        two: (bar[0] + 0.2, 0), less_dead: (0, 300), dead: (0, 400), soft: (0, 200),
    }  # fmt: skip
    round_ = SimpleNamespace(screening=SimpleNamespace(forms=list(gains), gain=np.array(list(gains.values()), dtype=float).T))
    law = SimpleNamespace(id="law")

    def alike(form):
        evidence = SimpleNamespace(forms={"law": form}, effect_of=lambda other: other)
        return search_state.alike(SimpleNamespace(evidence=evidence, round_of=lambda law: round_), law)

    assert alike(cube) == [plain, sign, square, two, full, dead]
    assert alike(LawForm((Factor("rate"),))) == []


# Each rule by which a law is refused or is no more than a candidate: alone it decides, and at its limit.

FORM = LAWS["matrix"][0]
LAW, OTHER = as_effect(FORM, "discovered.n0"), as_effect(LAWS["warm"][0], "gyro.other")
#: what the law is worth, -2 log evidence
WORTH = 200.0
NOTHING = SimpleNamespace(state=SimpleNamespace(claims=()))


def held_out(**changed):
    """A test on what was put away that a law passes."""
    return SimpleNamespace(**{**vars(DECIDED), **changed})


def answered(chance_p=1e-4, catalogue=WORTH, without=WORTH, shapes=WORTH, tests=(DECIDED,), name=WORTH, **more):
    """A search that has come to one law, of which nothing speaks against it but what is changed; name: worth of a name in its place."""
    evidence = SimpleNamespace(
        forms={LAW.id: FORM}, exhausted=True, twin=SimpleNamespace(movements=[some_movement(3)]),
        guess=lambda best, without, add: SimpleNamespace(score=name),
    )  # fmt: skip
    best = SimpleNamespace(score=0.0, ids={LAW.id}, effects=(LAW,), noise=SimpleNamespace(unusual=False), fit=NOTHING)
    return SimpleNamespace(
        evidence=evidence, best=best, names=[OTHER], laws=[LAW], chance_p=lambda law: chance_p, held_out_of=lambda law: tests,
        catalogue=SimpleNamespace(score=catalogue, ids={"gyro.other"}), shapes=SimpleNamespace(score=shapes, ids={"unknown.smooth"}),
        without=lambda law: SimpleNamespace(score=without), closes_to_noise=True, **more,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"chance_p": 1.01 * search_state.CHANCE}, "no more than chance"),
        ({"catalogue": STAND_IN - 0.1}, "gyro.other is of equal worth"),
        ({"without": STAND_IN - 0.1}, "the rest explains"),
        ({"name": STAND_IN - 0.1}, "on the turns that were searched gyro.other is of equal worth with the rest"),
        ({"shapes": -STAND_IN - 0.1}, "a shape without a law does better: unknown.smooth"),
        ({"tests": (DECIDED, held_out(removed=0.0))}, "worsens the closure"),
        ({"tests": (DECIDED, held_out(p_value=0.0505))}, "chance improves the held-out segments"),
    ],
)
def test_one_reason_is_enough_and_at_the_limits_none_refuses(changed, said):
    assert said in refused(answered(**changed), LAW)
    limits = {"chance_p": search_state.CHANCE, "catalogue": STAND_IN, "without": STAND_IN, "shapes": -STAND_IN, "name": STAND_IN}
    assert refused(answered(**limits, tests=(held_out(removed=0.01, p_value=0.05), held_out(removed=None))), LAW) is None


@pytest.mark.parametrize(
    ("tests", "share"),
    [
        ([(0.5, search_state.NOISE_P)], 1),
        ([(0.5, search_state.NOISE_P), (0.97, search_state.NOISE_P / 2)], 0.97),
        ([(None, 0.0)], 1),
    ],
)
def test_what_is_left_counts_where_it_is_no_noise(tests, share):
    assert taken(answered(tests=[held_out(removed=removed, noise_p=noise_p) for removed, noise_p in tests])) == share


def test_what_is_left_asks_for_no_further_law_where_the_turns_close_to_noise():
    searched = answered(tests=(held_out(removed=0.1, noise_p=0.0),))
    assert not search_state.leaves_something(searched)
    searched.closes_to_noise = False
    assert search_state.leaves_something(searched)


DEAD_ZONE, LATCH = LAWS["dead zone"], (LawForm((Factor("rate", "latch", 0.076),)), [1.0, 1.0, 1.0])
AXES = SimpleNamespace(constant=0, values=np.array([0.01, 0.02, 0.04]), more=31.4)


LAG = (LawForm((Factor("rate", "size", None, 0.99 * engine.SETTLED_S),)), [1.0, 1.0, 1.0])
SETTLED = (LawForm((Factor("rate", "size", None, engine.SETTLED_S),)), [1.0, 1.0, 1.0])
TWICE = 2 * engine.DECISIVE


@pytest.mark.parametrize(
    ("law", "gain", "told", "share", "why"),
    [
        (LAWS["matrix"], TWICE, {}, search_state.ALL_OF_IT, ""),
        (LAWS["matrix"], TWICE, {}, search_state.ALL_OF_IT - 0.001, "98.9 % of the excess goes with it"),
        (LAWS["matrix"], engine.DECISIVE - 1, {}, 1.0, "too little is seen of it"),
        (LAWS["matrix"], TWICE, {"others": 2}, 1.0, "3 forms of equal worth add different rates"),
        (LAWS["matrix"], TWICE, {"against_gravity": True}, 1.0, "the turns close with it, and within them gravity"),
        (LAWS["matrix"], TWICE, {"lacking": 0.0501}, 1.0, "its numbers are not known well enough: in 5 of 100"),
        (DEAD_ZONE, TWICE, {"axes": AXES}, 1.0, "its width (of full scale) seems to differ by axis (0.01, 0.02, 0.04; chi-square 31)"),
        (LATCH, TWICE, {"threshold": (0.07, 0.081)}, 1.0, "its threshold (of full scale) may be from 0.07 to 0.081: no turn peaks"),
        (LAG, TWICE, {}, 1.0, "a lag below 0.1 s"),
        (SETTLED, TWICE, {}, 1.0, ""),
    ],
)
def test_a_law_is_found_where_nothing_is_undecided(law, gain, told, share, why):
    doubt = engine._doubt(law[0], **{"others": 0, "axes": None, "against_gravity": False, "threshold": None, "lacking": 0.05, **told})
    found = engine._undecided((law_of(*law, gain=gain, doubt=doubt),), share)
    assert found.startswith(why) if why else found == ""
