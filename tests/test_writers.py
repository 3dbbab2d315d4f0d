"""Every file is written in one place: through no link, whole or not at all, whichever call to the system fails."""

import ast
import os
import re
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import SESSION_TOML, Table, session_of, write_session
from failing_calls import FAULTS, Writer, contents, tried
from streams import frame_list, sent

import tinygc
from session.base.errors import CalibrationError
from session.base.files import is_stream
from session.base.records import write_whole
from session.base.results import write_text_whole
from session.bench import rawfile
from session.bench.events import SampleChunk
from session.bench.logwriter import LogWriter
from session.bench.rawfile import RawFile
from session.bench.session_file import SessionFile
from session.detect.accelerometer import write_calibrated_copy
from session.log.config import Accelerometer
from session.log.folder import add_board, add_notes
from tinygc.deploy.apply import opened
from tinygc.reporting.drawing import Panel, Picture, saved
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session as write_simulated

ROOT = Path(__file__).parents[1]
SAMPLES = Table().tumble(4, rest_s=1.5, seed=5).samples(odr_hz=52.0)
TOML = SESSION_TOML.replace("208.0", "52.0")
LOG = "time_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "".join(f"{10_000 * k},{k % 7},0.5,0,0,0,-1\n" for k in range(300))
TOLD = {"gyro_fs_dps": 500, "accel_fs_g": 4}


def written(name, text):
    """What stood there before."""
    return lambda folder: (folder / name).write_text(text)


def applied(name):
    def write(folder):
        with opened(folder / name) as file:
            for _ in range(3):
                file.write(b"1,2,3\n" * 5000)

    return write


def session(folder):
    (folder / "card.csv").write_text(LOG)
    return write_session(folder / "s", SAMPLES, toml=TOML)


def imported(**more):
    return lambda folder: tinygc.import_log(folder / "card.csv", folder / "s", **TOLD, **more)


def ported(folder):
    (folder / "raw.bin").write_bytes(b"".join(frame_list(*sent(300))))
    (folder / "session.toml").write_text(SESSION_TOML)


def configured(folder):
    SessionFile(folder / "s", None, 416.0, 500.0, 4.0).configure(None, 10.0)


def logged(*stems, keep=None):
    def write(folder):
        logs = LogWriter(folder)
        for number, stem in enumerate(stems):
            logs.begin(stem)
            logs.write([SampleChunk(*sent(300, 1_000_000 * (1 + 9 * number)))])
        if keep:
            logs.keep(keep)
        logs.close()

    return write


def raw(count):
    def write(folder):
        file = RawFile(folder)
        for number in range(count):
            file.append(100_000_000 * (1 + number), b"%d" % number * 500)
        file.mark(1_000_000_000, "open port")
        file.close()

    return write


def taken_raw(folder):
    from session.replay.options import Answers
    from session.replay.raw import convert_raw

    return convert_raw(folder / "raw.bin", folder / "s", Answers())


SIMULATED = SimulationOptions(segments=3, closure_s=0.0, odr_hz=62.5)
WRITERS = {
    "a result": Writer(lambda folder: write_whole(folder / "fit.json", {"a": [1.5] * 9}), written("fit.json", "{}\n")),
    "a new text": Writer(lambda folder: write_text_whole(folder / "page.html", "<p>\n" * 9000)),
    "a picture": Writer(lambda folder: saved(Picture([Panel()]), folder / "page.svg"), written("page.svg", "old")),
    "an applied log": Writer(applied("out.csv"), written("out.csv", "old")),
    "a packed log": Writer(applied("out.csv.gz"), written("out.csv.gz", "old")),
    "import": Writer(imported(), written("card.csv", LOG), folder=True),
    "import --add": Writer(imported(add="log"), session, folder=True),
    "import of a port's bytes": Writer(taken_raw, ported, folder=True),
    "fit --accelerometer alone": Writer(
        lambda folder: write_calibrated_copy(folder / "s", folder / "t", Accelerometer(source="file")), session, folder=True
    ),
    "Session.save": Writer(lambda folder: session_of(SAMPLES).save(folder / "s"), folder=True),
    "simulate": Writer(lambda folder: write_simulated(SIMULATED, folder / "s"), folder=True),
    "simulate --force": Writer(
        lambda folder: write_simulated(SIMULATED, folder / "s", force=True),
        lambda folder: write_simulated(replace(SIMULATED, seed=2), folder / "s"),
        folder=True,
    ),
    "a note": Writer(lambda folder: add_notes(folder / "s" / "session.toml", {"by": "Mara"}), session),
    "a board": Writer(lambda folder: add_board(folder / "s" / "session.toml", {"firmware": "1"}, {}), session),
    "session.toml of a recording": Writer(configured),
    "logs of a recording": Writer(logged("log", "log"), grows=True),
    "logs that go on": Writer(logged("log", "log"), logged("log"), grows=True),
    "a closure run that is kept": Writer(logged("log", "unclosed", keep="closure"), logged("log"), grows=True),
    "a port's bytes": Writer(raw(3), grows=True),
    "a port's bytes that go on": Writer(raw(3), raw(2), grows=True),
}


