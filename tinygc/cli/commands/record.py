"""``record``: guide the operator at the table through a session, without losing data."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from session.base import features
from session.base.options import folder_written, path_read
from session.base.texts import command_line, printable
from tinygc.cli.arguments import (
    accel_full_scale,
    closure_seconds,
    count,
    data_rate,
    gyro_full_scale,
    note,
    rates_dps,
    stream_header,
    within,
)
from tinygc.cli.defaults import defaults_json
from tinygc.cli.recording import (
    DEFAULTS,
    KNOWN_TO,
    LOOPBACK,
    bench,
    coach_of,
    counted,
    faults_of,
    files_left,
    left_out,
    missing,
    page_address,
    page_server,
    refuse_with_rest,
    rest_guide,
    so_far,
    table,
    takes,
    turned,
    views,
)
from tinygc.cli.results import Interruption, complain, output, print_commands, write_json

if TYPE_CHECKING:
    from session.base.errors import CalibrationError
    from session.bench.events import Info
    from session.bench.guide import Guide
    from session.bench.page.server import PageServer
    from session.bench.recorder import Recorder
    from session.bench.session_file import SessionFile
    from session.log.config import Config

SUMMARY = "record a guided session from a serial port"
USUAL_CLOSURE_S = 60.0
USUAL_SEGMENTS = 40
LONGEST_H = 1000.0
USUAL_DWELL_S = 10.0
EPILOG = """keys, where standard input is a terminal: p pauses (what comes is kept, and not judged) and goes on; d drops the last turn
(its segment is left out, its data stay); n begins a note, Enter keeps it in session.toml; in the closure run d begins the run again,
and Enter says that the table stands on its index mark; in a rest f ends it; with --table s
stops the table at once.  Where standard input is no terminal there are no keys."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.epilog = EPILOG
    command.add_argument("--port", metavar="PORT", help="such as /dev/ttyACM0 (the only one there is, if it can be the board)")
    command.add_argument("--baud", type=count(1), default=921600, help="of a port that has one (%(default)s)")
    command.add_argument("--out", type=folder_written, metavar="DIR", help="session folder to write (the next free data/sessionN)")
    command.add_argument("--resume", action="store_true", help="go on with the recording in --out")
    command.add_argument("--segments", type=count(1), default=USUAL_SEGMENTS, help="to be accepted (%(default)s)")
    command.add_argument("--stop-at-target", action="store_true", help="stop as soon as every parameter has reached its target sigma")
    command.add_argument(
        "--closure",
        type=closure_seconds,
        nargs="?",
        const=USUAL_CLOSURE_S,
        default=0.0,
        metavar="S",
        help="then lead through a closure run with S seconds of turning (60)",
    )
    rest = "turn nothing: record a rest log, until it is stopped or for so many hours, and show how long is enough for the noise"
    command.add_argument("--rest", type=within(0, LONGEST_H, "time", " h"), nargs="?", const=0.0, metavar="HOURS", help=rest)
    known = "with --rest: how well N, and B or K, are to be known (%(default)g %%); --stop-at-target stops there"
    command.add_argument("--known-to", type=within(1, 100, "share", " %"), default=KNOWN_TO, metavar="PERCENT", help=known)
    command.add_argument(
        "--note", type=note, action="append", default=[], metavar="KEY=TEXT", help="for [notes] of session.toml, such as operator=…"
    )
    command.add_argument("--like", type=path_read, metavar="TOML", help="take accelerometer, site and protocol from this session.toml")
    command.set_defaults(**dict.fromkeys(DEFAULTS, None), takes_defaults=takes)
    command.add_argument("--sensor", metavar="NAME", help="what it is, where the board does not say (see the command sensors)")
    command.add_argument("--header", type=stream_header, metavar="LINE", help="of a text stream that does not send it: t_us,gx_dps,…")
    command.add_argument("--odr", type=data_rate, metavar="HZ", help="data rate: set where the board takes commands, else what it is")
    command.add_argument("--gyro-fs", dest="gyro_fs_dps", type=gyro_full_scale, metavar="DPS", help="full scale, likewise")
    command.add_argument("--accel-fs", dest="accel_fs_g", type=accel_full_scale, metavar="G", help="full scale, likewise")
    command.add_argument("--no-coach", action="store_true", help="any turn will do")
    turned = "a machine turns: its table.toml; the plan is printed, and confirmed once (docs/table-sessions.md)"
    command.add_argument("--table", type=path_read, metavar="FILE", help=turned)
    command.add_argument("--table-port", metavar="PORT", help="with --table: instead of the port in the file")
    rates = "with --table: no turns, but steps of these rates in both senses, dps; their log is rates0001.csv"
    command.add_argument("--rates", type=rates_dps, metavar="DPS,…", help=rates)
    command.add_argument("--dwell", type=within(0, 3600, "time", " s"), default=USUAL_DWELL_S, metavar="S", help="of a rate (%(default)g)")
    command.add_argument("--axis", metavar="NAME", help="of --rates: the axis that turns (the innermost one)")
    homing = "with --table: it searches its reference marks first, once the plan is confirmed"
    command.add_argument("--home", action="store_true", help=homing)
    command.add_argument("--at-zero", action="store_true", help="with --table: all axes stand at zero, though its board has restarted")
    command.add_argument("--yes", action="store_true", help="with --table: the plan is confirmed, for those who know their table")
    command.add_argument("--mute", action="store_true", help="no bell")
    command.add_argument(
        "--view",
        type=page_address,
        nargs="?",
        const=page_address(LOOPBACK),
        metavar="ADDRESS",
        help="show a page in a browser: the board, where it is wanted, what to do (this computer alone; or HOST:PORT to listen on)",
    )


