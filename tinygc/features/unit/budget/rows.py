"""One budget: a quantity, the sources of its variance, what stands beside the sum, and the expanded uncertainty.

    u^2 = sum u_i^2          c_i = u_i / size of the source          U = k u,  k = t_p(nu_eff)

(GUM, JCGM 100:2008, 5.1 and annex G.4).  The variances are those of the fit's covariance, source by source, and add up to it in their order
to the last bit.  A printed column adds up to its printed sum as well: the last digits are shared out by the largest remainders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np

from session.base.records import in_unit
from tinygc.inference.solve import COVERAGE, Kind, Source, coverage_factor, effective_freedom


@dataclass(frozen=True)
class Row:
    """source: its name; kind; freedom: degrees of freedom; variance in SI; size of the source in ``size_unit``, None where it has no
    single one."""

    source: str
    kind: Kind
    freedom: float
    variance: float
    size: float | None = None
    size_unit: str = ""

    @property
    def u(self) -> float:
        """Standard uncertainty, SI; negative where the source takes variance away, as a mixture with a prior may."""
        return float(np.copysign(np.sqrt(abs(self.variance)), self.variance))


@dataclass(frozen=True)
class Beside:
    """What is known to move the quantity and is not in the sum: what; u in SI, None where nobody knows it; why, in words."""

    what: str
    u: float | None
    why: str

    def to_json(self, si: float) -> dict:
        """One entry of ``not_in_the_sum``, in a unit of this SI value."""
        return {"what": self.what, **in_unit(si, u=self.u), "why": self.why}


@dataclass(frozen=True)
class Budget:
    """The budget of one quantity: name; unit and its SI value; value in SI, None for an error that is expected to be zero; rows; beside."""

    name: str
    unit: str
    si: float
    value: float | None
    rows: tuple[Row, ...]
    beside: tuple[Beside, ...] = ()

    @property
    def shown_unit(self) -> str:
        """The unit, empty of a number without one."""
        return "" if self.unit == "1" else self.unit

    @property
    def variance(self) -> float:
        """In SI: the sum of the rows, in their order."""
        found = self.rows[0].variance
        for row in self.rows[1:]:
            found += row.variance
        return found

    @property
    def u(self) -> float:
        """Combined standard uncertainty, SI."""
        return float(np.sqrt(self.variance))

    @property
    def freedom(self) -> float:
        """Effective degrees of freedom (Welch–Satterthwaite)."""
        return effective_freedom([row.variance for row in self.rows], [row.freedom for row in self.rows])

    @property
    def k(self) -> float:
        """Coverage factor of 95 %."""
        return coverage_factor(self.freedom, COVERAGE)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k u, SI."""
        return self.k * self.u

    @property
    def largest(self) -> list[Row]:
        """The rows by their share, the largest first."""
        return sorted(self.rows, key=lambda row: -row.variance)

    def share(self, row: Row) -> float:
        """Share of a row in the variance."""
        return row.variance / self.variance

    def to_json(self) -> dict:
        """One entry of ``budgets`` of ``tinygc-budget/1``; variances in the square of SI."""
        return {
            "name": self.name,
            "unit": self.unit,
            "unit_si": self.si,
            **in_unit(self.si, value=self.value, u=self.u),
            "degrees_of_freedom": self.freedom,
            "k": self.k,
            "expanded_uncertainty": self.expanded / self.si,
            "variance_si": self.variance,
            "sources": [
                {
                    "source": row.source,
                    "type": row.kind,
                    "degrees_of_freedom": row.freedom,
                    "size": row.size,
                    "size_unit": row.size_unit,
                    "sensitivity": None if not row.size else abs(row.u) / self.si / row.size,
                    "u": row.u / self.si,
                    "variance_si": row.variance,
                    "share": self.share(row),
                }
                for row in self.rows
            ],
            "not_in_the_sum": [each.to_json(self.si) for each in self.beside],
        }


def budget_of(
    name: str,
    unit: str,
    si: float,
    value: float | None,
    sources: Iterable[Source],
    variance: Callable[[np.ndarray], float],
    sizes: dict[str, tuple[float, str]],
    beside: Sequence[Beside] = (),
) -> Budget:
    """The budget of a quantity whose variance is a linear function of a source's covariance."""
    rows = tuple(
        Row(source.name, source.kind, source.freedom, float(variance(source.covariance)), *sizes.get(source.name, (None, "")))
        for source in sources
    )
    return Budget(name, unit, si, value, rows, tuple(beside))


def apportioned(values: Sequence[float], decimals: int) -> list[float]:
    """Round values to so many decimals such that they add up to their rounded sum; the largest remainders are rounded up."""
    scale = 10.0**decimals
    scaled = np.array(values, dtype=float) * scale
    down = np.floor(scaled)
    missing = round(float(np.sum(scaled))) - int(np.sum(down))
    down[np.argsort(-(scaled - down), kind="stable")[:missing]] += 1
    return [float(value) / scale for value in down]


def decimals_of(value: float, digits: int) -> int:
    """Decimals with which a value has so many significant digits, 0 or more."""
    return max(0, digits - 1 - floor(log10(abs(value)))) if value else digits
