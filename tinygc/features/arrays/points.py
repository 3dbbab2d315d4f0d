"""What the core asks of arrays: each function answers None of what is no array, and imports the rest only where it is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.names import CLOCKS, is_array
from session.detect.findings import Finding
from tinygc.models.files import is_array_model

if TYPE_CHECKING:
    from session.replay.convert import Converted
    from session.replay.dialects import Answers
    from tinygc.features.arrays.apply import ArrayApplied


def check(recording: Any, clock: str, further: Callable[..., list[Finding]]) -> list[Finding] | None:
    """Check each unit of an array or its folder, and whether all are on one body; further: as of ``check_array``."""
    if isinstance(recording, Path) and is_array(recording):
        from tinygc.features.arrays.recording import read_array

        if clock != CLOCKS[0]:
            raise CalibrationError(f"{recording}: an array, whose units have clocks of their own; leave --clock {clock} out")
        try:
            recording = read_array(recording)
        except CalibrationError as error:
            return [Finding("error", recording.name, "reading", str(error))]
    if not hasattr(recording, "units"):
        return None
    from tinygc.features.arrays.checks import check_array

    return check_array(recording, further)


def apply(
    model: Path,
    folder: Path,
    out: Path,
    answers: Answers,
    *,
    which: str | None,
    unit: str,
    session: Path | None,
    progress: Callable[[str, int, int], None],
) -> ArrayApplied | None:
    """Fuse an array's folder into one log; which: its log, of several.  CalibrationError for what is no folder, and as ``apply_array``."""
    if not is_array_model(model):
        return None
    if session is not None:
        raise CalibrationError("--session is for one sensor's model; an array's model says what each unit is")
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no folder; an array's model takes the array's folder")
    from tinygc.features.arrays.apply import apply_array

    return apply_array(model, folder, out, answers, which, unit, progress)


def import_logs(paths: Sequence[Path], out: Path, answers: Answers, columns: Sequence[str], more: dict[str, Any]) -> Converted | None:
    """Make an array of one log's rows, by the column that ``--array-by`` names."""
    if more.get("array_by") is None:
        return None
    from tinygc.features.arrays.importing import import_array

    return import_array(paths, out, answers, more["array_by"], columns)
