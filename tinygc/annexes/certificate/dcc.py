"""Reading a Digital Calibration Certificate: its number, item, dates, and every quantity with its uncertainty, within bounds.

Any certificate of the schemas 2.4 to 3.3 is read for these; what else it holds is left alone.  The elements are looked for by their local
names.  Entities and declarations of a document type are refused, and so is what is too large, too deep or has too many elements.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from session.io.errors import FormatError
from session.io.files import MOST_JSON, read_text

MOST_ELEMENTS, DEEPEST = 200_000, 100
ROOT = "digitalCalibrationCertificate"
#: a value, its unit, U and k as they are called: of one number, of a list, and by earlier schemas
VALUES, UNITS = ("value", "valueXMLList"), ("unit", "unitXMLList")
EXPANDED = ("valueExpandedMU", "valueExpandedMUXMLList", "uncertainty", "uncertaintyXMLList")
FACTORS, PROBABILITIES = ("coverageFactor", "coverageFactorXMLList"), ("coverageProbability", "coverageProbabilityXMLList")
REALS = ("real", "realListXMLList")


@dataclass(frozen=True, eq=False)
class DccQuantity:
    """One quantity.

    id and ref_type as they stand there, or empty; name, in the language asked for; values (N,) in units; expanded (N,) in the same, NaN
    where it is not stated; factor, probability: of the coverage, NaN likewise; conformity: answers, as the schema calls them; covariance
    (N, N), None where there is none.
    """

    id: str
    ref_type: str
    name: str
    values: np.ndarray
    units: tuple[str, ...]
    expanded: np.ndarray
    factor: np.ndarray
    probability: np.ndarray
    conformity: tuple[str, ...] = ()
    covariance: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class DigitalCertificate:
    """version of the schema; number; laboratory, customer; model and identifications of the first item; begin, end: days of the calibration
    as written; quantities of the results; conformity: of the whole, as the schema calls it."""

    version: str
    number: str
    laboratory: str
    customer: str
    model: str
    identifications: tuple[str, ...]
    begin: str
    end: str
    quantities: tuple[DccQuantity, ...]
    conformity: tuple[str, ...]

    def quantity(self, name: str) -> DccQuantity:
        """The quantity of this id.  Raises KeyError."""
        return {each.id: each for each in self.quantities}[name]


def read(path: Path, language: str = "en") -> DigitalCertificate:
    """Read a certificate.  Raises FormatError, in one line, for what is none."""
    return parse(read_text(Path(path), MOST_JSON), str(path), language)


def parse(text: str, where: str, language: str = "en") -> DigitalCertificate:
    """Parse a certificate's text; where: begins the message of a FormatError."""
    root = _tree(text, where)
    if _local(root) != ROOT:
        raise FormatError(f"{where}: no Digital Calibration Certificate, its first element is {_local(root):.40}; expected {ROOT}")
    core, item = _below(root, "administrativeData", "coreData"), _below(root, "administrativeData", "items", "item")
    laboratory = _below(root, "administrativeData", "calibrationLaboratory", "contact")
    results = [each for each in root.iter() if _local(each) == "results"]
    wrong = f"{where}: broken certificate"
    try:
        quantities = tuple(_quantity(each, language) for part in results for each in _outer(part) if _holds_number(each))
    except ValueError as error:
        raise FormatError(f"{wrong}: {error!s:.80}; correct it there") from None
    number = _text(core, "uniqueIdentifier")
    if not number:
        raise FormatError(f"{wrong}: administrativeData.coreData.uniqueIdentifier is missing, expected its number; correct it there")
    statements = _below(root, "administrativeData", "statements")
    return DigitalCertificate(
        version=root.get("schemaVersion", ""),
        number=number,
        laboratory=_name(laboratory, language),
        customer=_name(_below(root, "administrativeData", "customer"), language),
        model=_text(item, "model"),
        identifications=tuple(_all(_below(item, "identifications"), "value")),
        begin=_text(core, "beginPerformanceDate"),
        end=_text(core, "endPerformanceDate"),
        quantities=quantities,
        conformity=tuple(_all(statements, "conformity")),
    )


