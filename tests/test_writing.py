"""A full disk is named by what was to be written, says what to do, and leaves nothing half made."""

import errno
import os
import shutil

import pytest
from dialect_logs import inertial, make

from session.base.errors import StorageError
from session.base.files import result_folder
from session.base.results import write_text_whole


@pytest.fixture
def full_disk(monkeypatch):
    """Calling it makes every further file that is written too much, as its bytes are to go to the disk."""

    def fill():
        def fsync(number):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", fsync)

    return fill


def test_a_file_is_named_and_nothing_is_left(full_disk, tmp_path):
    full_disk()
    path = tmp_path / "new" / "folder" / "r.html"
    with (
        pytest.raises(StorageError, match=r"r\.html: No space left on device; free space there, or choose another folder"),
        result_folder(path.parent),
    ):
        write_text_whole(path, "a report")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_there_or_holds_something_stays(full_disk, tmp_path):
    (tmp_path / "mine").mkdir()
    full_disk()
    with pytest.raises(StorageError), result_folder(tmp_path / "mine"):
        write_text_whole(tmp_path / "mine" / "r.html", "a report")

    def two_files():
        with result_folder(tmp_path / "new"):
            (tmp_path / "new" / "first").write_bytes(b"whole")
            write_text_whole(tmp_path / "new" / "second", "a report")

    with pytest.raises(StorageError):
        two_files()
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")) == ["mine", "new", "new/first"]


def test_an_export_and_an_import_to_a_full_disk(simulated, full_disk, tmp_path, run):
    folder = shutil.copytree(simulated(), tmp_path / "s")
    assert run("fit", folder, "--methods", "least_squares", "--quiet")[0] == 0
    full_disk()
    code, _, err = run("export", folder, "--to", "c", "--out", tmp_path / "new" / "x")
    (line,) = [line for line in err.splitlines() if "No space" in line]
    assert (code, str(tmp_path / "new" / "x") in line) == (2, True)
    with pytest.raises(StorageError, match=r"new/folder: No space.*choose another folder") as said:
        make(tmp_path, inertial(), out="new/folder")
    assert "LOG.CSV" not in str(said.value)
    assert {path.name for path in tmp_path.iterdir()} == {"s", "LOG.CSV"}
