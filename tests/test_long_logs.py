"""A day of readings in bounded memory: what is kept of a row, what a command holds beside it, and that nothing comes out otherwise."""

import tracemalloc

import pytest
from conftest import Table, write_session

from tinygc import Session, read_session

ROWS = 60_000


#: bytes: 8 of the stamp, 2 of each register, and the record around them
KEPT = 24.0


#: a day at 208 Hz is 18 million rows, of which 2 GB are 110 bytes each
READING = 75.0


def peak_of(work):
    """Bytes a row at the most, and that are kept, of what the work gives."""
    tracemalloc.start()
    try:
        result = work()
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak / ROWS, kept / ROWS, result


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_session(tmp_path_factory.mktemp("long") / "session", Table().rest(ROWS / 208).samples())


def test_a_log_is_read_kept_and_looked_at_in_as_many_bytes_as_it_has_registers(folder):
    """24 bytes a row would be one copy of one triad as floats."""
    read_session(folder)  # what is imported once is no part of it
    peak, kept, session = peak_of(lambda: read_session(folder))
    assert isinstance(session, Session)
    assert len(session.logs[0].samples) == ROWS
    assert kept < KEPT
    assert peak < READING + 2**23 / ROWS  # a piece of a file is a megabyte