@pytest.fixture(autouse=True)
def no_thread(monkeypatch):
    """The raw file is forced to the disk by a thread, whose calls would be counted at no certain place."""
    idle = SimpleNamespace(start=lambda: None, join=lambda: None)
    monkeypatch.setattr(rawfile, "threading", SimpleNamespace(Lock=threading.Lock, Event=threading.Event, Thread=lambda **_: idle))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")  # the killed close nothing
@pytest.mark.parametrize(("name", "fault"), [(name, FAULTS[number % len(FAULTS)]) for number, name in enumerate(WRITERS)])
def test_whichever_call_fails_the_old_is_whole_or_the_new(tmp_path, name, fault):
    """Of a folder's hundreds of calls some, and of a file's every fifth one."""
    step = 101 if WRITERS[name].folder else 5
    count, wrong = tried(WRITERS[name], tmp_path / "w", fault, lambda number: number % step == 1)
    assert wrong == []
    assert count


# Links, and who writes at all.

LINKED = {
    "a result": ("fit.json", WRITERS["a result"]),
    "a packed log": ("out.csv.gz", Writer(WRITERS["a packed log"].write)),
    "a note": ("s/session.toml", WRITERS["a note"]),
    "session.toml of a recording": ("s/session.toml", WRITERS["session.toml of a recording"]),
    "import --add": ("s/session.toml", WRITERS["import --add"]),
    "raw.bin": ("raw.bin", Writer(raw(1))),
    "raw.times": ("raw.times", Writer(raw(1))),
}
#: what is not there cannot be added to, and what is no session.toml cannot be recorded by
READ_FIRST = (("a note", "nothing"), ("import --add", "nothing"), ("session.toml of a recording", "a file"))


@pytest.mark.parametrize("to", ["a file", "nothing"])
@pytest.mark.parametrize("name", LINKED)
def test_nothing_is_written_through_a_link(tmp_path, name, to):
    target, writer = LINKED[name]
    (tmp_path / "w").mkdir()
    if "/" in target:
        writer.before(tmp_path / "w")
    path, victim = tmp_path / "w" / target, tmp_path / "victim"
    path.parent.mkdir(exist_ok=True)
    if to == "a file":
        victim.write_bytes(path.read_bytes() if path.exists() else b"precious")
    path.unlink(missing_ok=True)
    path.symlink_to(victim)
    before = contents(tmp_path)
    with pytest.raises(CalibrationError) as said:
        writer.write(tmp_path / "w")
    if (name, to) not in READ_FIRST:
        assert re.search(rf"{path.name}: is a link to {victim}, .*remove it", str(said.value))
    assert path.is_symlink()
    assert {each: data for each, data in contents(tmp_path).items() if each in before} == before
    assert [each for each in tmp_path.rglob(".tinygc-*")] == []


