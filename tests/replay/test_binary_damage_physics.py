"""Binary logs that are damaged, or that state more than they hold: what is whole is read, and one line says the rest, within the budget."""

import io
import os
import sqlite3
import struct
import sys
import zlib

import numpy as np
import pytest
from processes import ROOT, refused
from processes import run as run_process
from test_binary_logs_physics import ACCEL, ARRAYS, COUNT, FORMATS, GYRO, T_NS, file_of

from session.base.budget import GB, MB, budget
from session.base.errors import FormatError
from session.replay.binary.registry import reader_of
from session.replay.sources import sources_of

EVERY = FORMATS | ARRAYS


every_format = pytest.mark.parametrize("name", EVERY)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of each format, and the suffix that its file has."""
    made = {}
    for name, (write, *_) in EVERY.items():
        path = file_of(write, tmp_path_factory.mktemp("logs"))
        if path.is_dir():
            path = next(inner for inner in path.iterdir() if inner.suffix in (".db3", ".mcap"))
        made[name] = path.read_bytes(), path.suffix
    return made


def damaged(data, how):
    middle = len(data) // 2
    return {
        "half": data[:middle],
        "tail": data[:-1],
        "flipped": data[:middle] + bytes([data[middle] ^ 0x55]) + data[middle + 1 :],
        "zeros": data[: middle - 50] + bytes(100) + data[middle + 50 :],
        "empty": b"",
        "head": data[:64],
    }[how]


def answers(name, path):
    """The streams, or the one line that refuses the file.  Each stream is whole in itself."""
    reader = EVERY[name][1]
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
    assert [(topic.name, topic.rows, topic.holds) for topic in topics] == [
        (stream.name, len(stream), tuple(stream.parts)) for stream in streams
    ]
    for stream in streams:
        assert {"gyro", "accel"} & set(stream.parts)
        for kind, part in stream.parts.items():
            assert (part.values.shape, part.values.dtype) == ((len(stream), 3)[: 1 if kind == "temp" else 2], np.dtype(float))
        assert stream.t_ns is None or (stream.t_ns.shape, stream.t_ns.dtype) == ((len(stream),), np.dtype(np.int64))
        assert all("\n" not in note for note in stream.notes)
    return streams


@pytest.mark.parametrize("how", ["half", "flipped", "zeros", "head"])
@every_format
def test_no_damage_is_a_traceback(name, how, files, tmp_path, capsys):
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(damaged(data, how))
    assert isinstance(answers(name, path), str) or how not in ("empty", "head")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", FORMATS)
def test_what_stands_before_a_cut_is_read(name, files, tmp_path):
    """Row by row as it was written; and the note says where the file ends."""
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    # The tables' roots fill more than half of a small database.
    path.write_bytes(data[: 3 * len(data) // 4] if name == "ROS 2, zstd" else damaged(data, "half"))
    stream = next(stream for stream in answers(name, path) if stream.name == FORMATS[name][2])
    assert 20 <= len(stream) < COUNT
    np.testing.assert_array_equal(stream.t_ns, T_NS[: len(stream)])
    np.testing.assert_array_equal(stream.parts["gyro"].values, GYRO[: len(stream)])
    np.testing.assert_array_equal(stream.parts["accel"].values, ACCEL[: len(stream)])
    assert any("cut" in note for note in stream.notes), stream.notes
    assert any(char.isdigit() for note in stream.notes if "cut" in note for char in note)


@pytest.mark.parametrize("name", ["ROS 1, bz2", "MCAP"])
def test_a_damaged_chunk_is_left_out_and_the_others_are_read(name, files, tmp_path):
    """Checksums tell, so no wrong number is read.  The first chunk has defined the topic; where it is lost, the file's end repeats it."""
    data, suffix = files[name]
    path = tmp_path / f"a{suffix}"
    lost, first_lost = 0, 0
    for place in range(300, len(data), len(data) // 13):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        found = answers(name, path)
        if isinstance(found, str):
            continue  # the length of a record was hit
        (stream,) = found
        rows = np.searchsorted(T_NS, stream.t_ns)
        np.testing.assert_array_equal(stream.t_ns, T_NS[rows])
        np.testing.assert_array_equal(stream.parts["gyro"].values, GYRO[rows])
        np.testing.assert_array_equal(stream.parts["accel"].values, ACCEL[rows])
        assert stream.notes or len(stream) == COUNT
        lost += len(stream) < COUNT
        first_lost += len(stream) < COUNT and stream.t_ns[0] > T_NS[0]
    assert lost > 3
    assert first_lost > 0


def test_a_bag_whose_metadata_is_line_ends_is_refused_at_once(run, tmp_path):
    (tmp_path / "metadata.yaml").write_text("relative_file_paths:" + "\n" * 250_000 + "x")
    code, _, err = run("import", tmp_path, "--out", tmp_path / "s")
    assert (code, "holds no .db3" in err) == (2, True), err


# What states more than it holds.


COLUMNS = ("time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps", "acc_x_g", "acc_y_g", "acc_z_g")


def hdf5(path, **more):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, how in more.items():
            file.create_dataset(name, **how)


def hdf5_never_stored(path):
    triad = {"shape": (39_000_000, 3), "dtype": "f8", "chunks": (100_000, 3)}
    hdf5(path, gyro_dps=triad, acc_g=triad, time_s={"shape": (39_000_000,), "dtype": "f8", "chunks": (100_000,)})


def element(kind, body, length=None):
    return struct.pack("<II", kind, len(body) if length is None else length) + body + bytes(-len(body) % 8)


def matlab(path, rows, stored=0, kind=6):
    inner = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", rows, 3)) + element(1, b"gyro")
    inner += struct.pack("<II", 9, rows * 24)
    packed = zlib.compress(struct.pack("<II", 14, len(inner) + rows * 24) + inner + bytes(stored))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(packed)) + packed)


