"""Which numbers of a law are drawn together: what adds to one axis from one component of the quantity that is drawn along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from tinygc.discovery.grammar.form import Factor, Form, Term
from tinygc.effects import Movement

#: quantities in units that a bench knows: how many of them one is, times full scale where it is a share of that, what it is called, unit
SHOWN: dict[str, tuple[float, bool, str, str]] = {
    "rate": (1 / DEG, True, "rate about {i}", "dps"),
    "rate_size": (1 / DEG, True, "size of the rate", "dps"),
    "acceleration": (1 / DEG, True, "angular acceleration about {i}", "dps/s"),
    "acceleration_size": (1 / DEG, True, "size of the angular acceleration", "dps/s"),
    "jerk": (1 / DEG, True, "angular jerk about {i}", "dps/s²"),
    "force": (1.0, False, "specific force along {i}", "g"),
    "temperature": (1.0, False, "temperature since the first sample", "°C"),
    "temperature_rate": (60.0, False, "rate of the temperature", "°C/min"),
    "turned": (1 / DEG, False, "angle turned about {i}", "°"),
    "sense": (1.0, False, "sense of the last turn about {i}", "±1"),
}


@dataclass(frozen=True, eq=False)
class Series:
    """axis that the terms add to; component of the main factor's quantity; entries: the terms' places in theta."""

    axis: int
    component: int
    entries: tuple[int, ...]


def main_of(form: Form) -> Factor:
    """The factor that is drawn along: the one that bends; of two alike the first."""
    return next((factor for factor in form.factors if factor.through.name != "itself"), form.factors[0])


def other_of(form: Form) -> Factor | None:
    """The factor beside the main one, which may be the same function of the same quantity once more."""
    return form.factors[_beside(form)] if len(form.factors) == 2 else None


def component_beside(form: Form, term: Term) -> int:
    """Of the other factor, in a term."""
    return term.parts[_beside(form)][1]


def _beside(form: Form) -> int:
    return 1 - form.factors.index(main_of(form))


def series_of(form: Form) -> list[Series]:
    """Every axis with every component of the main factor that it has, in the order of the form's terms."""
    main, found = main_of(form), dict[tuple[int, int], list[int]]()
    for entry, term in enumerate(form.terms()):
        component = next(part // main.through.phases for factor, part in term.parts if factor is main)
        found.setdefault((term.axis, component), []).append(entry)
    return [Series(axis, component, tuple(entries)) for (axis, component), entries in found.items()]


def has_curve(form: Form) -> bool:
    """Whether the main factor can be drawn along its own quantity: nothing that remembers, and no direction fixed in the world."""
    main = main_of(form)
    remembers = any(factor.lag_s is not None or factor.through.memory for factor in form.factors)
    return not remembers and main.of.directions == 1


def values_of(factor: Factor, movement: Movement, component: int) -> np.ndarray:
    """(N,) of its quantity in SI, or in its own unit, without the function."""
    values = factor.of.of(movement).reshape(len(movement.rate), -1)
    return values[:, min(component, values.shape[1] - 1)]


def curve(factor: Factor, at: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(K,) SI of a series' law along its main quantity, theta (phases,) of its terms; times the other factor where there is one."""
    found = factor.through.of(at, factor.constant or 1.0).reshape(len(at), -1)
    return found @ theta[: found.shape[1]]


def shown_as(factor: Factor, movement: Movement) -> tuple[float, str, str]:
    """How many of the shown unit one of the quantity is, what it is called with ``{i}`` for the axis, and the unit."""
    times, of_scale, words, unit = SHOWN.get(factor.quantity, (1.0, False, factor.of.words, factor.of.unit))
    return times * (movement.fs_rps if of_scale else 1.0), words, unit


def component_name(factor: Factor, component: int) -> str:
    """``x``; nothing of a scalar."""
    return "xyz"[component // factor.of.directions] if factor.vector else ""
