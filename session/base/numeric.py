"""Numeric idioms: scatter from medians, the runs of a mask, and numbers as decimal text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import CalibrationError

# Scatter of values, and from medians, which a few wild ones do not move.

#: the median of |x| of a normal x, in standard deviations
MEDIAN_SIGMAS = 0.6745


#: rows and columns of the upper triangle of a matrix (3, 3)
UPPER = np.triu_indices(3)


def rms_of(values: ArrayLike) -> float:
    """Root mean square of values (…)."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_length(vectors: np.ndarray) -> float:
    """Root mean square of the lengths of vectors (N, n)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def median_length(vectors: np.ndarray) -> float:
    """Median of the lengths of vectors (N, n)."""
    return float(np.median(np.linalg.norm(vectors, axis=1)))


def running_sum(values: ArrayLike, axis: int = 0) -> np.ndarray:
    """Sums of none, the first, the first two, … and all of the values along an axis."""
    return np.insert(np.cumsum(values, axis=axis), 0, 0, axis=axis)


def span_steps(values: np.ndarray, size: int) -> np.ndarray:
    """Differences (…, 3) between the means of neighbouring spans of ``size`` values (N, 3), at every start."""
    total = running_sum(values)
    span = (total[size:] - total[:-size]) / size
    return span[size:] - span[:-size]


def sigmas_in(covariance: np.ndarray) -> np.ndarray:
    """Standard deviations (p,) of a covariance (p, p)."""
    return np.sqrt(np.diag(covariance))


def sigma_of(deviations: np.ndarray, axis: int | None = 0) -> np.ndarray:
    """Standard deviation of normal deviations (…) about zero, from the median of their sizes along an axis (None: of all)."""
    return np.median(np.abs(deviations), axis=axis) / MEDIAN_SIGMAS


def sigma_of_steps(values: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise in values (N, …), from their steps: what changes slowly does not count."""
    return sigma_of(np.diff(values, axis=0)) / np.sqrt(2)


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """The value (of N) up to which half of the weights (N,) lie."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


def smallest_step(values: np.ndarray) -> float:
    """The register's step as seen in values (N,): the smallest difference between neighbours, or 0."""
    steps = np.diff(values)
    np.abs(steps, out=steps)
    size = max(abs(values.max()), abs(values.min()))
    return float(steps.min(initial=np.inf, where=steps > 1e-9 * max(size, 1e-300))) if (steps > 0).any() else 0.0


# Rows by their time.


