"""What the page shows, as JSON: attitude of the board, state of the guide."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from session.bench.guide import Guide, View
from session.bench.messages import AcceptedTurn, Advice, GuideMessage, Kind, Stage
from session.bench.page.server import PageServer
from session.io.samples import Samples, joined
from session.io.texts import printable
from session.io.units import DEG, NS

# Unit quaternions, scalar first, for a picture: plain numbers, since numpy is slow on four of them.

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
NONE: Quaternion = (1.0, 0.0, 0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0])


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton's product: first b, then a."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def exp(x: float, y: float, z: float) -> Quaternion:
    """Of a rotation vector, rad."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return NONE
    by = math.sin(angle / 2) / angle
    return (math.cos(angle / 2), x * by, y * by, z * by)


def normalised(q: Quaternion) -> Quaternion:
    """Of length one again."""
    length = math.sqrt(sum(part * part for part in q))
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def rotated(q: Quaternion, vector: np.ndarray) -> np.ndarray:
    """A vector (3,) of the body, in the frame that q takes it to."""
    w, v = q[0], np.array(q[1:])
    return vector + 2 * w * np.cross(v, vector) + 2 * np.cross(v, np.cross(v, vector))


def inverse(q: Quaternion) -> Quaternion:
    """The way back."""
    return (q[0], -q[1], -q[2], -q[3])


def levelled(q: Quaternion, force: np.ndarray, part: float = 1.0) -> Quaternion:
    """q, turned on the shortest way, or a part of it, so that the specific force (3,) of a rest points up; the heading stays as it was."""
    up = rotated(q, force / max(float(np.linalg.norm(force)), 1e-9))
    axis, cosine = np.cross(up, UP), float(up @ UP)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return q if cosine > 0 else normalised(multiply((0.0, 1.0, 0.0, 0.0), q))
    x, y, z = axis * part * math.atan2(sine, cosine) / sine
    return normalised(multiply(exp(x, y, z), q))


# How the board lies now: gravity says it in rests, the gyro carries it through turns.  For a picture, not for a result.

STEP_S = 0.002  #: in which the rate counts as constant: coning inside it stays below 0.01°
SETTLES_S = 0.2  #: in which a rest's gravity takes the gyro's place: the noise of single samples is not to be seen
HEAD_OVER: Quaternion = (0.0, 1.0, 0.0, 0.0)  #: z down: of all ways to stand on the head always the same


class Attitude:
    """q: takes the board's axes to a frame with z up, whose heading is the one of the first sample; rate (3,) rad/s and its largest
    part of the last samples; zero_rps: what the gyro reads at rest, None before the first rest that counts."""

    def __init__(self) -> None:
        self.q: Quaternion = NONE
        self.rate = np.zeros(3)
        self.peak_rps = 0.0
        self.zero_rps: np.ndarray | None = None
        self._last_ns: int | None = None
        self._level = False

    def feed(self, samples: Samples, resting: bool) -> None:
        """Samples, SI, as they come; resting: whether the table is at rest, so that the accelerometer reads gravity alone."""
        if len(samples) == 0:
            return
        t_ns, gyro = np.asarray(samples.t_ns), np.asarray(samples.gyro)
        if self._last_ns is not None and self._last_ns < t_ns[0]:
            if self.zero_rps is not None or not resting:  # a bias that nobody knows yet is no turn
                zero_rps = 0.0 if self.zero_rps is None else self.zero_rps
                self.q = carried(self.q, gyro - zero_rps, np.diff(t_ns, prepend=self._last_ns) * NS)
        else:  # the first samples, or a clock that has begun anew: how it was turned meanwhile nobody knows
            self._level = False
        gap_s = float(t_ns[-1] - (t_ns[0] if self._last_ns is None else self._last_ns)) * NS
        self._last_ns = int(t_ns[-1])
        self.rate, self.peak_rps = gyro.mean(axis=0), float(np.abs(gyro).max())
        lately = t_ns > t_ns[-1] - SETTLES_S / NS  # of a recording that is taken in again, a portion holds many seconds
        force = np.asarray(samples.accel)[lately].mean(axis=0)
        if not self._level:
            self.q, self._level = levelled(NONE if force[2] >= 0 else HEAD_OVER, force), True
        elif resting:
            self.q = levelled(self.q, force, 1 - float(np.exp(-max(gap_s, 0.0) / SETTLES_S)))


def carried(q: Quaternion, rate: np.ndarray, dt_s: np.ndarray) -> Quaternion:
    """Through rates (N, 3) rad/s, each of them for dt_s (N,)."""
    steps = np.floor(np.cumsum(dt_s) / STEP_S)
    first = np.flatnonzero(np.diff(steps, prepend=-1.0))
    for x, y, z in np.add.reduceat(rate * dt_s[:, None], first).tolist():
        q = multiply(q, exp(x, y, z))
    return normalised(q)


