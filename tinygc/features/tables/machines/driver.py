"""The thread that owns a table during a recording: it asks where the table is, writes ``table.csv``, and makes moves one after the other.

Verbs and answers pass through one thread, so that no answer is taken for another's; only ``stop`` comes from outside.  ``tick`` is one
round: a question, a row, and the next verb where the one before has ended.  A fault ends all moves; ``clear`` asks the table again.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from session.base.errors import CalibrationError
from session.base.units import NS
from session.bench.guide import Moment
from session.bench.messages import AxisMove
from tinygc.features.tables.machines.angles import AngleFile
from tinygc.features.tables.machines.safety import REST_S, Guarded
from tinygc.features.tables.machines.verbs import TableFault, TableLimit, Where
from tinygc.features.tables.machines.wire import PRESS

EVERY_S = 0.05  #: between two questions: 20 Hz
#: arrivals that the device's time is taken from, s; bytes are late by some ms and never early
ARRIVALS_S = 20.0
#: s of arrivals that say how fast the device's clock runs; steps to the line, which takes two or three
LEAST_SPAN_S, STEPS = 2.0, 10


class _DeviceTime:
    """The board's device time at any moment of the host, from the arrivals of its samples: the line that no arrival lies before.

    Of all such lines it is the one that is nearest to the arrivals in the middle of their span: it touches the least late arrival of the
    first half and that of the second.  A line through the first and the last arrival would be as late as these happen to be.
    """

    def __init__(self) -> None:
        self._arrivals: deque[tuple[float, float]] = deque()  # host s, device s
        self._lock = threading.Lock()

    def add(self, host_s: float, device_s: float) -> None:
        """Samples arrived; device time that goes backward has restarted."""
        with self._lock:
            if self._arrivals and device_s < self._arrivals[-1][1]:
                self._arrivals.clear()
            if not self._arrivals or host_s > self._arrivals[-1][0]:
                self._arrivals.append((host_s, device_s))
            while self._arrivals[-1][0] - self._arrivals[0][0] > ARRIVALS_S:
                self._arrivals.popleft()

    def at(self, host_s: float) -> float | None:
        """Device time, s, at host_s; None before the first arrival."""
        with self._lock:
            arrivals = np.array(self._arrivals)
        if not len(arrivals):
            return None
        since = arrivals - arrivals[-1]
        rate = 1.0
        if since[0, 0] < -LEAST_SPAN_S:  # a virtual board may run faster than the host
            early = since[:, 0] < since[0, 0] / 2
            before, after = since[early], since[~early]
            for _ in range(STEPS):
                a, b = (part[np.argmax(part[:, 1] - rate * part[:, 0])] for part in (before, after))
                rate, last = (b[1] - a[1]) / (b[0] - a[0]), rate
                if rate == last:
                    break
        return float(arrivals[-1, 1] + np.max(since[:, 1] - rate * since[:, 0]) + rate * (host_s - arrivals[-1, 0]))


class TableDriver:
    """Moves a table, and follows it.

    now_s: monotonic clock of the host; in_thread: ``tick`` runs in a thread, else the caller calls it.

    where: the last answer, None before the first; fault: why nothing moves, empty if nothing is wrong; done: number of finished moves.
    """

    def __init__(self, table: Guarded, file: AngleFile, now_s: Callable[[], float] = time.monotonic, in_thread: bool = True):
        self.table, self._file, self.now_s = table, file, now_s
        self.where: Where | None = None
        self.fault, self.done = "", 0
        self.trouble: CalibrationError | None = None  #: what ended the thread
        self._log, self._device = "", _DeviceTime()
        self._queue: deque[AxisMove] = deque()
        self._sent: AxisMove | None = None
        self._rate: tuple[int, float] | None = None  # an axis that turns at a rate, or was told to stop
        self._halted, self._asked_s = False, -EVERY_S
        self._unasked_s: float | None = None  # since when it moves though nothing was asked of it
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="table", daemon=True) if in_thread else None
        if self._thread is not None:
            self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether moves are under way or to come, by what was sent and by what the table answers.  It never waits for an answer."""
        where = self.where
        return bool(self._queue) or self._sent is not None or self._rate is not None or (where is not None and where.moving)

    def heard(self, moment: Moment) -> None:
        """Samples have arrived, and which log they went to.  It never waits for an answer."""
        self._log = moment.log
        self._device.add(moment.host_ns * NS, moment.t_us * 1e-6)

    def make(self, moves: Sequence[AxisMove]) -> None:
        """Make these moves one after the other, each once the one before has ended.  TableLimit for one beyond limits; none is made."""
        for move in moves:
            self.table.require_move(move.axis, move.angle_rad, move.rate_rps)
        with self._lock:
            self._halted = False
            self._queue.extend(moves)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Turn an axis at a rate with its sign from now on; 0 brings it to rest.  TableLimit for a rate beyond what it can do."""
        if rate_rps:
            self.table.require_rate(axis, rate_rps)
        with self._lock:
            self._halted = False
            self._rate = axis, rate_rps
            self._ask(lambda: self._tell(lambda: self.table.turn_at(axis, rate_rps)))

    def stop(self) -> None:
        """Bring all axes to rest at once, and forget all moves.  It may be called from any thread."""
        self._halted = True  # without the lock, which a late answer may hold
        self._queue.clear()
        self._sent = self._rate = None
        self.where = None  # the last answer was of a motion
        try:
            self.table.stop()
        except TableFault as error:
            self.fault = self.fault or str(error)

    def clear(self) -> None:
        """Whoever stands at the table has dealt with the fault: ask the table again."""
        self.table.forget_alarm()
        self.fault = ""

    def tick(self) -> None:
        """One round: where is it, a row, the next verb."""
        with self._lock:
            if self.fault:
                return
            self._ask(self._round)

    def tick_if_alone(self) -> None:
        """The round of a driver without a thread."""
        if self._thread is None and self.now_s() - self._asked_s >= EVERY_S:
            self._asked_s = self.now_s()
            self.tick()

    def close(self) -> None:
        """Bring the table to rest, and let go of thread, port and file."""
        self._ended.set()
        if self.busy:  # a table at rest is not stopped: some lose their angles by it
            self.stop()
        if self._thread is not None:
            self._thread.join()
        self.table.close()
        self._file.close()

    def _run(self) -> None:
        while not self._ended.wait(EVERY_S):
            try:
                self.tick()
            except CalibrationError as error:  # a full disk: whoever leads the recording says it
                self.trouble = error
                self.stop()
                return

    def _ask(self, verb: Callable[[], None]) -> None:
        try:
            verb()
        except (TableFault, TableLimit) as error:
            self._failed(str(error))

    def _failed(self, why: str) -> None:
        """Stop, and keep why; where it is not seen at rest, that too."""
        self.fault = ""
        self.stop()
        unstopped = self.fault.removeprefix(f"{self.table.description.name}: ")
        self.fault = why if not unstopped or PRESS in why else f"{why}; {unstopped}"

    def _round(self) -> None:
        asked_s = self.now_s()
        self.where = where = self.table.where()
        t_s = self._device.at((asked_s + self.now_s()) / 2)  # at what time between the two it answered is not known
        if t_s is not None:
            self._file.add(self._log, round(t_s * 1e6), where)
        if not (where.moving and self.table.is_at_rest):
            self._unasked_s = None
        elif self._unasked_s is None:
            self._unasked_s = self.now_s()
        elif self.now_s() - self._unasked_s > REST_S:
            self._unasked_s = None
            raise TableFault(f"{self.table.description.name}: it moves though nothing was asked of it; it was told to stop")
        if self._rate is not None:
            if not where.moving:  # it was told to stop, or its limit ended it
                self._rate, self.done = None, self.done + 1
        elif self._sent is not None and not where.moving:
            self._sent, self.done = None, self.done + 1
        if self._queue and self._sent is None and self._rate is None and not where.moving:
            try:
                self._sent = move = self._queue[0]  # before it leaves the queue: ``busy`` sees it in either place
                self._queue.popleft()
            except IndexError:  # stopped meanwhile
                self._sent = None
                return
            self._tell(lambda: self.table.turn_to(move.axis, move.angle_rad, move.rate_rps))

    def _tell(self, verb: Callable[[], None]) -> None:
        """A verb that moves; a stop that comes meanwhile is the last word."""
        if not self._halted:
            verb()
        if self._halted:
            self._sent = self._rate = None
            self.table.stop()
