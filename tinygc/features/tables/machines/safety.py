"""The one way to move a table: ``Guarded``.  What a program can do against a wrong move; no safety function in a standard's sense.

- Nothing moves that no person has confirmed: the plan of all moves is shown before the first.
- Limits are checked before each move.  A turn at a rate is confirmed with its longest time.  Where the axis has limits or the machine has
  no rate mode it is sent as a turn to an angle: the machine brakes there by itself, whatever becomes of this program.
- A controller that has restarted has lost its angles, and its limits mean nothing: it is homed, or a person confirms that it stands at
zero. - Each answer is compared with what can be: an angle beyond the limits, a wrong sense or rate, a motion that does not end, that ends
  elsewhere, and silence stop the table.
- Ctrl-C, Ctrl-Z, SIGTERM, an exception and the end of the program stop it, and it is looked whether it rests.
- A reported alarm is never cleared from here.

A program that is killed (SIGKILL), a computer that freezes and a cable that is pulled can stop nothing.  The table's own emergency stop
is master: it must be within reach.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, TypeVar

import numpy as np

from session.base.errors import CalibrationError
from session.base.progress import Reporter
from session.base.texts import printable
from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.dialogue import Dialogue
from tinygc.features.tables.machines.link import PRESS, TableFault, TableLimit, Where

T = TypeVar("T")
A = TypeVar("A", np.ndarray, None)
#: s that a machine may take from the acknowledgement of a move to its begin
START_S = 0.3
#: a motion may take so many times as long as computed, and so many s more
SLOWER, LATER_S = 1.5, 5.0
#: s that homing may take
HOME_S = 300.0
#: rad beyond its declared accuracy and play that a move may end off its angle, and a limit be passed
TOLERANCE_RAD = 0.2 * DEG
#: of two answers, how much faster than the axis they may claim that it turned, and rad on top
FASTER, JUMP_RAD = 1.3, 2 * DEG
#: s between two looks whether it rests, rad that it may turn between them, and s after which it should rest beyond its braking time
LOOK_S, RESTS_RAD, REST_S = 0.15, 0.02 * DEG, 2.0
#: s without a look at a moving table after which a program counts as hung
HUNG_S = 15.0


@dataclass(frozen=True)
class Move:
    """A move that a person confirms: one axis, between which angles it may go and how fast; axis None: homing; longest_s above 0: it
    turns at a rate (either sense) until it is stopped, for at most so long."""

    axis: int | None
    least_rad: float = 0.0
    most_rad: float = 0.0
    fastest_rps: float = 0.0
    longest_s: float = 0.0

    @property
    def at_rate(self) -> bool:
        """Whether it turns at a rate."""
        return self.longest_s > 0

    @classmethod
    def home(cls) -> Move:
        """All axes search their reference marks."""
        return cls(None)

    @classmethod
    def to(cls, axis: int, angle_rad: float, rate_rps: float) -> Move:
        """One axis to an angle."""
        return cls(axis, angle_rad, angle_rad, rate_rps)

    @classmethod
    def at(cls, axis: int, rate_rps: float, longest_s: float) -> Move:
        """One axis at a rate, in either sense, for at most so long (above 0)."""
        return cls(axis, -np.inf, np.inf, abs(rate_rps), longest_s)

    @classmethod
    def anywhere(cls, table: Description, axis: int, fastest_rps: float) -> Move:
        """Any angle within an axis's limits: of moves that are computed on the way."""
        return cls(axis, table.axes[axis].least_rad, table.axes[axis].most_rad, fastest_rps)

    def text(self, table: Description) -> str:
        """One line of the plan."""
        if self.axis is None:
            return f"all axes ({', '.join(axis.name for axis in table.axes)}) search their reference marks, at the machine's own rate"
        of = table.axes[self.axis]
        limits = of.limits if of.is_endless else f"limits {of.limits}"
        rate = f"{self.fastest_rps / DEG:g} dps"
        if self.at_rate:
            turned = f"{self.fastest_rps * self.longest_s / DEG:g} deg"
            return f"{of.name} turns at {rate}, in either sense, for at most {self.longest_s:g} s, which is {turned} ({limits})"
        if self.least_rad == self.most_rad:
            return f"{of.name} to {self.most_rad / DEG:g} deg at up to {rate} ({limits})"
        if not np.isfinite(self.least_rad):
            return f"{of.name} to any angle at up to {rate}, turn after turn ({limits})"
        return f"{of.name} to any angle from {self.least_rad / DEG:g} to {self.most_rad / DEG:g} deg at up to {rate} ({limits})"


