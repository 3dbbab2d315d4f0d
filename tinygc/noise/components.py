"""Noise beyond white: the variance components of a session, estimated by restricted maximum likelihood (``inference.noise``)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from session.base import rotation
from session.base.numeric import rms_of, running_sum
from session.base.texts import significant
from session.base.units import DEG, DEG_PER_HOUR, MG, G
from session.detect.check_time import LEAST_EXPONENT, STEPS, capped, thinning_exponent, thinning_weights
from tinygc.closure import residual
from tinygc.inference.choose import chi_square_above
from tinygc.inference.noise import SCORING_STEPS, Banded, Prior, Sparse, Striped, Unit, estimate, wander_covariance
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener

# Motion faster than half the data rate: its aliasing error in the closure, predicted from the recording alone.
#
# With every k-th reading alone the error is larger: it is the aliased part of the spectrum, and for a spectrum that falls as a power of
# frequency it grows as a power p of the step.  The error of all readings is contained in that of every k-th, so
#
#     |end(every k-th) - end(all)|^2 = (k^2p - 1) E^2,
#
# E is the closure error of all readings.  p is common to the recording, E belongs to each turn.  A sensor that filters below half its data
# rate has less aliasing than this law predicts; a factor estimated from the closure accounts for that.  Noise or false readings grow with
# p = 0.5 and are not motion.

#: the exponent without aliasing
SMOOTH = 2.0


@dataclass(frozen=True, eq=False)
class Undersampling:
    """Predicted aliasing error of the closure.

    predicted_rad (S,): rms per angle of each turn at the recording's data rate; exponent; missed_rad (K,): rms over all turns and both
    angles of the difference between every k-th and all readings, k from ``STEPS``; rate_hz of the recording.
    """

    predicted_rad: np.ndarray
    exponent: float
    missed_rad: np.ndarray
    rate_hz: float

    @property
    def rms_rad(self) -> float:
        """Predicted rms tilt error over all turns, both angles together."""
        return float(np.sqrt(2 * np.mean(self.predicted_rad**2)))

    def rate_needed_hz(self, missed_rad: float, allowed_rad: float) -> float:
        """Data rate that reduces the rms tilt error to ``allowed_rad`` from ``missed_rad`` at the recording's rate."""
        return float(self.rate_hz * max(missed_rad / allowed_rad, 1e-12) ** (1 / self.exponent))


def undersampling(twin: Twin) -> Undersampling:
    """Predict the aliasing error of a session's used segments, by the first linear fit.

    To first order the error of an end is the sum of the rate errors in the table frame (``Twin.sensitivity``).  So the attitudes are
    computed once, and every k-th reading takes a plain sum: within 1 % of its integration.
    """
    rate, at_s = _turned(twin)
    whole = _sum(rate, at_s)
    walk = np.array([np.mean(twin.problem.logs[s.log].noise.angle_random_walk ** 2) for s in twin.segments]) * twin.batch.duration_s
    missed = []
    for step in STEPS:
        kept = [_every(rate.shape[1], step, offset) for offset in range(step)]
        apart = [np.mean((_sum(rate[:, rows], at_s[:, rows]) - whole) ** 2, axis=-1) for rows in kept]
        # White noise is decimated as well: its variance grows with the step.
        missed.append(np.maximum(np.mean(apart, axis=0) - (step - 1) * walk, 0.0))
    square = np.array(missed)
    grows = thinning_exponent(square)
    exponent = grows or SMOOTH
    predicted = np.mean(square / thinning_weights(exponent)[:, None], axis=0) * (grows >= LEAST_EXPONENT)
    period = float(np.median([log.samples.period_s for log in twin.problem.logs]))
    return Undersampling(capped(np.sqrt(predicted)), exponent, np.sqrt(np.mean(square, axis=1)), 1 / period)


def _turned(twin: Twin) -> tuple[np.ndarray, np.ndarray]:
    """Rates (S, T, 2) rad/s about the table's horizontal axes, and times (S, T) s from each segment's start; padding has no duration."""
    batch = twin.batch
    rate = twin.problem.first(batch.rate)
    level = np.einsum("stij,stj->sti", rotation.matrix(residual.attitudes(batch, rate))[..., :2, :], rate - batch.earth)
    at_s = running_sum(batch.dt, axis=1)
    counts = np.array([segment.stop - segment.start for segment in twin.segments])
    return np.where(np.arange(rate.shape[1])[None, :, None] < counts[:, None, None], level, 0.0), at_s