def later_row(times: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Rows (…) of increasing times (N,), N of 2 or more, that with the row before lie on both sides of moments (…), or nearest to that."""
    return np.clip(np.searchsorted(times, at), 1, len(times) - 1)


def nearest_row(times: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Rows (…) of increasing times (N,), N of at least 2, nearest to moments (…); of two alike the earlier."""
    after = later_row(times, at)
    return after - (at - times[after - 1] < times[after] - at)


# Readings that are held: rows of one sensor that come faster than it measures.


def new_readings(values: np.ndarray) -> np.ndarray:
    """(N,) bool: rows (N, 3) that differ from the one before; the first does."""
    found = np.ones(len(values), dtype=bool)
    for start in range(1, len(values), BLOCK):  # of a day, no second copy
        some = values[start - 1 : start + BLOCK]
        x, y, z = (some[1:] != some[:-1]).T
        found[start : start + BLOCK] = x | y | z
    return found


def held_for(new: np.ndarray) -> int:
    """Rows for which a reading usually stands, of ``new_readings`` (N,): the median over the readings, so that neither a rest in coarse
    steps nor a limit counts for more than one."""
    if 2 * np.count_nonzero(new[1:] & new[:-1]) > np.count_nonzero(new) - 1:  # most stand for one: of a day's log no list of rows
        return 1
    rows = np.flatnonzero(new)
    return int(np.median(np.diff(rows))) if len(rows) > 2 else 1


# Runs of rows that a mask marks.


def runs_of(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First rows (R,), and rows behind the last (R,), of each run of True in a mask (N,) bool, in order: ``start <= i < stop``."""
    end = np.zeros(1, dtype=np.int8)
    edges = np.flatnonzero(np.diff(np.concatenate([end, mask.view(np.int8), end])))
    return edges[::2], edges[1::2]


# Numbers as decimal text, a whole block of rows at once: several times as fast as formatting one number after another.

#: "0000" to "9999", four bytes each
FOURS = (np.arange(10_000)[:, None] // (1000, 100, 10, 1) % 10 + ord("0")).astype(np.uint8).view(np.uint32)[:, 0]
LIMIT = 10**18
#: rows at once, as many as a processor's cache holds
BLOCK = 1 << 13
#: decimals that are tried: a register has none, a careful logger nine
MOST_DECIMALS = 9
#: zeros behind the point of a number below which Python writes an exponent
MOST_ZEROS = 4


def in_decimals(values: np.ndarray, decimals: int) -> np.ndarray | None:
    """Whole numbers of 10^-decimals that give values (…) back to the last bit, in 16 or 32 bits; None where none do.

    The quotient of two whole numbers that a float64 holds exactly is rounded once, as a decimal that is read is: the same number.
    """
    scaled = np.rint(values * 10.0**decimals) if decimals else values
    size = max(scaled.max(initial=0), -scaled.min(initial=0))
    if not size < 2**31:
        return None
    whole = scaled.astype(np.int16 if size < 2**15 else np.int32)
    same = np.array_equal(np.divide(whole, 10.0**decimals) if decimals else whole, values)
    return whole if same else None


def fewest_decimals(values: np.ndarray, least: int) -> tuple[int, np.ndarray] | None:
    """How many decimals, ``least`` or more, values (…) have, and their whole numbers; None where they have too many."""
    tried = ((decimals, in_decimals(values, decimals)) for decimals in range(least, MOST_DECIMALS + 1))
    return next(((decimals, whole) for decimals, whole in tried if whole is not None), None)


def decimal_rows(columns: list[np.ndarray], decimals: list[int]) -> bytes:
    """CSV lines of columns (N,), each a whole number of units of 10^-decimals: 12345 with 3 decimals is ``12.345``.

    int64 columns are such numbers already (time stamps: 0 decimals); floats are rounded to the nearest.
    Raises ValueError for a value that is not finite or has more than 18 digits.
    """
    parts = ([column[start : start + BLOCK] for column in columns] for start in range(0, len(columns[0]), BLOCK))
    return b"".join(_lines([_column(_whole(each, places), places) for each, places in zip(part, decimals, strict=True)]) for part in parts)


def formatted_rows(columns: list[np.ndarray], formats: list[str]) -> Iterator[bytes]:
    """CSV lines of columns (N,), many at a time, each number as its format has it: ``%d`` of integers, ``%r`` or ``%.15g`` of floats."""
    row, least = ",".join(formats) + "\n", [1] * len(columns)
    for start in range(0, len(columns[0]), BLOCK):
        part, texts = [column[start : start + BLOCK] for column in columns], []
        for number, (values, form) in enumerate(zip(part, formats, strict=True)):
            found = (
                (0, values.astype(np.int64, copy=False))
                if form == "%d"
                else fewest_decimals(values, least[number])
                if form == "%r"
                else None
            )
            if found is None:
                break
            least[number] = found[0]
            texts.append(_column(found[1], found[0], None if form == "%d" else values))
        if len(texts) == len(part):
            yield _lines(texts)
        else:
            yield "".join(map(row.__mod__, zip(*(values.tolist() for values in part), strict=True))).encode()


def _lines(columns: list[tuple[np.ndarray, np.ndarray]]) -> bytes:
    for number, (text, _) in enumerate(columns, start=1):
        text[:, -1] = ord("\n") if number == len(columns) else ord(",")
    texts, masks = zip(*columns, strict=True)
    return np.concatenate(texts, axis=1)[np.concatenate(masks, axis=1)].tobytes()


def _whole(values: np.ndarray, places: int) -> np.ndarray:
    if np.issubdtype(values.dtype, np.integer):
        whole = values
        fine = (whole > -LIMIT * 9) & (whole < LIMIT * 9)
    else:
        with np.errstate(over="ignore", invalid="ignore"):  # what is too large is refused below, in words
            scaled = np.rint(values * 10.0**places)
        fine = np.abs(scaled) < LIMIT
        whole = np.where(fine, scaled, 0).astype(np.int64)
    if not fine.all():
        raise ValueError(f"{values[int(np.argmin(fine))]} cannot be written with {places} decimals")
    return whole


def _column(whole: np.ndarray, places: int, shortest: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Sign, digits, point, digits and one byte to spare (N, W), and which of these bytes are written; shortest: the numbers (N,), where
    they are written as ``repr`` does."""
    size = np.abs(whole)
    width = max(len(str(int(size.max()))), places + 1)
    groups = -(-width // 4)
    fours = np.empty((len(whole), groups), dtype=np.uint32)
    rest = size
    for group in range(groups - 1, -1, -1):
        high = rest // 10_000
        fours[:, group] = FOURS[rest - high * 10_000]
        rest = high
    digits = fours.view(np.uint8)[:, 4 * groups - width :]
    before = width - places
    point = 1 if places else 0
    text = np.empty((len(whole), 1 + width + point + 1), dtype=np.uint8)
    mask = np.ones(text.shape, dtype=bool)
    text[:, 0], mask[:, 0] = ord("-"), whole < 0
    text[:, 1 : 1 + before] = digits[:, :before]
    if point:
        text[:, 1 + before] = ord(".")
        text[:, 2 + before : -1] = digits[:, before:]
    for i in range(before - 1):  # leading zeros; the last digit before the point always stands
        mask[:, 1 + i] = size >= 10 ** (width - 1 - i)
    if shortest is not None:
        mask[:, 0] = np.signbit(shortest)
        for i in range(places - 1, 0, -1):  # zeros at the end; the first digit behind the point always stands
            mask[:, 2 + before + i] = (text[:, 2 + before + i] != ord("0")) | mask[:, 3 + before + i] & (i < places - 1)
        if len(tiny := np.flatnonzero((size > 0) & (size < 10 ** max(places - MOST_ZEROS, 0)))):
            words = np.array([repr(value) for value in shortest[tiny].tolist()], dtype=f"S{text.shape[1] - 1}")
            text[tiny, :-1] = words.view(np.uint8).reshape(len(tiny), -1)
            mask[tiny, :-1] = text[tiny, :-1] != 0
    return text, mask


# Records as a pandas DataFrame, where pandas is installed.


def data_frame(columns: Mapping[str, Any], index: Sequence[str] | None = None) -> Any:
    """Return a DataFrame of columns by name, its rows named by ``index``.  CalibrationError where pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise CalibrationError("to_frame needs pandas: python -m pip install pandas") from None
    return pandas.DataFrame(dict(columns), index=None if index is None else list(index))


#: step of a central difference, of numbers of about one: its square is as small as rounding
SMALL = 1e-6


def derivative(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """(m, n): of a function that gives m numbers of n, at x (n,), by central differences."""
    sides = [[function(x + sign * step) for step in SMALL * np.eye(len(x))] for sign in (1, -1)]
    return (np.array(sides[0]) - np.array(sides[1])).T / (2 * SMALL)
