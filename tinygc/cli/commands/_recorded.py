"""What was recorded, in lines and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from session.guide.guide import Guide
    from session.recording.recorder import Recorder

MOST_NAMED = 3  #: logs


def so_far(guide: Guide, recorder: Recorder) -> str:
    """What there is: segments and files."""
    names = [path.name for path in recorder.logs.paths] or ["no log yet"]
    logs = ", ".join(names) if len(names) <= MOST_NAMED else f"{names[0]} and {len(names) - 1} more"
    return f"{counted(guide, recorder)} ({recorder.raw.path.name}, {logs})"


def counted(guide: Guide, recorder: Recorder) -> str:
    """Segments and samples."""
    return f"{guide.accepted} of {guide.segments} segments, {recorder.samples} samples"


def left_out(recorder: Recorder) -> Iterator[str]:
    """What is in the raw bytes and in no log, or may be in one and wrong."""
    from session.recording.logwriter import said_not_logged
    from session.stream.frames import cannot_be_told

    raw, logs = recorder.raw.path, recorder.logs
    if crc_errors := recorder.decoder.crc_errors:
        yield f"{raw}: of {crc_errors} damaged frames {cannot_be_told(crc_errors)}"
    if recorder.undecoded:
        yield f"{raw}: {recorder.undecoded} bytes of it are in no log yet; record --resume goes on with them, or replay {raw} --out DIR"
    if logs.not_logged:
        yield f"{raw}: {said_not_logged(logs.not_logged, logs.not_logged_starts)}"


def missing(guide: Guide) -> str:
    """What the coach would still ask for."""
    if guide.advice is None or not guide.advice.missing:
        return ""
    return f"not yet at their target sigma: {'; '.join(guide.advice.missing[:4])}{'; …' if len(guide.advice.missing) > 4 else ''}"


def table(guide: Guide, folder: Path, recorder: Recorder) -> dict:
    """The result as JSON."""
    health = guide.health
    troubles = health.troubles  # before the port was closed, which tears the last frame
    return {
        "schema": "tinygc-record/1",
        "session": str(folder),
        "done": guide.stage.value == "done",
        "segments": {"wanted": guide.segments, "accepted": guide.accepted, "rejected": guide.rejected, "dropped": guide.dropped},
        "accelerometer": _accelerometer(guide),
        "samples": recorder.samples,
        "lost": troubles["lost"],
        "crc_errors": troubles["crc"],
        "garbage_bytes": troubles["garbage"],
        "implausible": troubles["implausible"],
        "resets": troubles["reset"],
        "odr_hz": health.odr_hz,
        "odr_by_host_hz": health.odr_by_host_hz,
        "logs": [path.name for path in recorder.logs.paths],
        "missing": list(guide.advice.missing) if guide.advice else None,
    }


def _accelerometer(guide: Guide) -> dict | None:
    """What the stills make of an accelerometer that nobody has calibrated."""
    if guide.taken.own is None:
        return None
    before, after = guide.taken.own.spread_mg
    stills = len(guide.taken.own.stills)
    return {"stills": stills, "attitudes": guide.taken.own.attitudes, "spread_mg": {"before": before, "after": after}}
