"""A lot as prior of one unit's gyroscope, and the probability that the unit belongs to it (docs/lots.md).

The next session's numbers are normal about the lot's mean, with the covariance of that mean, of the spread between units, and of the change
from session to session.  A unit that does not belong has one number, or all of them, several times as far off: both hypotheses are
weighted, and the lot contributes nothing under the second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc

from session.io.errors import CalibrationError
from tinygc.annexes.lots.lot import Lot
from tinygc.closure.prior import GaussianPrior
from tinygc.models.linear import NAMES, PARAMETERS, PRIOR_SIGMA

#: fewest units for a covariance of twelve numbers of the next unit
FEWEST_UNITS = 10
#: prior probability that a unit does not belong (benchmarks/lot_prior.py: costs and benefits)
OFF_LOT = 0.03
#: factors by which a unit that does not belong is off, in spreads of the lot: equally probable
OFF_SCALES = (3.0, 10.0, 30.0, 100.0)
#: share of the predicted covariance, from noise and prior, below which a direction is unobserved
UNSEEN = 1e-9
#: least sigma from a lot, relative to a parameter's wide prior, which keeps matrices invertible
LEAST = 1e-6


def prior_of(lot: Lot, start: np.ndarray, tails: float = np.inf) -> GaussianPrior:
    """Return the prior of the next session of a unit that belongs to the lot.

    start (12,): the centre of numbers unknown to the lot; tails: degrees of freedom; if finite, the scale matrix is used instead of the
    covariance.
    """
    mean, known = lot.mean[:PARAMETERS], np.isfinite(lot.mean[:PARAMETERS])
    known &= np.isfinite(np.diag(lot.spread)[:PARAMETERS])
    centre = np.where(known, mean, start)
    block = np.ix_(known, known)
    covariance = np.diag(PRIOR_SIGMA**2)
    spread = lot.spread[:PARAMETERS, :PARAMETERS] * ((tails - 2) / tails if 2 < tails < np.inf else 1.0)
    more = sum(np.nan_to_num(part[:PARAMETERS, :PARAMETERS], nan=0.0) for part in (lot.mean_covariance, lot.repeatability))
    covariance[block] = (spread + more)[block] + np.diag((LEAST * PRIOR_SIGMA[known]) ** 2)
    return GaussianPrior(centre, (covariance + covariance.T) / 2, known)


def require_usable(lot: Lot, sensor: str, where: str) -> None:
    """Raise CalibrationError, in one line, where a lot contains nothing on a session's sensor."""
    if lot.sensor != sensor:
        raise CalibrationError(f"{where}: a lot of {lot.sensor}, and the session's sensor is {sensor}; give the lot of its own model")
    if lot.units < FEWEST_UNITS:
        raise CalibrationError(
            f"{where}: a lot of {lot.units} units, expected at least {FEWEST_UNITS} for a prior; add sessions of more units"
        )
    known = np.isfinite(lot.mean[:PARAMETERS]) & np.isfinite(np.diag(lot.spread)[:PARAMETERS])
    if not known.any():
        raise CalibrationError(
            f"{where}: tells none of the gyroscope's {PARAMETERS} numbers; estimate the lot from sessions that were fitted"
        )
    spread = lot.spread[np.ix_(*[np.flatnonzero(known)] * 2)]
    if not np.isfinite(spread).all() or np.linalg.eigvalsh((spread + spread.T) / 2)[0] < -1e-9 * np.trace(spread):
        raise CalibrationError(f"{where}: its spread is no covariance; estimate the lot again")


@dataclass(frozen=True, eq=False)
class Belonging:
    """Membership test of a unit.

    probability that it belongs to the lot; distance from the lot's mean, in sigmas of lot and session together, over the directions
    (freedom) that the session observes; p_value of so large a one in a unit that belongs; weight: of the lot's covariance by its tails, 1
    where the lot is normal.
    """

    probability: float
    distance: float
    freedom: int
    p_value: float
    weight: float = 1.0


