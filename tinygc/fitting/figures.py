"""The contract's figures of closure errors, in degrees."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from session.common.units import DEG


class ClosureFigures(TypedDict):
    """Root mean squares over segments, degrees; yaw_rms_deg: None where yaw is not known.  Where some turns have a known angle, it is
    that of these turns, about each one's own axis."""

    tilt_rms_deg: float
    roll_rms_deg: float
    pitch_rms_deg: float
    yaw_rms_deg: float | None


def closure_figures(angles: np.ndarray) -> ClosureFigures:
    """The four figures of error angles (S, 2 or 3) rad, in degrees."""
    rms = np.sqrt(np.mean(angles**2, axis=0)) / DEG
    third = angles[:, 2:][angles[:, 2:] != 0]  # 0, exactly, where a segment's angle is not known
    return {
        "tilt_rms_deg": float(np.hypot(rms[0], rms[1])),
        "roll_rms_deg": float(rms[0]),
        "pitch_rms_deg": float(rms[1]),
        "yaw_rms_deg": float(np.sqrt(np.mean(third**2))) / DEG if len(third) else None,
    }


def run_figures(errors: np.ndarray) -> dict[str, float]:
    """The figures of one closure run, from roll, pitch, yaw errors (3,) rad."""
    roll, pitch, yaw = (float(error) / DEG for error in errors)
    return {"roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw, "rmse_deg": float(np.sqrt(np.mean(errors**2))) / DEG}
