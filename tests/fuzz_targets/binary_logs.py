"""Binary logs of every format, as other programs write them: the streams that are accepted are whole in themselves."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import written_logs as written

from fuzz_targets.material import FORCES_G, RATES_DPS, T_US
from fuzz_targets.rules import choose
from session.annexes.logs import ardupilot, arrow, betaflight, hdf5, matlab, mcap_file, numpy_file, rosbag1, rosbag2, ulog
from session.io.units import DEG, G

#: rows: a file of many formats is long by what stands around them
COUNT = 12
#: reader, writer, name of the file
FORMATS = (
    (ulog, written.write_ulog, "a.ulg"),
    (rosbag1, written.write_ros1, "a.bag"),
    (rosbag2, written.write_ros2, "a.db3"),
    (mcap_file, written.write_mcap, "a.mcap"),
    (ardupilot, written.write_ardupilot, "a.BIN"),
    (betaflight, written.write_blackbox, "a.bbl"),
    (hdf5, written.write_hdf5, "a.h5"),
    (matlab, written.write_mat, "a.mat"),
    (numpy_file, written.write_npz, "a.npz"),
    (arrow, written.write_feather, "a.feather"),
)


@cache
def seeds() -> list[bytes]:
    """One file of each format, behind its number."""
    made = []
    for number, (_, write, name) in enumerate(FORMATS):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            write(path, T_US[:COUNT] * 1000, RATES_DPS[:COUNT] * DEG, FORCES_G[:COUNT] * G, np.linspace(25, 26, COUNT))
            data = (path / name).with_name(f"{name}.db3").read_bytes() if path.is_dir() else path.read_bytes()
        made.append(bytes([number]) + data)
    return made


def run(data: bytes, folder: Path) -> None:
    """By the reader that the first byte names, whether it would know the file or not."""
    (reader, _, name), rest = choose(data, FORMATS)
    path = folder / name
    path.write_bytes(rest)
    reader.is_mine(path, rest[:4096])
    topics, streams = reader.topics(path, None), reader.read(path, [], None)
    assert [(topic.name, topic.rows, topic.holds) for topic in topics] == [(stream.name, len(stream), stream.holds) for stream in streams]
    for stream in streams:
        assert {"gyro", "accel"} & set(stream.holds)
        for part in (stream.gyro, stream.accel):
            assert part is None or (part.shape, part.dtype) == ((len(stream), 3), np.dtype(float))
        for part in (stream.t_ns, stream.temp):
            assert part is None or part.shape == (len(stream),)
