"""Units and sessions that do not belong to a lot, with reasons: outlying numbers in sigmas of the lot, or their combination.

A unit is an outlier where its numbers are far from the lot's, relative to the lot's spread and its sessions' uncertainty.  A session is an
outlier where it is far from the other sessions of its own unit, or where the ratio of its closure to its floor is far above the lot's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc, stdtr

from session.io.numeric import sigma_of
from tinygc.annexes.lots.hierarchy import Hierarchy, combined
from tinygc.annexes.lots.lot import OWN, SENSOR_ERRORS, LotSessions, jacobian

#: family-wise p-value, over all units and numbers, or all sessions, of an outlier: one false one in a hundred lots
FAMILY_P = 0.01
#: fewest units for each number of a covariance, for tests of combinations
UNITS_PER_NUMBER = 3
#: fewest sessions for a spread of closures
FEWEST_CLOSURES = 8
UNIT, SESSION, UNKNOWN = "unit", "session", "unit or session"


@dataclass(frozen=True)
class Reason:
    """Reason for an outlier.

    what: a number's key, ``combination`` or ``closure``; value, of the number less the lot's mean in its unit, of a closure the ratio to
    its floor; sigmas of the lot.
    """

    what: str
    value: float
    sigmas: float


@dataclass(frozen=True)
class Outlier:
    """An outlier: serial, session (of an outlying session, else empty).

    kind: ``unit``, ``session``, or ``unit or session`` where a single session leaves that open; p_value over the whole lot; reasons, the
    largest first; says: a sentence.
    """

    serial: str
    session: str
    kind: str
    p_value: float
    reasons: tuple[Reason, ...]
    says: str


def outliers(lot: LotSessions, found: Hierarchy) -> list[Outlier]:
    """Return the outliers, the least probable first."""
    closures = _closures(lot)
    sessions, excused = _bad_sessions(lot, found, closures)
    return sorted([*sessions, *_odd_units(lot, found, closures, excused)], key=lambda each: each.p_value)


def _closures(lot: LotSessions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (S,) each: closure over floor, its sigmas above the lot's, and the p-value of that; 1 where unknown."""
    ratio = lot.closure_deg / np.where(lot.floor_deg > 0, lot.floor_deg, np.nan)
    logs = np.log(np.where(ratio > 0, ratio, np.nan))
    fine = np.isfinite(logs)
    sigmas, p = np.zeros(len(ratio)), np.ones(len(ratio))
    if fine.sum() >= FEWEST_CLOSURES:
        middle = np.median(logs[fine])
        # a closure of some dozen segments is uncertain by at least some percent
        spread = max(float(sigma_of(logs[fine] - middle)), 0.05)
        sigmas[fine] = (logs[fine] - middle) / spread
        p[fine] = stdtr(fine.sum() - 1, -sigmas[fine])
        p[ratio <= 1] = 1.0  # at its floor, however low the others are
    return ratio, sigmas, p


def _bad_sessions(lot: LotSessions, found: Hierarchy, closures: tuple) -> tuple[list[Outlier], set[int]]:
    """Return sessions that contradict their unit's others, and those with an outlying closure; the units of the former."""
    made, units = [], set()
    several = np.flatnonzero(lot.count > 1)
    per_unit = 2 * max(int(lot.count[several].sum()), 1)
    S = lot.scale
    J = jacobian(found.mean)
    for part, chunk in lot.chunks(several):
        of = combined(chunk, found.belief.repeatability)
        number = np.repeat(np.arange(len(part)), chunk.count)
        told = np.einsum("sii->si", chunk.noise) < 1e7
        own = chunk.noise + found.belief.repeatability - of.noise[number]
        d = chunk.y - of.y[number]
        far = np.einsum("si,sij,sj->s", d, np.linalg.inv(own), d)
        freedom = np.maximum(told.sum(axis=1), 1)
        p = chdtrc(freedom, far)
        for s in np.flatnonzero(p * per_unit < FAMILY_P):
            u = part[number[s]]
            mine = np.flatnonzero(number == number[s])
            if len(mine) == 2 and far[s] < far[mine].max():
                continue  # of two sessions, the one with the smaller sigmas is taken as correct
            if len(mine) > 2 and p[s] > p[mine].min():
                continue
            reasons = _numbers(J * S, d[s], own[s], told[s])
            row = lot.first[u] + int(s - chunk.first[number[s]])
            also = _closure_reason(closures, row)
            words = f"session {lot.names[row]} of unit {lot.serials[u] or '(no serial)'} disagrees with the unit's other sessions"
            which = " or the other one" if len(mine) == 2 else ""
            made.append(_said(lot.serials[u], lot.names[row], SESSION, min(1.0, p[s] * per_unit), [*reasons[:3], *also], words + which))
            units.add(int(u))
    return made, units


