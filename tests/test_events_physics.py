"""Events that detectors propose: tried by the closure of their turns, and repaired; each term by hand."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import DEG, Table, broad, config, session_of
from linear_twin import effect, linear_twin
from numpy.testing import assert_allclose
from scipy import special, stats
from small_turns import PERFECT, TRUE, angles_by_scipy, small_turns, turned_ends

from session.base.progress import no_report
from session.log.logfile import Bridge, Log
from session.log.samples import Samples
from tinygc import Session
from tinygc.closure.build import build_problem
from tinygc.effects import Reach
from tinygc.explanation import data_repair
from tinygc.explanation.clipped_turns import (
    excess_of,
    find_clipping,
)
from tinygc.explanation.data_repair import (
    _EVERY_CHOICE,
    ClosureTrial,
    Verdict,
    _chance_of_each,
    _common_count,
    _with_accepted,
    choices,
    left_open,
    lowest,
    repair,
    tried_events,
)
from tinygc.explanation.faulty_readings import (
    FALSE,
    LOST,
    Crossing,
    RegisterFault,
    proposed,
)
from tinygc.explanation.physics import lost_in
from tinygc.noise.components import TURN


def rows_in_turns(table, samples, each, seed):
    """Rows well inside the turns, ``each`` in every turn, at least a third of a second apart: where rate and gravity both change."""
    rng = np.random.default_rng(seed)
    stops, starts = [stop for _, stop in table.rests[:-1]], [start for start, _ in table.rests[1:]]
    times = []
    for stop, start in zip(stops, starts, strict=True):
        slots = stop + (start - stop) * (0.2 + 0.6 * np.arange(each) / each)
        times += (slots + rng.uniform(0, 0.6 * (start - stop) / each - 0.35, each)).tolist()
    return np.searchsorted(samples.t_s, np.array(times))


def with_losses(samples, rows, count):
    """``count`` samples gone after each row, and the stamps closed up."""
    kept = np.ones(len(samples), dtype=bool)
    for row in rows:
        kept[row + 1 : row + 1 + count] = False
    return Samples(samples.t_ns[: kept.sum()], samples.gyro[kept], samples.accel[kept], samples.temp_c[kept])


def closed_up(rows, count):
    """The same rows, counted after the losses before them."""
    return rows - count * np.arange(len(rows))


def session_with(*logs, bridges=()):
    files = tuple(Log(Path(f"log{i:04}.csv"), samples, bridges=tuple(bridges)) for i, samples in enumerate(logs))
    return Session(Path("made"), config(odr_hz=100.0), files, ())


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


@pytest.mark.parametrize(
    ("count", "true"),
    [
        *((_EVERY_CHOICE, true) for true in ((), (0, 3, 5), "all")),
        *((_EVERY_CHOICE + 4, true) for true in ((), (2,), tuple(range(1, 9)), "all")),
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


def test_the_chance_of_an_event_is_the_share_of_the_choices_that_have_it():
    """Bayes' rule over three choices, with prior probability 0.3 of each event."""
    likelihood = {frozenset(): 1.0, frozenset({0}): 2.0, frozenset({0, 1}): 2.5}
    weights = np.exp([1.0, 2.0, 2.5]) * [0.7 * 0.7, 0.3 * 0.7, 0.3 * 0.3]
    expected = [weights[1:].sum() / weights.sum(), weights[2] / weights.sum()]
    for shift in (0.0, 5000.0):
        moved = {choice: value + shift for choice, value in likelihood.items()}
        assert_allclose(_chance_of_each(2, moved, 0.3), expected)


