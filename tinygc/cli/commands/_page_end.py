"""The page behind the end of a recording, whose files are closed by then: it stays while somebody looks at it, and has the report made
by a process of its own where that is asked for."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING

from session.common.texts import printable, shell_word

if TYPE_CHECKING:
    from session.page.server import PageServer

GONE_S = 5.0  #: without a browser: one that reloads the page is back by then
LOOK_EVERY_S = 0.1
CALIBRATE = Path(__file__).resolve().parents[3] / "calibrate.py"
MADE = (0, 1)  #: exit codes of ``report`` with a report: 1 is a calibration that fails


def say_interrupted(server: PageServer, command: str) -> None:
    """Say on the page how it goes on."""
    server.publish("end", {"words": "interrupted; everything received is kept. To go on:", "command": command, "report": "none"})


def stay(server: PageServer, folder: Path, wanted: Callable[[], bool]) -> None:
    """While somebody looks at the page, and nobody wants it to end."""
    _Finished(server, folder).stay(wanted)


class _Finished:
    """A recording that is finished, on the page."""

    def __init__(self, server: PageServer, folder: Path):
        self._server, self._path = server, folder / "report.html"
        self._command, self._folder = f"calibrate.py report {shell_word(folder)}", folder
        self._ready = False
        server.report = lambda: self._path.read_bytes() if self._ready and self._path.is_file() else None
        self._say("offered", "The files are closed.")

    def stay(self, wanted: Callable[[], bool]) -> None:
        """Whoever reloads the page, or has a phone that sleeps, is awaited; where nobody ever looked, it ends at once."""
        seen_s = time.monotonic()
        if self._server.visited:
            print("the page stays while it is looked at, and can make the report; Ctrl-C ends it", file=sys.stderr, flush=True)
        else:
            return
        while not wanted() and time.monotonic() - seen_s < GONE_S:
            if self._server.wishes.report.is_set():
                self._make(wanted)
                self._server.wishes.report.clear()
            if self._server.clients:
                seen_s = time.monotonic()
            time.sleep(LOOK_EVERY_S)

    def _make(self, wanted: Callable[[], bool]) -> None:
        began_s = time.monotonic()
        with tempfile.TemporaryFile() as said:
            command = [
                sys.executable,
                str(CALIBRATE),
                "report",
                str(self._folder.resolve()),
                "--quiet",
            ]  # no name that looks like an option
            with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said) as making:
                try:
                    while making.poll() is None and not wanted():
                        self._say(
                            "making", f"The report is being made: {time.monotonic() - began_s:.0f} s so far, up to some minutes in all."
                        )
                        time.sleep(LOOK_EVERY_S)
                finally:
                    making.terminate()
            self._ready = making.returncode in MADE and self._path.is_file()
            if self._ready:
                self._say("ready", f"The report is {self._path}.")
            else:
                self._say("failed", f"No report: {_last_line(said) or f'exit code {making.returncode}'}.")

    def _say(self, report: str, words: str) -> None:
        self._server.publish("end", {"words": printable(words), "command": self._command, "report": report})


def _last_line(said: IO[bytes]) -> str:
    said.seek(0)
    lines = said.read().decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""
