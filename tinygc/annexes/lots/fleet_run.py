"""Hand out the sessions that are not known yet, to processes here or to a cluster, and keep what comes back."""

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
from queue import SimpleQueue
from time import monotonic
from typing import Any, Protocol

from session.io.errors import CalibrationError
from session.io.texts import printable
from tinygc.annexes.lots.fleet_row import DIED, DONE, FleetOptions, Row, empty, key_of
from tinygc.annexes.lots.fleet_session import Job, Outcome, compute
from tinygc.annexes.lots.fleet_table import Table

# Which folders are sessions, found one after the other as they are asked for: a hundred thousand of them are never held at once.

CONFIG = "session.toml"
#: some systems name files in capitals, and may put a line end into a name
LOG = re.compile(r"log.*\.csv(\.gz)?", re.IGNORECASE | re.DOTALL)


def session_folders(places: Iterable[Path]) -> Iterator[Path]:
    """Every session folder in these, by name, at any depth; a session's own folders are not looked into.

    A folder that holds a log and no session.toml is one, too: it fails with its line instead of being passed over, and what is in it is
    found besides, since the log may be somebody's notes.  Folders whose names begin with a dot are passed over, and so is what lies behind
    a link, unless that is a session itself.  CalibrationError for a place that is not there.
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
    except OSError:  # what nobody may look into is no session that anybody could read; those beside it are found
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
    """A link that leads to itself, or where nobody may look, is none, and no reason to pass over what lies beside it."""
    try:
        return entry.is_dir()
    except OSError:
        return False


def listed_folders(lines: Iterable[str]) -> Iterator[Path]:
    """Those of a list, one a line, as they stand; blank lines are passed over.  One that is not there fails with its line."""
    for line in lines:
        if name := line.rstrip("\r\n"):
            yield Path(name)


# Who computes: what ``run.py`` asks of processes and clusters alike.


@dataclass(frozen=True)
class Finished:
    """Of a job: its outcome; or None where the process that computed it ended, and died says how."""

    job: Job
    outcome: Outcome | None
    died: str = ""


class Executor(Protocol):
    """Takes ``capacity`` jobs at a time."""

    @property
    def capacity(self) -> int:
        """How many jobs may be under way, so that nobody waits for work."""

    def submit(self, job: Job) -> None:
        """Begin a job, or queue it."""

    def finished(self) -> list[Finished]:
        """Wait until at least one of them has come to an end."""

    def close(self) -> None:
        """Stop whatever is under way."""


# Processes of this machine, each with one job at a time, so that it is known whose end cost which session.

READY = "ready"
#: jobs that wait beside each that is computed: the next begins at once
AHEAD = 1
#: s: for a process that was told to end, before it is made to
GRACE_S = 5.0
#: exit code of a process for which there was no memory
NO_MEMORY = 12
#: matrices are small: threads that wait for one another cost more than they give, and sums must not depend on their number
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    ready: bool = False
    job: Job | None = None


class Processes:
    """``count`` of them, started with the first job, and anew where one ends.

    Each is a fresh interpreter: what the parent holds open or has running is not its own.  It ends by itself when the parent has.
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
        """Those that are computed, and those that wait."""
        return self._count * (1 + AHEAD)

    def submit(self, job: Job) -> None:
        """To who has nothing to do, else into the queue."""
        while len(self._workers) < self._count:
            self._workers.append(self._started())
        self._queue.append(job)
        self._hand_out()

    def finished(self) -> list[Finished]:
        """Wait until at least one job has come to an end."""
        found: list[Finished] = []
        while not found:
            by_pipe = {worker.pipe: worker for worker in self._workers}
            for pipe in wait(list(by_pipe)):
                worker = by_pipe[pipe]  # type: ignore[index]
                try:
                    said = worker.pipe.recv()
                except (EOFError, OSError):
                    found += self._replaced(worker)
                    continue
                if isinstance(said, CalibrationError):
                    raise said
                if said == READY:
                    worker.ready = True
                else:
                    assert worker.job is not None
                    found.append(Finished(worker.job, said))
                    worker.job = None
            self._hand_out()
        return found

    def close(self) -> None:
        """End them all; what they compute is lost."""
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
                with contextlib.suppress(OSError):  # it has ended: ``finished`` sees that next
                    worker.pipe.send(worker.job)

    def _started(self) -> _Worker:
        ours, its = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(its,), daemon=True)
        with _interrupts_ignored():  # from its first moment on: Ctrl-C reaches it, too, and is ours to answer
            process.start()
        its.close()
        return _Worker(process, ours)

    def _replaced(self, worker: _Worker) -> list[Finished]:
        worker.process.join()
        worker.pipe.close()
        if not worker.ready:
            raise CalibrationError(f"a process ended before it could begin ({_how(worker.process.exitcode)}); is there memory for --jobs?")
        self._workers[self._workers.index(worker)] = self._started()
        return [] if worker.job is None else [Finished(worker.job, None, _how(worker.process.exitcode))]


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """A process that is started meanwhile ignores them as well."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _how(code: int | None) -> str:
    """In words: the signal that ended a process, or its exit code."""
    if code is None or code >= 0:
        return "memory was short" if code == NO_MEMORY else f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


def _serve(pipe: Connection) -> None:
    """In the process: jobs in, outcomes out, until the parent has gone.  Ctrl-C is the parent's."""
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


