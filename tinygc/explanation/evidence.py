"""The evidence of a hypothesis: the probability of the recording if exactly these effects are present."""

from __future__ import annotations

from collections import Counter
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from session.base.numeric import rms_of
from tinygc.effects import Effect
from tinygc.inference.choose import Selection, price
from tinygc.noise.channels import in_gauge
from tinygc.noise.components import SessionNoise, Whiteners, first_noise, noise_with
from tinygc.noise.refit import ENOUGH, Refit, Replay, prior_sigmas, refit, scanned
from tinygc.noise.twin import Twin, claim_slice
from tinygc.noise.whitening import Whitener

# Selection: the group of columns that explains the residuals beyond chance.
#
# What the calibration already fits is projected out of everything.  Each candidate's group of P columns is tested with Fisher's F, which
# uses the residuals' own scale, so its false-alarm rate holds if the noise is larger than stated.  The smallest p-value of so many
# correlated groups is not itself a p-value; its distribution when nothing is missing is drawn by Monte Carlo for this design.


# The best value of a scanned shape.


def selection_of(twin: Twin, whiten: Whitener, fit: Refit, rest: list[Effect], seed: int, replay: Replay | None = None) -> Selection[int]:
    """Test the candidates' whitened columns against what is already fitted.  replay: of the fit, if available."""
    columns = dict(enumerate(whiten.each(map((replay or Replay(twin, fit)).stacked, rest))))
    along = frozenset(number for number, effect in enumerate(rest) if effect.kind == "force")
    # An angle that no reference observes is always 0 and carries no information on the noise scale.
    rows = np.r_[np.flatnonzero(twin.batch.known), whiten.parts["still"]]
    return Selection(fit.J, columns, seed, allowances=whiten.allowances, scale_rows=rows, along=along)


def sharpened(twin: Twin, whiten: Whitener, fit: Refit, effect: Effect, replay: Replay) -> Effect:
    """Refine a scanned shape between its neighbours on the coarse grid, on successively finer grids; replay: of the fit."""
    if effect.scan is None:
        return effect
    values = scanned(twin, effect)
    at = effect.shape[effect.scan.name] * effect.scan.si
    reach = float(np.median(np.diff(values))) if effect.scan.grid is None else spacing(values, at)
    for _ in range(3):
        at = effect.shape[effect.scan.name] * effect.scan.si
        trials = effect.variants(np.linspace(at - reach, at + reach, 15))
        gains = selection_of(twin, whiten, fit, trials, 0, replay).gains(fit.r)
        if not gains:  # unobservable between its neighbours, in addition to the fit
            return effect
        effect = trials[max(gains, key=gains.__getitem__)]
        reach /= 6
    return effect


def spacing(values: np.ndarray, at: float) -> float:
    """Distance to the farther neighbour of a value on its grid, kept short of zero so that the value keeps its sign."""
    number = int(np.argmin(np.abs(values - at)))
    reach = float(np.max(np.abs(np.delete(values, number)[max(number - 1, 0) : number + 1] - at), initial=0.0))
    return min(reach, 0.9 * abs(at)) if at else reach


# The linear estimate of one effect in addition to what is fitted, without selection.


def without_claim(fit: Refit, number: int) -> Refit:
    """Remove a claim from the fit, to first order."""
    part = claim_slice(fit.state.claims, number)
    return replace(fit, r=fit.r - fit.J[:, part] @ fit.state.claims[number].theta, J=np.delete(fit.J, part, axis=1))


# The evidence of a hypothesis: the probability of the recording if exactly these effects are present.
#
#     -2 log p(recording | effects) = log|C| + log|1 + D J' C^-1 J| + r' C^-1 r + theta' D^-1 theta        (Laplace, around the exact refit)
#
# Here C is the noise covariance, re-estimated for every hypothesis: variance that an effect takes over from a noise component counts in
# favour of the effect.  D is the prior covariance of each effect: normal, with one sigma for all parameters of an effect.  That sigma is
# equally probable at every scale up to the catalogue's.  Its best value is the rms of the parameters, so that a strong and a weak effect
# have the same penalty.

#: Gauss-Newton steps before and after the noise is re-estimated: the second fit starts where the first ended
FIRST_STEPS, MORE_STEPS = 5, 2


