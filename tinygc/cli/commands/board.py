"""``board``: run a virtual board, to try the recorder without hardware."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import file_written, path_read
from session.base.texts import printable
from tinygc.cli.arguments import accel_full_scale, count, data_rate, gyro_full_scale, is_standard_output, positive, seconds
from tinygc.cli.results import ended_by_signals, write_json

if TYPE_CHECKING:
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.virtual_board import BoardSource

SUMMARY = "a virtual board: streams a session through a pseudo-terminal"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument("folder", type=path_read, nargs="?", help="session folder to stream (a simulated one)")
    command.add_argument("--rate", type=data_rate, default=416.0, metavar="HZ", help="data rate of the simulated sensor (%(default)g)")
    command.add_argument("--segments", type=count(1), default=40, help="turns of the simulated session (%(default)s)")
    command.add_argument(
        "--closure", type=seconds, default=0.0, metavar="S", help="closure run behind it, s, begun on the index mark (%(default)g: none)"
    )
    command.add_argument(
        "--raw-accelerometer",
        type=positive,
        nargs="?",
        const=30.0,
        metavar="MG",
        help="one that nobody has calibrated: bias of so many mg (30), scale 1 %%, axes 5 mrad; --config then says nothing of it",
    )
    takes = "which movement of the simulated sensor to stream (the next one that a board at this link has not begun yet)"
    command.add_argument("--take", type=count(1), metavar="N", help=takes)
    command.add_argument("--frames", action="store_true", help="send frames instead of text lines")
    command.add_argument("--physical", action="store_true", help="send text lines in dps, g and degC instead of registers")
    command.add_argument("--sensor", default="ASM330LHH", metavar="NAME", help="whose registers the simulated one has (%(default)s)")
    command.add_argument("--gyro-fs", type=gyro_full_scale, default=500.0, metavar="DPS", help="its full scale (%(default)g)")
    command.add_argument("--accel-fs", type=accel_full_scale, default=4.0, metavar="G", help="its full scale (%(default)g)")
    command.add_argument("--speed", type=positive, default=1.0, metavar="X", help="so many times faster than real (%(default)g)")
    command.add_argument("--lead", type=seconds, default=10.0, metavar="S", help="still time before the session (%(default)g)")
    command.add_argument("--tail", type=seconds, metavar="S", help="still time behind it, then stop (go on for ever)")
    command.add_argument("--uptime", type=seconds, default=0.0, metavar="S", help="device time at the start (%(default)g)")
    command.add_argument(
        "--faults",
        default="",
        metavar="NAME=X,…",
        help="lost, torn, flip: probability; garbage: bytes; reset, unplug: s",
    )
    command.add_argument(
        "--memory",
        type=count(1),
        metavar="BYTES",
        help="what it holds back while its reader is busy (65536, times --speed if that is above 1)",
    )
    command.add_argument("--link", type=file_written, metavar="PATH", help="name of the port (tinygc-board in the temporary folder)")
    on_table = "it lies on the virtual table of this table.toml, which has a port of its own, and turns with it"
    command.add_argument("--table", type=path_read, metavar="FILE", help=on_table)
    command.add_argument("--table-link", type=file_written, metavar="PATH", help="name of the table's port")
    command.add_argument("--table-faults", default="", metavar="NAME@S,…", help="what goes wrong with the table (docs/tables.md)")
    command.add_argument("--table-resets", action="store_true", help="the table restarts when its port is opened, as an Arduino Uno does")
    command.add_argument("--config", type=file_written, metavar="FILE", help="write the session.toml that belongs to the stream")


def run(args: argparse.Namespace) -> int:
    """Run a virtual board until Ctrl-C or the end of ``--tail``, then remove its port's link."""
    with ended_by_signals(ignored_interrupt=True):
        return _board(args)


