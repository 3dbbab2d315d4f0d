"""Commands for arrays: ``fit``, ``explain`` and ``simulate`` of several units on one rigid body.

Imports nothing heavy at its top, since the core's commands load it for its options.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.options import changed, given
from session.base.progress import Progress
from session.base.texts import command_line
from tinygc.cli.results import Done, complain, inside, output, print_commands, try_destinations, verdict, write_json
from tinygc.features.arrays.feature import ArrayOptions
from tinygc.features.arrays.names import is_array

if TYPE_CHECKING:
    from pathlib import Path

    from tinygc.features.arrays.library import Array
    from tinygc.simulation.options import SimulationOptions

#: options of ``fit`` that an array's fit uses
USED = ("bias", "accelerometer", "earth")


def simulate(args: Any, options: SimulationOptions, chosen: dict) -> int | None:
    """Simulate several units on one body; return None if no array option is given."""
    array: ArrayOptions = args.of_feature(ArrayOptions)
    if not changed(array):
        return None
    from tinygc.features.arrays.simulation import simulate_array, write_array
    from tinygc.simulation.write import check_folder

    if array.units < 2:
        raise CalibrationError("options of an array, and one unit; add --units N with two or more, or leave them out")
    if options.stop_sigma_deg or any(given(each) for each in args.of_features if each is not array):
        raise CalibrationError("--units: an array has neither rest logs nor turns of known angle; simulate them apart")
    check_folder(args.out, args.force)  # fail early
    folder = write_array(simulate_array(options, array), args.out, args.force)
    output(args).print(f"{folder}: {array.units} units are simulated; the truth is in truth.json, which no command reads", soft_wrap=True)
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
    from tinygc.reporting.terminal import progress_bar

    what = f"{args.folder}, an array, whose units are all fitted by least squares together"
    args.refuse_beside(what, *USED, "folder", "more", "out", "limit", "strict", "verbose")
    try_destinations(args.out or inside(args.folder, "fit"), args.json)
    with progress_bar(args.quiet) as progress:
        found = _read(args.folder, progress).fit(**{name: getattr(args, name) for name in USED}, progress=progress)
    table = found.to_json()
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"models: {folder}", soft_wrap=True)
    print_commands(args, "next:", command_line("explain", args.folder))
    closure = {unit["number"]: unit["closure"]["alone_rms_deg"] for unit in table["units"]}
    above = [] if args.limit is None else [number for number, rms in closure.items() if not rms <= args.limit]
    for number in above:
        complain(f"above --limit: unit {number}'s closure is {closure[number]:.4g} deg")
    return Done(1 if above else 0, table, f"{len(table['units'])} units")


def explain(args: Any) -> int | None:
    """Explain each unit by itself and by comparison with the others; None of what is no array."""
    if not is_array(args.folder):
        return None
    from tinygc.features.arrays.explanation import array_verdict_line
    from tinygc.reporting.terminal import progress_bar

    args.refuse_beside(f"{args.folder}, an array", "folder", "check_on", "out", "strict", "pictures", "seed", "earth")
    try_destinations(args.out or inside(args.folder, "explain"), args.json)
    with progress_bar(args.quiet) as progress:
        others = [_read(each, progress) for each in args.check_on]
        found = _read(args.folder, progress).explain(seed=args.seed, earth=args.earth, check_on=others, progress=progress)
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"written: {folder}", soft_wrap=True)
    verdict(args, array_verdict_line(found.result))
    write_json(args.json, found.to_json())
    return 1 if args.strict and found.result.verdict not in ("no_mismatch", "undecided") else 0
