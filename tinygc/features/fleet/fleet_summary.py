"""Summary of a fleet's table, and what people see of it; the size of the page does not grow with the number of sessions."""

from __future__ import annotations

import contextlib
import csv
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TextIO

import numpy as np

from session.base.texts import printable, significant
from session.base.units import DEG, MG
from tinygc.features.fleet.fleet_row import COLUMNS, DONE, VALUES, cell_content, unpacked
from tinygc.features.fleet.fleet_table import COUNTED, EACH, FleetTable, not_as_written
from tinygc.features.fleet.lot import UnitResult
from tinygc.inference.decide import simply_accepted
from tinygc.models.linear import BIAS
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.facts import Chapter, Part, Table, html, page
from tinygc.reporting.html.markup import WIDE

if TYPE_CHECKING:
    from tinygc.features.fleet.fleet_run import FleetRun

# Rows of a fleet's table as a lot's records, and as CSV.

#: order of production: by time where known, then by name, with s2 before s10
IN_ORDER = f"ORDER BY ifnull(recorded, '') = '', recorded, {COUNTED}(folder), folder"
#: left out: bytes are for programs only
NOT_IN_CSV = ("covariance",)


def results_of(table: FleetTable) -> Iterator[UnitResult]:
    """Yield each fitted session of an open table, in the order of production; a copy counts once."""
    names = ("folder", "model", "serial", "recorded", "key", "covariance")
    sql = f"SELECT {', '.join((*names, *VALUES))} FROM {EACH} WHERE held_out_deg IS NOT NULL {IN_ORDER}"
    for order, (folder, model, serial, recorded, key, blob, *row) in enumerate(table.each(sql)):
        with read_as_written(table, folder):
            values, covariance = np.array(row, dtype=float), unpacked(blob)
        yield UnitResult(key, serial or "", folder, values, covariance, float(order), model or "", recorded or "")


@contextlib.contextmanager
def read_as_written(table: FleetTable, folder: str) -> Iterator[None]:
    """Raise FormatError for values that another program has written into a row."""
    try:
        yield
    except (ValueError, TypeError, KeyError, AttributeError):
        raise not_as_written(table.path, folder) from None


def write_csv(table: FleetTable, file: TextIO) -> int:
    """Write a header and a line for each folder, by name; return their number.  Effects are ids separated by spaces; SI as in the table."""
    columns = [name for name in COLUMNS if name not in NOT_IN_CSV]
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["folder", "key", *columns])
    sql = (
        f"SELECT folders.folder, folders.key, {', '.join(columns)}, folders.error FROM folders LEFT JOIN results USING (key) ORDER BY 1"
    ).replace(" error,", " results.error,")
    status, error, effects, findings = (2 + columns.index(name) for name in ("status", "error", "effects", "findings"))
    count = 0
    for row in table.each(sql):
        cells = list(row[:-1])
        if row[1] is None:
            cells[status], cells[error] = "failed", row[-1]
        with read_as_written(table, row[0]):
            cells[effects] = " ".join(effect["id"] for effect in cell_content(cells[effects] or "[]"))
            cells[findings] = "; ".join(
                f"{each['where']}: {each['what']}: {each['description']}" for each in cell_content(cells[findings] or "[]")
            )
        writer.writerow(["" if cell is None else repr(cell) if isinstance(cell, float) else cell for cell in cells])
        count += 1
    return count


# Summary of the table: numbers and short lists, for any number of sessions.

#: length limit of lists, so that a page of a hundred thousand sessions stays small
MOST_LISTED, MOST_REASONS = 200, 20
#: commands that are offered to check names on a unit's other sessions, and sessions in each
MOST_OFFERED = 3
BINS = 40
#: SQL text for a value that is unknown, for conversion to an array
INFINITE = "9e999"
#: quantiles of a distribution: the median, one normal sigma around it, and nearly all
SHARES = (0.005, 0.16, 0.5, 0.84, 0.995)


@dataclass(frozen=True, eq=False)
class Distribution:
    """Distribution of a number.

    count: sessions with a value; quantiles (5,) at ``SHARES``; edges (B + 1,) and counts (B,) of its histogram over nearly all of them;
    below, above: number of values outside of it.
    """

    count: int
    quantiles: np.ndarray
    edges: np.ndarray
    counts: np.ndarray
    below: int
    above: int


