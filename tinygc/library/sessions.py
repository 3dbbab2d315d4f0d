"""``tinygc.check``, ``tinygc.simulate`` and others: what is known of sessions, what is done before a fit, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from session.detect.accelerometer import LengthFit, why_not, write_calibrated_copy
from session.detect.check_references import own_fit
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder, check_session
from session.detect.stills import SessionStills
from session.io.annexes import need
from session.io.config import Accelerometer, Protocol, Site
from session.io.errors import CalibrationError, DataError, SegmentError
from session.io.folder import Session, read_session
from session.io.names import CLOCKS, is_array
from session.io.texts import command_line
from session.io.units import DEG, G
from tinygc.closure.prepared import first_look_at_fit
from tinygc.effects import Effect, Movement, effect_of
from tinygc.effects.movement import vibration
from tinygc.estimation.accelerometer import AccelerometerFit, of_lengths
from tinygc.library.arguments import chosen, public, session_or_folder
from tinygc.library.records import Estimate, Listed, Named, Shown, accelerometer_estimates
from tinygc.noise.measured import measured_noise
from tinygc.planning.proposals import Proposal, RecordingPlan, propose
from tinygc.reporting.fit_text import lengths_page
from tinygc.reporting.terminal import Group, one_line
from tinygc.simulation.options import BIAS_DIGITS, MATRIX_DIGITS, SimulationOptions
from tinygc.simulation.simulator import Distort, RegisterLog, Simulation, plan_of, simulate_session
from tinygc.simulation.write import stopped_turns, truth_table, write_simulation

# ``tinygc.check``: the first look at a session, or at a folder whose logs may be unreadable.


@public()
def check(session: Any, clock: str = CLOCKS[0]) -> list[Finding]:
    """Check a recording before a fit: rates, scales, stills, turns, gaps, the accelerometer.

    Parameters
    ----------
    session : Session, ArraySession, str or Path
        The recording, or its folder.
    clock : {"board", "arrivals"}, optional
        Times as the board stamped them, or divided by ``sensor.clock_ratio``; of one sensor.

    Returns
    -------
    list of Finding
        In the order of the checks: ``level`` (ok, note, warning, error), ``where``, ``what``, ``says``, ``do``.  In a folder, a log
        that cannot be read is an error among the findings.  For an array, ``where`` begins with the unit's number.

    Raises
    ------
    CalibrationError
        If ``session`` is not a recording, or has no such clock.

    Examples
    --------
    >>> import tinygc
    >>> findings = tinygc.check(tinygc.simulate(segments=12, odr_hz=104.0, seed=1).session)
    >>> any(finding.level == "error" for finding in findings)
    False

    """
    if isinstance(session, Session):
        found = SessionStills(session := session.on_clock(clock))
        findings = check_session(session, found)
        return findings if worst(findings) == "error" else findings + first_look_at_fit(session, found, measured_noise())
    if isinstance(session, str | PathLike):
        folder = Path(session)
        if not is_array(folder):
            return check_folder(folder, partial(first_look_at_fit, at_rest=measured_noise()), clock)
        if clock != CLOCKS[0]:
            raise CalibrationError(f"{folder}: an array, whose units have clocks of their own; leave --clock {clock} out")
        read_array = need("recordings of arrays").read_array
        try:
            session = read_array(folder)
        except CalibrationError as error:
            return [Finding("error", folder.name, "reading", str(error))]
    elif not hasattr(session, "units"):
        session_or_folder(session)
    return need("checks of arrays").check_array(session, first_look_at_fit)


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
        return {"schema": "tinygc-accelerometer/1", "session": self.session.name, "stills": stills, **self.fit.to_json()}

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
    session : Session, str or Path
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

    result: RecordingPlan

    def __repr__(self) -> str:
        return f"<Plan of {len(self.proposals)} movements>"

    @property
    def proposals(self) -> Listed[Proposal]:
        """Movements, the best first: ``words``, ``parameter``, and its sigma ``now`` and ``after`` in units of its target."""
        return Listed(self.result.proposals)

    @property
    def requested(self) -> str | None:
        """The recording that the last ``explain`` requests, or None."""
        return self.result.asked

    @property
    def enough(self) -> int | None:
        """How many more turns reach every target; None if not even many do."""
        return self.result.enough

    @property
    def lines(self) -> list[str]:
        """What the command prints."""
        asked, enough = self.requested, self.enough
        said = [f"explain asks: {asked}"] if asked else []
        for number, move in enumerate(self.proposals, start=1):
            said.append(f"{number}. {move.words}: {move.parameter}, {move.now:.1f} -> {move.after:.1f} times its target sigma")
        if self.proposals and enough is not None:
            said.append(f"{enough} more turn{'s are' if enough != 1 else ' is'} enough for every target")
        if not self.proposals:
            own = "of the accelerometer 50 ppm, or 100 where it is given, 0.05 mrad, 0.05 mg"
            done = f"every parameter has reached its target sigma (50 ppm, 0.05 mrad, 2 mdps; {own})"
            said.append(f"{done}: nothing more is needed" + (" for the linear calibration" if asked else ""))
        return said

    @property
    def page(self) -> Group:
        """What the command prints, as a rich renderable."""
        return Group(*map(one_line, self.lines))

    def to_json(self) -> dict:
        """``tinygc-plan/2`` (docs/formats.md)."""
        found = {"requested": self.requested, "proposals": [vars(each) for each in self.proposals], "enough": self.enough}
        return {"schema": "tinygc-plan/2", **found}


@public()
def plan(session: Session | Path | str, *, count: int = 5) -> Plan:
    """Say which movements to record next.

    Parameters
    ----------
    session : Session, str or Path
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
    return Plan(propose(session_or_folder(session), count))


