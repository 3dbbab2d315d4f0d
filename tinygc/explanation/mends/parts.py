"""A long log in parts: what looks at a few tenths of a second around each reading need not have a day of them in memory."""

from __future__ import annotations

from collections.abc import Iterator

from session.log.samples import Samples

#: rows from which on a log is parted, more than an hour at 208 Hz; of a part; and on either side that go with it: many times what any
#: detector looks at around a reading
LONG, AT_ONCE, BESIDE = 1 << 20, 1 << 18, 1 << 12


def in_parts(samples: Samples) -> Iterator[tuple[int, range, Samples]]:
    """(row of the part's first, its own rows of the log, its samples) of each; one part of all where they are no more than ``LONG``."""
    count = len(samples)
    if count <= LONG:
        yield 0, range(count), samples
        return
    for start in range(0, count, AT_ONCE):
        own = range(start, min(start + AT_ONCE, count))
        first = max(start - BESIDE, 0)
        part = samples.between(first, min(own.stop + BESIDE, count))
        part.__dict__["period_s"] = samples.period_s
        yield first, own, part
