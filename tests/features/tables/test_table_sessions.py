"""Sessions that a machine turns, whole: on a virtual table with a virtual board on it; faults, and the comparison afterwards."""

import json
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from imperfect_tables import AxisErrors, TableErrors
from processes import PATIENCE_S
from table_recordings import Bench, table_toml
from virtual_tables import SimulatedClock

from session.base.errors import FormatError
from session.base.units import DEG
from session.bench.guide import Guide
from session.bench.messages import Kind, Stage
from session.detect.stills import SessionStills
from session.log.config import Protocol
from tinygc import CalibrationError, read_session
from tinygc.closure.prepared import prepare
from tinygc.features.tables.explanation import explain_table
from tinygc.features.tables.feature import explained
from tinygc.features.tables.machines.angles import read_angles
from tinygc.features.tables.machines.description import attitudes, read_description
from tinygc.features.tables.machines.virtual import TableLine, VirtualTable
from tinygc.features.tables.recording import TurnedRecording, require_table_of


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """However busy the machine is: nothing is silent unless a test wants it so."""
    monkeypatch.setattr("session.bench.guided_session.SILENT_S", PATIENCE_S)
    monkeypatch.setattr("session.bench.guided_session.LAST_WORD_S", PATIENCE_S)


def warnings(reported):
    return [change.text for change in reported.changes if change.kind is Kind.WARNING]


def test_a_session_goes_on_behind_a_stop_and_a_fault_and_is_whole(tmp_path):
    """Ctrl-C amid the first move, an emergency stop in the next: at rest, one line, nothing lost; homed and resumed it is whole."""
    bench = Bench(tmp_path, table_toml("middle", "inner"), faults="estop@move3")  # homing is the first
    guide, _ = bench.record(segments=1, interrupted=lambda guide: guide.turning)
    assert guide.accepted == 0
    assert not bench.bench.virtual.mechanics.is_moving()
    before, rounds = (bench.folder / "table.csv").read_text(), []

    def paused(guide):
        rounds.append(guide.stage is Stage.PAUSED)
        return sum(rounds) > 20

    guide, reported = bench.record(segments=1, interrupted=paused)
    assert guide.stage is Stage.PAUSED
    assert not bench.bench.virtual.mechanics.is_moving()
    (line,) = [text for text in warnings(reported) if "opened again" not in text]
    assert "p goes on" in line
    assert "press its own emergency stop" not in line  # which is for what no program can stop
    bench.repair()
    guide, reported = bench.record(segments=1)
    assert (guide.stage, guide.accepted, guide.rejected) == (Stage.DONE, 1, 0)
    assert set(warnings(reported)) == {"the port was opened again: a new log begins"}
    assert (bench.folder / "table.csv").read_text().startswith(before)
    session = read_session(bench.folder)
    angles = read_angles(bench.folder / "table.csv", bench.description)
    assert set(angles) == {log.path.name for log in session.logs}
    assert sum(len(log.samples) for log in session.logs) <= bench.bench.sent
    for log in session.logs:  # nothing is missing within a log
        assert log.samples.dt_s.max() < 1.5 * log.samples.period_s
    stills = [still for log in session.logs for still in SessionStills(session).of(log).stills]
    up = np.array([still.accel_mean / np.linalg.norm(still.accel_mean) for still in stills])
    roll, pitch, _ = session.attitudes.T
    dials = np.column_stack([np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])
    assert np.abs(dials - up).max() < 2e-3
    last = angles[session.logs[-1].path.name]
    at_rest = attitudes(bench.description, last.angles[~last.moving])
    assert np.abs(-at_rest[:, 2][-1] - up[-1]).max() < 2e-3


def test_a_table_whose_board_falls_silent_stops(tmp_path):
    bench, moved = Bench(tmp_path, table_toml("inner", fastest=8.0)), []

    def each(guide, mover):
        bench.bench.silent |= guide.turning and guide.turn.path_rad > 0.1
        if bench.bench.silent:
            moved.append(bench.bench.virtual.mechanics.is_moving())

    _, reported = bench.record(segments=1, each=each, interrupted=lambda guide: len(moved) == 50)
    assert any("no samples for 2 s while the table moves" in text for text in warnings(reported))
    assert moved[0]
    assert not any(moved[35:])  # 2 s, and the time to brake


