"""The runner-up as a curve along the law's own quantity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tinygc.discovery.told.fits import Fitted
from tinygc.discovery.told.series import Series, curve, has_curve, main_of, series_of
from tinygc.explanation.verdict.explain import Explanation


def other_curve(e: Explanation, own: Fitted, other: Fitted, series: Series) -> Callable[[np.ndarray], np.ndarray] | None:
    """(K,) of the quantity -> (K,) rad/s that the runner-up says, with what its calibration changes; None where it follows another."""
    if own.form is None or other.form is None or len(other.form.factors) != 1 or not has_curve(other.form):
        return None
    main, theirs = main_of(own.form), main_of(other.form)
    alike = next((each for each in series_of(other.form) if (each.axis, each.component) == (series.axis, series.component)), None)
    if theirs.quantity != main.quantity or alike is None:
        return None
    before, after = own.fit.state.model, other.fit.state.model
    zero = before.B[series.axis] - after.B[series.axis]
    per_rate = (before.E - after.E)[series.axis, series.component] if main.quantity == "rate" else 0.0
    theta, full_scale = other.theta[list(alike.entries)], e.twin.movements[0].fs_rps

    def said(at: np.ndarray) -> np.ndarray:
        return curve(theirs, at, theta) + zero + per_rate * full_scale * at

    return said
