"""``table.toml``: a machine that turns a sensor: how it is spoken to, its axes from the ground outwards, and what it declares of each.

Frames.  At angles of zero all stages are parallel to the table frame ``t`` (north-east-down, turned about the vertical by the table's
heading; ``session/__init__.py``).  Each axis is a direction in that frame; it is carried by the axes before it.  ``mounting`` takes vectors
from the sensor's body to the innermost stage; it is known to a degree or so.

    R_tb = Rot(a_1, alpha_1) Rot(a_2, alpha_2) ... M

a_k: direction of axis k at angles of zero, from the ground outwards; M: mounting.  A rate of axis k turns the body about
``R_tb^T Rot(a_1, alpha_1) ... Rot(a_k-1, alpha_k-1) a_k``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from session.base.errors import FormatError
from session.base.records import ROTATION, Key, record_from, record_of
from session.base.results import Array, Mismatch, Number, Shape, shown
from session.base.rotation import exp, identities, matrix
from session.base.toml import read_toml
from session.base.units import DEG

NAME = "table.toml"
MOST_AXES = 3
#: s that braking may take by its figures: so long a stop waits before it asks a silent table harder
MOST_BRAKING_S = 60.0
#: s of angles that a table takes to answer where nothing is declared: the prior of its latency
LATENCY_SIGMA_S = 0.1
AGAIN = "correct the file (docs/formats/tables.md)"


class Settings(Shape):
    """Numbers, texts and flags by name; of the numbers that every make has (``number``) none is 0 where that means nothing."""

    #: settings of every make, and what they are where neither its file nor table.toml states otherwise
    usual: ClassVar[Mapping[str, float]] = {
        "per_deg": 1.0,  # units of an angle, in requests and answers, per degree
        "rate_per_dps": 1.0,  # units of a rate per degree per second
        "count_per_deg": 1.0,  # of a {count} that is answered
        "decimals": 4,  # of numbers that are sent
        "open_s": 0.0,  # until it listens, after its port was opened
        "answer_s": 2.0,  # the longest that it takes to answer
        "home_s": 180.0,  # the longest that homing takes
        "rest_dps": 0.01,  # a {rate} below it is rest
        "same_s": 0.4,  # angles that stay for so long are rest, where nothing else decides it
        "clock_per_s": 1.0,  # units of a {clock} per second
    }
    may_be_zero = ("decimals", "open_s")

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch for a setting of the wrong kind."""
        if not isinstance(value, dict):
            self.refuse(value, where)
        for name, given in value.items():
            is_number = isinstance(given, int | float) and not isinstance(given, bool)
            if name in self.usual:
                if not (is_number and 0 < abs(given) < 1e9) and not (name in self.may_be_zero and given == 0):
                    raise Mismatch(f"{where}.{name} is {shown(given)}, expected a number that is not 0")
                if name == "decimals" and not (isinstance(given, int) and 0 <= given <= 9):
                    raise Mismatch(f"{where}.decimals is {shown(given)}, expected a whole number from 0 to 9")
            elif not isinstance(given, int | float | str) or (isinstance(given, str) and not given.isprintable()):
                kinds = "a number, a text without control characters, true or false"
                raise Mismatch(f"{where}.{name[:40]} is {shown(given)}, expected {kinds}")


