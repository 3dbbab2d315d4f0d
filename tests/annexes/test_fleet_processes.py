"""Who computes does not matter: one process or two, a Dask cluster, or several runs of which each was ended in its own way."""

import os
import signal
from threading import Timer

import processes
import pytest
from conftest import broad
from fleets import FIT, Here, content, made, ran
from processes import CALIBRATE, PIPE, started, until

from tinygc import CalibrationError
from tinygc.annexes.lots.fleet_row import FleetOptions
from tinygc.annexes.lots.fleet_run import Processes
from tinygc.annexes.lots.fleet_session import Job
from tinygc.annexes.lots.fleet_table import NAME, read_table

posix = pytest.mark.skipif(not processes.HAS_GROUPS, reason="signals and groups as POSIX has them")
WHOLE = FleetOptions()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    return made(tmp_path_factory.mktemp("fleet"), 4)


@pytest.fixture(scope="module")
def reference(fleet, tmp_path_factory):
    """What the table must hold, whoever makes it."""
    out = tmp_path_factory.mktemp("reference")
    ran(fleet, out, WHOLE)
    return content(out)


@pytest.fixture(scope="module")
def quick(fleet, tmp_path_factory):
    """The same without explain."""
    out = tmp_path_factory.mktemp("quick")
    ran(fleet, out, FIT)
    return content(out)


@pytest.fixture
def started_processes():
    """``started_processes(Kind, count)``: ended when the test is."""
    pools = []

    def start(kind, count):
        pools.append(kind(count))
        return pools[-1]

    yield start
    for pool in pools:
        pool.close()


@pytest.mark.broad
def test_two_processes_make_the_same_table_in_any_order(fleet, reference, tmp_path, started_processes):
    class Backwards(Processes):
        """Those that came first are handed out last."""

        capacity = 9

        def finished(self):
            self._queue.reverse()
            return super().finished()

    tally, _ = ran(fleet, tmp_path, WHOLE, started_processes(Backwards, 2))
    assert tally.done == 4
    assert content(tmp_path) == reference


@pytest.mark.slow
@posix
def test_a_process_that_is_killed_loses_nothing_and_one_that_always_is_fails_alone(fleet, quick, tmp_path, started_processes):
    """unit1's process is killed whenever it begins with it, and unit3's the first time."""
    killed = []

    class Deadly(Processes):
        def _hand_out(self):
            before = [worker.job for worker in self._workers]
            super()._hand_out()
            for job, worker in zip(before, self._workers, strict=True):
                name = os.path.basename(worker.job.folder) if worker.job is not None and worker.job is not job else ""
                if name == "unit1" or (name == "unit3" and name not in killed):
                    killed.append(name)
                    os.kill(worker.process.pid, signal.SIGKILL)

    tally, _ = ran(fleet, tmp_path, FIT, started_processes(Deadly, 1))
    assert sorted(killed) == ["unit1", "unit1", "unit3"]
    assert (tally.done, tally.failed) == (3, 1)
    with read_table(tmp_path) as table:
        ((key, error),) = table.rows("SELECT key, error FROM results WHERE status = 'died'")
    assert error.startswith("the process that computed it ended, 2 times (killed by SIGKILL)")
    others = [row for row in quick["results"] if row[0] != key]
    assert [row for row in content(tmp_path)["results"] if row[0] != key] == others
    assert ran(fleet, tmp_path, FIT, retry=True)[1] == ["unit1"]
    assert content(tmp_path) == quick


@posix
def test_processes_that_cannot_begin_are_said(fleet, started_processes):
    pool = started_processes(Processes, 1)
    pool.submit(Job(str(fleet / "unit0"), "", WHOLE))
    os.kill(pool._workers[0].process.pid, signal.SIGKILL)
    with pytest.raises(CalibrationError, match="a process ended before it could begin"):
        pool.finished()


