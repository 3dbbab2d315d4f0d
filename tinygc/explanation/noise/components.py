"""What the covariance of all channels may hold beside white noise: variance components, each with a name and a place.

A component is V_k s_k^2: V_k from the recording's geometry, s_k estimated (``restricted_likelihood.py``).

- ``noise.bias_wander``: the bias wanders as flicker noise; it is known beforehand as well as its source is.
- ``noise.still_rate``: the mean rate of each still errs by itself: rests creep, the bias jumps between them.
- ``noise.reference``: the accelerometer's error in each attitude: it tilts the reference at the ends of two turns, and shows in gravity's
  length.
- ``noise.truth``: in its place between moments of truth: the truth's own error at each, which two neighbours share with opposite signs.
- ``noise.turn``: what each turn errs by beyond all that; equal for all turns.
- ``motion.undersampled``: motion faster than half the data rate; each turn's share is predicted (``undersampling.py``), s is a factor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.common.units import DEG, DEG_PER_HOUR, MG, G
from tinygc.closure.bias_wander import wander_covariance
from tinygc.explanation.noise.restricted_likelihood import Prior
from tinygc.explanation.noise.sparse import Sparse
from tinygc.explanation.noise.undersampling import Undersampling
from tinygc.explanation.twin.twin import Twin

WANDER, STILL_RATE, REFERENCE, TRUTH, TURN, UNDERSAMPLED = (
    "noise.bias_wander",
    "noise.still_rate",
    "noise.reference",
    "noise.truth",
    "noise.turn",
    "motion.undersampled",
)
#: ln: how far a unit's bias instability may be from the typical one of its model, and from the one that was given for it
TYPICAL_SPREAD, GIVEN_SPREAD = 0.5, 0.1
#: an undersampling below this share of the floor's rms is none: a factor of it cannot be told
LEAST_UNDERSAMPLING = 0.1
#: ln: undersampling is predicted within a factor of 1.5 (benchmarks/real_recordings.py); a filter below half the data rate leaves less
FACTOR_SPREAD, FILTERED_SPREAD = 0.4, 1.0
#: two of these spreads: turns that miss by more than this times what fast motion makes miss for another reason
MOST_FACTOR = float(np.exp(2 * FACTOR_SPREAD))
#: ln: a truth's sigma is stated to an order of magnitude: of the public ones, some are 30 times as good, some as bad as they say
TRUTH_SPREAD = 1.5
#: a bias that wanders beside a truth where nothing says by how much: a MEMS gyroscope's, to an order of magnitude
UNKNOWN_WANDER_RPS, UNKNOWN_SPREAD = 10 * DEG_PER_HOUR, 1.5


@dataclass(frozen=True, eq=False)
class Component:
    """One of them.

    name; V (n, n) rad^2, (rad/s)^2 and (m/s^2)^2 of the stacked channels for s = 1, sparse but for what lasts all session; usual: s as
    large as white noise, SI, where a search begins; prior: median and spread (ln) of s where something is known beforehand; unit and si:
    how a person reads s; says.
    """

    name: str
    V: np.ndarray | Sparse
    usual: float
    unit: str
    si: float
    says: str
    prior: Prior | None = None


def components_of(twin: Twin, sizes: tuple[int, int, int], missed: Undersampling) -> list[Component]:
    """Of a twin whose channels have sizes (S d, 3 Q, Q)."""
    floor = float(np.sqrt(np.mean(replace(twin.problem.floor, tilt_excess=1.0).sigma[twin.batch.known] ** 2)))
    reference = _reference(twin, sizes) if twin.stills else _truth(twin, sizes)
    found = [_wander(twin, sizes), _still_rate(twin, sizes), reference, _turn(twin, sizes, floor)]
    if missed.rms_rad / np.sqrt(2) > LEAST_UNDERSAMPLING * floor:
        found.append(_undersampled(twin, sizes, missed))
    return [c for c in found if np.any(c.V.values if isinstance(c.V, Sparse) else c.V)]


def _wander(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    s, q = len(twin.segments), len(twin.stills)
    starts = twin.problem.began_s
    segment_s = [starts[segment.log] + segment.start_s + segment.duration_s / 2 for segment in twin.segments]
    still_s = [starts[log] + still.start_s + still.duration_s / 2 for log, still in twin.stills]
    spans = [segment.duration_s for segment in twin.segments] + [still.duration_s for _, still in twin.stills]
    wander = wander_covariance(np.array(segment_s + still_s), np.array(spans), instability_rps=1.0)
    # A bias error turns a segment's end by its mean attitude times its duration, and shows in a still as it is.
    sensitivity = twin.sensitivity(twin.start(), twin.rates(twin.start()))
    response = np.concatenate([sensitivity.sum(axis=1).reshape(sizes[0], 3), np.tile(np.eye(3), (q, 1))])
    owner = np.concatenate([np.repeat(np.arange(s), twin.batch.angles), s + np.repeat(np.arange(q), 3)])
    V = np.zeros((sum(sizes), sum(sizes)))
    V[: len(owner), : len(owner)] = (response @ response.T) * wander[np.ix_(owner, owner)]
    known = twin.problem.instability
    white = float(np.median(twin.problem.still_rates.sigma)) if q else 2 * UNKNOWN_WANDER_RPS
    spread = TYPICAL_SPREAD if known.source.startswith("typical") else GIVEN_SPREAD
    prior = Prior(known.rps, spread) if known.rps > 0 and not known.of_unit else None
    if not q and prior is None:  # the rates at rest that an estimate is from are no rows of such a twin
        prior = Prior(known.rps, TYPICAL_SPREAD) if known.rps > 0 else Prior(UNKNOWN_WANDER_RPS, UNKNOWN_SPREAD)
    return Component(WANDER, V, known.rps or white / 2, "°/h", DEG_PER_HOUR, "the bias wanders", prior)


def _still_rate(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    diagonal = np.zeros(sum(sizes))
    diagonal[sizes[0] : sizes[0] + sizes[1]] = 1.0
    white = float(np.median(twin.problem.still_rates.sigma)) if len(twin.stills) else DEG
    return Component(STILL_RATE, Sparse.of_diagonal(diagonal), white, "dps", DEG, "the mean rate of each still errs by itself")


def _reference(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    d = twin.batch.angles
    V = np.zeros((sum(sizes), sum(sizes)))
    ends = np.zeros((len(twin.segments), len(twin.stills)))
    ends[np.arange(len(ends)), twin.first] += 1
    ends[np.arange(len(ends)), twin.last] -= 1
    shared = ends @ ends.T / G**2
    tilt = np.diag([1.0, 1.0, 0.0])[:d, :d]
    V[: sizes[0], : sizes[0]] = np.kron(shared, tilt)
    length = slice(sizes[0] + sizes[1], sum(sizes))
    V[length, length] = np.eye(sizes[2])
    return Component(REFERENCE, Sparse.of(V), 0.1 * MG, "mg", MG, "the accelerometer errs with attitude, beyond its calibration")


def _truth(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    """Of each moment of truth; a segment that begins at the sample where another ends shares its moment."""
    sigma = twin.problem.session.config.protocol.truth_sigma_deg * DEG
    ends: dict[tuple[int, int], np.ndarray] = {}
    for number, s in enumerate(twin.segments):
        for at, sign in ((s.start, -1.0), (s.stop - 1, 1.0)):
            ends.setdefault((s.log, at), np.zeros(len(twin.segments)))[number] += sign
    moments = np.array(list(ends.values()))
    V = np.kron(moments.T @ moments, np.eye(twin.batch.angles))
    return Component(TRUTH, Sparse.of(V), sigma, "deg", DEG, "each moment of truth errs by itself", Prior(sigma, TRUTH_SPREAD))


def _turn(twin: Twin, sizes: tuple[int, int, int], floor: float) -> Component:
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = 1.0
    if twin.batch.turns is not None:
        # A known angle has its stop's sigma: what an accelerometer or a hand does to the tilt at the ends is none of its.
        diagonal[2 : sizes[0] : twin.batch.angles] = 0.0
    return Component(TURN, Sparse.of_diagonal(diagonal), floor, "deg", DEG, "each turn errs by itself")


def _undersampled(twin: Twin, sizes: tuple[int, int, int], missed: Undersampling) -> Component:
    d = twin.batch.angles
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = np.repeat(missed.predicted_rad**2, d)
    prior = Prior(1.0, FILTERED_SPREAD, FACTOR_SPREAD)
    says = "motion is faster than half the data rate"
    return Component(UNDERSAMPLED, Sparse.of_diagonal(diagonal), 1.0, "times what is predicted", 1.0, says, prior)
