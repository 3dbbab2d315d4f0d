"""Sections of a report, one file each.  Each has ``section(evidence)``, which returns a ``Section``, or None if the session has
nothing to show.  Those of features stand behind one of these, which their ``BEHIND`` names."""

from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

from session.base import features

#: module names in this folder
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
    "noise_at_rest",
    "denoising",
    "explanation",
    "application",
    "provenance",
)


def modules() -> Iterator[ModuleType]:
    """Yield the module of each section, in the order of the page."""
    more = list(features.each("report section"))
    for name in SECTIONS:
        yield import_module(f"{__name__}.{name}")
        yield from (module for module in more if name == module.BEHIND)
