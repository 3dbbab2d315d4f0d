"""What every job on a session begins with: read it, look for boring causes, find its stills, build the problem.  Each once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from session.checks.accelerometer import WHAT, with_own_accelerometer
from session.checks.findings import Finding, stop_at_errors
from session.checks.first_look import check_session
from session.detect.session_stills import SessionStills
from session.log.folder import Session, read_session
from tinygc.problem.build import build_problem
from tinygc.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class Prepared:
    """findings of the first look, none of them an error; problem of the session."""

    findings: list[Finding]
    problem: Problem

    @property
    def session(self) -> Session:
        """That it was made of."""
        return self.problem.session

    @property
    def warnings(self) -> list[Finding]:
        """What costs accuracy, and an accelerometer that the session itself has calibrated."""
        return [finding for finding in self.findings if finding.level == "warning" or finding.what == WHAT]


def prepare(
    session: Session | Path, *, use_earth: bool = True, exclude: tuple[int, ...] = (), progress: Callable[[str], None] = lambda what: None
) -> Prepared:
    """From a session, or a session folder, to its problem.

    Raises DataError for the first error of the first look, and the errors of ``read_session`` and ``build_problem``.
    """
    if not isinstance(session, Session):
        session = read_session(session, lambda name: progress(f"reading {name}"))
    session, own = with_own_accelerometer(session)
    progress("first look")
    found = SessionStills(session)
    findings = own + check_session(session, found)
    stop_at_errors(findings)
    return Prepared(findings, build_problem(session, use_earth=use_earth, exclude=exclude, found=found, progress=progress))
