"""``noise``: the terms of a unit's noise, of its rest logs, of the stills of its sessions, or of an Allan curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.options import argument, folder_written, option
from tinygc.cli.options import LONGEST_S, Command
from tinygc.cli.results import output, try_destinations, write_json

CURVE = "an Allan curve that is there already"
SUMMARY = "the noise of a sensor at rest, from milliseconds to hours: each term with its sigma, and when the others will be known"


@dataclass(frozen=True)
class Options(Command):
    """Options of ``noise``."""

    logs: tuple[Path, ...] = argument("of one unit: session folders, folders of rest logs, or standard logs", (), metavar="DIR|LOG")
    out: Path | None = option(None, "where noise.json and noise.png go (fit in the first session)", metavar="DIR", read=folder_written)
    sensor: str = option("", "what the sensor is, such as MPU-9250", read=str)
    serial: str = option("", "which one it is", metavar="TEXT", read=str)
    verbose: bool = option(False, "print every term, and all remarks")
    pictures: bool = option(True, "draw the picture", off="write no picture")
    curve: Path | None = option(None, "columns of tau in s and deviations: 1 or 3 of each sensor", group=CURVE)
    curve_units: str | None = option(None, "of its deviations, where its header does not say them: m/s2,deg/s", metavar="LIST", group=CURVE)
    duration: float | None = option(None, "how long the recording was that it is from", unit="s", least=0, most=LONGEST_S, group=CURVE)
    odr: float | None = option(None, "its data rate", unit="Hz", least=0.1, most=50_000, group=CURVE)


def run(args: Options) -> int:
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
        found.save(folder, pictures=args.pictures)
        picture = folder / library.PICTURE
        files = [folder / FILE, *([picture] if picture.exists() and args.pictures else [])]
        output(args).print(f"written: {', '.join(map(str, files))}", soft_wrap=True, markup=False)
    elif args.json is None:
        output(args).print("nothing is written; --out DIR keeps noise.json and noise.png", soft_wrap=True)
    write_json(args.json, found.to_json())
    return 0
