"""Does ``history`` state what is so?  Simulated years of units: scatter, drift, and shocks where there are none.

Units are drawn as the model of a history has them, session by session, with sigmas of a session of thirty turns.  Each row counts over
all units: the share of errors within one stated sigma and within the stated interval.

    python benchmarks/history.py                      # about 5 minutes of one core
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
from tinygc.estimation.between_sessions import course
from tinygc.estimation.session_times import YEAR_S, Moment
from tinygc.estimation.spread import ACCELEROMETER, USUAL, Spread
from tinygc.estimation.spread import ZERO as B_OF_21
from tinygc.features.unit.history.estimate import history_of
from tinygc.features.unit.history.sessions import GYROSCOPE, NUMBERS, ZERO, UnitSession, unit_sessions
from tinygc.fitting.unit_state import UnitState, fitted_state
from tinygc.models.linear import BIAS

FIRST = datetime(2020, 1, 1, tzinfo=UTC)
#: one sigma of a session of thirty turns, in the unit of each number (``python calibrate.py fit data/session1``)
OWN = {"ppm": 25.0, "mrad": 0.03, "dps": 0.001, "mg": 0.01}
#: from session to session, beyond that
SCATTER = {"ppm": 40.0, "mrad": 0.02, "dps": 0.03, "mg": 0.5}
DRIFT_A_YEAR = {"ppm": 60.0, "mrad": 0.05, "dps": 0.05, "mg": 0.5}


@dataclass(frozen=True)
class Unit:
    """sessions, over years; scatter and drift: factors on the usual ones."""

    seed: int
    sessions: int = 6
    years: float = 3.0
    scatter: float = 1.0
    drift: float = 0.0
    uneven: bool = False


@dataclass(frozen=True, eq=False)
class Truth:
    """scatter and drift a year of each number, SI."""

    scatter: np.ndarray
    drift: np.ndarray


def unit_of(job: Unit) -> tuple[list[UnitSession], Truth]:
    """A unit's sessions, and what made them."""
    rng = np.random.default_rng(job.seed)
    si = np.array([number.si for number in NUMBERS])
    own, scatter, drift = (np.array([table[number.unit] for number in NUMBERS]) * si for table in (OWN, SCATTER, DRIFT_A_YEAR))
    scatter, drift = job.scatter * scatter, job.drift * drift * rng.choice([-1.0, 1.0], len(NUMBERS))
    at = np.sort(np.concatenate([[0.0], rng.uniform(0, job.years, job.sessions - 2), [job.years]]))
    sizes = rng.uniform(0.5, 3.0, job.sessions) if job.uneven else np.ones(job.sessions)
    root = np.linalg.cholesky(0.6 * np.eye(len(NUMBERS)) + 0.4)  # the errors of one fit are correlated
    sessions = []
    for j, when in enumerate(at):
        level = drift * (when - at[-1])
        sigma = own * sizes[j]
        values = level + scatter * rng.normal(size=len(NUMBERS)) + sigma * (root @ rng.normal(size=len(NUMBERS)))
        covariance = np.outer(sigma, sigma) * (root @ root.T)
        moment = Moment(FIRST + timedelta(seconds=float(when) * YEAR_S), "notes")
        vector = np.concatenate([np.eye(3).ravel(), -values[ZERO]])
        named, stated = f"session{j + 1}", np.zeros((12, 12))
        stated[BIAS, BIAS] = covariance[ZERO, ZERO]
        sessions.append(UnitSession(named, "ASM330LHH", "1", moment, values, covariance, vector, stated))
    return sessions, Truth(scatter, drift)


def estimated(job: Unit) -> dict[str, np.ndarray | float]:
    """What the history of one unit states against what made it, over its 21 numbers."""
    sessions, truth = unit_of(job)
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
    return {
        "drift": np.array(drift),
        "drift95": np.array(inside),
        "limit95": np.array(limit),
        "scatter95": np.array(covers),
        "scatter": np.array(scatters),
        "false": float(bool(history.steps)),
        "drifts": np.array([each.course.drifts for each in history.numbers]),  # type: ignore[union-attr]
    }


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


# Real units on several days: how many of their numbers lie within the sigma that is stated for any other session?


def days(folder: Path) -> None:
    """Each number of a session less the same of each other day of that unit, over its stated sigma, by kind of number.

    Three statements: the fit's own sigmas; with the spread that is usual; with that of the unit's days but these two.
    """
    units: dict[str, list[UnitState]] = {}
    for session in sorted(folder.glob("e*u*")):
        if (session / "fit" / "model_least_squares.json").exists():
            units.setdefault(session.name.partition("u")[2], []).append(fitted_state(session))
    usual = np.zeros(len(NUMBERS))
    usual[ZERO] = USUAL.sigma[B_OF_21]
    usual[GYROSCOPE:] = USUAL.sigma[ACCELEROMETER][[*SCALES, *SHEARS, *BIASES]]
    z: dict[str, dict[str, list[float]]] = {}
    for read in units.values():
        sessions = unit_sessions(read)
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
    scatter = {name: _usual_size([unit_sessions(each) for each in units.values()], name) for name in z}
    print(f"\n{count} sessions of {len(units)} units; scatter beyond the fit, rms over units and axes: {scatter}")


def _spread(sessions: Sequence[UnitSession], q: int) -> float | None:
    """As ``fit --history`` counts it; None of fewer than two sessions."""
    values, own = np.array([each.values[q] for each in sessions]), np.array([each.covariance[q, q] for each in sessions])
    shown = np.isfinite(values)
    if shown.sum() < 2:
        return None
    model = course(values[shown], own[shown], np.arange(shown.sum(), dtype=float)).model
    return float(Spread.of(0, model.counted, "", model.freedom).at(slice(0, 1)).sigma[0])


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
    parser.add_argument("--units", type=int, default=200, help="units a row (%(default)s)")
    parser.add_argument("--days", type=Path, metavar="FOLDER", help="fitted sessions of units on several days, eNuM")
    args = parser.parse_args()
    if args.days is not None:
        days(args.days)
    else:
        statements(args.units)


if __name__ == "__main__":
    main()
