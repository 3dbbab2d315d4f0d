"""``tinygc.estimate_rates``: a sensor on a rate table, of a feature."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from session.base.errors import CalibrationError
from session.base.features import need
from tinygc.library.arguments import Progress, is_path, nothing, public


@public()
def estimate_rates(
    source: Any,
    *,
    sigma: Any = None,
    unit: str = "",
    rate_column: str = "",
    output_column: str = "",
    readings: int | None = None,
    progress: Progress | None = None,
) -> Any:
    """Choose the law of a sensor's output over the rate of a table, with the terms of IEEE 1431; bandwidth and delay of a sweep.

    Parameters
    ----------
    source : str, Path, or tuple of arrays
        A CSV of rates and outputs, or of frequencies, gains and phases; a folder with ``rates*.csv``, ``table.toml`` and ``table.csv``; or
        ``(rate_dps, output)``: (N,) °/s and (N,), in the order in which they were taken.
    sigma : array_like, optional
        (N,) sigma of each output, where it is known, of arrays.
    unit : str, optional
        Unit of the output, where the CSV does not say it.
    rate_column, output_column : str, optional
        Names of the columns of a CSV.
    readings : int, optional
        Readings behind each mean, where the CSV has their std.
    progress : callable, optional
        Called with what is done, how far, and of how much.

    Returns
    -------
    Rates
        ``choices``, ``sweeps``, ``remarks``, ``summary()``, ``html()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

    Raises
    ------
    CalibrationError
        For what cannot be read, for too few rates, and if the rates feature was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> rates = [-60, -40, -20, 0, 20, 40, 60]
    >>> found = tinygc.estimate_rates((rates, [-1.2001, -0.7998, -0.4001, 0.0002, 0.3999, 0.8001, 1.1999]), unit="V")
    >>> found.choices[0].fit.hypothesis.name
    'line'

    """
    feature = need("rates of a table")
    if is_path(source):
        if sigma is not None:
            raise CalibrationError("estimate_rates: sigma is of arrays; a CSV has a column std and --readings")
        columns = feature.Columns(rate_column, output_column, unit, readings)
        return feature.rates_of(Path(source), columns, progress or nothing)
    if not (isinstance(source, tuple) and len(source) == 2):
        raise CalibrationError(f"source is of type {type(source).__name__}, expected a path or a tuple of two arrays (rate_dps, output)")
    return feature.rates_of_arrays(*source, sigma, unit or "units", progress or nothing)
