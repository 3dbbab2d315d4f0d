"""Sessions with a truth file: errors of the truth, its twin, and the selection of effects."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from session.base import rotation
from session.base.numeric import rms_of, running_sum, sigmas_in
from session.base.progress import Told, untold
from session.base.units import DEG
from tinygc.closure.floor import Floor, gyro_variance
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch, attitudes
from tinygc.effects import AppliedEffect, Effect, Movement, Parameter, largest
from tinygc.explanation.claims import common_delays
from tinygc.explanation.decision import FOLD_STEPS, Naming, decided, fold_rows
from tinygc.explanation.evidence import Evidence, Hypothesis
from tinygc.explanation.search import NAMELESS, NamedEffect, exchanged, search
from tinygc.features.truth.evidence import OFFSET_ID, TruthClaim, TruthExplanation, offset_columns, truth_claim
from tinygc.features.truth.reading import GIVEN
from tinygc.inference.choose import PRIOR_ODDS, STAND_IN
from tinygc.inference.prove import FOLDS, folds_of
from tinygc.models.linear import PARAMETERS
from tinygc.noise.channels import in_gauge
from tinygc.noise.components import WANDER
from tinygc.noise.refit import Refit, candidates, refit
from tinygc.noise.twin import Channels, State, Twin
from tinygc.noise.whitening import Whitener

# Errors of a truth file, in addition to the catalogue, which describes sensors on a table.


def _nothing(movement: Movement) -> np.ndarray:
    """Zero columns: these effects change the reference, not the rate."""
    return np.zeros((*movement.rate.shape, 1))


OFFSET = Effect(
    id=OFFSET_ID,
    equation="the truth's attitude at t is the one that the gyro's clock has at t + seconds",
    parameter=Parameter("seconds", (), "s", plausible=0.1),
    observable_in=("timing",),
    kind="reference",
    columns=_nothing,
    describe=lambda theta: (
        f"the truth's stamps are {1e3 * abs(theta[0]):.2f} ms {'early' if theta[0] > 0 else 'late'} beside the gyro's: shift one of them "
        f"(truth.offset_s = {theta[0]:.6f}); a delay that all axes of the gyro share looks the same"
    ),
    discriminating_motion="turn fast and stop: the truth must stop with the gyro",
)
#: s to either side of a moment over which its angular acceleration is taken: a truth's smoothing is as wide, and vibration faster
SMOOTHED_S = 0.02
_SMOOTHING = Effect(
    id="reference.truth_smoothing",
    equation="the truth's attitude is a mean over a while around t: it errs by half the variance of that while times dω/dt",
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
        return (
            f"the gyro's zero-rate offset wanders by {span.max() / DEG:.3f} dps (most on {'xyz'[int(np.argmax(span))]}) while the run lasts"
        )

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


def wrong_moments(count: int) -> Effect:
    """An effect of ``count`` wrong moments; its parameter is their times, s of the session."""
    return Effect(
        id="reference.truth_jump",
        equation="single attitudes of the truth are wrong: the segment before misses by what the segment after makes good",
        parameter=Parameter("at_s", (count,), "s"),
        observable_in=("reference",),
        kind="register",
        columns=_nothing,
        describe=lambda theta: f"{len(theta)} moments of truth are wrong by more than chance allows: leave them out",
        discriminating_motion="look at the truth's own residuals there",
    )


#: what an outage looks like where nothing tells that it is not the gyro that is wrong
LIKE_AN_OUTAGE = ("gyro.bias_step", "data.glitches")


def outages(spans: int, size_dps: list[float], sure: bool) -> Effect:
    """An effect of outages of the truth; its parameter is the (spans, 2) times from and to, s of the session.  sure: whether it is the
    truth that is wrong there."""

    def describe(theta: np.ndarray) -> str:
        where = ", ".join(f"{begin:.1f} to {end:.1f} s" for begin, end in theta.reshape(-1, 2))
        apart = f"from {where} truth and gyro part by {max(size_dps):.3g} dps rms, far beyond what the rest of the recording shows"
        whose = "the truth has lost the body" if sure else "the truth or the gyro is wrong there, and this recording does not tell which"
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


# The twin of a recording with a truth file: the closure between moments of truth alone, with the truth's clock among its effects.
#
# Stills of such a recording are not rows of it.  Their attitudes are estimated from truth and gyro together, and in a vehicle the zero-rate
# level at rest differs from that in motion (``zero_at_rest`` measures it), so a joint fit would describe neither.

#: most steps in which a clock is set back; with more, each step is longer than two samples
MOST_STEPS = 100


class TruthTwin(Twin):
    """A problem between moments of truth, ready to be replayed.

    Its floor is the gyro's white noise alone: the truth's noise is a component, whose size is estimated from the recording.
    """

    def __init__(self, problem: Problem):
        at = attitudes(problem.batch, problem.first(problem.batch.rate))
        own = gyro_variance(problem.batch, at, [problem.logs[segment.log].noise for segment in problem.used])
        own, wider = own[:, : problem.batch.angles, : problem.batch.angles], problem.floor.wider
        floor = Floor(own, np.zeros_like(problem.floor.shared))
        super().__init__(replace(problem, floor=floor if wider is None else floor.widened(wider)))
        self.original = problem
        alignment = problem.session.reference.alignment
        self.clock_free = alignment is None or alignment.source["offset_s"] != GIVEN

    def batch_at(self, state: State) -> Batch:
        """The batch with the truth's attitudes corrected for its clock and its smoothing, and the state's Earth rate."""
        batch = super().batch_at(state)
        for claim in state.claims:
            if claim.effect.id == OFFSET.id:
                batch = self.later(batch, state, float(claim.theta[0]))
            elif claim.effect.id == _SMOOTHING.id:
                start, end = (-float(claim.theta[0]) / 2 * change @ state.model.E.T for change in self._changes)
                batch = replace(
                    batch,
                    start=rotation.multiply(batch.start, rotation.exp(start)),
                    end=rotation.multiply(batch.end, rotation.exp(end)),
                )
        return batch

    @cached_property
    def _changes(self) -> tuple[np.ndarray, np.ndarray]:
        """(S, 3) rad/s^2, as read, at both ends of the segments: second differences of the angle over ``SMOOTHED_S`` to either side."""
        found = np.zeros((2, len(self.segments), 3))
        for log, log_stills in enumerate(self.problem.logs):
            samples = log_stills.samples
            angle = running_sum((samples.gyro[1:] + samples.gyro[:-1]) / 2 * samples.dt_s[:, None])
            own = [i for i, segment in enumerate(self.problem.used) if segment.log == log]
            at = np.array([(self.problem.used[i].start, self.problem.used[i].stop - 1) for i in own]).reshape(-1, 2).T
            t_s = samples.t_s[at].clip(samples.t_s[0] + SMOOTHED_S, samples.t_s[-1] - SMOOTHED_S)
            for axis in range(3):
                before, here, after = (np.interp(t_s + step, samples.t_s, angle[:, axis]) for step in (-SMOOTHED_S, 0.0, SMOOTHED_S))
                found[:, own, axis] = (after - 2 * here + before) / SMOOTHED_S**2
        return found[0], found[1]

    def later(self, batch: Batch, state: State, seconds: float) -> Batch:
        """Treat the truth's attitudes as those of ``seconds`` later: integrate each back along the calibrated rate, in steps of about two
        samples, each with the rate at its midpoint."""
        period_s = float(np.median([self.problem.logs[s.log].samples.period_s for s in self.segments]))
        steps = min(int(np.ceil(abs(seconds) / (2 * period_s))), MOST_STEPS) or 1
        turned, step_s = [], seconds / steps
        # (S, 3) of each segment's last sample, of values (S, T, 3).
        last = np.sum(self.batch.dt > 0, axis=1)
        for q, samples_at, earth in (
            (batch.start, [s.start for s in self.segments], batch.earth[:, 0]),
            (batch.end, [s.stop - 1 for s in self.segments], np.take_along_axis(batch.earth, last[:, None, None], axis=1)[:, 0]),
        ):
            for number in reversed(range(steps)):
                half_s = (number + 0.5) * step_s
                gyro = np.array([self._gyro(s.log, at, half_s) for s, at in zip(self.segments, samples_at, strict=True)])
                q = rotation.multiply(q, rotation.exp(-step_s * (state.model(gyro) - earth)))
            turned.append(q)
        return replace(batch, start=turned[0], end=turned[1])

    def _gyro(self, log: int, at: int, later_s: float) -> np.ndarray:
        """(3,) rad/s as read ``later_s`` after a sample, interpolated linearly."""
        samples = self.problem.logs[log].samples
        where = np.clip(at + later_s / samples.period_s, 0, len(samples) - 1.001)
        share, first = where % 1.0, int(where)
        return (1 - share) * samples.gyro[first] + share * samples.gyro[first + 1]

    def effect_columns(self, effect: Effect, state: State, sensitivity: np.ndarray, rates: list[np.ndarray]) -> Channels:
        """The columns of any twin; for the truth's clock and smoothing, the rotation of the attitudes at both ends."""
        if effect.kind != "reference":
            return super().effect_columns(effect, state, sensitivity, rates)
        batch = self.batch_at(state)
        if effect.id == OFFSET.id:
            columns = offset_columns(batch, state.model)
        else:
            ends = zip((batch.start, batch.end), self._changes, strict=True)
            start, end = (np.einsum("sij,sj->si", rotation.matrix(q), change @ state.model.E.T) / 2 for q, change in ends)
            columns = end - start
        return Channels(columns[..., None], np.zeros((0, 3, 1)), np.zeros((0, 1)))


