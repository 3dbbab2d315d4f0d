"""``compare``: compare sessions of one sensor."""

from __future__ import annotations

import argparse

from session.base.options import path_read
from tinygc.cli.results import output, verdict, write_json

SUMMARY = "say whether the calibrations of several sessions of one sensor agree"
USES_EFFECTS = True


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folders", type=path_read, nargs="+", metavar="DIR", help="session folders that were fitted, two or more")
    command.add_argument("--bias", action="store_true", help="the bias counts, too: the sensor was never switched off in between")
    command.add_argument("--strict", action="store_true", help="exit 1 if they differ (p < 0.01)")
    command.add_argument("--limit", type=_probability, metavar="P", help="exit 1 if the p-value is below this")


def run(args: argparse.Namespace) -> int:
    """Compare sessions of one sensor."""
    from tinygc.fitting.compare import DIFFERS_P
    from tinygc.library.comparisons import compare

    found = compare(args.folders, bias=args.bias)
    output(args).print(found.page)
    verdict(args, found.verdict_line)
    write_json(args.json, found.to_json())
    limits = [limit for limit in (args.limit, DIFFERS_P if args.strict else None) if limit is not None]
    return 1 if any(found.p_value < limit for limit in limits) else 0


def _probability(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text} is no probability")
    return value


_probability.__name__ = "number"
