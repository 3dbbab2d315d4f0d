"""The uncertainty that a fit states, assembled from its sources: the covariance is their sum, in order, and nothing else.

    noise, references, calibration of the accelerometer, Earth      C_i of each: through the response of the parameters
    misfit beyond the noise                                         (f - 1) sum C_i, where the closure refutes that noise explains it
    rounding, clock, prior                                          added as they are

f is the variance inflation: chi-square of the closure over its degrees of freedom nu.  Its own uncertainty is f sqrt(2 / nu), so that the
misfit's variance has nu ((f - 1) / f)^2 degrees of freedom.  What one effect that nobody modelled may have moved (``systematic``), and the
bias of another switch-on (``repeatability``), are no part of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import FitError
from session.base.texts import command_line, significant
from tinygc.closure.least_squares import PriorUse
from tinygc.closure.problem import GYROSCOPE, Problem
from tinygc.closure.uncertainty import covariance_parts, goodness
from tinygc.estimation.options import FitOptions
from tinygc.estimation.sources import Source, total
from tinygc.estimation.stated_noise import StatedNoise, kind_of, rounding_covariance, shared_part, stated_goodness, stated_sources
from tinygc.models.linear import MATRIX, LinearModel

MISFIT, ROUNDING, CLOCK = "misfit beyond the noise", "rounding of the registers", "clock"


def stated_uncertainty(
    problem: Problem, level: Problem, model: LinearModel, noise: StatedNoise | None, options: FitOptions, prior: PriorUse | None = None
) -> dict[str, Any]:
    """Assemble the uncertainty of a model fitted to ``level``, the problem with the selected bias, as the fields of ``FitResult`` state it.

    Raises FitError for a calibration that no gyroscope has (``require_plausible``).
    """
    if noise is None:
        found, rates = goodness(level.batch, level.floor, model, level.wander), level.still_rates if options.still_rates else None
        widened = found.excess
        parts = covariance_parts(level.batch, level.floor, model, level.earth, rates, level.wander, level.prior)
        sources = [Source(cause, *kind_of(cause, level), part) for cause, part in parts.items()]
    else:
        found, widened = stated_goodness(level, model, noise)
        sources = stated_sources(level, model, noise, options.still_rates)
    if widened > 1:
        freedom = max(1.0, found.freedom * ((widened - 1) / widened) ** 2)
        sources = [*sources, Source(MISFIT, "A", freedom, (widened - 1) * total(sources))]
    joint = noise is not None and level.joint is not None
    gyroscope = [source.of(GYROSCOPE) for source in sources] if joint else sources
    require_plausible(model, total(gyroscope), problem.session.folder)
    more = list(_as_they_are(problem, model, prior))
    there = tuple(source for source in (*gyroscope, *more) if source.covariance.any())
    stated = {"goodness": found, "widened": widened, "sources": there, "covariance": total(there)}
    if noise is None:
        return stated
    shared = widened * shared_part(level, sources)
    if not joint:
        return stated | {"accelerometer_covariance": shared}
    whole = (*sources, *(_embedded(source, shared.shape) for source in more))
    stated |= {"joint_sources": whole, "joint_covariance": total(whole), "joint_shared": shared}
    return stated | {"accelerometer_covariance": shared[GYROSCOPE, GYROSCOPE]}


def _as_they_are(problem: Problem, model: LinearModel, prior: PriorUse | None) -> Iterator[Source]:
    yield Source(ROUNDING, "B", np.inf, rounding_covariance(problem, model))
    if prior is not None:
        yield Source(prior.source, "B", np.inf, prior.more)
    if (clock := problem.session.clock) is not None:
        yield Source(CLOCK, "B", np.inf, clock.covariance(model.vector))


def _embedded(source: Source, shape: tuple[int, ...]) -> Source:
    covariance = np.zeros(shape)
    covariance[GYROSCOPE, GYROSCOPE] = source.covariance
    return replace(source, covariance=covariance)


# A calibration that no gyroscope can have, whatever its residuals.

#: factor by which no gyroscope's sensitivity is off: data sheets allow 1 to 10 %, and the next usual mistake is a factor of 1.15 or 2
GAIN_WITHIN = 1.25
#: sigmas beyond that factor
CLEARLY = 3.0


def require_plausible(model: LinearModel, covariance: np.ndarray, folder: Path) -> None:
    """Refuse a calibration whose E stretches or shrinks the rates along some direction as no gyroscope's errors do.

    covariance (12, 12) of ``model.vector``: what the session hardly determines is not refused.  Raises FitError.
    """
    left, gains, right = np.linalg.svd(model.E)
    for gain, u, v in zip(gains, left.T, right, strict=True):
        slope = np.outer(u, v).ravel()  # of a singular value by the elements of E
        sigma = float(np.sqrt(slope @ covariance[MATRIX, MATRIX] @ slope))
        beyond = max(gain - GAIN_WITHIN, 1 / GAIN_WITHIN - gain)
        if not beyond <= CLEARLY * sigma:
            raise FitError(
                f"{folder}: no gyroscope has this calibration: it multiplies rates about ({', '.join(f'{x:.2f}' for x in v)}) by "
                f"{significant(gain)}, expected {1 / GAIN_WITHIN:g} to {GAIN_WITHIN:g}; rates or gravity are not what session.toml says: "
                f"look at {command_line('check', folder)}"
            )