@dataclass(frozen=True, eq=False)
class Summary:
    """Summary of a table, for folders that still exist.

    folders: how many; sessions: different ones; done, failed, died; unreadable: folders that could not be read; passed, undecided
    and missed: sessions by the verdict of their fit, with limit_deg where it is given; units: serial numbers;
    first_look and verdicts: counts of each; effects: id -> sessions in which it is reported; reasons: (step, reason, count) of failures,
    the most frequent first; failures: (folder, step, line), listed up to ``MOST_LISTED``; cpu_s: of all;
    distributions: ``held_out_deg``, ``floor_deg``, ``run_rmse_deg`` and each parameter, where there are any.
    """

    folders: int
    sessions: int
    done: int
    failed: int
    died: int
    unreadable: int
    passed: int
    undecided: int
    missed: int
    units: int
    limit_deg: float | None
    first_look: dict[str, int]
    verdicts: dict[str, int]
    effects: dict[str, int]
    reasons: list[tuple[str, str, int]]
    failures: list[tuple[str, str, str]]
    cpu_s: float
    distributions: dict[str, Distribution] = field(default_factory=dict)

    @property
    def fitted(self) -> int:
        """Sessions with a verdict."""
        return self.passed + self.undecided + self.missed

    @property
    def all_failed(self) -> int:
        """Failed, died and unreadable ones."""
        return self.failed + self.died + self.unreadable

    @property
    def rule(self) -> str:
        """By what a session passes."""
        if self.limit_deg is not None:
            return f"Rule: each fit's verdict with a limit of {self.limit_deg:g}°."
        return "Rule: each fit's verdict; no session passes without limits or a data sheet."

    def to_json(self) -> dict:
        """Return ``tinygc-fleet/1`` (docs/formats.md), without the facts of the run itself."""
        return {
            **vars(self),
            "reasons": [{"step": step, "reason": reason, "sessions": count} for step, reason, count in self.reasons],
            "failures": [{"folder": folder, "step": step, "error": error} for folder, step, error in self.failures],
            "distributions": [
                {"figure": name, "sessions": each.count, "quantiles": each.quantiles.tolist()} for name, each in self.distributions.items()
            ],
        }


def summarise(table: FleetTable, limit_deg: float | None = None) -> Summary:
    """Summarise an open table; only its numbers are in memory, 20 MB for a hundred thousand rows."""
    status = dict(table.rows(f"SELECT status, count(*) FROM {EACH} GROUP BY status"))
    answers = Counter(_answers(table, limit_deg))
    names = ("held_out_deg", "floor_deg", "run_rmse_deg", *VALUES)
    known = ", ".join(f"ifnull({name}, {INFINITE})" for name in names)
    figures = np.fromiter(table.each(f"SELECT {known} FROM {EACH}"), dtype=np.dtype((float, len(names))))
    found = {name: distribution(values[np.isfinite(values)]) for name, values in zip(names, figures.T, strict=True)}
    keyed = f"SELECT folder, ifnull(step, status), error FROM {EACH} WHERE status <> '{DONE}'"
    return Summary(
        folders=table.one("SELECT count(*) FROM folders"),
        sessions=sum(status.values()),
        done=status.get(DONE, 0),
        failed=status.get("failed", 0),
        died=status.get("died", 0),
        unreadable=table.one("SELECT count(*) FROM folders WHERE key IS NULL"),
        passed=answers["pass"] + answers["doubtful pass"],
        undecided=answers["not decided"] + answers["no limit"],
        missed=answers["fail"],
        units=table.one(f"SELECT count(DISTINCT serial) FROM {EACH} WHERE serial <> ''"),
        limit_deg=limit_deg,
        first_look=_counted(table, "first_look"),
        verdicts=_counted(table, "verdict"),
        effects=_effects(table),
        reasons=_reasons(table),
        failures=table.rows(
            f"{keyed} UNION ALL SELECT folder, 'reading', error FROM folders WHERE key IS NULL ORDER BY 1 LIMIT {MOST_LISTED}"
        ),
        cpu_s=table.one(f"SELECT ifnull(sum(cpu_s), 0) FROM {EACH} JOIN durations USING (key)"),
        distributions={name: each for name, each in found.items() if each is not None},
    )


