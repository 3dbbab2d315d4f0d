"""Python interface of ``rates``: the points of a rate table, of a CSV or of a recording with its machine's angles; sine sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.files import result_folder
from session.base.records import write_whole
from session.base.results import write_text_whole
from tinygc.features.tables.feature import Columns
from tinygc.features.tables.rates.choice import Choice, choose
from tinygc.features.tables.rates.points import Points, points_of, read_points, read_table, settings_of
from tinygc.features.tables.rates.recording import read_recording
from tinygc.features.tables.rates.report import figure_of, page, rates_page
from tinygc.features.tables.rates.sweep import Response, Sweep, fit_response, is_response, read_response
from tinygc.features.tables.rates.terms import terms
from tinygc.library.arguments import Progress, is_path, nothing, public
from tinygc.library.records import Shown
from tinygc.reporting.pictures.canvas import has_matplotlib, save, saved
from tinygc.reporting.terminal import Group

if TYPE_CHECKING:
    from tinygc.reporting.pictures.canvas import Figure

SCHEMA = "tinygc-rates/1"
FILE, PICTURE, PAGE = "rates.json", "rates.png", "rates.html"


@dataclass(frozen=True, eq=False, repr=False)
class Rates(Shown):
    """Result of ``tinygc.estimate_rates``: ``choices`` (law, fit, rivals of each sensor), ``sweeps``, ``remarks``."""

    name: str
    choices: tuple[Choice, ...]
    sweeps: tuple[Sweep, ...] = ()
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<Rates of {self.name}: {', '.join(choice.fit.hypothesis.name for choice in self.choices) or 'a sweep'}>"

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return rates_page(self.choices, self.sweeps, self.remarks)

    def to_json(self) -> dict:
        """``tinygc-rates/1`` (docs/features/tables/rates-format.md)."""
        return {
            "schema": SCHEMA,
            "version": VERSION,
            "name": self.name,
            "sensors": [_of_sensor(choice) for choice in self.choices],
            "sweeps": [_of_sweep(sweep) for sweep in self.sweeps],
            "remarks": list(self.remarks),
        }

    def save(self, folder: Path | str, pictures: bool = True) -> Path:
        """Write ``rates.json``, ``rates.html`` and, where matplotlib is installed, ``rates.png`` into a folder, and return it.

        Raises StorageError for files that cannot be written.
        """
        folder = Path(folder)
        with result_folder(folder):
            write_whole(folder / FILE, self.to_json())
            write_text_whole(folder / PAGE, self.html())
            if pictures and has_matplotlib():
                save(self.plot(), folder / PICTURE)
        return folder

    def html(self) -> str:
        """The report of the rate table as one HTML document."""
        return page(self.choices, self.sweeps, self.remarks, self.name)

    def plot(self, path: Path | str | None = None) -> Figure:
        """Draw outputs, laws and residuals; path: a PNG to write.  Raises CalibrationError where matplotlib is missing."""
        figure = figure_of(self.choices, self.sweeps)
        return figure if path is None else saved(figure, Path(path))


def _of_sensor(choice: Choice) -> dict[str, Any]:
    found, points = choice.fit, choice.points
    lack = found.lack_of_fit
    rows = zip(points.curve.tolist(), points.rate_dps, points.output, found.predicted, found.is_limited, strict=True)
    return {
        "sensor": points.sensor,
        "unit": points.unit,
        "curves": list(points.curves),
        "law": found.hypothesis.law,
        "name": found.hypothesis.name,
        "equation": found.hypothesis.equation,
        "parameters": [vars(each) for each in found.numbers],
        "probability": choice.probability,
        "p_value": choice.p_value,
        "rms": found.rms,
        "noise": found.noise,
        "line_rms": choice.line.rms,
        "lack_of_fit": None if lack is None else vars(lack),
        "rivals": [{"name": rival.hypothesis.name, "probability": share, "rms": rival.rms} for rival, share in choice.rivals],
        "terms": [vars(row) for row in terms(choice)],
        "points": [
            {"curve": curve, "rate_dps": float(rate), "output": float(output), "predicted": float(predicted), "limited": bool(limited)}
            for curve, rate, output, predicted, limited in rows
        ],
        "held_out": [vars(one) for one in choice.held_out],
    }


def _of_sweep(sweep: Sweep) -> dict[str, Any]:
    (gain, gain_sigma), (delay_s, delay_sigma_s) = sweep.gain, sweep.delay_s
    names = ("frequency_hz", "gain", "gain_sigma", "phase_deg", "phase_sigma_deg")
    return {
        "name": sweep.response.name,
        "model": sweep.model,
        "probability": sweep.probability,
        "gain": gain,
        "gain_sigma": gain_sigma,
        "delay_s": delay_s,
        "delay_sigma_s": delay_sigma_s,
        "latency_s": sweep.response.latency_s,
        "bandwidth_hz": sweep.bandwidth_hz,
        "bandwidth_sigma_hz": sweep.bandwidth_sigma_hz,
        "bandwidth_at_least_hz": sweep.bandwidth_at_least_hz,
        "points": [dict(zip(names, row, strict=True)) for row in sweep.rows_deg],
    }


def rates_of(path: Path, columns: Columns, progress: Progress) -> Rates:
    """Rate steps and sweeps of a CSV or of a recording's folder.  Raises CalibrationError, in one line, for what cannot be read."""
    points, responses = list[Points](), list[Response]()
    if path.is_dir():
        points, responses, remarks = read_recording(path, progress)
    elif is_response(read_table(path)[0]):
        responses = [read_response(path)]
        remarks = ["The CSV does not say how late the table's angle is; a latency of it counts with its sign against the sensor's delay."]
    else:
        points, remarks = read_points(path, columns)
    return _chosen(path.name, points, [*map(fit_response, responses)], remarks, progress)


