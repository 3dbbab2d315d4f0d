"""``[certificate]`` of session.toml: what a calibration certificate states that no measurement shows (certificate.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date, datetime
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from session.base.results import Keys, Shape, Text

if TYPE_CHECKING:
    from session.log.config import Config

#: places of a Digital Calibration Certificate
PERFORMED_AT = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
LANGUAGES = ("en",)
#: what traceability is stated of
TRACED = ("gravity", "clock", "angle")
#: fields that a certificate must have -> what they are, in words
REQUIRED = {
    "laboratory": "name of the laboratory",
    "address": "address of the laboratory",
    "number": "number of the certificate",
    "customer": "name of the customer",
    "customer_address": "address of the customer",
    "place": "place of the calibration",
    "method": "reference of the procedure",
    "issued": "date of issue",
    "authorised_by": "who authorises it",
}
#: characters of a text
LONGEST = 300


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


Words = Annotated[str, Line()]
Date = Annotated[date | None, Day()]
_DAYS = ("received", "calibrated", "issued", "valid_until", "next_calibration")
#: every two of them, but for the last two, which have no order
_IN_ORDER = [pair for pair in combinations(_DAYS, 2) if pair != _DAYS[-2:]]


def out_of_order(days: Mapping[str, date | None]) -> tuple[str, str] | None:
    """The first two of these days, by their names, of which the later one is before the earlier; None where there are none."""
    for before, after in _IN_ORDER:
        first, second = days.get(before), days.get(after)
        if first is not None and second is not None and first > second:
            return before, after
    return None


@dataclass(frozen=True)
class Equipment:
    """One piece of equipment: name, identification, number of its certificate, date on which its calibration is due."""

    name: Words
    identification: Words = ""
    certificate: Words = ""
    due: Date = None


@dataclass(frozen=True)
class CertificateGiven:
    """The fields as they are given; empty, or None, where they are not."""

    section: ClassVar[str] = "certificate"
    #: name
    laboratory: Words = ""
    #: its address
    address: Words = ""
    #: required by the DCC
    country: Annotated[str, Country()] = ""
    #: name of the customer
    customer: Words = ""
    #: address of the customer
    customer_address: Words = ""
    #: of the certificate, unique
    number: Words = ""
    #: number of the certificate that this one replaces
    amends: Words = ""
    #: what the item is
    item: Words = ""
    #: who made it
    manufacturer: Words = ""
    #: the condition in which it came
    condition: Words = ""
    #: where it was calibrated
    place: Words = ""
    #: required by the DCC
    performed_at: Annotated[str, Text(PERFORMED_AT)] = ""
    #: who calibrated; `notes.operator` without it
    operator: Words = ""
    #: who authorises the certificate
    authorised_by: Words = ""
    #: as what
    role: Words = ""
    #: when the item came; the order of dates is checked
    received: Date = None
    #: when it was calibrated; else the day of the recording
    calibrated: Date = None
    #: when it is issued
    issued: Date = None
    #: only as agreed with the customer
    valid_until: Date = None
    #: likewise
    next_calibration: Date = None
    #: the laboratory's procedure
    method: Words = ""
    #: what deviated from it
    deviations: Words = ""
    #: air temperature, humidity, …
    conditions: Words = ""
    #: results of external providers
    external: Words = ""
    #: anything else
    remarks: Words = ""
    #: of the certificate
    language: Annotated[str, Text(LANGUAGES)] = LANGUAGES[0]
    #: `[[certificate.equipment]]`: `name`, and `identification`, `certificate` (its number), `due` (a date)
    equipment: tuple[Equipment, ...] = ()
    #: `[certificate.traceability]`: `gravity`, `clock`, `angle`: how each is traceable, a line of text
    traceability: Annotated[Mapping[str, str], Keys(may=dict.fromkeys(TRACED, Line()))] = field(default_factory=dict)

    @staticmethod
    def fault(table: Mapping[str, Any]) -> str:
        """What is wrong with the order of the section's dates."""
        if pair := out_of_order(table):
            before, after = pair
            return f"{after} is {table[after]}, expected no day before {before}, {table[before]}"
        return ""


def given_in(config: Config) -> CertificateGiven:
    """What a session's configuration states for a certificate."""
    found: CertificateGiven = config.sections.get(CertificateGiven.section, CertificateGiven())
    return found


def missing_fields(config: Config) -> list[str]:
    """Keys of session.toml that a certificate must have, whatever was recorded, and that are not there."""
    given = given_in(config)
    missing = [f"certificate.{key}" for key in REQUIRED if not getattr(given, key)]
    missing += [] if config.sensor.serial else ["sensor.serial"]
    missing += [] if config.model_given else ["sensor.model"]
    return missing + [f"certificate.traceability.{key}" for key in TRACED if key not in given.traceability]
