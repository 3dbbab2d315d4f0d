"""What an effect has to be told beside the rate, and how far around a sample it looks."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

#: what an effect may declare in ``inputs``: the fields of a ``Movement`` that it then may read
INPUTS = {
    "force": ("force_g",),
    "temperature": ("temp_c", "first_temp_c"),
    "vibration": ("vibration_g2",),
    "time": ("t_s", "duration_s", "dt_s"),
}
#: the fields that hold for samples beside this one: who looks around may read them, too
AROUND = ("t_s", "dt_s")


@dataclass(frozen=True)
class Reach:
    """How far before and after a sample an effect looks, in samples and in seconds, which add up.

    One evaluation of ``columns``, ``exact_distort`` or ``exact_correct`` is meant; that the default ``correct`` repeats itself is known.
    """

    before_samples: int = 0
    after_samples: int = 0
    before_s: float = 0.0
    after_s: float = 0.0

    @classmethod
    def around(cls, samples: int = 0, seconds: float = 0.0) -> Reach:
        """As far to both sides."""
        return cls(samples, samples, seconds, seconds)

    def __add__(self, other: Reach) -> Reach:
        return Reach(
            self.before_samples + other.before_samples,
            self.after_samples + other.after_samples,
            self.before_s + other.before_s,
            self.after_s + other.after_s,
        )

    def times(self, count: int) -> Reach:
        """Of ``count`` evaluations, one after the other."""
        return Reach(count * self.before_samples, count * self.after_samples, count * self.before_s, count * self.after_s)

    @property
    def is_ahead(self) -> bool:
        """Whether it needs samples that are yet to come."""
        return self.after_samples > 0 or self.after_s > 0

    def __bool__(self) -> bool:
        return self != NOWHERE

    def rows(self, rate_hz: float) -> tuple[int, int]:
        """Samples before and after at a sampling rate."""
        return self.before_samples + ceil(self.before_s * rate_hz), self.after_samples + ceil(self.after_s * rate_hz)


NOWHERE = Reach()
#: a derivative by central differences
NEIGHBOURS = Reach.around(samples=1)
#: of an input itself: vibration is taken from the force by three centred means (``conditions``), twice half of 0.05 s and half of 0.25 s
INPUT_REACH = {"vibration": Reach.around(samples=5, seconds=0.175)}
