"""Whether a fit with a law is one that a gyroscope could have: its score alone does not say so."""

from __future__ import annotations

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.responses import Responses
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.twin.layout import LINEAR
from tinygc.explanation.twin.refit import Refit
from tinygc.models.linear import MATRIX

#: of residuals in sigmas, mean square: one by the noise that was estimated with them, unless the fit has not arrived there
MOST_LEFT = 2.0
#: of the scale factor and the misalignments, that a law may take over: five times the sensitivity's tolerance on the data sheet.  A rate,
#: and a rate that is cut off above its range, are nearly one: each may have any size while their sum has none, and the calibration is lost.
#: benchmarks/discover_real.py: on injected/case09 such laws took 0.4
MOST_TAKEN = 0.05
#: the same by linear columns, which are not believed by half of it
MOST_TAKEN_LINEARLY = 2 * MOST_TAKEN


def believable(have: Hypothesis, base: Hypothesis) -> bool:
    """Of a hypothesis with a law, beside one without it: its fit leaves what its score was computed with, and the calibration stays."""
    arrived = float(have.fit.r @ have.fit.r) < MOST_LEFT * len(have.fit.r)
    return arrived and float(np.abs(have.fit.state.model.E - base.fit.state.model.E).max()) < MOST_TAKEN


def takes_calibration(form: Form, responses: Responses, look: Look, fit: Refit) -> bool:
    """Whether a form, at its best by linear columns beside a fit in a look's noise, would take the calibration's place.

    What differs from the rate in one turn alone takes up that turn, and the scale factor of all others: it promises much, and is not
    believed once it is refitted.
    """
    columns = look.whitened(responses.columns(form))
    theta = np.linalg.lstsq(look.free_of(columns), look.residual, rcond=None)[0]
    moved = np.linalg.lstsq(fit.J, columns @ theta, rcond=None)[0]
    return bool(np.abs(moved[LINEAR][MATRIX]).max() > MOST_TAKEN_LINEARLY)
