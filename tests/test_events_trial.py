"""Events on trial by hand: closure with some repaired, likelihoods of two turns, and what is done with what was accepted."""

from itertools import combinations
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG
from linear_twin import effect, linear_twin
from scipy import special, stats
from small_turns import PERFECT, TRUE, angles_by_scipy, small_turns, turned_ends

from session.io.logfile import Bridge
from tinygc.closure.problem import CLIPPED, LEFT_OUT
from tinygc.effects import Reach
from tinygc.explanation import clipped_turns, data_repair
from tinygc.explanation.clipped_turns import about_the_vertical, chance_of_creep, excess_of, find_clipping
from tinygc.explanation.data_repair import (
    EVERY_CHOICE,
    ClosureTrial,
    Gap,
    Verdict,
    chance_of_each,
    choices,
    common_count,
    is_inside,
    left_open,
    lowest,
    repair,
    session_with_lost,
    with_accepted,
    with_gaps,
    without_creeping,
)
from tinygc.explanation.faulty_readings import FALSE, LOST, Crossing, RegisterFault
from tinygc.noise.components import TURN

# Several events of one turn


def turn(shifts, measured, sigma=0.1, allowed=0.0):
    """A turn that misses by ``measured``, of which each event, mended, takes one of the shifts; allowed: what a gap may hide."""
    shifts = np.asarray(shifts, dtype=float)

    def value(choice):
        left = measured - shifts[sorted(choice)].sum(axis=0)
        variance = sigma**2 + len(choice) * allowed**2
        return float(-(left @ left) / variance / 2 - np.log(variance)), float(left @ left / sigma**2)

    return value


def best(likelihood):
    return set(max(likelihood, key=likelihood.__getitem__))


def test_two_that_cancel_in_part_are_both_found():
    """Mended alone, each leaves the turn further off than it is."""
    shifts = np.array([[3.0, 0.0], [-2.8, 0.5], [1.0, 4.0]])
    likelihood = choices(3, turn(shifts, shifts[:2].sum(axis=0)))
    assert best(likelihood) == {0, 1}
    np.testing.assert_allclose(chance_of_each(3, likelihood, 0.5), [1, 1, 0], atol=1e-6)


def test_two_that_cancel_are_found_among_many_and_two_others_that_do_are_not():
    """Of eight, climbing from none and from all: one change alone is for the worse."""
    shifts = np.array([[3.0, 0.0], [-2.8, 0.5], [0.0, 4.0], [0.3, -3.8], [9, 0], [0, 9], [-7, 8], [11, 5]])
    assert best(choices(8, turn(shifts, shifts[:2].sum(axis=0)))) == {0, 1}


@pytest.mark.parametrize(
    ("count", "true"),
    [
        *((EVERY_CHOICE, true) for true in ((), (0, 3, 5), "all")),
        *((EVERY_CHOICE + 4, true) for true in ((), (2,), tuple(range(1, 9)), "all")),
    ],
)
def test_those_that_were_there_are_found_among_few_and_many(count, true):
    shifts = np.random.default_rng(count).normal(size=(count, 2)) * 3
    true = range(count) if true == "all" else true
    seen = []
    value = turn(shifts, shifts[list(true)].sum(axis=0))
    assert best(choices(count, lambda choice: seen.append(choice) or value(choice))) == set(true)
    assert len(seen) == len(set(seen))
    assert (len(seen) == 2**count) == (count == 6)  # up to six, every combination is tried


def test_a_part_that_fits_as_well_makes_the_rest_inadmissible():
    """A wide gap is likelier than a miss of eight sigmas, but the turn misses no less with it than without."""
    value = turn([[0.0, -0.5]], np.array([0.8, 0.0]), allowed=3.0)
    assert value(frozenset({0}))[0] > value(frozenset())[0]
    assert list(choices(1, value)) == [frozenset()]
    for change, admissible in ((0.0, 1), (-1e-9, 2)):
        assert len(choices(1, lambda choice, change=change: (0.0, len(choice) * change))) == admissible


def test_the_chance_of_an_event_is_the_share_of_the_choices_that_have_it():
    """Bayes' rule over three choices, with prior probability 0.3 of each event."""
    likelihood = {frozenset(): 1.0, frozenset({0}): 2.0, frozenset({0, 1}): 2.5}
    weights = np.exp([1.0, 2.0, 2.5]) * [0.7 * 0.7, 0.3 * 0.7, 0.3 * 0.3]
    expected = [weights[1:].sum() / weights.sum(), weights[2] / weights.sum()]
    for shift in (0.0, 5000.0):
        moved = {choice: value + shift for choice, value in likelihood.items()}
        np.testing.assert_allclose(chance_of_each(2, moved, 0.3), expected)


