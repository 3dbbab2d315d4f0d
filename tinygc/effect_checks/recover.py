"""Inject and recover: over simulated sessions, the fitted parameters miss the true ones by what their stated sigmas allow."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from tinygc.effect_checks.report import Wrong
from tinygc.effect_checks.sessions import Found, fitted, inject
from tinygc.effects import Convention, Derived, Effect
from tinygc.explanation.verdict.readable import readable

#: two-sided: errors as far from their sigmas, to either side, come by chance once in so many checks
CHANCE = 1e-4
#: beyond noise, what any model of an effect simplifies (filters, sampling): this share of the injected size is allowed in each sigma
MODEL_SHARE = 0.01
#: of the size, a stated sigma with which most parameters cannot be told from zero: their errors then say little
HARDLY_SEEN = 1 / 3


def recover(effect: Effect, size: float, seeds: int, value: float | None = None) -> tuple[str, Found]:
    """Squares of the errors in stated sigmas, summed over parameters and sessions, against chi-square."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, seeds + 1):
            found.append(fitted(effect, inject(effect, Path(folder) / str(seed), size, seed, value)))
    return _verdict(found), found[0]


def _verdict(found: list[Found]) -> str:
    looks = [_look(one) for one in found]
    error, sigma = (np.concatenate([look[i] for look in looks]) for i in (0, 1))
    count = len(error)
    # Correlated errors are fewer independent ones (Satterthwaite): the sum of squares is chi-square of so much freedom, scaled.
    freedom = count**2 / sum(float(np.sum(look[2] ** 2)) for look in looks)
    allowed = MODEL_SHARE * np.concatenate([look[3] for look in looks])
    strict, loose = (float(np.sum(error**2 / variance)) * freedom / count for variance in (sigma**2, sigma**2 + allowed**2))
    bounds = chi2.ppf([CHANCE, 1 - CHANCE], freedom)
    sizes = np.concatenate([look[3] for look in looks])
    worst = float((np.abs(error) / sizes).max())
    numbers = (
        f"{len(found)} sessions, {count} numbers: errors {np.sqrt(np.mean((error / sigma) ** 2)):.2f} sigma rms, "
        f"at most {100 * worst:.2g} % of the size"
    )
    if loose > bounds[1]:
        raise Wrong(f"{numbers}: more than the stated sigmas and {100 * MODEL_SHARE:g} % allow (chance {CHANCE:g})")
    if strict < bounds[0]:
        raise Wrong(f"{numbers}: the stated sigmas are too large (chance {CHANCE:g})")
    weak = "; hardly seen at this size: give a larger size=" if np.median(sigma / sizes) > HARDLY_SEEN else ""
    return numbers + weak


def _look(one: Found) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Errors (n,) and stated sigmas (n,) of what the JSON says, their correlation (n, n), and the injected size (n,)."""
    claim, truth = one.claim, one.injected.theta
    effect = claim.effect
    widen = max(1.0, one.fit.chi_square / max(len(one.fit.r) - one.fit.J.shape[1], 1))
    covariance = one.fit.theta_covariance(0) * widen
    _, parameters, std = readable(claim, covariance)
    if isinstance(effect.derived, Derived):
        name = effect.derived.name
        error = np.array([parameters[name] - effect.derived.of(truth)])
        return error, np.array([std[name]]), np.eye(1), np.abs([effect.derived.of(truth)])
    sigma = np.ravel(std[effect.parameter.name]) * effect.parameter.si
    keep = sigma > 0  # a convention holds one entry exactly
    if isinstance(effect.gauge, Convention):
        slope = effect.gauge.slope(claim.theta)
        covariance = slope @ covariance @ slope.T
    own = np.sqrt(np.diag(covariance)[keep])
    correlation = covariance[np.ix_(keep, keep)] / np.outer(own, own)
    size = np.full(int(keep.sum()), np.sqrt(np.mean(truth**2)))
    return (claim.theta - truth)[keep], sigma[keep], correlation, size
