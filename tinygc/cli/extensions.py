"""What annexes add to commands of the core: options, and jobs that they take.

An annex' module has ``add_NAME_arguments(command)`` for each command that it extends.  Where the annex is not there, the options that ask
for it say so.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from types import ModuleType

from session.io.annexes import find, need

#: command -> service of an annex that extends it -> options that say, where the annex is not there, that they need it
EXTENSIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "board": {"the emulated board": ("--firmware",)},
    "fit": {"rest logs and temperature": ("--temperature", "--temperature-order")},
    "simulate": {"rest logs and temperature": ("--rest-cycles",), "commands on arrays": ("--units",)},
}


def extensions(name: str) -> Iterator[ModuleType]:
    """The modules of the annexes that extend a command and are there."""
    return (module for service in EXTENSIONS.get(name, ()) if (module := find(service)) is not None)


def add_annex_arguments(name: str, command: argparse.ArgumentParser) -> None:
    """The options that annexes add to a command, by the function ``add_NAME_arguments`` of their modules."""
    for service, options in EXTENSIONS.get(name, {}).items():
        module = find(service)
        if module is not None:
            getattr(module, f"add_{name}_arguments")(command)
            continue
        for option in options:
            command.add_argument(option, action=_MissingOption, const=service, nargs="?", help=argparse.SUPPRESS)


class _MissingOption(argparse.Action):
    """An option of an annex that is not there; ``const`` is what it asks of the registry."""

    def __call__(self, *_: object) -> None:
        need(str(self.const))
