"""Joint estimate of all units, and the split of the closure into a common part and each unit's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from session.base.numeric import sigma_of
from session.base.progress import Told, untold
from session.base.units import DEG, NS
from tinygc.closure.joint import GRAVITY_SIGMA_MPS2, KNOWN_MPS2
from tinygc.features.arrays.system import (
    GYROSCOPE,
    PER_UNIT,
    ArrayState,
    ParameterLayout,
    RowMap,
    Solution,
    System,
    UnitRows,
    array_system,
    common_earth,
    start_state,
    unit_rows,
    with_earth,
)
from tinygc.features.arrays.units import ArrayUnit, SameStills
from tinygc.inference.choose import LEVEL, ONE_SIDED
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import BIAS, MATRIX, LinearModel

# Events beyond an array's usual errors: a reading of one unit that the others contradict, a turn that all miss alike.

#: family-wise probability, over all blocks of rows of an array
RARE_P = 0.01

OWN_TURN, OWN_STILL, COMMON_TURN, COMMON_STILL = "turn", "still", "common turn", "common still"


@dataclass(frozen=True, eq=False)
class ArrayEvent:
    """An outlying block of rows.

    what: ``turn`` or ``still`` of one unit, ``common turn`` or ``common still`` of all; unit: its index among the units, None of all;
    rival: of two units, the other one where it contradicts as much, so that the faulty one is unknown; first, last: the array's stills
    around it; size: rad or m/s^2; p_value: of one as large by chance, family-wise; rows of the system.
    """

    what: str
    unit: int | None
    first: int
    last: int
    size: float
    p_value: float
    rows: np.ndarray
    rival: int | None = None

    def together(self, events: Sequence[ArrayEvent]) -> tuple[ArrayEvent, ...]:
        """Return the events of single units in the same turn or still; with more than one unit, none is a sensor's own."""
        return tuple(e for e in events if e.unit is not None and (e.what, e.first, e.last) == (self.what, self.first, self.last))


class Blocks(NamedTuple):
    """what rows are of, and the index of their unit; rows (B, d) that are kept or rejected together; spans (B, 2) stills."""

    what: str
    unit: int | None
    rows: np.ndarray
    spans: np.ndarray


def blocks_of(rows: list[UnitRows], same: SameStills, where: RowMap) -> list[Blocks]:
    """Return the blocks of every unit's turns and stills, and of the common part."""
    q = np.arange(len(same))
    return [
        *(Blocks(OWN_TURN, i, where.closure[i], np.column_stack([unit.first, unit.last])) for i, unit in enumerate(rows)),
        *(Blocks(OWN_STILL, i, where.force[i], np.column_stack([unit.stills, unit.stills])) for i, unit in enumerate(rows)),
        Blocks(COMMON_TURN, None, where.common, np.column_stack([q[:-1], q[1:]])),
        Blocks(COMMON_STILL, None, where.level, np.column_stack([q, q])),
    ]


def candidates(solution: Solution, blocks: list[Blocks]) -> list[ArrayEvent]:
    """Return each block's event, with the family-wise probability that chance makes one as large.

    A block's share in the estimate of its own component is removed: an F test of its residual against those of the others.
    """
    from scipy.stats import f

    total = sum(len(each.rows) for each in blocks)
    found = []
    for what, unit, rows, spans in blocks:
        chi, error = solution.blocks(rows)
        d = rows.shape[1]
        counted = np.asarray(~solution.system.out[rows].any(axis=1))
        m = int(counted.sum())
        for b in range(len(chi)):
            others = m - counted[b]
            left = d * m - chi[b] if counted[b] else d * m
            freedom = d * max(others, 1)
            p = float(f.sf(chi[b] / d / max(left / freedom, 0.1), d, freedom))
            size = float(np.linalg.norm(error[b]))
            first, last = (int(q) for q in spans[b])
            found.append(ArrayEvent(what, unit, first, last, size, min(1.0, p * total), rows[b]))
    return found


def _worst_of_each_turn(found: list[ArrayEvent], out: np.ndarray) -> list[ArrayEvent]:
    """Return the new events, at most one of each turn or still, since one bad reading also shows in the rows that share its turn."""
    best: dict[tuple[bool, int], ArrayEvent] = {}
    for event in found:
        if event.p_value > RARE_P or out[event.rows].all():
            continue
        key = (event.first == event.last, event.first)
        if key not in best or event.p_value < best[key].p_value or (event.p_value == best[key].p_value and event.size > best[key].size):
            best[key] = event
    units = {event.unit for event in found if event.unit is not None}
    return [_with_rival(event, found) if len(units) == 2 else event for event in best.values()]


