"""Sessions at several temperatures, and rest logs, in one model: E(T) and b(T)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, eq=False)
class JointFit:
    """To come."""