def parquet(path):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow.table([np.zeros(60_000)] * 7, names=COLUMNS), path)


def npy_with_a_hole(path):
    head = repr({"descr": [("gyro_dps", "<f8", (3,)), ("acc_g", "<f8", (3,))], "fortran_order": False, "shape": (16_000_000,)}).encode()
    path.write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(head) + 1) + head + b"\n")
    os.truncate(path, path.stat().st_size + 16_000_000 * 48)


def bag(path, messages, plain=True, rows=()):
    with sqlite3.connect(path) as made:
        made.execute("create table topics(id integer, name text, type text, serialization_format text)")
        made.execute("insert into topics values(1, '/imu', 'sensor_msgs/msg/Imu', 'cdr')")
        made.execute(messages)
        for row in rows:
            made.execute("insert into messages(topic_id, timestamp) values(1, ?)", row)
        if not plain:
            made.execute("pragma writable_schema = on")
            made.execute("update sqlite_master set type = 'table' where name = 'messages'")
    made.close()


ENDLESS = (
    "create view messages as with recursive r(x) as (select 7 union all select x + 1 from r) "
    "select x as id, x as rowid, 2 as topic_id, x as timestamp, x'00' as data from r"
)


GENERATED = (
    "create table messages(id integer primary key, topic_id int, timestamp int, data blob generated always as (zeroblob(700000000)))"
)


def bag_endless(path):
    bag(path, ENDLESS, plain=False)


def bag_generated(path):
    bag(path, GENERATED, rows=[(number,) for number in range(60)])


def record(kind, body):
    return struct.pack("<BQ", kind, len(body)) + body


