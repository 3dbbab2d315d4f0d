"""Files that state more than they hold, or unpack to a thousand times their length, are refused before anything of it is allocated.

What counts is tested in this process, with a small budget where a whole one would take long to write; that nothing else takes memory, in a
process that the system ends beyond a bound.
"""

import io
import os
import re
import sqlite3
import struct
import sys
import zlib

import numpy as np
import pytest
from commandline import refused
from processes import ROOT
from processes import run as run_process

from session.annexes.logs.registry import reader_of
from session.annexes.logs.ros import json_decoder
from session.annexes.logs.source import Source
from session.io.budget import GB, MB, PACKED, RECORD, Budget, budget
from session.io.errors import FormatError
from session.replay.sources import Sources, head_of

COLUMNS = ("time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps", "acc_x_g", "acc_y_g", "acc_z_g")


def hdf5(path, **more):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, how in more.items():
            file.create_dataset(name, **how)


def hdf5_never_stored(path):
    triad = {"shape": (39_000_000, 3), "dtype": "f8", "chunks": (100_000, 3)}
    hdf5(path, gyro_dps=triad, acc_g=triad, time_s={"shape": (39_000_000,), "dtype": "f8", "chunks": (100_000,)})


def hdf5_scalars_of_arrays(path):
    one = {"shape": (1,), "dtype": np.dtype(("f8", (8000, 8000))), "chunks": (1,)}
    hdf5(path, s0=one, s1=one, fs=one)


def hdf5_deep(path):
    hdf5(path, **{"g/" * 3000 + "gyro_dps": {"data": np.ones((9, 3))}})


def hdf5_chunk(path):
    triad = {"shape": (1000, 3), "dtype": "f8", "chunks": (160_000_000, 3), "maxshape": (None, 3)}
    hdf5(path, gyro_dps=triad, acc_g=triad)


def hdf5_heaps_in_heaps(path):
    hdf5(path, gyro_dps={"data": np.ones((9, 3))})
    heads, objects = 300, 20_000  # each of the heaps goes on over the others into the same objects
    heap = [b"GCOL\1\0\0\0" + struct.pack("<QH6xQ", 1 << 40, 1, 32 * (heads - 1 - number)) for number in range(heads)]
    with path.open("ab") as file:
        file.write(b"".join(heap) + struct.pack("<H6xQ", 1, 0) * objects)


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


def feather(path):
    arrow, feather = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.feather")
    feather.write_feather(arrow.table([np.zeros(60_000)] * 7, names=COLUMNS), path, compression="zstd", chunksize=60_000)


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


def bag_of_one_page(path):
    """A table of ten levels, whose pages have one and the same page below them three hundred times."""
    bag(path, "create table messages(id integer primary key, topic_id integer, timestamp integer, data blob)")
    with sqlite3.connect(path) as made:
        made.executemany("insert into messages(topic_id, timestamp, data) values(1, ?, ?)", [(at, bytes(100)) for at in range(2000)])
        (root,) = made.execute("select rootpage from sqlite_master where name = 'messages'").fetchone()
    made.close()
    data = bytearray(path.read_bytes())
    (first,) = struct.unpack_from(">H", data, (root - 1) * 4096 + 12)
    (below,) = struct.unpack_from(">I", data, (root - 1) * 4096 + first)
    for _ in range(10):
        page = bytearray(4096)
        page[0] = 5
        struct.pack_into(">HHHI", page, 3, 300, 4096 - 300 * 8, 0, below)
        struct.pack_into(">H", page, 7, 0)
        struct.pack_into(">I", page, 8, below)
        for number in range(300):
            at = 4096 - (number + 1) * 8
            struct.pack_into(">IB", page, at, below, 1)
            struct.pack_into(">H", page, 12 + 2 * number, at)
        data += page
        below = len(data) // 4096
    data[(root - 1) * 4096 : root * 4096] = page
    struct.pack_into(">I", data, 28, below)
    path.write_bytes(data)


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


def mcap_json(path, message):
    channel = record(4, struct.pack("<HH", 1, 0) + text(b"/imu") + text(b"json") + bytes(4))
    mcap(path, channel, record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + message))


