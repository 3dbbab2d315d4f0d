"""Models with physics as JSON: the linear model or net, and each effect with its parameters in SI and in people's units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from session.common.errors import FormatError
from session.files.shapes import Array, Keys, ListOf, Number, Text, require
from tinygc.effects import AppliedEffect, EffectError, effect_of
from tinygc.effects.effect import READINGS
from tinygc.models.kinds.known import CONDITIONS_TABLE, known_of
from tinygc.models.kinds.weights import weight
from tinygc.models.linear import LinearModel
from tinygc.models.physics import CarriedNet, PhysicsModel

EQUATIONS = {
    "physics": "omega = (each effect undone, in order)(E @ m + B), m the measured rate in rad/s",
    "tinygc_physics": "omega = net(E^-1 ((each effect undone, in order)(E @ m + B) - B))",
}

#: of an effect's generous sigma (``Parameter.plausible``): nothing that a sensor does is larger
PLAUSIBLE = 1e3
_LINEAR = Keys({name: weight(name, shape) for name, shape in LinearModel.SHAPES.items()})
_PHYSICS = Keys({"linear": _LINEAR, "conditions": CONDITIONS_TABLE, "effects": ListOf(Keys({"id": Text()}))})


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
    require(table, _PHYSICS, where)
    linear = LinearModel(*(np.asarray(table["linear"][name], dtype=float) for name in LinearModel.SHAPES))
    claims = tuple(_read_claim(entry, f"{where}: effects[{i}]") for i, entry in enumerate(table["effects"]))
    known = known_of(table, {name for claim in claims for name in claim.effect.inputs}, where)
    physics = PhysicsModel(linear, claims, known)
    return physics if table["kind"] == PhysicsModel.kind else CarriedNet(physics, read(table.get("net"), f"{where}: net"))


def _read_claim(entry: dict, where: str) -> AppliedEffect:
    try:
        effect = effect_of(entry["id"])
        most = PLAUSIBLE * effect.parameter.plausible
        require(entry, Keys({"theta_si": Array((effect.parameter.size,), Number(-most, most))}), where)
        if effect.scan is not None:
            require(entry, Keys({effect.scan.name: Number()}), where)
            effect = effect.at(float(entry[effect.scan.name]) * effect.scan.si)
    except EffectError as error:
        raise FormatError(f"{where}: {error}") from None
    if entry.get("of") == READINGS and effect.of_readings is not None:
        effect = effect.of_readings
    return AppliedEffect(effect, np.asarray(entry["theta_si"], dtype=float))
