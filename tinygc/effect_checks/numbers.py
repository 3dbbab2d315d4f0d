"""Words, units and JSON."""

from __future__ import annotations

import json
import re

import numpy as np

from session.common.units import DEG, MG
from tinygc import models
from tinygc.effect_checks.report import Wrong
from tinygc.effect_checks.scene import Trial
from tinygc.effects.discovery import having

#: what the first word of a unit is in SI; what it is divided by is g, s, degC or a power of them, all one here
UNITS = {
    **dict.fromkeys(["s", "fraction", "samples", "1", "", "Hz", "rad", "rad/s", "m", "g", "°C", "%/100"], 1.0),
    **{"dps": DEG, "deg": DEG, "°": DEG, "mdps": 1e-3 * DEG, "mg": MG, "ms": 1e-3, "us": 1e-6, "%": 1e-2, "ppm": 1e-6, "min": 60.0},
}
PER = {"g": 1.0, "g²": 1.0, "°C": 1.0, "°C²": 1.0, "s": 1.0, "dps": DEG, "dps²": DEG**2, "Hz": 1.0, "V": 1.0}
LONGEST = 300
RESERVED = ("id", "equation", "theta_si")


def units(trial: Trial) -> str:
    """One sentence with a number; a unit that is as large as declared; names and numbers that come back from a model file."""
    _sentence(trial)
    said = [_unit(trial.effect.parameter.unit, trial.effect.parameter.si)]
    if (scan := trial.effect.scan) is not None:
        said.append(_unit(scan.unit, scan.si))
    names = [trial.effect.parameter.name, *trial.effect.shape]
    if clash := [name for name in names if name in RESERVED or names.count(name) > 1 or not name.isidentifier()]:
        raise Wrong(f"{clash[0]!r} cannot be a parameter's name in the JSON: it is taken, or no name")
    if trial.effect.kind == "rate":
        _round_trip(trial)
        said.append("its model file gives the same numbers back")
    return "; ".join(said)


def _sentence(trial: Trial) -> None:
    says = trial.effect.says(trial.theta)
    if not isinstance(says, str) or "\n" in says or not re.search(r"\d", says) or "nan" in says or len(says) > LONGEST:
        raise Wrong(f"says gives {says!r:.120}, expected one sentence with a number")


def _unit(unit: str, si: float) -> str:
    """That si is the size of the unit; a unit that is not known is taken at its word."""
    first, *per = unit.split(" ")[0].split("/")
    if unit.split(" ")[0] in UNITS:
        size = UNITS[unit.split(" ")[0]]
    elif first in UNITS and all(word in PER for word in per):
        size = UNITS[first] / float(np.prod([PER[word] for word in per]))
    else:
        return f"unit {unit!r} is not known here and taken at its word, {si:g} SI"
    if not np.isclose(si, size, rtol=1e-9):
        raise Wrong(f"unit {unit!r} is {size:.6g} in SI, and si says {si:.6g}")
    return f"unit {unit!r} is {si:.6g} SI"


def _round_trip(trial: Trial) -> None:
    parameter = trial.effect.parameter
    text = json.dumps(models.to_dict(trial.model()), allow_nan=False)
    with having(trial.original):
        try:
            (claim,) = models.from_dict(json.loads(text)).undone
        except Exception as error:
            raise Wrong(f"its model file cannot be read again: {error}") from None
    (entry,) = json.loads(text)["effects"]
    shown = np.ravel(entry[parameter.name]) * parameter.si
    if not (np.array_equal(claim.theta, trial.theta) and np.allclose(shown, trial.theta, rtol=1e-12)):
        raise Wrong(f"its model file gives {claim.theta.tolist()}, {shown.tolist()} back for {trial.theta.tolist()}")
    if claim.effect.shape != trial.effect.shape or any(entry[name] != value for name, value in trial.effect.shape.items()):
        raise Wrong(f"its model file gives the shape {claim.effect.shape} back for {trial.effect.shape}")
