"""What people see of a history: the screen, the page with its pictures, and the section of a report whose ``--history`` names other fitted
sessions of the unit.

A picture has the numbers of one kind about their means, over the dates, with the course that was estimated and the shocks that were found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import timedelta

import numpy as np

from session.base.texts import NONE, measured, significant
from session.base.units import DEG
from tinygc.estimation.between_sessions import FEWEST_WITH_DRIFT, ONE_SIGMA
from tinygc.estimation.session_times import SOURCES, YEAR_S
from tinygc.estimation.spread import ZERO
from tinygc.explanation.reported import ReportData
from tinygc.features.unit.history.estimate import NumberHistory, UnitHistory, history_of
from tinygc.features.unit.history.forecast import Outlook
from tinygc.features.unit.history.sessions import GYROSCOPE, Number, unit_sessions
from tinygc.fitting.unit_state import fitted_state, state_of
from tinygc.inference.decide import HOLDS, UNDECIDED
from tinygc.inference.solve import coverage_factor
from tinygc.models.linear import BIAS
from tinygc.reporting import facts
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.facts import Part, Table
from tinygc.reporting.html.markup import Section
from tinygc.reporting.terminal import one_line

#: sessions of the table of values; of more, the last ones stand there, and all are in history.json
MOST_COLUMNS = 4
#: a limit beyond this many times the range of the values, with their largest sigma, is none
HIDDEN = 30.0


def unit_facts(history: UnitHistory, outlooks: Sequence[Outlook], everything: bool = True, alone: bool = True) -> list[Part]:
    """What stands of one unit: the answer, then the gyroscope's numbers; everything: all numbers, and those of each session; alone: else
    its tables are shown with everything."""
    parts: list[Part] = [one_line(outlook_line(each), each.of.style) for each in outlooks]
    parts += [one_line(line, "" if outlooks else "bold") for line in summary_lines(history)]
    parts += lines(history, everything)
    if not (everything or alone):
        return parts
    shown, count = history.numbers if everything else history.numbers[:GYROSCOPE], len(history.sessions)
    if count > 1:
        header = ("", "last", "scatter", f"drift a {history.drift_time}", "step")
        columns = 3 if count < FEWEST_WITH_DRIFT else len(header)
        title = "Scatter between sessions" + ", drift, and a step that may hide between two" * (columns > 3)
        parts.append(Table(f"{title} (95 %)", header[:columns], [row[:columns] for row in rows(history, shown)]))
    if everything or count == 1:
        places = range(max(0, count - MOST_COLUMNS), count)
        title = "Values ± one sigma" + f", the last {len(places)} sessions" * (len(places) < count)
        names = [session_words(history, place) for place in places]
        parts.append(Table(title, ("", *names), value_rows(shown, places), minor=range(1, len(places))))
    return parts


def summary_lines(history: UnitHistory) -> list[str]:
    """How many sessions there are, and whether a drift or a shock was found."""
    count = len(history.sessions)
    long = f" over {span_words(history.span_years)}" if history.span_years is not None and count > 1 else ""
    begin = f"{history.name}: {count} session{'s' * (count > 1)}{long}"
    if count < FEWEST_WITH_DRIFT:
        return [f"{begin}; drift needs {FEWEST_WITH_DRIFT} or more."]
    drifts, steps = _drift_lines(history), _step_lines(history)
    if drifts or steps:
        kinds = " and ".join(["drift"] * bool(drifts) + ["shock"] * bool(steps))
        return [f"{begin}; {kinds} found:", *(f"  {line}" for line in (*drifts, *steps))]
    is_short = history.dated and not history.is_year_stated
    return [f"{begin}; {'too short for a drift a year' if is_short else 'no drift found'}."]


def span_words(years: float) -> str:
    """``2.1 years``, ``12 days``, ``3 hours``."""
    if years >= 1:
        return f"{years:.1f} years"
    days = years * 365.25
    return f"{days:.0f} days" if days >= 2 else f"{significant(24 * days, 2)} hours"


def session_words(history: UnitHistory, place: int) -> str:
    """``day1 2026-11-05``."""
    session = history.sessions[place]
    return session.name if session.moment is None or session.moment.day in session.name else f"{session.name} {session.moment.day}"


def value_rows(numbers: Sequence[NumberHistory], places: Sequence[int]) -> list[list[str]]:
    """Of each number that any session shows: its name with the unit, and its value in these sessions."""
    found = []
    for each in numbers:
        at = {int(place): k for k, place in enumerate(each.sessions)}
        if at:
            found.append([_name(each), *(number_cell(each, at[place]) if place in at else NONE for place in places)])
    return found


def _name(each: NumberHistory) -> str:
    return f"{each.number.words}, {each.number.unit}"


def number_cell(each: NumberHistory, k: int) -> str:
    """Value and sigma of the k-th session that shows the number."""
    return measured(each.values[k] / each.number.si, each.sigmas[k] / each.number.si)


def rows(history: UnitHistory, numbers: Sequence[NumberHistory]) -> list[list[str]]:
    """Of each number: its name with the unit, last value, scatter, drift and the limit of a step."""
    known = [each for each in numbers if each.course is not None]
    return [[_name(each), number_cell(each, -1), scatter_words(each), drift_words(history, each), step_words(each)] for each in known]


def scatter_words(each: NumberHistory) -> str:
    """``0.031 (0.018–0.090)`` or ``< 0.02``."""
    assert each.scatter is not None
    assert each.scatter_interval is not None
    low, high = (end / each.number.si for end in each.scatter_interval)
    if low == 0:
        return f"< {significant(high, 2)}"
    return f"{significant(each.scatter / each.number.si, 2)} ({significant(low, 2)}–{significant(high, 2)})"


def drift_words(history: UnitHistory, each: NumberHistory) -> str:
    """``12 ± 3`` or ``< 40``."""
    if each.course is None or each.drift is None or each.drift_limit is None or (history.dated and not history.is_year_stated):
        return NONE
    if each.course.drifts:
        return measured(each.drift[0] / each.number.si, each.drift[1] / each.number.si)
    return f"< {significant(each.drift_limit / each.number.si, 2)}"


def step_words(each: NumberHistory) -> str:
    """``< 0.2``; no limit where a step could hide in the drift across a gap."""
    if each.step_limit is None:
        return NONE
    if each.step_limit > HIDDEN * (float(np.ptp(each.values)) + float(each.sigmas.max())):
        return NONE
    return f"< {significant(each.step_limit / each.number.si, 2)}"


def grouped(numbers: Sequence[Number]) -> str:
    """``bias x, y; accelerometer bias z``."""
    names = dict.fromkeys(number.name for number in numbers)
    return "; ".join(f"{name} {', '.join(number.component for number in numbers if number.name == name)}" for name in names)


def lines(history: UnitHistory, everything: bool = False) -> list[str]:
    """What stands between the answer and the tables; everything: with the accelerometer, and where the dates are from."""
    found, spread = [], history.any_session
    if spread is not None:
        factors = np.array([coverage_factor(freedom) for freedom in spread.freedom])  # of two sessions 12.7
        own = coverage_factor(np.inf) ** 2 * np.diag(history.sessions[-1].stated)[BIAS]
        sizes = " ".join(significant(each, 2) for each in np.sqrt(own + 2 * (factors * spread.scatter) ** 2) / DEG)
        found.append(f"Next switch-on: bias within ±{sizes} dps (95 %, {len(history.sessions)} sessions, x y z).")
    if everything and (words := history.accelerometer_words) is not None:
        found.append(f"Next switch-on: accelerometer {words} (1 sigma, x y z).")
    if (warmth := _warmth_line(history)) is not None:
        found.append(warmth)
    if everything and history.dated:
        sources = dict.fromkeys(session.moment.source for session in history.sessions if session.moment is not None)
        found.append(f"Dates: {', '.join(SOURCES[source] for source in sources)}.")
    return [*found, *history.remarks]


def _drift_lines(history: UnitHistory) -> list[str]:
    drifting = [each for each in history.numbers if each.course is not None and each.course.drifts]
    if not drifting or (history.dated and not history.is_year_stated):
        return []
    clear = [each.number for each in drifting if each.drift_or_step is None]
    found = [f"drift: {grouped(clear)}"] if clear else []
    for place in dict.fromkeys(int(each.sessions[each.drift_or_step]) for each in drifting if each.drift_or_step is not None):
        same = [each.number for each in drifting if each.drift_or_step is not None and each.sessions[each.drift_or_step] == place]
        names = " and ".join(history.sessions[k].name for k in (place, place + 1))
        found.append(f"drift, or a step between {names}: {grouped(same)}")
    return found


def _step_lines(history: UnitHistory) -> list[str]:
    found = []
    for step in history.steps:
        size = measured(step.size / step.number.si, step.sigma / step.number.si)
        by = f"{step.number.words} by {'+' if step.size > 0 else ''}{size} {step.number.unit}"
        found.append(f"shock between {step.before} and {step.after}: {by}")
    return found


def _warmth_line(history: UnitHistory) -> str | None:
    """The bias over temperature; None where the sessions do not show it."""
    cells = []
    for each in history.numbers:
        if each.number.name == "bias" and each.warmth is not None:
            value, sigma, limit = (1e3 * part / each.number.si for part in each.warmth)
            is_known = each.course is not None and each.course.warms
            cells.append(f"{each.number.component} {measured(value, sigma) if is_known else f'< {significant(limit, 2)}'}")
    return f"Bias over temperature: {', '.join(cells)} mdps/K." if cells else None


def outlook_line(each: Outlook) -> str:
    """``OK until 2027-03-04 (95 %): bias 50 mdps``."""
    if each.kind == HOLDS:
        return f"OK {each.line}: {each.requirement.text}"
    begin = "Undecided" if each.kind == UNDECIDED and each.until is None else "Recalibrate"
    return f"{begin}: {each.line} ({each.requirement.text})."


# The pictures.

#: places between the first session and the last at which a course is drawn
DRAWN = 25
#: components that are drawn in one panel; of six misalignments three at a time
SIDE_BY_SIDE = 3
#: of the span, between the points of two components at one session
APART = 0.006
#: dates below a panel
DATES = 6


def picture_of(history: UnitHistory) -> Picture:
    """All panels of a unit."""
    title = f"{history.name}: difference from each number's mean, ± one sigma; dashed: no significant course"
    return Picture([*panels_of(history)], title)


def panels_of(history: UnitHistory) -> Iterator[Panel]:
    """A panel for each kind of number, in their order."""
    for name in dict.fromkeys(each.number.name for each in history.numbers):
        kind = [each for each in history.numbers if each.number.name == name and len(each.values)]
        for first in range(0, len(kind), SIDE_BY_SIDE):
            part = kind[first : first + SIDE_BY_SIDE]
            title = name if len(kind) <= SIDE_BY_SIDE else f"{name} {', '.join(each.number.component for each in part)}"
            yield _panel(history, part, title)


def _panel(history: UnitHistory, part: Sequence[NumberHistory], title: str) -> Panel:
    # Years since the first session, with dates, or names of sessions where there are none
    lo, hi = float(history.at[0]), float(history.at[-1])
    room, first, unit = 0.04 * (hi - lo) or 0.5, history.sessions[0].moment, part[0].number.unit
    if history.dated and first is not None:
        dates = [(float(at), first.when + timedelta(seconds=float(at) * YEAR_S)) for at in np.linspace(lo, hi, DATES)]
        ticks = [(at, date.date().isoformat()) for at, date in dates]
    else:
        ticks = [(float(at), session.name[:16]) for at, session in zip(history.at, history.sessions, strict=True)]
    course = "the course with its 68 %, dashed where neither drift nor step is significant"
    caption = f"{title}: difference from each one’s mean, and {course}."
    panel = Panel(Axis("", lo - room, hi + room, ticks=ticks), Axis(f"difference ({unit})"), title, caption=caption)
    shocks: dict[float, list[str]] = {}
    for k, (axis, each) in enumerate(zip("xyz", part, strict=False)):
        si, at, component = each.number.si, history.at[each.sessions], each.number.component
        mean = float(np.mean(each.values))
        values, sigmas = (each.values - mean) / si, each.sigmas / si
        if each.course is not None:
            grid, *curves = _course(each, at)
            middle, low, high = ((curve - mean) / si for curve in curves)
            panel.area(grid, low, high, axis, name="" if k else "course, 68 %")
            panel.line(grid, middle, axis, "thin" if each.course.drifts or each.course.steps else "dash")
        notes = [
            f"{history.sessions[place].name}: {component} {'+' if value > 0 else ''}{measured(value, sigma)} {unit}"
            for place, value, sigma in zip(each.sessions, values, sigmas, strict=True)
        ]
        shifted = at + (k - 1) * APART * ((hi - lo) or 1.0)
        panel.points(shifted, values, axis, sigma=sigmas, name=f"{component} {significant(mean / si, 4)}", labels=notes)
        for step in history.steps:
            if step.number == each.number:
                shocks.setdefault(float(history.at[step.interval : step.interval + 2].mean()), []).append(component)
    for at_s, which in sorted(shocks.items()):
        panel.upright(at_s, name="shock").words(at_s, -np.inf, f" shock: {', '.join(sorted(which))}", "floor")
    return panel


def _course(each: NumberHistory, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Level, steps and drift on a grid, with their 68 %; a step stands in the middle of its interval."""
    assert each.course is not None
    model = each.course.model
    edges = [float((at[before] + at[before + 1]) / 2) for before in each.course.steps]
    short = 1e-6 * (at[-1] - at[0])
    grid = np.sort(np.concatenate([np.linspace(at[0], at[-1], DRAWN), *([edge - short, edge + short] for edge in edges)]))
    slopes = np.zeros((len(grid), model.design.shape[1]))
    slopes[:, 0] = 1.0
    for k, edge in enumerate(edges):
        slopes[:, 1 + k] = np.where(grid < edge, -1.0, 0.0)
    if each.course.has_drift:
        slopes += (grid - at[-1])[:, None] * each.course.drift_column
    low, high = np.array([model.interval(slope, ONE_SIGMA) for slope in slopes]).T
    return grid, slopes @ model.coefficients, low, high


