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

# TinyGC-Net with conditions: temperature and specific force are inputs that change its biases and gains (the paper's future work).
#
#     omega = net(m) + (bias c) + m * (gain c)          c the K conditions: temperature less T0, in degC; specific force, in g
#
# ``bias`` (3, K) and ``gain`` (3, K) add to the 27: 33 parameters with temperature, 45 with force, 51 with both.  It starts at the exact
# identity.  Conditions and kinks are used only if they improve the closure of held-out segments.
#
# Effects identified by `explain` have an equation and act in front of the net (``CarriedNet``).  This net is for unidentified effects: it
# learns a linear dependence on its conditions.

#: condition -> number of inputs, prior sigma of its bias (rad/s per unit) and of its gain (per unit): 0.1 dps/degC and 0.2 dps/g
CONDITIONS = {"temperature": (1, 0.1 * DEG, 1e-3), "force": (3, 0.2 * DEG, 1e-2)}


@dataclass(frozen=True, eq=False)
class ConditionsNet:
    """Net with bias and gain (3, K) and the ordered names of its conditions, called on inputs (..., 3 + K): rate, then conditions."""

    net: CalibrationNet
    bias: np.ndarray
    gain: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def identity(cls, names: tuple[str, ...]) -> ConditionsNet:
        """The exact identity."""
        count = sum(CONDITIONS[name][0] for name in names)
        return cls(CalibrationNet.identity(), np.zeros((3, count)), np.zeros((3, count)), names)

    def with_vector(self, vector: Any) -> ConditionsNet:
        """Set 27 + 6 K weights: the net's, then bias and gain row by row."""
        count = self.bias.shape[1]
        bias, gain = (vector[27 + 3 * count * i : 27 + 3 * count * (i + 1)].reshape(3, count) for i in range(2))
        return ConditionsNet(CalibrationNet.from_vector(vector[:27]), bias, gain, self.names)

    @property
    def vector(self) -> Any:
        """(27 + 6 K,) all weights."""
        xp = rotation.namespace(self.bias)
        return xp.concatenate([self.net.vector, self.bias.reshape(-1), self.gain.reshape(-1)], 0)

    def rungs(self, typical_rps: float, ties: tuple[float, ...] = TIES) -> list[tuple[float, np.ndarray]]:
        """(tie, prior sigma): the linear model, tie 0; with conditions, also tie 0; then with increasingly free kinks."""
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
        """(S, d, 27 + 6 K): rotation of the end attitude per weight (NumPy only)."""
        rate, known = inputs[..., :3], inputs[..., 3:]
        bias = np.einsum("stdi,stk->sdik", sensitivity, known, optimize=True)
        gain = np.einsum("stdi,stk->sdik", sensitivity * rate[:, :, None], known, optimize=True)
        parts = [self.net.columns(sensitivity, rate), *(part.reshape(*part.shape[:2], -1) for part in (bias, gain))]
        return np.concatenate(parts, axis=-1)


@dataclass(frozen=True, eq=False)
class ConditionsModel(BaseModel):
    """A trained net with its reference conditions."""

    kind: ClassVar[str] = "tinygc_conditions"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    net: ConditionsNet
    known: Conditions

    @property
    def parameters(self) -> int:
        """Number of parameters: 27, and six for each condition."""
        return len(self.net.vector)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Names of the net's further inputs."""
        return self.net.names

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force."""
        return self.net(inputs_of(samples, self.net.names, self.known, live))


def inputs_of(samples: Samples, names: tuple[str, ...], known: Conditions, live: bool = False) -> np.ndarray:
    """(N, 3 + K): measured rate and conditions.  Raises FitError if this log, or the session's first one, has no temperature."""
    movement = movement_of(samples, samples.gyro, known, live=live)
    values = {"temperature": (movement.temp_c - known.first_temp_c)[:, None], "force": movement.force_g}
    inputs = np.concatenate([samples.gyro, *(values[name] for name in names)], axis=1)
    if not np.isfinite(inputs).all():
        raise FitError("the log has no temperature, which the net is to be told; leave it out of --conditions")
    return inputs


# TinyGC-Net with conditions as JSON: the net's table, and the weights of the conditions.

EQUATION = "omega = net(m) + bias @ c + m * (gain @ c), c: temperature less conditions.first_temp_c in degC, force in g"


def to_table(model: ConditionsModel, write: Callable[..., dict]) -> dict:
    """Table with equation, input names, reference conditions, bias and gain (3, K), and the net."""
    return {
        "equation": EQUATION,
        "inputs": list(model.net.names),
        "conditions": {name: value if np.isfinite(value) else None for name, value in asdict(model.known).items()},
        "weights": {name: np.asarray(getattr(model.net, name)).tolist() for name in ("bias", "gain")},
        "net": write(model.net.net),
    }


def from_table(table: dict, where: str, read: Callable[..., Any]) -> ConditionsModel:
    """Read the model from its table.  Raises FormatError for an invalid table."""
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
