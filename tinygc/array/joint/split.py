"""What the closure misses beyond noise, split: what all units have in common is not the sensors', what one has alone is its own.

Common are motion beyond the data rate (of units that are read at the same moments), the reference (a body that is not at rest in a still)
and whatever else turned the body without the readings' knowledge.  Its size between two stills is gamma (``rows.py``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from session.common.units import DEG
from tinygc.array.joint.events import COMMON_TURN, OWN_TURN, ArrayEvent
from tinygc.array.joint.joint import Joint

#: -2 log likelihood by which the name "motion beyond the data rate" must better a part of no name, and no part at all
BORNE_OUT = 2.0
#: family-wise, of all units: an own excess less probable by chance is that unit's
OWN_P = 0.01
#: of what is predicted: less is what a filter lets through (``explanation/noise/components.py``: predicted within a factor of 1.5)
FILTERED = 1 / 3


@dataclass(frozen=True, eq=False)
class TurnSplit:
    """Of one turn between stills first and last: common_rad (2,) tilt that all units miss by, sigma_rad of each angle; own_rad (N,) the
    length of what each unit errs by itself, NaN where it has no such turn; events of it."""

    first: int
    last: int
    common_rad: np.ndarray
    sigma_rad: np.ndarray
    own_rad: np.ndarray
    events: tuple[ArrayEvent, ...]


@dataclass(frozen=True, eq=False)
class Split:
    """Tilt, both angles together, rms over the turns, rad.

    own (N, 2): each unit's own excess and its sigma, and own_p (N,) of one as large by chance, of all units together; turn (2,): of what
    is common, equal in all turns; fast (2,): what of it goes as motion beyond the data rate is predicted to, and its sigma;
    predicted: that prediction; level_mps2 (2,); gains: by how much -2 log likelihood falls with a common part that is equal in all
    turns, and with one that goes as predicted; minus_mean_rad: unit minus mean; turns.
    """

    own: np.ndarray
    own_p: np.ndarray
    turn: tuple[float, float]
    fast: tuple[float, float]
    predicted: float
    level_mps2: tuple[float, float]
    gains: dict[str, float]
    minus_mean_rad: float
    minus_mean_of: np.ndarray
    turns: tuple[TurnSplit, ...]

    @property
    def common(self) -> float:
        """rad: all that is common to the turns' closure."""
        return float(np.hypot(self.turn[0], self.fast[0]))

    @property
    def p_value(self) -> float:
        """Of there being nothing common, by chance: likelihood ratio, whose part is zero half the time (Self & Liang 1987)."""
        gain = max(self.gains.values())
        return float(chi2.sf(max(gain, 0.0), 1)) if gain > 0 else 1.0

    @property
    def is_fast_motion(self) -> bool:
        """Whether what is common goes from turn to turn as motion beyond the data rate is predicted to."""
        return self.p_value < 0.01 and self.gains["undersampled"] > self.gains["turn"] + BORNE_OUT

    @property
    def words(self) -> str:
        """What is common, in one sentence."""
        if self.p_value > 0.01:
            return "nothing in common beyond noise: what turns miss by is each unit's own"
        size = f"{self.common / DEG:.2g}° rms a turn in common, which no unit's sensor has made"
        if self.is_fast_motion:
            factor, sigma = (part / self.predicted for part in self.fast)
            why = "; a filter below half the data rate leaves so little" if factor < FILTERED else ""
            predicted = f"predicted {self.predicted / DEG:.2g}° (found {factor:.2f} ± {sigma:.2f} of it{why})"
            return f"{size}: motion beyond the data rate, {predicted}"
        fast = f"; motion beyond the data rate is predicted to make {self.predicted / DEG:.2g}°" if self.predicted > 0 else ""
        return f"{size}: the motion, the table or the reference{fast}"


