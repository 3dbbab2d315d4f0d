"""A table that is turned by hand, with a dial on each axis: the verbs ask the person, and Enter says that it is done."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable

import numpy as np

from session.base.texts import printable
from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.verbs import Table, TableFault, Where

TITLE = "turned by hand: each verb asks you, Enter confirms the angle"


class Hand(Table):
    """``Table`` whose motor is a person.  ask: prints a request and returns what was typed; TableFault where nobody can answer.

    A verb asks in a thread of its own, as a machine moves by itself: ``where`` says moving until Enter, or another angle, was typed.
    """

    has_rate_mode = by_hand = True

    def __init__(self, description: Description, ask: Callable[[str], str]):
        self.description, self._ask = description, ask
        self._angles = np.zeros(len(description.axes))
        self._thread: threading.Thread | None = None
        self._fault = ""

    def home(self) -> None:
        """Ask for all dials at zero."""
        self._begin("turn every dial to 0, then press Enter", lambda typed: self._angles.fill(0.0))

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Ask for an angle; what is typed instead of Enter alone is the dial's reading."""
        name = self.description.axes[axis].name

        def done(typed: str) -> None:
            self._angles[axis] = float(typed) * DEG if typed else angle_rad

        text = f"turn {name} to {angle_rad / DEG:g} deg, at most at {rate_rps / DEG:g} dps; press Enter, or type the angle if it is another"
        self._begin(text, done)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Ask for a rate; where it ended is asked for."""
        name = self.description.axes[axis].name

        def done(typed: str) -> None:
            self._angles[axis] = float(typed or "nan") * DEG

        if rate_rps:
            self._begin(f"turn {name} at about {rate_rps / DEG:g} dps, then stop and type the angle where it ended", done)

    def where(self) -> Where:
        """What was confirmed last."""
        if self._fault:
            raise TableFault(self._fault)
        moving = self._thread is not None and self._thread.is_alive()
        return Where(self._angles.copy(), moving)

    def stop(self) -> None:
        """Say it."""
        print(printable(f"{self.description.name}: stop turning"), file=sys.stderr, flush=True)

    def close(self) -> None:
        """Nothing is held."""

    def _begin(self, text: str, done: Callable[[str], None]) -> None:
        if self._thread is not None and self._thread.is_alive():
            raise TableFault(f"{self.description.name}: the last request is not confirmed yet")

        def run() -> None:
            try:
                done(self._ask(f"{self.description.name}: {text}: ").strip())
            except (EOFError, OSError):
                self._fault = f"{self.description.name}: nobody answers at the keyboard; a table turned by hand needs a terminal"
            except ValueError:
                self._fault = f"{self.description.name}: what was typed is no angle in degrees; begin again"

        self._thread = threading.Thread(target=run, name="hand", daemon=True)
        self._thread.start()


def open_table(description: Description, clock: Clock) -> Hand:
    """A person at this terminal."""

    def ask(text: str) -> str:
        print(printable(text), end="", file=sys.stderr, flush=True)
        if not (line := sys.stdin.readline()):
            raise EOFError
        return line

    return Hand(description, ask)
