"""Rate steps: a table turns at known rates, in both senses, with rests between; the samples go to ``rates*.csv``.

A step is: rest, turn at a rate, wait until the rate has settled, dwell, rest.  An axis with limits is first set to the limit that the step
turns away from.  Nothing is examined meanwhile; ``rates`` finds the steps in the log by the machine's angles, which ``table.csv`` holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from session.base.units import DEG
from session.bench.events import Event
from session.bench.guide import Guide, Moment
from session.bench.messages import AxisMove, GuideMessage, Instruction, Kind, Stage
from session.log.config import Protocol
from session.log.samples import Samples
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.mover import MachineMover, TableDriver
from tinygc.features.tables.machines.verbs import TableLimit

STEM = "rates"
#: s: rest before and after each step; of a rate until it is even, beyond its acceleration
REST_S, SETTLE_S = 3.0, 1.0
#: rad that stay between a step and the limits
MARGIN_RAD = 2 * DEG


@dataclass(frozen=True)
class RateStep:
    """An axis at a rate with its sign, rad/s, for dwell_s once it has settled; start_rad: where it begins, None: anywhere."""

    axis: int
    rate_rps: float
    dwell_s: float
    start_rad: float | None = None

    def seconds(self, table: Description) -> float:
        """How long it takes, with its rests."""
        return REST_S + SETTLE_S + self.dwell_s + 2 * abs(self.rate_rps) / table.axes[self.axis].acceleration_rps2


def steps_of(table: Description, axis: int, rates_rps: Sequence[float], dwell_s: float) -> list[RateStep]:
    """The steps of rates (their signs do not count), each in both senses, small ones first.  TableLimit where one does not fit."""
    of, found = table.axes[axis], []
    for rate in sorted({abs(rate) for rate in rates_rps}):
        if not 0 < rate <= of.fastest_rps * (1 + 1e-9):
            raise TableLimit(f"{of.name} at {rate / DEG:g} dps: expected above 0 and at most {of.fastest_rps / DEG:g}, its fastest")
        way = rate * (dwell_s + SETTLE_S + rate / of.acceleration_rps2) + MARGIN_RAD
        for sense in (1.0, -1.0):
            if way > of.most_rad - of.least_rad:
                turns = f"{of.name} at {rate / DEG:g} dps for {dwell_s:g} s turns by {way / DEG:.0f} deg"
                raise TableLimit(f"{turns}, its limits leave {(of.most_rad - of.least_rad) / DEG:.0f}: a shorter --dwell")
            start = None if of.is_endless else of.least_rad if sense > 0 else of.most_rad
            found.append(RateStep(axis, sense * rate, dwell_s, start))
    return found


class RatesGuide(Guide):
    """The guide of rate steps: it begins their log, shows how far they are, and looks for no turn."""

    stem, takes_a_log, of_a_pause = STEM, True, "and belong to no step"

    def __init__(self, protocol: Protocol, steps: int):
        self.steps, self.made = steps, 0
        self.says = ""  #: what the table does now
        super().__init__(protocol, 0)

    @property
    def so_far(self) -> str:
        """What is recorded, in words."""
        return f"{self.made} of {self.steps} rate steps"

    @property
    def instruction(self) -> Instruction:
        """What happens: hands off."""
        if self.stage is Stage.HOLD_STILL:
            return Instruction(self.stage, "hands off: the table turns at known rates", f"{self.says}; {self.so_far}")
        return super().instruction

    def _do(self, decision: Event) -> None:
        """Nothing is decided about steps."""

    def step_made(self, step: RateStep) -> list[GuideMessage]:
        """A step is recorded; the last one ends the recording."""
        self.made += 1
        self._say(Kind.ACCEPTED, f"step {self.made} of {self.steps}: {step.rate_rps / DEG:+g} dps for {step.dwell_s:g} s")
        if self.made >= self.steps:
            self._finish(self.so_far)
        return self._told()

    def _block(self, samples: Samples) -> None:
        self.here.take(samples, remember=False)


class RateMover(MachineMover):
    """Makes the steps, one after the other; one that was interrupted is made again."""

    def __init__(self, driver: TableDriver, steps: Sequence[RateStep]):
        super().__init__(driver)
        self._steps = list(steps)
        self._phase, self._since_s = "begin", 0.0
        self._log = ""

    def stop(self) -> None:
        """Bring the table to rest at once."""
        super().stop()
        self._phase = "begin"

    def _round(self, guide: Guide, moment: Moment | None, coaching: bool) -> None:
        assert isinstance(guide, RatesGuide)
        log = moment.log if moment is not None else ""
        # Whatever comes: the present step is made again, from rest
        if guide.stage is Stage.PAUSED or self._is_blind(moment) or log != self._log:
            if self._phase not in ("begin", "rest"):
                self.driver.stop()
            self._phase, self._log = "begin", log
        elif guide.stage is Stage.HOLD_STILL and not self._stopped and self.driver.where is not None:
            self._messages += self._go_on(guide)

    def _go_on(self, guide: RatesGuide) -> list[GuideMessage]:
        step, driver = self._steps[guide.made], self.driver
        axis = driver.table.description.axes[step.axis]
        lasted_s = driver.now_s() - self._since_s
        guide.says = f"{axis.name} {step.rate_rps / DEG:+g} dps"
        if self._phase == "begin" and not driver.busy:
            assert driver.where is not None
            if step.start_rad is not None and abs(step.start_rad - driver.where.angles[step.axis]) > MARGIN_RAD / 2:
                driver.make([AxisMove(step.axis, step.start_rad, axis.fastest_rps)])
                return []
            self._enter("rest")
        elif self._phase == "rest" and lasted_s >= REST_S:
            driver.turn_at(step.axis, step.rate_rps)
            self._enter("turn")
        elif self._phase == "turn" and lasted_s >= abs(step.rate_rps) / axis.acceleration_rps2 + SETTLE_S + step.dwell_s:
            driver.turn_at(step.axis, 0.0)
            self._enter("brake")
        elif self._phase == "brake" and not driver.busy:
            self._phase = "begin"
            return guide.step_made(step)
        return []

    def _enter(self, phase: str) -> None:
        self._phase, self._since_s = phase, self.driver.now_s()