def _answers(table: FleetTable, limit_deg: float | None) -> Iterator[str]:
    """Yield the answer of each fit's verdict, with a limit where it is given."""
    closures = "answer, answer_within, held_out_deg, ifnull(run_rmse_deg, 0)"
    for answer, within, *values in table.each(f"SELECT {closures} FROM {EACH} WHERE held_out_deg IS NOT NULL"):
        if limit_deg is None:
            yield answer
        else:
            yield within if all(simply_accepted(each, (0.0, limit_deg)) for each in values) else "fail"


def distribution(values: np.ndarray) -> Distribution | None:
    """Return the distribution of values (N,); None if there are none."""
    if not len(values):
        return None
    quantiles = np.quantile(values, SHARES)
    low, high = quantiles[0], quantiles[-1]
    if not high > low:
        low, high = low - max(abs(low), 1e-12) * 1e-6, high + max(abs(high), 1e-12) * 1e-6
    edges = np.linspace(low, high, BINS + 1)
    counts, _ = np.histogram(values, edges)
    return Distribution(len(values), quantiles, edges, counts, int(np.sum(values < low)), int(np.sum(values > high)))


def _counted(table: FleetTable, name: str) -> dict[str, int]:
    return dict(table.rows(f"SELECT {name}, count(*) AS n FROM {EACH} WHERE {name} IS NOT NULL GROUP BY {name} ORDER BY n DESC, {name}"))


def _effects(table: FleetTable) -> dict[str, int]:
    found: Counter[str] = Counter()
    for folder, text in table.each(f"SELECT folder, effects FROM {EACH} WHERE effects <> '[]' AND effects IS NOT NULL"):
        with read_as_written(table, folder):
            found.update({effect["id"] for effect in cell_content(text)})
    return dict(sorted(found.items(), key=lambda each: (-each[1], each[0])))


def to_check(table: FleetTable) -> list[tuple[str, list[str]]]:
    """Sessions that name an effect, one of each unit that has other sessions, and these, for ``explain --check-on``.

    At most ``MOST_OFFERED`` of each.
    """
    units: dict[str, list[tuple[str, bool]]] = {}
    for folder, serial, text in table.each(f"SELECT folder, serial, effects FROM {EACH} WHERE serial <> '' AND effects IS NOT NULL"):
        with read_as_written(table, folder):
            units.setdefault(serial, []).append((folder, bool(cell_content(text))))
    found = []
    for _, sessions in sorted(units.items()):
        first = next((folder for folder, names in sorted(sessions) if names), None)
        others = [folder for folder, _ in sorted(sessions) if folder != first]
        if first is not None and others:
            found.append((first, others[:MOST_OFFERED]))
    return found[:MOST_OFFERED]


def reason_of(line: str) -> str:
    """Remove numbers and names from a failure's line, so that equal causes have equal lines."""
    words = [("*" if any(c.isdigit() for c in word) else word) for word in line.split()]
    return " ".join(word for number, word in enumerate(words) if word != "*" or words[number - 1 : number] != ["*"])


def _reasons(table: FleetTable) -> list[tuple[str, str, int]]:
    found: Counter[tuple[str, str]] = Counter()
    for step, error in table.each(f"SELECT ifnull(step, status), error FROM {EACH} WHERE status <> '{DONE}'"):
        found[step, reason_of(error)] += 1
    for folder, error in table.each("SELECT folder, error FROM folders WHERE key IS NULL"):
        found["reading", reason_of(error.replace(folder, "*"))] += 1
    return [(*which, count) for which, count in sorted(found.items(), key=lambda each: (-each[1], each[0]))][:MOST_REASONS]


# The screen and the page.

#: columns of closures, with their titles
CLOSURES = {
    "held_out_deg": "Held-out tilt of the turns",
    "floor_deg": "Noise floor of the turns",
    "run_rmse_deg": "Worst closure run, RMSE",
}
#: px: height of a chart; width of charts side by side
HEIGHT, SMALL = 170, 410


