"""Numbers behind the pictures: channels, laws, estimates of each turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from session.base import rotation
from session.base.texts import measured
from session.base.units import DEG
from tinygc.closure.residual import closure_angles
from tinygc.effects import Effect, Movement
from tinygc.effects.effect import ENERGY_LAW, SCALE_LAW
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.noise.twin import READ, Variable, variable_of

# Labels: a parameter's name, and its value with its sigma in a readable unit.

#: unit of a parameter -> factor to a more readable unit, and its name
READS: dict[str, tuple[float, str]] = {
    "s": (1e3, "ms"),
    "fraction": (1e2, "%"),
    "fraction of full scale": (1e2, "% of full scale"),
    "1/°C": (1e6, "ppm/°C"),
}


def entry_name(effect: Effect, entry: int) -> str:
    """Name ``x``; ``x from y`` in a matrix; otherwise the parameter's name, with a number if there are several."""
    shape = effect.parameter.shape
    if shape == (3,):
        return "xyz"[entry]
    if shape == (3, 3):
        return f"{'xyz'[entry // 3]} from {'xyz'[entry % 3]}"
    return f"{effect.parameter.name} {entry + 1}" if effect.parameter.size > 1 else effect.parameter.name


def _value(claim: Claim, entry: int) -> tuple[float, float]:
    """A parameter and its sigma in the unit of its effect; NaN if the claim states other numbers instead."""
    name = claim.effect.parameter.name
    values, sigmas = (np.ravel(given.get(name, np.nan)) for given in (claim.parameters, claim.std))
    return (float(values[entry]), float(sigmas[entry])) if entry < len(values) and entry < len(sigmas) else (np.nan, np.nan)


def value_text(claim: Claim, entry: int) -> str:
    """Text ``-4.21 ± 0.05 ms``, to the sigma's first digits; empty if the claim states other numbers."""
    value, sigma = _value(claim, entry)
    if not np.isfinite(value):
        return ""
    unit = claim.effect.parameter.unit
    times, words = READS.get(unit, (1.0, unit))
    return f"{measured(times * value, times * sigma)} {words}".strip()


# Residuals of the twin's channels, and the contribution of an effect to them.
#
# The fit contains all effects that are drawn against a variable, named or not.  So its residuals are "after"; with the effect's
# contribution added back they are "before".


def rates_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual rates (Q, 3) dps in the stills, before and after."""
    before, after = (e.twin.residuals(fit.state).still / DEG for fit in (e.naming.first, e.naming.fit))
    return before, after


def lengths_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual lengths of gravity (Q,) m/s^2 in the stills, before and after."""
    before, after = (e.twin.residuals(fit.state).length for fit in (e.naming.first, e.naming.fit))
    return before, after


def added_in_stills(e: Explanation, claim: Claim, values: np.ndarray | None = None) -> np.ndarray:
    """Contribution of an effect to each still's mean rate, (Q, 3) dps; values (P,) SI replace its parameters, to isolate a part."""
    twin = e.twin
    values = claim.theta if values is None else values
    if claim.effect.kind == "earth":
        return np.einsum("qji,j->qi", rotation.matrix(twin.q_tb), values) / DEG
    by_log = [claim.effect.columns(m.with_rate(rate)) @ values for m, rate in zip(twin.movements, e.replay.rates, strict=True)]
    return np.array([by_log[log][still.start : still.stop].mean(axis=0) for log, still in twin.stills]) / DEG


def recorded_in_stills(e: Explanation, claim: Claim) -> np.ndarray:
    """Part of each still's recorded rate, (Q, 3) dps, that the effect should explain."""
    _, after = rates_per_still(e)
    return after + added_in_stills(e, claim)


def closure_as_recorded(e: Explanation) -> dict[int, float]:
    """Closure in degrees by segment number, without data repair, under the linear model fitted to the repaired data."""
    angles = closure_angles(e.problem.batch, e.naming.fit.state.model)
    return dict(zip((segment.number for segment in e.problem.used), np.linalg.norm(angles[:, :2], axis=1) / DEG, strict=True))


def closure_by_segment(e: Explanation) -> tuple[dict[int, float], dict[int, float]]:
    """Held-out closure in degrees by segment number, before and after."""
    before, after = (np.linalg.norm(angles[:, :2], axis=1) / DEG for angles in (e.proof.before, e.proof.after))
    return dict(zip(e.proof.before_numbers, before, strict=True)), dict(zip(e.proof.after_numbers, after, strict=True))


# The curve of an effect's law: its contribution at a constant movement, along the variable that it follows.


