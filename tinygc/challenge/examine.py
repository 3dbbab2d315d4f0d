"""The examination from end to end: hide, seal, explain blind, open, score."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from session.common.errors import DataError, FormatError
from session.files.writing import naming
from tinygc.challenge.cases import Case, draw_cases
from tinygc.challenge.conceal import MAKERS, conceal, options_chosen
from tinygc.challenge.concealment import Maker
from tinygc.challenge.examination import SEALED, SESSIONS, Examination, as_table, asked_blind, opened
from tinygc.challenge.score import Score, score
from tinygc.challenge.seal import Seal, seal
from tinygc.challenge.worker import DISCOVER
from tinygc.effects.discovery import loaded_folders
from tinygc.simulation.write import write_files

ROOT = Path(__file__).resolve().parents[2]


def examine(
    folder: Path,
    count: int,
    seed: int,
    *,
    segments: int | None = None,
    announce: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Examination[Score]:
    """Examine ``explain`` on ``count`` sessions in ``folder``, which must be empty or new.

    segments: of every session, instead of drawn; announce: shown the SHA-256 before anything is explained.
    """
    new_folder(folder)
    cases = draw_cases(count, seed, segments)
    closed = hide(folder, cases, progress)
    announce(f"truth sealed, SHA-256 {closed.sha256}")
    said = asked_blind([folder / SESSIONS / case.name for case in cases], explained, "explaining blind", progress)
    truth = opened(folder, closed, said)
    scores = [score(name, truth[name], said[name]) for name in truth]
    return Examination(seed, closed.sha256, scores, truth, said)


def new_folder(folder: Path) -> None:
    """Make the folder of an examination.  FormatError where something lies in it."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FormatError(f"{folder}: not empty; give a new folder")
    with naming(folder):
        (folder / SESSIONS).mkdir(parents=True)


def hide(folder: Path, cases: list[Case], progress: Callable[[str, int, int], None], makers: Mapping[str, Maker] = MAKERS) -> Seal:
    """The session folders, and the truth beside them, sealed."""
    truth = {}
    for done, case in enumerate(cases):
        progress("hiding", done, len(cases))
        simulation, config, effects = conceal(case, makers)
        write_files(simulation, folder / SESSIONS / case.name, config)
        truth[case.name] = {
            "effects": effects,
            "strength": case.strength,
            "strengths": dict(zip(case.ids, case.strengths, strict=True)),
            "odr_hz": case.options.odr_hz,
            "bias_instability_dph": case.options.bias_instability_dph,
            "told": case.told,
            "options": options_chosen(case.options),
        }
    return seal(truth, folder / SEALED)


def explained(folder: Path, discover: bool = False) -> dict:
    """What a process of its own, with the same folders of effects, says of a session folder (``tinygc-explain/1``, with verdict
    ``refused`` where it refuses); discover: it looks for laws, too, and writes their files there."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tinygc.challenge.worker", *([DISCOVER] if discover else []), ".", *map(str, loaded_folders())]
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if run.returncode != 0:
        raise DataError(f"{folder.name}: explaining ended with {run.returncode}: {run.stderr.strip()[-500:]}")
    return json.loads(run.stdout)


def without_sessions(folder: Path, everything: bool = False) -> None:
    """Remove the sessions of an examination, or its whole folder."""
    shutil.rmtree(folder if everything else folder / SESSIONS)


def to_json(result: Examination[Score]) -> dict:
    """``tinygc-challenge/1``: every session with its truth, what was said and its score, and the totals."""
    from tinygc.challenge.table import totals

    def more(score: Score, said: dict) -> dict:
        named = {effect["id"]: effect["equivalent"] for effect in said["effects"]}
        return {"named": named, "score": vars(score) | {"kind": score.kind, "statements": [vars(one) for one in score.statements]}}

    return as_table("tinygc-challenge/1", result, totals(result.scores), more)
