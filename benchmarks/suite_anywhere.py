"""Run the tests where they are hardest to pass: signals ignored, one core, a busy machine, another order; count what is left running.

python benchmarks/suite_anywhere.py                             all tests, under each condition
python benchmarks/suite_anywhere.py --only nohup busy -- tests/test_record.py -n 0
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
import uuid
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOOPS = 4
NAMES = ("tests", "failures", "errors", "skipped")  #: of a JUnit result
SETTLE_S = 10.0  #: after the run, for what ends by itself
BUSY = "while True: pass"
CONDITIONS = {
    "alone": "nothing special",
    "nohup": "SIGINT and SIGHUP ignored, as behind `nohup … &`",
    "core": "one core (`taskset -c 0`)",
    "busy": f"{LOOPS} busy loops beside it",
    "shuffled": "files and their tests in random order",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0], epilog="What follows -- goes to pytest.")
    parser.add_argument("--only", nargs="+", choices=CONDITIONS, default=list(CONDITIONS)[1:], help="some conditions (all but alone)")
    parser.add_argument("--seed", type=int, default=14, help="of the random order (%(default)s)")
    parser.add_argument("--log", type=Path, help="folder for what pytest says under each condition")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest")
    args = parser.parse_args()
    print(f"| condition | passed | failed | errors | skipped | processes left | minutes |\n| --- {'| ---: ' * 6}|", flush=True)
    for condition in args.only:
        words = args.pytest + (["--shuffle", str(args.seed)] if condition == "shuffled" else [])
        with busy_loops(LOOPS if condition == "busy" else 0):
            counts, minutes = run(condition, words, args.log)
        print(f"| {CONDITIONS[condition]} | {' | '.join(map(str, counts))} | {minutes:.1f} |", flush=True)


def run(condition: str, words: list[str], log: Path | None) -> tuple[list[int], float]:
    """Passed, failed, errors, skipped, and processes that were left, which are then killed; minutes."""
    mark = f"TINYGC_SUITE={uuid.uuid4().hex}"
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.xml"
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", f"--junitxml={result}", *words]
        if condition == "nohup":
            command = ["bash", "-c", "trap '' INT HUP; exec \"$@\"", "bash", *command]
        elif condition == "core":
            command = ["taskset", "-c", "0", *command]
        environment = os.environ | {"PYTHONPATH": str(ROOT)} | dict([mark.split("=")])
        began = time.monotonic()
        said = subprocess.run(command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        minutes = (time.monotonic() - began) / 60
        if log:
            log.mkdir(parents=True, exist_ok=True)
            (log / f"{condition}.txt").write_text(said.stdout + said.stderr, encoding="utf-8")
        if not result.exists():
            raise SystemExit(f"pytest made no result: {(said.stdout + said.stderr)[-2000:]}")
        counts = {name: sum(int(suite.get(name)) for suite in ElementTree.parse(result).iter("testsuite")) for name in NAMES}
    passed = counts["tests"] - counts["failures"] - counts["errors"] - counts["skipped"]
    return [passed, counts["failures"], counts["errors"], counts["skipped"], len(left_running(mark))], minutes


def left_running(mark: str) -> list[int]:
    """Processes with this mark in their environment, once those that were about to end have ended; they are killed."""
    deadline = time.monotonic() + SETTLE_S
    while (found := marked(mark)) and time.monotonic() < deadline:
        time.sleep(0.2)
    for number in found:
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    return found


def marked(mark: str) -> list[int]:
    """Running processes; on Linux and macOS ``ps e`` shows their environment."""
    said = subprocess.run(["ps", "axeww", "-o", "pid=,args="], capture_output=True, text=True).stdout
    return [int(line.split()[0]) for line in said.splitlines() if mark in line]


@contextlib.contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """So many processes that only take time."""
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


if __name__ == "__main__":
    main()
