"""Results of the public functions: fitted numbers, records that become tables, and text for a terminal or a notebook."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from session.base.files import result_folder
from session.base.numeric import data_frame
from session.base.records import write_whole
from session.base.results import write_text_whole
from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.detect.accelerometer import PARAMETERS
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.reporting.terminal import Group, as_html, as_text

R = TypeVar("R")


@dataclass(frozen=True)
class Estimate:
    """One fitted number."""

    #: ``E_xy``, ``B_x``, ``bias_x``, …
    name: str
    #: in ``unit``; NaN if the session does not observe it
    value: float
    #: one standard deviation, in ``unit``; NaN if it is not known
    sigma: float
    #: ``1`` if unitless
    unit: str

    def __repr__(self) -> str:
        return f"<{self.name} = {self.value:.6g} ± {self.sigma:.2g}{'' if self.unit == '1' else f' {self.unit}'}>"


def accelerometer_estimates(found: AccelerometerFit) -> dict[str, Estimate]:
    """Return the nine numbers of f = M (measured - b) in the accelerometer's own triad by name; a sigma is NaN if it was given."""
    sigmas = np.full(PARAMETERS, np.nan) if found.sigmas is None else found.sigmas
    names = [name.replace(" ", "_") for name in ACCELEROMETER_NAMES]
    return {
        name: Estimate(name, float(value), float(sigma), "m/s^2" if name.startswith("bias") else "1")
        for name, value, sigma in zip(names, found.values, sigmas, strict=True)
    }


#: fields of records that no cell of a table can hold
NO_CELLS = ("corrections",)


def _rows(records: Iterable[Any]) -> dict[str, list[Any]]:
    tables = [{each.name: getattr(record, each.name) for each in fields(record)} if is_dataclass(record) else record for record in records]
    names = dict.fromkeys(name for table in tables for name in table if name not in NO_CELLS)
    return {name: [table.get(name) for table in tables] for name in names}


class Named(dict[str, R]):
    """Records by name; ``to_frame()`` makes a pandas DataFrame of them, a row for each name."""

    def to_frame(self) -> Any:
        """Return a pandas DataFrame, its rows by name.  Raises CalibrationError where pandas is not installed."""
        return data_frame(_rows(self.values()), [*self])


class Listed(tuple[R, ...]):
    """Records in order; ``to_frame()`` makes a pandas DataFrame of them, a row for each."""

    def to_frame(self) -> Any:
        """Return a pandas DataFrame.  Raises CalibrationError where pandas is not installed."""
        return data_frame(_rows(self))


class Shown:
    """A result with a ``page`` for rich, which is its text in a terminal and its table in a notebook."""

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        raise NotImplementedError

    def summary(self) -> str:
        """The command's output as plain text."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)


class Kept(Shown):
    """A result that writes its JSON, its page and its picture into a folder."""

    #: names of the files, as far as it has them; methods that return the JSON, the page as one HTML document, and the picture
    FILES: ClassVar[tuple[str, ...]]
    to_json: Any
    html: Any
    figure: Any

    def plot(self, path: Path | str | None = None) -> Any:
        """Draw the picture; path: an SVG to write."""
        from tinygc.reporting.drawing import saved

        return saved(self.figure(), path)

    def save(self, folder: Path | str, pictures: bool = True) -> Any:
        """Write its files into a folder, and return the folder.

        Raises StorageError for files that cannot be written.
        """
        folder = Path(folder)
        with result_folder(folder):
            for name in self.FILES:
                if name.endswith(".json"):
                    write_whole(folder / name, self.to_json())
                elif name.endswith(".html"):
                    write_text_whole(folder / name, self.html())
                elif pictures:
                    self.plot(folder / name)
        return folder
