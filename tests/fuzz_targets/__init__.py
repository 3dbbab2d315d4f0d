"""Every reader as a function of bytes, for the test that replays what fuzzing kept.

A target is a module with ``run(data, folder)``, which reads ``data`` as one kind of file, written into an empty ``folder``, and checks
what it got; and ``seeds()``, good inputs of our own simulation.
"""

from __future__ import annotations

import importlib
from types import ModuleType

from annex import annex

#: of each target, a module of this folder
NAMES = ["logs", "session_toml", "beside_logs", "decoder", "raw", "model", "replay", "results", "arguments"]
if annex("session.annexes.logs"):
    NAMES.append("binary_logs")
if annex("tinygc.annexes.noise.inputs"):
    NAMES.append("noise")
if annex("session.annexes.machines.makes"):
    NAMES.append("machines")
if annex("tinygc.annexes.rates.points"):
    NAMES.append("rates")


def target(name: str) -> ModuleType:
    """The module."""
    return importlib.import_module(f"fuzz_targets.{name}")
