"""Detect, select, reject and prove effects: what a recording shows, and its closure on held-out segments."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from session.base.errors import CalibrationError
from session.base.numeric import rms_length
from session.base.progress import Reporter, no_report
from session.base.rotation import matrix
from session.base.units import DEG
from session.detect.bridging import GAP
from session.detect.check_time import STEPS
from session.detect.segments import Segment
from tinygc.closure.problem import Problem
from tinygc.effects import Effect, catalogue
from tinygc.estimation.bias import SAME, choose, tilt_rms
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.estimation.stated_noise import stated_response
from tinygc.explanation.claims import Claim, named_claims
from tinygc.explanation.evidence import Evidence, Hypothesis
from tinygc.explanation.families import SLOW_ZERO
from tinygc.explanation.search import NAMELESS, NamedEffect, curves_like, exchanged, guesses, search, slow_candidates, unknown_candidates
from tinygc.fitting.results import FitResult
from tinygc.inference import prove
from tinygc.inference.choose import LEVEL, MISMATCH_P, PRIOR_ODDS, STAND_IN, Standing, probabilities, rivals_of, standing_of
from tinygc.inference.prove import folds_of, signed_ranks_above
from tinygc.inference.solve import left_of, orthonormal
from tinygc.models.linear import LinearModel
from tinygc.noise.components import MOST_FACTOR, STILL_RATE, TURN, UNDERSAMPLED, WANDER, SessionNoise
from tinygc.noise.refit import Refit, Replay, at_known_shapes, candidates, prior_sigmas, refit, scanned, value_of
from tinygc.noise.twin import FIRST_CLAIM, LINEAR, State, Twin, claim_slice
from tinygc.noise.whitening import OPEN_MPS2, Whitener
from tinygc.verdict.acceptance import NEAR_FLOOR

# Prove: closure on held-out segments, before, after, and the floor.

#: Gauss-Newton iterations, starting from the fit of all segments, of which a fold leaves out a tenth
FOLD_STEPS = 3
#: excess, in units of the floor's variance, below which a share of it is a share of noise: three sigmas of the variance of 80 angles, which
#: is known to 16 %
LEAST_EXCESS = 0.5


#: ``fit`` without an option, by the method that every model is held against
AS_FIT = FitOptions(methods=("least_squares",))


@dataclass(frozen=True, eq=False)
class FitClosure:
    """What ``fit`` states for a session: the problem that it solves, with the bias of each turn from its stills where it takes it from
    them; its least squares; its options; and the twin of its noise.  None where it states nothing."""

    problem: Problem | None = None
    fit: MethodFit | None = None
    options: FitOptions = AS_FIT
    twin: Twin | None = None

    @classmethod
    def of(cls, problem: Problem, options: FitOptions = AS_FIT) -> FitClosure:
        """``fit``'s own function on this problem; nothing where that does not settle."""
        try:
            _, level, fit = choose(problem, options)
        except CalibrationError:
            return cls(None, None, options)
        return cls(level, fit, options)

    @classmethod
    def stated_by(cls, fit: FitResult | None, problem: Problem) -> FitClosure:
        """What a fit of this problem states; what ``fit`` would state where there is none, or one by other sessions as well."""
        if fit is None or fit.prior is not None:
            return cls.of(problem)
        return cls(fit.problem, fit.linear, fit.options, None if fit.noise is None else fit.noise.twin)

    @property
    def held_out(self) -> np.ndarray | None:
        """Held-out error angles (S, d) rad."""
        return None if self.fit is None else self.fit.held_out

    @property
    def numbers(self) -> list[int]:
        """Numbers of its segments."""
        return [] if self.problem is None else [segment.number for segment in self.problem.used]

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the catalogue that ``fit`` itself states: a drift of the accelerometer's zero."""
        joint = None if self.problem is None else self.problem.joint
        return () if joint is None or joint.drift is None else (catalogue()["accelerometer.zero_drift"],)

    def base(self, original: Problem, twin: Twin, state: State) -> Problem:
        """The problem whose closure is stated with effects, with the accelerometer that ``fit`` has where neither its turns nor the
        accelerometer are changed."""
        same = twin.original is original and self.numbers == [segment.number for segment in original.used] and not state.bends
        return self.problem if self.problem is not None and same else twin.original


