"""The movement that the coach asks for: in the still that it was meant for, until the board is turned; never a moment longer."""

from __future__ import annotations

from session.guide.messages import Advice

COACH_S = 2.0  #: how long the coach is waited for before any turn will do
SETTLING_S = 0.3  #: quiet for so long, a turn is over
BETWEEN = 0.6  #: of still_s: the same between two movements; what lasts 0.7 of it counts as a still
MOST_OF_IT = 0.75  #: of the angles asked for: whoever rests before, rests between two movements


class AskedFor:
    """advice: what is asked for now; None while the coach thinks, and where it asks for nothing."""

    def __init__(self) -> None:
        self.advice: Advice | None = None
        self._since_s: float | None = None

    def ends(self, now_s: float | None = None) -> None:
        """What was asked for is over: the board lies elsewhere, or other turns count.  now_s: where the coach is asked again."""
        self.advice, self._since_s = None, now_s

    def answered(self, advice: Advice | None) -> None:
        """The coach's word on the board as it lies now."""
        self.advice, self._since_s = advice if advice and advice.words else None, None

    def awaited(self, now_s: float) -> bool:
        """Whether the coach's word is worth waiting for still."""
        return self._since_s is not None and now_s - self._since_s < COACH_S

    def settling_s(self, path_rad: float, still_s: float) -> float:
        """How long the table is quiet where its turn is over, which has come so far; longer where a second movement is still to come."""
        movements = self.advice.movements if self.advice else ()
        goes_on = len(movements) > 1 and path_rad < MOST_OF_IT * sum(abs(movement.angle_rad) for movement in movements)
        return max(SETTLING_S, BETWEEN * still_s) if goes_on else SETTLING_S
