"""The parts of a report, a file each, in their order.  Each has ``section(evidence)``, which gives a ``Section``, or None where the session
has nothing to show for it."""

from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

from session.io.annexes import SERVICES, find

#: files of this folder; or what an annex serves, whose section is left out where the annex is
SECTIONS = (
    "answer",
    "recording",
    "methods",
    "closure_per_segment",
    "attitudes_over_run",
    "parameters",
    "accelerometer",
    "correlations",
    "noise",
    "denoising",
    "explanation",
    "explanation_by_truth",
    "discoveries in a calibration report",
    "application",
    "provenance",
)


def modules() -> Iterator[ModuleType]:
    """The module of each section, in the order of the page."""
    for name in SECTIONS:
        module = find(name) if name in SERVICES else import_module(f"{__name__}.{name}")
        if module is not None:
            yield module