def mcap_defined(path, definition, count=1):
    """As many topics of the same type."""
    for_each = (
        record(3, struct.pack("<H", number) + text(b"a/msg/B") + text(b"ros2msg") + text(definition))
        + record(4, struct.pack("<HH", number, number) + text(b"/imu%d" % number) + text(b"cdr") + bytes(4))
        + record(5, struct.pack("<HIQQ", number, 0, 0, 0))
        for number in range(1, count + 1)
    )
    mcap(path, *for_each)


def mcap_with_a_hole(path):
    path.write_bytes(b"\x89MCAP0\r\n" + record(1, bytes(8)) + struct.pack("<BQ", 6, 900_000_000))
    os.truncate(path, 900_000_100)


TAKES, UNPACKS = r"reading it takes more than [\d.]+ [MG]B of memory, and .*import --most-memory [\d.]+[MG]B$", r"unpacks to more than"
#: name of the file -> what writes it, what is said, budget in MB
BOMBS = {
    "never_stored.h5": (hdf5_never_stored, TAKES, None),
    "scalars_of_arrays.h5": (hdf5_scalars_of_arrays, "no gyroscope and no accelerometer", None),
    "deep.h5": (hdf5_deep, "groups more than 32 deep", None),
    "chunk.h5": (hdf5_chunk, TAKES, None),
    "heaps.h5": (hdf5_heaps_in_heaps, "damaged at byte", None),
    "zlib.mat": (lambda path: matlab(path, 60_000_000), TAKES, None),
    "many.mat": (lambda path: matlab(path, 400_000, 9_600_000), TAKES, 10),
    "one_value.parquet": (parquet, TAKES, 3),
    "one_value.feather": (feather, TAKES, 3),
    "hole.npy": (npy_with_a_hole, TAKES, None),
    "endless.db3": (bag_endless, "messages is no plain table", None),
    "generated.db3": (bag_generated, "messages is no plain table", None),
    "one_page.db3": (bag_of_one_page, "messages has more rows than the file has room for", None),
    "chunks.mcap": (mcap_chunks, UNPACKS, 10),
    "hole.mcap": (mcap_with_a_hole, TAKES, None),
    "long_json.mcap": (lambda path: mcap_json(path, b'{"gyro":[1,2,3],"a":[' + b"[]," * 30_000 + b"1]}"), "more than 65536 bytes", None),
    "many_json.mcap": (lambda path: mcap_json(path, b'{"gyro":[' + b"1," * 9000 + b"1]}"), UNPACKS, 20),
    "long_definition.mcap": (lambda path: mcap_defined(path, b"int8 a\n" * 20_000), "its definition has more than 131072 letters", None),
    "definitions.mcap": (lambda path: mcap_defined(path, b"int8 a\n" * 200, 20), UNPACKS, 4),
    "arrays.mcap": (lambda path: mcap_defined(path, b"int8[900] a", 20), UNPACKS, 8),
    "sequences.mcap": (
        lambda path: mcap_defined(path, b"X[200] a\n" + b"=" * 80 + b"\nMSG: a/X\n" + b"int8[] a\n" * 200),
        "has more than 20000 numbers",
        None,
    ),
    "long_name.mcap": (lambda path: mcap_defined(path, b"int8[9] " + b"a" * 400), "has more than 300 letters", None),
    "parts.mcap": (lambda path: mcap_defined(path, b"int8[] a\n" * 40 + b"float64[3] gyro"), "more than 32 texts and sequences", None),
    "names.mcap": (
        lambda path: mcap(path, *(record(4, struct.pack("<HH", at, 0) + text(b"%06d" % at * 9999) + bytes(8)) for at in range(60))),
        TAKES,
        5,
    ),
}


BLACKBOX = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\nH I interval:32\n"
RATES = b"loopIteration,time,gyroADC[0],gyroADC[1],gyroADC[2]"


def _fields(kind, names, encoding, predictor=0):
    """The header's lines for the fields of a kind of frame."""
    count = names.count(b",") + 1
    lines = {b"name": names, b"encoding": b",".join([b"%d" % encoding] * count), b"predictor": b",".join([b"%d" % predictor] * count)}
    return b"".join(b"H Field %s %s:%s\n" % (kind, what, said) for what, said in lines.items())


