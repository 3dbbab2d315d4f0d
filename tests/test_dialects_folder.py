"""The folder that a foreign log becomes: never written over, added to, nothing left of it by a full disk."""

import shutil

import pytest
from conftest import write_session
from dialect_logs import (
    SAMPLES,
    inertial,
    make,
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
    def full(source, target):
        raise OSError(28, "No space left on device", source.name)

    own = (write_session(tmp_path / "own", SAMPLES) / "log0001.csv").read_bytes()
    monkeypatch.setattr(shutil, "copyfileobj", full)
    with pytest.raises(StorageError, match="session: No space") as said:
        make(tmp_path, own)
    assert "LOG.CSV" not in str(said.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["LOG.CSV", "own"]
