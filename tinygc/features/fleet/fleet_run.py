"""Distribute the sessions without a result to processes, and store the results."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import monotonic

from session.base.errors import CalibrationError
from session.base.texts import printable
from tinygc.features.fleet.fleet_row import DIED, DONE, FleetOptions, Job, Outcome, compute, empty, key_of
from tinygc.features.fleet.fleet_table import WATCH_S, FleetTable

# Session folders, found one by one on demand: a hundred thousand of them are never in memory at once.

CONFIG = "session.toml"
#: some systems use capitals in file names, and allow a newline in a name
LOG = re.compile(r"log.*\.csv(\.gz)?", re.IGNORECASE | re.DOTALL)


def session_folders(places: Iterable[Path]) -> Iterator[Path]:
    """Yield every session folder in these, by name, at any depth; a session's own folders are not searched.

    A folder with a log but without session.toml counts as a session, so that it fails with a message; it is searched as well, since the log
    may be an unrelated file.  Folders whose names begin with a dot are skipped, and so are links, unless they lead to a session.  Raises
    CalibrationError for a missing place.
    """
    for place in places:
        if not place.is_dir():
            hint = "that is a file; --from FILE reads a list of folders" if place.exists() else "not found"
            raise CalibrationError(f"{place}: {hint}; give a folder with session folders in it")
        yield from _inside(os.fspath(place))


def _inside(folder: str) -> Iterator[Path]:
    try:
        with os.scandir(folder) as found:
            entries = [(entry.name, _is_folder(entry), entry.is_symlink()) for entry in found]
    except OSError:  # an unreadable folder is skipped; its neighbours are found
        return
    names = [name for name, is_folder, _ in entries if not is_folder]
    if CONFIG in names or any(map(LOG.fullmatch, names)):
        yield Path(folder)
    if CONFIG in names:
        return
    for name, is_folder, is_link in sorted(entries):
        inside = os.path.join(folder, name)
        if not is_folder or name.startswith("."):
            continue
        if not is_link:
            yield from _inside(inside)
        elif os.path.exists(os.path.join(inside, CONFIG)):
            yield Path(inside)


def _is_folder(entry: os.DirEntry) -> bool:
    """Return whether it is a folder; a circular or unreadable link is none, and does not hide its neighbours."""
    try:
        return entry.is_dir()
    except OSError:
        return False


def listed_folders(lines: Iterable[str]) -> Iterator[Path]:
    """Yield the folders of a list, one a line, unchanged; blank lines are skipped.  A missing folder fails with its own message."""
    for line in lines:
        if name := line.rstrip("\r\n"):
            yield Path(name)


# Processes of this machine with one job at a time, so that the death of a process is attributed to its session.

#: a finished job and its outcome; or how its process died
Finished = tuple[Job, Outcome | str]
READY = "ready"
#: queued jobs per running job, so that the next one starts at once
AHEAD = 1
#: s for a process to end on request before it is killed
GRACE_S = 5.0
#: exit code of a process that was out of memory
NO_MEMORY = 12
#: matrices are small: threads cost more than they gain, and sums must not depend on their number
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    ready: bool = False
    job: Job | None = None


class Processes:
    """A pool of ``count`` processes, started with the first job, and replaced when one dies.

    Each is a fresh interpreter, without the parent's open files and threads.  It ends by itself after the parent.
    """

    def __init__(self, count: int):
        for name in ONE_THREAD:
            os.environ.setdefault(name, "1")
        self._count = count
        self._context = get_context("spawn")
        self._queue: deque[Job] = deque()
        self._workers: list[_Worker] = []

    @property
    def capacity(self) -> int:
        """Return the number of jobs running and queued."""
        return self._count * (1 + AHEAD)

    def submit(self, job: Job) -> None:
        """Give the job to an idle process, else queue it."""
        while len(self._workers) < self._count:
            self._workers.append(self._started())
        self._queue.append(job)
        self._hand_out()

    def finished(self) -> list[Finished]:
        """Wait until a job has finished, or for ``WATCH_S``."""
        found: list[Finished] = []
        until = monotonic() + WATCH_S
        while not found and monotonic() < until:
            by_pipe = {worker.pipe: worker for worker in self._workers}
            for pipe in wait(list(by_pipe), WATCH_S):
                worker = by_pipe[pipe]  # type: ignore[index]
                try:
                    message = worker.pipe.recv()
                except (EOFError, OSError):
                    worker.process.join()
                    worker.pipe.close()
                    if not worker.ready:
                        how = _how(worker.process.exitcode)
                        raise CalibrationError(f"a process ended before it could begin ({how}); is there memory for --jobs?") from None
                    self._workers[self._workers.index(worker)] = self._started()
                    found += [] if worker.job is None else [(worker.job, _how(worker.process.exitcode))]
                    continue
                if isinstance(message, CalibrationError):
                    raise message
                if message == READY:
                    worker.ready = True
                else:
                    assert worker.job is not None
                    found.append((worker.job, message))
                    worker.job = None
            self._hand_out()
        return found

    def close(self) -> None:
        """End all processes; their current jobs are lost."""
        for worker in self._workers:
            worker.pipe.close()
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join(GRACE_S)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
        self._workers.clear()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._queue and worker.ready and worker.job is None:
                worker.job = self._queue.popleft()
                with contextlib.suppress(OSError):  # the process has died; ``finished`` detects it next
                    worker.pipe.send(worker.job)

    def _started(self) -> _Worker:
        ours, its = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(its,), daemon=True)
        with _interrupts_ignored():  # from its start: Ctrl-C reaches it too, and the parent handles it
            process.start()
        its.close()
        return _Worker(process, ours)


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Make processes started in this context ignore interrupts as well."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _how(code: int | None) -> str:
    """Describe the signal that ended a process, or its exit code."""
    if code is None or code >= 0:
        return "memory was short" if code == NO_MEMORY else f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


def _serve(pipe: Connection) -> None:
    """Run jobs in the process until the parent has gone.  Ctrl-C is handled by the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        pipe.send(READY)
        while True:
            outcome: Outcome = compute(pipe.recv())
            pipe.send(outcome)
    except (EOFError, OSError):
        return
    except CalibrationError as error:
        pipe.send(error)
    except MemoryError:
        os._exit(NO_MEMORY)


