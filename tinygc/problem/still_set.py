"""The stills of one log, with the attitudes that are carried through them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.detect.rests import Rest, find_rests
from session.detect.stills import Noise, Still
from session.log.logfile import Bridge
from session.log.samples import Samples


@dataclass(frozen=True, eq=False)
class StillSet:
    """The stills of one log: their noise, attitudes q_tb (Q, 4), the yaw carried from still to still, and yaw groups (Q,); bridges:
    readings of its samples that were put in."""

    samples: Samples
    stills: list[Still]
    noise: Noise
    q_tb: np.ndarray
    group: np.ndarray
    bridges: tuple[Bridge, ...] = ()

    @cached_property
    def rests(self) -> list[Rest]:
        """Phases in which a vehicle stands, though its motors may shake it; looked for once."""
        return find_rests(self.samples)
