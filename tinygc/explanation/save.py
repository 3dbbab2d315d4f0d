"""An explanation as files: what was found, and its picture."""

from __future__ import annotations

from pathlib import Path

from session.files.results import write_whole
from session.files.writing import result_folder
from tinygc.explanation.pictures.picture import draw
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.result import to_json


def save_explanation(e: Explanation, folder: Path | None = None, pictures: bool = True, table: dict | None = None) -> Path:
    """Write the result, and its picture, into a folder, the session's ``explain`` by default; returns that folder.

    table: the result, where more is told than the explanation knows of.

    Raises StorageError where it cannot be written, CalibrationError where a picture is wanted and matplotlib is missing.
    """
    folder = folder or e.session.own_folder("explain")
    with result_folder(folder):
        write_whole(folder / "explain.json", table or to_json(e))
    if pictures:
        draw(e, folder / "explain.png")
    return folder
