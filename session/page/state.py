"""What the page shows, as JSON: ``pose`` many times a second, ``state`` as often as the screen is drawn.  Degrees, dps; never NaN."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from session.common.texts import printable
from session.common.units import DEG
from session.guide.guide import Guide
from session.guide.instructions import wait_of
from session.guide.messages import Advice, Stage
from session.page.attitude import Attitude
from session.page.turning import Quaternion, exp, levelled, multiply, rotated

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
        "up": [_rounded(_up(guide.taken.coverage.correct(each.accel_mean)), 3) for each in guide.taken.stills[-MOST_STILLS:]],
        "sigmas": _sigmas(guide.advice),
        "closure_deg": None if closure_deg is None else round(closure_deg, 3),
        "temp_c": None if health.temp_c is None or not math.isfinite(health.temp_c) else round(health.temp_c, 1),
        "wait": None if (wait := wait_of(guide)) is None else wait.words,
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
