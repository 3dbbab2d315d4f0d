"""What a model must be told beside the rate, and how far around a sample it looks; from what its effects declare."""

from __future__ import annotations

from tinygc.effects import AppliedEffect
from tinygc.effects.reach import NOWHERE, Reach
from tinygc.models.model import Model

#: half the temperature's mean over a second, with which a log by itself is calibrated, and some more
TEMPERATURE_REACH = Reach.around(samples=2, seconds=0.55)
#: what an effect's input is called in a call of the model
TOLD = {"force": "acc", "vibration": "acc", "temperature": "temp"}


class Needs:
    """Of one model: ``told``, some of acc, temp and rate_hz; ``effects``, ids of those that it undoes."""

    def __init__(self, model: Model):
        self._claims: tuple[AppliedEffect, ...] = model.undone
        self.effects: tuple[str, ...] = tuple(claim.effect.id for claim in self._claims)
        inputs = {*model.conditions, *(name for claim in self._claims for name in claim.effect.inputs)}
        told = {TOLD[name] for name in inputs if name in TOLD}
        if any(claim.effect.needs_rate_hz for claim in self._claims):
            told.add("rate_hz")
        self.told = tuple(what for what in ("acc", "temp", "rate_hz") if what in told)

    @property
    def looks_ahead(self) -> tuple[str, ...]:
        """Ids of the effects that are undone from what comes after a sample, and so not while only the past is known."""
        return tuple(sorted(claim.effect.id for claim in self._claims if claim.effect.looks(claim.theta).is_ahead))

    @property
    def of_one_session(self) -> tuple[str, ...]:
        """Ids of the effects that follow the time of the model's own session."""
        return tuple(sorted(claim.effect.id for claim in self._claims if claim.effect.of_one_session))

    def around(self, rate_hz: float | None, live: bool) -> tuple[int, int]:
        """How many samples before and after one its rate depends on."""
        reach = sum((claim.effect.looks(claim.theta) for claim in self._claims), NOWHERE)
        if "temp" in self.told and not live:
            reach += TEMPERATURE_REACH
        return reach.rows(rate_hz or 1.0)
