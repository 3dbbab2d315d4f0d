"""CPU seconds, user and system, and peak memory of whole processes of one thread: imports, reading and saving included.

    python benchmarks/whole_process.py --against CHECKOUT                  what a user waits for, in two versions
    python benchmarks/whole_process.py --beside "imu_calib acc.mat gyro.mat"    and in another program
    python benchmarks/whole_process.py --growth turns                      how cost grows with turns, rows or sensors

All take turns, ``--repeat`` times, and the least of each counts.  Bytecode is kept, and made before the first run.  Each version has its
own copies of the sessions, since commands write into them and take what is there.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import markdown, progress

from session.base.numeric import decimal_rows

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
ENVIRONMENT |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
SESSIONS = ROOT / "data" / "session1", ROOT.parent / "shared" / "xsens"
SENSOR = "--segments 8 --closure 0 --odr-hz 104"
#: of a fleet
SENSORS = 40
#: in this order, since a report takes what fit and explain have left; ``new`` is removed before each
USUAL = (
    "check session1",
    "fit session1 --methods least_squares",
    "fit session1",
    "explain xsens",
    "report session1",
    "noise rest.csv",
    "import rest.csv --out new",
    "explain turns640",
    "fleet fleet --jobs 1 --out new",
)
#: other programs
OTHERS = {
    "AllanTools, `oadev` of its six channels as well": "import allantools, pandas; [allantools.oadev(x, rate=208.0, data_type='freq', "
    "taus='octave') for x in pandas.read_csv('rest.csv').to_numpy().T[1:]]",
}
#: what grows: options of ``simulate``, none for readings at rest; commands; the head of the table with the sizes
OF_TURNS = "check turns/0", "fit turns/0 --methods least_squares", "explain turns/0"
GROWTH = {
    "turns": ("--segments {} --closure 0", OF_TURNS, ("turns", "40", "160", "640", "exponents")),
    "rows": ("", ("noise rest.csv", "import rest.csv --out new"), ("rows", "100000", "1000000", "10000000", "exponents")),
    "sensors": (SENSOR, ("fleet sensors --jobs 1 --out new", "fleet --out new --lot"), ("sensors", "50", "200", "800", "exponents")),
}
#: a process of its own, small, so that the peak that the system tells is that of the command
PROBE = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([done.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss, done.stderr[-300:]]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5, help="each is run this often, the least counts (%(default)s)")
    parser.add_argument("--only", nargs="*", default=[""], metavar="TEXT", help="what has one of these texts")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="another checkout of this project, whose runs alternate with ours")
    parser.add_argument(
        "--beside", action="append", default=[], metavar="COMMAND", help="another program, with its arguments and full paths"
    )
    parser.add_argument("--growth", choices=GROWTH, help="instead, each run once")
    args = parser.parse_args()
    roots = [ROOT, *([args.against.resolve()] if args.against else [])]
    for root in roots:
        subprocess.run([sys.executable, "-m", "compileall", "-q", root / "session", root / "tinygc"], env=ENVIRONMENT, check=True)
    with TemporaryDirectory(prefix="tinygc-") as parent:
        print(growth(args, roots, Path(parent)) if args.growth else usual(args, roots, Path(parent)))


def usual(args: argparse.Namespace, roots: list[Path], parent: Path) -> str:
    """The table of commands in each version, and of other programs."""
    folders = [parent / str(number) for number in range(len(roots))]
    for session in SESSIONS:
        shutil.copytree(session, folders[0] / session.name, copy_function=shutil.copyfile).chmod(0o755)
    write_rest(folders[0] / "rest.csv")
    simulate(folders[0] / "turns640", "--segments 640 --closure 0")
    for sensor in range(SENSORS):
        simulate(folders[0] / "fleet" / str(sensor), f"{SENSOR} --seed {sensor}")
    for folder in folders[1:]:
        shutil.copytree(folders[0], folder)
    jobs = {f"`{words}`": [(ours(words, root), folder) for root, folder in zip(roots, folders, strict=True)] for words in USUAL}
    jobs |= {words: [([sys.executable, "-c", code], folders[0])] for words, code in OTHERS.items()}
    jobs |= {Path(program[0]).name: [(program, folders[0])] for program in map(shlex.split, args.beside)}
    jobs = {words: versions for words, versions in jobs.items() if any(text in words for text in args.only)}
    runs = [[[used(*version) for version in versions] for versions in jobs.values()] for _ in range(args.repeat)]
    rows = []
    for words, *turns in zip(jobs, *runs, strict=True):
        least = [[min(figures) for figures in zip(*version, strict=True)] for version in zip(*turns, strict=True)]
        ratios = [f"{a / b:.2f}" for a, b in zip(*least, strict=True)] if len(least) > 1 else []
        rows.append([words, *(cell for cpu_s, mb in least for cell in (_seconds(cpu_s), f"{mb:.0f}")), *ratios])
    head = ["whole process", "CPU s", "MB"]
    return markdown([*head, f"{roots[1].name}: CPU s", "MB", "CPU, ratio", "MB, ratio"] if len(roots) > 1 else head, rows)


def growth(args: argparse.Namespace, roots: list[Path], parent: Path) -> str:
    """The table of commands by size, with the exponents of CPU and MB from the last size but one to the last."""
    options, commands, head = GROWTH[args.growth]
    sizes = [int(size) for size in head[1:-1]]
    found: dict[str, list[tuple[float, float]]] = {}
    for size in sizes:
        folder = parent / str(size)
        for number in range(size if args.growth == "sensors" else 1 if options else 0):
            simulate(folder / args.growth / str(number), options.format(size) + f" --seed {number}")
        if not options:
            folder.mkdir()
            write_rest(folder / "rest.csv", size)
        for root in roots:
            for words in commands:
                found.setdefault(f"`{words}`" + (f", {root.name}" if len(roots) > 1 else ""), []).append(used(ours(words, root), folder))
        shutil.rmtree(folder)
    rows = []
    for words, figures in found.items():
        exponents = [math.log(b / a) / math.log(sizes[-1] / sizes[-2]) for a, b in zip(*figures[-2:], strict=True)]
        rows.append([words, *(f"{_seconds(cpu_s)} s, {mb:.0f} MB" for cpu_s, mb in figures), "{:.2f}, {:.2f}".format(*exponents)])
    return markdown(head, rows)


def _seconds(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{value:.0f}"


def write_rest(path: Path, rows: int = 10**6) -> None:
    """Readings at rest: microseconds; dps with noise and a random walk, and m/s^2 with noise, in hundredths."""
    rng, gravity = np.random.default_rng(0), np.array([[0], [0], [981]])
    gyro = 5 * rng.normal(size=(3, rows)) + np.cumsum(0.02 * rng.normal(size=(3, rows)), axis=1)
    readings = np.rint([*gyro, *(gravity + 5 * rng.normal(size=(3, rows)))]).astype(np.int64)
    head = "t (us),gx (deg/s),gy (deg/s),gz (deg/s),ax (m/s^2),ay (m/s^2),az (m/s^2)\n"
    path.write_bytes(head.encode() + decimal_rows([4807 * np.arange(rows), *readings], [0, *[2] * 6]))


def simulate(folder: Path, options: str) -> None:
    """Write a session."""
    used(ours(f"simulate --out {folder} {options}", ROOT), ROOT)


def ours(words: str, root: Path) -> list[str]:
    """The command line of one of our commands."""
    return [sys.executable, str(root / "calibrate.py"), *words.split(), "--quiet"]


def used(command: list[str], folder: Path) -> tuple[float, float]:
    """CPU s and peak MB of one process that is run in a folder."""
    progress(shlex.join(command)[-100:])
    if "--out new" in shlex.join(command):
        shutil.rmtree(folder / "new", ignore_errors=True)
    probe = subprocess.run([sys.executable, "-c", PROBE, *command], env=ENVIRONMENT, cwd=folder, check=True, capture_output=True, text=True)
    code, cpu_s, peak, said = json.loads(probe.stdout)
    if code not in (0, 1, 5):
        sys.exit(f"{shlex.join(command)}: {said}")
    progress("")
    return cpu_s, peak * (1 if sys.platform == "darwin" else 1024) / 1e6


if __name__ == "__main__":
    main()
