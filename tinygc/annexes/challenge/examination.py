"""The blind test from end to end: inject, seal, explain, open, score, and its tables."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np

from session.io.errors import DataError, FormatError
from session.io.files import MOST_JSON, naming, read_bytes
from tinygc.annexes.challenge.cases import MAKERS, STRENGTHS, Case, conceal, draw_cases, options_chosen
from tinygc.annexes.challenge.rate_effects import Maker
from tinygc.annexes.challenge.score import CLAIMS_FROM, KINDS, Score, calibration_error, groups, reliability, score
from tinygc.annexes.challenge.worker import DISCOVER
from tinygc.effects.catalogue import loaded_folders
from tinygc.reporting.terminal import Group, Table, Text
from tinygc.simulation.write import write_files

# Seal the truth: a file that cannot be read without the key, which only the examiner's memory holds until the end.
#
# The SHA-256 of the truth is printed before anything is explained and checked when the file is opened, so neither can be changed between.

KEY_BYTES = 32


@dataclass(frozen=True)
class Seal:
    """path of the sealed file; sha256 of the truth as text; the key."""

    path: Path
    sha256: str
    key: bytes

    def open(self) -> dict:
        """Decrypt the truth.  Raises DataError if the file is not the one that was sealed."""
        text = _masked(read_bytes(self.path, MOST_JSON), self.key)
        if hashlib.sha256(text).hexdigest() != self.sha256:
            raise DataError(f"{self.path}: this is not the truth that was sealed; its SHA-256 has changed")
        return json.loads(text)


def seal(truth: dict, path: Path) -> Seal:
    """Encrypt the JSON-ready truth into a file."""
    text = (json.dumps(truth, indent=1, ensure_ascii=False) + "\n").encode()
    key = secrets.token_bytes(KEY_BYTES)
    path.write_bytes(_masked(text, key))
    return Seal(path, hashlib.sha256(text).hexdigest(), key)


def _masked(data: bytes, key: bytes) -> bytes:
    """XOR with a one-time pad: the key is used for one file only."""
    pad = hashlib.shake_256(key).digest(len(data))
    return bytes(a ^ b for a, b in zip(data, pad, strict=True))


# The record of a blind test, and its common steps once the truth is sealed: explain, open, write.

PROCESSES = 2
SESSIONS, SEALED, OPENED, ANSWERS = "sessions", "sealed_truth.bin", "truth.json", "answers.json"


class Scored(Protocol):
    """One session's score: its name, and the kind of hidden effect."""

    @property
    def name(self) -> str:
        """Name of the session."""

    @property
    def kind(self) -> str:
        """Kind of the hidden effects."""


AnyScore = TypeVar("AnyScore", bound=Scored)


@dataclass(frozen=True, eq=False)
class Examination(Generic[AnyScore]):
    """sha256 of the truth as it was printed before; the scores, one for each session; truth and answers by session."""

    seed: int
    sha256: str
    scores: list[AnyScore]
    truth: dict[str, dict]
    said: dict[str, dict]


def asked_blind(
    folders: Sequence[Path], answer: Callable[[Path], dict], what: str, progress: Callable[[str, int, int], None]
) -> dict[str, dict]:
    """Answers for the session folders, by name; several run at once."""
    said = {}
    with ThreadPoolExecutor(PROCESSES) as pool:
        for folder, result in zip(folders, pool.map(answer, folders), strict=True):
            said[folder.name] = result
            progress(what, len(said), len(folders))
    return said


def opened(folder: Path, closed: Seal, said: dict[str, dict]) -> dict[str, dict]:
    """Write the answers and then the truth into the folder of the test, and return the truth."""
    _write(folder / ANSWERS, said)
    truth = closed.open()
    _write(folder / OPENED, truth)
    return truth


def _write(path: Path, table: dict) -> None:
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def as_table(
    schema: str, result: Examination[AnyScore], totals: dict, more: Callable[[AnyScore, dict], dict] = lambda score, said: {}
) -> dict:
    """JSON-ready: every session with its truth, its verdict and its score, and the totals; more: of a score and an answer, keys that extend
    or replace a session's own."""
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


# The tables of the blind test: by effect and strength, and totals.

TITLES = {"nothing": "nothing hidden", "beside": "beside an outsider", **{kind: f"{kind} at once" for kind in ("two", "three", "four")}}
#: kinds of sessions with effects of the catalogue only
HIDDEN = ("one", "two", "three", "four")
LAST = list(TITLES.values())


def challenge_tables(result: Examination[Score]) -> Group:
    """The printed output of ``calibrate.py challenge``."""
    tables = [part for table in _tables(result.scores) for part in (table, Text(""))]
    return Group(*tables, Text("\n".join(sentences(result.scores))))


def markdown(result: Examination[Score]) -> str:
    """The same tables in Markdown, for a README."""
    return "\n\n".join([*map(_markdown, _tables(result.scores)), "\n".join(f"- {line}" for line in sentences(result.scores))]) + "\n"


