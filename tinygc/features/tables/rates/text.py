"""The screen of ``rates``: for each sensor the law, the terms of IEEE 1431, what was predicted of curves that were left out, remarks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.base.texts import NONE, printable, probability
from tinygc.features.tables.rates.choice import RIVAL, Choice, HeldOut
from tinygc.features.tables.rates.fitting import REFUTED, Number
from tinygc.features.tables.rates.laws import LAWS
from tinygc.features.tables.rates.sweep import Sweep
from tinygc.features.tables.rates.terms import TermRow, left_open, size, terms
from tinygc.reporting.pictures.canvas import plain
from tinygc.reporting.terminal import Group, RenderableType, one_line, plain_table


def rates_page(choices: Sequence[Choice], sweeps: Sequence[Sweep], remarks: Sequence[str]) -> Group:
    """The screen."""
    parts: list[RenderableType] = []
    for choice in choices:
        parts += [*_sensor(choice), ""]
    for sweep in sweeps:
        table = plain_table("", "frequency, Hz", "gain", "phase, °", right=True)
        for f, gain, gain_sigma, phase, phase_sigma in sweep.rows_deg:
            table.add_row(size(f), plain(gain, gain_sigma), plain(phase, phase_sigma))
        parts += [one_line(sweep.headline, "bold"), table, *map(one_line, sweep.lines), ""]
    return Group(*(parts[:-1] if parts else parts), *map(one_line, remarks))


def headline(choice: Choice) -> str:
    """Which sensor, and what its points follow."""
    found, points = choice.fit, choice.points
    curves = f" on {len(points.curves)} curves" if len(points.curves) > 1 else ""
    return f"{printable(points.sensor)}: {len(points)} points{curves}: {law_words(choice)}; it leaves {size(found.rms)} {points.unit} rms"


def law_words(choice: Choice) -> str:
    """``a straight line, clipped below and above``."""
    _, *rest = choice.fit.hypothesis.name.split(", ")
    extras = {"turning": "with an offset while the table turns", "hysteresis": "with hysteresis", "asymmetry": "with asymmetry"}
    extras |= {"drift": "with a drift in the order of the rows", "one reading off": "with one reading off"}
    return ", ".join([choice.fit.hypothesis.of.words, *(extras.get(each, each) for each in rest)])


def lines(choice: Choice) -> list[str]:
    """What stands between headline and terms: the equation, its numbers, chance and rivals."""
    found, points = choice.fit, choice.points
    skip = len(found.offsets) if len(found.offsets) > 1 else 0
    said = [found.hypothesis.equation, ", ".join(map(_number, found.numbers[skip:]))]
    if choice.is_line:
        said.append(f"no departure from a straight line beyond chance ({probability(choice.p_value)})")
    else:
        said.append(f"a straight line leaves {size(choice.line.rms)} {points.unit} rms; it is refuted ({probability(choice.p_value)})")
    if found.hypothesis.apart >= 0:
        at, more, again, beyond = float(points.rate_dps[found.hypothesis.apart]), "", "beside it", left_open(found)
        if beyond is not None:
            size_of = points.output * np.sign(choice.line.coefficients[0] * at)
            is_larger = size_of[points.rate_dps * np.sign(at) > abs(at)] > size_of[found.hypothesis.apart]
            limit = "" if is_larger.any() else "the output has a limit there or "
            more, again = f", or {limit or 'there is '}a kink from {size(beyond[1])} °/s on, which no reading determines", "beyond"
        said.append(f"the reading at {size(at)} °/s is off{more}; measure it again, and {again}")
    lack = found.lack_of_fit
    if lack is not None and lack.p_value < REFUTED:
        repeats = f"{size(lack.noise)} {points.unit}" if not points.is_known else f"{size(lack.noise)} of the stated sigmas"
        wider = f"; the sigmas are {lack.variance_inflation**0.5:.2f} times wider for it" if lack.variance_inflation > 1 else ""
        said.append(
            f"repeats scatter by {repeats}, and the law leaves more ({probability(lack.p_value)}): it is not the whole of it{wider}"
        )
    laws = f"of {len(LAWS)} laws and a curve of none"
    if choice.rivals:
        others = ", ".join(
            f"{rival.hypothesis.name} ({100 * share:.0f} %, {size(rival.rms)} {points.unit})" for rival, share in choice.rivals
        )
        said.append(f"{laws} this one has {100 * choice.probability:.0f} %; not excluded: {others}")
    elif not choice.is_line:
        said.append(f"{laws} no other is more than {100 * RIVAL:.0f} % as probable")
    if choice.curve is not None:
        said.append("the figures of a range are of a smooth curve through these points, whatever the law is called")
    return said


def _sensor(choice: Choice) -> list[RenderableType]:
    parts: list[RenderableType] = [one_line(headline(choice), "bold"), *map(one_line, lines(choice))]
    table = plain_table("", "", "value", "± σ", "unit", "condition")
    for column in (1, 2):
        table.columns[column].justify = "right"
    for row in terms(choice):
        table.add_row(row.name, *cells(row), row.unit, row.condition)
    parts.append(table)
    if choice.held_out:
        # Rms that each law leaves on a curve that it was not fitted to
        first = f"left on the curve that was not fitted, {choice.points.unit} rms (beyond its rates)"
        table = plain_table("", first, *map(curve_words, choice.points.curves), right=True)
        for law, cells_of_law in held_out_rows(choice):
            table.add_row(law, *cells_of_law)
        parts.append(table)
    return parts


def cells(row: TermRow) -> tuple[str, str]:
    """Value and sigma, ``less than x``, or a dash."""
    if row.value is None:
        return (NONE, "") if row.at_most is None else (f"less than {size(row.at_most, 2)}", "")
    if row.sigma is None or not row.sigma > 0:
        return size(row.value), ""
    value, _, sigma = number(row.value, row.sigma).partition(" ± ")
    return value, sigma


def _number(each: Number) -> str:
    """``K 0.01986 ± 0.00012 V/(°/s)``, or between which values it is not determined."""
    unit = "" if each.unit == "1" else f" {each.unit}"
    if each.between is not None:
        return f"{each.name} not determined; {size(each.between[0])} to {size(each.between[1])}{unit} fit as well"
    return f"{each.name} not determined" if each.value is None else f"{each.name} {number(each.value, each.sigma or 0.0)}{unit}"


def number(value: float, sigma: float) -> str:
    """``−0.019864 ± 0.000013``, or with a power of ten where it is small; to the sigma's first digits."""
    if value and 0 < abs(value) < 1e-4 and sigma > 0:
        exponent = f"{value:e}".partition("e")[2]
        return f"({plain(value / 10.0 ** int(exponent), sigma / 10.0 ** int(exponent))}) × 10^{int(exponent)}".replace("^-", "^−")
    return plain(value, sigma)


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
    return f"{size(one.within_rms)} ({size(one.rms)})" if one.beyond else size(one.rms)


def curve_words(curve: str) -> str:
    """The last of a curve's cells, which differs most often."""
    return printable(curve.rpartition(", ")[2])
