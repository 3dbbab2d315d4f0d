"""A person's command at an alarm: run without a shell, with the alarm's JSON line at its standard input; it never stops the watch."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import subprocess
import threading

from session.base.errors import CalibrationError
from session.base.progress import Told

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
    """Runs ``words`` for each alarm, beside the watch; say: one line of what went wrong."""

    def __init__(self, words: list[str], say: Told, most_s: float = MOST_S):
        self._words, self._say, self._most_s = words, say, most_s
        self._running: list[threading.Thread] = []

    def __call__(self, line: str) -> None:
        """Start the command with a line at its standard input."""
        self._running = [thread for thread in self._running if thread.is_alive()]
        if len(self._running) >= MOST_RUNNING:
            self._say(f"{self._words[0]}: {MOST_RUNNING} of it still run; not started for this alarm")
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
            self._say(f"{name}: cannot be run ({getattr(error, 'strerror', None) or error}); the watch goes on")
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
            self._say(f"{name}: did not end within {self._most_s:g} s and was stopped; the watch goes on")
        except OSError as error:  # it closed its input
            process.wait()
            self._say(f"{name}: {error.strerror or error}; the watch goes on")
        else:
            if process.returncode:
                self._say(f"{name}: ended with code {process.returncode}; the watch goes on")
