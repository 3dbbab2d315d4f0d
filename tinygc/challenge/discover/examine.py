"""The examination of the search for laws from end to end: hide, seal, let it search blind in copies, open, score."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from tinygc.challenge.cases import Case
from tinygc.challenge.discover.cases import draw_discover_cases
from tinygc.challenge.discover.score import LawScore, score_law
from tinygc.challenge.discover.tables import totals
from tinygc.challenge.discover.truth import ALL, added_rate
from tinygc.challenge.examination import SESSIONS, Examination, as_table, asked_blind, opened
from tinygc.challenge.examine import explained, hide, new_folder

#: the copies in which the workers search and write, below the sessions; where their laws are kept
COPIES, LAWS = "searched", "laws"
EXPLAIN = "explain"
Answer = Callable[[Path], dict]


def answered(folder: Path) -> dict:
    """What a process of its own says of a copy of a session folder, where it may write."""
    return explained(folder, discover=True)


def examine_laws(
    folder: Path,
    count: int,
    seed: int,
    *,
    segments: int | None = None,
    answer: Answer = answered,
    announce: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Examination[LawScore]:
    """Examine the search for laws on ``count`` sessions in ``folder``, which must be empty or new.

    segments: of every session, instead of drawn; answer: what is asked of each copy; announce: shown the SHA-256 before any is asked.
    """
    new_folder(folder)
    cases = draw_discover_cases(count, seed, segments)
    closed = hide(folder, cases, progress, ALL)
    announce(f"truth sealed, SHA-256 {closed.sha256}")
    copies = [_copy(folder, case.name) for case in cases]
    said = asked_blind(copies, answer, "searching blind", progress)
    truth = opened(folder, closed, said)
    scores: list[LawScore] = []
    for case, copy in zip(cases, copies, strict=True):
        progress("scoring", len(scores), count)
        scores.append(_scored(case, truth[case.name], said[case.name], copy))
        if (copy / EXPLAIN / "effects").is_dir():
            shutil.copytree(copy / EXPLAIN / "effects", folder / LAWS / case.name, ignore=shutil.ignore_patterns("__pycache__"))
    return Examination(seed, closed.sha256, scores, truth, said)


def _copy(folder: Path, name: str) -> Path:
    """The session once more: what a worker writes stays out of the session that was hidden."""
    return Path(shutil.copytree(folder / SESSIONS / name, folder / SESSIONS / COPIES / name))


def _scored(case: Case, truth: dict, said: dict, copy: Path) -> LawScore:
    return score_law(case.name, truth, said, added_rate(case), copy / EXPLAIN)


def to_json(result: Examination[LawScore]) -> dict:
    """``tinygc-discover-challenge/1``: every session with its truth, what was said and its score, and the totals."""
    return as_table("tinygc-discover-challenge/1", result, totals(result.scores))