def belonging(prior: GaussianPrior, moved: np.ndarray, noise: np.ndarray, kept: np.ndarray, tails: float = np.inf) -> Belonging:
    """Test whether a unit belongs, from the shift of its fit with the lot's prior away from the lot's mean.

    moved (12,): the fit's vector less the centre; noise (12, 12): covariance of the fit by the session's own noise; kept (12, 12): response
    of the fit to the unit's true distance from the centre, I less the prior's share.  Unobserved directions do not move.
    """
    root = np.linalg.cholesky(prior.covariance)
    to = np.linalg.inv(root)
    y, white = to @ moved, to @ noise @ to.T
    follows = to @ kept @ root
    inside = white + follows @ follows.T
    size, axes = np.linalg.eigh((inside + inside.T) / 2)
    seen = size > UNSEEN
    project = axes[:, seen] / np.sqrt(size[seen])  # a unit that belongs is unit normal here
    d = project.T @ y
    square, freedom = float(d @ d), int(seen.sum())
    if freedom == 0:
        return Belonging(1.0 - OFF_LOT, 0.0, 0, 1.0)
    p_value = float(chdtrc(freedom, square) if not np.isfinite(tails) else fdtrc(freedom, tails, square / freedom))
    log_in = _log_in(square, freedom, tails)
    # a unit that does not belong: one number, or all, each from a normal this many times as wide
    shift = project.T @ to
    outside = []
    for scale in OFF_SCALES:
        more = scale**2 - 1
        whole = project.T @ follows
        outside.append((_log_normal(d, np.eye(freedom) + more * whole @ whole.T), 0.5))
        for k in np.flatnonzero(prior.known):
            alone = (shift @ kept[:, k]) * np.sqrt(prior.covariance[k, k])
            outside.append((_log_normal(d, np.eye(freedom) + more * np.outer(alone, alone)), 0.5 / prior.known.sum()))
    logs = np.array([log + np.log(share / len(OFF_SCALES)) for log, share in outside])
    log_out = float(np.logaddexp.reduce(logs))
    odds = np.log1p(-OFF_LOT) + log_in - np.log(OFF_LOT) - log_out
    weight = (tails + freedom) / (tails + square) if np.isfinite(tails) else 1.0
    return Belonging(float(1 / (1 + np.exp(-np.clip(odds, -700, 700)))), float(np.sqrt(square)), freedom, p_value, weight)


def _log_in(square: float, freedom: int, tails: float) -> float:
    if not np.isfinite(tails):
        return -square / 2
    from scipy.stats import multivariate_t

    found = multivariate_t.logpdf(np.append(np.sqrt(square), np.zeros(freedom - 1)), np.zeros(freedom), np.eye(freedom), tails)
    return float(found) + freedom / 2 * np.log(2 * np.pi)


def _log_normal(d: np.ndarray, covariance: np.ndarray) -> float:
    """Return the log density at d, less that of a unit normal at zero."""
    half = np.linalg.cholesky(covariance)
    return float(-np.sum(np.linalg.solve(half, d) ** 2) / 2 - np.log(np.diag(half)).sum())


def farthest(lot: Lot, vector: np.ndarray, covariance: np.ndarray, seen: np.ndarray) -> tuple[str, float] | None:
    """Return the parameter, of those observed (12,), that is farthest from the lot's mean, and its distance in sigmas of the lot.

    The fit is without the lot's prior; None where no parameter is observed.
    """
    sigma = np.sqrt(np.diag(lot.spread)[:PARAMETERS])
    off = vector - lot.mean[:PARAMETERS]
    both = np.abs(off) / np.sqrt(sigma**2 + np.diag(covariance))
    both[~(seen & np.isfinite(both))] = -1.0
    worst = int(np.argmax(both))
    return None if both[worst] < 0 else (NAMES[worst], float(off[worst] / max(sigma[worst], LEAST * PRIOR_SIGMA[worst])))
