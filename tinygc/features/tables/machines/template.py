"""A first ``table.toml`` for a make, with a comment on each key: ``table new MAKE``."""

from __future__ import annotations

from session.base.texts import comment
from tinygc.features.tables.machines.description import SCHEMA
from tinygc.features.tables.machines.makes import MODULES, make_of_name

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
name = "{name}"{gap}# yours: small letters
word = "{word}"{word_gap}# what the machine calls it  <--
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
#: what a make wants besides: a line of [settings], and the words of the axes (none: their names)
SETTINGS = {
    "grbl": ("homing = true  # false without limit switches ($22 = 0)", "XYZ"),
    "scpi": ("", ("AXIS1", "AXIS2", "AXIS3")),
    "ximc": (
        "steps_per_deg = 100  # full steps of the motor to a degree of the stage  <--",
        tuple(f"xi-com:///dev/ttyACM{number}" for number in range(3)),
    ),
}


def template(make: str, axes: int = 1) -> str:
    """The text of a ``table.toml`` to fill in, of one to three axes.  FormatError for a make that is not there."""
    settings, words = SETTINGS.get(make, ("", ()))
    if make in MODULES:
        title, remarks, port = MODULES[make].TITLE, "", ""
    else:
        of = make_of_name(make)
        title, remarks = of.title, f"# Unchecked: {comment(of.unchecked)}\n" if of.unchecked else ""
        port = f'port = "/dev/ttyUSB0"  # <-- `ports` lists what there is\nbaud = {of.baud}\n'
    text = TEMPLATE.format(
        schema=SCHEMA,
        make=make,
        title=comment(title),
        remarks=remarks,
        port=port,
        settings=f"\n[settings]\n{settings}\n" if settings else "",
    )
    for (name, direction), word in zip(AXES[axes - 1].items(), words or AXES[axes - 1], strict=False):
        gap, word_gap = (" " * max(2, 16 - len(each)) for each in (name, word))
        about = DOWN if direction == [0, 0, 1] else ""
        text += "\n" * (name != "outer") + AXIS.format(
            name=name, gap=gap, word=word, word_gap=word_gap, direction=direction, about=about, limits=BELOW if make == "grbl" else LIMITS
        )
    return text
