"""An array's units, each prepared as a session of its own is, but on the array's clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from session.common.errors import CalibrationError, FitError
from session.common.units import NS
from session.log.array_session import ArraySession
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.array.places.place import UnitClock, UnitPlace
from tinygc.models.linear import LinearModel
from tinygc.problem.prepared import AUTO, Prepared, prepare
from tinygc.problem.problem import Problem

#: an array of fewer has no other unit to be a reference
FEWEST_UNITS = 2


@dataclass(frozen=True, eq=False)
class ArrayUnit:
    """number; session as recorded; place where it is known to be beforehand; prepared: on the array's clock, by itself."""

    number: int
    session: Session
    place: UnitPlace
    prepared: Prepared

    @property
    def problem(self) -> Problem:
        """Of this unit alone."""
        return self.prepared.problem

    @property
    def model(self) -> LinearModel:
        """Its first linear fit, alone."""
        return self.problem.first


@dataclass(frozen=True, eq=False)
class LeftOutUnit:
    """A unit that could not be used, and why, in one line."""

    number: int
    why: str


def on_array_clock(session: Session, clock: UnitClock) -> Session:
    """The session with its stamps as the array's clock would have given them."""
    if clock.offset_s == 0 and clock.rate == 0:
        return session

    def moved(samples: Samples) -> Samples:
        t_ns = samples.t_ns - samples.t_ns[0]  # whole nanoseconds, whatever the era of the stamps
        begins_s = float(samples.t_ns[0]) * NS
        first_ns = round(float(clock.array_time(np.array([begins_s]))[0]) / NS)
        stretched = first_ns + np.rint(t_ns * (1 + clock.rate)).astype(np.int64)
        return replace(samples, t_ns=stretched)

    logs, runs = (tuple(replace(log, samples=moved(log.samples)) for log in each) for each in (session.logs, session.closures))
    # Moments that are left out are of the log's clock, too.
    exclude = tuple(replace(row, at_s=float(clock.array_time(np.array([row.at_s]))[0])) for row in session.config.exclude)
    return replace(session, config=replace(session.config, exclude=exclude), logs=logs, closures=runs)


def prepare_units(
    array: ArraySession,
    places: tuple[UnitPlace, ...],
    *,
    use_earth: bool = True,
    accelerometer: str = AUTO,
    progress: Callable[[str], None] = lambda what: None,
) -> tuple[list[ArrayUnit], list[LeftOutUnit]]:
    """Each unit's problem, and those that have none.

    places: of each unit, in the array's order.  Raises FitError where fewer than two units can be used, or the first cannot, whose body
    frame and clock are the array's.
    """
    found: list[ArrayUnit] = []
    left: list[LeftOutUnit] = []
    for number, session, place in zip(array.numbers, array.units, places, strict=True):
        progress(f"unit {number}")
        try:
            prepared = prepare(on_array_clock(session, place.clock), use_earth=use_earth, accelerometer=accelerometer)
        except CalibrationError as error:
            left.append(LeftOutUnit(number, str(error)))
            continue
        found.append(ArrayUnit(number, session, place, prepared))
    if left and left[0].number == array.numbers[0]:
        raise FitError(f"{array.name}: unit {left[0].number}, whose axes and clock are the array's, cannot be used: {left[0].why}")
    if len(found) < FEWEST_UNITS:
        raise FitError(f"{array.name}: {len(found)} of {len(array)} units can be used; unit {left[0].number}: {left[0].why}")
    return found, left
