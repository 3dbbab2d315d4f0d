"""How long ``explain`` takes, step by step, and how it grows with segments and samples.

    python benchmarks/explain_speed.py [--segments 20 40 80 160 320 640]

Each session hides a bias that follows temperature and gravity, so that the naming has two rounds and lookalikes to refit.
Each runs in a fresh process of one thread; the times are its CPU seconds, so that whatever else the machine does is left out (two
threads take a little less), and the memory is its largest.
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

import numpy as np
from common import markdown, progress

from session.io.units import DEG, G
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

STEPS = ("reading", "boring causes", "registers", "stills", "digital twin", "naming", "lookalikes", "beyond the catalogue", "proof")
K_THERMAL, K_GRAVITY = 0.01 * DEG, 0.02 * DEG


def timed(folder: Path) -> dict:
    """Seconds by step, and MB, of explaining one folder in this process."""
    from tinygc.explanation.engine import explain_session

    seconds, now = dict.fromkeys(STEPS, 0.0), [STEPS[0], time.process_time()]

    def step(what: str, done: int, of: int) -> None:
        name = next((step for step in STEPS if what.startswith(step)), now[0])
        moment = time.process_time()
        seconds[now[0]] += moment - now[1]
        now[:] = name, moment

    result = explain_session(folder, progress=step)
    step(now[0], 0, 0)
    samples = sum(len(log.samples) for log in result.problem.logs)
    named = [claim.effect.id for claim in result.claimed]
    return {"seconds": seconds, "total": sum(seconds.values()), "memory_mb": peak_memory_mb(), "samples": samples, "named": named}


def peak_memory_mb() -> float:
    """This program's own largest; ru_maxrss would count the process that it was forked from (Linux; nan elsewhere)."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), float("nan"))


def measured(options: SimulationOptions) -> dict:
    """Simulate, and explain in a fresh process."""

    def distort(t, rate, force, temp):
        return rate + K_THERMAL * (temp - options.temperature_start_c)[:, None] + K_GRAVITY * force[:, ::-1] / G

    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        folder = write_session(options, Path(parent) / "session", distort=distort)
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, __file__, "--one", str(folder)]
        return json.loads(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)


def exponent(sizes: list[float], seconds: list[float]) -> float:
    """Growth as a power of the size, between the larger half of the sizes, where fixed costs no longer count."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(np.maximum(seconds[half:], 1e-3)), 1)[0])


def growth(title: str, sizes: list[float], results: list[dict]) -> str:
    """A row for each step, a column for each size, and the power that it grows with."""
    rows = []
    for name in (*STEPS, "total"):
        seconds = [result["total"] if name == "total" else result["seconds"][name] for result in results]
        if max(seconds) > 0.005:
            power = exponent([result["samples"] for result in results], seconds)
            rows.append((name, *(f"{each:.2f}" for each in seconds), f"{power:.2f}" if max(seconds) > 0.3 else ""))
    rows.append(("memory, MB", *(f"{result['memory_mb']:.0f}" for result in results), ""))
    rows.append(("named", *(str(len(result["named"])) for result in results), ""))
    return markdown((title, *map("{:g}".format, sizes), "∝ samples^"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--segments", type=int, nargs="*", default=[20, 40, 80, 160, 320, 640])
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        print(json.dumps(timed(args.one)))
        return
    results = []
    for segments in args.segments:
        progress(f"{segments} segments")
        results.append(measured(SimulationOptions(segments=segments, closure_s=0.0, warm_up_c=6.0, seed=1)))
    progress("")
    print(growth("segments, 208 Hz: CPU seconds", args.segments, results))


if __name__ == "__main__":
    main()
