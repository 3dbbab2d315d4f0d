"""Plain laws, one of each quantity: what a recording that shows no law is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.responses import Responses
from tinygc.discovery.screen.values import Values
from tinygc.discovery.screen.weighing import FAINT


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
        response = responses.columns(form).sum(axis=1)
        whitened = look.whitened(response)
        free = look.free_of(whitened)
        length = float(np.linalg.norm(free))
        if not length > FAINT * float(np.linalg.norm(whitened)):  # or no number
            continue
        rms = beside_calibration(form, np.ones(form.size), responses.values) / length
        if factor.quantity not in best or rms < best[factor.quantity].rms:
            best[factor.quantity] = Probe(factor.quantity, form, whitened / length, free / length, rms)
    return tuple(best.values())


def beside_calibration(form: Form, theta: np.ndarray, values: Values) -> float:
    """rad/s rms over samples and axes: the rate that a law of coefficients theta (P,) adds, less what a bias and a matrix take up."""
    found = {factor: values.of(factor) for factor in form.factors}
    added = np.zeros((3, values.samples))
    for term, size in zip(form.terms(), theta, strict=True):
        product = np.array(size)
        for factor, component in term.parts:
            product = product * found[factor][component]
        added[term.axis] += product
    left = added - (added @ values.calibration) @ values.calibration.T
    return float(np.sqrt(np.mean(left**2)))