def _board(args: argparse.Namespace) -> int:
    try:
        from tinygc.simulation.terminal import MEMORY_BYTES, Terminal
    except ImportError:
        raise CalibrationError(
            "board: a virtual board needs a pseudo-terminal, which only POSIX systems have (Linux, macOS); "
            "everything else runs here, record with a real port too"
        ) from None
    from session.base.results import write_text_whole
    from session.bench.clocks import HostClock
    from tinygc.simulation.virtual_board import LineFaults, VirtualBoard

    def say(what: str) -> None:
        if not args.quiet:
            print(printable(what), file=sys.stderr, flush=True)

    if args.frames and args.physical:
        raise CalibrationError("board: frames hold registers; leave --frames or --physical out")
    if args.folder and args.take:
        raise CalibrationError("board: a folder is streamed as it was recorded; leave --take out")
    if args.table and (args.folder or args.speed != 1):
        raise CalibrationError("board: --table is a board of its own, in real time; leave the folder and --speed out")
    if not args.table and (args.table_link or args.table_faults or args.table_resets):
        raise CalibrationError("board: --table-link, --table-faults and --table-resets are of a table; add --table FILE")
    faults = LineFaults.parse(args.faults)
    # A faster board needs a larger buffer, because the host is no faster.
    terminal = Terminal(args.link, args.memory or round(MEMORY_BYTES * max(1.0, args.speed)))
    table = None
    try:
        if args.table:
            calibrated = not args.raw_accelerometer
            given = (args.table, args.table_link, _options(args), calibrated, args.table_faults, args.table_resets)
            table = features.first("table under a virtual board", *given)
        source = table.source if table else _source(args, terminal.name, say)
        if args.config and source.config:
            write_text_whole(args.config, source.config)
    except BaseException:
        terminal.let_go()
        raise
    with terminal, table or nullcontext():
        if table:
            say(f"the table is at {table.name}")
        board = VirtualBoard(
            source=source,
            terminal=terminal,
            frames=args.frames,
            physical=args.physical,
            speed=args.speed,
            lead_s=args.lead,
            tail_s=args.tail,
            uptime_s=args.uptime,
            faults=faults,
            seed=args.seed,
            say=say,
            clock=table.clock if table else HostClock(),
        )
        try:
            if not args.quiet and not is_standard_output(args.json):
                print(terminal.name, flush=True)
            say(f"{source.info.text}: open it with another program; Ctrl-C ends")
            board.run()
        finally:
            say(f"{board.sent} samples sent, {terminal.dropped} writes dropped since nobody read")
            told = {"samples": board.sent, "dropped": terminal.dropped, "starts": board.starts, "take": source.number}
            write_json(args.json, {"schema": "tinygc-board/1", **told})
    return 0


def _options(args: argparse.Namespace) -> SimulationOptions:
    from tinygc.simulation.options import SimulationOptions

    odr_hz = int(args.rate) if args.rate == int(args.rate) else args.rate
    ranges = {"sensor": args.sensor, "gyro_fs_dps": args.gyro_fs, "accel_fs_g": args.accel_fs}
    options = SimulationOptions(segments=args.segments, closure_s=args.closure, odr_hz=odr_hz, seed=args.seed, **ranges)
    # A raw accelerometer's scale and axes have typical errors, but the session.toml contains no calibration.
    return replace(options, accel_bias_mg=args.raw_accelerometer) if args.raw_accelerometer else options


def _source(args: argparse.Namespace, link: Path, say: Callable[[str], None]) -> BoardSource:
    """Return the sensor's data: the folder's session, or a simulated one that no board at this link has streamed yet."""
    from tinygc.simulation.virtual_board import next_take, recorded, remember, simulated, taken

    if args.folder:
        return recorded(args.folder)
    options, raw = _options(args), args.raw_accelerometer
    take = args.take or next_take(link, args.seed)
    again = "" if take == 1 else " (the same sensor, turned anew; --take 1 streams the first again)"
    say(f"simulating a session, take {take} of seed {args.seed}{again} …")
    options = taken(options, take)
    source = simulated(options, calibrated=not raw)
    remember(link, args.seed, take)
    return replace(source, number=take)
