"""The law of an effect with one parameter for each axis, ready to be drawn: what each turn asks for, and the curve, in people's units."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.common.units import DEG
from tinygc.effects.picture import ENERGY_LAW, SCALE_LAW
from tinygc.explanation.pictures.channel_values import theta, variable_for
from tinygc.explanation.pictures.law_curve import at_constant
from tinygc.explanation.pictures.turn_values import OfTurns, per_turn
from tinygc.explanation.twin.variable import Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

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
