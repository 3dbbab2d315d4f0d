"""``record --closure`` end to end on a virtual board: a pulled cable, Ctrl-C, and nothing is lost."""

import json
import signal
from dataclasses import replace

import pytest
from processes import CALIBRATE, PIPE, calibrate, heard, started
from recording_wires import virtual_boards

from tinygc import SimulationOptions, read_session
from tinygc.simulation.simulator import plan_of, simulate_session
from tinygc.simulation.virtual_board import onto_the_mark
from tinygc.simulation.write import config_text, write_files

PLANNED = ("--closure", 15)


@pytest.fixture
def boards(tmp_path):
    with virtual_boards(tmp_path) as start:
        yield lambda name, *words: start(*words, "--speed", 8, name=name)


def recorded_twice(tmp_path):
    """Folders for a board to stream: three turns and a closure run begun on the mark; and such a run alone."""
    options = SimulationOptions(segments=3, closure_s=24.0, odr_hz=104)
    simulation = simulate_session(options, plan=onto_the_mark(options, plan_of(options)))
    write_files(simulation, tmp_path / "session", config_text(simulation, concealed=False))
    write_files(replace(simulation, log=simulation.closure, closure=None), tmp_path / "run", config_text(simulation, concealed=False))
    return tmp_path / "session", tmp_path / "run"


@pytest.mark.broad
def test_a_cable_pulled_in_the_run_and_ctrl_c_after_it_lose_nothing(boards, tmp_path):
    """The cable is pulled every 34 s of device time, which is in the run: no broken run bears its name; resumed, it asks for the run."""
    session, run = recorded_twice(tmp_path)
    folder, port = tmp_path / "s", boards("a", session, "--faults", "unplug=34")
    words = ["record", "--out", folder, "--like", session, "--segments", 3, *PLANNED]
    with started([*CALIBRATE, *words, "--port", port], text=True, stderr=PIPE) as process:
        heard(process.stderr, lambda line: "now the closure run" in line)
        heard(process.stderr, lambda line: "a new log begins" in line)
        process.send_signal(signal.SIGINT)
        _, seen = process.communicate()
    assert process.returncode == 130, seen
    assert f"--resume --out {folder} --port {port} --segments 3 --closure 15" in seen
    assert not list(folder.glob("closure*"))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert read_session(folder).closures == ()  # what is there can be read
    result = calibrate(*words, "--port", boards("b", run, "--lead", 12), "--resume", "--json", "-")
    assert result.returncode == 0, result.stderr
    assert "resumed: 3 segments so far" in result.stderr
    told = json.loads(result.stdout)
    assert told["segments"]["accepted"] == 3
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert all(after[name].startswith(data) for name, data in before.items())
    (closure,) = read_session(folder).closures
    assert closure.samples.duration_s > 20
    assert calibrate("import", folder / "raw.bin", "--out", tmp_path / "again").returncode == 0
    assert {path.name for path in (tmp_path / "again").glob("*.csv")} == {name for name in after if name.endswith(".csv")}
    again = calibrate(*words, "--port", boards("c", run), "--resume", "--json", "-")  # all of it is there
    assert json.loads(again.stdout)["done"]
    assert "resumed:" not in again.stderr  # nothing is asked for any more