def _is_zero(direction: np.ndarray) -> str:
    return "" if direction.any() else "is zero, expected a direction such as [0, 0, 1]"


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a table.

    name; direction (3,), table frame, at angles of zero, which is made a unit vector; least_rad, most_rad: its limits, infinite where it
    turns without end; fastest_rps and acceleration_rps2: what it can do; sigma_rad: the declared accuracy of its angle, one sigma;
    backlash_rad: the declared play; word: what the machine calls it (``X``, ``1``), its name without one.
    """

    name: str
    direction: Annotated[np.ndarray, Array((3,), Number(), _is_zero)]
    fastest_rps: Annotated[float, Number(0, 1e5, above=True), Key("fastest_dps", DEG)]
    acceleration_rps2: Annotated[float, Number(0, 1e6, above=True), Key("acceleration_dps2", DEG)]
    sigma_rad: Annotated[float, Number(0, 10, above=True), Key("sigma_deg", DEG)]
    least_rad: Annotated[float, Number(-1e6, 1e6), Key("least_deg", DEG)] = -np.inf
    most_rad: Annotated[float, Number(-1e6, 1e6), Key("most_deg", DEG)] = np.inf
    backlash_rad: Annotated[float, Number(0, 10), Key("backlash_deg", DEG)] = 0.0
    word: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "word", self.word or self.name)
        object.__setattr__(self, "direction", self.direction / np.linalg.norm(self.direction))

    @property
    def is_endless(self) -> bool:
        """Whether it has no limits."""
        return bool(np.isinf(self.least_rad))

    @property
    def limits(self) -> str:
        """``-90 to 270 deg``, or that it has none."""
        return "no limits" if self.is_endless else f"{self.least_rad / DEG:g} to {self.most_rad / DEG:g} deg"

    def allows(self, angle_rad: float) -> bool:
        """Whether an angle lies within the limits, by rounding."""
        return bool(np.isfinite(angle_rad) and self.least_rad - 1e-9 <= angle_rad <= self.most_rad + 1e-9)

    @staticmethod
    def fault(row: Mapping) -> str:
        """What is wrong with a row of sound keys; empty where nothing is."""
        known = record_of(Axis).known
        if unknown := [key for key in row if key not in known]:  # a misspelt limit would be none
            return f"{unknown[0][:40]}: an axis has no such key, expected {', '.join(known)}"
        if not row.get("word", "").isprintable():  # it goes into requests: a line end would send another
            return f"word is {shown(row['word'])}, expected no line end or other control character"
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,20}", row["name"]):
            return f"name is {row['name'][:30]!r}, expected small letters, as outer"
        least, most = row.get("least_deg"), row.get("most_deg")
        if (least is None) != (most is None) or (least is not None and least >= most):
            return f"least_deg and most_deg are {least} and {most}, expected both, or none of an axis without end"
        if (braking_s := row["fastest_dps"] / row["acceleration_dps2"]) > MOST_BRAKING_S:
            figures = f"fastest_dps / acceleration_dps2 is {braking_s:.3g} s, which a stop may wait for"
            return f"{figures}, expected {MOST_BRAKING_S:g} or less"
        return ""


@dataclass(frozen=True, eq=False)
class Description:
    """A machine: make (a name of ``makes``), port, axes from the ground outwards, mounting (3, 3), and settings of the make.

    make_sha256: of a make's file of one's own, as a person has confirmed it.
    """

    schema: ClassVar[str] = "tinygc-table/1"
    name: Annotated[str, Key(absent="")]
    make: str
    axes: Annotated[tuple[Axis, ...], Key("axis")]
    mounting: Annotated[np.ndarray, ROTATION] = field(default_factory=lambda: np.eye(3))
    port: str = ""
    baud: Annotated[int, Number(1, 1e8, whole=True)] = 0  #: 0: that of the make
    settings: Annotated[Mapping[str, Any], Settings()] = field(default_factory=dict)
    make_sha256: str = ""

    @staticmethod
    def fault(table: Mapping) -> str:
        """What is wrong with a table of sound keys; empty where nothing is."""
        count = len(table["axis"])
        if 1 <= count <= MOST_AXES and len({row["name"] for row in table["axis"]}) == count:
            return ""
        return f"axis has {count} entries, expected one to {MOST_AXES} with names of their own"

    @property
    def braking_s(self) -> float:
        """Return the longest that an axis takes to brake."""
        return max(axis.fastest_rps / axis.acceleration_rps2 for axis in self.axes)

    def axis(self, name: str) -> int:
        """Number of the axis of that name.  FormatError where there is none."""
        names = [axis.name for axis in self.axes]
        if name not in names:
            raise FormatError(f"{self.name}: no axis {name!r}; it has {', '.join(names)}")
        return names.index(name)


def read_description(path: Path) -> Description:
    """Read ``table.toml`` (docs/formats/tables.md).  Raises FormatError for what is wrong with it."""
    found = record_from(Description, read_toml(path), str(path), AGAIN)
    return replace(found, name=found.name or path.stem)


def rotations(direction: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(N, 3, 3) right-handed rotations by angles (N,) rad about a unit direction (3,)."""
    return matrix(exp(np.asarray(angle, dtype=float)[..., None] * direction))


