"""Which movement a virtual board streams: a real one that is switched on again is the same sensor, but no hand turns it twice alike.

A take is a movement, with its noise, of one simulated sensor.  The board remembers, beside its link, which takes of a seed it has begun,
and streams the next one; so a recording that was interrupted goes on with turns that it does not hold yet.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from session.common.errors import CalibrationError
from session.files.reading import read_text
from session.files.results import write_text_whole
from tinygc.simulation.options import SimulationOptions

MOST_TAKES = 10**9
MOST_BYTES = 100_000


def taken(options: SimulationOptions, take: int) -> SimulationOptions:
    """The session of that take, counted from 1: take 1 is the session of ``options`` itself, a later one has its unit."""
    if take == 1:
        return options
    (seed,) = np.random.SeedSequence([options.seed, take]).generate_state(1, np.uint64)
    return replace(options, seed=int(seed) >> 1, unit_seed=options.unit_drawn_from)  # what a command line's --seed can be


def next_take(link: Path, seed: int) -> int:
    """The take of that seed that no board at ``link`` has begun yet; 1 where nothing is known."""
    return _known(link).get(seed, 0) + 1


def remember(link: Path, seed: int, take: int) -> None:
    """That a board at ``link`` begins this take.  Where it cannot be written the board streams all the same."""
    known = _known(link)
    known[seed] = max(take, known.get(seed, 0))
    try:
        write_text_whole(_memory_of(link), "".join(f"{each} {count}\n" for each, count in sorted(known.items())))
    except (OSError, CalibrationError):
        return


def _memory_of(link: Path) -> Path:
    return link.with_name(link.name + ".takes")


def _known(link: Path) -> dict[int, int]:
    """Seed -> last take; nothing of a file that is none of ours."""
    try:
        pairs = [tuple(map(int, line.split())) for line in read_text(_memory_of(link), MOST_BYTES).splitlines()]
        known = {seed: take for seed, take in pairs}
    except (OSError, ValueError, CalibrationError):
        return {}
    return known if all(0 < take < MOST_TAKES for take in known.values()) else {}
