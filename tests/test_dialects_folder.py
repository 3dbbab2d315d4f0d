"""The folder that a foreign log becomes: never written over, added to, nothing left of it by a full disk."""

import pytest
from conftest import write_session
from dialect_logs import (
    SAMPLES,
    inertial,
    make,
    rows,
)

from session.io.dialects import Answers
from session.io.errors import FormatError, StorageError
from session.replay.convert import convert
from tinygc import read_session


def test_an_existing_folder_is_not_written_over(tmp_path):
    made = make(tmp_path, inertial())
    before = made.log.read_bytes()
    with pytest.raises(FormatError, match="--add"):
        make(tmp_path, inertial())
    assert made.log.read_bytes() == before


def test_a_closure_run_is_added_to_its_session(tmp_path):
    made = make(tmp_path, inertial())
    more = convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add="closure")
    assert more.log.name == "closure0001.csv"
    session = read_session(made.folder)
    assert (len(session.logs), len(session.closures)) == (1, 1)
    assert convert([tmp_path / "LOG.CSV"], made.folder, Answers(), add="log").log.name == "log0002.csv"
    assert "\n# log0002.csv: from LOG.CSV (" in (made.folder / "session.toml").read_text()
    with pytest.raises(FormatError, match="--gyro-fs"):
        convert([tmp_path / "LOG.CSV"], made.folder, Answers(gyro_fs_dps=2000.0), add="log")


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    import session.replay.convert as module

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "_columns", full)
    with pytest.raises(StorageError, match=r"new/folder/session: No space.*choose another folder"):
        make(tmp_path, inertial(), out="new/folder/session")
    assert [path.name for path in tmp_path.iterdir()] == ["LOG.CSV"]


def test_a_full_disk_under_a_copied_log_is_not_the_logs_fault(tmp_path, monkeypatch):
    import session.replay.convert as module

    def full(source, target):
        raise OSError(28, "No space left on device", str(source), None, str(target))

    own = (write_session(tmp_path / "own", SAMPLES) / "log0001.csv").read_bytes()
    monkeypatch.setattr(module.shutil, "copyfile", full)
    with pytest.raises(StorageError, match="session: No space") as said:
        make(tmp_path, own)
    assert "LOG.CSV" not in str(said.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["LOG.CSV", "own"]


@pytest.mark.broad
def test_the_command_line_makes_a_session_that_fits(simulated, tmp_path, capsys):
    """A simulated session, written as a logger would, is replayed, and fits as the session itself."""
    import json

    import calibrate
    from session.io.logfile import read_log

    folder = simulated()
    sensor = read_session(folder).config.sensor
    samples = read_log(folder / "log0001.csv.gz", sensor).samples
    log = tmp_path / "sensor_combined_0.csv"
    names = ",".join([f"gyro_rad[{i}]" for i in range(3)] + [f"accelerometer_m_s2[{i}]" for i in range(3)])
    log.write_text(f"timestamp,{names}\n" + rows(samples.t_ns // 1000, *samples.gyro.T, *samples.accel.T))
    made, table = tmp_path / "made", tmp_path / "made.json"
    command = ["import", str(log), "--out", str(made)]
    assert calibrate.main([*command, "--gyro-fs", "500", "--accel-fs", "4", "--json", str(table)]) == 0
    assert "next:\n  python calibrate.py check" in capsys.readouterr().out
    assert json.loads(table.read_text())["dialects"] == ["PX4 sensor_combined"]
    head, site = (made / "session.toml").read_text().split("# Fill in"), (folder / "session.toml").read_text()
    (made / "session.toml").write_text(head[0] + site[site.index("[accelerometer]") :])
    found = {}
    for where in (folder, made):
        result = tmp_path / "fit.json"
        fit = ["fit", str(where), "--methods", "least_squares", "--folds", "2", "--out", str(tmp_path / "fit"), "--quiet"]
        assert calibrate.main([*fit, "--json", str(result)]) == 0
        found[where] = json.loads(result.read_text())["methods"]["least_squares"]["train"]["tilt_rms_deg"]
    assert found[made] == pytest.approx(found[folder], rel=1e-6)
