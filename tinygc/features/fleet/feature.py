"""Many sessions in one table, and a lot of sensors as the prior of one unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from session.base.errors import CalibrationError
from session.base.features import Feature
from session.base.options import Record, option

if TYPE_CHECKING:
    from tinygc.estimation.options import FitOptions
    from tinygc.estimation.spread import Spread
    from tinygc.features.fleet.fit import LotFile
    from tinygc.features.fleet.lot import UnitResult

# Options of a fit that a lot adds.


@dataclass(frozen=True)
class LotOptions(Record):
    """The lot that the unit is of."""

    lot: Path | None = option(None, "prior from a production lot (lot.json), of least squares alone: fewer turns are enough", rare=True)


# What the core asks of a fleet's table and of a lot.


def fitted_sessions(path: Path) -> Iterator[UnitResult] | None:
    """Yield the fitted sessions of a fleet's table, or of the folder that holds one."""
    from tinygc.features.fleet.fleet_table import NAME, read_table

    out = path.parent if path.name == NAME else path
    if path.name != NAME and not (path / NAME).is_file():
        return None
    from tinygc.features.fleet.fleet_summary import results_of

    def rows() -> Iterator[UnitResult]:
        with read_table(out) as table:
            yield from results_of(table)

    return rows()


def spread(path: Path, sensor: str) -> Spread:
    """Return how far the numbers of a unit of a lot move between sessions."""
    from tinygc.features.fleet.fit import lot_for

    return lot_for(path, sensor).spread


def prior(options: FitOptions, sensor: str) -> LotFile | None:
    """Return the lot as prior of a unit with this sensor, where the options name one.

    Raises CalibrationError for options that cannot use a prior, and the errors of ``lot_for``.
    """
    assert isinstance(options, LotOptions)
    if options.lot is None:
        return None
    if options.physics is not None:
        raise CalibrationError("--physics fits without a lot's prior; leave it or --lot out")
    from tinygc.features.fleet.fit import lot_for

    return lot_for(options.lot, sensor)


FEATURE = Feature(
    commands={
        "fleet": ("command", "thousands of sessions in one table; the spread of a lot", "many"),
    },
    public={"fleet": "library", "lot": "library"},
    serves={
        "options of a fit": "feature:LotOptions",
        "spread of a production lot": "feature:spread",
        "prior of a fit": "feature:prior",
        "fitted sessions of a table": "feature:fitted_sessions",
    },
)
