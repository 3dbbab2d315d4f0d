"""What frames or lines said, before and after it is known whether it counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Readings:
    """What frames or lines said: sequence (n,) int64, or None in text; t_us (n,) int64, as sent; registers (n, 7) int16;
    damaged (n,) bool, whether something unreadable came just before."""

    sequence: np.ndarray | None
    t_us: np.ndarray
    registers: np.ndarray
    damaged: np.ndarray

    def __len__(self) -> int:
        return len(self.t_us)

    def part(self, start: int, stop: int) -> Readings:
        """Those from start up to stop."""
        sequence = None if self.sequence is None else self.sequence[start:stop]
        return Readings(sequence, self.t_us[start:stop], self.registers[start:stop], self.damaged[start:stop])

    @property
    def numbers(self) -> list[int] | list[None]:
        """The sequence, one by one; None of each in text."""
        return [None] * len(self) if self.sequence is None else self.sequence.tolist()


@dataclass(frozen=True, eq=False)
class Accepted:
    """Readings that count.  t_us (n,) int64 unrolled; registers (n, 7); damaged (n,); periods (n,): sample periods since the one
    before, 1 without a loss."""

    t_us: np.ndarray
    registers: np.ndarray
    damaged: np.ndarray
    periods: np.ndarray

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """In this order."""
        return self.t_us, self.registers, self.damaged, self.periods