@pytest.mark.parametrize("most", [0, 1, 8, 15, 16, 17, 33, 50, 104])
def test_the_bottom_of_a_valley_is_found_wherever_it_is(most):
    for bottom in range(most + 1):
        tried = []
        assert lowest(lambda count, bottom=bottom, tried=tried: tried.append(count) or abs(count - bottom) ** 1.5, most) == bottom
        assert len(tried) == len(set(tried)) <= 17 + 2 * max(1, most // 16) + most % 16
        assert set(tried) <= set(range(most + 1))


# Closure with some events repaired


def trial(count=2, samples=24, sigma=0.01, noise=0.0) -> ClosureTrial:
    """Turns of one log, one behind the other, whose closure is scipy's; a second log holds what bridged readings would be."""
    batch = small_turns(count=count, samples=samples, noise_rad=noise)
    made = ClosureTrial.__new__(ClosureTrial)
    used = [SimpleNamespace(log=0, start=100 + 40 * i, stop=100 + 40 * i + samples, number=i + 1) for i in range(count)]
    rates = np.zeros((100 + 40 * count, 3))
    for segment, rate in zip(used, batch.rate, strict=True):
        rates[segment.start : segment.stop] = rate @ TRUE.E.T + TRUE.B
    made._bridged = [rates + 0.05]
    made.rates, made._batch, made._smeared, made._period_s = [rates.copy()], batch, 0, 0.2
    made._calm = SimpleNamespace(rows=lambda log, rows: rows)
    padded = lambda by_log: np.stack([by_log[0][s.start : s.stop] for s in used])  # noqa: E731
    made.twin = SimpleNamespace(problem=SimpleNamespace(used=used, logs=[SimpleNamespace(samples=None)]), segments=used, padded=padded)
    made.covariance = np.tile(sigma**2 * np.array([[1.0, 0.3], [0.3, 2.0]]), (count, 1, 1))
    return made


def closes(rate, dt, earth, batch, i) -> np.ndarray:
    """(2,) rad by scipy, of one turn with these calibrated rates."""
    one = batch.pick(slice(i, i + 1))
    one = type(one)(rate[None], dt[None], earth[None], one.start, one.end, False)
    chord = angles_by_scipy(one, PERFECT.vector)[0]
    size = np.linalg.norm(chord)
    return chord * 4 * np.arcsin(size / 4) / max(size, 1e-30)


@pytest.mark.parametrize("smeared", [0, 3])
def test_a_false_reading_is_replaced_by_the_bridged_rate_and_its_neighbours_where_an_effect_smears_it(smeared):
    made = trial()
    made._smeared = smeared
    event = RegisterFault(FALSE, 0, 149, 2)  # the tenth and eleventh readings of the second turn
    rate = made.rates[0][140:164].copy()
    rate[9 - smeared : 11 + smeared] += 0.05
    batch = made._batch
    expected = closes(rate, batch.dt[1], batch.earth[1], batch, 1)
    np.testing.assert_allclose(made.angles(1, [event], None, 0), expected, atol=1e-9)
    np.testing.assert_allclose(
        made.angles(1, [], None, 0), closes(made.rates[0][140:164], batch.dt[1], batch.earth[1], batch, 1), atol=1e-9
    )
    if smeared:  # and not beyond the turn
        rate = made.rates[0][140:164].copy()
        rate[:6] += 0.05
        at_start = made.angles(1, [RegisterFault(FALSE, 0, 141, 2)], None, 0)
        np.testing.assert_allclose(at_start, closes(rate, batch.dt[1], batch.earth[1], batch, 1), atol=1e-9)


def test_lost_samples_are_put_in_on_the_polynomial_with_the_median_period():
    """Two losses of three samples each, the later one first, and the padding of the first turn left out."""
    made = trial()
    batch = made._batch
    events = [RegisterFault(LOST, 0, 108), RegisterFault(LOST, 0, 114)]
    rate, dt, earth = made.rates[0][100:124], batch.dt[0], batch.earth[0]
    step = np.median(dt)
    for at in (15, 9):
        rows = np.r_[at - 4 : at, at : at + 4]
        places = np.r_[-4:0, 3:7]
        line = np.polynomial.polynomial.polyfit(places, rate[rows], 1)
        between = np.polynomial.polynomial.polyval(np.arange(3), line).T
        rate = np.insert(rate, at, between, axis=0)
        earth = np.insert(earth, at, np.tile(earth[at], (3, 1)), axis=0)
        dt = np.insert(dt, at, [step] * 3)
        step = np.median(dt)
    found = made.angles(0, events, lambda event: Crossing(1, 0.0), 3)
    np.testing.assert_allclose(found, closes(rate, dt, earth, batch, 0), atol=1e-9)


def test_the_likelihood_of_a_choice_is_normal_with_what_its_gaps_may_hide():
    """By hand for each choice of two events, beside another that is repaired in any case; a row that no sensor outputs adds 20.

    What a gap may hide excuses nothing: where the turn is as recorded hardly less likely, with the same covariance, that is all it gains.
    """
    made = trial()
    own = [RegisterFault(FALSE, 0, 106, 1), RegisterFault(FALSE, 0, 112, 2, True)]
    others = [RegisterFault(FALSE, 0, 118, 1)]
    made._bridged = [made.rates[0].copy()]
    made.rates[0][[106, 112, 113, 118]] += 0.3
    hides = {own[0]: 0.01, own[1]: 0.03, others[0]: 0.02}
    found = made.likelihoods(0, own, others, lambda event: Crossing(1, hides[event]), 0)
    misfit, expected = {}, {}

    def normal(repaired, hidden):
        C = made.covariance[0] + sum(hides[event] ** 2 for event in hidden) * np.eye(2)
        return stats.multivariate_normal(np.zeros(2), C).logpdf(made.angles(0, repaired, None, 0)) + np.log(2 * np.pi)

    for size in range(3):
        for some in combinations(range(2), size):
            mended = [*others, *(own[k] for k in some)]
            angles = made.angles(0, mended, None, 0)
            moved = normal(mended, mended) - normal(others, mended)
            gain = normal(mended, mended) - normal(others, others)
            expected[frozenset(some)] = normal(others, others) + (gain if moved > np.log(20) else min(gain, moved)) + 20 * (1 in some)
            misfit[frozenset(some)] = angles @ np.linalg.inv(made.covariance[0]) @ angles
    admissible = [c for c in expected if all(misfit[c] < misfit[c - {one}] for one in c)]
    assert found == pytest.approx({choice: expected[choice] for choice in admissible})
    assert len(found) > 1


@pytest.mark.parametrize(("row", "segment"), [(103, None), (104, 0), (119, 0), (120, None), (144, 1), (159, 1), (160, None)])
def test_an_event_belongs_to_a_turn_with_four_readings_on_either_side(row, segment):
    made = trial()
    assert made.segment_of(RegisterFault(LOST, 0, row)) == segment
    assert made.segment_of(RegisterFault(LOST, 1, row)) is None


def shortened(made: ClosureTrial, lengths: dict[int, int]) -> list[RegisterFault]:
    """Take time out of turns, at a reading in the middle of each, as if so many samples were lost there."""
    events = []
    for i, count in lengths.items():
        dt = made._batch.dt
        dt[i, 11] -= count * made._period_s
        events.append(RegisterFault(LOST, 0, made.twin.problem.used[i].start + 11))
    return events


@pytest.mark.parametrize("count", [1, 2])
def test_the_number_lost_each_time_closes_most_turns_of_which_one_may_have_none(count):
    """Half a second at most: two samples of a fifth each; whichever of a turn's events it is at."""
    made = trial(count=4)
    events = shortened(made, dict.fromkeys(range(3), count))
    nowhere = RegisterFault(LOST, 0, made.twin.problem.used[3].start + 8)
    other = RegisterFault(LOST, 0, made.twin.problem.used[0].start + 6)
    assert made.lost_each_time([*events, nowhere]) == count
    assert made.lost_each_time([*events, nowhere, other]) == count
    assert made.lost_each_time([nowhere]) == 0
    assert made.lost_each_time([RegisterFault(LOST, 0, 5)]) == 0  # in a rest
    made._period_s /= 3
    assert made.lost_each_time(shortened(made, {})) == 0


def test_most_turns_decide_the_number_lost_and_not_the_one_that_closes_best():
    """Three of one sample, which miss by two and a half sigmas; the fourth, of two, closes to nothing."""
    made = trial(count=4)
    made._batch = turned_ends(made._batch, np.outer([1, 1, 1, 0], [0.025, 0.0, 0.0]))
    assert made.lost_each_time(shortened(made, {0: 1, 1: 1, 2: 1, 3: 2})) == 1


def test_an_uncertain_bridge_alone_excuses_no_open_turn():
    """The turn is open by 3 rad/s at row 106; bridging row 112 changes next to nothing, and may hide 5 degrees."""
    made = trial()
    made._bridged = [made.rates[0].copy()]
    made.rates[0][106] += 3.0
    as_recorded = made.angles(0, [], None, 0)
    C, tried = made.covariance[0] + 0.09**2 * np.eye(2), []
    for step in (1e-5 * np.eye(3), -1e-5 * np.eye(3)):
        for change in step:
            made._bridged[0][112] = made.rates[0][112] + change
            angles = made.angles(0, [RegisterFault(FALSE, 0, 112, 1)], None, 0)
            found = made.likelihoods(0, [RegisterFault(FALSE, 0, 112, 1)], [], lambda event: Crossing(1, 0.09), 0)
            moved = (as_recorded @ np.linalg.solve(C, as_recorded) - angles @ np.linalg.solve(C, angles)) / 2
            if frozenset({0}) in found and moved > 0:  # it closes a little better
                assert found[frozenset({0})] - found[frozenset()] == pytest.approx(moved, rel=1e-5)
                tried.append(moved)
    assert tried
    assert max(tried) < 1e-2
    excused = stats.multivariate_normal(np.zeros(2), C).logpdf(as_recorded)
    assert excused - stats.multivariate_normal(np.zeros(2), made.covariance[0]).logpdf(as_recorded) > 3


def test_a_turn_that_stays_open_is_repaired_by_rows_alone_that_no_sensor_outputs():
    """One step below and above the chi-square of its closure once repaired, with what the gap may hide."""
    made = trial()
    false, certain = RegisterFault(FALSE, 0, 106, 1), RegisterFault(FALSE, 0, 112, 2, True)
    made._bridged = [made.rates[0].copy()]
    made.rates[0][[106, 112, 113]] += 0.3
    cross = lambda event: Crossing(1, 0.01)  # noqa: E731
    angles = made.angles(0, [false], None, 0)
    left = angles @ np.linalg.solve(made.covariance[0] + 0.01**2 * np.eye(2), angles)
    for most, kept in ((1.01 * left, True), (0.99 * left, False)):
        assert (frozenset({0}) in made.likelihoods(0, [false, certain], [], cross, 0, most)) == kept
    assert set(made.likelihoods(0, [false, certain], [], cross, 0, 0.0)) == {frozenset(), frozenset({1})}
    assert made.likelihoods(0, [false], [], cross, 0) == made.likelihoods(0, [false], [], cross, 0, np.inf)


@pytest.mark.parametrize(("turns", "excess"), [(6, 25.0), (5, 1.0)])
def test_a_closed_turn_is_one_that_closes_as_those_without_an_event(turns, excess):
    """Noise of five sigmas in each of them, whose median counts, from five on: one turn of all has an event."""
    made = trial(count=turns)
    made.twin.batch = SimpleNamespace(angles=2)
    root = np.linalg.cholesky(made.covariance[0])
    usual = np.sqrt(stats.chi2.ppf(0.5, 2))
    sizes = np.r_[1e3, 1e2, 1e-2, 5 * usual, 5 * usual, 5 * usual][:turns]
    made.angles = lambda i, mended, cross, length: root @ [sizes[i], 0.0]
    assert made.closed_below([RegisterFault(FALSE, 0, 110, 1)], None) == pytest.approx(excess * stats.chi2.isf(0.01, 2))
    made.covariance = 1e6 * made.covariance
    assert made.closed_below([RegisterFault(FALSE, 0, 110, 1)], None) == pytest.approx(stats.chi2.isf(0.01, 2))


def likely(made, tables, hides=0.0, length=0):
    """The trial with given likelihoods of each turn's choices."""
    made.likelihoods = lambda i, own, others, cross, length, most: {frozenset(c): v for c, v in tables[i].items()}
    made.closed_below = lambda events, cross: np.inf
    made.lost_each_time = lambda events: length
    return patch.object(data_repair, "crossing", lambda samples, event, length: Crossing(1, hides))


def test_two_turns_are_decided_with_the_share_that_they_have_together():
    """Passes by hand: chances with a share of one half, the share of these, and once more until no answer changes."""
    made = trial(count=3)
    events = [RegisterFault(FALSE, 0, row, 1) for row in (110, 150, 190, 5)]
    tables = {0: {(): 0.0, (0,): 6.0}, 1: {(): 0.0, (0,): 0.4}, 2: {(): 0.0, (0,): -3.0}}
    with likely(made, tables):
        found = made.test(FALSE, events, [])
    share, chance = 0.5, np.zeros(4)
    for _ in range(6):
        before = chance
        chance = np.array([special.expit(gain + special.logit(share)) for gain in (6.0, 0.4, -3.0, 0.0)])
        share = (chance.sum() + 0.5) / 5
        if ((before > 0.5) == (chance > 0.5)).all():
            break
    np.testing.assert_allclose(found.chance, chance, rtol=1e-9)
    assert found.accepted == [events[0], events[1], events[3]]  # the last, in a rest, is what most are
    assert found.log_ratio == pytest.approx(6.4)
    assert found.probability == pytest.approx(special.expit(6.4 - np.log(10.0 * 30)))
    assert (found.id, found.length) == (FALSE, 0)


@pytest.mark.parametrize(("gain", "accepted"), [(np.log(300) + 0.01, True), (np.log(300) - 0.01, False)])
def test_events_of_a_kind_are_there_if_closure_outweighs_the_odds_of_any_effect(gain, accepted):
    """One in thirty, and ten scales."""
    made = trial()
    event = RegisterFault(FALSE, 0, 110, 1)
    with likely(made, {0: {(): 1.0, (0,): 1.0 + gain}}):
        found = made.test(FALSE, [event], [])
    assert found.accepted == [event] * accepted
    assert found.probability == pytest.approx(special.expit(gain - np.log(300)))
    assert found.chance[0] > 0.5
    with likely(made, {0: {(): 1.0, (0,): -5.0}}):
        none = made.test(FALSE, [event], [])
    assert (none.accepted, none.probability, none.chance.tolist(), none.log_ratio) == ([], 0.0, [0.0], 0.0)


def test_lengths_that_were_tried_and_rows_that_no_sensor_outputs_count():
    """Of losses, as many lengths as half a second holds; each such row in a rest counts 20, and needs no closure."""
    made = trial()
    with likely(made, {0: {(): 0.0, (0,): 9.0}}, length=2):
        found = made.test(LOST, [RegisterFault(LOST, 0, 110)], [])
    assert (found.log_ratio, found.length) == (pytest.approx(9.0 - np.log(2)), 2)
    with likely(made, {}, length=0):
        none = made.test(LOST, [RegisterFault(LOST, 0, 110)], [])
    assert (none.accepted, none.probability) == ([], 0.0)
    with likely(made, {}):
        empty = made.test(FALSE, [RegisterFault(FALSE, 0, 5, 1, True), RegisterFault(FALSE, 0, 7, 1, True)], [])
        silent = made.test(FALSE, [RegisterFault(FALSE, 0, 5, 1)], [])
    assert empty.log_ratio == 40.0
    assert len(empty.accepted) == 2
    assert empty.chance.tolist() == [1.0, 1.0]
    assert silent.accepted == []
    one = Verdict(FALSE, ["a", "b"], np.array([0.51, 0.5]), 0.51, 0, 0.0, 0.0, 0.0)
    assert one.accepted == ["a"]
    assert Verdict(FALSE, ["a"], np.array([1.0]), 0.5, 0, 0.0, 0.0, 0.0).accepted == []


def test_the_tilt_of_the_turns_concerned_is_told_as_recorded_and_with_all_repaired():
    made = trial(count=3)
    events = [RegisterFault(FALSE, 0, 110, 1), RegisterFault(FALSE, 0, 150, 2)]
    with likely(made, {0: {(): 0.0, (0,): 1.0}, 1: {(): 0.0, (0,): 1.0}}):
        found = made.test(FALSE, events, [])
    for rms, mended in ((found.before_rad, [[], []]), (found.tried_rad, [[events[0]], [events[1]]])):
        angles = [made.angles(i, own, None, 0) for i, own in enumerate(mended)]
        assert rms == pytest.approx(np.sqrt(np.mean(np.sum(np.square(angles), axis=1))))
    assert made.tilt_rms({}, None, 0) == 0.0


def test_the_common_count_of_losses_in_every_turn_is_that_of_the_best_linear_fit():
    batch = small_turns(count=16, samples=24)
    used = [SimpleNamespace(log=0, start=100 * i, stop=100 * i + 24) for i in range(16)]
    losses = [RegisterFault(LOST, 0, 100 * i + 10) for i in range(16)]
    log = SimpleNamespace(samples=SimpleNamespace(period_s=0.1))
    problem = SimpleNamespace(
        batch=batch, floor=SimpleNamespace(sigma=np.full((16, 2), 1e-4)), used=used, first=TRUE, session=SimpleNamespace(logs=[log])
    )
    batch.dt[:, 10] -= 2 * 0.1
    assert common_count(problem, losses) == 2
    batch.dt[:, [10, 22]] = batch.dt[:, [22, 10]]  # in the last period of each turn
    assert common_count(problem, [RegisterFault(LOST, 0, event.row + 12) for event in losses]) == 2
    assert common_count(problem, [RegisterFault(LOST, 0, 23), RegisterFault(LOST, 1, 10)]) == 0  # at the end of a turn, in no log


# Turns that are left out of the physics


def opened(sizes, touched, steps=None):
    """``left_open`` of turns that close with these sizes over their floor, whatever is fitted."""
    problem = SimpleNamespace(batch=[None] * len(sizes))
    fits = []
    with patch.object(data_repair, "closure_over_floor", lambda problem, kept: fits.append(kept) or np.asarray(sizes, dtype=float)):
        return np.flatnonzero(left_open(problem, np.asarray(touched, dtype=bool))).tolist(), fits


def test_a_turn_is_left_open_at_five_times_the_typical_closure_of_most():
    """Of twenty, the twelve best, whose median is 0.71 of that of all; then five times that of all that are kept."""
    sizes = np.ones(20)
    for size, found in ((7.05, [3]), (7.03, [])):
        sizes[3] = size
        assert opened(sizes, np.ones(20))[0] == found
    sizes[3] = 50.0
    assert opened(sizes, np.arange(20) != 3)[0] == []
    with patch.object(data_repair, "SIZE_OF_KEPT", 2.0):  # then the last comparison decides
        for size, found in ((5.01, [3]), (4.99, [])):
            sizes[3] = size
            assert opened(sizes, np.ones(20))[0] == found


@pytest.mark.parametrize(("count", "kept"), [(20, 12), (30, 18), (12, 12), (10, 10)])
def test_six_tenths_are_kept_but_a_dozen_where_there_are_as_many(count, kept):
    sizes = np.linspace(1.0, 2.0, count)
    _, fits = opened(sizes, np.ones(count))
    assert [len(each) for each in fits] == ([count] if kept == count else [count, kept]) + [count]
    _, fits = opened(sizes, np.arange(count) >= count // 5)  # with few untouched, there is but one beginning
    assert len(fits[0]) == count
    _, fits = opened(sizes, np.arange(count) >= kept)
    assert [len(each) for each in fits if len(each) == kept][:1] == [kept]


def test_turns_that_miss_are_found_though_a_plain_fit_follows_them():
    """Four of sixteen ends are turned by a tenth of a radian all alike; nobody says which."""
    batch = small_turns(count=16, noise_rad=1e-4)
    by = np.zeros((16, 3))
    by[[2, 5, 9, 14]] = [0.1, 0.05, 0.0]
    problem = SimpleNamespace(
        batch=turned_ends(batch, by), floor=SimpleNamespace(sigma=np.full((16, 2), 1e-4)), first=PERFECT, still_rates=None
    )
    with patch.object(data_repair, "fit_least_squares", lambda batch, sigma, first, still_rates: fit(batch, sigma, first)):
        assert np.flatnonzero(left_open(problem, np.ones(16, dtype=bool))).tolist() == [2, 5, 9, 14]


fit = data_repair.fit_least_squares

# What is done with what was accepted


class Samples:
    def __init__(self, count):
        self.t_s, self.period_s, self.duration_s = np.arange(count) * 0.01, 0.01, count * 0.01

    def __len__(self):
        return len(self.t_s)


def logs(*counts, bridges=()):
    return tuple(SimpleNamespace(samples=Samples(count), bridges=tuple(bridges)) for count in counts)


def changed(made, **new):
    return SimpleNamespace(**{**vars(made), **new})


def verdict(name, events, log_ratio=10.0, length=0, chance=None):
    return Verdict(name, events, np.ones(len(events)) if chance is None else np.array(chance), 0.9, length, 0.0, 0.0, log_ratio)


@pytest.fixture
def plain(monkeypatch):
    """Repairs that only note what they were asked for."""
    noted = {}
    monkeypatch.setattr(data_repair, "bridged", lambda session, false: noted.update(false=false) or session)
    monkeypatch.setattr(data_repair, "rebuilt", lambda problem, session, **more: noted.update(session=session, more=more) or "again")
    monkeypatch.setattr(data_repair, "replace", changed)
    monkeypatch.setattr(data_repair.bridging, "best_order", lambda samples, rows, count: (int(rows[0]) % 7, 0.1 * int(rows[0]) + count))
    monkeypatch.setattr(
        data_repair.faulty_readings, "with_lost", lambda samples, rows, count, orders: (len(samples), rows.tolist(), count, orders.tolist())
    )
    return noted


def test_accepted_events_are_told_by_rows_and_seconds_of_all_logs(plain):
    """Later times count what was put in before them, in their own log and in earlier ones."""
    problem = SimpleNamespace(session=SimpleNamespace(logs=logs(500, 400)))
    false = [RegisterFault(FALSE, 0, 30, 1), RegisterFault(FALSE, 1, 40, 2), RegisterFault(FALSE, 1, 50, 4)]
    lost = [RegisterFault(LOST, 0, 100), RegisterFault(LOST, 0, 200), RegisterFault(LOST, 1, 300)]
    found, chances = {}, {}
    verdicts = [verdict(FALSE, [*false, RegisterFault(FALSE, 0, 9, 1)], 6.0, chance=[1, 1, 1, 0]), verdict(LOST, lost, 12.0, 9)]
    again, gaps = with_accepted(problem, verdicts, found, chances)
    assert again == "again"
    assert found[FALSE] == ({"at": [30, 540, 550], "samples": 2}, {})
    assert found[LOST] == ({"at_s": [1.0, 2.09, 8.18], "length": 9}, {"length": 0.5})
    assert chances == pytest.approx({FALSE: min(1, 4 * stats.chi2.sf(12.0, 3)), LOST: 3 * stats.chi2.sf(24.0, 3)})
    assert plain["false"] == false
    assert [(g.log, g.row, g.missed_rad) for g in gaps] == [(0, 101, 19.0), (0, 210, 29.0), (1, 301, 39.0)]
    assert [log.samples for log in plain["session"].logs] == [(500, [100, 200], 9, [2, 4]), (400, [300], 9, [6])]
    nothing = with_accepted(problem, [verdict(FALSE, false, chance=[0, 0, 0])], {}, chances)
    assert nothing == (problem, [])
    found.clear()
    with_accepted(problem, [verdict(LOST, lost[:1], -3.0, 2)], found, chances)
    assert (list(found), chances[LOST]) == ([LOST], 1.0)


def test_bridges_behind_lost_samples_move_with_them(plain):
    bridges = [Bridge("gap", row, 2, 0.0, np.zeros(3)) for row in (50, 100, 101, 250)]
    session = SimpleNamespace(logs=logs(500, bridges=bridges))
    with patch.object(data_repair, "replace", lambda made, **new: changed(made, **new)):
        (log,) = session_with_lost(session, [RegisterFault(LOST, 0, 100), RegisterFault(LOST, 0, 200)], 9)[0].logs
    assert [each.row for each in log.bridges] == [50, 100, 110, 268]
    same, gaps = session_with_lost(session, [], 9)
    assert (same.logs[0].samples, gaps) == (session.logs[0].samples, [])


def test_gaps_widen_the_floor_of_the_turns_that_they_lie_in(monkeypatch):
    monkeypatch.setattr(data_repair, "replace", changed)
    used = [SimpleNamespace(log=0, start=10, stop=20), SimpleNamespace(log=0, start=20, stop=30), SimpleNamespace(log=1, start=10, stop=20)]
    problem = SimpleNamespace(used=used, floor=SimpleNamespace(own=np.tile(np.eye(2), (3, 1, 1))), batch=SimpleNamespace(angles=2))
    wider = with_gaps(problem, [Gap(0, 10, 2.0), Gap(0, 19, 3.0), Gap(1, 20, 5.0), Gap(1, 19, 1.0)])
    np.testing.assert_allclose(wider.floor.own, [14 * np.eye(2), np.eye(2), 2 * np.eye(2)])
    assert with_gaps(problem, []) is problem


@pytest.mark.parametrize(
    ("log", "start", "stop", "inside"), [(0, 15, 30, True), (0, 16, 30, False), (0, 5, 15, False), (0, 5, 16, True), (1, 10, 20, False)]
)
def test_a_turn_is_another_ones_where_its_middle_lies(log, start, stop, inside):
    assert is_inside(SimpleNamespace(log=0, start=10, stop=20), SimpleNamespace(log=log, start=start, stop=stop)) == inside


def test_a_problem_is_rebuilt_with_what_was_left_out_before(monkeypatch):
    """Where a still is rejected, two turns become one: by the middles of what was left out."""
    monkeypatch.setattr(data_repair, "SessionStills", lambda session, before: "stills")
    asked = []

    def build(session, **options):
        asked.append(options)
        return SimpleNamespace(
            segments=[SimpleNamespace(log=0, start=0, stop=60, number=1), SimpleNamespace(log=0, start=60, stop=90, number=2)],
            changed=lambda **fields: fields,
        )

    monkeypatch.setattr(data_repair, "build_problem", build)
    old = [
        SimpleNamespace(log=0, start=30 * i, stop=30 * i + 30, number=i + 1, problem=why) for i, why in enumerate((LEFT_OUT, None, CLIPPED))
    ]
    problem = SimpleNamespace(segments=old, found=None, earth=SimpleNamespace(source="none"), at_rest="noise figures")
    assert data_repair.rebuilt(problem, None, left_out=(2,)) == {"at_rest": "noise figures"}
    assert asked[-1] == {"use_earth": False, "exclude": (1, 2), "clipped": (3,), "moving": (), "found": "stills"}
    problem.earth.source = "given"
    data_repair.rebuilt(problem, None, moving=(5,), clipped=(9,))
    assert asked[-2] == {"use_earth": False, "moving": (5,), "found": "stills"}
    assert asked[-1] == {"use_earth": True, "exclude": (1,), "clipped": (9, 2), "moving": (5,), "found": "stills"}


def test_stills_that_creep_and_turn_are_told_and_rejected(monkeypatch):
    stills = [SimpleNamespace(problem=why) for why in (None, "creeps", None)]
    problem = SimpleNamespace(stills=stills, session="session")
    monkeypatch.setattr(data_repair, "rebuilt", lambda problem, session, moving: ("again", moving))
    for turning, expected, result in (([], [1], problem), ([0], [0, 1], ("again", (0,)))):
        monkeypatch.setattr(data_repair, "about_the_vertical", lambda problem, turning=turning: turning)
        found, chances = {}, {}
        assert without_creeping(problem, found, chances) == result
        assert found == {"reference.not_still": ({"stills": expected}, {})}
        assert chances["reference.not_still"] == pytest.approx(3 * stats.chi2.sf(36.0, 3))
    quiet = SimpleNamespace(stills=stills[:1])
    assert without_creeping(quiet, found := {}, {}) is quiet
    assert found == {}
    assert chance_of_creep(SimpleNamespace(stills=range(10**9))) == 1.0


def test_a_repair_is_of_clipping_then_of_events_then_of_stills(monkeypatch):
    said, clipping = [], SimpleNamespace(borne_out=True, level=2.0 * DEG, known_to=0.1 * DEG, chance=0.003, numbers=[4, 5])
    monkeypatch.setattr(data_repair, "find_clipping", lambda problem: clipping)
    monkeypatch.setattr(data_repair, "rebuilt", lambda problem, session, clipped: f"{problem.name} without {clipped}")
    monkeypatch.setattr(data_repair, "tried_events", lambda problem, clipping, progress: (["verdict"], ("effect",)))
    monkeypatch.setattr(data_repair, "with_accepted", lambda problem, verdicts, found, chances: (f"{problem}, mended", ["gap"]))
    monkeypatch.setattr(data_repair, "without_creeping", lambda problem, found, chances: f"{problem}, still")
    monkeypatch.setattr(data_repair, "with_gaps", lambda problem, gaps: f"{problem}, {gaps}")
    problem = SimpleNamespace(name="turns", session=None)
    mended = repair(problem, said.append)
    assert mended.problem == "turns without (4, 5), mended, still, ['gap']"
    assert mended.found == {"gyro.saturation": ({"dps": pytest.approx(2.0)}, {"dps": pytest.approx(0.1)})}
    assert mended.p_value == {"gyro.saturation": 0.003}
    assert (mended.verdicts, mended.reference, mended.clipping) == (["verdict"], ("effect",), clipping)
    assert said == ["registers", "stills"]
    clipping.borne_out = False
    assert repair(problem).found == {}


def test_events_in_clipped_turns_are_not_tried_and_losses_come_after_false_readings(monkeypatch):
    segments = [SimpleNamespace(log=0, start=100 * i, stop=100 * i + 50, number=i + 1) for i in range(3)]
    places = ((0, 110), (0, 149), (1, 110), (0, 150), (0, 99))
    events = [RegisterFault(LOST, 0, 220), *(RegisterFault(FALSE, log, row, 1) for log, row in places)]
    monkeypatch.setattr(data_repair, "proposed", lambda session: events)
    monkeypatch.setattr(data_repair, "bridged", lambda session, false: ("bridged", false))
    monkeypatch.setattr(data_repair, "rebuilt", lambda problem, session: session)
    given = []
    monkeypatch.setattr(data_repair, "reference_effects", lambda *each: given.append(each) or SimpleNamespace(effects=("effect",)))

    class Trial:
        def __init__(self, *each):
            given.append(each)

        def test(self, name, events, others):
            given.append((name, events, others))
            return verdict(name, events)

    monkeypatch.setattr(data_repair, "ClosureTrial", Trial)
    problem = SimpleNamespace(session=None, segments=segments)
    false, lost = events[3:], events[:1]
    verdicts, effects = data_repair.tried_events(problem, SimpleNamespace(numbers=[2]), lambda what: None)
    assert given[0][1:] == (("bridged", false), false, lost)
    assert given[2:] == [(FALSE, false, []), (LOST, lost, false)]
    assert ([v.id for v in verdicts], effects) == ([FALSE, LOST], ("effect",))
    given.clear()
    events[:] = lost
    assert len(data_repair.tried_events(problem, None, lambda what: None)[0]) == 1
    assert given[0][1] is problem  # nothing is bridged
    events.clear()
    assert data_repair.tried_events(problem, None, lambda what: None) == ([], ())


@pytest.mark.parametrize(
    ("open_ones", "unusual", "losses", "searched"),
    [
        (8, False, True, ["open"]),
        (9, False, True, ["recorded", "mended"]),
        (8, True, True, ["open", "recorded", "mended"]),
        (8, True, False, ["open", "recorded", "bridged"]),
    ],
)
def test_the_physics_is_learnt_from_turns_that_close_if_there_are_a_dozen(monkeypatch, open_ones, unusual, losses, searched):
    """Else, or where their noise is no sensor's, of all turns as recorded and as repaired: the most evidence per value."""
    used = [SimpleNamespace(log=0, start=100 * i, stop=100 * i + 50, number=i + 1) for i in range(20)]
    false = [RegisterFault(FALSE, 0, 110, 1), RegisterFault(FALSE, 0, 60, 1)]
    lost = [RegisterFault(LOST, 0, 349)] * losses
    problem, quiet = SimpleNamespace(used=used, session="recorded", name="recorded"), SimpleNamespace(session="bridged")
    touched, tried, in_rests = [], [], []
    monkeypatch.setattr(
        data_repair, "left_open", lambda problem, each: touched.append(each.nonzero()[0].tolist()) or np.arange(20) < open_ones
    )
    monkeypatch.setattr(data_repair, "bridged", lambda session, events: in_rests.append(events) or "open")
    monkeypatch.setattr(data_repair, "common_count", lambda problem, lost: 3)
    monkeypatch.setattr(data_repair, "session_with_lost", lambda session, lost, count: ("mended" if count == 3 else "", []))
    monkeypatch.setattr(data_repair, "rebuilt", lambda problem, session, left_out=None: SimpleNamespace(name=session, left_out=left_out))

    def found(each):
        tried.append(each)
        score = {"open": 30.0, "recorded": 50.0, "mended": 20.0, "bridged": 40.0}[each.name]
        rows = {"open": 10, "recorded": 25, "mended": 0, "bridged": 10}[each.name]
        return SimpleNamespace(name=each.name, score=score, fit=SimpleNamespace(r=[0] * rows), noise=SimpleNamespace(unusual=unusual))

    monkeypatch.setattr(data_repair, "_searched", found)
    reference = data_repair.reference_effects(problem, quiet, false, lost)
    assert [each.name for each in tried] == searched
    assert reference.name == ("open" if searched == ["open"] else "recorded")
    assert touched == [[1, 3] if losses else [1]]
    if searched[0] == "open":
        assert tried[0].left_out == tuple(range(1, 9))
        assert in_rests == [[false[1]]]


# Clipping decided by closure


def test_clipped_turns_close_worse_than_the_others_by_the_model_of_the_others():
    """Twelve whole turns at least, else by the model of all; the others count as one at least."""
    batch = small_turns(count=16, noise_rad=1e-4)
    by = np.zeros((16, 3))
    by[[3, 7]] = [0.03, 0.0, 0.0]
    sigma = np.full((16, 2), 1e-4)
    segments = [SimpleNamespace(number=i + 1) for i in range(16)]
    problem = SimpleNamespace(batch=turned_ends(batch, by), floor=SimpleNamespace(sigma=sigma), first=PERFECT, used=segments)
    hit = np.isin(np.arange(16), [3, 7])
    model = fit(problem.batch.pick(~hit), sigma[~hit], PERFECT).model
    size = np.sqrt(np.mean((angles_by_scipy(problem.batch, model.vector) / sigma) ** 2, axis=1))
    assert np.median(size[~hit]) < 1
    assert excess_of(problem, [4, 8]) == pytest.approx(np.median(size[hit]), rel=1e-3)
    problem.floor.sigma = sigma / 10
    assert excess_of(problem, [4, 8]) == pytest.approx(np.median(size[hit]) / np.median(size[~hit]), rel=1e-3)
    many = [1, 2, 4, 8, 11]  # eleven are left
    of_all = np.sqrt(np.mean((angles_by_scipy(problem.batch, fit(problem.batch, sigma, PERFECT).model.vector) / sigma * 10) ** 2, axis=1))
    assert excess_of(problem, many) == pytest.approx(np.median(of_all[np.subtract(many, 1)]), rel=1e-3)
    assert np.isnan(excess_of(problem, [99]))


@pytest.mark.parametrize(
    ("register", "excess", "borne_out"),
    [(True, 2.01, True), (True, 2.0, False), (True, np.nan, True), (False, 10.1, True), (False, 10.0, False), (False, np.nan, False)],
)
def test_a_level_is_clipping_if_its_turns_close_worse(monkeypatch, register, excess, borne_out):
    """Twice for a level of the registers, which has no other cause; ten times for plateaus."""
    masks = [np.arange(100) == row for row in (15, 35)]
    ceilings = [SimpleNamespace(level=level, mask=mask) for level, mask in zip((2.0, 4.0), masks, strict=True)]
    found = {"first": [*ceilings, None] if register else [None] * 3, "second": [*ceilings, None]}
    for name, key in (("find_ceiling", "first"), ("find_plateaus", "second")):
        monkeypatch.setattr(
            clipped_turns, name, lambda samples, fs, key=key: found[key][samples] if fs == pytest.approx(500 * DEG) else 1 / 0
        )
    monkeypatch.setattr(clipped_turns, "excess_of", lambda problem, numbers: excess)
    monkeypatch.setattr(clipped_turns, "closure_angles", lambda batch, first: np.full((4, 2), 1.5e-4))
    segments = [
        SimpleNamespace(log=log, start=start, stop=start + 10, number=number)
        for number, (log, start) in enumerate([(0, 10), (0, 20), (1, 30), (2, 10)], 1)
    ]
    problem = SimpleNamespace(
        session=SimpleNamespace(config=SimpleNamespace(sensor=SimpleNamespace(gyro_fs_dps=500))),
        logs=[SimpleNamespace(samples=k) for k in range(3)],
        batch=SimpleNamespace(known=np.arange(8).reshape(4, 2) < 7),
        first=None,
        floor=SimpleNamespace(sigma=np.full((4, 2), 1e-4)),
        segments=segments,
    )
    clipping = find_clipping(problem)
    assert (clipping.level, clipping.numbers, clipping.borne_out) == (3.0, [1, 3], borne_out)
    assert clipping.known_to == pytest.approx(3.0 * (0.002 if register else 0.02))
    assert clipping.chance == pytest.approx(6 * 3 * 1e-4 if register else stats.chi2.sf(8 * 2.25, 7))
    found["second"] = [None] * 3
    assert (find_clipping(problem) is None) == (not register)
    found["first"] = [ceilings[0], None, None]
    problem.segments = segments[1:]
    assert find_clipping(problem) is None


def test_a_still_about_the_vertical_is_an_outlier_of_the_rates_along_gravity(monkeypatch):
    """Ten times the scatter of the others; within 18 degrees of the vertical; found again until nothing changes."""
    rng = np.random.default_rng(0)
    count = 30
    rates = rng.normal(size=(count, 3)) * 1e-4
    spread = np.median(np.linalg.norm(rates, axis=1)) / 1.54
    rates[3] = [0, 0, 30 * spread]
    rates[5] = [30 * spread, 0, 0]  # horizontal
    rates[7] = np.array([0.32, 0, 1.0]) * 20 * spread
    rates[8] = np.array([0.34, 0, 1.0]) * 20 * spread
    rates[9:11] = 1.0
    typical = np.median(np.linalg.norm(rates, axis=1)) / 1.54
    rates[9], rates[10] = [0, 0, -10.1 * typical], [0, 0, 9.9 * typical]
    q, rows_used = np.tile([1.0, 0, 0, 0], (count, 1)), []
    state = SimpleNamespace(state="state")
    twin = SimpleNamespace(residuals=lambda state: SimpleNamespace(still=rates), q_tb=q, start=lambda: "start")
    parts = {"still": slice(8, 8 + 3 * count), "length": slice(8 + 3 * count, 8 + 4 * count)}
    monkeypatch.setattr(clipped_turns, "Twin", lambda problem: twin)
    monkeypatch.setattr(clipped_turns, "known_whitener", lambda twin: SimpleNamespace(parts=parts))
    monkeypatch.setattr(
        clipped_turns, "refit", lambda twin, whiten, effects, start, rows, max_steps: rows_used.append((start, rows)) or state
    )
    stills = [SimpleNamespace(problem=None)] * count
    problem = SimpleNamespace(stills=[SimpleNamespace(problem="creeps"), *stills])
    assert about_the_vertical(problem) == [4, 8, 10]  # numbers with the one that creeps
    assert [start for start, _ in rows_used] == ["start", "state"]
    assert rows_used[0][1].all()
    gone = [8 + 3 * still + axis for still in (3, 5, 7, 8, 9) for axis in range(3)]
    assert np.flatnonzero(~rows_used[1][1]).tolist() == gone


@pytest.mark.parametrize(("reach", "smeared"), [(True, 10), (False, 0)])
def test_a_turns_covariance_is_of_its_noise_and_of_the_physics_that_others_taught(reach, smeared):
    """Each noise component has the size that the physics' own fit gave it; undersampling is of the turns with false readings bridged."""
    a = effect("a", 2, **({"reach": Reach.around(samples=1)} if reach else {}))
    twin, calm = linear_twin(seed=1), linear_twin(seed=2)
    twin.spoil(a, [5.0, -4.0])
    evidence = twin.evidence()
    hypothesis = evidence.of((a,), evidence.nothing)
    hypothesis = changed(hypothesis, noise=SimpleNamespace(size=lambda name: {TURN: 0.7}.get(name, 0.2)))
    for each in (twin, calm):
        each.batch_at = lambda state: "batch"
        each.movements = [SimpleNamespace(dt_s=0.1), SimpleNamespace(dt_s=0.2), SimpleNamespace(dt_s=0.9)]
    problem, quiet, given = SimpleNamespace(used=[1, 2]), SimpleNamespace(used=[3, 4]), []
    with (
        patch.object(data_repair, "Twin", lambda each: twin if each is problem else calm),
        patch.object(data_repair, "undersampling", lambda each: "calm" if each is calm else None),
        patch.object(data_repair, "first_noise", lambda twin, whiten, missed: given.append(missed) or twin.noise(whiten)),
    ):
        made = ClosureTrial(problem, hypothesis, quiet)
        quiet.used.append(5)
        ClosureTrial(problem, hypothesis, quiet)
    J = np.hstack([twin.calibration, twin.columns_of(a)])[: twin.sizes[0]]
    whole = (1 + 0.7**2) * np.eye(twin.sizes[0]) + J @ hypothesis.fit.covariance @ J.T
    np.testing.assert_allclose(made.covariance, [whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(8)], rtol=1e-6)
    assert (made._smeared, made._period_s, given) == (smeared, 0.2, ["calm", None])
