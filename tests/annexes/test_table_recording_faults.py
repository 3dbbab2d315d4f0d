"""What can go wrong with a table during a recording: it ends at rest, loses nothing, and goes on once somebody has put it right."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import broad
from processes import PATIENCE_S
from table_recordings import Bench, table_toml

from session.annexes.machines.angles import read_angles
from session.annexes.machines.virtual_motion import FAULTS
from session.bench.messages import AxisMove, Kind, Stage
from session.io.units import DEG
from tinygc import CalibrationError, read_session
from tinygc.annexes.machines.planner import LEAST_TURN_RAD, TableMoves

#: faults of homing are no faults of a recording, which does not home
OF_A_RECORDING = sorted(set(FAULTS) - {"home_fails"})
#: those that a recording goes on with: answers that come late or twice, and a motor that loses steps, which is told from gravity
BORNE = ("late", "doubled", "lost_steps")
#: those that leave a motion that no program can stop
OUT_OF_REACH = ("cable", "silence")
QUICK = ("estop", "stall", "lost_steps", "cable")


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent."""
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.LAST_WORD_S", PATIENCE_S)


@pytest.mark.parametrize("kind", [kind if kind in QUICK else broad(kind) for kind in OF_A_RECORDING])
def test_a_fault_ends_at_rest_and_the_recording_goes_on(tmp_path, kind):
    """A fault in the second move: paused with one line, at rest, nothing lost; homed and resumed, the session is whole."""
    bench = Bench(tmp_path, table_toml("middle", "inner"), faults=f"{kind}@move3")  # homing is the first
    rounds = []

    def interrupted(guide):
        rounds.append(guide.stage is Stage.PAUSED)
        return sum(rounds) > 60

    guide, said = bench.record(segments=3, interrupted=interrupted)
    lines = [change.text for change in said.changes if change.kind is Kind.WARNING]
    assert not bench.bench.virtual.mechanics.is_moving()
    if kind in BORNE:
        assert guide.stage is Stage.DONE
        assert len(lines) == (kind == "lost_steps")
    else:
        assert guide.stage is Stage.PAUSED
        (line,) = lines
        assert "Traceback" not in line
        assert "p goes on" in line
        assert ("press its own emergency stop" in line) == (kind in OUT_OF_REACH)
        bench.repair()
        guide, said = bench.record(segments=3)
        assert guide.stage is Stage.DONE
    assert guide.accepted == 3
    session = read_session(bench.folder)
    angles = read_angles(bench.folder / "table.csv", bench.description)
    assert set(angles) == {log.path.name for log in session.logs}
    assert sum(len(log.samples) for log in session.logs) <= bench.bench.sent
    for log in session.logs:  # nothing is missing within a log
        assert log.samples.dt_s.max() < 1.5 * log.samples.period_s


def test_an_emergency_stop_that_was_cleared_at_the_table_goes_on_with_p(tmp_path):
    bench, paused = Bench(tmp_path, table_toml("middle", "inner", make="line"), faults="estop@move3"), []

    def each(guide, mover):
        mechanics = bench.bench.virtual.mechanics
        if guide.stage is Stage.PAUSED:
            paused.append(mechanics.is_moving())
        if len(paused) == 20 and guide.stage is Stage.PAUSED:
            mechanics.release()
            mechanics.clear()
            bench.press("p")

    guide, said = bench.record(segments=3, each=each)
    assert guide.accepted == 3
    (line,) = [text for text in said.texts if "the table is stopped" in text]
    assert "emergency stop" in line
    assert "put it right there, then p goes on" in line
    assert not any(paused)


@pytest.mark.parametrize("seed", [0, *map(broad, range(1, 8))])
def test_no_move_leaves_the_limits(seed):
    """Of random limits and random walks through what is offered: no angle beyond, no rate above, every turn one that counts."""
    rng = np.random.default_rng(seed)
    for _ in range(3):
        names = rng.permutation(["outer", "middle", "inner"])[: rng.integers(1, 4)]
        limits = {name: sorted(rng.uniform(-400, 400, 2).round(1)) for name in names if rng.random() < 0.7}
        limits = {name: (low, high + 80) for name, (low, high) in limits.items()}
        table = _description(table_toml(*names, limits=limits, fastest=float(rng.uniform(5, 200))))
        start = [rng.uniform(*limits[name]) if name in limits else rng.uniform(-500, 500) for name in names]
        moves = TableMoves(table, np.multiply(start, DEG), 1.5, seed)
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
                    assert abs(move.angle_rad - before) >= LEAST_TURN_RAD
                assert np.array_equal(angles, turn.angles)
            for move in moves.choose(most_rps):
                moves.angles[move.axis] = move.angle_rad


def test_a_table_whose_limits_allow_no_turn_is_refused(tmp_path):
    moves = TableMoves(_description(table_toml("middle", limits={"middle": (-10, 10)})), np.zeros(1), 1.5)
    with pytest.raises(CalibrationError, match="no turn of 35 deg or more lies within the limits"):
        moves.turns_from(None, 1.0)


@pytest.mark.parametrize("fastest", [2.0, 3.0, 6.0])
def test_no_turn_of_a_slow_table_is_too_long_for_a_segment(fastest):
    """All that is offered ends within the 30 s of the longest segment, and what an axis reaches in them is the longest of it."""
    moves = TableMoves(_description(table_toml("middle", "inner", fastest=fastest)), np.zeros(2), 1.5)
    turns = moves.turns_from(None, np.inf)
    for turn in turns:
        assert sum(part.seconds for part in turn.parts) < 30 - 0.6 * len(turn.parts) + 1e-9
    assert max(part.angle_rad for turn in turns for part in turn.parts) <= moves.reach_rad(0)
    assert moves.reach_rad(0) == pytest.approx(fastest * (29.4 - fastest / 200) * DEG)


def test_a_table_that_is_too_slow_for_any_turn_is_refused():
    moves = TableMoves(_description(table_toml("middle", fastest=1.0)), np.zeros(1), 1.5)
    with pytest.raises(CalibrationError, match="ends within 30 s, the longest segment"):
        moves.turns_from(None, np.inf)


def test_a_move_beyond_the_limits_is_not_sent(tmp_path):
    """Whatever the planner says: the driver refuses it, and the recording pauses."""
    bench = Bench(tmp_path, table_toml("middle", "inner", make="line", limits={"middle": (-100, 100)}))

    def each(guide, mover):
        mover._moves.first = (AxisMove(0, 170 * DEG, 1.0),)

    guide, said = bench.record(segments=1, each=each, interrupted=lambda guide: guide.stage is Stage.PAUSED)
    assert guide.accepted == 0
    assert any("middle to 170 deg, expected -100 to 100; nothing was moved" in text for text in said.texts)


def _description(toml: str):
    from pathlib import Path
    from tempfile import TemporaryDirectory

    from session.annexes.machines.description import read_description

    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.toml"
        path.write_text(toml)
        return read_description(path)