def _tree(text: str, where: str) -> ElementTree.Element:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise FormatError(f"{where}: declares a document type or entities, which no certificate needs; remove the declaration")
    count, depth = 0, 0
    root: Any = None
    parser: ElementTree.XMLPullParser = ElementTree.XMLPullParser(("start", "end"))
    try:
        for begin in range(0, len(text), 1 << 16):
            parser.feed(text[begin : begin + (1 << 16)])
            for event, element in parser.read_events():  # type: ignore[misc]
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                count += event == "start"
                if count > MOST_ELEMENTS or depth > DEEPEST:
                    what = f"more than {MOST_ELEMENTS} elements" if count > MOST_ELEMENTS else f"elements more than {DEEPEST} deep"
                    raise FormatError(f"{where}: {what}, and no certificate has so many; is it the right file?")
        parser.close()
    except ElementTree.ParseError as error:
        raise FormatError(f"{where}: broken XML: {error}; correct it there") from None
    if root is None:
        raise FormatError(f"{where}: holds no element, expected {ROOT}")
    return root


# Elements by their local names.


def _local(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _below(element: ElementTree.Element | None, *names: str) -> ElementTree.Element | None:
    for name in names:
        if element is None:
            return None
        element = next((each for each in element if _local(each) == name), None)
    return element


def _text(element: ElementTree.Element | None, name: str) -> str:
    found = _below(element, name)
    return "" if found is None else (found.text or "").strip()


def _all(element: ElementTree.Element | None, name: str) -> list[str]:
    return [] if element is None else [(each.text or "").strip() for each in element.iter() if _local(each) == name]


def _name(element: ElementTree.Element | None, language: str) -> str:
    """The name in a language, else in the first there is."""
    said = [each for each in _below(element, "name") or () if _local(each) == "content"] if element is not None else []
    chosen = [each for each in said if each.get("lang", language) == language] or said
    return (chosen[0].text or "").strip() if chosen else ""


def _outer(element: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Quantities of results, without those that stand inside another one's remarks."""
    for each in element:
        if _local(each) == "quantity":
            yield each
        elif _local(each) not in ("measurementMetaData", "influenceConditions", "usedMethods"):
            yield from _outer(each)


# Quantities.


def _real_of(element: ElementTree.Element) -> ElementTree.Element | None:
    """Its number or list of numbers; of a hybrid one, in several units, the first."""
    for each in element:
        if _local(each) in REALS:
            return each
        if _local(each) == "hybrid":
            return _real_of(each)
    return None


def _holds_number(element: ElementTree.Element) -> bool:
    return _real_of(element) is not None


def _quantity(element: ElementTree.Element, language: str) -> DccQuantity:
    real = _real_of(element)
    assert real is not None  # by _holds_number
    values = _numbers(real, VALUES)
    count = len(values)
    single = ElementTree.Element("single")  # the region of all together has a coverage of its own
    single.extend(each for each in real if _local(each) != "measurementUncertaintyMultivariateXMLList")
    meta = _below(element, "measurementMetaData")
    answers = " ".join((*_all(meta, "conformity"), *_all(meta, "conformityXMLList"))).split()
    return DccQuantity(
        id=element.get("id", ""),
        ref_type=element.get("refType", ""),
        name=_name(element, language),
        values=values,
        units=tuple(_spread(_units(real), count)),
        expanded=_of_each(single, EXPANDED, count),
        factor=_of_each(single, FACTORS, count),
        probability=_of_each(single, PROBABILITIES, count),
        conformity=tuple(answers),
        covariance=_covariance(real, count),
    )


def _units(real: ElementTree.Element) -> list[str]:
    return next((text.split() for name in UNITS if (text := _text(real, name))), [""])


def _numbers(element: ElementTree.Element, names: tuple[str, ...]) -> np.ndarray:
    """(N,) numbers of the first element of one of these names.  Raises ValueError for what is none."""
    for each in element.iter():
        if _local(each) in names:
            return np.array([float(word) for word in (each.text or "").split()])
    return np.zeros(0)


def _of_each(element: ElementTree.Element, names: tuple[str, ...], count: int) -> np.ndarray:
    return np.array(_spread(_numbers(element, names).tolist() or [float("nan")], count))


def _spread(found: list, count: int) -> list:
    """One for each of N: a single one counts for all.  Raises ValueError for another number of them."""
    if len(found) not in (1, count):
        raise ValueError(f"{len(found)} entries beside {count} values")
    return found * count if len(found) == 1 else found


def _covariance(real: ElementTree.Element, count: int) -> np.ndarray | None:
    columns = [each for each in real.iter() if _local(each) == "covarianceXMLList"]
    if not columns:
        return None
    found = [_numbers(each, ("valueXMLList",)) for each in columns]
    if len(found) != count or any(len(column) != count for column in found):
        raise ValueError(f"a covariance that is not {count} x {count}")
    return np.array(found).T