@dataclass(frozen=True, eq=False)
class Proof:
    """Held-out error angles (S, d) rad: before as ``fit`` states them; named as it states them without the named effects. floor_rms rad of
    tilt; changed: whether anything is repaired or named between them. stated: by ``fit`` before; left: by ``fit`` without the effects;
    fit: the effects with the linear model of ``left``, which is handed on.

    The two may have different segments: clipped turns, which cannot be repaired, are left out of named.  Both use the numbers of before.
    """

    before: np.ndarray
    named: np.ndarray
    before_numbers: list[int]
    named_numbers: list[int]
    floor_rms: float
    changed: bool
    stated: FitClosure
    left: FitClosure
    fit: Refit

    @cached_property
    def ratio(self) -> float:
        """Closure with what is named over that before, on the turns of both."""
        common = sorted(set(self.before_numbers) & set(self.named_numbers))
        rows = [[numbers.index(number) for number in common] for numbers in (self.named_numbers, self.before_numbers)]
        named, before = (tilt_rms(angles[own]) for angles, own in zip((self.named, self.before), rows, strict=True))
        return named / before if before > 0 else 1.0

    @property
    def worse(self) -> bool:
        """Whether what is named makes the closure of these turns worse; below the floor the difference is chance."""
        return self.ratio > 1 + SAME and tilt_rms(self.named) > self.floor_rms

    @property
    def after(self) -> np.ndarray:
        """Angles of the better of the two, which is what is handed on."""
        return self.before if self.ratio > 1 else self.named

    @property
    def after_numbers(self) -> list[int]:
        """Segments of ``after``."""
        return self.before_numbers if self.ratio > 1 else self.named_numbers

    @property
    def removed(self) -> float | None:
        """Share of the excess over the floor that what is named removes, negative where it adds to it; None if the excess is negligible or
        nothing was changed. Closure below the floor is chance, and counts as all of it."""
        floor = self.floor_rms**2
        excess = tilt_rms(self.before) ** 2 - floor
        return None if excess < LEAST_EXCESS * floor or not self.changed else 1 - max(tilt_rms(self.named) ** 2 - floor, 0.0) / excess


class Prover:
    """Hold out segments as ``fit`` does, once for each state of a fit.  original: the problem before its repair, twin after it; stated: by
    ``fit`` without any effect."""

    def __init__(self, original: Problem, twin: Twin, stated: FitClosure):
        self.original, self.twin, self.stated = original, twin, stated
        self._known: dict[tuple[tuple[Effect, ...], bytes], tuple[np.ndarray, FitClosure]] = {}

    def __call__(self, whiten: Whitener, fit: Refit) -> Proof:
        """Prove the effects of a fit."""
        twin, stated = self.twin, self.stated
        effects = tuple(claim.effect for claim in fit.state.claims)
        key = effects, fit.state.vector.tobytes()
        if key not in self._known:
            self._known[key] = self._held_out(whiten, fit)
        named, left = self._known[key]
        before, changed = stated.held_out, bool(effects) or twin.original is not self.original
        if before is None:
            before = held_out(twin, whiten, refit(twin, whiten, [], twin.start()))
        numbers = numbers_before(self.original, twin)
        before_numbers = stated.numbers or numbers
        named_numbers = numbers if changed else before_numbers
        handed_on = _with_linear(twin, whiten, fit, left)
        return Proof(before, named, before_numbers, named_numbers, twin.original.floor.tilt_rms, changed, stated, left, handed_on)

    def _held_out(self, whiten: Whitener, fit: Refit) -> tuple[np.ndarray, FitClosure]:
        """The angles with the effects of a fit, and what ``fit`` states without them; where it states nothing, by the columns."""
        twin, left = self.twin, self.stated
        if fit.state.claims or twin.original is not self.original:
            base = left.base(self.original, twin, fit.state)
            left = FitClosure.of(without_effects(base, twin, whiten, fit, left.options.folds), left.options)
        return held_out(twin, whiten, fit) if left.held_out is None else left.held_out, left