def run(args: argparse.Namespace) -> int:
    """Guide the operator at the table through a session, without losing data."""
    from session.bench.port import only_candidate

    refuse_with_rest(args)
    args.machine = None
    # The first ``data/sessionN`` that does not exist.
    folder = args.out or next(path for number in range(1, 1_000_000) if not (path := Path("data") / f"session{number}").exists())
    port = args.port or only_candidate().name
    _require_place(folder, args.resume)
    with page_server(args) as page, turned(args, folder, port) as args.machine:
        with Interruption() as wanted:
            announce = True
            while (led := _led(args, folder, port, wanted, page, announce)) is None:
                announce = False  # the recording began again, without the bytes of another board
        interrupted = _tell(args, folder, port, *led)
        if page is not None:
            _end_page(page, args, folder, port, interrupted)
    return 130 if interrupted else 0


def _end_page(page: PageServer, args: argparse.Namespace, folder: Path, port: str, interrupted: bool) -> None:
    """Show the end of the recording and the next steps on the page, when all files are written."""
    from tinygc.cli.recording import stay

    if interrupted:
        words, command = "interrupted; everything received is kept. To go on:", _again(args, folder, port)
        page.publish("end", {"words": words, "command": command, "report": "none"})
        return
    with Interruption() as wanted:
        stay(page, folder, wanted)


def _again(args: argparse.Namespace, folder: Path, port: str) -> str:
    """Return the command that resumes the recording."""
    words: list[object] = ["record", "--resume", "--out", folder, "--port", port]
    words += [] if args.segments == USUAL_SEGMENTS else ["--segments", args.segments]
    words += [] if args.rest is None else ["--rest", *([f"{args.rest:g}"] if args.rest else [])]
    words += ["--stop-at-target"] if args.stop_at_target else []
    words += [] if args.known_to == KNOWN_TO else ["--known-to", f"{args.known_to:g}"]
    words += [] if args.view is None else ["--view"]
    words += ["--closure", f"{args.closure:g}"] if args.closure else []
    words += [] if args.table is None else ["--table", args.table, *(["--home"] if args.home else [])]
    words += [] if args.rates is None else ["--rates", ",".join(f"{rate:g}" for rate in args.rates), "--dwell", f"{args.dwell:g}"]
    words += [] if args.axis is None else ["--axis", args.axis]
    words += [] if args.table_port is None else ["--table-port", args.table_port]
    return command_line(*words)


def _tell(
    args: argparse.Namespace, folder: Path, port: str, guide: Guide, recorder: Recorder, session_file: SessionFile, interrupted: bool
) -> bool:
    """Report what was recorded; return interrupted."""
    from session.bench.session_file import ASSUMED

    console = output(args)
    console.print(f"{folder}: {so_far(guide, recorder)}", soft_wrap=True)
    console.print(f"files: {files_left(folder)}", soft_wrap=True)
    console.print(f"faults of the board: {faults_of(guide) or 'none'}", soft_wrap=True)
    for path in recorder.logs.put_aside:
        console.print(f"{path}: what was there differed from {recorder.raw.path.name}; the log was made again", soft_wrap=True)
    for line in left_out(recorder):
        console.print(line, soft_wrap=True)
    for path in recorder.logs.paths:
        if not path.exists():
            console.print(f"{path}: was removed meanwhile; --resume makes it again of {recorder.raw.path.name}", soft_wrap=True)
    if guide.taken.own is not None and args.rest is None:
        console.print(f"accelerometer, of which session.toml says nothing: {guide.taken.own.words}", soft_wrap=True)
    if words := session_file.measured(recorder.clock.measured):
        console.print(words, soft_wrap=True)
    if session_file.assumed:
        console.print(ASSUMED, soft_wrap=True)
    if args.table is not None and (words := args.machine.finish(folder, recorder.logs.renamed)):
        console.print(words, soft_wrap=True)
    if words := missing(guide):
        console.print(words, soft_wrap=True)
    if interrupted:
        complain("interrupted; everything received is kept. To go on:")
        print(f"  {_again(args, folder, port)}", file=sys.stderr, flush=True)
    elif args.rates is not None:
        print_commands(args, "next:", command_line("rates", folder))
    elif args.rest is None:
        print_commands(args, "next:", command_line("check", folder), command_line("fit", folder))
    else:
        for word in features.each("command for a rest"):
            print_commands(args, "next:", command_line(word, folder))
    write_json(args.json, table(guide, folder, recorder) | defaults_json(args))
    return interrupted


