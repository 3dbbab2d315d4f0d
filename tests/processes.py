"""Commands that tests start: each in a group of its own, with every signal at its default, and gone when its test is over.

``run`` and ``check_output`` take what ``subprocess`` takes; ``started`` is a context with the running process.  However the test ends, the
process's whole group is ended; however pytest itself ends, be it killed, the groups that are left are killed.  ``until`` waits for what
must happen, ``heard`` for what must be said.  No wait is for a time: PATIENCE_S takes only what hangs, however busy the machine is.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CALIBRATE = (sys.executable, str(ROOT / "calibrate.py"))
PATIENCE_S = 300.0
GRACE_S = 20.0  #: for what was asked to end, before it is killed
HAS_GROUPS = hasattr(os, "killpg")  # POSIX
DEVNULL, PIPE, STDOUT = subprocess.DEVNULL, subprocess.PIPE, subprocess.STDOUT
CompletedProcess, Popen = subprocess.CompletedProcess, subprocess.Popen
#: of the cheapest fit; the columns of a session's log
QUICK = ("--methods", "least_squares", "--quiet")
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"


class WithoutTorch:
    """A finder, before all others of ``sys.meta_path``, that knows of no PyTorch, as where it was never installed."""

    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def environment(**more):
    """The present one, so that a command of this checkout is run wherever it is started, and leaves a core to the others."""
    return os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)} | more


def wait():
    """The shortest of waits, for what is asked many times."""
    time.sleep(0.0005)


def until(condition, poll=lambda: time.sleep(0.005), what="what must happen"):
    """Wait until it holds; what it then gives."""
    deadline = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        poll()
    return found


@contextlib.contextmanager
def started(command, limit_s=PATIENCE_S, **how):
    """``subprocess.Popen`` in a group and session of its own; ended, by force if need be, when the context is left.

    Its standard input is empty, unless given.  After limit_s it is killed: whoever reads what it says then comes to an end.
    """
    how = {"cwd": ROOT, "env": environment(), "stdin": DEVNULL} | how
    with usual_signals():
        process = Popen([os.fspath(word) if isinstance(word, Path) else str(word) for word in command], start_new_session=True, **how)
    _WATCH.over(process.pid)
    limit = threading.Timer(limit_s, process.kill)
    limit.daemon = True
    limit.start()
    try:
        yield process
    finally:
        limit.cancel()
        end(process)
        _WATCH.no_more(process.pid)


def run(command, *, input=None, capture_output=False, check=False, **how):
    """``subprocess.run``, within PATIENCE_S."""
    how |= {"stdout": PIPE, "stderr": PIPE} if capture_output else {}
    how |= {"stdin": PIPE} if input is not None else {}
    with started(command, **how) as process:
        said = process.communicate(input)
        kill_group(process.pid)  # what it has left
    done = CompletedProcess(process.args, process.returncode, *said)
    if check:
        done.check_returncode()
    return done


def check_output(command, **how):
    """``subprocess.check_output``."""
    return run(command, stdout=PIPE, check=True, **how).stdout


def calibrate(*words, **how):
    """``calibrate.py`` with these words, to its end: texts in stdout and stderr."""
    return run([*CALIBRATE, *words], capture_output=True, text=True, **how)


def heard(stream, said):
    """The lines of a stream up to the first of which ``said`` is true.  AssertionError where it ends before."""
    seen = []
    for line in stream:
        seen.append(line)
        if said(line):
            return seen
    raise AssertionError(f"never said; the last lines: {''.join(seen[-20:])}")


def spoil(folder, change, name="log0001.csv"):
    """Change the list of a log's lines (0: comment, 1: header)."""
    path = folder / name
    lines = path.read_text().split("\n")
    path.write_text("\n".join(change(lines)))


