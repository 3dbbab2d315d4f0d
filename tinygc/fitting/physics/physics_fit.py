"""What a fit of named physics gives, and which effects may be asked for by their id."""

from __future__ import annotations

from dataclasses import dataclass

from session.common.errors import FitError
from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.models.physics import PhysicsModel
from tinygc.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class PhysicsFit:
    """model; problem it was fitted to (mended); twin, whitener and refit behind it; mended: ids of what was mended before; refused: there
    is a mismatch, and no name for it."""

    model: PhysicsModel
    problem: Problem
    twin: Twin
    whiten: Whitener
    fit: Refit
    mended: tuple[str, ...]
    refused: bool = False


def effect_of(twin: Twin, name: str) -> Effect:
    """The effect of an id that was asked for.  FitError, in one line, for what cannot be fitted to this session."""
    known = {effect.id: effect for effect in candidates(twin)}
    if name not in catalogue():
        raise FitError(f"--physics: {name!r} is no effect; known are {', '.join(catalogue())}; another folder's: --effects DIR")
    if catalogue()[name].kind == "motion":
        raise FitError(f"--physics: {name} is motion that the readings miss: there is nothing to fit, and no model gives it back")
    if name not in known:
        raise FitError(f"--physics: {name} cannot be fitted to this session (it needs what the log lacks, or is found without a fit)")
    if (scan := known[name].scan) is not None:
        raise FitError(f"--physics: {name} has a value ({scan.name}) that must be searched for; use --physics auto")
    return known[name]
