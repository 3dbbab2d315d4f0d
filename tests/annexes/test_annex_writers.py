"""What annexes write is whole, or is as it was, whichever call to the system fails; and it goes through no link."""

import numpy as np
import pytest
from annex import annex
from conftest import broad
from failing_calls import FAULTS, Writer, contents, tried
from table_recordings import table_toml
from turntables import Turned

import tinygc
from session.io.errors import StorageError
from tinygc.simulation.options import SimulationOptions

driver, verbs = annex("session.annexes.machines.driver"), annex("session.annexes.machines.verbs")
description, turns = annex("session.annexes.machines.description"), annex("session.annexes.turntable.folder")
arrays, array_options = annex("tinygc.annexes.arrays.simulation"), annex("tinygc.annexes.arrays.options")
lines = annex("tinygc.annexes.watch.lines")

TURNED = Turned(((0, 180, 90.0), (0, -180, 90.0)), noise=0.002)
SIX = "time_us,id,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + "".join(f"{10_000 * k},{k % 2},{k % 7},0.5,0,0,0,-1\n" for k in range(400))


def table(folder):
    (folder / "table.toml").write_text(table_toml("middle", "inner"))


def angles(*logs, renamed=""):
    def write(folder):
        file = driver.AngleFile(folder / "table.csv", description.read_description(folder / "table.toml"))
        for log in logs:
            file.add(log, 1000, verbs.Where(np.array([0.1, 0.2]), False))
        if renamed:
            file.rename(logs[-1], renamed)
        file.close()

    return write


def begun(folder):
    table(folder)
    angles("log0001.csv")(folder)


def array(folder):
    options = SimulationOptions(segments=3, closure_s=0.0, odr_hz=62.5)
    arrays.write_array(arrays.simulate_array(options, array_options.ArrayOptions(units=2)), folder / "s")


def watched(folder):
    written = lines.JsonLines(folder / "watch.jsonl", lambda said: None)
    for number in range(3):
        written.write({"schema": "tinygc-watch/1", "number": number})
    written.end()


WRITERS = {
    "table.csv": Writer(angles("log0001.csv", "log0002.csv"), table, grows=True),
    "table.csv that goes on": Writer(angles("log0002.csv"), begun, grows=True),
    "lines of watch": Writer(watched, grows=True),
    "import --array-by": Writer(
        lambda folder: tinygc.import_log(folder / "card.csv", folder / "s", array_by="id", gyro_fs_dps=500, accel_fs_g=4),
        lambda folder: (folder / "card.csv").write_text(SIX),
        folder=True,
    ),
    "a gyroscope alone": Writer(
        lambda folder: turns.write_turn_session(folder / "s", [turns.GyroLog("log0001", *TURNED.arrays())], TURNED.known("log0001.csv.gz")),
        folder=True,
    ),
    "simulate --units": Writer(array, folder=True),
}
QUICK = ("table.csv", "table.csv that goes on", "lines of watch")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")  # the killed close nothing
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", [name if name in QUICK else broad(name) for name in WRITERS])
def test_whichever_call_fails_the_old_is_whole_or_the_new(tmp_path, name, fault):
    every = name in QUICK  # the folders go the way of the core's, of which each call is tried
    count, wrong = tried(WRITERS[name], tmp_path / "w", fault, lambda number: every or number < 4 or number % 11 == 0)
    print(f"{name}, {fault}: {count} tried, {len(wrong)} failed")
    assert wrong == []
    assert count > 3


@pytest.mark.parametrize(
    ("name", "target"), [("table.csv", "table.csv"), ("table.csv that goes on", "table.csv"), ("lines of watch", "watch.jsonl")]
)
def test_nothing_is_written_through_a_link(tmp_path, name, target):
    (tmp_path / "w").mkdir()
    WRITERS[name].before(tmp_path / "w")
    path, victim = tmp_path / "w" / target, tmp_path / "victim"
    victim.write_bytes(path.read_bytes() if path.exists() else b"")
    path.unlink(missing_ok=True)
    path.symlink_to(victim)
    before = contents(tmp_path)
    with pytest.raises(StorageError, match=f"{target}: is a link to .*remove it"):
        WRITERS[name].write(tmp_path / "w")
    assert contents(tmp_path) == before
