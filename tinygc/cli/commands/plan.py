"""``plan``: recommend what to record next."""

from __future__ import annotations

import argparse

from tinygc.cli.arguments import count, path_read
from tinygc.cli.extensions import help_if_present
from tinygc.cli.results import output, write_json

SUMMARY = "say which movements to record next"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, help="session folder")
    lot = help_if_present("a lot as prior (--lot)", "prior from a production lot (lot.json): fewer turns are enough")
    command.add_argument("--lot", type=path_read, metavar="FILE", help=lot)
    command.add_argument("--count", type=count(1), default=5, help="movements at most (%(default)s)")


def run(args: argparse.Namespace) -> int:
    """Recommend what to record next."""
    from tinygc.planning.proposals import propose

    plan = propose(args.folder, args.count, args.lot)
    proposals, asked = plan.proposals, plan.asked
    console = output(args)
    if plan.lot is not None:
        console.print(plan.lot.words, soft_wrap=True)
    if asked:
        console.print(f"explain asks: {asked}")
    for number, proposal in enumerate(proposals, start=1):
        console.print(
            f"{number}. {proposal.words}: {proposal.parameter}, {proposal.now:.1f} -> {proposal.after:.1f} times its target sigma"
        )
    if proposals and plan.enough is not None:
        console.print(f"{plan.enough} more turn{'s are' if plan.enough != 1 else ' is'} enough for every target")
    if not proposals:
        accelerometer = "of the accelerometer 50 ppm, or 100 where it is given, 0.05 mrad, 0.05 mg"
        done = f"every parameter has reached its target sigma (50 ppm, 0.05 mrad, 2 mdps; {accelerometer})"
        console.print(f"{done}: nothing more is needed" + (" for the linear calibration" if asked else ""))
    lot = None if plan.lot is None else plan.lot.to_json()
    found = {"requested": asked, "proposals": [vars(proposal) for proposal in proposals], "enough": plan.enough, "lot": lot}
    write_json(args.json, {"schema": "tinygc-plan/2", **found})
    return 0