def _tables(scores: list[Score]) -> list[Table]:
    stated = any(each.statements for each in scores)
    return [_by_effect(scores), _by_strength(scores), *([_by_probability(scores)] if stated else []), _by_session(scores)]


def _markdown(table: Table) -> str:
    columns = [list(column.cells) for column in table.columns]
    lines: list[Sequence[object]] = [[column.header for column in table.columns], ["---"] * len(columns), *zip(*columns, strict=True)]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def _by_effect(scores: list[Score]) -> Table:
    strengths = [f"× {strength:g}" for strength in STRENGTHS]
    table = Table(
        "hidden", *strengths, "wrong names", "error, median σ", "within 3 σ", "excess gone", title="named (exactly or among equivalents) of"
    )
    groups: dict[str, list[Score]] = {}
    for each in scores:
        groups.setdefault(TITLES.get(each.kind) or each.truth[0], []).append(each)
    for name in sorted(groups, key=lambda name: (name in LAST, name.startswith("outside"), LAST.index(name) if name in LAST else 0, name)):
        group = groups[name]
        cells = [_named_of([each for each in group if each.strength == strength]) for strength in STRENGTHS]
        if group[0].kind == "nothing":
            cells = [f"{sum(each.alarmed for each in group)} alarms of {len(group)}", "", "", ""]
        table.add_row(name, *cells, str(sum(len(each.wrong) for each in group)), *_parameters(group))
    return table


def _named_of(group: list[Score]) -> str:
    """``named/of``; for effects outside the catalogue, which cannot be named: ``seen/of seen``."""
    if not group:
        return ""
    if group[0].kind == "outside":
        return f"{sum(each.alarmed for each in group)}/{len(group)} seen"
    return f"{sum(each.covered for each in group)}/{len(group)}"


def _by_strength(scores: list[Score]) -> Table:
    heads = ("strength", "sessions", "named exactly", "or with equivalents", "wrongly named", "missed", "error, median σ", "within 3 σ")
    table = Table(*heads, "excess gone", title="sessions that hide effects of the catalogue, by the weakest of them")
    hidden = [each for each in scores if each.kind in HIDDEN]
    for strength in (*STRENGTHS, None):
        group = hidden if strength is None else [each for each in hidden if each.strength == strength]
        if group:
            counts = map(str, _counts(group).values())
            table.add_row("all" if strength is None else f"× {strength:g}", str(len(group)), *counts, *_parameters(group))
    return table


def _counts(group: list[Score]) -> dict[str, int]:
    """Number of sessions by naming result."""
    return {
        "named_exactly": sum(each.exact for each in group),
        "named_with_equivalents": sum(each.covered for each in group),
        "wrongly_named": sum(bool(each.wrong) for each in group),
        "missed": sum(bool(each.missed) for each in group),
    }


def _by_probability(scores: list[Score]) -> Table:
    table = Table("stated probability", "names", "share right", "mean stated", title="is a stated probability what it says?")
    for each in reliability(one for scored in scores for one in scored.statements):
        if each.low >= CLAIMS_FROM and each.share_right is not None and each.mean_stated is not None:
            right, stated = f"{100 * each.share_right:.1f} %", f"{100 * each.mean_stated:.1f} %"
            table.add_row(f"{each.low:g} to {each.high:g}", str(each.number), right, stated)
    return table


def _by_session(scores: list[Score]) -> Table:
    table = Table("by", "", "sessions", "wrongly named", "nothing hidden", "false alarms", title="where alarms and wrong names come from")
    for row in groups(scores):
        table.add_row(*map(str, row.values()))
    return table


def _parameters(group: Sequence[Score]) -> tuple[str, str, str]:
    sigmas = [x for each in group for x in each.sigmas]
    removed = [each.removed for each in group if each.removed is not None]
    return (
        f"{np.median(sigmas):.2f}" if sigmas else "–",
        f"{100 * np.mean(np.array(sigmas) < 3):.0f} %" if sigmas else "–",
        f"{100 * np.median(removed):.1f} %" if removed else "–",
    )


def totals(scores: list[Score]) -> dict:
    """Counts and medians over all sessions, JSON-ready."""
    kinds = {kind: [each for each in scores if each.kind == kind] for kind in KINDS}
    hidden = [each for kind in HIDDEN for each in kinds[kind]]
    sigmas = [x for each in hidden for x in each.sigmas]
    right = [x for each in hidden for x in each.right]
    removed = [each.removed for each in hidden if each.removed is not None and each.found]
    stated = [one for each in scores for one in each.statements]
    return {
        "sessions": len(scores),
        "refused": sum(each.verdict == "refused" for each in scores),
        "nulls": len(kinds["nothing"]),
        "false_alarms": sum(each.alarmed for each in kinds["nothing"]),
        "hidden": len(hidden),
        **_counts(hidden),
        "outsiders": len(kinds["outside"]),
        "outsiders_seen": sum(each.alarmed for each in kinds["outside"]),
        "outsiders_wrongly_named": sum(bool(each.wrong) for each in kinds["outside"]),
        "outsiders_undecided": sum(bool(each.claimed) and not each.wrong for each in kinds["outside"]),
        "kinds": [{"kind": kind, "sessions": len(group), **_counts(group)} for kind, group in kinds.items() if group],
        "groups": groups(scores),
        "reliability": [vars(each) for each in reliability(stated)],
        "ece": calibration_error(stated),
        "ece_claimed": calibration_error(one for one in stated if one.claimed),
        "error_median_sigmas": float(np.median(sigmas)) if sigmas else None,
        "share_within_3_sigmas": float(np.mean(np.array(sigmas) < 3)) if sigmas else None,
        "share_within_3_sigmas_or_tenth": float(np.mean(right)) if right else None,
        "excess_removed_median": float(np.median(removed)) if removed else None,
    }