@dataclass(frozen=True, eq=False)
class Guess:
    """A hypothesis evaluated with linear columns.  effects; score: -2 log of evidence times prior."""

    effects: tuple[Effect, ...]
    score: float

    @property
    def ids(self) -> frozenset[str]:
        """Ids of its effects."""
        return frozenset(effect.id for effect in self.effects)

    def __repr__(self) -> str:
        return f"<{', '.join(sorted(self.ids)) or 'nothing'}: {self.score:.1f}>"


@dataclass(frozen=True, eq=False, repr=False)
class Hypothesis(Guess):
    """A hypothesis evaluated exactly.  fit with all effects; noise: the covariance used in the fit; whiteners: of the recording."""

    fit: Refit
    noise: SessionNoise
    whiteners: Whiteners

    @property
    def whiten(self) -> Whitener:
        """Whitener with the noise of this hypothesis."""
        return self.whiteners.of(self.noise)


def _key(effects: tuple[Effect, ...]) -> tuple:
    values = lambda effect: (round(value, 6) for value in effect.shape.values() if isinstance(value, float))  # noqa: E731
    return tuple(sorted((effect.id, effect.equation, *values(effect)) for effect in effects))


class Evidence:
    """Evidence of the hypotheses of one recording, each evaluated once."""

    def __init__(self, twin: Twin):
        self.twin = twin
        self.whiteners = Whiteners(twin)
        self.first_noise = first_noise(twin, self.whiteners.white)
        self._known: dict[tuple, Hypothesis] = {}
        self._guesses: dict[tuple, Guess] = {}
        self._shapes: dict[str, int] = {}
        self.nothing = self.of((), None)
        self.replay = Replay(twin, self.nothing.fit)

    @property
    def first_whiten(self) -> Whitener:
        """Whitener with the noise before any fit."""
        return self.whiteners.of(self.first_noise)

    def first_p(self, tried: list[Effect], seed: int) -> float:
        """Family-wise p-value of what these candidates would explain, compared with no effect."""
        nothing = self.nothing
        return selection_of(self.twin, nothing.whiten, nothing.fit, tried, seed, self.replay).p_value(nothing.fit.r)

    @property
    def weighed(self) -> list[Guess]:
        """All hypotheses so far, evaluated exactly or by their linear columns."""
        return [*self._known.values(), *(guess for key, guess in self._guesses.items() if key not in self._known)]

    def of(self, effects: tuple[Effect, ...], begin: Hypothesis | None) -> Hypothesis:
        """Evaluate the hypothesis with these effects; the fit starts from another hypothesis."""
        key = _key(effects)
        if key not in self._known:
            self._known[key] = self._weigh(effects, begin)
        return self._known[key]

    def _weigh(self, effects: tuple[Effect, ...], begin: Hypothesis | None) -> Hypothesis:
        twin = self.twin
        whiten = self.first_whiten if begin is None else begin.whiten
        # Start from the gauge: an earlier fit without this effect may have a common delay that ran far away.
        state = twin.start() if begin is None else in_gauge(twin, begin.whiten, begin.fit).state
        fit, noise = refit(twin, whiten, list(effects), state, max_steps=FIRST_STEPS), self.first_noise
        for start in (None, True):
            r, J = whiten.back(fit.r), whiten.back(fit.J) * self.prior(fit)
            del whiten  # the memory of its factor is that of the next one
            noise = self.first_noise.estimated(self.whiteners.white.base, r, J, noise.s if start else None)
            whiten = self.whiteners.of(noise, keep=bool(start))
            fit = settled(twin, whiten, refit(twin, whiten, list(effects), fit.state, max_steps=MORE_STEPS))
        # The part of theta' D^-1 theta that ``price`` leaves out: the squared penalty of a claim larger than plausible.
        prior, found = self.prior(fit), 0.0
        for number, claim in enumerate(fit.state.claims):
            size = float(np.sum((claim.theta / prior[claim_slice(fit.state.claims, number)]) ** 2))
            found += max(size - claim.effect.parameter.size, 0.0)
        score = noise.value + sum(self.price(effect) for effect in effects) + found
        return Hypothesis(effects, score, fit, noise, self.whiteners)

    def guess(self, have: Hypothesis, *, without: Effect | None = None, add: Effect | None = None) -> Guess:
        """Approximate, by linear columns, a hypothesis with one effect removed, added or replaced; the noise is re-estimated."""
        effects = tuple(e for e in have.effects if e is not without) + ((add,) if add is not None else ())
        key = _key(effects)
        if key in self._known:
            return Guess(effects, self._known[key].score)
        if key not in self._guesses:
            self._guesses[key] = Guess(effects, self._guessed(have, without, add) + sum(self.price(effect) for effect in effects))
        return self._guesses[key]

    def _guessed(self, have: Hypothesis, without: Effect | None, add: Effect | None) -> float:
        r, J, prior = have.whiten.back(have.fit.r), have.whiten.back(have.fit.J), self.prior(have.fit)
        if without is not None:
            number = next(i for i, effect in enumerate(have.effects) if effect is without)
            part = claim_slice(have.fit.state.claims, number)
            r = r - J[:, part] @ have.fit.state.claims[number].theta
            J, prior = (np.delete(values, part, axis=-1) for values in (J, prior))
        columns = np.zeros((len(r), 0)) if add is None else self.columns(add) * add.parameter.plausible
        return noise_with(self.first_noise, have.whiten, have.whiten.base, r, J * prior, columns, have.noise.s).value

    def columns(self, effect: Effect) -> np.ndarray:
        """(n, P) stacked change of the channels per unit of each parameter, from the linear model, which is accurate enough for ranking."""
        return self.replay.stacked(effect)

    def prior(self, fit: Refit) -> np.ndarray:
        """(p,) prior sigmas of all parameters; for a claim, the rms of its own parameters."""
        prior = prior_sigmas(self.twin, [claim.effect for claim in fit.state.claims])
        for number, claim in enumerate(fit.state.claims):
            part = claim_slice(fit.state.claims, number)
            # The lower limit is the sigma of the best-known direction: an unobservable direction carries no information on the size.
            least = float(np.sqrt(max(np.linalg.eigvalsh(fit.covariance[part, part])[0], 0.0)))
            rms = rms_of(claim.theta)
            prior[part] = min(max(rms, least, 1e-6 * claim.effect.parameter.plausible), claim.effect.parameter.plausible)
        return prior

    def price(self, effect: Effect) -> float:
        """Complexity penalty of an effect, -2 log: its prior odds, its scale, the number of shapes tried under its id, and the position of
        the parameters within their prior."""
        shapes = self._shapes.get(effect.id, 1) if effect.scan is None else len(scanned(self.twin, effect))
        return price(effect.parameter.size, shapes)

    def without(self, component: str) -> Evidence:
        """Return the evidence of the same recording with one noise component removed."""
        other, noise = copy(self), self.first_noise
        kept = np.array([c.name != component for c in noise.components])
        components = tuple(c for c in noise.components if c.name != component)
        other.first_noise = replace(noise, components=components, s=noise.s[kept], sigma=noise.sigma[kept])
        other._known, other._guesses = {}, {}
        other.nothing = other.of((), None)
        other.replay = Replay(self.twin, other.nothing.fit)
        return other

    @property
    def exact(self) -> list[Hypothesis]:
        """Hypotheses that were evaluated exactly."""
        return list(self._known.values())

    def forget(self, ids: frozenset[str]) -> None:
        """Discard all hypotheses with any of these effects."""
        self._known = {key: h for key, h in self._known.items() if not h.ids & ids}
        self._guesses = {key: guess for key, guess in self._guesses.items() if not guess.ids & ids}

    def will_try(self, tried: list[Effect]) -> None:
        """Count the unscanned shapes that share an id, for their complexity penalty."""
        self._shapes |= Counter(effect.id for effect in tried)


def settled(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """Return the fit with a delay common to all axes reset to the gauge if this costs no chi-square, else refit from the gauge.  The
    direction is hardly observable, so a search can run far along it."""
    gauged = in_gauge(twin, whiten, fit)
    if gauged.chi_square > fit.chi_square - ENOUGH:
        return replace(fit, state=gauged.state, r=gauged.r, chi_square=gauged.chi_square)
    return in_gauge(twin, whiten, refit(twin, whiten, [claim.effect for claim in fit.state.claims], gauged.state))
