"""A table in the place of the operator: it makes the turn that the coach requests, leads the closure run, and is compared with the sensor.

The guide finds stills and turns in the samples, as of a hand's turns.  The machine's word only shows when it has arrived.  What it reports
of its angles is held against gyroscope and gravity in each still.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.errors import CalibrationError
from session.base.rotation import angle_between
from session.base.units import DEG, NS
from session.bench.events import Event
from session.bench.guide import MARK, RUN, ClosureGuide, Guide, Moment
from session.bench.messages import AxisMove, GuideMessage, Kind, Stage
from session.detect.segments import angle_read
from tinygc.features.tables.machines.angles import AngleFile
from tinygc.features.tables.machines.description import Description, attitudes, body_axes
from tinygc.features.tables.machines.link import PRESS, TableFault, TableLimit, Where
from tinygc.features.tables.machines.safety import REST_S, Guarded

if TYPE_CHECKING:
    from tinygc.features.tables.planner import TableMoves


# The thread that owns a table during a recording: it asks where the table is, writes ``table.csv``, and makes moves one after the other.
#
# Verbs and answers pass through one thread, so that no answer is taken for another's; only ``stop`` comes from outside.  ``tick`` is one
# round: a question, a row, and the next verb where the one before has ended.  A fault ends all moves; ``clear`` asks the table again.

EVERY_S = 0.05  #: between two questions: 20 Hz
#: arrivals that the device's time is taken from, s; bytes are late by some ms and never early
ARRIVALS_S = 20.0
#: s of arrivals that show how fast the device's clock runs; steps to the line, which takes two or three
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

    where: the last answer, None before the first; fault: why nothing moves, empty if nothing is wrong.
    """

    def __init__(self, table: Guarded, file: AngleFile, now_s: Callable[[], float] = time.monotonic, in_thread: bool = True):
        self.table, self._file, self.now_s = table, file, now_s
        self.where: Where | None = None
        self.fault = ""
        self.trouble: CalibrationError | None = None  #: what ended the thread
        self._log, self._device = "", _DeviceTime()
        self._queue: deque[AxisMove] = deque()
        self._sent: AxisMove | None = None
        self._halted, self._requested_s = False, -EVERY_S
        self._uncommanded_s: float | None = None  # since when it moves though it got no command
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="table", daemon=True) if in_thread else None
        if self._thread is not None:
            self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether moves are under way or to come, by what was sent and by what the table answers.  It never waits for an answer."""
        where = self.where
        return bool(self._queue) or self._sent is not None or (where is not None and where.moving)

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

    def stop(self) -> None:
        """Bring all axes to rest at once, and forget all moves.  It may be called from any thread."""
        self._halted = True  # without the lock, which a late answer may hold
        self._queue.clear()
        self._sent = None
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
            self._request(self._round)

    def tick_if_alone(self) -> None:
        """The round of a driver without a thread."""
        if self._thread is None and self.now_s() - self._requested_s >= EVERY_S:
            self._requested_s = self.now_s()
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
            except CalibrationError as error:  # a full disk: whoever leads the recording reports it
                self.trouble = error
                self.stop()
                return

    def _request(self, verb: Callable[[], None]) -> None:
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
        requested_s = self.now_s()
        self.where = where = self.table.where()
        t_s = self._device.at((requested_s + self.now_s()) / 2)  # at what time between the two it answered is not known
        if t_s is not None:
            self._file.add(self._log, round(t_s * 1e6), where)
        if not (where.moving and self.table.is_at_rest):
            self._uncommanded_s = None
        elif self._uncommanded_s is None:
            self._uncommanded_s = self.now_s()
        elif self.now_s() - self._uncommanded_s > REST_S:
            self._uncommanded_s = None
            raise TableFault(f"{self.table.description.name}: it moves without a command; it was ordered to stop")
        if self._sent is not None and not where.moving:
            self._sent = None
        if self._queue and self._sent is None and not where.moving:
            try:
                self._sent = move = self._queue[0]  # before it leaves the queue: ``busy`` sees it in either place
                self._queue.popleft()
            except IndexError:  # stopped meanwhile
                self._sent = None
                return
            self._send(lambda: self.table.turn_to(move.axis, move.angle_rad, move.rate_rps))

    def _send(self, verb: Callable[[], None]) -> None:
        """A verb that moves; a stop that comes meanwhile is the last word."""
        if not self._halted:
            verb()
        if self._halted:
            self._sent = None
            self.table.stop()


# The machine's word against the sensor: where each still should lie by its angles, and how far each turn should have gone.
#
#     force of a still:  u = F p,  p = -R_tb(angles)^T e_z       F: the mounting's error, from the stills before (Kabsch)
#     turn:              the gyroscope's angles about the body's axes, against Log(R_tb(before)^T R_tb(after))
#
# The gyroscope is not calibrated yet and the mounting is known to a degree or so.  So small errors of either cannot be found here; those
# are for ``explain``.  What is found is a machine that does not do what it reports.

#: one sigma of what a gyroscope reads of a turn before it is calibrated, of its angle
SCALE_SIGMA = 0.02
#: rad, of gravity's direction: before any still has shown the mounting; with it; more with an accelerometer that is not calibrated
MOUNTING_SIGMA_RAD, TILT_SIGMA_RAD, RAW_TILT_SIGMA_RAD = 2.5 * DEG, 0.5 * DEG, 1.2 * DEG
SIGMAS = 4.0  #: beyond so many a contradiction is no chance
FEWEST = 3  #: stills that show the mounting
STALLED = 0.1  #: of the angle: less is no turn
LEAST_RAD = 5 * DEG  #: a smaller turn is not compared
#: cosine: turns about axes further apart are about different ones
SAME_AXIS = np.cos(20 * DEG)


class WordAgainstSensor:
    """``still`` after each still of the guide; returns contradictions, each in words."""

    def __init__(self, table: Description):
        self._table = table
        self._stills: list[tuple[np.ndarray, np.ndarray]] = []  # predicted and measured up, (3,) unit
        self._before: np.ndarray | None = None  # angles in the still before

    def interrupted(self) -> None:
        """The turn to the next still was not followed."""
        self._before = None

    def begin_again(self) -> None:
        """The machine's angles have another origin from here on."""
        self._stills, self._before = [], None

    def still(self, angles: np.ndarray, accel: np.ndarray, turned: np.ndarray | None, raw: bool = False) -> list[str]:
        """Compare a still: angles (K,) rad that the machine reports, accel (3,) measured; turned (3,) rad that the gyroscope saw on the way
        from the still before, None where it was not followed; raw: whether the accelerometer is not calibrated."""
        attitude = attitudes(self._table, angles[None])[0]
        up, measured = -attitude[2], accel / np.linalg.norm(accel)
        turn = "" if self._before is None or turned is None else self._of_turn(self._before, angles, turned)
        found = [*filter(None, (turn, self._of_gravity(up, measured, raw)))]
        if found:
            self.begin_again()
        self._stills.append((up, measured))
        self._before = np.array(angles, dtype=float)
        return found

    def _of_gravity(self, up: np.ndarray, measured: np.ndarray, raw: bool) -> str:
        predicted, sigma = up, MOUNTING_SIGMA_RAD
        if len(self._stills) >= FEWEST:
            before = np.array(self._stills)
            if np.linalg.svd(before[:, 0])[1][1] > 0.5:  # not all about one direction
                predicted = Rotation.align_vectors(before[:, 1], before[:, 0])[0].apply(up)
                sigma = TILT_SIGMA_RAD
        declared = [axis.sigma_rad**2 + (axis.backlash_rad / 2) ** 2 for axis in self._table.axes]
        sigma = float(np.sqrt(sigma**2 + (RAW_TILT_SIGMA_RAD**2 if raw else 0.0) + sum(declared)))
        apart = float(angle_between(predicted, measured))
        if apart <= SIGMAS * sigma:
            return ""
        way = (
            "upside down: is mounting the rotation from the sensor to the table?"
            if apart > 150 * DEG
            else "lost steps, or a wrong mounting"
        )
        return f"gravity lies {apart / DEG:.1f} deg from where the machine's angles put it ({SIGMAS * sigma / DEG:.1f} at most): {way}"

    def _of_turn(self, before: np.ndarray, after: np.ndarray, turned: np.ndarray) -> str:
        changes = np.abs(after - before)
        moved = np.flatnonzero(changes > LEAST_RAD)
        seen, reported_rad = float(np.linalg.norm(turned)), float(changes.sum())
        if not len(moved):
            return "" if seen < LEAST_RAD else f"the gyroscope turned by {seen / DEG:.0f} deg, and the machine reports that it rested"
        names = " and ".join(self._table.axes[k].name for k in moved)
        if seen < STALLED * float(changes.max()):
            far = f"the machine reports {reported_rad / DEG:.0f} deg, the gyroscope saw {seen / DEG:.1f}"
            return f"{names}: {far}: it is stalled, or its coupling slips"
        if len(moved) > 1:  # the sum of two turns is compared by the attitude alone
            return ""
        (axis,) = moved
        change = float(after[axis] - before[axis])
        along = float(turned @ body_axes(self._table, after[None])[0, axis]) * np.sign(change)
        if along < -SAME_AXIS * seen:
            return f"{names}: the gyroscope turned the other way round: the sign of the axis, or the mounting, is wrong"
        if along < SAME_AXIS * seen:
            return f"{names}: the gyroscope turned about another axis: direction or mounting is wrong in table.toml"
        of = self._table.axes[axis]
        sigma = float(np.sqrt((SCALE_SIGMA * change) ** 2 + of.sigma_rad**2 * 2 + of.backlash_rad**2))
        if abs(seen - abs(change)) > SIGMAS * sigma:
            return f"{names}: the machine reports {abs(change) / DEG:.1f} deg, the gyroscope saw {seen / DEG:.1f}: lost steps?"
        return ""


