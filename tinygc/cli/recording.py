"""Parts of ``record``: views, the page after the end, the coach."""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from session.base import features
from session.base.errors import CalibrationError
from session.base.texts import command_line, printable

if TYPE_CHECKING:
    from session.bench.guide import Guide, View
    from session.bench.guided_session import Watch
    from session.bench.messages import Advice, Progress
    from session.bench.page.server import PageServer
    from session.bench.recorder import Recorder
    from session.bench.rest_guide import RestGuide
    from session.log.config import Protocol, Site
    from tinygc.planning.coach import Coach


# Defaults that ``record`` uses: the port, and the bench's entries in a session.toml that it writes.

PORT, LIKE = {"port": "record.port"}, {"like": "record.like"}
SITE = {"latitude_deg": "site.latitude_deg", "gravity_mps2": "site.gravity_mps2"}
DEFAULTS = PORT | LIKE | SITE


def takes(args: argparse.Namespace, known: Mapping[str, object]) -> dict[str, str]:
    """Return destination -> key of the defaults that apply to this recording; known: the keys of the file.

    The folder's own session.toml overrides all but the port; a session.toml given by ``--like`` already contains the site.
    """
    if args.out is not None and (args.out / "session.toml").exists():
        return PORT
    if args.like is not None:
        return PORT
    return PORT | (LIKE if LIKE["like"] in known else SITE)


def bench(args: argparse.Namespace) -> Site:
    """Return the site of the table from these defaults."""
    from session.log.config import Site

    return Site(args.latitude_deg, args.gravity_mps2)


# Views of a recording: a live screen in a terminal, lines elsewhere, and a web page on request.

LOOPBACK = "127.0.0.1:0"


def page_address(text: str) -> tuple[str, int]:
    """Parse ``HOST:PORT`` or ``HOST``, an IPv4 address; port 0: any free port."""
    host, _, port = text.partition(":")
    try:
        address, number = ipaddress.IPv4Address(host), int(port or 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no address of this computer, such as 127.0.0.1:8000") from None
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"port {number} is none: 0 (any that is free) to 65535")
    if number == 80:
        raise argparse.ArgumentTypeError("port 80 is not to be had: browsers leave it out where the page wants it named; take 8080")
    return str(address), number


@contextlib.contextmanager
def page_server(args: argparse.Namespace) -> Iterator[PageServer | None]:
    """Start the page's server if requested.  The page also shows the error that ends a recording."""
    if args.view is None:
        yield None
        return
    from session.bench.page.server import PageServer

    server = PageServer(*args.view)
    server.start()
    print(f"look at the recording: {server.address}", file=sys.stderr, flush=True)  # also when quiet: it was requested
    try:
        yield server
    except CalibrationError as error:
        server.publish("end", {"words": printable(str(error)), "command": "", "report": "none"})
        raise
    finally:
        server.close()


@contextlib.contextmanager
def views(args: argparse.Namespace, title: str, server: PageServer | None) -> Iterator[tuple[View, Watch | None]]:
    """Yield the view of the recording, a live screen in a terminal and lines elsewhere, and the receiver of its samples."""
    from session.base.console import PlainConsole
    from session.bench.screen import LiveScreen, PlainLines

    console = PlainConsole(stderr=True, quiet=args.quiet)
    in_terminal = console.is_terminal and not args.quiet
    with contextlib.ExitStack() as shown:
        screen: View = shown.enter_context(LiveScreen(title, args.mute, console)) if in_terminal else PlainLines(console)
        if server is None:
            yield screen, None
            return
        from session.bench.page.state import PageView

        page = PageView(screen, server)
        yield page, page.watch


# A rest: its guide, with what the feature of the noise makes of it while it goes on.

KNOWN_TO = 20.0  #: per cent


def rest_guide(args: argparse.Namespace, protocol: Protocol) -> RestGuide:
    """Return the guide of ``--rest``; without the feature it records all the same, and says nothing of the noise."""
    from session.bench.rest_guide import RestGuide

    figures = features.first("figures of a rest", args.known_to / 100)
    return RestGuide(protocol, args.rest * 3600 if args.rest else None, figures, args.stop_at_target)


def refuse_with_rest(args: argparse.Namespace) -> None:
    """CalibrationError for options of turns that a rest does not have, and for options of a rest without one."""
    if args.rest is None:
        if args.known_to != KNOWN_TO:
            raise CalibrationError("--known-to says how well the noise of a rest is to be known; add --rest")
        return
    turns = {"--closure": args.closure, "--view": args.view}
    if given := next((name for name, value in turns.items() if value), None):
        raise CalibrationError(f"{given} is of turns, and with --rest nothing is turned; leave one of them out")


# A machine that turns the table.


