"""What ``fit`` has saved, taken again where it was made from the same files, with the same options, by the same version."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from session.common.errors import CalibrationError, FormatError
from session.common.version import VERSION
from session.files.shapes import Array, Keys, MapOf, Number, Text, read_required
from tinygc import models
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.problem.problem import Problem

NAME, SCHEMA = "fitted.json", "tinygc-fitted/1"
#: what decides the numbers of a method; which methods were asked for does not
IRRELEVANT = ("methods", "physics", "conditions", "checkpoints", "resume")
_ANGLES = Array((None, None))
_METHOD = Keys({"fitted_rad": _ANGLES, "held_out_rad": _ANGLES, "seconds": Number(0), "notes": Keys()})
SHAPE = Keys({"schema": Text((SCHEMA,)), "key": Keys(), "methods": MapOf(_METHOD)})


def key(options: FitOptions, hashes: dict[str, str]) -> dict:
    """What must be the same, JSON-ready."""
    chosen = {
        name: list(value) if isinstance(value, tuple) else str(value) if isinstance(value, Path) else value
        for name, value in asdict(options).items()
        if name not in IRRELEVANT
    }
    return {"options": chosen, "inputs": hashes, "version": VERSION}


def made_from(options: FitOptions, hashes: dict[str, str], methods: dict[str, MethodFit]) -> dict:
    """From what a fit was made, and of each method the error angles of each segment, rad, its seconds and its notes; JSON-ready."""
    return {"schema": SCHEMA, "key": key(options, hashes), "methods": {name: _entry(fit) for name, fit in methods.items()}}


def _entry(fit: MethodFit) -> dict:
    return {"fitted_rad": fit.angles.tolist(), "held_out_rad": fit.held_out.tolist(), "seconds": fit.seconds, "notes": fit.notes}


def saved_methods(folder: Path, problem: Problem, options: FitOptions, hashes: dict[str, str]) -> dict[str, MethodFit]:
    """The methods asked for that a folder of ``fit`` holds for this very problem; none where anything differs or cannot be read."""
    try:
        table = read_required(folder / NAME, SHAPE)
        if table["key"] != key(options, hashes):
            return {}
        found = {name: _read(folder, name, table["methods"][name], problem) for name in options.methods if name in table["methods"]}
    except CalibrationError:
        return {}
    if "tinygc_denoised" in options.methods and "tinygc_denoised" not in found:
        found.pop("tinygc", None)  # the denoiser is trained on the fits of the folds, which are not saved
    return found


def _read(folder: Path, name: str, entry: dict, problem: Problem) -> MethodFit:
    angles, held_out = (np.asarray(entry[which], dtype=float) for which in ("fitted_rad", "held_out_rad"))
    shape = (len(problem.batch), problem.batch.angles)
    if angles.shape != shape or held_out.shape != shape:
        raise FormatError(f"{name}: not the angles of {shape[0]} segments")
    return MethodFit(name, models.load(folder / f"model_{name}.json"), angles, held_out, float(entry["seconds"]), dict(entry["notes"]))
