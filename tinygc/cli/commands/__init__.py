"""The commands of ``calibrate.py``, one file each, in the order of ``--help``.

A command's file has ``SUMMARY`` (one line), ``add_arguments(command)`` and ``run(args)``, which returns the exit code.  It imports
nothing heavy at its top, so that ``--help`` is instant.  ``USES_EFFECTS = True`` adds ``--effects DIR``; ``DEFAULTS`` lists the
arguments that a user's defaults file may fill in (``tinygc/cli/defaults.py``).  To add a command, add a file and its name
below.

A command of a feature is listed by its name in ``session/base/features.py``; ``tinygc/cli/extensions.py`` has the extensions of core
commands by features.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from types import ModuleType

from session.base.features import SERVICES, find, need

COMMANDS = {
    "demo": "tinygc.cli.commands.demo",
    "sensors": "tinygc.cli.commands.sensors",
    "ports": "tinygc.cli.commands.ports",
    "board": "tinygc.cli.commands.board",
    "record": "tinygc.cli.commands.record",
    "import": "tinygc.cli.commands.import_",
    "list": "tinygc.cli.commands.list",
    "check": "tinygc.cli.commands.check",
    "accelerometer": "tinygc.cli.commands.accelerometer",
    "noise": SERVICES["noise"],
    "table": SERVICES["table"],
    "rates": SERVICES["rates"],
    "fit": "tinygc.cli.commands.fit",
    "explain": "tinygc.cli.commands.explain",
    "report": "tinygc.cli.commands.report",
    "plan": "tinygc.cli.commands.plan",
    "apply": "tinygc.cli.commands.apply",
    "export": "tinygc.cli.commands.export",
    "compare": "tinygc.cli.commands.compare",
    "verify": SERVICES["verify"],
    "watch": SERVICES["watch"],
    "history": SERVICES["history"],
    "budget": SERVICES["budget"],
    "fleet": SERVICES["fleet"],
    "lot": SERVICES["lot"],
    "challenge": SERVICES["challenge"],
    "simulate": "tinygc.cli.commands.simulate",
    "completion": "tinygc.cli.commands.completion",
}


def command_module(name: str) -> ModuleType:
    """Return the module of a command.  Raises MissingFeatureError where its feature is not installed."""
    return need(name) if name in SERVICES else importlib.import_module(COMMANDS[name])


def present_commands() -> Iterator[str]:
    """Yield the commands, except those of features that are not installed."""
    return (name for name in COMMANDS if name not in SERVICES or find(name) is not None)
