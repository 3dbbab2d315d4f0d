"""Windows and macOS: what only POSIX systems have is needed by the virtual board alone.

The modules that Windows lacks are hidden in a process of its own.  pyserial would then look for them itself, where on Windows it takes its
own back end: a stand-in of the same names is put in its place.
"""

import re
import sys

import processes
import pytest

from session.bench.rawfile import RawFile
from tinygc.cli.commands import commands

HIDE = """
import errno, os, select, signal, sys, types
for name in ("termios", "fcntl", "pty", "tty", "resource", "pwd", "grp", "syslog", "posix_ipc", "readline", "curses"):
    sys.modules[name] = None
for module, names in (
    (os, ("openpty", "forkpty", "pread", "pwrite", "mkfifo", "ttyname", "set_blocking", "fchmod", "fchown", "chown", "killpg", "setsid",
          "getpgid", "nice")),
    (select, ("poll", "epoll")),
    (signal, ("SIGHUP", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGPIPE", "SIGKILL", "SIGCHLD", "setitimer", "alarm", "pthread_sigmask")),
    (errno, ("EDQUOT",)),
):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
port = types.SimpleNamespace(device="COM3", vid=0x0483, pid=0x374E, serial_number="42", manufacturer="ST", product="ST-LINK/V3",
                             description="ST-LINK")
serial = types.ModuleType("serial")
serial.SerialException = type("SerialException", (OSError,), {})
serial.Serial = object
tools = types.ModuleType("serial.tools")
tools.list_ports = types.ModuleType("serial.tools.list_ports")
tools.list_ports.comports = lambda: [port]
tools.list_ports_common = types.ModuleType("serial.tools.list_ports_common")
tools.list_ports_common.ListPortInfo = types.SimpleNamespace
serial.tools = tools
sys.modules.update({"serial": serial, "serial.tools": tools, "serial.tools.list_ports": tools.list_ports,
                    "serial.tools.list_ports_common": tools.list_ports_common})
"""


def hidden(code, **more):
    """Run Python in which the POSIX modules are not there."""
    return processes.run([sys.executable, "-c", HIDE + code], capture_output=True, text=True, **more)


def calibrate(*arguments):
    return hidden(f"import calibrate; sys.exit(calibrate.main({[str(argument) for argument in arguments]!r}))")


@pytest.mark.broad
def test_every_module_but_the_boards_terminal_is_imported_and_a_session_runs(tmp_path):
    code = f"""
import calibrate, importlib, pathlib
failed = []
for path in sorted(pathlib.Path(".").glob("session/**/*.py")) + sorted(pathlib.Path(".").glob("tinygc/**/*.py")):
    name = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
    try:
        importlib.import_module(name)
    except ImportError:
        failed.append(name)
print(*failed)
folder = {str(tmp_path / "s")!r}
log, model = folder + "/log0001.csv.gz", folder + "/fit/model_least_squares.json"
for words in (
    ["simulate", "--out", folder, "--segments", "10", "--closure", "0", "--odr-hz", "104", "--quiet"],
    ["fit", folder, "--methods", "raw,least_squares", "--quiet"],
    ["apply", model, log, "-o", folder + "/out.csv"],
    ["export", folder, "--to", "json", "--out", folder + "/export"],
):
    assert calibrate.main(words) == 0, words
"""
    done = hidden(code)
    assert done.stdout.split("\n")[0] == "tinygc.simulation.terminal", done.stderr
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "s" / "out.csv").stat().st_size > 0


def test_a_line_that_was_cut_off_is_ended(tmp_path):
    (tmp_path / "raw.times").write_bytes(b"host_ns,bytes,event\n12,3")
    RawFile(tmp_path).close()
    assert (tmp_path / "raw.times").read_bytes() == b"host_ns,bytes,event\n12,3\n"


def test_commands_run_and_the_virtual_board_says_in_one_line_that_it_is_posix_only(tmp_path):
    """Help, a port's name, a raw file that is gone on with: all without those modules."""
    names = commands()
    code = f"""
import contextlib, io, calibrate
from pathlib import Path
from session.bench.rawfile import RawFile
for name in ("termios", "fcntl", "pty"):
    with contextlib.suppress(ImportError):
        __import__(name)
        print(name, "was not hidden")
for name in {names!r}:
    with contextlib.suppress(SystemExit):
        calibrate.main([*name.split(), "--help"])
for part in (b"a\\n", b"b\\r\\n"):
    raw = RawFile(Path({str(tmp_path)!r}))
    raw.append(1, part)
    raw.close()
assert calibrate.main(["record", "--port", "list"]) == 0
sys.exit(calibrate.main(["board"]))
"""
    done = hidden(code)
    assert done.stdout.count("usage:") == len(names), done.stderr
    assert "was not hidden" not in done.stdout
    assert "COM3" in done.stdout
    assert (tmp_path / "raw.bin").read_bytes() == b"a\nb\r\n"
    assert done.returncode == 2
    assert re.fullmatch(r"calibrate: board: .*POSIX.*\n", done.stderr), done.stderr
