"""Joint estimate of all units of an array: one motion, and for each unit twelve gyroscope, nine accelerometer and three mounting numbers.

Rows and unknowns are in ``system.py``.  The sizes of each unit's errors, and of the common ones, are variance components, estimated
together with the numbers by restricted maximum likelihood.  A reading of one unit that the others contradict is rejected (``events.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.base.progress import Reporter, no_report
from session.base.units import NS
from tinygc.closure.joint import GRAVITY_SIGMA_MPS2, KNOWN_MPS2
from tinygc.features.arrays.events import ArrayEvent, blocks_of, candidates, worst_of_each_turn
from tinygc.features.arrays.system import (
    GYROSCOPE,
    PER_UNIT,
    ArrayState,
    Layout,
    Solution,
    UnitRows,
    array_system,
    common_earth,
    start_state,
    unit_rows,
    with_earth,
)
from tinygc.features.arrays.units import ArrayUnit, SameStills
from tinygc.inference.noise import wander_covariance
from tinygc.models.linear import BIAS, MATRIX, LinearModel

ROUNDS = 12
#: rad, of any attitude or mounting, and share of E: a smaller change ends the search
SETTLED = 1e-6


@dataclass(frozen=True, eq=False)
class Joint:
    """Result of the joint estimate.

    state: the final one; start; rows of each unit; same: the common stills; layout of the system; solution: the last step's, whose
    change is zero; events; missed_rad (Q-1,): predicted tilt error of all units from fast motion.
    """

    state: ArrayState
    start: ArrayState
    rows: list[UnitRows]
    same: SameStills
    layout: Layout
    solution: Solution
    events: tuple[ArrayEvent, ...]
    missed_rad: np.ndarray

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
        return np.asarray(self.solution.x[self.layout.common])

    def component(self, k: int) -> tuple[float, float]:
        """Return the size of the k-th component and its sigma, as a standard deviation: rad or m/s^2; of fast motion a factor."""
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
    progress: Reporter = no_report,
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
        system, layout = array_system(state, start, rows, same, missed_rad, gravity_sigma)
        blocks = blocks_of([unit.number for unit in units], rows, same, layout)
        if out is not None:
            system = replace(system, out=out)
        if t is None:  # the components as large as the white noise, for a first step
            white = [np.median(system.base[v > 0]) for v in system.V[: 2 * len(rows)]]
            t = np.array([*white, *np.where(alone, 0.0, [np.mean(white[: len(rows)]), 0.25, 1e-6])])
            solution = system.solved(t)
        else:
            solution = system.estimated(t, dict.fromkeys((-3, -2, -1), 0.0) if alone else None)
            t = solution.t
        out = system.out
        new = worst_of_each_turn(candidates(solution, blocks), out) if turn else []
        if new:
            events += new
            out = out.copy()
            for event in new:
                out[event.rows] = True
        state = state.moved(solution.x, layout)
        if turn > 1 and not new and np.abs(solution.x[: layout.level[0, 0]]).max() < SETTLED:
            break
    return Joint(state, start, rows, same, layout, solution, tuple(events), missed_rad)


# Covariance of the units' numbers: that of the joint solution, and the bias wander that it does not include.


def units_covariance(units: list[ArrayUnit], joint: Joint) -> np.ndarray:
    """Return (24 N, 24 N) of all units' numbers in the order of ``Layout``: E, B, accelerometer, mounting; for measured rates.

    A wandering bias turns the ends of its unit's turns, which moves the numbers fitted to them; where biases are from the stills, B = -E b
    has the stills' own error, and their wander.
    """
    layout = joint.layout
    covariance = joint.covariance[: layout.gravity, : layout.gravity].copy()
    design = joint.solution.system.design
    carry = np.eye(layout.gravity)
    more = np.zeros((layout.gravity, layout.gravity))
    for i, (unit, rows) in enumerate(zip(units, joint.rows, strict=True)):
        own, at = layout.unit(i, GYROSCOPE), joint.layout.closure[i]
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
