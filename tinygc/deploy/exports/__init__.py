"""What other programs read: a file per format.

An exporter's file is named below.  It has

    NAME                       as ``--to`` names it
    SUMMARY                    one line for ``--help``
    export(model, context)     -> dict of file name -> text, without touching the disk

``model`` is what ``tinygc.models.load`` gives; ``context`` (``Context``) is what is known around it.  An exporter that cannot carry the
model raises ``ExportError`` with one line: what cannot be carried, and which format can.  What it carries only in part it says in
``context.say(line)``.  Files that begin with an underscore are shared by exporters.  A new format is a new file and a name in
``FORMATS`` (``tinygc/deploy/__init__.py``).
"""

from __future__ import annotations

import importlib
from types import ModuleType

from tinygc.deploy import FORMATS, ExportError

__all__ = ["FORMATS", "ExportError", "exporter"]


def exporter(name: str) -> ModuleType:
    """The module of a format."""
    return importlib.import_module(f"tinygc.deploy.exports.{name}")
