"""What a fleet of sessions costs, and that its table is the same however it comes about.

    python benchmarks/fleet.py make FOLDER [--count 10000]      simulated sessions: 8 turns at 104 Hz, a unit each
    python benchmarks/fleet.py scale FOLDER [--counts 100 1000 10000] [--jobs 2] [--out OUT]
    python benchmarks/fleet.py killed FOLDER [--count 1000]     kill -9 of the run in the middle, and of a worker; it goes on
    python benchmarks/fleet.py dask FOLDER [--count 100]        a local cluster of two workers, one of which is killed, against processes

``scale`` goes on where it was ended if OUT is kept.  CPU seconds leave out most of what else the machine does; they are of the computing
process for each session (beside the table, in ``durations``), and of the parent for everything else.
"""

from __future__ import annotations

import argparse
import os
import signal
import sqlite3
import subprocess
import sys
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

CALIBRATE = Path(__file__).resolve().parent.parent / "calibrate.py"
DAY = 100_000
DAY_S = 86_400.0


def make(folder: Path, count: int) -> None:
    for seed in range(count):
        place = folder / f"{seed // 1000:03d}" / f"unit{seed:06d}"
        if not (place / "truth.json").exists():
            write_session(SimulationOptions(segments=8, closure_s=0.0, odr_hz=104.0, seed=seed), place, force=place.exists())
        progress(f"{seed + 1} of {count} sessions")
    progress("")


