"""What goes wrong with a sensor, and when."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

#: the port: the line is stuck, though the sensor hears what is written; or it neither hears nor answers, and the line is pulled up
PORT_KINDS = ("zeros", "ones", "hang")
#: the FIFO's words
WORD_KINDS = ("parity", "tag_count", "tag_unknown", "swapped", "missing")
KINDS = (*PORT_KINDS, *WORD_KINDS, "reset", "identity", "int1")


@dataclass(frozen=True)
class Fault:
    """One thing that happens at ``at_s`` of the sensor's time.

    kind:
      zeros, ones   the sensor's line reads 0x00 or 0xFF for ``lasts_s``; what is written arrives
      hang          the sensor neither hears nor answers for ``lasts_s`` (reads 0xFF), and goes on measuring
      parity        the next ``words`` words in the FIFO have a false parity bit
      tag_count     their TAG_CNT is two further than it should be, the parity right
      tag_unknown   their tag is ``value`` (31 unless given), the parity right
      swapped       the next word changes places with the one behind it
      missing       they never reach the FIFO
      reset         the sensor starts up anew by itself
      identity      WHO_AM_I reads ``value`` for ``lasts_s``
      int1          the interrupt's pin stays low for ``lasts_s``

    Raises ValueError for a kind that is none.
    """

    kind: str
    at_s: float
    lasts_s: float = math.inf
    words: int = 1
    value: int = 31

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"no fault {self.kind!r}; there are {', '.join(KINDS)}")

    @classmethod
    def parse(cls, text: str) -> Fault:
        """``KIND@S``, with ``+S`` for how long and ``xN`` for how many words: ``hang@20+0.5``, ``parity@10x3``.  ValueError where it is
        none."""
        form = re.fullmatch(r"(\w+)@([\d.]+)(?:\+([\d.]+))?(?:x(\d+))?", text.strip())
        if not form:
            raise ValueError(f"{text!r} is no fault; expected KIND@S, KIND@S+S or KIND@SxN, as in parity@10x3")
        kind, at_s, lasts_s, words = form.groups()
        return cls(kind, float(at_s), float(lasts_s) if lasts_s else math.inf, int(words or 1))

    def holds(self, t_s: float) -> bool:
        """Whether it lasts at that time."""
        return self.at_s <= t_s < self.at_s + self.lasts_s
