"""How long a form's description is: the choices that the grammar offers at each place, in bits.

    factors: one or two | of each: quantity, function, its constant on the grid, lag or none | pattern of axes
"""

from __future__ import annotations

from functools import cache

import numpy as np

from tinygc.discovery.grammar.form import PATTERNS, Factor, Form
from tinygc.discovery.grammar.functions import FUNCTIONS
from tinygc.discovery.grammar.grids import FINE, LAGS_S, MOST_PERIODS
from tinygc.discovery.grammar.quantities import QUANTITIES


def bits(form: Form) -> float:
    """Of a form, whatever its constants are."""
    return _bits(form.shape)


@cache
def _bits(form: Form) -> float:
    return 1.0 + sum(map(_of_factor, form.factors)) + float(np.log2(len(PATTERNS)))


def _of_factor(factor: Factor) -> float:
    found = float(np.log2(len(QUANTITIES)) + np.log2(len(FUNCTIONS))) + 1.0
    if factor.constant is not None:
        periodic = factor.quantity == "time" and factor.through.phases > 1
        found += float(np.log2(MOST_PERIODS if periodic else len(FINE)))
    return found + (float(np.log2(len(LAGS_S))) if factor.lag_s is not None else 0.0)
