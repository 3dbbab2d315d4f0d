"""The page beside the screen: told the same things in the same place, and the samples besides."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from session.common.units import NS
from session.guide.guide import Guide
from session.guide.messages import AcceptedTurn, Change, Kind
from session.guide.view import View
from session.log.samples import Samples, joined
from session.page.attitude import Attitude, closure_deg
from session.page.server import PageServer
from session.page.state import pose_of, state_of
from session.page.turning import NONE

POSE_EVERY_S = 0.04  #: 25 pictures a second; what is shown is at most that much and a portion of the stream late
REMEMBERED = 6


class PageView:
    """screen: what is told as well."""

    def __init__(self, screen: View, server: PageServer):
        self._screen, self._server = screen, server
        self._attitude, self._still, self._stills = Attitude(), NONE, 0
        self._said: deque[tuple[int, str, float, str]] = deque(maxlen=REMEMBERED)
        self._numbers, self._sent_s = 0, 0.0
        self._unseen: list[Samples] = []
        self._closure_deg: float | None = None
        self._failed = False

    def change(self, change: Change) -> None:
        """Something has changed."""
        self._screen.change(change)
        if (turn := change.accepted) is not None:
            self._drawn(lambda: self._closed(turn))
        if change.kind is not Kind.STAGE:
            self._numbers += 1
            self._said.append((self._numbers, change.kind.value, change.at_s, change.text))

    def _closed(self, turn: AcceptedTurn) -> None:
        self._closure_deg = closure_deg(turn)

    def show(self, guide: Guide) -> None:
        """The present state."""
        self._screen.show(guide)
        self._drawn(lambda: self._server.publish("state", state_of(guide, self._still, self._said, self._closure_deg)))

    def watch(self, guide: Guide, samples: Samples) -> None:
        """Samples that the guide has just had.  They are followed many at a time, which costs a tenth of following each portion."""
        self._drawn(lambda: self._watch(guide, samples))

    def _drawn(self, draw: Callable[[], None]) -> None:
        """Whatever is wrong with the page, it must not end a recording."""
        if self._failed:
            return
        try:
            draw()
        except Exception as error:
            self._failed = True
            said = f"the page has failed ({type(error).__name__}: {error}); the recording goes on without it"
            self._screen.change(Change(Kind.WARNING, said, 0.0))

    def _watch(self, guide: Guide, samples: Samples) -> None:
        if len(samples) == 0:
            return
        if self._unseen and samples.t_ns[0] <= self._unseen[-1].t_ns[-1]:  # the board's clock has begun anew
            self._follow(guide)
        self._unseen.append(samples)
        if len(guide.taken.stills) != self._stills or time.monotonic() - self._sent_s >= POSE_EVERY_S:
            self._follow(guide)

    def _follow(self, guide: Guide) -> None:
        if not self._unseen:
            return
        samples, self._unseen = joined(self._unseen), []
        self._attitude.feed(samples, resting=not guide.turn.moving)
        stills = guide.taken.stills
        if len(stills) != self._stills:
            self._stills, self._still = len(stills), self._attitude.q
            self._attitude.zero_rps = stills[-1].gyro_mean
        if guide.sensor is not None:
            self._sent_s = time.monotonic()
            self._server.publish("pose", pose_of(self._attitude, guide.sensor.gyro_fs_dps, float(samples.t_ns[-1]) * NS))