def plan_lines(table: Description, moves: Sequence[Move], notes: Sequence[str] = ()) -> list[str]:
    """The plan as a person reads it before anything moves; notes: as of ``Guarded.notes``."""
    rows = [f"  {number}. {move.text(table)}" for number, move in enumerate(moves, 1)]
    rows = [*(f"  {note}" for note in notes), *rows]
    return [f"{table.name} ({table.make}) will move:", *rows, "Keep clear of it, and its own emergency stop within reach."]


def ask_person(question: str, unconfirmed: str) -> bool:
    """Ask whoever is at the terminal; True.  CalibrationError, which begins with ``unconfirmed``, where no one is, or the answer is no."""
    if sys.stdin is None or not sys.stdin.isatty():
        raise CalibrationError(f"{unconfirmed}: standard input is no terminal; --yes where you know the table")
    print(f"{printable(question)} ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise CalibrationError(unconfirmed)
    return True


@dataclass
class _Motion:
    """What was requested last; at rest nothing is.

    computed_s: how long it takes; start (K,) rad: where all axes rested before; target: axis and angle; way: axis and rate, with its sign;
    origin: time and angle that it turns from at that rate; turns_by_s: s by which it surely turns, of a turn at a rate without an end;
    furthest: rad that it was seen to have turned by.
    """

    begin_s: float = 0.0
    computed_s: float = np.inf
    start: np.ndarray | None = None
    target: tuple[int, float] | None = None
    way: tuple[int, float] | None = None
    origin: tuple[float, float] | None = None
    turns_by_s: float = 0.0
    is_homing: bool = False
    furthest: float = 0.0


class Guarded:
    """A table that does nothing which was not confirmed, and stops for everything that looks wrong.  Use it as a context.

    ``confirm`` first.  ``where`` is to be called some times a second while it moves; ``settle`` does that.  ``stop`` may be called from any
    thread.  TableLimit for what is not allowed (nothing is sent), TableFault for what went wrong (the table was stopped).
    """

    def __init__(self, table: Dialogue, clock: Clock | None = None):
        self.description = table.description
        self._table, self._clock = table, clock or Clock()
        self._allowed: list[Move] = []
        self._rest = threading.Event()  # whether nothing was requested to move since it was seen at rest
        self._rest.set()
        self._last: tuple[float, np.ndarray] | None = None
        self._motion = _Motion()
        self._looked_s = self._clock.now_s()
        self._closed, self._suspended = False, threading.Event()
        self._handlers = contextlib.ExitStack()

    def __enter__(self) -> Guarded:
        atexit.register(self._stop_what_moves)
        handlers: dict[str, Callable[..., None]] = {"SIGTERM": _interrupt}
        if isinstance(self._clock, Clock):
            handlers["SIGTSTP"] = lambda number, frame: self._suspended.set()  # Ctrl-Z; Windows has none
            threading.Thread(target=self._watch, name="table-watch", daemon=True).start()
        for number, handler in ((getattr(signal, name, None), handler) for name, handler in handlers.items() if _is_main()):
            if number and signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, handler)
                self._handlers.callback(signal.signal, number, signal.SIG_DFL)
        return self

    def __exit__(self, *error: object) -> None:
        try:
            with _undisturbed():
                if not self._rest.is_set():
                    print(printable(f"{self.description.name}: stopping it"), file=sys.stderr, flush=True)
                    try:
                        self.stop()
                    except TableFault as fault:
                        if error[0] is None:
                            raise
                        if not isinstance(error[1], TableFault):  # which states it already
                            print(fault, file=sys.stderr)
                self.close()
        finally:
            self._handlers.close()
            atexit.unregister(self._stop_what_moves)

    @property
    def is_at_rest(self) -> bool:
        """Whether it was seen at rest, and nothing was requested to move since."""
        return self._rest.is_set()

    @property
    def notes(self) -> list[str]:
        """What belongs to a plan in addition its moves: what is sent before the first, and what the make warns of."""
        begins = self._table.begins and f"before the first move it is sent: {self._table.begins}"
        return [*filter(None, (begins, self._table.warning))]

    def confirm(self, moves: Sequence[Move], ask: Callable[[str], bool] | None, show: Reporter) -> None:
        """Show a plan, check it against the limits, and have it confirmed; ask None: somebody confirmed it already (``--yes``).

        Raises TableLimit for a plan beyond the limits, here or by the controller's own settings, for one of angles that are lost, and where
        no one confirms it.  It takes the place of an earlier plan.
        """
        if not any(move.axis is None for move in moves):
            self.require_angles()
        for move in moves:
            if move.axis is not None:
                self.require_rate(move.axis, move.fastest_rps)
                for angle in {move.least_rad, move.most_rad} if not move.at_rate else ():
                    if np.isfinite(angle):
                        self.require_move(move.axis, angle, move.fastest_rps)
        self._table.require_travel()
        for line in plan_lines(self.description, moves, self.notes):
            show(line)
        if ask is not None and not ask("Move it?"):
            raise TableLimit(f"{self.description.name}: the plan was not confirmed; nothing was moved")
        self._allowed = list(moves)

    def stands_at_zero(self) -> None:
        """A person confirms that every axis stands at its zero: a controller that restarted is right with its angles."""
        self._table.angles_lost = False

    def require_angles(self) -> None:
        """TableLimit where the controller has restarted or states that it is not homed, and does not stand at zero."""
        if self._table.angles_lost:
            raise TableLimit(
                f"{self.description.name}: its controller has restarted or is not homed, and its angles and limits mean nothing; home it "
                "(--home), or turn every axis to its zero by hand and state so (--at-zero); nothing was moved"
            )

    def require_move(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """TableLimit for an angle beyond the limits of an axis, and as ``require_rate``."""
        of = self.description.axes[axis]
        if not of.allows(angle_rad):
            requested = f"{of.name} to {angle_rad / DEG:g} deg, expected {of.limits}"
            raise TableLimit(f"{self.description.name}: {requested}; nothing was moved")
        self.require_rate(axis, rate_rps)

    def require_rate(self, axis: int, rate_rps: float) -> None:
        """TableLimit for a rate (either sign) that is not finite, zero, beyond what the axis can do, or that its make cannot state."""
        of = self.description.axes[axis]
        if not 0 < abs(rate_rps) <= of.fastest_rps * (1 + 1e-9):
            requested = f"{of.name} at {rate_rps / DEG:g} dps, expected up to {of.fastest_rps / DEG:g}"
            raise TableLimit(f"{self.description.name}: {requested}; nothing was moved")
        self._table.require_rate(axis, rate_rps)

    # The five verbs.

    def home(self) -> None:
        """Begin to search the reference marks."""
        self._require_confirmed(any(move.axis is None for move in self._allowed), "home")
        self._require_rest()
        self._switch_on(None)
        self._begin(HOME_S, is_homing=True)
        self._guard(self._table.home)

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Begin to turn one axis to an angle; it rests before."""
        self.require_move(axis, angle_rad, rate_rps)
        of = self.description.axes[axis]
        allowed = any(
            move.axis == axis
            and not move.at_rate
            and move.least_rad - 1e-9 <= angle_rad <= move.most_rad + 1e-9
            and rate_rps <= move.fastest_rps * (1 + 1e-9)
            for move in self._allowed
        )
        self._require_confirmed(allowed, f"{of.name} to {angle_rad / DEG:g} deg at {rate_rps / DEG:g} dps")
        self._require_rest()
        here = self._resting_angles()
        self.require_angles()
        self._turn_to(axis, self._switch_on(here), angle_rad, rate_rps)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn one axis at a rate; through rest, where the machine has no rate mode or the axis has limits; 0 ends in rest."""
        of = self.description.axes[axis]
        direct = self._table.has_rate_mode and of.is_endless
        if not rate_rps:
            if direct:
                self._begin(of.fastest_rps / of.acceleration_rps2)
                return self._guard(lambda: self._table.turn_at(axis, 0.0))
            return self.stop()
        self.require_rate(axis, rate_rps)
        longest_s = max(
            (move.longest_s for move in self._allowed if move.axis == axis and abs(rate_rps) <= move.fastest_rps * (1 + 1e-9)), default=0.0
        )
        self._require_confirmed(longest_s > 0, f"{of.name} at {rate_rps / DEG:g} dps")
        if not direct and not self.is_at_rest:
            self.stop()
        angles = self.where().angles if direct else self._resting_angles()
        self.require_angles()
        if not direct:
            limit, here = of.most_rad if rate_rps > 0 else of.least_rad, angles[axis]
            if (limit - here) * np.sign(rate_rps) < TOLERANCE_RAD:
                raise TableLimit(f"{self.description.name}: {of.name} is at its limit of {limit / DEG:g} deg; nothing was moved")
            end = float(np.clip(here + rate_rps * longest_s, of.least_rad, of.most_rad))
            return self._turn_to(axis, self._switch_on(angles), end, abs(rate_rps))
        if rested := self.is_at_rest:
            angles = self._switch_on(angles)
        turns_by_s = 2 * of.fastest_rps / of.acceleration_rps2 + START_S + 0.5
        self._begin(longest_s, angles if rested else None, way=(axis, rate_rps), turns_by_s=turns_by_s)
        return self._guard(lambda: self._table.turn_at(axis, rate_rps))

    def where(self) -> Where:
        """Angles and state, compared with what can be."""
        requested_s = self._clock.now_s()
        found = self._guard(self._table.where)
        now_s = self._looked_s = self._clock.now_s()
        motion = self._motion
        if not self._rest.is_set() and not found.moving and now_s - motion.begin_s < (motion.turns_by_s or START_S):
            found = Where(found.angles, True, found.table_s)  # not begun yet, or between two senses
        self._compare(requested_s, now_s, found)
        if not found.moving and not self._rest.is_set():
            if motion.turns_by_s:
                self._stop_for("it reports that it rests, requested was a turn at a rate")
            found = self._guard(self._table.where)  # the angle may be older than the word that it rests
            # It states that the motion has ended: is it where it should be?
            if motion.target is not None:
                number, requested = motion.target
                axis, reported = self.description.axes[number], found.angles[number]
                if (
                    not abs(reported - requested) <= TOLERANCE_RAD + 5 * axis.sigma_rad + axis.backlash_rad
                ):  # it may begin late, and unwatched
                    self._stop_for(f"{axis.name} reports that it rests at {reported / DEG:.2f} deg, requested was {requested / DEG:.2f}")
            if motion.is_homing:
                self._table.angles_lost, self._last = False, None
            self._rests()
        if found.moving and now_s - self._motion.begin_s > SLOWER * self._motion.computed_s + LATER_S:
            self._stop_for(f"it still moves {now_s - motion.begin_s:.1f} s after its move began; computed were {motion.computed_s:.1f} s")
        return found

    def settle(self) -> Where:
        """Wait until the present motion has ended."""
        while True:
            if not (found := self.where()).moving:
                return found
            self._clock.sleep(0.05)

    def stop(self) -> None:
        """Bring all axes to rest, harder the second time, and see that they are.  TableFault where they are not seen at rest."""
        failed = ""
        for _ in range(2):
            try:
                self._table.stop()
            except TableFault as fault:
                failed = str(fault)
                continue
            if self._is_seen_at_rest():
                self._last = None
                self._rests()
                return
        failed = failed.removeprefix(f"{self.description.name}: ")
        why = failed if PRESS in failed else f"{failed}; {PRESS}" if failed else PRESS
        raise TableFault(f"{self.description.name}: it was ordered to stop and was not seen at rest; {why}")

    def clear(self) -> None:
        """Clear an alarm: only where a person has asked for it.  TableFault where the machine cannot, or does not."""
        self._table.clear()

    def forget_alarm(self) -> None:
        """A person has dealt with an alarm at the machine: ask it, and do not repeat what it stated before."""
        self._table.forget_alarm()

    def close(self) -> None:
        """Let go of the port."""
        if not self._closed:
            self._closed = True
            self._table.close()

    # What may not be.

    def _guard(self, verb: Callable[[], T]) -> T:
        """Do it; whatever fails, the table is stopped."""
        try:
            return verb()
        except TableFault as fault:
            if not self._rest.is_set():
                self._stop_for(str(fault).removeprefix(f"{self.description.name}: "))
            raise

    def _stop_for(self, why: str) -> None:
        """Stop it, and raise why."""
        try:
            self.stop()
            end = "it was stopped, and rests"
        except TableFault as fault:
            end = str(fault).removeprefix(f"{self.description.name}: ")
            why = why.removesuffix(f" {PRESS}").removesuffix(";")
        raise TableFault(f"{self.description.name}: {why}; {end}") from None

    def _switch_on(self, angles: A) -> A:
        """Send what the make wants before its first motion, which was confirmed and turns nothing.

        angles (K,) rad: where all axes rest; returns where they do behind it.  None where the angles mean nothing: it is homed next.
        """
        if self._table.begins:
            self._begin(0.0, angles)
            self._guard(self._table.begin)
            if angles is not None:
                return self.settle().angles
        return angles

    def _turn_to(self, axis: int, here: np.ndarray, angle_rad: float, rate_rps: float) -> None:
        """Send a turn from rest, with all axes at ``here``, to an angle."""
        of, way = self.description.axes[axis], angle_rad - here[axis]
        computed_s = abs(way) / rate_rps + rate_rps / of.acceleration_rps2
        self._begin(computed_s, here, way=(axis, float(np.copysign(rate_rps, way))), target=(axis, angle_rad))
        self._last = (self._motion.begin_s, here)
        self._guard(lambda: self._table.turn_to(axis, angle_rad, rate_rps))

    def _begin(self, computed_s: float, start: np.ndarray | None = None, **more: Any) -> None:
        """A motion begins now, from ``start`` where it rests; more: of ``_Motion``."""
        self._rest.clear()
        self._looked_s = now_s = self._clock.now_s()
        self._motion = motion = _Motion(now_s, computed_s, start, **more)
        if motion.way is not None and start is not None:
            motion.origin = now_s, float(start[motion.way[0]])
        self._last = None

    def _compare(self, requested_s: float, now_s: float, found: Where) -> None:
        """An answer states where it was between the question and the answer."""
        if not np.isfinite(found.angles).all():
            return
        motion = self._motion
        last_s = motion.begin_s if self._last is None else self._last[0]
        for number, (axis, angle) in enumerate(zip(self.description.axes, found.angles, strict=True)):
            if motion.is_homing:  # it changes angles at once
                continue
            allowed_rad = 5 * axis.sigma_rad + axis.backlash_rad
            if self._last is not None and not axis.is_endless:
                over, before = (max(axis.least_rad - reported, reported - axis.most_rad) for reported in (angle, self._last[1][number]))
                if over > TOLERANCE_RAD + allowed_rad and over > before + RESTS_RAD:  # back from beyond it may come
                    self._stop_for(f"{axis.name} reports {angle / DEG:.2f} deg, beyond its limits")
            if motion.target is not None and motion.target[0] == number and self._last is not None and motion.way is not None:
                over = (angle - motion.target[1]) * np.sign(motion.way[1])
                if over > TOLERANCE_RAD + allowed_rad:
                    self._stop_for(f"{axis.name} is at {angle / DEG:.2f} deg, beyond the {motion.target[1] / DEG:.2f} that it was sent to")
            round_rad = FASTER * axis.fastest_rps * (now_s - last_s) + JUMP_RAD + allowed_rad
            if self._last is not None and (change := abs(angle - self._last[1][number])) > round_rad:
                self._stop_for(f"{axis.name} reports that it turned by {change / DEG:.1f} deg within {now_s - last_s:.2f} s")
            if motion.way is None or motion.way[0] != number:
                if motion.start is not None and abs(angle - motion.start[number]) > JUMP_RAD + allowed_rad:
                    self._stop_for(f"{axis.name} turns without a command: it is at {angle / DEG:.2f} deg")
                continue
            if motion.origin is None:  # it turned at another rate before
                motion.origin = (requested_s, angle) if now_s - motion.begin_s > motion.turns_by_s else None
                continue
            along, lasted_s = (angle - motion.origin[1]) * np.sign(motion.way[1]), now_s - motion.origin[0]
            requested = f"requested was {motion.way[1] / DEG:+g} dps"
            if along > FASTER * abs(motion.way[1]) * lasted_s + round_rad:
                self._stop_for(f"{axis.name} reports that it turned by {along / DEG:.1f} deg within {lasted_s:.2f} s, {requested}")
            motion.furthest = max(motion.furthest, along)
            if along < motion.furthest - JUMP_RAD - allowed_rad:
                self._stop_for(f"{axis.name} turns the wrong way: it is at {angle / DEG:.2f} deg, {requested}")
        self._last = (requested_s, found.angles)

    def _rests(self) -> None:
        """It was seen at rest."""
        self._motion = _Motion(self._motion.begin_s)
        self._rest.set()

    def _require_confirmed(self, allowed: bool, what: str) -> None:
        if not allowed:
            raise TableLimit(f"{self.description.name}: {what} is in no plan that was confirmed; nothing was moved")

    def _require_rest(self) -> None:
        if not self._rest.is_set():
            raise TableLimit(f"{self.description.name}: it still moves; wait for it, or stop it first")

    def _resting_angles(self) -> np.ndarray:
        """Angles (K,) rad; TableLimit where it moves though it got no command: somebody else has."""
        end_s = self._clock.now_s() + REST_S
        while (found := self.where()).moving:
            if self._clock.now_s() > end_s:
                raise TableLimit(f"{self.description.name}: it moves, and not from here; stop it first")
            self._clock.sleep(0.05)
        return found.angles

    def _is_seen_at_rest(self) -> bool:
        """Whether two looks see the same angles within the time that braking takes."""
        end_s = self._clock.now_s() + self.description.braking_s + REST_S
        before: np.ndarray | None = None
        while self._clock.now_s() <= end_s:
            try:
                angles = self._table.look()
            except TableFault:
                return False
            if before is not None and np.abs(angles - before).max() < RESTS_RAD:
                return True
            before = angles
            self._clock.sleep(LOOK_S)
        return False

    def _watch(self) -> None:
        """A thread: a program that does not look at a moving table any more has hung; one that is suspended (Ctrl-Z) stops it before."""
        while not self._closed:
            if self._clock.now_s() - self._looked_s > HUNG_S:
                self._stop_what_moves()
                self._looked_s = self._clock.now_s()
            if self._suspended.wait(0.5):
                self._suspended.clear()
                self._stop_what_moves()
                os.kill(os.getpid(), signal.SIGSTOP)

    def _stop_what_moves(self) -> None:
        """As well as it can, at the end of a program too."""
        if not self._rest.is_set() and not self._closed:
            with contextlib.suppress(TableFault):
                self._table.stop()


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C, Ctrl-Z, SIGTERM and SIGHUP wait while a table is being stopped."""
    before = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP") if _is_main() else ():
        if number := getattr(signal, name, None):
            before[number] = signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