@pytest.mark.parametrize("most", [0, 1, 16, 17, 50, 104])
def test_the_bottom_of_a_valley_is_found_wherever_it_is(most):
    for bottom in range(most + 1):
        tried = []
        assert lowest(lambda count, bottom=bottom, tried=tried: tried.append(count) or abs(count - bottom) ** 1.5, most) == bottom
        assert len(tried) == len(set(tried)) <= 17 + 2 * max(1, most // 16) + most % 16
        assert set(tried) <= set(range(most + 1))


# Closure with some events repaired


def trial(count=2):
    """Turns of one log, one behind the other, whose closure is scipy's; a second log holds what bridged readings would be."""
    batch = small_turns(count=count, samples=24, noise_rad=0.0)
    made = ClosureTrial.__new__(ClosureTrial)
    used = [SimpleNamespace(log=0, start=100 + 40 * i, stop=124 + 40 * i, number=i + 1) for i in range(count)]
    rates = np.zeros((100 + 40 * count, 3))
    for segment, rate in zip(used, batch.rate, strict=True):
        rates[segment.start : segment.stop] = rate @ TRUE.E.T + TRUE.B
    made._bridged, made.rates, made._batch, made._smeared, made._period_s = [rates + 0.05], [rates], batch, 0, 0.2
    made._calm = SimpleNamespace(rows=lambda log, rows: rows)
    padded = lambda by_log: np.stack([by_log[0][s.start : s.stop] for s in used])  # noqa: E731
    problem = SimpleNamespace(used=used, logs=[SimpleNamespace(samples=None)])
    made.twin = SimpleNamespace(problem=problem, segments=used, padded=padded, batch=SimpleNamespace(angles=2))
    made.covariance = np.tile(1e-4 * np.array([[1.0, 0.3], [0.3, 2.0]]), (count, 1, 1))
    return made


def closes(rate, dt, earth, batch, i):
    """(2,) rad by scipy, of one turn with these calibrated rates."""
    one = batch.pick(slice(i, i + 1))
    one = type(one)(rate[None], dt[None], earth[None], one.start, one.end, False)
    chord = angles_by_scipy(one, PERFECT.vector)[0]
    size = np.linalg.norm(chord)
    return chord * 4 * np.arcsin(size / 4) / max(size, 1e-30)


@pytest.mark.parametrize(
    ("smeared", "row", "false"),
    [(0, 149, slice(9, 11)), (3, 149, slice(6, 14)), (3, 141, slice(0, 6))],  # and not beyond the turn
)
def test_a_false_reading_is_replaced_by_the_bridged_rate_and_its_neighbours_where_an_effect_smears_it(smeared, row, false):
    made = trial()
    made._smeared = smeared
    rate, batch = made.rates[0][140:164].copy(), made._batch
    for events in ([], [RegisterFault(FALSE, 0, row, 2)]):
        rate[false] += 0.05 * len(events)
        assert_allclose(made.angles(1, events, None, 0), closes(rate, batch.dt[1], batch.earth[1], batch, 1), atol=1e-9)


def test_lost_samples_are_put_in_on_the_polynomial_with_the_median_period():
    """Two losses of three samples each, the later one first, and the padding of the first turn left out."""
    made = trial()
    batch = made._batch
    events = [RegisterFault(LOST, 0, 108), RegisterFault(LOST, 0, 114)]
    rate, dt, earth = made.rates[0][100:124], batch.dt[0], batch.earth[0]
    step = np.median(dt)
    for at in (15, 9):
        line = np.polynomial.polynomial.polyfit(np.r_[-4:0, 3:7], rate[at - 4 : at + 4], 1)
        between = np.polynomial.polynomial.polyval(np.arange(3), line).T
        rate = np.insert(rate, at, between, axis=0)
        earth = np.insert(earth, at, np.tile(earth[at], (3, 1)), axis=0)
        dt = np.insert(dt, at, [step] * 3)
        step = np.median(dt)
    found = made.angles(0, events, lambda event: Crossing(1, 0.0), 3)
    assert_allclose(found, closes(rate, dt, earth, batch, 0), atol=1e-9)


def test_the_likelihood_of_a_choice_is_normal_with_what_its_gaps_may_hide():
    """By hand for each choice of two events, beside another that is repaired in any case; a row that no sensor outputs adds 20.

    What a gap may hide excuses nothing: where the turn is as recorded hardly less likely, with the same covariance, that is all it gains.
    """
    made = trial()
    first, second, other = RegisterFault(FALSE, 0, 106, 1), RegisterFault(FALSE, 0, 112, 2, True), RegisterFault(FALSE, 0, 118, 1)
    made._bridged = [made.rates[0].copy()]
    made.rates[0][[106, 112, 113, 118]] += 0.3
    hides = {first: 0.01, second: 0.03, other: 0.02}
    found = made.likelihoods(0, [first, second], [other], lambda event: Crossing(1, hides[event]), 0)

    def normal(repaired, hidden):
        C = made.covariance[0] + sum(hides[event] ** 2 for event in hidden) * np.eye(2)
        return stats.multivariate_normal(np.zeros(2), C).logpdf(made.angles(0, repaired, None, 0)) + np.log(2 * np.pi)

    misfit, expected = {}, {}
    for choice, mended in {(): [other], (0,): [other, first], (1,): [other, second], (0, 1): [other, first, second]}.items():
        gain, moved = (normal(mended, mended) - normal([other], hidden) for hidden in ([other], mended))
        gain = gain if moved > np.log(20) else min(gain, moved)
        expected[frozenset(choice)] = normal([other], [other]) + gain + 20 * (second in mended)
        angles = made.angles(0, mended, None, 0)
        misfit[frozenset(choice)] = angles @ np.linalg.inv(made.covariance[0]) @ angles
    assert found == pytest.approx({c: expected[c] for c in expected if all(misfit[c] < misfit[c - {one}] for one in c)})
    assert len(found) > 1


@pytest.mark.parametrize(("row", "segment"), [(103, None), (104, 0), (119, 0), (120, None), (144, 1)])
def test_an_event_belongs_to_a_turn_with_four_readings_on_either_side(row, segment):
    made = trial()
    assert made.segment_of(RegisterFault(LOST, 0, row)) == segment
    assert made.segment_of(RegisterFault(LOST, 1, row)) is None


def shortened(made, lengths):
    """Take readings out of turns, from the middle of each, as if so many samples were lost there."""
    events = []
    for i, count in lengths.items():
        segment = made.twin.problem.used[i]
        row = segment.start + 11
        rates, batch = made.rates[0], made._batch
        rates[row + 1 : segment.stop - count] = rates[row + 1 + count : segment.stop].copy()
        batch.dt[i, len(batch.dt[i]) - count :] = 0.0
        events.append(RegisterFault(LOST, 0, row))
    return events


@pytest.mark.parametrize("count", [1, 2])
def test_the_number_lost_each_time_closes_most_turns_of_which_one_may_have_none(count):
    """Half a second at most: two samples of a fifth each; whichever of a turn's events it is at."""
    made = trial(count=4)
    events = shortened(made, dict.fromkeys(range(3), count))
    nowhere, other, in_rest = (RegisterFault(LOST, 0, row) for row in (228, 106, 5))
    with patch.object(data_repair, "crossings", lambda logs, events, length: dict.fromkeys(events, Crossing(3, 0.0))):
        for losses, expected in ([*events, nowhere], count), ([*events, nowhere, other], count), ([nowhere], 0), ([in_rest], 0):
            assert made.lost_each_time(losses) == expected


def test_most_turns_decide_the_number_lost_and_not_the_one_that_closes_best():
    """Three of one sample, which miss by two and a half sigmas; the fourth, of two, closes to nothing."""
    made = trial(count=4)
    made._batch = turned_ends(made._batch, np.outer([1, 1, 1, 0], [0.025, 0.0, 0.0]))
    with patch.object(data_repair, "crossings", lambda logs, events, length: dict.fromkeys(events, Crossing(3, 0.0))):
        assert made.lost_each_time(shortened(made, {0: 1, 1: 1, 2: 1, 3: 2})) == 1


def test_a_turn_that_stays_open_is_repaired_by_rows_alone_that_no_sensor_outputs():
    """One step below and above the chi-square of its closure once repaired, with what the gap may hide."""
    made = trial()
    own = [RegisterFault(FALSE, 0, 106, 1), RegisterFault(FALSE, 0, 112, 2, True)]
    made._bridged = [made.rates[0].copy()]
    made.rates[0][[106, 112, 113]] += 0.3
    cross = lambda event: Crossing(1, 0.01)  # noqa: E731
    angles = made.angles(0, own[:1], None, 0)
    left = angles @ np.linalg.solve(made.covariance[0] + 0.01**2 * np.eye(2), angles)
    for most, kept in ((1.01 * left, True), (0.99 * left, False)):
        assert (frozenset({0}) in made.likelihoods(0, own, [], cross, 0, most)) == kept
    assert set(made.likelihoods(0, own, [], cross, 0, 0.0)) == {frozenset(), frozenset({1})}


@pytest.mark.parametrize(("turns", "excess"), [(6, 25.0), (5, 1.0)])
def test_a_closed_turn_is_one_that_closes_as_those_without_an_event(turns, excess):
    """Noise of five sigmas in each of them, whose median counts, from five on: one turn of all has an event."""
    made = trial(count=turns)
    root = np.linalg.cholesky(made.covariance[0])
    usual = np.sqrt(stats.chi2.ppf(0.5, 2))
    sizes = np.r_[1e3, 1e2, 1e-2, 5 * usual, 5 * usual, 5 * usual][:turns]
    made.angles = lambda i, mended, cross, length: root @ [sizes[i], 0.0]
    for wider, times in ((1.0, excess), (1e6, 1.0)):
        made.covariance = wider * made.covariance
        assert made.closed_below([RegisterFault(FALSE, 0, 110, 1)], None) == pytest.approx(times * stats.chi2.isf(0.01, 2))


def test_that_a_turn_stays_open_is_asked_of_all_turns_together():
    made = trial(count=3)
    each = 1 - 0.99 ** (1 / 3)
    made.segment_of = lambda event: None if event.row > 300 else event.row // 100
    events = [RegisterFault(FALSE, 0, row, 1) for row in (10, 20, 110, 210, 310)]  # two in one turn, one in a rest
    assert made.closed_below(events, None) == pytest.approx(stats.chi2.isf(each, 2))


def likely(made, tables, name, events, others=(), length=0):
    """The verdict with given likelihoods of each turn's choices."""
    made.likelihoods = lambda i, own, others, cross, length, most: {frozenset(c): v for c, v in tables[i].items()}
    made.closed_below = lambda events, cross: np.inf
    made.lost_each_time = lambda events: length
    made.twin.problem.logs = [SimpleNamespace(samples=Table().rest(4).samples())]
    return made.test(name, events, list(others))


def test_two_turns_are_decided_with_the_share_that_they_have_together():
    """Passes by hand: chances with a share of one half, the share of these, and once more until no answer changes."""
    made = trial(count=3)
    events = [RegisterFault(FALSE, 0, row, 1) for row in (110, 150, 190, 5)]
    found = likely(made, {0: {(): 0.0, (0,): 6.0}, 1: {(): 0.0, (0,): 0.4}, 2: {(): 0.0, (0,): -3.0}}, FALSE, events)
    gain = np.array([6.0, 0.4, -3.0, 0.0])
    chance = special.expit(gain)
    for _ in range(2):
        chance = special.expit(gain + special.logit((chance.sum() + 0.5) / 5))
    assert_allclose(found.chance, chance, rtol=1e-9)
    assert found.accepted == [events[0], events[1], events[3]]  # the last, in a rest, is what most are
    assert (found.id, found.length, found.log_ratio) == (FALSE, 0, pytest.approx(6.4))
    # The tilt of the turns concerned is told as recorded and with all repaired.
    for rms, mended in ((found.before_rad, [[], [], []]), (found.tried_rad, [[event] for event in events[:3]])):
        angles = [made.angles(i, own, None, 0) for i, own in enumerate(mended)]
        assert rms == pytest.approx(np.sqrt(np.mean(np.sum(np.square(angles), axis=1))))
    assert made.tilt_rms({}, None, 0) == 0.0


@pytest.mark.parametrize(("gain", "accepted"), [(np.log(300) + 0.01, True), (np.log(300) - 0.01, False)])
def test_events_of_a_kind_are_there_if_closure_outweighs_the_odds_of_any_effect(gain, accepted):
    """One in thirty, and ten scales."""
    event = RegisterFault(FALSE, 0, 110, 1)
    found = likely(trial(), {0: {(): 1.0, (0,): 1.0 + gain}}, FALSE, [event])
    assert found.accepted == [event] * accepted
    assert found.probability == pytest.approx(special.expit(gain - np.log(300)))
    assert found.chance[0] > 0.5
    none = likely(trial(), {0: {(): 1.0, (0,): -5.0}}, FALSE, [event])
    assert (none.accepted, none.probability, none.chance.tolist(), none.log_ratio) == ([], 0.0, [0.0], 0.0)


def test_lengths_that_were_tried_and_rows_that_no_sensor_outputs_count():
    """Of losses, as many lengths as half a second holds; each such row in a rest counts 20, and needs no closure."""
    lost = [RegisterFault(LOST, 0, 110)]
    found = likely(trial(), {0: {(): 0.0, (0,): 9.0}}, LOST, lost, length=2)
    assert (found.log_ratio, found.length) == (pytest.approx(9.0 - np.log(2)), 2)
    assert likely(trial(), {}, LOST, lost).probability == 0.0
    for certain, accepted in ((True, 2), (False, 0)):
        empty = likely(trial(), {}, FALSE, [RegisterFault(FALSE, 0, row, 1, certain) for row in (5, 7)])
        assert (empty.log_ratio, len(empty.accepted)) == (40.0 * certain, accepted)
    chances = np.array([0.51, 0.5])
    assert [Verdict(FALSE, ["a", "b"], chances, p, 0, 0.0, 0.0, 0.0).accepted for p in (0.51, 0.5)] == [["a"], []]


def test_the_common_count_of_losses_in_every_turn_is_that_of_the_best_linear_fit():
    """Also in the first and the last period of each turn; none at its end, and in no log."""
    used = [SimpleNamespace(log=0, start=100 * i, stop=100 * i + 24) for i in range(16)]
    session = SimpleNamespace(logs=[SimpleNamespace(samples=SimpleNamespace(period_s=0.1))])
    for place in (0, 10, 22):
        batch = small_turns(count=16, samples=24)
        batch.dt[:, place] -= 2 * 0.1
        floor = SimpleNamespace(sigma=np.full((16, 2), 1e-4))
        problem = SimpleNamespace(batch=batch, floor=floor, used=used, first=TRUE, session=session, still_rates=None)
        assert _common_count(problem, [RegisterFault(LOST, 0, 100 * i + place) for i in range(16)]) == 2
    assert _common_count(problem, [RegisterFault(LOST, 0, 23), RegisterFault(LOST, 1, 10)]) == 0


def test_turns_that_miss_are_left_open_though_a_plain_fit_follows_them():
    """Four of sixteen ends are turned by a tenth of a radian all alike; nobody says which.  Without that no turn is, by an exact refit."""
    sigma = np.full((16, 2), 1e-4)
    for miss, expected in ((0.1, [2, 5, 9, 14]), (0.0, [])):
        by = np.zeros((16, 3))
        by[[2, 5, 9, 14]] = [miss, miss / 2, 0.0]
        batch = turned_ends(small_turns(count=16, noise_rad=1e-4), by)
        problem = SimpleNamespace(batch=batch, floor=SimpleNamespace(sigma=sigma), first=PERFECT, still_rates=None)
        assert np.flatnonzero(left_open(problem, np.ones(16, dtype=bool))).tolist() == expected
        assert np.flatnonzero(left_open(problem, np.arange(16) != 5)).tolist() == [i for i in expected if i != 5]


@pytest.mark.parametrize(("reach", "smeared"), [({"reach": Reach.around(samples=1)}, 10), ({}, 0)])
def test_a_turns_covariance_is_of_its_noise_and_of_the_physics_that_others_taught(reach, smeared):
    """Each noise component has the size that the physics' own fit gave it; undersampling is of the turns with false readings bridged."""
    a, twin, calm = effect("a", 2, **reach), linear_twin(seed=1), linear_twin(seed=2)
    twin.spoil(a, [5.0, -4.0])
    evidence = twin.evidence()
    fit = evidence.of((a,), evidence.nothing).fit
    noise = SimpleNamespace(size=lambda name: {TURN: 0.7}.get(name, 0.2))
    hypothesis = SimpleNamespace(fit=fit, noise=noise)
    for each in (twin, calm):
        each.batch_at = lambda state: "batch"
        each.movements = [SimpleNamespace(dt_s=dt_s) for dt_s in (0.1, 0.2, 0.9)]
    problem, quiet, given = SimpleNamespace(used=[1, 2]), SimpleNamespace(used=[3, 4]), []
    with (
        patch.object(data_repair, "Twin", lambda each: twin if each is problem else calm),
        patch.object(data_repair, "undersampling", lambda each: "calm" if each is calm else None),
        patch.object(data_repair, "first_noise", lambda twin, whiten, missed: given.append(missed) or twin.noise(whiten)),
    ):
        made = ClosureTrial(problem, hypothesis, quiet)
        quiet.used.append(5)
        ClosureTrial(problem, hypothesis, quiet)
    n = twin.sizes[0]
    J = np.hstack([twin.calibration, twin.columns_of(a)])[:n]
    whole = ((1 + 0.7**2) * np.eye(n) + J @ fit.covariance @ J.T).reshape(8, 2, 8, 2)
    assert_allclose(made.covariance, whole[range(8), :, range(8)], rtol=1e-6)
    assert (made._smeared, made._period_s, given) == (smeared, 0.2, ["calm", None])


# Whole sessions: rows and times go on from log to log.


@pytest.fixture(scope="module")
def two():
    """Two clean logs of eight turns each, and where in them the turns are."""
    tables = [Table().tumble(8, seed=seed) for seed in (11, 12)]
    return [(table.samples(seed=seed), table) for seed, table in enumerate(tables)]


def test_accepted_events_are_told_by_rows_and_seconds_of_all_logs_and_widen_the_floor(two):
    """Later times count what was put in before them, in their own log and in earlier ones; bridges behind a loss move with it."""
    (first, table), (second, other) = two
    at, there = rows_in_turns(table, first, 1, 6)[[1, 5]], rows_in_turns(other, second, 1, 6)[[2]]
    bridges = [Bridge("gap", int(at[0]) + shift, 2, 0.0, np.zeros(3)) for shift in (0, 1)]
    session = session_with(with_losses(first, at, 9), with_losses(second, there, 9), bridges=bridges)
    problem, count = build_problem(replace(session, config=config())), len(session.logs[0].samples)
    lost = [RegisterFault(LOST, log, int(row)) for log, row in ((0, at[0]), (0, at[1] - 9), (1, there[0]))]
    false = [RegisterFault(FALSE, log, row, samples) for log, row, samples in ((0, 30, 1), (1, 40, 2), (1, 50, 4), (0, 9, 1))]
    verdicts = [
        Verdict(FALSE, false, np.array([1.0, 1, 1, 0]), 0.9, 0, 0.0, 0.0, 6.0),
        Verdict(LOST, lost, np.ones(3), 0.9, 9, 0.0, 0.0, 12.0),
    ]
    again = _with_accepted(problem, verdicts, found := {})
    times = found[LOST].parameters.pop("at_s")
    told = {name: (claim.parameters, claim.std) for name, claim in found.items()}
    assert told == {FALSE: ({"at": [30, count + 40, count + 50], "samples": 2}, {}), LOST: ({"length": 9}, {"length": 0.5})}
    assert_allclose(times, [*first.t_s[at], first.duration_s + second.t_s[there[0]]], atol=0.002)
    chances = {name: claim.p_value for name, claim in found.items()}
    assert chances == pytest.approx({FALSE: min(1, 4 * stats.chi2.sf(12.0, 3)), LOST: 3 * stats.chi2.sf(24.0, 3)})
    assert {claim.probability for claim in found.values()} == {0.9}
    one, two = (log.bridges for log in again.session.logs)
    assert [each.row for each in one] == [int(at[0]), int(at[0]) + 1, int(at[0]) + 10, int(at[1]) + 1]
    assert [(each.what, each.row, each.count) for each in two[2:]] == [("gap", int(there[0]) + 1, 9)]
    assert all(each.sigma_rad.max() > 0 for each in (one[1], one[3], two[2]))
    plain = build_problem(replace(again.session, logs=tuple(replace(log, bridges=()) for log in again.session.logs)))
    wider = [s.number for s, own, before in zip(again.used, again.floor.own, plain.floor.own, strict=True) if (own > before + 1e-15).any()]
    inside = [s.number for s in again.used if any(s.start <= each.row < s.stop and each.count == 9 for each in (one, two)[s.log])]
    assert wider == inside
    assert inside
    assert _with_accepted(problem, [replace(verdicts[0], chance=np.zeros(4))], {}) is problem


def test_losses_of_the_second_log_are_timed_after_the_first(two):
    """Of an eighth of a second, over which a rate bends: as one long step, 26 samples would close best.  A closure run is not mended."""
    (first, _), (second, table) = two
    rows = rows_in_turns(table, second, 1, 6)[::2]  # twelve turns without a loss: enough for a linear model of their own
    lossy = with_losses(second, rows, 25)
    problem = build_problem(session_with(first, lossy))
    mended, ((verdict,), _) = repair(problem), tried_events(problem, None, no_report)
    assert list(mended.found) == [LOST]
    parameters = mended.found[LOST].parameters
    assert parameters["length"] == 25
    assert_allclose(parameters["at_s"], first.duration_s + second.t_s[rows], atol=0.02)
    assert verdict.tried_rad < 0.1 * verdict.before_rad
    for samples, at in ((lossy, lossy.t_s[closed_up(rows, 25)]), (second, [])):
        assert_allclose(lost_in(SimpleNamespace(samples=samples, rows=range(len(samples)))), at, atol=0.01)


def test_a_ceiling_in_one_log_leaves_the_other_logs_segments_alone(two):
    (first, _), (second, _) = two
    problem = build_problem(session_with(first, replace(second, gyro=np.clip(second.gyro, -70 * DEG, 70 * DEG))))
    found = find_clipping(problem)
    assert (found.confirmed, found.known_to, found.chance) == (True, pytest.approx(0.002 * found.level), pytest.approx(6 * 2 * 1e-4))
    assert found.excess == excess_of(problem, found.numbers) > 2
    mended = repair(problem)
    (claim,) = mended.found.values()
    assert (claim.effect.id, claim.p_is_bound) == ("gyro.saturation", True)
    assert (claim.parameters, claim.std) == ({"dps": pytest.approx(70, rel=2e-3)}, {"dps": pytest.approx(0.14, rel=0.01)})
    assert [s.number for s in problem.used if s.number not in found.numbers] == [s.number for s in mended.problem.used]
    assert {s.log for s in problem.used if s.number in found.numbers} == {1}


# What the body really did is not mended, what only the readings did is.


def knocked(really):
    """Turns of which every fourth is knocked at 60 dps for three readings about an axis of its own, or reads as if; and the rows."""
    table, rng, knocks = Table().rest(2 + 0.5 / 104), np.random.default_rng(4), {}
    for number in range(16):
        table.turn(rng.uniform(50, 100), rng.normal(size=3), 156 / 104)
        if number % 4 == 0:
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            knocks[int(np.ceil(table.duration_s * 104))] = 60 * DEG * axis
            table.steady(60 * really, axis, 2.5 / 104)
        table.turn(rng.uniform(50, 100), rng.normal(size=3), 156.5 / 104).rest(2)
    samples = table.samples(odr_hz=104.0)
    gyro = samples.gyro.copy()
    for row, rate in knocks.items():
        gyro[row : row + 3] += rate * (not really)
    return build_problem(session_of(replace(samples, gyro=gyro), odr_hz=104.0)), [*knocks]


@pytest.mark.parametrize("really", [True, broad(False)])
def test_a_real_knock_is_not_mended_and_the_same_readings_without_one_are(really):
    """To the readings of the gyro, both are the same; gravity at the turn's end was turned by the one alone."""
    problem, rows = knocked(really)
    assert {(e.id, e.row) for e in proposed(problem.session)} == {(FALSE, row) for row in rows}  # the registers alone propose them
    mended, ((verdict,), _) = repair(problem), tried_events(problem, None, no_report)
    assert (verdict.tried_rad > 1.4 * verdict.before_rad) == really
    assert (verdict.before_rad > 1.4 * verdict.tried_rad) == (not really)
    if really:
        assert mended.found == {}
    else:
        assert (list(mended.found), mended.found[FALSE].parameters["at"]) == ([FALSE], rows)
        assert mended.found[FALSE].p_value < 1e-6
