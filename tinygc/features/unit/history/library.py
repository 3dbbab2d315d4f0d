"""Python interface of ``history``: the sessions of units together, and when to calibrate next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError
from session.base.progress import Progress, no_report
from session.base.records import in_unit, plain, table_of
from session.base.units import DEG
from tinygc.estimation.session_times import Moment, parsed
from tinygc.features.unit.history.estimate import NumberHistory, UnitHistory, history_of
from tinygc.features.unit.history.forecast import Outlook, outlooks_of, parse_accuracy, parse_limit
from tinygc.features.unit.history.sessions import NUMBERS, read_dates, sessions_of
from tinygc.features.unit.history.shown import outlook_line, page, picture_of, summary_lines, unit_facts
from tinygc.features.unit.options import HistoryOptions
from tinygc.library.arguments import is_path, public
from tinygc.library.records import Kept
from tinygc.models.linear import BIAS
from tinygc.reporting.drawing import Picture, saved
from tinygc.reporting.facts import screen
from tinygc.reporting.terminal import Group

SCHEMA = "tinygc-history/1"
FILE, PAGE, PICTURE = "history.json", "history.html", "history.svg"


@dataclass(frozen=True, eq=False, repr=False)
class History(Kept):
    """Result of ``tinygc.history``: ``units`` (one unit each: sessions, numbers, steps, any_session), ``outlooks`` of each."""

    FILES: ClassVar = (FILE, PAGE)
    units: tuple[UnitHistory, ...]
    outlooks: tuple[tuple[Outlook, ...], ...] = ()
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<History of {', '.join(summary_lines(unit)[0] for unit in self.units)}>"

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return self.screen()

    def screen(self, everything: bool = False) -> Group:
        """The same; everything: with the accelerometer's numbers and the values of each session."""
        units = zip(self.units, self.outlooks, strict=True)
        parts = [part for unit, outlooks in units for part in unit_facts(unit, outlooks, everything, len(self.units) == 1)]
        return screen([*parts, *self.remarks])

    @property
    def exit_code(self) -> int:
        """0; 1 where a requirement does not hold today, 5 where one is undecided and none fails."""
        codes = {each.of.exit_code for outlooks in self.outlooks for each in outlooks}
        return 1 if 1 in codes else max(codes, default=0)

    @property
    def verdict_line(self) -> str:
        """One line: the answers to the requirements, or how many sessions there are."""
        answers = [
            f"{unit.name}: {outlook_line(each)}" for unit, outlooks in zip(self.units, self.outlooks, strict=True) for each in outlooks
        ]
        return "; ".join(answers or [summary_lines(unit)[0] for unit in self.units])

    def to_json(self) -> dict:
        """``tinygc-history/1`` (docs/formats/unit.md)."""
        units = [_of_unit(unit, outlooks) for unit, outlooks in zip(self.units, self.outlooks, strict=True)]
        return plain({"schema": SCHEMA, "version": VERSION, "units": units, "remarks": self.remarks})

    def html(self) -> str:
        """The histories as one HTML document."""
        return page(self.units, self.outlooks, self.remarks)

    def plot(self, path: Path | str | None = None, unit: int = 0) -> Picture:
        """Draw the numbers of a unit over the dates; path: an SVG to write."""
        return saved(picture_of(self.units[unit]), path)

    def save(self, folder: Path | str, pictures: bool = True) -> Any:
        """Write ``history.json``, ``history.html`` and ``history.svg`` into a folder; of several units ``history1.svg`` and so on.
        Returns the paths.

        Raises StorageError for files that cannot be written.
        """
        into = Path(super().save(folder, False))
        written = [into / name for name in self.FILES]
        for number in range(len(self.units)) if pictures else ():
            written.append(into / (PICTURE if len(self.units) == 1 else f"history{number + 1}.svg"))
            self.plot(written[-1], number)
        return written


