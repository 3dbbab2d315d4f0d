"""The session: stills and turns over time, data left out and why, attitudes and turn axes covered."""

from __future__ import annotations

import numpy as np

from session.base.texts import fixed, significant
from session.base.units import DEG
from session.detect.segments import Segment
from session.log.folder import Session
from session.log.samples import Samples
from tinygc.closure.problem import Problem
from tinygc.explanation.reported import ReportData
from tinygc.reporting.fit_text import earth_words
from tinygc.reporting.html.chart import Axis, Chart, coverage, drawing, hemispheres, linear_axis
from tinygc.reporting.html.markup import Section, render

#: instants of a turn whose axes are drawn
AXES_PER_TURN = 25


def section(evidence: ReportData) -> Section:
    """Section on the recording."""
    problem = evidence.problem
    segments = [(s.number, f"{s.start_s:.0f} s", s.problem) for s in problem.segments if s.problem]
    segments += [(s.number, f"{s.start_s:.0f} s", f"used: {s.note}") for s in problem.used if s.note]
    segments += [(each.segment, "", f"used: {each.words}") for each in problem.widened]
    html = render(
        "session.html",
        problem=problem,
        numbers=_numbers(problem),
        earth=earth_words(evidence.fit).replace(" -", " −"),
        over_time=lambda width: _over_time(problem, width),
        some_left_out=any(not segment.accepted for segment in problem.segments) or any(still.problem for still in problem.stills),
        temperature=any(_temperature_of(log.samples) is not None for log in problem.logs) and (lambda width: _temperature(problem, width)),
        segments=segments,
        rests=[(f"{rest.start_s:.1f} s", f"{rest.duration_s:.1f} s", rest.why) for _, rest in problem.unused_rests],
        covered=_coverage(problem),
        warnings=evidence.fit.warnings,
    )
    return Section("session", "The session", html)


def _numbers(problem: Problem) -> list[tuple[str, str]]:
    good = [still.duration_s for still in problem.stills if still.problem is None]
    nominal = problem.session.nominal_rate
    rate_hz = 1 / np.median([log.samples.period_s for log in problem.logs])
    fastest = max(float(np.abs(problem.logs[s.log].samples.gyro[_turning(s)]).max()) for s in problem.used)
    return [
        ("Length", f"{problem.began_s[-1] / 60:.1f} min in {len(problem.logs)} log{'s' * (len(problem.logs) != 1)}"),
        ("Stills", f"{len(good)}, median {np.median(good):.1f} s" if good else "none"),
        ("Segments used" if problem.session.reference else "Turns used", f"{len(problem.used)} of {len(problem.segments)}"),
        ("True data rate", f"{rate_hz:.2f} Hz") if nominal is None else ("Data rate", nominal.words),
        ("Fastest", f"{fastest / DEG:.0f} dps"),
        ("Reference", reference_words(problem.session)),
    ]


def _turning(segment: Segment) -> slice:
    """Samples between the two stills of a turn; all of a segment between two moments of a further reference."""
    if segment.first is None or segment.last is None or segment.last.start < segment.first.stop:
        return slice(segment.start, segment.stop)
    return slice(segment.first.stop, segment.last.start + 1)


def _temperature_of(samples: Samples) -> np.ndarray | None:
    """Temperature (N,) degC; None if the log has none."""
    return samples.temp_c if samples.temp_c is not None and np.isfinite(samples.temp_c).any() else None


