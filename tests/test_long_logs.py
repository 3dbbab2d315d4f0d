"""A day of readings in bounded memory: what is kept of a row, what a command holds beside it, and that nothing comes out otherwise."""

import tracemalloc

import numpy as np
import pytest
from conftest import Table, write_session

from session.log import samples as readings
from session.log.samples import Samples
from tinygc import Session, read_session
from tinygc.explanation.faulty_readings import find_glitches, without_glitches

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


def test_what_replaces_false_readings_keeps_a_log_as_its_registers(folder):
    session = read_session(folder)
    samples = session.logs[0].samples
    gyro = np.array(samples.gyro)
    gyro[[5000, 5001, 30_000]] += 3.0
    floats = Samples(samples.t_ns, gyro, np.array(samples.accel))
    glitches = find_glitches(floats)
    assert glitches is not None
    packed = Samples(
        samples.t_ns, readings.replaced(samples.gyro, np.array([5000, 5001, 30_000]), gyro[[5000, 5001, 30_000]]), samples.accel
    )
    mended = without_glitches(packed, glitches)
    assert isinstance(mended.gyro, readings.PackedReadings)
    np.testing.assert_array_equal(np.asarray(mended.gyro), without_glitches(floats, glitches).gyro)


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
