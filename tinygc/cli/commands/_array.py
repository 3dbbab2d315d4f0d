"""``fit`` and ``explain`` of an array's folder: several units on one rigid body."""

from __future__ import annotations

import argparse

from session.common.errors import CalibrationError
from session.common.texts import shell_word
from tinygc.cli.commands._fitting import given
from tinygc.cli.commands._results import complain, output, try_destinations, verdict, write_json
from tinygc.cli.commands._several import Done

#: of a fit's options, those that an array's heeds
HONOURED = ("bias", "accelerometer", "no_earth")
SAID = ("model", "bias_dps", "physics", "resume", "temperature")


def fit_array_folder(args: argparse.Namespace) -> Done:
    """All units of one folder, estimated together."""
    idle = [*given(args, HONOURED), *(f"--{name.replace('_', '-')}" for name in SAID if getattr(args, name, None))]
    if idle := list(dict.fromkeys(idle)):
        raise CalibrationError(
            f"{', '.join(idle)}: of no use with {args.folder}, an array, whose units are all fitted by least squares together; "
            f"leave {'it' if len(idle) == 1 else 'them'} out, or give one unit a folder of its own"
        )
    from tinygc.cli.console import progress_bar
    from tinygc.library.array import fit

    if args.bias not in (None, "auto", "ends", "stills"):
        raise CalibrationError(f"--bias {args.bias}: a bias of the day is one unit's; an array takes --bias auto, ends or stills")
    try_destinations(args, "fit")
    with progress_bar(args.quiet) as progress:
        found = fit(args.folder, bias=args.bias or "auto", accelerometer=args.accelerometer, use_earth=not args.no_earth, progress=progress)
    table = found.to_json()
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"models: {folder}", soft_wrap=True)
    output(args).print(f"next: calibrate.py explain {shell_word(args.folder)}", soft_wrap=True, markup=False)
    closure = {unit["number"]: unit["closure"]["alone_rms_deg"] for unit in table["units"]}
    above = [] if args.limit is None else [number for number, rms in closure.items() if not rms <= args.limit]
    for number in above:
        complain(f"above --limit: unit {number}'s closure is {closure[number]:.4g} deg")
    return Done(1 if above else 0, table, f"{len(table['units'])} units")


def explain_array_folder(args: argparse.Namespace) -> int:
    """Each unit by itself, and what the others say of it."""
    if args.lot is not None:
        raise CalibrationError(f"--lot: of no use with {args.folder}, an array; leave it out, or give one unit a folder of its own")
    if args.discover:
        raise CalibrationError(
            f"--discover: of no use with {args.folder}, an array; leave it out, or give one unit a folder of its own and search there"
        )
    from tinygc.cli.console import progress_bar
    from tinygc.library.array import explain
    from tinygc.report.array_explain_text import array_verdict_line

    try_destinations(args, "explain")
    with progress_bar(args.quiet) as progress:
        found = explain(args.folder, seed=args.seed, use_earth=not args.no_earth, progress=progress)
    folder = found.save(args.out)
    output(args).print(found.page)
    output(args).print(f"written: {folder}", soft_wrap=True)
    verdict(args, array_verdict_line(found.result))
    write_json(args.json, found.to_json())
    return 1 if args.strict and found.result.verdict != "no_mismatch" else 0
