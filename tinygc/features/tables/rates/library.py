"""Python interface of ``rates``: the points of a rate table, of a CSV or of a recording with its machine's angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.progress import Progress, no_report
from session.base.texts import NONE, measured, printable, probability, significant
from tinygc.features.tables.feature import Columns
from tinygc.features.tables.rates.choice import RIVAL, Choice, HeldOut, choose
from tinygc.features.tables.rates.fitting import REFUTED, Number
from tinygc.features.tables.rates.laws import EXTRAS, LAWS
from tinygc.features.tables.rates.points import Points, points_of, read_points, settings_of
from tinygc.features.tables.rates.terms import TermRow, left_open, terms
from tinygc.library.arguments import is_path, public
from tinygc.library.records import Kept
from tinygc.reporting import facts
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.facts import Chapter, Part, Table, screen
from tinygc.reporting.terminal import Group, one_line

# What ``rates`` shows, on screen, page and picture: of each sensor the law, the terms of IEEE 1431, and what other curves show of it.

# Words.


def headline(choice: Choice) -> str:
    """Which sensor, and what its points follow."""
    found, points = choice.fit, choice.points
    return f"{printable(points.sensor)}: {law_words(choice)}; it leaves {significant(found.rms)} {points.unit} rms"


def law_words(choice: Choice) -> str:
    """``a straight line, clipped below and above``."""
    of = choice.fit.hypothesis
    return ", ".join([of.of.words, *filter(None, [of.clipped]), *(f"with {EXTRAS[name].words}" for name in of.all_extras)])


def lines(choice: Choice) -> list[str]:
    """What stands between headline and terms: the equation, its numbers, chance and rivals."""
    found, points = choice.fit, choice.points
    reported = law_lines(choice)
    if choice.is_line:
        reported.append(f"no departure from a straight line beyond chance ({probability(choice.p_value)})")
    else:
        reported.append(
            f"a straight line leaves {significant(choice.line.rms)} {points.unit} rms; it is refuted ({probability(choice.p_value)})"
        )
    if found.hypothesis.apart >= 0:
        at, more, again, beyond = float(points.rate_dps[found.hypothesis.apart]), "", "next to it", left_open(found)
        if beyond is not None:
            size_of = points.output * np.sign(choice.line.coefficients[0] * at)
            is_larger = size_of[points.rate_dps * np.sign(at) > abs(at)] > size_of[found.hypothesis.apart]
            limit = "" if is_larger.any() else "the output has a limit there or "
            more, again = f", or {limit or 'there is '}a kink from {significant(beyond[1])} °/s on, which no reading determines", "beyond"
        reported.append(f"the reading at {significant(at)} °/s is off{more}; measure it again, and {again}")
    lack = found.lack_of_fit
    if lack is not None and lack.p_value < REFUTED:
        repeats = f"{significant(lack.noise)} {points.unit}" if not points.is_known else f"{significant(lack.noise)} of the stated sigmas"
        wider = f"; the sigmas are {lack.variance_inflation**0.5:.2f} times wider for it" if lack.variance_inflation > 1 else ""
        reported.append(
            f"repeats scatter by {repeats}, and the law leaves more ({probability(lack.p_value)}): it is not the whole of it{wider}"
        )
    laws = f"of {len(LAWS)} laws and a curve of none"
    if choice.rivals:
        others = ", ".join(
            f"{rival.hypothesis.name} ({100 * share:.0f} %, {significant(rival.rms)} {points.unit})" for rival, share in choice.rivals
        )
        reported.append(f"{laws} this one has {100 * choice.probability:.0f} %; not excluded: {others}")
    elif not choice.is_line:
        reported.append(f"{laws} no other is more than {100 * RIVAL:.0f} % as probable")
    if choice.curve is not None:
        reported.append("the figures of a range are of a smooth curve through these points, whatever the law is called")
    return reported


def law_lines(choice: Choice) -> list[str]:
    """The equation, and its numbers."""
    found = choice.fit
    skip = len(found.offsets) if len(found.offsets) > 1 else 0
    return [found.hypothesis.equation, ", ".join(map(_number, found.numbers[skip:]))]


def cells(row: TermRow) -> tuple[str, str]:
    """Value and sigma, ``less than x``, or a dash."""
    if row.value is None:
        return (NONE, "") if row.at_most is None else (f"less than {significant(row.at_most, 2)}", "")
    if row.sigma is None or not row.sigma > 0:
        return significant(row.value), ""
    value, _, sigma = measured(row.value, row.sigma).partition(" ± ")
    return value, sigma


def _number(each: Number) -> str:
    """``K 0.01986 ± 0.00012 V/(°/s)``, or between which values it is not determined."""
    unit = "" if each.unit == "1" else f" {each.unit}"
    if each.between is not None:
        return f"{each.name} not determined; {significant(each.between[0])} to {significant(each.between[1])}{unit} fit as well"
    return f"{each.name} not determined" if each.value is None else f"{each.name} {measured(each.value, each.sigma or 0.0)}{unit}"


def held_out_rows(choice: Choice) -> list[tuple[str, list[str]]]:
    """A law, and what it was fitted to; what it leaves on each curve."""
    found: dict[str, dict[str, HeldOut]] = {}
    for one in choice.held_out:
        found.setdefault(", ".join(filter(None, (one.hypothesis, one.fitted_to and f"fitted to {one.fitted_to}"))), {})[one.curve] = one
    return [(law, [held_out_cell(by_curve.get(curve)) for curve in choice.points.curves]) for law, by_curve in found.items()]


def held_out_cell(one: HeldOut | None) -> str:
    """``0.0415 (1.79)``: rms over the rates within those that were fitted, and over all where some lie beyond."""
    if one is None:
        return NONE
    return f"{significant(one.within_rms)} ({significant(one.rms)})" if one.beyond else significant(one.rms)


def curve_words(curve: str) -> str:
    """The last of a curve's cells, which differs most often."""
    return printable(curve.rpartition(", ")[2])


