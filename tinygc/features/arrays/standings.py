"""Standings of an array's parts: what all units miss by, motion beyond the data rate, and each unit's own excess, each with a limit.

All are sizes of variance components, tested and limited by the profile of the restricted likelihood: zero half of the time where nothing is
there (Self & Liang 1987), and excluded with 95 % where -2 log likelihood rises by 1.64 squared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from session.base.numeric import rms_of
from session.base.units import DEG
from tinygc.features.arrays.joint import Joint, VarianceSplit, rise, upper_component
from tinygc.inference.choose import Standing, Statement, standing_of

#: component of motion beyond the data rate in ``RowMap.names``, from the end
FAST = -2
#: factor within which motion beyond the data rate is predicted (docs/explain.md)
PREDICTED_WITHIN = 1.5
RATIO = "likelihood ratio"


@dataclass(frozen=True)
class Part:
    """A statement with the rms tilt a turn that it is about, and its upper 95 % limit, rad."""

    statement: Statement
    size_rad: float
    upper_rad: float

    @property
    def standing(self) -> Standing:
        """Return its standing."""
        return self.statement.standing


@dataclass(frozen=True)
class Parts:
    """Parts of an array's closure.  fast: None where no motion beyond the data rate is predicted; own: of each unit; all_own: over all."""

    common: Part
    fast: Part | None
    own: tuple[Part, ...]
    all_own: Part


def parts_of(joint: Joint, split: VarianceSplit, floors_rad: np.ndarray, numbers: Sequence[int]) -> Parts:
    """State the parts of a joint estimate.

    floors_rad (N,): what white noise makes each unit miss, tilt rms a turn, from which on a part matters; numbers of the units.
    """
    floor = rms_of(floors_rad)
    common = _part("what all units miss by alike", split.p_value, split.common, split.common_upper, floor)
    sizes_rad = [float(np.sqrt(2 * t)) for t in joint.solution.t[: len(numbers)]]
    limits_rad = [float(np.sqrt(2 * upper_component(joint.solution, i, joint.sigmas[i]))) for i in range(len(numbers))]
    own = tuple(
        _part(f"unit {number} by itself", float(p), size, max(limit, size), float(each))
        for number, p, size, limit, each in zip(numbers, split.own_p, sizes_rad, limits_rad, floors_rad, strict=True)
    )
    fast = _fast(joint, split.predicted, floor) if split.predicted > 0 else None
    # One statement over all units: those with an excess, and what any of them may have
    there = [(number, part) for number, part in zip(numbers, own, strict=True) if part.standing is Standing.FOR]
    p_value = min(part.statement.p_value for part in own)
    size, upper = max(part.size_rad for part in own), max(part.upper_rad for part in own)
    standing = standing_of(p_value, upper=upper, matters=floor)
    rest = [part.upper_rad for part in own if part.standing is not Standing.FOR]
    sizes = ", ".join(f"{_deg(part.size_rad)} in unit {number}" for number, part in there) or f"{_deg(size)} at most"
    sizes += f", up to {_deg(max(rest))} in any other" if there and rest else ""
    every = Statement("what units miss by one by one", standing, RATIO, p_value, sizes, _deg(upper))
    return Parts(common, fast, own, Part(every, size, upper))


def _part(what: str, p_value: float, size_rad: float, upper_rad: float, matters_rad: float) -> Part:
    standing = standing_of(p_value, upper=upper_rad, matters=matters_rad)
    return Part(Statement(what, standing, RATIO, p_value, f"{_deg(size_rad)} rms a turn", _deg(upper_rad)), size_rad, upper_rad)


def _fast(joint: Joint, predicted: float, floor: float) -> Part:
    """Motion beyond the data rate: one term of all units, tested against zero and against its prediction, beside an unnamed common part."""
    solution = joint.solution
    k = len(solution.t) + FAST
    factor = float(np.sqrt(solution.t[k]))
    p_zero = float(chdtrc(1, max(rise(solution, {k: 0.0}), 0.0))) / 2 if factor > 0 else 1.0
    nearest = float(np.clip(factor, 1 / PREDICTED_WITHIN, PREDICTED_WITHIN))
    p_claimed = 1.0 if nearest == factor else float(chdtrc(1, max(rise(solution, {k: nearest**2}), 0.0))) / 2
    size = predicted * factor
    upper = max(float(predicted * np.sqrt(upper_component(solution, k, joint.sigmas[FAST]))), size)
    standing = standing_of(p_zero, p_claimed=p_claimed, upper=upper, matters=floor)
    p_value = p_claimed if standing is Standing.AGAINST else p_zero
    said = f"{_deg(size)} rms a turn, predicted {_deg(predicted)}"
    claimed = f"the predicted {_deg(predicted / PREDICTED_WITHIN)} to {_deg(predicted * PREDICTED_WITHIN)}"
    said = f"{_deg(size)} rms a turn" if standing is Standing.AGAINST else said
    return Part(Statement("motion beyond the data rate", standing, RATIO, p_value, said, _deg(upper), claimed), size, upper)


def _deg(rad: float) -> str:
    return f"{rad / DEG:.2g}°"
