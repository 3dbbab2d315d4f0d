"""What the page of a recording shows: stills, segments with their closure, marks with their reasons, changes by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from session.base.errors import CalibrationError
from session.base.progress import Progress, no_report
from session.base.texts import printable
from session.base.units import DEG, NS
from session.detect.check_references import with_own_accelerometer
from session.detect.check_samples import with_bridges
from session.detect.first_look import CHANGED
from session.detect.segments import LogSegments, Segment, moments_of, moved_at, session_segments
from session.detect.stills import SessionStills, still_at
from session.log.config import LeftOut, StillByHand, read_config
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples, start_times
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session, prepared_for
from tinygc.models.linear import bias_only

METHOD = "least_squares"
#: places of a log, by what was put in there
MARKS = {"gap": "missing, put in from their neighbours", "clipped": "at the register's end, estimated from their neighbours"}


#: errors of tilt at the end of a segment that is in no fit, degrees: raw, and calibrated (held out of the fit)
NOT_FITTED: dict[str, float | None] = {"raw_deg": None, "after_deg": None}


@dataclass(frozen=True, eq=False)
class Closure:
    """What a fit leaves: turns by the samples between which they move; rms of all, and of the floor, degrees; the problem; warnings."""

    turns: Mapping[tuple[int, int, int], Mapping[str, float | None]]
    raw_deg: float
    after_deg: float
    floor_deg: float
    problem: Problem
    warnings: tuple[str, ...]

    @classmethod
    def of(cls, session: Session, progress: Progress = no_report) -> Closure:
        """By least squares, as ``fit`` does it.  Raises its errors."""
        options = FitOptions(methods=(METHOD,))
        prepared = prepared_for(session, options, progress)
        result = fit_session(prepared.session, options, progress, prepared=prepared)
        problem, held_out = result.problem, result.methods[METHOD].held_out
        raw = closure_angles(problem.batch, bias_only())
        tilts = (np.linalg.norm(angles[:, :2], axis=1) / DEG for angles in (raw, held_out))
        turns = {
            _ends(segment): dict(zip(NOT_FITTED, map(float, each), strict=True))
            for segment, *each in zip(problem.used, *tilts, strict=True)
        }
        raw_deg, after_deg, floor_deg = (float(each / DEG) for each in (tilt_rms(raw), tilt_rms(held_out), problem.floor.tilt_rms))
        return cls(turns, raw_deg, after_deg, floor_deg, problem, tuple(each.line for each in result.warnings if each.what != CHANGED))

    @property
    def figures(self) -> dict[str, float]:
        """For the page: rms of tilt, and how many turns."""
        return {"raw_deg": self.raw_deg, "after_deg": self.after_deg, "floor_deg": self.floor_deg, "turns": len(self.turns)}


def _ends(segment: Segment) -> tuple[int, int, int]:
    """Log, first and last sample of the movement."""
    if segment.first is None or segment.last is None:
        return segment.log, segment.start, segment.stop - 1
    return segment.log, segment.first.stop - 1, segment.last.start


@dataclass(frozen=True, eq=False)
class Recording:
    """A session as it is looked at: its stills and segments under what ``session.toml`` changes by hand."""

    session: Session

    def again(self) -> Recording:
        """With the changes that the file has now."""
        config = read_config(self.session.folder / "session.toml")
        return Recording(replace(self.session, config=replace(self.session.config, exclude=config.exclude, still=config.still)))

    @cached_property
    def found(self) -> tuple[Session, SessionStills]:
        """The session with its bridges, and its stills.  Raises FormatError for a change that cannot be."""
        session, _ = self.session.examined()
        session, _ = with_own_accelerometer(session)
        whole = with_bridges(session)
        return whole, SessionStills(whole, SessionStills(session))

    @cached_property
    def parts(self) -> list[LogSegments]:
        """Its logs with their stills and segments."""
        return session_segments(*self.found)

    def content(self, closure: Closure | None = None, before: Closure | None = None, stale: bool = False, why: str = "") -> dict[str, Any]:
        """For the page; closure: of the last fit; before: of the one before; stale: whether something was changed since; why: there is
        none."""
        session, parts = self.session, self.parts
        began_s = dict(zip((log.path.name for log in logs_of(session)), _began(session), strict=False))
        at = [_clock(part.log.samples, began_s[part.log.path.name]) for part in parts]
        segments, of_segments = [segment for part in parts for segment in part.segments], at
        if session.reference is not None:  # which cuts its own
            segments = [] if closure is None else closure.problem.segments
            of_segments = [_clock(log.samples, began_s[log.path.name]) for log in session.logs]
        elif closure is not None and not stale:  # with the reasons that only a fit knows
            segments = closure.problem.segments
        stills, number = [], 0
        for place, part in enumerate(parts):
            for index, still in enumerate(part.stills):
                row = self.row_of_still(place, index)
                ends = {"from_s": at[place](still.start), "to_s": at[place](still.stop - 1)}
                changed = None if row is None else "left out" if row.from_s is None else "moved"
                stills.append({"number": number, **ends, "problem": still.problem, "by_hand": changed, "temp_c": _known(still.temp_c)})
                number += 1
        widened: dict[int, list[str]] = {}
        for each in () if closure is None or stale else closure.problem.widened:
            widened.setdefault(each.segment, []).append(each.words)
        return {
            "session": session.name,
            "sensor": " · ".join(filter(None, (session.config.sensor.model, session.config.sensor.serial))),
            "length_s": float(_began(session)[-1]),
            "logs": [{"name": name, "from_s": float(start)} for name, start in began_s.items()],
            "stills": stills,
            "segments": [
                {
                    "number": segment.number,
                    "from_s": of_segments[segment.log](segment.start),
                    "to_s": of_segments[segment.log](segment.stop - 1),
                    "turn_s": segment.turn_s,
                    "turn_deg": segment.turn_deg,
                    "note": "; ".join(filter(None, (segment.note, *widened.get(segment.number, ())))) or None,
                    "problem": segment.problem,
                    "by_hand": bool(self.rows_of_segment(segment)),
                    **((closure and closure.turns.get(_ends(segment))) or NOT_FITTED),
                }
                for segment in segments
            ],
            "marks": [*self._bridges(at), *self._rests(at)],
            "closure": closure and closure.figures,
            "before": before and before.figures,
            "stale": stale,
            "why": printable(why),
            "warnings": [] if closure is None else list(closure.warnings),
        }

    def _bridges(self, at: Sequence[Callable[[int], float]]) -> list[dict[str, Any]]:
        return [
            {
                "from_s": at[place](bridge.row),
                "to_s": at[place](bridge.row + bridge.count - 1),
                "what": bridge.what,
                "why": f"{bridge.count} samples {MARKS.get(bridge.what, bridge.what)}",
            }
            for place, part in enumerate(self.parts)
            for bridge in part.log.bridges
        ]

    def _rests(self, at: Sequence[Callable[[int], float]]) -> list[dict[str, Any]]:
        if self.session.reference is not None:
            return []
        rests = [(at[place](0) + rest.start_s, rest) for place, part in enumerate(self.parts) for rest in part.found.unused]
        return [{"from_s": start, "to_s": start + rest.duration_s, "what": "rest", "why": rest.why} for start, rest in rests]

    # Changes by hand, and what they mean here.

    def rows_of_segment(self, segment: Segment) -> list[LeftOut]:
        """Of ``session.toml``, those that leave it out."""
        if self.session.reference is not None:
            return []
        part = self.parts[segment.log]
        rows = [row for row in self.session.config.exclude if moments_of(part.log.path, [row])]
        return [row for row in rows if moved_at(segment, part.found.samples, row.at_s)]

    def row_of_still(self, log: int, index: int) -> StillByHand | None:
        """Of ``session.toml``, the one that changes it."""
        part = self.parts[log]
        detected, samples = part.found.detected or part.stills, part.found.samples
        rows = [row for row in self.session.config.still if moments_of(part.log.path, [row])]
        return next((row for row in rows if still_at(detected, samples, row.at_s) == index), None)

    def segment(self, number: int) -> Segment:
        """By its number.  Raises LookupError."""
        return next(s for part in self.parts for s in part.segments if s.number == number)

    def place(self, still: int) -> tuple[int, int]:
        """Log, and number in it, of a still counted over all logs.  Raises LookupError."""
        for log, part in enumerate(self.parts):
            if 0 <= still < len(part.stills):
                return log, still
            still -= len(part.stills)
        raise LookupError(still)

    def leave_out(self, segment: Segment) -> LeftOut:
        """The row that leaves it out."""
        log, first, last = _ends(segment)
        t_ns = self.parts[log].found.samples.t_ns
        return LeftOut(self.parts[log].log.path.name, round(float((t_ns[first] // 2 + t_ns[last] // 2) * NS), 6))

    def change(self, still: int, ends_s: tuple[float, float] | None) -> StillByHand:
        """The row that leaves a still out, or gives it other ends, s of the session."""
        log, index = self.place(still)
        part = self.parts[log]
        found, t_ns = (part.found.detected or part.stills)[index], part.found.samples.t_ns
        name, at_s = part.log.path.name, round(float(t_ns[found.middle] * NS), 6)
        if ends_s is None:
            return StillByHand(name, at_s)
        began_s = _began(self.session)[[each.path.name for each in self.session.logs].index(name)]
        start, stop = (round(float(t_ns[0] * NS + end - began_s), 6) for end in ends_s)
        return StillByHand(name, at_s, start, stop)


def logs_of(session: Session) -> tuple[Log, ...]:
    """All that is shown, one after the other: its logs, then its closure runs."""
    return (*session.logs, *session.closures)


def _began(session: Session) -> np.ndarray:
    return start_times(log.samples for log in logs_of(session))


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _clock(samples: Samples, began_s: float) -> Callable[[int], float]:
    """Session time, s, of the samples of a log."""
    return lambda row: round(samples.at_s(row) + began_s, 6)


def fitted(recording: Recording, progress: Progress = no_report) -> tuple[Closure | None, str]:
    """The closure of a recording; or None, and why not."""
    try:
        return Closure.of(recording.session, progress), ""
    except CalibrationError as error:
        return None, str(error).removeprefix(f"{recording.session.folder}: ")
