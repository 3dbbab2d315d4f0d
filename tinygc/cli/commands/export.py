"""``export``: write a calibration in another program's format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, folder_written, option, values
from session.base.texts import command_line
from tinygc.cli.options import Command, UsesEffects
from tinygc.cli.results import complain, output, write_json
from tinygc.deploy import FORMATS, ExportOptions, format_named


@dataclass(frozen=True)
class Options(ExportOptions, Command, UsesEffects):
    """Options of ``export``."""

    folder: Path = argument("session folder that was fitted, or noise.json")
    to: str = option(..., f"one of {', '.join(FORMATS)}", metavar="FORMAT", read=format_named, choices=tuple(FORMATS))
    out: Path | None = option(None, "where the files go (export/ in the session folder)", metavar="DIR", read=folder_written)


def run(args: Options) -> int:
    """Write a calibration in another program's format."""
    from tinygc.library.reports import export

    made = export(args.folder, args.to, **values(args, ExportOptions))
    home = args.folder.parent if args.folder.is_file() else args.folder
    written = made.save(args.out or home / "export")
    console = output(args)
    console.print(f"written: {', '.join(map(str, written))}")
    for remark in made.remarks:
        complain(remark) if console.quiet else console.print(remark, style="yellow")
    if args.folder.is_dir():
        console.print(f"next, on a later day: {command_line('verify', args.folder, 'TODAY')}", soft_wrap=True)
    write_json(args.json, made.to_json(written))
    return 0
