"""The numbers behind the pictures: channels, laws, what each turn says, an effect's own picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from session.io.units import DEG
from tinygc.attitude import rotation
from tinygc.closure.residual import closure_angles
from tinygc.effects import Effect, EffectError, Movement, PictureData
from tinygc.effects.effect import ENERGY_LAW, SCALE_LAW
from tinygc.explanation.claims import Claim, theta_of
from tinygc.explanation.engine import Explanation
from tinygc.noise.twin import READ, Variable, variable_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# What a picture of an explanation shows of the twin's channels: what is left in them, and what an effect says of it.
#
# The fit holds all that is drawn against a variable, with a name or without one.  So what it leaves is after, and with the effect added
# again it is before.


def told(e: Explanation) -> Claim | None:
    """The strongest effect that adds to the rates, which is what can be drawn against a variable."""
    return next((claim for claim in [*e.claimed, *e.findings] if claim.effect.kind == "rate"), None)


def theta(e: Explanation, claim: Claim) -> np.ndarray:
    """(P,) SI, the parameters of a claim as the fit has them."""
    return theta_of(claim.effect, claim.parameters, e.naming.fit.state)


def variable_for(e: Explanation, claim: Claim | None) -> Variable:
    """The variable that a claim is drawn against; time where there is none."""
    return variable_of(None) if claim is None else variable_of(claim.effect, theta(e, claim))


def rates_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual rates (Q, 3) dps in the stills, before and after."""
    before, after = (e.twin.residuals(fit.state).still / DEG for fit in (e.naming.first, e.naming.fit))
    return before, after


def lengths_per_still(e: Explanation) -> tuple[np.ndarray, np.ndarray]:
    """Residual lengths of gravity (Q,) m/s^2 in the stills, before and after."""
    before, after = (e.twin.residuals(fit.state).length for fit in (e.naming.first, e.naming.fit))
    return before, after


def added_in_stills(e: Explanation, claim: Claim, values: np.ndarray | None = None) -> np.ndarray:
    """(Q, 3) dps that an effect adds to each still's mean rate; values (P,) SI in place of its parameters, to see a part of it."""
    twin = e.twin
    values = theta(e, claim) if values is None else values
    if claim.effect.kind == "earth":
        return np.einsum("qji,j->qi", rotation.matrix(twin.q_tb), values) / DEG
    by_log = [claim.effect.columns(m.with_rate(rate)) @ values for m, rate in zip(twin.movements, e.replay.rates, strict=True)]
    return np.array([by_log[log][still.start : still.stop].mean(axis=0) for log, still in twin.stills]) / DEG


def recorded_in_stills(e: Explanation, claim: Claim) -> np.ndarray:
    """(Q, 3) dps that the recording has in each still of what the effect should explain."""
    _, after = rates_per_still(e)
    return after + added_in_stills(e, claim)


def added_to_closure(e: Explanation, claim: Claim) -> tuple[np.ndarray, np.ndarray]:
    """(S, d) rad that an effect adds to the closure of each segment, to first order, and what the recording has of it."""
    added = -e.replay.columns(claim.effect).closure @ theta(e, claim)
    return added, e.twin.residuals(e.naming.fit.state, e.replay.rates).closure + added


def closure_as_recorded(e: Explanation) -> dict[int, float]:
    """Closure in degrees, by the segment's number, of what was recorded with nothing mended, by the linear model of what was mended."""
    angles = closure_angles(e.problem.batch, e.naming.fit.state.model)
    return dict(zip((segment.number for segment in e.problem.used), np.linalg.norm(angles[:, :2], axis=1) / DEG, strict=True))


def closure_by_segment(e: Explanation) -> tuple[dict[int, float], dict[int, float]]:
    """Held-out closure in degrees by the segment's number, before and after."""
    before, after = (np.linalg.norm(angles[:, :2], axis=1) / DEG for angles in (e.proof.before, e.proof.after))
    return dict(zip(e.proof.before_numbers, before, strict=True)), dict(zip(e.proof.after_numbers, after, strict=True))


# The curve of an effect's own law: what it adds at a constant movement, along the variable that it follows.


