"""The readers of binary logs, and which of them reads a file.

A reader is a module with ``NAME``, ``PACKAGE`` (what pip installs, or ``""``), ``EXTRA`` (of this project), ``LICENCE`` of the package and
``EXAMPLE`` (one line that shows such a file), and with three functions:

- ``is_mine(path, head)`` says whether a file is of this format, by its first bytes.
- ``topics(path, columns)`` lists the streams that hold a gyroscope or an accelerometer.
- ``read(path, names, columns)`` returns the streams of these names; of all of them where no name is given.

columns is the text of ``--columns``; a reader whose format names its own columns refuses it.  Both raise FormatError, in one line, for
what cannot be read.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

#: how people call the format -> module, in the order in which the formats are listed and tried
READERS = {
    "ULog": "session.replay.binary.ulog",
    "ROS 1 bag": "session.replay.binary.rosbag1",
    "ROS 2 bag": "session.replay.binary.rosbag2",
    "MCAP": "session.replay.binary.mcap_file",
    "ArduPilot dataflash": "session.replay.binary.ardupilot",
    "Betaflight blackbox": "session.replay.binary.betaflight",
    "HDF5": "session.replay.binary.hdf5",
    "MATLAB": "session.replay.binary.matlab",
    "NumPy": "session.replay.binary.numpy_file",
    "Arrow": "session.replay.binary.arrow",
}


def reader_of(path: Path, head: bytes) -> ModuleType | None:
    """The module that reads a file which begins with head; None where no reader knows it.

    head: its first bytes, as ``session/replay/sources.py`` reads them; of a folder none.
    """
    return next((module for module in map(import_module, READERS.values()) if module.is_mine(path, head)), None)
