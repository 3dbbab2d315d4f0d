"""CPU seconds, user and system, of whole processes: a user's ``fit``, imports and saving included.

Ratios are of processes that took turns in one run: against Python with NumPy alone, which no fit can do without, and against another
checkout of this project with ``--against``.  The least of several runs counts; sessions are copied first, since ``fit`` writes its models.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from common import markdown, progress

ROOT = Path(__file__).resolve().parents[1]
#: words, session, arguments, target s of an idle core
FITS = (
    ("`fit --methods least_squares`, `../shared/xsens`", ROOT.parent / "shared" / "xsens", ["--methods", "least_squares"], 0.9),
    ("`fit --methods least_squares`, `data/session1`", ROOT / "data" / "session1", ["--methods", "least_squares"], None),
    ("`fit`, `data/session1`", ROOT / "data" / "session1", [], 4.0),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5, help="each is run this often, the least counts (%(default)s)")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="another checkout of this project, whose runs alternate with ours")
    args = parser.parse_args()
    roots = [ROOT, *([args.against.resolve()] if args.against else [])]
    rows = []
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        for number, (words, session, more, target_s) in enumerate(FITS):
            if not session.is_dir():
                continue
            folder = shutil.copytree(session, Path(parent) / str(number), copy_function=shutil.copyfile)
            folder.chmod(0o755)
            times: list[list[float]] = [[] for _ in (None, *roots)]
            for turn in range(args.repeat):
                progress(f"{words} {turn + 1} of {args.repeat}")
                times[0].append(cpu_s(["-c", "import numpy"], ROOT))
                for own, root in zip(times[1:], roots, strict=True):
                    own.append(cpu_s([str(root / "calibrate.py"), "fit", str(folder), *more, "--quiet"], root))
            numpy_s, ours, *others = map(min, times)
            against = [f"{ours / other:.3f}" for other in others]
            rows.append([words, f"{ours:.2f} s", "" if target_s is None else f"at most {target_s:g} s", f"{ours / numpy_s:.1f}", *against])
    progress("")
    header = [
        "whole process",
        "CPU",
        "target, idle core",
        "times Python with NumPy",
        *(["share of the other checkout's"] if args.against else []),
    ]
    print(markdown(header, rows))


def cpu_s(arguments: list[str], root: Path) -> float:
    """Of one Python process that imports this project from ``root``."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    own = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, *arguments], env=own, cwd=root, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
