"""What a stage of an embedded program offers, and what all stages share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tinygc.deploy.errors import ExportError
from tinygc.effects import Cost

__all__ = ["Cost", "Inputs", "ProgramStage", "single"]


@dataclass(frozen=True, eq=False)
class Inputs:
    """What a device hands in at each of N samples, all float32: rate (N, 3) rad/s, force (N, 3) m/s^2 pre-calibrated, temp_c (N,)."""

    rate: np.ndarray
    force: np.ndarray
    temp_c: np.ndarray

    @classmethod
    def of(cls, rate: ArrayLike, force: ArrayLike | None = None, temp_c: ArrayLike | None = None) -> Inputs:
        """Rounded to float32; what is not given is zero."""
        rates = np.asarray(rate, dtype=np.float32)
        zeros = np.zeros_like(rates)
        return cls(
            rates,
            zeros if force is None else np.asarray(force, dtype=np.float32),
            zeros[:, 0] if temp_c is None else np.asarray(temp_c, dtype=np.float32),
        )


class ProgramStage(ABC):
    """One step of a program: it changes ``float r[3]`` in place, and may read ``in`` and change ``state``.

    says: a line of the header's formula; constants: name in C -> float32 array; body: C statements; functions: C functions that the
    body calls; state: C members, state_bytes their size, start: C statements that forget all samples; cost of one sample.
    """

    says: str
    constants: dict[str, np.ndarray]
    body: str
    functions = state = start = ""
    state_bytes = 0
    cost: Cost

    @abstractmethod
    def run(self, inputs: Inputs, rate: np.ndarray) -> np.ndarray:
        """What the body does, for N samples at once and in the same order: (N, 3) float32 from (N, 3) float32."""


def single(values: ArrayLike, what: str) -> np.ndarray:
    """As float32; ExportError where that has no such number."""
    with np.errstate(over="ignore"):
        rounded = np.asarray(values, dtype=float).astype(np.float32)
    if not np.isfinite(rounded).all():
        raise ExportError(f"{what} holds numbers beyond single precision; C cannot carry it, json can")
    return rounded
