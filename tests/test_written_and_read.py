"""Every file that a command writes is accepted by every command that reads it: a table of writers and readers, on small sessions."""

from __future__ import annotations

import json
import shutil
import threading
from pathlib import Path

import pytest
from recording_wires import MEMORY

import calibrate
import tinygc
from session.bench.events import Info
from session.bench.session_file import SessionFile
from session.io.config import read_config
from tinygc import SimulationOptions, read_session
from tinygc.deploy.exports import FORMATS
from tinygc.simulation.terminal import Terminal
from tinygc.simulation.virtual_board import HostClock, VirtualBoard, recorded, simulated

pytestmark = pytest.mark.slow
SIMULATE = ("--segments", 16, "--closure", 20, "--odr-hz", 62.5, "--seed", 5)
QUICK = ("--methods", "least_squares", "--folds", 2)


def done(*words, codes=(0,)) -> None:
    """The command accepts it, without a word."""
    assert calibrate.main([*map(str, words), "--quiet"]) in codes


class Hurry(HostClock):
    """Simulated time, for a wire that nobody reads meanwhile."""

    seconds = 0.0

    def now_s(self) -> float:
        return self.seconds

    def sleep(self, seconds: float) -> None:
        self.seconds += seconds


class File:
    """What a board sends, in a file."""

    has_reader, dropped = True, 0

    def __init__(self, path: Path):
        self._file = path.open("ab")

    def write(self, data: bytes) -> bool:
        self._file.write(data)
        return True


def raw_bytes(folder: Path, **form) -> Path:
    """What a port gave of a virtual board."""
    folder.mkdir()
    file = File(folder / "raw.bin")
    source = simulated(SimulationOptions(segments=16, closure_s=0.0, odr_hz=62.5, seed=5), calibrated=False)
    VirtualBoard(source, file, speed=50.0, lead_s=2.0, tail_s=1.0, clock=Hurry(), **form).run()
    file._file.close()
    return folder / "raw.bin"


def record(folder: Path) -> Path:
    """A guided recording of a virtual board, with a note and a closure run."""
    source = simulated(SimulationOptions(segments=14, closure_s=24.0, odr_hz=104, seed=6))
    (folder.parent / "like.toml").write_text(source.config, encoding="utf-8")
    with Terminal(folder.parent / "port", MEMORY) as terminal:
        board = VirtualBoard(source, terminal, frames=True, speed=40.0, lead_s=3.0)
        threading.Thread(target=board.run, daemon=True).start()
        words = ("--segments", 14, "--closure", 15, "--no-coach", "--note", "operator=Mara", "--json", folder.parent / "record.json")
        done("record", "--port", terminal.name, "--out", folder, "--like", folder.parent / "like.toml", *words)
        board.tail_s = None
    return folder


@pytest.fixture(scope="module")
def at(tmp_path_factory):
    """A folder with a session of each writer, fitted; logs, models, results."""
    home = tmp_path_factory.mktemp("written")
    one = home / "simulate"
    done("simulate", "--out", one, *SIMULATE, "--stop-sigma-deg", 0.05)
    record(home / "record")
    done("import", home / "record" / "raw.bin", "--out", home / "replay of frames")
    for name, form in (("text", {}), ("units", {"physical": True})):
        raw = raw_bytes(home / f"raw {name}", **form)
        done("import", raw, "--out", home / f"replay of {name}", "--gyro-fs", 500, "--accel-fs", 4)
    done("import", one / "log0001.csv.gz", "--out", home / "replay of a log")
    done("import", one / "closure0001.csv.gz", "--out", home / "replay of a log", "--add", "closure")
    done("import", one / "log0001.csv.gz", "--out", home / "replay of two", "--serial", 'gyro "7" №\\')
    done("simulate", "--out", home / "another", *SIMULATE, "--seed", 7, "--unit-seed", 5)
    done("import", home / "another" / "log0001.csv.gz", "--out", home / "replay of two", "--add", "log")
    done("accelerometer", home / "record", "--out", home / "accelerometer")
    rest = ("--rest-cycles", 1, "--rest-cycle-s", 600, "--rest-cold-c", 10, "--rest-warm-c", 45, "--odr-hz", 62.5, "--seed", 5)
    done("simulate", "--out", home / "rest", *rest)
    models = "least_squares,tinygc,tinygc_denoised"
    done("fit", one, "--methods", models, "--folds", 2, "--physics", "gyro.thermal_bias", codes=(0, 1))
    done("fit", one, "--model", one / "fit" / "model_least_squares.json", "--bias", "start", codes=(0, 1))
    done("fit", home / "rest")
    for word in ("rps", "dps"):
        done("apply", one / "fit" / "model_least_squares.json", one / "log0001.csv.gz", "-o", home / f"{word}.csv.gz", "--unit", word)
        done("import", home / f"{word}.csv.gz", "--out", home / f"calibrated {word}", "--gyro-fs", 500, "--accel-fs", 4)
    done("explain", one, "--no-pictures", "--json", home / "explain.json")
    done("report", one, *QUICK, "--json", home / "report.json", codes=(0, 1))
    for name in FORMATS:
        done("export", one, "--to", name, "--out", home / name)
    return home


SESSIONS = [
    "simulate",
    "record",
    "replay of frames",
    "replay of text",
    "replay of units",
    "replay of a log",
    "replay of two",
    "accelerometer",
    "calibrated rps",
    "calibrated dps",
]


