"""A counter that comes round: where its stamps may be carried on, and where time only goes backward."""

from __future__ import annotations

import numpy as np

#: of a counter's span: what may lie between the last stamp before it comes round and the first after; at 32 bits of us, 9 minutes
NEAR_ENDS = 1 / 8


def comes_round(steps: np.ndarray, lowest: int, highest: int, span: int) -> np.ndarray:
    """Which of the steps (N,) of integer stamps are a counter of ``span`` that has come round.

    Such a step falls by nearly the whole span, and no stamp, lowest to highest, lies outside the counter: nanoseconds of an epoch, of
    which some are lost, are no counter.  A counter may be written with a sign.
    """
    counter = any(first <= lowest and highest < first + span for first in (0, -span // 2))
    return steps <= -span * (1 - NEAR_ENDS) if counter else np.zeros(len(steps), dtype=bool)
