"""What the benchmarks share: simulated sessions in a temporary folder, two processes, Markdown tables."""

from __future__ import annotations

import math
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from session.base.rotation import from_euler, matrix
from session.log.folder import Session
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.write import write_session

PROCESSES = 2


@contextmanager
def simulated(options: SimulationOptions, distort: Callable | None = None):
    """A simulated session's folder, gone afterwards; ``distort``: what is concealed in its rates."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as parent:
        yield write_session(options, Path(parent) / f"seed{options.seed}", distort=distort)


def with_heading(session: Session, heading_deg: float | None) -> Session:
    """The same session with another heading in its configuration."""
    return replace(session, config=replace(session.config, site=replace(session.config.site, heading_deg=heading_deg)))


def first_still_heading_deg(options: SimulationOptions) -> float:
    """True heading of the body's x axis in the first still, where a fit puts yaw zero."""
    simulation = simulate_session(replace(options, segments=1, closure_s=0.0))
    yaw, pitch, roll = simulation.plan.start_rad
    R_tb = matrix(from_euler(roll, pitch, yaw))
    return simulation.unit.heading_deg + math.degrees(math.atan2(R_tb[1, 0], R_tb[0, 0]))


def in_parallel(work: Callable, jobs: Sequence, what: str, processes: int = PROCESSES) -> list:
    """``work`` on each job, in processes of one thread each; a line of progress on standard error."""
    os.environ["OMP_NUM_THREADS"] = "1"  # inherited by the children, who import torch and BLAS afresh
    results = []
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        for result in pool.map(work, jobs):
            results.append(result)
            progress(f"{what} {len(results)} of {len(jobs)}")
    progress("")
    return results


def progress(text: str) -> None:
    """Show where a long benchmark is; nothing where standard error is no terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)


def markdown(header: Sequence[str], rows: Iterable[Sequence]) -> str:
    """A Markdown table: first column to the left, the others to the right."""
    lines = [header, ["---"] + ["---:"] * (len(header) - 1), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)