def _with_linear(twin: Twin, whiten: Whitener, fit: Refit, left: FitClosure) -> Refit:
    """The effects of a fit with the linear model of ``left``, which ``fit`` made of what they leave: its closure is stated for both.

    The covariance is that of both estimates for the same errors of the channels.  The linear model answers by L to what the twin's fit
    leaves, which is independent of its errors, and to what is still in it: its columns but those of the effects, times their errors, which
    an unknown shape widens.
    """
    if left.fit is None or left.problem is None or not isinstance(left.fit.model, LinearModel):
        return fit
    L = stated_response(left.problem, left.fit.model)
    columns = whiten.back(fit.J)
    if L.shape[1] != len(columns):  # nothing is named, and ``fit`` has left out turns
        return fit
    answers = L @ columns
    through = np.eye(len(fit.covariance))
    through[LINEAR, :FIRST_CLAIM] = -answers[:, :FIRST_CLAIM]
    covariance = through @ fit.covariance @ through.T
    held = at_known_shapes(fit.J, prior_sigmas(twin, [claim.effect for claim in fit.state.claims]))
    covariance[LINEAR, LINEAR] += whiten.carried(L) - answers @ held @ answers.T
    return replace(fit, state=replace(fit.state, model=left.fit.model), covariance=covariance)


def without_effects(base: Problem, twin: Twin, whiten: Whitener, fit: Refit, folds: int = AS_FIT.folds) -> Problem:
    """The problem ``base`` as a sensor without the named effects would have recorded it, for ``fit``'s own function.

    In each of its folds the effects are those of a fit without the fold's segments and the stills at their ends.  base: with the turns and
    stills of the twin; without effects it comes back as it is.
    """
    effects, parts = [claim.effect for claim in fit.state.claims], []
    for held in folds_of(len(twin.segments), folds) if effects else ():
        rows = fold_rows(twin, whiten, held)
        parts.append(cleared(base, twin, refit(twin, whiten, effects, fit.state, rows=rows, max_steps=FOLD_STEPS).state))
    return cleared(base, twin, fit.state).changed(folds=tuple(parts)) if effects else base


def cleared(base: Problem, twin: Twin, state: State) -> Problem:
    """The problem with the effects of a state taken out of its rates, references and Earth's rate."""
    state = replace(state, horizontal=np.zeros(2))  # a heading is no effect
    back = np.linalg.inv(state.model.E).T
    rates = [(rate - state.model.B) @ back for rate in twin.rates(state)]
    batch = replace(twin.batch_at(state), rate=twin.padded(rates))
    if batch.start is not twin.batch.start:  # the references follow the state
        base = base.changed(joint=None)
    else:
        batch = replace(batch, start=base.batch.start, end=base.batch.end)
    stills = base.still_rates
    if twin.stills:
        earth = stills.earth + np.einsum("qji,j->qi", matrix(twin.q_tb), state.earth_t)
        change = twin.still_means([rate - log.samples.gyro for rate, log in zip(rates, twin.seen.logs, strict=True)])
        stills = replace(stills, rate=stills.rate + change, earth=earth)
    return base.changed(batch=batch, still_rates=stills, rest_rps=None)


def numbers_before(original: Problem, twin: Twin) -> list[int]:
    """Numbers that the twin's segments had before the repair: rejecting a still joins two turns and shifts the numbers after it."""

    def middle(segment: Segment) -> float:
        return segment.start_s + segment.duration_s / 2

    numbers = []
    for segment in twin.segments:
        same_log = [other for other in original.segments if other.log == segment.log] or original.segments
        numbers.append(min(same_log, key=lambda other: abs(middle(other) - middle(segment))).number)
    return numbers


def held_out(twin: Twin, whiten: Whitener, fit: Refit) -> np.ndarray:
    """(S, d) rad of each segment, with parameters estimated from all rows except its fold's, linearized."""
    prior = prior_sigmas(twin, [claim.effect for claim in fit.state.claims])
    return left_out(twin, whiten, fit.r, fit.J * prior)[whiten.parts["closure"]].reshape(-1, twin.batch.angles)


def left_out(twin: Twin, whiten: Whitener, r: np.ndarray, J: np.ndarray) -> np.ndarray:
    """(n,) stacked: every row predicted with parameters from the other folds' rows (``prove.left_out``); a still's row by the last of its
    folds.  r (n,) and J (n, p) are whitened, at the fit of all rows, with J in units of the prior sigmas."""
    parts = [np.flatnonzero(~fold_rows(twin, whiten, held)) for held in folds_of(len(twin.segments))]
    return prove.left_out(whiten.back(r), whiten.back(J), whiten.precision, whiten.pulled(r), whiten.pulled(J), parts)


