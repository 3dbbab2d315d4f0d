"""``noise``: the terms of a unit's noise, of its rest logs, of the stills of its sessions, or of an Allan curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.options import argument, folder_written, option, values
from tinygc.cli.options import Command, Pictures
from tinygc.cli.results import keep, output, try_destinations
from tinygc.features.noise.options import NoiseOptions


@dataclass(frozen=True)
class Options(NoiseOptions, Pictures, Command):
    """Options of ``noise``."""

    logs: tuple[Path, ...] = argument("of one unit: session folders, folders of rest logs, or standard logs", (), metavar="DIR|LOG")
    out: Path | None = option(None, "where noise.json and noise.svg go (fit in the first session)", metavar="DIR", read=folder_written)
    verbose: bool = option(False, "print every term, and all remarks")


def run(args: Options) -> int:
    """Estimate the noise of one unit, print it, and write noise.json and noise.svg."""
    from session.base.names import is_session
    from tinygc.features.noise.library import PICTURE, estimate_noise
    from tinygc.noise.figures import FILE
    from tinygc.reporting.terminal import progress_bar

    if bool(args.logs) == (args.curve is not None):
        raise CalibrationError("noise: give logs or session folders at rest, or --curve FILE, and not both")
    if args.curve is None and (args.curve_units or args.duration_s):
        raise CalibrationError("--curve-units and --duration are of --curve FILE; leave them out")
    session = next((path for path in args.logs if path.is_dir() and is_session(path)), None)
    folder: Path | None = args.out or (None if session is None else session / "fit")
    try_destinations(folder, args.json)
    with progress_bar(args.quiet) as progress:
        found = estimate_noise(list(args.logs) or None, progress=progress, **values(args, NoiseOptions))
    output(args).print(found.pages(args.verbose))
    keep(args, found, folder, FILE, PICTURE)
    return 0
