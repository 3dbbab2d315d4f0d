"""Extensions of core commands by features: options, and the work behind them.

A feature module has ``add_NAME_arguments(command)`` for each command that it extends.  Where the feature is not installed, its options
report that it is missing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from types import ModuleType

from session.base.features import find, is_present, need

#: command -> service of a feature that extends it -> options that report a missing feature
EXTENSIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "fit": {"rest logs and temperature": ("--temperature", "--temperature-order")},
    "simulate": {"rest logs and temperature": ("--rest-cycles",), "commands on arrays": ("--units",)},
}


def extensions(name: str) -> Iterator[ModuleType]:
    """Return the modules of installed features that extend a command."""
    return (module for service in EXTENSIONS.get(name, ()) if (module := find(service)) is not None)


def add_feature_arguments(name: str, command: argparse.ArgumentParser) -> None:
    """Add the options of features to a command, by the function ``add_NAME_arguments`` of their modules."""
    for service, options in EXTENSIONS.get(name, {}).items():
        module = find(service)
        if module is not None:
            getattr(module, f"add_{name}_arguments")(command)
            continue
        for option in options:
            command.add_argument(option, action=_MissingOption, const=service, nargs="?", help=argparse.SUPPRESS)


class _MissingOption(argparse.Action):
    """An option of a feature that is not installed; ``const`` names the service in the registry."""

    def __call__(self, parser: object, namespace: object, values: object, option: str | None = None) -> None:
        need(str(self.const), option or "")


def help_if_present(service: str, text: str) -> str:
    """Return the help of a core option that a feature serves; the help page leaves the option out where the feature is not installed."""
    return text if is_present(service) else argparse.SUPPRESS
