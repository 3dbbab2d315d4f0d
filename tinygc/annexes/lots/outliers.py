"""Units that do not belong to a lot, with reasons: outlying numbers in sigmas of the lot, or their combination."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, stdtr

from tinygc.annexes.lots.hierarchy import Hierarchy, combined
from tinygc.annexes.lots.lot import OWN, SENSOR_ERRORS, LotSessions, jacobian

#: family-wise p-value, over all units and numbers, of an outlier: one false one in a hundred lots
FAMILY_P = 0.01
#: fewest units for each number of a covariance, for tests of combinations
UNITS_PER_NUMBER = 3


@dataclass(frozen=True)
class Reason:
    """Reason for an outlier: what, a number's key or ``combination``; value, of the number less the lot's mean in its unit; sigmas of the
    lot."""

    what: str
    value: float
    sigmas: float


@dataclass(frozen=True)
class Outlier:
    """A unit that does not belong: serial; session, of a unit with one session alone, else empty; p_value over the whole lot; reasons, the
    largest first; says: a sentence."""

    serial: str
    session: str
    p_value: float
    reasons: tuple[Reason, ...]
    says: str


def outliers(lot: LotSessions, found: Hierarchy) -> list[Outlier]:
    """Return the outliers, the least probable first: far from the lot, relative to its spread and their sessions' uncertainty."""
    made = []
    belief, S, J = found.belief, lot.scale, jacobian(found.mean)
    with_combinations = lot.units >= UNITS_PER_NUMBER * int(lot.known.sum())
    tails = belief.tails
    freedom = found.spread_freedom[OWN]
    own_tails = 1 / (1 / tails + 1 / np.maximum(np.nan_to_num(freedom, nan=1.0), 1.0))
    tests = lot.units * 2
    for part, chunk in lot.chunks():
        of = combined(chunk, belief.repeatability)
        told = np.logical_or.reduceat(np.einsum("sii->si", chunk.noise) < 1e7, chunk.first) & lot.known
        r = of.y - belief.beta[0] - (chunk.place - 0.5)[:, None] * belief.beta[1] * found.drifts
        whole = of.noise + belief.spread
        pulled = np.linalg.solve(whole, r[..., None])[..., 0]
        delta = np.einsum("ui,ui->u", pulled, r)
        q = np.maximum(told.sum(axis=1), 1)
        units = max(lot.units - 1, 2)
        freed = np.minimum(tails, np.maximum(units - q, 1))
        p_all = fdtrc(q, freed, delta / q) if with_combinations else np.ones(len(part))
        both = told[:, :, None] & told[:, None, :]
        moved = np.where(told, r, 0.0) @ (J * S).T
        variance = np.einsum("ni,uij,nj->un", J * S, np.where(both, whole, 0.0), J * S, optimize=True)
        z = np.where(told[:, OWN], moved / np.sqrt(np.maximum(variance, 1e-300)), 0.0)
        p_each = 2 * stdtr(own_tails, -np.abs(z))
        p = tests * np.minimum(p_all, q * np.where(told[:, OWN], p_each, 1.0).min(axis=1))
        for u in np.flatnonzero(p < FAMILY_P):
            number = int(part[u])
            alone = np.flatnonzero(p_each[u] * q[u] * tests < FAMILY_P)
            order = alone[np.argsort(-np.abs(z[u, alone]))]
            reasons = [Reason(SENSOR_ERRORS[n].key, float(moved[u, n]), float(z[u, n])) for n in order[:5]]
            if not len(alone):
                reasons = _combination(J * S, r[u], whole[u], told[u], delta[u])
            session = lot.names[lot.first[number]] if lot.count[number] == 1 else ""
            made.append(_said(lot.serials[number], session, p[u], reasons))
    return sorted(made, key=lambda each: each.p_value)


def _combination(JS: np.ndarray, r: np.ndarray, covariance: np.ndarray, told: np.ndarray, delta: float) -> list[Reason]:
    """Describe the distance of all numbers together, and the numbers least expected given the others."""
    some = np.flatnonzero(told[OWN])
    error_covariance = (JS @ np.where(told[:, None] & told, covariance, 0.0) @ JS.T)[np.ix_(some, some)]
    size = np.sqrt(np.diag(error_covariance))
    inverse = np.linalg.pinv(error_covariance / np.outer(size, size), hermitian=True)
    moved = (JS @ np.where(told, r, 0.0))[some]
    expected = inverse @ (moved / size) / np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    most = np.argsort(-np.abs(expected))[:2]
    whole = Reason("combination", float(delta), float(np.sqrt(delta)))
    return [whole, *(Reason(SENSOR_ERRORS[some[n]].key, float(moved[n]), float(expected[n])) for n in most)]


def _said(serial: str, session: str, p: float, reasons: list[Reason]) -> Outlier:
    told = []
    for reason in reasons:
        if reason.what == "combination":
            told.append("no number alone is far off, but their combination is")
        else:
            (each,) = (each for each in SENSOR_ERRORS if each.key == reason.what)
            value = f"{reason.value:+.0f}" if abs(reason.value) >= 100 else f"{reason.value:+.3g}"
            told.append(f"{each.name} {value} {each.unit} ({reason.sigmas:+.1f} sigmas)")
    single = f", of the single session {session}," if session else ""
    says = f"unit {serial or '(no serial)'}{single} does not belong to the lot: {', '.join(told)}"
    return Outlier(serial, session, float(p), tuple(reasons), says)