def at_constant(
    effect: Effect, theta: np.ndarray, like: Movement, variable: Variable, axis: int, at: np.ndarray, *, per_rate: bool = False
) -> np.ndarray:
    """Rate (K,) rad/s that the effect adds to one axis at each value (K,) of the variable, in display units; or its ratio to the rate.

    like: a log whose session, sampling period and full scale apply.  If the rate is not the variable, the ratio is that at one tenth of
    full scale.
    """
    count = len(at)
    vector = np.zeros((count, 3))
    rate = np.zeros((count, 3))
    if per_rate and variable.variable != "rate":
        rate[:, axis] = like.fs_rps / 10
    one = like.with_rate(rate)
    one = replace(
        one,
        t_s=np.full(count, like.t_s.mean()),
        force_g=vector,
        temp_c=np.full(count, np.nanmean(like.temp_c) if np.isfinite(like.temp_c).any() else np.nan),
        vibration_g2=np.zeros(count),
    )
    if variable.variable == "rate":
        rate[:, axis] = at * DEG
    elif variable.variable == "temperature":
        one = replace(one, temp_c=at)
    elif variable.variable == "time":
        one = replace(one, t_s=at)
    elif variable.variable == "vibration":
        one = replace(one, vibration_g2=at)
    elif variable.variable == "attitude":
        vector[:, axis if variable.axis is None else variable.axis] = -at
    added = effect.distort(one, np.asarray(theta, dtype=float)) - one.rate
    if not per_rate:
        return added[:, axis]
    return np.divide(added[:, axis], one.rate[:, axis], out=np.full(count, np.nan), where=one.rate[:, axis] != 0)


# Estimate of an effect from each turn alone: the turn's closure, with the rest of the fit kept, projected on the effect's closure.
#
# To first order a small rate error turns a segment's end by the sum of sensitivity times rate.  So a constant scale error or offset of one
# axis, or one unit of a parameter, has one column of closure in each turn, and the turn's own estimate is the least-squares share of it.

#: unit rate error of each sample's movement (N, 3) that a turn's closure is expressed in: a share of the rate, or an added rate
CARRIERS: dict[str, Callable[[Movement], np.ndarray]] = {"scale": lambda m: m.rate, "offset": lambda m: np.ones_like(m.rate)}
#: turns whose sigma exceeds this multiple of the best tenth's are left out, since they hardly turn about the axis
FAINT = 4.0
#: largest distance of a turn from the curve, as a share of its height: the law of a one-way turn does not hold for a two-way turn
OFF_CURVE = 0.1
#: points of a law's curve on which a turn is located
GRID = 801


@dataclass(frozen=True, eq=False)
class TurnEstimates:
    """Estimates of one axis or parameter, in SI, from the S' turns that observe it.

    x (S',): value of the variable at each turn, in display units, or the closure (rad) of one unit of the parameter; before, after (S',):
    estimate from the turn without this part of the effect, and with it; sigma (S',) from noise; law (S',): prediction of the effect.
    """

    x: np.ndarray
    before: np.ndarray
    after: np.ndarray
    sigma: np.ndarray
    law: np.ndarray


def turn_columns(e: Explanation, claim: Claim) -> np.ndarray:
    """Change of each turn's closure, (S, d, P) rad, per SI unit of each parameter."""
    return -e.replay.columns(claim.effect).closure


def turn_sigma(e: Explanation) -> np.ndarray:
    """Floor of each closure angle, (S, d) rad, inflated by the residuals as the claims' own sigmas are."""
    fit = e.naming.fit
    widen = max(1.0, float(fit.r @ fit.r) / max(len(fit.r) - int(np.sum(~e.twin.batch.known)) - fit.J.shape[1], 1))
    return e.twin.problem.floor.sigma * np.sqrt(widen)


def left_by_turn(e: Explanation) -> np.ndarray:
    """Closure residuals, (S, d) rad, of the fit with all of its effects."""
    return e.twin.residuals(e.naming.fit.state, e.replay.rates).closure


def without(e: Explanation, claim: Claim, entries: Sequence[int]) -> np.ndarray:
    """Closure, (S, d) rad, computed exactly with these parameters at zero and the rest of the fit unchanged."""
    state, some = e.naming.fit.state, claim.theta.copy()
    some[list(entries)] = 0.0
    claims = tuple(replace(each, theta=some) if each.effect.id == claim.effect.id else each for each in state.claims)
    return e.twin.residuals(replace(state, claims=claims)).closure


