"""What a model with conditions refers to, as JSON: ``conditions`` of ``tinygc-model/1``."""

from __future__ import annotations

from collections.abc import Collection

from session.common.errors import FormatError
from session.files.shapes import Keys, Maybe, Number
from tinygc.effects.conditions import Conditions
from tinygc.models.shapes import CELSIUS, RATE

#: no session lasts longer than a year
_YEAR_S = 366 * 86400.0
CONDITIONS_TABLE = Keys(
    {"duration_s": Number(0, _YEAR_S), "fs_rps": Number(0, RATE.high, above=True), "first_temp_c": Maybe(CELSIUS)},
)


def known_of(table: dict, inputs: Collection[str], where: str) -> Conditions:
    """From a table that ``CONDITIONS_TABLE`` was held against; inputs: what the model is told beside the rate.

    FormatError where it follows temperature, and nobody knows from which one on.
    """
    known = table["conditions"]
    if known["first_temp_c"] is None and "temperature" in inputs:
        raise FormatError(f"{where}: conditions.first_temp_c is null, expected a number: the model follows temperature; fit again")
    first = known["first_temp_c"]
    return Conditions(float(known["duration_s"]), float(known["fs_rps"]), float("nan") if first is None else float(first))
