"""Does ``history`` state what is so?  Simulated years of units: scatter, drift, shocks, and the day until which a requirement is met.

Units are drawn as the model of a history has them, session by session, with sigmas of a session of thirty turns.  Each row counts over
all units: the share of errors within one stated sigma and within the stated interval, shocks where there are none, shocks found by size,
and how many units still meet the requirement on the day that was stated.

    python benchmarks/history.py                      # all of it, about 8 minutes of one core
    python benchmarks/history.py --units 50 --only forecast
    python benchmarks/history.py --days FOLDER        # fitted sessions ``e1u0`` … of ``python -m benchmarks.public mimu``: real units
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import combinations
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.detect.accelerometer import BIASES, SCALES, SHEARS
from tinygc.annexes.history.estimate import history_of
from tinygc.annexes.history.forecast import draws_of, outlooks_of, parse_limit
from tinygc.annexes.history.sessions import GYROSCOPE, NUMBERS, ZERO, UnitSession, in_one_frame
from tinygc.estimation.accelerometer import USUAL_SPREAD as USUAL_ACCELEROMETER
from tinygc.estimation.between_sessions import CHANCE, course
from tinygc.estimation.compare import Calibrated, read_calibrated
from tinygc.estimation.expected_zero import USUAL_SPREAD
from tinygc.estimation.repeatability import widened
from tinygc.estimation.session_times import YEAR_S, Moment

FIRST = datetime(2020, 1, 1, tzinfo=UTC)
#: one sigma of a session of thirty turns, in the unit of each number (``python calibrate.py fit data/session1``)
OWN = {"ppm": 25.0, "mrad": 0.03, "dps": 0.001, "mg": 0.01}
#: from session to session, beyond that
SCATTER = {"ppm": 40.0, "mrad": 0.02, "dps": 0.03, "mg": 0.5}
DRIFT_A_YEAR = {"ppm": 60.0, "mrad": 0.05, "dps": 0.05, "mg": 0.5}
MET = "bias 0.15 dps", "scale factor error 400 ppm"


@dataclass(frozen=True)
class Unit:
    """sessions, over years; scatter and drift: factors on the usual ones; shock: its size in sigmas of scatter and session together, of
    all numbers of one kind, in the middle."""

    seed: int
    sessions: int = 6
    years: float = 3.0
    scatter: float = 1.0
    drift: float = 0.0
    shock: float = 0.0
    uneven: bool = False


@dataclass(frozen=True, eq=False)
class Truth:
    """scatter, drift a year, step of each number, SI; level (21,) at the last session."""

    scatter: np.ndarray
    drift: np.ndarray
    step: np.ndarray
    level: np.ndarray


def unit_of(job: Unit) -> tuple[list[UnitSession], Truth, np.random.Generator]:
    """A unit's sessions, and what made them."""
    rng = np.random.default_rng(job.seed)
    si = np.array([number.si for number in NUMBERS])
    own, scatter, drift = (np.array([table[number.unit] for number in NUMBERS]) * si for table in (OWN, SCATTER, DRIFT_A_YEAR))
    scatter, drift = job.scatter * scatter, job.drift * drift * rng.choice([-1.0, 1.0], len(NUMBERS))
    at = np.sort(np.concatenate([[0.0], rng.uniform(0, job.years, job.sessions - 2), [job.years]]))
    shocked = np.array([number.name == "bias" for number in NUMBERS]) & (job.shock > 0)
    step = np.where(shocked, job.shock * np.hypot(scatter, own), 0.0)
    sizes = rng.uniform(0.5, 3.0, job.sessions) if job.uneven else np.ones(job.sessions)
    root = np.linalg.cholesky(0.6 * np.eye(len(NUMBERS)) + 0.4)  # the errors of one fit are correlated
    sessions = []
    for j, when in enumerate(at):
        level = drift * (when - at[-1]) - step * (j < job.sessions // 2)
        sigma = own * sizes[j]
        values = level + scatter * rng.normal(size=len(NUMBERS)) + sigma * (root @ rng.normal(size=len(NUMBERS)))
        covariance = np.outer(sigma, sigma) * (root @ root.T)
        moment = Moment(FIRST + timedelta(seconds=float(when) * YEAR_S), "notes")
        vector = np.concatenate([np.eye(3).ravel(), -values[ZERO]])
        named = f"session{j + 1}"
        sessions.append(UnitSession(named, "ASM330LHH", "1", moment, values, covariance, -values[ZERO], covariance[ZERO, ZERO], vector))
    return sessions, Truth(scatter, drift, step, np.zeros(len(NUMBERS))), rng


def estimated(job: Unit) -> dict[str, np.ndarray | float]:
    """What the history of one unit states against what made it, over its 21 numbers."""
    sessions, truth, _ = unit_of(job)
    history = history_of(sessions)
    drift, inside, limit, covers, scatters = [], [], [], [], []
    for q, each in enumerate(history.numbers):
        assert each.course is not None
        if each.drift is not None and each.drift_limit is not None:
            low, high = each.course.model.interval(each.course.drift_column)
            drift.append(abs(each.drift[0] - truth.drift[q]) <= each.drift[1])
            inside.append(low <= truth.drift[q] <= high)
            limit.append(abs(truth.drift[q]) <= each.drift_limit)
        covers.append(each.scatter_interval[0] <= truth.scatter[q] <= each.scatter_interval[1])  # type: ignore[index]
        scatters.append(each.scatter / max(truth.scatter[q], 1e-30))  # type: ignore[operator]
    right = [step for step in history.steps if job.shock > 0 and step.number.name == "bias" and step.interval == job.sessions // 2 - 1]
    sized = [abs(step.size - truth.step[NUMBERS.index(step.number)]) <= step.sigma for step in right]
    false = [step for step in history.steps if step not in right]
    return {
        "drift": np.array(drift),
        "drift95": np.array(inside),
        "limit95": np.array(limit),
        "scatter95": np.array(covers),
        "scatter": np.array(scatters),
        "found": len(right) / 3,
        "sized": np.array(sized, dtype=float),
        "false": float(bool(false)),
        "drifts": np.array([each.course.drifts for each in history.numbers]),  # type: ignore[union-attr]
    }


def foretold(job: Unit) -> tuple[list[tuple[float, float, float]], np.ndarray]:
    """Of each requirement: years until it ends, the share of later switch-ons of this unit that meet it then, and whether it goes on.

    And the share of draws below the truth a year on, of each number: uniform if the prediction is right.
    """
    sessions, truth, rng = unit_of(job)
    history, last = history_of(sessions), sessions[-1]
    assert last.moment is not None
    found = []
    for outlook in outlooks_of(history, list(map(parse_limit, MET)), today=last.moment.when):
        if outlook.until is None:
            found.append((0.0, float("nan"), 0.0))
            continue
        years, places = (outlook.until - last.moment.when).total_seconds() / YEAR_S, list(outlook.requirement.numbers)
        then = truth.drift[places] * years + truth.scatter[places] * rng.normal(size=(400, len(places)))
        meets = np.all(np.abs(then - last.values[places]) <= outlook.requirement.limit, axis=1)
        found.append((years, float(np.mean(meets)), float(outlook.beyond)))
    then = truth.drift + truth.scatter * rng.normal(size=len(NUMBERS)) - last.values
    return found, np.mean(draws_of(history).after(1.0) < then, axis=0)


def share(values: Sequence[np.ndarray]) -> str:
    """Mean of 0 and 1 in per cent, with the sigma of units' means."""
    means = np.array([np.mean(each) for each in values if np.size(each)])
    if not len(means):
        return "–"
    return f"{100 * means.mean():.1f} ± {100 * means.std(ddof=1) / np.sqrt(len(means)):.1f} %"


KINDS = {
    "4 sessions": {"sessions": 4},
    "6 sessions": {"sessions": 6},
    "6, drifting": {"sessions": 6, "drift": 1.0},
    "6, sigmas of sessions 1 to 6": {"sessions": 6, "uneven": True},
    "6, no scatter": {"sessions": 6, "scatter": 0.0},
    "12 sessions": {"sessions": 12, "years": 6.0},
    "40, drifting": {"sessions": 40, "years": 10.0, "drift": 1.0},
    "12, drifting": {"sessions": 12, "years": 6.0, "drift": 1.0},
}


def statements(units: int) -> None:
    rows = []
    for name, kind in KINDS.items():
        found = in_parallel(estimated, [Unit(seed, **kind) for seed in range(units)], name, processes=1)
        columns = [share([each[key] for each in found]) for key in ("drift", "drift95", "limit95", "scatter95", "drifts")]
        median = np.median(np.concatenate([each["scatter"] for each in found])) if kind.get("scatter", 1.0) else float("nan")
        rows.append([name, *columns, f"{median:.2f}" if np.isfinite(median) else "–", share([each["false"] for each in found])])
    head = [
        "history",
        "drift within 1σ",
        "within its 95 %",
        "below its limit",
        "scatter within its 95 %",
        "called drifting",
        "scatter / true, median",
    ]
    print(f"{units} units a row, 21 numbers each.\n\n{markdown([*head, 'units with a false shock'], rows)}\n")


def shocks(units: int) -> None:
    rows = []
    for sessions in (6, 12, 20):
        for size in (5, 10, 20):
            jobs = [Unit(seed, sessions=sessions, years=sessions / 2, shock=float(size)) for seed in range(units)]
            found = in_parallel(estimated, jobs, f"shocks of {size}", processes=1)
            row = [share([each[key] for each in found]) for key in ("found", "sized", "false")]
            rows.append([f"{sessions} sessions, {size} σ", *row])
    head = ["shock of the bias", "found, of its three axes", "size within 1σ", "units with a false one"]
    print(f"{units} units a row; chance of a false one {CHANCE:.0%}.\n\n{markdown(head, rows)}\n")


def forecasts(units: int) -> None:
    rows = []
    for name, kind in KINDS.items():
        if not kind.get("scatter", 1.0):
            continue
        jobs = [Unit(10_000 + seed, **kind) for seed in range(units)]
        pairs = in_parallel(foretold, jobs, name, processes=1)
        found, uniform = np.array([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])
        inside = [np.mean(np.abs(uniform - 0.5) < half) for half in (0.341, 0.475)]
        for k, text in enumerate(MET):
            years, meets, beyond = found[:, k].T
            told = np.isfinite(meets)
            share_now = f"{100 * np.mean(~told):.0f} %"
            ends = told & (beyond == 0)
            cells = [f"{100 * np.mean(meets[which]):.1f} %" if which.any() else "–" for which in (told, ends)]
            rows.append(
                [
                    name,
                    text,
                    share_now,
                    f"{np.median(years[told]):.1f}" if told.any() else "–",
                    *cells,
                    *(f"{100 * part:.1f} %" for part in inside),
                ]
            )
    head = ["history", "requirement", "not sure now", "years, median", "meet it that day", "… that ends within the history's length"]
    print(f"{units} units a row.\n\n{markdown([*head, 'a year on, within 68 %', 'within 95 %'], rows)}\n")


# Real units on several days: how many of their numbers lie within the sigma that is stated for any other session?


def days(folder: Path) -> None:
    """Each number of a session less the same of each other day of that unit, over its stated sigma, by kind of number.

    Three statements: the fit's own sigmas; with the spread that is usual; with that of the unit's days but these two.
    """
    units: dict[str, list[Calibrated]] = {}
    for session in sorted(folder.glob("e*u*")):
        if (session / "fit" / "model_least_squares.json").exists():
            units.setdefault(session.name.partition("u")[2], []).append(read_calibrated(session))
    usual = np.zeros(len(NUMBERS))
    usual[ZERO] = USUAL_SPREAD.rps
    usual[GYROSCOPE:] = USUAL_ACCELEROMETER.spread[[*SCALES, *SHEARS, *BIASES]]
    z: dict[str, dict[str, list[float]]] = {}
    for read in units.values():
        sessions = in_one_frame(read)
        for first, second in combinations(range(len(sessions)), 2):
            one, other = sessions[first], sessions[second]
            left = [each for i, each in enumerate(sessions) if i not in (first, second)]
            own, off = np.diag(one.covariance) + np.diag(other.covariance), one.values - other.values
            for q in np.flatnonzero(np.isfinite(off) & np.isfinite(own)):
                lasting = NUMBERS[q].name in ("scale factor error", "misalignment")
                spreads = {"the fit's own": 0.0} | ({} if lasting else {"as usual": usual[q], "of the unit's other days": _spread(left, q)})
                for name, spread in spreads.items():
                    if spread is not None:
                        found = off[q] / np.sqrt(own[q] + 2 * spread**2)
                        z.setdefault(NUMBERS[q].name, {}).setdefault(name, []).append(float(found))
    rows = []
    for number, by_statement in z.items():
        for statement, values in by_statement.items():
            size = np.abs(values)
            shares = [f"{100 * np.mean(size < bar):.0f} %" for bar in (1, 1.96)]
            rows.append([number, statement, str(len(size)), *shares, f"{np.sqrt(np.mean(size**2)):.1f}"])
    print(markdown(["number", "sigma", "pairs of days", "within 1σ", "within 1.96σ", "rms"], rows))
    count = sum(map(len, units.values()))
    scatter = {name: _usual_size([in_one_frame(each) for each in units.values()], name) for name in z}
    print(f"\n{count} sessions of {len(units)} units; scatter beyond the fit, rms over units and axes: {scatter}")


def _spread(sessions: Sequence[UnitSession], q: int) -> float | None:
    """As ``fit --history`` counts it; None of fewer than two sessions."""
    values, own = np.array([each.values[q] for each in sessions]), np.array([each.covariance[q, q] for each in sessions])
    shown = np.isfinite(values)
    if shown.sum() < 2:
        return None
    model = course(values[shown], own[shown], np.arange(shown.sum(), dtype=float)).model
    return float(widened(np.array([model.counted]), np.array([float(model.freedom)]))[0])


def _usual_size(units: Sequence[Sequence[UnitSession]], name: str) -> str:
    """Root of the mean square of the scatter about each unit's mean, less the fits' own variances."""
    squares = []
    for sessions in units:
        for q in (q for q, number in enumerate(NUMBERS) if number.name == name):
            values, own = np.array([each.values[q] for each in sessions]), np.array([each.covariance[q, q] for each in sessions])
            shown = np.isfinite(values) & np.isfinite(own)
            if shown.sum() > 1:
                squares.append(np.var(values[shown], ddof=1) - np.mean(own[shown]))
    si = next(number for number in NUMBERS if number.name == name)
    return f"{np.sqrt(max(float(np.mean(squares)), 0.0)) / si.si:.3g} {si.unit}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    what = "units a row of the first table; a fifth of shocks, a third of forecasts (%(default)s)"
    parser.add_argument("--units", type=int, default=200, help=what)
    parser.add_argument("--only", choices=("statements", "shocks", "forecast"), help="one table")
    parser.add_argument("--days", type=Path, metavar="FOLDER", help="fitted sessions of units on several days, eNuM")
    args = parser.parse_args()
    if args.days is not None:
        days(args.days)
        return
    for name, table, part in (("statements", statements, 1), ("shocks", shocks, 5), ("forecast", forecasts, 3)):
        if args.only in (None, name):
            table(max(args.units // part, 2))


if __name__ == "__main__":
    main()