def mcap_chunks(path):
    zstandard = pytest.importorskip("zstandard")
    inner = record(5, struct.pack("<HIQQ", 1, 0, 0, 0)) * 20_000
    packed = zstandard.ZstdCompressor().compress(inner)
    chunk = struct.pack("<QQQI", 0, 1, len(inner), 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    path.write_bytes(b"\x89MCAP0\r\n" + record(1, bytes(8)) + record(6, chunk) * 16)


def text(words):
    return struct.pack("<I", len(words)) + words


def mcap(path, *records):
    path.write_bytes(b"\x89MCAP0\r\n" + record(1, bytes(8)) + b"".join(records))


def mcap_defined(path, definition, count=1):
    """As many topics of the same type."""
    for_each = (
        record(3, struct.pack("<H", number) + text(b"a/msg/B") + text(b"ros2msg") + text(definition))
        + record(4, struct.pack("<HH", number, number) + text(b"/imu%d" % number) + text(b"cdr") + bytes(4))
        + record(5, struct.pack("<HIQQ", number, 0, 0, 0))
        for number in range(1, count + 1)
    )
    mcap(path, *for_each)


TAKES, UNPACKS = r"reading it takes more than [\d.]+ [MG]B of memory, and .*import --most-memory [\d.]+[MG]B$", r"unpacks to more than"


#: name of the file -> what writes it, what is said, budget in MB
BOMBS = {
    "never_stored.h5": (hdf5_never_stored, TAKES, None),
    "zlib.mat": (lambda path: matlab(path, 60_000_000), TAKES, None),
    "many.mat": (lambda path: matlab(path, 400_000, 9_600_000), TAKES, 10),
    "one_value.parquet": (parquet, TAKES, 3),
    "hole.npy": (npy_with_a_hole, TAKES, None),
    "endless.db3": (bag_endless, "messages is no plain table", None),
    "generated.db3": (bag_generated, "messages is no plain table", None),
    "chunks.mcap": (mcap_chunks, UNPACKS, 10),
    "long_definition.mcap": (lambda path: mcap_defined(path, b"int8 a\n" * 20_000), "its definition has more than 131072 letters", None),
    "parts.mcap": (lambda path: mcap_defined(path, b"int8[] a\n" * 40 + b"float64[3] gyro"), "more than 32 texts and sequences", None),
}


def _answers():
    from session.replay.options import Answers

    return Answers(odr_hz=100, gyro_fs_dps=500, accel_fs_g=4)


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_in_one_line(name, tmp_path):
    write, said, most_mb = BOMBS[name]
    write(tmp_path / name)
    with (
        budget([tmp_path / name], None if most_mb is None else most_mb * MB),
        pytest.raises(FormatError, match=said) as raised,
        sources_of([tmp_path / name], _answers()),
    ):
        pass
    assert "\n" not in str(raised.value)


@pytest.mark.broad
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux tells a process's peak")
@pytest.mark.parametrize("name", ["never_stored.h5", "generated.db3"])
def test_a_bomb_takes_no_memory(name, tmp_path):
    """Of all that the process takes: a third of the budget is what its libraries have."""
    BOMBS[name][0](tmp_path / name)
    code = (
        "import re, sys, calibrate\n"
        "code = calibrate.main(['import', sys.argv[1], '--out', sys.argv[1] + '.d', '--odr', '100'])\n"
        "print(re.search(r'VmHWM:\\s+(\\d+) kB', open('/proc/self/status').read())[1])\nsys.exit(code)"  # ru_maxrss is the parent's, too
    )
    done = run_process([sys.executable, "-c", code, tmp_path / name], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2
    assert int(done.stdout.split()[-1]) * 1024 < GB / 3


def test_import_takes_more_memory_where_it_may(tmp_path, run):
    """Of text, too: what is joined is in memory."""
    path = tmp_path / "a.csv"
    rows = io.StringIO()
    np.savetxt(
        rows, np.column_stack([np.arange(3000) * 10_000, np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 1.0], (3000, 1))]), fmt="%g", delimiter=","
    )
    path.write_text("t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n" + rows.getvalue())
    words = ("import", path, "--gyro-fs", "500", "--accel-fs", "4")
    refused(run(*words, "--out", tmp_path / "s", "--most-memory", "0.1MB"), "of memory, and 0.1 MB may be taken", "--most-memory 0.4MB")
    code, _, _ = run(*words, "--out", tmp_path / "s", "--most-memory", "1MB")
    assert code == 2  # its sensor stands still
    assert (tmp_path / "s" / "session.toml").exists()
    code, _, err = run(*words, "--most-memory", "much")
    assert (code, "'much' is no amount of memory such as 3GB or 700MB" in err) == (2, True)
