"""How well each channel is predicted, together with the others and by itself.

The fit sees all channels whitened together, with one calibration for all, so that a misfit of the closure is spread over the stills.
To say *where* a mismatch lives, each channel is whitened by its own covariance and may have the calibration that suits it best.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from tinygc.explanation.twin.refit import Refit, prior_sigmas
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.models.linear import MATRIX

#: by how much a channel's own E may differ from the one that all share: a data sheet's tolerance of sensitivity
OWN_E_SIGMA = 0.01


def channel_p_values(twin: Twin, whiten: Whitener, r: np.ndarray, nuisance: np.ndarray) -> dict[str, float]:
    """Goodness of fit of each channel's rows under the one calibration that all share: whether anything is missing.

    r (n,), nuisance (n, p): whitened together, as a ``Refit`` has them.
    """
    q, _ = np.linalg.qr(nuisance / np.linalg.norm(nuisance, axis=0))
    taken = np.sum(q**2, axis=1)
    return {name: _p(twin, r[part], taken[part].sum(), unknown_rows(twin, name)) for name, part in whiten.parts.items()}


def own_p_values(twin: Twin, whiten: Whitener, fit: Refit) -> dict[str, float]:
    """Goodness of fit of each channel with the calibration that suits it best: where something is missing."""
    alone, taken = own_residuals(twin, whiten, fit)
    return {name: _p(twin, alone[part], taken[name], unknown_rows(twin, name)) for name, part in whiten.parts.items()}


def own_residuals(twin: Twin, whiten: Whitener, fit: Refit) -> tuple[np.ndarray, dict[str, float]]:
    """Residuals (n,) of each channel by itself, unit variance, and how many parameters each has used up."""
    prior = prior_sigmas(twin, [claim.effect for claim in fit.state.claims])
    prior[MATRIX] = OWN_E_SIGMA
    alone, columns = whiten.by_channel(fit.r), whiten.by_channel(fit.J * prior)
    taken = {}
    for name, part in whiten.parts.items():
        u, size, _ = np.linalg.svd(columns[part], full_matrices=False)
        kept = size**2 / (1 + size**2)
        alone[part] -= (u * kept) @ (u.T @ alone[part])
        taken[name] = float(kept.sum())
    return alone, taken


def unknown_rows(twin: Twin, name: str) -> int:
    """How many rows of a channel hold no datum: angles of turns that no reference sees."""
    return int(np.sum(~twin.batch.known)) if name == "closure" else 0


def _p(twin: Twin, r: np.ndarray, taken: float, unknown: int) -> float:
    """Against the measured noise, which is itself only known from so many blocks (Fisher's F)."""
    noise_freedom = 3 * sum(still.duration_s for _, still in twin.stills) / 0.1 * 0.66
    freedom = max(len(r) - unknown - taken, 1.0)
    return float(stats.f.sf(np.sum(r**2) / freedom, freedom, noise_freedom))


def bonferroni(p: dict[str, float]) -> float:
    """The smallest of several p-values, as one."""
    return min(1.0, len(p) * min(p.values()))
