"""Refit the linear model, the Earth, gravity and the claimed effects together, exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.io.units import EARTH_RATE_RPS, MG
from tinygc.effects import AppliedEffect, Effect
from tinygc.models.linear import PRIOR_SIGMA
from tinygc.noise.twin import Channels, State, Twin, claim_slice
from tinygc.noise.whitening import Whitener

# Scanned shapes that may be fitted, since what the effect adds changes smoothly with them: a time constant, a period, a dead zone's width.
#
# A scan puts them near their best by linear columns, in rates that the effect still disturbs.  Here they are fitted with all else, a
# Gauss-Newton step at a time, and their own uncertainty widens that of the parameters: a time constant that is a little longer asks for
# other coefficients.

#: of the value: a central difference is then off by a ten-thousandth of what it shows
STEP = 0.01
#: of the value: a prior's sigma, as wide as any grid; and the farthest that one step goes
LOOSE, FARTHEST = 1.0, 0.3


@dataclass(frozen=True, eq=False)
class Shapes:
    """Of a fit with whitened residuals r (n,), columns J (n, p) and covariance (p, p) that held its shapes: numbers of the claims whose
    shape may be fitted; moves (n, m), whitened, how the residuals change with these values, each as a share of itself."""

    claims: tuple[AppliedEffect, ...]
    numbers: tuple[int, ...]
    moves: np.ndarray

    @classmethod
    def of(cls, twin: Twin, whiten: Whitener, state: State, rates: list[np.ndarray], sensitivity: np.ndarray) -> Shapes:
        """Of a state, with its rates and sensitivity."""
        numbers = tuple(number for number, claim in enumerate(state.claims) if is_fitted(claim.effect))
        moves = [_moves(twin, state.claims[number], state, rates, sensitivity) for number in numbers]
        return cls(state.claims, numbers, whiten(np.stack(moves, axis=1)) if moves else np.zeros((0, 0)))

    def widened(self, J: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """The covariance of the parameters where these shapes are fitted, too."""
        if not self.numbers:
            return covariance
        along = covariance @ (J.T @ self.moves)
        return covariance + along @ np.linalg.solve(self._information(J, along), along.T)

    def stepped(self, r: np.ndarray, J: np.ndarray, held: np.ndarray) -> list[Effect]:
        """All effects, with these shapes where their linear columns are best; held: the covariance that ``widened`` was given."""
        along = held @ (J.T @ self.moves)
        left = r - J @ (held @ (J.T @ r))
        step = np.clip(-np.linalg.solve(self._information(J, along), self.moves.T @ left), -FARTHEST, FARTHEST)
        effects = [claim.effect for claim in self.claims]
        for number, share in zip(self.numbers, step, strict=True):
            effects[number] = effects[number].at(value_of(effects[number]) * (1 + float(share)))
        return effects

    def _information(self, J: np.ndarray, along: np.ndarray) -> np.ndarray:
        """(m, m) of the values, whatever the parameters are."""
        return self.moves.T @ self.moves - (self.moves.T @ J) @ along + np.eye(len(self.numbers)) / LOOSE**2


def is_fitted(effect: Effect) -> bool:
    """Whether it has a shape, at a value, that may be fitted."""
    return effect.scan is not None and effect.scan.smooth and effect.shape.get(effect.scan.name, 0.0) != 0


def value_of(effect: Effect) -> float:
    """Of its scanned shape, SI."""
    assert effect.scan is not None  # who asks has seen it
    return float(effect.shape[effect.scan.name] * effect.scan.si)


def _moves(twin: Twin, claim: AppliedEffect, state: State, rates: list[np.ndarray], sensitivity: np.ndarray) -> np.ndarray:
    """(n,) how the residuals change with the value of a claim's shape, as a share of itself."""
    value = value_of(claim.effect)
    low, high = (
        twin.effect_columns(claim.effect.at(value * (1 + side * STEP)), state, sensitivity, rates).stacked() @ claim.theta
        for side in (-1, 1)
    )
    return (high - low) / (2 * STEP)


# Refit everything together: the linear model, the Earth's unknown part, gravity, and the claimed effects, exactly.
#
# Gauss-Newton on the whitened channels.  The residuals are exact (effects are undone, not linearised); the columns are linear, which
# changes where the steps go but not where they end.  Weak priors keep what no channel sees from wandering.

#: Gauss-Newton: iterations, not a bar; ``ENOUGH`` ends it
MAX_STEPS = 12
#: a step that gains less than this in chi-square, a tenth of a sigma, is the last
ENOUGH = 0.01
#: of shapes that may be fitted: the scan has put them near
SHAPE_STEPS = 4
#: prior: the site's gravity and the accelerometer's scale, 2 % of g by its data sheet
GRAVITY_SIGMA = 20 * MG
#: of what is known, as a prior's sigma: small beside everything
KNOWN = 1e-9


@dataclass(frozen=True, eq=False)
class Refit:
    """Where the search ended.

    state; whitened residuals r (n,) and columns J (n, p) in the order of ``State.vector``, of the rows that counted; chi_square;
    covariance (p, p); columns_at: the state that J was taken at, which may be another than the one that was settled on.  Small, for a
    hypothesis each: what the columns rest on sample by sample is made again by ``Replay``.
    """

    state: State
    r: np.ndarray
    J: np.ndarray
    chi_square: float
    covariance: np.ndarray
    columns_at: State

    def theta_covariance(self, number: int) -> np.ndarray:
        """(P, P) of one claim."""
        own = claim_slice(self.state.claims, number)
        return self.covariance[own, own]


