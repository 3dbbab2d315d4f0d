"""``explain/discover.png``: the remainder against the quantity that a law follows, with the law and its runner-up; what each leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tinygc.discovery.grammar.words import equation
from tinygc.discovery.judge.answer import Discovery, Law
from tinygc.discovery.told.as_json import briefly, other_equation
from tinygc.discovery.told.fits import Fitted, Pair
from tinygc.discovery.told.page import headline
from tinygc.discovery.told.panels import draw_pair
from tinygc.discovery.told.points import Points, of_stills, of_turns
from tinygc.discovery.told.series import series_of
from tinygc.explanation.pictures.canvas import canvas
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: of a law's chi-square, from which on a channel has a row of its own
SHARE = 0.15
#: series in one panel
MOST_SERIES = 3


def figure_of(e: Explanation, discovery: Discovery, pairs: list[Pair]) -> Figure:
    """The page as a matplotlib figure, of an answer with laws.  Raises CalibrationError where matplotlib is missing."""
    rows = [(pair, points) for pair in pairs for points in _rows(e, pair)]
    title, _ = headline(discovery.verdict, any(law.runners_up for law in discovery.laws))
    figure, grid = canvas(len(rows), f"{e.session.name}: {title}", (), [_words(pair.law) for pair in pairs])
    for (pair, points), sides in zip(rows, np.reshape(grid, (-1, 2)), strict=True):
        draw_pair(e, pair, points, *sides)
    return figure


def _words(law: Law) -> str:
    beside = f"      runner-up:  {briefly(other_equation(law.runners_up[0]))}" if law.runners_up else ""
    return f"{law.effect.id}:  {equation(law.form)}{beside}"


def _rows(e: Explanation, pair: Pair) -> list[list[Points]]:
    """The series of each channel that tells of the law."""
    power, found = _power(pair.own), []
    for channel, of in (("closure", of_turns), ("still", of_stills)):
        if power[channel] < SHARE * sum(power.values()):
            continue
        points = [of(e, pair, series) for series in series_of(pair.law.form)]
        points = [each for each in points if len(each.x)]
        if not points:
            continue
        strength = [float(np.sum(((each.without - each.left) / each.sigma) ** 2)) for each in points]
        most = 1 if points[0].level is not None else MOST_SERIES
        found.append([points[number] for number in sorted(np.argsort(strength)[::-1][:most])])
    return found


def _power(own: Fitted) -> dict[str, float]:
    """Chi-square of what the law says, by channel."""
    said = own.whiten.by_channel(own.whiten(own.adds.stacked() @ own.theta))
    return {name: float(np.sum(said[part] ** 2)) for name, part in own.whiten.parts.items()}
