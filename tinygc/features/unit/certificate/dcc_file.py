"""A certificate as Digital Calibration Certificate (PTB DCC 3.3.0, with D-SI 2.2.1), written with the standard library.

Values are in SI, in D-SI's syntax; each quantity has an ``id`` that names it, and a ``refType`` of the good practice where there is one.
The twelve parameters of ω = E m + B go along with their covariance.  What the schema requires and the session does not hold is required,
never made up: a draft has no DCC.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.special import gammaincinv

from session import VERSION
from session.base.errors import CalibrationError
from session.base.texts import printable
from session.log.config import Config
from session.log.requirements import GUARDED
from tinygc.features.unit.certificate.given import Equipment, given_in, missing_fields
from tinygc.inference.decide import Conformity, Fact
from tinygc.inference.solve import COVERAGE
from tinygc.models.linear import NAMES, PARAMETERS

#: of ``content.py``, which imports this file
Certificate = Any
DCC, SI, XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
VERSION_OF_SCHEMA = "3.3.0"
#: unit in which a value is measured here -> unit of D-SI, and what one is in it
UNITS = {
    "ppm": (r"\one", 1e-6),
    "mrad": (r"\radian", 1e-3),
    "°": (r"\radian", np.pi / 180),
    "mdps": (r"\radian\second\tothe{-1}", 1e-3 * np.pi / 180),
    "mg": (r"\metre\second\tothe{-2}", 1e-3 * 9.80665),
    "dps/g": (r"\radian\second\metre\tothe{-1}", np.pi / 180 / 9.80665),
    "°/√h": (r"\radian\second\tothe{-0.5}", np.pi / 180 / 60),
    "°/h": (r"\radian\second\tothe{-1}", np.pi / 180 / 3600),
}
#: answers of the decision rules as the schema has them; what lies in a guard band is a conditional pass or fail (ILAC-G8:09)
ANSWERS = {"pass": "pass", "fail": "fail"}
#: keys of session.toml that the schema requires as well as those of the certificate -> what they are
REQUIRED = {"country": "two letters", "performed_at": "one of laboratory, customer, …"}


def dcc_text(content: Certificate) -> str:
    """The certificate as XML.  Raises CalibrationError, in one line, for a draft, and for what the schema requires and is not there."""
    if content.draft:
        raise CalibrationError(f"--dcc: a draft has no Digital Calibration Certificate; {'; '.join(content.draft)}")
    require_fields(content.config)
    for prefix, address in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        ElementTree.register_namespace(prefix, address)
    root = e("digitalCalibrationCertificate", _administrative(content), e("measurementResults", _measured(content)))
    root.set("schemaVersion", VERSION_OF_SCHEMA)
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} {DCC}/v{VERSION_OF_SCHEMA}/dcc.xsd")
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def require_fields(config: Config) -> None:
    """Raises CalibrationError, in one line, for what a Digital Calibration Certificate needs of session.toml and is not there."""
    if missing := missing_fields(config):
        raise CalibrationError(f"--dcc: a draft has no Digital Calibration Certificate; not stated: {', '.join(missing)}")
    if absent := [f"certificate.{key} ({what})" for key, what in REQUIRED.items() if not getattr(given_in(config), key)]:
        raise CalibrationError(f"--dcc: session.toml has no {', '.join(absent)}, which the schema requires; give it there")


# Elements: each with its text, which stays one line where it is a user's, or with others inside.


def e(tag: str, *inside: str | ElementTree.Element, namespace: str = DCC, **attributes: str) -> ElementTree.Element:
    """An element with text, or with elements."""
    made = ElementTree.Element(f"{{{namespace}}}{tag}", attributes)
    for each in inside:
        if isinstance(each, str):
            made.text = printable(" ".join(each.split()))
        else:
            made.append(each)
    return made


def si(tag: str, *inside: str | ElementTree.Element) -> ElementTree.Element:
    """An element of D-SI."""
    return e(tag, *inside, namespace=SI)


def named(tag: str, *words: str, **attributes: str) -> ElementTree.Element:
    """An element of text in the certificate's language."""
    return e(tag, *(e("content", each, lang="en") for each in words), **attributes)


def some(tag: str, text: object) -> list[ElementTree.Element]:
    """An element that is there where its text is."""
    return [e(tag, str(text))] if text else []


# Administrative data.


