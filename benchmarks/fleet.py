"""Whether a fleet's table is the same from a local Dask cluster of two workers, one of which is killed halfway, as from processes."""

from __future__ import annotations

import argparse
import os
import signal
import sqlite3
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from common import progress
from distributed import LocalCluster

from tinygc.features.fleet.fleet_row import FleetOptions
from tinygc.features.fleet.fleet_run import Cluster, FleetRun, Processes, run_fleet, session_folders
from tinygc.features.fleet.fleet_table import NAME, open_table
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="simulated sessions of eight turns at 104 Hz (%(default)s)")
    count = parser.parse_args().count
    with TemporaryDirectory(prefix="tinygc-") as place:
        sessions, one, other = (Path(place) / name for name in ("sessions", "one", "other"))
        for seed in range(count):
            write_session(SimulationOptions(segments=8, closure_s=0.0, odr_hz=104.0, seed=seed), sessions / str(seed))
        computed(sessions, one, Processes(2))
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:

            def kill_one_halfway(tally: FleetRun) -> None:
                if tally.folders == count // 2:
                    with cluster.get_client() as client:
                        os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

            computed(sessions, other, Cluster(cluster.scheduler_address), kill_one_halfway)
        print(f"the same table: {content(one) == content(other)} ({count} sessions)")


def computed(sessions: Path, out: Path, executor, seen: Callable[[FleetRun], None] = lambda tally: None) -> None:
    """Write the table of all sessions."""

    def told(tally: FleetRun) -> None:
        progress(f"{tally.folders}: {tally.done} done, {tally.failed} failed")
        seen(tally)

    out.mkdir()
    with open_table(out) as table:
        try:
            run_fleet(session_folders([sessions]), table, executor, FleetOptions(), progress=told)
        finally:
            executor.close()
    progress("")


def content(out: Path) -> list[tuple]:
    """All rows, without how long they took."""
    connection = sqlite3.connect(out / NAME)
    try:
        return [row for table in ("results", "folders") for row in connection.execute(f"SELECT * FROM {table} ORDER BY 1")]
    finally:
        connection.close()


if __name__ == "__main__":
    main()
