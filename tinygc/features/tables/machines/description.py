"""``table.toml``: a machine that turns a sensor: how it is spoken to, its axes from the ground outwards, and what it declares of each.

Frames.  At angles of zero all stages are parallel to the table frame ``t`` (north-east-down, turned about the vertical by the table's
heading; ``session/__init__.py``).  Each axis is a direction in that frame; it is carried by the axes before it.  ``mounting`` takes vectors
from the sensor's body to the innermost stage; it is known to a degree or so.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.results import Array, Keys, ListOf, Number, Text, require, shown
from session.base.toml import read_toml
from session.base.units import DEG
from session.log.config import ROTATION_WITHIN

SCHEMA = "tinygc-table/1"
NAME = "table.toml"
MOST_AXES = 3
#: s that braking may take by its figures: so long a stop waits before it asks a silent table harder
MOST_BRAKING_S = 60.0
#: s of angles that a table takes to answer where nothing is declared: the prior of its latency
LATENCY_SIGMA_S = 0.1


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a table.

    name; direction (3,) unit, table frame, at angles of zero; least_rad, most_rad: its limits (both None: it turns without end);
    fastest_rps and acceleration_rps2: what it can do; sigma_rad: the declared accuracy of its angle, one sigma; backlash_rad: the
    declared play; word: what the machine calls it (``X``, ``1``).
    """

    name: str
    direction: np.ndarray
    least_rad: float | None
    most_rad: float | None
    fastest_rps: float
    acceleration_rps2: float
    sigma_rad: float
    backlash_rad: float
    word: str

    @property
    def is_endless(self) -> bool:
        """Whether it has no limits."""
        return self.least_rad is None

    def allows(self, angle_rad: float) -> bool:
        """Whether an angle lies within the limits, by rounding."""
        if self.least_rad is None or self.most_rad is None:
            return math.isfinite(angle_rad)
        return self.least_rad - 1e-9 <= angle_rad <= self.most_rad + 1e-9


@dataclass(frozen=True, eq=False)
class Description:
    """A machine: make (a name of ``makes``), port, axes from the ground outwards, mounting (3, 3), and settings of the make.

    make_sha256: of a make's file of one's own, as a person has confirmed it.
    """

    name: str
    make: str
    axes: tuple[Axis, ...]
    mounting: np.ndarray = field(default_factory=lambda: np.eye(3))
    port: str = ""
    baud: int = 0  #: 0: that of the make
    settings: Mapping[str, object] = field(default_factory=dict)
    make_sha256: str = ""

    @property
    def braking_s(self) -> float:
        """Return the longest that an axis takes to brake."""
        return max(axis.fastest_rps / axis.acceleration_rps2 for axis in self.axes)

    def axis(self, name: str) -> int:
        """Number of the axis of that name.  FormatError where there is none."""
        for number, axis in enumerate(self.axes):
            if axis.name == name:
                return number
        raise FormatError(f"{self.name}: no axis {name!r}; it has {', '.join(axis.name for axis in self.axes)}")


_ANGLE = Number(-1e6, 1e6)
_AXIS = Keys(
    {
        "name": Text(),
        "direction": Array((3,)),
        "fastest_dps": Number(0, 1e5, above=True),
        "acceleration_dps2": Number(0, 1e6, above=True),
        "sigma_deg": Number(0, 10, above=True),
    },
    {"least_deg": _ANGLE, "most_deg": _ANGLE, "backlash_deg": Number(0, 10), "word": Text()},
)
SHAPE = Keys(
    {"schema": Text((SCHEMA,)), "make": Text(), "axis": ListOf(_AXIS)},
    {
        "name": Text(),
        "make_sha256": Text(),
        "mounting": Array((3, 3)),
        "port": Text(),
        "baud": Number(1, 1e8, whole=True),
        "settings": Keys(),
    },
)
AGAIN = "correct the file (docs/formats/tables.md)"


def read_description(path: Path) -> Description:
    """Read ``table.toml`` (docs/formats/tables.md).  Raises FormatError for what is wrong with it."""
    table = read_toml(path)
    require(table, SHAPE, str(path), AGAIN)
    axes = tuple(_axis(f"{path}: axis[{number}]", row) for number, row in enumerate(table["axis"]))
    if not 1 <= len(axes) <= MOST_AXES or len({axis.name for axis in axes}) < len(axes):
        raise FormatError(f"{path}: {len(axes)} axes, expected one to {MOST_AXES} with names of their own; {AGAIN}")
    mounting = np.array(table.get("mounting", np.eye(3)), dtype=float)
    if np.abs(mounting @ mounting.T - np.eye(3)).max() > ROTATION_WITHIN or np.linalg.det(mounting) < 0:
        raise FormatError(f"{path}: mounting is no rotation matrix within {ROTATION_WITHIN:g}; {AGAIN}")
    u, _, v = np.linalg.svd(mounting)
    return Description(
        table.get("name", path.stem),
        table["make"],
        axes,
        u @ v,
        table.get("port", ""),
        table.get("baud", 0),
        table.get("settings", {}),
        table.get("make_sha256", ""),
    )


def _axis(where: str, row: Mapping) -> Axis:
    if unknown := [key for key in row if key not in _AXIS.known]:  # a misspelt limit would be none
        raise FormatError(f"{where}.{unknown[0][:40]}: an axis has no such key, expected {', '.join(_AXIS.known)}; {AGAIN}")
    if not row.get("word", row["name"]).isprintable():  # it goes into requests: a line end would send another
        raise FormatError(f"{where}.word is {shown(row['word'])}, expected no line end or other control character; {AGAIN}")
    direction = np.array(row["direction"], dtype=float)
    length = float(np.linalg.norm(direction))
    if not length:
        raise FormatError(f"{where}.direction is zero, expected a direction such as [0, 0, 1]; {AGAIN}")
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,20}", row["name"]):
        raise FormatError(f"{where}.name is {row['name'][:30]!r}, expected small letters, as outer; {AGAIN}")
    least, most = row.get("least_deg"), row.get("most_deg")
    if (least is None) != (most is None) or (least is not None and least >= most):
        raise FormatError(f"{where}: least_deg and most_deg are {least} and {most}, expected both, or none of an axis without end; {AGAIN}")
    if (braking_s := row["fastest_dps"] / row["acceleration_dps2"]) > MOST_BRAKING_S:
        figures = f"fastest_dps / acceleration_dps2 is {braking_s:.3g} s, which a stop may wait for"
        raise FormatError(f"{where}: {figures}, expected {MOST_BRAKING_S:g} or less; {AGAIN}")
    return Axis(
        row["name"],
        direction / length,
        None if least is None else least * DEG,
        None if most is None else most * DEG,
        row["fastest_dps"] * DEG,
        row["acceleration_dps2"] * DEG,
        row["sigma_deg"] * DEG,
        row.get("backlash_deg", 0.0) * DEG,
        row.get("word", row["name"]),
    )
