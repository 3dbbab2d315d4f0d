"""Whether a fit with a law is one that a gyroscope could have: its score alone does not say so."""

from __future__ import annotations

import numpy as np

from tinygc.explanation.naming.evidence import Hypothesis

#: of residuals in sigmas, mean square: one by the noise that was estimated with them, unless the fit has not arrived there
MOST_LEFT = 2.0
#: of the scale factor and the misalignments, that a law may take over: five times the sensitivity's tolerance on the data sheet.  A rate,
#: and a rate that is cut off above its range, are nearly one: each may have any size while their sum has none, and the calibration is lost.
#: benchmarks/discover_real.py: on injected/case09 such laws took 0.4
MOST_TAKEN = 0.05


def believable(have: Hypothesis, base: Hypothesis) -> bool:
    """Of a hypothesis with a law, beside one without it: its fit leaves what its score was computed with, and the calibration stays."""
    arrived = float(have.fit.r @ have.fit.r) < MOST_LEFT * len(have.fit.r)
    return arrived and float(np.abs(have.fit.state.model.E - base.fit.state.model.E).max()) < MOST_TAKEN
