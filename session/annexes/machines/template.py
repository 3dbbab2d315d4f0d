"""A first ``table.toml`` for a make, with a comment on each key: ``table new MAKE``."""

from __future__ import annotations

from session.annexes.machines.description import SCHEMA
from session.annexes.machines.makes import MODULES, make_of_name
from session.io.texts import comment

TEMPLATE = """\
# A table that turns a sensor (docs/formats/tables.md).  Fill in what is marked <--, then `table check table.toml`.
schema = "{schema}"
name = "my table"
make = "{make}"  # {title}
{remarks}{port}
# From the sensor's axes to the innermost stage, all angles at zero: rows of a rotation matrix.  Known to a degree is enough.
mounting = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]  # <--
{settings}
# One [[axis]] for each axis of the table, from the ground outwards.
[[axis]]
name = "outer"           # yours: small letters
word = "{word}"{gap}# what the machine calls it  <--
direction = [0, 0, 1]    # of a positive turn, at angles of zero, right-handed: [0, 0, 1] is down, so clockwise seen from above  <--
# The software limits; leave both out only where the table may turn without end (a slip ring, no cable).
least_deg = -180         # <-- what the cable allows
most_deg = 180           # <--
fastest_dps = 30         # no move is faster  <--
acceleration_dps2 = 100  # as the controller is set  <--
sigma_deg = 0.1          # accuracy of the angle that it says, one sigma
backlash_deg = 0.1       # play when the sense changes; 0 if there is none
"""
#: what a make wants besides: a line of [settings], and the word of an axis
SETTINGS = {
    "grbl": ("homing = true  # false without limit switches ($22 = 0)", "X"),
    "marlin": ("count_per_deg = 80  # steps to a degree, as of M92  <--", "X"),
    "scpi": ("", "AXIS1"),
    "line": ("", "outer"),
    "hand": ("", "outer"),
    "ximc": ("steps_per_deg = 100  # full steps of the motor to a degree of the stage  <--", "xi-com:///dev/ttyACM0"),
}


def template(make: str) -> str:
    """The text of a ``table.toml`` to fill in.  FormatError for a make that is not there."""
    settings, word = SETTINGS.get(make, ("", "1"))
    if make in MODULES:
        title, remarks, port = MODULES[make].TITLE, "", ""
    else:
        of = make_of_name(make)
        title, remarks = of.title, f"# Unchecked: {comment(of.unchecked)}\n" if of.unchecked else ""
        port = f'port = "/dev/ttyUSB0"  # <-- `ports` lists what there is\nbaud = {of.baud}\n'
    return TEMPLATE.format(
        schema=SCHEMA,
        make=make,
        title=comment(title),
        remarks=remarks,
        port=port,
        settings=f"\n[settings]\n{settings}\n" if settings else "",
        word=word,
        gap=" " * max(2, 16 - len(word)),
    )
