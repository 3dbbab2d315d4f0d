"""``check``: a first examination of a session."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.errors import CalibrationError
from session.base.names import is_session
from session.base.options import argument, folder_written, option
from tinygc.cli.logs import of_session
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import complain, output, verdict, write_json


@dataclass(frozen=True)
class Options(Command, UsesEffects):
    """Options of ``check``."""

    folder: Path = argument("session folder, or an array's; or one with sessions, three folders deep (this one)", Path())
    strict: bool = option(False, "exit 1 on warnings", rare=True)
    all: bool = option(False, "all that was checked, what is ok included")
    plan: int | None = option(None, "which movements to record next, so many at most (5)", least=1, alone=5)
    repair: Path | None = option(
        None, "write the corrected copy of a session whose errors have a known cause", metavar="OUT", read=folder_written
    )
    cause: int | None = option(None, "with --repair: which of several causes that explain an error alike", rare=True)


def run(args: Options) -> int:
    """Print a first examination of a session, or its plan, or write its corrected copy; of a folder of sessions, list them."""
    args, _ = of_session(args)
    if args.repair is not None:
        return _repair(args, args.repair)
    if args.cause is not None:
        raise CalibrationError("--cause names one of several causes for --repair; add --repair OUT")
    if args.plan is not None:
        return _plan(args, args.plan)
    if not args.folder.exists():
        raise CalibrationError(f"{args.folder}: no such folder")
    if args.folder.is_dir() and not is_session(args.folder) and not any(args.folder.glob("*.csv*")):
        return _list(args)
    from session.detect.findings import worst
    from tinygc.library.checks import check
    from tinygc.reporting.tables import finding_lines, next_line, unit_lines, verdict_line

    findings = check(args.folder)
    console = output(args)
    for line in (verdict_line(findings, with_worst=False), *unit_lines(findings)):  # one line each, for readers by program
        console.print(line)
    console.print(finding_lines(findings, args.all))
    console.print(next_line(args.folder, findings))
    if worst(findings) != "error":
        verdict(args, verdict_line(findings))
    write_json(args.json, {"schema": "tinygc-check/2", "findings": findings})
    if worst(findings) == "error":
        if output(args).quiet:  # without the table, print at least what prevents a calibration
            errors = [finding for finding in findings if finding.level == "error"]
            complain(errors[0].line + (f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""))
        return 2
    return 1 if args.strict and worst(findings) == "warning" else 0


def _repair(args: Options, out: Path) -> int:
    """Write the corrected copy of a session, and show what it closes to before and after."""
    args.refuse_with("--repair", "repair", "cause")
    from session.detect.repair import repair
    from tinygc.fitting.fit import closure_of
    from tinygc.reporting.tables import repair_report, verdict_line

    done = repair(args.folder, out, args.cause)
    before, after = closure_of(done.source), closure_of(done.folder)
    output(args).print(repair_report(done, before, after))
    verdict(args, verdict_line(list(done.findings)))
    write_json(args.json, {**done.to_json(), "closure": {"before": before, "after": after}, "findings": done.findings})
    return 2 if any(finding.level == "error" for finding in done.findings) else 0


def _plan(args: Options, count: int) -> int:
    """Recommend what to record next."""
    args.refuse_with("--plan", "plan")
    from tinygc.library.sessions import plan

    found = plan(args.folder, count=count)
    for line in found.lines:
        output(args).print(line)
    write_json(args.json, found.to_json())
    return 0


def _list(args: Options) -> int:
    """List the sessions of a folder, with the last result of each; one that cannot be read is listed with the reason."""
    from tinygc.library.known import list_sessions
    from tinygc.reporting.tables import sessions_table

    sessions = list_sessions(args.folder)
    output(args).print(*sessions_table(args.folder, sessions), sep="\n")
    write_json(args.json, {"schema": "tinygc-list/1", "sessions": sessions})
    return 0
