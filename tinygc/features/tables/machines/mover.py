"""A table in the place of the operator: it makes the turn that the coach requests, leads the closure run, and is compared with the sensor.

The guide finds stills and turns in the samples, as of a hand's turns.  The machine's word only says when it has arrived.  What it says of
its angles is held against gyroscope and gravity in each still.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from session.base.units import DEG, NS
from session.bench.events import Event
from session.bench.guide import MARK, RUN, ClosureGuide, Guide, Moment
from session.bench.messages import AxisMove, GuideMessage, Kind, Stage
from session.detect.segments import angle_read
from tinygc.features.tables.machines.comparison import WordAgainstSensor
from tinygc.features.tables.machines.driver import TableDriver
from tinygc.features.tables.machines.verbs import TableLimit

if TYPE_CHECKING:
    from tinygc.features.tables.planner import TableMoves

#: without samples while the table moves, s: nobody sees what it does
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


class MachineMover:
    """What the movers of a recording (``session.bench.guide.Mover``) share: faults, pauses, and what is said of them."""

    def __init__(self, driver: TableDriver):
        self.driver = driver
        self.wants: Event | None = None
        self._stopped = False  # by the operator, a fault, or contradictions: until the recording goes on
        self._was_paused = False
        self._messages: list[GuideMessage] = []
        self._now_s = 0.0

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
            self._stopped = False
            self._goes_on()
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

    def close(self) -> None:
        """Bring the table to rest and let go of it."""
        self.driver.close()

    def _round(self, guide: Guide, moment: Moment | None, coaching: bool) -> None:
        """Begin what the guide waits for, where nothing is wrong."""

    def _goes_on(self) -> None:
        """A pause has ended."""

    def _is_blind(self, moment: Moment | None) -> bool:
        """Whether nobody sees what the table does."""
        return moment is not None and self.driver.now_s() - moment.host_ns * NS > BLIND_S

    def _halt(self, why: str) -> None:
        """Stop, and pause until somebody has looked at it."""
        self.stop()
        self.wants = PAUSE
        self._say(f"{why}; {PUT_RIGHT}")

    def _say(self, text: str) -> None:
        self._messages.append(GuideMessage(Kind.WARNING, text, self._now_s))


class TableMover(MachineMover):
    """Makes the turns of a session."""

    def __init__(self, driver: TableDriver, moves: TableMoves):
        super().__init__(driver)
        self._moves = moves
        self._word = WordAgainstSensor(driver.table.description)
        self._stills: int | None = None  # of the guide, that were compared
        self._log, self._begun_ns = "", 0  # of the last still that was compared, and about when it began
        self._contradictions = 0  # in a row
        self._made_s: float | None = None  # when the last move had ended, and no still has followed
        self._mark: np.ndarray | None = None  # angles of the closure run's mark

    def stop(self) -> None:
        """Bring the table to rest at once."""
        super().stop()
        self._word.interrupted()

    def _goes_on(self) -> None:
        self._contradictions, self._made_s = 0, None
        self._word.interrupted()

    def _round(self, guide: Guide, moment: Moment | None, coaching: bool) -> None:
        driver = self.driver
        guide.any_turn = THE_TABLE_TURNS
        if driver.busy and self._is_blind(moment) and not self._stopped:  # it goes on when the guide has seen a still
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
            advice = guide.asked
            if self._made_s is not None and not self._waited(NO_TURN_S):
                return  # its still has yet to come
            if self._made_s is not None:
                # The machine says that it has turned, and no turn was seen
                self._contradictions += 1
                self._say("the machine says that it has turned, and the gyroscope saw nothing: it is stalled, or its coupling slips")
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
            away = [float(mark - angle) for mark, angle in zip(self._mark, angles, strict=True)]
            whole = [2 * np.pi * round(each / (2 * np.pi)) if axis.is_endless else 0.0 for each, axis in zip(away, axes, strict=True)]
            back = [each - turns for each, turns in zip(away, whole, strict=True)]
            self.driver.make(
                [
                    AxisMove(k, float(angles[k] + each), min(rate, axes[k].fastest_rps))
                    for k, each in enumerate(back)
                    if abs(each) > 0.01 * DEG
                ]
            )
