"""TinyGC-Net with conditions: temperature and specific force as inputs; and its file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from session.io.errors import FitError, FormatError
from session.io.results import Array, Keys, ListOf, Text, require
from session.io.samples import Samples
from session.io.units import DEG
from tinygc.attitude import rotation
from tinygc.effects import Conditions, movement_of
from tinygc.models.model import FACTOR, BaseModel
from tinygc.models.nets import TIES, CalibrationNet
from tinygc.models.physics import CONDITIONS_TABLE, known_of

# TinyGC-Net with conditions: temperature, and specific force, as inputs that move its biases and its gains (the paper's future work).
#
#     omega = net(m) + (bias c) + m * (gain c)          c the K conditions: temperature less T0, in degC; specific force, in g
#
# ``bias`` (3, K) and ``gain`` (3, K) beside the 27: 33 parameters with temperature, 45 with force, 51 with both.  It starts at the exact
# identity.  Conditions are learnt only where left-out segments ask for them, as the kinks are.
#
# What `explain` names has an equation and a place in front of the net (``CarriedNet``).  This is for what has no name yet: the net finds by
# itself how its conditions matter, linearly, and no more.

#: condition -> how many inputs it is, prior sigma of its bias (rad/s per unit) and of its gain (per unit): 0.1 dps/degC and 0.2 dps/g
CONDITIONS = {"temperature": (1, 0.1 * DEG, 1e-3), "force": (3, 0.2 * DEG, 1e-2)}


@dataclass(frozen=True, eq=False)
class ConditionsNet:
    """net; bias and gain (3, K); names of the conditions, in their order.  It is called on inputs (..., 3 + K): rate, then conditions."""

    net: CalibrationNet
    bias: np.ndarray
    gain: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def identity(cls, names: tuple[str, ...]) -> ConditionsNet:
        """No correction, exactly."""
        count = sum(CONDITIONS[name][0] for name in names)
        return cls(CalibrationNet.identity(), np.zeros((3, count)), np.zeros((3, count)), names)

    def with_vector(self, vector: Any) -> ConditionsNet:
        """From 27 + 6 K numbers: the net's, bias and gain row by row."""
        count = self.bias.shape[1]
        bias, gain = (vector[27 + 3 * count * i : 27 + 3 * count * (i + 1)].reshape(3, count) for i in range(2))
        return ConditionsNet(CalibrationNet.from_vector(vector[:27]), bias, gain, self.names)

    @property
    def vector(self) -> Any:
        """(27 + 6 K,)."""
        xp = rotation.namespace(self.bias)
        return xp.concatenate([self.net.vector, self.bias.reshape(-1), self.gain.reshape(-1)], 0)

    def rungs(self, typical_rps: float, ties: tuple[float, ...] = TIES) -> list[tuple[float, np.ndarray]]:
        """(tie, prior sigma): the linear model; then with conditions, their tie counted as 0, too; then bent."""
        of_net = self.net.rungs(typical_rps, ties)
        sigmas = [np.concatenate([[CONDITIONS[name][column]] * CONDITIONS[name][0] for name in self.names]) for column in (1, 2)]
        own = np.concatenate([np.tile(sigma, 3) for sigma in sigmas])
        closed = (of_net[0][0], np.concatenate([of_net[0][1], own * 1e-9]))
        return [closed, *((tie, np.concatenate([prior, own])) for tie, prior in of_net)]

    def __call__(self, inputs: Any) -> Any:
        """Calibrated rate (..., 3) rad/s."""
        rate, known = inputs[..., :3], inputs[..., 3:]
        return self.net(rate) + known @ self.bias.T + rate * (known @ self.gain.T)

    def columns(self, sensitivity: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """(S, d, 27 + 6 K): how each weight turns the end attitude (NumPy only)."""
        rate, known = inputs[..., :3], inputs[..., 3:]
        bias = np.einsum("stdi,stk->sdik", sensitivity, known, optimize=True)
        gain = np.einsum("stdi,stk->sdik", sensitivity * rate[:, :, None], known, optimize=True)
        parts = [self.net.columns(sensitivity, rate), *(part.reshape(*part.shape[:2], -1) for part in (bias, gain))]
        return np.concatenate(parts, axis=-1)


@dataclass(frozen=True, eq=False)
class ConditionsModel(BaseModel):
    """A trained net and what its conditions refer to."""

    kind: ClassVar[str] = "tinygc_conditions"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    net: ConditionsNet
    known: Conditions

    @property
    def parameters(self) -> int:
        """27 and six for each condition."""
        return len(self.net.vector)

    @property
    def conditions(self) -> tuple[str, ...]:
        """What the net is told."""
        return self.net.names

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force."""
        return self.net(inputs_of(samples, self.net.names, self.known, live))


def inputs_of(samples: Samples, names: tuple[str, ...], known: Conditions, live: bool = False) -> np.ndarray:
    """(N, 3 + K): the measured rate, and the conditions.  Raises FitError where the log has no temperature, or the first had none."""
    movement = movement_of(samples, samples.gyro, known, live=live)
    values = {"temperature": (movement.temp_c - known.first_temp_c)[:, None], "force": movement.force_g}
    inputs = np.concatenate([samples.gyro, *(values[name] for name in names)], axis=1)
    if not np.isfinite(inputs).all():
        raise FitError("the log has no temperature, which the net is to be told; leave it out of --conditions")
    return inputs


# TinyGC-Net that is told temperature or force, as JSON: the net's own table, and how the conditions move it.

EQUATION = "omega = net(m) + bias @ c + m * (gain @ c), c: temperature less conditions.first_temp_c in degC, force in g"


def to_table(model: ConditionsModel, write: Callable[..., dict]) -> dict:
    """equation, inputs by name, what they refer to, bias and gain (3, K), and the net."""
    return {
        "equation": EQUATION,
        "inputs": list(model.net.names),
        "conditions": {name: value if np.isfinite(value) else None for name, value in asdict(model.known).items()},
        "weights": {name: np.asarray(getattr(model.net, name)).tolist() for name in ("bias", "gain")},
        "net": write(model.net.net),
    }


def from_table(table: dict, where: str, read: Callable[..., Any]) -> ConditionsModel:
    """The model; FormatError says what is wrong with the table."""
    require(table, Keys({"inputs": ListOf(Text(tuple(CONDITIONS))), "conditions": CONDITIONS_TABLE}), where)
    names = tuple(table["inputs"])
    if not names or len(set(names)) < len(names):
        raise FormatError(f"{where}: inputs name {len(names)} conditions, expected each of {', '.join(CONDITIONS)} once at most; fit again")
    count = sum(CONDITIONS[name][0] for name in names)
    require(table, Keys({"weights": Keys({name: Array((3, count), FACTOR) for name in ("bias", "gain")})}), where)
    bias, gain = (np.asarray(table["weights"][name], dtype=float) for name in ("bias", "gain"))
    known = known_of(table, {"temperature"} & set(names), where)
    net = read(table.get("net"), f"{where}: net")
    if not isinstance(net, CalibrationNet):
        raise FormatError(f"{where}: net is of another kind, expected tinygc")
    return ConditionsModel(ConditionsNet(net, bias, gain, names), known)