# ``tinygc.simulate``: simulate a session and its truth; other commands read it like a recorded one.


@dataclass(frozen=True, eq=False, repr=False)
class Simulated:
    """Result of ``tinygc.simulate``: a session with its truth."""

    #: ``tinygc-truth/1`` (docs/formats.md)
    truth: dict
    #: options, movement, unit and registers
    simulation: Simulation

    @cached_property
    def session(self) -> Session:
        """The session, as a recorder would have written it."""
        return _session(self.simulation)

    def __repr__(self) -> str:
        hidden = ", ".join(self.truth["effects"]) or "nothing"
        return f"<Simulated {len(self.simulation.plan.turns)} turns, seed {self.simulation.options.seed}; hides {hidden}>"

    def save(self, folder: Path | str, force: bool = False) -> Path:
        """Write a session folder with truth.json; returns the folder.  FormatError if the folder holds something else."""
        return write_simulation(self.simulation, Path(folder), force, self.truth["effects"])


@public(SimulationOptions)
def simulate(
    options: SimulationOptions | None = None, *, effects: Mapping[str, Mapping[str, Any]] | None = None, **choices: Any
) -> Simulated:
    """Simulate a session; the same arguments give the same registers.

    Parameters
    ----------
    options : SimulationOptions, optional
        Sensor, unit, bench and movement.
    effects : mapping, optional
        Effects hidden in the gyroscope: id -> parameters by their JSON names and units
        (``{"gyro.g_sensitivity": {"matrix_dps_per_g": [[…], […], […]]}}``).
    **choices
        Single fields of ``SimulationOptions``: ``segments=12``, ``odr_hz=416.0``, ``seed=3``.

    Returns
    -------
    Simulated
        ``session`` and ``truth``; ``save(folder)`` writes both.

    Raises
    ------
    CalibrationError
        For invalid options, and for an effect that does not add to the rate.

    Examples
    --------
    >>> import tinygc
    >>> simulated = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1)
    >>> simulated
    <Simulated 12 turns, seed 1; hides nothing>
    >>> simulated.session.logs[0].samples.gyro.shape[1]
    3

    """
    settings = chosen(SimulationOptions, options, choices)
    hidden = {name: dict(parameters) for name, parameters in (effects or {}).items()}
    plan = plan_of(settings)
    simulation = simulate_session(settings, _distort(hidden, settings, plan.log_s), plan=plan)
    return Simulated(truth_table(simulation, hidden), simulation)


