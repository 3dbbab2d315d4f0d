"""Parts of ``record``: views, the page after the end, the coach."""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from session.base.errors import CalibrationError
from session.base.options import folder_written, option, typed
from session.base.progress import Reporter
from session.base.texts import command_line, printable
from tinygc.cli.arguments import note as note_read
from tinygc.cli.options import Command, Stream

if TYPE_CHECKING:
    from session.bench.guide import Guide, View
    from session.bench.guided_session import Watch
    from session.bench.messages import Advice, Progress
    from session.bench.page.server import PageServer
    from session.bench.recorder import Recorder
    from session.log.config import Protocol
    from tinygc.planning.coach import Coach


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


LOOPBACK = page_address("127.0.0.1:0")
SHORTEST_CLOSURE_S = 5.0
MOST_TURNS = 40  #: of a session whose numbers do not all reach their targets


@dataclass(frozen=True)
class Recording(Command, Stream):
    """Options of every recording, with what one kind has otherwise than another: its guide, its machine, the commands to go on with."""

    #: the command, as it is typed
    NAME = "record"
    #: whether a person turns, or a machine, from still to still
    TURNS = True
    view: Any = None

    port: str | None = option(
        None, "such as /dev/ttyACM0 (the only one there is, if it can be the board); list: those there are", default_key="record.port"
    )
    out: Path | None = option(None, "session folder to write (the next free data/sessionN)", metavar="DIR", read=folder_written)
    resume: bool = option(False, "go on with the recording in --out")
    note: tuple[Any, ...] = option(
        (), "for [notes] of session.toml, such as operator=Mara", metavar="KEY=TEXT", read=note_read, repeated=True, rare=True
    )
    like: Path | None = option(
        None, "take accelerometer, site and protocol from this session.toml", metavar="TOML", default_key="record.like", rare=True
    )
    sensor: str | None = option(None, "what it is, where the board does not report it (see sensors)")
    odr_hz: float | None = option(
        None,
        "data rate: set where the board takes commands, else what it is",
        unit="Hz",
        least=0.1,
        most=50_000,
        flags=("--odr",),
        rare=True,
    )
    gyro_fs_dps: float | None = option(None, "full scale, likewise", unit="dps", least=1, most=1e5, flags=("--gyro-fs",), rare=True)
    accel_fs_g: float | None = option(None, "full scale, likewise", unit="g", least=0.1, most=1000, flags=("--accel-fs",), rare=True)
    mute: bool = option(False, "no bell", rare=True)
    latitude_deg: float | None = option(None, "of the site", cli=False, default_key="site.latitude_deg")
    gravity_mps2: float | None = option(None, "of the site", cli=False, default_key="site.gravity_mps2")

    def takes(self, known: Mapping[str, object]) -> Sequence[str]:
        """Return the fields that the user's defaults fill in; known: the keys of the file.

        The folder's own session.toml overrides all but the port; a session.toml given by ``--like`` already contains the site.
        """
        if self.like is not None or (self.out is not None and (self.out / "session.toml").exists()):
            return ("port",)
        return ("port", "like") if "record.like" in known else ("port", "latitude_deg", "gravity_mps2")

    def machine(self, folder: Path, port: str) -> contextlib.AbstractContextManager[Any]:
        """Return a context with what turns the table, its plan confirmed; None where a person does."""
        return contextlib.nullcontext()

    def guide(self, protocol: Protocol) -> Guide:
        """Return the guide of the recording."""
        raise NotImplementedError

    def coach(self, machine: Any) -> Callable[[Progress], Advice] | None:
        """Return what recommends the next turn; None without a coach."""
        return None

    def next(self, folder: Path) -> tuple[str, ...]:
        """Return the commands to go on with."""
        return (command_line("fit", folder),)

    def again(self, folder: Path, port: str, *without: str) -> str:
        """Return the command that resumes the recording, without some of its options."""
        but = [*Recording.__dataclass_fields__, "yes", "at_zero", "view", *without]
        view = [] if self.view is None else ["--view"]
        return command_line(*self.NAME.split(), "--resume", "--out", folder, "--port", port, *typed(self, but), *view)


@dataclass(frozen=True)
class Turning(Recording):
    """Options of a recording of turns."""

    segments: int | None = option(None, f"make N turns, such as 10 for verify (as many as all numbers need, at most {MOST_TURNS})", least=1)
    closure: float = option(0.0, "then lead through a closure run with S seconds of turning (60)", unit="s", least=0, most=3600, alone=60.0)
    coached: bool = option(True, "recommend each turn", off="any turn will do", flags=("--no-coach",), rare=True)
    view: Any = option(
        None,
        "show a page in a browser: the board, where it is wanted, what to do (this computer alone; or HOST:PORT to listen on)",
        metavar="ADDRESS",
        read=page_address,
        alone=LOOPBACK,
    )

    def __post_init__(self) -> None:
        """Check each field, and that a closure run is no instant."""
        super().__post_init__()
        self.expect(not 0 < self.closure < SHORTEST_CLOSURE_S, "closure", f"a number from {SHORTEST_CLOSURE_S:g} to 3600 s")

    @property
    def plan(self) -> tuple[int, bool]:
        """How many turns at most, and whether to stop as soon as every number is good enough."""
        return self.segments or MOST_TURNS, self.segments is None and self.coached

    def guide(self, protocol: Protocol) -> Guide:
        """Return the guide of the turns."""
        from session.bench.guide import Guide

        return Guide(protocol, *self.plan, self.closure)

    def coach(self, machine: Any) -> Callable[[Progress], Advice] | None:
        """Return the coach."""
        return coach_of(machine) if self.coached else None


