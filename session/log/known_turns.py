"""``turns.csv``: turns whose angle is known beforehand, from a stop or the table's index (docs/formats.md).

The file counts turns as ``check`` and ``fit`` count segments: from 0, over all logs in name order; with the column ``log``, from 0 in the
log of that name.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.common.units import DEG
from session.log.rows_of_text import rows_of

NAME = "turns.csv"
COLUMNS = ("turn", "axis", "angle_deg", "sigma_deg")
#: any order, and ``log`` besides where turns are counted within each log
LOG = "log"
#: a stop that repeats worse than this tells nothing that a gyroscope does not know
MOST_SIGMA_DEG = 10.0
#: full circles in one turn; beyond that the angle is in another unit
MOST_ANGLE_DEG = 36_000.0
#: five times the longest session that a table has made
MOST_TURNS = 10_000


@dataclass(frozen=True, eq=False)
class KnownTurn:
    """One row.

    turn: its number, over all logs, or in the log of that name; axis (3,) unit, body axes, nominal: what the sensor was turned about;
    words: the axis as it was written; angle_rad about it by the right-hand rule, whole circles included; sigma_rad: the
    stop's repeatability.
    """

    turn: int
    log: str | None
    axis: np.ndarray
    words: str
    angle_rad: float
    sigma_rad: float

    @property
    def name(self) -> str:
        """``turn 3``, or ``turn 0 of log0002.csv``."""
        return f"turn {self.turn}" + (f" of {self.log}" if self.log else "")

    @property
    def says(self) -> str:
        """``360 ± 0.05 deg about x``."""
        return f"{self.angle_rad / DEG:g} ± {self.sigma_rad / DEG:g} deg about {self.words}"


def read_known_turns(path: Path, logs: list[str]) -> tuple[KnownTurn, ...]:
    """The rows of ``turns.csv``; logs: names of the session's logs.  FormatError names the line and what is wrong."""
    lines = rows_of(path)
    header = [cell.strip() for cell in next(lines, (0, ""))[1].split(",")]
    if sorted(set(header) - {LOG}) != sorted(COLUMNS) or len(set(header)) != len(header):
        raise FormatError(f"{NAME}: the header must be {','.join(COLUMNS)}, with the column {LOG} where turns are counted in each log")
    turns: dict[tuple[int, str | None], KnownTurn] = {}
    for number, line in lines:
        turn = _row(f"{NAME} line {number}", header, line, logs)
        if (turn.turn, turn.log) in turns:
            raise FormatError(f"{NAME} line {number}: {turn.name} is given twice; keep one")
        turns[turn.turn, turn.log] = turn
        if len(turns) > MOST_TURNS:
            raise FormatError(f"{NAME} line {number}: more than {MOST_TURNS} turns; is it the right file?")
    if not turns:
        raise FormatError(f"{NAME}: a header but no turns; remove the file, or give a row for each turn of known angle")
    return tuple(turns.values())


def _row(where: str, header: list[str], line: str, logs: list[str]) -> KnownTurn:
    try:
        cells = [cell.strip() for cell in next(csv.reader([line], strict=True))]
    except csv.Error:
        cells = []
    if len(cells) != len(header):
        raise FormatError(f"{where}: {line[:60]!r}, expected {len(header)} cells: {','.join(header)}")
    cell = dict(zip(header, cells, strict=True))
    says = ";".join(part.strip() for part in cell["axis"].split(";"))  # a number may stand between characters that nobody sees
    turn = _number(where, "turn", cell["turn"], "a whole number, the first turn is 0")
    if turn != int(turn) or not 0 <= turn < MOST_TURNS:
        raise FormatError(f"{where}: turn is {cell['turn']!r}, expected a whole number, the first turn is 0")
    angle = _number(where, "angle_deg", cell["angle_deg"], "degrees, as 360 or -90")
    if not 0 < abs(angle) <= MOST_ANGLE_DEG:
        raise FormatError(f"{where}: angle_deg is {cell['angle_deg']!r}, expected degrees, not 0 and within {MOST_ANGLE_DEG:g}")
    sigma = _number(where, "sigma_deg", cell["sigma_deg"], "degrees, one sigma of the stop, as 0.05")
    if not 0 < sigma <= MOST_SIGMA_DEG:
        raise FormatError(
            f"{where}: sigma_deg is {cell['sigma_deg']!r}, expected one sigma of the stop, above 0 and up to {MOST_SIGMA_DEG:g}"
        )
    return KnownTurn(int(turn), _log(where, cell.get(LOG), logs), _axis(where, says), says, angle * DEG, sigma * DEG)


def _number(where: str, name: str, text: str, expected: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{where}: {name} is {text[:30]!r}, expected {expected}")
    return value


def _axis(where: str, text: str) -> np.ndarray:
    """``x``, ``+y``, ``-z``, or three numbers with semicolons between; (3,) unit."""
    sign, letter = (-1.0 if text.startswith("-") else 1.0), text.lstrip("+-").lower()
    if letter in ("x", "y", "z") and len(text) <= 2:
        return sign * np.eye(3)["xyz".index(letter)]
    try:
        axis = np.array([float(part) for part in text.split(";")])
    except ValueError:
        axis = np.zeros(0)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise FormatError(f"{where}: axis is {text[:30]!r}, expected x, y or z with a sign if need be, or three numbers as 0;0.7;0.7")
    axis = axis / np.abs(axis).max()  # the squares of what is very large or small are no numbers
    return axis / np.linalg.norm(axis)


def _log(where: str, text: str | None, logs: list[str]) -> str | None:
    """The log's own name; an empty cell counts over all logs."""
    if not text:
        return None
    for name in logs:
        if text in (name, name.removesuffix(".gz"), name.removesuffix(".gz").removesuffix(".csv")):
            return name
    raise FormatError(f"{where}: log is {text[:40]!r}, expected one of {', '.join(logs[:6])}{', …' if len(logs) > 6 else ''}")
