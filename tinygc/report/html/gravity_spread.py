"""How far gravity's length spreads over the stills, before and after: a card of the answer, and what the accelerometer's section charts."""

from __future__ import annotations

import numpy as np

from session.common.units import MG
from tinygc.report.html.evidence import Evidence
from tinygc.report.html.numbers import significant


def card(evidence: Evidence) -> tuple[str, str, str] | None:
    """Name, figure and words for the answer's box: gravity's spread; None where the session has no stills that say it."""
    before, after = misses_of(evidence)
    if evidence.problem.session.truths is not None or not after.size:
        return None
    found = evidence.fit.accelerometer
    arrow = "" if before is None else f"<small>{spread_text(before)} →</small> "
    left = len(found.unobserved)
    words = {"fit": "from these very stills and turns", "prior": "the given one, sharpened", "given": "as given"}[found.mode]
    words = "nobody has calibrated it" if found.calibration.source == "none" else words
    tail = f"; <strong>{left} of its 9 numbers not observed</strong>" if left else ""
    return "Accelerometer", f"{arrow}{spread_text(after)}", f"spread of gravity’s length over {after.size} stills; {words}{tail}"


def spread_text(misses: np.ndarray) -> str:
    """Their standard deviation, in mg."""
    return f"{significant(float(np.std(misses)) / MG, 2)} mg"


def misses_of(evidence: Evidence) -> tuple[np.ndarray | None, np.ndarray]:
    """m/s^2 before, None where there is no other, and after, of the stills that are references."""
    found = evidence.fit.accelerometer
    if found.misses_mps2 is not None:
        return found.misses_mps2
    gravity = evidence.problem.session.config.site.expected_gravity_mps2
    return None, np.array([np.linalg.norm(s.accel_mean) - gravity for s in evidence.problem.stills if s.problem is None])
