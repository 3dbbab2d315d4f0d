"""Which sensor a name means, however it is written: ``mpu9250``, ``MPU-9250``, ``ST asm330lhhtr, unit 2``."""

from __future__ import annotations

import re
from difflib import get_close_matches
from functools import lru_cache

from session.sensor.profiles import invensense, others, st
from session.sensor.profiles.profile import Profile

PROFILES: tuple[Profile, ...] = (*st.PROFILES, *invensense.PROFILES, *others.PROFILES)
#: what registers are where nobody names the sensor (docs/formats.md)
DEFAULT = "ASM330LHH"
GENERIC = "generic"


def _pattern(name: str) -> re.Pattern[str]:
    """The name as a word, whatever stands between its letters and digits; TR is tape and reel."""
    written = r"[\s_.-]*".join(re.findall(r"[A-Za-z]+|[0-9]+", name))
    return re.compile(rf"(?<![A-Za-z0-9]){written}(?:TR)?(?![A-Za-z0-9])", re.IGNORECASE)


_PATTERNS = [(_pattern(name), profile) for profile in PROFILES if profile.name != GENERIC for name in (profile.name, *profile.also)]


@lru_cache(maxsize=256)
def profile_of(model: str) -> Profile | None:
    """The known sensor that a text names; None where it names none, or two.  ``generic`` is meant only where nothing else is said."""
    if model.strip().lower() == GENERIC:
        return next(profile for profile in PROFILES if profile.name == GENERIC)
    found = [(match.span(), profile) for pattern, profile in _PATTERNS for match in pattern.finditer(model)]
    # LSM6DS3TR-C begins like LSM6DS3TR: the longer name counts.
    longest = [(span, profile) for span, profile in found if not any(_within(span, other) for other, _ in found)]
    named = {profile.name: profile for _, profile in longest}
    return next(iter(named.values())) if len(named) == 1 else None


def _within(span: tuple[int, int], other: tuple[int, int]) -> bool:
    return span != other and other[0] <= span[0] and span[1] <= other[1]


def nearest_name(model: str) -> str | None:
    """The known name that is most like a text, if any is."""
    names = {_plain(name): name for profile in PROFILES for name in (profile.name, *profile.also)}
    close = get_close_matches(_plain(model), names, n=1, cutoff=0.75)
    return names[close[0]] if close else None


def _plain(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())
