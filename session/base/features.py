"""Features: parts of the tool that the core does not know, a folder each in ``tinygc/features``.

A folder may be removed.  The core holds this one table of names: which module of which feature serves what.  It imports none of them;
``find`` and ``need`` import a module when its service is needed.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from session.base.errors import CalibrationError

#: what a feature serves, as messages name it -> its module
SERVICES = {
    "recordings of arrays": "tinygc.features.arrays.recording",
    "arrays out of one log": "tinygc.features.arrays.importing",
    "binary logs": "session.replay.binary.registry",
    "a lot as prior (--lot)": "tinygc.features.fleet.fit",
    "checks of arrays": "tinygc.features.arrays.checks",
    "a search beyond the catalogue (--discover)": "tinygc.features.discovery.engine",
    "reports of a discovery": "tinygc.features.discovery.report",
    "discoveries in a calibration report": "tinygc.features.discovery.report_section",
    "earlier discoveries": "tinygc.features.discovery.report_section",
    "calibrations over temperature": "tinygc.features.temperature.library",
    "commands on arrays": "tinygc.features.arrays.command",
    "calibrations of arrays": "tinygc.features.arrays.library",
    "lots and fleets": "tinygc.features.fleet.library",
    "turns of known angle": "tinygc.features.turns.importing",
    "known turns of a gyroscope alone": "tinygc.features.turns.library",
    "a gyroscope alone": "tinygc.features.turns.command",
    "rest logs and temperature": "tinygc.features.temperature.command",
    "models over temperature": "tinygc.features.temperature.model",
    "exports over temperature": "tinygc.features.temperature.deploy",
    "noise": "tinygc.features.noise.command",
    "noise figures": "tinygc.features.noise.library",
    "noise while a rest is recorded (record --rest)": "tinygc.features.noise.live",
    "table": "tinygc.features.tables.command",
    "sessions turned by a machine (--table)": "tinygc.features.tables.recording",
    "a virtual board on a virtual table (board --table)": "tinygc.features.tables.board",
    "the table's own errors": "tinygc.features.tables.explanation",
    "rates": "tinygc.features.tables.rates.command",
    "rates of a table": "tinygc.features.tables.rates.library",
    "rate steps recorded with a machine": "tinygc.features.tables.rates.recording",
    "verify": "tinygc.features.unit.verification.command",
    "verification of a calibration": "tinygc.features.unit.verification.library",
    "watch": "tinygc.features.unit.watch.command",
    "the watch of a calibration": "tinygc.features.unit.watch.library",
    "history": "tinygc.features.unit.history.command",
    "the history of a unit": "tinygc.features.unit.history.library",
    "the history of a unit in a calibration report": "tinygc.features.unit.history.report_section",
    "budget": "tinygc.features.unit.budget.command",
    "uncertainty budgets": "tinygc.features.unit.budget.library",
    "uncertainty by source in a calibration report": "tinygc.features.unit.budget.report_section",
    "certificates (report --certificate)": "tinygc.features.unit.certificate.library",
    "fleet": "tinygc.features.fleet.fleet_command",
    "lot": "tinygc.features.fleet.command",
    "challenge": "tinygc.features.challenge.command",
    "the proof of an effect": "tinygc.features.challenge.proofs",
}


class MissingFeatureError(CalibrationError):
    """The folder of a feature is not there."""


def find(service: str) -> ModuleType | None:
    """The module that serves it (a key of ``SERVICES``); None where its feature was removed."""
    name = SERVICES[service]
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        # A feature may stand on another one.  A package that is not installed is another matter.
        if error.name is None or (".features." not in error.name and not f"{name}.".startswith(f"{error.name}.")):
            raise
        return None


def is_present(service: str) -> bool:
    """Whether the folder of the feature that serves it is there; imports nothing of the feature."""
    spec = find_spec(".".join(SERVICES[service].split(".")[:3]))
    return spec is not None and spec.origin is not None  # a folder with nothing but a cache has no origin


def need(service: str, option: str = "") -> ModuleType:
    """The module that serves it.  Raises MissingFeatureError, in one line, where its feature was removed; option: that asked for it."""
    module = find(service)
    if module is None:
        package, _, feature = SERVICES[service].split(".")[:3]
        asked = f"{option}: {service}" if option else service
        raise MissingFeatureError(
            f"{asked}: served by the feature {feature}, which is not there ({package}/features/{feature}/); install the whole of TinyGC"
        )
    return module