def memory_mb(number: int) -> float:
    """A process's largest so far (Linux)."""
    lines = Path(f"/proc/{number}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def computed(folder: Path, count: int, out: Path, executor, halfway: Callable[[], None] = lambda: None) -> dict:
    """Run the first ``count`` sessions; wall and CPU seconds of this process, and peak memory when a tenth was done and in the end."""
    seen: dict[int, tuple[float, ...]] = {}

    def told(tally: Tally) -> None:
        progress(f"{tally.folders} of {count}: {tally.done} done, {tally.failed} failed, {tally.reused} reused")
        if isinstance(executor, Processes) and tally.folders in (count // 10, count):
            numbers = [os.getpid(), *(worker.process.pid for worker in executor._workers)]
            seen[tally.folders] = tuple(memory_mb(number) for number in numbers)
        if tally.folders == count // 2:
            halfway()

    began, cpu = time.perf_counter(), time.process_time()
    with open_table(out) as table:
        try:
            tally = run_fleet(islice(session_folders([folder]), count), table, executor, FleetOptions(), progress=told)
        finally:
            executor.close()
    progress("")
    return {"tally": tally, "wall_s": time.perf_counter() - began, "cpu_s": time.process_time() - cpu, "memory": seen}


def rows(out: Path, sql: str) -> list[tuple]:
    connection = sqlite3.connect(out / NAME)
    try:
        return connection.execute(sql).fetchall()
    finally:
        connection.close()


def content(out: Path) -> list[tuple]:
    return rows(out, "SELECT * FROM results ORDER BY 1") + rows(out, "SELECT * FROM folders ORDER BY 1")


def scale(folder: Path, counts: list[int], jobs: int, kept: Path | None) -> None:
    lines = []
    for count in counts:
        with tempfile.TemporaryDirectory(prefix="tinygc-") as temporary:
            out = kept or Path(temporary)
            found = computed(folder, count, out, Processes(jobs))
            cpu = np.array([row[0] for row in rows(out, "SELECT cpu_s FROM folders JOIN durations USING (key) ORDER BY folder")])[:count]
            now = found["tally"].done + found["tally"].failed
            first, last = (found["memory"].get(at, ()) for at in (count // 10, count))
            lines.append(
                (
                    str(count),
                    f"{cpu.mean():.4f} ± {cpu.std() / np.sqrt(len(cpu)):.4f}",
                    f"{1e3 * found['cpu_s'] / max(now, 1):.2f}" if now else "",
                    f"{found['wall_s'] / now:.3f}" if now else "",
                    " / ".join(f"{each:.0f}" for each in first),
                    " / ".join(f"{each:.0f}" for each in last),
                    f"{(out / NAME).stat().st_size / count / 1024:.1f}",
                    str(rows(out, "SELECT count(*) FROM results WHERE status <> 'done'")[0][0]),
                )
            )
            cores = DAY * (cpu.mean() + (found["cpu_s"] / now if now else 0)) / DAY_S
            progress("")
            print(f"{count} sessions: {cores:.2f} cores are busy all day with {DAY} of them")
    header = ("sessions", "CPU s each", "parent, ms each", "wall s each", "MB at a tenth", "MB at the end", "KB each", "failed")
    print(markdown(header, lines))


def count_of(out: Path) -> int:
    try:
        return rows(out, "SELECT count(*) FROM results")[0][0] if (out / NAME).exists() else 0
    except sqlite3.Error:
        return 0


def killed(folder: Path, count: int, jobs: int) -> None:
    """The same table as of a run that nobody disturbed."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as temporary:
        places = Path(temporary) / "list"
        places.write_text("".join(f"{each}\n" for each in islice(session_folders([folder]), count)))
        calm, out = Path(temporary) / "calm", Path(temporary) / "out"
        command = [sys.executable, str(CALIBRATE), "fleet", "--from", str(places), "--jobs", str(jobs), "--quiet", "--out"]
        subprocess.run([*command, str(calm)], check=True)
        for end in (count // 3, 2 * count // 3):
            running = subprocess.Popen([*command, str(out)])
            while count_of(out) < end:
                time.sleep(0.05)
            if end < count // 2:
                running.send_signal(signal.SIGKILL)
                running.wait()
                print(f"kill -9 of the run at {count_of(out)} of {count} rows")
            else:
                children = Path(f"/proc/{running.pid}/task/{running.pid}/children").read_text().split()
                worker = next(each for each in children if "spawn_main" in Path(f"/proc/{each}/cmdline").read_text())
                os.kill(int(worker), signal.SIGKILL)
                print(f"kill -9 of a worker at {count_of(out)} rows; exit code {running.wait()}")
        print(f"the same table: {content(out) == content(calm)} ({len(content(out))} rows)")


def kill_one_of(cluster) -> None:
    with cluster.get_client() as client:
        number = next(iter(client.run(os.getpid).values()))
    os.kill(number, signal.SIGKILL)
    progress("")
    print(f"kill -9 of a Dask worker, process {number}")


def dask(folder: Path, count: int) -> None:
    from distributed import LocalCluster

    with tempfile.TemporaryDirectory(prefix="tinygc-") as temporary:
        one, other = Path(temporary) / "one", Path(temporary) / "other"
        here = computed(folder, count, one, Processes(2))
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            there = computed(folder, count, other, Cluster(cluster.scheduler_address), partial(kill_one_of, cluster))
        each = [rows(out, "SELECT avg(cpu_s) FROM durations")[0][0] for out in (one, other)]
        print(f"the same table: {content(one) == content(other)} ({count} sessions)")
        print(f"wall s each: processes {here['wall_s'] / count:.3f}, Dask {there['wall_s'] / count:.3f}")
        print(f"CPU s each in the worker: processes {each[0]:.4f}, Dask {each[1]:.4f}")
        print(f"CPU ms each in the parent: processes {1e3 * here['cpu_s'] / count:.1f}, Dask {1e3 * there['cpu_s'] / count:.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("make", "scale", "killed", "dask"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int)
    parser.add_argument("--counts", type=int, nargs="*", default=[100, 1000, 10_000])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, help="of scale: keep the table there")
    args = parser.parse_args()
    if args.what == "make":
        make(args.folder, args.count or 10_000)
    elif args.what == "scale":
        scale(args.folder, args.counts, args.jobs, args.out)
    elif args.what == "killed":
        killed(args.folder, args.count or 1000, args.jobs)
    else:
        dask(args.folder, args.count or 100)


if __name__ == "__main__":
    main()
