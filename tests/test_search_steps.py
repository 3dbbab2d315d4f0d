"""The search's steps by tables of scores, its detection limits and probabilities by hand, and one recording whose subsets are all tried."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from linear_twin import effect, linear_twin, stepped

from tinygc.effects import Convention
from tinygc.explanation import search as searching
from tinygc.explanation.evidence import Guess, least_gain, price
from tinygc.explanation.search import (
    detection_limits,
    exchanged,
    guesses,
    in_words,
    probabilities,
    promises,
    ranked,
    rewhitened,
    rivals_of,
    search,
    without_idle,
)
from tinygc.noise.refit import Replay

NAMES = "abcdef"
EFFECTS = {name: effect(name) for name in NAMES}
LATE = Convention(lambda theta: theta, lambda theta: np.eye(1), delays=(0,))
DELAYS = {name: effect(name, gauge_convention=LATE) for name in NAMES}


class Scores:
    """Evidence by tables: exact scores of sets of names, 1000 where none is given; guesses differ from them by ``off``."""

    def __init__(self, scores: dict[str, float], off: dict[str, float] | None = None, effects=EFFECTS):
        self.scores, self.off, self.effects, self.weighed, self.removed = scores, off or {}, effects, [], []
        rng = np.random.default_rng(0)
        self.basis = np.linalg.qr(rng.normal(size=(30, 21)))[0]
        whiten = SimpleNamespace(each=iter)
        self.whiten = self.first_whiten = whiten
        self.twin = None

    def named(self, names: str):
        return self.of(tuple(self.effects[name] for name in names), None)

    def _key(self, effects) -> str:
        return "".join(sorted(each.id[-1] for each in effects))

    def of(self, effects, begin):
        key = self._key(effects)
        self.weighed.append(key)
        found = Guess(tuple(effects), self.scores.get(key, 1000.0))
        claims = tuple(SimpleNamespace(effect=each, theta=np.ones(1)) for each in effects)
        # Every effect promises as much as the others: its column, of length one, is hit by a hundred sigmas.
        columns = np.stack([self.columns(each)[:, 0] for each in effects], axis=1) if effects else np.zeros((30, 0))
        J = np.hstack([self.basis[:, 6:], columns])
        fit = SimpleNamespace(r=100 * self.basis[:, :6].sum(axis=1), J=J, state=SimpleNamespace(claims=claims))
        self.found = _Hypothesis(found.effects, found.score, fit, self.whiten)
        return self.found

    def guess(self, have, *, without=None, add=None):
        effects = tuple(e for e in have.effects if e is not without) + ((add,) if add else ())
        key = self._key(effects)
        return Guess(effects, self.scores.get(key, 1000.0) + self.off.get(key, 0.0))

    def columns(self, each):
        return self.basis[:, [NAMES.index(each.id[-1])]]

    def price(self, each):
        return 0.0

    def will_try(self, tried):
        self.tried = tried


class _Hypothesis(Guess):
    def __init__(self, effects, score, fit, whiten):
        self.__dict__ |= {"effects": effects, "score": score, "fit": fit, "whiten": whiten}


@pytest.fixture(autouse=True)
def replaced(monkeypatch):
    monkeypatch.setattr(searching, "replace", lambda fit, **new: SimpleNamespace(**{**vars(fit), **new}))


def names_of(hypothesis) -> str:
    return "".join(sorted(name[-1] for name in hypothesis.ids))


def found(scores, tried="abc", off=None, effects=EFFECTS, **options):
    table = Scores({"": 0.0, **scores}, off, effects)
    said: list[str] = []
    best = search(table, [effects[name] for name in tried], table.named(""), progress=said.append, **options)
    return names_of(best), table.weighed[1:], said


def test_effects_are_added_while_each_adds_evidence():
    chain = {"a": -10.0, "ab": -20.0, "abc": -30.0, "abcd": -40.0, "abcde": -50.0, "abcdef": -60.0}
    assert found(chain, NAMES)[0] == "abcde"
    assert found(chain, NAMES, most=2)[0] == "ab"
    assert found({"a": -10.0, "ab": -10.0})[0] == "a"
    assert found({"a": 0.0})[0] == ""
    name, _, said = found({"a": -10.0, "ab": -9.0})
    assert (name, said) == ("a", ["naming, round 1", "naming, round 2"])
    assert found(chain, "")[0] == ""


@pytest.mark.parametrize(("second", "expected"), [(-28.1, "bc"), (-28.0, "a")])
def test_a_second_best_beginning_is_followed_if_it_is_near(second, expected):
    """Within 12; the best has no better continuation, the second has."""
    scores = {"a": -40.0, "b": second, "c": 0.0, "bc": -90.0, "ac": -38.0, "ab": -38.0}
    assert found(scores, off={"b": -10.0})[0] == expected


def test_a_third_beginning_is_not_followed():
    assert found({"a": -40.0, "b": -39.0, "c": -38.0, "ab": -30.0, "ac": -30.0, "bc": 0.0, "cd": -90.0}, "abcd")[0] == "a"


def test_the_best_by_linear_columns_and_those_near_it_are_evaluated_exactly():
    """Up to three, and within 8 of the best guess."""
    scores = {"a": -40.0, "b": -32.1, "c": -32.0}
    assert set(found(scores, "abc", most=1)[1]) == {"a", "b"}
    assert set(found({name: -40.0 + k for k, name in enumerate(NAMES)}, NAMES, most=1)[1]) == {"a", "b", "c"}
    # Of delays, all, if one is near: linear columns rank them poorly.
    far = {"a": -40.0, "b": -20.0, "c": -10.0}
    assert set(found(far, "abc", most=1, effects=DELAYS)[1]) == {"a", "b", "c"}
    mixed = {**EFFECTS, "b": DELAYS["b"]}
    assert set(found(far, "abc", most=1, effects=mixed)[1]) == {"a"}
    assert found({"a": -40.0, "b": -30.0}, off={"b": -15.0})[0] == "a"  # what counts is the exact score


@pytest.mark.parametrize(("guessed", "tried"), [(-96.1, True), (-96.0, False)])
def test_what_others_make_redundant_is_taken_out(guessed, tried):
    """Where the guess without it is within 4 of the best."""
    table = Scores({"abc": -100.0, "ab": -120.0, "a": -50.0, "b": -50.0}, {"ab": guessed + 120.0})
    left = without_idle(table, table.named("abc"))
    assert names_of(left) == ("ab" if tried else "abc")


def test_one_effect_alone_stays_and_of_two_delays_each_is_tried_without():
    table = Scores({"": -500.0, "a": -10.0})
    assert names_of(without_idle(table, table.named("a"))) == "a"
    scores = {"ab": -100.0, "a": -110.0}
    both = [{**DELAYS}, {**EFFECTS, "b": DELAYS["b"]}]
    for effects, expected in zip(both, ("a", "ab"), strict=True):
        table = Scores(scores, {"a": 200.0, "b": 200.0}, effects)
        assert names_of(without_idle(table, table.named("ab"))) == expected


@pytest.mark.parametrize(("guessed", "expected"), [(-92.1, "c"), (-92.0, "a")])
def test_an_effect_gives_place_to_one_that_fits_in_its_place(guessed, expected):
    """Where the guess is within 8 of the best; the exact score decides."""
    table = Scores({"a": -100.0, "c": -110.0, "": 0.0}, {"c": guessed + 110.0})
    assert names_of(exchanged(table, list(EFFECTS.values()), table.named("a"))) == expected
    late = Scores({"a": -100.0, "c": -110.0, "": 0.0}, {"c": 110.0}, DELAYS)
    assert names_of(exchanged(late, list(DELAYS.values()), late.named("a"))) == "c"
    one = {**EFFECTS, "c": DELAYS["c"]}
    table = Scores({"a": -100.0, "c": -110.0, "": 0.0}, {"c": 110.0}, one)
    assert names_of(exchanged(table, list(one.values()), table.named("a"))) == "a"


def test_exchanges_go_on_while_they_gain_and_take_out_what_is_idle():
    scores = {"ab": -100.0, "bc": -110.0, "cd": -120.0, "c": -130.0}
    table = Scores(scores)
    assert names_of(exchanged(table, list(EFFECTS.values()), table.named("ab"))) == "c"


def test_a_lookalike_must_promise_nearly_as_much():
    """Within 12 and a tenth of what the effect itself promises; an effect is not exchanged for another that is there."""
    table = Scores({"a": -100.0})
    best = table.named("a")
    own = best.fit.J[:, -1]
    size = 100.0**2 - np.log(100.0**2)
    for share, expected in ((0.9 * size - 12 + 0.5, ["test.b"]), (0.9 * size - 12 - 0.5, [])):
        gain = next(g for g in np.linspace(share, share + 20, 20001) if g - np.log(g) >= share)
        best.fit.r = 99.0 * own + np.sqrt(gain) * table.basis[:, 1]  # with the claim's own one, a hundred again
        best.fit.state.claims[0].theta[:] = -1.0
        tried = [EFFECTS["a"], EFFECTS["b"], EFFECTS["c"]]
        assert [e.id for e in searching.in_place_of(table, tried, best, best.effects[0], 0.0)] == expected
    best.fit.r = 99.0 * own
    other = effect("a", equation="another shape")  # with the same column
    assert searching.in_place_of(table, [other], best, best.effects[0], 0.0) == [other]
    scanned = stepped("a", np.array([1.0])).at(1.0)
    assert searching.in_place_of(table, [scanned], best, best.effects[0], 0.0) == []
    best = table.named("a")  # of five as good, four
    assert len(searching.in_place_of(table, list(EFFECTS.values()), best, best.effects[0], 0.0)) == 4
    both = table.named("ab")
    assert searching.in_place_of(table, [EFFECTS["b"]], both, both.effects[0], 0.0) == []


def test_the_promise_is_the_gain_less_its_logarithm_and_its_price():
    twin = linear_twin(seed=4)
    tried = [effect("a", 2), effect("b", 3)]
    twin.spoil(tried[0], [4.0, -3.0])
    evidence = twin.evidence()
    nothing = evidence.nothing
    first = evidence.first_whiten
    looks = [(nothing.whiten, nothing.fit), (first, rewhitened(nothing, first))]
    assert rewhitened(nothing, nothing.whiten) is nothing.fit
    for found, (whiten, _) in zip(promises(evidence, looks, tried), looks, strict=True):
        J = whiten(np.delete(twin.calibration, [12, 13], axis=1))
        r = whiten(nothing.whiten.back(nothing.fit.r))
        for promise, each in zip(found, tried, strict=True):
            left = [np.sum((r - A @ np.linalg.lstsq(A, r, rcond=None)[0]) ** 2) for A in (J, np.hstack([J, whiten(twin.columns_of(each))]))]
            gain, P = left[0] - left[1], each.parameter.size
            assert promise == pytest.approx(gain - P * np.log(max(gain / P, 1)) - price(each, 1), rel=1e-6)


def test_up_to_three_candidates_of_either_ranking_each_once_at_its_best_shape():
    twin = linear_twin(seed=4)
    tried = [effect(name) for name in "abcdefgh"]
    for each, size in zip(tried[:4], (90.0, 80.0, 70.0, 60.0), strict=True):
        twin.spoil(each, [size])
    evidence = twin.evidence()
    names = [each.id[-1] for each in ranked(evidence, tried, evidence.nothing)]
    assert set("abc") <= set(names)
    assert len(names) == len(set(names)) <= 6
    have = evidence.of((tried[0],), evidence.nothing)
    assert "a" not in [each.id[-1] for each in ranked(evidence, tried, have)]
    scores = [guess.score for guess in guesses(evidence, tried, evidence.nothing)]
    assert scores == sorted(scores)
    assert len(scores) == len(names)
    values = np.array([1.0, 2.0, 3.0])
    tried = [effect("c", equation="another"), effect("c"), *stepped("step", values).variants(values)]
    for each in tried:
        twin.spoil(each, [100.0])
    evidence = twin.evidence()
    assert sorted(each.id for each in ranked(evidence, tried, evidence.nothing)) == ["test.c", "test.c", "test.step"]


@pytest.mark.parametrize("true", [(), ("b",), ("a", "c", "d")])
def test_the_search_finds_the_best_of_all_subsets_and_their_probabilities(true):
    """The headline of naming, in a recording small enough to try everything: each name has the share of the subsets that have it."""
    tried = {name: effect(name, 1 + (name == "b")) for name in "abcd"}
    twin = linear_twin(seed=11)
    for name in true:
        twin.spoil(tried[name], np.full(tried[name].parameter.size, 6.0))
    evidence, everything = twin.evidence(), twin.evidence()
    best = search(evidence, list(tried.values()), evidence.nothing)
    subsets = [some for size in range(5) for some in combinations(tried, size)]
    everything.will_try(list(tried.values()))
    exact = [everything.of(tuple(tried[name] for name in some), everything.nothing) for some in subsets]
    assert {name[-1] for name in best.ids} == {name[-1] for name in min(exact, key=lambda h: h.score).ids} == set(true)
    weights = np.exp(-np.array([h.score - best.score for h in exact]) / 2)
    chance = probabilities(evidence.weighed)
    for name in tried:
        by_hand = weights[[name in some for some in subsets]].sum() / weights.sum()
        assert chance.get(f"test.{name}", 0.0) == pytest.approx(by_hand, abs=0.03)
        assert (by_hand > 0.5) == (name in true)


# Detection limits


def test_the_detection_limit_removes_the_least_gain_along_half_of_the_directions(monkeypatch):
    twin = linear_twin(seed=3)
    a, weak = effect("a", 3, plausible=2.0), effect("weak", 1, plausible=1e-3)
    shapes = [stepped("step", np.array([1.0, 2.0])).at(at) for at in (1.0, 2.0)]
    monkeypatch.setattr(searching, "candidates", lambda twin: [a, weak, *shapes])
    twin.calibration[:, 12:14] = np.random.default_rng(0).normal(size=(twin.n, 2))
    nothing = twin.evidence().nothing
    # A fit of which every column is there.
    J = nothing.fit.J.copy()
    J[:, 12:14] = nothing.whiten(twin.calibration[:, 12:14])
    fit = SimpleNamespace(**{**vars(nothing.fit), "J": J})
    monkeypatch.setattr(searching, "Replay", lambda twin, fit: Replay(twin, nothing.fit))
    limits = detection_limits(twin, nothing.whiten, fit)
    q = np.linalg.qr(J)[0]

    def strength(each):
        own = nothing.whiten(twin.columns_of(each))
        return np.median(np.linalg.svd(own - q @ (q.T @ own), compute_uv=False))

    assert limits["test.a"] == pytest.approx(np.sqrt(least_gain(a, 1)) / strength(a) / 0.5)
    assert limits["test.step"] == pytest.approx(min(np.sqrt(least_gain(each, 2)) / strength(each) for each in shapes) / 0.5)
    assert limits["test.weak"] == np.inf
    gain = least_gain(weak, 1)
    for share, seen in ((1.001, True), (0.999, False)):  # a plausible size just above, just below the limit
        other = effect("weak", 1, plausible=share * np.sqrt(gain) / strength(weak))
        monkeypatch.setattr(searching, "candidates", lambda twin, other=other: [other])
        assert np.isfinite(detection_limits(twin, nothing.whiten, fit)["test.weak"]) == seen


def test_detection_limits_in_words():
    sizes = {"gyro.bias_step": 0.0123, "gyro.bandwidth": 0.00456, "gyro.bias_drift": np.inf}
    assert in_words(sizes) == [
        "detection limits: gyro.bias_step 0.012 dps, gyro.bandwidth 0.0046 s",
        "not observable in this recording: gyro.bias_drift",
    ]
    assert in_words({}) == []


# Probabilities


def guess(score: float, *names: str) -> Guess:
    return Guess(tuple(SimpleNamespace(id=name) for name in names), score)


def test_probabilities_are_those_of_the_hypotheses_that_have_the_name():
    odds = [guess(-2 * np.log(share), *names) for share, names in ((0.4, ("a",)), (0.3, ("b",)), (0.2, ("a", "b")), (0.1, ()))]
    for shift in (-1e5, 0.0, 1e5):
        moved = [Guess(g.effects, g.score + shift) for g in odds]
        assert probabilities(moved) == pytest.approx({"a": 0.6, "b": 0.5, "": 0.1})  # both at once are counted twice
    assert probabilities([guess(0.0, "a"), guess(5000.0)]) == pytest.approx({"a": 1.0, "": 0.0})


def test_a_rival_is_what_stands_in_the_same_place_beside_the_same_others():
    best = guess(10.0, "a", "b")
    weighed = [
        best,
        guess(13.0, "c", "b"),
        guess(12.0, "c", "b"),
        guess(12.5, "c", "b"),
        guess(11.0, "c"),
        guess(11.5, "b"),
        guess(10.5, "a", "d"),
        guess(9, "a", "b", "d"),
        guess(8, "c", "d", "b"),
    ]
    assert rivals_of(weighed, best, best.effects[0]) == {"c": 2.0}
    assert rivals_of(weighed, best, best.effects[1]) == {"d": 0.5}
