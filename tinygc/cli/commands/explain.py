"""``explain``: explain differences between recording and simulation."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from session.base import features
from session.base.options import argument, folder_written, option, values
from session.base.texts import command_line
from tinygc.cli.logs import of_session
from tinygc.cli.options import Command, Pictures, UsesEffects
from tinygc.cli.results import inside, output, print_commands, try_destinations, verdict, write_json
from tinygc.estimation.options import AtRest, Seed

#: recordings of the unit that are offered for a check; each takes as long as the first
MOST_OFFERED = 3


@dataclass(frozen=True)
class Options(AtRest, Pictures, Command, UsesEffects, Seed):
    """Options of ``explain``."""

    folder: Path = argument("session folder")
    check_on: tuple[Path, ...] = option(
        (), "other recordings of the unit, or a folder of them: each effect is checked there with the size that it has here", several=True
    )
    out: Path | None = option(None, "where the result goes (explain/ in the session folder)", metavar="DIR", read=folder_written)
    strict: bool = option(False, "exit 1 if there is a mismatch")
    verbose: bool = option(False, "print residuals, noise, alternatives and all limits")


def run(args: Options) -> int:
    """Explain differences between recording and simulation."""
    args, _ = of_session(args)
    if (code := features.first("explanation of a folder", args)) is not None:
        return code
    from session.log.siblings import sibling_sessions
    from tinygc.library.explanations import explain
    from tinygc.reporting.checked_text import checked_page
    from tinygc.reporting.facts import screen
    from tinygc.reporting.terminal import progress_bar

    try_destinations(args.out or inside(args.folder, "explain"), args.json)
    with progress_bar(args.quiet) as progress:
        why = explain(args.folder, check_on=args.check_on, progress=progress, **values(args, Seed, AtRest), **args.further)
    folder = why.save(args.out, pictures=args.pictures)
    console, offers = output(args), why.offers(folder, args.effects)
    console.print(screen([*why.parts(brief=not args.verbose), *checked_page(why.checked)]))
    for line in (*why.notes, f"written: {folder}"):
        console.print(line)
    if why.effects and not args.check_on and (others := sibling_sessions(args.folder)):
        names = [os.path.relpath(other) for other in others[:MOST_OFFERED]]
        check = command_line("explain", args.folder, "--check-on", *names)
        offers.append(("or check it on other recordings of this unit:", [check]))
    for title, commands in offers:
        print_commands(args, title, *commands)
    verdict(args, why.verdict_line)
    write_json(args.json, why.to_json())
    return 1 if args.strict and why.verdict != "no_mismatch" else 0
