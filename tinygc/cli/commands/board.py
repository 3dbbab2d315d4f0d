"""``board``: run a virtual board, to try the recorder without hardware."""

from __future__ import annotations

import sys
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from session.base import features
from session.base.errors import CalibrationError
from session.base.options import argument, file_written, option
from session.base.texts import printable
from tinygc.cli.arguments import is_standard_output
from tinygc.cli.options import LONGEST_S, Command, Force
from tinygc.cli.results import ended_by_signals, write_json
from tinygc.estimation.options import Seed

if TYPE_CHECKING:
    from tinygc.simulation.options import SimulationOptions
    from tinygc.simulation.virtual_board import BoardSource


@dataclass(frozen=True)
class Options(Command, Force, Seed):
    """Options of ``board``."""

    folder: Path | None = argument("session folder to stream (a simulated one)", None)
    rate: float = option(416.0, "data rate of the simulated sensor", unit="Hz", least=0.1, most=50_000)
    segments: int = option(40, "turns of the simulated session", least=1)
    closure: float = option(0.0, "closure run behind it, begun on the index mark; 0: none", unit="s", least=0, most=LONGEST_S)
    raw_accelerometer: float | None = option(
        None,
        "an uncalibrated one: bias of so many mg (30), scale 1 %, axes 5 mrad; --config then does not mention it",
        unit="mg",
        above=0,
        alone=30.0,
        rare=True,
    )
    take: int | None = option(
        None,
        "which movement of the simulated sensor to stream (the next one that a board at this link has not begun yet)",
        least=1,
        rare=True,
    )
    frames: bool = option(False, "send frames instead of text lines", rare=True)
    physical: bool = option(False, "send text lines in dps, g and degC instead of registers", rare=True)
    sensor: str = option("ASM330LHH", "whose registers the simulated one has", rare=True)
    gyro_fs: float = option(500.0, "its full scale", unit="dps", least=1, most=1e5, rare=True)
    accel_fs: float = option(4.0, "its full scale", unit="g", least=0.1, most=1000, rare=True)
    speed: float = option(1.0, "so many times faster than real", above=0)
    lead: float = option(10.0, "still time before the session", unit="s", least=0, most=LONGEST_S, rare=True)
    tail: float | None = option(None, "still time behind it, then stop (go on for ever)", unit="s", least=0, most=LONGEST_S, rare=True)
    uptime: float = option(0.0, "device time at the start", unit="s", least=0, most=LONGEST_S, rare=True)
    faults: str = option("", "lost, torn, flip: probability; garbage: bytes; reset, unplug: s", metavar="NAME=X", read=str)
    memory: int | None = option(
        None, "what it holds back while its reader is busy (65536, times --speed if that is above 1)", least=1, metavar="BYTES", rare=True
    )
    link: Path | None = option(None, "name of the port (tinygc-board in the temporary folder)", metavar="PATH", read=file_written)
    config: Path | None = option(None, "write the session.toml that belongs to the stream", read=file_written, rare=True)


def run(args: Options) -> int:
    """Run a virtual board until Ctrl-C or the end of ``--tail``, then remove its port's link."""
    with ended_by_signals(ignored_interrupt=True), suppress(KeyboardInterrupt):
        _board(args)
    return 0


def _board(args: Options) -> None:
    try:
        from tinygc.simulation.terminal import MEMORY_BYTES, Terminal
    except ImportError:
        raise CalibrationError(
            "board: a virtual board needs a pseudo-terminal, which only POSIX systems have (Linux, macOS); "
            "everything else runs here, record with a real port too"
        ) from None
    from session.base.results import write_text_whole
    from session.bench.clocks import Clock
    from tinygc.simulation.virtual_board import LineFaults, VirtualBoard

    def report(what: str) -> None:
        if not args.quiet:
            print(printable(what), file=sys.stderr, flush=True)

    if args.frames and args.physical:
        raise CalibrationError("board: frames hold registers; leave --frames or --physical out")
    if args.folder and args.take:
        raise CalibrationError("board: a folder is streamed as it was recorded; leave --take out")
    faults = LineFaults.parse(args.faults)
    # A faster board needs a larger buffer, because the host is no faster.
    terminal = Terminal(args.link, args.memory or round(MEMORY_BYTES * max(1.0, args.speed)))
    try:
        table = features.first("table under a virtual board", args, _options(args))
    except BaseException:
        terminal.let_go()
        raise

    def announce() -> None:
        if not args.quiet and not is_standard_output(args.json):
            print(terminal.name, flush=True)
        report("start record in another terminal; Ctrl-C ends the board")

    with terminal, table or nullcontext():
        # Simulating takes seconds, for which a reader may wait; a folder may be refused, and the file of --config comes first.
        at_once = not (table or args.folder or args.config)
        if at_once:
            announce()
        source = table.source if table else _source(args, terminal.name)
        if args.config and source.config:
            write_text_whole(args.config, source.config)
        if not at_once:
            announce()
        if table:
            report(f"the table is at {table.name}")
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
            report=report,
            clock=table.clock if table else Clock(),
        )
        try:
            if source.number is not None:
                report(f"take {source.number} of seed {args.seed}")
            board.run()
        finally:
            dropped = f", {terminal.dropped} writes dropped without a reader" if terminal.dropped else ""
            report(f"{board.sent} samples sent{dropped}")
            counts = {"samples": board.sent, "dropped": terminal.dropped, "starts": board.starts, "take": source.number}
            write_json(args.json, {"schema": "tinygc-board/1", **counts})


def _options(args: Options) -> SimulationOptions:
    from tinygc.simulation.options import SimulationOptions

    odr_hz = int(args.rate) if args.rate == int(args.rate) else args.rate
    options = SimulationOptions(
        segments=args.segments,
        closure_s=args.closure,
        seed=args.seed,
        odr_hz=odr_hz,
        sensor=args.sensor,
        gyro_fs_dps=args.gyro_fs,
        accel_fs_g=args.accel_fs,
    )
    # A raw accelerometer's scale and axes have typical errors, but the session.toml contains no calibration.
    return replace(options, accel_bias_mg=args.raw_accelerometer) if args.raw_accelerometer else options


def _source(args: Options, link: Path) -> BoardSource:
    """Return the sensor's data: the folder's session, or a simulated one that no board at this link has streamed yet."""
    from tinygc.simulation.virtual_board import next_take, recorded, remember, simulated, taken

    if args.folder:
        return recorded(args.folder)
    options, raw = _options(args), args.raw_accelerometer
    take = args.take or next_take(link, args.seed)
    options = taken(options, take)
    source = simulated(options, calibrated=not raw)
    remember(link, args.seed, take)
    return replace(source, number=take)
