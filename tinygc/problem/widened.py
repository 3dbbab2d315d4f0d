"""Segments that are less certain than their noise says, each with its cause: what was bridged in them, or an impact that no reading shows.

The extra variance belongs to the end attitude of that segment alone, and stands in the floor (``Floor.wider``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.checks.findings import Finding
from session.common.units import DEG
from session.detect.bridges import GAP
from session.detect.segments import Segment
from session.log.logfile import Bridge
from tinygc.attitude import rotation


@dataclass(frozen=True)
class Widening:
    """segment: its number; cause: ``gap``, ``clipped`` or ``impact``; sigma_rad: rms of tilt that it adds; says: what happened, where."""

    segment: int
    cause: str
    sigma_rad: float
    says: str

    @property
    def words(self) -> str:
        """For a table: what happened, and what it costs."""
        return f"{self.says}: weighed down, ± {self.sigma_rad / DEG:.2g}° of tilt more"

    def to_json(self) -> dict:
        """One of ``segments.widened`` of ``tinygc-fit/1``."""
        return {"segment": self.segment, "cause": self.cause, "sigma_deg": self.sigma_rad / DEG, "says": self.says}


def weighed_down(session: str, widened: Sequence[Widening]) -> list[Finding]:
    """What is to be said of a session's segments that are less certain than the others, one line a cause."""
    found = []
    for cause in dict.fromkeys(each.cause for each in widened):
        mine = [each for each in widened if each.cause == cause]
        worst = max(mine, key=lambda each: each.sigma_rad)
        many = f"{len(mine)} segments, most of all segment" if len(mine) > 1 else "segment"
        says = f"{many} {worst.segment}: {worst.words}"
        found.append(Finding("note", session, f"weighed down ({cause})", says, "what they miss beyond that is looked at"))
    return found


def widened_by_bridges(
    segments: Sequence[Segment], bridges: Sequence[tuple[Bridge, ...]], attitudes: np.ndarray
) -> tuple[np.ndarray, list[Widening]]:
    """(S, 3, 3) rad^2 that bridged readings (of each log) add to the ends of S segments with attitudes q_tb (S, T, 4), table axes."""
    more, said = np.zeros((len(segments), 3, 3)), []
    for i, segment in enumerate(segments):
        for cause, inside in _inside(segment, bridges[segment.log]).items():
            added = np.zeros((3, 3))
            for bridge in inside:
                turn = rotation.matrix(attitudes[i, bridge.row - segment.start])
                added += turn @ np.diag(bridge.sigma_rad**2) @ turn.T
            more[i] += added
            said.append(Widening(segment.number, cause, float(np.sqrt(added[0, 0] + added[1, 1])), _words(cause, inside)))
    return more, said


def bridged_sigma(segments: Sequence[Segment], bridges: Sequence[tuple[Bridge, ...]]) -> np.ndarray:
    """(S,) rad of each of S segments, whichever way it lies: the same before any attitude is known."""
    inside = [[bridge for each in _inside(s, bridges[s.log]).values() for bridge in each] for s in segments]
    return np.array([np.sqrt(sum(float(bridge.sigma_rad @ bridge.sigma_rad) for bridge in own)) for own in inside])


def _inside(segment: Segment, bridges: tuple[Bridge, ...]) -> dict[str, list[Bridge]]:
    found: dict[str, list[Bridge]] = {}
    for bridge in bridges:
        if segment.start <= bridge.row < segment.stop:
            found.setdefault(bridge.what, []).append(bridge)
    return found


def _words(cause: str, bridges: list[Bridge]) -> str:
    count, where = sum(bridge.count for bridge in bridges), f"at {bridges[0].at_s:.2f} s"
    where += f" and {len(bridges) - 1} more place{'s' * (len(bridges) != 2)}" if len(bridges) > 1 else ""
    if cause == GAP:
        return f"{count} sample{'s are' if count > 1 else ' is'} missing {where}, put in from the neighbours"
    return f"{count} reading{'s' * (count > 1)} at the register's end {where}, what was beyond estimated from the neighbours"
