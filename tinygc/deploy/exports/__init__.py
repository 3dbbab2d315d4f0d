"""Exports for other programs, one file per format.

An exporter's file is named below.  It has

    NAME                       its name for ``--to``
    export(model, context)     -> dict of file name -> text, without writing to disk
    export_noise(context)      -> the same of what needs no model, only ``context.noise``; a format may lack it

``model`` is the result of ``tinygc.models.load``; ``context`` (``Context``) is what is known about its origin.  An exporter that cannot
carry the model raises ``ExportError`` with one line: what cannot be carried, and which format can.  It reports partial losses by
``context.remark(line)``.  Files that begin with an underscore are shared by exporters.  To add a format, add a file and its name in
``FORMATS`` (``tinygc/deploy/__init__.py``).
"""

from __future__ import annotations

import importlib
from types import ModuleType

from tinygc.deploy import FORMATS, ExportError

__all__ = ["FORMATS", "ExportError", "exporter"]


def exporter(name: str) -> ModuleType:
    """Return the module of a format."""
    return importlib.import_module(f"tinygc.deploy.exports.{name}")
