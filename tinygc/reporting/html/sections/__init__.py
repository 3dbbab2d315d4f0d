"""Sections of a report, one file each.  Each has ``section(evidence)``, which returns a ``Section``, or None if the session has
nothing to show."""

from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

from session.io.annexes import find

<<<<<<< HEAD
#: the services of annexes that make a section; the section is omitted if the annex is
DISCOVERIES = "discoveries in a calibration report"
HISTORY = "the history of a unit in a calibration report"
#: module names in this folder, and those services
=======
#: the services of annexes that make a section; a section is omitted if its annex is
DISCOVERIES, SOURCES = "discoveries in a calibration report", "uncertainty by source in a calibration report"
#: module names in this folder, and these services
>>>>>>> fb114d0753f3c056f6529119e6f701f5a36f3020
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
<<<<<<< HEAD
        module = find(name) if name in (DISCOVERIES, HISTORY) else import_module(f"{__name__}.{name}")
=======
        module = find(name) if name in (DISCOVERIES, SOURCES) else import_module(f"{__name__}.{name}")
>>>>>>> fb114d0753f3c056f6529119e6f701f5a36f3020
        if module is not None:
            yield module
