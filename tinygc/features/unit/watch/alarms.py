"""Where the events of a watch go: JSON lines, and a person's command at an alarm.

Each line is written at once; what cannot be written is kept, and tried again with the next.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shlex
import signal
import subprocess
import sys
import threading
from collections import deque
from io import FileIO
from pathlib import Path

from session.base.errors import CalibrationError, StorageError
from session.base.files import open_written
from session.base.progress import Reporter
from session.base.records import json_line

#: lines that are kept while they cannot be written
MOST_KEPT = 10_000


class JsonLines:
    """path: a new file, or None for standard output; report: one line when writing fails, and when it works again.

    Raises StorageError for a file that cannot be opened.
    """

    def __init__(self, path: Path | None, report: Reporter):
        self._path, self._report = path, report
        self._waiting: deque[bytes] = deque(maxlen=MOST_KEPT)
        self._whole = 0  # bytes of whole lines in the file
        self._lost, self._failed = 0, False
        self._file: FileIO | None = None
        if path is not None:
            try:
                self._file = os.fdopen(open_written(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb", buffering=0)
            except OSError as error:
                raise StorageError(f"{path}: cannot be written ({error.strerror}); give --json another path") from None

    def write(self, table: dict) -> None:
        """Write a line, or keep it."""
        line = json_line(table)
        if self._path is None:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
            return
        self._lost += len(self._waiting) == MOST_KEPT
        self._waiting.append(f"{line}\n".encode())
        self._try()

    def _try(self) -> None:
        assert self._path is not None
        try:
            file = self._file = self._file or os.fdopen(open_written(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "ab", buffering=0)
            while self._waiting:
                line = self._waiting[0]
                if file.write(line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                self._whole += len(line)
                self._waiting.popleft()
        except OSError as error:
            self._close()
            if not self._failed:
                self._report(f"{self._path}: {error.strerror or error}; its lines are kept, and written as soon as they can be")
            self._failed = True
        else:
            if self._failed:
                self._report(f"{self._path}: can be written again; {self._lost} lines were lost")
            self._failed = False

    def _close(self) -> None:
        """Close the file without the part of a line that did not fit."""
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                os.ftruncate(file.fileno(), self._whole)
            with contextlib.suppress(OSError):
                file.close()

    def end(self) -> None:
        """Write what is left.  Raises StorageError where that still fails."""
        if self._path is None:
            return
        if self._waiting:
            self._try()
        left = len(self._waiting) + self._lost
        self._close()
        if left:
            raise StorageError(f"{self._path}: {left} lines could not be written; free space there, or give --json another path")


# A person's command at an alarm: run without a shell, with the alarm's JSON line at its standard input; it never stops the watch.

#: s that a command may take, and commands that may run at once
MOST_S, MOST_RUNNING = 30.0, 4


def words_of(text: str) -> list[str]:
    """The words of a command.  CalibrationError for none, and for a quote that does not end."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise CalibrationError(f"--command {text!r:.80}: {error}; write it as in a shell, without its operators") from None
    if not words or "\0" in text:
        raise CalibrationError("--command: expected a program and its arguments, such as --command 'mail -s alarm me'")
    return words


class AlarmCommand:
    """Runs ``words`` for each alarm, while the watch goes on; report: one line of what went wrong."""

    def __init__(self, words: list[str], report: Reporter, most_s: float = MOST_S):
        self._words, self._report, self._most_s = words, report, most_s
        self._running: list[threading.Thread] = []

    def __call__(self, line: str) -> None:
        """Start the command with a line at its standard input."""
        self._running = [thread for thread in self._running if thread.is_alive()]
        if len(self._running) >= MOST_RUNNING:
            self._report(f"{self._words[0]}: {MOST_RUNNING} of it still run; not started for this alarm")
            return
        thread = threading.Thread(target=self._run, args=(line,), name="alarm", daemon=True)
        self._running.append(thread)
        thread.start()

    def wait(self) -> None:
        """Wait for those that still run; none takes longer than it may."""
        for thread in self._running:
            thread.join()

    def _run(self, line: str) -> None:
        name = self._words[0]
        try:
            # The JSON may go to standard output, so what the command prints does not.
            process = subprocess.Popen(
                self._words, stdin=subprocess.PIPE, stdout=2, start_new_session=True, encoding="utf-8", errors="replace"
            )
        except (OSError, ValueError) as error:
            self._report(f"{name}: cannot be run ({getattr(error, 'strerror', None) or error}); the watch goes on")
            return
        try:
            process.communicate(line + "\n", timeout=self._most_s)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(OSError):
                if hasattr(os, "killpg"):
                    os.killpg(process.pid, signal.SIGKILL)
                else:
                    process.kill()
            process.wait()
            self._report(f"{name}: did not end within {self._most_s:g} s and was stopped; the watch goes on")
        except OSError as error:  # it closed its input
            process.wait()
            self._report(f"{name}: {error.strerror or error}; the watch goes on")
        else:
            if process.returncode:
                self._report(f"{name}: ended with code {process.returncode}; the watch goes on")
