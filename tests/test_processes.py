"""Commands that tests start run and end in the same way anywhere; nothing in the tests goes round that, or waits for a time."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import processes
import pytest
from processes import PIPE, heard, run, started, until

HERE = Path(__file__).resolve().parent
posix = pytest.mark.skipif(not processes.HAS_GROUPS, reason="signals and groups as POSIX has them")
#: says how it is, starts a child that says so, and both sleep for ever
PAIR = """
import os, signal, subprocess, sys, time
print(*(signal.getsignal(number) == how for number, how in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL))),
      signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set(), os.getpgid(0) == os.getpid(), flush=True)
child = subprocess.Popen([sys.executable, "-c", "import time; print('child', flush=True); time.sleep(1e6)"])
print(child.pid, flush=True)
time.sleep(1e6)
"""


def alive(number: int) -> bool:
    """Whether a process runs; one that has ended and waits for its parent does not."""
    state = run(["ps", "-o", "stat=", "-p", number], text=True, stdout=PIPE).stdout.strip()
    return bool(state) and not state.startswith("Z")


def started_pair(running) -> list[int]:
    """Numbers of both."""
    lines = heard(running.stdout, lambda line: "child" in line)
    lines += [] if len(lines) == 3 else heard(running.stdout, lambda line: True)
    assert lines[0] == "True True True True\n"
    return [running.pid, int(next(line for line in lines if line.strip().isdigit()))]


@pytest.fixture
def ignoring():
    """As under ``nohup``, and behind an ``&`` of a script; and with a signal blocked."""
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGHUP)}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    for number, handler in before.items():
        signal.signal(number, handler)


@posix
def test_whatever_we_ignore_a_command_has_every_signal_and_its_whole_group_ends(ignoring):
    with started([sys.executable, "-c", PAIR], stdout=PIPE, text=True) as running:
        pair = started_pair(running)
        assert all(map(alive, pair))
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN  # ours are as they were
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert running.returncode == -signal.SIGTERM
    until(lambda: not any(map(alive, pair)), what="the end of both")


@posix
def test_what_does_not_listen_is_killed(monkeypatch):
    monkeypatch.setattr(processes, "GRACE_S", 0.2)
    deaf = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(1e6)"
    with started([sys.executable, "-c", deaf], stdout=PIPE, text=True) as running:
        heard(running.stdout, lambda line: line == "deaf\n")
    assert running.returncode == -signal.SIGKILL


@posix
def test_what_hangs_is_killed_and_whoever_reads_is_told():
    with started([sys.executable, "-c", PAIR], limit_s=0.5, stdout=PIPE, text=True) as running:
        os.killpg(running.pid, signal.SIGSTOP)
        with pytest.raises(AssertionError, match="never said"):
            heard(running.stdout, lambda line: line == "what it never says\n")


@posix
def test_who_starts_commands_may_be_killed_and_they_end():
    """As a continuous integration does with a test run that takes too long."""
    tests = f"""
import sys, time
sys.path.insert(0, {str(HERE)!r})
from processes import started
with started([sys.executable, "-c", {PAIR!r}]) as running:
    print(running.pid, "started", flush=True)
    time.sleep(1e6)
"""
    with started([sys.executable, "-c", tests], stdout=PIPE, text=True) as outer:
        lines = heard(outer.stdout, lambda line: "child" in line)
        lines += heard(outer.stdout, lambda line: True) if len(lines) < 4 else []
        pair = [int(line.split()[0]) for line in lines if line[0].isdigit()]
        assert len(pair) == 2
        assert all(map(alive, pair))
        outer.kill()
        until(lambda: not any(map(alive, pair)), what="the end of both")


def test_a_command_has_no_terminal_to_read_from():
    """A person's who runs the tests in one: ``record`` would take the keys."""
    code = "import sys; print(sys.stdin.isatty(), repr(sys.stdin.read()))"
    assert run([sys.executable, "-c", code], text=True, stdout=PIPE).stdout == "False ''\n"
