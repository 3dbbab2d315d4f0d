"""Which turns the physics is learnt from that judges events: all that close, whatever was proposed in them."""

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from spoilt_registers import rows_in_turns, with_glitches, with_losses

from tinygc.closure.build import build_problem
from tinygc.explanation.data_repair import left_open
from tinygc.explanation.faulty_readings import FALSE, proposed


@pytest.fixture(scope="module")
def table() -> Table:
    return Table().tumble(24, seed=21)


def opened(problem, rows) -> tuple[list[int], list[int]]:
    """Numbers of the segments that are left open where each is under suspicion, and of those that hold one of the rows."""
    found = left_open(problem, np.ones(len(problem.used), dtype=bool))
    hit = [s.number for s in problem.used if any(s.start <= row < s.stop for row in rows)]
    return [s.number for s, is_open in zip(problem.used, found, strict=True) if is_open], hit


def test_no_turn_that_closes_is_left_open(table):
    for seed in range(2):
        assert opened(build_problem(session_of(table.samples(seed=seed))), [])[0] == []


@pytest.mark.parametrize("share", [3])
def test_turns_that_lost_samples_are_left_open_and_no_others(table, share):
    """Up to a third of all, which draw a plain fit to themselves; nobody says beforehand which they are."""
    samples = table.samples(seed=1)
    rows = rows_in_turns(table, samples, 1, 2)[::share]
    problem = build_problem(session_of(with_losses(samples, rows, 12)))
    found, hit = opened(problem, rows - 12 * np.arange(len(rows)))
    assert len(hit) == len(rows)
    assert found == hit


@pytest.mark.parametrize("odr_hz", [62.5])
@pytest.mark.parametrize("count", [7])
def test_long_false_readings_do_not_hide_among_themselves_at_a_low_data_rate(table, odr_hz, count):
    """What their neighbourhood scatters by is taken from more readings than the longest of them spoils."""
    samples = table.samples(odr_hz=odr_hz, seed=3)
    rows = rows_in_turns(table, samples, 1, 4)[::2]
    spoilt = with_glitches(samples, rows, np.full(len(rows), count), 5)
    assert np.abs(spoilt.gyro - samples.gyro).max() > 20 * DEG
    assert {e.row for e in proposed(session_of(spoilt)) if e.id == FALSE} >= set(rows.tolist())
