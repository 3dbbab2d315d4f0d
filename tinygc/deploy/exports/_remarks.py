"""Comment lines that every text format begins with: what this is, of what, in which frame.

Names and serial numbers are another's words: each line goes through ``comment``, and is one line.
"""

from __future__ import annotations

from textwrap import wrap

from session.common.texts import comment
from tinygc.deploy.exports._context import Context

FRAME = (
    "Frame: the sensor's own axes, right-handed, exactly as in the log that was calibrated (this project's b: forward, right, down,",
    "where they are so mounted).  If your driver turns the axes before this is applied (REP 103: forward, left, up), turn it too:",
    "E' = R E R^T, B' = R B with R from logged to driver's axes.",
)


def remarks(context: Context, *lines: str, mark: str = "#", longest: int | None = None) -> str:
    """Source and frame, then the format's own lines, as comments; longest: bytes of a line, where a reader takes the rest for the next."""
    sensor = context.config.sensor
    head = (
        f"TinyGC calibration of session {context.session}, method {context.method}: {sensor.model} {sensor.serial}".rstrip(),
        *(f"sha256 {digest}  {name}" for name, digest in context.hashes.items()),
        *FRAME,
        *lines,
    )
    written = [comment(line) for line in head]
    if longest is not None:
        written = [piece for line in written for piece in _pieces(line, longest - len(mark) - 1)]
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in written)


def _pieces(line: str, most: int) -> list[str]:
    """Of at most so many bytes of UTF-8, broken at blanks where there are any."""
    for width in (most, most // 2, most // 4):  # no character has more than four bytes
        pieces = wrap(line, width, subsequent_indent="  ", break_on_hyphens=False)
        if all(len(piece.encode()) <= most for piece in pieces):
            break
    return pieces
