"""A certificate as Digital Calibration Certificate (PTB DCC 3.3.0, with D-SI 2.2.1), written with the standard library.

Values are in SI, in D-SI's syntax; each quantity has an ``id`` that names it, and a ``refType`` of the good practice where there is one.
The twelve parameters of ω = E m + B go along with their covariance.  What the schema requires and the session does not hold is asked for,
never made up: a draft has no DCC.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from scipy.special import gammaincinv

from session import VERSION
from session.base.errors import CalibrationError
from session.base.texts import printable
from session.log.config import Config
from session.log.requirements import GUARDED
from tinygc.features.unit.certificate.content import Content, missing_fields
from tinygc.features.unit.certificate.given import given_in
from tinygc.inference.decide import Conformity, Fact
from tinygc.inference.solve import COVERAGE
from tinygc.models.linear import NAMES, PARAMETERS

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
#: keys of session.toml that the schema requires besides those of the certificate -> what they are
REQUIRED = {"country": "two letters", "performed_at": "one of laboratory, customer, …"}


def dcc_text(content: Content) -> str:
    """The certificate as XML.  Raises CalibrationError, in one line, for a draft, and for what the schema requires and is not there."""
    if content.draft:
        raise CalibrationError(f"--dcc: a draft has no Digital Calibration Certificate; {'; '.join(content.draft)}")
    require_fields(content.config)
    for prefix, address in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        ElementTree.register_namespace(prefix, address)
    root = ElementTree.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": VERSION_OF_SCHEMA})
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} {DCC}/v{VERSION_OF_SCHEMA}/dcc.xsd")
    _administrative(_in(root, "administrativeData"), content)
    _measured(_in(_in(root, "measurementResults"), "measurementResult"), content)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def require_fields(config: Config) -> None:
    """Raises CalibrationError, in one line, for what a Digital Calibration Certificate needs of session.toml and is not there."""
    if missing := missing_fields(config):
        raise CalibrationError(f"--dcc: a draft has no Digital Calibration Certificate; not stated: {', '.join(missing)}")
    if absent := [f"certificate.{key} ({what})" for key, what in REQUIRED.items() if not getattr(given_in(config), key)]:
        raise CalibrationError(f"--dcc: session.toml lacks {', '.join(absent)}, which the schema requires; give it there")


# Elements: one inside another, with text; a text of the user's stays one line.


def _in(parent: ElementTree.Element, tag: str, text: str | None = None, namespace: str = DCC, **attributes: str) -> ElementTree.Element:
    made = ElementTree.SubElement(parent, f"{{{namespace}}}{tag}", attributes)
    if text is not None:
        made.text = printable(" ".join(text.split()))
    return made


def named(parent: ElementTree.Element, tag: str, *words: str, **attributes: str) -> ElementTree.Element:
    """An element of text in the certificate's language."""
    made = _in(parent, tag, **attributes)
    for each in words:
        _in(made, "content", each, lang="en")
    return made


# Administrative data.


def _administrative(parent: ElementTree.Element, c: Content) -> None:
    given = c.given
    software = _in(_in(parent, "dccSoftware"), "software")
    named(software, "name", "TinyGC")
    _in(software, "release", VERSION)
    _in(software, "type", "application")
    core = _in(parent, "coreData")
    _in(core, "countryCodeISO3166_1", given.country)
    _in(core, "usedLangCodeISO639_1", given.language)
    _in(core, "mandatoryLangCodeISO639_1", given.language)
    _in(core, "uniqueIdentifier", c.number)
    if given.received is not None:
        _in(core, "receiptDate", str(given.received))
    for tag in ("beginPerformanceDate", "endPerformanceDate"):
        _in(core, tag, str(c.calibrated))
    _in(core, "performanceLocation", given.performed_at)
    _in(core, "issueDate", str(given.issued))
    if given.amends:
        replaced = _in(core, "reportAmendedSubstituted")
        _in(replaced, "typeOfChange", "substituted")
        _in(replaced, "replacedUniqueIdentifier", given.amends)
    item = _in(_in(parent, "items"), "item")
    config = c.config
    named(item, "name", next(text for label, text, _ in c.item if label == "Object"))
    others = ("Object", "Manufacturer", "Model", "Serial number")
    named(item, "description", *(f"{label}: {text}" for label, text, _ in c.item if label not in others))
    if c.given.manufacturer:
        named(_in(item, "manufacturer"), "name", c.given.manufacturer)
    if config.model_given:
        _in(item, "model", config.sensor.model)
    known = _in(_in(item, "identifications"), "identification", refType="basic_serialNumber")
    _in(known, "issuer", "manufacturer")
    _in(known, "value", config.sensor.serial)
    named(known, "name", "Serial number")
    contact = _in(_in(parent, "calibrationLaboratory"), "contact")
    _contact(contact, given.laboratory, given.address, given.country)
    persons = _in(parent, "respPersons")
    _person(persons, given.authorised_by, given.role or "authorises the certificate", signs=True)
    if c.operator:
        _person(persons, c.operator, "operator")
    _contact(_in(parent, "customer"), given.customer, given.customer_address)
    _statements(_in(parent, "statements"), c)


