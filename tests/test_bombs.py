"""Files that exhaust whoever reads them without bounds: one line, at once, within a fraction of the memory that they ask for.

The readers themselves take all of ``bombs.py``, in one process whose peak the kernel tells, and every command takes those that would make
it wait.
"""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from conftest import broad
from processes import PATIENCE_S, PIPE, refused, started

from session.base import files
from session.base.errors import CalibrationError, FormatError
from session.base.files import open_file, read_bytes
from session.replay.options import Answers
from session.replay.tables import TableReader
from tinygc.cli.commands import commands

ROOT = Path(__file__).resolve().parent.parent

if os.name != "posix":
    pytest.skip("devices, named pipes and sockets as files are POSIX's", allow_module_level=True)
from bombs import BOMBS, readers_of  # noqa: E402

#: of a process that has NumPy; a bomb of JSON within its bound takes the most
MOST_MB, MOST_CPU_S = 1000, 20
#: of a clock, on however busy a machine: only what waits for ever takes as long
WAITS_S = 300
#: reads every bomb of a folder with what reads that kind of file, and says what became of it
CHILD = r"""
import json, re, signal, sys, time
from pathlib import Path
from session.base.errors import CalibrationError
from session.replay.options import Answers
from session.replay.tables import TableReader
from session.base.results import read_json
from session.log.folder import read_session
from session.replay.raw import convert_raw

def as_foreign(path):
    for piece in TableReader(path, Answers(gyro_fs_dps=500, accel_fs_g=4)).pieces():
        pass

def read(folder, path):
    if path.suffix == ".json":
        read_json(path)
    elif path.suffix == ".bin":
        convert_raw(path, folder / "out", Answers(odr_hz=208.0, gyro_fs_dps=500.0, accel_fs_g=4.0))
    else:
        if path.name.startswith("log"):
            try:
                as_foreign(path)
            except CalibrationError:
                pass
        read_session(folder)

def on_alarm(*_):
    raise TimeoutError

signal.signal(signal.SIGALRM, on_alarm)
for line in sys.stdin:
    number, folder, path = json.loads(line)
    try:
        open("/proc/self/clear_refs", "w").write("5")
    except OSError:
        pass  # then the peak is that of all so far
    began = time.process_time()
    try:
        signal.alarm(int(sys.argv[1]))
        read(Path(folder), Path(path))
        said = "accepted"
    except CalibrationError as error:
        said = f"refused: {error}"
    except BaseException as error:
        said = f"fell: {error!r}"
    signal.alarm(0)
    peak_mb = int(re.search(r"VmHWM:\s+([0-9]+)", open("/proc/self/status").read())[1]) / 1024
    print(json.dumps([number, said, peak_mb, time.process_time() - began]), flush=True)
"""
#: what is no bomb to the reader alone, but to who comes behind it, or is accepted as it should be
HARMLESS = {
    "comment of 60 000 letters",
    "header of 60 000 brackets",
    "9 999 turns",
}


def linear_model(folder):
    path = folder / "good.json"
    weights = {"E": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "B": [0, 0, 0]}
    path.write_text(json.dumps({"schema": "tinygc-model/1", "kind": "linear", "weights": weights}))
    return path


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux tells a process's peak")
def test_each_bomb_is_refused_in_one_line_within_a_gigabyte(tmp_path):
    """In one process, whose peak the kernel tells."""
    whole = shutil.copytree(ROOT / "data" / "session1", tmp_path / "whole", copy_function=shutil.copyfile)
    (whole / "closure0001.csv.gz").unlink()
    wrong = {}
    with started([sys.executable, "-c", CHILD, str(WAITS_S)], limit_s=4 * PATIENCE_S, stdin=PIPE, stdout=PIPE, text=True) as child:
        for number, bomb in enumerate(BOMBS):
            folder = shutil.copytree(whole, tmp_path / str(number), copy_function=os.link)
            path = bomb.put(folder)
            child.stdin.write(json.dumps([number, str(folder), str(path)]) + "\n")
            child.stdin.flush()
            told = child.stdout.readline()
            assert told, f"{bomb.place}: {bomb.name} ended the process"
            _, said, peak_mb, cpu_s = json.loads(told)
            refused_ = said.startswith(("refused: ", "accepted") if bomb.name in HARMLESS else "refused: ")
            if not refused_ or "\n" in said or peak_mb > MOST_MB or cpu_s > MOST_CPU_S:
                wrong[bomb.place, bomb.name] = said, peak_mb, cpu_s
            shutil.rmtree(folder)
        child.stdin.close()
    assert wrong == {}


