"""``challenge``: blind test of the tool."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import option
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import output, try_json, write_json
from tinygc.estimation.options import Seed


@dataclass(frozen=True)
class Options(Command, UsesEffects, Seed):
    """Options of ``challenge``."""

    on: Path | None = option(None, "conceal them in copies of this recording, not in simulated sessions", metavar="DIR")
    cases: int = option(20, "number of sessions", least=1)


def run(args: Options) -> int:
    """Run the blind test and print its table."""
    from tinygc.features.challenge.examination import examine, page
    from tinygc.reporting.terminal import progress_bar

    try_json(args.json)
    with progress_bar(args.quiet) as progress:
        result = examine(args.cases, args.seed, args.on, progress=progress)
    output(args).print(page(result))
    write_json(args.json, result)
    return 0
