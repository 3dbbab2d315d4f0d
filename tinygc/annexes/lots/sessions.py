"""The sessions of a lot as arrays, in the order of production."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from session.io.errors import CalibrationError
from session.io.numeric import sigma_of
from tinygc.annexes.lots.lot import NAMES, UNITS, UnitResult, sensor_errors

# Sessions of a lot as compact arrays, in the order of production, sized for a hundred thousand.

COUNT = len(NAMES)
TRIANGLE = np.triu_indices(COUNT)
#: variance of an unknown number, in squares of the parameter's scale: it has no weight, and matrices stay invertible
UNTOLD = 1e8
#: units processed at once: some 20 MB
CHUNK = 1024


@dataclass(frozen=True, eq=False)
class UnitChunk:
    """Units and their sessions.

    y (S, 21) and noise (S, 21, 21) in scales about the centre; first (U,) of each unit among the sessions; count (U,); place (U,), of 0 to
    1 through production; told (U,): number of values known from its sessions.
    """

    y: np.ndarray
    noise: np.ndarray
    first: np.ndarray
    count: np.ndarray
    place: np.ndarray
    told: np.ndarray


@dataclass(frozen=True, eq=False)
class LotSessions:
    """Sessions of a lot: values (S, 21), SI, NaN where unknown; covariances (S, 231), their upper triangles, in units of scale (21,).

    told (S, 21): known values.  Sessions of a unit are adjacent: first (U,), count (U,); serials (U,); place (U,): production index of the
    unit; centre (21,) and scale (21,): median and robust sigma over all sessions, SI; known (21,): numbers known of at least two units;
    twice (21,): numbers with two sessions of at least one unit.  keys, names, operators, stations (S,), closure and floor (S,) degrees;
    order (S,).
    """

    values: np.ndarray
    covariances: np.ndarray
    told: np.ndarray
    first: np.ndarray
    count: np.ndarray
    serials: list[str]
    place: np.ndarray
    centre: np.ndarray
    scale: np.ndarray
    known: np.ndarray
    twice: np.ndarray
    names: list[str]
    operators: list[str]
    stations: list[str]
    closure_deg: np.ndarray
    floor_deg: np.ndarray
    order: np.ndarray

    @property
    def units(self) -> int:
        """Return the number of units."""
        return len(self.first)

    @property
    def sessions(self) -> int:
        """Return the number of sessions."""
        return len(self.values)

    @property
    def unit(self) -> np.ndarray:
        """Return (S,): the unit of each session."""
        return np.repeat(np.arange(self.units), self.count)

    def sigmas(self) -> np.ndarray:
        """Return the stated sigmas (S, 21), SI; NaN where unknown."""
        diagonal = np.flatnonzero(TRIANGLE[0] == TRIANGLE[1])
        return np.where(self.told, np.sqrt(self.covariances[:, diagonal]) * self.scale, np.nan)

    def covariance(self, sessions: np.ndarray | slice) -> np.ndarray:
        """Return the stated covariances (…, 21, 21), in scales; ``UNTOLD`` where unknown."""
        packed = self.covariances[sessions]
        full = np.empty((len(packed), COUNT, COUNT))
        full[:, TRIANGLE[0], TRIANGLE[1]] = packed
        full[:, TRIANGLE[1], TRIANGLE[0]] = packed
        return full

    def chunks(self, units: np.ndarray | None = None, at_once: int = CHUNK) -> Iterator[tuple[np.ndarray, UnitChunk]]:
        """Yield the numbers of units and their data, chunk by chunk; all units, or the given ones."""
        numbers = np.arange(self.units) if units is None else units
        last = max(self.units - 1, 1)
        for begin in range(0, len(numbers), at_once):
            part = numbers[begin : begin + at_once]
            count = self.count[part]
            first = np.concatenate([[0], np.cumsum(count)[:-1]])
            rows = np.repeat(self.first[part] - first, count) + np.arange(count.sum())
            y = np.where(self.told[rows], (self.values[rows] - self.centre) / self.scale, 0.0)
            told = np.logical_or.reduceat(self.told[rows], first).sum(axis=1)
            yield part, UnitChunk(y, self.covariance(rows), first, count, self.place[part] / last, told)


def lot_sessions(results: Iterable[UnitResult]) -> LotSessions:
    """Collect sessions in any order; those with one key count once, and a session without a serial number is a unit of its own.

    Raises CalibrationError where fewer than two units have any value.
    """
    rows, sensor_errors = [], set()
    values, packed = [], bytearray()  # grows in place, and becomes the array without a copy
    for each in results:
        variance = np.diag(each.covariance)
        if each.key in sensor_errors or not (np.isfinite(each.values) & (variance > 0)).any():
            continue
        sensor_errors.add(each.key)
        values.append(np.array(each.values, dtype=float))
        packed += np.asarray(each.covariance, dtype=float)[TRIANGLE].tobytes()
        row = (each.serial or f"\0{each.key}", each.order, each.session, each.operator, each.station, each.closure_deg, each.floor_deg)
        rows.append(row)
    serials = np.array([row[0] for row in rows], dtype=object)
    names, of_unit = np.unique(serials.astype(str), return_inverse=True) if rows else (np.array([]), np.array([], dtype=int))
    if len(names) < 2:
        raise CalibrationError(f"a lot needs fitted sessions of two units or more, got {len(names)}; give more, or name their serials")
    order = np.array([row[1] for row in rows], dtype=float)
    made = np.full(len(names), np.inf)
    np.minimum.at(made, of_unit, order)
    place = np.empty(len(names))
    place[np.lexsort((names, made))] = np.arange(len(names))
    sort = np.lexsort((order, place[of_unit]))
    count = np.bincount(place[of_unit].astype(int))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    rows = [rows[i] for i in sort]
    all_values = np.array(values)[sort]
    covariances = np.frombuffer(packed).reshape(len(rows), -1)
    if (sort != np.arange(len(rows))).any():
        covariances = covariances[sort]
    shown = [names[i] for i in np.argsort(place)]
    serial = ["" if str(name).startswith("\0") else str(name) for name in shown]
    told, centre, scale = _scaled(all_values, covariances)
    units_telling = np.logical_or.reduceat(told, first).sum(axis=0)
    return LotSessions(
        np.where(told, all_values, np.nan),
        covariances,
        told,
        first,
        count,
        serial,
        np.arange(len(names), dtype=float),
        centre,
        scale,
        units_telling >= 2,
        np.any(np.add.reduceat(told.astype(int), first) >= 2, axis=0),
        [row[2] for row in rows],
        [row[3] for row in rows],
        [row[4] for row in rows],
        np.array([row[5] if row[5] is not None else np.nan for row in rows], dtype=float),
        np.array([row[6] if row[6] is not None else np.nan for row in rows], dtype=float),
        order[sort],
    )


def _scaled(values: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return told, centre and scale; covariances are scaled in place, with ``UNTOLD`` for unknown values."""
    i, j = TRIANGLE
    diagonal = np.flatnonzero(i == j)
    variance = covariances[:, diagonal]
    told = np.isfinite(values) & np.isfinite(variance) & (variance > 0)
    centre, scale = np.zeros(COUNT), np.ones(COUNT)
    for n in range(COUNT):
        if told[:, n].any():
            mine = values[told[:, n], n]
            centre[n] = np.median(mine)
            noise = np.sqrt(np.median(variance[told[:, n], n]))
            scale[n] = max(float(sigma_of(mine - centre[n])), noise)
    for k in range(len(i)):
        both = told[:, i[k]] & told[:, j[k]]
        covariances[:, k] = np.where(both, covariances[:, k] / (scale[i[k]] * scale[j[k]]), UNTOLD if i[k] == j[k] else 0.0)
    return told, centre, scale


