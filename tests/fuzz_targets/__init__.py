"""Every reader as a function of bytes, for the test that replays what fuzzing kept.

A target is a module with ``run(data, folder)``, which reads ``data`` as one kind of file, written into an empty ``folder``, and checks
what it got.
"""

import importlib

#: of each target, a module of this folder
NAMES = ["logs", "beside_logs", "raw", "replay"]


def target(name):
    """The module."""
    return importlib.import_module(f"fuzz_targets.{name}")
