"""The coach rates a machine's turns by the table's kinematics."""

import numpy as np
import pytest

from session.annexes.machines.description import Axis, Description
from session.annexes.machines.kinematics import attitudes
from session.io.units import DEG, G
from tinygc.annexes.machines.planner import TableMoves
from tinygc.planning.coach import Coach
from tinygc.planning.turns import Turn


def axis(name, direction, limit_deg=None):
    """An axis of a table of 90 deg/s."""
    most = None if limit_deg is None else limit_deg * DEG
    return Axis(name, np.array(direction, dtype=float), None if most is None else -most, most, 90 * DEG, 200 * DEG, 0.02 * DEG, 0.0, name)


@pytest.fixture
def moves():
    """The moves of a table of two axes, one of them with limits."""
    table = Description("bench", "grbl", (axis("outer", [0, 1, 0], 100), axis("inner", [0, 0, 1])), np.eye(3))
    return TableMoves(table, np.array([30, 50]) * DEG, 1.5)


def test_each_turn_ends_where_its_parts_carry_the_board(moves):
    """The product of the parts' rotations is the rotation between both attitudes of the table."""
    from tinygc.attitude import rotation

    start = attitudes(moves.table, moves.angles[None])[0]
    for each in moves.turns_from(None, 10.0):
        body = np.eye(3)
        for part in each.parts:
            body = body @ rotation.matrix(rotation.exp(part.axis * part.angle_rad))
        end = attitudes(moves.table, each.angles[None])[0]
        np.testing.assert_allclose(start @ body, end, atol=1e-12)
        np.testing.assert_allclose(each.parts[-1].up, -end[2], atol=1e-12)
        np.testing.assert_allclose(each.up, -start[2], atol=1e-12)
        assert each.moves[-1].angle_rad == each.angles[each.moves[-1].axis]


def test_turns_from_one_place_are_found_once(moves):
    first = moves.turns_from(None, 10.0)
    assert moves.turns_from(moves.angles + 1e-5, 10.0) is first
    assert moves.turns_from(moves.angles + 1 * DEG, 10.0) is not first
    moves.hold_s = 3.0
    assert moves.turns_from(None, 10.0)[0].cost_s == first[0].cost_s + 1.5


def test_a_turn_that_lasts_longer_is_noisier(moves):
    """White noise of the rate: the sigma of an angle grows with the root of time, and the rows are the columns over it."""
    coach = Coach(machine=moves)
    turns = moves.turns_from(None, 10.0)
    rows = coach._rows(np.array([0.0, 0.0, -G]), turns)
    slow = [Turn(each.straightened, each.parts, 4 * each.cost_s, each.moves, each.angles) for each in turns]
    np.testing.assert_allclose(coach._rows(np.array([0.0, 0.0, -G]), slow), rows / 2, rtol=1e-12)