def at_constant(
    effect: Effect, theta: np.ndarray, like: Movement, variable: Variable, axis: int, at: np.ndarray, *, per_rate: bool = False
) -> np.ndarray:
    """(K,) rad/s that the effect adds to one axis at each value (K,) of the variable, in people's units; a share of the rate on request.

    like: a log whose session, sampling period and full scale count.  An effect that is asked for a share where the rate is no
    variable has it at one tenth of full scale.
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


# What each turn by itself says of an effect: its closure, with all else of the fit kept, projected on what the effect would make of it.
#
# To first order a small rate error turns a segment's end by the sum of sensitivity times rate.  So a constant scale error or offset of one
# axis, or one unit of a parameter, has one column of closure in each turn, and the turn's own estimate is the least-squares share of it.

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


# The law of an effect with one parameter for each axis, ready to be drawn: what each turn asks for, and the curve, in people's units.

#: a picture's name -> what carries its law in ``per_turn``, and what that is called
CARRIED = {SCALE_LAW: ("scale", "scale error"), ENERGY_LAW: ("offset", "zero-rate offset")}
#: of the greatest scale error: from which on it is told in per cent, not in millionths
PER_CENT = 1e-3
#: points of a curve: even, so that none is at the zero of a rate, of which nothing is a share
POINTS = 400


@dataclass(frozen=True, eq=False)
class AxisLaws:
    """words: what turns ask for; follows: the variable's; unit: of values; x_label; turns: of each axis, values in that unit; curves: of
    each axis, where (K,) and the law there (K,)."""

    words: str
    follows: str
    unit: str
    x_label: str
    turns: list[OfTurns]
    curves: list[tuple[np.ndarray, np.ndarray]]

    @property
    def reached(self) -> np.ndarray:
        """(n,) all places of turns and curves."""
        return np.concatenate([*(of.x for of in self.turns), *(at for at, _ in self.curves)])

    @property
    def asked(self) -> np.ndarray:
        """(n,) all values of turns, as recorded, and of curves."""
        return np.concatenate([*(of.before for of in self.turns), *(values for _, values in self.curves)])


def axis_laws(e: Explanation, claim: Claim) -> AxisLaws | None:
    """Of an effect whose picture names such a law.  None where no axis is its own, or no constant movement has the law."""
    variable, pair = variable_for(e, claim), claim.effect.pair
    if not isinstance(pair, str) or pair not in CARRIED:
        return None
    if claim.effect.parameter.size != 3 or claim.effect.reach or variable.variable == "angular acceleration":
        return None
    carrier, words = CARRIED[pair]
    turns = [per_turn(e, claim, carrier, axis, variable) for axis in range(3)]
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


def _curve(e: Explanation, claim: Claim, carrier: str, variable: Variable, axis: int, of: OfTurns) -> tuple[np.ndarray, np.ndarray]:
    """Where (K,), and the law there (K,) SI, along what the axis's turns reach; of a rate, as far to either side."""
    span = np.max(np.abs(of.x), initial=0.0)
    low, high = (-span, span) if variable.variable == "rate" else (np.min(of.x, initial=np.inf), np.max(of.x, initial=-np.inf))
    if variable.variable == "vibration":
        low = min(low, 0.0)
    if not high > low:
        return np.zeros(0), np.zeros(0)
    at = np.linspace(low, high, POINTS)
    return at, at_constant(claim.effect, theta(e, claim), e.twin.movements[0], variable, axis, at, per_rate=carrier == "scale")


# An effect that draws its own picture: it is handed plain arrays, and the two axes.


def picture_data(e: Explanation, claim: Claim) -> PictureData:
    """What there is to draw of a claim that adds to the rates."""
    variable, (before, after) = variable_for(e, claim), rates_per_still(e)
    closure_says, closure_recorded = added_to_closure(e, claim)
    return PictureData(
        theta=theta(e, claim),
        parameters=claim.parameters,
        std=claim.std,
        variable=variable.words,
        unit=variable.units,
        of_stills=variable.of_stills(e.twin),
        of_segments=variable.of_segments(e.twin),
        stills_s=Variable("time").of_stills(e.twin),
        before=before * DEG,
        after=after * DEG,
        says=added_in_stills(e, claim) * DEG,
        numbers=np.array([segment.number for segment in e.twin.segments]),
        closure_says=closure_says,
        closure_recorded=closure_recorded,
        floor_rad=float(e.proof.floor_rms),
    )


def draw_own(e: Explanation, claim: Claim, left: Axes, right: Axes) -> None:
    """Call the effect's own function.  EffectError, with what it said, where it fails."""
    own = claim.effect.pair
    assert callable(own)
    try:
        own(picture_data(e, claim), left, right)
    except Exception as error:
        what = " ".join(str(error).split())
        raise EffectError(
            f"{claim.effect.id}: its picture cannot be drawn: {type(error).__name__}: {what}; --no-pictures goes on"
        ) from None
