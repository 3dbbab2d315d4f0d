"""A session that a machine turns, whole: on a virtual table of a real make, with a virtual board on it."""

from __future__ import annotations

import re
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from processes import PATIENCE_S
from table_recordings import OPTIONS, Bench, table_toml

from session.annexes.machines.angles import read_angles
from session.annexes.machines.kinematics import attitudes
from session.annexes.machines.verbs import TableFault, TableLimit
from session.bench.guide import Guide
from session.bench.messages import Kind, Stage
from session.detect.stills import SessionStills
from session.io.config import Protocol
from session.io.units import DEG
from tinygc import CalibrationError, FitOptions, fit, read_session
from tinygc.annexes.machines.recording import TurnedRecording
from tinygc.closure.build import build_problem
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.planning.proposals import TARGETS


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent unless a test wants it so."""
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.LAST_WORD_S", PATIENCE_S)


def warnings(said) -> list[str]:
    return [change.text for change in said.changes if change.kind is Kind.WARNING]


def test_a_whole_session_is_turned_by_the_machine(tmp_path):
    """The turns are those of the guide, nothing is contradicted, and table.csv and attitudes.csv say where the sensor was."""
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    guide, said = bench.record(segments=4)
    assert guide.stage is Stage.DONE
    assert (guide.accepted, guide.rejected) == (4, 0)
    assert not warnings(said)
    session = read_session(bench.folder)
    stills = SessionStills(session).of(session.logs[0]).stills
    assert len(session.attitudes) == len(stills) == 5
    up = np.array([still.accel_mean / np.linalg.norm(still.accel_mean) for still in stills])
    roll, pitch, _ = session.attitudes.T
    dials = np.column_stack([np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])
    assert np.abs(dials - up).max() < 2e-3
    angles = read_angles(bench.folder / "table.csv", bench.description)["log0001.csv"]
    at_rest = attitudes(bench.description, angles.angles[~angles.moving])
    assert np.abs(-at_rest[:, 2][-1] - up[-1]).max() < 2e-3
    assert not bench.bench.virtual.mechanics.is_moving()


@pytest.mark.broad
def test_every_target_is_met_and_the_fit_finds_the_sensor(tmp_path):
    """What the coach states is the covariance of the recorded session, and the fit's parameters are the sensor's within 4 sigma."""
    bench = Bench(tmp_path, table_toml("outer", "middle", "inner"), replace(OPTIONS, bias_instability_dph=3.0))
    guide, said = bench.record(segments=40, stop_at_target=True)
    assert guide.advice.reached
    assert guide.accepted < 25
    assert not warnings(said)
    problem = build_problem(read_session(bench.folder))
    covariance = parameter_covariance(problem.batch, problem.floor, problem.first, problem.earth, wander=problem.wander)
    planned = np.array([value for _, value in guide.advice.sigmas]) * TARGETS / np.sqrt(np.diag(covariance))
    assert np.median(planned) == pytest.approx(1, abs=0.03)
    assert np.abs(planned - 1).max() < 0.2
    found = fit(bench.folder, FitOptions(methods=("least_squares",))).result
    truth = np.append(bench.bench.unit.E.ravel(), bench.bench.unit.B)
    assert np.abs((found.linear.model.vector - truth) / np.sqrt(np.diag(found.covariance))).max() < 4


def test_the_closure_run_goes_through_attitudes_and_back_onto_its_mark(tmp_path):
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    guide, said = bench.record(segments=1, closure_s=20.0)
    assert guide.stage is Stage.DONE
    assert not warnings(said)
    assert [text for text in said.texts if text.startswith("closure run: ")]
    session = read_session(bench.folder)
    assert [log.path.name for log in session.closures] == ["closure0001.csv"]
    angles = read_angles(bench.folder / "table.csv", bench.description)
    assert sorted(angles) == ["closure0001.csv", "log0001.csv"]
    run = attitudes(bench.description, angles["closure0001.csv"].angles)
    assert np.abs(run[0] - run[-1]).max() < 1e-6
    assert np.ptp(angles["closure0001.csv"].angles, axis=0).min() > 90 * DEG


def test_a_pause_lets_the_move_end_and_the_next_one_waits(tmp_path):
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    paused = []

    def each(guide, mover):
        if guide.turning and not paused:
            bench.press("p")
        if guide.stage is Stage.PAUSED:
            paused.append(bench.bench.virtual.mechanics.is_moving())
            if len(paused) == 100:
                bench.press("p")

    guide, said = bench.record(segments=2, each=each)
    assert paused[0]  # the move that was under way
    assert not any(paused[50:])
    assert guide.accepted == 2
    assert not warnings(said)


def test_the_stop_key_stops_at_once(tmp_path):
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    angles = []

    def each(guide, mover):
        if guide.turning and guide.turn.path_rad > 0.3 and not angles:
            bench.press("s")
        if guide.stage is Stage.PAUSED:
            angles.append([track.state(bench.bench.clock.now_s())[0] for track in bench.bench.virtual.tracks])
            if len(angles) == 60:
                bench.press("p")

    guide, said = bench.record(segments=2, each=each)
    still = np.ptp(angles, axis=0)
    assert still.max() < 1e-6
    assert "the table is stopped; p goes on with the next move" in warnings(said)
    assert guide.accepted == 2


@pytest.mark.broad
def test_a_table_whose_board_falls_silent_stops(tmp_path):
    bench, moved = Bench(tmp_path, table_toml("middle", "inner", fastest=8.0)), []

    def each(guide, mover):
        inner = bench.bench
        if guide.turning and guide.turn.path_rad > 0.1 and not moved:
            inner.silent = True
        if inner.silent:
            moved.append(inner.virtual.mechanics.is_moving())
            inner.silent = len(moved) < 50

    guide, said = bench.record(segments=1, each=each)
    assert any("no samples for 2 s while the table moves" in text for text in warnings(said))
    assert not any(moved[35:])  # 2 s, and the time to brake
    assert guide.accepted == 1


def test_resumed_it_goes_on_from_where_the_table_stands(tmp_path):
    """Ctrl-C in the middle of a move: the table is brought to rest; --resume counts what was recorded, and table.csv goes on."""
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    guide, _ = bench.record(segments=4, interrupted=lambda guide: guide.accepted == 2 and guide.turning)
    assert guide.accepted == 2
    assert not bench.bench.virtual.mechanics.is_moving()
    before = (bench.folder / "table.csv").read_text()
    guide, said = bench.record(segments=4)
    assert guide.accepted == 4
    assert "resumed: 2 segments so far" in said.texts
    assert (bench.folder / "table.csv").read_text().startswith(before)
    session = read_session(bench.folder)
    assert len(session.logs) == 2
    assert np.isfinite(session.attitudes).all()


@pytest.mark.broad
def test_what_a_table_of_one_axis_cannot_show_is_said_and_ends(tmp_path):
    """About the vertical alone: no turn shows a scale; it stops where what can be seen is known."""
    bench = Bench(tmp_path, table_toml("outer"))
    guide, said = bench.record(segments=40, stop_at_target=True)
    assert guide.stage is Stage.DONE
    assert guide.accepted < 40
    last = said.changes[-1].text
    assert "all that this table can show has reached its target, or changes no more; it cannot show" in last
    assert "scale of z" in last


def test_a_mounting_that_is_the_other_way_round_is_named_and_pauses(tmp_path):
    """table.toml says z up where it is down: gravity contradicts each still."""
    flipped = table_toml("middle", "inner").replace('make = "grbl"', 'make = "grbl"\nmounting = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]')
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    bench.file.write_text(flipped)
    _, said = bench.record(segments=6, interrupted=lambda guide: guide.stage is Stage.PAUSED)
    assert any("upside down: is mounting" in text for text in warnings(said))
    assert any("3 stills in a row contradict the machine" in text for text in warnings(said))


def test_a_table_that_does_not_know_its_angles_is_homed_first(tmp_path):
    """GRBL is locked when it is switched on: it is said what to do; with --home the plan begins with it."""
    bench = Bench(tmp_path, table_toml("middle", "inner"), homed=False)
    with pytest.raises(TableFault, match="home it"):
        bench.record(segments=1)
    guide, said = bench.record(segments=1, home=True)
    assert guide.accepted == 1
    assert not warnings(said)


def test_a_plan_that_nobody_confirms_moves_nothing(tmp_path, monkeypatch, capsys):
    bench = Bench(tmp_path, table_toml("middle", "inner", make="line", limits={"middle": (-90, 270)}))
    machine = TurnedRecording(bench.file, opened=bench.bench.opened, now_s=bench.bench.clock.now_s)
    for answer in ("", "no\n"):
        monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda known=bool(answer): known, readline=lambda answer=answer: answer))
        with pytest.raises(CalibrationError, match="the plan is not confirmed, and nothing was moved"):
            machine.confirmed(False, 7, False, 60.0, yes=False)
        plan = capsys.readouterr().err
        assert "middle   -90 to 270 deg, at most 90 dps" in plan
        assert "inner    -720 to 720 deg (it has no limits; a cable may)" in plan
        assert "7 turns at most; 7 in " in plan
        assert re.search(r"likely turns: 1 (middle|inner) to -?\d+°", plan)
        assert re.search(r";\s+7 (middle|inner) to -?\d+°", plan)
        mover = machine.mover(bench.folder, Guide(Protocol()))
        with pytest.raises(TableLimit, match="in no plan that was confirmed"):
            mover.driver.table.turn_to(0, 1.0, 1.0)
        mover.close()
    machine.close()
    assert [track.state(bench.bench.clock.now_s())[0] for track in bench.bench.virtual.tracks] == [0.0, 0.0]


def test_a_table_that_shows_little_is_asked_about_twice(tmp_path, monkeypatch, capsys):
    """One upright axis: its plan groups what no turn of it shows, and a yes to the plan is not a yes to that."""
    bench, answers = Bench(tmp_path, table_toml("outer")), iter(["yes\n", "no\n"])
    machine = TurnedRecording(bench.file, opened=bench.bench.opened, now_s=bench.bench.clock.now_s)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: next(answers)))
    with closing(machine), pytest.raises(CalibrationError, match="the plan is not confirmed"):
        machine.confirmed(False, 40, True, 0.0, yes=False)
    said = capsys.readouterr().err
    assert "no turn of this table shows 8 of 12 parameters: scale of x, y, z; misalignment of " in said
    assert said.endswith("turn? (yes) such a session calibrates little of the sensor: turn nevertheless? (yes) ")
    assert not list(answers)
