"""What each turn by itself says of an effect: its closure, with all else of the fit kept, projected on what the effect would make of it.

To first order a small rate error turns a segment's end by the sum of sensitivity times rate.  So a constant scale error or offset of one
axis, or one unit of a parameter, has one column of closure in each turn, and the turn's own estimate is the least-squares share of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from session.common.units import DEG
from tinygc.effects import Movement
from tinygc.explanation.pictures.channel_values import theta
from tinygc.explanation.pictures.law_curve import at_constant
from tinygc.explanation.twin.variable import READ, Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

#: what a turn's closure is expressed as, of each sample's movement (N, 3): a share of the rate, or a rate that is added
CARRIERS: dict[str, Callable[[Movement], np.ndarray]] = {"scale": lambda m: m.rate, "offset": lambda m: np.ones_like(m.rate)}
#: turns that hardly turn about an axis say nothing of it: beyond this many times the sigma of the best tenth they are left out
FAINT = 4.0
#: share of the curve's height by which a turn may stand beside it: a turn of both senses has no place on one of sense
OFF_CURVE = 0.1
#: points of a law's curve on which the place of a turn is looked up
GRID = 201


@dataclass(frozen=True, eq=False)
class OfTurns:
    """Of one axis or parameter, in SI, of the S' turns that tell of it.

    x (S',): where a turn stands, in people's units of its variable, or the closure (rad) that one unit makes; before, after (S',): what
    its closure asks for without this part of the effect, and with it; sigma (S',) from noise; law (S',): what the effect says.
    """

    x: np.ndarray
    before: np.ndarray
    after: np.ndarray
    sigma: np.ndarray
    law: np.ndarray


def turn_columns(e: Explanation, claim: Claim) -> np.ndarray:
    """(S, d, P) rad: what one SI unit of each parameter adds to the closure of each turn."""
    return -e.replay.columns(claim.effect).closure


def turn_sigma(e: Explanation) -> np.ndarray:
    """(S, d) rad: the floor of each angle of closure, widened as the claims' own sigmas are, by what is left."""
    fit = e.naming.fit
    widen = max(1.0, float(fit.r @ fit.r) / max(len(fit.r) - int(np.sum(~e.twin.batch.known)) - fit.J.shape[1], 1))
    return e.twin.problem.floor.sigma * np.sqrt(widen)


def left_by_turn(e: Explanation) -> np.ndarray:
    """(S, d) rad that the fit leaves with all of its effects in it."""
    return e.twin.residuals(e.naming.fit.state, e.replay.rates).closure


def without(e: Explanation, claim: Claim, entries: Sequence[int]) -> np.ndarray:
    """(S, d) rad of closure once these parameters are zero, exactly, and all else is as the fit has it."""
    state, some = e.naming.fit.state, theta(e, claim).copy()
    some[list(entries)] = 0.0
    claims = tuple(replace(each, theta=some) if each.effect.id == claim.effect.id else each for each in state.claims)
    return e.twin.residuals(replace(state, claims=claims)).closure


def per_turn(e: Explanation, claim: Claim, carrier: str, axis: int, variable: Variable) -> OfTurns:
    """The scale error (fraction) or offset (rad/s) that each turn asks for on one axis, where the turn stands along the variable.

    An effect with one parameter for each axis.  A turn stands where a constant movement would have its law, as the law itself weighs
    the turn: a cubic sees fast moments more than slow ones.  Turns that went both ways, and those that hardly turn about the axis, stand
    nowhere and are left out; which ones does not depend on what they ask for.
    """
    twin, replay = e.twin, e.replay
    columns, sigma = turn_columns(e, claim), turn_sigma(e)
    movements = [movement.with_rate(rate) for movement, rate in zip(twin.movements, replay.rates, strict=True)]
    carried = twin.padded([CARRIERS[carrier](movement) for movement in movements])[:, :, axis]
    of_samples = replay.sensitivity[:, :, :, axis] * carried[:, :, None]
    share, own_sigma = projector(of_samples.sum(axis=1), sigma)
    weight = np.einsum("sd,std->st", share, of_samples)
    along = _padded_scalar(e, [_along(variable, movement, axis) for movement in movements])
    mean = np.sum(weight * along, axis=1)
    unit = np.einsum("sd,sd->s", share, columns[:, :, axis])
    before, after = (np.einsum("sd,sd->s", share, angles) for angles in (without(e, claim, [axis]), left_by_turn(e)))
    keep = telling(own_sigma) & np.isfinite(mean)
    span = np.array([np.min(along[keep]), np.max(along[keep])]) if keep.any() else np.zeros(2)
    one = np.eye(3)[axis]

    def curve(at: np.ndarray) -> np.ndarray:
        return at_constant(claim.effect, one, movements[0], variable, axis, at, per_rate=carrier == "scale")

    x, law = standing(mean, unit, curve, span), unit * theta(e, claim)[axis]
    keep &= one_way(weight, along, mean)
    keep[keep] &= _on_curve(unit[keep], curve(x[keep]))
    return OfTurns(x[keep], before[keep], after[keep], own_sigma[keep], law[keep])


def per_parameter(e: Explanation, claim: Claim, entry: int) -> OfTurns:
    """The closure that each turn misses along the direction in which one parameter moves it, rad; x of one SI unit, rad.

    Added-variable: a straight line through zero whose slope is the parameter.
    """
    columns, sigma = turn_columns(e, claim), turn_sigma(e)
    own = columns[:, :, entry]
    size = np.linalg.norm(own, axis=1)
    largest = np.argmax(np.abs(own), axis=1)
    signed = size * np.sign(own[np.arange(len(own)), largest])
    ahead = np.divide(own, signed[:, None], out=np.zeros_like(own), where=size[:, None] > 0)
    before, after = (np.einsum("sd,sd->s", ahead, angles) for angles in (without(e, claim, [entry]), left_by_turn(e)))
    noise = np.sqrt(np.sum((ahead * sigma) ** 2, axis=1))
    keep = size > 0
    return OfTurns(signed[keep], before[keep], after[keep], noise[keep], (signed * theta(e, claim)[entry])[keep])


def strongest(e: Explanation, claim: Claim, most: int = 3) -> list[int]:
    """Parameters that move the closure most, in sigmas of noise, in their own order."""
    moved = turn_columns(e, claim) * theta(e, claim) / turn_sigma(e)[:, :, None]
    power = np.sum(moved**2, axis=(0, 1))
    return sorted(int(entry) for entry in np.argsort(power)[::-1][:most])


def projector(column: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S, d) that gives the least-squares share of a column (S, d) in angles of these sigmas; its own sigma (S,), inf where it is none."""
    weighted = column / sigma**2
    power = np.sum(weighted * column, axis=1)
    share = np.divide(weighted, power[:, None], out=np.zeros_like(column), where=power[:, None] > 0)
    return share, np.divide(1.0, np.sqrt(power), out=np.full(len(power), np.inf), where=power > 0)


def telling(sigma: np.ndarray) -> np.ndarray:
    """(S,) bool."""
    return sigma <= FAINT * np.quantile(sigma, 0.1)


def one_way(weight: np.ndarray, along: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """(S,) bool: those whose weights, of a turn there and back of either sign, still give a mean within what the variable was."""
    seen = weight != 0
    low, high = (np.max(np.where(seen, side * along, -np.inf), axis=1) for side in (-1, 1))
    return (mean >= -low) & (mean <= high)


def _on_curve(unit: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """(S',) bool: turns on which the law of one unit acts as at a constant movement; a law with a jump has none for both sides of it."""
    return np.abs(unit - curve) <= OFF_CURVE * np.max(np.abs(curve), initial=0.0)


def _along(variable: Variable, movement: Movement, axis: int) -> np.ndarray:
    """(N,) of the variable; a rate with its sign, so that both ways round are told apart."""
    if variable.variable == "rate":
        return movement.rate[:, axis] / DEG
    values = READ[variable.variable][0](movement)
    return values if values.ndim == 1 else values[:, axis]


def _padded_scalar(e: Explanation, of_logs: list[np.ndarray]) -> np.ndarray:
    """(S, T) of values (N,) for each log."""
    return e.twin.padded([np.repeat(values[:, None], 3, axis=1) for values in of_logs])[:, :, 0]


def standing(mean: np.ndarray, unit: np.ndarray, curve: Callable[[np.ndarray], np.ndarray], span: np.ndarray) -> np.ndarray:
    """(S,) where on a curve of one unit each turn's own unit stands, on its mean's side of zero; the mean where no curve tells it."""
    found = mean.copy()
    for side in (-1, 1):
        low, high = np.clip(span, *((0, np.inf) if side > 0 else (-np.inf, 0)))
        if not high > low:
            continue
        at = np.linspace(low, high, GRID)
        values = curve(at)
        rise = np.diff(values[1:-1])
        if not ((rise > 0).all() or (rise < 0).all()):
            continue
        at, values = (at, values) if rise[0] > 0 else (at[::-1], values[::-1])
        here = (np.sign(mean) == side) & (unit >= values[1]) & (unit <= values[-2])
        found[here] = np.interp(unit[here], values[1:-1], at[1:-1])
    return found
