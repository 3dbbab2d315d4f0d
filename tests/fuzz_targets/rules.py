"""What counts as a finding, whatever the reader."""

import contextlib
import shutil
import sys
import time
import traceback
import warnings
from pathlib import Path
from typing import TypeVar

import numpy as np

from session.base.errors import CalibrationError

try:
    import resource
except ImportError:  # Windows: memory is not watched there
    resource = None

#: of CPU, for an input of less than 10 KB
LONGEST_S = 1.0
#: by which one input may raise the process's peak
MOST_BYTES = 500 << 20
LONGEST_MESSAGE = 2000
#: ru_maxrss is in KiB, but on macOS
RSS_UNIT = 1 if sys.platform == "darwin" else 1024
OURS = ("session", "tinygc")

Choice = TypeVar("Choice")


class Finding(Exception):
    """What no input may do.  place: file and line of our own code that it came from, so that one cause is told from another."""

    def __init__(self, what, place):
        super().__init__(what)
        self.place = place


def attempt(target, data, folder):
    """Run one input in an empty folder; whether it was accepted.

    Raises Finding: an exception that is neither CalibrationError nor OSError, a warning, a message of more than one line, more than a
    second of CPU, more than 500 MB, or what the target itself finds wrong with an answer.
    """
    peak = _peak_bytes()
    accepted, took_s = _timed(target, data, folder)
    if took_s > LONGEST_S:  # the first may have waited for an import
        accepted, took_s = _timed(target, data, folder)
    if took_s > LONGEST_S:
        raise Finding(f"{took_s:.1f} s of CPU for {len(data)} bytes", "time")
    if (grown := _peak_bytes() - peak) > MOST_BYTES:
        raise Finding(f"{grown >> 20} MB for {len(data)} bytes", "memory")
    return accepted


def _timed(target, data, folder):
    """Whether it was accepted, and s of CPU."""
    folder.mkdir(exist_ok=True)
    began_s = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", ResourceWarning)  # whose moment is the collector's, not the input's
            target.run(data, folder)
        return True, time.process_time() - began_s
    except (CalibrationError, OSError) as error:
        if "\n" in (text := str(error)) or "\r" in text or not text.strip() or len(text) > LONGEST_MESSAGE:
            raise Finding(f"a message of {len(text)} characters that is no line: {text[:200]!r}", _place(error)) from error
        return False, time.process_time() - began_s
    except MemoryError as error:
        raise Finding("memory", _place(error)) from error
    except Exception as error:
        raise Finding(f"{type(error).__name__}: {error}", _place(error)) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def choose(data, choices):
    """One of the choices, by the first byte, and the rest: how an input says as what it is to be read."""
    return choices[data[0] % len(choices)] if data else choices[0], data[1:]


def finite(*arrays):
    """Each is there and finite, or None."""
    for values in arrays:
        assert values is None or np.isfinite(values).all(), f"accepted {np.asarray(values).ravel()[:3]}…, which is not finite"


@contextlib.contextmanager
def must_hold(what):
    """What the tool has written, or accepted before, may not be refused."""
    try:
        yield
    except CalibrationError as error:
        raise AssertionError(f"{what} is refused: {error}") from error


def _peak_bytes():
    return 0 if resource is None else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * RSS_UNIT


def _place(error):
    """The last line of ours in the traceback, else the last of all."""
    error = error.__cause__ or error
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if set(OURS) & set(Path(frame.filename).parts)]
    last = (ours or frames)[-1]
    return f"{Path(last.filename).name}:{last.lineno} {type(error).__name__}"
