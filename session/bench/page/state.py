"""The content of the page, as JSON: attitude of the board, state of the guide."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from session.base import rotation
from session.base.texts import printable
from session.base.units import DEG, NS
from session.bench.guide import Guide, View
from session.bench.messages import GuideMessage, Kind, Stage
from session.bench.page.server import PageServer
from session.log.samples import Samples, joined

# Unit quaternions (4,), scalar first: ``session.base.rotation``.

NONE = np.array([1.0, 0.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
HEAD_OVER = np.array([0.0, 1.0, 0.0, 0.0])  #: z down, about a fixed axis


def rotated(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """A body vector (3,) in the frame that q maps to."""
    return rotation.matrix(q) @ vector


def levelled(q: np.ndarray, force: np.ndarray, part: float = 1.0) -> np.ndarray:
    """q, rotated by the shortest way, or a part of it, so that the specific force (3,) of a rest points up; the heading is kept."""
    up = rotated(q, force / max(float(np.linalg.norm(force)), 1e-9))
    axis, cosine = np.cross(up, UP), float(up @ UP)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return q if cosine > 0 else rotation.multiply(HEAD_OVER, q)
    return rotation.multiply(rotation.exp(axis * part * math.atan2(sine, cosine) / sine), q)


# The board's attitude, for a picture: from gravity in rests, from the gyro in turns.

STEP_S = 0.002  #: in which the rate is taken as constant: coning inside it stays below 0.01°
SETTLES_S = 0.2  #: time constant of the change from gyro to gravity in a rest, which hides the noise of samples


class Attitude:
    """The board's attitude."""

    def __init__(self) -> None:
        self.q = NONE  #: board to a frame with z up, whose heading is that of the first sample
        self.rate = np.zeros(3)  #: of the last samples, rad/s
        self.peak_rps = 0.0  #: largest component of it
        self.zero_rps: np.ndarray | None = None  #: the gyro's reading at rest, None before the first accepted still
        self._last_ns: int | None = None
        self._level = False

    def feed(self, samples: Samples, resting: bool) -> None:
        """Take samples, SI; resting: whether the table is at rest, so that the accelerometer measures gravity alone."""
        if len(samples) == 0:
            return
        t_ns, gyro = np.asarray(samples.t_ns), np.asarray(samples.gyro)
        if self._last_ns is not None and self._last_ns < t_ns[0]:
            if self.zero_rps is not None or not resting:  # an unknown bias is no turn
                zero_rps = 0.0 if self.zero_rps is None else self.zero_rps
                self.q = carried(self.q, gyro - zero_rps, np.diff(t_ns, prepend=self._last_ns) * NS)
        else:  # the first samples, or a restarted clock: the rotation in between is unknown
            self._level = False
        gap_s = float(t_ns[-1] - (t_ns[0] if self._last_ns is None else self._last_ns)) * NS
        self._last_ns = int(t_ns[-1])
        self.rate, self.peak_rps = gyro.mean(axis=0), float(np.abs(gyro).max())
        lately = t_ns > t_ns[-1] - SETTLES_S / NS  # in a resumed recording a portion holds many seconds
        force = np.asarray(samples.accel)[lately].mean(axis=0)
        if not self._level:
            self.q, self._level = levelled(NONE if force[2] >= 0 else HEAD_OVER, force), True
        elif resting:
            self.q = levelled(self.q, force, 1 - float(np.exp(-max(gap_s, 0.0) / SETTLES_S)))


def carried(q: np.ndarray, rate: np.ndarray, dt_s: np.ndarray) -> np.ndarray:
    """q, rotated by rates (N, 3) rad/s, each for dt_s (N,)."""
    steps = np.floor(np.cumsum(dt_s) / STEP_S)
    first = np.flatnonzero(np.diff(steps, prepend=-1.0))
    moved = rotation.multiply(q, rotation.compose(rotation.exp(np.add.reduceat(rate * dt_s[:, None], first))))
    return moved / np.linalg.norm(moved)


# The page's events: ``pose`` many times a second, ``state`` as often as the screen is drawn.  Degrees, dps; never NaN.

MOST_STILLS = 200  #: on the sphere: the last of them