def rates_of_arrays(
    rate_dps: Sequence[float], output: Sequence[float], sigma: Sequence[float] | None, unit: str, progress: Progress
) -> Rates:
    """Rate steps of arrays (N,), in the order in which they were taken."""
    rate, out = np.asarray(rate_dps, dtype=float), np.asarray(output, dtype=float)
    known = None if sigma is None else np.asarray(sigma, dtype=float)
    if rate.ndim != 1 or rate.shape != out.shape or (known is not None and known.shape != rate.shape):
        raise FormatError(f"rates: shapes {rate.shape} and {out.shape}, expected (N,) rates and as many outputs")
    return _chosen("arrays", [points_of("arrays", unit, rate, out, [""] * len(rate), known)], [], [], progress)


def _chosen(name: str, points: Sequence[Points], sweeps: Sequence[Sweep], remarks: Sequence[str], progress: Progress) -> Rates:
    choices, said = [], list(remarks)
    for number, own in enumerate(points):
        progress(f"laws of {own.sensor}", number, len(points))
        settled, why = settings_of(own)
        choices.append(choose(settled))
        said += why
    return Rates(name, tuple(choices), tuple(sweeps), tuple(said))


@public(Columns)
def estimate_rates(source: Any, *, sigma: Any = None, progress: Progress | None = None, **choices: Any) -> Any:
    """Choose the law of a sensor's output over the rate of a table, with the terms of IEEE 1431; bandwidth and delay of a sweep.

    Parameters
    ----------
    source : str, Path, or tuple of arrays
        A CSV of rates and outputs, or of frequencies, gains and phases; a folder with ``rates*.csv``, ``table.toml`` and ``table.csv``; or
        ``(rate_dps, output)``: (N,) °/s and (N,), in the order in which they were taken.
    sigma : array_like, optional
        (N,) sigma of each output, where it is known, of arrays.
    progress : callable, optional
        Called with what is done, how far, and of how much.

    Returns
    -------
    Rates
        ``choices``, ``sweeps``, ``remarks``, ``summary()``, ``html()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

    Raises
    ------
    CalibrationError
        For what cannot be read, for too few rates; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> rates = [-60, -40, -20, 0, 20, 40, 60]
    >>> found = tinygc.estimate_rates((rates, [-1.2001, -0.7998, -0.4001, 0.0002, 0.3999, 0.8001, 1.1999]), unit="V")
    >>> found.choices[0].fit.hypothesis.name
    'line'

    """
    columns = Columns(**choices)
    if is_path(source):
        if sigma is not None:
            raise CalibrationError("estimate_rates: sigma is of arrays; a CSV has a column std and --readings")
        return rates_of(Path(source), columns, progress or nothing)
    if not (isinstance(source, tuple) and len(source) == 2):
        raise CalibrationError(f"source is of type {type(source).__name__}, expected a path or a tuple of two arrays (rate_dps, output)")
    return rates_of_arrays(*source, sigma, columns.unit or "units", progress or nothing)