def _with_rival(event: ArrayEvent, found: list[ArrayEvent]) -> ArrayEvent:
    """Add the rival in an array of two units, where in yaw each is the only reference of the other."""
    same = [e for e in found if e.unit not in (None, event.unit) and (e.what, e.first, e.last) == (event.what, event.first, event.last)]
    rival = next((other.unit for other in same if other.p_value <= RARE_P), None)
    return replace(event, rival=rival) if event.unit is not None else event


# Joint estimate of all units of an array: one motion, and for each unit twelve gyroscope, nine accelerometer and three mounting numbers.
#
# Rows and unknowns are in ``system.py``. The sizes of each unit's errors, and of the common ones, are variance components, estimated
# together with the numbers by restricted maximum likelihood. A reading of one unit that the others contradict is rejected.

ROUNDS = 12
#: rad, of any attitude or mounting, and share of E: a smaller change ends the search
SETTLED = 1e-6


@dataclass(frozen=True, eq=False)
class Joint:
    """Result of the joint estimate.

    state: the final one; start; rows of each unit; same: the common stills; where: rows of the system; solution: the last step's, whose
    change is zero; events; missed_rad (Q-1,): predicted tilt error of all units from fast motion.
    """

    state: ArrayState
    start: ArrayState
    rows: list[UnitRows]
    same: SameStills
    where: RowMap
    solution: Solution
    events: tuple[ArrayEvent, ...]
    missed_rad: np.ndarray

    @property
    def layout(self) -> ParameterLayout:
        """Return the layout of the numbers."""
        return ParameterLayout(len(self.rows), len(self.same))

    @property
    def models(self) -> tuple[LinearModel, ...]:
        """Return each unit's model for measured rates."""
        return tuple(
            model if unit.rest is None else replace(model, B=-model.E @ unit.rest)
            for model, unit in zip(self.state.models, self.rows, strict=True)
        )

    @cached_property
    def covariance(self) -> np.ndarray:
        """Return (count, count) of the last step's solution, which assumes constant biases of the units."""
        return self.solution.covariance

    @property
    def common_rad(self) -> np.ndarray:
        """Return (Q-1, 2) rad: the tilt error common to all units between two stills."""
        return np.asarray(self.solution.x[self.layout.common].reshape(-1, 2))

    def component(self, name: str) -> tuple[float, float]:
        """Return a component's size and its sigma, as a standard deviation: rad or m/s^2; of ``common.undersampled`` a factor."""
        k = self.where.names.index(name)
        t, sigma = float(self.solution.t[k]), float(self.sigmas[k])
        size = np.sqrt(t)
        # for a component near zero, the size that its sigma stands for
        return float(size), float(sigma / (2 * size)) if t > sigma else float(np.sqrt(sigma) if np.isfinite(sigma) else np.inf)

    @cached_property
    def sigmas(self) -> np.ndarray:
        """Return the sigmas (G,) of the components, as variances."""
        return self.solution.sigma()


def estimate(
    units: list[ArrayUnit],
    same: SameStills,
    missed_rad: np.ndarray,
    *,
    bias: str = "ends",
    alone: bool = False,
    use_earth: bool = True,
    progress: Told = untold,
) -> Joint:
    """Estimate all units jointly.

    missed_rad (Q-1,): predicted tilt error of every unit from motion beyond the data rate, zero where unknown; alone: for a single unit,
    whose common errors cannot be separated from its own.
    """
    rows = [unit_rows(unit, i, same, bias) for i, unit in enumerate(units)]
    start = state = start_state(units, rows, same)
    site = units[0].problem.session.config.site
    free = all(unit.problem.joint is not None and unit.problem.joint.mode == "fit" for unit in units)
    gravity_sigma = max(site.gravity_sigma_mps2, KNOWN_MPS2) if free else GRAVITY_SIGMA_MPS2
    earths = {int(g): units[same.anchor].problem.earths[int(g)] for g in np.unique(same.group)}
    t: np.ndarray | None = None
    events: list[ArrayEvent] = []
    out: np.ndarray | None = None
    for turn in range(ROUNDS):
        progress(f"joint estimate, round {turn + 1}")
        if use_earth and turn < 3:
            earths = common_earth(units, state, same)
            rows = [
                with_earth(unit, model, M, state, same.group, earths)
                for unit, model, M in zip(rows, state.models, state.mountings, strict=True)
            ]
        system, where = array_system(state, start, rows, same, missed_rad, gravity_sigma)
        blocks = blocks_of(rows, same, where)
        if out is not None:
            system = replace(system, out=out)
        if t is None:
            t = _first_sizes(system, where, len(rows))
            t[-3:] *= not alone
            solution = system.solved(t)
        else:
            solution = system.estimated(t, np.arange(len(t)) >= len(t) - 3 if alone else None)
            t = solution.t
        out = system.out
        new = _worst_of_each_turn(candidates(solution, blocks), out) if turn else []
        if new:
            events += new
            out = out.copy()
            for event in new:
                out[event.rows] = True
        state = state.moved(solution.x, ParameterLayout(len(rows), len(same)))
        if turn > 1 and not new and np.abs(solution.x[: ParameterLayout(len(rows), len(same)).attitudes.stop]).max() < SETTLED:
            break
    return Joint(state, start, rows, same, where, solution, tuple(events), missed_rad)


