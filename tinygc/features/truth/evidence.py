"""Evidence of a session with a truth file: growth of the closure, correlation of neighbours; and the record of its explanation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from session.base import rotation
from session.base.numeric import rms_length, sigma_of
from session.base.units import DEG, NS
from session.detect.findings import Finding
from session.detect.segments import Segment
from session.log.folder import Session
from tinygc.closure import residual
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, RateMap
from tinygc.effects import Effect, movement_of
from tinygc.explanation.claims import AgainstStated, Claim, described  # noqa: F401  # the type of an inherited field, for the API pages
from tinygc.explanation.decision import FitClosure, Naming, cleared
from tinygc.explanation.search import NAMELESS
from tinygc.features.truth.problem import batch_of
from tinygc.features.truth.reading import TruthAlignment
from tinygc.features.truth.segments import TruthEnds, cut_at_truth, find_rests, moments_inside
from tinygc.inference.choose import LEVEL
from tinygc.models.linear import LinearModel
from tinygc.noise.components import SessionNoise
from tinygc.noise.refit import Refit
from tinygc.noise.thinned import conditions
from tinygc.noise.twin import State, Twin

# Evidence of a truth file: growth of the closure, correlation of neighbours, the accelerometer, the rests.

#: segment lengths of the closure's growth, s
LENGTHS_S = (0.5, 1.0, 2.0, 4.0, 8.0)
#: averaging window of the specific force, over which a vehicle's own acceleration averages out: a change of speed below 0.5 m/s has a mean
#: of 5 mg at most
FORCE_WINDOW_S = 20.0


@dataclass(frozen=True, eq=False)
class Rests:
    """The zero-rate level at rest.  seconds at rest; difference (3,) rad/s of the zero at rest from that in motion, with its scatter sigma
    (3,); vibration_g2 at rest and in motion."""

    seconds: float
    difference: np.ndarray
    sigma: np.ndarray
    vibration_g2: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Force:
    """Apparent bias (3,) m/s^2 of the accelerometer against the truth's attitude, with the truth's frame as recorded and rotated as the
    gyro shows; sigma (3,)."""

    bias: np.ndarray
    turned: np.ndarray
    sigma: np.ndarray


def error_angles(batch: Batch, model: RateMap) -> np.ndarray:
    """(S, 3) rad: residual rotation of each segment with a model, about the truth's axes."""
    return residual.error_angles(residual.segment_residuals(batch, model(batch.rate)))


def neighbours(problem: Problem) -> np.ndarray:
    """(P,) indices of used segments whose successor begins where they end."""
    used = problem.used
    return np.array(
        [i for i in range(len(used) - 1) if used[i].log == used[i + 1].log and used[i].stop - 1 == used[i + 1].start], dtype=int
    )


def offset_columns(batch: Batch, model: RateMap) -> np.ndarray:
    """(S, 3) rad/s: derivative of the residual with respect to the truth's clock offset.  Truth stamped s late shows the attitude of s
    earlier."""
    rate = model(batch.rate) - batch.earth
    counts = np.sum(batch.dt > 0, axis=1)
    last = np.take_along_axis(rate, counts[:, None, None], axis=1)[:, 0]
    ends = [np.einsum("sij,sj->si", rotation.matrix(q), w) for q, w in ((batch.start, rate[:, 0]), (batch.end, last))]
    # The truth's attitude is that at t + s: taken back to t, the start turns back by s w_start, and so does the end.
    return ends[1] - ends[0]


def _again(problem: Problem, segment_s: float) -> list[tuple[Segment, TruthEnds]]:
    """Cut the same session at another segment length, within the used segments."""
    session, protocol = problem.session, replace(problem.session.config.protocol, segment_s=segment_s)
    cut = []
    for number, (log, truth) in enumerate(zip(problem.logs, session.reference.truths, strict=True)):
        used = [(s.start, s.stop) for s in problem.used if s.log == number]
        for segment, ends in cut_at_truth(log.samples, truth, session.config.sensor, protocol, log=number):
            inside = any(a <= segment.start and segment.stop <= b for a, b in _joined(used))
            if segment.accepted and inside:
                cut.append((segment, ends))
    return cut