# Candidates: the catalogue's rate effects, the truth's clock and a drifting bias, compared as for any recording.

WANDER_S = 20.0  #: spacing of the knots; the evidence penalizes their number


def name_beside_truth(twin: TruthTwin, evidence: Evidence, seed: int, progress: Told = untold) -> TruthExplanation:
    """Select among the candidates by the twin's evidence.  An effect at a size that no gyroscope has is rejected, and the selection
    repeated without it."""
    # A drifting bias, so that an unnamed drift is not taken for one of the catalogue's effects.
    duration, segments = float(twin.problem.began_s[-1]), len(twin.segments)
    slow = wander(np.linspace(0, duration, max(3, min(round(duration / WANDER_S) + 1, segments // 6))))
    tried = [*(effect for effect in candidates(twin) if effect.kind == "rate"), OFFSET, _SMOOTHING, slow]
    tried = [effect for effect in tried if np.isfinite(columns := evidence.columns(effect)).all() and columns.any()]
    first_p = evidence.first_p(tried, seed)
    refused: list[TruthClaim] = []
    while True:
        best = _best(evidence, tried, slow, progress)
        naming = _with_slow_bias(evidence, tried, slow, decided(evidence, best, first_p, len({effect.id for effect in tried})))
        claims = _claims(naming, naming.fit)
        wrong = [claim for claim in claims if claim.implausible]
        if not wrong:
            break
        ids = frozenset(claim.effect.id for claim in wrong)
        refused += [claim for claim in wrong if claim.effect is not _SMOOTHING]  # a negative one sharpens, which no truth does
        tried = [effect for effect in tried if effect.id not in ids]
        evidence.forget(ids)
    first, last = naming.first, beside_clock(twin, naming.whiten, naming.fit)
    angles = twin.residuals(first.state).closure, twin.residuals(last.state).closure
    return TruthExplanation(
        problem=twin.original,
        twin=twin,
        naming=naming,
        fit=last,
        claimed=_claims(naming, last),
        refused=refused,
        p_value=naming.p_value,
        angles=angles,
        held_out=(held_out(twin, naming.whiten, first), held_out(twin, naming.whiten, last)),
        excess=(excess_of(twin.original, angles[0], 0), excess_of(twin.original, angles[1], sum(len(claim.theta) for claim in claims))),
    )


def beside_clock(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """Add the truth's clock, unless it was given, to a fit with effects that delay: the clock takes the part common to all axes."""
    effects = [claim.effect for claim in fit.state.claims]
    if twin.clock_free and OFFSET not in effects and any(effect.id in common_delays() for effect in effects):
        fit = refit(twin, whiten, [OFFSET, *effects], fit.state)
    return in_gauge(twin, whiten, fit)


def _best(evidence: Evidence, tried: list[Effect], slow: Effect, progress: Told) -> Hypothesis:
    """Search from nothing and from a slow bias: otherwise effects that imitate parts of a slow bias are found first and leave it no
    gain."""
    evidence.will_try(tried)
    begins = [evidence.nothing, *([evidence.of((slow,), evidence.nothing)] if slow in tried else [])]
    best = exchanged(evidence, tried, min((search(evidence, tried, begin, progress=progress) for begin in begins), key=lambda h: h.score))
    if slow.id in best.ids:
        return best
    # If fewer effects and a slow bias do nearly as well, several names are too many: a wrong name is worse than none.
    instead = [h for h in evidence.exact if slow.id in h.ids and len(h.ids) <= len(best.ids) and h.score < best.score + STAND_IN]
    return min([*instead, best], key=lambda h: (len(h.ids - {slow.id}), h.score))


def _with_slow_bias(evidence: Evidence, tried: list[Effect], slow: Effect, naming: Naming) -> Naming:
    """Report a bias drift of unknown size that is more probable than none as a slow bias, instead of leaving it in the noise.  Effects made
    redundant by it are removed."""
    names = tuple(claim.effect for claim in naming.fit.state.claims)
    if evidence.twin.problem.instability.rps > 0 or slow not in tried or slow.id in {effect.id for effect in names}:
        return naming
    begin, steady = evidence.of(names, evidence.nothing), evidence.without(WANDER)
    odds = (steady.of(names, steady.nothing).score - begin.score) / 2 + np.log(PRIOR_ODDS)
    if odds < 0:
        return naming
    best = steady.of((*names, slow), begin)
    for effect in names:
        fewer = steady.of(tuple(other for other in best.effects if other is not effect), best)
        best = min(best, fewer, key=lambda h: h.score)
    kept, fit = {effect.id for effect in best.effects}, best.fit
    shape = _said(fit, slow, float(1 / (1 + np.exp(-odds))))
    first = refit(evidence.twin, best.whiten, [], evidence.twin.start())
    named = [each for each in naming.named if each.effect.id in kept]
    p_value = min(naming.p_value, shape.p_value)
    return replace(naming, first=first, fit=fit, named=named, beyond=[shape], whiten=best.whiten, noise=best.noise, p_value=p_value)


def _said(fit: Refit, effect: Effect, probability: float) -> NamedEffect:
    number = [claim.effect.id for claim in fit.state.claims].index(effect.id)
    theta = fit.state.claims[number].theta
    gain = float(theta @ np.linalg.solve(fit.theta_covariance(number), theta))
    return NamedEffect(effect, float(chdtrc(len(theta), gain)), gain, probability)


def _claims(naming: Naming, fit: Refit) -> list[TruthClaim]:
    """Claims of the selected effects, with the estimates of this fit."""
    numbers = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    claims = [
        _claim(fit, numbers[each.effect.id], each, naming.first.chi_square)
        for each in sorted(naming.named + naming.beyond, key=lambda each: -each.gain)
    ]
    return [replace(c, equivalent=common_delays()) if c.effect is OFFSET else c for c in claims]


def _claim(fit: Refit, number: int, named: NamedEffect, chi_square: float) -> TruthClaim:
    claim, sigma = fit.state.claims[number], sigmas_in(fit.theta_covariance(number))
    share = float(np.clip(named.gain / chi_square, 0, 1))
    more = {"probability": named.probability, "rivals": named.rivals, "equivalent": named.equivalent}
    return truth_claim(claim.effect, claim.theta, sigma, named.p_value, share=share, **more)


def held_out(twin: TruthTwin, whiten: Whitener, fit: Refit, folds: int = FOLDS) -> np.ndarray:
    """(S, 3) rad: closure of every ``folds``-th segment, in turn, from the fit of all others."""
    effects = [_shrunk(claim) for claim in fit.state.claims]
    angles = np.zeros((len(twin.segments), 3))
    for held in folds_of(len(twin.segments), folds):
        part = refit(twin, whiten, effects, fit.state, rows=fold_rows(twin, whiten, held), max_steps=FOLD_STEPS)
        angles[held] = twin.residuals(part.state).closure[held]
    return angles


def _shrunk(claim: AppliedEffect) -> Effect:
    """A slow bias with the prior used in its evidence, the rms of its own parameters; other effects unchanged."""
    if not claim.effect.id.startswith(NAMELESS):
        return claim.effect
    rms = rms_of(claim.theta)
    return replace(claim.effect, parameter=replace(claim.effect.parameter, plausible=rms))


def excess_of(problem: Problem, angles: np.ndarray, parameters: int) -> float:
    """Chi-square per degree of freedom against the stated noise of gyro and truth, of closure angles (S, 3), with ``parameters`` fitted in
    addition to the linear model's 12."""
    white = np.linalg.solve(np.linalg.cholesky(problem.floor.dense()), angles.ravel())
    return float(white @ white) / max(len(white) - PARAMETERS - parameters, 1)