def _first_sizes(system: System, where: RowMap, units: int) -> np.ndarray:
    """Return initial components (G,) from medians, which are robust to outliers."""
    usual = np.array([np.median(system.base[v > 0]) for v in system.V[: 2 * units]])
    t = np.concatenate([usual, [np.mean(usual[:units]), 0.25, 1e-6]])
    for _ in range(3):
        found = system.solved(t)
        for i, rows in enumerate((*where.closure, *where.force)):
            spare = np.maximum(1 - found.leverage[rows], 0.1)
            t[i] = max(float(sigma_of((found.residual[rows] / np.sqrt(spare)).ravel())) ** 2 - usual[i], 0.01 * usual[i])
        spare = np.maximum(1 - found.leverage[where.common], 0.05)
        t[-3] = max(float(sigma_of((found.residual[where.common] / np.sqrt(spare)).ravel())) ** 2, 0.01 * np.mean(usual[:units]))
    return t


# Covariance of the units' numbers: that of the joint solution, and the bias wander that it does not include.


def units_covariance(units: list[ArrayUnit], joint: Joint) -> np.ndarray:
    """Return (24 N, 24 N) of all units' numbers in the order of ``ParameterLayout``: E, B, accelerometer, mounting; for measured rates.

    A wandering bias turns the ends of its unit's turns, which moves the numbers fitted to them; where biases are from the stills, B = -E b
    has the stills' own error, and their wander.
    """
    layout = joint.layout
    covariance = joint.covariance[: layout.gravity, : layout.gravity].copy()
    design = joint.solution.system.design
    carry = np.eye(layout.gravity)
    more = np.zeros((layout.gravity, layout.gravity))
    for i, (unit, rows) in enumerate(zip(units, joint.rows, strict=True)):
        own, at = layout.unit(i, GYROSCOPE), joint.where.closure[i]
        instability = unit.problem.instability.rps
        if rows.rest is None:
            turns = [unit.problem.used[row] for row in joint.same.turns[i]]
            begins_s = [float(unit.problem.logs[turn.log].samples.t_ns[0] * NS) for turn in turns]
            middle_s = np.array([begin + turn.start_s + turn.duration_s / 2 for begin, turn in zip(begins_s, turns, strict=True)])
            wander = wander_covariance(middle_s, instability_rps=instability)
            bias = design[at][..., own][..., BIAS]  # (S, 3, 3)
            pull = np.einsum("psd,sdi->psi", _response(joint, at), bias)
            more += np.einsum("psi,st,qti->pq", pull, wander, pull, optimize=True)
            continue
        rest, E = rows.rest, joint.models[i].E
        block = np.eye(GYROSCOPE.stop)
        block[BIAS, MATRIX] = -np.kron(np.eye(3), rest)
        block[BIAS, BIAS] = 0.0
        carry[own, own] = block
        rates = unit.problem.still_rates
        assert rates.middle_s is not None
        count = len(rates.sigma)
        white = np.diag(np.sum(rates.sigma**2, axis=0) / count**2)
        wander = wander_covariance(rates.middle_s, instability_rps=instability).mean() * np.eye(3)
        place = np.arange(layout.gravity)[own][BIAS]
        more[np.ix_(place, place)] += E @ (white + wander) @ E.T
    return carry @ covariance @ carry.T + more


