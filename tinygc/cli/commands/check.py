"""``check``: a first examination of a session."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import path_read
from tinygc.cli.results import complain, output, verdict, write_json

SUMMARY = "a first look at a session: units, scales, rates, gaps, axes, stills"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder, or an array's")
    command.add_argument("--strict", action="store_true", help="exit 1 on warnings")


def run(args: argparse.Namespace) -> int:
    """Print a first examination of a session."""
    from session.detect.findings import worst
    from tinygc.library.sessions import check
    from tinygc.reporting.tables import findings_table, next_line, unit_lines, verdict_line

    findings = check(args.folder)
    console = output(args)
    console.print(findings_table(findings))
    console.print()
    for line in (
        *unit_lines(findings),
        verdict_line(findings),
        next_line(args.folder, findings),
    ):  # one line each, for readers by program
        console.print(line, soft_wrap=True)
    if worst(findings) != "error":
        verdict(args, verdict_line(findings))
    write_json(args.json, {"schema": "tinygc-check/2", "findings": [finding.to_json() for finding in findings]})
    if worst(findings) == "error":
        if output(args).quiet:  # without the table, print at least what prevents a calibration
            errors = [finding for finding in findings if finding.level == "error"]
            complain(errors[0].line + (f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""))
        return 2
    return 1 if args.strict and worst(findings) == "warning" else 0