def _odd_units(lot: LotSessions, found: Hierarchy, closures: tuple, excused: set[int]) -> list[Outlier]:
    made, seen_sessions = [], set()
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
        rows = lot.first[part]
        closed = np.minimum.reduceat(closures[2][np.repeat(rows - chunk.first, chunk.count) + np.arange(len(chunk.y))], chunk.first)
        for u in np.flatnonzero((p < FAMILY_P) | (closed * lot.sessions < FAMILY_P)):
            number = int(part[u])
            bad = number in excused
            row = int(rows[u] + np.argmin(closures[2][rows[u] : rows[u] + chunk.count[u]]))
            closure = _closure_reason(closures, row) if closed[u] * lot.sessions < FAMILY_P else []
            if p[u] >= FAMILY_P:
                if row not in seen_sessions and not bad:
                    seen_sessions.add(row)
                    words = f"session {lot.names[row]} of unit {lot.serials[number] or '(no serial)'} closes worse than the lot's do"
                    made.append(_said(lot.serials[number], lot.names[row], SESSION, closed[u] * lot.sessions, closure, words))
                continue
            if bad and lot.count[number] == 2:
                continue  # reported already as a contradiction between its two sessions
            alone = np.flatnonzero(p_each[u] * q[u] * tests < FAMILY_P)
            order = alone[np.argsort(-np.abs(z[u, alone]))]
            reasons = [Reason(SENSOR_ERRORS[n].key, float(moved[u, n]), float(z[u, n])) for n in order[:5]]
            if not len(alone):
                reasons = _combination(J * S, r[u], whole[u], told[u], delta[u])
            kind = UNIT if lot.count[number] > 1 else SESSION if closure else UNKNOWN
            words = f"unit {lot.serials[number] or '(no serial)'} does not belong to the lot"
            if kind == UNIT:
                words += "; its sessions agree, so it is the unit"
            elif kind == UNKNOWN:
                words += "; one session alone cannot tell whether it is the unit"
                words += ", though it closes as the lot's sessions do" if np.isfinite(closures[1][row]) and closures[0][row] > 0 else ""
            else:
                words += "; its session does not close as the lot's do, so mistrust the session first"
            made.append(_said(lot.serials[number], "" if kind == UNIT else lot.names[row], kind, p[u], [*reasons, *closure], words))
    return made


def _closure_reason(closures: tuple, row: int) -> list[Reason]:
    ratio, sigmas, p = closures
    return [Reason("closure", float(ratio[row]), float(sigmas[row]))] if p[row] < FAMILY_P else []


def _numbers(JS: np.ndarray, d: np.ndarray, covariance: np.ndarray, told: np.ndarray) -> list[Reason]:
    """Return the reasons by sigmas, the largest first."""
    moved = JS @ np.where(told, d, 0.0)
    sigma = np.sqrt(np.diag(JS @ np.where(told[:, None] & told, covariance, 0.0) @ JS.T))
    z = np.where(told[OWN], moved / np.maximum(sigma, 1e-300), 0.0)
    return [Reason(SENSOR_ERRORS[n].key, float(moved[n]), float(z[n])) for n in np.argsort(-np.abs(z)) if told[OWN[n]]]


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


def _said(serial: str, session: str, kind: str, p: float, reasons: list[Reason], words: str) -> Outlier:
    told = []
    for reason in reasons:
        if reason.what == "closure":
            told.append(f"its closure is {reason.value:.2g} times its floor")
        elif reason.what == "combination":
            told.append("no number alone is far off, but their combination is")
        else:
            (each,) = (each for each in SENSOR_ERRORS if each.key == reason.what)
            value = f"{reason.value:+.0f}" if abs(reason.value) >= 100 else f"{reason.value:+.3g}"
            told.append(f"{each.name} {value} {each.unit} ({reason.sigmas:+.1f} sigmas)")
    return Outlier(serial, session, kind, float(min(p, 1.0)), tuple(reasons), f"{words}: {', '.join(told)}" if told else words)
