"""Split of an array's closure error beyond noise: a part common to all units is no sensor's error, a part in one unit only is its own.

Common causes are motion beyond the data rate (of units that are read at the same times), the reference (a body that is not at rest in a
still) and any rotation of the body that the readings miss.  The size between two stills is gamma (``system.py``).

Every part is a statement about variance components, tested and limited by the profile of the restricted likelihood: zero half of the time
where nothing is there (Self & Liang 1987), and excluded with 95 % where -2 log likelihood rises by 1.64 squared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtrc

from session.base.numeric import rms_of, running_sum
from session.base.records import in_unit
from session.base.texts import measured
from session.base.units import DEG, MG
from tinygc.features.arrays.joint import Joint
from tinygc.features.arrays.system import Solution
from tinygc.inference.choose import ONE_SIDED, Standing, Statement, chance_of_any
from tinygc.inference.noise import where_risen


def rise(solution: Solution, held: dict[int, float]) -> float:
    """Return by how much -2 log likelihood rises where components have these values, all others estimated again."""
    return max(solution.held(held).value - solution.value, 0.0)


def upper_size(solution: Solution, k: int, sigma: float, zero: Sequence[int] = ()) -> float:
    """Return the largest size, the root of component k, that is not excluded with 95 %, all others free; infinite where none is excluded.

    sigma: of the component, with which the search steps; zero: components held at zero meanwhile.  Where these alone are excluded, the
    size that is best without them.
    """
    nothing = dict.fromkeys(zero, 0.0)
    without = solution.held(nothing) if nothing else solution
    low = float(without.t[k])
    if without.value - solution.value >= ONE_SIDED**2:
        return float(np.sqrt(low))
    wide = sigma if np.isfinite(sigma) and sigma > 0 else max(low, 1e-3 * float(np.median(solution.system.base)))
    step = np.sqrt(low + ONE_SIDED * wide) - np.sqrt(low)
    return where_risen(lambda size: rise(solution, {k: size**2, **nothing}), np.sqrt(low), float(step), ONE_SIDED**2)


#: drop of -2 log likelihood that ``motion beyond the data rate`` needs against an unnamed common part, and against none
SUPPORTED = 2.0
#: share of the predicted size; below it, a filter passes only a part
FILTERED = 1 / 3
#: factor within which motion beyond the data rate is predicted (docs/explain.md)
PREDICTED_WITHIN = 1.5
#: components of a common error, from the end: equal in all turns, as predicted for fast motion, level acceleration
TURN, FAST, LEVEL_MPS2 = -3, -2, -1
#: sizes of a tilt are those of both of its angles together
BOTH = np.sqrt(2)


@dataclass(frozen=True, eq=False)
class Split:
    """Parts of a joint estimate of two units or more: tilt errors, both angles together, rms over the turns, rad; a pair is a size and its
    sigma.

    numbers of the units; floors_rad (N,): what white noise makes each miss, from which on a part matters.
    """

    joint: Joint
    numbers: tuple[int, ...]
    floors_rad: np.ndarray

    @cached_property
    def own_rad(self) -> np.ndarray:
        """Return (N, 2): each unit's own excess and its sigma."""
        return BOTH * np.array([self.joint.component(i) for i in range(len(self.joint.rows))])

    @cached_property
    def turn_rad(self) -> np.ndarray:
        """Return (2,): the common part that is equal in all turns."""
        return BOTH * np.array(self.joint.component(TURN))

    @cached_property
    def fast_rad(self) -> np.ndarray:
        """Return (2,): the part proportional to the prediction for motion beyond the data rate."""
        return self.predicted_rad * np.array(self.joint.component(FAST)) if self.predicted_rad > 0 else np.zeros(2)

    @cached_property
    def predicted_rad(self) -> float:
        """Return that prediction."""
        return float(BOTH * rms_of(self.joint.missed_rad))

    @cached_property
    def common_rad(self) -> float:
        """Return the whole common part of the turns' closure."""
        return float(np.hypot(self.turn_rad[0], self.fast_rad[0]))

    @cached_property
    def gains(self) -> dict[str, float]:
        """Return drops of -2 log likelihood from no common part, all other components estimated again: of one that is equal in all turns,
        and of one that follows the prediction."""
        joint, t = self.joint, self.joint.solution.t
        system, fast = joint.solution.system, float(np.mean(joint.missed_rad**2))
        usual = t[TURN] + t[FAST] * fast + np.median(system.base[system.V[0] > 0])
        begin = replace(joint.solution, t=np.concatenate([t[:TURN], [usual, usual / max(fast, 1e-30)], t[LEVEL_MPS2:]]))
        none, turn = (begin.held(dict.fromkeys(held, 0.0)).value for held in ((TURN, FAST), (FAST,)))
        return {"turn": none - turn, "undersampled": none - begin.held({TURN: 0.0}).value if fast else -np.inf}

    @property
    def is_fast_motion(self) -> bool:
        """Return whether the common part varies between turns as predicted for motion beyond the data rate."""
        return self.common.standing is Standing.FOR and self.gains["undersampled"] > self.gains["turn"] + SUPPORTED

    @cached_property
    def common(self) -> Statement:
        """State the error that all units share: likelihood ratio of the better of its two shapes; the larger one of their limits."""
        solution, predicted = self.joint.solution, self.predicted_rad
        found, gain = self.common_rad, max(self.gains.values())
        limits = [found, BOTH * upper_size(solution, TURN, self.joint.sigmas[TURN], (FAST,))]
        if predicted > 0:
            limits.append(predicted * upper_size(solution, FAST, self.joint.sigmas[FAST], (TURN,)))
        shared = _tilt("common error of all units", "common", float(chdtrc(1, max(gain, 0.0))), found, max(limits), rms_of(self.floors_rad))
        if shared.standing is not Standing.FOR:
            return shared
        why = "; the motion, the table or the reference, no unit's sensor"
        if predicted > 0:
            factor, sigma = self.fast_rad / predicted
            filtered = "; a filter below half the data rate leaves so little" if factor < FILTERED else ""
            why += f"; motion beyond the data rate predicts {_deg(predicted)}"
            if gain > self.gains["turn"] + SUPPORTED:
                why = f"; motion beyond the data rate, predicted {_deg(predicted)} (found {factor:.2f} ± {sigma:.2f} of it{filtered})"
        return replace(shared, more=why)

    @cached_property
    def fast(self) -> Statement | None:
        """State motion beyond the data rate, one term of all units, tested against zero and against its prediction, next to an unnamed
        common part; None where none is predicted."""
        if not (predicted := self.predicted_rad) > 0:
            return None
        solution = self.joint.solution
        factor = float(np.sqrt(solution.t[FAST]))
        p_zero = float(chdtrc(1, rise(solution, {FAST: 0.0}))) / 2 if factor > 0 else 1.0
        nearest = float(np.clip(factor, 1 / PREDICTED_WITHIN, PREDICTED_WITHIN))
        p_claimed = 1.0 if nearest == factor else float(chdtrc(1, rise(solution, {FAST: nearest**2}))) / 2
        upper = predicted * upper_size(solution, FAST, self.joint.sigmas[FAST])
        claimed = f"the predicted {_deg(predicted / PREDICTED_WITHIN)} to {_deg(predicted * PREDICTED_WITHIN)}"
        how: dict[str, Any] = {"p_claimed": p_claimed, "claimed": claimed, "more": f"; predicted {_deg(predicted)}"}
        return _tilt("motion beyond the data rate", "motion", p_zero, predicted * factor, upper, rms_of(self.floors_rad), **how)

    @cached_property
    def own_p(self) -> list[float]:
        """Return the p-value of each unit's own excess, over all units.

        A component's size over its sigma is no test near zero, where half of all estimates are zero and the others small.
        """
        solution, count = self.joint.solution, len(self.numbers)
        each = [float(chdtrc(1, rise(solution, {i: 0.0}))) / 2 if solution.t[i] > 0 else 1.0 for i in range(count)]
        return [chance_of_any(p_value, count) for p_value in each]

    @cached_property
    def own(self) -> tuple[Statement, ...]:
        """State the own error of each unit."""
        solution, found = self.joint.solution, []
        for i, (number, p_value, floor) in enumerate(zip(self.numbers, self.own_p, self.floors_rad, strict=True)):
            size, upper = BOTH * np.sqrt(solution.t[i]), BOTH * upper_size(solution, i, self.joint.sigmas[i])
            found.append(_tilt(f"own error of unit {number}", "own", p_value, size, upper, float(floor)))
        return tuple(found)

    @cached_property
    def alone(self) -> Statement:
        """State the own errors of the units: those with an excess, and the most that any of them may have."""
        there = [(number, part) for number, part in zip(self.numbers, self.own, strict=True) if part.standing is Standing.FOR]
        rest = [part.upper for part in self.own if part.standing is not Standing.FOR]
        size, upper = (max(getattr(part, what) for part in self.own) for what in ("value", "upper"))
        sizes = ", ".join(f"{_deg(part.value)} in unit {number}" for number, part in there) or f"{_deg(size)} at most"
        sizes += f", up to {_deg(max(rest))} in any other" if there and rest else ""
        p_value = min(part.p_value for part in self.own)
        return replace(_tilt("own error of each unit", "own", p_value, size, upper, rms_of(self.floors_rad)), size=sizes)

    @cached_property
    def left_rad(self) -> np.ndarray:
        """Return (S, N, 3): each unit's own error of each turn (``SameStills.spans``), NaN where it has no such turn."""
        joint, same = self.joint, self.joint.same
        spans = same.spans.tolist()
        left = np.full((len(spans), len(joint.rows), 3), np.nan)
        for i, rows in enumerate(joint.layout.closure):
            left[[spans.index([a, b]) for a, b in zip(same.first[i], same.last[i], strict=True)], i] = joint.solution.residual[rows]
        return left

    @cached_property
    def minus_mean_rad(self) -> np.ndarray:
        """Return (N,) of each unit's closure less the mean of all units', over the turns that all have; NaN where there is none."""
        whole = self.left_rad[np.isfinite(self.left_rad).all(axis=(1, 2)), :, :2]
        if not len(whole):
            return np.full(whole.shape[1], np.nan)
        return np.sqrt(np.mean(np.sum((whole - whole.mean(axis=1, keepdims=True)) ** 2, axis=2), axis=0))

    def table(self) -> dict:
        """Return ``split`` of the JSON."""
        pairs = {
            "equal_in_all_turns_deg": self.turn_rad / DEG,
            "undersampled_deg": self.fast_rad / DEG,
            "level_acceleration_mg": np.array(self.joint.component(LEVEL_MPS2)) / MG,
        }
        sizes = {name: {"size": size, "sigma": sigma} for name, (size, sigma) in pairs.items()}
        sizes["undersampled_deg"]["predicted"] = self.predicted_rad / DEG
        common, minus = self.common, rms_of(self.minus_mean_rad)
        stated = {"common_p_value": common.p_value, "is_fast_motion": self.is_fast_motion, "description": common.words}
        return in_unit(DEG, common_rms_deg=common.value, common_upper95_deg=common.upper, minus_mean_rms_deg=minus) | stated | sizes

    def turns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return of each of S turns (``SameStills.spans``) the tilt error (S, 2) common to all units, the sigma of each angle, and the
        length (S, N) of each unit's own error, NaN where it has no such turn."""
        joint, same = self.joint, self.joint.same
        variance = np.diag(joint.covariance)[joint.layout.common]
        a, b = same.spans.T
        common, squares = (np.diff(running_sum(each)[[a, b]], axis=0)[0] for each in (joint.common_rad, variance))
        return common, np.sqrt(squares), np.linalg.norm(self.left_rad, axis=2)


def _tilt(what: str, scope: str, p_value: float, size_rad: float, upper_rad: float, matters_rad: float, **how: Any) -> Statement:
    upper = max(float(upper_rad), float(size_rad))
    figures = {"scope": scope, **in_unit(DEG, size_deg=size_rad, upper95_deg=upper)}
    known: dict[str, Any] = {"value": float(size_rad), "upper": upper, "matters": matters_rad, "figures": figures}
    return Statement.of(what, "likelihood ratio", p_value, f"{_deg(size_rad)} rms a turn", _deg(upper), **known, **how)


def _deg(rad: float) -> str:
    return f"{measured(float(f'{rad / DEG:.2g}'))}°"
