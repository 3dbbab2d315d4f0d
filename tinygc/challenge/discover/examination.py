"""The record of an examination of the search for laws."""

from __future__ import annotations

from dataclasses import dataclass

from tinygc.challenge.discover.score import LawScore


@dataclass(frozen=True, eq=False)
class LawExamination:
    """sha256 of the truth as it was printed before; the scores, one for each session; truth and what was said, by session."""

    seed: int
    sha256: str
    scores: list[LawScore]
    truth: dict[str, dict]
    said: dict[str, dict]
