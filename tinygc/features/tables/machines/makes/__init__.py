"""Makes of tables: a file of dialogues each, or a module for what speaks no lines.  ``open_table`` opens any of them."""

from __future__ import annotations

from pathlib import Path

from session.base.errors import FormatError
from session.base.texts import command_line
from session.bench.clocks import Clock, HostClock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.dialogue import Dialogue
from tinygc.features.tables.machines.makefile import AGAIN, FOLDER, Make, make_names, read_make
from tinygc.features.tables.machines.makes import hand, ximc
from tinygc.features.tables.machines.proof import require_fit
from tinygc.features.tables.machines.verbs import Table
from tinygc.features.tables.machines.wire import PRESS, Link, SerialLink, VisaLink

#: makes that are code
MODULES = {"hand": hand, "ximc": ximc}


def makes() -> dict[str, str]:
    """Name -> title of each make."""
    return {name: read_make(FOLDER / f"{name}.toml").title for name in make_names()} | {
        name: module.TITLE for name, module in MODULES.items()
    }


def make_of(table: Description, folder: Path | None = None) -> Make:
    """The make's file of a table; ``make = "./mine.toml"`` is one of the user's, beside table.toml in ``folder``.

    Raises FormatError for what is wrong with it, for what does not fit the table, and for requests that may do more than the plan says.
    """
    make = read_make((folder or Path()) / table.make) if is_own(table) else make_of_name(table.make)
    require_fit(table, make)
    return make


def is_own(table: Description) -> bool:
    """Whether its make's file does not come with the tool."""
    return table.make.endswith(".toml")


def make_of_name(name: str) -> Make:
    """A make that comes with the tool.  FormatError where it is none, or no file."""
    if name not in make_names():
        known = ", ".join([*make_names(), *MODULES])
        raise FormatError(f"no make {name[:40]!r}; it is one of {known}, or a file of your own such as ./mine.toml; {AGAIN}")
    return read_make(FOLDER / f"{name}.toml")


def open_table(
    table: Description, folder: Path | None = None, link: Link | None = None, clock: Clock | None = None, stops: bool = False
) -> Table:
    """Open the machine of a description; link: instead of its port; stops: to stop it, before it has answered anything.

    It moves only through ``safety.Guarded``.

    Raises FormatError for a description that the make does not fit, and for a make's file of one's own that is not confirmed as it is
    (``make_sha256``), before the port is opened; TableFault where nothing answers.
    """
    clock = clock or HostClock()
    if table.make in MODULES:
        return MODULES[table.make].open_table(table, clock)
    make = make_of(table, folder)
    if is_own(table) and table.make_sha256 != make.sha256:
        why = "has changed since it was confirmed" if table.make_sha256 else "does not come with the tool, and nobody has confirmed it"
        do = f"{command_line('table', 'check')} shows all that it can send, and the line that confirms it"
        stop = f"; Ctrl-C in the program that moves it stops it; {PRESS}" if stops else ""
        raise FormatError(f"{table.name}: {table.make} {why}: nothing was sent; {do}{stop}")
    if link is None and not table.port:
        raise FormatError(f'{table.name}: has no port; give it one, such as port = "/dev/ttyUSB0"; {AGAIN}')
    if link is None:
        is_visa = "::" in table.port
        baud = table.baud or make.baud
        link = VisaLink(table.port, baud, str(table.settings.get("visa", ""))) if is_visa else SerialLink(table.port, baud, clock)
    try:
        return Dialogue(table, make, link, clock, stops)
    except BaseException:
        link.close()
        raise
