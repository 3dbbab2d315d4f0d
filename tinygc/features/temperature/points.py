"""What the noise at rest asks of the temperature: what of a rest goes with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.log.rests import RestLog
from tinygc.features.temperature.axis_fit import Knots, fit_axis, make_knots
from tinygc.features.temperature.rest_fit import zero_of_blocks
from tinygc.features.temperature.sweeps import sweeps_of


def knots_of(logs: Sequence[RestLog]) -> Knots:
    """Return the blocks of rests over temperature."""
    return make_knots(list(logs), [sweep for index, log in enumerate(logs) for sweep in sweeps_of(log.temp_c, index)])


def part_of(knots: Knots, means: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Fit the zero of a channel over temperature, with its lag, to the means (B,) of the blocks.

    Returns the zero (B,) of each, and its columns (B, order); None where it does not depend on the temperature.
    """
    found = fit_axis(knots, means)
    if not found.order:
        return None
    element = knots.element_c(found.tau_s) - knots.reference_c
    return zero_of_blocks(knots, found), element[:, None] ** np.arange(1, found.order + 1)
