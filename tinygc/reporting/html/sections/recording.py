"""The session: stills and turns over time, data left out and why, attitudes and turn axes covered."""

from __future__ import annotations

from typing import Any

import numpy as np

from session.base.rotation import unit_vectors
from session.base.texts import fixed, significant
from session.base.units import DEG
from session.detect.accelerometer import force_of
from session.detect.segments import Segment
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.closure.problem import Problem
from tinygc.explanation.reported import ReportData
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.fit_text import earth_words
from tinygc.reporting.html.markup import Section, render

#: intervals of time of the envelope of the rate
COLUMNS = 800
#: instants of a turn whose axes are drawn
AXES_PER_TURN = 25


def section(evidence: ReportData) -> Section:
    """Section on the recording."""
    problem = evidence.problem
    html = render(
        "session.html",
        problem=problem,
        **_numbers(problem),
        earth=earth_words(evidence.fit).replace(" -", " −"),
        over_time=_over_time(problem),
        temperature=_temperature(problem),
        covered=_coverage(problem),
        warnings=evidence.fit.warnings,
    )
    return Section("session", "The session", html)


def _numbers(problem: Problem) -> dict[str, Any]:
    """What the list of facts has in addition to the problem: number and median duration of the good stills, s; what it is compared with."""
    good = [still.duration_s for _, still in problem.references]
    fastest = max(float(np.abs(problem.logs[s.log].samples.gyro[_turning(s)]).max()) for s in problem.used)
    return {
        "stills": (len(good), np.median(good)) if good else (),
        "rate_hz": 1 / np.median([log.samples.period_s for log in problem.logs]),
        "fastest_dps": fastest / DEG,
        "reference": reference_words(problem.session),
    }


def _turning(segment: Segment) -> slice:
    """Samples between the two stills of a turn; all of a segment between two moments of a further reference."""
    if segment.first is None or segment.last is None or segment.last.start < segment.first.stop:
        return slice(segment.start, segment.stop)
    return slice(segment.first.stop, segment.last.start + 1)


def _temperature_of(samples: Samples) -> np.ndarray | None:
    """Temperature (N,) degC; None if the log has none."""
    return samples.temp_c if samples.temp_c is not None and np.isfinite(samples.temp_c).any() else None


