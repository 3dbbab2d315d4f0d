"""Annexes: parts of the tool that the core does not know, a folder each in ``session/annexes`` or ``tinygc/annexes``.

A folder may be removed.  The core holds this one table of names: which module of which annex serves what.  It imports none of them;
``find`` and ``need`` import a module when its service is needed.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from session.io.errors import CalibrationError

#: what an annex serves, as messages name it -> its module
SERVICES = {
    "recordings of arrays": "session.annexes.arrays.recording",
    "arrays out of one log": "session.annexes.arrays.importing",
    "binary logs": "session.annexes.logs.registry",
    "a lot as prior (--lot)": "tinygc.annexes.lots.fit",
    "checks of arrays": "tinygc.annexes.arrays.checks",
    "a search beyond the catalogue (--discover)": "tinygc.annexes.discovery.engine",
    "reports of a discovery": "tinygc.annexes.discovery.report",
    "discoveries in a calibration report": "tinygc.annexes.discovery.report_section",
    "earlier discoveries": "tinygc.annexes.discovery.report_section",
    "calibrations over temperature": "tinygc.annexes.temperature.library",
    "commands on arrays": "tinygc.annexes.arrays.command",
    "calibrations of arrays": "tinygc.annexes.arrays.library",
    "lots and fleets": "tinygc.annexes.lots.library",
    "turns of known angle": "session.annexes.turntable.importing",
    "known turns of a gyroscope alone": "tinygc.annexes.turntable.library",
    "a gyroscope alone": "tinygc.annexes.turntable.command",
    "rest logs and temperature": "tinygc.annexes.temperature.command",
    "models over temperature": "tinygc.annexes.temperature.model",
    "exports over temperature": "tinygc.annexes.temperature.deploy",
    "noise": "tinygc.annexes.noise.command",
    "noise figures": "tinygc.annexes.noise.library",
    "noise while a rest is recorded (record --rest)": "tinygc.annexes.noise.live",
    "table": "tinygc.annexes.machines.command",
    "sessions turned by a machine (--table)": "tinygc.annexes.machines.recording",
    "a virtual board on a virtual table (board --table)": "tinygc.annexes.machines.board",
    "the table's own errors": "tinygc.annexes.machines.explanation",
    "rates": "tinygc.annexes.rates.command",
    "rates of a table": "tinygc.annexes.rates.library",
    "rate steps recorded with a machine": "tinygc.annexes.rates.recording",
    "verify": "tinygc.annexes.verification.command",
    "verification of a calibration": "tinygc.annexes.verification.library",
    "watch": "tinygc.annexes.watch.command",
    "the watch of a calibration": "tinygc.annexes.watch.library",
    "history": "tinygc.annexes.history.command",
    "the history of a unit": "tinygc.annexes.history.library",
    "the history of a unit in a calibration report": "tinygc.annexes.history.report_section",
    "budget": "tinygc.annexes.budget.command",
    "uncertainty budgets": "tinygc.annexes.budget.library",
    "uncertainty by source in a calibration report": "tinygc.annexes.budget.report_section",
    "certificates (report --certificate)": "tinygc.annexes.certificate.library",
    "fleet": "tinygc.annexes.lots.fleet_command",
    "lot": "tinygc.annexes.lots.command",
    "challenge": "tinygc.annexes.challenge.command",
    "the proof of an effect": "tinygc.annexes.challenge.proofs",
}


class MissingAnnexError(CalibrationError):
    """The folder of an annex is not there."""


def find(service: str) -> ModuleType | None:
    """The module that serves it (a key of ``SERVICES``); None where its annex was removed."""
    name = SERVICES[service]
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        # An annex may stand on another one.  A package that is not installed is another matter.
        if error.name is None or (".annexes." not in error.name and not f"{name}.".startswith(f"{error.name}.")):
            raise
        return None


def is_present(service: str) -> bool:
    """Whether the folder of the annex that serves it is there; imports nothing of the annex."""
    spec = find_spec(".".join(SERVICES[service].split(".")[:3]))
    return spec is not None and spec.origin is not None  # a folder with nothing but a cache has no origin


def need(service: str, option: str = "") -> ModuleType:
    """The module that serves it.  Raises MissingAnnexError, in one line, where its annex was removed; option: that asked for it."""
    module = find(service)
    if module is None:
        package, _, annex = SERVICES[service].split(".")[:3]
        asked = f"{option}: {service}" if option else service
        raise MissingAnnexError(
            f"{asked}: served by the annex {annex}, which is not there ({package}/annexes/{annex}/); install the whole of TinyGC"
        )
    return module
