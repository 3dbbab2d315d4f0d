"""Where each parameter stands in ``State.vector``, and so in a ``Refit``'s columns and covariance.

The linear model's 12, the Earth's horizontal correction (2), the length of gravity, then each claim's theta in order.
"""

from __future__ import annotations

from collections.abc import Sequence

from tinygc.effects import AppliedEffect
from tinygc.models.linear import PARAMETERS

LINEAR = slice(0, PARAMETERS)
EARTH = slice(LINEAR.stop, LINEAR.stop + 2)
GRAVITY = EARTH.stop  #: one number
FIRST_CLAIM = GRAVITY + 1


def claim_slice(claims: Sequence[AppliedEffect], number: int) -> slice:
    """Where the theta of claim ``number`` stands.  IndexError where there is no such claim."""
    start = FIRST_CLAIM + sum(len(claim.theta) for claim in claims[:number])
    return slice(start, start + len(claims[number].theta))