def refit(
    twin: Twin, whiten: Whitener, effects: list[Effect], start: State, rows: np.ndarray | None = None, max_steps: int = MAX_STEPS
) -> Refit:
    """Fit with these effects, from a state whose own claims give their starting values; ``rows`` (n,) bool: those that count.

    Scanned shapes that may be fitted are (``shapes``): the claims of the answer then have other values of them than were given.
    """
    whiten = whiten if rows is None else whiten.only(rows)
    best, ahead = _refit(twin, whiten, effects, start, max_steps)
    for _ in range(SHAPE_STEPS):
        if ahead is None:
            break
        found, ahead = _refit(twin, whiten, ahead, best.state, max_steps)
        if found.chi_square > best.chi_square - ENOUGH:
            break
        best = found
    return best


def _refit(twin: Twin, whiten: Whitener, effects: list[Effect], start: State, max_steps: int) -> tuple[Refit, list[Effect] | None]:
    """With all shapes held; and the effects with better ones, None where there are none to be fitted."""
    # An effect with more numbers than it had begins anew.
    known = {(claim.effect.id, len(claim.theta)): claim.theta for claim in start.claims}
    begin = (known.get((e.id, e.parameter.size), np.full(e.parameter.size, e.begin)) for e in effects)
    state = replace(start, claims=tuple(AppliedEffect(e, theta) for e, theta in zip(effects, begin, strict=True)))
    centre = replace(twin.start(), claims=tuple(AppliedEffect(e, np.zeros(e.parameter.size)) for e in effects)).vector
    prior = prior_sigmas(twin, effects)
    rates = twin.rates(state)
    r = whiten(twin.residuals(state, rates).stacked())

    def cost(r: np.ndarray, state: State) -> float:
        return float(r @ r + np.sum(((state.vector - centre) / prior) ** 2))

    sensitivity = None
    for _ in range(max_steps):
        # A step turns the attitudes along a turn by far less than their own size: those of the first step do for all but the last design.
        J, sensitivity = design(twin, whiten, state, rates, sensitivity)
        scaled = J * prior
        gradient = scaled.T @ r + (state.vector - centre) / prior
        step = -np.linalg.solve(scaled.T @ scaled + np.eye(len(prior)), gradient) * prior
        before = cost(r, state)
        for _ in range(5):
            trial = state.with_vector(state.vector + step)
            with np.errstate(over="ignore", invalid="ignore"):  # a step too far may overflow, and then gains nothing
                trial_rates = twin.rates(trial)
                trial_r = whiten(twin.residuals(trial, trial_rates).stacked())
            gain = before - cost(trial_r, trial)
            if gain > 0:
                state, rates, r = trial, trial_rates, trial_r
                break
            step = step / 3
        if gain < ENOUGH:
            break
    del sensitivity
    J, sensitivity = design(twin, whiten, state, rates)
    scaled = J * prior
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(len(prior))) * np.outer(prior, prior)
    shapes = Shapes.of(twin, whiten, state, rates, sensitivity)
    found = Refit(state, r, J, float(r @ r), shapes.widened(J, covariance), state)
    return found, shapes.stepped(r, J, covariance) if shapes.numbers else None


def design(
    twin: Twin, whiten: Whitener, state: State, rates: list[np.ndarray], sensitivity: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened columns (n, p) of all parameters, and the sensitivity they rest on: the state's own, or a near one that is known."""
    sensitivity = twin.sensitivity(state, rates) if sensitivity is None else sensitivity
    earth = twin.earth_columns()
    horizontal = Channels(*(part @ state.axes.T for part in (earth.closure, earth.still, earth.length)))
    parts = [twin.linear_columns(sensitivity), horizontal, twin.gravity_columns()]
    parts += [twin.effect_columns(claim.effect, state, sensitivity, rates) for claim in state.claims]
    return whiten(np.concatenate([part.stacked() for part in parts], axis=1)), sensitivity


def prior_sigmas(twin: Twin, effects: list[Effect]) -> np.ndarray:
    """(p,) generous sigmas, SI, in the order of ``State.vector``; what is known is held."""
    # A heading that was estimated may be wrong, which turns the Earth's horizontal rate; its length is known.
    free = {"estimated": (1.0, KNOWN), "unknown": (1.0, 1.0)}.get(twin.problem.earth.source, (KNOWN, KNOWN))
    horizontal = np.multiply(free, EARTH_RATE_RPS)
    plausible = [np.full(effect.parameter.size, effect.parameter.plausible) for effect in effects]
    return np.concatenate([PRIOR_SIGMA, horizontal, [GRAVITY_SIGMA], *plausible])


# A fit's movement, sample by sample: of a day with 400 turns 50 MB, so that no fit keeps its own.


class Replay:
    """What columns of effects beside a fit rest on; made where they are asked for, of the states that the fit keeps."""

    def __init__(self, twin: Twin, fit: Refit):
        self.twin, self.fit = twin, fit

    @cached_property
    def rates(self) -> list[np.ndarray]:
        """True rates (N, 3) rad/s of each log, where the fit stands."""
        return self.twin.rates(self.fit.state)

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """(S, T, d, 3) s, that the fit's own columns rest on."""
        at, state = self.fit.columns_at, self.fit.state
        return self.twin.sensitivity(at, self.rates if at is state else self.twin.rates(at))

    def columns(self, effect: Effect) -> Channels:
        """Of an effect's parameters, as ``Twin.effect_columns``."""
        return self.twin.effect_columns(effect, self.fit.state, self.sensitivity, self.rates)
