"""Hand out what is not known yet, keep what comes back: a hundred thousand folders go through a handful at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from session.common.errors import CalibrationError
from session.common.texts import printable
from tinygc.fleet.compute import Job, Outcome
from tinygc.fleet.executor import Executor, Finished
from tinygc.fleet.keys import key_of
from tinygc.fleet.options import FleetOptions
from tinygc.fleet.row import DIED, DONE, Row, empty
from tinygc.fleet.table import Table

#: a session whose process ends is given out so often; the first end may have been another's fault, as where memory was short
ATTEMPTS = 2


@dataclass
class Tally:
    """Of a run, folders: done and failed now; reused: known before, by this or another folder; reused_failed: those of them that failed."""

    done: int = 0
    failed: int = 0
    reused: int = 0
    reused_failed: int = 0

    @property
    def folders(self) -> int:
        """All that were dealt with."""
        return self.done + self.failed + self.reused


class _Run:
    def __init__(self, table: Table, executor: Executor, options: FleetOptions, retry: bool, progress: Callable[[Tally], None]):
        self._table, self._executor, self._options, self._retry = table, executor, options, retry
        self._progress, self._pending, self._ends = progress, dict[str, list[Path]](), dict[str, int]()
        self.tally = Tally()

    def take(self, folder: Path) -> None:
        """A folder: known, under way already, or given out."""
        folder = Path(os.path.abspath(folder))  # the table is read from elsewhere, too
        try:
            key = key_of(folder, self._options)
        except CalibrationError as error:
            self._without_key(folder, str(error))
            return
        status = None if key in self._pending else self._table.status(key)
        if status == DONE or (status is not None and not self._retry):
            self._table.put_folder(folder, key)
            self.tally.reused += 1
            self.tally.reused_failed += status != DONE
            self._progress(self.tally)
        elif key in self._pending:
            self._pending[key].append(folder)
        else:
            while len(self._pending) >= self._executor.capacity:
                self.collect()
            self._pending[key] = [folder]
            self._executor.submit(Job(str(folder), key, self._options))

    def collect(self) -> None:
        """Wait for something, and keep it."""
        for finished in self._executor.finished():
            self._keep(finished)
            self._progress(self.tally)

    def drain(self) -> None:
        """Until nothing is under way."""
        while self._pending:
            self.collect()

    def _keep(self, finished: Finished) -> None:
        key = finished.job.key
        outcome = finished.outcome
        if outcome is None:
            self._ends[key] = self._ends.get(key, 0) + 1
            if self._ends[key] < ATTEMPTS:
                self._executor.submit(finished.job)
                return
            outcome = Outcome(key, _died(finished.died))
        folders = self._pending.pop(key)
        self._ends.pop(key, None)
        if outcome.row is None:
            for folder in folders:
                self._without_key(folder, outcome.trouble)
            return
        self._table.put(outcome, outcome.row, folders)
        good = outcome.row["status"] == DONE
        self.tally.done += good
        self.tally.failed += not good
        self.tally.reused += len(folders) - 1
        self.tally.reused_failed += (len(folders) - 1) * (not good)

    def _without_key(self, folder: Path, error: str) -> None:
        self._table.put_folder(folder, None, printable(error))
        self.tally.failed += 1
        self._progress(self.tally)


def run_fleet(
    folders: Iterable[Path],
    table: Table,
    executor: Executor,
    options: FleetOptions,
    *,
    retry: bool = False,
    progress: Callable[[Tally], None] = lambda tally: None,
) -> Tally:
    """Deal with each folder: a row in the table for what is in it, computed where it is not there yet.

    retry: failures that are there are computed again.  progress is told after each folder.  Whatever ends this (an interrupt, a full disk)
    leaves every finished row in the table.  StorageError and FormatError of the table.
    """
    run = _Run(table, executor, options, retry, progress)
    for folder in folders:
        run.take(folder)
    run.drain()
    return run.tally


def _died(how: str) -> Row:
    error = f"the process that computed it ended, {ATTEMPTS} times ({how or 'no reason known'}); was memory short? try again with --retry"
    return empty() | {"status": DIED, "error": error}
