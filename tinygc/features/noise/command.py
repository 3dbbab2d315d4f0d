"""``noise``: the terms of a unit's noise, of its rest logs, of the stills of its sessions, or of an Allan curve."""

from __future__ import annotations

import argparse
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.options import folder_written, path_read
from tinygc.cli.arguments import data_rate, seconds
from tinygc.cli.results import output, try_destinations, write_json

NAME = "noise"
SUMMARY = "the noise of a sensor at rest, from milliseconds to hours: each term with its sigma, and when the others will be known"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's own arguments."""
    command.add_argument(
        "logs",
        type=path_read,
        nargs="*",
        metavar="DIR|LOG",
        help="of one unit: session folders, folders of rest logs, or standard logs",
    )
    command.add_argument("--out", type=folder_written, metavar="DIR", help="where noise.json and noise.png go (fit in the first session)")
    command.add_argument("--sensor", default="", metavar="NAME", help="what the sensor is, such as MPU-9250")
    command.add_argument("--serial", default="", metavar="TEXT", help="which one it is")
    command.add_argument("--verbose", action="store_true", help="print every term, and all remarks")
    command.add_argument("--no-pictures", action="store_true", help="write no picture")
    curve = command.add_argument_group("an Allan curve that is there already")
    curve.add_argument("--curve", type=path_read, metavar="FILE", help="columns of tau in s and deviations: 1 or 3 of each sensor")
    curve.add_argument("--curve-units", metavar="LIST", help="of its deviations, where its header does not say them: m/s2,deg/s")
    curve.add_argument("--duration", type=seconds, metavar="S", help="how long the recording was that it is from")
    curve.add_argument("--odr", type=data_rate, metavar="HZ", help="its data rate")


def run(args: argparse.Namespace) -> int:
    """Estimate the noise of one unit, print it, and write noise.json and noise.png."""
    from session.base.names import is_session
    from tinygc.features.noise import library
    from tinygc.noise.figures import FILE
    from tinygc.reporting.terminal import progress_bar

    if bool(args.logs) == (args.curve is not None):
        raise CalibrationError("noise: give logs or session folders at rest, or --curve FILE, and not both")
    if args.curve is None and (args.curve_units or args.duration):
        raise CalibrationError("--curve-units and --duration are of --curve FILE; leave them out")
    session = next((path for path in args.logs if path.is_dir() and is_session(path)), None)
    folder: Path | None = args.out or (None if session is None else session / "fit")
    try_destinations(folder, args.json)
    with progress_bar(args.quiet) as progress:
        if args.curve is not None:
            found = library.noise_of_curve(args.curve, args.curve_units, args.duration, args.odr, args.sensor, args.serial)
        else:
            found = library.noise_of(args.logs, args.sensor, args.serial, progress)
    output(args).print(found.pages(args.verbose))
    if folder is not None:
        found.save(folder, pictures=not args.no_pictures)
        picture = folder / library.PICTURE
        files = [folder / FILE, *([picture] if picture.exists() and not args.no_pictures else [])]
        output(args).print(f"written: {', '.join(map(str, files))}", soft_wrap=True, markup=False)
    elif args.json is None:
        output(args).print("nothing is written; --out DIR keeps noise.json and noise.png", soft_wrap=True)
    write_json(args.json, found.to_json())
    return 0
