"""Where a law's numbers were found, for what proves an effect: elsewhere it may do nothing at all."""

from __future__ import annotations

from dataclasses import dataclass

from session.common.units import DEG


@dataclass(frozen=True)
class FoundAt:
    """Of the session: full scale fs_rps, to which its turns go; first_temp_c, from which it warms up."""

    fs_rps: float = 500 * DEG
    first_temp_c: float = 25.0


ANYWHERE = FoundAt()