def refused(result, *words):
    """Exit code 2 and one line, without a traceback, that says every word."""
    code, out, err = result
    lines = err.strip().split("\n")
    assert code == 2, (code, err)
    assert len(lines) == 1, err
    assert lines[0].startswith("calibrate: "), err
    assert "Traceback" not in out + err
    for word in words:
        assert word in lines[0], (word, lines[0])


def as_it_stands(name, found):
    """A screen is that of tests/screens.  TINYGC_SCREENS=write writes it anew."""
    path = ROOT / "tests" / "screens" / name
    if os.environ.get("TINYGC_SCREENS") == "write":
        path.write_text(found, encoding="utf-8")
    assert found == path.read_text(encoding="utf-8")


def end(process):
    """Ask, then kill: the process and all of its group.  It is waited for, and its pipes are closed."""
    if process.returncode is None:  # else its number may be another's by now
        if process.poll() is None:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(GRACE_S)
        kill_group(process.pid)
        if process.returncode is None:
            process.kill()
            process.wait()
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            with contextlib.suppress(OSError):  # what it would still flush, nobody reads
                pipe.close()


def kill_group(number):
    """What is left of it."""
    if HAS_GROUPS:
        with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses a group of which only a zombie is left
            os.killpg(number, signal.SIGKILL)


@contextlib.contextmanager
def usual_signals():
    """What is started here has every signal at its default, also under ``nohup`` or behind an ``&``.

    A child inherits which signals are ignored and which are blocked, not the handlers.  So what we ignore gets a handler that does nothing.
    """
    if threading.current_thread() is not threading.main_thread() or not HAS_GROUPS:
        yield
        return
    ignored = [number for number in signal.valid_signals() if signal.getsignal(number) is signal.SIG_IGN]
    blocked = signal.pthread_sigmask(signal.SIG_SETMASK, ())
    for number in ignored:
        signal.signal(number, lambda *_: None)
    try:
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


class _Watch:
    """A process that outlives this one by a moment: it kills the groups that were left, when the pipe to it is closed by our end."""

    PROGRAM = """
import os, signal, sys
for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
groups = set()
for line in sys.stdin:
    (groups.add if line[0] == "+" else groups.discard)(int(line[1:]))
for group in groups:
    try:
        os.killpg(group, signal.SIGKILL)
    except OSError:
        pass
"""

    def __init__(self):
        self._process: Popen | None = None

    def over(self, group):
        """From now on."""
        if HAS_GROUPS:
            self._say(f"+{group}\n")

    def no_more(self, group):
        """It has ended."""
        if HAS_GROUPS:
            self._say(f"-{group}\n")

    def _say(self, line):
        if self._process is None:
            quiet = {"stdout": DEVNULL, "stderr": DEVNULL, "start_new_session": True}
            self._process = Popen([sys.executable, "-I", "-S", "-c", self.PROGRAM], stdin=PIPE, text=True, bufsize=1, **quiet)
            pipe = self._process.stdin.fileno()
            os.register_at_fork(after_in_child=lambda: os.close(pipe))  # else it stays open as long as the child lives
            atexit.register(self._process.communicate)
        self._process.stdin.write(line)


_WATCH = _Watch()


def closed_pipe():
    """The writing end of a pipe that nobody reads."""
    reader, writer = os.pipe()
    os.close(reader)
    return writer


def unread(monkeypatch, *words):
    """Exit code of a command, in this process, whose standard output and standard error nobody reads."""
    import calibrate

    with (
        open(closed_pipe(), "w", encoding="utf-8") as out,
        open(closed_pipe(), "w", encoding="utf-8", buffering=1) as err,
        monkeypatch.context() as patch,
    ):
        for name, stream in (("stdout", out), ("stderr", err)):
            patch.setattr(sys, name, stream)
            patch.setattr(sys, f"__{name}__", stream)
        try:
            return calibrate.main(list(words))
        except SystemExit as stopped:  # argparse
            return stopped.code
        finally:
            sys.stdout.flush()
