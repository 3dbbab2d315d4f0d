"""Makes of tables, a file of dialogues each.  ``open_table`` opens any of them."""

from __future__ import annotations

from pathlib import Path

from session.base.errors import FormatError
from session.base.texts import command_line, comment
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import AGAIN, Description
from tinygc.features.tables.machines.dialogue import Dialogue
from tinygc.features.tables.machines.link import PRESS, SerialLink
from tinygc.features.tables.machines.makefile import Make, read_make
from tinygc.features.tables.machines.proof import fitted

FILES = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}


def makes() -> dict[str, str]:
    """Name -> title of each make."""
    return {name: read_make(path).title for name, path in FILES.items()}


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
        raise FormatError(f"no make {name[:40]!r}; it is one of {', '.join(FILES)}, or a file of your own such as ./mine.toml; {AGAIN}")
    return read_make(FILES[name])


def open_table(
    table: Description, folder: Path | None = None, link: SerialLink | None = None, clock: Clock | None = None, stops: bool = False
) -> Dialogue:
    """Open the machine of a description; link: instead of its port; stops: to stop it, before it has answered anything.

    It moves only through ``safety.Guarded``.

    Raises FormatError for a description that the make does not fit, and for a make's file of one's own that is not confirmed as it is
    (``make_sha256``), before the port is opened; TableFault where nothing answers.
    """
    clock = clock or Clock()
    make = make_of(table, folder)
    if is_own(table) and table.make_sha256 != make.sha256:
        why = "has changed since it was confirmed" if table.make_sha256 else "does not come with the tool, and no one has confirmed it"
        do = f"{command_line('table', 'check')} shows all that it can send, and the line that confirms it"
        stop = f"; Ctrl-C in the program that moves it stops it; {PRESS}" if stops else ""
        raise FormatError(f"{table.name}: {table.make} {why}: nothing was sent; {do}{stop}")
    if link is None and not table.port:
        raise FormatError(f'{table.name}: has no port; give it one, such as port = "/dev/ttyUSB0"; {AGAIN}')
    if link is None:
        link = SerialLink(table.port, table.baud or make.baud, clock)
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
{unchecked}port = "/dev/ttyUSB0"  # <-- `record --port list` lists the ports
baud = {baud}

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
}


def template(make: str, axes: int = 1) -> str:
    """A first ``table.toml``, with a comment on each key, of one to three axes.  FormatError for a make that is not there."""
    settings, words = SETTINGS.get(make, ("", ()))
    of = make_of_name(make)
    text = TEMPLATE.format(
        schema=Description.schema,
        make=make,
        title=comment(of.title),
        unchecked=f"# Unchecked: {comment(of.unchecked)}\n" if of.unchecked else "",
        baud=of.baud,
        settings=f"\n[settings]\n{settings}\n" if settings else "",
    )
    for (name, direction), word in zip(AXES[axes - 1].items(), words or AXES[axes - 1], strict=False):
        about = DOWN if direction == [0, 0, 1] else ""
        text += "\n" * (name != "outer") + AXIS.format(
            name=f'"{name}"', word=f'"{word}"', direction=direction, about=about, limits=BELOW if make == "grbl" else LIMITS
        )
    return text
