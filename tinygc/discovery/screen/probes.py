"""Plain laws, one of each quantity: what a recording that shows no law is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.responses import Responses


@dataclass(frozen=True, eq=False)
class Probe:
    """A law with all coefficients alike: quantity, form; whitened (n,): its response in the look's whitened channels, unit (m,) the same
    beside the nuisance, of length one, at the size rms: rad/s of the rate that it adds beside what a calibration takes up."""

    quantity: str
    form: Form
    whitened: np.ndarray
    unit: np.ndarray
    rms: float


def probes_of(forms: Sequence[Form], responses: Responses, look: Look) -> tuple[Probe, ...]:
    """Of each quantity, that law of one function of it, without a constant, the same for each axis, which shows at the smallest rate."""
    best: dict[str, Probe] = {}
    for form in forms:
        (factor, *others) = form.factors
        if others or form.constants or form.pattern != "each":
            continue
        probe = _probe(form, responses, look)
        if probe is not None and probe.rms < best.get(factor.quantity, probe).rms * (1 + 1e-12):
            best[factor.quantity] = probe
    return tuple(best.values())


def _probe(form: Form, responses: Responses, look: Look) -> Probe | None:
    columns = responses.columns(form)
    response = columns.sum(axis=1)
    free = look.seen(response)
    length = float(np.linalg.norm(free))
    if not np.isfinite(length) or length < look.least_seen(response):
        return None
    rms = beside_calibration(form, np.ones(form.size), responses)
    return Probe(form.factors[0].quantity, form, look.whitened(response) / length, free / length, rms / length)


def beside_calibration(form: Form, theta: np.ndarray, responses: Responses) -> float:
    """rad/s rms over all samples and axes of the rate that a law adds, less what a linear calibration of the same axis takes up."""
    values = {factor: responses.values.of(factor) for factor in form.factors}
    added = np.zeros((3, responses.values.samples))
    for term, size in zip(form.terms(), theta, strict=True):
        product = np.array(size)
        for factor, component in term.parts:
            product = product * values[factor][component]
        added[term.axis] += product
    rates = np.concatenate([movement.rate for movement in responses.values.movements])
    taken, _ = np.linalg.qr(np.concatenate([rates, np.ones((len(rates), 1))], axis=1))
    left = added - (added @ taken) @ taken.T
    return float(np.sqrt(np.mean(left**2)))
