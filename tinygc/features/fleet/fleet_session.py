"""Check, fit and explain one session into a row, in this process, another one, or on another machine."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from session import VERSION
from session.base.errors import CalibrationError
from session.base.texts import printable
from session.detect.check_stills import check_rests
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder
from session.log.config import Config, read_config
from session.log.folder import Session, read_session
from tinygc.closure.prepared import Prepared, first_look_at_fit
from tinygc.effects import using
from tinygc.estimation.session_times import date_of
from tinygc.explanation.engine import explain_session
from tinygc.features.fleet.fleet_row import DONE, FAILED, FleetOptions, Row, cell_of, effects_hash, empty, fitted, key_of, number, told_by
from tinygc.fitting.fit import fit_session, prepared_for
from tinygc.fitting.results import FitResult

#: length limits of an error message, and of the findings in a row: a hundred thousand of them are stored
MOST_ERROR, MOST_FINDINGS = 500, 20
#: a cluster's worker may run several tasks in parallel, which share the catalogue of effects and the memory
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Job:
    """Job for one session.

    folder, as the computing process finds it; key of its content when the job was made; version that made the job.
    """

    folder: str
    key: str
    options: FleetOptions
    version: str = VERSION


@dataclass(frozen=True)
class Outcome:
    """Result of a job: key; row, None where nothing may be stored, with the reason in trouble; cpu_s and wall_s of the job."""

    key: str
    row: Row | None
    trouble: str = ""
    cpu_s: float = 0.0
    wall_s: float = 0.0


def compute(job: Job) -> Outcome:
    """Compute a job's outcome; errors of a session are stored in its row.

    Raises CalibrationError for errors of the process: another version than the job's, missing effects, or other effect files than the
    job's.
    """
    with _ONE_AT_A_TIME, using(job.options.effects):
        if job.version != VERSION:
            raise CalibrationError(f"a worker runs TinyGC {VERSION}, this is {job.version}; install the same version everywhere")
        began, cpu = time.perf_counter(), time.process_time()
        folder, row = Path(job.folder), empty() | {"status": DONE}
        with _failing_at("check", row, folder):
            _fill(row, folder, job.options)
        try:
            after = key_of(folder, job.options)
        except CalibrationError as error:
            trouble = str(error)
        else:
            trouble = "" if after == job.key else f"{folder}: changed while it was read; run again"
        if job.options.effects and effects_hash(job.options.effects) != job.options.effects_sha256:
            where = ", ".join(job.options.effects)
            raise CalibrationError(f"{where}: effects have changed, or are others where a worker runs; let them be, and run again")
        return Outcome(job.key, None if trouble else row, trouble, time.process_time() - cpu, time.perf_counter() - began)


def _fill(row: Row, folder: Path, options: FleetOptions) -> None:
    _kept_config(row, folder, read_config(folder / "session.toml"))
    if options.steps == ("check",):
        _kept_findings(row, folder, check_folder(folder, first_look_at_fit))
        errors = [finding for finding in told_by(row["findings"]) if finding["level"] == "error"]
        if errors:
            raise CalibrationError(": ".join(errors[0][key] for key in ("where", "what", "description")))
        return
    session = read_session(folder)
    prepared = prepared_for(session, options.of_fit, lambda what, done, of: None)
    if "check" in options.steps:
        _kept_findings(row, folder, prepared.findings + check_rests(session.rests, session.config.sensor))
    fit = None
    if "fit" in options.steps:
        with _failing_at("fit", row, folder):
            fit = fit_session(session, options.of_fit, prepared=prepared)
            row |= fitted(fit)
    if "explain" in options.steps and row["status"] == DONE:
        with _failing_at("explain", row, folder):
            row |= _explained(session, prepared, options, fit)


@contextlib.contextmanager
def _failing_at(step: str, row: Row, folder: Path) -> Iterator[None]:
    """Store a step's error as the row's one line; earlier results stay."""
    try:
        yield
    except MemoryError:
        raise  # the process is in an unknown state: the parent treats it as dead
    except (CalibrationError, OSError) as error:
        said = str(error) if isinstance(error, CalibrationError) else f"{error.filename or folder}: {error.strerror or error}"
        row |= {"status": FAILED, "step": step, "error": _without_folder(said, folder)}
    except Exception as error:  # one session must not end a run of a hundred thousand
        row |= {"status": FAILED, "step": step, "error": _without_folder(f"internal error: {type(error).__name__}: {error}", folder)}


def _without_folder(said: str, folder: Path) -> str:
    """Remove the folder's name from a line, since copies of a session have other folders."""
    for where in sorted({str(folder), str(folder.resolve())}, key=len, reverse=True):
        said = said.replace(f"{where}/", "").replace(f"{where}: ", "").replace(where, "the session")
    return printable(said)[:MOST_ERROR]


def _kept_config(row: Row, folder: Path, config: Config) -> None:
    """Store a session's configuration, also where its logs cannot be read."""
    notes, sensor = config.notes, config.sensor
    recorded = _moment(date_of(folder, config)[0])
    row |= {"model": printable(sensor.model), "serial": printable(sensor.serial), "recorded": recorded}
    row |= {name: printable(str(notes[name])) if name in notes else None for name in ("operator", "station")}


def _moment(text: str | None) -> str | None:
    """Return ISO 8601, in UTC where the zone is known, so that rows sort by time; None for text that is no date."""
    try:
        found = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    if found.tzinfo is not None:
        return found.astimezone(UTC).isoformat(timespec="seconds")
    return text if len(text or "") == len("2026-01-05") else found.isoformat(timespec="seconds")


def _kept_findings(row: Row, folder: Path, findings: list[Finding]) -> None:
    """Store the highest severity, and all findings worth reporting."""
    name = printable(folder.resolve().name)
    worth = sorted((finding for finding in findings if finding.level in ("warning", "error")), key=lambda each: each.level)
    told = [
        {"level": each.level, "where": "session" if each.where == name else each.where, "what": each.what}
        | {"description": _without_folder(each.says, folder), "advice": _without_folder(each.do, folder)}
        for each in worth[:MOST_FINDINGS]
    ]
    row |= {"first_look": worst(findings), "findings": cell_of(told)}


def _explained(session: Session, prepared: Prepared, options: FleetOptions, fit: FitResult | None) -> Row:
    how: dict[str, Any] = {"seed": options.seed, "use_earth": options.earth}
    if session.reference is not None:
        found = session.reference.explain(session, **how)
    else:
        found = explain_session(session, prepared=prepared, fit=fit, **how)
    effects = cell_of([claim.to_json() for claim in found.claimed])
    return {"verdict": found.verdict, "p_value": number(found.p_value), "effects": effects}