def _response(joint: Joint, rows: np.ndarray) -> np.ndarray:
    """Return (24 N, S, 3): the response of the units' numbers to an error of closure rows (S, 3)."""
    solution, units = joint.solution, joint.layout.gravity
    weight = np.where(solution.system.out, 0.0, 1 / solution.variance)[rows.ravel()]
    found = -joint.covariance[:units] @ (solution.system.design[rows.ravel()] * weight[:, None]).T
    return np.asarray(found.reshape(units, *rows.shape))


def unit_block(covariance: np.ndarray, index: int) -> np.ndarray:
    """Return (24, 24) of one unit."""
    own = slice(index * PER_UNIT, (index + 1) * PER_UNIT)
    return covariance[own, own]


# Limits of variance components by the profile of the restricted likelihood.

#: relative precision of a limit, and most steps of each part of its search
NEAR, MOST_STEPS = 0.03, 12


def rise(solution: Solution, held: dict[int, float]) -> float:
    """Return by how much -2 log likelihood rises where components have these values, all others estimated anew."""
    return solution.held(held).value - solution.value


def upper_component(solution: Solution, k: int, sigma: float, zero: Sequence[int] = ()) -> float:
    """Return the largest value of component k that is not excluded with 95 %, all others free; infinite where none is excluded.

    sigma: of the component, with which the search steps; zero: components held at zero meanwhile.  Where these alone are excluded, the
    value that is best without them.
    """
    nothing = dict.fromkeys(zero, 0.0)
    low = float(solution.t[k])
    if nothing:
        without = solution.held(nothing)
        low = float(without.t[k])
        if without.value - solution.value >= ONE_SIDED**2:
            return low
    step = sigma if np.isfinite(sigma) and sigma > 0 else max(low, 1e-3 * float(np.median(solution.system.base)))
    high = low + ONE_SIDED * step
    for _ in range(MOST_STEPS):
        if rise(solution, {k: high, **nothing}) >= ONE_SIDED**2:
            break
        low, high = high, high + 2 * (high - low)
    else:
        return np.inf
    for _ in range(MOST_STEPS):
        if high - low <= NEAR * high:
            break
        middle = (low + high) / 2
        low, high = (low, middle) if rise(solution, {k: middle, **nothing}) >= ONE_SIDED**2 else (middle, high)
    return high


# Split of the closure error beyond noise: a part common to all units is not a sensor error, a part in one unit only is its own.
#
# Common causes are motion beyond the data rate (of units that are read at the same times), the reference (a body that is not at rest in a
# still) and any rotation of the body that the readings miss. The size between two stills is gamma (``system.py``).

#: drop of -2 log likelihood that ``motion beyond the data rate`` needs against an unnamed common part, and against none
BORNE_OUT = 2.0
#: share of the predicted size; below it, a filter passes only a part (predictions hold within a factor of 1.5)
FILTERED = 1 / 3


@dataclass(frozen=True, eq=False)
class TurnSplit:
    """Split of one turn between stills first and last.

    common_rad (2,): tilt error common to all units, sigma_rad of each angle; own_rad (N,): length of each unit's own error, NaN where it
    has no such turn.
    """

    first: int
    last: int
    common_rad: np.ndarray
    sigma_rad: np.ndarray
    own_rad: np.ndarray


@dataclass(frozen=True, eq=False)
class VarianceSplit:
    """Tilt errors, both angles together, rms over the turns, rad.

    own (N, 2): each unit's own excess and its sigma, and own_p (N,) of one as large by chance, over all units; turn (2,): the common part
    that is equal in all turns; fast (2,): the part proportional to the prediction for motion beyond the data rate, and its sigma;
    predicted: that prediction; level_mps2 (2,); gains: drop of -2 log likelihood with a common part that is equal in all turns, and with
    one that follows the prediction; minus_mean_rad: unit minus mean; turns; common_upper: upper 95 % limit of the common part.
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
    common_upper: float = np.inf

    @property
    def common(self) -> float:
        """Return the whole common part of the turns' closure, rad."""
        return float(np.hypot(self.turn[0], self.fast[0]))

    @property
    def p_value(self) -> float:
        """Return the p-value of no common part: likelihood ratio, zero half of the time (Self & Liang 1987)."""
        gain = max(self.gains.values())
        return float(chi2.sf(max(gain, 0.0), 1)) if gain > 0 else 1.0

    @property
    def is_fast_motion(self) -> bool:
        """Return whether the common part varies between turns as predicted for motion beyond the data rate."""
        return self.p_value < LEVEL and self.gains["undersampled"] > self.gains["turn"] + BORNE_OUT

    @property
    def words(self) -> str:
        """Describe the common part in one sentence."""
        if self.p_value >= LEVEL:
            limit = f", below {self.common_upper / DEG:.2g}° with 95 %" if np.isfinite(self.common_upper) else ""
            size = f"{self.common / DEG:.2g}° rms a turn{limit} (p = {self.p_value:.2g})"
            return f"undecided whether turns have more than noise in common: {size}"
        size = f"{self.common / DEG:.2g}° rms a turn in common, which no unit's sensor has made"
        if self.is_fast_motion:
            factor, sigma = (part / self.predicted for part in self.fast)
            why = "; a filter below half the data rate leaves so little" if factor < FILTERED else ""
            predicted = f"predicted {self.predicted / DEG:.2g}° (found {factor:.2f} ± {sigma:.2f} of it{why})"
            return f"{size}: motion beyond the data rate, {predicted}"
        fast = f"; motion beyond the data rate is predicted to make {self.predicted / DEG:.2g}°" if self.predicted > 0 else ""
        return f"{size}: the motion, the table or the reference{fast}"