def state_of(guide: Guide, still: np.ndarray, messages: Collection[tuple[int, str, float, str]]) -> dict[str, Any]:
    """The ``state`` event.  still: attitude in the last accepted still, where the requested movement begins; messages: the last ones."""
    now, health, wait = guide.instruction, guide.health, guide.wait
    forces = [guide.taken.corrected(each.accel_mean) for each in guide.taken.stills[-MOST_STILLS:]]
    sigmas = guide.advice.sigmas if guide.advice is not None else ()
    target = _target(guide, still)
    return {
        "stage": now.stage.value,
        "do": printable(now.do),
        "why": printable(now.why if target else now.reason),
        "good": now.good,
        "remaining_s": now.remaining_s,
        "part": now.part,
        "moving": guide.stage in (Stage.HOLD_STILL, Stage.TURN, Stage.CLOSURE) and guide.turn.moving,
        "turned_deg": round(guide.turn.path_rad / DEG, 1),
        "accepted": guide.accepted,
        "wanted": None if guide.stop_at_target else guide.segments,
        "rejected": guide.rejected,
        "connected": guide.stage is not Stage.FIND_PORT,
        "enough": guide.enough,
        "target": target,
        "up": [_rounded(force / max(float(np.linalg.norm(force)), 1e-9), 3) for force in forces],
        "sigmas": [{"name": name, "of_target": round(min(sigma, 1e6), 3) if math.isfinite(sigma) else 1e6} for name, sigma in sigmas],
        "temp_c": None if health.temp_c is None or not math.isfinite(health.temp_c) else round(health.temp_c, 1),
        "wait": None if wait is None else wait.words,
        "odr_hz": None if health.odr_hz is None else round(health.odr_hz, 2),
        "samples": health.samples,
        "lost": health.troubles["lost"],
        "messages": [
            {"number": number, "kind": kind, "at_s": round(at_s, 1), "text": printable(text)} for number, kind, at_s, text in messages
        ],
    }


def _target(guide: Guide, still: np.ndarray) -> dict[str, Any] | None:
    """The requested attitude, and the rotations to it, each about an axis of the frame with z up."""
    advice = guide.requested
    if guide.stage is not Stage.TURN or advice is None or not advice.movements:
        return None
    q, turns = still if advice.up is None else levelled(still, np.array(advice.up)), []
    for movement in advice.movements:
        axis = np.array(movement.axis)
        angle_deg, words = round(movement.angle_rad / DEG, 1), printable(movement.words)
        turns.append({"from": _rounded(q, 4), "axis": _rounded(rotated(q, axis), 4), "angle_deg": angle_deg, "words": words})
        q = rotation.multiply(q, rotation.exp(movement.angle_rad * axis))
    return {"q": _rounded(q, 4), "turns": turns}


def _rounded(numbers: np.ndarray, digits: int) -> list[float]:
    return [round(float(number), digits) for number in numbers]


POSE_EVERY_S = 0.04  #: 25 pictures a second
REMEMBERED = 6


class PageView:
    """A view that shows everything on a screen and on the page."""

    def __init__(self, screen: View, server: PageServer):
        self._screen, self._server = screen, server
        self._attitude, self._still, self._stills = Attitude(), NONE, 0
        self._recent: deque[tuple[int, str, float, str]] = deque(maxlen=REMEMBERED)
        self._numbers, self._sent_s = 0, 0.0
        self._unseen: list[Samples] = []
        self._failed = False

    def change(self, change: GuideMessage) -> None:
        """Show a message."""
        self._screen.change(change)
        if change.kind is not Kind.STAGE:
            self._numbers += 1
            self._recent.append((self._numbers, change.kind.value, change.at_s, change.text))

    def show(self, guide: Guide) -> None:
        """Draw the present state."""
        self._screen.show(guide)
        self._guarded(lambda: self._publish_state(guide))

    def _publish_state(self, guide: Guide) -> None:
        self._server.publish("state", state_of(guide, self._still, self._recent))

    def watch(self, guide: Guide, samples: Samples) -> None:
        """Take samples after the guide.  Many are processed at once, at a tenth of the cost of single portions."""
        self._guarded(lambda: self._watch(guide, samples))

    def _guarded(self, draw: Callable[[], None]) -> None:
        """No failure of the page may end a recording."""
        if self._failed:
            return
        try:
            draw()
        except Exception as error:
            self._failed = True
            failed = f"the page has failed ({type(error).__name__}: {error}); the recording goes on without it"
            self._screen.change(GuideMessage(Kind.WARNING, failed, 0.0))

    def _watch(self, guide: Guide, samples: Samples) -> None:
        if len(samples) == 0:
            return
        if self._unseen and samples.t_ns[0] <= self._unseen[-1].t_ns[-1]:  # the board's clock has restarted
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
            # Device time of the last sample; board to a frame with z up; rate of the three axes, and its peak.
            pose = {
                "t_s": round(float(samples.t_ns[-1]) * NS, 4),
                "q": _rounded(self._attitude.q, 4),
                "rate_dps": _rounded(self._attitude.rate / DEG, 1),
                "peak_dps": round(self._attitude.peak_rps / DEG, 1),
                "full_scale_dps": guide.sensor.gyro_fs_dps,
            }
            self._server.publish("pose", pose)
