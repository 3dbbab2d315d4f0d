"""An accelerometer's calibration as a table in the terminal."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from session.accelerometer.lengths import LengthFit
from session.common.units import MG
from tinygc.fitting.accelerometer import AccelerometerFit

DIGITS = {"ppm": 0, "mrad": 3, "mg": 3}
#: a still that counts for less than this did not count
IDLE_WEIGHT = 0.1


def accelerometer_table(found: AccelerometerFit, title: str) -> Table:
    """Scale, nonorthogonality and bias, each with one sigma."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for column in ("", "x", "y", "z"):
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    for word, unit, values, sigmas, names in found.errors():
        digits, spread = DIGITS[unit], np.zeros(3) if sigmas is None else sigmas
        shown = zip(values, spread, names, strict=True)
        cells = ["not observed" if name in found.unobserved else f"{v:.{digits}f} ± {s:.{digits}f}" for v, s, name in shown]
        table.add_row(f"{word}, {unit}" + (" (xy, xz, yz)" if unit == "mrad" else ""), *cells)
    if found.mode == "prior":
        table.caption = f"the calibration that is given is a prior; it holds: p = {found.p_value:.2g}"
        table.caption_justify = "left"
    return table


def lengths_page(name: str, found: LengthFit, fit: AccelerometerFit) -> Group:
    """What ``calibrate.py accelerometer`` prints."""
    text = Text(f"{name}: ", "bold")
    before, after = (float(np.std(each)) / MG for each in (found.before, found.after))
    said = f"{len(found.before)} stills in {found.attitudes} attitudes; gravity's spread {before:.2f} mg before, {after:.2f} mg after"
    text.append(said, "not bold")
    parts: list[RenderableType] = [text, accelerometer_table(fit, "Accelerometer, what it errs by: value ± one sigma")]
    idle = np.flatnonzero(found.weight < IDLE_WEIGHT)
    if len(idle):
        listed = ", ".join(f"{i} ({found.after[i] / MG:+.1f} mg)" for i in idle[:5]) + (", …" if len(idle) > 5 else "")
        parts.append(Text(f"stills that hardly counted, their gravity being off: {listed}", "yellow"))
    if found.unobserved:
        do = "rest it on edges and corners, too"
        parts.append(Text(f"Not observed by these attitudes: {', '.join(found.unobserved)}; {do}.", "yellow"))
    return Group(*parts)
