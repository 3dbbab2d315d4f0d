"""A table of a make that is data: requests, answers, and all that a line does to them, behind the five verbs.

A verb that moves starts the motion and returns; ``where`` states when it has ended.  Nothing here moves without ``safety.Guarded``, which
checks limits before each move.  All verbs raise TableFault where the table does not answer, and for a fault that it reports.

A request is sent whole, then its acknowledgement is awaited; what else comes meanwhile is looked at: an alarm, a restart, an error.  Bytes
that are left from earlier answers (late, doubled) are thrown away before a request.  ``stop`` waits for no one: it writes at once, from any
thread, and a motion whose requests are half sent ends there.
"""

from __future__ import annotations

import threading

import numpy as np

from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import AGAIN, Description
from tinygc.features.tables.machines.link import SerialLink, TableFault, TableLimit, Where
from tinygc.features.tables.machines.makefile import LONGEST_LINE, UNKNOWN, Make, Pattern, Step, matched
from tinygc.features.tables.machines.proof import request_text, require_travel, sent_text

#: how often ``where`` asks again where an answer is missing or garbled
TRIES = 3
#: bytes of a line that has no end
LONGEST_BUFFER = 4096
#: behind a line that is no answer, one is waited for so long
AGAIN_S = 0.25
#: behind an answer, its acknowledgement comes within so long
ACKNOWLEDGED_S = 0.5
#: deg by which an angle at rest may change; a slow rate passes it within ``same_s``
RESOLUTION_DEG = 0.01
#: how long the acknowledgement of a stop is waited for: for the line to be free, and for its bytes
STOP_S, POLL_STOP_S = 0.3, 0.05
#: that a state is waited for while it is stopped
STATE_S = 0.2


