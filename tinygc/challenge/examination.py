"""The record of an examination."""

from __future__ import annotations

from dataclasses import dataclass

from tinygc.challenge.score import Score


@dataclass(frozen=True, eq=False)
class Examination:
    """sha256 of the truth as it was printed before; the scores, one for each session; truth and what was said, by session."""

    seed: int
    sha256: str
    scores: list[Score]
    truth: dict[str, dict]
    said: dict[str, dict]
