"""``motion.undersampled``: a claim about the turns' own noise, weighed against the same noise without that cause."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from session.common.units import DEG
from tinygc.effects import catalogue
from tinygc.explanation.naming.evidence import Evidence
from tinygc.explanation.noise.components import MOST_FACTOR, UNDERSAMPLED
from tinygc.explanation.noise.session_noise import SessionNoise
from tinygc.explanation.noise.undersampling import STEPS
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.claims import Claim

#: of the floor's rms, below which it is told among the noise and is no claim: it adds a tenth to the closure
WORTH_SAYING = 0.5


def undersampled_claim(twin: Twin, whiten: Whitener, fit: Refit, noise: SessionNoise) -> list[Claim]:
    """The claim, if the recording bears it out: the noise is less probable without it, whatever each turn may err by otherwise."""
    factor, missed = noise.size(UNDERSAMPLED), noise.missed
    floor = twin.problem.floor.tilt_rms
    if factor * missed.rms_rad < WORTH_SAYING * floor or factor > MOST_FACTOR:
        return []
    J = whiten.back(fit.J) * Evidence.prior_of(twin, fit)
    fewer = noise.without(UNDERSAMPLED)
    gain = fewer.estimated(whiten, whiten.back(fit.r), J, fewer.s).value - noise.value
    probability = float(1 / (1 + np.exp(-np.clip(gain, -700, 700) / 2)))
    if probability < 0.5:
        return []
    effect = catalogue()[UNDERSAMPLED]
    sigma = next(float(s) for s, c in zip(noise.sigma, noise.components, strict=True) if c.name == UNDERSAMPLED)
    angles = twin.residuals(fit.state).closure[:, :2]
    own = float(np.sqrt(np.mean(np.sum(angles**2, axis=1))))
    rates = missed.rate_hz / np.array([1, *STEPS])
    closure = np.sqrt(own**2 + np.concatenate([[0.0], 2 * missed.missed_rad**2]))
    size = factor * missed.rms_rad
    beyond = own**2 - floor**2
    each = factor * np.sqrt(2) * missed.predicted_rad
    parameters = {
        "predicted_deg": size / DEG,
        "share": float(min(size**2 / beyond, 1.0)) if beyond > 0 else 1.0,
        "turns": [s.number for s, angle in zip(twin.segments, each, strict=True) if angle > floor],
        "rates_hz": rates.tolist(),
        "closure_deg": (closure / DEG).tolist(),
        "exponent": -missed.exponent,
    }
    says = f"{effect.says(np.array([size]))}; {missed.rate_needed_hz(size, floor):.0f} Hz would have been enough"
    std = {"predicted_deg": sigma * missed.rms_rad / DEG if np.isfinite(sigma) else missed.rms_rad / DEG}
    return [Claim(effect, parameters, std, float(chi2.sf(max(gain, 0.0), 1)), max(gain, 0.0), (), says, probability=probability)]
