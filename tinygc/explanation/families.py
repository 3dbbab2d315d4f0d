"""Families of effects that few recordings separate: one statement with its alternatives, instead of one name that hides the others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from session.base.texts import significant
from session.base.units import DEG
from tinygc.effects import Effect
from tinygc.explanation.claims import Claim
from tinygc.noise.twin import Twin

#: slow motions of the zero-rate offset: id -> what it would be
SLOW_ZERO = {
    "gyro.bias_drift": "a steady drift or slow warm-up",
    "gyro.bias_step": "a jump",
    "gyro.thermal_bias": "temperature",
    "unknown.warm_up": "a warm-up within the session",
    "unknown.curve_over_time": "a smooth curve over time",
}
#: share of a family's probability from which on its best member is named alone
NAMED = 0.95


@dataclass(frozen=True)
class SlowZero:
    """The zero-rate offset moves slowly.  size_rps: from its lowest to its highest over the session, on the axis where it moves most;
    shares: of each alternative in the family's probability, by id, the most probable first; thermometer: whether temperature was recorded.
    """

    size_rps: float
    axis: int
    shares: dict[str, float]
    thermometer: bool

    @property
    def is_open(self) -> bool:
        """Whether there are alternatives: several are probable, or no thermometer recorded what temperature did."""
        return not self.thermometer or next(iter(self.shares.values())) < NAMED

    @property
    def words(self) -> str:
        """Return one sentence without its full stop."""
        moves = f"the zero-rate offset moves by {significant(self.size_rps / DEG, 2)} dps on {'xyz'[self.axis]} over the session"
        return f"{moves}, {alternatives(self.shares, self.thermometer)}"

    def to_json(self) -> dict:
        """Return one entry of ``families`` of ``tinygc-explain/2``."""
        return {"id": "slow_zero", "size_dps": self.size_rps / DEG, "shares": self.shares, "description": self.words}


def alternatives(shares: Mapping[str, float], thermometer: bool) -> str:
    """``most likely a jump (0.7), or temperature (0.3)``; one alone where it has nearly all of the probability.  Without a thermometer
    temperature was not weighed, so the shares are those of the others."""
    (first, share), *others = shares.items()
    among, end = ("", "") if thermometer else (" among those weighed", "; temperature was not recorded")
    if share >= NAMED:
        return f"as {SLOW_ZERO[first]} ({share:.2f}{among}){end}"
    others_text = "".join(f", or {SLOW_ZERO[name]} ({part:.2f})" for name, part in others if part >= 1 - NAMED)
    return f"most likely {SLOW_ZERO[first]} ({share:.2f}{among}){others_text}{end}"


def shares_of(weights: Mapping[str, float]) -> dict[str, float]:
    """Divide weights by their sum; the largest first."""
    total = sum(weights.values())
    return {name: weight / total for name, weight in sorted(weights.items(), key=lambda item: -item[1])}


def slow_zero(twin: Twin, claims: Iterable[Claim]) -> SlowZero | None:
    """The family's statement of one session; None where no member is claimed.

    Where several are claimed at once, their motions add, and the weights of each with what was weighed in its place.
    """
    mine = [claim for claim in claims if claim.effect.id in SLOW_ZERO]
    if not mine:
        return None
    weights: dict[str, float] = {}
    for claim in mine:
        for name, p in {claim.effect.id: claim.probability, **claim.rivals}.items():
            if name in SLOW_ZERO:
                weights[name] = weights.get(name, 0.0) + p
    size, axis = motion(twin, [(claim.effect, claim.theta) for claim in mine])
    return SlowZero(size, axis, shares_of(weights), twin.has_thermometer)


def motion(twin: Twin, applied: Iterable[tuple[Effect, np.ndarray]]) -> tuple[float, int]:
    """rad/s from the lowest to the highest of what effects with parameters (P,) add over a session, and the axis where that is most."""
    applied = list(applied)
    added = np.concatenate([sum(effect.columns(m) @ theta for effect, theta in applied) for m in twin.movements])
    reach = np.ptp(added, axis=0)
    return float(reach.max()), int(reach.argmax())
