"""A calibration that also corrects physical effects; and its file."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from session.base.errors import CalibrationError, FormatError
from session.base.results import Array, Keys, ListOf, Maybe, Number, Text, require
from session.log.samples import Samples
from tinygc.effects import AppliedEffect, Conditions, Effect, EffectError, Movement, effect_of, movement_of
from tinygc.effects.effect import READINGS
from tinygc.models.linear import BIAS, PARAMETERS, LinearModel
from tinygc.models.model import CELSIUS, RATE, Model
from tinygc.models.nets import CalibrationNet, weight

# Reference conditions of a model as JSON: ``conditions`` of ``tinygc-model/1``.

#: no session is longer than a year
_YEAR_S = 366 * 86400.0
CONDITIONS_TABLE = Keys(
    {"duration_s": Number(0, _YEAR_S), "fs_rps": Number(0, RATE.high, above=True), "first_temp_c": Maybe(CELSIUS)},
)


def known_of(table: dict, inputs: Collection[str], where: str) -> Conditions:
    """Read the reference conditions from a table that ``CONDITIONS_TABLE`` has validated; inputs: the model's inputs other than the rate.

    Raises FormatError if it depends on temperature and the reference temperature is missing.
    """
    known = table["conditions"]
    if known["first_temp_c"] is None and "temperature" in inputs:
        raise FormatError(f"{where}: conditions.first_temp_c is null, expected a number: the model follows temperature; fit again")
    first = known["first_temp_c"]
    return Conditions(float(known["duration_s"]), float(known["fs_rps"]), float("nan") if first is None else float(first))


# A calibration that corrects the physical effects that `explain` identified or the user requested.

#: tolerance on the session's duration, as a share: a log's own data rate and data repair may change its end
PAST_END = 0.01
#: rad/s: below this dependence an effect counts as independent of the rate
RATES_ALIKE = 1e-12


@dataclass(frozen=True, eq=False)
class PhysicsModel(Model):
    """omega = (E m + B) with the effects removed; effects on readings are removed from m.

    It has a linear model, claims in the order of their removal, and reference conditions."""

    kind: ClassVar[str] = "physics"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    linear: LinearModel
    claims: tuple[AppliedEffect, ...]
    known: Conditions

    @property
    def parameters(self) -> int:
        """Number of parameters: 12 and those of the effects."""
        return PARAMETERS + sum(len(claim.theta) for claim in self.claims)

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """The claims."""
        return self.claims

    @property
    def session_s(self) -> float | None:
        """The session's duration if an effect depends on session time (a drift, a step); None otherwise."""
        return self.known.duration_s if any(claim.effect.of_one_session for claim in self.claims) else None

    def at_end(self) -> PhysicsModel | LinearModel:
        """The model for any time: effects of session time keep their final value, as a part of B.

        Effects of session time that also depend on the rate or anything else are not corrected.  With effects that depend on the rate the
        result is exact up to the product of the two.
        """
        if self.session_s is None:
            return self
        lasting = tuple(claim for claim in self.claims if not claim.effect.of_one_session)
        linear = self.linear.with_bias_moved(-self.bygone)
        return PhysicsModel(linear, lasting, self.known) if lasting else linear

    def at_end_slope(self) -> np.ndarray:
        """(12 + P', 12 + P): derivative of the parameters of ``at_end`` by this model's, in the order of its covariance."""
        size = self.parameters
        slope, kept, at = np.eye(size), list(range(PARAMETERS)), PARAMETERS
        for claim in self.claims:
            here = slice(at, at + len(claim.theta))
            if claim.effect.of_one_session:
                slope[BIAS, here] = -_columns_at_end(claim.effect, self.known)
            else:
                kept += range(here.start, here.stop)
            at = here.stop
        return slope[kept]

    @property
    def bygone(self) -> np.ndarray:
        """(3,) rad/s: sum of the effects of session time at its end."""
        ended = (_columns_at_end(claim.effect, self.known) @ claim.theta for claim in self.claims if claim.effect.of_one_session)
        return sum(ended, np.zeros(3))

    def _refuse_other_times(self, samples: Samples, began_s: float) -> None:
        if self.session_s is None or not len(samples):
            return
        past, ended_s = PAST_END * self.session_s, began_s + samples.t_s[-1]
        if not (began_s >= -past and ended_s <= self.session_s + past):
            names = ", ".join(claim.effect.id for claim in self.claims if claim.effect.of_one_session)
            raise CalibrationError(
                f"{names} is known from 0 to {self.session_s:.1f} s of its session, the samples lie from {began_s:.1f} to {ended_s:.1f} s; "
                "take the model for any time (_at_end)"
            )

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force; began_s: session time at its start; live: causal,
        without smoothing of the temperature.

        Raises CalibrationError for samples after the session if an effect depends on session time.
        """
        self._refuse_other_times(samples, began_s)
        readings = samples.gyro
        movement = movement_of(samples, self.linear(readings), self.known, began_s, live)
        for claim in self.claims:
            if claim.effect.on_readings:
                readings = claim.effect.correct(readings, movement.with_rate(readings), claim.theta)
        rate = self.linear(readings)
        for claim in self.claims:
            if claim.effect.on_readings:
                continue
            rate = claim.effect.correct(rate, movement.with_rate(rate), claim.theta)
        return rate


def _columns_at_end(effect: Effect, known: Conditions) -> np.ndarray:
    """(3, P) rate per parameter at the session's end; zeros for an effect that depends on more than time."""
    still = np.zeros((3, effect.parameter.size))
    if effect.inputs != ("time",) or effect.reach or effect.exact_distort is not None or effect.exact_correct is not None:
        return still
    nothing = np.zeros((2, 3))
    ends = Movement(
        t_s=np.full(2, known.duration_s),
        dt_s=1.0,
        rate=np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 3.0]]),
        force_g=nothing,
        temp_c=np.full(2, np.nan),
        vibration_g2=np.zeros(2),
        **vars(known),
    )
    at_rest, turning = effect.columns(effect.shown(ends))
    return at_rest if np.abs(turning - at_rest).max() < RATES_ALIKE else still


