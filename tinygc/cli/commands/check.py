"""``check``: a first examination of a session."""

from __future__ import annotations

import argparse

from session.base.errors import CalibrationError
from session.base.options import folder_written, path_read
from session.base.records import plain
from tinygc.cli.options import add_clock_argument
from tinygc.cli.results import complain, output, verdict, write_json

SUMMARY = "a first look at a session: units, scales, rates, gaps, axes, stills"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder, or an array's")
    add_clock_argument(command)
    command.add_argument("--strict", action="store_true", help="exit 1 on warnings")
    command.add_argument("--all", action="store_true", help="a table of all that was looked at, what is ok included")
    command.add_argument(
        "--repair", type=folder_written, metavar="OUT", help="write the corrected copy of a session whose errors have a known cause"
    )
    command.add_argument("--cause", type=int, metavar="N", help="with --repair: which of several causes that explain an error alike")


def run(args: argparse.Namespace) -> int:
    """Print a first examination of a session, or write its corrected copy."""
    if args.repair is not None:
        return _repair(args)
    if args.cause is not None:
        raise CalibrationError("--cause names one of several causes for --repair; add --repair OUT")
    from session.detect.findings import worst
    from tinygc.library.checks import check
    from tinygc.reporting.tables import finding_lines, findings_table, next_line, unit_lines, verdict_line

    findings = check(args.folder, args.clock)
    console = output(args)
    for line in (verdict_line(findings, with_worst=False), *unit_lines(findings)):  # one line each, for readers by program
        console.print(line, soft_wrap=True)
    console.print(findings_table(findings) if args.all else finding_lines(findings))
    console.print(next_line(args.folder, findings), soft_wrap=True)
    if worst(findings) != "error":
        verdict(args, verdict_line(findings))
    write_json(args.json, {"schema": "tinygc-check/2", "findings": plain(findings)})
    if worst(findings) == "error":
        if output(args).quiet:  # without the table, print at least what prevents a calibration
            errors = [finding for finding in findings if finding.level == "error"]
            complain(errors[0].line + (f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""))
        return 2
    return 1 if args.strict and worst(findings) == "warning" else 0


def _repair(args: argparse.Namespace) -> int:
    """Write the corrected copy of a session, and show what it closes to before and after."""
    from session.detect.repair import repair
    from tinygc.fitting.before_after import closure_of
    from tinygc.reporting.tables import repair_report, verdict_line

    done = repair(args.folder, args.repair, args.cause)
    before, after = closure_of(done.source), closure_of(done.folder)
    output(args).print(repair_report(done, before, after))
    verdict(args, verdict_line(list(done.findings)))
    closure = {"before": before.to_json(), "after": after.to_json()}
    write_json(args.json, {**done.to_json(), "closure": closure, "findings": plain(done.findings)})
    return 2 if any(finding.level == "error" for finding in done.findings) else 0