def _per_turn(e: Explanation, claim: Claim, carrier: str, axis: int, variable: Variable) -> TurnEstimates:
    """Scale error (fraction) or offset (rad/s) of one axis estimated from each turn, located along the variable.

    Requires an effect with one parameter per axis.  A turn is located where a constant movement would have the same law, weighted as the
    law weights the turn: a cubic weights fast moments more than slow ones.  Turns in both senses, and those that hardly turn about the
    axis, are left out; this selection does not depend on their estimates.
    """
    twin, columns = e.twin, turn_columns(e, claim)
    movements = [movement.with_rate(rate) for movement, rate in zip(twin.movements, e.replay.rates, strict=True)]
    carried = twin.padded([CARRIERS[carrier](movement) for movement in movements])[:, :, axis]
    share, weight, own_sigma = projector(e.replay.sensitivity[:, :, :, axis] * carried[:, :, None], turn_sigma(e))
    by_log = [np.repeat(_along(variable, movement, axis)[:, None], 3, axis=1) for movement in movements]
    along = twin.padded(by_log)[:, :, 0]
    mean = np.sum(weight * along, axis=1)
    unit = np.einsum("sd,sd->s", share, columns[:, :, axis])
    before, after = (np.einsum("sd,sd->s", share, angles) for angles in (without(e, claim, [axis]), left_by_turn(e)))
    keep = informative(own_sigma) & np.isfinite(mean)
    span = np.array([np.min(along[keep]), np.max(along[keep])]) if keep.any() else np.zeros(2)
    one = np.eye(3)[axis]

    def curve(at: np.ndarray) -> np.ndarray:
        return at_constant(claim.effect, one, movements[0], variable, axis, at, per_rate=carrier == "scale")

    x, law = standing(mean, unit, curve, span), unit * claim.theta[axis]
    keep &= one_way(weight, along, mean)
    # The law of one unit acts on a turn as at a constant movement, except on a turn that crosses a jump of the law.
    at_turns = curve(x[keep])
    keep[keep] &= np.abs(unit[keep] - at_turns) <= OFF_CURVE * np.max(np.abs(at_turns), initial=0.0)
    return TurnEstimates(x[keep], before[keep], after[keep], own_sigma[keep], law[keep])


def per_parameter(e: Explanation, claim: Claim, entry: int) -> TurnEstimates:
    """Closure residual of each turn along the direction in which one parameter moves it, rad; x: closure of one SI unit, rad.

    This is an added-variable plot: a straight line through zero whose slope is the parameter.
    """
    angles = without(e, claim, [entry]), left_by_turn(e)
    signed, (before, after), noise = ahead_of(turn_columns(e, claim)[:, :, entry], angles, turn_sigma(e))
    keep = signed != 0
    return TurnEstimates(signed[keep], before[keep], after[keep], noise[keep], (signed * claim.theta[entry])[keep])


def ahead_of(own: np.ndarray, angles: Sequence[np.ndarray], sigma: np.ndarray) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Along the direction of each turn's column own (S, d), its largest angle's sign kept: its length (S,), the angles (S,) of (S, d), and
    their sigma."""
    size = np.linalg.norm(own, axis=1)
    signed = size * np.sign(own[np.arange(len(own)), np.argmax(np.abs(own), axis=1)])
    ahead = np.divide(own, signed[:, None], out=np.zeros_like(own), where=size[:, None] > 0)
    noise = np.sqrt(np.sum((ahead * sigma) ** 2, axis=1))
    return signed, [np.einsum("sd,sd->s", ahead, each) for each in angles], noise


def strongest(e: Explanation, claim: Claim, most: int = 3) -> list[int]:
    """Indices, ascending, of the parameters that move the closure most, in sigmas of noise."""
    moved = turn_columns(e, claim) * claim.theta / turn_sigma(e)[:, :, None]
    power = np.sum(moved**2, axis=(0, 1))
    return sorted(int(entry) for entry in np.argsort(power)[::-1][:most])


def projector(of_samples: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (S, d) of the least-squares share of what its samples (S, T, d) do to each turn, in angles of these sigmas; the weights
    (S, T) of the samples in it; its sigma (S,), inf where they do nothing."""
    column = of_samples.sum(axis=1)
    weighted = column / sigma**2
    power = np.sum(weighted * column, axis=1)
    share = np.divide(weighted, power[:, None], out=np.zeros_like(column), where=power[:, None] > 0)
    own_sigma = np.divide(1.0, np.sqrt(power), out=np.full(len(power), np.inf), where=power > 0)
    return share, np.einsum("sd,std->st", share, of_samples), own_sigma


def informative(sigma: np.ndarray) -> np.ndarray:
    """Turns that observe the axis, (S,) bool."""
    return sigma <= FAINT * np.quantile(sigma, 0.1)


