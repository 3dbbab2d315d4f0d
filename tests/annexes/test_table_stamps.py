"""Stamps of a machine's word: how their errors enter the rows, which answers were held up, and live stamps of clean tables."""

import numpy as np
import pytest
from table_simulation import fixed_moves
from table_summaries import Stamps, Summary, draw

from session.annexes.machines.angles import AngleLog
from session.annexes.machines.description import Axis, Description
from session.annexes.machines.mechanics import TableErrors
from session.io.samples import Samples
from session.io.units import DEG
from tinygc.annexes.machines.observed import Turn, held_up_from, said_at, stamps_beside
from tinygc.annexes.machines.rows import Comparison
from tinygc.annexes.machines.rows_noise import NoiseModel, of_answers
from tinygc.annexes.machines.selection import DELAY_SIGMA_S, LATE_STAMPS_S, select

RATE_RPS = 60 * DEG
TABLE = Description(
    "bench",
    "virtual",
    tuple(
        Axis(name, direction, -np.pi, np.pi, 200 * DEG, 400 * DEG, 0.01 * DEG, 0.0, name)
        for name, direction in zip("ab", np.eye(3)[[2, 1]], strict=True)
    ),
)


def session(stamps, seed=0, moves=16, latency_s=0.0):
    errors = TableErrors(TableErrors.none(TABLE).axes, latency_s=latency_s)
    return draw(Summary(TABLE, fixed_moves(TABLE, moves, 80 * DEG, seed), errors, stamps=stamps, block_s=0.07), seed)


def test_an_edge_at_an_answer_has_that_answer_and_one_between_has_its_neighbours():
    taken = of_answers(np.array([2.0, 3.5]))
    assert taken[0] == pytest.approx(np.eye(taken.shape[1])[2], abs=1e-15)
    assert taken[1, 2:6] == pytest.approx([-1 / 16, 9 / 16, 9 / 16, -1 / 16], abs=1e-15)
    assert of_answers(np.linspace(2, 9, 30)).sum(axis=1) == pytest.approx(1.0, abs=1e-14)


def test_the_word_at_the_edges_scatters_as_its_answers_do():
    """Akima's interpolation of a turn at one rate, against the covariance of the rows: variances and neighbours, over 1500 draws."""
    rng, poll_s, edges = np.random.default_rng(1), np.arange(1, 40) * 0.06, np.linspace(0, 2.4, 36)
    ends = np.zeros(1), np.array([2.4 * RATE_RPS])
    at = said_at(edges, poll_s, RATE_RPS * poll_s[:, None], ends)[1]
    drawn = np.array(
        [said_at(edges, poll_s, RATE_RPS * (poll_s + 1e-3 * rng.normal(size=39))[:, None], ends)[0][:, 0] for _ in range(4000)]
    )
    inner = slice(4, -4)
    seen, derived = np.cov(drawn.T)[inner, inner], (1e-3 * RATE_RPS) ** 2 * (of_answers(at) @ of_answers(at).T)[inner, inner]
    assert np.diag(seen) == pytest.approx(np.diag(derived), rel=0.25)
    assert np.diag(seen, 1) == pytest.approx(np.diag(derived, 1), abs=0.15 * derived.max())


def test_jitter_and_wander_of_the_stamps_are_angles_by_the_rate():
    """Covariances of the rows within a turn, of each size alone; where the axis rests the word has no error."""
    seen = session(None, moves=8)
    model = NoiseModel(Comparison(seen))
    tiny = np.log([1e-9, 1e-9, 1e-15, 1e-9, 1.0])
    walks = [factor @ factor.T for factor in model._factors(tiny)]
    for place, size in ((0, 2e-3), (3, 5e-3)):
        x = tiny.copy()
        x[place] = np.log(size)
        x[4] = np.log(0.3)
        for number, (factor, walk) in enumerate(zip(model._factors(x), walks, strict=True)):
            way = seen.said_edges[number, : seen.blocks[number] + 1, seen.alone[number]]
            rate = (way[2:] - way[:-2]) / (2 * seen.block_s[number])
            t_s = seen.block_s[number] * np.arange(len(rate))
            kept = np.eye(len(rate)) if place == 0 else np.exp(-np.abs(t_s[:, None] - t_s) / 0.3)
            assert factor @ factor.T - walk == pytest.approx(
                size**2 * np.outer(rate, rate) * kept, abs=2e-3 * (size * rate.max()) ** 2 + 1e-15
            )


@pytest.fixture
def turn():
    """Answers of a turn of 90 degrees that begins and ends within it, stamped with a jitter of 1 ms."""
    rng, t_s = np.random.default_rng(4), np.arange(0, 3, 0.005)
    way = np.interp(t_s, [0.5, 2.5], [0, 90 * DEG])
    asked_s = np.arange(0.03, 2.95, 0.06)
    return t_s, way, asked_s, asked_s + 1e-3 * rng.normal(size=len(asked_s))


@pytest.mark.parametrize("late_s", [0.05, 0.02, -0.02])
def test_an_answer_that_was_held_up_is_found_and_no_other(turn, late_s):
    t_s, way, asked_s, stamp_s = turn
    stamp_s[20] += late_s
    beside_s = stamps_beside(stamp_s, np.interp(asked_s, t_s, way), t_s, way)
    assert np.flatnonzero(np.abs(beside_s) > held_up_from([beside_s])).tolist() == [20]
    assert beside_s[20] == pytest.approx(late_s, abs=3e-3)


