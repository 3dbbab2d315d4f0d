"""``python -m session.public NAME DIR``: session folders of a public set, from its authors' own files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from session.annexes.public import adis16405, broad, euroc, imucal, mikov, mimu, phones, repoimu, sundevil, tofupilot, xsens
from session.io.errors import CalibrationError
from session.io.texts import printable

#: of each set: files, folder to write into, whether the accelerometer is as the authors give it, or from stills -> session folders
SETS: dict[str, Callable[[Path, Path, bool], Iterable[Path]]] = {
    "xsens": xsens.write,
    "mikov": mikov.write,
    "mimu": mimu.write,
    "euroc": euroc.write,
    "imucal": imucal.write,
    "tofupilot": tofupilot.write,
    "broad": broad.write,
    "repoimu": repoimu.write,
    "sundevil": sundevil.write,
    "adis16405": adis16405.write,
    "phones": phones.write,
}
#: of sets whose units were fixed to one body: the same as arrays
ARRAYS: dict[str, Callable[[Path, Path], Iterable[Path]]] = {"mikov": mikov.write_array, "mimu": mimu.write_array}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the folders and print the path of each that is whole.  Exit code 2, and one line, for what is wrong with the files."""
    parser = argparse.ArgumentParser(
        prog="python -m session.public", description="Session folders of a public set of recordings; docs/real-recordings.md says more."
    )
    parser.add_argument("name", choices=tuple(SETS), help="which set")
    parser.add_argument("dir", type=Path, help="folder with the authors' own files, as they were downloaded")
    parser.add_argument("--out", type=Path, help="where the session folders are written (DIR/sessions)")
    parser.add_argument(
        "--accelerometer",
        choices=("given", "stills"),
        default="given",
        help="its calibration: what the authors give, or nothing; or nine numbers from the recording's own stills (%(default)s)",
    )
    parser.add_argument("--array", action="store_true", help=f"the units of one body as one array ({', '.join(ARRAYS)})")
    args = parser.parse_args(arguments)
    try:
        for folder in _folders(args):
            print(printable(str(folder)))
    except (CalibrationError, OSError) as error:
        print(f"session.public: {error}", file=sys.stderr)
        return 2
    return 0


def _folders(args: argparse.Namespace) -> Iterable[Path]:
    out = args.out or args.dir / "sessions"
    if not args.array:
        return SETS[args.name](args.dir, out, args.accelerometer == "given")
    if args.name not in ARRAYS:
        raise CalibrationError(f"--array: {args.name} is no array; expected {' or '.join(ARRAYS)}")
    if args.accelerometer != "given":
        raise CalibrationError("--array: --accelerometer stills writes one calibration into one session; leave one of the two out")
    return ARRAYS[args.name](args.dir, out)


if __name__ == "__main__":
    sys.exit(main())