#: without samples while the table moves, s: no one sees what it does
BLIND_S = 2.0
#: contradictions in a row that pause the recording
MOST_CONTRADICTIONS = 3
#: s that a machine at rest may keep the guide waiting for a turn, or a still, before it makes another move
NO_TURN_S, NO_STILL_S = 6.0, 30.0
#: share of the sensor's full scale that a move may reach
MOST_OF_SCALE = 0.6
PAUSE = Event("pause")
THE_TABLE_TURNS = "hands off: the table turns"
PUT_RIGHT = (
    "look at the table, put it right there, then p goes on "
    "(where a command must do it, or angles are lost: Ctrl-C, `table clear` if need be, then --resume with --home)"
)


class TableMover:
    """The mover of a recording (``session.bench.guide.Mover``): makes its turns, and reports faults and pauses."""

    def __init__(self, driver: TableDriver, moves: TableMoves):
        self.driver, self._moves = driver, moves
        self.wants: Event | None = None
        self._stopped = False  # by the operator, a fault, or contradictions: until the recording goes on
        self._was_paused = False
        self._messages: list[GuideMessage] = []
        self._now_s = 0.0
        self._word = WordAgainstSensor(driver.table.description)
        self._stills: int | None = None  # of the guide, that were compared
        self._log, self._begun_ns = "", 0  # of the last still that was compared, and about when it began
        self._contradictions = 0  # in a row
        self._made_s: float | None = None  # when the last move had ended, and no still has followed
        self._mark: np.ndarray | None = None  # angles of the closure run's mark

    def step(self, guide: Guide, moment: Moment | None, coaching: bool) -> list[GuideMessage]:
        """One round of the recording."""
        self._messages, self.wants, self._now_s = [], None, guide.now_s
        driver, paused = self.driver, guide.stage is Stage.PAUSED
        if driver.trouble is not None:
            raise driver.trouble
        if moment is not None:
            driver.heard(moment)
        driver.tick_if_alone()
        if self._was_paused and not paused:
            driver.clear()
            self._stopped, self._contradictions, self._made_s = False, 0, None
            self._word.interrupted()
        self._was_paused = paused
        if driver.fault and not self._stopped:
            self._halt(f"the table is stopped: {driver.fault}")
        else:
            self._round(guide, moment, coaching)
        return self._messages

    def stop(self) -> None:
        """Bring the table to rest at once."""
        self.driver.stop()
        self._stopped = True
        self._word.interrupted()

    def close(self) -> None:
        """Bring the table to rest and let go of it."""
        self.driver.close()

    def _halt(self, why: str) -> None:
        """Stop, and pause until somebody has looked at it."""
        self.stop()
        self.wants = PAUSE
        self._say(f"{why}; {PUT_RIGHT}")

    def _say(self, text: str) -> None:
        self._messages.append(GuideMessage(Kind.WARNING, text, self._now_s))

    def _round(self, guide: Guide, moment: Moment | None, coaching: bool) -> None:
        driver = self.driver
        guide.any_turn = THE_TABLE_TURNS
        blind = moment is not None and driver.now_s() - moment.host_ns * NS > BLIND_S
        if driver.busy and blind and not self._stopped:  # it goes on when the guide has seen a still
            driver.stop()
            self._word.interrupted()
            guide.waits(Stage.CHECK_STREAM, "no samples while the table moves")
            self._say(f"no samples for {BLIND_S:g} s while the table moves: it is stopped, and goes on with them")
        if driver.busy:
            self._made_s = None if self._made_s is None else driver.now_s()
        elif driver.where is not None:
            self._moves.angles = driver.where.angles
        self._compare(guide, moment)
        if driver.where is not None and not self._stopped and not driver.busy and guide.stage is not Stage.PAUSED:
            try:
                self._turn(guide, coaching)
            except TableLimit as error:
                self._halt(str(error))

    def _compare(self, guide: Guide, moment: Moment | None) -> None:
        """Hold the machine's word against each new still."""
        stills, driver = guide.taken.stills, self.driver
        if self._stills is None:
            self._stills = len(stills)
        if len(stills) == self._stills or driver.where is None or driver.busy or moment is None:
            return
        last = guide.taken.turns[-1] if guide.taken.turns else None
        followed = last is not None and len(stills) == self._stills + 1 and moment.log == self._log and last.segment.stills[1] is stills[-1]
        if followed and last is not None:  # seen again it may be no still: then the segment holds the turn before it too
            ended = last.segment.stills[0].stop - 1 - last.segment.start
            followed = int(last.samples.t_ns[ended]) > self._begun_ns
        if moment.log != self._log:
            self._word.interrupted()
        self._stills, self._log, self._made_s = len(stills), moment.log, None
        self._begun_ns = moment.t_us * 1000 - round(stills[-1].duration_s / NS)
        turned = None
        if followed and last is not None:
            turned = angle_read(last.samples, replace(last.segment, start=0, stop=len(last.samples)))
        force, raw = guide.taken.corrected(stills[-1].accel_mean), guide.taken.own is not None
        found = self._word.still(driver.where.angles, force, turned, raw)
        self._contradictions = self._contradictions + 1 if found else 0
        for words in found:
            self._say(words)
        if self._contradictions >= MOST_CONTRADICTIONS:
            self._halt(f"{self._contradictions} stills in a row contradict the machine")

    def _turn(self, guide: Guide, coaching: bool) -> None:
        """Begin what the guide waits for; the table is at rest."""
        if guide.stage is Stage.CLOSURE and guide.closure is not None:
            self._close_run(guide, guide.closure)
        elif guide.stage is Stage.TURN and not guide.turning:
            advice = guide.requested
            if self._made_s is not None and not self._waited(NO_TURN_S):
                return  # its still has yet to come
            if self._made_s is not None:
                # The machine reports that it has turned, and no turn was seen
                self._contradictions += 1
                self._say("the machine reports that it has turned, and the gyroscope saw nothing: it is stalled, or its coupling slips")
                if self._contradictions >= MOST_CONTRADICTIONS:
                    self._halt(f"{self._contradictions} moves in a row were not seen by the sensor")
            elif advice is None and (coaching or (guide.coached and guide.awaits_advice)):
                return
            moves = advice.moves if advice is not None and advice.moves else self._moves.choose(self._most_rps(guide))
            if not self._stopped:
                self.driver.make(moves)
                self._made_s = self.driver.now_s()
        elif guide.stage is Stage.HOLD_STILL and self._made_s is not None and self._waited(NO_STILL_S):
            self._made_s = self.driver.now_s()
            self._say(f"no still for {NO_STILL_S:g} s although the table is at rest: {guide.objection or guide.here.why or 'it trembles'}")

    def _waited(self, seconds: float) -> bool:
        return self._made_s is not None and self.driver.now_s() - self._made_s > seconds

    @staticmethod
    def _most_rps(guide: Guide) -> float:
        return MOST_OF_SCALE * guide.taken.gyro_fs_rps

    def _close_run(self, guide: Guide, closure: ClosureGuide) -> None:
        """Onto the mark, which is where the table stands; through attitudes; back."""
        assert self.driver.where is not None
        angles = self.driver.where.angles
        if closure.step == MARK:
            self._mark = angles.copy()
            closure.on_the_mark()
        elif closure.step == RUN and self._mark is not None:
            rate = self._most_rps(guide)
            if not closure.enough:
                self.driver.make(self._moves.choose(rate))
                return
            axes = self.driver.table.description.axes
            away = self._mark - angles
            back = away - np.where([axis.is_endless for axis in axes], 2 * np.pi * np.round(away / (2 * np.pi)), 0.0)
            self.driver.make(
                [
                    AxisMove(k, float(angles[k] + each), min(rate, axes[k].fastest_rps))
                    for k, each in enumerate(back.tolist())
                    if abs(each) > 0.01 * DEG
                ]
            )
