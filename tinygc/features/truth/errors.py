"""Errors of a truth file: the effects that are its own, its variance components, and its wrong moments, which are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import fdtrc, gammaincinv

from session.base import rotation
from session.base.numeric import median_length, sigma_of
from session.base.texts import significant
from session.base.units import DEG
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.effects import AppliedEffect, Effect, Movement, Parameter, largest
from tinygc.effects.signals import angular_acceleration
from tinygc.explanation.claims import claim_of
from tinygc.explanation.data_repair import RepairedProblem
from tinygc.features.truth.reading import FOUND
from tinygc.inference.noise import Prior, Sparse
from tinygc.noise.components import Component
from tinygc.noise.twin import Twin

# Errors of a truth file, in addition to the catalogue, which describes sensors on a table.


def _nothing(movement: Movement) -> np.ndarray:
    """Zero columns: these effects change the reference, not the rate."""
    return np.zeros((*movement.rate.shape, 1))


OFFSET = Effect(
    id="timing.truth_offset",
    equation="the truth's attitude at t is the one that the gyro's clock has at t + seconds",
    parameter=Parameter("seconds", (), "s", plausible=0.1),
    observable_in=("timing",),
    kind="reference",
    columns=_nothing,
    describe=lambda theta: (
        f"the truth's stamps are {1e3 * abs(theta[0]):.2f} ms {'early' if theta[0] > 0 else 'late'} against the gyro's: shift one of them "
        f"(truth.offset_s = {theta[0]:.6f}); a delay that all axes of the gyro share looks the same"
    ),
    discriminating_motion="turn fast and stop: the truth must stop with the gyro",
)
#: s to either side of a moment over which its angular acceleration is taken: a truth's smoothing is as wide, and vibration faster
SMOOTHED_S = 0.02
SMOOTHING = Effect(
    id="reference.truth_smoothing",
    equation="the truth's attitude is a mean over a while around t: it is wrong by half the variance of that while times dω/dt",
    parameter=Parameter("variance_ms2", (), "ms²", 1e-6, plausible=0.05**2),
    observable_in=("reference",),
    kind="reference",
    columns=_nothing,
    describe=lambda theta: (
        f"the truth is smoothed, as by a mean over {1e3 * np.sqrt(12 * max(theta[0], 0.0)):.0f} ms: it rounds off what the gyro shows "
        "where the rate changes; a gyro that reads ahead of its own motion would look the same, and no gyro does"
    ),
    discriminating_motion="turn fast and stop: the truth must stop as sharply as the gyro; read the truth unfiltered",
)
FRAME = Effect(
    id="reference.truth_frame",
    equation="the truth's body frame is the sensor's, turned by a constant rotation",
    parameter=Parameter("rotation_deg", (3,), "deg", DEG, plausible=10 * DEG),
    observable_in=("reference",),
    kind="reference",
    columns=_nothing,
    describe=lambda theta: (
        f"the truth's body frame is turned by {np.linalg.norm(theta) / DEG:.1f} deg against the sensor's, "
        f"most about {'xyz'[int(np.argmax(np.abs(theta)))]} ({largest(theta) / DEG:+.1f} deg): "
        "gyro and accelerometer ask for the same rotation"
    ),
    discriminating_motion="mount the sensor in the truth's body another way: a frame's error goes with the body, a gyro's misalignment "
    "with the gyro",
)


MOUNTED = replace(
    FRAME,
    describe=lambda theta: (
        f"the truth's body is turned by {np.linalg.norm(theta) / DEG:.1f} deg against the sensor's axes, more than a gyro's misalignment: "
        "it is taken off, and what is common to the gyro's axes of misalignment with it"
    ),
)


def wander(knots_s: np.ndarray) -> Effect:
    """A slowly drifting bias: linear between knots, with three values at each knot after the first."""

    def basis(movement: Movement) -> np.ndarray:
        return np.stack([np.interp(movement.t_s, knots_s, hat) for hat in np.eye(len(knots_s))[1:]], axis=1)

    def columns(movement: Movement) -> np.ndarray:
        return np.einsum("nk,ij->nikj", basis(movement), np.eye(3)).reshape(len(movement.t_s), 3, -1)

    def describe(theta: np.ndarray) -> str:
        at = np.concatenate([np.zeros((1, 3)), theta.reshape(-1, 3)])
        span = np.ptp(at, axis=0)
        return f"the gyro's zero-rate offset wanders by {span.max() / DEG:.3f} dps (most on {'xyz'[int(np.argmax(span))]}) over the run"

    return Effect(
        id="unknown.slow_bias",
        equation="ω += b(t), slow; straight between knots",
        parameter=Parameter("dps_at_knots", (len(knots_s) - 1, 3), "dps", DEG, plausible=DEG),
        observable_in=("turn",),
        columns=columns,
        basis=None if len(knots_s) == 4 else basis,  # a parameter (3, 3) would have a row for each axis
        describe=describe,
        inputs=("time",),
        discriminating_motion="record temperature, and the supply; repeat after a long warm-up",
        shape={"knots_s": [round(float(knot), 1) for knot in knots_s]},
    )


#: id of the wrong moments, which are left out before the fit
WRONG_MOMENTS = "reference.truth_jump"


def wrong_moments(count: int) -> Effect:
    """An effect of ``count`` wrong moments; its parameter is their times, s of the session."""
    return Effect(
        id=WRONG_MOMENTS,
        equation="single attitudes of the truth are wrong: the segment before misses by what the segment after makes good",
        parameter=Parameter("at_s", (count,), "s"),
        observable_in=("reference",),
        kind="register",
        columns=_nothing,
        describe=lambda theta: f"{len(theta)} moments of truth are wrong by more than chance allows: leave them out",
        discriminating_motion="look at the truth's own residuals there",
    )


#: what an outage looks like where the gyro may be wrong instead
LIKE_AN_OUTAGE = ("gyro.bias_step", "data.glitches")


def outages(spans: int, size_dps: list[float], sure: bool) -> Effect:
    """An effect of outages of the truth; its parameter is the (spans, 2) times from and to, s of the session.  sure: whether it is the
    truth that is wrong there."""

    def describe(theta: np.ndarray) -> str:
        where = ", ".join(f"{begin:.1f} to {end:.1f} s" for begin, end in theta.reshape(-1, 2))
        apart = f"from {where} truth and gyro part by {significant(max(size_dps))} dps rms, far beyond what the rest of the recording shows"
        whose = "the truth has lost the body" if sure else "the truth or the gyro is wrong there, and this recording does not show which"
        return f"{apart}: {whose}; its moments there are left out"

    return Effect(
        id="reference.truth_outage",
        equation="for a while the truth's attitudes are not the body's",
        parameter=Parameter("spans_s", (spans, 2), "s"),
        observable_in=("reference",),
        kind="register",
        columns=_nothing,
        describe=describe,
        discriminating_motion="look at the truth's own residuals there; repeat the movement, in better sight of the cameras",
        shape={"size_dps": size_dps},
    )


# The variance components of a truth's errors, in place of the accelerometer's.
#
# - ``noise.truth``: the truth's error at each moment, shared by two neighbours with opposite signs.
# - ``noise.truth_rate``, ``noise.truth_acceleration``: further errors of each moment, in proportion to the rate and the angular
#   acceleration there: jitter of the truth's stamps, blur, markers that give way.
# - ``noise.turned``: an error of each turn whose variance is in proportion to the angle that is turned through: errors of the truth with
#   the attitude differ at the ends of a turn and agree at those of a rest.

TRUTH, TRUTH_RATE, TRUTH_ACCELERATION, TURNED = "noise.truth", "noise.truth_rate", "noise.truth_acceleration", "noise.turned"
#: ln: a truth's sigma is stated to an order of magnitude: some public ones are 30 times as good as stated, some as bad
TRUTH_SPREAD = 1.5
#: where a search starts: jitter of a camera's stamps, s; what smoothing over 50 ms may leave, s^2; a camera's errors after a radian, rad
USUAL_JITTER_S, USUAL_BLUR_S2, USUAL_TURNED_RAD = 1e-3, 1e-4, 0.1 * DEG


def truth_components(twin: Twin, sizes: tuple[int, int, int]) -> list[Component]:
    """Components of the truth's error at each moment, and of what it leaves in a turn; a segment that begins at the sample where another
    ends shares its moment."""
    sigma = twin.problem.session.reference.sigma_deg * DEG
    rates = twin.rates(twin.start())
    changes = [angular_acceleration(movement.with_rate(rate)) for movement, rate in zip(twin.movements, rates, strict=True)]
    ends: dict[tuple[int, int], np.ndarray] = {}
    for number, s in enumerate(twin.segments):
        for at, sign in ((s.start, -1.0), (s.stop - 1, 1.0)):
            ends.setdefault((s.log, at), np.zeros(len(twin.segments)))[number] += sign
    moments = np.array(list(ends.values()))

    def of_moments(name: str, sizes_at: np.ndarray, usual: float, unit: str, si: float, what: str, prior: Prior | None = None) -> Component:
        sized = moments * sizes_at[:, None]
        return Component(name, Sparse.of(np.kron(sized.T @ sized, np.eye(twin.batch.angles))), usual, unit, si, what, prior)

    rate, change = (np.array([np.linalg.norm(values[log][at]) for log, at in ends]) for values in (rates, changes))
    angle = [
        np.linalg.norm(rates[s.log][s.start : s.stop], axis=1) @ rotation.sample_weights(dt[None, : s.stop - s.start - 1])[0]
        for s, dt in zip(twin.segments, twin.batch.dt, strict=True)
    ]
    diagonal = np.zeros(sum(sizes))
    diagonal[: sizes[0]] = np.repeat(angle, twin.batch.angles)
    words = "attitude of each moment of truth"
    # A search that starts at the stated sigma, which may be off by a factor of 30, ends where other components have taken its place.
    usual = float(sigma_of(twin.residuals(twin.start()).closure.ravel())) / np.sqrt(2) or sigma
    return [
        of_moments(TRUTH, np.ones(len(moments)), usual, "deg", DEG, words, Prior(sigma, TRUTH_SPREAD)),
        of_moments(TRUTH_RATE, rate, USUAL_JITTER_S, "ms", 1e-3, "the truth's error that grows with the rate"),
        of_moments(TRUTH_ACCELERATION, change, USUAL_BLUR_S2, "ms²", 1e-6, "the truth's error that grows with the angular acceleration"),
        Component(TURNED, Sparse.of_diagonal(diagonal), USUAL_TURNED_RAD, "°/√rad", DEG, "each turn, by the root of the angle turned"),
    ]


# Single wrong attitudes of a truth file: the segments before and after miss by opposite rotations.

#: both segments at a wrong moment miss by this many times the median (normal errors: less than 1e-7 a moment by ``chance_of``), in opposite
#: directions: misses of five times the noise are within about 16 degrees of opposite, and 45 are allowed
JUMP = 5.0
OPPOSITE = -0.7


#: median length of a vector of three normal deviates; and the effective number of squares in a scale from the median of N such lengths,
#: over N
MEDIAN_LENGTH, FREEDOM_SHARE = float(np.sqrt(2 * gammaincinv(1.5, 0.5))), 1.58


def repaired(problem: Problem) -> RepairedProblem:
    """The problem without wrong moments; as recorded, its clock is where the truth's stamps have it."""
    alignment = problem.session.reference.alignment
    repaired = without_wrong_moments(problem)
    if alignment is None or alignment.source["offset_s"] != FOUND:
        return repaired
    twin = problem.session.reference.twin(problem)
    return replace(repaired, recorded=replace(problem, batch=twin.later(problem.batch, twin.start(), -alignment.reading.offset_s)))