# Run of a fleet: distribute the sessions without a result and store the results, with only a few folders in memory at a time.

#: attempts of a session whose process dies; another session may have caused the first death, as with short memory
ATTEMPTS = 2


class FleetRun:
    """A run, with its counts of folders: done and failed now; reused: known before, by this or another folder."""

    def __init__(self, table: FleetTable, executor: Processes, options: FleetOptions, retry: bool, progress: Callable[[FleetRun], None]):
        self._table, self._executor, self._options, self._retry = table, executor, options, retry
        self._progress, self._pending, self._ends = progress, dict[str, list[Path]](), dict[str, int]()
        self.done = self.failed = self.reused = 0

    @property
    def folders(self) -> int:
        """Return the number of all folders handled."""
        return self.done + self.failed + self.reused

    def take(self, folder: Path) -> None:
        """Handle a folder: its result is known, in progress, or to be computed."""
        self._table.require_there()
        folder = Path(os.path.abspath(folder))  # readers of the table may have another working directory
        try:
            key = key_of(folder, self._options)
        except CalibrationError as error:
            self._without_key(folder, str(error))
            return
        status = None if key in self._pending else self._table.status(key)
        if status == DONE or (status is not None and not self._retry):
            self._table.put_folder(folder, key)
            self.reused += 1
            self._progress(self)
        elif key in self._pending:
            self._pending[key].append(folder)
        else:
            while len(self._pending) >= self._executor.capacity:
                self.collect()
            self._pending[key] = [folder]
            self._executor.submit(Job(str(folder), key, self._options))

    def collect(self) -> None:
        """Wait for a result, and store it."""
        self._table.require_there()
        for job, outcome in self._executor.finished():
            self._keep(job, outcome)
            self._progress(self)

    def drain(self) -> None:
        """Wait until no job is in progress."""
        while self._pending:
            self.collect()

    def _keep(self, job: Job, outcome: Outcome | str) -> None:
        key = job.key
        if isinstance(outcome, str):
            self._ends[key] = self._ends.get(key, 0) + 1
            if self._ends[key] < ATTEMPTS:
                self._executor.submit(job)
                return
            error = f"the process that computed it ended, {ATTEMPTS} times ({outcome}); was memory short? try again with --retry"
            outcome = Outcome(key, empty() | {"status": DIED, "error": error})
        folders = self._pending.pop(key)
        self._ends.pop(key, None)
        if outcome.row is None:
            for folder in folders:
                self._without_key(folder, outcome.trouble)
            return
        self._table.put(outcome, outcome.row, folders)
        good = outcome.row["status"] == DONE
        self.done += good
        self.failed += not good
        self.reused += len(folders) - 1

    def _without_key(self, folder: Path, error: str) -> None:
        self._table.put_folder(folder, None, printable(error))
        self.failed += 1
        self._progress(self)


def run_fleet(
    folders: Iterable[Path],
    table: FleetTable,
    executor: Processes,
    options: FleetOptions,
    *,
    retry: bool = False,
    progress: Callable[[FleetRun], None] = lambda run: None,
) -> FleetRun:
    """Make a row in the table for each folder, computed where it is missing.

    retry: failed rows are computed again.  progress is called after each folder.  Finished rows stay in the table whatever ends the run (an
    interrupt, a full disk).  Raises StorageError and FormatError of the table.
    """
    run = FleetRun(table, executor, options, retry, progress)
    for folder in folders:
        run.take(folder)
    run.drain()
    table.require_there(at_once=True)
    return run
