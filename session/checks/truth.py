"""Check of a truth file: its rotations must be the ones that the gyro's rates make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.checks.findings import Finding, xyz_text
from session.common.errors import CalibrationError
from session.common.units import DEG
from session.detect.segments import Segment
from session.detect.truth_segments import cut_at_truth
from session.log.config import Config
from session.log.logfile import Log
from session.log.truth import Truth

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

EXPLAINED = 0.5  #: of the truth's rotations, or they are not this gyro's
MOST_SEGMENTS = 200
SHORT_S = 10.0  #: over more, a bias of some dps turns so far that it is no longer a small correction
LEAST_DEG = 1.0


def check_truth(log: Log, truth: Truth, config: Config) -> list[Finding]:
    """The rotations between moments of truth, against the gyro's, a constant bias taken off."""
    where = truth.path.name
    try:
        cut = cut_at_truth(log.samples, truth, config.sensor, config.protocol)
    except CalibrationError as error:
        return [Finding("error", where, "truth", str(error))]
    good = [(segment, ends) for segment, ends in cut if segment.accepted]
    says = f"{len(truth)} moments, {len(good)} of {len(cut)} segments whole"
    if not good:
        return [Finding("error", where, "truth", f"{says}: {cut[0][0].problem}", "is the truth of this log?")]
    findings = [Finding("ok", where, "truth", says)]
    picked = good[:: -(-len(good) // MOST_SEGMENTS)]
    if float(np.median([segment.duration_s for segment, _ in picked])) > SHORT_S:
        return findings
    from scipy.spatial.transform import Rotation

    gyro = Rotation.from_quat(np.array([_integrated(log, segment) for segment, _ in picked]), scalar_first=True)
    start, end = (Rotation.from_quat(np.array([getattr(ends, name) for _, ends in picked]), scalar_first=True) for name in ("start", "end"))
    duration = np.array([segment.duration_s for segment, _ in picked])[:, None]
    turned = start.inv() * end
    size = float(np.sqrt(np.mean(turned.magnitude() ** 2))) / DEG
    if size < LEAST_DEG:
        return [*findings, Finding("note", where, "gyro against truth", f"hardly turned ({size:.1f} deg): it cannot test the gyro")]
    misfit, bias = _misfit(gyro, turned, duration)
    says = f"segments of {size:.0f} deg, explained to {1 - misfit:.1%} (bar {EXPLAINED:.0%}) with a bias of {xyz_text(bias / DEG)} dps"
    if misfit <= 1 - EXPLAINED:
        return [*findings, Finding("ok", where, "gyro against truth", says)]
    inverse, _ = _misfit(gyro, start * end.inv(), duration)
    hint = (
        "the inverse explains it: write q_nb, body to navigation frame"
        if inverse < 0.5 * misfit
        else "are axes, units and clocks the same?"
    )
    return [*findings, Finding("error", where, "gyro against truth", says, hint)]


def _misfit(gyro: Rotation, turned: Rotation, duration: np.ndarray) -> tuple[float, np.ndarray]:
    """Share of the truth's squared rotation that the gyro leaves, and the bias (3,) rad/s that was taken off."""
    error = (turned.inv() * gyro).as_rotvec()
    bias = np.median(error / duration, axis=0)
    return float(np.sum((error - bias * duration) ** 2) / np.sum(turned.magnitude() ** 2)), bias


def _integrated(log: Log, segment: Segment) -> np.ndarray:
    """Quaternion (4,) of a segment's rotation by the measured rate."""
    part = log.samples.between(segment.start, segment.stop)
    from scipy.spatial.transform import Rotation

    steps = Rotation.from_rotvec((part.gyro[1:] + part.gyro[:-1]) / 2 * part.dt_s[:, None])
    while len(steps) > 1:
        even = len(steps) // 2 * 2
        product = steps[0:even:2] * steps[1:even:2]
        steps = product if even == len(steps) else Rotation.concatenate([product, steps[even:]])
    return steps.as_quat(scalar_first=True).reshape(4)
