"""The commands of ``calibrate.py``, one file each, in the order of ``--help``.

A command's file has ``SUMMARY`` (one line), a record ``Options`` (``session/base/options.py``, with what is shared in
``tinygc/cli/options.py``) and ``run(options)``, which returns the exit code.  It imports nothing heavy at its top, so that ``--help`` is
instant.  To add a command, add a file and its name below.

Features have further commands, and options of these (``session/base/features.py``).
"""

from __future__ import annotations

import importlib
from types import ModuleType

from session.base import features

COMMANDS = {
    "demo": "tinygc.cli.commands.demo",
    "sensors": "tinygc.cli.commands.sensors",
    "board": "tinygc.cli.commands.board",
    "record": "tinygc.cli.commands.record",
    "import": "tinygc.cli.commands.import_",
    "check": "tinygc.cli.commands.check",
    "fit": "tinygc.cli.commands.fit",
    "explain": "tinygc.cli.commands.explain",
    "report": "tinygc.cli.commands.report",
    "apply": "tinygc.cli.commands.apply",
    "export": "tinygc.cli.commands.export",
    "simulate": "tinygc.cli.commands.simulate",
}


def command_module(name: str) -> ModuleType | None:
    """Return the module of a command, of the core or of a feature; None of a word that is no command."""
    return importlib.import_module(COMMANDS[name]) if name in COMMANDS else features.named("commands", name)


def commands() -> list[str]:
    """Return the names of all commands, those of features last."""
    return [*COMMANDS, *features.names("commands")]