def _distort(hidden: dict[str, dict], options: SimulationOptions, duration_s: float) -> Distort | None:
    """Compose all hidden effects into one function, applied one after the other."""
    effects = [_with_theta(name, parameters) for name, parameters in hidden.items()]
    if not effects:
        return None

    def distort(t_s: np.ndarray, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray) -> np.ndarray:
        dt_s, force_g, full_scale = float(t_s[1] - t_s[0]), force / G, options.gyro_fs_dps * DEG
        for effect, theta in effects:
            shaken = vibration(force_g, dt_s)
            movement = Movement(t_s, dt_s, rate, force_g, temp_c, shaken, duration_s, full_scale, options.temperature_start_c)
            rate = effect.distort(movement, theta)
        return rate

    return distort


def _with_theta(name: str, parameters: dict) -> tuple[Effect, np.ndarray]:
    effect = effect_of(name)
    if effect.kind != "rate":
        raise DataError(f"{name} does not add to the rate; simulate hides only effects that do")
    wanted = [effect.parameter.name, *([] if effect.scan is None else [effect.scan.name])]
    if set(parameters) != set(wanted):
        raise DataError(f"{name}: parameters are {', '.join(parameters) or 'none'}, expected {' and '.join(wanted)}")
    theta = _numbers(name, effect.parameter.name, parameters) * effect.parameter.si
    if theta.shape != effect.parameter.shape or not np.isfinite(theta).all():
        raise DataError(f"{name}: {effect.parameter.name} has shape {theta.shape}, expected {effect.parameter.shape} of finite numbers")
    if effect.scan is not None:
        value = _numbers(name, effect.scan.name, parameters)
        if value.shape or not np.isfinite(value):
            raise DataError(f"{name}: {effect.scan.name} has shape {value.shape}, expected a finite number")
        effect = effect.at(float(value) * effect.scan.si)
    return effect, theta.ravel()


def _numbers(name: str, of: str, parameters: dict) -> np.ndarray:
    try:
        return np.asarray(parameters[of], dtype=float)
    except (TypeError, ValueError):
        raise DataError(f"{name}: {of} is {parameters[of]!r:.60}, expected numbers") from None


def _session(simulation: Simulation) -> Session:
    """Build the session that a reader would get from its files."""
    options, unit = simulation.options, simulation.unit

    def arrays(recording: RegisterLog) -> tuple[np.ndarray, ...]:
        units = options.register_units
        temp_c = units.temperature_c(recording.temp)
        arrays = (recording.t_us * 1e-6, recording.gyro * units.gyro_rps, recording.accel * units.accel_mps2)
        return arrays if temp_c is None else (*arrays, temp_c)

    session = Session.from_arrays(
        *arrays(simulation.log),
        closures=[] if simulation.closure is None else [arrays(simulation.closure)],
        name=f"simulated-{options.seed}",
        model=options.sensor,
        serial=f"SIM-{options.unit_drawn_from}",
        gyro_fs_dps=options.gyro_fs_dps,
        accel_fs_g=options.accel_fs_g,
        accelerometer=Accelerometer(np.round(unit.accel_matrix, MATRIX_DIGITS), np.round(unit.accel_bias, BIAS_DIGITS)),
        site=Site(options.latitude_deg, options.gravity_mps2, unit.heading_deg if options.with_heading else None),
        protocol=Protocol(still_s=options.still_s, segment_s=2 * options.still_s + options.turn_s),
    )
    turns = stopped_turns(simulation.plan, options)
    return replace(session, config=replace(session.config, sensor=replace(session.config.sensor, odr_hz=options.odr_hz)), turns=turns)
