"""All units of an array estimated together: one motion, and of each unit its twelve, its nine and its mounting.

Rows and unknowns are in ``rows.py``; sizes of what each unit, and all together, miss by are variance components, found by restricted
maximum likelihood with the numbers (``system.py``).  A reading of one unit that the others contradict does not count (``events.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.common.robust import sigma_of
from tinygc.array.joint.events import ArrayEvent, blocks_of, candidates, worst_of_each_turn
from tinygc.array.joint.rows import RowMap, UnitRows, array_system
from tinygc.array.joint.same_stills import SameStills
from tinygc.array.joint.state import Layout, State
from tinygc.array.joint.system import Solution, System
from tinygc.array.joint.unit_rows import common_earth, start_state, unit_rows, with_earth
from tinygc.array.joint.units import ArrayUnit
from tinygc.attitude.earth import EarthRate
from tinygc.models.linear import LinearModel
from tinygc.problem.joint import GRAVITY_SIGMA_MPS2, KNOWN_MPS2

ROUNDS = 12
#: rad, of any attitude or mounting, and share of E: a change below ends the search
SETTLED = 1e-7


@dataclass(frozen=True, eq=False)
class Joint:
    """state: where it ended; start; rows of each unit; same: the common stills; where: rows of the system; solution: the last step's, whose
    change is nothing; events; earths by yaw group; missed_rad (Q-1,) tilt that fast motion is predicted to make all miss."""

    state: State
    start: State
    rows: list[UnitRows]
    same: SameStills
    where: RowMap
    solution: Solution
    events: tuple[ArrayEvent, ...]
    earths: dict[int, EarthRate]
    missed_rad: np.ndarray

    @property
    def layout(self) -> Layout:
        """Of the numbers."""
        return Layout(len(self.rows), len(self.same))

    @property
    def models(self) -> tuple[LinearModel, ...]:
        """Of each unit, for rates as they are measured."""
        return tuple(
            model if unit.rest is None else replace(model, B=-model.E @ unit.rest)
            for model, unit in zip(self.state.models, self.rows, strict=True)
        )

    @cached_property
    def covariance(self) -> np.ndarray:
        """(count, count) of the last step's solution, which takes the units' biases to stand still (``parameters.py``)."""
        return self.solution.covariance

    @property
    def common_rad(self) -> np.ndarray:
        """(Q-1, 2) rad: the tilt by which all units miss between two stills."""
        return np.asarray(self.solution.x[self.layout.common].reshape(-1, 2))

    def component(self, name: str) -> tuple[float, float]:
        """A component's size and its sigma, as a standard deviation: rad or m/s^2; of ``common.undersampled`` a factor."""
        k = self.where.names.index(name)
        t, sigma = float(self.solution.t[k]), float(self.sigmas[k])
        size = np.sqrt(t)
        # Of one near zero, the size that its sigma stands for.
        return float(size), float(sigma / (2 * size)) if t > sigma else float(np.sqrt(sigma) if np.isfinite(sigma) else np.inf)

    @cached_property
    def sigmas(self) -> np.ndarray:
        """(G,) of the components, as variances."""
        return self.solution.sigma()


def estimate(
    units: list[ArrayUnit],
    same: SameStills,
    missed_rad: np.ndarray,
    *,
    bias: str = "ends",
    alone: bool = False,
    use_earth: bool = True,
    progress: Callable[[str], None] = lambda what: None,
) -> Joint:
    """Of all units together.

    missed_rad (Q-1,): tilt that motion beyond the data rate is predicted to make every unit miss; zeros where nothing is known of it;
    alone: of a single unit, in which what is common cannot be told from its own.
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
            system = system.without(out)
        if t is None:
            t = _first_sizes(system, where, len(rows))
            t[-3:] *= not alone
            solution = system.solved(t)
        else:
            solution = system.estimated(t, np.arange(len(t)) >= len(t) - 3 if alone else None)
            t = solution.t
        out = system.out
        new = worst_of_each_turn(candidates(solution, blocks), out) if turn else []
        if new:
            events += new
            out = out.copy()
            for event in new:
                out[event.rows] = True
        state = state.moved(solution.x, Layout(len(rows), len(same)))
        if turn > 1 and not new and np.abs(solution.x[: Layout(len(rows), len(same)).attitudes.stop]).max() < SETTLED * 10:
            break
    return Joint(state, start, rows, same, where, solution, tuple(events), earths, missed_rad)


def _first_sizes(system: System, where: RowMap, units: int) -> np.ndarray:
    """Components (G,) to begin with, from medians, which single wild readings do not move."""
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