def rows_of(out) -> int:
    """So far."""
    if not (out / NAME).exists():
        return 0
    try:
        with read_table(out) as table:
            return table.one("SELECT count(*) FROM results")
    except CalibrationError:  # it is being made
        return 0


@pytest.mark.slow
@posix
def test_a_run_that_is_interrupted_and_one_that_is_killed_go_on(fleet, quick, tmp_path):
    """Both wait for more folders when that happens; one is written each time, and two are under way."""
    out = tmp_path / "out"
    command = [*CALIBRATE, "fleet", "--from", "-", "--out", out, "--jobs", 1, "--only", "check,fit"]
    pipes = {"stdin": PIPE, "stderr": PIPE, "stdout": PIPE, "text": True}
    with started(command, **pipes) as running:
        fed(running, [fleet / f"unit{number}" for number in range(3)])
        until(lambda: rows_of(out) == 1, what="the first row")
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does: to all of the group
        _, said = running.communicate()
    assert running.returncode == 130
    assert said.strip().splitlines()[-1] == "calibrate: interrupted"
    assert "Traceback" not in said
    assert rows_of(out) == 1
    with started(command, **pipes) as running:
        fed(running, [fleet / f"unit{number}" for number in range(4)])
        until(lambda: rows_of(out) == 2, what="the next row")
        running.kill()
        running.communicate()  # returns when the process that it has left behind has gone, too
    assert rows_of(out) == 2
    assert len(ran(fleet, out, FIT)[1]) == 2
    assert content(out) == quick


def fed(running, folders) -> None:
    """A list that does not end yet."""
    running.stdin.write("".join(f"{folder}\n" for folder in folders))
    running.stdin.flush()


@pytest.mark.broad
def test_effects_that_a_process_does_not_find_end_the_run_and_fail_no_session(fleet, tmp_path, started_processes):
    (tmp_path / "effects").mkdir()
    options = FleetOptions(effects=(str(tmp_path / "effects"),))
    (tmp_path / "effects").rmdir()
    with pytest.raises(CalibrationError, match="effects"):
        ran(fleet, tmp_path / "out", options, started_processes(Processes, 1))
    assert rows_of(tmp_path / "out") == 0


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "tls://127.0.0.1:9", "nonsense", broad("http://here:80")])
def test_a_scheduler_that_is_not_there_is_said(address, fleet, tmp_path, run, monkeypatch):
    """Without a client, whose end would be waited for."""
    distributed = pytest.importorskip("distributed", reason="the extra fleet is not installed")
    monkeypatch.setattr("tinygc.annexes.lots.fleet_run.PATIENCE_S", 0.1)
    monkeypatch.setattr(distributed, "Client", None)
    code, _, err = run("fleet", fleet, "--out", tmp_path, "--scheduler", address)
    assert code == 2
    assert "no Dask scheduler answers" in err.splitlines()[-1]


@pytest.mark.broad
def test_a_scheduler_that_has_gone_ends_the_run_in_one_line(fleet, tmp_path, run, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the extra fleet is not installed")
    monkeypatch.setattr("tinygc.annexes.lots.fleet_run.GONE_S", 0.1)
    cluster = distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None)  # a job waits for a worker for ever
    try:
        stop = Timer(2.0, cluster.close)
        stop.start()
        code, _, err = run("fleet", fleet, "--out", tmp_path, "--scheduler", cluster.scheduler_address, "--quiet")
        stop.join()
    finally:
        cluster.close()
    assert code == 2
    assert err.count("\n") == 1, err
    assert "the scheduler has gone; start it and run again" in err


def test_a_worker_of_another_version_is_said(fleet, tmp_path, monkeypatch):
    monkeypatch.setattr("tinygc.annexes.lots.fleet_session.VERSION", "0.0.0")
    with pytest.raises(CalibrationError, match=r"a worker runs TinyGC 0\.0\.0, this is .*; install the same version everywhere"):
        ran(fleet, tmp_path, executor=Here())