def without_wrong_moments(problem: Problem) -> RepairedProblem:
    """The problem without the segments on both sides of a wrong moment of truth."""
    model = problem.first
    keep = np.ones(len(problem.batch), dtype=bool)
    for _ in range(3):
        model = fit_least_squares(problem.batch.pick(keep), problem.floor.sigma[keep], model).model
        angles = closure_angles(problem.batch, model)
        usual = median_length(angles)
        at = neighbours(problem)
        before, after = angles[at], angles[at + 1]
        size = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
        cosine = np.sum(before * after, axis=1) / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-12)
        wrong = at[(size > JUMP * usual) & (cosine < OPPOSITE)]
        keep = np.ones(len(problem.batch), dtype=bool)
        keep[wrong] = keep[wrong + 1] = False
    if not len(wrong) or keep.sum() < len(keep) / 2:
        return RepairedProblem(problem, {})
    before = [problem.used[i] for i in wrong]
    at_s = np.array([round(float(problem.began_s[s.log]) + s.start_s + s.duration_s, 3) for s in before])
    p_value = chance_of(float(size[np.isin(at, wrong)].max() / usual), len(at), len(angles))
    claim = claim_of(AppliedEffect(wrong_moments(len(at_s)), at_s), None, p_value)
    return RepairedProblem(problem.without(~keep, "one of its moments of truth is wrong"), {WRONG_MOMENTS: claim})


def chance_of(times_usual: float, pairs: int, segments: int) -> float:
    """Upper bound of the probability that normal errors miss on both sides of one of ``pairs`` moments by this many times the median
    length. The scale of the errors is estimated from the median length of ``segments`` of them.  The bound is the probability that one side
    of one moment does, over all moments (Bonferroni)."""
    ratio = (times_usual * MEDIAN_LENGTH) ** 2 / 3
    return float(min(1.0, pairs * fdtrc(3, FREEDOM_SHARE * segments, ratio)))


def neighbours(problem: Problem) -> np.ndarray:
    """(P,) indices of used segments whose successor begins where they end."""
    used = problem.used
    return np.array(
        [i for i in range(len(used) - 1) if used[i].log == used[i + 1].log and used[i].stop - 1 == used[i + 1].start], dtype=int
    )
