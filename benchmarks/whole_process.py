"""CPU seconds, user and system, and peak memory of whole processes: imports, reading and saving included.

Ratios are of processes that took turns in one run: against Python with NumPy alone, which no fit can do without, and against another
checkout of this project with ``--against``.  The least of several runs counts; sessions are copied first, since ``fit`` writes its models.
The sessions of many turns, and logs of many rows with 14 turns between long rests, are simulated; each is run once.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from common import markdown, progress

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from long_logs import long_session  # noqa: E402

LEAST_SQUARES = ("--methods", "least_squares")
#: command, session
USUAL = (
    (("fit", *LEAST_SQUARES), ROOT.parent / "shared" / "xsens"),
    (("fit", *LEAST_SQUARES), ROOT / "data" / "session1"),
    (("fit",), ROOT / "data" / "session1"),
    (("explain",), ROOT / "data" / "session1"),
)
OF_MANY_TURNS = (("check",), ("fit",), ("explain",))
OF_MANY_ROWS = (("check",), ("fit",), ("noise",))
#: rows of the session whose model is verified with one of many rows
LEAST_ROWS = 100_000
#: a process of its own, small, so that the peak that the system tells is that of the command
PROBE = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([done.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss, done.stderr[-300:]]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5, help="each is run this often, the least counts (%(default)s)")
    parser.add_argument("--turns", type=int, nargs="*", default=[2000], help="of simulated sessions (%(default)s)")
    parser.add_argument("--rows", type=int, nargs="*", default=[], help="of simulated logs with long rests, 18000000 for a day (none)")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="another checkout of this project, whose runs alternate with ours")
    args = parser.parse_args()
    roots = [ROOT, *([args.against.resolve()] if args.against else [])]
    rows = []
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        jobs = []
        for number, (command, session) in enumerate(USUAL):
            if session.is_dir():
                folder = shutil.copytree(session, Path(parent) / str(number), copy_function=shutil.copyfile)
                folder.chmod(0o755)
                jobs.append((f"`{' '.join(command)}`, `{session.name}`", command, folder, args.repeat))
        for turns in args.turns:
            folder = Path(parent) / f"turns{turns}"
            used(["calibrate.py", "simulate", "--segments", str(turns), "--closure", "0", "--out", str(folder), "--quiet"], ROOT)
            jobs += [(f"`{command[0]}`, {turns} turns", command, folder, 1) for command in OF_MANY_TURNS]
        for rows_of_log in args.rows:
            folder, short = (long_session(Path(parent) / f"rows{count}", count) for count in (rows_of_log, LEAST_ROWS))
            used(["calibrate.py", "fit", str(short), *LEAST_SQUARES, "--quiet"], ROOT)
            verify = ("verify", str(short / "fit" / "model_least_squares.json"))
            jobs += [(f"`{command[0]}`, {rows_of_log} rows", command, folder, 1) for command in (*OF_MANY_ROWS, verify)]
        for words, command, folder, repeat in jobs:
            runs: list[list[tuple[float, float]]] = [[] for _ in (None, *roots)]
            for turn in range(repeat):
                progress(f"{words} {turn + 1} of {repeat}")
                runs[0].append(used(["-c", "import numpy"], ROOT))
                for own, root in zip(runs[1:], roots, strict=True):
                    own.append(used([str(root / "calibrate.py"), *command, str(folder), "--quiet"], root))
            (numpy_s, numpy_mb), (ours_s, ours_mb), *others = ([min(each) for each in zip(*own, strict=True)] for own in runs)
            against = [f"{ours_s / cpu_s:.3f}; {ours_mb / mb:.3f}" for cpu_s, mb in others]
            rows.append([words, f"{ours_s:.2f} s", f"{ours_s / numpy_s:.1f}", f"{ours_mb:.0f} MB", f"{ours_mb / numpy_mb:.1f}", *against])
    progress("")
    header = ["whole process", "CPU", "times Python with NumPy", "peak memory", "times Python with NumPy"]
    print(markdown([*header, *(["of the other checkout's CPU; memory"] if args.against else [])], rows))


def used(arguments: list[str], root: Path) -> tuple[float, float]:
    """CPU s and peak MB of one Python process, of one thread, that imports this project from ``root``."""
    own = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    probe = [sys.executable, "-c", PROBE, sys.executable, *arguments]
    code, cpu_s, peak, said = json.loads(subprocess.run(probe, env=own, cwd=root, check=True, capture_output=True, text=True).stdout)
    if code not in (0, 1, 5):
        sys.exit(said)
    return cpu_s, peak * (1 if sys.platform == "darwin" else 1024) / 1e6


if __name__ == "__main__":
    main()