@pytest.mark.parametrize("error_deg", [lambda a: 2.0 * (a > 45 * DEG), lambda a: 0.5 * np.sin(9 * a), lambda a: 1.0 * np.sin(a)])
def test_an_error_of_the_table_is_no_answer_that_was_held_up(turn, error_deg):
    """Lost steps, a ripple and an index error: neighbours have them too."""
    t_s, way, asked_s, stamp_s = turn
    said = np.interp(asked_s, t_s, way)
    beside_s = stamps_beside(stamp_s, said + error_deg(said) * DEG, t_s, way)
    assert not (np.abs(beside_s) > held_up_from([beside_s])).any()


def test_an_answer_that_is_late_throughout_is_not_held_up_where_the_axis_begins_and_stops():
    """All stamps are 15 ms late, with almost no jitter, and the axis takes 0.3 s to its rate."""
    t_s = np.arange(0, 3, 0.005)
    way = np.cumsum(np.interp(t_s, [0.5, 0.8, 2.2, 2.5], [0, 90 * DEG, 90 * DEG, 0])) * 0.005
    asked_s = np.arange(0.03, 2.95, 0.06)
    beside_s = stamps_beside(asked_s + 0.015, np.interp(asked_s, t_s, way), t_s, way)
    assert not (np.abs(beside_s) > held_up_from([beside_s])).any()


def test_a_turn_leaves_out_what_was_held_up_whatever_the_zero_of_the_gyroscope():
    """A zero of 3 dps is 9 degrees in the turn; one answer of 40 is held up by 60 ms, 3.6 degrees."""
    t_s = np.arange(0, 3, 0.005)
    rate = np.interp(t_s, [0.5, 0.7, 2.0, 2.2], [0, RATE_RPS, RATE_RPS, 0])
    way = np.append(0.0, np.cumsum((rate[1:] + rate[:-1]) / 2 * 0.005))
    zero = np.array([0.02, -0.03, 3 * DEG])
    gyro = rate[:, None] * np.array([0, 0, 1.0]) + zero
    samples = Samples(np.rint(t_s * 1e9).astype(np.int64), gyro, np.zeros((len(t_s), 3)), np.full(len(t_s), np.nan))
    asked_s = np.arange(0.03, 2.9, 0.06)
    stamp_s = asked_s + 0.012
    stamp_s[20] += 0.06 - 1e-3  # just before the next one
    angles = np.column_stack([np.interp(asked_s, t_s, way), np.zeros(len(asked_s))])
    word = AngleLog("log", np.rint(stamp_s * 1e9).astype(np.int64), np.full(len(asked_s), np.nan), asked_s > 0, angles)
    turn = Turn(samples, 0, len(t_s), zero, word, (np.zeros(2), np.array([way[-1], 0.0])))
    limit_s = held_up_from([turn.beside_s])
    assert np.flatnonzero(np.abs(turn.beside_s) > limit_s).tolist() == [20]
    _, block_s, rates, said, answer_at = turn.blocks(limit_s)
    late = np.interp(block_s * np.arange(len(said)) - 0.012, t_s, way)
    assert np.abs(said[:, 0] - late).max() < 0.2 * DEG
    assert rates.sum(axis=0) * block_s == pytest.approx([0, 0, way[-1]] + zero * t_s[-1], abs=1e-6)
    assert answer_at[-1] == len(asked_s)  # both rests, and one answer less


def test_few_answers_are_not_judged():
    t_s = np.arange(0, 1, 0.01)
    assert np.isnan(stamps_beside(np.array([0.2, 0.5, 0.8]), np.zeros(3), t_s, t_s)).all()
    assert held_up_from([np.full(3, np.nan)]) == np.inf
    assert held_up_from([]) == np.inf


def test_stamps_are_drawn_as_they_are_described():
    asked_s, stamp_s = Stamps(late_s=0.01, jitter_s=2e-3, wander_s=3e-3, time_s=2.0).drawn(3000.0, np.random.default_rng(2))
    late_s = stamp_s - asked_s
    assert (np.diff(stamp_s) >= 0).all()
    assert late_s.mean() == pytest.approx(0.01, abs=5e-4)
    assert late_s.var() == pytest.approx(4e-6 + 9e-6, rel=0.1)
    kept = np.mean((late_s[33:] - late_s.mean()) * (late_s[:-33] - late_s.mean()))
    assert kept == pytest.approx(9e-6 * np.exp(-33 * 0.06 / 2.0), rel=0.2)


@pytest.mark.broad
def test_sizes_of_live_stamps_are_recovered_and_nothing_is_named():
    found = [select(session(Stamps(late_s=0.01, jitter_s=2e-3, wander_s=3e-3, time_s=2.0, stalled=0.01), seed), seed) for seed in range(4)]
    assert [each.named for each in found] == [[]] * 4
    jitter_s, _, _, wander_s, _ = np.median([each.noise.word for each in found], axis=0)
    assert jitter_s == pytest.approx(2e-3, rel=0.3)
    assert wander_s == pytest.approx(3e-3, rel=0.4)
    assert np.mean([each.latency_s for each in found]) == pytest.approx(0.01, abs=2e-3)


@pytest.mark.broad
@pytest.mark.parametrize(("latency_s", "ids"), [(0.02, []), (0.05, ["table.latency"]), (-0.02, ["gyro.bandwidth"])])
def test_a_word_is_late_beyond_what_a_computer_makes_of_it(latency_s, ids):
    """0 to 10 ms late in any case, and 5 ms either way: a word of 20 ms has no name, and one that is 20 ms early has."""
    assert np.hypot(DELAY_SIGMA_S, LATE_STAMPS_S) == pytest.approx(7.6e-3, abs=1e-4)
    found = select(session(None, 3, latency_s=latency_s), 3)
    assert [each.candidate.id for each in found.named] == ids