#: frames of one byte: many fields for which none is stored; as many counters, each over all loops from a frame to the next
NOT_STORED = BLACKBOX + _fields(b"I", RATES, 1) + _fields(b"H", b",".join([b"a"] * 250), 9) + b"I" + bytes(5) + b"H" * 300
COUNTERS = BLACKBOX.replace(b"32", b"4096\nH P interval:1/4096") + _fields(b"I", RATES, 1) + _fields(b"H", RATES, 9, 6) + b"I" + bytes(5)
ROWS = BLACKBOX + _fields(b"I", RATES, 9)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (BLACKBOX * 2000, UNPACKS),
        (BLACKBOX + b"H x:" + b"1" * 66_000, "a header's line of more than 65536 bytes"),
        (BLACKBOX + b"\0" * 66_000, "a header's line of more than 65536 bytes"),
        (BLACKBOX + b"H Field I name:" + b",".join(b"f%d" % at for at in range(300)) + b"\nI", "more than 256 fields"),
        (BLACKBOX + _fields(b"H", b",".join([b"a"] * 300), 9) + b"I", "more than 256 fields"),
        (NOT_STORED, UNPACKS),
        (COUNTERS + b"H" * 10, UNPACKS),
        (ROWS + b"I" * 2000, UNPACKS),
        (ROWS + b"IX" * 1000, UNPACKS),
        (ROWS + b"I" + b"E\0\0" * 2000, UNPACKS),
    ],
    ids=["logs", "line", "no_line", "fields", "one_name", "not_stored", "counters", "rows", "between", "events"],
)
def test_a_blackbox_log_is_not_searched_for_minutes(data, said, tmp_path):
    pytest.importorskip("orangebox")
    (tmp_path / "a.bbl").write_bytes(data)
    with budget([tmp_path / "a.bbl"], MB), pytest.raises(FormatError, match=said):
        reader_of(tmp_path / "a.bbl", data[:99]).topics(tmp_path / "a.bbl", None)


def test_values_of_json_count_beside_their_bytes(tmp_path):
    with budget(most=MB):
        decode = json_decoder(tmp_path / "a.mcap", b'{"gyro": [1]}')[1](["gyro[0]"])
        with pytest.raises(FormatError, match=UNPACKS):
            list(map(decode, [b'{"gyro": [1], "a": [' + b"[]," * 9000 + b"1]}"] * 10))


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_in_one_line(name, tmp_path):
    write, said, most_mb = BOMBS[name]
    write(tmp_path / name)
    with (
        budget([tmp_path / name], None if most_mb is None else most_mb * MB),
        pytest.raises(FormatError, match=said) as raised,
        Sources([tmp_path / name], _answers()),
    ):
        pass
    assert "\n" not in str(raised.value)


def _answers():
    from session.io.dialects import Answers

    return Answers(odr_hz=100, gyro_fs_dps=500, accel_fs_g=4)


@pytest.mark.broad
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux tells a process's peak")
@pytest.mark.parametrize("name", ["never_stored.h5", "chunk.h5", "zlib.mat", "hole.npy", "generated.db3", "hole.mcap"])
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


@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_the_index_is_asked_once_however_many_chunks_are_damaged(name, tmp_path):
    """A file of as many bytes as this has room for 60 chunks, whose summary would else be read 60 times."""
    path = tmp_path / name
    if name == "a.mcap":
        pytest.importorskip("mcap")
        summary = record(4, bytes(4) + text(b"/imu" * 9999) + text(b"json") + bytes(4))
        begin = 8 + 17 + 60 * (9 + 45) + 9 + 4
        chunk = record(6, bytes(28) + text(b"?") + bytes(8) + bytes(4))
        assert len(chunk) == 9 + 45
        mcap(path, chunk * 60, record(15, bytes(4)), summary, record(2, struct.pack("<QQI", begin, 0, 0)), b"\x89MCAP0\r\n")
    else:
        pytest.importorskip("rosbags")

        def fields(**values):
            return b"".join(text(name.encode() + b"=" + value) for name, value in values.items())

        def of_bag(body=b"", **values):
            return text(fields(**values)) + text(body)

        chunk = of_bag(op=b"\5", compression=b"?", size=bytes(4))
        head = of_bag(op=b"\3", index_pos=bytes(8), conn_count=struct.pack("<I", 1), chunk_count=bytes(4))
        begin = struct.pack("<Q", 13 + len(head) + 60 * len(chunk))
        head = of_bag(op=b"\3", index_pos=begin, conn_count=struct.pack("<I", 1), chunk_count=bytes(4))
        about = fields(type=b"a/B", message_definition=b"", topic=b"", md5sum=b"")
        path.write_bytes(b"#ROSBAG V2.0\n" + head + chunk * 60 + of_bag(about, op=b"\7", conn=bytes(4), topic=b"/imu" * 9999))
    with budget([path], MB), pytest.raises(FormatError, match="/imu/imu"):
        reader_of(path, head_of(path)).topics(path, None)


