"""How far a thing walks through the house: a rate from its log to the closure table, an effect from the catalogue to its picture.

``python benchmarks/walks.py data/session1``: the job is run once, and every call of the project's own functions that is handed the thing
(an array of rates, or a record that holds it) is followed in the order of time, each function once, as a reader would meet it.  A room is
a folder of ``tinygc`` or ``session``, or a module that lies loose beside them; a return is a step into a room that was left before.
``--root`` looks at another checkout.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: what carries the thing: an array of at least so many rows of three, or a record of these names
ROWS = 50
CARRIERS = {
    "rate": {"Samples", "Log", "Session", "Batch", "Problem", "Prepared", "MethodFit", "FitResult", "Fit"},
    "effect": {"Effect", "Claim", "AppliedEffect", "Claimed", "Named", "NamedEffect", "SizedEffect", "Naming", "Explanation", "Why"},
}


class Walk:
    """Follows calls: ``steps`` from room to room, ``files`` seen, ``returns`` to a room that was left before."""

    def __init__(self, root: Path, what: str):
        self.root, self.what = str(root), what
        self.seen, self.files, self.steps = set(), set(), []

    def __call__(self, frame, event: str, argument) -> None:
        """For ``sys.setprofile``."""
        name = frame.f_code.co_filename
        if event != "call" or not name.startswith(self.root) or not self._carries(frame):
            return
        parts = Path(name).relative_to(self.root).parts
        if parts[0] not in ("tinygc", "session") or frame.f_code in self.seen:
            return
        self.seen.add(frame.f_code)
        self.files.add(parts)
        room = "/".join(parts[:2])
        if not self.steps or self.steps[-1] != room:
            self.steps.append(room)

    def _carries(self, frame) -> bool:
        code = frame.f_code
        return any(self._is_it(frame.f_locals.get(name)) for name in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount])

    def _is_it(self, value) -> bool:
        if self.what == "rate" and type(value).__name__ == "ndarray":
            return value.ndim >= 2 and value.shape[-1] == 3 and value.shape[-2] >= ROWS
        if isinstance(value, list | tuple) and value:
            value = value[0]
        return type(value).__name__ in CARRIERS[self.what]

    @property
    def returns(self) -> int:
        """Steps into a room that was left before."""
        return len(self.steps) - len(set(self.steps))


def walk(root: Path, what: str, words: list[str]) -> Walk:
    """One command of the checkout at ``root``, followed."""
    sys.path.insert(0, str(root))
    import calibrate

    follower = Walk(root, what)
    sys.setprofile(follower)
    try:
        calibrate.main([*words, "--quiet"])
    finally:
        sys.setprofile(None)
    return follower


def main() -> None:
    """Print both walks."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="session folder; it is copied")
    parser.add_argument("--root", type=Path, default=ROOT, help="another checkout")
    parser.add_argument("--only", choices=("rate", "effect"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.only is None:
        for what in ("rate", "effect"):  # each in a process of its own
            subprocess.run([sys.executable, __file__, str(args.folder), "--root", str(args.root), "--only", what], check=True)
        return
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(shutil.copytree(args.folder, Path(scratch) / "session"))
        words = ["fit", str(copy), "--methods", "least_squares"] if args.only == "rate" else ["explain", str(copy)]
        found = walk(args.root.resolve(), args.only, words)
    job = "from its log to the closure table" if args.only == "rate" else "from the catalogue to its picture"
    print(f"{args.only} {job}: {len(set(found.steps))} rooms, {len(found.files)} files, {found.returns} returns")
    print("  " + " > ".join(found.steps))


if __name__ == "__main__":
    main()
