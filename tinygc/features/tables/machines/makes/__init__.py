"""Makes of tables: a file of dialogues each, or a module for what speaks no lines.  ``open_table`` opens any of them."""

from __future__ import annotations

from pathlib import Path

from session.base.errors import FormatError
from session.base.texts import command_line, comment
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import AGAIN, Description
from tinygc.features.tables.machines.dialogue import Dialogue
from tinygc.features.tables.machines.makefile import Make, read_make
from tinygc.features.tables.machines.makes import ximc
from tinygc.features.tables.machines.proof import fitted
from tinygc.features.tables.machines.verbs import PRESS, Link, SerialLink, Table, VisaLink

#: makes that are code, and those that are files
MODULES = {"ximc": ximc}
FILES = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}


def makes() -> dict[str, str]:
    """Name -> title of each make."""
    return {name: read_make(path).title for name, path in FILES.items()} | {name: module.TITLE for name, module in MODULES.items()}


def make_of(table: Description, folder: Path | None = None) -> Make:
    """The make of a table, with its settings; ``make = "./mine.toml"`` is one of the user's, next to table.toml in ``folder``.

    Raises FormatError for what is wrong with it, for what does not fit the table, and for requests that may do more than is in the plan.
    """
    make = read_make((folder or Path()) / table.make) if is_own(table) else make_of_name(table.make)
    return fitted(table, make)


def is_own(table: Description) -> bool:
    """Whether its make's file does not come with the tool."""
    return table.make.endswith(".toml")


def make_of_name(name: str) -> Make:
    """A make that comes with the tool.  FormatError where it is none, or no file."""
    if name not in FILES:
        known = ", ".join([*FILES, *MODULES])
        raise FormatError(f"no make {name[:40]!r}; it is one of {known}, or a file of your own such as ./mine.toml; {AGAIN}")
    return read_make(FILES[name])


def open_table(
    table: Description, folder: Path | None = None, link: Link | None = None, clock: Clock | None = None, stops: bool = False
) -> Table:
    """Open the machine of a description; link: instead of its port; stops: to stop it, before it has answered anything.

    It moves only through ``safety.Guarded``.

    Raises FormatError for a description that the make does not fit, and for a make's file of one's own that is not confirmed as it is
    (``make_sha256``), before the port is opened; TableFault where nothing answers.
    """
    clock = clock or Clock()
    if table.make in MODULES:
        return MODULES[table.make].open_table(table, clock)
    make = make_of(table, folder)
    if is_own(table) and table.make_sha256 != make.sha256:
        why = "has changed since it was confirmed" if table.make_sha256 else "does not come with the tool, and no one has confirmed it"
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


# A first table.toml: ``table new MAKE``.

TEMPLATE = """\
# A table that turns a sensor (docs/formats/tables.md).  Fill in what is marked <--, then `table check table.toml`.
schema = "{schema}"
name = "my table"
make = "{make}"  # {title}
{remarks}{port}
# From the sensor's axes to the innermost stage, all angles at zero: rows of a rotation matrix.  Known to a degree is enough.
mounting = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]  # <--
{settings}
# One [[axis]] for each axis of the table, from the ground outwards; `table new {make} --axes 2` prints two.
# The software limits; leave both out only where the table may turn without end (a slip ring, no cable).
"""
AXIS = """\
[[axis]]
name = {name:<16}  # yours: small letters
word = {word:<16}  # what the machine calls it  <--
direction = {direction}    # of a positive turn, at angles of zero, right-handed{about}  <--
{limits}
fastest_dps = 30         # no move is faster  <--
acceleration_dps2 = 100  # as the controller is set  <--
sigma_deg = 0.1          # accuracy of the angle that it says, one sigma
backlash_deg = 0.1       # play when the sense changes; 0 if there is none
"""
#: names and directions of one axis; of two, which tilt and then turn, so that every turn can be about the level; of three
AXES = (
    {"outer": [0, 0, 1]},
    {"outer": [0, 1, 0], "inner": [0, 0, 1]},
    {"outer": [0, 0, 1], "middle": [0, 1, 0], "inner": [1, 0, 0]},
)
DOWN = ": [0, 0, 1] is down, so clockwise seen from above"
LIMITS = "least_deg = -180         # <-- what the cable allows\nmost_deg = 180           # <--"
#: of a GRBL with switches, where 0 is the switch
BELOW = "least_deg = -180         # <-- what the cable allows, from -$130 on\nmost_deg = -1            # <-- up to -$27: its switch is at 0"
#: what a make needs in addition: a line of [settings], and the words of the axes (none: their names)
SETTINGS = {
    "grbl": ("homing = true  # false without limit switches ($22 = 0)", "XYZ"),
    "scpi": ("", ("AXIS1", "AXIS2", "AXIS3")),
    "ximc": (
        "steps_per_deg = 100  # full steps of the motor to a degree of the stage  <--",
        tuple(f"xi-com:///dev/ttyACM{number}" for number in range(3)),
    ),
}


def template(make: str, axes: int = 1) -> str:
    """A first ``table.toml``, with a comment on each key, of one to three axes.  FormatError for a make that is not there."""
    settings, words = SETTINGS.get(make, ("", ()))
    if make in MODULES:
        title, remarks, port = MODULES[make].TITLE, "", ""
    else:
        of = make_of_name(make)
        title, remarks = of.title, f"# Unchecked: {comment(of.unchecked)}\n" if of.unchecked else ""
        port = f'port = "/dev/ttyUSB0"  # <-- `record --port list` lists the ports\nbaud = {of.baud}\n'
    text = TEMPLATE.format(
        schema=Description.schema,
        make=make,
        title=comment(title),
        remarks=remarks,
        port=port,
        settings=f"\n[settings]\n{settings}\n" if settings else "",
    )
    for (name, direction), word in zip(AXES[axes - 1].items(), words or AXES[axes - 1], strict=False):
        about = DOWN if direction == [0, 0, 1] else ""
        text += "\n" * (name != "outer") + AXIS.format(
            name=f'"{name}"', word=f'"{word}"', direction=direction, about=about, limits=BELOW if make == "grbl" else LIMITS
        )
    return text