def _administrative(c: Certificate) -> ElementTree.Element:
    given, config = c.given, c.config
    replaced = e("reportAmendedSubstituted", e("typeOfChange", "substituted"), e("replacedUniqueIdentifier", given.amends))
    core = e(
        "coreData",
        e("countryCodeISO3166_1", given.country),
        e("usedLangCodeISO639_1", given.language),
        e("mandatoryLangCodeISO639_1", given.language),
        e("uniqueIdentifier", c.number),
        *some("receiptDate", given.received),
        e("beginPerformanceDate", str(c.calibrated)),
        e("endPerformanceDate", str(c.calibrated)),
        e("performanceLocation", given.performed_at),
        e("issueDate", str(given.issued)),
        *([replaced] if given.amends else []),
    )
    others = ("Object", "Manufacturer", "Model", "Serial number")
    serial = e("issuer", "manufacturer"), e("value", config.sensor.serial), named("name", "Serial number")
    item = e(
        "item",
        named("name", next(text for label, text, _ in c.item if label == "Object")),
        named("description", *(f"{label}: {text}" for label, text, _ in c.item if label not in others)),
        *([e("manufacturer", named("name", given.manufacturer))] if given.manufacturer else []),
        *([e("model", config.sensor.model)] if config.model_given else []),
        e("identifications", e("identification", *serial, refType="basic_serialNumber")),
    )
    persons = [_person(given.authorised_by, given.role or "authorises the certificate", e("mainSigner", "true"))]
    return e(
        "administrativeData",
        e("dccSoftware", e("software", named("name", "TinyGC"), e("release", VERSION), e("type", "application"))),
        core,
        e("items", item),
        e("calibrationLaboratory", e("contact", *_contact(given.laboratory, given.address, given.country))),
        e("respPersons", *persons, *([_person(c.operator, "operator")] if c.operator else [])),
        e("customer", *_contact(given.customer, given.customer_address)),
        e("statements", *_statements(c)),
    )


def _contact(name: str, address: str, country: str = "") -> tuple[ElementTree.Element, ...]:
    return named("name", name), e("location", *some("countryCode", country), named("further", address))


def _person(name: str, role: str, *signs: ElementTree.Element) -> ElementTree.Element:
    return e("respPerson", e("person", named("name", name)), e("role", role), *signs)


def _statements(c: Certificate) -> Iterator[ElementTree.Element]:
    for remark in c.remarks:
        yield e("statement", named("declaration", remark))
    for label, text, _ in c.traceability:
        yield e("statement", named("name", f"Traceability: {label}"), named("declaration", text), refType="basic_traceability")
    for day, words in ((c.given.valid_until, "Valid until"), (c.given.next_calibration, "Next calibration")):
        if day is not None:
            yield e("statement", named("declaration", words), e("date", str(day)), refType="basic_recalibration")
    for reference, rule, _ in c.statements:
        declared = named("declaration", *([f"Limits: {reference}"] if reference else []), f"Decision rule: {rule}")
        yield e("statement", e("norm", "ISO/IEC 17025:2017"), e("reference", "7.8.6"), declared, refType="basic_conformity")


# Results.


def _measured(c: Certificate) -> ElementTree.Element:
    turns = named("name", "Calibration by turns from rest to rest"), named("description", *c.method), e("reference", c.given.method)
    uncertain = named("name", "Expanded uncertainty"), named("description", *c.uncertainty), e("norm", "JCGM 100:2008")
    used = e("usedMethod", *turns, refType="basic_calibrationMethod"), e("usedMethod", *uncertain, refType="basic_uncertainty")
    conforms = [each for *_, of in c.statements for each in of]
    equipment, conditions = [_equipment(each) for each in c.equipment], list(_conditions(c))
    results = [_result("Errors of the sensor, without correction", _facts(c.results, "", conforms))]
    if c.as_found:
        results.append(_result(f"As found: errors of the output as {c.previous} corrects it", _facts(c.as_found, "found_")))
    return e(
        "measurementResult",
        named("name", "Errors of the sensor, calibration and closure"),
        e("usedMethods", *used),
        *([e("measuringEquipments", *equipment)] if equipment else []),
        *([e("influenceConditions", *conditions)] if conditions else []),
        e("results", *results, _result("Closure with the calibration", _closure(c, conforms)), _model(c)),
    )


def _equipment(each: Equipment) -> ElementTree.Element:
    notes = [f"{label}: {text}" for label, text in (("certificate", each.certificate), ("calibration due", each.due)) if text]
    known = e("identification", e("issuer", "calibrationLaboratory"), e("value", each.identification))
    more = [named("description", *notes)] if notes else []
    more += [e("identifications", known)] if each.identification else []
    return e("measuringEquipment", named("name", each.name), *more, refType="basic_normalUsed")


def _conditions(c: Certificate) -> Iterator[ElementTree.Element]:
    if c.temperature_c is not None:
        ends = zip(("basic_temperatureMin", "basic_temperatureMean", "basic_temperatureMax"), c.temperature_c, strict=True)
        data = e("data", *(e("quantity", _real(value, r"\degreecelsius"), refType=kind) for kind, value in ends))
        declared = named("name", "Temperature of the sensor, by its own thermometer")
        yield e("influenceCondition", declared, data, refType="basic_temperature")
    for label, text, key in c.conditions:
        if key in ("certificate.conditions", "certificate.place", "site.latitude_deg"):
            yield e("influenceCondition", named("name", label), e("data", named("text", text)))