# Values of each session in displayed units, with their stated sigmas, and a test of the stated sigmas by repeated sessions.

_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class SessionErrors:
    """Displayed values of all sessions.

    values and sigmas (S, 21) in displayed units and their order, NaN where unknown; unit (S,); first (U,): the row of each unit's first
    session.
    """

    values: np.ndarray
    sigmas: np.ndarray
    unit: np.ndarray
    first: np.ndarray


def session_errors(lot: LotSessions, J: np.ndarray) -> SessionErrors:
    """Convert all sessions; J (21, 21): derivative of the displayed numbers by the lot's vector, at its mean."""
    JS = J * lot.scale
    sigmas = np.empty((lot.sessions, len(UNITS)))
    for begin in range(0, lot.sessions, _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        told = lot.told[part]
        noise = np.where(told[:, :, None] & told[:, None, :], lot.covariance(part), 0.0)
        sigmas[part] = np.sqrt(np.maximum(np.einsum("snj,nj->sn", JS @ noise, JS), 0.0))
    values = sensor_errors(lot.values)
    return SessionErrors(values, np.where(np.isfinite(values), sigmas, np.nan), lot.unit, lot.first)


def stated(found: SessionErrors) -> tuple[np.ndarray, np.ndarray]:
    """Compare the stated sigmas with the differences between sessions of one unit, each number alone, about each unit's weighted mean.

    Returns ratio (21,), 1 where they agree, and p-value (21,) of so large a ratio by chance; NaN where no unit has two sessions.
    """
    weight = np.where(np.isfinite(found.values), 1 / found.sigmas**2, 0.0)
    y = np.where(np.isfinite(found.values), found.values, 0.0)
    total = np.add.reduceat(weight, found.first)
    mean = np.add.reduceat(weight * y, found.first) / np.where(total > 0, total, 1.0)
    chi_square = np.sum(weight * (y - mean[found.unit]) ** 2, axis=0)
    told = np.add.reduceat((weight > 0).astype(int), found.first)
    freedom = np.maximum(told - 1, 0).sum(axis=0)
    some = freedom > 0
    ratio = np.where(some, np.sqrt(chi_square / np.maximum(freedom, 1)), np.nan)
    return ratio, np.where(some, chdtrc(np.maximum(freedom, 1), chi_square), np.nan)
