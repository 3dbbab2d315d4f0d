"""The record of an examination, whatever is examined, and what all of them do once the truth is sealed: ask blind, open, write down."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from tinygc.challenge.seal import Seal

PROCESSES = 2
SESSIONS, SEALED, OPENED, SAID = "sessions", "sealed_truth.bin", "truth.json", "said.json"


class Scored(Protocol):
    """One session's score: its name, and what kind of thing was hidden."""

    @property
    def name(self) -> str:
        """Of the session."""

    @property
    def kind(self) -> str:
        """Of what is hidden."""


AnyScore = TypeVar("AnyScore", bound=Scored)


@dataclass(frozen=True, eq=False)
class Examination(Generic[AnyScore]):
    """sha256 of the truth as it was printed before; the scores, one for each session; truth and what was said, by session."""

    seed: int
    sha256: str
    scores: list[AnyScore]
    truth: dict[str, dict]
    said: dict[str, dict]


def asked_blind(
    folders: Sequence[Path], answer: Callable[[Path], dict], what: str, progress: Callable[[str, int, int], None]
) -> dict[str, dict]:
    """What is said of each session folder, by its name; some at once."""
    said = {}
    with ThreadPoolExecutor(PROCESSES) as pool:
        for folder, result in zip(folders, pool.map(answer, folders), strict=True):
            said[folder.name] = result
            progress(what, len(said), len(folders))
    return said


def opened(folder: Path, closed: Seal, said: dict[str, dict]) -> dict[str, dict]:
    """The truth, written into the folder of the examination beside what was said before it was opened."""
    _write(folder / SAID, said)
    truth = closed.open()
    _write(folder / OPENED, truth)
    return truth


def _write(path: Path, table: dict) -> None:
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def as_table(
    schema: str, result: Examination[AnyScore], totals: dict, more: Callable[[AnyScore, dict], dict] = lambda score, said: {}
) -> dict:
    """JSON-ready: every session with its truth, its verdict and its score, and the totals; more: of a score and what was said, keys to add
    to a session's or to put in the place of its own."""
    return {
        "schema": schema,
        "seed": result.seed,
        "sha256": result.sha256,
        "sessions": {
            each.name: {
                "truth": result.truth[each.name],
                "verdict": result.said[each.name]["verdict"],
                "score": vars(each) | {"kind": each.kind},
                **more(each, result.said[each.name]),
            }
            for each in result.scores
        },
        "totals": totals,
    }
