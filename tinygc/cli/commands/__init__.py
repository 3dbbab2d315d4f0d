"""The commands of ``calibrate.py``, one file each, in the order of ``--help``.

A command's file has a record ``Options`` (``session/base/options.py``, with what is shared in ``tinygc/cli/options.py``) and
``run(options)``, which returns the exit code.  It imports nothing heavy at its top, so that its ``--help`` is instant.  To add a command,
add a file and a line below: its name, its module, and what ``--help`` says of it.

Features have further commands, and options of these (``session/base/features.py``).
"""

from __future__ import annotations

import importlib
from types import ModuleType

from session.base import features

COMMANDS = {
    "demo": ("demo", "try the tool: write a simulated session, fit it, compare with its truth"),
    "sensors": ("sensors", "list the sensors that are known, or all that is known of one"),
    "board": ("board", "a virtual board: streams a session through a pseudo-terminal"),
    "record": ("record", "record a guided session from a serial port"),
    "import": (
        "import_",
        "make a session folder of any log: a logger's, a telephone's, a robot's, a flight controller's, or a port's raw bytes",
    ),
    "check": (
        "check",
        "a first look at a session: units, scales, rates, gaps, axes, stills; of a folder of sessions, a list of them",
    ),
    "fit": ("fit", "fit the calibration, compare the methods, print the closure errors"),
    "explain": ("explain", "say why the recording differs from the simulation, and prove it"),
    "report": ("report", "the calibration report: one HTML file that needs nothing else"),
    "apply": ("apply", "calibrate the rates and the specific force of a log"),
    "export": ("export", "write the calibration for other programs"),
    "simulate": ("simulate", "write a simulated session"),
}


def command_module(name: str) -> ModuleType | None:
    """Return the module of a command, of the core or of a feature; None of a word that is no command."""
    return importlib.import_module(f"{__name__}.{COMMANDS[name][0]}") if name in COMMANDS else features.named("commands", name)


def commands() -> dict[str, str]:
    """Return name -> summary of all commands, those of features last."""
    return {name: summary for name, (_, summary) in (COMMANDS | features.names("commands")).items()}