@pytest.mark.broad
def test_the_closure_run_goes_through_attitudes_and_back_onto_its_mark(tmp_path):
    bench = Bench(tmp_path, table_toml("middle", "inner"))
    guide, reported = bench.record(segments=1, closure_s=20.0)
    assert guide.stage is Stage.DONE
    assert not warnings(reported)
    assert [text for text in reported.texts if text.startswith("closure run: ")]
    session = read_session(bench.folder)
    assert [log.path.name for log in session.closures] == ["closure0001.csv"]
    angles = read_angles(bench.folder / "table.csv", bench.description)
    assert sorted(angles) == ["closure0001.csv", "log0001.csv"]
    run = attitudes(bench.description, angles["closure0001.csv"].angles)
    assert np.abs(run[0] - run[-1]).max() < 1e-6
    assert np.ptp(angles["closure0001.csv"].angles, axis=0).min() > 90 * DEG


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
        with pytest.raises(CalibrationError, match="in no plan that was confirmed"):
            mover.driver.table.turn_to(0, 1.0, 1.0)
        mover.close()
    machine.close()
    assert [track.state(bench.bench.clock.now_s())[0] for track in bench.bench.virtual.tracks] == [0.0, 0.0]


@pytest.mark.broad
def test_a_description_that_was_corrected_goes_on_with_its_session(tmp_path):
    """The comparison reports that direction or mounting is wrong: whoever mends them goes on, and all attitudes are of the new ones."""
    right = table_toml("middle", "inner")
    bench = Bench(tmp_path, right)
    wrong = right.replace("direction = [0, 1, 0]", "direction = [0, -1, 0]").replace("direction = [1, 0, 0]", "direction = [-1, 0, 0]")
    bench.file.write_text(wrong)
    _, reported = bench.record(segments=4, interrupted=lambda guide: guide.accepted == 3)
    assert any("the other way round: the sign of the axis, or the mounting, is wrong" in text for text in reported.texts)
    bench.file.write_text(right)
    assert "takes its place" in require_table_of(bench.file, bench.folder)
    guide, reported = bench.record(segments=4)
    assert guide.accepted == 4
    assert not any("the other way round" in text for text in reported.texts)
    assert (bench.folder / "table.toml").read_text() == right
    assert [path.read_text() for path in bench.folder.glob("table.toml.*")] == [wrong]


# Its own errors, from its files.


@pytest.fixture(scope="module")
def tilted(tmp_path_factory):
    """Of a table whose axis leans by 0.2 degrees."""
    wrong = TableErrors((AxisErrors(), AxisErrors()), np.array([0.2, 0, 0]) * DEG)
    bench = Bench(tmp_path_factory.mktemp("tilted"), table_toml("middle", "inner"), errors=wrong)
    bench.record(segments=7)
    return bench.folder


@pytest.mark.broad
def test_explain_names_what_a_session_shows_of_its_table(tilted):
    found = explain_table(prepare(tilted).problem)
    (tilt,) = found.selected.named
    assert tilt.candidate.id == "table.tilt"
    assert tilt.theta / DEG == pytest.approx([0.2, 0], abs=0.03)
    shown = found.to_json()["table"]
    json.dumps(shown, allow_nan=False)
    assert [each["id"] for each in shown["effects"]] == ["table.tilt"]
    assert all(each["detection_limit"] > 0 for each in shown["undecided"])


@pytest.mark.broad
def test_too_few_angles_are_undecided_and_a_broken_file_is_one_line(tilted, tmp_path):
    folder = shutil.copytree(tilted, tmp_path / "session")
    problem, path = prepare(folder).problem, folder / "table.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:40]) + "\n")
    found = explain_table(problem)
    assert found.verdict == found.to_json()["table"]["verdict"] == "undecided"
    assert "table.csv has angles for" in found.why_not
    path.write_text("\n".join([lines[0], "log0001.csv,what,,0,0,0"]) + "\n")
    with pytest.raises(FormatError, match=r"table\.csv line 2"):
        explain_table(problem)
    explanation = SimpleNamespace(session=problem.session, problem=problem, warnings=[])
    assert explained(explanation, 0) is None
    (warning,) = explanation.warnings
    assert (warning.level, warning.what) == ("warning", "table")
    assert warning.description.startswith("table.csv line 2")
    path.unlink()
    assert explained(explanation, 0) is None
    assert len(explanation.warnings) == 1


# The port of a virtual table.


def test_each_opening_of_the_port_restarts_a_controller_that_resets(tmp_path):
    (tmp_path / "table.toml").write_text(table_toml("outer"))
    table = VirtualTable(read_description(tmp_path / "table.toml"), SimulatedClock())
    terminal = SimpleNamespace(has_reader=False, read=lambda: b"", write=lambda text: True)
    counts = []
    for resets in (False, True):
        line = TableLine(table, terminal, resets)
        for terminal.has_reader in (False, True, True, False, True):
            line.answer()
        counts.append(table.mechanics.restarts)
    assert counts == [0, 2]
