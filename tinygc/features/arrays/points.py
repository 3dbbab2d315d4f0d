"""What the core asks of arrays: each function answers None of what is no array, and imports the rest only where it is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError, FormatError
from session.base.names import CLOCKS
from session.base.options import changed, given, record_in, refuse_with
from session.base.progress import Progress
from session.base.results import read_json
from session.base.texts import command_line
from session.detect.findings import Finding
from tinygc.features.arrays.feature import SCHEMA, ApplyOptions, ArrayOptions, ImportOptions, array_folders, array_size, is_array, unit_of

if TYPE_CHECKING:
    from session.replay.convert import Imported
    from session.replay.options import Answers
    from tinygc.cli.results import Done
    from tinygc.features.arrays.apply import ArrayApplied
    from tinygc.features.arrays.library import Array
    from tinygc.simulation.options import SimulationOptions


def kind_of_folder(folder: Path) -> str | None:
    """State what the folder is, and what takes it."""
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
    try:
        table = read_json(model) if model.is_file() else None
    except (FormatError, OSError):
        return None
    if not isinstance(table, dict) or table.get("schema") != SCHEMA:
        return None
    if session is not None:
        raise CalibrationError("--session is for one sensor's model; an array's model states what each unit is")
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no folder; an array's model takes the array's folder")
    from tinygc.features.arrays.apply import apply_array

    return apply_array(model, folder, out, record_in(further, ApplyOptions).which, unit, progress)


def import_logs(
    paths: Sequence[Path], out: Path, answers: Answers, *, columns: Sequence[str], serial: str, add: str | None, further: Sequence[Any]
) -> Imported | None:
    """Make an array of one log's rows, by the column that ``--array-by`` names."""
    own = record_in(further, ImportOptions)
    if own.array_by is None:
        return None
    from tinygc.features.arrays.importing import import_array

    others: dict[str, object] = {
        "--add": add,
        "--serial": serial,
        "--where": answers.where,
        "--topic": answers.topic,
        "--even": answers.even,
    }
    refuse_with("--array-by", others, [each for each in further if each is not own])
    return import_array(paths, out, answers, own.array_by, columns)


#: options of ``fit`` that an array's fit uses
USED = ("bias", "accelerometer", "earth")
OTHERWISE = ", or give one unit a folder of its own"


def simulate(args: Any, options: SimulationOptions, chosen: dict) -> int | None:
    """Simulate several units on one body; return None if no array option is given."""
    array: ArrayOptions = args.of_feature(ArrayOptions)
    if not changed(array):
        return None
    from tinygc.cli.results import output, write_json
    from tinygc.features.arrays.simulation import simulate_array, write_array
    from tinygc.simulation.write import check_folder

    if array.units < 2:
        raise CalibrationError("options of an array, and one unit; add --units N with two or more, or leave them out")
    if options.stop_sigma_deg or any(given(each) for each in args.of_features if each is not array):
        raise CalibrationError("--units: an array has neither rest logs nor turns of known angle; simulate them apart")
    check_folder(args.out, args.force)  # fail early
    folder = write_array(simulate_array(options, array), args.out, args.force)
    output(args).print(f"{folder}: {array.units} units are simulated; the truth is in truth.json, which no command reads")
    write_json(args.json, {"schema": "tinygc-simulate/1", "folder": str(folder), "options": chosen | {"array": asdict(array)}})
    return 0


def _read(folder: Path, progress: Progress) -> Array:
    from tinygc.features.arrays.library import Array
    from tinygc.features.arrays.recording import read_array

    return Array(read_array(folder, lambda name: progress(f"reading {name}", 0, 1)))


def fit(args: Any) -> Done | None:
    """Estimate all units of one folder jointly; None of what is no array."""
    if not is_array(args.folder):
        return None
    from tinygc.cli.results import Done, complain, inside, output, print_commands, try_destinations
    from tinygc.reporting.terminal import progress_bar

    what = f"{args.folder}, an array, whose units are all fitted by least squares together"
    args.refuse_with(what, *USED, "out", "limit_deg", "strict", "verbose", otherwise=OTHERWISE)
    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        found = _read(args.folder, progress).fit(**{name: getattr(args, name) for name in USED}, progress=progress)
    table = found.to_json()
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"models: {folder}")
    print_commands(args, "next:", command_line("explain", args.folder))
    closure = {unit["number"]: unit["closure"]["alone_rms_deg"] for unit in table["units"]}
    above = [] if args.limit_deg is None else [number for number, rms in closure.items() if not rms <= args.limit_deg]
    for number in above:
        complain(f"above --limit: unit {number}'s closure is {closure[number]:.4g} deg")
    return Done(1 if above else 0, table, f"{len(table['units'])} units")


def explain(args: Any) -> int | None:
    """Explain each unit by itself and by comparison with the others; None of what is no array."""
    if not is_array(args.folder):
        return None
    from tinygc.cli.results import inside, output, try_destinations, verdict, write_json
    from tinygc.reporting.terminal import progress_bar

    used = ("check_on", "out", "strict", "pictures", "seed", "earth")
    args.refuse_with(f"{args.folder}, an array", *used, otherwise=OTHERWISE)
    try_destinations(args.out or inside(args.folder, "explain"), args.json)
    with progress_bar(args.quiet) as progress:
        others = [_read(each, progress) for each in args.check_on]
        found = _read(args.folder, progress).explain(seed=args.seed, earth=args.earth, check_on=others, progress=progress)
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"written: {folder}")
    verdict(args, found.line)
    write_json(args.json, found.to_json())
    return 1 if args.strict and found.verdict not in ("no_mismatch", "undecided") else 0
