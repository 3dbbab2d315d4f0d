"""``record``: guide the operator at the table through a session, without losing data."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base import features
from session.base.texts import command_line, printable
from tinygc.cli.defaults import defaults_json
from tinygc.cli.recording import (
    Recording,
    Turning,
    faults_of,
    left_out,
    logs_of,
    missing,
    page_server,
    so_far,
    table,
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

EPILOG = """keys: p pauses and goes on (data are kept); d drops the last turn (its data stay); n begins a note, and Enter keeps it in
session.toml; f finishes, once every number is good enough, or a rest; in a closure run d begins it again, and Enter confirms the index
mark; s stops a machine at once."""


@dataclass(frozen=True)
class Options(Turning):
    """Options of ``record``."""


def run(args: Recording) -> int:
    """Guide the operator at the table through a session, without losing data; or list the ports."""
    from session.bench.port import only_candidate

    if args.port == "list":
        return _ports(args)
    # The first ``data/sessionN`` that does not exist.
    folder = args.out or next(path for number in range(1, 1_000_000) if not (path := Path("data") / f"session{number}").exists())
    port = args.port or only_candidate().name
    _require_place(folder, args.resume)
    with page_server(args) as page, args.machine(folder, port) as machine:
        with Interruption() as wanted:
            led = _led(args, folder, port, machine, wanted, page)
        interrupted = _report(args, folder, port, machine, *led)
        if page is not None:
            _end_page(page, args, folder, port, interrupted)
    return 130 if interrupted else 0


def _ports(args: Recording) -> int:
    """List the serial ports, candidates first."""
    args.refuse_with("--port list", "port")
    from session.bench.port import known_ports

    ports = known_ports()
    none = not any(port.is_candidate for port in ports)
    if none:
        output(args).print("No board found." + (" Other ports:" if ports else ""))
    for port in ports:
        usb = "" if port.usb is None else f"  USB {port.usb[0]:04x}:{port.usb[1]:04x}"
        serial = "" if port.serial_number is None else f"  S/N {port.serial_number}"
        output(args).print(f"{port.name}  {port.what}{usb}{serial}")
    if none:
        print_commands(args, "next: plug one in, or start a virtual one", command_line("board"))
    write_json(args.json, {"schema": "tinygc-ports/1", "ports": [asdict(port) for port in ports]})
    return 0


def _end_page(page: PageServer, args: Recording, folder: Path, port: str, interrupted: bool) -> None:
    """Show the end of the recording and the next steps on the page, when all files are written."""
    from tinygc.cli.recording import stay

    if interrupted:
        words, command = "Interrupted: everything received is kept. To go on:", args.again(folder, port)
        page.publish("end", {"words": words, "command": command, "report": "none"})
        return
    with Interruption() as wanted:
        stay(page, folder, wanted)


def _report(
    args: Recording, folder: Path, port: str, machine: Any, guide: Guide, recorder: Recorder, session_file: SessionFile, interrupted: bool
) -> bool:
    """Print what was recorded, the result first; return interrupted."""
    from session.bench.port import is_virtual
    from session.bench.rest_guide import in_words
    from session.bench.session_file import ASSUMED

    console = output(args)
    took = f" in {in_words(guide.now_s)}" if guide.segments and not is_virtual(port) else ""  # its seconds need not be real ones
    ended = f"Interrupted: {guide.so_far}; everything received is kept." if interrupted else f"{guide.outcome.capitalize()}{took}."
    console.print(ended)
    if words := missing(guide):
        console.print(words)
    console.print(f"{folder}: {logs_of(recorder)}")
    if words := faults_of(guide):
        console.print(f"Faults: {words}.")
    for path in recorder.logs.put_aside:
        console.print(f"{path}: differed from {recorder.raw.path.name} and was written again")
    for line in left_out(recorder):
        console.print(line)
    for path in recorder.logs.paths:
        if not path.exists():
            console.print(f"{path}: was removed; --resume writes it again from {recorder.raw.path.name}")
    if guide.taken.own is not None and guide.stem != "rest":
        console.print(f"Accelerometer: {guide.taken.own.words}")
    if words := session_file.measured(recorder.clock.measured):
        console.print(words)
    if session_file.assumed:
        console.print(ASSUMED)
    if machine is not None and (words := machine.finish(folder, recorder.logs.renamed)):
        console.print(words)
    _print_next(args, folder, port, guide, interrupted)
    write_json(args.json, table(guide, folder, recorder) | defaults_json(args))
    return interrupted


def _print_next(args: Recording, folder: Path, port: str, guide: Guide, interrupted: bool) -> None:
    """Print the commands to go on with: with the turns that there are, and to record more of them."""
    from session.bench.port import is_virtual
    from session.detect.check_stills import ENOUGH_SEGMENTS
    from session.detect.segments import FEWEST_SEGMENTS

    commands, too_few = () if interrupted else args.next(folder), False
    if args.TURNS:
        few, too_few = guide.accepted < ENOUGH_SEGMENTS, guide.accepted < FEWEST_SEGMENTS
        if few:
            output(args).print(f"A fit needs {FEWEST_SEGMENTS} turns, a verdict {ENOUGH_SEGMENTS}.")
        commands = () if too_few else args.next(folder)
        check = "verify"  # of a feature
        if commands and (few or interrupted) and check in features.names("commands"):
            commands = (*commands, command_line(check, "MODEL", folder))
    if commands:
        print_commands(args, "next:", *commands)
    if interrupted or too_few:
        words = f"{'or more turns' if commands else 'next'}{', with the virtual board started again' if is_virtual(port) else ''}:"
        # What has made all of its turns is resumed without their number.
        print_commands(args, words, args.again(folder, port, *(() if interrupted else ("segments",))))


def _led(
    args: Recording, folder: Path, port: str, machine: Any, wanted: Interruption, page: PageServer | None
) -> tuple[Guide, Recorder, SessionFile, bool]:
    """Lead the recording to its end; return its parts and whether it was interrupted."""
    from session.base.errors import CalibrationError
    from session.bench.guided_session import GuidedRecording
    from session.bench.operator import Keyboard
    from session.bench.port import is_virtual
    from session.bench.recorder import Recorder
    from session.bench.session_file import SessionFile
    from session.log.config import Site

    site = Site(args.latitude_deg, args.gravity_mps2)
    session_file = SessionFile(folder, args.like, args.odr_hz, args.gyro_fs_dps, args.accel_fs_g, args.sensor, dict(args.note), site)
    if args.TURNS:
        _print_request(args, folder)
    recorder = Recorder(folder, port, args.baud, args.header, session_file.wanted())
    if recorder.raw.cut:
        print(recorder.raw.cut, file=sys.stderr)
    if recorder.setting.applied and not args.quiet:
        print(f"the board was set: {', '.join(recorder.setting.applied)}", file=sys.stderr)
    guide = args.guide(session_file.protocol)
    title = f"{folder} · {'the virtual board turns by itself, not as requested' if is_virtual(port) else port}"
    failed, problem, guided, interrupted = None, None, None, False
    try:
        with Keyboard() as keys, views(args, title, page) as (view, watch):
            typed = keys if keys.there else None

            def configure(info: Info | None, waited_s: float) -> Config | None:
                return session_file.configure(info, waited_s, recorder.logs.physical, recorder.logs.board, recorder.setting.speaks)

            coach, wished = args.coach(machine), None if page is None else page.wishes
            mover = None if machine is None else machine.mover(folder, guide)
            guided = GuidedRecording(guide, recorder, configure, coach, view, session_file, typed, watch, wished, mover)
            guided.lead(wanted)
    except KeyboardInterrupt:
        interrupted = True
    except CalibrationError as error:
        failed = error
    finally:
        problem = _closed(recorder, session_file)
    if recorder.raw.trouble is not None:
        raise recorder.raw.trouble
    if (wrong := failed or problem) is not None:
        if guided is None:  # refused before what the folder holds was taken in: there is nothing to count yet
            raise wrong
        raise type(wrong)(f"{wrong}; kept in {folder}: {so_far(guide, recorder)}") from None
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


def _print_request(args: Recording, folder: Path) -> None:
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
            print(printable(f"explain requests ({place}): {words}"), file=sys.stderr)
            return