def like(folder: Path, new: Path) -> None:
    """``record --like``, and ``--resume`` of what that wrote."""
    physical = read_config(folder / "session.toml").sensor.profile is None  # whose registers nobody knows
    config = SessionFile(new, folder, None, None, None).configure(Info(500.0, 4.0, 104.3, "7"), 5.0, physical)
    assert SessionFile(new, None, None, None, None).configure(Info(500.0, 4.0, 104.3, "7")).sensor == config.sensor
    assert calibrate.main(["check", str(new), "--quiet"]) == 2  # no logs yet


READERS = {
    "check": lambda folder, new: done("check", folder, "--json", new.with_suffix(".json")),
    "fit": lambda folder, new: done("fit", folder, *QUICK, "--out", new, codes=(0, 1)),
    "accelerometer": lambda folder, new: done("accelerometer", folder, "--out", new),
    "plan": lambda folder, new: done("plan", folder, "--json", new.with_suffix(".json")),
    "replay": lambda folder, new: done("import", sorted(folder.glob("log*"))[0], "--out", new, "--gyro-fs", 500, "--accel-fs", 4),
    "record --like": like,
    "read_session": lambda folder, new: tinygc.check(read_session(folder)),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("writer", SESSIONS)
def test_a_session_is_read(writer, reader, at, tmp_path, capsys):
    READERS[reader](at / writer, tmp_path / "new")
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("writer", ["simulate", "record", "replay of text", "replay of a log", "accelerometer"])
def test_a_session_streams(writer, at):
    """``board``, of any session whose registers are known."""
    assert len(recorded(at / writer).rows) > 1000


@pytest.mark.parametrize("writer", ["record", "replay of frames", "replay of units", "accelerometer"])
def test_a_session_is_compared_exported_and_reported(writer, at, tmp_path):
    """From what ``fit`` has left beside it."""
    one = tmp_path / "s"
    shutil.copytree(at / writer, one)
    done("fit", one, *QUICK, codes=(0, 1))
    done("fit", at / "simulate", *QUICK, "--out", tmp_path / "other", codes=(0, 1))
    done("compare", one, at / "simulate", "--json", tmp_path / "c.json")
    done("export", one, "--to", "json", "--out", tmp_path / "json", "--anyway")
    done("report", one, *QUICK, "--no-explain", codes=(0, 1))


MODELS = {
    **{f"fit: {name}": f"simulate/fit/model_{name}.json" for name in ("least_squares", "tinygc", "tinygc_denoised")},
    "fit: physics": "simulate/fit/model_physics.json",
    "fit --model": "simulate/fit/model_rebiased.json",
    "fit of rests": "rest/fit/model_thermal.json",
    "export": "json/simulate.json",
}


@pytest.mark.parametrize("model", MODELS)
def test_a_model_is_loaded_applied_and_exported(model, at, tmp_path):
    path = at / MODELS[model]
    tinygc.load(path).save(tmp_path / "saved.json")
    tinygc.load(tmp_path / "saved.json")
    done("apply", path, at / "simulate" / "log0001.csv.gz", "-o", tmp_path / "out.csv")
    done("export", at / "simulate", "--to", "json", "--model", path, "--out", tmp_path / "json", "--anyway")
    (exported,) = (tmp_path / "json").iterdir()
    done("apply", exported, at / "simulate" / "log0001.csv.gz", "-o", tmp_path / "again.csv")
    rows = [[line for line in (tmp_path / name).read_text().splitlines() if line[0] != "#"] for name in ("out.csv", "again.csv")]
    assert rows[0] == rows[1]


@pytest.mark.parametrize("model", ["fit: least_squares", "fit: tinygc", "fit --model", "export"])
def test_a_model_gets_a_bias_of_the_day(model, at, tmp_path):
    done("fit", at / "record", "--model", at / MODELS[model], "--bias", "start", "--out", tmp_path / "fit", codes=(0, 1))
    done("apply", tmp_path / "fit" / "model_rebiased.json", at / "record" / "log0001.csv", "-o", tmp_path / "out.csv")


@pytest.mark.slow
def test_what_explain_found_is_planned_recorded_and_reported(at, tmp_path):
    folder = at / "simulate"
    assert json.loads((folder / "explain" / "explain.json").read_text(encoding="utf-8"))["schema"] == "tinygc-explain/2"
    done("plan", folder)
    done("report", folder, *QUICK, "--out", tmp_path / "r.html", codes=(0, 1))
    done("fit", folder, *QUICK, "--physics", "auto", "--out", tmp_path / "fit", codes=(0, 1))


@pytest.mark.slow
def test_rest_logs_are_checked_and_join_a_session(at, tmp_path):
    done("check", at / "rest")
    done("fit", at / "simulate", at / "rest", "--temperature", "--out", tmp_path / "fit")
    done("apply", tmp_path / "fit" / "model_thermal.json", at / "simulate" / "log0001.csv.gz", "-o", tmp_path / "out.csv")


def test_a_turn_that_was_dropped_and_a_note_are_read(at, tmp_path):
    folder = tmp_path / "s"
    shutil.copytree(at / "record", folder)
    file = SessionFile(folder, None, None, None, None, notes={"why": "the table\ncreaks №\x1b"})
    file.configure(None)
    file.exclude("log0001.csv", float(read_session(folder).logs[0].samples.t_s[600]))
    done("check", folder)
    done("fit", folder, *QUICK, codes=(0, 1))
    done("report", folder, *QUICK, "--no-explain", codes=(0, 1))
    done("import", folder / "raw.bin", "--out", tmp_path / "again")
    assert (tmp_path / "again" / "session.toml").read_bytes() == (folder / "session.toml").read_bytes()
