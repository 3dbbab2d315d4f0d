"""Joint exact refit of the linear model, the Earth, gravity and the claimed effects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.base.units import EARTH_RATE_RPS, MG
from tinygc.effects import AppliedEffect, Effect, catalogue
from tinygc.inference.choose import chi_square_above
from tinygc.models.linear import PRIOR_SIGMA
from tinygc.noise.twin import Channels, State, Twin, claim_slice
from tinygc.noise.whitening import Whitener

# The effects of the catalogue that a recording may show, with the values of their scanned shapes.

#: values over which a shape is scanned; it is refined between them.  More would make the work grow with the square of the session's length
#: (benchmarks/whole_process.py)
MOST_TIMES = 60


def candidates(twin: Twin) -> list[Effect]:
    """Candidate effects for this recording, the sensor's and the reference's; an effect with a scanned shape gives one for each value."""
    found = [*twin.errors]
    for effect in catalogue().values():
        if effect.kind in ("register", "motion") or ("temperature" in effect.inputs and not twin.has_thermometer):
            continue
        if effect.kind != "rate" and not twin.stills:
            continue
        if effect.kind == "earth" and twin.problem.earth.source != "none":
            continue
        if effect.id == "reference.accelerometer" and twin.own_accelerometer:
            continue  # its nine parameters are those of these very stills
        found += effect.variants(scanned(twin, effect))
    return found


def scanned(twin: Twin, effect: Effect) -> np.ndarray:
    """(K,) trial values of an effect's scanned shape, SI: its own grid, or the middles of the turns."""
    if effect.scan is None or effect.scan.grid is None:
        # Middle of each turn except the first and the last, s of the session; a long session uses every n-th turn.
        times = [twin.movements[s.log].t_s[s.start] + s.duration_s / 2 for s in twin.segments][1:-1]
        return np.array(times[:: -(-len(times) // MOST_TIMES) or 1])
    return np.asarray(effect.scan.grid(twin.movements), dtype=float)


# Fit of the scanned shapes on which an effect depends smoothly: a time constant, a period, a dead zone's width.
#
# A scan finds them roughly by linear columns, in rates that the effect still disturbs.  Here they are fitted with all other parameters
# by Gauss-Newton steps, and their uncertainty widens that of the parameters, since a longer time constant changes the coefficients.

#: relative step of the central differences, whose relative error is then 1e-4
STEP = 0.01
#: relative to the value: the prior's sigma, as wide as any grid, and the largest step
LOOSE, FARTHEST = 1.0, 0.3


@dataclass(frozen=True, eq=False)
class Shapes:
    """Shapes of a fit with whitened residuals r (n,), columns J (n, p) and covariance (p, p) at fixed shapes.

    numbers: the claims whose shape is fitted; moves (n, m): derivative of the whitened residuals by the logarithms of these values.
    """

    claims: tuple[AppliedEffect, ...]
    numbers: tuple[int, ...]
    moves: np.ndarray

    @classmethod
    def of(cls, twin: Twin, whiten: Whitener, state: State, rates: list[np.ndarray], sensitivity: np.ndarray) -> Shapes:
        """Compute the shapes of a state with its rates and sensitivity."""
        numbers = tuple(number for number, claim in enumerate(state.claims) if is_fitted(claim.effect))
        moves = [_moves(twin, state.claims[number], state, rates, sensitivity) for number in numbers]
        return cls(state.claims, numbers, whiten(np.stack(moves, axis=1)) if moves else np.zeros((0, 0)))

    def widened(self, J: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """Covariance of the parameters if the shapes are fitted as well."""
        if not self.numbers:
            return covariance
        along = covariance @ (J.T @ self.moves)
        return covariance + along @ np.linalg.solve(self._information(J, along), along.T)

    def stepped(self, r: np.ndarray, J: np.ndarray, held: np.ndarray) -> list[Effect]:
        """All effects after a Gauss-Newton step of the shapes; held: the covariance at fixed shapes, as passed to ``widened``."""
        along = held @ (J.T @ self.moves)
        left = r - J @ (held @ (J.T @ r))
        step = np.clip(-np.linalg.solve(self._information(J, along), self.moves.T @ left), -FARTHEST, FARTHEST)
        effects = [claim.effect for claim in self.claims]
        for number, share in zip(self.numbers, step, strict=True):
            effects[number] = effects[number].at(value_of(effects[number]) * (1 + float(share)))
        return effects

    def _information(self, J: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Information matrix (m, m) of the values with the parameters marginalised."""
        return self.moves.T @ self.moves - (self.moves.T @ J) @ along + np.eye(len(self.numbers)) / LOOSE**2


def is_fitted(effect: Effect) -> bool:
    """Whether an effect has a shape, at a value, that may be fitted."""
    return effect.scan is not None and effect.scan.smooth and effect.shape.get(effect.scan.name, 0.0) != 0


def value_of(effect: Effect) -> float:
    """Value of an effect's scanned shape, SI."""
    assert effect.scan is not None  # callers have checked it
    return float(effect.shape[effect.scan.name] * effect.scan.si)


def _moves(twin: Twin, claim: AppliedEffect, state: State, rates: list[np.ndarray], sensitivity: np.ndarray) -> np.ndarray:
    """(n,) derivative of the residuals by the logarithm of the value of a claim's shape."""
    value = value_of(claim.effect)
    low, high = (
        twin.effect_columns(claim.effect.at(value * (1 + side * STEP)), state, sensitivity, rates).stacked() @ claim.theta
        for side in (-1, 1)
    )
    return (high - low) / (2 * STEP)


# Joint exact refit of the linear model, the Earth's unknown part, gravity, and the claimed effects.
#
# It is Gauss-Newton on the whitened channels.  The residuals are exact (effects are removed, not linearised); the columns are linear, which
# affects the steps but not the solution.  Weak priors bound parameters that no channel observes.

#: greatest number of Gauss-Newton steps; usually ``ENOUGH`` ends the search
MAX_STEPS = 12
#: the search ends when a step reduces chi-square by less than this, a tenth of a sigma
ENOUGH = 0.01
#: greatest number of steps of the shapes, which start near from the scan
SHAPE_STEPS = 4
#: prior sigma of gravity: the accelerometer's scale is within 2 % of g by its data sheet
GRAVITY_SIGMA = 20 * MG
#: prior sigma of a known parameter, negligible to all else
KNOWN = 1e-9


@dataclass(frozen=True, eq=False)
class Refit:
    """Result of a refit.

    state; whitened residuals r (n,) and columns J (n, p) in the order of ``State.vector``, of the rows used; chi_square; covariance (p, p);
    columns_at: the state at which J was computed, which may differ from the final one.  To stay small it holds no data per sample;
    ``Replay`` recomputes them.
    """

    state: State
    r: np.ndarray
    J: np.ndarray
    chi_square: float
    covariance: np.ndarray
    columns_at: State

    @property
    def p_value(self) -> float:
        """Probability that noise leaves a chi-square this large."""
        return chi_square_above(self.chi_square, max(len(self.r) - self.J.shape[1], 1))

    @property
    def widened(self) -> float:
        """Variance inflation from the residuals, 1 or more."""
        return max(1.0, self.chi_square / max(len(self.r) - self.J.shape[1], 1))

    def theta_covariance(self, number: int) -> np.ndarray:
        """Covariance (P, P) of one claim."""
        own = claim_slice(self.state.claims, number)
        return self.covariance[own, own]


def refit(
    twin: Twin, whiten: Whitener, effects: list[Effect], start: State, rows: np.ndarray | None = None, max_steps: int = MAX_STEPS
) -> Refit:
    """Fit with these effects, starting at a state, whose claims give the start values; ``rows`` (n,) bool: the rows used.

    Scanned shapes are fitted where possible (``shapes``): the claims of the result then have new values of them.
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
    """Refit at fixed shapes; also return the effects with improved shapes, None if no shape is fitted."""
    # An effect whose number of parameters changed starts from its initial value.
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
        # A step changes the attitudes along a turn so little that those of the first step suffice for all but the last design.
        J, sensitivity = design(twin, whiten, state, rates, sensitivity)
        scaled = J * prior
        gradient = scaled.T @ r + (state.vector - centre) / prior
        step = -np.linalg.solve(scaled.T @ scaled + np.eye(len(prior)), gradient) * prior
        before = cost(r, state)
        for _ in range(5):
            trial = state.with_vector(state.vector + step)
            with np.errstate(over="ignore", invalid="ignore"):  # too large a step may overflow and is then rejected
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
    covariance = at_known_shapes(J, prior)
    shapes = Shapes.of(twin, whiten, state, rates, sensitivity)
    found = Refit(state, r, J, float(r @ r), shapes.widened(J, covariance), state)
    return found, shapes.stepped(r, J, covariance) if shapes.numbers else None


def at_known_shapes(J: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of the parameters with whitened columns J (n, p) and prior sigmas (p,), were the values of the shapes known."""
    scaled = J * prior
    return np.linalg.inv(scaled.T @ scaled + np.eye(len(prior))) * np.outer(prior, prior)


def design(
    twin: Twin, whiten: Whitener, state: State, rates: list[np.ndarray], sensitivity: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened columns (n, p) of all parameters, and their sensitivity: that of the state, or a known one of a nearby state."""
    sensitivity = twin.sensitivity(state, rates) if sensitivity is None else sensitivity
    parts = [twin.effect_columns(claim.effect, state, sensitivity, rates).stacked() for claim in state.claims]
    return whiten(np.concatenate([calibration_columns(twin, state, sensitivity), *parts], axis=1)), sensitivity


def calibration_columns(twin: Twin, state: State, sensitivity: np.ndarray) -> np.ndarray:
    """Columns (n, 15) of what every recording has: the linear model, the horizontal Earth rate, gravity's length."""
    earth = twin.earth_columns()
    horizontal = Channels(*(part @ state.axes.T for part in (earth.closure, earth.still, earth.length)))
    parts = (twin.linear_columns(sensitivity), horizontal, twin.gravity_columns())
    return np.concatenate([part.stacked() for part in parts], axis=1)


def prior_sigmas(twin: Twin, effects: list[Effect]) -> np.ndarray:
    """(p,) wide prior sigmas, SI, in the order of ``State.vector``; known parameters are fixed."""
    # An error of an estimated heading rotates the Earth's horizontal rate; its length is known.
    free = {"estimated": (1.0, KNOWN), "unknown": (1.0, 1.0)}.get(twin.problem.earth.source, (KNOWN, KNOWN))
    horizontal = np.multiply(free, EARTH_RATE_RPS)
    plausible = [np.full(effect.parameter.size, effect.parameter.plausible) for effect in effects]
    return np.concatenate([PRIOR_SIGMA, horizontal, [GRAVITY_SIGMA], *plausible])


# A scanned shape on which an effect does not depend smoothly, as the moment of a step, is known to some time only: what the effect's size
# and all else would be at its other values is in their covariance.  The values have a flat prior, and each its linear fit:
#
#     P(v) = cell exp(-chi^2(v) / 2) |H(v)|^(-1/2),    covariance = sum of P(v) (H(v)^-1 + s(v) s(v)'),
#
# H the information at the value, s the step of all parameters from the fit to the best ones there.

#: values about the best one, up to its second neighbours on the grid of a scan
NEAR_VALUES = 61


def over_shapes(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """Return the fit with the covariance that its parameters have where the values of such shapes are not known."""
    prior, replay = prior_sigmas(twin, [claim.effect for claim in fit.state.claims]), Replay(twin, fit)
    scaled, covariance = fit.J * prior, fit.covariance
    # At the fit the slope of chi-square vanishes: its priors pull as much as its residuals.
    pull, held = scaled.T @ fit.r, np.linalg.inv(scaled.T @ scaled + np.eye(len(prior)))
    for number, claim in enumerate(fit.state.claims):
        if claim.effect.scan is None or claim.effect.scan.smooth:
            continue
        part, at, grid = claim_slice(fit.state.claims, number), value_of(claim.effect), scanned(twin, claim.effect)
        near = [at, *grid[np.argsort(np.abs(grid - at))[:5]]]
        values = np.unique([*grid, *np.linspace(min(near), max(near), NEAR_VALUES), at])
        scores, parts = [], []
        for columns in whiten.each(map(replay.stacked, claim.effect.variants(values))):
            r, J = fit.r + (columns - fit.J[:, part]) @ claim.theta, scaled.copy()
            J[:, part] = columns * prior[part]
            own = np.linalg.inv(J.T @ J + np.eye(len(prior)))
            step = -own @ (J.T @ r - pull)
            left = r + J @ step
            scores.append(np.linalg.slogdet(own)[1] - float(left @ left - 2 * pull @ step + step @ step))
            parts.append(own + np.outer(step, step))
        cells = np.gradient(values) if len(values) > 1 else np.ones(1)
        weight = cells * np.exp((np.array(scores) - max(scores)) / 2)
        covariance = covariance + np.einsum("v,vij->ij", weight / weight.sum(), np.array(parts) - held) * np.outer(prior, prior)
    return replace(fit, covariance=covariance)


#: values of columns that a replay keeps, 64 MB: enough for the catalogue in sessions of up to about a thousand turns
MOST_KEPT = 1 << 23

# A motion at every sample takes 50 MB for a day with 400 turns: a twin keeps that of its last state, and no fit its own.


class Replay:
    """Rates and sensitivity of a fit, for columns of further effects; recomputed on demand from the fit's states."""

    def __init__(self, twin: Twin, fit: Refit):
        self.twin, self.fit = twin, fit
        self._known: dict[Effect, np.ndarray] = {}

    def of(self, fit: Refit) -> Replay:
        """The replay of a fit of the same twin: this one, with what it knows, where the fit has the same states."""
        same = fit.state is self.fit.state and fit.columns_at is self.fit.columns_at
        return self if same else Replay(self.twin, fit)

    @cached_property
    def rates(self) -> list[np.ndarray]:
        """True rates (N, 3) rad/s of each log at the fit's state."""
        return self.twin.rates(self.fit.state)

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """(S, T, d, 3) s: sensitivity of the fit's columns."""
        at, state = self.fit.columns_at, self.fit.state
        return self.twin.sensitivity(at, self.rates if at is state else self.twin.rates(at))

    def columns(self, effect: Effect) -> Channels:
        """Columns of an effect's parameters, as ``Twin.effect_columns``."""
        return self.twin.effect_columns(effect, self.fit.state, self.sensitivity, self.rates)

    def stacked(self, effect: Effect) -> np.ndarray:
        """(n, P) ``columns``, stacked."""
        found = self._known.get(effect)
        if found is None:
            found = self.columns(effect).stacked()
            # Keep the first columns, not the latest: candidates are evaluated in turn, and a cache of the latest would never hit.
            if sum(each.size for each in self._known.values()) + found.size <= MOST_KEPT:
                self._known[effect] = found
        return found
