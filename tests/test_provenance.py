"""Hashes are those of any other program; every file that counts is among them."""

import hashlib

from session.log.folder import input_hashes, sha256_of
from tinygc import read_session
from tinygc.models.versions import versions


def test_every_file_of_a_session_is_hashed(simulated):
    session = read_session(simulated())
    hashes = input_hashes(session)
    assert set(hashes) == {"session.toml", "log0001.csv.gz", "closure0001.csv.gz"}
    for name, found in hashes.items():
        assert found == hashlib.sha256((session.folder / name).read_bytes()).hexdigest()


def test_a_large_file_is_hashed_whole(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b"abc" * 1_000_000)
    assert sha256_of(path) == hashlib.sha256(b"abc" * 1_000_000).hexdigest()


def test_versions_name_what_computes():
    assert {"TinyGC", "Python", "numpy", "scipy"} <= set(versions())
