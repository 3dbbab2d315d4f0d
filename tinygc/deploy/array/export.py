"""An array's model for other programs: C for a device, or its own JSON; a format of one sensor's numbers cannot hold an array."""

from __future__ import annotations

from pathlib import Path

from session.files.results import json_text
from tinygc.array.fused.model_files import load_array_model, to_table
from tinygc.deploy.array.c_source import array_source
from tinygc.deploy.errors import ExportError

FORMATS = ("json", "c")


def export_array(path: Path, to: str) -> dict[str, str]:
    """File name -> text of an array's model file.  ExportError for a format that holds one sensor only."""
    model = load_array_model(path)
    if to not in FORMATS:
        raise ExportError(f"{to} holds one sensor's calibration, {path.name} is an array of {len(model)} units; json and c carry an array")
    return array_source(model) if to == "c" else {"array.json": json_text(to_table(model)) + "\n"}
