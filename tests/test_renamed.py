"""Names of 0.1.0 that users import: they lead to the same things, and state the new name in one line."""

import importlib
import sys

import processes
import pytest

from session.io.renamed import RENAMED


@pytest.mark.parametrize("name", sorted(RENAMED))
def test_an_old_name_leads_to_the_module_of_today(name):
    assert importlib.import_module(RENAMED[name]) is importlib.import_module(name)


def test_the_new_name_is_stated_in_one_line():
    code = "from session.common.units import DEG; from tinygc.effects.picture import SCALE_LAW; from session.common.units import G"
    done = processes.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stderr.splitlines() == [
        "session.common.units is now session.io.units; the old name goes with version 0.3",
        "tinygc.effects.picture is now tinygc.effects.effect; the old name goes with version 0.3",
    ]


def test_what_never_was_is_still_not_found():
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("session.common.nothing")