def _envelope(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle time, minimum and maximum in each of ``COLUMNS`` intervals of time."""
    edges = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], COLUMNS + 1)[:-1]))
    return t[edges], np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)


def _over_time(problem: Problem) -> Panel:
    began, (unit, word) = problem.began_s, _time_unit(problem)
    sizes = [np.linalg.norm(log.samples.gyro, axis=1) / DEG for log in problem.logs]
    # Scale by the used samples: picking up the sensor at the end must not shrink the session.
    top = max(float(sizes[s.log][s.start : s.stop].max()) for s in problem.used) * 1.1
    # Below zero stand stills and turns.
    about = "Rate over the session, with stills and turns"
    ticks = [tick for tick in Axis().marks(0, top, 260)]
    panel = Panel(Axis(f"time ({word})", 0, began[-1] / unit), Axis("rate (dps)", -0.24 * top, top, ticks=ticks), about=about)
    for number, (log, size) in enumerate(zip(problem.logs, sizes, strict=True)):
        middle, lo, hi = _envelope((log.samples.t_s + began[number]) / unit, size)
        panel.area(middle, lo, hi, "quiet").line(middle, hi, "quiet", "thin")
        for i, still in enumerate(log.stills):
            start = (began[number] + still.start_s) / unit
            label = f"still {i}, {still.duration_s:.1f} s" + (f": {still.problem}" if still.problem else "")
            look = ("bad", "left out") if still.problem else ("still", "still")
            _block(panel, start, still.duration_s / unit, -0.21 * top, *look, label)
        if number:
            panel.upright(began[number] / unit, "quiet")
    for segment in problem.segments:
        first = segment.first
        start = began[segment.log] + (segment.start_s if first is None else first.start_s + first.duration_s)
        label = f"segment {segment.number}: {segment.turn_deg:.0f}° in {segment.turn_s:.1f} s"
        label += f", left out: {segment.problem}" if segment.problem else f", {segment.note}" if segment.note else ""
        look = ("bad", "left out") if segment.problem else ("turn", "turn")
        _block(panel, start / unit, segment.turn_s / unit, -0.11 * top, *look, label)
    return panel


def _block(panel: Panel, start: float, length: float, below: float, kind: str, name: str, label: str) -> None:
    height = 0.07 * (panel.y.hi or 1.0)
    panel.area([start, start + length], below, below + height, kind, "block", name=name, labels=[label])


def _time_unit(problem: Problem) -> tuple[float, str]:
    return (60.0, "min") if problem.began_s[-1] > 600 else (1.0, "s")


def _temperature(problem: Problem) -> Panel | None:
    """Means of 1 s over the session; None where no log has a temperature."""
    began, (unit, word) = problem.began_s, _time_unit(problem)
    panel = Panel(Axis(f"time ({word})", 0, began[-1] / unit), Axis("temperature (°C)"), about="Temperature over the session", height=80)
    for number, log in enumerate(problem.logs):
        if (temp_c := _temperature_of(log.samples)) is not None:
            size = max(1, round(1 / log.samples.period_s))
            if whole := len(log.samples) // size * size:
                mean = temp_c[:whole].reshape(-1, size).mean(axis=1)
                panel.line((log.samples.t_s[:whole:size] + began[number]) / unit, mean, "before")
    lo, hi = panel.ends()[1]
    if hi - lo < 0.5:
        panel.y.lo, panel.y.hi = (lo + hi) / 2 - 0.25, (lo + hi) / 2 + 0.25
    return panel if panel.marks else None


# Directions on a sphere, as two discs in Lambert's equal-area projection: the half with z towards the viewer, and the other.

#: angular radius around a direction that counts as covered
REACH_RAD = np.pi / 6
_EVEN = 4000


def _coverage(problem: Problem) -> dict:
    good = [(number, still) for number, still in enumerate(problem.stills) if still.problem is None]
    down = -force_of([still for _, still in good])
    axes, instants, share = _turn_axes(problem)
    of_stills = [f"still {number}: down is {_direction(d)}" for (number, _), d in zip(good, down, strict=True)]
    of_turns = [f"segment {s.number}: about {_direction(a)}, {s.turn_deg:.0f}°" for s, a in zip(problem.used, axes, strict=True)]
    panels = [_disc(sign, down, "still", of_stills, name) for sign, name in ((1, "z side down"), (-1, "z side up"))]
    panels += [_disc(sign, axes, "turn", of_turns, name, instants) for sign, name in ((1, "turning with +z"), (-1, "turning with −z"))]
    panels[0].title, panels[2].title = f"Where down was{'' if good else ': no stills'}", "Axes of the turns"
    draw = Picture(panels, columns=4, least=140)
    return {"draw": draw, "attitudes": _covered(down) if good else None, "axes": _covered(instants), "share": share}


def _covered(directions: np.ndarray) -> float:
    """Share of the sphere that lies within 30 degrees of one of the directions (N, 3)."""
    if not len(directions):
        return 0.0
    k = np.arange(_EVEN) + 0.5
    z, turn = 1 - 2 * k / _EVEN, np.pi * (1 + np.sqrt(5)) * k
    even = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    unit = unit_vectors(directions)
    return float(np.mean((even @ unit.T).max(axis=1) >= np.cos(REACH_RAD)))


def _disc(sign: int, directions: np.ndarray, kind: str, labels: list[str], name: str, faint: np.ndarray | None = None) -> Panel:
    """One half of the sphere, with rings at 30 and 60 degrees; faint (M, 3): smaller points behind."""
    about = "Directions of gravity in the stills, and axes of the turns, in the sensor's own frame"
    panel = Panel(Axis(name), about=about, height=180, is_equal=True, is_framed=False)
    turn = np.linspace(0, 2 * np.pi, 73)
    for angle in np.radians((30, 60, 90)):
        size = np.sqrt(2) * np.sin(angle / 2)
        panel.line(size * np.cos(turn), size * np.sin(turn), "rule" if angle > 1.5 else "grid", "hair")
    panel.line([-1, 1], 0, "grid", "hair").line([0, 0], [-1, 1], "grid", "hair")
    panel.words(1.1, -0.04, "x").words(0, 1.1, "y", anchor="middle")
    for points, style, radius in ((faint, "faint", 1.3), (directions, "dot", 3.4)):
        if points is None or not len(points):
            continue
        unit = unit_vectors(points)
        here = sign * unit[:, 2] >= 0
        x, y = (unit[here, :2] / np.sqrt(1 + np.abs(unit[here, 2:]))).T
        near = [text for text, seen in zip(labels, here, strict=True) if seen] if style == "dot" else ()
        panel.add(style, kind, x, y, radius=radius, labels=near)
    return panel


def _turn_axes(problem: Problem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Main axis of each used turn (S, 3), axes at instants (M, 3), and the share of all turning about each body axis (3,)."""
    axes, instants, total = [], [], np.zeros(3)
    for segment in problem.used:
        samples = problem.logs[segment.log].samples
        rate = problem.first(samples.gyro[_turning(segment)])
        second = rate.T @ rate
        main = np.linalg.eigh(second)[1][:, -1]
        axes.append(main * (1 if np.sum(rate @ main) >= 0 else -1))
        fast = rate[np.linalg.norm(rate, axis=1) > 0.3 * np.linalg.norm(rate, axis=1).max()]
        instants.append(fast[:: max(1, len(fast) // AXES_PER_TURN)])
        total += np.abs(rate).sum(axis=0) * samples.period_s
    return np.array(axes), np.concatenate(instants), total / total.sum()


def _direction(vector: np.ndarray) -> str:
    return ", ".join(f"{fixed(v, 2)} {axis}" for v, axis in zip(vector / np.linalg.norm(vector), "xyz", strict=True))


def reference_words(session: Session) -> str:
    """What the recording is compared with."""
    if session.reference is not None:
        return str(session.reference.title)
    return "table dials" if session.config.protocol.reference == "table" else "gravity"


def temperature_words(problem: Problem) -> str:
    """Temperature range, start and end, over all logs."""
    means = []
    for log in problem.logs:
        if (temp_c := _temperature_of(log.samples)) is not None:
            size = max(1, round(1 / log.samples.period_s))
            means.append([np.nanmean(part) for part in np.array_split(temp_c, max(1, len(log.samples) // size))])
    if not means:
        return "not recorded"
    values = np.concatenate(means)
    return (
        f"{significant(values.min(), 4)} to {significant(values.max(), 4)} °C (start {significant(values[0], 4)}, end "
        f"{significant(values[-1], 4)})"
    )