@pytest.fixture
def impatient():
    """A test that waits for a pipe ends."""

    def on_alarm(*_):
        raise TimeoutError("it waits")

    before = signal.signal(signal.SIGALRM, on_alarm)
    signal.alarm(WAITS_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


PIPES = [bomb for bomb in BOMBS if bomb.name == "named pipe"]


@pytest.mark.parametrize("bomb", [(pytest.param if bomb.place == "log0001.csv" else broad)(bomb, id=bomb.place) for bomb in PIPES])
def test_no_command_waits_for_what_is_no_file(bomb, folder, tmp_path, run, impatient):
    """Every command that reads such a file, as ``bombs.py`` lists them."""
    model = linear_model(tmp_path)
    log = shutil.copyfile(folder / "log0001.csv", tmp_path / "log.csv")
    path = bomb.put(folder)
    for number, line in enumerate(line for line in readers_of(bomb) if line.split()[0] in commands()):
        words = line.format(S=folder, B=path, M=model, L=log, O=tmp_path / f"out{number}").split()
        if words[0] in ("check", "fleet") and "--plan" not in words:  # whose table says it
            code, out, _ = run(*words)
            assert code == (2 if words[0] == "check" else 0)  # for a list and a fleet it is one row of many
            assert "cannot be read" in " ".join(out.split())
        else:
            refused(run(*words, "--quiet"), "cannot be read")


@pytest.mark.parametrize("name", ["log0002.csv", "turns.csv"])
def test_nothing_is_read_before_a_named_pipe_is_refused(name, folder, run, impatient):
    """The error is the only line, though the first log is sound: no progress of a work that cannot be done."""
    os.mkfifo(folder / name)
    for command in ("fit", "explain"):
        code, out, err = run(command, folder)
        expected = f"calibrate: {folder / name}: cannot be read (it is a named pipe, expected a file)\n"
        assert (code, out, err) == (2, "", expected)


@pytest.mark.parametrize("kind", ["fifo", "device"])
def test_a_path_that_becomes_another_between_two_looks_is_noticed(kind, tmp_path, monkeypatch, impatient):
    """What ``stat`` saw need not be what ``open`` opens."""
    path = tmp_path / "log0001.csv"
    os.mkfifo(path) if kind == "fifo" else path.symlink_to("/dev/zero")
    regular = os.stat(__file__)
    monkeypatch.setattr(files.os, "stat", lambda path: regular)
    with pytest.raises(FormatError, match="a named pipe" if kind == "fifo" else "a device"):
        open_file(path)


def test_a_file_that_grows_beyond_its_size_is_not_read_on(tmp_path, monkeypatch):
    path = tmp_path / "session.toml"
    path.write_bytes(b"x" * 5000)
    status = os.stat(path)
    monkeypatch.setattr(files.os, "fstat", lambda _: os.stat_result((status.st_mode, *status[1:6], 0, *status[7:])))
    with pytest.raises(FormatError, match="its bytes do not end"):
        read_bytes(path, 1000)
    assert read_bytes(path, 5000) == b"x" * 5000


@pytest.mark.parametrize("part", ["a: 1 ", "0xA", "[{"])
def test_long_lines_of_any_text_are_seen_through_at_once(part, tmp_path, impatient):
    """A pattern that looks on from each letter of a line of 60 000 would take minutes."""
    line = part * (60_000 // len(part))
    (tmp_path / "log.txt").write_text("\n".join([line] * 20) + "\n")
    with pytest.raises(CalibrationError):
        list(TableReader(tmp_path / "log.txt", Answers()).pieces())
