"""``plan``: what to record next."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import count
from tinygc.cli.commands._results import output, write_json
from tinygc.cli.paths import path_read

SUMMARY = "say which movements to record next"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The command's own arguments."""
    command.add_argument("folder", type=path_read, help="session folder")
    command.add_argument("--count", type=count(1), default=5, help="movements at most (%(default)s)")


def run(args: argparse.Namespace) -> int:
    """What to record next."""
    from tinygc.plan.proposals import propose

    proposals, asked = propose(args.folder, args.count)
    console = output(args)
    if asked:
        console.print(f"explain asks: {asked}")
    for number, proposal in enumerate(proposals, start=1):
        console.print(
            f"{number}. {proposal.words}: {proposal.parameter}, {proposal.now:.1f} -> {proposal.after:.1f} times its target sigma"
        )
    if not proposals:
        accelerometer = "of the accelerometer 50 ppm, or 100 where it is given, 0.05 mrad, 0.05 mg"
        done = f"every parameter has reached its target sigma (50 ppm, 0.05 mrad, 2 mdps; {accelerometer})"
        console.print(f"{done}: nothing more is needed" + (" for the linear calibration" if asked else ""))
    write_json(args.json, {"schema": "tinygc-plan/1", "asked": asked, "proposals": [vars(proposal) for proposal in proposals]})
    return 0
