"""Short gaps and single clipped readings are bridged before a fit: what was put in, and how much of a turn it may cost."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from session.checks.findings import Finding, axes_text
from session.common.units import DEG
from session.detect.bridges import CLIPPED, GAP, bridged
from session.detect.segments import why_broken
from session.detect.stills import Noise, Still
from session.log.config import Sensor
from session.log.folder import Session
from session.log.logfile import Bridge, Log

WHAT = "bridged readings"


def with_bridges(session: Session) -> Session:
    """The session with the short gaps and short peaks of its logs and closure runs bridged; logs without any are the same objects."""

    def whole(log: Log) -> Log:
        if log.bridges:  # done before
            return log
        samples, bridges = bridged(log.samples, session.config.sensor)
        return replace(log, samples=samples, bridges=bridges) if bridges else log

    return replace(session, logs=tuple(map(whole, session.logs)), closures=tuple(map(whole, session.closures)))


def check_bridges(log: Log, sensor: Sensor, stills: list[Still], noise: Noise | None, segment_s: float) -> list[Finding]:
    """What a fit puts in, against what the gyro's own noise adds to a segment; what lies in turns that are not used for another reason,
    between these stills, is not counted."""
    samples, bridges = bridged(log.samples, sensor)
    if not bridges:
        return []
    whole = replace(log, samples=samples, bridges=bridges)
    turns = [(first.start_s + first.duration_s, last.start_s) for first, last in pairwise(stills)]
    rows = np.searchsorted(samples.t_s, turns).reshape(-1, 2)
    broken = [(a, b) for a, b in rows.tolist() if why_broken(samples, slice(a, b + 1), sensor, whole.put_in)]
    bridges = tuple(bridge for bridge in bridges if not any(a <= bridge.row <= b for a, b in broken))
    if not bridges:
        return []
    floor = np.inf if noise is None else float(noise.angle_random_walk.max()) * np.sqrt(segment_s)
    worst = max(float(np.linalg.norm(bridge.sigma_rad)) for bridge in bridges)
    says = "; ".join(text for text in (_gaps_text(bridges), _peaks_text(bridges)) if text)
    says += f": put in from their neighbours, off by {worst / DEG:.2g} deg at worst"
    says += f" (gyro noise per segment {floor / DEG:.2g})" if np.isfinite(floor) else ""
    do = "their turns count, with so much wider a sigma"
    return [Finding("warning" if worst > floor else "note", log.path.name, WHAT, says, do)]


def _gaps_text(bridges: tuple[Bridge, ...]) -> str:
    gaps = [bridge for bridge in bridges if bridge.what == GAP]
    if not gaps:
        return ""
    lost = sum(gap.count for gap in gaps)
    return f"{lost} missing in {len(gaps)} gap{'s' * (len(gaps) != 1)}, the first at {gaps[0].at_s:.1f} s"


def _peaks_text(bridges: tuple[Bridge, ...]) -> str:
    peaks = [bridge for bridge in bridges if bridge.what == CLIPPED]
    if not peaks:
        return ""
    axes = axes_text(np.any([peak.sigma_rad > 0 for peak in peaks], axis=0))
    stood = sum(peak.count for peak in peaks)
    return f"{stood} at the register's end on {axes}, the first at {peaks[0].at_s:.1f} s"
