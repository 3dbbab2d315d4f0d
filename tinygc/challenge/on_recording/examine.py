"""A recording examined from end to end: explain it, conceal, seal, explain blind, open, count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.common.errors import DataError
from tinygc.challenge.examination import SEALED, SESSIONS, asked_blind, opened
from tinygc.challenge.examine import explained, new_folder
from tinygc.challenge.on_recording.files import write_spoilt
from tinygc.challenge.on_recording.inject import inject
from tinygc.challenge.on_recording.power import Power, Tried, agreement, own_names, powers
from tinygc.challenge.on_recording.recording import Recording, recording_of
from tinygc.challenge.on_recording.trials import Trial, draw_trials
from tinygc.challenge.seal import Seal, seal

UNTOUCHED = "untouched"


@dataclass(frozen=True, eq=False)
class OwnExamination:
    """session: its name; sha256 of the truth as it was printed before; verdict, own names: what the untouched recording gets; powers: by
    effect."""

    session: str
    seed: int
    sha256: str
    verdict: str
    own: tuple[str, ...]
    powers: list[Power]


def examine_recording(
    session: Path,
    folder: Path,
    count: int | None,
    seed: int,
    *,
    announce: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> OwnExamination:
    """What the recording in ``session`` can tell; ``folder`` must be empty or new; count: at most so many trials, None for all.

    Raises what ``recording_of`` raises, and FormatError for the folder.
    """
    recording = recording_of(session)
    new_folder(folder)
    sessions = folder / SESSIONS
    progress("explaining it untouched", 0, 1)
    write_spoilt(recording.session, tuple(log.samples for log in recording.session.logs), sessions / UNTOUCHED)
    untouched = explained(sessions / UNTOUCHED)
    if untouched["verdict"] == "refused":
        raise DataError(f"{session}: explain refuses it: {untouched['why']}")
    seen_from = {name: entry["size"] for name, entry in untouched["seen_from"].items() if entry["size"]}
    own = own_names(untouched)
    trials = draw_trials(seen_from, own, recording.has_temperature, count, seed)
    trials, closed = _write(recording, trials, folder, progress)
    announce(f"truth sealed, SHA-256 {closed.sha256}")
    said = asked_blind([sessions / trial.name for trial in trials], explained, "explaining blind", progress)
    opened(folder, closed, {UNTOUCHED: untouched} | said)
    found = powers(trials, said, untouched)
    return OwnExamination(recording.session.name, seed, closed.sha256, untouched["verdict"], tuple(sorted(own)), found)


def _write(recording: Recording, trials: list[Trial], folder: Path, progress: Callable[[str, int, int], None]) -> tuple[list[Trial], Seal]:
    """The session folders of the trials that this recording allows, and the truth beside them, sealed."""
    written, truth = [], {}
    for done, trial in enumerate(trials):
        progress("concealing", done, len(trials))
        spoilt = inject(recording, trial)
        if not all(np.isfinite(log.gyro).all() for log in spoilt.logs):
            continue  # it reads what this recording lacks
        write_spoilt(recording.session, spoilt.logs, folder / SESSIONS / trial.name)
        truth[trial.name] = {"effects": {trial.id: spoilt.truth}, "size": trial.size, "unit": trial.unit, "seen_from": trial.seen_from}
        written.append(trial)
    return written, seal(truth, folder / SEALED)


def to_json(result: OwnExamination) -> dict:
    """``tinygc-power/1``."""
    return {
        "schema": "tinygc-power/1",
        "session": result.session,
        "seed": result.seed,
        "sha256": result.sha256,
        "verdict": result.verdict,
        "own": list(result.own),
        "effects": [
            {
                "id": each.id,
                "unit": each.unit,
                "seen_from": each.seen_from,
                "told_from": each.told_from,
                "ratio": each.ratio,
                "agrees": each.agrees,
                "tried": [_tried(one) for one in each.tried],
            }
            for each in result.powers
        ],
        "agreement": agreement(result.powers),
    }


def _tried(one: Tried) -> dict:
    return {"size": one.size, "found": one.found, "named": list(one.named), "wrong": list(one.wrong), "lost": list(one.lost)}
