"""Forty segments, from the virtual board through ``record`` to ``fit``, against the same session read from its file.

With ``--raw-accelerometer``: one that nobody has calibrated, and a closure run behind the segments.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from common import markdown, progress

ROOT = Path(__file__).resolve().parent.parent
CALIBRATE = [sys.executable, str(ROOT / "calibrate.py")]
RUN_S = 50  #: of turning in the closure run
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=int, nargs="*", default=[416, 1667], help="Hz")
    parser.add_argument("--segments", type=int, default=40)
    parser.add_argument("--speed", type=float, default=4.0, help="of the board, times real time")
    parser.add_argument("--raw-accelerometer", action="store_true", help="that the session calibrates, with a closure run")
    args = parser.parse_args()
    if args.raw_accelerometer:
        raw(args)
        return
    header = ("stream", "seconds", "accepted", "samples", "lost", "closure held out", "… from the file", "raw", "… from the file")
    rows = []
    for rate in args.rates:
        with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
            file = Path(folder) / "file"
            progress(f"{rate} Hz, from its file")
            options = ["--odr-hz", rate, "--segments", args.segments, "--closure", 0, "--quiet"]
            run("simulate", "--out", file, *options)
            theirs = closure(file)
            rows += [measure(Path(folder), rate, form, args, theirs) for form in ("text", "frames")]
    progress("")
    print(markdown(header, rows))


def raw(args: argparse.Namespace) -> None:
    """A table of sessions that calibrate both sensors, closure run included."""
    header = (
        "stream",
        "seconds",
        "accepted",
        "gravity's spread, mg",
        "… calibrated",
        "closure held out",
        "floor",
        "closure run",
        "its floor",
    )
    rows = []
    for rate in args.rates:
        with tempfile.TemporaryDirectory(prefix="tinygc-") as name:
            folder = Path(name)
            progress(f"{rate} Hz")
            port, config, out = folder / "port", folder / "bench.toml", folder / "s"
            words = ["--rate", rate, "--segments", args.segments, "--link", port, "--config", config, "--lead", 4, "--speed", args.speed]
            words += ["--raw-accelerometer", "--closure", RUN_S + 4]
            board = subprocess.Popen(
                [*CALIBRATE, "board", *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=ROOT, env=ENVIRONMENT
            )
            board.stdout.readline()
            began = time.monotonic()
            words = ["--port", port, "--out", out, "--like", config, "--segments", args.segments, "--closure", RUN_S]
            told = json.loads(run("record", *words, "--json", "-"))
            seconds = time.monotonic() - began
            board.terminate()
            board.wait()
            fit = json.loads(run("fit", out, "--methods", "least_squares", "--json", "-"))
            (closed,) = fit["closure_runs"]
            found, spread, segments = fit["methods"]["least_squares"]["holdout"], told["accelerometer"]["spread_mg"], told["segments"]
            rows.append(
                (
                    f"{rate} Hz, text",
                    f"{seconds:.0f}",
                    f"{segments['accepted']} of {segments['accepted'] + segments['rejected']}",
                    f"{spread['before']:.1f}",
                    f"{spread['after']:.3f}",
                    f"{found['tilt_rms_deg']:.4f}°",
                    f"{fit['noise']['closure_floor_rms_deg']:.4f}°",
                    f"{closed['least_squares']['rmse_deg']:.4f}°",
                    f"{closed['floor_rmse_deg']:.4f}°",
                )
            )
    progress("")
    print(markdown(header, rows))


def measure(folder: Path, rate: int, form: str, args: argparse.Namespace, theirs: tuple[str, str]) -> tuple:
    """One line of the table."""
    name = f"{rate} Hz, {form}"
    progress(name)
    port, config, out = folder / f"port-{form}", folder / "bench.toml", folder / form
    words = ["--rate", rate, "--segments", args.segments, "--link", port, "--config", config, "--lead", 4, "--speed", args.speed]
    command = [*CALIBRATE, "board", *map(str, words), *["--frames"] * (form == "frames")]
    board = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=ROOT, env=ENVIRONMENT)
    board.stdout.readline()
    began = time.monotonic()
    told = json.loads(run("record", "--port", port, "--out", out, "--like", config, "--segments", args.segments, "--json", "-"))
    seconds = time.monotonic() - began
    board.terminate()
    board.wait()
    mine, segments = closure(out), told["segments"]
    accepted = f"{segments['accepted']} of {segments['accepted'] + segments['rejected']}"
    return name, f"{seconds:.0f}", accepted, told["samples"], told["lost"], mine[0], theirs[0], mine[1], theirs[1]


def closure(folder: Path) -> tuple[str, str]:
    """Held-out closure of least squares, and raw, degrees rms."""
    methods = json.loads(run("fit", folder, "--methods", "raw,least_squares", "--json", "-"))["methods"]
    return tuple(f"{methods[name]['holdout']['tilt_rms_deg']:.4f}°" for name in ("least_squares", "raw"))


def run(*words) -> str:
    """A command's standard output."""
    return subprocess.run([*CALIBRATE, *map(str, words)], check=True, capture_output=True, text=True, cwd=ROOT, env=ENVIRONMENT).stdout


if __name__ == "__main__":
    main()
