"""``[accelerometer]`` of a session.toml that is a person's own: put there, or in the place of the one that is, and nothing else touched."""

from __future__ import annotations

import re

from session.log.config import Accelerometer

SECTION = "[accelerometer]"
#: a new section stands before this one, where there is one
NEXT_SECTION = "[protocol]"
HEADER = re.compile(r"^\s*\[[^\[\]]+\]\s*(#.*)?$")


def section(accelerometer: Accelerometer, remark: str = "") -> str:
    """The section's text, 1e-9 and 1e-8 m/s^2 its last digits; remark: a comment above it."""
    rows = ", ".join("[" + ", ".join(f"{value:.9f}" for value in row) + "]" for row in accelerometer.matrix)
    bias = ", ".join(f"{value:.8f}" for value in accelerometer.bias_mps2)
    return (f"# {remark}\n" if remark else "") + f"{SECTION}\nmatrix = [{rows}]\nbias_mps2 = [{bias}]\n"


def with_section(text: str, accelerometer: Accelerometer, remark: str) -> str:
    """The text of a session.toml with this calibration in it."""
    lines = text.splitlines(keepends=True)
    headers = [i for i, line in enumerate(lines) if HEADER.match(line)]
    mine = next((i for i in headers if lines[i].split("#")[0].strip() == SECTION), None)
    if mine is not None:
        end = next((i for i in headers if i > mine), len(lines))
        lines[mine:end] = [section(accelerometer, remark) + "\n"]
        return "".join(lines)
    at = next((i for i in headers if lines[i].strip().startswith(NEXT_SECTION)), len(lines))
    before = "" if at == 0 or not lines[at - 1].strip() or lines[at - 1].endswith("\n") else "\n"
    return "".join(lines[:at]) + before + section(accelerometer, remark) + "\n" + "".join(lines[at:])