def sentences(scores: list[Score]) -> list[str]:
    """The totals as sentences."""
    t = totals(scores)
    lines = [
        f"{t['hidden']} sessions hide one to four effects: {t['named_exactly']} named exactly, {t['named_with_equivalents']} exactly or "
        f"with equivalents that contain the truth, {t['wrongly_named']} with a wrong name, {t['missed']} with something missed",
        *_by_kind(t["kinds"]),
        f"{t['nulls']} hide nothing: {t['false_alarms']} false alarms",
        f"{t['outsiders']} hide what no catalogue has: {t['outsiders_seen']} seen, {t['outsiders_wrongly_named']} wrongly given a name, "
        f"{t['outsiders_undecided']} said to be ambiguous between a name and a shape without one",
    ]
    if t["error_median_sigmas"] is not None:
        lines.append(
            f"parameters: median error {t['error_median_sigmas']:.2f} sigmas, {100 * t['share_within_3_sigmas']:.1f} % within 3 sigmas, "
            f"{100 * t['share_within_3_sigmas_or_tenth']:.1f} % within 3 sigmas or a tenth"
        )
    if t["excess_removed_median"] is not None:
        lines.append(f"share of the held-out misfit removed: median {100 * t['excess_removed_median']:.1f} %")
    if t["ece"] is not None:
        claimed = "" if t["ece_claimed"] is None else f" ({100 * t['ece_claimed']:.1f} % over the names that are claimed)"
        lines.append(f"stated probabilities: expected calibration error {100 * t['ece']:.1f} %{claimed}")
    if t["refused"]:
        lines.append(f"{t['refused']} were refused by the first look")
    return lines


def _by_kind(kinds: list[dict]) -> list[str]:
    """A line for each kind of session with several effects."""
    return [
        f"{each['sessions']} hide {'one or two effects ' if each['kind'] == 'beside' else ''}{TITLES[each['kind']]}: "
        f"{each['named_with_equivalents']} right, {each['wrongly_named']} with a wrong name, {each['missed']} with something missed"
        for each in kinds
        if each["kind"] in ("two", "three", "four", "beside")
    ]


# The blind test from end to end: inject, seal, explain, open, score.

ROOT = Path(__file__).resolve().parents[3]


def examine(
    folder: Path,
    count: int,
    seed: int,
    *,
    segments: int | None = None,
    announce: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Examination[Score]:
    """Test ``explain`` on ``count`` sessions in ``folder``, which must be empty or new.

    segments: of every session, instead of drawn; announce: called with the SHA-256 before anything is explained.
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
    """Make the folder of a blind test.  FormatError where it is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FormatError(f"{folder}: not empty; give a new folder")
    with naming(folder):
        (folder / SESSIONS).mkdir(parents=True)


def hide(folder: Path, cases: list[Case], progress: Callable[[str, int, int], None], makers: Mapping[str, Maker] = MAKERS) -> Seal:
    """Write the session folders, and the sealed truth next to them."""
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
            "instability_source": case.instability_source,
            "options": options_chosen(case.options),
        }
    return seal(truth, folder / SEALED)


def explained(folder: Path, discover: bool = False) -> dict:
    """``tinygc-explain/2`` of a session folder from a process of its own with the same effect folders (verdict ``refused`` where it
    refuses); discover: search for laws, too, and write their files there."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tinygc.annexes.challenge.worker", *([DISCOVER] if discover else []), ".", *map(str, loaded_folders())]
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if run.returncode != 0:
        raise DataError(f"{folder.name}: explaining ended with {run.returncode}: {run.stderr.strip()[-500:]}")
    return json.loads(run.stdout)


def without_sessions(folder: Path, everything: bool = False) -> None:
    """Remove the sessions of a blind test, or its whole folder."""
    shutil.rmtree(folder if everything else folder / SESSIONS)


def to_json(result: Examination[Score]) -> dict:
    """``tinygc-challenge/2``: every session with its truth, its answer and its score, and the totals."""

    def more(score: Score, said: dict) -> dict:
        named = {effect["id"]: effect["equivalent"] for effect in said["effects"]}
        return {"named": named, "score": vars(score) | {"kind": score.kind, "statements": [vars(one) for one in score.statements]}}

    return as_table("tinygc-challenge/2", result, totals(result.scores), more)
