"""The commands of ``calibrate.py``, one file each.

A command's file has a record ``Options`` (``session/base/options.py``, with what is shared in ``tinygc/cli/options.py``) and
``run(options)``, which returns the exit code.  It imports nothing heavy at its top, so that its ``--help`` is instant.  To add a command,
add a file and a line below.

Features have further commands, and options of these (``session/base/features.py``).
"""

from __future__ import annotations

import importlib
from types import ModuleType

from session.base import features

#: groups of commands, in the order of ``--help``
GROUPS = ("try", "bench", "result", "over time", "lab", "many")
#: name -> module, summary of at most 60 characters, group
COMMANDS = {
    "demo": ("demo", "a simulated session, fitted and compared with its truth", "try"),
    "simulate": ("simulate", "write a simulated session", "try"),
    "board": ("board", "a virtual board that streams a session", "try"),
    "record": ("record", "record a guided session from a serial port", "bench"),
    "import": ("import_", "make a session folder of any program's log", "bench"),
    "check": ("check", "whether a session can be fitted; list a folder's sessions", "bench"),
    "view": ("view", "look at a recording; leave out turns, move stills", "bench"),
    "sensors": ("sensors", "the known sensors, or all about one of them", "bench"),
    "fit": ("fit", "fit the calibration and test it on held-out turns", "result"),
    "explain": ("explain", "why the recording differs from the model", "result"),
    "report": ("report", "the calibration as one HTML page", "result"),
    "apply": ("apply", "calibrate the rates and the specific force of a log", "result"),
    "export": ("export", "write the calibration for other programs", "result"),
}


def command_module(name: str) -> ModuleType | None:
    """Return the module of a command, of the core or of a feature; None of a word that is no command."""
    return importlib.import_module(f"{__name__}.{COMMANDS[name][0]}") if name in COMMANDS else features.named("commands", name)


def commands() -> dict[str, str]:
    """Return name -> summary of all commands, in the order of ``--help``."""
    return {name: summary for group in grouped().values() for name, summary in group.items()}


def grouped() -> dict[str, dict[str, str]]:
    """Return group -> name -> summary; other people's features may have groups of their own, which are the last."""
    found: dict[str, dict[str, str]] = {group: {} for group in GROUPS}
    for name, (_, summary, group) in (COMMANDS | features.names("commands")).items():
        found.setdefault(group, {})[name] = summary
    return found
