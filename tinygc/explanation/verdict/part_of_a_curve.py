"""A name beside a curve without one, over the same variable: is it more than a further term of that curve?

Where the scale bends with the rate as nothing in the catalogue does, any power of the rate makes the fit better, a named one as well as
another.  Such a name says that there is more of the curve, not that its own law is there.
"""

from __future__ import annotations

import numpy as np

from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.naming.selection import left_of, orthonormal
from tinygc.explanation.naming.unknown import NAMELESS, curves_like
from tinygc.explanation.twin.layout import claim_slice

#: share of what a name does beside all else that further terms of the curve do as well, from which on it is one of them
SAME = 0.9


def part_of_a_curve(evidence: Evidence, best: Hypothesis, number: int) -> bool:
    """Whether the effect of this number does in the channels what further terms of a nameless curve in the same hypothesis do."""
    own, J = best.effects[number], best.fit.J
    for other in best.effects:
        if not other.id.startswith(NAMELESS) or own.id.startswith(NAMELESS) or other.regime is None or own.regime is None:
            continue
        terms = curves_like(evidence.twin, other) if own.regime[0] == other.regime[0] else []
        if not terms:
            continue
        part = claim_slice(best.fit.state.claims, number)
        rest = orthonormal(np.delete(J, part, axis=1))
        does = left_of(rest, J[:, part])
        curve = left_of(rest, np.concatenate([best.whiten(evidence.columns(term)) for term in terms], axis=1))
        if does.shape[1] and np.sum((curve.T @ does) ** 2) > SAME * does.shape[1]:
            return True
    return False
