"""``record --series``: a row of boards at one bench; unplug, plug in the next, and it begins."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.common.texts import printable, shell_word
from tinygc.cli.commands._interruption import Interruption
from tinygc.cli.commands._results import complain, output, write_json
from tinygc.cli.commands._views import page_server
from tinygc.cli.defaults import defaults_json

if TYPE_CHECKING:
    from session.page.server import PageServer
    from session.recording.series import Series

#: of ``record``: leads one recording to its end, None where it has to begin again; says what was recorded, and whether it was interrupted
Led = Callable[..., Any]
Tell = Callable[..., bool]


def run_series(args: argparse.Namespace, led: Led, tell: Tell) -> int:
    """Board after board until Ctrl-C, which keeps all; the list is ``series.json`` and the JSON.  130 where a board was cut short."""
    from session.common.errors import CalibrationError, StorageError
    from session.recording.series import SCHEMA, Listener, Series

    if args.resume:
        raise CalibrationError(
            "--resume: a series goes on with each board that was begun; leave it out, and give the series' folder with --out"
        )
    series = Series(args.out or Path("data") / f"series-{datetime.now().astimezone():%Y-%m-%d}")
    listener, last, code = Listener(lambda: _port(args), args.baud, args.header), None, 0
    with page_server(args) as page, Interruption() as wanted:  # one for the whole row: none of its moments may miss a Ctrl-C
        while not wanted():
            _say(args, "plug in the next board" if last is None else "unplug it, plug in the next board; Ctrl-C ends the row", ring=True)
            serial = listener.next_board(last, wanted)
            if serial is None or listener.name is None:
                break
            last = serial
            if (before := series.done(serial)) is not None:
                _say(args, f"board {serial} is done already ({series.folder / before.session}, {before.segments} segments)", ring=True)
                continue
            folder, begun = series.place(serial)
            _say(args, f"board {serial or 'without a serial number'}: {folder}{', which goes on' if begun else ''}", ring=True)
            try:
                if _one(args, series, serial, folder, begun, listener.name, page, wanted, led, tell):
                    code = 130
                    break
            except StorageError:
                raise
            except CalibrationError as error:
                complain(str(error))
    done = sum(each.done for each in series.entries)
    output(args).print(f"{series.folder}: {done} of {len(series.entries)} boards done", soft_wrap=True)
    if series.entries:
        output(args).print(f"next: calibrate.py fleet {shell_word(series.folder)}", soft_wrap=True)
    write_json(
        args.json, {"schema": SCHEMA, "folder": str(series.folder), "boards": [vars(e) for e in series.entries]} | defaults_json(args)
    )
    return code


def _one(
    args: argparse.Namespace,
    series: Series,
    serial: str,
    folder: Path,
    begun: bool,
    port: str,
    page: PageServer | None,
    wanted: Interruption,
    led: Led,
    tell: Tell,
) -> bool:
    """One board's session; whether it was interrupted."""
    from session.recording.series import Entry

    of_one = argparse.Namespace(**{**vars(args), "out": folder, "resume": begun})
    while (found := led(of_one, folder, port, wanted, lambda args, folder: None, page)) is None:
        pass  # it began again without another board's bytes
    interrupted = tell(of_one, folder, port, *found)
    guide = found[0]
    ended = datetime.now().astimezone().isoformat(timespec="seconds")
    series.add(Entry(serial, folder.name, guide.stage.value == "done", guide.accepted, ended))
    return interrupted


def _port(args: argparse.Namespace) -> str | None:
    """The one that was asked for, or the only one that can be the board; None while there is none, or more than one."""
    from session.common.errors import DeviceError
    from session.recording.ports import only_candidate

    if args.port:
        return str(args.port)
    try:
        return only_candidate().name
    except DeviceError:
        return None


def _say(args: argparse.Namespace, words: str, ring: bool = False) -> None:
    """A line, and a bell where somebody sits at a terminal."""
    bell = "\a" if ring and not args.mute and sys.stderr.isatty() else ""
    if not args.quiet:
        print(f"{bell}{printable(words)}", file=sys.stderr, flush=True)
    elif bell:
        print(bell, end="", file=sys.stderr, flush=True)
