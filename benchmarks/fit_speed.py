"""How long each step of the main job takes, on one session of 40 segments at 208 Hz; ratios are of times measured in one run."""

from __future__ import annotations

import argparse
import gzip
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import markdown, progress

from session.detect.stills import find_stills
from session.io.folder import Session, read_session
from session.io.logfile import read_log
from session.io.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions
from tinygc.estimation.particle_swarm import fit_pso
from tinygc.models.linear import bias_only
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session

SESSION = Path(__file__).resolve().parents[1] / "data" / "session1"
MANY_ROWS = 500_000
MANY_SAMPLES = 3_000_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=SESSION, help="session folder (%(default)s)")
    parser.add_argument("--repeat", type=int, default=3, help="each step is timed this often, the least counts (%(default)s)")
    parser.add_argument("--no-folds", action="store_true", help="leave out the folds")
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.alone:
        return _alone(args.folder, args.alone)
    session = read_session(args.folder)
    problem = build_problem(session)
    rows = [
        *_reading(args.folder, session, args.repeat),
        *_still_detection(session, args.repeat),
        ["stills, segments, attitudes, floor (`build_problem`)", f"{best(lambda: build_problem(session), args.repeat):.2f} s", ""],
        *_methods(problem, args),
        *_whole_job(args.folder),
    ]
    progress("")
    count, longest = problem.batch.rate.shape[:2]
    print(f"{args.folder.name}: {count} segments of up to {longest} samples; {os.cpu_count()} cores; least of {args.repeat} runs.\n")
    print(markdown(["step", "measured", "target"], rows))


def best(work: Callable[[], object], repeat: int) -> float:
    """Least wall-clock time in s of several runs."""
    times = []
    for _ in range(repeat):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def _reading(folder: Path, session: Session, repeat: int):
    """``read_log`` against numpy.loadtxt, on the session's own rows repeated into a long plain file."""
    progress("reading")
    text = gzip.decompress((folder / session.logs[0].path.name).read_bytes()).decode()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    header, body = lines[0], [line.split(",", 1)[1] for line in lines[1:]]
    period_us = round(session.logs[0].samples.period_s * 1e6)
    stamped = (f"{i * period_us},{body[i % len(body)]}" for i in range(MANY_ROWS))
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        long_log = Path(parent) / "log.csv"
        long_log.write_text(header + "\n" + "\n".join(stamped) + "\n", encoding="ascii")
        ours = best(lambda: read_log(long_log, session.config.sensor), repeat)
        plain = best(lambda: np.loadtxt(long_log, delimiter=",", skiprows=1), repeat)
        integers = best(lambda: np.loadtxt(long_log, delimiter=",", skiprows=1, dtype=np.int64), repeat)
    yield [f"reading a log of {MANY_ROWS:,} rows", f"{MANY_ROWS / ours / 1e3:,.0f} thousand rows/s", "about 500"]
    yield ["the same by `numpy.loadtxt`, floats; integers", f"{plain / ours:.2f}; {integers / ours:.2f} times our time", "about 1"]


def _still_detection(session: Session, repeat: int):
    progress("still detection")
    for name, samples in (("208 Hz", _tiled(session.calibrated(session.logs[0]))), ("1667 Hz", _tiled(_fast_samples()))):
        found = []
        seconds = best(lambda samples=samples, found=found: found.append(len(find_stills(samples)[0])), repeat)
        words = f"still detection, {len(samples) / 1e6:.1f} million samples at {name} ({found[0]} stills)"
        yield [words, f"{len(samples) / seconds / 1e6:.1f} million samples/s", "at least 1"]


def _tiled(samples: Samples) -> Samples:
    """A log repeated, its time going on, until it has ``MANY_SAMPLES``."""
    times = -(-MANY_SAMPLES // len(samples))
    span = samples.t_ns[-1] - samples.t_ns[0] + np.int64(np.median(np.diff(samples.t_ns)))
    t_ns = (samples.t_ns[None] + span * np.arange(times)[:, None]).ravel()
    return Samples(t_ns, np.tile(samples.gyro, (times, 1)), np.tile(samples.accel, (times, 1)))


def _fast_samples() -> Samples:
    from session.io.registers import accel_mps2_per_lsb, gyro_rps_per_lsb

    options = SimulationOptions(segments=10, closure_s=0.0, odr_hz=1667)
    log = simulate_session(options).log
    gyro, accel = log.gyro * gyro_rps_per_lsb(options.gyro_fs_dps), log.accel * accel_mps2_per_lsb(options.accel_fs_g)
    return Samples(log.t_us * 1000, gyro, accel)


def _methods(problem: Problem, args: argparse.Namespace):
    from tinygc.estimation.network import train_second_order

    batch, sigma, start = problem.batch, problem.floor.sigma, bias_only(problem.still_rates.rate[0])
    progress("least squares")
    whole = {"least_squares": best(lambda: fit_least_squares(batch, sigma, start), args.repeat)}
    progress("TinyGC-Net")
    whole["tinygc"] = best(lambda: train_second_order(batch, sigma), args.repeat)
    progress("PSO")
    whole["pso"] = best(lambda: fit_pso(batch, sigma, start, seed=0), args.repeat)
    targets = {"least_squares": ("least squares, 12 parameters", 0.5), "tinygc": ("TinyGC-Net to convergence", 3), "pso": ("PSO", 1.5)}
    for name, seconds in whole.items():
        words, target = targets[name]
        yield [words, f"{seconds:.2f} s", f"at most {target:g} s"]
        if not args.no_folds:
            progress(f"{words}, with folds")
            folds = best(lambda name=name: run_method(name, problem, FitOptions()), 1)
            yield ["… and the 5 folds of the held-out closure", f"{folds:.2f} s", ""]


def _whole_job(folder: Path):
    """Time and peak memory of the whole command in a process of its own, of two methods and of all."""
    for methods in ("raw,least_squares", "raw,raw_bias_removed,least_squares,pso,tinygc,tinygc_denoised"):
        progress(f"fit --methods {methods}")
        began = time.perf_counter()
        command = [sys.executable, __file__, str(folder), "--alone", methods]
        answer = subprocess.run(command, check=True, capture_output=True, text=True)
        seconds = time.perf_counter() - began
        words = "all methods and folds" if "pso" in methods else "`--methods raw,least_squares`"
        yield [f"`fit`, {words}, from start to end", f"{seconds:.1f} s, {float(answer.stdout):.0f} MB at most", "less than 1000 MB"]


def _alone(folder: Path, methods: str) -> None:
    from tinygc.estimation.fit import fit_session

    fit_session(folder, replace(FitOptions(), methods=tuple(methods.split(","))))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


if __name__ == "__main__":
    main()
