"""Covariances of which few elements are not zero: ``scipy.sparse`` has them as well, and takes longer to import than a fit takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Sparse:
    """A matrix (n, n): ``values`` (m,) at ``rows`` and ``columns`` (m,), each place once; zero elsewhere."""

    size: int
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, dense: np.ndarray) -> Sparse:
        """Of a matrix (n, n), without its zeros."""
        rows, columns = np.nonzero(dense)
        return cls(len(dense), rows, columns, dense[rows, columns])

    @classmethod
    def of_diagonal(cls, diagonal: np.ndarray) -> Sparse:
        """Of one whose diagonal (n,) alone is not zero."""
        at = np.flatnonzero(diagonal)
        return cls(len(diagonal), at, at, diagonal[at])

    def block(self, of: np.ndarray) -> np.ndarray:
        """Some rows and the same columns, by number (k,), as (k, k)."""
        place = np.full(self.size, -1)
        place[of] = np.arange(len(of))
        row, column = place[self.rows], place[self.columns]
        inside = (row >= 0) & (column >= 0)
        dense = np.zeros((len(of), len(of)))
        dense[row[inside], column[inside]] = self.values[inside]
        return dense

    def dense(self) -> np.ndarray:
        """(n, n)."""
        return self.block(np.arange(self.size))