def fold_rows(twin: Twin, whiten: Whitener, held: np.ndarray) -> np.ndarray:
    """Rows (n,) bool of the channels without the held-out segments and without the stills at their ends."""
    d = twin.batch.angles
    still = np.r_[whiten.parts["still"]].reshape(-1, 3)
    rows = np.ones(whiten.parts["length"].stop, dtype=bool)
    rows[(held[:, None] * d + np.arange(d)).ravel()] = False
    if twin.stills:
        ends = np.unique([twin.first[held], twin.last[held]])
        rows[still[ends].ravel()] = False
        rows[whiten.parts["length"].start + ends] = False
    return rows


# An effect and an unnamed curve over the same variable: is the effect more than a further term of that curve?
#
# If the scale bends with the rate as no effect of the catalogue does, any power of the rate improves the fit, named or not.  Such an effect
# shows that the curve has more terms, not that the effect's own law holds.

#: share of an effect's action, after projection, that further terms of the curve reproduce; above it the effect is one of them
SAME_CURVE = 0.9


def _part_of_a_curve(evidence: Evidence, best: Hypothesis, number: int) -> bool:
    """Whether further terms of an unnamed curve in the same hypothesis reproduce this effect in the channels."""
    own, J = best.effects[number], best.fit.J
    for other in best.effects:
        if not other.id.startswith(NAMELESS) or own.id.startswith(NAMELESS) or other.conditions is None or own.conditions is None:
            continue
        terms = curves_like(evidence.twin, other) if own.conditions[0] == other.conditions[0] else []
        if not terms:
            continue
        part = claim_slice(best.fit.state.claims, number)
        rest = orthonormal(np.delete(J, part, axis=1))
        does = left_of(rest, J[:, part])
        curve = left_of(rest, np.concatenate([best.whiten(evidence.columns(term)) for term in terms], axis=1))
        if does.shape[1] and np.sum((curve.T @ does) ** 2) > SAME_CURVE * does.shape[1]:
            return True
    return False


def separated(evidence: Evidence, best: Hypothesis) -> Hypothesis:
    """Without slow motions of the zero-rate offset that an unnamed one in the same hypothesis reproduces, or without that one, whichever
    leaves more evidence.  Together such members may cancel, and only their sum is determined: one of them, fitted alone, states
    it."""
    for number, own in enumerate(best.effects):
        if own.id in SLOW_ZERO and _part_of_a_curve(evidence, best, number):
            others = [e for e in best.effects if e.id in SLOW_ZERO and e.id.startswith(NAMELESS)]
            fewer = [tuple(effect for effect in best.effects if effect is not gone) for gone in (own, *others)]
            return separated(evidence, min((evidence.of(effects, best) for effects in fewer), key=lambda h: h.score))
    return best


# ``motion.undersampled``: a claim about the turns' own noise, compared with the same noise without that cause.

#: share of the floor's rms below which it is reported as noise and not claimed: it adds a tenth to the closure
WORTH_REPORTING = 0.5


