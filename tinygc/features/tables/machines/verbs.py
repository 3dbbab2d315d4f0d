"""The five verbs of a table: home, turn to an angle, turn at a rate, where are you, stop.

A make implements ``Table``.  A verb that moves starts the motion and returns; ``where`` says when it has ended.  Nothing here moves without
``Guarded.require_move``: limits are checked before each move, whatever the machine itself would do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.errors import CalibrationError, DeviceError
from tinygc.features.tables.machines.description import Description


class TableFault(DeviceError):
    """The table reports a fault, does not answer, or does not do what it was asked to.  Exit code 3."""


class TableLimit(CalibrationError):
    """A move beyond the table's limits: it is not sent."""


@dataclass(frozen=True, eq=False)
class Where:
    """What a table answers: angles (K,) rad; moving; table_s: its own clock, where it has one."""

    angles: np.ndarray
    moving: bool
    table_s: float | None = None


class Table:
    """A machine that is connected.  All verbs raise TableFault where it does not answer, and for a fault that it reports.

    has_rate_mode: whether it turns at a rate by itself; angles_lost: it has restarted, and was not homed since; warning: what whoever lets
    it move must know.
    """

    description: Description
    has_rate_mode = angles_lost = False
    warning = ""

    def home(self) -> None:
        """Begin to search the reference marks of all axes."""
        raise NotImplementedError

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Begin to turn one axis to an angle, at most that fast (above 0)."""
        raise NotImplementedError

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn one axis at a rate with its sign, until another verb; 0 brings it to rest.

        Makes without ``has_rate_mode`` are sent turns to an angle instead.
        """
        raise NotImplementedError

    def where(self) -> Where:
        """Ask for angles and state."""
        raise NotImplementedError

    def stop(self) -> None:
        """Bring all axes to rest at once.  It may be called at any time and from any thread."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of the port; the table is at rest before."""
        raise NotImplementedError

    # What not every machine has.

    @property
    def begins(self) -> str:
        """What ``begin`` will send, as text; empty where there is nothing, or it was sent."""
        return ""

    def begin(self) -> None:
        """Send what it wants before its first motion, such as to switch its motors on; nothing the second time."""

    def look(self) -> np.ndarray:
        """Angles (K,) rad, whatever else it reports: to see whether it rests."""
        return self.where().angles

    def clear(self) -> None:
        """Clear an alarm, where a program can: only when a person has said so.  TableFault where it stays."""
        raise TableFault(f"{self.description.name}: an alarm of a {self.description.make} is cleared at the machine")

    def forget_alarm(self) -> None:
        """A person has dealt with an alarm at the machine: ask it, and do not repeat what it said before."""

    def set_zero(self) -> None:
        """A person says that every axis stands at its zero."""

    def require_rate(self, axis: int, rate_rps: float) -> None:
        """TableLimit for a rate (either sign) that its requests cannot say."""

    def require_travel(self) -> None:
        """TableLimit where the controller's own settings do not fit the description; TableFault where it does not say them."""