def _joined(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Merge consecutive spans."""
    joined: list[tuple[int, int]] = []
    for a, b in spans:
        if joined and joined[-1][1] - 1 >= a:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return joined


def growth(problem: Problem, model: LinearModel) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (L,) s that the truth's moments allow, and the closure's robust rms (L, 3) rad at each, about the table's axes."""
    lengths, closures = [], []
    for length in LENGTHS_S:
        cut = _again(problem, length)
        # With fewer segments the scatter is not known to 40 %; a tenth in length is a twentieth in the noise's growth.
        if len(cut) < 8 or abs(np.median([s.duration_s for s, _ in cut]) / length - 1) > 0.1:
            continue
        batch = batch_of(problem.logs, [s for s, _ in cut], [ends for _, ends in cut])
        angles = error_angles(batch, model)
        lengths.append(length)
        closures.append(sigma_of(angles - np.median(angles, axis=0)))
    return np.array(lengths), np.array(closures).reshape(-1, 3)


def noises(lengths: np.ndarray, closures: np.ndarray) -> tuple[float, float]:
    """Per angle: sigma rad of a moment of truth, and the random walk rad/sqrt(s), from variance = 2 truth^2 + walk^2 T + drift^2 T^2."""
    if len(lengths) < 3:
        return float("nan"), float("nan")
    from scipy.optimize import nnls

    variance = np.mean(closures**2, axis=1)
    design = np.column_stack([2 * np.ones_like(lengths), lengths, lengths**2])
    solution, _ = nnls(design / variance[:, None], np.ones_like(lengths))
    return float(np.sqrt(solution[0])), float(np.sqrt(solution[1]))


def neighbours_correlation(problem: Problem, angles: np.ndarray) -> float:
    """Correlation of neighbouring segments' errors (S, 3): -1/2 if moments of truth are wrong, 0 if the gyro is noisy, more if its bias
    drifts."""
    at = neighbours(problem)
    if len(at) < 5:
        return float("nan")
    size = np.median(np.linalg.norm(angles, axis=1))
    angles = angles * np.minimum(1, 3 * size / np.maximum(np.linalg.norm(angles, axis=1), 1e-12))[:, None]
    return float(np.sum(angles[at] * angles[at + 1]) / np.sqrt(np.sum(angles[at] ** 2) * np.sum(angles[at + 1] ** 2)))


def force_against_truth(problem: Problem, stands: np.ndarray, turned: np.ndarray) -> Force | None:
    """Compare the mean specific force with the truth's vertical in long windows, over which a vehicle's acceleration averages out. stands,
    turned (3, 3): from the sensor's axes to those of the problem's attitudes, with the truth as recorded and rotated as the gyro shows."""
    rows: list[np.ndarray] = []
    values: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    g = problem.session.config.site.expected_gravity_mps2
    down = np.array([0, 0, g])
    for log, truth in zip(problem.logs, problem.session.reference.truths, strict=True):
        at, q = moments_inside(log.samples, truth)
        force, size = log.samples.accel[at], int(FORCE_WINDOW_S / np.median(np.diff(log.samples.t_ns[at]) * NS))
        turn, has = rotation.matrix(q), np.abs(force).sum(axis=1) > 0
        weight = np.hanning(size) / np.hanning(size).sum() if size > 10 else None
        for start in range(0, len(at) - size, max(size // 2, 1)):
            part = slice(start, start + size)
            if (
                weight is None
                or not has[part].all()
                or log.samples.t_s[at[part.stop - 1]] - log.samples.t_s[at[start]] > 1.1 * FORCE_WINDOW_S
            ):
                continue
            mean = np.einsum("t,tij->ij", weight, turn[part])
            rows.append(mean)
            for out, f in zip(values, (force[part] @ stands.T, force[part] @ turned.T), strict=True):
                out.append(np.einsum("t,tij,tj->i", weight, turn[part], f) + down)
    if len(rows) < 3:
        return None
    # The unknowns are a bias in the body frame, and a tilt of the truth's world frame.
    tilt = np.tile(np.array([[0, g], [-g, 0], [0, 0]]), (len(rows), 1, 1))
    A = np.concatenate([np.array(rows), tilt], axis=2).reshape(-1, 5)
    prior = np.diag([1e-6] * 3 + [1 / (0.5 * DEG) ** 2] * 2) * 0.05**2
    inverse = np.linalg.inv(A.T @ A + prior)
    found = []
    for value in values:
        y = np.array(value).ravel()
        x = inverse @ (A.T @ y)
        left = y - A @ x
        found.append((x[:3], np.sqrt(np.diag(inverse)[:3] * float(left @ left) / max(len(y) - 5, 1))))
    return Force(found[0][0], found[1][0], found[0][1])


def zero_at_rest(problem: Problem, model: LinearModel) -> Rests | None:
    """The zero-rate level at rest compared with that in motion, from the gyro's own readings."""
    rates, weights, quiet, shaken = [], [], [], []
    for log in problem.logs:
        movement = movement_of(log.samples, model(log.samples.gyro), conditions(problem))
        moving = np.ones(len(log.samples), dtype=bool)
        for part, rate in find_rests(log.samples):
            rates.append(np.asarray(model(rate[None]))[0])
            weights.append(part.stop - part.start)
            quiet.append(float(movement.vibration_g2[part].mean()))
            moving[part] = False
        shaken.append(float(np.median(movement.vibration_g2[moving])))
    if not rates:
        return None
    mean = np.average(rates, axis=0, weights=weights)
    scatter = np.std(rates, axis=0, ddof=1) / np.sqrt(len(rates)) if len(rates) > 1 else np.full(3, np.nan)
    seconds = sum(weights) * problem.logs[0].samples.period_s
    return Rests(float(seconds), mean, scatter, (float(np.average(quiet, weights=weights)), float(np.mean(shaken))))


# Claims and result of a session with a truth file.

IMPLAUSIBLE = 2.0  #: times ``Parameter.plausible``: impossible for a gyroscope
SLOW = 0.3  #: correlation of neighbours' errors: three sigmas of 30 segments' three angles, where noise gives 0 or less

#: of the effect of a truth's clock
OFFSET_ID = "timing.truth_offset"
LEFT_EXCESS = 1.5  #: chi-square per freedom: three sigmas of the same 90 angles


@dataclass(frozen=True, eq=False)
class TruthClaim(Claim):
    """A claim with its parameters theta (P,) in SI and their sigma, None for moments, which are stamps."""

    theta: np.ndarray = field(kw_only=True)
    sigma: np.ndarray | None = field(kw_only=True)

    @property
    def implausible(self) -> bool:
        """Whether the effect is larger than any gyroscope has, or a truth's smoothing that would sharpen."""
        if self.effect.id == "reference.truth_smoothing" and self.theta[0] < 0:
            return True
        return bool(np.abs(self.theta).max() > IMPLAUSIBLE * self.effect.parameter.plausible)

    def to_json(self) -> dict:
        """Return the claim's entry with the share of chi-square that it removes."""
        return super().to_json() | {"share": self.share}


def truth_claim(effect: Effect, theta: np.ndarray, sigma: np.ndarray | None, p_value: float, **more: Any) -> TruthClaim:
    """Claim an effect with these parameters; more: further fields of a ``Claim``."""
    parameter = effect.parameter
    values, std = (None if x is None else (x / parameter.si).reshape(parameter.shape).tolist() for x in (theta, sigma))
    parameters = {parameter.name: values, **effect.shape}
    says = effect.describe(theta) if sigma is None else described(effect, theta, np.diag(sigma**2))
    return TruthClaim(effect, parameters, {parameter.name: std}, p_value, says, theta=theta, sigma=sigma, **more)


@dataclass(frozen=True, eq=False)
class TruthExplanation:
    """The explanation of a session with a truth file; angles in rad.

    problem: without the segments at suspect moments. twin: of it. naming: the selected effects. fit: the last, with the truth's clock in
    addition to any delay. claimed: strongest first. refused: effects that would fit, but at a size that no gyroscope has. p_value: of the
    first fit. angles (S, 3), before and after: each used segment's closure about the truth's axes. held_out: the same from fits without
    that segment. excess: chi-square per degree of freedom, against the stated noise. jumps: log and s of wrong moments. lengths_s (L,),
    closure_rad (L, 3): growth. truth_rad per moment and walk_rad per root second, from the growth. gyro_rad per root second: the gyro's own
    walk at its quietest. neighbours: correlation of neighbouring segments' errors, before and after. rests; force; warnings of the
    preparation.
    """

    problem: Problem
    twin: Twin
    naming: Naming
    fit: Refit
    claimed: list[TruthClaim]
    refused: list[TruthClaim]
    p_value: float
    angles: tuple[np.ndarray, np.ndarray]
    held_out: tuple[np.ndarray, np.ndarray]
    excess: tuple[float, float]
    jumps: Sequence[tuple[int, float]] = ()
    lengths_s: np.ndarray = field(default_factory=lambda: np.zeros(0))
    closure_rad: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    truth_rad: float = np.nan
    walk_rad: float = np.nan
    gyro_rad: float = np.nan
    neighbours: tuple[float, float] = (np.nan, np.nan)
    rests: Rests | None = None
    force: Force | None = None
    warnings: Sequence[Finding] = ()

    @property
    def session(self) -> Session:
        """The explained session."""
        return self.problem.session

    @property
    def alignment(self) -> TruthAlignment:
        """Clock and frame of the truth against the gyro."""
        found: TruthAlignment = self.session.reference.alignment
        return found

    @property
    def noise(self) -> SessionNoise:
        """The estimated noise and its components."""
        return self.naming.noise

    @property
    def named(self) -> tuple[Effect, ...]:
        """The effects of the catalogue and the clock in the selected fit."""
        return tuple(claim.effect for claim in self.naming.fit.state.claims if not claim.effect.id.startswith(NAMELESS))

    @property
    def measured(self) -> dict[str, tuple[np.ndarray, np.ndarray] | None]:
        """As of an ``Explanation``: the offset of the truth's clock, None where it is not known."""
        claim = next((claim for claim in self.claimed if claim.effect.id == OFFSET_ID), None)
        value, sigma = self.alignment.offset_s, self.alignment.offset_sigma_s
        if claim is not None and claim.sigma is not None:
            value, sigma = float(claim.theta[0]), float(claim.sigma[0])
        return {OFFSET_ID: (np.array([value]), np.array([[sigma**2]])) if np.isfinite([value, sigma]).all() else None}

    def closure_without(self, state: State) -> float | None:
        """As of an ``Explanation``."""
        angles = FitClosure.of(cleared(self.problem, self.twin, state)).held_out
        return None if angles is None else rms_length(angles)

    @property
    def closure_rms(self) -> tuple[float, float]:
        """rms closure, rad, of all three angles together, before and after."""
        return rms_length(self.angles[0]), rms_length(self.angles[1])

    @property
    def held_out_rms(self) -> tuple[float, float]:
        """rms closure, rad, of held-out segments, before and after."""
        return rms_length(self.held_out[0]), rms_length(self.held_out[1])

    @property
    def words(self) -> tuple[str, str]:
        """The verdict in words, and its style."""
        return self.verdict.replace("_", " "), ""

    @property
    def verdict(self) -> str:
        """The verdict, as defined in docs/explain.md."""
        if not self.claimed:
            return "unexplained" if self.p_value <= LEVEL else "no_mismatch"
        slow = self.neighbours[1] > SLOW or any(claim.effect.id.startswith("unknown") for claim in self.claimed)
        return "partly_explained" if self.excess[1] > LEFT_EXCESS or slow else "explained"
