"""What a machine may turn next: turns that end where their parts carry the board, within the limits of the axes and of a segment."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from table_recordings import table_toml

from session.base import rotation
from session.base.units import DEG
from tinygc import CalibrationError
from tinygc.features.tables.machines.description import Axis, Description, attitudes, read_description
from tinygc.features.tables.planner import _LEAST_TURN_RAD, TableMoves, _seconds_of, plan_of


def axis(name, direction, limit_deg=np.inf):
    """An axis of a table of 90 deg/s."""
    most = limit_deg * DEG
    return Axis(name, np.array(direction, dtype=float), 90 * DEG, 200 * DEG, 0.02 * DEG, -most, most)


@pytest.fixture
def moves():
    """The moves of a table of two axes, one of them with limits."""
    table = Description("bench", "grbl", (axis("outer", [0, 1, 0], 100), axis("inner", [0, 0, 1])), np.eye(3))
    return TableMoves(table, np.array([30, 50]) * DEG, 1.5)


def test_each_turn_ends_where_its_parts_carry_the_board(moves):
    """The product of the parts' rotations is the rotation between both attitudes of the table."""
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


def _description(toml):

    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.toml"
        path.write_text(toml)
        return read_description(path)


def test_no_move_leaves_the_limits():
    """Of random limits and random walks through what is offered: no angle beyond, no rate above, every turn one that counts."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        names = rng.permutation(["outer", "middle", "inner"])[: rng.integers(1, 4)]
        limits = {name: sorted(rng.uniform(-400, 400, 2).round(1)) for name in names if rng.random() < 0.7}
        limits = {name: (low, high + 80) for name, (low, high) in limits.items()}
        table = _description(table_toml(*names, limits=limits, fastest=float(rng.uniform(5, 200))))
        start = [rng.uniform(*limits[name]) if name in limits else rng.uniform(-500, 500) for name in names]
        moves = TableMoves(table, np.multiply(start, DEG), 1.5, 0)
        most_rps = rng.uniform(10, 300) * DEG
        for _ in range(4):
            for turn in moves.turns_from(None, most_rps):
                angles = moves.angles.copy()
                for move in turn.moves:
                    before, angles[move.axis] = angles[move.axis], move.angle_rad
                    axis = table.axes[move.axis]
                    assert axis.allows(move.angle_rad)
                    assert moves.limits[move.axis][0] - 1e-9 <= move.angle_rad <= moves.limits[move.axis][1] + 1e-9
                    assert 0 < move.rate_rps <= min(axis.fastest_rps, most_rps)
                    assert abs(move.angle_rad - before) >= _LEAST_TURN_RAD
                assert np.array_equal(angles, turn.angles)
            for move in moves.choose(most_rps):
                moves.angles[move.axis] = move.angle_rad


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"limits": {"middle": (-10, 10)}}, "no turn of 35 deg or more lies within the limits"),
        ({"fastest": 1.0}, "ends within 30 s, the longest segment"),
    ],
)
def test_a_table_without_a_turn_that_counts_is_refused(more, says):
    moves = TableMoves(_description(table_toml("middle", **more)), np.zeros(1), 1.5)
    with pytest.raises(CalibrationError, match=says):
        moves.turns_from(None, np.inf)


def test_no_turn_of_a_slow_table_is_too_long_for_a_segment():
    """All that is offered ends within the 30 s of the longest segment, and what an axis reaches in them is the longest of it."""
    fastest = 3.0
    moves = TableMoves(_description(table_toml("middle", "inner", fastest=fastest)), np.zeros(2), 1.5)
    turns = moves.turns_from(None, np.inf)
    for turn in turns:
        assert sum(part.seconds for part in turn.parts) < 30 - 0.6 * len(turn.parts) + 1e-9
    assert max(part.angle_rad for turn in turns for part in turn.parts) <= moves.reach_rad(0)
    assert moves.reach_rad(0) == pytest.approx(fastest * (29.4 - fastest / 200) * DEG)


def test_a_move_takes_its_ramps_and_a_plan_its_turns():
    """Of 90 deg at 30 dps and 100 dps^2 the ramps add 0.3 s; one of 1 deg never reaches the rate.  A turn has its still besides."""
    assert _seconds_of(90 * DEG, 30 * DEG, 100 * DEG) == pytest.approx((3.3, 0.3))
    assert _seconds_of(-1 * DEG, 30 * DEG, 100 * DEG) == pytest.approx((0.2, 0.1))
    table = _description(table_toml("middle", "inner", limits={"middle": (-90, 270)}))
    turns, _ = plan_of(TableMoves(table, np.zeros(2), 1.5), False, 3, False)
    angles, expected_s = np.zeros(2), 0.0
    for turn in turns:
        for move in turn.moves:
            expected_s += abs(move.angle_rad - angles[move.axis]) / (90 * DEG) + 90 / 200
            angles[move.axis] = move.angle_rad
        expected_s += 0.6 + 1.5
    assert sum(turn.cost_s for turn in turns) == pytest.approx(expected_s)
