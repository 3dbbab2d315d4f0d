"""The motion that all units of an array felt, and what each unit's rates have beyond it.

Each unit is held against the mean of the others, so that its own error is not in what it is compared with.  Rates stand in the gyroscope's
axes of the first unit; a linear map takes each unit's there, with its scales and misalignments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.array.places.clocks import ClockFit
from tinygc.array.places.rates import Rates


@dataclass(frozen=True, eq=False)
class Difference:
    """Of one unit, over all its logs, readings that all units cover.

    t_s (N,) s array clock, as stamped; log and row (N,) of each; excess (N, 3) rad/s, the unit's rate in the first unit's axes minus the
    others' mean at that moment; rate and slope (N, 3), rad/s and rad/s^2, of that mean.
    """

    t_s: np.ndarray
    log: np.ndarray
    row: np.ndarray
    excess: np.ndarray
    rate: np.ndarray
    slope: np.ndarray


class SharedMotion:
    """Rates of all units on one clock.  rates: of each unit, its logs; fits: of each unit."""

    def __init__(self, rates: Sequence[Sequence[Rates]], fits: Sequence[ClockFit]):
        self.stamped = [[each.shifted(fit.clock.array_time(each.t_s)) for each in unit] for unit, fit in zip(rates, fits, strict=True)]
        self.maps = [np.linalg.inv(fit.matrix) for fit in fits]
        self.offsets = [fit.bias for fit in fits]
        self.moved = self.stamped

    def correct(self, ages: Sequence[Sequence[np.ndarray]]) -> None:
        """Take the readings to have been made so much earlier than they are stamped: of each unit, of each log, (N,) s."""
        self.moved = [
            [each.shifted(each.t_s - age) for each, age in zip(unit, mine, strict=True)]
            for unit, mine in zip(self.stamped, ages, strict=True)
        ]

    def differences(self) -> list[Difference]:
        """Of every unit against the others, each unit's map fitted anew."""
        splines = [[each.spline() for each in unit] for unit in self.moved]
        slopes = [[spline.derivative() for spline in unit] for unit in splines]
        found, maps, offsets = [], [], []
        for unit in range(len(self.moved)):
            others = [each for each in range(len(self.moved)) if each != unit]
            parts = []
            for number, mine in enumerate(self.moved[unit]):
                covered = mine.good & np.all([self.moved[other][number].covers(mine.t_s) for other in others], axis=0)
                rows = np.flatnonzero(covered)
                at = self.stamped[unit][number].t_s[rows]
                # Held against the motion at the stamp: what the age is, is then seen whole.
                rate = np.mean([(splines[o][number](at) - self.offsets[o][number]) @ self.maps[o].T for o in others], axis=0)
                slope = np.mean([slopes[o][number](at) @ self.maps[o].T for o in others], axis=0)
                parts.append((at, np.full(len(rows), number), rows, mine.rate[rows], rate, slope))
            t_s, log, row, read, rate, slope = (np.concatenate(each) for each in zip(*parts, strict=True))
            logs = len(self.moved[unit])
            design = np.hstack([read, (log[:, None] == np.arange(logs)).astype(float)])
            age = np.concatenate([self.stamped[unit][i].t_s[part[2]] - self.moved[unit][i].t_s[part[2]] for i, part in enumerate(parts)])
            target = rate - age[:, None] * slope  # what the others say of the moment in which the reading was made
            coefficients = np.linalg.lstsq(design, target, rcond=None)[0]
            found.append(Difference(t_s, log, row, design @ coefficients - rate, rate, slope))
            maps.append(coefficients[:3].T)
            offsets.append(-np.linalg.solve(coefficients[:3].T, coefficients[3:].T).T)
        self.maps, self.offsets = maps, offsets
        return found
