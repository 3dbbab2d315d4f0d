"""Files of tests that need what only POSIX systems have: elsewhere they skip, and say so."""

from __future__ import annotations

import importlib.util

import pytest

#: the virtual board stands at the other end of a pseudo-terminal; the commands of pages are those of a POSIX shell
POSIX_ONLY = {f"test_{name}.py" for name in ("board", "firmware", "page_outputs", "page_physics", "record", "recording_physics", "screens")}


class _NotHere(pytest.Module):
    """A file of tests that cannot even be imported on this system: it skips, and says so."""

    def collect(self):
        pytest.skip("needs a pseudo-terminal, which only POSIX has", allow_module_level=True)


def pytest_pycollect_makemodule(module_path, parent):
    if module_path.name in POSIX_ONLY and importlib.util.find_spec("termios") is None:
        return _NotHere.from_parent(parent, path=module_path)
    return None
