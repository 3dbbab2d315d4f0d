"""A fleet's table as a lot: sessions of sensors of one model."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from session.common.errors import CalibrationError
from session.common.texts import printable
from tinygc.fleet.results import results_of
from tinygc.fleet.table import EACH, Table, read_table
from tinygc.lot.report import LotReport, lot_of
from tinygc.lot.unit_result import UnitResult

MOST_NAMED = 5
#: serial numbers from which on fleet says what they are together
FEWEST_UNITS = 8


def lot_of_fleet(out: Path, model: str | None = None, limits: dict[str, tuple[float, float]] | None = None, seed: int = 0) -> LotReport:
    """Of the folder that ``fleet`` wrote.  Raises CalibrationError where its sensors are of several models and none is named, and where
    fewer than two units were fitted."""
    with read_table(out) as table:
        return lot_of_table(table, model, limits, seed)


def lot_of_table(table: Table, model: str | None = None, limits: dict[str, tuple[float, float]] | None = None, seed: int = 0) -> LotReport:
    """The same, of a table that is open."""
    fitted = f"FROM {EACH} WHERE held_out_deg IS NOT NULL"
    models = [name or "" for (name,) in table.rows(f"SELECT DISTINCT model {fitted} ORDER BY 1")]
    named = ", ".join(printable(name or "(no name)") for name in models[:MOST_NAMED]) + (", …" if len(models) > MOST_NAMED else "")
    if model is not None and model not in models:
        raise CalibrationError(f"{table.path}: no fitted session of a {printable(model)}; there are {named or 'none at all'}")
    if model is None and len(models) > 1:
        raise CalibrationError(f"{table.path}: sensors of {len(models)} models ({named}), and a lot is of one; name it with --model")
    keys = None
    if model is not None and len(models) > 1:
        keys = {key for (key,) in table.rows(f"SELECT key {fitted} AND ifnull(model, '') = ?", (model,))}
    return lot_of(_chosen(results_of(table), keys), model or (models[0] if models else ""), limits, seed=seed)


def lot_if_any(table: Table, seed: int = 0) -> LotReport | None:
    """Of a table that is open, where its fitted sensors are of one model and enough for a page; else None."""
    models, units = table.rows(
        f"SELECT count(DISTINCT ifnull(model, '')), count(DISTINCT serial) FROM {EACH} WHERE held_out_deg IS NOT NULL"
    )[0]
    return lot_of_table(table, seed=seed) if models == 1 and units >= FEWEST_UNITS else None


def _chosen(results: Iterator[UnitResult], keys: set[str] | None) -> Iterator[UnitResult]:
    return results if keys is None else (each for each in results if each.key in keys)
