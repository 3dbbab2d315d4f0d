"""Sessions of a table as files: simulated sample by sample, observed, explained, and refused in one line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from formats_page import strangers
from table_simulation import LostSteps, fixed_moves, simulate_on_table

import tinygc
from session.annexes.machines.angles import AngleLog, on_its_clock, read_angles
from session.annexes.machines.description import Axis, Description, read_description
from session.annexes.machines.kinematics import attitudes, roll_pitch_yaw
from session.annexes.machines.mechanics import AxisErrors, TableErrors
from session.io.errors import FormatError
from session.io.results import json_text
from session.io.units import DEG, NS
from tinygc.annexes.machines.explanation import explain_table
from tinygc.annexes.machines.observed import observe
from tinygc.closure.prepared import prepare
from tinygc.reporting.terminal import as_text
from tinygc.simulation.options import SimulationOptions

_, Y, Z = np.eye(3)
OPTIONS = SimulationOptions(seed=2, closure_s=0.0, still_s=1.2, odr_hz=104, with_heading=True)


def table():
    axes = (Axis(n, d, -np.pi, np.pi, 200 * DEG, 400 * DEG, 0.01 * DEG, 0.0, n) for n, d in zip("ab", (Z, Y), strict=True))
    return Description("bench", "virtual", tuple(axes))


def written(folder, wrong=None, moves=12, **more):
    of = table()
    return simulate_on_table(of, fixed_moves(of, moves, 90 * DEG, 2), OPTIONS, wrong, **more).save(folder)


@pytest.fixture(scope="module")
def tilted(tmp_path_factory):
    wrong = TableErrors((AxisErrors(), AxisErrors(backlash=0.1 * DEG)), np.array([0.2, -0.1, 0]) * DEG, 0.03)
    return written(tmp_path_factory.mktemp("tilted") / "session", wrong)


def test_a_session_says_of_its_rests_what_its_table_says(tilted):
    problem, of = prepare(tilted).problem, read_description(tilted / "table.toml")
    seen = observe(problem, of, read_angles(tilted / "table.csv", of))
    assert (len(seen.said), len(seen.first)) == (13, 12)
    goals = np.array([move.angles_rad for move in fixed_moves(table(), 12, 90 * DEG, 2)])
    assert seen.said[1:] == pytest.approx(goals, abs=1e-7)
    assert problem.session.attitudes == pytest.approx(roll_pitch_yaw(attitudes(of, seen.said)), abs=1e-8)
    down = attitudes(of, seen.said)[:, 2]
    assert np.abs(seen.force + down).max() < 0.01  # the tilt of 0.2 degrees, and noise
    turned = np.linalg.norm((seen.rates * seen.block_s[:, None, None]).sum(axis=1), axis=1)
    assert turned == pytest.approx(np.abs(seen.turned).sum(axis=1), abs=0.15)  # scale and zero of an uncalibrated gyroscope


@pytest.mark.broad
def test_what_it_says_and_what_explain_says(tilted):
    found = explain_table(prepare(tilted).problem)
    assert found.verdict in ("table", "both", "ambiguous")
    ids = [each.candidate.id for each in found.selected.named]
    assert {"table.tilt", "table.backlash"} <= set(ids)
    tilt = next(each for each in found.selected.named if each.candidate.id == "table.tilt")
    assert tilt.theta / DEG == pytest.approx([0.2, -0.1], abs=0.02)
    page = as_text(found.page())
    assert "table bench: " in page
    assert "table.tilt" in page
    assert "not seen, and would be from" in page
    shown = found.to_json()
    json.dumps(shown, allow_nan=False)
    assert {each["id"] for each in shown["effects"]} == set(ids)
    assert all(each["detection_limit"] > 0 for each in shown["undecided"])
    assert shown["latency_ms"] == pytest.approx(30, abs=12)  # less the sensor's filter and half a sample


def test_a_folder_without_a_machine_has_no_such_section(tilted, tmp_path):
    assert explain_table(prepare(tinygc.simulate(segments=8, closure_s=0.0, odr_hz=104.0, seed=1).session).problem) is None
    folder = written(tmp_path / "by_hand", moves=8)
    (folder / "table.csv").unlink()
    assert explain_table(prepare(folder).problem) is None


def test_too_few_angles_are_undecided_and_a_broken_file_is_one_line(tmp_path):
    folder = written(tmp_path / "session", moves=8)
    problem, path = prepare(folder).problem, folder / "table.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:60]) + "\n")
    found = explain_table(problem)
    assert found.verdict == "undecided"
    assert "table.csv has angles for" in found.why_not
    assert found.why_not in as_text(found.page()).replace("\n", " ")
    assert found.to_json()["verdict"] == "undecided"
    path.write_text("\n".join([lines[0], "log0001.csv.gz,what,,0,0,0"]) + "\n")
    with pytest.raises(FormatError, match=r"table\.csv line 2"):
        explain_table(problem)


def test_a_machines_clock_takes_the_jitter_out_of_its_stamps():
    rng = np.random.default_rng(3)
    table_s = 100 + np.arange(200) * 0.02
    late = rng.uniform(0, 0.01, 200)
    word = AngleLog(
        "log", np.rint((np.arange(200) * 0.02 * 1.001 - late + 1) / NS).astype(np.int64), table_s, table_s > 0, np.zeros((200, 1))
    )
    mended = on_its_clock(word)
    left = mended.t_ns * NS - (np.arange(200) * 0.02 * 1.001 + 1)
    assert np.std(left) < 0.2 * np.std(late)
    assert np.mean(left) == pytest.approx(-np.mean(late), abs=1e-6)
    without = replace(word, table_s=np.full(200, np.nan))
    assert on_its_clock(without) is without


@pytest.mark.broad
def test_explain_prints_it_and_keeps_it(tilted):
    why = tinygc.explain(tilted)
    assert why.turned_by.verdict == why.table["table"]["verdict"]
    assert "table bench: " in why.summary()
    assert strangers(json.loads(json_text(why.table))) == []


@pytest.mark.broad
def test_lost_steps_of_a_whole_recording(tmp_path):
    folder = written(tmp_path / "session", lost=(LostSteps(7, 1, 0.5 * DEG),), moves=16)
    (found,) = explain_table(prepare(folder).problem).selected.named
    assert (found.candidate.id, found.candidate.where, found.equivalent) == ("table.lost_steps", "turn 7", ())
    assert abs(found.theta[0]) == pytest.approx(0.5 * DEG, abs=0.05 * DEG)


def test_dials_are_as_good_as_session_toml_says(tilted, tmp_path):
    floors = []
    for sigma_deg in (0.05, 0.5):
        folder = tmp_path / f"dials{sigma_deg}"
        folder.mkdir()
        for path in tilted.iterdir():
            (folder / path.name).write_bytes(path.read_bytes())
        text = (folder / "session.toml").read_text().replace('reference = "gravity"', f'reference = "table"\ndial_sigma_deg = {sigma_deg}')
        (folder / "session.toml").write_text(text)
        problem = prepare(folder).problem
        assert problem.session.config.protocol.dial_sigma_deg == sigma_deg
        floors.append(problem.floor.own[0][2, 2])
        again = problem.session.save(tmp_path / f"again{sigma_deg}")
        assert ("dial_sigma_deg" in (again / "session.toml").read_text()) == (sigma_deg != 0.05)  # the default needs no line
    assert floors[1] - floors[0] == pytest.approx(2 * ((0.5 * DEG) ** 2 - (0.05 * DEG) ** 2), rel=1e-6)  # a turn has two dials