class Dialogue:
    """A table over a link, of a make that is fitted to it (``proof.fitted``).  Opening sends nothing; with ``stops`` a stop, at once.

    has_rate_mode: whether it turns at a rate by itself; angles_lost: it has restarted, and was not homed since; warning: what whoever lets
    it move must know.
    """

    def __init__(self, description: Description, make: Make, link: SerialLink, clock: Clock, stops: bool = False):
        self.description, self.make, self._link, self._clock = description, make, link, clock
        self.has_rate_mode, self.angles_lost, self.warning = bool(make.requests.turn_at), False, make.warning
        self._settings = make.settings
        self._exchange, self._writing = threading.RLock(), threading.Lock()
        self._buffer, self._lines = b"", list[str]()
        self._stops, self._harder = 0, 0
        self._stopping: Step | None = None  # what of a stop was written, while it goes on
        self._unread_motion = False  # whether a motion was sent that is not acknowledged yet: it may not even be read
        self._awaited_home: float | None = None  # when homing counts as failed, where its acknowledgements come at its end
        self._due = 0  # of these
        self._alarm, self._restarted, self._only_looks = "", False, False
        self._begun = not make.requests.begin
        self._answered, self._unread = "", ""  # the last lines that were an answer, and none
        self._angles = np.full(len(description.axes), np.nan)
        self._before: tuple[float, np.ndarray] | None = None
        with self._exchange:
            self._open(stops)

    @property
    def begins(self) -> str:
        """What ``begin`` will send, as text; empty where there is nothing, or it was sent."""
        return "" if self._begun else sent_text(self.description, self.make, self.make.requests.begin)

    def begin(self) -> None:
        """Send what it wants before its first motion, such as to switch its motors on; nothing the second time."""
        with self._exchange:
            if not self._begun:
                self._forget_restart()
                self._requests(self.make.requests.begin)
                self._begun = True

    def require_rate(self, axis: int, rate_rps: float) -> None:
        """TableLimit for a rate (either sign) that the decimals of its requests make 0."""
        settings = self._settings
        if not round(abs(rate_rps) / DEG * settings["rate_per_dps"], int(settings["decimals"])):
            least = 10.0 ** -settings["decimals"] / settings["rate_per_dps"]
            what = f"{self.description.axes[axis].name} at {rate_rps / DEG:g} dps"
            raise TableLimit(f"{self.description.name}: {what} would be sent as 0, expected {least:.3g} dps or more; nothing was moved")

    def require_travel(self) -> None:
        """TableLimit where the controller's own settings do not fit the description; TableFault where it does not report them."""
        if (controller := self.make.controller) is None:
            return
        for step in controller.ask:
            with self._exchange:
                self._receive(0.0)
                self._hear((), 0.0)
                with self._writing:
                    self._write(step)
                values = dict[int, float]()
                while found := self._hear((*step.answers, *self.make.line.done), self._settings["answer_s"]):
                    if found["code"].isdigit():
                        values[int(found["code"])] = float(found["count"])
            if found is None:
                raise TableFault(self._complaint("does not report its settings", step, step.answers))
            require_travel(self.description, self.make, controller, values)

    # The five verbs.

    def home(self) -> None:
        """Begin to search the reference marks."""
        if not self.make.requests.home:
            raise TableFault(f"{self.description.name}: a {self.make.name} has no homing; turn it to its zero by hand")
        with self._exchange:
            self._forget_restart()
            self._refuse_alarm()
            count = len(self.description.axes)
            if due := sum(len(step.axes(count)) for step in self.make.requests.home if step.later):
                self._awaited_home, self._due = self._clock.now_s() + self._settings["home_s"], due
            self._motion(self.make.requests.home)

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Begin to turn one axis to an angle."""
        self._motion(self.make.requests.turn_to, axis, angle_rad, rate_rps)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn one axis at a rate: only where it has a rate mode."""
        self._motion(self.make.requests.turn_at, axis, 0.0, rate_rps)

    def where(self) -> Where:
        """Ask for angles and state.  TableFault for an alarm, a restart, a state that is a fault, and where no answer can be read."""
        with self._exchange:
            self._refuse_alarm()
            if self._awaited_home is not None and (busy := self._where_while_busy()) is not None:
                return busy
            for number in range(TRIES):
                found = self._ask_where()
                if found is not None:
                    return found
                if number + 1 < TRIES:
                    self._clock.sleep(0.05)
            raise TableFault(
                self._complaint("does not report where it is", self.make.requests.where[0], self.make.requests.where[0].answers)
            )

    def look(self) -> np.ndarray:
        """Angles (K,) rad, whatever else it reports: to see whether it rests after a fault.  TableFault where it reports none."""
        with self._exchange:
            self._only_looks = True
            try:
                for _ in range(TRIES):
                    if (found := self._ask_where()) is not None:
                        return found.angles
            finally:
                self._only_looks = False
        raise TableFault(f"{self.description.name}: does not report where it is")

    def stop(self) -> None:
        """Bring all axes to rest.  Called again before another motion, it asks harder, where the make has a harder way.

        A request with ``states`` is repeated while one of them is reported, or while a motion may not be read yet, for as long as braking
        takes.  The harder request follows then, or at once where another motion or no state is reported; within one list, nothing waits.
        A list without ``states`` is written at once, and again while a motion may not be read yet.
        """
        try:
            self._stop()
        finally:
            self._stopping = None
        self._awaited_home = None
        self._before = None

    def _stop(self) -> None:
        hardest = len(self.make.requests.stop) - 1
        homes = self._awaited_home is not None  # a controller may then hear the hardest alone
        level, state = hardest if homes else min(self._harder, hardest), ""
        while True:
            self._harder = level + 1
            steps, end_s, unread = self.make.requests.stop[level], self._clock.now_s() + self._settings["answer_s"], True
            while unread:
                unread = not level and self._unread_motion and self._clock.now_s() < end_s
                for step in steps:
                    if not (homes and step.states):
                        self._write_stop(step)
                        state = self._follow(step, step is not steps[-1]) if step.states else ""
                if steps[-1].states:
                    break
                self._hear_stop(steps[-1])
            level += 1
            if level > hardest or not steps[-1].states or (state and state not in self.make.states.moving):
                return

    def _write_stop(self, step: Step) -> None:
        with self._writing:
            self._stops += 1
            self._stopping = step
            for axis in step.axes(len(self.description.axes)):
                self._write(step, axis)
            self._clock.sleep(step.pause_s)

    def _follow(self, step: Step, patient: bool) -> str:
        """Repeat a request, as ``stop`` describes; return the last reported state, empty without one."""
        begin_s, state = self._clock.now_s(), ""
        while True:
            if heard := self._exchange.acquire(timeout=POLL_STOP_S):  # else another thread asks
                try:
                    state = self._state()
                finally:
                    self._exchange.release()
            longest_s = self.description.braking_s + (self._settings["answer_s"] if self._unread_motion else STOP_S)
            if self._clock.now_s() - begin_s > longest_s:
                return state
            if heard and not self._unread_motion and state not in step.states and (state or not patient):
                return state
            self._clock.sleep(POLL_STOP_S)
            self._write_stop(step)

    def _hear_stop(self, step: Step) -> None:
        """Read the answers to a stop, so that they are not taken for answers to a later request."""
        if self._exchange.acquire(timeout=STOP_S):
            try:
                self._hear(step.answers, self._settings["answer_s"] if step.answers else POLL_STOP_S)
            finally:
                self._exchange.release()

    def _state(self) -> str:
        """The reported state, of a moving axis if one moves; empty where none arrives in time."""
        asks = (step for step in self.make.requests.where if any("state" in pattern.fields for pattern in step.answers))
        if (step := next(asks, None)) is None:
            return ""
        for axis in step.axes(len(self.description.axes)):
            with self._writing:
                self._write(step, axis)
            if (state := (self._hear(step.answers, STATE_S) or {}).get("state", "")) in self.make.states.moving:
                break
        return state

    def _hear(self, wanted: tuple[Pattern, ...], longest_s: float) -> dict[str, str] | None:
        """The fields of the first line that is wanted, and None where none comes; all others are noticed, and nothing is raised."""
        end_s = self._clock.now_s() + longest_s
        while True:
            self._receive(min(POLL_STOP_S, longest_s))
            while self._lines:
                line = self._lines.pop(0)
                ends = matched((*self.make.line.done, *self.make.line.greeting), line) is not None
                self._unread_motion = self._unread_motion and not ends and self.make.refused.meaning(line) is None
                if (found := matched(wanted, line)) is not None:
                    return found
                self._notice(line)
            if self._clock.now_s() >= end_s:
                return None

    def close(self) -> None:
        """Let go of the port."""
        self._link.close()

    def clear(self) -> None:
        """Clear an alarm, where a program can: only when a person has confirmed it.  TableFault where it stays."""
        if not self.make.requests.clear:
            raise TableFault(f"{self.description.name}: an alarm of a {self.make.name} is cleared at the machine, not from here")
        with self._exchange:
            if self._awaited_home is not None or self._state() in self.make.states.moving:
                raise TableFault(f"{self.description.name}: it moves; stop it before you clear anything")
            alarm, self._alarm = self._alarm, ""
            try:
                self._requests(self.make.requests.clear)
                self._require_accepted()
            except TableFault:
                self._alarm = alarm
                raise

    def forget_alarm(self) -> None:
        """A person has dealt with it at the machine: what it answers from now on counts.  Angles that a restart has lost stay lost."""
        with self._exchange:
            if not self._restarted:
                self._alarm = ""

    # Requests.

    def _open(self, stops: bool) -> None:
        if stops:
            self.stop()
            self._harder = 0
        end_s = self._clock.now_s() + self._settings["open_s"]
        while self._clock.now_s() < end_s:
            self._receive(min(0.1, end_s - self._clock.now_s()))
            if self._heard_greeting():
                break
        self._receive(0.05)
        self.angles_lost = self._heard_greeting()  # it has restarted, as many do when their port is opened
        self._lines.clear()

    def _heard_greeting(self) -> bool:
        return any(matched(self.make.line.greeting, line) is not None for line in self._lines)

    def _motion(self, steps: tuple[Step, ...], axis: int = 0, angle_rad: float = 0.0, rate_rps: float = 0.0) -> None:
        with self._exchange:
            self._refuse_alarm()
            self._harder = 0
            self._before, self._unread_motion = None, bool(self.make.line.done)
            self._requests(steps, axis, angle_rad, rate_rps)
            self._unread_motion = False
            self._require_accepted()

    def _require_accepted(self) -> None:
        """TableFault where the make keeps errors until it is queried, and has one."""
        for ask in self.make.errors.ask[:1]:
            found = next((found for _ in range(TRIES) if (found := self._request(ask, 0))), None)
            if found is None:
                raise TableFault(self._complaint("does not report whether it takes the request", ask, ask.answers))
            if (code := found["code"]) not in self.make.errors.none:
                words = {**self.make.alarms.words, **self.make.refused.words}.get(code, UNKNOWN)
                raise TableFault(f"{self.description.name}: it refuses with {code} ({words}); nothing more was sent")

    def _requests(self, steps: tuple[Step, ...], axis: int = 0, angle_rad: float = 0.0, rate_rps: float = 0.0) -> None:
        stops = self._stops
        for step in steps:
            for number in step.axes(len(self.description.axes), axis):
                self._drain()
                with self._writing:
                    text = self._write(step, number, angle_rad, rate_rps, stops)
                if step.pause_s:
                    self._clock.sleep(step.pause_s)
                if step.answers and self._await(step, step.answers, text) is None:
                    raise TableFault(self._complaint("answers something else", step, step.answers))
                if not (step.later or step.unanswered or step.raw) and self.make.line.done:
                    self._await(step, self.make.line.done, text)

    def _write(self, step: Step, axis: int = 0, angle_rad: float = 0.0, rate_rps: float = 0.0, stops: int | None = None) -> str:
        """Send a request, and return it; stops: how many there were before, beyond which it is not sent."""
        text = request_text(step, self._settings, self.description.axes[axis].word, axis, angle_rad, rate_rps)
        if stops not in (None, self._stops):
            self._unread_motion = False
            raise TableFault(f"{self.description.name}: stopped before {text!r} was sent")
        self._link.write((text if step.raw else text + self.make.line.end).encode("latin-1"))
        return text

    # Answers.

    def _receive(self, longest_s: float) -> None:
        """Take what has come, and keep its whole lines."""
        self._buffer += self._link.read(longest_s)
        text = self._buffer.replace(b"\r", b"\n")
        if prompt := self.make.line.prompt.encode("latin-1"):
            text = text.replace(prompt, b"\n" + prompt + b"\n")
        *lines, self._buffer = text.split(b"\n")
        self._buffer = self._buffer[-LONGEST_BUFFER:]
        for line in lines:
            if reported := line.decode("latin-1").strip()[:LONGEST_LINE]:
                self._lines.append(reported)

    def _drain(self) -> None:
        """Throw away what is left of earlier answers, except what states that something is wrong."""
        self._receive(0.0)
        for line in self._lines:
            self._notice(line)
        self._lines.clear()
        self._refuse_alarm()

    def _notice(self, line: str) -> None:
        """What a line means by itself: an alarm, a restart, the end of homing."""
        make, name = self.make, self.description.name
        greets = matched(make.line.greeting, line) is not None
        if greets or make.alarms.meaning(line) is not None:
            self._unread_motion = False
        if self._stopping is not None and matched(self._stopping.answers, line) is not None:
            return  # which another thread's question has come across
        if (meaning := make.alarms.meaning(line)) is not None:
            self._alarm = f"{name}: the table reports {line!r}: {meaning or 'it has stopped'}; see why, then `table clear` or `table home`"
        elif greets:
            if self._alarm and not self._restarted:  # a restart does not end an emergency stop
                return
            self._restarted = self.angles_lost = True
            self._begun = not make.requests.begin
            self._alarm = f"{name}: the controller has restarted ({line!r}): its angles are lost; home it"
        elif self._awaited_home is not None:
            if (meaning := make.refused.meaning(line)) is not None:
                self._awaited_home = None
                self._alarm = f"{name}: homing was refused with {line!r} ({meaning})"
            elif matched(make.line.done, line) is not None:
                self._due -= 1
                self._awaited_home = self._awaited_home if self._due else None

    def _forget_restart(self) -> None:
        """Before homing: nothing but its angles is lost."""
        if self._restarted:
            self._alarm, self._restarted = "", False

    def _refuse_alarm(self) -> None:
        if self._alarm and not self._only_looks:
            raise TableFault(self._alarm)

    def _await(
        self, step: Step, wanted: tuple[Pattern, ...], sent: str, word: str = "", longest_s: float | None = None
    ) -> dict[str, str] | None:
        """The fields of the first line that is wanted; None where only other lines came, and behind longest_s.

        TableFault for errors, and for silence of ``answer_s``.
        """
        end_s, seen = self._clock.now_s() + (self._settings["answer_s"] if longest_s is None else longest_s), list[str]()
        while True:
            while self._lines:
                line = self._lines.pop(0)
                if (found := matched(wanted, line, word)) is not None:
                    self._answered = line
                    return found
                self._notice(line)
                self._refuse_alarm()
                if (meaning := self.make.refused.meaning(line)) is not None:
                    self._unread_motion = False
                    raise TableFault(f"{self.description.name}: {sent!r} was refused with {line!r} ({meaning})")
                if step.answers:  # an answer that is garbled: ask again soon
                    end_s = min(end_s, self._clock.now_s() + AGAIN_S)
                seen.append(line)
                self._unread = line
            if (left_s := end_s - self._clock.now_s()) <= 0:
                if longest_s is not None or (step.answers and seen):
                    return None
                raise TableFault(self._complaint("does not answer", step, wanted, sent, seen))
            self._receive(min(left_s, 0.1))

    def _complaint(self, what: str, step: Step, wanted: tuple[Pattern, ...], sent: str = "", seen: list[str] | None = None) -> str:
        expected = " or ".join(repr(pattern.text) for pattern in wanted[:2])
        line = seen[-1] if seen else self._unread
        heard = f"heard {line[:60]!r}" if line else "heard nothing that can be read"
        settings = f"within {self._settings['answer_s']:g} s"
        silent = f"; {self.make.states.silent}" if self.make.states.silent and not line else ""
        return (
            f"{self.description.name}: it {what}: sent {sent or step.send or step.raw!r}, {heard}, expected {expected} {settings}{silent}"
        )

    def _request(self, step: Step, axis: int) -> dict[str, str]:
        """A query's fields; empty where its answer cannot be read."""
        self._drain()
        with self._writing:
            text = self._write(step, axis)
        found = self._await(step, step.answers, text, self.description.axes[axis].word) or {}
        if found and self.make.line.done and not (step.raw or step.unanswered):
            answered = self._answered
            self._await(step, self.make.line.done, text, longest_s=ACKNOWLEDGED_S)  # else it would be taken for the next request's
            self._answered = answered
        return found

    # Where it is.

    def _where_while_busy(self) -> Where | None:
        """While homing keeps it from answering (GRBL): the last angles; None once its acknowledgements came."""
        self._receive(0.05)
        self._drain()
        if self._awaited_home is not None and self._clock.now_s() > self._awaited_home:
            raise TableFault(f"{self.description.name}: homing does not end within {self._settings['home_s']:g} s")
        return None if self._awaited_home is None else Where(self._angles, True)

    def _ask_where(self) -> Where | None:
        """One round of questions; None where an answer cannot be read."""
        make, axes, settings = self.make, self.description.axes, self._settings
        angles, table_s = np.full(len(axes), np.nan), None
        moving: bool | None = None
        for step in make.requests.where:
            once = None
            for axis, of in enumerate(axes):
                if step.each or once is None:
                    once = self._request(step, axis)
                    answered = self._answered
                elif any("word" in pattern.fields for pattern in step.answers):
                    once = matched(step.answers, answered, of.word)
                if not once:
                    return None
                if "angles" in once:
                    values = once["angles"].split(",")
                    place = make.states.order.index(of.word) if make.states.order else axis
                    if place >= len(values):
                        raise TableFault(f"{self.description.name}: it reports {len(values)} angles, and no {of.word}; {AGAIN}")
                    once = once | {"angle": values[place]}
                for name, unit in (("count", "count_per_deg"), ("angle", "per_deg")):
                    if name in once:
                        angles[axis] = float(once[name]) / settings[unit] * DEG
                if "rate" in once:
                    moving = bool(moving) or abs(float(once["rate"]) / settings["rate_per_dps"]) > settings["rest_dps"]
                if "state" in once and not self._only_looks:
                    if (state := self._is_moving(once["state"])) is None:
                        self._unread = self._answered
                        return None
                    moving = bool(moving) or state
                if "clock" in once:
                    table_s = float(once["clock"]) / settings["clock_per_s"]
                if (fault := once.get("fault", make.errors.none[0])) not in make.errors.none and not self._only_looks:
                    meaning = make.alarms.words.get(fault, UNKNOWN)
                    self._alarm = f"{self.description.name}: the table reports {fault}: {meaning}; see why, then `table clear`"
                    raise TableFault(self._alarm)
        if not np.isfinite(angles).all():
            return None
        now_s = self._clock.now_s()
        if moving is None:
            moving = self._is_changing(now_s, angles)
        self._angles = angles
        return Where(angles, moving, table_s)

    def _is_moving(self, state: str) -> bool | None:
        """Whether a state is motion; None of one that the make's file does not know.  TableFault of one that is a fault."""
        make = self.make
        if state in make.states.faults and self._stopping is None:  # else it may be of our own stop
            raise TableFault(f"{self.description.name}: the table is in state {state}: {make.states.faults[state]}")
        return state not in make.states.rest if state in (*make.states.moving, *make.states.rest, *make.states.faults) else None

    def _is_changing(self, now_s: float, angles: np.ndarray) -> bool:
        """Where nothing else decides it: whether angles have stayed for ``same_s``."""
        counts = any("count" in pattern.fields for step in self.make.requests.where for pattern in step.answers)
        resolution = DEG * max(1.5 / abs(self._settings["count_per_deg"]) if counts else 0.0, RESOLUTION_DEG)
        if self._before is None or np.abs(angles - self._before[1]).max() > resolution:
            self._before = (now_s, angles)
            return True
        return now_s - self._before[0] < self._settings["same_s"]