def _every(count: int, step: int, offset: int) -> np.ndarray:
    """Rows of every ``step``-th reading from ``offset``, and of both ends, which are at rest."""
    return np.unique(np.concatenate([[0], np.arange(offset, count, step), [count - 1]]))


def _sum(rate: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Integrate to (S, 2) rad by the trapezoidal rule."""
    return np.einsum("st,sti->si", np.diff(at_s, axis=1), rate[:, 1:] + rate[:, :-1]) / 2


# The variance components of all channels beyond white noise.
#
# A component is V_k s_k^2: V_k follows from the recording's geometry, s_k is estimated (``estimate``).
#
# - ``noise.bias_wander``: bias drift as flicker noise, with a prior from the source of the bias instability.
# - ``noise.still_rate``: an independent error of each still's mean rate: the body creeps, the bias jumps between stills.
# - ``noise.reference``: the accelerometer's error in each attitude: it tilts the reference at the ends of two turns and changes gravity's
#   length.
#   A further reference has components of its own in its place.
# - ``noise.turn``: a further independent error of each turn, of equal size for all turns.
# - ``motion.undersampled``: motion faster than half the data rate; each turn's share is predicted (``undersampling``), s is a factor.

WANDER, STILL_RATE, REFERENCE, TURN, UNDERSAMPLED = (
    "noise.bias_wander",
    "noise.still_rate",
    "noise.reference",
    "noise.turn",
    "motion.undersampled",
)
#: ln: spread of a unit's bias instability about the typical one of its model (stills of 19 recordings of eleven MPU-9150: 0.85, with the
#: error of each), and about the given one, or the one of another day
TYPICAL_SPREAD, GIVEN_SPREAD = 0.8, 0.1
#: s: the bias' drift within turns is summed over pieces of half the shortest correlation time, or longer ones where the turns together
#: would have more pieces than this
PIECE_S, MOST_PIECES = 0.25, 2000
#: undersampling below this share of the floor's rms is ignored, since its factor cannot be estimated
LEAST_UNDERSAMPLING = 0.1
#: ln: spread of the prediction, a factor of 1.5 (benchmarks/real_recordings.py); downwards, for a filter below half the data rate
FACTOR_SPREAD, FILTERED_SPREAD = 0.4, 1.0
#: two of these spreads: a larger factor on the prediction has a cause other than fast motion
MOST_FACTOR = float(np.exp(2 * FACTOR_SPREAD))
#: bias instability without another source: a MEMS gyroscope's, to an order of magnitude
_UNKNOWN_WANDER_RPS, _UNKNOWN_SPREAD = 10 * DEG_PER_HOUR, 1.5


@dataclass(frozen=True, eq=False)
class Component:
    """A variance component.

    name; V (n, n) rad^2, (rad/s)^2 and (m/s^2)^2 of the stacked channels for s = 1, without its zeros and its upper half; usual: s as
    large as white noise, SI, where a search starts; prior: of s, if any; unit and si: display unit of s, its SI value.
    """

    name: str
    V: Unit
    usual: float
    unit: str
    si: float
    description: str
    prior: Prior | None = None

    def add_to(self, total: np.ndarray, s: float) -> None:
        """Add the component of size s to a covariance (n, n), in place."""
        if isinstance(self.V, np.ndarray):
            total += s**2 * self.V
        else:
            self.V.add_to(total, s**2)


def components_of(twin: Twin, sizes: tuple[int, int, int], missed: Undersampling) -> list[Component]:
    """Variance components of a twin whose channels have sizes (S d, 3 Q, Q)."""
    white = replace(twin.problem.floor, tilt_excess=1.0, own=twin.problem.floor.white, wider=None)
    floor = rms_of(white.sigma[twin.batch.known])
    reference = twin.problem.session.reference
    references = [_reference(twin, sizes)] if reference is None else reference.components(twin, sizes)
    found = [_wander(twin, sizes), _still_rate(twin, sizes), *references, _turn(twin, sizes, floor)]
    if missed.rms_rad / np.sqrt(2) > LEAST_UNDERSAMPLING * floor:
        d = twin.batch.angles
        diagonal = np.zeros(sum(sizes))
        diagonal[: sizes[0]] = np.repeat(missed.predicted_rad**2, d)
        prior = Prior(1.0, FILTERED_SPREAD, FACTOR_SPREAD)
        words = "motion faster than half the data rate"
        found.append(Component(UNDERSAMPLED, Sparse.of_diagonal(diagonal), 1.0, "times what is predicted", 1.0, words, prior))
    return [c for c in found if not isinstance(c.V, Sparse) or c.V.values.any()]


def _wander(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    q, d, starts = len(twin.stills), twin.batch.angles, twin.problem.began_s
    # The bias at each moment rotates a segment's end by the attitude then, and adds directly to a still's rate.
    turns = wander_pieces(twin.sensitivity(twin.start(), twin.rates(twin.start())), twin.batch.dt)
    counts = [*map(len, turns), *[1] * q]
    began_s = [starts[s.log] + s.start_s for s in twin.segments] + [starts[log] + still.start_s for log, still in twin.stills]
    length_s = [segment.duration_s for segment in twin.segments] + [still.duration_s for _, still in twin.stills]
    edges = np.cumsum([0, *counts])
    spans = np.repeat(np.divide(length_s, counts), counts)
    middle_s = np.repeat(began_s, counts) + (np.arange(edges[-1]) - np.repeat(edges[:-1], counts) + 0.5) * spans
    wander = wander_covariance(middle_s, spans, instability_rps=1.0)
    rows = sizes[0] + sizes[1]
    V = np.zeros((rows, rows))
    for axis in range(3):
        parts = [(slice(i * d, i * d + d), slice(*edges[i : i + 2]), turn[:, :, axis].T) for i, turn in enumerate(turns)]
        parts += [
            (slice(k, k + 1), slice(*edges[i : i + 2]), np.ones((1, 1))) for i, k in enumerate(range(sizes[0] + axis, rows, 3), len(turns))
        ]
        left = np.zeros((rows, len(wander)))
        for own, pieces, response in parts:
            left[own] = response @ wander[pieces]
        for own, pieces, response in parts:
            V[:, own] += left[:, pieces] @ response.T
    known = twin.problem.instability
    white = float(np.median(twin.problem.still_rates.sigma)) if q else 2 * _UNKNOWN_WANDER_RPS
    # Stills hardly separate a drift from errors of their own: without a further source, what such gyroscopes have decides.
    prior = Prior(_UNKNOWN_WANDER_RPS, _UNKNOWN_SPREAD)
    if known.rps > 0 and not (known.of_unit and q):
        spread = TYPICAL_SPREAD if known.of_unit or known.source.startswith("typical") else GIVEN_SPREAD
        if known.sigma_rps is not None and not known.of_unit:  # measured at rest, on another day
            spread = float(np.hypot(GIVEN_SPREAD, known.sigma_rps / known.rps))
        prior = Prior(known.rps, spread)
    return Component(WANDER, Striped.of(V, sum(sizes)), known.rps or white / 2, "°/h", DEG_PER_HOUR, "bias drift", prior)


def wander_pieces(sensitivity: np.ndarray, dt: np.ndarray) -> list[np.ndarray]:
    """Rotation (P, d, 3) s of the ends of segments with sensitivity (S, T, d, 3) s by a bias of 1 rad/s in each of their P equal pieces."""
    found, weights = [], rotation.sample_weights(dt)
    piece_s = max(PIECE_S, float(weights.sum()) / MOST_PIECES)
    for each, weight in zip(sensitivity, weights, strict=True):
        count = max(1, int(np.ceil(weight.sum() / piece_s * (1 - 1e-9))))  # 5 s are 20 pieces, however the sum is rounded
        piece = np.minimum((np.cumsum(weight) - weight / 2) * (count / weight.sum()), count - 1).astype(int)
        summed = np.zeros((count, *each.shape[1:]))
        np.add.at(summed, piece, each)
        found.append(summed)
    return found


def _still_rate(twin: Twin, sizes: tuple[int, int, int]) -> Component:
    diagonal = np.zeros(sum(sizes))
    diagonal[sizes[0] : sizes[0] + sizes[1]] = 1.0
    white = float(np.median(twin.problem.still_rates.sigma)) if len(twin.stills) else DEG
    return Component(STILL_RATE, Sparse.of_diagonal(diagonal), white, "dps", DEG, "mean rate of each still")


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
    return Component(REFERENCE, Sparse.of(V), 0.1 * MG, "mg", MG, "accelerometer error with attitude")


def _turn(twin: Twin, sizes: tuple[int, int, int], floor: float) -> Component:
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = 1.0
    if twin.batch.turns is not None:
        # A known angle has its stop's sigma: errors of the tilt due to accelerometer or hand do not apply to it.
        diagonal[2 : sizes[0] : twin.batch.angles] = 0.0
    return Component(TURN, Sparse.of_diagonal(diagonal), floor, "deg", DEG, "each turn")


# The noise of one session: its components with sizes, and their covariance.

#: turns in a block, whose covariance is inverted at once (benchmarks/whole_process.py)
BLOCK = 60
#: spreads of the bias instability's prior beyond which its size is unusual
UNUSUAL = 3.0


@dataclass(frozen=True, eq=False)
class SessionNoise:
    """Components with s and sigma (K,) in SI; value: -2 log of the restricted likelihood; missed: the predicted undersampling."""

    components: tuple[Component, ...]
    blocks: list[np.ndarray]
    missed: Undersampling
    s: np.ndarray
    sigma: np.ndarray
    value: float = float("nan")

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) covariance in addition to white noise."""
        count = sum(len(block) for block in self.blocks)  # every row is in one block
        total = np.zeros((count, count))
        for s, component in zip(self.s, self.components, strict=True):
            if s > 0:
                component.add_to(total, s)
        return total

    def size(self, name: str) -> float:
        """Size s of a component, SI; 0 if it is absent."""
        return next((float(s) for s, c in zip(self.s, self.components, strict=True) if c.name == name), 0.0)

    @property
    def beyond(self) -> list[tuple[Component, float, float]]:
        """The components larger than such a sensor and its rests have, each with its size and the largest usual one, SI: errors of turns or
        stills above white noise, undersampling above its prediction, a bias drift far above its prior."""
        most = [MOST_FACTOR if c.name == UNDERSAMPLED else c.usual if c.name in (TURN, STILL_RATE) else np.inf for c in self.components]
        for number, component in enumerate(self.components):
            if component.name == WANDER:
                assert component.prior is not None
                most[number] = component.prior.median * np.exp(UNUSUAL * component.prior.spread)
        return [(c, float(s), float(m)) for c, s, m in zip(self.components, self.s, most, strict=True) if s > m]

    @property
    def beyond_words(self) -> str:
        """The components that are larger than such a sensor has, with what it has, in one line."""
        found = ((c, significant(s / c.si, 2), significant(most / c.si, 2)) for c, s, most in self.beyond)
        return "; ".join(f"{c.description} {size} {c.unit} (usual {usual})" for c, size, usual in found)

    @property
    def unusual(self) -> bool:
        """Whether some component is larger than such a sensor has."""
        return bool(self.beyond)

    def unusual_p(self, white: np.ndarray | Banded, r: np.ndarray, J: np.ndarray) -> float:
        """P-value of unusual noise; 1 if it is not unusual.  white (n, n), r (n,), J (n, p): those that gave these sizes.

        It is the likelihood ratio against the noise that such a sensor may have: each large component as large as usual at most.  All of
        them together, and those that grow for it: held alone, one gives way where another takes its place.  Under the hypothesis each
        estimate is on its edge half the time (Self & Liang 1987).
        """
        own, held, cost = self, 0, 0.0
        while own.beyond:
            white = white.dense() if isinstance(white, Banded) else white.copy()
            for component, _, most in own.beyond:
                component.add_to(white, most)
                cost += 0.0 if component.prior is None else component.prior.apart(most)[0] ** 2
                own, held = own.without(component.name), held + 1
            own = own.estimated(white, r, J, own.s)
        if not held:
            return 1.0
        gain = max(own.value + cost - self.value, 0.0)
        ways = [math.comb(held, k) / 2**held for k in range(1, held + 1)]
        return sum(way * chi_square_above(gain, k) for k, way in enumerate(ways, start=1))

    def to_json(self) -> list[dict]:
        """``noise.components`` of explain.json and fit.json."""
        return [
            {
                "name": c.name,
                "size": float(s / c.si),
                "sigma": float(sigma / c.si) if np.isfinite(sigma) else None,
                "unit": c.unit,
                "description": c.description,
            }
            for s, sigma, c in zip(self.s, self.sigma, self.components, strict=True)
        ]

    @property
    def words(self) -> str:
        """The components present, in one line."""
        found = [f"{c.description} {significant(s / c.si, 2)} {c.unit}" for s, c in zip(self.s, self.components, strict=True) if s > 0]
        return "; ".join(found) or "none"

    def without(self, name: str) -> SessionNoise:
        """Remove a component."""
        kept = [i for i, c in enumerate(self.components) if c.name != name]
        return replace(self, components=tuple(self.components[i] for i in kept), s=self.s[kept], sigma=self.sigma[kept])

    def estimated(
        self,
        white: np.ndarray | Banded,
        r: np.ndarray,
        J: np.ndarray,
        start: np.ndarray | None = None,
        with_sigma: bool = False,
        steps: int = SCORING_STEPS,
    ) -> SessionNoise:
        """Re-estimate the components, with white noise of covariance (n, n), with columns J (n, p), stacked, in units of their priors'
        sigmas, and residuals r (n,), stacked.

        An effect that explains part of a component reduces it.  start: s (K,) at which the search starts; with_sigma: whether to compute
        the sigmas.
        """
        if not self.components:
            return self
        found = estimate(
            r,
            J,
            white,
            [c.V for c in self.components],
            np.array([c.usual for c in self.components]),
            [c.prior for c in self.components],
            self.blocks,
            start,
            with_sigma,
            steps,
        )
        return replace(self, **vars(found))


#: steps of an estimate with one more effect, which starts from the noise without it
_GUESS_STEPS = 7


def noise_with(
    noise: SessionNoise,
    whiten: Callable[[np.ndarray], np.ndarray],
    white: np.ndarray | Banded,
    r: np.ndarray,
    J: np.ndarray,
    columns: np.ndarray,
    start: np.ndarray,
) -> SessionNoise:
    """Re-estimate the noise with an effect, by linear columns (n, P), with J (n, p), both stacked and in units of their priors' sigmas.

    The sigma of the effect's prior becomes the rms of its own parameters.  whiten: by the noise without it, of sizes ``start``; white
    (n, n): white noise.
    """
    both = np.concatenate([J, columns], axis=1)
    own = slice(J.shape[1], both.shape[1])

    def optimum() -> np.ndarray:
        white_J = whiten(both)
        return -np.linalg.solve(white_J.T @ white_J + np.eye(len(both.T)), white_J.T @ whiten(r))

    if columns.shape[1]:
        both[:, own] *= np.sqrt(np.mean(optimum()[own] ** 2))
    return noise.estimated(white, r + both @ optimum(), both, start, steps=_GUESS_STEPS)


#: of each twin that is in use: ``explain`` needs it after ``fit``
_FIRST_NOISE: WeakKeyDictionary[Twin, SessionNoise] = WeakKeyDictionary()


def first_noise(twin: Twin, whiten: Whitener, missed: Undersampling | None = None) -> SessionNoise:
    """Noise before any fit: the bias instability alone.  missed: undersampling, if better known than from this twin."""
    if missed is None and twin in _FIRST_NOISE:
        return _FIRST_NOISE[twin]
    own = missed or undersampling(twin)
    components = tuple(components_of(twin, whiten.sizes, own))
    s = np.array([c.prior.median if c.name == WANDER and c.prior else 0.0 for c in components])
    found = SessionNoise(components, _blocks(twin, whiten), own, s, np.zeros(len(s)))
    if missed is None:
        _FIRST_NOISE[twin] = found
    return found


def _blocks(twin: Twin, whiten: Whitener) -> list[np.ndarray]:
    """Rows of blocks of neighbouring turns with the stills before them; a session of up to ``BLOCK`` turns is one block."""
    count, d = len(twin.segments), twin.batch.angles
    parts = max(1, -(-count // BLOCK))
    edges = np.linspace(0, count, parts + 1).round().astype(int)
    # Each still belongs to the turn that begins at or after it.
    owner = np.searchsorted(twin.first, np.arange(len(twin.stills)))
    found = []
    for start, stop in pairwise(edges):
        last = stop == count
        stills = np.flatnonzero((owner >= start) & ((owner < stop) | last))
        found.append(
            np.concatenate(
                [
                    np.arange(start * d, stop * d),
                    whiten.sizes[0] + (stills[:, None] * 3 + np.arange(3)).ravel(),
                    whiten.sizes[0] + whiten.sizes[1] + stills,
                ]
            )
        )
    return found


def known_whitener(twin: Twin) -> Whitener:
    """Whitener with a twin's noise before any fit."""
    whiten = Whitener(twin)
    return whiten.with_more(first_noise(twin, whiten).covariance)


# A cache of a twin's whiteners for the noise of each hypothesis.

#: whiteners kept: for a search's current hypothesis, and the candidate or the noise before any fit
HELD = 2


class Whiteners:
    """Cache of whiteners by noise.  A factor has (n, n) elements, 46 MB for 400 turns, and each hypothesis has its own noise; those not
    used recently are factored again, with identical results."""

    def __init__(self, twin: Twin):
        #: white noise alone
        self.white = Whitener(twin)
        self._held: dict[SessionNoise, Whitener] = {}

    def __len__(self) -> int:
        return len(self._held)

    def of(self, noise: SessionNoise, keep: bool = True) -> Whitener:
        """Whitener for white noise and this noise; keep: whether it is needed again."""
        found = self._held.pop(noise, None)
        if found is None:
            while len(self._held) >= HELD:  # drop the least recently used before computing another
                del self._held[next(iter(self._held))]
            found = self.white.with_more(noise.covariance)
        if keep:
            self._held[noise] = found
        return found