# Screen and page: what stands of each sensor, with its charts.

#: terms that a screen of several sensors shows
FIRST = ("scale", "offset", "nonlinearity", "hysteresis")
#: rates at which a law is drawn
DRAWN = 401


def _terms_table(rows: Sequence[TermRow]) -> Table:
    cells_of = [[row.name, *cells(row), row.unit, row.condition] for row in rows]
    return Table("", ("", "value", "± σ", "unit", "condition"), cells_of, left=(0, 3, 4), minor=(4,))


def _sensor(choice: Choice) -> list[Part]:
    parts: list[Part] = [
        one_line(headline(choice), "bold"),
        *lines(choice),
        _terms_table(terms(choice)),
        _output(choice),
        _residuals(choice),
    ]
    if choice.held_out:
        # Rms that each law leaves on a curve that it was not fitted to, whose offset alone is free
        first = f"left on the curve that was not fitted, {choice.points.unit} rms (beyond its rates)"
        left = [[law, *found] for law, found in held_out_rows(choice)]
        parts.append(Table("", (first, *map(curve_words, choice.points.curves)), left))
    return parts


# The pictures.

#: colours of the curves of one sensor, in their order; further ones begin again
CURVES = ("after", "y", "raw", "pso", "tinygc", "tinygc_denoised")


def _output(choice: Choice) -> Panel:
    points = choice.points
    grid = np.linspace(points.rate_dps.min(), points.rate_dps.max(), DRAWN)
    panel = Panel(Axis("rate (°/s)"), Axis(f"output ({points.unit})"), headline(choice).partition(":")[0])
    panel.line(grid, choice.line.at(grid), "floor", "dash", name="straight line")
    return _measured(panel.line(grid, choice.fit.at(grid), "physics", name=choice.fit.hypothesis.name), choice, points.output)


def _residuals(choice: Choice) -> Panel:
    points, order = choice.points, np.argsort(choice.points.rate_dps, kind="stable")
    noise = (choice.fit.noise * (points.sigma if points.is_known else np.ones(len(points))))[order]
    title = f"What the law leaves (a straight line: {significant(choice.line.rms)} rms)"
    panel = Panel(Axis("rate (°/s)"), Axis(f"left ({points.unit})"), title).zero()
    panel.area(points.rate_dps[order], -noise, noise, "floor", name="noise, 1 σ")
    return _measured(panel, choice, choice.fit.residuals)


def _measured(panel: Panel, choice: Choice, values: np.ndarray) -> Panel:
    """Add the points of each curve."""
    titles = np.array(_titles(choice), dtype=object)
    for n, curve in enumerate(choice.points.curves):
        own = choice.points.curve == n
        panel.points(
            choice.points.rate_dps[own], values[own], CURVES[n % len(CURVES)], name=curve_words(curve) or "measured", labels=titles[own]
        )
    return panel


def _titles(choice: Choice) -> list[str]:
    points = choice.points
    names = [curve_words(points.curves[n]) for n in points.curve]
    return [
        f"{name} {significant(rate)} °/s: {measured(value)} {points.unit}, {significant(left, 2)} from the law".strip()
        for name, rate, value, left in zip(names, points.rate_dps, points.output, choice.fit.residuals, strict=True)
    ]


#: sensors of one picture, at most
MOST_ROWS = 8


SCHEMA = "tinygc-rates/1"
FILE, PICTURE, PAGE = "rates.json", "rates.svg", "rates.html"


