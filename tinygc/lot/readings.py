"""What each session read, as people see it: values with their stated sigmas, and whether units repeat as well as sessions state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from tinygc.lot.quantities import OWN, UNITS, seen
from tinygc.lot.sessions import LotSessions

_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Readings:
    """values and sigmas (S, 21) in people's units and their order, NaN where not told; unit (S,); first (U,): the row of each unit's first
    session."""

    values: np.ndarray
    sigmas: np.ndarray
    unit: np.ndarray
    first: np.ndarray


def readings(lot: LotSessions, J: np.ndarray) -> Readings:
    """Of all sessions; J (21, 21): people's numbers by the lot's vector, at its mean."""
    JS = J * lot.scale
    sigmas = np.empty((lot.sessions, len(UNITS)))
    for begin in range(0, lot.sessions, _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        told = lot.told[part]
        noise = np.where(told[:, :, None] & told[:, None, :], lot.covariance(part), 0.0)
        sigmas[part] = np.sqrt(np.maximum(np.einsum("snj,nj->sn", JS @ noise, JS), 0.0))
    values = seen(lot.values)
    return Readings(values, np.where(np.isfinite(values), sigmas, np.nan), lot.unit, lot.first)


@dataclass(frozen=True, eq=False)
class Stated:
    """Whether stated sigmas are those by which sessions of one unit differ: ratio (21,), 1 where they are, of freedom (21,); p_value (21,)
    of so large a ratio by chance; NaN where no unit has two sessions."""

    ratio: np.ndarray
    freedom: np.ndarray
    p_value: np.ndarray


def stated(found: Readings) -> Stated:
    """Each number alone, about each unit's own weighed mean."""
    weight = np.where(np.isfinite(found.values), 1 / found.sigmas**2, 0.0)
    y = np.where(np.isfinite(found.values), found.values, 0.0)
    total = np.add.reduceat(weight, found.first)
    mean = np.add.reduceat(weight * y, found.first) / np.where(total > 0, total, 1.0)
    chi_square = np.sum(weight * (y - mean[found.unit]) ** 2, axis=0)
    told = np.add.reduceat((weight > 0).astype(int), found.first)
    freedom = np.maximum(told - 1, 0).sum(axis=0)
    some = freedom > 0
    ratio = np.where(some, np.sqrt(chi_square / np.maximum(freedom, 1)), np.nan)
    return Stated(ratio, freedom.astype(float), np.where(some, stats.chi2.sf(chi_square, np.maximum(freedom, 1)), np.nan))


def own_numbers(lot: LotSessions) -> np.ndarray:
    """(21,) bool: which of people's numbers at least two units tell."""
    return lot.known[OWN]