@contextlib.contextmanager
def turned(args: argparse.Namespace, folder: Path, port: str) -> Iterator[Any]:
    """Yield the table of ``--table``, its plan confirmed; None where the operator turns.

    What can be refused without it is refused before its port is opened, since --home moves it.
    """
    if args.table is None:
        of_a_table = (args.table_port, args.rates, args.axis)
        if args.yes or args.home or args.at_zero or any(value is not None for value in of_a_table):
            raise CalibrationError("--yes, --home, --at-zero, --table-port, --rates and --axis are of a table; add --table FILE")
        yield None
        return
    if args.rest is not None:
        raise CalibrationError("--table turns, and with --rest nothing is turned; leave one of them out")
    from session.bench.port import Port

    if (recording := next(features.each("machine of a recording"), None)) is None:
        raise CalibrationError("record has no option --table")
    if (words := recording.require_table_of(args.table, folder)) and not args.quiet:
        print(printable(words), file=sys.stderr)
    Port(port, args.baud).close()  # DeviceError where there is no board
    machine = recording.TurnedRecording(args.table, args.table_port, args.home, at_zero=args.at_zero)
    try:
        if args.rates is not None:
            machine.confirmed_rates(args.rates, args.dwell, args.axis, args.yes, args.quiet)
        else:
            machine.confirmed(recording.is_raw(folder, args.like), args.segments, args.stop_at_target, args.closure, args.yes, args.quiet)
        yield machine
    finally:
        machine.close()


# The recorded data, in lines and as JSON.

MOST_NAMED = 3  #: most logs that are named
NUMBERED = re.compile(r"(?P<stem>[a-z]+)(?P<number>[0-9]{4})\.csv")


def so_far(guide: Guide, recorder: Recorder) -> str:
    """Count segments, or the time of a rest, and files."""
    names = [path.name for path in recorder.logs.paths] or ["no log yet"]
    logs = ", ".join(names) if len(names) <= MOST_NAMED else f"{names[0]} and {len(names) - 1} more"
    return f"{counted(guide, recorder)} ({recorder.raw.path.name}, {logs})"


def counted(guide: Guide, recorder: Recorder) -> str:
    """Count segments, or the time of a rest, and samples."""
    segments = f"{guide.accepted} of {guide.segments} segments" if guide.segments else guide.so_far
    return f"{segments}, {recorder.samples} samples"


def files_left(folder: Path) -> str:
    """Name every file of the recording; of a row of numbered ones the first and the last."""
    from session.base.names import has_recorded_name

    names, rows = sorted(path.name for path in folder.iterdir() if has_recorded_name(path)), list[list[str]]()
    for name in names:
        before, this = NUMBERED.fullmatch(rows[-1][-1]) if rows else None, NUMBERED.fullmatch(name)
        if before and this and before["stem"] == this["stem"] and int(before["number"]) + 1 == int(this["number"]):
            rows[-1].append(name)
        else:
            rows.append([name])
    return ", ".join(", ".join(row) if len(row) < 4 else f"{row[0]} to {row[-1]} ({len(row)} files)" for row in rows)


def faults_of(guide: Guide) -> str:
    """Name every fault of the board and of its stream, with how often it came; empty without any."""
    words = [f"{count} {name}" for name, count in guide.health.faults.items() if count]
    words += [f"the board counted {name} {count}×" for name, count in guide.board_faults.items() if count]
    return ", ".join(words)


def left_out(recorder: Recorder) -> Iterator[str]:
    """Yield data that is in the raw bytes but in no log, or that may be wrong in one."""
    from session.bench.frames import cannot_be_told
    from session.bench.logwriter import said_not_logged

    raw, logs = recorder.raw.path, recorder.logs
    if crc_errors := recorder.decoder.crc_errors:
        yield f"{raw}: of {crc_errors} damaged frames {cannot_be_told(crc_errors)}"
    if recorder.undecoded:
        yield f"{raw}: {recorder.undecoded} bytes of it are in no log yet; record --resume goes on with them, or import {raw} --out DIR"
    if logs.not_logged:
        yield f"{raw}: {said_not_logged(logs.not_logged, logs.not_logged_starts)}"


def missing(guide: Guide) -> str:
    """Name the parameters above their target sigma, according to the coach."""
    if guide.advice is None or not guide.advice.missing:
        return ""
    return f"not yet at their target sigma: {'; '.join(guide.advice.missing[:4])}{'; …' if len(guide.advice.missing) > 4 else ''}"


