"""The picture of a law: what each still and each turn misses, over what the law predicts, with the law and with its runner-up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import measured
from session.base.units import DEG, MDPS
from tinygc.explanation.engine import Explanation
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.law_fits import Pair
from tinygc.features.discovery.result import briefly, headline
from tinygc.features.discovery.search_state import Discovery, Law
from tinygc.features.discovery.words import coefficient_unit, equation
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.pictures.values import ahead_of

#: share of a law's chi-square above which a channel has its own row
SHARE = 0.15
#: channel -> unit of its panels, its size in SI, and what is drawn
CHANNELS = {"closure": ("°", DEG, "closure of each turn"), "still": ("mdps", MDPS, "rate in each still")}


@dataclass(frozen=True, eq=False)
class Points:
    """A law's terms of one axis in n stills or turns: predicted (n,), what they make of each, of a turn along the direction in which they
    move its closure; left, other_left (n,): the residual with the law, and with the runner-up in its place, None where there is none; sigma
    (n,) of noise.  rad/s in stills, rad in turns."""

    axis: int
    predicted: np.ndarray
    left: np.ndarray
    other_left: np.ndarray | None
    sigma: np.ndarray

    @property
    def without(self) -> np.ndarray:
        """The residual (n,) without the law."""
        return self.predicted + self.left


def points_of(e: Explanation, pair: Pair, axis: int, channel: str) -> Points:
    """One axis of a law in the stills or in the turns."""
    law, fits, entries = pair.own, [pair.own, *([] if pair.other is None else [pair.other])], _entries(pair.law.form, axis)
    if channel == "still":
        predicted = law.adds.still[:, axis][:, entries] @ law.theta[entries]
        sigma, angles = law.whiten.sigma[law.whiten.parts["still"]].reshape(-1, 3)[:, axis], [fit.left.still[:, axis] for fit in fits]
    else:
        moved = law.adds.closure[:, :, entries] @ law.theta[entries]
        predicted, angles, sigma = ahead_of(moved, [fit.left.closure for fit in fits], e.twin.problem.floor.sigma)
    keep = (predicted != 0) | (channel == "still")
    left, *others = (each[keep] for each in angles)
    return Points(axis, predicted[keep], left, others[0] if others else None, sigma[keep])


def _entries(form: LawForm, axis: int) -> list[int]:
    return [number for number, (own, _) in enumerate(form.terms()) if own == axis]


def draw(law: Law, points: list[Points], channel: str) -> tuple[Panel, Panel]:
    """Draw one row of the page: on the line of slope one if the law is the cause, level once it is taken off."""
    unit, si, what = CHANNELS[channel]
    label = Axis(f"what the law predicts ({unit})")
    left = Panel(label, Axis(f"{what} without the law ({unit})"), f"Without the law: {what}").zero()
    right = Panel(label, Axis(f"{what} that is left ({unit})"), _what_is_left(points)).zero()
    for each in points:
        kind, predicted, sigma = "xyz"[each.axis], each.predicted / si, each.sigma / si
        left.points(predicted, each.without / si, kind, sigma=sigma, name=kind + _number(law, each.axis))
        right.points(predicted, each.left / si, kind, sigma=sigma, name=f"{kind}, with the law")
        if each.other_left is not None:
            left.points(predicted, (each.without - each.other_left) / si, kind, ring=True, name="what the runner-up predicts")
            right.points(predicted, each.other_left / si, kind, ring=True, name="with the runner-up")
    ends = left.ends()[0]
    return left.line(ends, ends, "ink", name="what the law predicts, slope 1", is_measure=False), right


def _number(law: Law, axis: int) -> str:
    """The coefficient with its sigma as on the page, where the axis has one."""
    entry, *more = _entries(law.form, axis)
    if more:
        return ""
    sigma = np.sqrt(law.covariance[entry, entry])
    return f": {measured(law.theta[entry] / DEG, sigma / DEG)} {coefficient_unit(law.form)[0]}"


def _what_is_left(points: list[Points]) -> str:
    def rms(values: list[np.ndarray]) -> float:
        return rms_of(np.concatenate(values))

    words = f"What is left: {rms([each.left / each.sigma for each in points]):.2g} sigmas rms with the law"
    others = [each.other_left / each.sigma for each in points if each.other_left is not None]
    return f"{words}, {rms(others):.2g} with the runner-up" if others else words


def picture_of(e: Explanation, discovery: Discovery, pairs: list[Pair]) -> Picture:
    """``explain/discover.svg``, for an answer with laws."""
    title, _ = headline(discovery.verdict, any(law.runners_up for law in discovery.laws))
    return Picture(
        [panel for pair in pairs for panel in _rows(e, pair)], f"{e.session.name}: {title}", [_words(pair.law) for pair in pairs]
    )


def _words(law: Law) -> str:
    rival = f"      runner-up:  {briefly(law.runners_up[0].effect.equation)}" if law.runners_up else ""
    return f"{law.effect.id}:  {equation(law.form)}{rival}"


def _rows(e: Explanation, pair: Pair) -> Iterator[Panel]:
    """Both panels of each channel with evidence for the law, by the chi-square of its prediction."""
    whitened = pair.own.whiten.by_channel(pair.own.whiten(pair.own.adds.stacked() @ pair.own.theta))
    power = {name: float(np.sum(whitened[part] ** 2)) for name, part in pair.own.whiten.parts.items()}
    for channel in CHANNELS:
        points = [points_of(e, pair, axis, channel) for axis in range(3) if _entries(pair.law.form, axis)]
        if power[channel] >= SHARE * sum(power.values()) and (seen := [each for each in points if len(each.predicted)]):
            yield from draw(pair.law, seen, channel)