@dataclass(frozen=True, eq=False, repr=False)
class Rates(Kept):
    """Result of ``tinygc.estimate_rates``: ``choices`` (law, fit, rivals of each sensor), ``remarks``."""

    FILES: ClassVar = (FILE, PAGE, PICTURE)
    name: str
    choices: tuple[Choice, ...]
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<Rates of {self.name}: {', '.join(choice.fit.hypothesis.name for choice in self.choices)}>"

    @property
    def _chapters(self) -> list[Chapter]:
        return [(f"sensor-{n}", choice.points.sensor, _sensor(choice)) for n, choice in enumerate(self.choices)]

    @property
    def page(self) -> Group:
        """The command's output, as a rich renderable."""
        return self.screen()

    def screen(self, everything: bool = False) -> Group:
        """The same; everything: what other laws leave as well, and of several sensors all numbers."""
        parts, brief = list[Part](), len(self.choices) > 1 and not everything
        for choice in self.choices:
            known = [row for row in terms(choice) if row.value is not None or row.at_most is not None]
            shown = [row for row in known if row.key in FIRST] if brief else known
            law = [] if brief else lines(choice) if everything else law_lines(choice)
            parts += [one_line(headline(choice), "bold"), *law, _terms_table(shown)]
        return screen([*parts, *["--verbose shows all numbers"] * brief])

    def to_json(self) -> dict:
        """``tinygc-rates/1`` (docs/formats/tables.md)."""
        return {
            "schema": SCHEMA,
            "version": VERSION,
            "name": self.name,
            "sensors": [_of_sensor(choice) for choice in self.choices],
            "remarks": list(self.remarks),
        }

    def html(self) -> str:
        """The report of the rate table as one HTML document."""
        more: list[Chapter] = [("remarks", "Remarks", self.remarks)] if self.remarks else []
        foot = "Terms of IEEE 1431, 12.9 to 12.11. ± is one standard deviation; “less than” is an upper limit (95 %)."
        return facts.page("Rate table", self.name, [*self._chapters, *more], foot)

    def figure(self) -> Picture:
        """Outputs with their laws, and what these leave."""
        panels = [panel for choice in self.choices[:MOST_ROWS] for panel in (_output(choice), _residuals(choice))]
        return Picture(panels, "Rate steps")


def _values(of: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(of, name) for name in names}


def _of_sensor(choice: Choice) -> dict[str, Any]:
    found, points = choice.fit, choice.points
    lack = found.lack_of_fit
    columns = _values(points, "curve", "rate_dps", "output") | {"predicted": found.predicted, "limited": found.is_limited}
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return {
        "sensor": points.sensor,
        "unit": points.unit,
        "curves": list(points.curves),
        **_values(found.hypothesis, "law", "name", "equation"),
        "parameters": [vars(each) for each in found.numbers],
        **_values(choice, "probability", "p_value"),
        **_values(found, "rms", "noise"),
        "line_rms": choice.line.rms,
        "lack_of_fit": None if lack is None else vars(lack),
        "rivals": [{"name": rival.hypothesis.name, "probability": share, "rms": rival.rms} for rival, share in choice.rivals],
        "terms": [vars(row) for row in terms(choice)],
        "points": [dict(zip(columns, row, strict=True)) for row in rows],
        "held_out": [vars(one) for one in choice.held_out],
    }


@public(Columns)
def estimate_rates(source: Any, *, sigma: Any = None, progress: Progress | None = None, **choices: Any) -> Any:
    """Choose the law of a sensor's output over the rate of a table, with the terms of IEEE 1431.

    Parameters
    ----------
    source : str, Path, or tuple of arrays
        A CSV of rates and outputs; or ``(rate_dps, output)``: (N,) °/s and (N,), in the order in which they were taken.
    sigma : array_like, optional
        (N,) sigma of each output, where it is known, of arrays.
    progress : callable, optional
        Called with what is done, how far, and of how much.

    Returns
    -------
    Rates
        ``choices``, ``remarks``, ``summary()``, ``html()``, ``to_json()``, ``save(folder)``, ``plot(path)``.

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
    columns, notify = Columns(**choices), progress or no_report
    points, remarks = list[Points](), list[str]()
    if not is_path(source):
        if not (isinstance(source, tuple) and len(source) == 2):
            raise CalibrationError(
                f"source is of type {type(source).__name__}, expected a path or a tuple of two arrays (rate_dps, output)"
            )
        rate, out = (np.asarray(each, dtype=float) for each in source)
        known = None if sigma is None else np.asarray(sigma, dtype=float)
        if rate.ndim != 1 or rate.shape != out.shape or (known is not None and known.shape != rate.shape):
            raise FormatError(f"rates: shapes {rate.shape} and {out.shape}, expected (N,) rates and as many outputs")
        name, points = "arrays", [points_of("arrays", columns.unit or "units", rate, out, [""] * len(rate), known)]
    elif sigma is not None:
        raise CalibrationError("estimate_rates: sigma is of arrays; a CSV has a column std and --readings")
    else:
        name, (points, remarks) = Path(source).name, read_points(Path(source), columns)
    laws = []
    for number, own in enumerate(points):
        notify(f"laws of {own.sensor}", number, len(points))
        settled, why = settings_of(own)
        laws.append(choose(settled))
        remarks += why
    return Rates(name, tuple(laws), tuple(remarks))
