"""``[accelerometer]`` of a session.toml that is a person's own: put there, or in the place of the one that is, and nothing else touched."""

from __future__ import annotations

import re

from session.common.errors import FormatError
from session.files.toml import parse_toml
from session.log.config import Accelerometer

SECTION = "[accelerometer]"
#: a new section stands before this one, where there is one
NEXT_SECTION = "[protocol]"
#: text in quotes, and a comment: brackets in them open nothing
IDLE = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'|#.*')


def section(accelerometer: Accelerometer, remark: str = "", own_stills: bool = False) -> str:
    """The section's text, 1e-9 and 1e-8 m/s^2 its last digits; remark: a comment above it; own_stills: see docs/formats.md."""
    rows = ", ".join("[" + ", ".join(f"{value:.9f}" for value in row) + "]" for row in accelerometer.matrix)
    bias = ", ".join(f"{value:.8f}" for value in accelerometer.bias_mps2)
    own = "own_stills = true  # leave this line out where another recording is to have it as a prior\n" if own_stills else ""
    return (f"# {remark}\n" if remark else "") + f"{SECTION}\nmatrix = [{rows}]\nbias_mps2 = [{bias}]\n{own}"


def with_section(text: str, accelerometer: Accelerometer, remark: str) -> str:
    """The text of a session.toml with this calibration of its own stills in it.

    Raises FormatError where that cannot be done without touching something else.
    """
    lines = text.splitlines(keepends=True)
    headers = _headers(lines)
    new = section(accelerometer, remark, own_stills=True) + "\n"
    mine = next((i for i in headers if _bare(lines[i]) == SECTION), None)
    if mine is not None:
        end = next((i for i in headers if i > mine), len(lines))
        made = "".join([*lines[:mine], new, *lines[end:]])
    else:
        at = next((i for i in headers if _bare(lines[i]) == NEXT_SECTION), len(lines))
        gap = "" if at == 0 or lines[at - 1].endswith("\n") else "\n"
        made = "".join([*lines[:at], gap, new, *lines[at:]])
    try:
        before, after = parse_toml(text, ""), parse_toml(made, "")
    except FormatError:
        before, after = {}, {"": None}
    if {**before, "accelerometer": None} != {**after, "accelerometer": None} or "own_stills" not in after.get("accelerometer", {}):
        raise FormatError(
            f"session.toml is written in a way that its [accelerometer] cannot be replaced in; put this there by hand: {new!r}"
        )
    return made


def _headers(lines: list[str]) -> list[int]:
    """Numbers of the lines that begin a table: a bracket that opens where none is open."""
    found, depth = [], 0
    for number, line in enumerate(lines):
        code = IDLE.sub("", line)
        if depth == 0 and code.lstrip().startswith("["):
            found.append(number)
            continue
        depth = max(0, depth + code.count("[") + code.count("{") - code.count("]") - code.count("}"))
    return found


def _bare(line: str) -> str:
    return "".join(IDLE.sub("", line).split())