# A Dask cluster: its scheduler gives the same jobs to workers on other machines, which see the session folders under the same paths.

#: jobs under way for each thread of the cluster, so that none waits for us
CLUSTER_AHEAD = 2
#: s between two looks at how many workers there are: they may come and go
OFTEN_S = 2.0
#: s: for a scheduler to answer
PATIENCE_S = 30


class Cluster:
    """A scheduler's workers.  CalibrationError where the package is missing, or no scheduler answers.

    A job whose worker ends is given out again by the scheduler (``distributed.scheduler.allowed-failures`` times), and comes back as died
    when that is used up.
    """

    def __init__(self, address: str):
        try:
            import distributed
        except ImportError:
            raise CalibrationError("--scheduler needs the package distributed: python -m pip install 'tinygc[fleet]'") from None
        self._distributed = distributed
        try:
            self._client = distributed.Client(address, timeout=PATIENCE_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise CalibrationError(
                f"--scheduler {address}: no Dask scheduler answers ({why}); give its address, such as tcp://host:8786"
            ) from None
        self._jobs: dict[Any, Job] = {}
        self._over: SimpleQueue[Any] = SimpleQueue()  # filled by the client's own thread
        self._threads, self._asked_s = 0, float("-inf")

    @property
    def capacity(self) -> int:
        """Of the workers that there are now; with none yet, one: it waits for the first."""
        if monotonic() - self._asked_s > OFTEN_S:
            self._threads, self._asked_s = sum(self._client.nthreads().values()), monotonic()
        return max(CLUSTER_AHEAD * self._threads, 1)

    def submit(self, job: Job) -> None:
        """To whatever worker the scheduler chooses."""
        future = self._client.submit(compute, job, pure=False)
        self._jobs[future] = job
        future.add_done_callback(self._over.put)

    def finished(self) -> list[Finished]:
        """Wait until at least one job has come to an end."""
        over = [self._over.get()]
        while not self._over.empty():
            over.append(self._over.get())
        return [self._ended(future) for future in over]

    def close(self) -> None:
        """Take back what is under way; the cluster goes on without us."""
        with contextlib.suppress(Exception):  # a scheduler that has gone has nothing under way
            self._client.cancel(list(self._jobs), force=True)
        self._jobs.clear()
        with contextlib.suppress(Exception):
            self._client.close()

    def _ended(self, future: Any) -> Finished:
        job = self._jobs.pop(future)
        try:
            return Finished(job, future.result())
        except self._distributed.KilledWorker:
            return Finished(job, None, "on workers that ended")
        except self._distributed.CancelledError as error:
            raise CalibrationError(
                f"the scheduler has dropped {job.folder} ({error}); is it still running? what is finished is kept"
            ) from None
        except (ImportError, AttributeError) as error:
            raise CalibrationError(f"a worker cannot run TinyGC ({error}); install the same version there") from None
        except CalibrationError:
            raise
        except MemoryError:
            return Finished(job, None, "memory was short")
        except Exception as error:
            return Finished(job, None, f"{type(error).__name__}: {error}")


# Hand out what is not known yet, keep what comes back: a hundred thousand folders go through a handful at a time.

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


class _FleetRun:
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
    run = _FleetRun(table, executor, options, retry, progress)
    for folder in folders:
        run.take(folder)
    run.drain()
    return run.tally


def _died(how: str) -> Row:
    error = f"the process that computed it ended, {ATTEMPTS} times ({how or 'no reason known'}); was memory short? try again with --retry"
    return empty() | {"status": DIED, "error": error}
