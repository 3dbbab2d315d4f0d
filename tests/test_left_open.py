"""Which turns the physics is learnt from that judges events: all that close, whatever was proposed in them."""

import numpy as np
from conftest import Table, session_of

from tinygc.closure.build import build_problem
from tinygc.explanation.data_repair import left_open


def test_no_turn_that_closes_is_left_open():
    """Not even where each is under suspicion."""
    table = Table().tumble(24, seed=21)
    for seed in range(2):
        problem = build_problem(session_of(table.samples(seed=seed)))
        assert not left_open(problem, np.ones(len(problem.used), dtype=bool)).any()
