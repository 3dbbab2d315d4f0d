"""Whatever ran before, and however slow the machine is: the same examples, the same draws, no reader that is left; ``--shuffle SEED``.

Files with the most ``slow`` tests begin, then those that start commands, so that no worker is left with a long one at the end while the
others have nothing to do.
"""

from __future__ import annotations

import gc
import os
import random
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

HERE = Path(__file__).resolve().parent
# The same examples each time, however slow the machine is.
settings.register_profile("anywhere", deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("anywhere")
_DRAWN: dict[int, tuple[np.random.Generator, dict]] = {}  # generators of the tests' own modules, as they were when these were loaded


def pytest_addoption(parser):
    parser.addoption("--shuffle", type=int, metavar="SEED", help="files, and the tests of each, in an order drawn from this seed")


def pytest_xdist_auto_num_workers(config):
    """As many as there are cores, hyper-threads counted: each collects all tests for itself, and hardly one waits."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pytest_collection_modifyitems(config, items):
    seed = config.getoption("--shuffle")
    files: dict[Path, list] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    if seed is not None:
        draw = random.Random(seed)
        order = draw.sample(list(files), len(files))
        items[:] = [item for path in order for item in draw.sample(files[path], len(files[path]))]
    elif config.getoption("numprocesses", None) != 0:
        items[:] = [item for path in sorted(files, key=lambda path: _length(files[path]), reverse=True) for item in files[path]]


def _length(tests):
    """Of a file, by its number of slow test functions, however many parameters each has, whether it starts commands, and of all tests."""
    slow = {test.nodeid.split("[")[0] for test in tests if test.get_closest_marker("slow")}
    starts = any(getattr(value, "__module__", None) == "processes" for value in vars(tests[0].module).values())
    return len(slow), starts, len(tests)


def pytest_collection_finish():
    gc.collect()
    gc.freeze()  # thousands of tests stay to the end: no collection needs to look at them again
    for module in list(sys.modules.values()):
        if Path(getattr(module, "__file__", None) or "").is_relative_to(HERE):
            generators = [value for value in vars(module).values() if isinstance(value, np.random.Generator)]
            _DRAWN.update({id(each): (each, each.bit_generator.state) for each in generators if id(each) not in _DRAWN})


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup():
    """What a test draws does not depend on which ran before."""
    for generator, state in _DRAWN.values():
        generator.bit_generator.state = state


@pytest.fixture(autouse=True)
def no_reader_is_left():
    """One whose test has failed would wait for its port to come back, and take what the next test sends."""
    yield
    for thread in threading.enumerate():
        if thread.name == "port-reader":
            thread._target.__self__.close()