def test_a_folder_may_be_a_link_and_so_may_a_device(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_text_whole(tmp_path / "link" / "page.html", "mine")
    assert (tmp_path / "real" / "page.html").read_text() == "mine"
    (tmp_path / "null").symlink_to(os.devnull)
    write_text_whole(tmp_path / "null", "mine")
    assert (tmp_path / "null").is_symlink()


def test_many_who_write_one_file_at_once_do_not_meet(tmp_path):
    path, texts = tmp_path / "page.html", [str(number) * 20_000 for number in range(8)]
    with ThreadPoolExecutor(8) as pool:
        for _ in pool.map(lambda number: write_text_whole(path, texts[number % 8]), range(200)):
            pass
    assert path.read_text() in texts
    assert list(tmp_path.iterdir()) == [path]


def test_the_bytes_are_on_the_disk_before_they_get_their_name(tmp_path, monkeypatch):
    happened = []
    for name in ("fsync", "replace"):
        call = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *args, name=name, call=call: (happened.append(name), call(*args)))
    write_text_whole(tmp_path / "page.html", "mine")
    assert happened == ["fsync", "replace", "fsync"]


@pytest.mark.parametrize("name", ["/dev/stdout"])
def test_a_file_that_a_shell_has_opened_is_added_to(tmp_path, name):
    (tmp_path / "notes").write_text("mine\n")
    code = f"from session.base.results import write_text_whole as w; from pathlib import Path; w(Path({name!r}), 'a page')"
    with (tmp_path / "notes").open("ab") as file:
        subprocess.run([sys.executable, "-c", code], stdout=file, check=True, cwd=ROOT)
    assert (tmp_path / "notes").read_text() == "mine\na page"
    assert subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True, cwd=ROOT).stdout == b"a page"


def test_another_name_of_a_file_is_no_stream(tmp_path, monkeypatch):
    (tmp_path / "notes").write_text("mine")
    monkeypatch.chdir(tmp_path)
    assert not is_stream(Path("/proc/self/cwd/notes"))
    assert not is_stream(Path("/proc/self/fd/../cwd/notes"))
    assert all(map(is_stream, map(Path, ["/dev/null", "/dev/stderr", "/dev/fd/9", f"/proc/{os.getpid()}/fd/0"])))


#: calls that write by a name, whatever they are of
BY_NAME = {"write_text", "write_bytes", "touch", "to_csv", "savetxt", "savez", "tofile", "mkstemp", "mkdtemp", "truncate"}
BY_NAME |= {"copy2", "copyfile", "copytree", "shutil.copy", "shutil.move", "os.replace", "os.rename", "os.link", "os.symlink"}
LASTS = {name.rpartition(".")[2] for name in BY_NAME} | {"open"}
#: a file without such a call need not be parsed: of a text, ``replace`` has two arguments
CANDIDATE = re.compile(rf"\b({'|'.join(LASTS - {'replace'})})\(|\.replace\((?![^,\n()]*,)")
#: who gives a recording's own file another name, moves within a folder that is being made, makes one of a new name, or cuts off a half line
ELSEWHERE = {
    "tinygc/features/tables/machines/angles.py": {"os.truncate"},
    "session/bench/logwriter.py": {"rename"},
    "session/bench/rawfile.py": {"rename", "tempfile.mkdtemp"},
    "session/replay/convert.py": {"rename"},
    "session/detect/repair.py": {"rename"},
}


def written_by(call):
    """The call's name, if it makes or changes a file by its name; not the null device, nor what is open."""
    last = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if last not in LASTS or re.search(r"os\.devnull|fileno", whole := ast.unparse(call)):
        return set()
    name = ast.unparse(call.func)
    if {name, last} & BY_NAME or (name == "os.open" and re.search("O_WRONLY|O_RDWR|O_CREAT", whole)):
        return {name}
    if last == "open":
        words = [ast.unparse(each) for each in (*call.args, *(key.value for key in call.keywords))]
        return {last} if name != "gzip.open" and any(re.fullmatch("'[rbt+]*[wax+][rwaxbt+]*'", word) for word in words) else set()
    return {last} if last in ("rename", "replace") and len(call.args) == 1 and not call.keywords else set()


def test_files_are_written_in_one_place():
    """A new writer goes through ``session.base.files``, which follows no link and loses nothing."""
    found = {}
    for path in (*ROOT.glob("session/**/*.py"), *ROOT.glob("tinygc/**/*.py"), ROOT / "calibrate.py"):
        where, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        if where != "session/base/files.py" and CANDIDATE.search(text):
            calls = [each for each in ast.walk(ast.parse(text)) if isinstance(each, ast.Call)]
            names = set().union(*map(written_by, calls)) - ELSEWHERE.get(where, set())
            found |= {where: names} if names else {}
    assert found == {}
