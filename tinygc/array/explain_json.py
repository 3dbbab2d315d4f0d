"""An array's explanation as ``tinygc-array-explain/1`` (docs/formats.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.common.errors import CalibrationError
from session.common.units import DEG
from session.common.version import VERSION
from session.files.results import write_whole
from session.files.writing import result_folder
from tinygc.array.explain import ArrayExplanation
from tinygc.array.fit_json import begins_s, event_to_json, split_to_json
from tinygc.array.moments import Moment
from tinygc.explanation.verdict.result import to_json

SCHEMA = "tinygc-array-explain/1"
NAME = "array.json"


def explained_to_json(found: ArrayExplanation) -> dict:
    """The whole result, JSON-ready; times in seconds of the array's clock from its first sample."""
    fit = found.fit
    return {
        "schema": SCHEMA,
        "array": fit.array.name,
        "verdict": found.verdict,
        "split": split_to_json(fit.split),
        "units": [
            {
                "number": unit.number,
                "verdict": found.explanations[unit.number].verdict if unit.number in found.explanations else None,
                "error": found.not_explained.get(unit.number),
                "own_rms_deg": unit.own_rad[0] / DEG,
                "own_sigma_deg": unit.own_rad[1] / DEG if np.isfinite(unit.own_rad[1]) else None,
                "own_p_value": float(p),
                "explained": f"unit{unit.number}/explain.json" if unit.number in found.explanations else None,
            }
            for unit, p in zip(fit.units, fit.split.own_p, strict=True)
        ],
        "traits": [
            {"id": trait.id, "units": list(trait.units), "whose": trait.whose, "says": trait.words, "of_units": list(trait.says)}
            for trait in found.traits
        ],
        "events": [event_to_json(event, fit) for event in fit.joint.events],
        "moments": [_moment(moment, begins_s(fit)) for moment in found.moments],
        "left_out": [{"number": unit.number, "why": unit.why} for unit in fit.left_out],
        "version": VERSION,
    }


def _moment(moment: Moment, begins: float) -> dict:
    return {
        "what": moment.what,
        "at_s": moment.at_s - begins,
        "unit": moment.unit,
        "units": list(moment.units),
        "size_dps": moment.size_rps / DEG,
        "felt_by_others": moment.felt,
        "says": moment.words,
    }


def save_array_explanation(found: ArrayExplanation, folder: Path | None = None) -> Path:
    """``array.json``, and each unit's ``unit3/explain.json``, into a folder, ``explain`` in the array's; returns it.

    CalibrationError where the array was never a folder and none is given.
    """
    array = found.fit.array
    if folder is None and not array.folder.is_dir():
        raise CalibrationError(f"{array.name}: made of arrays, it has no folder of its own; give one to save to")
    folder = folder or array.folder / "explain"
    with result_folder(folder):
        for number, explanation in found.explanations.items():
            with result_folder(folder / f"unit{number}"):
                write_whole(folder / f"unit{number}" / "explain.json", to_json(explanation))
        write_whole(folder / NAME, explained_to_json(found))
    return folder
