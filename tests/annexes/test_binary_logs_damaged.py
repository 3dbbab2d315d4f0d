"""Damaged binary logs: what is whole is read, and it is said where a file stops; whatever the bytes, there is one line and no traceback."""

import numpy as np
import pytest
import test_binary_arrays
import test_binary_logs
import written_logs as written
from test_binary_logs import ACCEL, COUNT, GYRO, RECORDING, T_NS

from session.annexes.logs import betaflight
from session.annexes.logs.registry import reader_of
from session.io.errors import FormatError
from session.io.streams import Stream

#: writer, file in it, reader, the stream that is compared
BLACKBOX = {"blackbox": (written.write_blackbox, "a.bbl", betaflight, "log1", False)}
STREAMED = test_binary_logs.FORMATS | BLACKBOX
EVERY = {name: entry[:3] for name, entry in STREAMED.items()} | test_binary_arrays.FORMATS
#: of a file that is cut in its middle nothing can be read where the index, or a checksum of the whole, stands at the end
AT_THE_END = ("HDF5", "HDF5, packed", "MATLAB 7.3", "MATLAB 5", "MATLAB 5, unpacked", "npz", "npy", "Parquet", "Feather")
every_format = pytest.mark.parametrize("name", EVERY)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of each format, and the suffix that its file has."""
    pytest.importorskip("orangebox")
    made = {}
    for name, (write, file, *_) in EVERY.items():
        path = tmp_path_factory.mktemp("logs") / file
        write(path, *RECORDING)
        if path.is_dir():
            path = next(inner for inner in path.iterdir() if inner.suffix in (".db3", ".mcap"))
        made[name] = path.read_bytes(), path.suffix
    return made


def damaged(data: bytes, how: str) -> bytes:
    middle = len(data) // 2
    return {
        "half": data[:middle],
        "tail": data[:-1],
        "flipped": data[:middle] + bytes([data[middle] ^ 0x55]) + data[middle + 1 :],
        "zeros": data[: middle - 50] + bytes(100) + data[middle + 50 :],
        "empty": b"",
        "head": data[:64],
    }[how]


def answers(name, path) -> list[Stream] | str:
    """The streams, or the one line that refuses the file.  Each stream is whole in itself."""
    reader = EVERY[name][2]
    if path.stat().st_size >= 100:  # less has no magic number
        known = reader_of(path, path.read_bytes()[:4096])
        assert known in (reader, None) or name == "ROS 2, MCAP"
        reader = known or reader
    try:
        topics, streams = reader.topics(path, None), reader.read(path, [], None)
    except FormatError as error:
        said = str(error)
        assert ("\n" not in said, len(said) < 800, str(path) in said) == (True, True, True)
        return said
    assert [(topic.name, topic.rows, topic.holds) for topic in topics] == [(stream.name, len(stream), stream.holds) for stream in streams]
    for stream in streams:
        assert stream.holds
        for part in (stream.gyro, stream.accel):
            assert part is None or (part.shape, part.dtype) == ((len(stream), 3), np.dtype(float))
        assert stream.temp is None or stream.temp.shape == (len(stream),)
        assert stream.t_ns is None or (stream.t_ns.shape, stream.t_ns.dtype) == ((len(stream),), np.dtype(np.int64))
        assert all("\n" not in note for note in stream.notes)
    return streams


@pytest.mark.parametrize("how", ["half", "tail", "flipped", "zeros", "empty", "head"])
@every_format
def test_no_damage_is_a_traceback(name, how, files, tmp_path, capsys):
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(damaged(data, how))
    assert isinstance(answers(name, path), str) or how not in ("empty", "head")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", STREAMED)
def test_what_stands_before_a_cut_is_read(name, files, tmp_path):
    """Row by row as it was written; and the note says where the file ends."""
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    # The tables' roots fill more than half of a small database.
    path.write_bytes(data[: 3 * len(data) // 4] if name == "ROS 2, zstd" else damaged(data, "half"))
    stream = next(stream for stream in answers(name, path) if stream.name == STREAMED[name][3])
    gyro, accel = test_binary_logs.COUNTS if name == "blackbox" else (GYRO, ACCEL)
    assert 20 <= len(stream) < COUNT
    np.testing.assert_array_equal(stream.t_ns, T_NS[: len(stream)])
    np.testing.assert_array_equal(stream.gyro, gyro[: len(stream)])
    np.testing.assert_array_equal(stream.accel, accel[: len(stream)])
    assert any("cut" in note or "no end mark" in note for note in stream.notes), stream.notes
    assert any(char.isdigit() for note in stream.notes if "cut" in note or "no end mark" in note for char in note)


@pytest.mark.parametrize("name", AT_THE_END)
def test_a_cut_file_whose_index_is_at_its_end_is_refused(name, files, tmp_path):
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(damaged(data, "half"))
    assert "copy it again" in answers(name, path) or "cut in the variable" in answers(name, path)


@pytest.mark.parametrize("name", ["ROS 1, bz2", "MCAP", "MCAP, unpacked", "MCAP, ROS 1", "MCAP, JSON"])
def test_a_damaged_chunk_is_left_out_and_the_others_are_read(name, files, tmp_path):
    """Checksums tell, so no wrong number is read.  The first chunk has defined the topic; where it is lost, the file's end repeats it."""
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    lost, first_lost = 0, 0
    for place in range(300, len(data), len(data) // 23):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        found = answers(name, path)
        if isinstance(found, str):
            continue  # the length of a record was hit
        (stream,) = found
        rows = np.searchsorted(T_NS, stream.t_ns)
        np.testing.assert_array_equal(stream.t_ns, T_NS[rows])
        np.testing.assert_array_equal(stream.gyro, GYRO[rows])
        np.testing.assert_array_equal(stream.accel, ACCEL[rows])
        assert stream.notes or len(stream) == COUNT
        lost += len(stream) < COUNT
        first_lost += len(stream) < COUNT and stream.t_ns[0] > T_NS[0]
    assert lost > 3
    assert first_lost > 0


@pytest.mark.parametrize("name", ["ULog", "dataflash"])
def test_zeros_in_the_middle_cost_the_messages_that_they_hit(name, files, tmp_path):
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(damaged(data, "zeros"))
    stream = next(stream for stream in answers(name, path) if stream.name == STREAMED[name][3])
    assert COUNT - 60 <= len(stream) < COUNT + 1
    np.testing.assert_array_equal(stream.t_ns[-20:], T_NS[-20:])
    assert any("damaged" in note for note in stream.notes)


def test_a_bag_whose_metadata_is_line_ends_is_refused_at_once(run, tmp_path):
    (tmp_path / "metadata.yaml").write_text("relative_file_paths:" + "\n" * 250_000 + "x")
    code, _, err = run("import", tmp_path, "--out", tmp_path / "s")
    assert (code, "holds no .db3" in err) == (2, True), err
