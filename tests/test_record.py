"""``record`` end to end: a virtual board on a pseudo-terminal, the recorder, the files; what it does when things go wrong."""

import json
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from conftest import config
from processes import CALIBRATE, PIPE, calibrate, heard, started
from recording_wires import LEAD_S, virtual_boards

from session.bench.guide import Guide
from session.io.config import Config
from session.io.logfile import Log
from session.io.samples import Samples
from tinygc import FitOptions, Session, SimulationOptions, read_session
from tinygc.cli.recording import faults_of, files_left
from tinygc.closure.build import build_problem
from tinygc.closure.residual import closure_angles
from tinygc.estimation.held_out import run_method
from tinygc.simulation.write import write_session

#: more turns than any test needs, however late the recorder comes
SLOW_SENSOR = ("--rate", 104, "--segments", 120, "--speed", 20)


@pytest.fixture
def board(tmp_path):
    with virtual_boards(tmp_path) as start:
        yield start


def closures(samples: Samples, config: Config) -> tuple[np.ndarray, np.ndarray]:
    """Closure angles (S, 3) of each segment: raw, and calibrated by least squares."""
    problem = build_problem(Session(Path("made"), config, (Log(Path("log0001.csv"), samples, raw=True),), ()))
    return tuple(closure_angles(problem.batch, run_method(name, problem, FitOptions()).model) for name in ("raw", "least_squares"))


@pytest.mark.parametrize(
    ("rate", "form", "segments", "speed"), [(104, [], 7, 20), pytest.param(1667, ["--frames"], 7, 5, marks=pytest.mark.slow)]
)
def test_from_the_board_to_the_fit(board, run, tmp_path, rate, form, segments, speed):
    """Nothing is lost, every turn is accepted, and the session is, sample by sample, the one that can be read from its file."""
    spare = 2  # turns, so that one that is missed fails here and not by waiting for ever
    port = board("--rate", rate, "--segments", segments + spare, "--speed", speed, *form)
    result = calibrate(
        "record", "--port", port, "--out", tmp_path / "s", "--like", tmp_path / "bench.toml", "--segments", segments, "--json", "-"
    )
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["done"]
    assert told["segments"] == {"wanted": segments, "accepted": segments, "rejected": 0, "dropped": 0}
    assert told["lost"] == told["crc_errors"] == told["garbage_bytes"] == told["implausible"] == told["resets"] == 0
    assert "\x1b" not in result.stderr
    live = read_session(tmp_path / "s")
    ((samples,), config) = (log.samples for log in live.logs), live.config
    assert len(samples) == told["samples"]
    assert samples.dt_s.max() < 1.5 * samples.period_s
    options = SimulationOptions(segments=segments + spare, closure_s=0.0, odr_hz=rate)
    (file,) = read_session(write_session(options, tmp_path / "file")).logs
    # Live there are some seconds of stillness more before the first turn, and it ends when the last one has been accepted: that moves the
    # middles of the first and the last still, where their segments begin and end.  In between, all is the same.
    lead = round(LEAD_S * (len(samples) - 1) / samples.duration_s)
    count = min(len(samples) - lead, len(file.samples))
    mine, theirs = samples.between(lead, lead + count), file.samples.between(0, count)
    for name in ("gyro", "accel", "temp_c"):
        assert np.array_equal(getattr(mine, name), getattr(theirs, name))
    assert np.abs((mine.t_ns - mine.t_ns[0]) - (theirs.t_ns - theirs.t_ns[0])).max() <= 1000
    for one, other in zip(closures(mine, config), closures(theirs, config), strict=True):
        assert len(one) == segments
        assert one == pytest.approx(other, abs=2e-6)  # rad, of 0.06 uncalibrated and 2e-4 calibrated: what 1 us in a stamp does
    code, fit, said = run("fit", tmp_path / "s", "--methods", "raw,least_squares", "--json", "-")
    assert code == 0, said
    assert json.loads(fit)["segments"]["used"] == segments


def test_the_closing_lines_name_rows_of_files_and_every_fault(tmp_path):
    for name in ("raw.bin", *(f"log{number:04d}.csv" for number in range(1, 8)), "closure0001.csv", "log0003.csv.changed1", "notes.txt"):
        (tmp_path / name).touch()
    assert (
        files_left(tmp_path) == "closure0001.csv, log0001.csv, log0002.csv, log0003.csv, log0003.csv.changed1, "
        "log0004.csv to log0007.csv (4 files), raw.bin"
    )
    guide = Guide(config().protocol)
    assert faults_of(guide) == ""
    guide.health.troubles["lost"], guide.board_faults = 3, {"hang": 2}
    assert faults_of(guide) == "3 lost, the board counted hang 2×"


def test_ctrl_c_keeps_everything_and_resume_goes_on(board, run, tmp_path):
    port = board(*SLOW_SENSOR)
    words = ["record", "--port", port, "--out", tmp_path / "s", "--like", tmp_path / "bench.toml", "--segments", 4]
    with started([*CALIBRATE, *words], text=True, stderr=PIPE, stdout=PIPE) as process:
        heard(process.stderr, lambda line: "turn 2 accepted" in line)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate()
    assert process.returncode == 130
    assert re.search(r"everything received is kept. To go on:\n  python \S*calibrate\.py record --resume --out", stderr)
    assert "Traceback" not in stderr
    (accepted,) = re.findall(r"(\d) of 4 segments", stdout)
    before = (tmp_path / "s" / "raw.bin").read_bytes()
    own = (tmp_path / "s" / "session.toml").read_bytes()
    log = (tmp_path / "s" / "log0001.csv").read_bytes()

    code, _, said = run(*words)
    assert code == 2
    assert "holds a recording; --resume goes on with it" in said

    code, told, said = run(*words, "--resume", "--json", "-")
    assert code == 0, said
    assert json.loads(told)["segments"]["accepted"] == 4
    (resumed,) = re.findall(r"resumed: (\d) segments so far", said)
    assert int(accepted) <= int(resumed) <= int(accepted) + 1  # what came while it stopped may have completed one
    assert (tmp_path / "s" / "raw.bin").read_bytes().startswith(before)
    assert (tmp_path / "s" / "session.toml").read_bytes() == own
    assert (tmp_path / "s" / "log0001.csv").read_bytes() == log


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["--resume", "--out", "{new}"], 2, "no recording to resume"),
        (["--out", "{log}"], 2, "holds log0001.csv; give another --out"),
        (["--out", "{new}", "--like", "{new}/none.toml"], 2, "not found"),
        (["--out", "{new}"], 3, "cannot be opened"),
        (["--out", "{file}"], 2, "file"),
    ],
)
def test_what_cannot_be_is_one_line(run, tmp_path, words, code, says):
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "log0001.csv").write_text("t_us,gx,gy,gz,ax,ay,az,temp\n")
    (tmp_path / "file").write_text("")
    places = {name: tmp_path / name for name in ("new", "log", "file")}
    ended, _, said = run("record", "--port", tmp_path / "no-port", *(word.format(**places) for word in words))
    assert ended == code
    assert says in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "new").exists()