def _led(
    args: argparse.Namespace, folder: Path, port: str, wanted: Interruption, page: PageServer | None, announce: bool
) -> tuple[Guide, Recorder, SessionFile, bool] | None:
    """Lead one recording to its end; return its parts and whether it was interrupted, or None where it must begin again: it held another
    board's bytes, which are now in a separate file."""
    from session.base.errors import CalibrationError, OtherSensor
    from session.bench.guide import Guide
    from session.bench.guided_session import GuidedRecording
    from session.bench.operator import Keyboard
    from session.bench.recorder import Recorder
    from session.bench.session_file import SessionFile

    session_file = SessionFile(folder, args.like, args.odr, args.gyro_fs_dps, args.accel_fs_g, args.sensor, dict(args.note), bench(args))
    if announce and args.rest is None and args.rates is None:
        _say_what_was_asked(args, folder)
    recorder = Recorder(folder, port, args.baud, args.header, session_file.wanted())
    if recorder.raw.cut:
        print(recorder.raw.cut, file=sys.stderr)
    if recorder.setting.said and not args.quiet:
        print(f"the board was set: {', '.join(recorder.setting.said)}", file=sys.stderr)
    if args.rates is not None:
        guide: Guide = args.machine.guide(session_file.protocol)
    elif args.rest is None:
        guide = Guide(session_file.protocol, args.segments, args.stop_at_target, args.closure)
    else:
        guide = rest_guide(args, session_file.protocol)
    failed, problem, guided, interrupted = None, None, None, False
    try:
        with Keyboard() as keys, views(args, f"{folder} · {port}", page) as (view, watch):
            typed = keys if keys.there else None

            def configure(info: Info | None, waited_s: float) -> Config | None:
                return session_file.configure(info, waited_s, recorder.logs.physical, recorder.logs.board, recorder.setting.speaks)

            turns = args.rest is None and args.rates is None
            coach, wished = coach_of(args.machine) if turns and not args.no_coach else None, None if page is None else page.wishes
            mover = None if args.machine is None else args.machine.mover(folder, guide)
            guided = GuidedRecording(guide, recorder, configure, coach, view, session_file, typed, watch, wished, mover)
            guided.lead(wanted)
    except KeyboardInterrupt:
        interrupted = True
    except CalibrationError as error:
        failed = error
    finally:
        problem = _closed(recorder, session_file)
    if failed is not None and problem is None and guided is not None and guided.begin_again:
        complain(str(failed))
        return None
    if recorder.raw.trouble is not None:
        raise recorder.raw.trouble
    if (wrong := failed or problem) is not None:
        if guided is None:  # refused before what the folder holds was taken in: there is nothing to count yet
            raise wrong
        counts = counted(guide, recorder) if isinstance(wrong, OtherSensor) else so_far(guide, recorder)  # it names its files itself
        raise type(wrong)(f"{wrong}; kept in {folder}: {counts}") from None
    return guide, recorder, session_file, interrupted


def _closed(recorder: Recorder, session_file: SessionFile) -> CalibrationError | None:
    """Close the recorder; return the error of doing so."""
    from session.base.errors import StorageError

    try:
        recorder.close()
    except StorageError as error:  # a full disk causes more than one error
        return error
    finally:
        if recorder.raw.saved is not None:
            with contextlib.suppress(OSError):
                session_file.save_copy(recorder.raw.saved)
    return recorder.raw.trouble


def _require_place(folder: Path, resume: bool) -> None:
    """Require a new folder, or with ``resume`` an existing recording; a recording is never overwritten."""
    from session.base.errors import FormatError
    from session.base.names import log_paths
    from session.bench.rawfile import IN_USE, RAW, is_locked

    raw = folder / RAW
    if is_locked(raw):
        raise FormatError(f"{folder}: {IN_USE}")
    recorded = raw.exists() and raw.stat().st_size > 0
    if resume and not raw.exists():
        raise FormatError(f"{folder}: no recording to resume ({RAW} is not there); give its folder with --out, or leave --resume out")
    if not resume and recorded:
        raise FormatError(f"{folder}: holds a recording; --resume goes on with it, or give another --out")
    if not resume and folder.is_dir() and (logs := log_paths(folder, "log")):
        raise FormatError(f"{folder}: holds {logs[0].name}; give another --out")


def _say_what_was_asked(args: argparse.Namespace, folder: Path) -> None:
    """Print what `explain` recommends for this sensor: in the resumed session, or in the one given by ``--like``."""
    from session.base.errors import FormatError
    from tinygc.planning.proposals import requested_by_explain

    for place in (folder, args.like.parent if args.like else None):
        try:
            words = requested_by_explain(place) if place else None
        except FormatError as error:  # an old explanation must not stop a recording
            complain(str(error))
            continue
        if words and not args.quiet:
            print(printable(f"explain asks ({place}): {words}"), file=sys.stderr)
            return