def closure_deg(turn: AcceptedTurn) -> float:
    """By how much gravity misses, at a turn's end, where the gyro as measured carries it from the turn's beginning."""
    first, last = turn.segment.stills
    rate = np.asarray(turn.samples.gyro) - (first.gyro_mean + last.gyro_mean) / 2
    q = carried(levelled(NONE, first.accel_mean), (rate[1:] + rate[:-1]) / 2, turn.samples.dt_s)
    expected, found = rotated(inverse(q), UP), last.accel_mean / np.linalg.norm(last.accel_mean)
    return float(np.arctan2(np.linalg.norm(np.cross(expected, found)), expected @ found) / DEG)


# What the page shows, as JSON: ``pose`` many times a second, ``state`` as often as the screen is drawn.  Degrees, dps; never NaN.

MOST_STILLS = 200  #: on the sphere: the last of them


def pose_of(attitude: Attitude, full_scale_dps: float, t_s: float) -> dict[str, Any]:
    """t_s: device time of the last sample; q: board to a frame with z up; rate of the three axes and its peak, dps."""
    return {
        "t_s": round(t_s, 4),
        "q": _rounded(attitude.q, 4),
        "rate_dps": _rounded(attitude.rate / DEG, 1),
        "peak_dps": round(attitude.peak_rps / DEG, 1),
        "full_scale_dps": full_scale_dps,
    }


def state_of(guide: Guide, still: Quaternion, said: Collection[tuple[int, str, float, str]], closure_deg: float | None) -> dict[str, Any]:
    """still: attitude at the last rest that counts, where the coach's turn begins; said: number, kind, time and words of what changed."""
    now, health = guide.instruction, guide.health
    return {
        "stage": now.stage.value,
        "do": printable(now.do),
        "why": printable(now.why),
        "good": now.good,
        "remaining_s": now.remaining_s,
        "part": now.part,
        "moving": guide.stage in (Stage.HOLD_STILL, Stage.TURN, Stage.CLOSURE) and guide.turn.moving,
        "turned_deg": round(guide.turn.path_rad / DEG, 1),
        "accepted": guide.accepted,
        "wanted": guide.segments,
        "rejected": guide.rejected,
        "target": _target(guide, still),
        "up": [_rounded(_up(guide.taken.coverage.corrected(each.accel_mean)), 3) for each in guide.taken.stills[-MOST_STILLS:]],
        "sigmas": _sigmas(guide.advice),
        "closure_deg": None if closure_deg is None else round(closure_deg, 3),
        "temp_c": None if health.temp_c is None or not math.isfinite(health.temp_c) else round(health.temp_c, 1),
        "wait": None if (wait := guide.wait) is None else wait.words,
        "odr_hz": None if health.odr_hz is None else round(health.odr_hz, 2),
        "samples": health.samples,
        "lost": health.troubles["lost"],
        "said": [{"number": number, "kind": kind, "at_s": round(at_s, 1), "text": printable(text)} for number, kind, at_s, text in said],
    }


def _target(guide: Guide, still: Quaternion) -> dict[str, Any] | None:
    """Where the coach wants the board, and the turns that lead there, each about an axis of the frame with z up."""
    advice = guide.asked_for.advice
    if guide.stage is not Stage.TURN or advice is None or not advice.movements:
        return None
    q, turns = still if advice.up is None else levelled(still, np.array(advice.up)), []
    for movement in advice.movements:
        axis = np.array(movement.axis)
        turns.append({"from": _rounded(q, 4), "axis": _rounded(rotated(q, axis), 4), "angle_deg": round(movement.angle_rad / DEG, 1)})
        q = multiply(q, exp(*(movement.angle_rad * axis).tolist()))
    return {"q": _rounded(q, 4), "turns": turns}


def _sigmas(advice: Advice | None) -> list[dict[str, Any]]:
    return (
        []
        if advice is None
        else [{"name": name, "of_target": round(min(sigma, 1e6), 3) if math.isfinite(sigma) else 1e6} for name, sigma in advice.sigmas]
    )


def _up(force: np.ndarray) -> np.ndarray:
    return force / max(float(np.linalg.norm(force)), 1e-9)


def _rounded(numbers: Quaternion | np.ndarray, digits: int) -> list[float]:
    return [round(float(number), digits) for number in numbers]


# The page beside the screen: told the same things in the same place, and the samples besides.

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

    def change(self, change: GuideMessage) -> None:
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
            self._screen.change(GuideMessage(Kind.WARNING, said, 0.0))

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
