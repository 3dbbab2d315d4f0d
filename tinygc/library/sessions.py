"""``tinygc.accelerometer`` and ``tinygc.plan``: what the stills of a session show of the accelerometer, and what to record next."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from session.base.errors import CalibrationError, SegmentError
from session.base.records import plain, table_of
from session.base.texts import command_line
from session.detect.accelerometer import LengthFit, why_not, write_calibrated_copy
from session.detect.check_references import own_fit
from session.log.config import Accelerometer
from session.log.folder import Session, read_session
from tinygc.estimation.accelerometer import AccelerometerFit, of_lengths
from tinygc.library.arguments import public
from tinygc.library.records import Estimate, Listed, Named, Shown, accelerometer_estimates
from tinygc.library.sources import session_or_folder
from tinygc.planning.proposals import Proposal, propose
from tinygc.reporting.fit_text import lengths_page
from tinygc.reporting.terminal import Group, one_line

# ``tinygc.accelerometer``: the accelerometer alone, from gravity's length in the stills.


@dataclass(frozen=True, eq=False, repr=False)
class OwnAccelerometer(Shown):
    """Result of ``tinygc.accelerometer``."""

    #: the session, as it was given
    session: Session
    #: lengths of gravity in the stills, before and after, and how much each still counts
    lengths: LengthFit

    def __repr__(self) -> str:
        return f"<OwnAccelerometer of {self.session.name}: {len(self.lengths.before)} stills>"

    @cached_property
    def fit(self) -> AccelerometerFit:
        """The calibration with its covariance, in SI."""
        return of_lengths(self.lengths)

    @property
    def calibration(self) -> Accelerometer:
        """The calibration ``f = matrix @ (measured - bias_mps2)``, for ``Session.from_arrays(…, accelerometer=…)``."""
        return self.lengths.accelerometer

    @cached_property
    def parameters(self) -> Named[Estimate]:
        """Its nine numbers by name, as ``Fit.accelerometer_parameters``."""
        return Named(accelerometer_estimates(self.fit))

    @property
    def page(self) -> Group:
        """What the command prints, as a rich renderable."""
        return lengths_page(self.session.name, self.lengths, self.fit)

    def to_json(self) -> dict:
        """``tinygc-accelerometer/1`` (docs/formats.md)."""
        stills = len(self.lengths.before)
        return plain({"schema": "tinygc-accelerometer/1", "session": self.session.name, "stills": stills, **self.fit.to_json()})

    def save(self, folder: Path | str) -> Path:
        """Write a copy of the session with this calibration in its session.toml; returns the folder, which must be new or empty."""
        if self.session.in_memory:
            own = replace(self.calibration, source="stills")
            return replace(self.session, config=replace(self.session.config, accelerometer=own)).save(folder)
        write_calibrated_copy(self.session.folder, Path(folder), self.calibration)
        return Path(folder)


@public()
def accelerometer(session: Session | Path | str) -> OwnAccelerometer:
    """Calibrate the accelerometer alone, from gravity's magnitude in the stills of a session.

    Parameters
    ----------
    session : Session, table, str or Path
        The recording, or its folder.  The calibration of the accelerometer that it has is not used.

    Returns
    -------
    OwnAccelerometer
        ``calibration``, ``parameters`` with their sigmas, ``summary()``; ``save(folder)`` writes a copy of the session with it.

    Raises
    ------
    CalibrationError
        For data that cannot be read, and for stills that do not determine it: too few attitudes, or none in which gravity is about 1 g.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=24, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> found = tinygc.accelerometer(session)
    >>> found.parameters["bias_x"].unit
    'm/s^2'

    """
    where = session_or_folder(session)
    read = where if isinstance(where, Session) else read_session(where)
    bare = replace(read, config=replace(read.config, accelerometer=Accelerometer(source="none")))
    found = own_fit(bare)
    if found is None:
        raise SegmentError(
            f"{read.folder}: no still in which gravity is about 1 g; see `{command_line('check', read.folder)}` for its units"
        )
    if found.rung is None:
        raise SegmentError(f"{read.folder}: {why_not(found)}; rest it on all six sides and some edges")
    return OwnAccelerometer(read, found)


# ``tinygc.plan``: what to record next.


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Shown):
    """Result of ``tinygc.plan``."""

    schema = "tinygc-plan/2"
    #: the recording that the last ``explain`` requests, or None
    requested: str | None
    #: movements, the best first: ``words``, ``parameter``, and its sigma ``now`` and ``after`` in units of its target
    proposals: Listed[Proposal]
    #: how many more turns reach every target; None if not even many do
    enough: int | None

    def __repr__(self) -> str:
        return f"<Plan of {len(self.proposals)} movements>"

    @property
    def lines(self) -> list[str]:
        """What the command prints."""
        wanted, enough = self.requested, self.enough
        notes = [f"explain requests: {wanted}"] if wanted else []
        if self.proposals and enough is not None:
            notes.append(f"{enough} more turn{'s are' if enough != 1 else ' is'} enough for every target; the best first:")
        for number, move in enumerate(self.proposals, start=1):
            notes.append(f"{number}. {move.words}: {move.parameter}, {move.now:.1f} -> {move.after:.1f} times its target sigma")
        if not self.proposals:
            own = "of the accelerometer 50 ppm, or 100 where it is given, 0.05 mrad, 0.05 mg"
            done = f"every parameter has reached its target sigma (50 ppm, 0.05 mrad, 2 mdps; {own})"
            notes.append(f"{done}: nothing more is needed" + (" for the linear calibration" if wanted else ""))
        return notes

    @property
    def page(self) -> Group:
        """What the command prints, as a rich renderable."""
        return Group(*map(one_line, self.lines))

    def to_json(self) -> dict:
        """``tinygc-plan/2`` (docs/formats.md)."""
        return table_of(self)


@public()
def plan(session: Session | Path | str, *, count: int = 5) -> Plan:
    """Find which movements to record next.

    Parameters
    ----------
    session : Session, table, str or Path
        What was recorded so far, or its folder.
    count : int, optional
        Movements at most.

    Returns
    -------
    Plan
        ``proposals``, ``requested``, ``enough``, ``summary()``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted.

    Examples
    --------
    >>> import tinygc
    >>> found = tinygc.plan(tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session, count=2)
    >>> len(found.proposals)
    2

    """
    if count < 1:
        raise CalibrationError(f"count is {count!r}, expected a whole number of 1 or more")
    proposals, requested, enough = propose(session_or_folder(session), count)
    return Plan(requested, Listed(proposals), enough)
