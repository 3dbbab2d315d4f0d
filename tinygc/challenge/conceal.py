"""Simulate what a case hides: the session, what its session.toml tells, and the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from session.common.units import MDPS, MG
from tinygc.challenge.cases import Case
from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.other_effects import OTHER_EFFECTS
from tinygc.challenge.outsiders import OUTSIDERS
from tinygc.challenge.rate_effects import RATE_EFFECTS
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulate import Distort, Disturb, Simulation, plan_of, simulate_session
from tinygc.simulation.table_movement import Plan
from tinygc.simulation.write import config_text

MAKERS: dict[str, Maker] = {**RATE_EFFECTS, **OTHER_EFFECTS, **OUTSIDERS}
MODEL_LINE = 'model = "ASM330LHH"'


def drawn(case: Case, makers: Mapping[str, Maker] = MAKERS) -> tuple[list[Concealment], Plan]:
    """What a case hides, in the order in which it bends the rate, and the movement that it was drawn for."""
    rng, plan = np.random.default_rng(case.seed), plan_of(case.options)
    hidden = [makers[name](Scene(rng, strength, case.options, plan)) for name, strength in zip(case.ids, case.strengths, strict=True)]
    return hidden, plan


def conceal(case: Case, makers: Mapping[str, Maker] = MAKERS) -> tuple[Simulation, str, dict[str, dict]]:
    """The session of a case, its session.toml, and the truth: id -> parameters."""
    hidden, plan = drawn(case, makers)
    for one in hidden:
        plan = one.movement(plan) if one.movement else plan
    simulation = simulate_session(case.options, _distort(hidden), plan=plan, disturb=_disturb(hidden))
    truth = {one.id: dict(one.truth) for one in hidden}
    for one in hidden:
        if one.spoil:
            log, more = one.spoil(simulation.log)
            simulation = replace(simulation, log=log)
            truth[one.id] |= more
    return simulation, _silent(simulation, case.told, any(one.without_latitude for one in hidden)), truth


def _distort(hidden: list[Concealment]) -> Distort | None:
    functions = [one.distort for one in hidden if one.distort]

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        for function in functions:
            rate = function(t, rate, force, temp)
        return rate

    return distort if functions else None


def _disturb(hidden: list[Concealment]) -> Disturb | None:
    functions = [one.disturb for one in hidden if one.disturb]

    def disturb(t: np.ndarray, force: np.ndarray) -> np.ndarray:
        for function in functions:
            force = function(t, force)
        return force

    return disturb if functions else None


def _silent(simulation: Simulation, told: str, without_latitude: bool) -> str:
    """session.toml without its remarks, which would tell how to make the session again; told: of the bias instability, as in ``Case``."""
    stated = f"\ngyro_bias_instability_dph = {simulation.options.bias_instability_dph!r}" if told == "stated" else ""
    sensor = MODEL_LINE if told == "model" else f'model = "unnamed"{stated}\n{_units_told(simulation.options)}'
    lines = config_text(simulation, concealed=False).replace(MODEL_LINE, sensor).split("\n")
    return "\n".join(
        line for line in lines if not line.startswith("#") and not (without_latitude and line.startswith(("latitude_deg", "heading_deg")))
    )


def _units_told(options: SimulationOptions) -> str:
    """What the registers of a sensor that is not named mean."""
    units, thermometer = options.register_units, options.register_units.thermometer
    told = {"gyro_mdps_per_lsb": round(units.gyro_rps / MDPS, 9), "accel_mg_per_lsb": round(units.accel_mps2 / MG, 9)}
    if thermometer is not None:
        told |= {"temp_lsb_per_c": thermometer.lsb_per_c, "temp_at_zero_c": thermometer.at_zero_c}
    return "\n".join(f"{key} = {value!r}" for key, value in told.items())


def options_chosen(options: SimulationOptions) -> dict:
    """Those that are not the default, for the truth file."""
    return {field.name: getattr(options, field.name) for field in fields(options) if getattr(options, field.name) != field.default}
