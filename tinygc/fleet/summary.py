"""What the table says as a whole: numbers and short lists, however many sessions it holds."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from tinygc.fleet.cells import told_by
from tinygc.fleet.results import read_as_written
from tinygc.fleet.row import DONE, VALUES
from tinygc.fleet.table import EACH, Table

#: lists are cut here: a page of a hundred thousand stays small
MOST_LISTED, MOST_SLOWEST, MOST_REASONS = 200, 10, 20
BINS = 40
#: as SQL has it: stands for what is not known on its way into an array
INFINITE = "9e999"
#: of a distribution, the shares that are told: the middle, one sigma of a normal one around it, and nearly all
SHARES = (0.005, 0.16, 0.5, 0.84, 0.995)


@dataclass(frozen=True, eq=False)
class Distribution:
    """count: sessions that told; quantiles (5,) at ``SHARES``; edges (B + 1,) and counts (B,) of its histogram over nearly all of them;
    below, above: how many lie outside of that."""

    count: int
    quantiles: np.ndarray
    edges: np.ndarray
    counts: np.ndarray
    below: int
    above: int


@dataclass(frozen=True, eq=False)
class Summary:
    """Of a table, of what a folder still has.

    folders: how many; sessions: different ones; done, failed, died; unreadable: folders that could not be read; passed and missed:
    sessions whose calibration is of use, and is not (nothing closes better than the raw rates, or it is above limit_deg); units: serial
    numbers; first_look and verdicts: how often which; effects: id -> sessions in which it is named; reasons: (step, reason, count) of
    failures, the most frequent first; failures: (folder, step, line), listed up to ``MOST_LISTED``; slowest: (folder, CPU s); cpu_s: of
    all; distributions: ``held_out_deg``, ``floor_deg``, ``run_rmse_deg`` and each parameter, where there are any.
    """

    folders: int
    sessions: int
    done: int
    failed: int
    died: int
    unreadable: int
    passed: int
    missed: int
    units: int
    limit_deg: float | None
    first_look: dict[str, int]
    verdicts: dict[str, int]
    effects: dict[str, int]
    reasons: list[tuple[str, str, int]]
    failures: list[tuple[str, str, str]]
    slowest: list[tuple[str, float]]
    cpu_s: float
    distributions: dict[str, Distribution] = field(default_factory=dict)

    def to_json(self) -> dict:
        """``tinygc-fleet/1`` (docs/formats.md), but for what the run itself was."""
        return {
            "folders": self.folders,
            "sessions": self.sessions,
            "done": self.done,
            "failed": self.failed,
            "died": self.died,
            "unreadable": self.unreadable,
            "passed": self.passed,
            "missed": self.missed,
            "units": self.units,
            "limit_deg": self.limit_deg,
            "cpu_s": self.cpu_s,
            "first_look": self.first_look,
            "verdicts": self.verdicts,
            "effects": self.effects,
            "reasons": [{"step": step, "reason": reason, "sessions": count} for step, reason, count in self.reasons],
            "failures": [{"folder": folder, "step": step, "error": error} for folder, step, error in self.failures],
            "distributions": [
                {"figure": name, "sessions": each.count, "quantiles": each.quantiles.tolist()} for name, each in self.distributions.items()
            ],
        }


def summarise(table: Table, limit_deg: float | None = None) -> Summary:
    """Of a table that is open; of its rows only the figures are held, 20 MB of a hundred thousand."""
    status = dict(table.rows(f"SELECT status, count(*) FROM {EACH} GROUP BY status"))
    fine = "use IS NOT NULL" + ("" if limit_deg is None else " AND held_out_deg <= :limit AND ifnull(run_rmse_deg, 0) <= :limit")
    within = {} if limit_deg is None else {"limit": limit_deg}
    passed = table.rows(f"SELECT count(*) FROM {EACH} WHERE held_out_deg IS NOT NULL AND {fine}", within)[0][0]  # type: ignore[arg-type]
    fitted = table.one(f"SELECT count(*) FROM {EACH} WHERE held_out_deg IS NOT NULL")
    names = ("held_out_deg", "floor_deg", "run_rmse_deg", *VALUES)
    known = ", ".join(f"ifnull({name}, {INFINITE})" for name in names)
    figures = np.fromiter(table.each(f"SELECT {known} FROM {EACH}"), dtype=np.dtype((float, len(names))))
    found = {name: distribution(values[np.isfinite(values)]) for name, values in zip(names, figures.T, strict=True)}
    return Summary(
        folders=table.one("SELECT count(*) FROM folders"),
        sessions=sum(status.values()),
        done=status.get(DONE, 0),
        failed=status.get("failed", 0),
        died=status.get("died", 0),
        unreadable=table.one("SELECT count(*) FROM folders WHERE key IS NULL"),
        passed=passed,
        missed=fitted - passed,
        units=table.one(f"SELECT count(DISTINCT serial) FROM {EACH} WHERE serial <> ''"),
        limit_deg=limit_deg,
        first_look=_counted(table, "first_look"),
        verdicts=_counted(table, "verdict"),
        effects=_effects(table),
        reasons=_reasons(table),
        failures=_failures(table),
        slowest=table.rows(f"SELECT folder, cpu_s FROM {EACH} JOIN durations USING (key) ORDER BY cpu_s DESC, folder LIMIT {MOST_SLOWEST}"),
        cpu_s=table.one(f"SELECT ifnull(sum(cpu_s), 0) FROM {EACH} JOIN durations USING (key)"),
        distributions={name: each for name, each in found.items() if each is not None},
    )


def distribution(values: np.ndarray) -> Distribution | None:
    """Of values (N,); None of none."""
    if not len(values):
        return None
    quantiles = np.quantile(values, SHARES)
    low, high = quantiles[0], quantiles[-1]
    if not high > low:
        low, high = low - max(abs(low), 1e-12) * 1e-6, high + max(abs(high), 1e-12) * 1e-6
    edges = np.linspace(low, high, BINS + 1)
    counts, _ = np.histogram(values, edges)
    return Distribution(len(values), quantiles, edges, counts, int(np.sum(values < low)), int(np.sum(values > high)))


def _counted(table: Table, name: str) -> dict[str, int]:
    return dict(table.rows(f"SELECT {name}, count(*) AS n FROM {EACH} WHERE {name} IS NOT NULL GROUP BY {name} ORDER BY n DESC, {name}"))


def _effects(table: Table) -> dict[str, int]:
    found: Counter[str] = Counter()
    for folder, text in table.each(f"SELECT folder, effects FROM {EACH} WHERE effects <> '[]' AND effects IS NOT NULL"):
        with read_as_written(table, folder):
            found.update({effect["id"] for effect in told_by(text)})
    return dict(sorted(found.items(), key=lambda each: (-each[1], each[0])))


def reason_of(line: str) -> str:
    """A failure's line without its own numbers and names, so that those of one cause are one."""
    words = [("…" if any(c.isdigit() for c in word) else word) for word in line.split()]
    return " ".join(word for number, word in enumerate(words) if word != "…" or words[number - 1 : number] != ["…"])


def _failures(table: Table) -> list[tuple[str, str, str]]:
    keyed = f"SELECT folder, ifnull(step, status), error FROM {EACH} WHERE status <> '{DONE}'"
    return table.rows(f"{keyed} UNION ALL SELECT folder, 'reading', error FROM folders WHERE key IS NULL ORDER BY 1 LIMIT {MOST_LISTED}")


def _reasons(table: Table) -> list[tuple[str, str, int]]:
    found: Counter[tuple[str, str]] = Counter()
    for step, error in table.each(f"SELECT ifnull(step, status), error FROM {EACH} WHERE status <> '{DONE}'"):
        found[step, reason_of(error)] += 1
    for folder, error in table.each("SELECT folder, error FROM folders WHERE key IS NULL"):
        found["reading", reason_of(error.replace(folder, "…"))] += 1
    return [(*which, count) for which, count in sorted(found.items(), key=lambda each: (-each[1], each[0]))][:MOST_REASONS]