def _undersampled_claim(evidence: Evidence, whiten: Whitener, fit: Refit, noise: SessionNoise) -> list[Claim]:
    """Claim undersampling if the noise is less probable without it, even with the turns' other noise free."""
    twin, factor, missed = evidence.twin, noise.size(UNDERSAMPLED), noise.missed
    floor = twin.problem.floor.tilt_rms
    if factor * missed.rms_rad < WORTH_REPORTING * floor or factor > MOST_FACTOR:
        return []
    J = whiten.back(fit.J) * evidence.prior(fit)
    fewer = noise.without(UNDERSAMPLED)
    gain = fewer.estimated(whiten.base, whiten.back(fit.r), J, fewer.s).value - noise.value
    probability = float(1 / (1 + np.exp(-np.clip(gain, -700, 700) / 2)))
    p_value = float(chdtrc(1, max(gain, 0.0)))
    if standing_of(p_value) is not Standing.FOR:
        return []
    effect = catalogue()[UNDERSAMPLED]
    sigma = next(float(s) for s, c in zip(noise.sigma, noise.components, strict=True) if c.name == UNDERSAMPLED)
    angles = twin.residuals(fit.state).closure[:, :2]
    own = rms_length(angles)
    rates = missed.rate_hz / np.array([1, *STEPS])
    closure = np.sqrt(own**2 + np.concatenate([[0.0], 2 * missed.missed_rad**2]))
    size = factor * missed.rms_rad
    beyond = own**2 - floor**2
    each = factor * np.sqrt(2) * missed.predicted_rad
    parameters = {
        "predicted_deg": size / DEG,
        "share": float(min(size**2 / beyond, 1.0)) if beyond > 0 else 1.0,
        "turns": [s.number for s, angle in zip(twin.segments, each, strict=True) if angle > floor],
        "rates_hz": rates.tolist(),
        "closure_deg": (closure / DEG).tolist(),
        "exponent": -missed.exponent,
    }
    words = f"{effect.describe(np.array([size]))}; {missed.rate_needed_hz(size, floor):.0f} Hz would have been enough"
    std = {"predicted_deg": sigma * missed.rms_rad / DEG if np.isfinite(sigma) else missed.rms_rad / DEG}
    return [Claim(effect, parameters, std, p_value, words, probability=probability, theta=np.array([size]))]


# A claim is kept only if it improves held-out data by more than chance, paired by segments.
#
# Each segment is left out together with the stills at its ends; all its rows are predicted with and without the claim, with everything else
# refitted both times.  A scanned shape (the time of a step, the frequency of a line) moves with the rest, since a shape found with the
# left-out rows improves them by chance; how many were tried is in the claim's evidence.

#: significance level of the held-out improvement
CONFIRMED_P = 0.05


def confirmed(evidence: Evidence, have: Hypothesis, number: int) -> bool:
    """Whether a claim of a hypothesis improves the left-out rows."""
    effect, moved = have.effects[number], None
    if effect.scan is not None:
        values, at = scanned(evidence.twin, effect), value_of(effect)
        near = np.array([values[values < at].max(initial=values[0]), values[values > at].min(initial=values[-1])])
        before, after = have.whiten.each(map(evidence.columns, effect.variants(near)))
        moved = (after - before) @ have.fit.state.claims[number].theta / 2
    return improvement_p(evidence.twin, have, evidence.prior(have.fit), number, moved) < CONFIRMED_P


def improvement_p(twin: Twin, have: Hypothesis, prior: np.ndarray, number: int, moved: np.ndarray | None = None) -> float:
    """Probability that chance improves the left-out segments as much as a claim does (Wilcoxon's signed ranks, one-sided).

    prior (p,): sigmas of all parameters of the hypothesis.  moved (n,): whitened change from the claim's shape to its neighbours, where it
    has one.
    """
    whiten, fit = have.whiten, have.fit
    part = claim_slice(fit.state.claims, number)
    J = fit.J * prior
    with_r, r = fit.r, fit.r - fit.J[:, part] @ fit.state.claims[number].theta
    if have.effects[number].kind == "force" and twin.own_accelerometer:
        # These stills gave the accelerometer's nine parameters: they are left out of those, too.
        J = np.concatenate([J, whiten(twin.own_columns()) * OPEN_MPS2], axis=1)
        with_r = _settled(with_r, J)
    fewer = np.delete(J, part, axis=1)
    r = _settled(r, fewer)
    if moved is not None:
        J = np.column_stack([J, moved])
        with_r = _settled(with_r, J)
    gains = _per_segment(twin, have, left_out(twin, whiten, r, fewer)) - _per_segment(twin, have, left_out(twin, whiten, with_r, J))
    return signed_ranks_above(gains)


