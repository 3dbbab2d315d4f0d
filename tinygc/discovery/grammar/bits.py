"""How long a form's description is: the choices that the grammar offers at each place, in bits.

    one factor or two | of each: quantity; itself or a function, and which; its constant's place on the grid; lag or none, and which |
    pattern of axes, of those that such factors may have

A choice among n costs log2(n).  What is asked with yes or no costs one bit: is there a second factor, is it the quantity itself, is there
a lag.  So a law of one quantity as it is costs seven bits, and a product of two functions behind lags more than thirty.  The bits are those
of the grammar, whatever a recording has; constants count by their place on the grid.  Two to the power of minus the bits, summed over
all forms, is below one, as of any code.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from tinygc.discovery.grammar.form import Form, patterns_of
from tinygc.discovery.grammar.functions import FUNCTIONS
from tinygc.discovery.grammar.grids import lags_of, places
from tinygc.discovery.grammar.quantities import QUANTITIES


def bits(form: Form) -> float:
    """Of a form, whatever its constants are."""
    factors = sum(_of_factor(f.quantity, f.function, f.constant is not None, f.lag_s is not None) for f in form.factors)
    return 1.0 + factors + float(np.log2(len(patterns_of(form.factors))))


@cache
def _of_factor(quantity: str, function: str, constant: bool, lag: bool) -> float:
    found = float(np.log2(len(QUANTITIES))) + 2.0
    if function != "itself":
        found += float(np.log2(len(FUNCTIONS) - 1))
    if constant:
        found += float(np.log2(len(places(quantity, function))))
    return found + (float(np.log2(len(lags_of(quantity)))) if lag else 0.0)