@dataclass(frozen=True, eq=False)
class CarriedNet(Model):
    """TinyGC-Net behind physical effects: the net calibrates the rates that the sensor would have measured without them."""

    kind: ClassVar[str] = "tinygc_physics"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    physics: PhysicsModel
    net: CalibrationNet

    @property
    def parameters(self) -> int:
        """Number of parameters of the net and the effects."""
        return len(self.net.vector) + self.physics.parameters - PARAMETERS

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """The claims of the physical model."""
        return self.physics.claims

    @property
    def session_s(self) -> float | None:
        """The session's duration, as for the physical model."""
        return self.physics.session_s

    def at_end(self) -> CarriedNet | CalibrationNet:
        """The net behind the physical model of the session's end; the net alone if no effect remains."""
        if self.session_s is None:
            return self
        ended = self.physics.at_end()
        # The final values are a part of B, which is not applied before the net, so the net includes them.
        change = -np.linalg.solve(self.physics.linear.E, self.physics.bygone)  # the net's output equals this one's for the rate plus that
        net = replace(self.net, b1=self.net.b1 + self.net.W1 @ change, b2=self.net.b2 + change)
        return CarriedNet(ended, net) if isinstance(ended, PhysicsModel) else net

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force."""
        # The rates that the sensor would have measured without the effects, which the network was trained on.
        linear = self.physics.linear
        return self.net((self.physics.calibrate(samples, began_s, live) - linear.B) @ np.linalg.inv(linear.E).T)


# Models with physical effects as JSON: the linear model or net, and each effect with its parameters in SI and in display units.

EQUATIONS = {
    "physics": "omega = (each effect undone, in order)(E @ m + B), m the measured rate in rad/s",
    "tinygc_physics": "omega = net(E^-1 ((each effect undone, in order)(E @ m + B) - B))",
}

#: limit on an effect's parameters in units of their wide sigma (``Parameter.plausible``); no real sensor exceeds it
PLAUSIBLE = 1e3
_LINEAR = Keys({name: weight(name, shape) for name, shape in LinearModel.SHAPES.items()})
_PHYSICS = Keys({"linear": _LINEAR, "conditions": CONDITIONS_TABLE, "effects": ListOf(Keys({"id": Text()}))})


def to_table(model: PhysicsModel | CarriedNet, write: Callable[..., dict]) -> dict:
    """Table with the equation, the effects in order of removal, the reference conditions, and the net, if any."""
    physics = model.physics if isinstance(model, CarriedNet) else model
    table: dict[str, Any] = {
        "equation": EQUATIONS[model.kind],
        "linear": {name: getattr(physics.linear, name) for name in LinearModel.SHAPES},
        "effects": [_claim(claim) for claim in physics.claims],
        "conditions": physics.known,
    }
    return table | {"net": write(model.net)} if isinstance(model, CarriedNet) else table


def _claim(claim: AppliedEffect) -> dict:
    effect = claim.effect
    values = (claim.theta / effect.parameter.si).reshape(effect.parameter.shape)
    return {"id": effect.id, "equation": effect.equation, "theta_si": claim.theta, effect.parameter.name: values, **effect.shape}


def from_table(table: dict, where: str, read: Callable[..., Any]) -> PhysicsModel | CarriedNet:
    """Read the model from its table.  Raises FormatError for an invalid table."""
    require(table, _PHYSICS, where)
    linear = LinearModel(**_LINEAR.made(table["linear"]))
    claims = tuple(_read_claim(entry, f"{where}: effects[{i}]") for i, entry in enumerate(table["effects"]))
    known = known_of(table, {name for claim in claims for name in claim.effect.inputs}, where)
    physics = PhysicsModel(linear, claims, known)
    return physics if table["kind"] == PhysicsModel.kind else CarriedNet(physics, read(table.get("net"), f"{where}: net"))


def _read_claim(entry: dict, where: str) -> AppliedEffect:
    try:
        effect = effect_of(entry["id"])
        most = PLAUSIBLE * effect.parameter.plausible
        require(entry, Keys({"theta_si": Array((effect.parameter.size,), Number(-most, most))}), where)
        if effect.scan is not None:
            require(entry, Keys({effect.scan.name: Number()}), where)
            effect = effect.at(float(entry[effect.scan.name]) * effect.scan.si)
    except EffectError as error:
        raise FormatError(f"{where}: {error}") from None
    if entry.get("of") == READINGS and effect.of_readings is not None:
        effect = effect.of_readings
    return AppliedEffect(effect, np.asarray(entry["theta_si"], dtype=float))
