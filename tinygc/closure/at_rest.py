"""Noise figures of the unit that were measured at rest, beside a session: the prior that they give, and whether the session agrees.

``tinygc.noise.measured`` makes these records of ``noise.json``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.records import Share, Size
from session.base.texts import significant
from session.detect.findings import Finding
from tinygc.closure.floor import BiasInstability

#: a session contradicts the figures at rest where chance makes as much of a difference in one of a thousand, and it is this large: a
#: session's temperature, range and data rate are not those of the rest
CONTRADICTED_P, CONTRADICTED_RATIO = 1e-3, 1.1
WHAT = "noise at rest"
#: an interval that begins below the first ratio is said as a limit; one that ends beyond the second, as two ratios
LEAST_RATIO, FAR = 0.1, 2.0


@dataclass(frozen=True)
class NoiseComparison:
    """Noise of a session over that at rest, rms: ratio, its 95 % interval low to high, and the p-value (two-sided) of the ratio 1."""

    written = ("ratio", "low", "high", "p_value", "contradicted")
    ratio: Size
    low: Size
    high: Size
    p_value: Share

    @property
    def contradicted(self) -> bool:
        """Whether the session contradicts the figures at rest."""
        return self.p_value < CONTRADICTED_P and not 1 / CONTRADICTED_RATIO < self.ratio < CONTRADICTED_RATIO

    @property
    def within(self) -> str:
        """How far from the figures at rest the session may be (95 %), in words."""
        if self.low < LEAST_RATIO:
            return f"at most {significant(self.high, 2)} times as large (95 %)"
        if self.high > FAR:
            return f"{significant(self.low, 2)} to {significant(self.high, 2)} times as large (95 %)"
        return f"within {significant(100 * max(1 - self.low, self.high - 1), 2)} % (95 %)"


@dataclass(frozen=True, eq=False)
class MeasuredNoise:
    """Noise figures at rest, in use for a session.

    path of the file, sha256 of it; instability: prior of the session's bias drift, None where the figures set none or are contradicted;
    white: of each axis, empty where the session shows none; drift: of all axes together, None where the session or the figures show none.
    """

    written = ("file", "sha256", "white", "drift")
    path: Path
    sha256: str
    instability: BiasInstability | None
    white: tuple[NoiseComparison, ...] = ()
    drift: NoiseComparison | None = None

    @property
    def file(self) -> str:
        """Name of the file."""
        return self.path.name

    @property
    def words(self) -> str:
        """What the session says of the figures, in one line."""
        parts = []
        if self.white and not any(each.contradicted for each in self.white):
            parts.append(f"white noise {max(self.white, key=lambda each: each.high - each.low).within}")
        if self.drift is not None and not self.drift.contradicted:
            parts.append(f"bias drift {self.drift.within}")
        return f"Noise at rest ({self.file}), not contradicted by this session: {'; '.join(parts)}." if parts else ""

    def findings(self, where: str) -> list[Finding]:
        """A warning for each figure that the session contradicts; a note for those that it does not."""
        found = []
        differs = [(each, f"white noise of the stills on {axis}") for each, axis in zip(self.white, "xyz", strict=False)]
        differs = [pair for pair in differs if pair[0].contradicted]
        if differs:
            found.append(_warning(where, *min(differs, key=lambda pair: pair[0].p_value), self.file, SHAKES))
        if self.drift is not None and self.drift.contradicted:
            found.append(_warning(where, self.drift, "bias drift from still to still", self.file, DRIFTS, "; no prior of this session"))
        return found + ([Finding("note", where, WHAT, self.words)] if self.words else [])


SHAKES = "does the table shake? put it on a quiet floor"
DRIFTS = "let the board warm up, fasten it and its cable, and hold it still for longer"


def _warning(where: str, found: NoiseComparison, what: str, file: str, do: str, more: str = "") -> Finding:
    ratio, low, high = (significant(value, 3) for value in (found.ratio, found.low, found.high))
    p = f"p = {found.p_value:.1g}" if found.p_value > 1e-99 else "p < 1e-99"
    says = f"{what}: {ratio} times that of {file} (95 %: {low} to {high}; {p}){more}"
    of_file = f"is {file} of this unit, in this range? measure it again with noise record"
    return Finding("warning", where, WHAT, says, f"{do}; {of_file}" if found.ratio > 1 else of_file)