def split_of(joint: Joint) -> Split:
    """Of a joint estimate of two units or more."""
    count = len(joint.rows)
    predicted = float(np.sqrt(2 * np.mean(joint.missed_rad**2)))
    both = np.sqrt(2)
    own = np.array([joint.component(f"turn.{i}") for i in range(count)]) * both
    turn, fast = (joint.component(f"common.{name}") for name in ("turn", "undersampled"))
    minus, of_unit = _minus_mean(joint)
    return Split(
        own,
        _own_p(joint),
        _times(turn, both),
        _times(fast, predicted),
        predicted,
        joint.component("common.level"),
        _gains(joint),
        minus,
        of_unit,
        _turns(joint),
    )


def _own_p(joint: Joint) -> np.ndarray:
    """(N,) of each unit's own excess being chance, over all units: likelihood ratio, whose part is zero half the time (Self & Liang 1987).

    A component's size over its sigma tells nothing near zero, where half of all sizes are zero and the others small.
    """
    solution, count = joint.solution, len(joint.rows)
    p = np.ones(count)
    for i in range(count):
        if not solution.t[i] > 0:
            continue
        begin, held = solution.t.copy(), np.zeros(len(solution.t), dtype=bool)
        begin[i], held[i] = 0.0, True
        gain = solution.system.estimated(begin, held).value - solution.value
        p[i] = min(1.0, count * float(chi2.sf(max(gain, 0.0), 1)) / 2)
    return p


def _times(size: tuple[float, float], factor: float) -> tuple[float, float]:
    """A size and its sigma; nothing where the factor is."""
    return (factor * size[0], factor * size[1]) if factor > 0 else (0.0, 0.0)


def _gains(joint: Joint) -> dict[str, float]:
    system, t = joint.solution.system, joint.solution.t
    values = {}
    for name, held in (("none", (-3, -2)), ("turn", (-2,)), ("undersampled", (-3,))):
        begin, keep = t.copy(), np.zeros(len(t), dtype=bool)
        usual = float(np.mean(t[-3]) + t[-2] * np.mean(joint.missed_rad**2)) + float(np.median(system.base[system.V[0] > 0]))
        begin[-3], begin[-2] = usual, usual / max(float(np.mean(joint.missed_rad**2)), 1e-30)
        for k in held:
            begin[k], keep[k] = 0.0, True
        values[name] = system.estimated(begin, keep).value if name != "undersampled" or joint.missed_rad.any() else np.inf
    return {name: values["none"] - values[name] for name in ("turn", "undersampled")}


def _minus_mean(joint: Joint) -> tuple[float, np.ndarray]:
    """rad rms of tilt over the turns that all units have, and of each unit: its closure minus the mean of all units'."""
    same, count = joint.same, len(joint.rows)
    left: dict[tuple[int, int], dict[int, np.ndarray]] = {}
    for i in range(count):
        if not len(joint.where.closure[i]):
            continue
        residual = joint.solution.residual[joint.where.closure[i]]
        for s, (a, b) in enumerate(zip(same.first[i], same.last[i], strict=True)):
            left.setdefault((int(a), int(b)), {})[i] = residual[s, :2]
    whole = np.array([[each[i] for i in range(count)] for each in left.values() if len(each) == count]).reshape(-1, count, 2)
    if not len(whole):
        return float("nan"), np.full(count, np.nan)
    square = np.sum((whole - whole.mean(axis=1, keepdims=True)) ** 2, axis=2)
    return float(np.sqrt(square.mean())), np.sqrt(square.mean(axis=0))


def _turns(joint: Joint) -> tuple[TurnSplit, ...]:
    solution, layout, same = joint.solution, joint.layout, joint.same
    sigma = np.sqrt(np.diag(joint.covariance)[layout.common].reshape(-1, 2))
    common = joint.common_rad
    found = []
    for a, b in same.spans:
        own = np.full(len(joint.rows), np.nan)
        for i in range(len(joint.rows)):
            row = np.flatnonzero((same.first[i] == a) & (same.last[i] == b))
            if len(row):
                own[i] = np.linalg.norm(solution.residual[joint.where.closure[i][row[0]]])
        events = tuple(e for e in joint.events if e.what in (OWN_TURN, COMMON_TURN) and a <= e.first and e.last <= b)
        found.append(TurnSplit(int(a), int(b), common[a:b].sum(axis=0), np.sqrt((sigma[a:b] ** 2).sum(axis=0)), own, events))
    return tuple(found)
