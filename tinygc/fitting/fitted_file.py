"""Saved methods of ``fit``, reused where they were made from the same files, with the same options, by the same version."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.records import Size, read_record
from session.base.results import Array, Keys
from session.log.folder import input_hashes
from tinygc import models
from tinygc.closure.problem import Problem
from tinygc.estimation.options import FitOptions, MethodFit

SAVED_NAME = "fitted.json"
#: options that do not affect the numbers of a method
IRRELEVANT = ("methods", "physics", "checkpoints", "resume", "history", "noise", "requirements")
_ANGLES = Array((None, None))


@dataclass(frozen=True, eq=False)
class SavedMethod:
    """Error angles (segments, angles) of the fit to all and of the held-out fits, rad; seconds; notes."""

    fitted_rad: Annotated[np.ndarray, _ANGLES]
    held_out_rad: Annotated[np.ndarray, _ANGLES]
    seconds: Size
    notes: Annotated[dict, Keys()]


@dataclass(frozen=True, eq=False)
class Fitted:
    """``fitted.json``; key: what must be equal for reuse."""

    schema: ClassVar[str] = "tinygc-fitted/1"
    key: Annotated[dict, Keys()]
    methods: Mapping[str, SavedMethod]


def key(options: FitOptions, hashes: dict[str, str]) -> dict:
    """Return what must be equal for reuse, JSON-ready."""
    chosen = {
        name: list(value) if isinstance(value, tuple) else str(value) if isinstance(value, Path) else value
        for name, value in asdict(options).items()
        if name not in IRRELEVANT
    }
    return {"options": chosen, "inputs": hashes, "version": VERSION}


def inputs_of(problem: Problem) -> dict[str, str]:
    """Return file -> SHA-256 of what a method's numbers follow from: the session's files, and noise figures at rest if there are any."""
    return input_hashes(problem.session) | ({} if problem.at_rest is None else {problem.at_rest.file: problem.at_rest.sha256})


def made_from(options: FitOptions, hashes: dict[str, str], methods: dict[str, MethodFit]) -> Fitted:
    """Return the inputs of a fit, and what is saved of each method."""
    saved = {name: SavedMethod(fit.angles, fit.held_out, fit.seconds, fit.notes) for name, fit in methods.items()}
    return Fitted(key(options, hashes), saved)


def saved_methods(folder: Path, problem: Problem, options: FitOptions, hashes: dict[str, str]) -> dict[str, MethodFit]:
    """Read the requested methods that a folder of ``fit`` contains for this problem; none where anything differs or cannot be read."""
    try:
        saved = read_record(Fitted, folder / SAVED_NAME)
        if saved.key != key(options, hashes):
            return {}
        found = {name: _read(folder, name, saved.methods[name], problem) for name in options.methods if name in saved.methods}
    except CalibrationError:
        return {}
    if "tinygc_denoised" in options.methods and "tinygc_denoised" not in found:
        found.pop("tinygc", None)  # the denoiser is trained on the fits of the folds, which are not saved
    return found


def _read(folder: Path, name: str, saved: SavedMethod, problem: Problem) -> MethodFit:
    shape = (len(problem.batch), problem.batch.angles)
    if saved.fitted_rad.shape != shape or saved.held_out_rad.shape != shape:
        raise FormatError(f"{name}: not the angles of {shape[0]} segments")
    return MethodFit(
        name, models.load(folder / f"model_{name}.json"), saved.fitted_rad, saved.held_out_rad, saved.seconds, dict(saved.notes)
    )
