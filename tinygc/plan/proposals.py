"""What to record next: the movement that teaches most about what is known worst.

A single turn about one body axis, from a still with some axis up, adds its own closure residual: two angles, linear in the 12
parameters through the same sensitivity as everything else.  Its worth is how much it lowers the variance of the parameter that is
least certain beside its target.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from session.checks.accelerometer import with_own_accelerometer
from session.common.units import DEG
from session.log.folder import read_session
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.models import linear
from tinygc.plan.requested import requested_by_explain
from tinygc.problem.build import build_problem
from tinygc.problem.problem import Problem

#: one sigma that a 40-segment session of an ASM330LHH reaches: what is worse than this is worth another turn
TARGETS = np.array([50e-6] * 9 + [2e-3 * DEG] * 3)
TURN_DEG, TURN_S, STILL_S, RATE_HZ = 270.0, 3.0, 1.0, 100.0


@dataclass(frozen=True)
class Proposal:
    """words for the operator; parameter that it helps; sigma of that parameter now and after, in units of its target."""

    words: str
    parameter: str
    now: float
    after: float


def propose(folder: Path, count: int = 5) -> tuple[list[Proposal], str | None]:
    """Proposals for a session, and what `explain` asked for there, if it did.  Raises what ``build_problem`` raises."""
    session, _ = with_own_accelerometer(read_session(folder))
    problem = build_problem(session)
    covariance = parameter_covariance(problem.batch, problem.floor, problem.first, problem.earth, wander=problem.wander)
    return _greedy(problem, covariance, count), requested_by_explain(session.folder)


def parameter_words(name: str) -> str:
    """``E_xy`` as a person says it."""
    kind, axes = name.split("_")
    if kind == "B":
        return f"bias of {axes}"
    return f"scale of {axes[0]}" if axes[0] == axes[1] else f"misalignment of {axes[0]} towards {axes[1]}"


def _greedy(problem: Problem, covariance: np.ndarray, count: int) -> list[Proposal]:
    """The best movement, then the best after that, …, until every parameter reaches its target."""
    moves = _moves()
    weight = 1 / float(np.median(problem.floor.sigma[problem.batch.known])) ** 2
    information, proposals = np.linalg.inv(covariance), []
    for _ in range(count):
        sigma = np.sqrt(np.diag(np.linalg.inv(information))) / TARGETS
        worst = int(np.argmax(sigma))
        if sigma[worst] <= 1:
            break
        gains = [np.linalg.inv(information + weight * J.T @ J)[worst, worst] for _, J in moves]
        words, J = moves[int(np.argmin(gains))]
        information = information + weight * J.T @ J
        after = float(np.sqrt(np.linalg.inv(information)[worst, worst]) / TARGETS[worst])
        proposals.append(Proposal(words, parameter_words(linear.NAMES[worst]), float(sigma[worst]), after))
    return proposals


def _moves() -> list[tuple[str, np.ndarray]]:
    """Words and columns (2, 12) of every turn: six stills, three axes, two senses."""
    found = []
    for up, sign, axis, sense in product(range(3), (1, -1), range(3), (1, -1)):
        force = np.zeros(3)
        force[up] = sign  # an accelerometer reads +g along the axis that points up
        words = (
            f"start still with {'+-'[sign < 0]}{'xyz'[up]} up, turn {TURN_DEG:.0f}° {'positively' if sense > 0 else 'negatively'} "
            f"about the sensor's {'xyz'[axis]} axis in about {TURN_S:.0f} s, hold still"
        )
        found.append((words, _columns(rotation.from_gravity(force), axis, sense)))
    return found


def _columns(start: np.ndarray, axis: int, sense: int) -> np.ndarray:
    t = np.arange(0, TURN_S + 2 * STILL_S, 1 / RATE_HZ)
    phase = np.clip((t - STILL_S) / TURN_S, 0, 1)
    rate = np.zeros((1, len(t), 3))
    rate[0, :, axis] = sense * TURN_DEG * DEG / TURN_S * 2 * np.sin(np.pi * phase) ** 2
    dt = np.full((1, len(t) - 1), 1 / RATE_HZ)
    batch = Batch(rate, dt, np.zeros_like(rate), start[None], start[None], yaw_known=False)
    return linear.columns(closure.sensitivity(batch, rate), rate)[0, :2]