def _settled(r: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Residuals r (n,) after all parameters of the columns J (n, p), in units of their priors' sigmas, have moved to their optimum."""
    return r - J @ np.linalg.solve(J.T @ J + np.eye(J.shape[1]), J.T @ r)


def _per_segment(twin: Twin, have: Hypothesis, rows: np.ndarray) -> np.ndarray:
    """(S,) sums of squares of left-out rows (n,), in sigmas, for each segment and the still at which it begins."""
    square = np.nan_to_num((rows / have.whiten.sigma) ** 2)
    closure, still, length = (square[part] for part in have.whiten.parts.values())
    total = closure.reshape(len(twin.segments), -1).sum(axis=1)
    if not twin.stills:
        return total
    return total + still.reshape(-1, 3).sum(axis=1)[twin.first] + length[twin.first]


# Detect, select, reject: `explain` reports the result, and `fit --physics auto` fits it.

#: an effect is reported if its probability, together with its equivalents, exceeds one half
REPORTED = 0.5
#: -2 log evidence within which a single unnamed shape is evaluated in place of all names: a second shape may add to it
INSTEAD = 60.0
MOST_FINDINGS = 2  #: unnamed shapes in addition to the named effects: as many as fit on a page
#: ratio of held-out closures that is tolerated of an effect that the stills show: above the 1.02 of a g-sensitivity of four times its limit
#: in a recording whose turns miss for another reason (mimu e5u4)
TOLERATED = 1.05


@dataclass(frozen=True, eq=False)
class Naming:
    """The effects selected for a recording.

    first: the fit without any effect, and first_p its family-wise p-value. fit: with all effects that are kept. named: strongest first.
    beyond: shapes without a name. whiten and noise: the covariance used. considered: rejected effects with their probability. p_value of
    the detection. undersampled: the claim about the turns' own noise. unusual: whether the rest of that noise is unlike a sensor's.
    replay: of the search without any effect, with the columns that it knows. refused: names that would fit against a reference, at a size
    that no sensor has.
    """

    first: Refit
    first_p: float
    fit: Refit
    named: list[NamedEffect]
    whiten: Whitener
    noise: SessionNoise
    beyond: list[NamedEffect] = field(default_factory=list)
    considered: dict[str, float] = field(default_factory=dict)
    p_value: float = 1.0
    undersampled: list[Claim] = field(default_factory=list)
    unusual: bool = False
    replay: Replay | None = None
    refused: list[Claim] = field(default_factory=list)

    @property
    def unnamed(self) -> bool:
        """Whether there is a mismatch that no effect explains."""
        return not self.named and not self.undersampled and (self.p_value <= LEVEL or self.unusual)


def leaves_more(twin: Twin, naming: Naming, proof: Proof) -> bool:
    """Whether something is left without a name: a shape, noise unlike a sensor's, or a closure that the names make worse, or that
    is far above the noise that has a cause."""
    return bool(naming.beyond) or naming.unusual or proof.worse or tilt_rms(proof.after) > NEAR_FLOOR * _expected_rms(twin, naming, proof)


def _expected_rms(twin: Twin, naming: Naming, proof: Proof) -> float:
    """Tilt rms, rad, that noise with a cause leaves of a segment: of what is estimated, all but each turn's and each still's own error."""
    noise, closure = naming.noise.without(TURN).without(STILL_RATE), naming.whiten.parts["closure"]
    variance = np.diag(noise.covariance)[closure].reshape(-1, twin.batch.angles)
    if twin.errors:  # a further reference is as wrong as is stated of it: what is beyond has no name
        return proof.floor_rms
    # By bridged readings; that of an impact is an allowance, and no cause.
    gaps = sum(each.sigma_rad**2 for each in twin.original.widened if each.cause == GAP)
    return math.sqrt(proof.floor_rms**2 + float(np.mean(variance[:, 0] + variance[:, 1])) + gaps / len(twin.original.used))


def decide(
    twin: Twin,
    seed: int,
    progress: Reporter = no_report,
    begin: tuple[Effect, ...] = (),
    prove: Prover | None = None,
) -> Naming:
    """Compare the catalogue's effects with each other, with unnamed shapes, and with no effect.

    begin: effects found in a part of the recording, from which the search may start; prove: holds out segments, to keep only effects with
    which they close no worse; those that ``fit`` states are weighed whatever their rank.
    """
    evidence, tried = Evidence(twin), candidates(twin)
    if not twin.stills:  # what stills alone would show has no columns
        tried = [effect for effect in (*tried, *twin.slow) if np.isfinite(columns := evidence.columns(effect)).all() and columns.any()]
    progress("detecting")
    first_p, refused = evidence.first_p(tried, seed), list[Claim]()
    stated = () if prove is None else prove.stated.effects
    while True:
        begins = (begin, *((effect,) for effect in (*stated, *twin.slow)))
        start = min(evidence.nothing, *(evidence.of(effects, evidence.nothing) for effects in begins), key=lambda h: h.score)
        best = search(evidence, tried, start, progress=progress)
        progress("lookalikes")
        best = exchanged(evidence, tried, best)
        progress("beyond the catalogue")
        best = rather_slow(evidence, best) if twin.slow else _beyond_the_catalogue(evidence, tried, best, first_p)
        for effect in stated:
            if effect.id not in best.ids:
                evidence.guess(best, add=effect)
        naming = with_slow_bias(evidence, decided(evidence, best, first_p, len({effect.id for effect in tried}), prove))
        impossible = [claim for claim in naming.fit.state.claims if twin.is_impossible(claim)]
        if not impossible:
            return replace(naming, refused=refused)
        ids = frozenset(claim.effect.id for claim in impossible)
        refused += [claim for claim in named_claims(naming.fit, [*naming.named, *naming.beyond], 0.0) if claim.effect.id in ids]
        tried = [effect for effect in tried if effect.id not in ids]
        evidence.forget(ids)


def with_slow_bias(evidence: Evidence, naming: Naming) -> Naming:
    """Where no still shows the bias, a drift of it that is more probable than none is a slow bias, instead of noise of unknown size.
    Effects that it makes redundant are removed."""
    names, twin = tuple(claim.effect for claim in naming.fit.state.claims), evidence.twin
    if twin.problem.instability.rps > 0 or not twin.slow or twin.slow[0] in names:
        return naming
    begin, steady = evidence.of(names, evidence.nothing), evidence.without(WANDER)
    odds = (steady.of(names, steady.nothing).score - begin.score) / 2 + np.log(PRIOR_ODDS)
    if odds < 0:
        return naming
    best = steady.of((*names, *twin.slow), begin)
    for effect in names:
        fewer = steady.of(tuple(other for other in best.effects if other is not effect), best)
        best = min(best, fewer, key=lambda h: h.score)
    shape = named_effect(steady, best, best.effects.index(twin.slow[0]), {twin.slow[0].id: float(1 / (1 + np.exp(-odds)))}, 1)
    first = refit(twin, best.whiten, [], twin.start())
    named = [each for each in naming.named if each.effect.id in best.ids]
    found = replace(
        naming, first=first, fit=best.fit, named=named, beyond=[replace(shape, rivals={})], whiten=best.whiten, noise=best.noise
    )
    return replace(found, p_value=min(naming.p_value, shape.p_value))


def rather_slow(evidence: Evidence, best: Hypothesis) -> Hypothesis:
    """A slow bias in place of several names, where it does nearly as well with fewer: a wrong name is worse than none."""
    ids = {effect.id for effect in evidence.twin.slow}
    if best.ids & ids:
        return best
    instead = [h for h in evidence.exact if h.ids & ids and len(h.ids) <= len(best.ids) and h.score < best.score + STAND_IN]
    return min([*instead, best], key=lambda h: (len(h.ids - ids), h.score))


def _beyond_the_catalogue(evidence: Evidence, tried: list[Effect], best: Hypothesis, first_p: float) -> Hypothesis:
    """Search unnamed shapes, in addition to the named effects and in their place.  Lines, of which there are hundreds, are tried only if
    something remains that no other candidate explains."""
    shapes = slow_candidates(evidence.twin)
    ahead = search(evidence, shapes, best, most=MOST_FINDINGS)
    if best.effects and any(g.score < ahead.score + INSTEAD for g in guesses(evidence, shapes, evidence.nothing)[:1]):
        ahead = min(ahead, search(evidence, shapes, evidence.nothing, most=MOST_FINDINGS), key=lambda h: h.score)
    if ahead.noise.unusual or (not ahead.effects and first_p < LEVEL):
        ahead = search(evidence, unknown_candidates(evidence.twin), ahead, most=1)
    if any(effect.id.startswith(NAMELESS) for effect in ahead.effects):
        # An effect that stood for a part of what the shape describes may be removed, and another may enter.
        ahead = exchanged(evidence, tried, search(evidence, tried, exchanged(evidence, tried, ahead), most=MOST_FINDINGS))
    return ahead


def decided(evidence: Evidence, best: Hypothesis, first_p: float, tests: int, prove: Prover | None = None) -> Naming:
    """Select which effects of the best hypothesis are reported; prove: as in ``decide``."""
    best = separated(evidence, best)
    twin, weighed = evidence.twin, evidence.weighed
    chance = probabilities(weighed)
    named = [named_effect(evidence, best, number, chance, tests) for number in range(len(best.effects))]
    kept = [
        n
        for number, n in enumerate(named)
        if n.probability + sum(n.rivals[name] for name in n.equivalent) >= REPORTED
        and confirmed(evidence, best, number)
        and not _part_of_a_curve(evidence, best, number)
    ]
    fit = best.fit if len(kept) == len(best.effects) else _refitted(twin, best, kept)
    if kept and prove is not None:
        before = tilt_rms(prove(evidence.nothing.whiten, evidence.nothing.fit).named)
        kept, fit = _no_worse(twin, best, kept, fit, lambda tried: tilt_rms(prove(best.whiten, tried).named) / before)
    if not kept:  # then use the noise of the hypothesis without effects
        best, fit = evidence.nothing, evidence.nothing.fit
    names = [n for n in kept if not n.effect.id.startswith(NAMELESS)]
    ids = {n.effect.id for n in kept}
    # A rejected effect may fit the segments that the fit saw; its probability is reported as one half at most.
    considered = {name: min(p, REPORTED) for name, p in chance.items() if name and name not in ids and not name.startswith(NAMELESS)}
    first = refit(twin, best.whiten, [], twin.start())
    r, J = best.whiten.back(fit.r), best.whiten.back(fit.J) * evidence.prior(fit)
    noise = best.noise.estimated(best.whiten.base, r, J, best.noise.s, with_sigma=True)
    undersampled = _undersampled_claim(evidence, best.whiten, fit, noise)
    p_value = min([first_p, *(n.p_value for n in kept), *(claim.p_value for claim in undersampled)])
    unusual = noise.unusual_p(best.whiten.base, r, J) < MISMATCH_P
    named = sorted(names, key=lambda n: -n.gain)
    beyond = [n for n in kept if n not in names]
    return Naming(first, first_p, fit, named, best.whiten, noise, beyond, considered, p_value, undersampled, unusual, evidence.replay)


def _refitted(twin: Twin, best: Hypothesis, kept: list[NamedEffect]) -> Refit:
    return refit(twin, best.whiten, [n.effect for n in kept], best.fit.state)


def _no_worse(
    twin: Twin, best: Hypothesis, kept: list[NamedEffect], fit: Refit, ratio: Callable[[Refit], float]
) -> tuple[list[NamedEffect], Refit]:
    """Remove the effects with the least gain until held-out segments close no worse than without any; or worse by the ratio ``TOLERATED``
    at most, where every remaining effect is also seen in stills.  ratio: of the closures with the effects of a fit and without.

    Effects seen in stills only are tested there.  Those seen in both need not improve the closure: a turn's bias follows its stills anyway.
    """
    while turning := [n for n in kept if "turn" in n.effect.observable_in]:
        in_turns_alone = [n for n in turning if "still" not in n.effect.observable_in]
        after = ratio(fit)
        if after <= (1 if in_turns_alone else TOLERATED):
            break
        weakest = min(in_turns_alone if after <= TOLERATED else turning, key=lambda n: n.gain)
        kept = [n for n in kept if n is not weakest]
        fit = _refitted(twin, best, kept)
    return kept, fit


def named_effect(evidence: Evidence, best: Hypothesis, number: int, chance: dict[str, float], tests: int) -> NamedEffect:
    """An effect of a hypothesis with its Wald test, times the number of tests, and its probability; chance: of each id."""
    effect, claims = best.effects[number], best.fit.state.claims
    part, theta = claim_slice(claims, number), claims[number].theta
    gain = float(theta @ np.linalg.solve(best.fit.covariance[part, part], theta))
    freedom = effect.parameter.size + (effect.scan is not None)
    p_value = min(1.0, tests * float(chdtrc(freedom, gain)))
    rivals = rivals_of(evidence.weighed, best, effect.id)
    return NamedEffect(
        effect,
        p_value,
        gain,
        chance[effect.id],
        tuple(name for name, worse in rivals.items() if worse < STAND_IN),
        {name: chance[name] for name in rivals},
    )
