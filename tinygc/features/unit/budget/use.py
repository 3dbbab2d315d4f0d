"""What a calibration is used for: the attitude after a motion, with the errors of the calibration and those of the use itself.

    phi = A (theta - truth)  +  white noise and drift of the bias during the motion
          + A_B (bias of another switch-on, temperature)                    A (3, 12): slope of ``closure.motion``

Within one switch-on the drift in the use and in the session are partly the same: its row is the variance of their difference.  With S and
U their parts of the attitude's covariance, S' and U' the symmetric roots, and rho the correlation of their means (``drift_between``), it is
S + U - rho (S' U' + U' S').
Axes are those of the body at the start.  The total angle's variance is the sum of the three.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from session.base.numeric import rms_of
from session.base.units import DEG, DEG_PER_HOUR
from session.log.folder import read_session
from tinygc.closure.floor import GYRO_NOISE
from tinygc.closure.motion import Motion, at_rest, motion_of
from tinygc.closure.uncertainty import BIAS_DRIFT
from tinygc.estimation.expected_zero import drift_between, expected_zero
from tinygc.estimation.sources import Source, freedom_of
from tinygc.estimation.stated_noise import COMPONENTS, kind_of
from tinygc.features.unit.options import BudgetOptions
from tinygc.fitting.results import FitResult
from tinygc.library.logs import read_log
from tinygc.models.linear import BIAS
from tinygc.noise.components import WANDER

#: names of the sources of the use itself
_NOISE_OF_USE, _DRIFT_OF_USE = f"{GYRO_NOISE}, in use", f"{BIAS_DRIFT}, in use"
#: causes of ``expected_zero`` as sources
ZERO_OF_USE = {
    "switch-on": "bias of another switch-on",
    "temperature": "temperature of the use",
}
#: the same by the spread that is usual of MEMS gyroscopes, where nothing tells that of the unit
USUAL_SWITCH_ON = "bias of another switch-on, as usual"
#: the drift in use less that in the session, of one switch-on
DRIFT_SINCE = f"{BIAS_DRIFT} since the session"
#: word for a sensor that lies still
REST = "rest"
#: the total angle of the attitude's error
TOTAL = "attitude total"


def motion_in(use: BudgetOptions, result: FitResult) -> Motion:
    """The motion.  Raises CalibrationError for a log that cannot be read, or is too short."""
    if use.motion is None:
        return motion_of(result.session.logs, use.seconds)
    if str(use.motion) == REST:
        return at_rest(result.linear.linear, use.seconds)
    path, sensor = use.motion, result.session.config.sensor
    if path.is_dir():
        return motion_of(read_session(path).logs, use.seconds)
    answers: dict[str, Any] = {"gyro_fs_dps": sensor.gyro_fs_dps, "accel_fs_g": sensor.accel_fs_g, "sensor": sensor.model}
    return motion_of(read_log(path, **answers).session().logs, use.seconds)


def sources_in_use(
    result: FitResult, use: BudgetOptions, motion: Motion
) -> tuple[list[Source], dict[str, tuple[float, str]], tuple[str, ...]]:
    """Sources (3, 3) rad^2 of the attitude at a motion's end; the sizes of those that only the use has, in a unit; names of those whose
    size is not this unit's own."""
    model = result.linear.linear
    slope = motion.slope(model)
    found = [source.through(slope) for source in result.sources]
    density, problem = result.problem.noise.angle_random_walk, result.problem
    found.append(Source(_NOISE_OF_USE, *kind_of(GYRO_NOISE, problem), motion.noise_covariance(model, density, 0.0)))
    rps, drift = _drift(result)
    sizes = {_NOISE_OF_USE: (rms_of(problem.noise.gyro) / DEG, "dps/√Hz")}
    sizes |= dict.fromkeys((_DRIFT_OF_USE, DRIFT_SINCE), (rps / DEG_PER_HOUR, "°/h"))
    in_use = motion.noise_covariance(model, np.zeros(3), rps)
    at = next((i for i, source in enumerate(found) if source.name == BIAS_DRIFT), None)
    if use.elapsed_s is None or at is None:
        found.append(replace_covariance(drift, _DRIFT_OF_USE, in_use))
    else:
        middle_s = problem.began_s[-1] + use.elapsed_s + motion.duration_s / 2
        between = drift_between(problem.middle_s, problem.batch.duration_s, middle_s, motion.duration_s, rps)
        shared = between.correlation * _root(found[at].covariance) @ _root(in_use)
        found[at] = replace_covariance(drift, DRIFT_SINCE, found[at].covariance + in_use - shared - shared.T)
    zero = expected_zero(
        result.covariance[BIAS, BIAS],
        switched_on_since=use.elapsed_s is None,
        repeatability=result.repeatability,
        warmer_k=use.warmer_k,
    )
    names = ZERO_OF_USE | ({"switch-on": USUAL_SWITCH_ON} if "switch-on" in zero.assumed else {})
    for cause, name in names.items():
        if cause not in zero.parts:
            continue
        own, spread = Source(name, "B", np.inf, zero.parts[cause]), result.repeatability
        if cause == "switch-on" and spread is not None and np.isfinite(spread.freedom).all():  # as estimated: its freedom is in k
            own = Source(name, "A", float(spread.freedom.min()), np.diag(2 * spread.scatter_rps**2))
        found.append(own.through(slope[:, BIAS]))
        sizes[name] = (float(np.sqrt(np.mean(np.diag(zero.parts[cause])))) / DEG, "dps")
    return found, sizes, tuple(names[cause] for cause in zero.assumed)


def replace_covariance(source: Source, name: str, covariance: np.ndarray) -> Source:
    """A source of the same kind and freedom."""
    return Source(name, source.kind, source.freedom, covariance)


def _root(covariance: np.ndarray) -> np.ndarray:
    """(3, 3): symmetric, R R = covariance."""
    size, axes = np.linalg.eigh(covariance)
    return axes * np.sqrt(np.maximum(size, 0.0)) @ axes.T


def _drift(result: FitResult) -> tuple[float, Source]:
    """Bias instability, rad/s: as estimated from the recording, else as known beforehand; and a source with its kind and freedom."""
    nothing = np.zeros((3, 3))
    if result.noise is not None:
        noise = result.noise.noise
        for s, sigma, component in zip(noise.s, noise.sigma, noise.components, strict=True):
            if component.name == WANDER and s > 0:
                return float(s), Source(COMPONENTS[WANDER], "A" if component.prior is None else "B", freedom_of(s, sigma), nothing)
    known = result.problem.instability
    return known.rps, Source(BIAS_DRIFT, *kind_of(BIAS_DRIFT, result.problem), nothing)


def axes_and_total() -> Iterator[tuple[str, np.ndarray]]:
    """Names of the quantities of an attitude error, and the weights (3,) of the axes' variances in them."""
    yield from zip(("attitude x", "attitude y", "attitude z"), np.eye(3), strict=True)
    yield TOTAL, np.ones(3)
