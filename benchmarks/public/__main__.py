"""Session folders of a public set, from its authors' own files (docs/real-recordings.md); from a checkout:

python -m benchmarks.public NAME DIR [--out FOLDER] [--accelerometer given|stills] [--array]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from session.base.errors import CalibrationError

#: each a module with ``write(source, out, given)``; given: whether the accelerometer is as the authors give it, or from stills
SETS = ("xsens", "mikov", "mimu", "euroc", "imucal", "tofupilot", "broad", "repoimu", "sundevil", "adis16405", "phones")
#: those whose units were fixed to one body, with ``write_array(source, out)``
ARRAYS = ("mikov", "mimu")


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the folders and print the path of each.  Exit code 2, and one line, for what is wrong with the files."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.public", description="Session folders of a public set of recordings.")
    parser.add_argument("name", choices=SETS, help="which set")
    parser.add_argument("dir", type=Path, help="folder with the authors' own files, as they were downloaded")
    parser.add_argument("--out", type=Path, help="where the session folders are written (DIR/sessions)")
    parser.add_argument("--accelerometer", choices=("given", "stills"), default="given", help="its calibration (%(default)s)")
    parser.add_argument("--array", action="store_true", help=f"the units of one body as one array ({', '.join(ARRAYS)})")
    args = parser.parse_args(arguments)
    given = args.accelerometer == "given"
    if args.array and not (given and args.name in ARRAYS):
        parser.error(f"--array is of {' and '.join(ARRAYS)}, without --accelerometer")
    out, of = args.out or args.dir / "sessions", import_module(f".{args.name}", __package__)
    try:
        for folder in of.write_array(args.dir, out) if args.array else of.write(args.dir, out, given):
            print(folder)
    except (CalibrationError, OSError) as error:
        print(f"{args.name}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
