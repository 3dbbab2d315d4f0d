"""What one form promises beside a hypothesis that was not screened: the rest of what stands, in the noise as it is with the form."""

from __future__ import annotations

import numpy as np

from tinygc.discovery.grammar.form import Form
from tinygc.discovery.screen.alike import basis_of
from tinygc.discovery.screen.looks import Look
from tinygc.discovery.screen.screening import Screening
from tinygc.discovery.screen.weighing import promise


def promised_beside(screening: Screening, form: Form, look: Look) -> float:
    """Studentised, as ``Screening.tested``; -inf where nothing of it is seen.  look: of all turns, at the rest."""
    basis = basis_of(form, screening.all_responses, look)
    if not basis.shape[1]:
        return -np.inf
    gain, rank = np.array([np.sum((basis.T @ look.residual) ** 2)]), np.array([basis.shape[1]])
    return float(promise(look.studentised(gain, rank, look.scatter), rank, np.array([screening.price_of(form)]))[0])
