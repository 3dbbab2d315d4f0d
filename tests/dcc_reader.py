"""Reading a Digital Calibration Certificate apart from its writer, by the elements' local names."""

from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np

#: of one number, and of a list
EXPANDED = ("valueExpandedMU", "valueExpandedMUXMLList")
FACTORS, PROBABILITIES = ("coverageFactor", "coverageFactorXMLList"), ("coverageProbability", "coverageProbabilityXMLList")


def read(path):
    return parse(path.read_text(encoding="utf-8"))


def parse(text):
    """version, number, laboratory, customer, model, identifications, begin, end, quantity by its id."""
    root = ElementTree.fromstring(text)
    administrative = below(root, "administrativeData")
    core, item = below(administrative, "coreData"), below(administrative, "items", "item")
    results = [each for each in root.iter() if local(each) == "results"]
    quantities = [quantity(each) for part in results for each in outer(part) if real_of(each) is not None]
    return SimpleNamespace(
        version=root.get("schemaVersion"),
        number=words(core, "uniqueIdentifier"),
        laboratory=name_of(below(administrative, "calibrationLaboratory", "contact")),
        customer=name_of(below(administrative, "customer")),
        model=words(item, "model"),
        identifications=tuple(every(below(item, "identifications"), "value")),
        begin=words(core, "beginPerformanceDate"),
        end=words(core, "endPerformanceDate"),
        quantity={each.id: each for each in quantities}.__getitem__,
    )


def local(element):
    return element.tag.rpartition("}")[2]


def below(element, *names):
    for name in names:
        element = next((each for each in ([] if element is None else element) if local(each) == name), None)
    return element


def words(element, *names):
    found = below(element, *names)
    return "" if found is None else found.text.strip()


def every(element, *names):
    return [] if element is None else [each.text.strip() for each in element.iter() if local(each) in names]


def name_of(element):
    return words(element, "name", "content")


def outer(element):
    """Quantities of results, without those that stand inside another one's remarks."""
    for each in element:
        if local(each) == "quantity":
            yield each
        elif local(each) not in ("measurementMetaData", "influenceConditions", "usedMethods"):
            yield from outer(each)


def real_of(element):
    """Its number or list of numbers."""
    return next((each for each in element if local(each) in ("real", "realListXMLList")), None)


def quantity(element):
    """values in units, expanded, factor and probability: NaN where it is not stated; conformity; covariance, None where there is none."""
    real = real_of(element)
    values = numbers(real, "value", "valueXMLList")
    single = [each for each in real if local(each) != "measurementUncertaintyMultivariateXMLList"]  # it has a coverage of its own
    columns = [numbers(each, "valueXMLList") for each in real.iter() if local(each) == "covarianceXMLList"]
    expanded, factor, probability = (
        np.broadcast_to(next((found for each in single if len(found := numbers(each, *names))), np.nan), values.shape)
        for names in (EXPANDED, FACTORS, PROBABILITIES)
    )
    return SimpleNamespace(
        id=element.get("id"),
        **dict(values=values, expanded=expanded, factor=factor, probability=probability),
        conformity=tuple(" ".join(every(below(element, "measurementMetaData"), "conformity", "conformityXMLList")).split()),
        covariance=np.array(columns).T if columns else None,
    )


def numbers(element, *names):
    return np.array([float(word) for word in " ".join(every(element, *names)[:1]).split()])