def test_a_parser_that_reads_three_bytes_at_once_comes_to_an_end(tmp_path):
    """A hole of a terabyte is as many messages without a length as it has bytes."""
    (tmp_path / "a.ulg").write_bytes(bytes(9999))
    with Source(tmp_path / "a.ulg", strict=False, budget=5 * RECORD) as source:
        assert len(list(iter(lambda: source.read(3), b""))) == 10


def test_a_bag_reads_each_of_its_files_once(tmp_path):
    pytest.importorskip("rosbags")
    bag(tmp_path / "a.db3", "create table messages(id integer primary key, topic_id integer, timestamp integer, data blob)")
    os.truncate(tmp_path / "a.db3", (tmp_path / "a.db3").stat().st_size - 1)
    (tmp_path / "metadata.yaml").write_text("  relative_file_paths:\n" + "  - a.db3\n" * 3)
    with pytest.raises(FormatError, match="without a topic") as raised:
        reader_of(tmp_path, b"").topics(tmp_path, None)
    assert str(raised.value).count("the file is cut") == 1


# What counts.


def test_the_budget_is_a_gigabyte_or_what_the_files_take_on_the_disk(tmp_path):
    small, sparse, folder = tmp_path / "small", tmp_path / "sparse", tmp_path / "folder"
    small.write_bytes(b"1" * 100)
    sparse.write_bytes(b"1" * 8192)
    os.truncate(sparse, 10**12)
    folder.mkdir()
    (folder / "a.db3").write_bytes(b"1" * 100)
    assert [Budget([path]).most for path in (small, sparse, folder, tmp_path / "none")] == [GB] * 4
    large = tmp_path / "large"
    large.write_bytes(bytes(b"1" * (60 * MB)))
    assert Budget([large]).most == Budget([large, small]).most - PACKED * 100 == PACKED * 60 * MB
    assert Budget([large], 5).most == 5


def test_what_is_said_is_enough(tmp_path):
    """Half as much again as the complaint names lets the file through: that is what it advises."""
    path = tmp_path / "a.npz"
    np.savez(path, gyro_dps=np.ones((5000, 3)), acc_g=np.ones((5000, 3)), time_ns=np.arange(5000))
    reader = reader_of(path, head_of(path))
    with budget([path], MB // 2), pytest.raises(FormatError) as raised:
        reader.read(path, [], None)
    enough = re.search(r"takes more than ([\d.]+) MB", str(raised.value))[1]
    with budget([path], int(float(enough) * 1.5 * MB)):
        assert len(reader.read(path, [], None)[0]) == 5000


def test_topics_and_streams_do_not_count_twice(tmp_path):
    pytest.importorskip("zstandard")
    path = tmp_path / "a.npz"
    np.savez(path, gyro_dps=np.ones((5000, 3)), acc_g=np.ones((5000, 3)), time_ns=np.arange(5000))
    with budget([path]) as allowed, Sources([path], _answers()) as (source,):
        assert allowed.held == 5000 * 7 * 8 * 2.5
        list(source.pieces())
        assert source.stream.gyro is None


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
    assert code == 0
    code, _, err = run(*words, "--most-memory", "much")
    assert (code, "'much' is no amount of memory such as 3GB or 700MB" in err) == (2, True)
