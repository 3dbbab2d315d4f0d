"""What the core asks of arrays: each function answers None of what is no array, and imports the rest only where it is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.names import CLOCKS
from session.base.options import given_beside, record_in
from session.base.progress import Progress
from session.base.texts import command_line
from session.detect.findings import Finding
from tinygc.features.arrays.feature import ApplyOptions, ImportOptions
from tinygc.features.arrays.names import array_folders, array_size, is_array, is_array_model, unit_of

if TYPE_CHECKING:
    from session.replay.convert import Converted
    from session.replay.options import Answers
    from tinygc.features.arrays.apply import ArrayApplied


def kind_of_folder(folder: Path) -> str | None:
    """Say what the folder is, and what takes it."""
    if (count := array_size(folder)) is None:
        return None
    return (
        f"an array of {count} unit{'s' * (count != 1)} on one body, and no single session; "
        f"`{command_line('check', folder)}` and `{command_line('fit', folder)}` take it whole; "
        "to read one unit alone, give it a folder of its own"
    )


def listed(folder: Path) -> dict[str, Any] | None:
    """Return the sensor from session.toml, or from the first unit's, and the first unit's logs: fields of ``ListedSession``."""
    if (units := array_size(folder)) is None:
        return None
    from session.base.names import log_paths
    from session.log.config import read_config
    from tinygc.estimation.session_times import date_of

    names = array_folders(folder)
    first = folder / names[0] if names else folder
    config = read_config(first / "session.toml")
    logs, closures = ([path for path in log_paths(first, stem)] for stem in ("log", "closure"))
    date, source = date_of(folder, config, [*logs, *closures])
    counts = [len(paths) if names else len({found[0] for found in map(unit_of, paths) if found}) for paths in (logs, closures)]
    serial = None if names else config.sensor.serial or None
    known = {"model": config.sensor.model, "serial": serial, "date": date, "date_from": source, "units": units}
    return {**known, "logs": counts[0], "closures": counts[1]}


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
    *,
    unit: str,
    session: Path | None,
    further: Sequence[Any],
    progress: Progress,
) -> ArrayApplied | None:
    """Fuse an array's folder into one log; CalibrationError for what is no folder, and as ``apply_array``."""
    if not is_array_model(model):
        return None
    if session is not None:
        raise CalibrationError("--session is for one sensor's model; an array's model says what each unit is")
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no folder; an array's model takes the array's folder")
    from tinygc.features.arrays.apply import apply_array

    return apply_array(model, folder, out, record_in(further, ApplyOptions).which, unit, progress)


def import_logs(
    paths: Sequence[Path], out: Path, answers: Answers, *, columns: Sequence[str], serial: str, add: str | None, further: Sequence[Any]
) -> Converted | None:
    """Make an array of one log's rows, by the column that ``--array-by`` names."""
    own = record_in(further, ImportOptions)
    if own.array_by is None:
        return None
    from session.replay.importing import refuse_beside
    from tinygc.features.arrays.importing import import_array

    others: dict[str, object] = {
        "--add": add,
        "--serial": serial,
        "--where": answers.where,
        "--topic": answers.topic,
        "--even": answers.even,
    }
    refuse_beside("--array-by", {**others, **given_beside(further, own)})
    return import_array(paths, out, answers, own.array_by, columns)
