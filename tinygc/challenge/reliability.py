"""Does a stated probability mean what it says?  Statements by bins, and the expected calibration error."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

#: edges of the bins: fine where names are claimed, coarse where a name was only considered
EDGES = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0)
#: bins from here on are what the text table shows
CLAIMS_FROM = 0.5


@dataclass(frozen=True)
class Statement:
    """That ``id`` is in the recording, with a probability; claimed: as a name, not only considered; right: whether it is hidden there."""

    id: str
    probability: float
    claimed: bool
    right: bool


@dataclass(frozen=True)
class Bin:
    """Statements with a probability from ``low`` to ``high``: how many, the share that are right, the mean that was stated."""

    low: float
    high: float
    number: int
    share_right: float | None
    mean_stated: float | None


def statements(said: dict, hidden: Iterable[str]) -> tuple[Statement, ...]:
    """What ``said`` (``tinygc-explain/1``) states of names with a probability, each id once; a shape without a name states none."""
    known, stated = set(hidden), {}
    for claimed, group in ((False, said.get("considered") or ()), (True, said["effects"])):
        for each in group:
            if each.get("probability") is not None and not each["id"].startswith("unknown."):
                stated[each["id"]] = Statement(each["id"], float(each["probability"]), claimed, each["id"] in known)
    return tuple(stated.values())


def reliability(stated: Iterable[Statement]) -> list[Bin]:
    """The statements by bins of their probability, all bins of ``EDGES``."""
    everything = list(stated)
    p = np.array([each.probability for each in everything])
    right = np.array([each.right for each in everything], dtype=bool)
    place = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    bins = []
    for number, (low, high) in enumerate(pairwise(EDGES)):
        here = place == number
        count = int(here.sum())
        bins.append(Bin(low, high, count, float(right[here].mean()) if count else None, float(p[here].mean()) if count else None))
    return bins


def calibration_error(stated: Iterable[Statement]) -> float | None:
    """Mean distance, over the statements, of the share that are right from the mean that was stated, bin by bin; None without any."""
    bins = [each for each in reliability(stated) if each.share_right is not None and each.mean_stated is not None]
    total = sum(each.number for each in bins)
    return sum(each.number * abs((each.share_right or 0.0) - (each.mean_stated or 0.0)) for each in bins) / total if total else None
