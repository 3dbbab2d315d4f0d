"""Models with physics as JSON: the linear model or net, and each effect with its parameters in SI and in people's units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from session.common.errors import FormatError
from tinygc.effects import AppliedEffect, Conditions, EffectError, effect_of
from tinygc.effects.effect import READINGS
from tinygc.models.linear import LinearModel
from tinygc.models.physics import CarriedNet, PhysicsModel

EQUATIONS = {
    "physics": "omega = (each effect undone, in order)(E @ m + B), m the measured rate in rad/s",
    "tinygc_physics": "omega = net(E^-1 ((each effect undone, in order)(E @ m + B) - B))",
}


def to_table(model: PhysicsModel | CarriedNet, write: Callable[..., dict]) -> dict:
    """equation, what is undone in which order, what it refers to, and the net where there is one behind."""
    physics = model.physics if isinstance(model, CarriedNet) else model
    table: dict[str, Any] = {
        "equation": EQUATIONS[model.kind],
        "linear": {"E": physics.linear.E.tolist(), "B": physics.linear.B.tolist()},
        "effects": [_claim(claim) for claim in physics.claims],
        "conditions": {name: value if np.isfinite(value) else None for name, value in asdict(physics.known).items()},
    }
    return table | {"net": write(model.net)} if isinstance(model, CarriedNet) else table


def _claim(claim: AppliedEffect) -> dict:
    effect = claim.effect
    values = (claim.theta / effect.parameter.si).reshape(effect.parameter.shape).tolist()
    return {"id": effect.id, "equation": effect.equation, "theta_si": claim.theta.tolist(), effect.parameter.name: values, **effect.shape}


def from_table(table: dict, where: str, read: Callable[..., Any]) -> PhysicsModel | CarriedNet:
    """The model; FormatError says what is wrong with the table."""
    try:
        E, B = (np.asarray(table["linear"][name], dtype=float).reshape(shape) for name, shape in (("E", (3, 3)), ("B", (3,))))
        known = Conditions(**{name: float("nan") if value is None else float(value) for name, value in table["conditions"].items()})
        claims = tuple(_read_claim(entry) for entry in table["effects"])
    except EffectError as error:
        raise FormatError(f"{where}: {error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{where}: the physics cannot be read: {error}") from None
    if not (np.isfinite(E).all() and np.isfinite(B).all() and all(np.isfinite(claim.theta).all() for claim in claims)):
        raise FormatError(f"{where}: the physics holds numbers that are not finite")
    physics = PhysicsModel(LinearModel(E, B), claims, known)
    return physics if table["kind"] == PhysicsModel.kind else CarriedNet(physics, read(table.get("net"), f"{where}: net"))


def _read_claim(entry: dict) -> AppliedEffect:
    effect = effect_of(entry["id"])
    if effect.scan is not None:
        effect = effect.at(float(entry[effect.scan.name]) * effect.scan.si)
    if entry.get("of") == READINGS and effect.of_readings is not None:
        effect = effect.of_readings
    return AppliedEffect(effect, np.asarray(entry["theta_si"], dtype=float))
