"""Whoever writes, and by whatever way: no file of a recording is replaced, and a simulation replaces only a simulation."""

import gzip
import os
import shutil

import pytest
from commandline import refused
from recorded_files import RECORDED, make_recording

from session.io.errors import StorageError
from session.io.names import is_recorded
from session.io.results import write_text_whole

recording = pytest.fixture(make_recording, name="recording")


@pytest.mark.parametrize("name", RECORDED)
def test_nothing_is_written_whole_over_a_recording(recording, tmp_path, name):
    """Whoever writes: the last door."""
    assert is_recorded(recording / name)
    with pytest.raises(StorageError, match="is a file of the recording"):
        write_text_whole(recording / name, "mine")
    link = recording / "fit.json"
    link.symlink_to(recording / name)
    with pytest.raises(StorageError, match="is a link to"):
        write_text_whole(link, "mine")
    assert (recording / name).read_bytes().startswith(b"recorded")
    assert not is_recorded(tmp_path / name)


def test_a_simulation_replaces_only_a_simulation(run, simulated, tmp_path):
    made = tmp_path / "made"
    shutil.copytree(simulated(), made)
    real = tmp_path / "real.csv.gz"
    real.write_bytes(gzip.compress(b"recorded"))
    (made / "log0001.csv.gz").unlink()
    again = ("simulate", "--out", made, "--force", "--segments", 4, "--odr-hz", 104)
    for link in (lambda: (made / "log0001.csv.gz").symlink_to(real), lambda: os.link(real, made / "log0001.csv.gz")):
        link()
        refused(run(*again), "log0001.csv.gz", "not replaced")
        assert gzip.decompress(real.read_bytes()) == b"recorded"
        (made / "log0001.csv.gz").unlink()
    (made / "raw.bin").write_bytes(b"recorded")
    refused(run(*again), "raw.bin", "not replaced")
    (made / "raw.bin").unlink()
    (made / "session.toml").write_text((made / "session.toml").read_text().partition("\n")[2])
    refused(run(*again), "session.toml", "not replaced")