def fleet_facts(summary: Summary, tally: FleetRun | None = None) -> list[Part]:
    """Counts, what the steps found, and reasons of failures; tally: of this run."""
    counts = [("PASS", summary.passed), ("FAIL", summary.missed), ("NOT DECIDED", summary.undecided)] if summary.fitted else []
    counts += [("could not be computed", summary.all_failed)]
    words = ", ".join(f"{count} {word}" for word, count in counts if count) or f"{summary.done} done"
    parts: list[Part] = [f"{words}: {_count(summary.sessions, 'session')} of {_count(summary.units, 'serial number')}."]
    parts += [summary.rule] if summary.fitted else []
    parts += [] if tally is None else [f"This run: {tally.done} done, {tally.failed} failed, {tally.reused} known before."]
    parts.append(
        f"Table: {_count(summary.folders, 'folder')}, {_count(summary.sessions, 'different session')}; "
        f"{summary.done} done, {summary.all_failed} failed."
    )
    for title, found in (
        ("First look, worst finding", summary.first_look),
        ("Verdicts of explain", summary.verdicts),
        ("Effects found", summary.effects),
    ):
        if found:
            rows = [(name, count, f"{significant(100 * count / summary.sessions, 2)} %") for name, count in found.items()]
            parts.append(Table(title, ("", "sessions", "share"), rows))
    reasons = [f"  {count} in {step}: {printable(reason)}" for step, reason, count in summary.reasons]
    return [*parts, *(["Failures by reason (* is what differs):", *reasons] if reasons else [])]


def _count(count: int, name: str) -> str:
    return f"{count} {name}{'s' * (count != 1)}"


def fleet_html(summary: Summary, more: Sequence[Chapter] = ()) -> str:
    """Build the page; more: chapters on the sessions as a whole (lot statistics), between parameters and failures."""
    made: list[Chapter] = [("counts", "How many", fleet_facts(summary))]
    if found := {CLOSURES[name]: (summary.distributions[name], "°", 1.0) for name in CLOSURES if name in summary.distributions}:
        drawn = [_histogram(title, *each, summary.limit_deg) for title, each in found.items()]
        made.append(("closure", "Closure", [*drawn, _shares(found)]))
    if shown := {name: (summary.distributions[name], *_unit(name)) for name in VALUES if name in summary.distributions}:
        charts = html(_histogram(name, *each, widest=SMALL) for name, each in shown.items())
        made.append(("parameters", "Parameters", html([_shares(shown)]) + f'<div class="pair">{charts}</div>'))
    made += more
    if summary.failures:
        cut = f"the first {len(summary.failures)} of {summary.all_failed}; fleet.sqlite and --csv have all"
        each = Table("", ("folder", "in", "because"), summary.failures, cut, (0, 1, 2), kind="words")
        made.append(("failures", "Failures", [each]))
    title = f"{summary.sessions} sessions, {summary.units} serial numbers"
    return page("Fleet of sessions", title, made, "Least squares alone; every number is in fleet.sqlite.")


def _unit(name: str) -> tuple[str, float]:
    """Return a parameter's displayed unit, and its size in SI."""
    if name in VALUES[BIAS]:
        return "dps", DEG
    return ("mg", MG) if name.startswith("accel_bias") else ("", 1.0)


def _shares(found: dict[str, tuple[Distribution, str, float]]) -> Table:
    header = ("", "sessions", *(f"{100 * share:g} %" for share in SHARES))
    rows = [
        (f"{name}, {unit}" if unit else name, each.count, *(significant(value / size, 4) for value in each.quantiles))
        for name, (each, unit, size) in found.items()
    ]
    return Table("Shares of the sessions lie below", header, rows, minor=(2, 6))


def _histogram(title: str, each: Distribution, unit: str, size: float, limit: float | None = None, widest: int = WIDE) -> Panel:
    edges, counts = each.edges / size, each.counts
    x, heights = np.repeat(edges, 2)[1:-1], np.repeat(counts, 2)
    outside = f"; {each.below + each.above} lie beyond" if each.below + each.above else ""
    panel = Panel(Axis(f"{title} ({unit})" if unit else title, float(edges[0]), float(edges[-1])), Axis("sessions", lo=0), height=HEIGHT)
    panel.about, panel.caption = f"{title}: histogram of {each.count} sessions", f"{each.count} sessions, the middle dashed{outside}"
    panel.widest = widest
    panel.area(x, 0, heights, "least_squares").line(x, heights, "least_squares", "thin")
    panel.upright(float(each.quantiles[len(SHARES) // 2]) / size, "quiet")
    return panel.upright(limit, "limit", name="limit") if limit is not None and edges[0] <= limit <= edges[-1] else panel
