"""A full disk is named by what was to be written, says what to do, and leaves nothing half made."""

import errno
import os
import shutil
from pathlib import Path

import pytest

import calibrate
from session.io.errors import StorageError
from session.io.files import naming, result_folder
from session.io.results import write_text_whole


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


def test_other_errors_keep_what_they_say():
    with pytest.raises(PermissionError) as said, naming(Path("result")):
        raise PermissionError(errno.EACCES, "Permission denied", "elsewhere")
    assert said.value.filename == "elsewhere"


@pytest.mark.parametrize("form", ["json", "c"])
def test_export_to_a_full_disk(form, simulated, full_disk, tmp_path, capsys):
    folder = shutil.copytree(simulated(), tmp_path / "s")
    assert calibrate.main(["fit", str(folder), "--methods", "least_squares", "--folds", "2", "--quiet"]) == 0
    full_disk()
    capsys.readouterr()
    assert calibrate.main(["export", str(folder), "--to", form, "--out", str(tmp_path / "new" / "x")]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "No space" in line]
    assert str(tmp_path / "new" / "x") in line
    assert not (tmp_path / "new").exists()


def test_report_to_a_full_disk(full_disk, monkeypatch, tmp_path):
    from tinygc.reporting.html import page

    monkeypatch.setattr(page, "page", lambda evidence: "<html></html>")
    full_disk()
    with pytest.raises(StorageError, match=r"new/r\.html: No space"):
        page.save(None, tmp_path / "new" / "r.html")
    assert list(tmp_path.iterdir()) == []
