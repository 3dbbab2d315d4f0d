"""The whiteners of one twin under the noise of each hypothesis, a few at a time."""

from __future__ import annotations

from tinygc.explanation.noise.session_noise import SessionNoise
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: whiteners that are held: of the hypothesis that a search goes on from, of the one that is weighed, and of one more
HELD = 3


class Whiteners:
    """By noise.  A factor has (n, n) elements, of 400 turns 46 MB, and each hypothesis has noise of its own; what was not asked for lately
    is factored again, to the same digits."""

    def __init__(self, twin: Twin):
        #: white noise alone
        self.white = Whitener(twin)
        self._held: dict[SessionNoise, Whitener] = {}

    def __len__(self) -> int:
        return len(self._held)

    def of(self, noise: SessionNoise) -> Whitener:
        """White noise with this on top."""
        found = self._held.pop(noise, None)
        if found is None:
            while len(self._held) >= HELD:  # before another is made: the one that was asked for longest ago
                del self._held[next(iter(self._held))]
            found = self.white.with_more(noise.covariance)
        self._held[noise] = found
        return found
