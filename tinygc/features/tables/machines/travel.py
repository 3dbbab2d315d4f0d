"""A controller's own settings, held against ``table.toml`` before a plan is confirmed: where its zero is, and how far it may turn.

A GRBL that homes ($22) has all its travel ($130 and on) below 0: its switch is at 0, or at the other end where $23 says so, and behind
homing it rests by $27 beside it.  A turn to the other side of 0 drives through the switch: an alarm with $21, nothing at all without.
"""

from __future__ import annotations

from collections.abc import Mapping

from session.base.units import DEG
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.verbs import TableLimit

#: deg by which a limit may lie beyond the travel: settings have three decimals
WITHIN_DEG = 1e-3
#: bits of ``homes``: it homes, and sets its zero there (grblHAL), which moves its travel
HOMES, ZERO_THERE = 1, 8


def require_travel(table: Description, numbers: Mapping[str, int], order: str, values: Mapping[int, float], per_deg: float) -> None:
    """TableLimit where the controller counts in inches, or an axis may turn beyond its travel.

    numbers: of the settings, by what they are (docs/formats/tables.md); values: by their numbers; order: letters of its axes.
    """
    value = {name: values.get(number, 0.0) for name, number in numbers.items()}
    if value.get("inches"):
        raise TableLimit(f"{table.name}: its controller has angles in inches: set ${numbers['inches']} to 0; nothing was moved")
    if int(value.get("homes", 0)) & (HOMES | ZERO_THERE) != HOMES:
        return
    for axis in table.axes:
        place = order.index(axis.word)
        if (travel := values.get(numbers["travel"] + place)) is None:
            continue
        pulloff = value["pulloff"]
        ends = (pulloff - travel, 0.0) if int(value["sense"]) >> place & 1 else (-travel, -pulloff)
        least, most = sorted(end / per_deg + 0.0 for end in ends)  # no -0
        settings = f"${numbers['travel'] + place}, ${numbers['pulloff']}, ${numbers['sense']}"
        if axis.least_rad is None or axis.most_rad is None:
            if stops := [numbers[name] for name in ("soft", "hard") if value[name]]:
                why = f"turns without end by table.toml, and ${stops[0]} stops it at {least:g} and {most:g} deg"
                raise TableLimit(f"{table.name}: {axis.name} {why}; set it to 0, or give limits; nothing was moved")
        elif axis.least_rad / DEG < least - WITHIN_DEG or axis.most_rad / DEG > most + WITHIN_DEG:
            limits = f"{axis.least_rad / DEG:g} to {axis.most_rad / DEG:g} deg"
            allowed = f"{least:g} to {most:g} by its controller ({settings})"
            raise TableLimit(
                f"{table.name}: {axis.name} may turn from {limits} by table.toml, and from {allowed}: beyond is its switch, or nothing "
                "that stops it; correct least_deg and most_deg, or these settings; nothing was moved"
            )