# The page, and the section.

#: the section of the report that this one stands behind
BEHIND = "explanation"


def page(units: Sequence[UnitHistory], outlooks: Sequence[Sequence[Outlook]], remarks: Sequence[str]) -> str:
    """The page as one HTML document."""
    sections = [(f"unit-{k}", unit.name, unit_page(unit, own)) for k, (unit, own) in enumerate(zip(units, outlooks, strict=True))]
    sections += [("remarks", "Remarks", [*remarks])] if remarks else []
    title = units[0].name if len(units) == 1 else f"{len(units)} units"
    return facts.page("History", title, sections, "± is one standard deviation; intervals and limits have 95 %.")


def unit_page(history: UnitHistory, outlooks: Sequence[Outlook]) -> list[Part]:
    """What stands of one unit, with its charts."""
    return [*unit_facts(history, outlooks), *panels_of(history)]


def section(evidence: ReportData) -> Section | None:
    """Section on the unit's sessions, this one among them; None where the fit has no ``history``."""
    fit = evidence.fit
    if not fit.options.history or "least_squares" not in fit.methods:
        return None
    others = [fitted_state(folder) for folder in fit.options.history]
    history = history_of(unit_sessions([*others, state_of(fit, fit.session.config)]))
    # The fit states the bias of any other session, of the others alone: one document has one number.
    spread = fit.spread.at(ZERO)
    history = replace(history, any_session=None if spread.is_usual else spread)
    return Section("history", "History", facts.html(unit_page(history, ())))