def one_way(weight: np.ndarray, along: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Turns whose weighted mean lies within the range of the variable, (S,) bool; weights of both signs may put it outside."""
    seen = weight != 0
    low, high = (np.max(np.where(seen, side * along, -np.inf), axis=1) for side in (-1, 1))
    return (mean >= -low) & (mean <= high)


def _along(variable: Variable, movement: Movement, axis: int) -> np.ndarray:
    """Value of the variable (N,); a rate keeps its sign, which separates both senses."""
    if variable.variable == "rate":
        return movement.rate[:, axis] / DEG
    values = READ[variable.variable][0](movement)
    return values if values.ndim == 1 else values[:, axis]


def standing(mean: np.ndarray, unit: np.ndarray, curve: Callable[[np.ndarray], np.ndarray], span: np.ndarray) -> np.ndarray:
    """Place (S,) of each turn's value on a curve that never turns back, on its mean's side of zero; the mean if the curve does not
    determine it, as where it is flat."""
    found = mean.copy()
    for side in (-1, 1):
        low, high = np.clip(span, *((0, np.inf) if side > 0 else (-np.inf, 0)))
        if not high > low:
            continue
        at = np.linspace(low, high, GRID)[1:-1]
        values = curve(at)
        if values[0] > values[-1]:
            at, values = at[::-1], values[::-1]
        rises = np.concatenate([[True], np.diff(values) > 0])
        if not np.all(np.diff(values) >= 0) or rises.sum() < 2:
            continue
        here = (np.sign(mean) == side) & (unit > values[0]) & (unit < values[-1])
        found[here] = np.interp(unit[here], values[rises], at[rises])
    return found


# The law of an effect with one parameter per axis, as drawn: estimates of each turn and the curve, in display units.

#: a picture's name -> carrier of its law in ``_per_turn``, and its label
CARRIED = {SCALE_LAW: ("scale", "scale error"), ENERGY_LAW: ("offset", "zero-rate offset")}
#: largest scale error from which on it is shown in per cent instead of ppm
PER_CENT = 1e-3
#: points of a curve; an even number avoids a rate of zero, where a ratio to the rate is undefined
POINTS = 400


@dataclass(frozen=True, eq=False)
class AxisLaws:
    """Law of each axis, as drawn.

    words: name of the estimated quantity; follows: name of the variable; unit: of values; x_label; turns: for each axis, values in that
    unit; curves: for each axis, variable (K,) and law (K,).
    """

    words: str
    follows: str
    unit: str
    x_label: str
    turns: list[TurnEstimates]
    curves: list[tuple[np.ndarray, np.ndarray]]


def axis_laws(e: Explanation, claim: Claim) -> AxisLaws | None:
    """Laws of an effect whose picture needs them.  None if it has no parameter per axis, or if no constant movement has the law."""
    variable, pair = variable_of(claim.effect, claim.theta), claim.effect.pair
    if pair not in CARRIED:
        return None
    if claim.effect.parameter.size != 3 or claim.effect.reach or variable.variable == "angular acceleration":
        return None
    carrier, words = CARRIED[pair]
    turns = [_per_turn(e, claim, carrier, axis, variable) for axis in range(3)]
    curves = [_curve(e, claim, carrier, variable, axis, turns[axis]) for axis in range(3)]
    unit, one = ("dps", DEG)
    if carrier == "scale":
        greatest = max(np.max(np.abs(values), initial=0.0) for _, values in curves)
        unit, one = ("%", 1e-2) if greatest >= PER_CENT else ("ppm", 1e-6)
    where = "rate about the axis in the turn, with its sense" if variable.variable == "rate" else f"{variable.words} in the turn"
    return AxisLaws(
        words=words,
        follows=variable.words,
        unit=unit,
        x_label=f"{where} ({variable.units})",
        turns=[replace(of, before=of.before / one, after=of.after / one, sigma=of.sigma / one, law=of.law / one) for of in turns],
        curves=[(at, values / one) for at, values in curves],
    )


def _curve(e: Explanation, claim: Claim, carrier: str, variable: Variable, axis: int, of: TurnEstimates) -> tuple[np.ndarray, np.ndarray]:
    """Variable (K,) and law (K,) SI over the range of the axis's turns; for a rate, the range is symmetric about zero."""
    span = np.max(np.abs(of.x), initial=0.0)
    low, high = (-span, span) if variable.variable == "rate" else (np.min(of.x, initial=np.inf), np.max(of.x, initial=-np.inf))
    if variable.variable == "vibration":
        low = min(low, 0.0)
    if not high > low:
        return np.zeros(0), np.zeros(0)
    at = np.linspace(low, high, POINTS)
    return at, at_constant(claim.effect, claim.theta, e.twin.movements[0], variable, axis, at, per_rate=carrier == "scale")
