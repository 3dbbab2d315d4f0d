"""How well the units' numbers are known: the joint solution's covariance, and what it does not know of, biases that wander."""

from __future__ import annotations

import numpy as np

from session.common.units import NS
from tinygc.array.joint.joint import Joint
from tinygc.array.joint.state import GYROSCOPE, PER_UNIT
from tinygc.array.joint.units import ArrayUnit
from tinygc.closure.bias_wander import wander_covariance
from tinygc.models.linear import BIAS, MATRIX


def units_covariance(units: list[ArrayUnit], joint: Joint) -> np.ndarray:
    """(24 N, 24 N) of all units' numbers in the order of ``state.py``: E, B, accelerometer, mounting; of the models for measured rates.

    A bias that wanders turns the ends of its unit's turns, so it moves what follows them; where biases are from the stills, B = -E b has
    the stills' own error, and their wander.
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
            middle_s = np.array([_middle_s(unit, row) for row in joint.same.turns[i]])
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
    """(24 N, S, 3): how the units' numbers follow an error of closure rows (S, 3)."""
    solution, units = joint.solution, joint.layout.gravity
    weight = np.where(solution.system.out, 0.0, 1 / solution.variance)[rows.ravel()]
    found = -joint.covariance[:units] @ (solution.system.design[rows.ravel()] * weight[:, None]).T
    return np.asarray(found.reshape(units, *rows.shape))


def _middle_s(unit: ArrayUnit, row: int) -> float:
    segment = unit.problem.used[row]
    samples = unit.problem.logs[segment.log].samples
    return float(samples.t_ns[0] * NS + segment.start_s + segment.duration_s / 2)


def unit_block(covariance: np.ndarray, index: int) -> np.ndarray:
    """(24, 24) of one unit."""
    own = slice(index * PER_UNIT, (index + 1) * PER_UNIT)
    return covariance[own, own]