def _of_unit(unit: UnitHistory, outlooks: Sequence[Outlook]) -> dict[str, Any]:
    triad = unit.accelerometer_any_session  # one sigma of each of the accelerometer's numbers
    return {
        "model": unit.model,
        "serial": unit.serial,
        "dated": unit.dated,
        "span_years": unit.span_years,
        "drift_per": unit.drift_time,
        "sessions": [
            {
                "session": session.name,
                "date": None if session.moment is None else session.moment.when.isoformat(timespec="seconds"),
                "date_from": None if session.moment is None else session.moment.source,
                "temperature_c": session.temperature_c,
            }
            for session in unit.sessions
        ],
        "numbers": [_of_number(each) for each in unit.numbers],
        "steps": [
            {
                **table_of(step.number),
                "after": step.before,
                "before": step.after,
                **in_unit(step.number.si, size=step.size, sigma=step.sigma),
                "p_value": step.p_value,
            }
            for step in unit.steps
        ],
        "bias_any_session": None if unit.any_session is None else unit.any_session.to_json(np.diag(unit.sessions[-1].stated)[BIAS]),
        "accelerometer_any_session": None
        if triad is None
        else [table_of(n) | {"sigma": s / n.si} for n, s in zip(NUMBERS[-len(triad) :], triad, strict=True)],
        "requirements": [
            {
                "requirement": each.requirement.text,
                "limit_deg": None if each.requirement.numbers else each.requirement.limit / DEG,
                "seconds": None if each.requirement.numbers else each.requirement.seconds,
                "answer": each.kind,
                "until": None if each.until is None else each.until.date().isoformat(),
                "beyond": each.beyond,
                "reason": each.line,
                "years": each.years,
                "shares": each.shares,
            }
            for each in outlooks
        ],
        "remarks": unit.remarks,
    }


def _of_number(each: NumberHistory) -> dict[str, Any]:
    si, course = each.number.si, each.course
    low, high = each.scatter_interval or (None, None)
    drift, drift_sigma = each.drift or (None, None)
    warmth, warmth_sigma, warmth_limit = each.warmth or (None, None, None)
    return {
        **table_of(each.number),
        "sessions": each.sessions,
        **in_unit(
            si,
            values=each.values,
            sigmas=each.sigmas,
            level=None if course is None else course.model.coefficients[0],
            level_sigma=None if course is None else course.model.sigma(np.eye(course.model.design.shape[1])[0]),
            scatter=each.scatter,
            scatter_low=low,
            scatter_high=high,
        ),
        "freedom": None if course is None else course.model.freedom,
        **in_unit(si, drift=drift, drift_sigma=drift_sigma, drift_at_most=each.drift_limit),
        "drift_p": None if drift is None or course is None else course.drift_p,
        "drifts": None if drift is None or course is None else course.drifts,
        "drift_or_step_after": None if each.drift_or_step is None else each.sessions[each.drift_or_step],
        **in_unit(si, step_at_most=each.step_limit, per_kelvin=warmth, per_kelvin_sigma=warmth_sigma, per_kelvin_at_most=warmth_limit),
        "follows_temperature": None if warmth is None or course is None else course.warms,
    }


@public(HistoryOptions)
def history(sessions: Path | str | Sequence[Path | str], *, dates: Any = None, progress: Progress | None = None, **choices: Any) -> Any:
    """Estimate the history of a unit from its sessions: scatter between switch-ons, drift, shocks, and when to calibrate next.

    Parameters
    ----------
    sessions : path or sequence of paths
        Fitted session folders, folders that hold such, or a fleet's folder.
    dates : mapping of str to date or str, or path, optional
        Dates of sessions by the names of their folders, or a CSV of them.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    History
        ``units``, each with ``sessions``, ``numbers``, ``steps``, ``any_session``; ``outlooks`` of the requirements; ``summary()``,
        ``html()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

    Raises
    ------
    CalibrationError
        For a folder without a fitted session, one session twice, a requirement or a date that cannot be read; its message is one line.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> folders = [f"{tempfile.mkdtemp()}/day{seed}" for seed in (1, 2)]
    >>> for seed, folder in zip((1, 2), folders):
    ...     session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=seed, unit_seed=1).session
    ...     _ = session.save(folder)
    ...     _ = tinygc.fit(folder, methods=("least_squares",)).save()
    >>> len(tinygc.history(folders).units[0].sessions)
    2

    """
    given = [Path(each) for each in (sessions if isinstance(sessions, Sequence) and not isinstance(sessions, str) else [sessions])]
    options = HistoryOptions(**choices)
    requirements = [*([parse_accuracy(options.accuracy)] if options.accuracy else []), *map(parse_limit, options.require)]
    moments = read_dates(Path(dates)) if is_path(dates) else {name: _moment(name, when) for name, when in (dates or {}).items()}
    today = None if options.today is None else _moment("today", options.today).when
    grouped, remarks = sessions_of(given, moments, progress or no_report, options.serial)
    units = tuple(history_of(sessions) for _, sessions in sorted(grouped.items()))
    return History(units, tuple(outlooks_of(unit, requirements, today) for unit in units), tuple(remarks))


def _moment(name: str, when: Any) -> Moment:
    found = parsed(str(when))
    if found is None:
        raise CalibrationError(f"dates: {name} has {when!r:.60}, expected a date in ISO 8601")
    return Moment(found, "given")