def _contact(parent: ElementTree.Element, name: str, address: str, country: str = "") -> None:
    named(parent, "name", name)
    location = _in(parent, "location")
    if country:
        _in(location, "countryCode", country)
    named(location, "further", address)


def _person(parent: ElementTree.Element, name: str, role: str, signs: bool = False) -> None:
    person = _in(parent, "respPerson")
    named(_in(person, "person"), "name", name)
    _in(person, "role", role)
    if signs:
        _in(person, "mainSigner", "true")


def _statements(parent: ElementTree.Element, c: Content) -> None:
    for remark in c.remarks:
        named(_in(parent, "statement"), "declaration", remark)
    for label, text, _ in c.traceability:
        traced = _in(parent, "statement", refType="basic_traceability")
        named(traced, "name", f"Traceability: {label}")
        named(traced, "declaration", text)
    for day, words in ((c.given.valid_until, "Valid until"), (c.given.next_calibration, "Next calibration")):
        if day is not None:
            again = _in(parent, "statement", refType="basic_recalibration")
            named(again, "declaration", words)
            _in(again, "date", str(day))
    for reference, rule, _ in c.statements:
        conforms = _in(parent, "statement", refType="basic_conformity")
        _in(conforms, "norm", "ISO/IEC 17025:2017")
        _in(conforms, "reference", "7.8.6")
        named(conforms, "declaration", *([f"Limits: {reference}"] if reference else []), f"Decision rule: {rule}")


# Results.


def _measured(parent: ElementTree.Element, c: Content) -> None:
    named(parent, "name", "Errors of the sensor, calibration and closure")
    methods = _in(parent, "usedMethods")
    used = _in(methods, "usedMethod", refType="basic_calibrationMethod")
    named(used, "name", "Calibration by turns from rest to rest")
    named(used, "description", *c.method)
    _in(used, "reference", c.given.method)
    uncertain = _in(methods, "usedMethod", refType="basic_uncertainty")
    named(uncertain, "name", "Expanded uncertainty")
    named(uncertain, "description", *c.uncertainty)
    _in(uncertain, "norm", "JCGM 100:2008")
    if c.equipment:
        equipment = _in(parent, "measuringEquipments")
        for each in c.equipment:
            one = _in(equipment, "measuringEquipment", refType="basic_normalUsed")
            named(one, "name", each.name)
            if said := [f"{label}: {text}" for label, text in (("certificate", each.certificate), ("calibration due", each.due)) if text]:
                named(one, "description", *said)
            if each.identification:
                known = _in(_in(one, "identifications"), "identification")
                _in(known, "issuer", "calibrationLaboratory")
                _in(known, "value", each.identification)
    _conditions(parent, c)
    results = _in(parent, "results")
    _result(results, "Errors of the sensor, without correction", "", c.results, c.conformity)
    if c.as_found:
        _result(results, f"As found: errors of the output as {c.previous} corrects it", "found_", c.as_found)
    _closure(results, c)
    _model(results, c)


def _conditions(parent: ElementTree.Element, c: Content) -> None:
    conditions = ElementTree.Element(f"{{{DCC}}}influenceConditions")
    if c.temperature_c is not None:
        warm = _in(conditions, "influenceCondition", refType="basic_temperature")
        named(warm, "name", "Temperature of the sensor, by its own thermometer")
        data = _in(warm, "data")
        ends = zip(("basic_temperatureMin", "basic_temperatureMean", "basic_temperatureMax"), c.temperature_c, strict=True)
        for kind, value in ends:
            _real(_in(data, "quantity", refType=kind), value, r"\degreecelsius")
    for label, text, key in c.conditions:
        if key in ("certificate.conditions", "certificate.place", "site.latitude_deg"):
            condition = _in(conditions, "influenceCondition")
            named(condition, "name", label)
            named(_in(condition, "data"), "text", text)
    if len(conditions):
        parent.append(conditions)


def _result(parent: ElementTree.Element, words: str, prefix: str, facts: Sequence[Fact], conformity: Sequence[Conformity] = ()) -> None:
    result = _in(parent, "result")
    named(result, "name", words)
    data, answers = _in(result, "data"), {each.measured.key: each for each in conformity if each.measured.key}
    for each in facts:
        identifier = "_".join("".join(c if c.isascii() and c.isalnum() else " " for c in each.name).split())
        quantity = _quantity(data, prefix + identifier, each.name, each)
        if (found := answers.get(each.key)) is not None:
            _conforms(quantity, found)


def _quantity(parent: ElementTree.Element, name: str, words: str, each: Fact) -> ElementTree.Element:
    quantity = _in(parent, "quantity", id=name, refType="basic_measurementError")
    named(quantity, "name", words)
    if not each.observed or not np.isfinite(each.value):
        named(quantity, "noQuantity", "not observed")
        return quantity
    unit, size = UNITS[each.unit]
    _real(quantity, each.value * size, unit, each, size)
    return quantity


