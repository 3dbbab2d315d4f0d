"""``import``: make a session folder of any log, or of bytes captured from a port."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import argument, folder_written, option, part, values
from session.replay.options import GROUP, Answers, Into, Place
from tinygc.cli.arguments import memory, stream_header
from tinygc.cli.logs import ask_latitude
from tinygc.cli.options import Command
from tinygc.cli.results import output, write_json

#: lines of how a log was read, and of what is wrong with it
MOST_LINES, MOST_DOUBTS = 7, 2
#: what a further log may add to the session
MAY_FOLLOW = ("turns", "stills", "length")


@dataclass(frozen=True)
class Options(Answers, Into, Place, Command):
    """Options of ``import``."""

    logs: tuple[Path, ...] = argument("the log; or gyroscope's and accelerometer's; or raw.bin", (), metavar="LOG")
    out: Path | None = option(None, "session folder to make (named as the log, next to it)", metavar="DIR", read=folder_written)
    list: bool = option(False, "list what is read, each with an example line")
    header: str | None = option(
        None, "of raw.bin in text that does not hold it, as t_us,gx_dps", metavar="LINE", read=stream_header, rare=True
    )
    even: bool = option(
        False, "count the samples along their stamps, which scatter or are rounded: at one rate, on straight lines between gaps", rare=True
    )
    most_memory: int | None = option(
        None,
        "memory that reading may take, such as 3GB (1GB, or 20 times what the files take on the disk)",
        metavar="SIZE",
        read=memory,
        rare=True,
    )
    columns: tuple[str, ...] = option(  # type: ignore[assignment]  # of one file ``Answers`` has one
        (),
        "of any other table: t_us=NAME,gx_dps=NAME and so on to temp_c=NAME; once for each file",
        metavar="LIST",
        repeated=True,
        read=str,
        group=GROUP,
    )


def run(args: Options) -> int:
    """Convert a log to a session folder."""
    from session.base.errors import FormatError
    from session.detect.check_samples import HELD
    from session.replay.importing import import_log, known_logs, with_latitude

    console = output(args)
    if args.list:
        readers = [{"name": name, "example": example, "needs": needs} for name, example, needs in known_logs()]
        for each in readers:
            console.print(each["name"] + (f" ({each['needs']})" if each["needs"] else ""))
            console.print(f"    {each['example']}")
        write_json(args.json, {"schema": "tinygc-readers/1", "readers": readers})
        return 0
    if not args.logs:
        raise FormatError("import: no log; give its file, or --list for what is read")
    if len(args.columns) > len(args.logs):
        files = f"{len(args.logs)} file{'s' * (len(args.logs) != 1)}"
        raise FormatError(f"--columns is given {len(args.columns)} times for {files}; give it once for each")
    one, columns = (args.columns[0], ()) if len(args.columns) == 1 else (None, args.columns)
    made = import_log(
        args.logs,
        args.out,
        part(args, Answers, columns=one),
        **values(args, Into),
        **values(args, Place),
        columns=columns,
        header=args.header,
        further=args.of_features,
        most_memory=args.most_memory,
    )
    if len(made.next) > 1 and (latitude_deg := ask_latitude(args.quiet)) is not None:
        made = with_latitude(made, latitude_deg)
    errors = [finding for finding in made.findings if finding.level == "error"]
    console.print(made.headline)
    for line in (*made.took, *made.repairs)[:MOST_LINES]:
        console.print(f"  {line}")
    doubts = [finding for finding in made.findings if finding.level == "warning" or finding.what == HELD]  # how fast each sensor is
    for finding in (errors or doubts)[:MOST_DOUBTS]:
        console.print(f"  {finding.level}: {finding.line.split(';')[0]}")
    for step in made.next:
        console.print(step if step.startswith("optional") else f"next: {step}")
    write_json(args.json, made)
    return 2 if any(finding.what not in MAY_FOLLOW for finding in errors) else 0