# Views of a recording: a live screen in a terminal, lines elsewhere, and a web page on request.


@contextlib.contextmanager
def page_server(args: Recording) -> Iterator[PageServer | None]:
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
def views(args: Recording, title: str, server: PageServer | None) -> Iterator[tuple[View, Watch | None]]:
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


# The recorded data, in lines and as JSON.

MOST_NAMED = 3  #: most logs that are named


def so_far(guide: Guide, recorder: Recorder) -> str:
    """What is recorded, and its files."""
    return f"{guide.so_far} ({recorder.raw.path.name}, {logs_of(recorder)})"


def logs_of(recorder: Recorder) -> str:
    """Name the logs, and count their samples."""
    names = [path.name for path in recorder.logs.paths] or ["no log yet"]
    logs = ", ".join(names) if len(names) <= MOST_NAMED else f"{names[0]} and {len(names) - 1} more"
    return f"{logs}, {recorder.samples} samples"


def faults_of(guide: Guide) -> str:
    """Name every fault of the board and of its stream, with how often it came; empty without any."""
    words = [f"{count} {name}" for name, count in guide.health.faults.items() if count]
    words += [f"the board counted {name} {count}×" for name, count in guide.board_faults.items() if count]
    return ", ".join(words)


def left_out(recorder: Recorder) -> Iterator[str]:
    """Yield data that is in the raw bytes but in no log, or that may be wrong in one."""
    from session.bench.frames import damaged_words

    raw = recorder.raw.path
    if crc_errors := recorder.decoder.crc_errors:
        yield f"{raw}: of {crc_errors} damaged frames {damaged_words(crc_errors)}"
    if recorder.undecoded:
        yield f"{raw}: {recorder.undecoded} bytes of it are in no log yet; record --resume goes on with them, or import {raw} --out DIR"


def missing(guide: Guide) -> str:
    """Name the number that is furthest from good enough, according to the coach."""
    if guide.advice is None or not guide.advice.missing:
        return ""
    worst, *others = guide.advice.missing
    return f"Worst: {worst}{f' and {len(others)} more' if others else ''}."


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


def while_seen(server: PageServer, wanted: Callable[[], bool]) -> Iterator[None]:
    """Yield time after time until an interruption, or until no browser has shown the page for a while: a reload, or a sleeping phone."""
    seen_s = time.monotonic()
    while not wanted() and (not server.visited or time.monotonic() - seen_s < GONE_S):
        yield
        if server.clients:
            seen_s = time.monotonic()
        time.sleep(LOOK_EVERY_S)


def stay(server: PageServer, folder: Path, wanted: Callable[[], bool]) -> None:
    """Keep the page while a browser shows it, until an interruption; at once where no browser has opened it."""
    path, ready = folder / "report.html", False

    def publish(report: str, words: str) -> None:
        server.publish("end", {"words": printable(words), "command": command_line("report", folder), "report": report})

    server.report = lambda: path.read_bytes() if ready and path.is_file() else None
    publish("offered", "The files are closed.")
    if not server.visited:
        return
    print("the page stays while it is looked at, and can make the report; Ctrl-C ends it", file=sys.stderr, flush=True)
    for _ in while_seen(server, wanted):
        if server.wishes.report.is_set():
            problem = _made(folder, wanted, lambda words: publish("making", words))
            ready = not problem and path.is_file()
            publish(*(("ready", f"The report is {path}.") if ready else ("failed", f"No report: {problem}.")))
            server.wishes.report.clear()


def _made(folder: Path, wanted: Callable[[], bool], show: Reporter) -> str:
    """Make the report in a process of its own, with the time that it takes; return why there is none, or nothing."""
    began_s = time.monotonic()
    command = [sys.executable, str(CALIBRATE), "report", str(folder.resolve()), "--quiet"]  # no name that looks like an option
    with tempfile.TemporaryFile() as errors:
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors) as making:
            try:
                while making.poll() is None and not wanted():
                    show(f"The report is being made: {time.monotonic() - began_s:.0f} s so far, up to some minutes in all.")
                    time.sleep(LOOK_EVERY_S)
            finally:
                making.terminate()
        return "" if making.returncode in MADE else _last_line(errors) or f"exit code {making.returncode}"


def _last_line(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read().decode("utf-8", "replace").strip().splitlines()
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