def split_of(joint: Joint) -> VarianceSplit:
    """Split the closure of a joint estimate of two units or more."""
    count = len(joint.rows)
    predicted = float(np.sqrt(2 * np.mean(joint.missed_rad**2)))
    both = np.sqrt(2)
    own = np.array([joint.component(f"turn.{i}") for i in range(count)]) * both
    turn, fast = (joint.component(f"common.{name}") for name in ("turn", "undersampled"))
    minus, of_unit = _minus_mean(joint)
    return VarianceSplit(
        own,
        excess_p_values(joint),
        _times(turn, both),
        _times(fast, predicted),
        predicted,
        joint.component("common.level"),
        _gains_of(joint),
        minus,
        of_unit,
        _turns(joint),
        common_upper_of(joint, predicted),
    )


def common_upper_of(joint: Joint, predicted: float) -> float:
    """Return the upper 95 % limit of the whole common part, rad rms a turn: the larger one of the two shapes that it may have."""
    solution, sigmas = joint.solution, joint.sigmas
    turn, fast = len(solution.t) - 3, len(solution.t) - 2
    limits = [np.sqrt(2 * upper_component(solution, turn, sigmas[turn], (fast,)))]
    if predicted > 0:
        limits.append(predicted * np.sqrt(upper_component(solution, fast, sigmas[fast], (turn,))))
    found = np.hypot(np.sqrt(2 * solution.t[turn]), predicted * np.sqrt(solution.t[fast]))
    return float(max(*limits, found))


def excess_p_values(joint: Joint) -> np.ndarray:
    """Return (N,) p-values of each unit's own excess, over all units: likelihood ratio, zero half of the time (Self & Liang 1987).

    A component's size over its sigma is no test near zero, where half of all estimates are zero and the others small.
    """
    solution, count = joint.solution, len(joint.rows)
    p = np.ones(count)
    for i in range(count):
        if not solution.t[i] > 0:
            continue
        gain = rise(solution, {i: 0.0})
        p[i] = min(1.0, count * float(chi2.sf(max(gain, 0.0), 1)) / 2)
    return p


def _times(size: tuple[float, float], factor: float) -> tuple[float, float]:
    """Scale a size and its sigma by the factor."""
    return (factor * size[0], factor * size[1]) if factor > 0 else (0.0, 0.0)


def _gains_of(joint: Joint) -> dict[str, float]:
    """Return ``VarianceSplit.gains``: drops of -2 log likelihood from no common part, all other components estimated anew."""
    system, t = joint.solution.system, joint.solution.t
    fast = float(np.mean(joint.missed_rad**2))
    usual = t[-3] + t[-2] * fast + np.median(system.base[system.V[0] > 0])
    values = {}
    for name, held in (("none", (-3, -2)), ("turn", (-2,)), ("undersampled", (-3,))):
        begin = replace(joint.solution, t=np.concatenate([t[:-3], [usual, usual / max(fast, 1e-30)], t[-1:]]))
        values[name] = begin.held(dict.fromkeys(held, 0.0)).value if name != "undersampled" or joint.missed_rad.any() else np.inf
    return {name: values["none"] - values[name] for name in ("turn", "undersampled")}


def _minus_mean(joint: Joint) -> tuple[float, np.ndarray]:
    """Return rad rms of tilt over the turns that all units have, and for each unit its closure minus the mean of all units'."""
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
        found.append(TurnSplit(int(a), int(b), common[a:b].sum(axis=0), np.sqrt((sigma[a:b] ** 2).sum(axis=0)), own))
    return tuple(found)
