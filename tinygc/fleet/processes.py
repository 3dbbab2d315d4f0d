"""Processes of this machine, each with one job at a time, so that it is known whose end cost which session."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from session.common.errors import CalibrationError
from tinygc.fleet.compute import Job, Outcome, compute
from tinygc.fleet.executor import Finished

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
    except MemoryError:
        os._exit(NO_MEMORY)
