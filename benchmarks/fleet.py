"""What a fleet of sessions costs, and that its table is the same however it comes about.

    python benchmarks/fleet.py make FOLDER [--count 10000]      simulated sessions: 8 turns at 104 Hz, a unit each
    python benchmarks/fleet.py scale FOLDER [--counts 100 1000 10000]
    python benchmarks/fleet.py dask FOLDER [--count 100]        a local cluster of two workers, one of which is killed, against processes

CPU seconds leave out most of what else the machine does; they are of the computing
process for each session (beside the table, in ``durations``), and of the parent for everything else.
"""

from __future__ import annotations

import argparse
import os
import signal
import sqlite3
import tempfile
import time
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from common import markdown, progress

from tinygc.annexes.lots.fleet_row import FleetOptions
from tinygc.annexes.lots.fleet_run import Cluster, Processes, Tally, run_fleet, session_folders
from tinygc.annexes.lots.fleet_table import NAME, open_table
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session


def make(folder: Path, count: int) -> None:
    for seed in range(count):
        place = folder / f"{seed // 1000:03d}" / f"unit{seed:06d}"
        write_session(SimulationOptions(segments=8, closure_s=0.0, odr_hz=104.0, seed=seed), place)


def memory_mb(number: int) -> float:
    """A process's largest so far (Linux)."""
    lines = Path(f"/proc/{number}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def computed(folder: Path, count: int, out: Path, executor, halfway: Callable[[], None] = lambda: None) -> tuple:
    """Run the first ``count`` sessions; wall and CPU seconds of this process, and peak memory in the end, the children's after its own."""
    seen: list[float] = []

    def told(tally: Tally) -> None:
        progress(f"{tally.folders} of {count}: {tally.done} done, {tally.failed} failed, {tally.reused} reused")
        if isinstance(executor, Processes) and tally.folders == count:
            seen.extend(map(memory_mb, [os.getpid(), *(worker.process.pid for worker in executor._workers)]))
        if tally.folders == count // 2:
            halfway()

    began, cpu = time.perf_counter(), time.process_time()
    with open_table(out) as table:
        try:
            run_fleet(islice(session_folders([folder]), count), table, executor, FleetOptions(), progress=told)
        finally:
            executor.close()
    progress("")
    return time.perf_counter() - began, time.process_time() - cpu, seen


def rows(out: Path, sql: str) -> list[tuple]:
    connection = sqlite3.connect(out / NAME)
    try:
        return connection.execute(sql).fetchall()
    finally:
        connection.close()


def content(out: Path) -> list[tuple]:
    return rows(out, "SELECT * FROM results ORDER BY 1") + rows(out, "SELECT * FROM folders ORDER BY 1")


def scale(folder: Path, counts: list[int]) -> None:
    lines = []
    for count in counts:
        with tempfile.TemporaryDirectory(prefix="tinygc-") as temporary:
            out = Path(temporary)
            wall_s, cpu_s, memory = computed(folder, count, out, Processes(2))
            cpu = np.array(rows(out, "SELECT cpu_s FROM durations"))
            each = f"{cpu.mean():.4f} ± {cpu.std() / np.sqrt(count):.4f}", f"{1e3 * cpu_s / count:.2f}", f"{wall_s / count:.3f}"
            lines.append((count, *each, " / ".join(f"{mb:.0f}" for mb in memory), f"{(out / NAME).stat().st_size / count / 1024:.1f}"))
    print(markdown(("sessions", "CPU s each", "parent, ms each", "wall s each", "MB at the end", "KB each"), lines))


def kill_one_of(cluster) -> None:
    with cluster.get_client() as client:
        number = next(iter(client.run(os.getpid).values()))
    os.kill(number, signal.SIGKILL)


def dask(folder: Path, count: int) -> None:
    from distributed import LocalCluster

    with tempfile.TemporaryDirectory(prefix="tinygc-") as temporary:
        one, other = Path(temporary) / "one", Path(temporary) / "other"
        computed(folder, count, one, Processes(2))
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            computed(folder, count, other, Cluster(cluster.scheduler_address), partial(kill_one_of, cluster))
        print(f"the same table: {content(one) == content(other)} ({count} sessions)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("make", "scale", "dask"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int)
    parser.add_argument("--counts", type=int, nargs="*", default=[100, 1000, 10_000])
    args = parser.parse_args()
    if args.what == "scale":
        scale(args.folder, args.counts)
    elif args.what == "make":
        make(args.folder, args.count or 10_000)
    else:
        dask(args.folder, args.count or 100)


if __name__ == "__main__":
    main()
