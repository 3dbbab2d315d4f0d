"""A form as an effect of the catalogue's kind, so that all that weighs, fits and draws effects takes it as one of them."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.grammar.words import equation as equation_of
from tinygc.discovery.grammar.words import regime, splits
from tinygc.effects import Effect, Movement, NoC, Parameter, Reach

#: rad/s: a prior, not a bar: beyond the zero-rate level of any good part (3 dps)
PLAUSIBLE_RPS = 5 * DEG


def columns_of(form: Form, movement: Movement) -> np.ndarray:
    """(N, 3, P): what one rad/s of each coefficient adds."""
    values = {factor: factor.values(movement) for factor in form.factors}
    terms = form.terms()
    found = np.zeros((len(movement.rate), 3, len(terms)))
    for number, term in enumerate(terms):
        product = np.ones(len(movement.rate))
        for factor, component in term.parts:
            product = product * values[factor][:, component]
        found[:, term.axis, number] = product
    return found


def distorted(form: Form, movement: Movement, theta: np.ndarray) -> np.ndarray:
    """(N, 3) rad/s: the rate with the law; as ``columns_of`` times theta (P,), without the zeros."""
    values = {factor: factor.values(movement) for factor in form.factors}
    found = movement.rate.copy()
    for term, coefficient in zip(form.terms(), theta, strict=True):
        product = coefficient * values[term.parts[0][0]][:, term.parts[0][1]]
        for factor, component in term.parts[1:]:
            product *= values[factor][:, component]
        found[:, term.axis] += product
    return found


def as_effect(form: Form, name: str = "discovered.law", rms: float = 1.0, equation: str = "") -> Effect:
    """The form as an effect; rms: of its products in the recording, by which its plausible size is known."""
    reach = sum((factor.reach for factor in form.factors), Reach())
    inputs = tuple(dict.fromkeys(name for factor in form.factors for name in factor.inputs))
    unit, said = form.coefficient_unit, equation or equation_of(form)
    return Effect(
        id=name,
        equation=said,
        parameter=Parameter("coefficients", (form.size,), unit, DEG, plausible=PLAUSIBLE_RPS / max(rms, 1e-12)),
        seen_in=("still", "turn"),
        columns=lambda movement: columns_of(form, movement),
        says=lambda theta: f"follows {said} (up to {np.abs(theta).max() / DEG:.3g} {unit})",
        splits=splits(form),
        regime=regime(form),
        inputs=inputs,
        reach=reach,
        exact_distort=lambda movement, theta: distorted(form, movement, theta),
        device=NoC("no C has been written for it"),
    )