def table(guide: Guide, folder: Path, recorder: Recorder) -> dict:
    """Return the result as JSON."""
    health = guide.health
    troubles = health.troubles  # counted before the port was closed, which truncates the last frame
    return {
        "schema": "tinygc-record/1",
        "session": str(folder),
        "done": guide.stage.value == "done",
        "segments": {"wanted": guide.segments, "accepted": guide.accepted, "rejected": guide.rejected, "dropped": guide.dropped},
        "accelerometer": _accelerometer(guide),
        "samples": recorder.samples,
        "lost": troubles["lost"],
        "crc_errors": troubles["crc"],
        "garbage_bytes": troubles["garbage"],
        "implausible": troubles["implausible"],
        "resets": troubles["reset"],
        "odr_hz": health.odr_hz,
        "odr_by_host_hz": health.odr_by_host_hz,
        "clock": None if health.clock is None else {"ratio": health.clock.ratio, "sigma_ppm": health.clock.sigma_ppm},
        "logs": [path.name for path in recorder.logs.paths],
        "missing": list(guide.advice.missing) if guide.advice else None,
        **_rest(guide),
    }


def _rest(guide: Guide) -> dict:
    """Return the key of a rest, which other recordings do not have."""
    from session.bench.rest_guide import RestGuide

    if not isinstance(guide, RestGuide):
        return {}
    seconds = {"wanted_s": guide.rest_s, "recorded_s": guide.rested_s, "moved_s": guide.moved_s}
    return {"rest": seconds | {"known": guide.answer.known, "remarks": list(guide.answer.lines)}}


def _accelerometer(guide: Guide) -> dict | None:
    """Return the state of an uncalibrated accelerometer's calibration from the stills."""
    if guide.taken.own is None or guide.stem == "rest":
        return None
    before, after = guide.taken.own.spread_mg
    stills = len(guide.taken.own.stills)
    return {"stills": stills, "attitudes": guide.taken.own.attitudes, "spread_mg": {"before": before, "after": after}}


# The page after the end of a recording, when all files are closed: it stays while a browser shows it, and makes the report in a separate
# process on request.

GONE_S = 5.0  #: without a browser: time to reload the page
LOOK_EVERY_S = 0.1
CALIBRATE = Path(__file__).resolve().parents[2] / "calibrate.py"
MADE = (0, 1)  #: exit codes of ``report`` with a report: 1 is a calibration that fails


def stay(server: PageServer, folder: Path, wanted: Callable[[], bool]) -> None:
    """Keep the page while a browser shows it, until an interruption."""
    _Finished(server, folder).stay(wanted)


class _Finished:
    """A finished recording on the page."""

    def __init__(self, server: PageServer, folder: Path):
        self._server, self._path = server, folder / "report.html"
        self._command, self._folder = command_line("report", folder), folder
        self._ready = False
        server.report = lambda: self._path.read_bytes() if self._ready and self._path.is_file() else None
        self._say("offered", "The files are closed.")

    def stay(self, wanted: Callable[[], bool]) -> None:
        """Wait for a reload or a sleeping phone; end at once where no browser has opened the page."""
        seen_s = time.monotonic()
        if self._server.visited:
            print("the page stays while it is looked at, and can make the report; Ctrl-C ends it", file=sys.stderr, flush=True)
        else:
            return
        while not wanted() and time.monotonic() - seen_s < GONE_S:
            if self._server.wishes.report.is_set():
                self._make(wanted)
                self._server.wishes.report.clear()
            if self._server.clients:
                seen_s = time.monotonic()
            time.sleep(LOOK_EVERY_S)

    def _make(self, wanted: Callable[[], bool]) -> None:
        began_s = time.monotonic()
        with tempfile.TemporaryFile() as said:
            command = [
                sys.executable,
                str(CALIBRATE),
                "report",
                str(self._folder.resolve()),
                "--quiet",
            ]  # no name that looks like an option
            with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said) as making:
                try:
                    while making.poll() is None and not wanted():
                        self._say(
                            "making", f"The report is being made: {time.monotonic() - began_s:.0f} s so far, up to some minutes in all."
                        )
                        time.sleep(LOOK_EVERY_S)
                finally:
                    making.terminate()
            self._ready = making.returncode in MADE and self._path.is_file()
            if self._ready:
                self._say("ready", f"The report is {self._path}.")
            else:
                self._say("failed", f"No report: {_last_line(said) or f'exit code {making.returncode}'}.")

    def _say(self, report: str, words: str) -> None:
        self._server.publish("end", {"words": printable(words), "command": self._command, "report": report})


def _last_line(said: IO[bytes]) -> str:
    said.seek(0)
    lines = said.read().decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else ""


# The coach of a recording.


def coach_of(machine: Any = None) -> Callable[[Progress], Advice]:
    """Return the coach; its modules are loaded in its own thread, not before the recording starts.  machine: what turns the table."""
    coach: Coach | None = None

    def advise(progress: Progress) -> Advice:
        nonlocal coach
        if coach is None:
            from tinygc.planning.coach import Coach

            coach = Coach(machine=None if machine is None else machine.moves)
        return coach(progress)

    return advise
