"""What the guide says to do at this moment, and why it waits."""

from __future__ import annotations

from typing import Protocol

from session.common.units import DEG
from session.guide.asked_for import AskedFor
from session.guide.closure_guide import ClosureGuide
from session.guide.health import Health
from session.guide.messages import Instruction, Stage
from session.guide.present_log import PresentLog
from session.guide.stream_check import CHECK_S
from session.guide.taken import Taken
from session.guide.turn_in_progress import TurnInProgress
from session.guide.warmth import Wait
from session.log.config import Sensor

PEAK_FULL_SCALE = 0.85
ANY_TURN = "turn the board onto another side: by 90°, 180° or 270° about an axis of it that is level, in about 3 s"


class Leader(Protocol):
    """What a guide shows of itself."""

    stage: Stage
    segments: int
    waits_for: str
    objection: str
    here: PresentLog
    closure: ClosureGuide | None
    asked_for: AskedFor
    sensor: Sensor | None
    health: Health
    taken: Taken

    @property
    def accepted(self) -> int:
        """Segments that count."""

    @property
    def turn(self) -> TurnInProgress:
        """What the table does now."""

    @property
    def hold_s(self) -> float:
        """How long a still is asked for."""

    @property
    def coach_is_asked(self) -> bool:
        """Whether its word is still awaited."""


def instruction_of(guide: Leader) -> Instruction:
    """For each stage."""
    stage = guide.stage
    if stage is Stage.FIND_PORT:
        return Instruction(stage, "connect the board", guide.waits_for or "no port is open yet", good=False)
    if stage is Stage.CHECK_STREAM:
        waits = guide.waits_for or f"{min(guide.here.checked_s, CHECK_S):.1f} of {CHECK_S:.1f} s of samples seen"
        return Instruction(stage, "wait: the stream is being looked at", waits, good=False)
    if stage is Stage.PAUSED:
        return Instruction(stage, "paused: nothing is judged", "p goes on", good=False)
    if stage is Stage.DONE:
        return Instruction(stage, "done: the table may be left", f"{guide.accepted} segments accepted")
    if stage is Stage.CLOSURE and guide.closure is not None:
        return guide.closure.instruction(guide.turn)
    return _turn(guide) if stage is Stage.TURN else _hold(guide)


def wait_of(guide: Leader) -> Wait | None:
    """Whether it pays to let the board become warm before going on."""
    if guide.stage not in (Stage.HOLD_STILL, Stage.TURN):
        return None
    return guide.health.warmth.wait(guide.taken.turns, guide.taken.stills, guide.segments - guide.accepted)


def _hold(guide: Leader) -> Instruction:
    turn, held = guide.turn, guide.turn.still_s
    why, good = guide.objection, False
    if turn.moving:
        why = f"{guide.here.why} for {turn.restless_s or turn.moving_s:.1f} s: hands off?"
    elif not why:
        why, good = f"still for {held:.1f} of {guide.hold_s:.1f} s", True
    left = max(guide.hold_s - held, 0.0)
    return Instruction(guide.stage, "hold still: hands off the table", why, left, min(held / guide.hold_s, 1.0), good)


def _turn(guide: Leader) -> Instruction:
    turn, advice = guide.turn, guide.asked_for.advice
    if guide.coach_is_asked:
        return Instruction(guide.stage, "one moment: the coach looks at the last turn", "for some 2 s at most")
    do = advice.words if advice else ANY_TURN
    if not turn.moving:
        waits = f"waiting for the turn; segment {guide.accepted + 1} of {guide.segments}"
        return Instruction(guide.stage, do, advice.reason if advice and advice.reason else waits)
    assert guide.sensor is not None  # as it was set before the first sample
    peak_dps, bar_dps = turn.peak_rps / DEG, PEAK_FULL_SCALE * guide.sensor.gyro_fs_dps
    turned = f"turned {turn.path_rad / DEG:.0f}° so far"
    if peak_dps > bar_dps:
        return Instruction(guide.stage, do, f"{turned}, but {peak_dps:.0f} > {bar_dps:.0f} dps: slower, or it clips", good=False)
    return Instruction(guide.stage, do, f"{turned}, peak {peak_dps:.0f} of {guide.sensor.gyro_fs_dps:.0f} dps; then let go")