def _real(parent: ElementTree.Element, value: float, unit: str, measured: Fact | None = None, size: float = 1.0) -> None:
    """``si:real`` in SI, with the expanded uncertainty where it is known."""
    real = _in(parent, "real", namespace=SI)
    _in(real, "value", repr(float(value)), SI)
    _in(real, "unit", unit, SI)
    if measured is None or not (np.isfinite(measured.expanded) and measured.expanded > 0):
        return
    expanded = _in(_in(real, "measurementUncertaintyUnivariate", namespace=SI), "expandedMU", namespace=SI)
    _in(expanded, "valueExpandedMU", repr(float(measured.expanded * size)), SI)
    _in(expanded, "coverageFactor", f"{measured.factor:.6f}", SI)
    _in(expanded, "coverageProbability", f"{COVERAGE:g}", SI)
    _in(expanded, "distribution", "normal" if not np.isfinite(measured.freedom) else "t", SI)


def _conforms(quantity: ElementTree.Element, each: Conformity) -> None:
    """The statement of conformity of one quantity, with its limits; no answer where nothing was decided, but in a guard band."""
    one = _in(_in(quantity, "measurementMetaData"), "metaData", refType="basic_conformity")
    named(one, "declaration", each.risk_words)
    inside = each.limits[0] <= each.measured.value <= each.limits[1]
    banded = each.rule.kind == GUARDED and each.measured.observed and np.isfinite(each.measured.expanded)
    if each.answer in ANSWERS or banded:
        _in(one, "conformity", ANSWERS.get(each.answer, "conditionalPass" if inside else "conditionalFail"))
    data, (unit, size) = _in(one, "data"), UNITS[each.measured.unit]
    for side, limit, accepted in zip(("Lower", "Upper"), each.limits, each.acceptance, strict=True):
        if np.isfinite(limit):
            _real(_in(data, "quantity", refType=f"basic_toleranceLimit{side}"), limit * size, unit)
            _real(_in(data, "quantity", refType=f"basic_acceptanceLimit{side}"), accepted * size, unit)


def _closure(parent: ElementTree.Element, c: Content) -> None:
    result = _in(parent, "result")
    named(result, "name", "Closure with the calibration")
    data = _in(result, "data")
    answers = [each for each in c.conformity if each.measured.unit == "°"]  # the attitude after a minute has no row elsewhere
    for number, (each, floor) in enumerate(c.closure):
        name = "closure" if number == 0 else f"closure_run_{number}"
        quantity = _quantity(data, name, f"{each.name}; noise alone: {floor:.4f}°", each)
        if found := next((one for one in answers if one.measured.name == each.name), None):
            answers.remove(found)
            _conforms(quantity, found)
    for one in answers:
        _conforms(_quantity(data, one.measured.key, one.measured.name, one.measured), one)


def _model(parent: ElementTree.Element, c: Content) -> None:
    """E and B of ω = E m + B with their covariance: an ellipsoid of the twelve."""
    result = _in(parent, "result")
    named(result, "name", "Calibration: rate = E m + B, m the measured rate")
    quantity = _in(_in(result, "data"), "quantity", id="calibration")
    named(quantity, "name", "E row by row, then B")
    listed = _in(quantity, "realListXMLList", namespace=SI)
    units = [r"\one"] * 9 + [r"\radian\second\tothe{-1}"] * 3
    _in(listed, "labelXMLList", " ".join(NAMES[:PARAMETERS]), SI)
    _in(listed, "valueXMLList", " ".join(repr(float(value)) for value in c.model.vector), SI)
    _in(listed, "unitXMLList", " ".join(units), SI)
    region = _in(_in(listed, "measurementUncertaintyMultivariateXMLList", namespace=SI), "ellipsoidalRegionMUXMLList", namespace=SI)
    matrix = _in(region, "covarianceMatrixXMLList", namespace=SI)
    rate = r"\radian\second\tothe{-1}"
    square = {(False, False): r"\one", (True, True): r"\radian\tothe{2}\second\tothe{-2}"}
    for column in range(PARAMETERS):
        one = _in(_in(matrix, "columnXMLList", namespace=SI), "covarianceXMLList", namespace=SI)
        _in(one, "valueXMLList", " ".join(repr(float(value)) for value in c.covariance[:, column]), SI)
        _in(one, "unitXMLList", " ".join(square.get((row > 8, column > 8), rate) for row in range(PARAMETERS)), SI)
    _in(region, "coverageFactorXMLList", f"{np.sqrt(2 * gammaincinv(PARAMETERS / 2, COVERAGE)):.6f}", SI)
    _in(region, "coverageProbabilityXMLList", f"{COVERAGE:g}", SI)
    _in(region, "distributionXMLList", "normal", SI)