def _envelope(t: np.ndarray, values: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle time, minimum and maximum in each of ``columns`` intervals of time."""
    edges = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], columns + 1)[:-1]))
    return t[edges], np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)


def _over_time(problem: Problem, width: int) -> str:
    began = problem.began_s
    minutes = began[-1] > 600
    unit = 60.0 if minutes else 1.0
    sizes = [np.linalg.norm(log.samples.gyro, axis=1) / DEG for log in problem.logs]
    # Scale by the used samples: picking up the sensor at the end must not shrink the session.
    top = max(float(sizes[s.log][s.start : s.stop].max()) for s in problem.used) * 1.1
    # The lowest fifth of the frame, below zero, shows stills and turns.
    floor = -0.22 * top
    ticks = [tick for tick in Axis(0, top).marks(260) if tick[0] >= 0]
    x = Axis(0, began[-1] / unit, "time, min" if minutes else "time, s")
    chart = Chart(width, 250, x, Axis(floor, top, "rate, dps", ticks=ticks), "Rate over the session, with stills and turns")
    for number, (log, size) in enumerate(zip(problem.logs, sizes, strict=True)):
        t = (log.samples.t_s + began[number]) / unit
        middle, lo, hi = _envelope(t, size, width if len(problem.logs) == 1 else max(50, width // len(problem.logs)))
        chart.area(middle, lo, hi, "quiet").line(middle, hi, "quiet", "thin")
        for i, still in enumerate(log.stills):
            start = (began[number] + still.start_s) / unit
            words = f"still {i}, {still.duration_s:.1f} s" + (f": {still.problem}" if still.problem else "")
            chart.span(start, start + still.duration_s / unit, "bad" if still.problem else "still", words, 0.02, 0.075)
        if number:
            chart.upright(began[number] / unit, "quiet")
    for segment in problem.segments:
        first = segment.first
        start = began[segment.log] + (segment.start_s if first is None else first.start_s + first.duration_s)
        words = f"segment {segment.number}: {segment.turn_deg:.0f}° in {segment.turn_s:.1f} s"
        words += f", left out: {segment.problem}" if segment.problem else f", {segment.note}" if segment.note else ""
        chart.span(start / unit, (start + segment.turn_s) / unit, "bad" if segment.problem else "turn", words, 0.095, 0.15)
    return chart.svg()


def _temperature(problem: Problem, width: int) -> str:
    began = problem.began_s
    minutes = began[-1] > 600
    unit = 60.0 if minutes else 1.0
    parts = []
    for number, log in enumerate(problem.logs):
        if (temp_c := _temperature_of(log.samples)) is not None:
            size = max(1, round(1 / log.samples.period_s))
            whole = len(log.samples) // size * size
            if whole:
                mean = temp_c[:whole].reshape(-1, size).mean(axis=1)
                parts.append(((log.samples.t_s[:whole:size] + began[number]) / unit, mean))
    if not parts:
        return ""
    values = np.concatenate([mean for _, mean in parts])
    y = linear_axis(values, "temperature, °C (means of 1 s)")
    if y.hi - y.lo < 0.5:
        y = Axis((y.lo + y.hi) / 2 - 0.25, (y.lo + y.hi) / 2 + 0.25, y.label)
    chart = Chart(width, 128, Axis(0, began[-1] / unit, ""), y, "Temperature over the session")
    for t, mean in parts:
        chart.line(t, mean, "before")
    return chart.svg()


def _coverage(problem: Problem) -> dict:
    good = [(number, still) for number, still in enumerate(problem.stills) if still.problem is None]
    down = np.array([-still.accel_mean for _, still in good]).reshape(-1, 3)
    axes, instants, share = _turn_axes(problem)
    down_titles = [f"still {number}: down is {_direction(d)}" for (number, _), d in zip(good, down, strict=True)]
    axis_titles = [f"segment {s.number}: about {_direction(a)}, {s.turn_deg:.0f}°" for s, a in zip(problem.used, axes, strict=True)]

    def draw(width: int) -> str:
        narrow = width < 500
        radius = (width - 74) / 4 if narrow else (width - 150) / 8
        gap = 0 if narrow else width / 2 + 14
        below = 2 * radius + 76 if narrow else 0
        attitudes = hemispheres(8, 42, radius, down, "still", down_titles, ("z side down", "z side up"))
        turns = hemispheres(8 + gap, 42 + below, radius, axes, "turn", axis_titles, ("turning with +z", "turning with −z"), instants)
        names = (
            f'<text class="strong" x="8" y="14">Where down was, in the stills{"" if good else ": none"}</text>'
            f'<text class="strong" x="{8 + gap:.0f}" '
            f'y="{14 + below:.0f}">About which axes it turned</text>'
        )
        height = 42 + 2 * radius + 24 + below
        return drawing(
            width,
            height,
            "Directions of gravity in the stills, and axes of the turns, in the sensor's own frame",
            names + attitudes + turns,
        )

    return {"draw": draw, "attitudes": coverage(down) if good else None, "axes": coverage(instants), "share": share}


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
