"""Inject and recover: over simulated sessions, the fitted parameters miss the true ones by what their stated sigmas allow."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from tinygc.effect_checks.report import Wrong
from tinygc.effect_checks.sessions import Found, fitted, inject
from tinygc.effects import Effect
from tinygc.explain.verdict.readable import readable

#: two-sided: errors as far from their sigmas, to either side, come by chance once in so many checks
CHANCE = 1e-4
#: beyond noise, what any model of an effect simplifies (filters, sampling): this share of the injected size is allowed in each sigma
MODEL_SHARE = 0.03


def recover(effect: Effect, size: float, seeds: int, value: float | None = None) -> tuple[str, Found]:
    """Squares of the errors in stated sigmas, summed over parameters and sessions, against chi-square."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, seeds + 1):
            found.append(fitted(effect, inject(effect, Path(folder) / str(seed), size, seed, value)))
    return _verdict(found, size), found[0]


def _verdict(found: list[Found], size: float) -> str:
    total, loose, freedom, worst = 0.0, 0.0, 0, 0.0
    for one in found:
        error = one.claim.theta - one.injected.theta
        covariance = _covariance(one)
        scale = np.sqrt(np.diag(covariance))
        keep = scale > 1e-6 * scale.max()  # a convention holds one entry exactly
        error, covariance = error[keep], covariance[np.ix_(keep, keep)]
        total += float(error @ np.linalg.solve(covariance + (MODEL_SHARE * size) ** 2 * np.eye(len(error)), error))
        loose += float(error @ np.linalg.solve(covariance, error))
        freedom += len(error)
        worst = max(worst, float(np.abs(error).max()))
    bounds = chi2.ppf([CHANCE, 1 - CHANCE], freedom)
    rms = np.sqrt(loose / freedom)
    numbers = f"{len(found)} sessions, {freedom} parameters: errors {rms:.2f} sigma rms, at most {worst / size:.2g} of the size"
    if total > bounds[1]:
        raise Wrong(f"{numbers}: more than the stated sigmas and {100 * MODEL_SHARE:g} % allow (chance {CHANCE:g})")
    if loose < bounds[0]:
        raise Wrong(f"{numbers}: the stated sigmas are too large (chance {CHANCE:g})")
    return numbers


def _covariance(one: Found) -> np.ndarray:
    """(P, P) as it is stated: widened as ``readable`` widens it for the JSON."""
    effect = one.claim.effect
    widen = max(1.0, one.fit.chi_square / max(len(one.fit.r) - one.fit.J.shape[1], 1))
    covariance = one.fit.theta_covariance(0) * widen
    if effect.derived is None:
        _, _, std = readable(one.claim, covariance)
        stated = np.ravel(std[effect.parameter.name]) * effect.parameter.si
        own = np.sqrt(np.diag(covariance))
        factor = np.divide(stated, own, out=np.ones_like(own), where=own > 0)
        return covariance * np.outer(factor, factor)
    return covariance
