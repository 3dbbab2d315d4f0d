"""Sections of a report, one file each.  Each has ``section(evidence)``, which returns a ``Section``, or None if the session has
nothing to show."""

from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

from session.base.features import find

#: the services of features that make a section; a section is omitted if its feature is
DISCOVERIES = "discoveries in a calibration report"
HISTORY = "the history of a unit in a calibration report"
SOURCES = "uncertainty by source in a calibration report"
#: module names in this folder, and those services
SECTIONS = (
    "answer",
    "front",
    "recording",
    "methods",
    "closure_per_segment",
    "attitudes_over_run",
    "parameters",
    "accelerometer",
    "correlations",
    SOURCES,
    "noise_at_rest",
    "denoising",
    "explanation",
    "explanation_by_truth",
    DISCOVERIES,
    HISTORY,
    "application",
    "provenance",
)


def modules() -> Iterator[ModuleType]:
    """Yield the module of each section, in the order of the page."""
    for name in SECTIONS:
        module = find(name) if name in (DISCOVERIES, HISTORY, SOURCES) else import_module(f"{__name__}.{name}")
        if module is not None:
            yield module
