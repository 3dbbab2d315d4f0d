"""``[certificate]`` of session.toml: what a calibration certificate states that no measurement tells (docs/certificate.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date, datetime
from itertools import combinations
from typing import Any

from session.base.results import Keys, ListOf, Mismatch, Shape, Text

#: places of a Digital Calibration Certificate
PERFORMED_AT = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
LANGUAGES = ("en",)
#: what traceability is stated of
TRACED = ("gravity", "clock", "angle")
#: characters of a text
LONGEST = 300


@dataclass(frozen=True)
class Equipment:
    """One piece of equipment: name, identification, number of its certificate, date on which its calibration is due."""

    name: str
    identification: str = ""
    certificate: str = ""
    due: date | None = None


@dataclass(frozen=True)
class CertificateGiven:
    """The fields as they are given; empty, or None, where they are not."""

    laboratory: str = ""
    address: str = ""
    country: str = ""
    customer: str = ""
    customer_address: str = ""
    number: str = ""
    amends: str = ""
    item: str = ""
    manufacturer: str = ""
    condition: str = ""
    place: str = ""
    performed_at: str = ""
    operator: str = ""
    authorised_by: str = ""
    role: str = ""
    received: date | None = None
    calibrated: date | None = None
    issued: date | None = None
    valid_until: date | None = None
    next_calibration: date | None = None
    method: str = ""
    deviations: str = ""
    conditions: str = ""
    external: str = ""
    remarks: str = ""
    language: str = LANGUAGES[0]
    equipment: tuple[Equipment, ...] = field(default_factory=tuple)
    traceability: dict[str, str] = field(default_factory=dict)


class Line(Text):
    """Text that is not blank, on one line, and no longer than a page has room for."""

    expected = f"text on one line, of at most {LONGEST} characters"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        super().check(value, where)
        if not value.strip() or not value.isprintable() or len(value) > LONGEST:
            self.refuse(value, where)


class Country(Text):
    """Two capital letters (ISO 3166-1)."""

    expected = "two capital letters (ISO 3166-1)"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        super().check(value, where)
        if not (len(value) == 2 and value.isascii() and value.isalpha() and value.isupper()):
            self.refuse(value, where)


class Day(Shape):
    """A date of TOML, without a time."""

    expected = "a date without quotes, such as 2026-11-22"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, date) or isinstance(value, datetime):
            self.refuse(value, where)


_DAYS = ("received", "calibrated", "issued", "valid_until", "next_calibration")
#: every two of them, but for the last two, which have no order
_IN_ORDER = [pair for pair in combinations(_DAYS, 2) if pair != _DAYS[-2:]]
_OWN = {"country": Country(), "performed_at": Text(PERFORMED_AT), "language": Text(LANGUAGES)}
_LINES = [name for name in CertificateGiven.__dataclass_fields__ if name not in (*_DAYS, *_OWN, "equipment", "traceability")]


def out_of_order(days: Mapping[str, date | None]) -> tuple[str, str] | None:
    """The first two of these days, by their names, of which the later one is before the earlier; None where there are none."""
    for before, after in _IN_ORDER:
        first, second = days.get(before), days.get(after)
        if first is not None and second is not None and first > second:
            return before, after
    return None


class CertificateShape(Keys):
    """The section's shape, and that its dates are in order."""

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        super().check(value, where)
        if pair := out_of_order(value):
            before, after = pair
            raise Mismatch(f"{where}.{after} is {value[after]}, expected no day before {before}, {value[before]}")


SHAPE = CertificateShape(
    may=dict.fromkeys(_LINES, Line())
    | dict.fromkeys(_DAYS, Day())
    | _OWN
    | {
        "equipment": ListOf(Keys(must={"name": Line()}, may={"identification": Line(), "certificate": Line(), "due": Day()})),
        "traceability": Keys(may=dict.fromkeys(TRACED, Line())),
    }
)


def certificate_of(table: dict[str, Any]) -> CertificateGiven:
    """Of a section that was compared with its shape."""
    known = {key: value for key, value in table.items() if key in SHAPE.may}
    own = Equipment.__dataclass_fields__
    known["equipment"] = tuple(Equipment(**{k: v for k, v in row.items() if k in own}) for row in table.get("equipment", []))
    known["traceability"] = {key: value for key, value in table.get("traceability", {}).items() if key in TRACED}
    return CertificateGiven(**known)
