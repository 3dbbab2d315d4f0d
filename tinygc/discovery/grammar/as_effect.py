"""A form as an effect of the catalogue's kind, so that all that weighs, fits and draws effects takes it as one of them."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.grammar.words import equation as equation_of
from tinygc.discovery.grammar.words import regime, splits
from tinygc.effects import Effect, Movement, NoC, Parameter, Reach, signals

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


def as_effect(form: Form, name: str = "discovered.law", rms: float = 1.0, equation: str = "") -> Effect:
    """The form as an effect; rms: of its products in the recording, by which its plausible size is known."""
    lags = [signals.lag_reach(factor.lag_s) for factor in form.factors if factor.lag_s is not None]
    memory = any(factor.through.memory for factor in form.factors)
    reach = sum([*(factor.of.reach for factor in form.factors), *lags, *([signals.WHOLE] if memory else [])], Reach())
    named = [name for factor in form.factors for name in factor.of.inputs] + (["time"] if memory else [])
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
        inputs=tuple(dict.fromkeys(named)),
        reach=reach,
        device=NoC("no C has been written for it"),
    )
