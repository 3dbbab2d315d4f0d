"""``verify``: whether a stored calibration still holds, by a short session, with turns or a minute at rest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, file_written, option, values
from tinygc.cli.options import Command, Force, UsesEffects
from tinygc.cli.results import output, try_file, try_json, verdict, write_json
from tinygc.features.unit.options import VerifyOptions


@dataclass(frozen=True)
class Options(VerifyOptions, Command, UsesEffects, Force):
    """Options of ``verify``."""

    model: Path = argument("a model file, or a fitted session folder", metavar="MODEL")
    today: Path = argument("a session folder: turns and rests, or a minute at rest", metavar="TODAY")
    write: Path | None = option(None, "write the model with the bias of today's recording", read=file_written)


def run(args: Options) -> int:
    """Verify a calibration, print the verdict, and return its exit code."""
    from tinygc.features.unit.verification.verdict import verify
    from tinygc.reporting.terminal import progress_bar

    if args.write is not None:
        try_file(args.write, args.json)
    try_json(args.json)
    with progress_bar(args.quiet) as progress:
        found = verify(args.model, args.today, progress=progress, **values(args, VerifyOptions))
    output(args).print(found.page)
    verdict(args, found.verdict_line)
    if args.write is not None:
        found.save_model(args.write)
        output(args).print(f"written: {args.write}")
    write_json(args.json, found.to_json())
    return found.exit_code
