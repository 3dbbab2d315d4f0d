"""A Dask cluster: its scheduler gives the same jobs to workers on other machines, which see the session folders under the same paths."""

from __future__ import annotations

import contextlib
from queue import SimpleQueue
from time import monotonic
from typing import Any

from session.common.errors import CalibrationError
from tinygc.fleet.compute import Job, compute
from tinygc.fleet.executor import Finished

#: jobs under way for each thread of the cluster, so that none waits for us
AHEAD = 2
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
        return max(AHEAD * self._threads, 1)

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