def attitudes(table: Description, angles: np.ndarray) -> np.ndarray:
    """``R_tb`` (N, 3, 3) of angles (N, K) rad, one column for each axis."""
    return stage_attitudes([axis.direction for axis in table.axes], angles) @ table.mounting


def stage_attitudes(directions: Sequence[np.ndarray], angles: np.ndarray) -> np.ndarray:
    """(N, 3, 3): the innermost stage to the table frame."""
    product = identities(len(angles))
    for direction, angle in zip(directions, np.asarray(angles, dtype=float).T, strict=True):
        product = product @ rotations(direction, angle)
    return product


def body_axes(table: Description, angles: np.ndarray) -> np.ndarray:
    """(N, K, 3): the body's rate, rad/s per rad/s of each axis, at angles (N, K) rad."""
    outside, found = identities(len(angles)), []
    for axis, angle in zip(table.axes, np.asarray(angles, dtype=float).T, strict=True):
        found.append(outside @ axis.direction)
        outside = outside @ rotations(axis.direction, angle)
    return np.einsum("nij,nki->nkj", outside @ table.mounting, np.stack(found, axis=1))


def roll_pitch_yaw(R: np.ndarray) -> np.ndarray:
    """(N, 3) rad of ``R = Rz(yaw) Ry(pitch) Rx(roll)`` (N, 3, 3)."""
    pitch = np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0]))
    level = np.cos(pitch) > 1e-9  # else roll and yaw are one: roll is 0
    roll = np.where(level, np.arctan2(R[:, 2, 1], R[:, 2, 2]), 0.0)
    yaw = np.where(level, np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.arctan2(-R[:, 0, 1], R[:, 1, 1]))
    return np.stack([roll, pitch, yaw], axis=1)


# What a real table does as well: errors that do not change within a rest.
#
#     R_tb = Rot(tilt) prod_k Rot(wobble_k(alpha)) Rot(a_k + skew_k, alpha_k + lost_k) M
#
# tilt: the base against the vertical; lost: the angle less the reported one, such as steps that the motor has lost; skew_k: an axis is
# not where it should be (its component along a_k shows nothing); wobble_k(alpha) = w1 cos alpha e1 + w2 sin alpha e2 + w3 cos alpha e2 +
# w4 sin alpha e1, e1 and e2 normal to a_k.


@dataclass(frozen=True, eq=False)
class AxisErrors:
    """Errors of one axis, rad: lost (one for all angles, or one for each), skew (3,), wobble (4,)."""

    lost: float | np.ndarray = 0.0
    skew: np.ndarray = field(default_factory=lambda: np.zeros(3))
    wobble: np.ndarray = field(default_factory=lambda: np.zeros(4))


@dataclass(frozen=True, eq=False)
class TableErrors:
    """Errors of a table: of each axis; tilt (3,) rad of its base."""

    axes: tuple[AxisErrors, ...]
    tilt: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def none(cls, table: Description) -> TableErrors:
        """A perfect table."""
        return cls(tuple(AxisErrors() for _ in table.axes))


def true_attitudes(table: Description, errors: TableErrors, reported: np.ndarray) -> np.ndarray:
    """``R_tb`` (N, 3, 3) with all errors, of reported angles (N, K) rad."""
    product = np.broadcast_to(matrix(exp(errors.tilt)), (len(reported), 3, 3))
    for k, (axis, of) in enumerate(zip(table.axes, errors.axes, strict=True)):
        alpha, (e1, e2) = reported[:, k], normals(axis.direction)
        cos, sin = np.cos(alpha)[:, None], np.sin(alpha)[:, None]
        w1, w2, w3, w4 = of.wobble
        wobble = (w1 * cos + w4 * sin) * e1 + (w2 * sin + w3 * cos) * e2
        skewed = axis.direction + of.skew
        turned = rotations(skewed / np.linalg.norm(skewed), alpha + of.lost)
        product = product @ matrix(exp(wobble)) @ turned
    return product @ table.mounting


def normals(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) normal to a unit direction (3,) and to each other, right-handed with it."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    e1 = np.cross(other, direction)
    e1 = e1 / np.linalg.norm(e1)
    return e1, np.cross(direction, e1)
