"""What was said of a session, as a curve: what its laws, or the names of the catalogue, add to the rate of a movement."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tinygc.effects import Effect, EffectError, Movement, Parts, catalogue, using

#: of an explain folder
EFFECTS = "effects"


def added_by_laws(laws: Sequence[dict], folder: Path, movement: Movement) -> list[np.ndarray]:
    """Of each law of ``discovery.laws``, (N, 3) rad/s; folder: the explain folder with their files, which are run as Python.

    Raises EffectError for a file that is missing or broken, or holds another id or other parameters than were said.
    """
    if not laws:
        return []
    places = {str((folder / law["file"]).parent) for law in laws}
    with using(sorted(places)):
        known = catalogue()
        missing = [law["id"] for law in laws if law["id"] not in known]
        if missing:
            raise EffectError(f"{folder}: no file defines {', '.join(missing)}")
        return [added(known[law["id"]], {**_constants(law), **law["parameters"]}, movement) for law in laws]


def _constants(law: dict) -> dict:
    """A law's constants by name, in the units of their JSON."""
    return {name: each["value"] for name, each in law.get("constants", {}).items()}


def added_by_names(effects: Sequence[dict], movement: Movement) -> np.ndarray | None:
    """Of all ``effects`` of ``tinygc-explain/1`` that bend the rate, together (N, 3) rad/s; None where there is none."""
    known = catalogue()
    curves = [
        added(known[each["id"]], each["parameters"], movement)
        for each in effects
        if each["id"] in known and known[each["id"]].kind == "rate"
    ]
    return sum(curves[1:], curves[0]) if curves else None


def added(effect: Effect, told: dict, movement: Movement) -> np.ndarray:
    """(N, 3) rad/s of an effect with parameters by their JSON names, in their units."""
    if effect.scan is not None and effect.scan.name in told:
        effect = effect.at(float(np.ravel(told[effect.scan.name])[0]) * effect.scan.si)
    for form in (effect, effect.wider, effect.of_readings):
        theta = None if form is None else _theta(form, told)
        if form is not None and theta is not None:
            return form.distort(movement, theta) - movement.rate
    raise EffectError(f"{effect.id}: its parameters are {', '.join(told)}, expected {effect.parameter.size} of {effect.parameter.name}")


def _theta(effect: Effect, told: dict) -> np.ndarray | None:
    """(P,) SI; None where what was told is of another form."""
    if isinstance(effect.derived, Parts):
        return effect.derived.theta(told) if all(name in told for name, _, _ in effect.derived.parts) else None
    value = told.get(effect.parameter.name)
    if value is None or np.size(value) != effect.parameter.size:
        return None
    return np.ravel(value).astype(float) * effect.parameter.si
