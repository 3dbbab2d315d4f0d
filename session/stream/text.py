"""The text form of a stream: the log's own lines (FORMATS)."""

from __future__ import annotations

import re

from session.stream.events import Info

COLUMNS = ("t_us", "gx", "gy", "gz", "ax", "ay", "az", "temp")
HEADER = ",".join(COLUMNS)
_NUMBER = re.compile(rb"-?[1-9][0-9]{0,17}|0")
_PAIR = re.compile(r"(\w+)=(\S+)")


def parse_line(line: bytes) -> list[int] | None:
    """A line's whole numbers, eight or more of them; None where it is no such line, or a register holds more than 16 bits."""
    cells = [cell.strip(b" \t") for cell in line.split(b",")]
    if len(cells) < len(COLUMNS) or not all(map(_NUMBER.fullmatch, cells)):
        return None
    values = list(map(int, cells))
    return values if values[0] >= 0 and all(-32768 <= value <= 32767 for value in values[1:8]) else None


def parse_info(comment: str) -> Info | None:
    """What a comment says of the board, or None where it is about something else."""
    said = dict(_PAIR.findall(comment))
    try:
        numbers = [float(said[name]) for name in ("gyro_fs_dps", "accel_fs_g", "odr_hz")]
    except (KeyError, ValueError):
        return None
    return Info(*numbers, said.get("serial", "")) if all(0 < number < 1e6 for number in numbers) else None
