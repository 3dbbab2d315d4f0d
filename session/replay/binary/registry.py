"""The readers of binary logs, and which of them reads a file.

A reader is a module with a ``FORMAT``: of messages that name their own columns (``source.Messages``), or of arrays of any name
(``arrays.Tables``).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from session.replay.binary.arrays import Tables
from session.replay.binary.source import Messages

#: how people call the format -> module, in the order in which the formats are listed and tried
READERS = {
    "ULog": "session.replay.binary.ulog",
    "ROS 1 bag": "session.replay.binary.rosbag1",
    "ROS 2 bag": "session.replay.binary.rosbag2",
    "MCAP": "session.replay.binary.mcap_file",
    "ArduPilot dataflash": "session.replay.binary.ardupilot",
    "HDF5": "session.replay.binary.hdf5",
    "MATLAB": "session.replay.binary.matlab",
    "NumPy": "session.replay.binary.numpy_file",
    "Parquet": "session.replay.binary.parquet",
}


def format_of(name: str) -> Messages | Tables:
    """The format of a name in ``READERS``."""
    found: Messages | Tables = import_module(READERS[name]).FORMAT
    return found


def reader_of(path: Path, head: bytes) -> Messages | Tables | None:
    """The format of a file that begins with head; None where no reader knows it.

    head: its first bytes, as ``session/replay/sources.py`` reads them; of a folder none.
    """
    return next((each for each in map(format_of, READERS) if each.is_mine(path, head)), None)
