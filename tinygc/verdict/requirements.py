"""The values of a calibration that may have limits, each as a fact with its uncertainty; ``inference.decide`` decides them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from session.base.numeric import rms_of
from session.base.units import DEG
from session.log.requirements import ATTITUDE, CLOSURE, CLOSURE_RUN, KINDS, SIMPLE, Requirements, Rule
from tinygc.closure.motion import at_rest
from tinygc.estimation.bias import tilt_rms
from tinygc.inference.decide import Conformity, Fact, share_words
from tinygc.inference.solve import Source, coverage_factor, effective_freedom, total
from tinygc.models.linear import NAMES, PARAMETERS, LinearModel

#: var(mean) S / mean^2 of squared tilts: 1 for two normal angles alike; where shared stills are wrong alone, their angles
#: correlate by -1/2 and their squares by 1/4, with two neighbours each
SHARED = 1.5


def rule_words(rule: Rule) -> str:
    """The rule in one sentence."""
    if rule.kind == SIMPLE:
        condition = f" if (upper - lower) / 2 U is at least {rule.least_ratio:g}" if rule.least_ratio is not None else ""
        return f"Simple acceptance: PASS within limits{condition}."
    if rule.risk is not None:
        return f"Guard band: PASS or FAIL where its risk is at most {share_words(rule.risk)}, else not decided."
    return f"Guard band: PASS {rule.guard:g} U within the limits, FAIL {rule.guard:g} U beyond, else not decided."


def closure_measured(angles: np.ndarray, numbers: Sequence[int]) -> Fact:
    """Root mean square tilt of error angles (S, 2 or 3) rad of segments by their numbers, degrees.

    The squared tilts scatter about their mean, each correlated with its neighbour's, with which it shares a still:
    var(mean) = (sum c_i^2 + 2 sum c_i c_i+1) / S (S - 1), u = var^(1/2) / 2 rms.  A few squares that happen to be alike show no scatter:
    var is at least ``SHARED`` / S of the mean's square.  How often such a U holds is in docs/measured.md.
    """
    squares, count = np.sum(angles[:, :2] ** 2, axis=1), len(angles)
    rms = tilt_rms(angles)
    if count < 2 or not rms > 0:
        return Fact("closure of held-out segments, rms of tilt", "°", rms / DEG, key=CLOSURE)
    c = squares / rms**2 - 1
    neighbours = np.diff(np.asarray(numbers)) == 1
    shared = float(np.sum((c[:-1] * c[1:])[neighbours]))
    variance = max((float(c @ c) + 2 * max(shared, 0.0)) / (count * (count - 1)), SHARED / count)
    sigma = np.sqrt(variance) / 2 * rms / DEG
    return Fact("closure of held-out segments, rms of tilt", "°", rms / DEG, sigma, count - 1, key=CLOSURE, relative=True)


def run_measured(file: str, error: np.ndarray, floor: np.ndarray | None) -> Fact:
    """RMSE of a closure run of errors (3,) rad, degrees; floor (3,) rad: one sigma of each from noise alone, None where not known.

    sigma is the root mean square of what the true RMSE departs from it: near the floor it holds that noise adds to the size.
    """
    size, words = rms_of(error) / DEG, f"closure run {file}, RMSE"
    if floor is None or not np.isfinite(size):
        return Fact(words, "°", size, key=CLOSURE_RUN)
    nodes, weights = np.polynomial.hermite_e.hermegauss(16)
    true = np.stack(np.meshgrid(*(e / DEG + f / DEG * nodes for e, f in zip(error, floor, strict=True)), indexing="ij"))
    share = np.einsum("i,j,k->ijk", weights, weights, weights) / np.sum(weights) ** 3
    sigma = float(np.sqrt(np.sum(share * (np.sqrt(np.mean(true**2, axis=0)) - size) ** 2)))
    errors = (tuple((error / DEG).tolist()), tuple((floor / DEG).tolist())) if sigma > 0 else None
    return Fact(words, "°", size, sigma, key=CLOSURE_RUN, errors=errors)


#: beginning of a key -> word of the sensor
SENSORS = {"gyro": "gyroscope", "accel": "accelerometer"}


def sensor_measured(sensor: str, facts: Iterable[Fact]) -> list[Fact]:
    """Errors of a sensor, ``gyro`` or ``accel``, with the keys of their requirements, and in the units of these."""
    found = []
    for q in facts:
        kind = f"{sensor}_{q.word.replace(' ', '_')}"
        unit, more = KINDS[kind][1], 1e3 if q.unit == "dps" else 1.0
        key, word = f"{kind}_{q.component.replace(' ', '_')}_{unit}", f"{SENSORS[sensor]} {q.word}"
        found.append(replace(q, word=word, key=key, unit=unit, value=q.value * more, sigma=q.sigma * more, moved=q.moved * more))
    return found


def attitude_measured(vector: np.ndarray, sources: Sequence[Source], unobserved: tuple[str, ...] = ()) -> Fact:
    """Expanded uncertainty (95 %) of the attitude about its worst axis after a minute at rest, from the calibration alone, degrees.

    k is that of the sources (12, 12) about that axis.  It is not observed where a parameter on which it depends is not.
    """
    model = LinearModel.from_vector(vector)
    slope = at_rest(model).slope(model)
    variances, axes = np.linalg.eigh(slope @ total(sources) @ slope.T)
    worst = axes[:, -1] @ slope
    freedom = effective_freedom([float(each.variance(worst[None])[0]) for each in sources], [each.freedom for each in sources])
    size = coverage_factor(freedom) * np.sqrt(max(float(variances[-1]), 0.0)) / DEG
    observed = not any(np.any(slope[:, NAMES.index(name)]) for name in unobserved if name in NAMES[:PARAMETERS])
    return Fact("attitude after 60 s at rest, expanded uncertainty", "°", size, freedom=freedom, observed=observed, key=ATTITUDE)


def conformity(requirements: Requirements, measured: Iterable[Fact]) -> list[Conformity]:
    """Each measured value that has limits, against them, in the order of the values; a value that is an uncertainty itself has no guard
    band, so that simple acceptance decides it."""
    requested = [(each, Rule() if each.key == ATTITUDE else requirements.rule) for each in measured if each.key in requirements.limits]
    return [Conformity(each, requirements.limits[each.key], rule, requirements.reference) for each, rule in requested]
