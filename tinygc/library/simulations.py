"""``tinygc.simulate``: simulate a session and its truth; other commands read it like a recorded one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import DataError
from session.base.units import DEG, G
from session.log.folder import Session
from tinygc.effects import Effect, Movement, effect_of
from tinygc.effects.movement import vibration
from tinygc.library.arguments import chosen, public
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.sensor import Distort, RegisterLog
from tinygc.simulation.simulator import Simulation, plan_of, simulate_session
from tinygc.simulation.write import config_of, stopped_turns, truth_table, write_simulation


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
    options = simulation.options

    def arrays(recording: RegisterLog) -> tuple[np.ndarray, ...]:
        units = options.register_units
        temp_c = units.temperature_c(recording.temp)
        arrays = (recording.t_us * 1e-6, recording.gyro * units.gyro_rps, recording.accel * units.accel_mps2)
        return arrays if temp_c is None else (*arrays, temp_c)

    session = Session.from_arrays(
        *arrays(simulation.log),
        closures=[] if simulation.closure is None else [arrays(simulation.closure)],
        name=f"simulated-{options.seed}",
        gyro_fs_dps=options.gyro_fs_dps,
        accel_fs_g=options.accel_fs_g,
    )
    return replace(session, config=config_of(options, simulation.unit), turns=stopped_turns(simulation.plan, options))
