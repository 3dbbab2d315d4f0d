"""The evidence of a hypothesis: how probable the recording is, if these effects and no others are there.

    -2 log p(recording | effects) = log|C| + log|1 + D J' C^-1 J| + r' C^-1 r + theta' D^-1 theta        (Laplace, around the exact refit)

C holds the noise as it is (``explanation/noise``), re-estimated for every hypothesis: what a name takes over from a noise component
speaks for the name.  D is the prior size of each effect: normal, with one sigma for all parameters of an effect, which is itself as
probable at every scale up to the catalogue's; its best value is the parameters' own rms, so that a strong and a weak effect pay alike.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from tinygc.effects import Effect
from tinygc.explanation.naming.candidates import scanned
from tinygc.explanation.noise.session_noise import SessionNoise, first_noise
from tinygc.explanation.noise.whiteners import Whiteners
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.refit import ENOUGH, Refit, prior_sigmas, refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.state import State
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: of any effect of the catalogue, before the recording is looked at, and of any shape without a name: a recording shows none of twenty
#: effects in one case of three or so
PRIOR_ODDS = 1 / 30
#: the scale of an effect is known to a factor of e within ten of them, from what is never seen to what no sensor has
SCALES = 10.0
#: Gauss-Newton steps before and after the noise has been re-estimated: the second fit begins where the first ended
FIRST_STEPS, MORE_STEPS = 5, 2
#: numbers of candidates' columns that are kept, 64 MB of them: those of the catalogue in sessions of up to a thousand turns or so
MOST_KEPT = 1 << 23
#: of the search for the noise beside a guess: it begins where a near hypothesis has it
GUESS_STEPS = 7


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """effects; fit with all of them; noise: the covariance that it was fitted with; score: -2 log of evidence times prior; whiteners: of
    the recording."""

    effects: tuple[Effect, ...]
    fit: Refit
    noise: SessionNoise
    score: float
    whiteners: Whiteners

    @property
    def whiten(self) -> Whitener:
        """With its noise."""
        return self.whiteners.of(self.noise)

    @property
    def ids(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(effect.id for effect in self.effects)

    def __repr__(self) -> str:
        return f"<{', '.join(sorted(self.ids)) or 'nothing'}: {self.score:.1f}>"


@dataclass(frozen=True, eq=False)
class Guess:
    """effects, and the score that their linear columns promise."""

    effects: tuple[Effect, ...]
    score: float

    @property
    def ids(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(effect.id for effect in self.effects)


def _key(effects: tuple[Effect, ...]) -> tuple:
    values = lambda effect: (round(value, 6) for value in effect.shape.values() if isinstance(value, float))  # noqa: E731
    return tuple(sorted((effect.id, effect.equation, *values(effect)) for effect in effects))


class Evidence:
    """Hypotheses of one recording, each weighed once.  odds: of effects that a lot of such units is known to have, by id."""

    def __init__(self, twin: Twin, odds: Mapping[str, float] | None = None):
        self.twin, self._odds = twin, odds or {}
        self.whiteners = Whiteners(twin)
        self.first_noise = first_noise(twin, self.whiteners.white)
        self.first_whiten = self.whiteners.white.with_more(self.first_noise.covariance)
        self._known: dict[tuple, Hypothesis] = {}
        self._guesses: dict[tuple, Guess] = {}
        self._shapes: dict[str, int] = {}
        self._columns: dict[Effect, np.ndarray] = {}
        self.nothing = self.of((), None)
        self._replay = Replay(twin, self.nothing.fit)

    @property
    def weighed(self) -> list[Hypothesis | Guess]:
        """All hypotheses so far: weighed exactly, or else by their linear columns."""
        return [*self._known.values(), *(guess for key, guess in self._guesses.items() if key not in self._known)]

    def of(self, effects: tuple[Effect, ...], begin: Hypothesis | None) -> Hypothesis:
        """The hypothesis of these effects; the fit begins from another's."""
        key = _key(effects)
        if key not in self._known:
            self._known[key] = self._weigh(effects, begin)
        return self._known[key]

    def _weigh(self, effects: tuple[Effect, ...], begin: Hypothesis | None) -> Hypothesis:
        twin = self.twin
        whiten = self.first_whiten if begin is None else begin.whiten
        state = twin.start() if begin is None else self._gauged_start(begin)
        fit, noise = refit(twin, whiten, list(effects), state, max_steps=FIRST_STEPS), self.first_noise
        for start in (None, True):
            noise = self._noise(whiten, fit, noise.s if start else None)
            whiten = self.whiteners.of(noise)
            fit = settled(twin, whiten, refit(twin, whiten, list(effects), fit.state, max_steps=MORE_STEPS))
        score = noise.value + sum(self.price(effect) for effect in effects) + self._implausible(fit)
        return Hypothesis(effects, fit, noise, score, self.whiteners)

    def _implausible(self, fit: Refit) -> float:
        """theta' D^-1 theta beyond what ``price`` has of it: a claim that is larger than plausible pays by its square."""
        prior, found = self.prior(fit), 0.0
        for number, claim in enumerate(fit.state.claims):
            size = float(np.sum((claim.theta / prior[claim_slice(fit.state.claims, number)]) ** 2))
            found += max(size - claim.effect.parameter.size, 0.0)
        return found

    def _noise(self, whiten: Whitener, fit: Refit, start: np.ndarray | None) -> SessionNoise:
        return self.first_noise.estimated(whiten, whiten.back(fit.r), whiten.back(fit.J) * self.prior(fit), start)

    def guess(self, have: Hypothesis, *, without: Effect | None = None, add: Effect | None = None) -> Guess:
        """A hypothesis with one effect less, one more, or one in another's place, by linear columns; the noise is estimated anew."""
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
        if add is not None:
            J = np.concatenate([J, self.columns(add)], axis=1)
            prior = np.concatenate([prior, np.full(add.parameter.size, add.parameter.plausible)])
        # Everything moves to where the new columns are best.
        white_r, white_J = have.whiten(r), have.whiten(J) * prior
        step = -np.linalg.solve(white_J.T @ white_J + np.eye(len(prior)), white_J.T @ white_r)
        if add is not None:
            prior[-add.parameter.size :] *= max(float(np.sqrt(np.mean(step[-add.parameter.size :] ** 2))), 1e-6)
            white_J = have.whiten(J) * prior
            step = -np.linalg.solve(white_J.T @ white_J + np.eye(len(prior)), white_J.T @ white_r)
        J = J * prior
        return self.first_noise.estimated(have.whiten, r + J @ step, J, have.noise.s, steps=GUESS_STEPS).value

    def columns(self, effect: Effect) -> np.ndarray:
        """(n, P) stacked, as one unit of each parameter moves the channels: by the linear model, which is near enough to rank by."""
        found = self._columns.get(effect)
        if found is None:
            found = self._replay.columns(effect).stacked()
            # Not those asked for last: all are asked for in turn, and who comes too late for the memo would always find it full of others.
            if sum(each.size for each in self._columns.values()) + found.size <= MOST_KEPT:
                self._columns[effect] = found
        return found

    def _gauged_start(self, begin: Hypothesis) -> State:
        # Not from where an earlier effect's common delay has run while this one was missing.
        return in_gauge(self.twin, begin.whiten, begin.fit).state

    def prior(self, fit: Refit) -> np.ndarray:
        """(p,) prior sigmas of all parameters: of each claim, the rms of its own."""
        return self.prior_of(self.twin, fit)

    @staticmethod
    def prior_of(twin: Twin, fit: Refit) -> np.ndarray:
        """The same, of any fit."""
        prior = prior_sigmas(twin, [claim.effect for claim in fit.state.claims])
        for number, claim in enumerate(fit.state.claims):
            part = claim_slice(fit.state.claims, number)
            # At least what the best known of their directions is known to: one that nothing sees says nothing of their size.
            least = float(np.sqrt(max(np.linalg.eigvalsh(fit.covariance[part, part])[0], 0.0)))
            rms = float(np.sqrt(np.mean(claim.theta**2)))
            prior[part] = min(max(rms, least, 1e-6 * claim.effect.parameter.plausible), claim.effect.parameter.plausible)
        return prior

    def price(self, effect: Effect) -> float:
        """Twice the logarithm of what a name costs before it is looked at: its prior odds, its scale, the shapes that were tried under its
        name, and the parameters' own place within their prior."""
        shapes = self._shapes.get(effect.id, 1) if effect.scan is None else len(scanned(self.twin, effect))
        return price(effect, shapes, self._odds.get(effect.id))

    def without(self, component: str) -> Evidence:
        """The same recording, where the noise has no such component."""
        other, noise = copy(self), self.first_noise
        kept = np.array([c.name != component for c in noise.components])
        components = tuple(c for c in noise.components if c.name != component)
        other.first_noise = replace(noise, components=components, s=noise.s[kept], sigma=noise.sigma[kept])
        other.first_whiten = self.whiteners.white.with_more(other.first_noise.covariance)
        other._known, other._guesses = {}, {}
        other.nothing = other.of((), None)
        other._replay = Replay(self.twin, other.nothing.fit)
        return other

    @property
    def exact(self) -> list[Hypothesis]:
        """Those that were weighed exactly."""
        return list(self._known.values())

    def forget(self, ids: frozenset[str]) -> None:
        """Hypotheses with any of these effects are no longer weighed."""
        self._known = {key: h for key, h in self._known.items() if not h.ids & ids}
        self._guesses = {key: guess for key, guess in self._guesses.items() if not guess.ids & ids}

    def will_try(self, tried: list[Effect]) -> None:
        """Shapes without a scan that share a name: each is one of so many."""
        self._shapes |= Counter(effect.id for effect in tried)


def price(effect: Effect, shapes: int, odds: float | None = None) -> float:
    """``Evidence.price`` of an effect of which so many shapes are tried; odds: of the effect, where a lot tells them.

    The lot's size is not asked for here: a unit may have more of it, or less, than the others (``verdict/of_the_lot.py``).
    """
    return 2 * float(np.log(SCALES / (odds or PRIOR_ODDS)) + np.log(shapes)) + effect.parameter.size


def least_gain(effect: Effect, shapes: int) -> float:
    """Chi-square that an effect must take up to be as probable as nothing: each parameter also pays the logarithm of its signal over its
    noise."""
    size = effect.parameter.size
    return float(brentq(lambda gain: gain - size * np.log(gain / size) - price(effect, shapes), size, 1e4))


def settled(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """The fit where a delay that all axes share stands where it can be: such a direction is hardly seen, and a search that has run far
    along it goes on from the gauge."""
    gauged = in_gauge(twin, whiten, fit)
    if gauged.chi_square > fit.chi_square - ENOUGH:
        return replace(fit, state=gauged.state, r=gauged.r, chi_square=gauged.chi_square)
    return in_gauge(twin, whiten, refit(twin, whiten, [claim.effect for claim in fit.state.claims], gauged.state))
