"""How far a fleet is: done, failed, reused, how many a second, how long still; a bar on a terminal, else a line now and then."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tinygc.fleet.run import Tally

#: s between two looks, on a terminal and elsewhere
OFTEN_S, SELDOM_S = 0.2, 30.0


class Meter:
    """A context; call it with each new tally.  The folders are counted beside the work, so that the first does not wait for the last."""

    def __init__(self, quiet: bool, folders: Callable[[], Iterable[Any]] | None):
        self._quiet, self._folders = quiet, folders
        self._found, self._counted, self._ended = 0, False, False
        self._stack = ExitStack()

    def __enter__(self) -> Meter:
        from tinygc.cli.console import progress_bar

        self._show = self._stack.enter_context(progress_bar(self._quiet))
        self._every_s = OFTEN_S if sys.stderr.isatty() else SELDOM_S
        self._began = self._last = time.monotonic()
        if self._folders is not None and not self._quiet:
            threading.Thread(target=self._count, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended = True
        self._stack.close()

    def __call__(self, tally: Tally) -> None:
        """Show it, unless that was done just now."""
        now = time.monotonic()
        if now - self._last < self._every_s:
            return
        self._last = now
        self._show(self.words(tally, now - self._began), tally.folders, max(self._found, tally.folders, 1))

    def words(self, tally: Tally, elapsed_s: float) -> str:
        """``812 done, 1 failed, 90 reused, 7.2/s, 20 min left``: the rate is that of what was computed."""
        computed = tally.done + tally.failed
        rate = computed / elapsed_s if elapsed_s > 0 else 0.0
        said = f"{tally.done} done, {tally.failed} failed, {tally.reused} reused, {rate:.3g}/s"
        if self._counted and rate > 0:
            left_s = max(self._found - tally.folders, 0) / rate
            size, unit = (1, "s") if left_s < 100 else (60, "min") if left_s < 6000 else (3600, "h")
            said += f", {left_s / size:.3g} {unit} left"
        return said

    def _count(self) -> None:
        try:
            for _ in self._folders():  # type: ignore[misc]
                self._found += 1
                if self._ended:
                    return
            self._counted = True
        except Exception:  # the work meets the same, and says it
            return
