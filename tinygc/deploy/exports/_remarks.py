"""Comment lines that every text format begins with: what this is, of what, in which frame.

Names and serial numbers are another's words: each line goes through ``comment``, and is one line.
"""

from __future__ import annotations

from session.common.texts import comment
from tinygc.deploy.exports._context import Context

FRAME = (
    "Frame: the sensor's own axes, right-handed, exactly as in the log that was calibrated (this project's b: forward, right, down,",
    "where they are so mounted).  If your driver turns the axes before this is applied (REP 103: forward, left, up), turn it too:",
    "E' = R E R^T, B' = R B with R from logged to driver's axes.",
)


def remarks(context: Context, *lines: str, mark: str = "#") -> str:
    """Source and frame, then the format's own lines, as comments."""
    sensor = context.config.sensor
    head = (
        f"TinyGC calibration of session {context.session}, method {context.method}: {sensor.model} {sensor.serial}".rstrip(),
        *(f"sha256 {digest}  {name}" for name, digest in context.hashes.items()),
        *FRAME,
        *lines,
    )
    return "".join(f"{mark} {comment(line)}".rstrip() + "\n" for line in head)