def _result(words: str, quantities: Iterable[ElementTree.Element]) -> ElementTree.Element:
    return e("result", named("name", words), e("data", *quantities))


def _facts(facts: Sequence[Fact], prefix: str, conformity: Sequence[Conformity] = ()) -> Iterator[ElementTree.Element]:
    answers = {each.measured.key: each for each in conformity if each.measured.key}
    for each in facts:
        identifier = "_".join("".join(c if c.isascii() and c.isalnum() else " " for c in each.name).split())
        yield _quantity(prefix + identifier, each.name, each, answers.get(each.key))


def _quantity(name: str, words: str, each: Fact, conforms: Conformity | None = None) -> ElementTree.Element:
    value = named("noQuantity", "not observed")
    if each.observed and np.isfinite(each.value):
        unit, size = UNITS[each.unit]
        value = _real(each.value * size, unit, each, size)
    more = [] if conforms is None else [e("measurementMetaData", _conforms(conforms))]
    return e("quantity", named("name", words), value, *more, id=name, refType="basic_measurementError")


def _real(value: float, unit: str, measured: Fact | None = None, size: float = 1.0) -> ElementTree.Element:
    """``si:real`` in SI, with the expanded uncertainty where it is known."""
    real = si("real", si("value", repr(float(value))), si("unit", unit))
    if measured is not None and np.isfinite(measured.expanded) and measured.expanded > 0:
        expanded = si(
            "expandedMU",
            si("valueExpandedMU", repr(float(measured.expanded * size))),
            si("coverageFactor", f"{measured.factor:.6f}"),
            si("coverageProbability", f"{COVERAGE:g}"),
            si("distribution", "normal" if not np.isfinite(measured.freedom) else "t"),
        )
        real.append(si("measurementUncertaintyUnivariate", expanded))
    return real


def _conforms(each: Conformity) -> ElementTree.Element:
    """The statement of conformity of one quantity, with its limits; no answer where nothing was decided, but in a guard band."""
    inside = each.limits[0] <= each.measured.value <= each.limits[1]
    banded = each.rule.kind == GUARDED and each.measured.observed and np.isfinite(each.measured.expanded)
    answer = ANSWERS.get(each.answer, ("conditionalPass" if inside else "conditionalFail") if banded else "")
    (unit, size), limits = UNITS[each.measured.unit], []
    for side, limit, accepted in zip(("Lower", "Upper"), each.limits, each.acceptance, strict=True):
        if np.isfinite(limit):
            limits.append(e("quantity", _real(limit * size, unit), refType=f"basic_toleranceLimit{side}"))
            limits.append(e("quantity", _real(accepted * size, unit), refType=f"basic_acceptanceLimit{side}"))
    declared = named("declaration", each.risk_words)
    return e("metaData", declared, *some("conformity", answer), e("data", *limits), refType="basic_conformity")


def _closure(c: Certificate, conforms: Sequence[Conformity]) -> Iterator[ElementTree.Element]:
    answers = {each.measured.name: each for each in conforms if each.measured.unit == "°"}
    for number, (each, floor) in enumerate(c.closure):
        name = "closure" if number == 0 else f"closure_run_{number}"
        yield _quantity(name, f"{each.name}; noise alone: {floor:.4f}°", each, answers.pop(each.name, None))
    for one in answers.values():  # the attitude after a minute has no row elsewhere
        yield _quantity(one.measured.key, one.measured.name, one.measured, one)


def _model(c: Certificate) -> ElementTree.Element:
    """E and B of ω = E m + B with their covariance: an ellipsoid of the twelve."""
    rate = r"\radian\second\tothe{-1}"
    square = {(False, False): r"\one", (True, True): r"\radian\tothe{2}\second\tothe{-2}"}
    columns = []
    for column in range(PARAMETERS):
        units = " ".join(square.get((row > 8, column > 8), rate) for row in range(PARAMETERS))
        values = " ".join(repr(float(value)) for value in c.covariance[:, column])
        columns.append(si("columnXMLList", si("covarianceXMLList", si("valueXMLList", values), si("unitXMLList", units))))
    region = si(
        "ellipsoidalRegionMUXMLList",
        si("covarianceMatrixXMLList", *columns),
        si("coverageFactorXMLList", f"{np.sqrt(2 * gammaincinv(PARAMETERS / 2, COVERAGE)):.6f}"),
        si("coverageProbabilityXMLList", f"{COVERAGE:g}"),
        si("distributionXMLList", "normal"),
    )
    listed = si(
        "realListXMLList",
        si("labelXMLList", " ".join(NAMES[:PARAMETERS])),
        si("valueXMLList", " ".join(repr(float(value)) for value in c.model.vector)),
        si("unitXMLList", " ".join([r"\one"] * 9 + [rate] * 3)),
        si("measurementUncertaintyMultivariateXMLList", region),
    )
    quantity = e("quantity", named("name", "E row by row, then B"), listed, id="calibration")
    return _result("Calibration: rate = E m + B, m the measured rate", [quantity])
