"""What formats that hold a matrix and a bias can carry of a model, and a refusal of the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from session.common.units import G
from tinygc.deploy.errors import ExportError
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.conditions_net import ConditionsModel
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.linear import LinearModel
from tinygc.models.model import Model
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.models.published_net import PublishedNet
from tinygc.models.thermal import ThermalModel

#: slopes this near to 1 are 1 but for the rounding of a fit
UNBENT = 1e-9
ELSEWHERE = "export --to json carries every model, or choose another with --model"
#: nets that no linear format carries, in words
NETS_BESIDE = {CarriedNet.kind: "a net behind physics", ConditionsModel.kind: "a net that is told temperature or force"}


@dataclass(frozen=True, eq=False)
class LinearPart:
    """omega = E m + B - K a - k (T - T0): E (3, 3); B (3,) rad/s; K (3, 3) (rad/s)/(m/s^2); k (3,) (rad/s)/degC from T0 degC."""

    E: np.ndarray
    B: np.ndarray
    K: np.ndarray
    k: np.ndarray
    first_c: float

    @property
    def M(self) -> np.ndarray:
        """The sensor itself, m = M (omega + K a + k (T - T0)) + bias."""
        return np.linalg.inv(self.E)

    @property
    def bias(self) -> np.ndarray:
        """(3,) rad/s, what the sensor reads at rest, at T0 and without gravity."""
        return -self.M @ self.B

    def example(self) -> str:
        """One vector in and out, to try an implementation with."""
        m, a = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -9.0])
        omega = self.E @ m + self.B - self.K @ a
        force = f" with specific force {words(a)} m/s^2" if self.K.any() else ""
        return f"Try: measured {words(m)} rad/s{force} must give {words(np.round(omega, 9))} rad/s."


def linear_part(model: Model, name: str, carries: tuple[str, ...] = ()) -> LinearPart:
    """Of a model that is linear, up to effects that are ``linear_in`` what the format ``carries``.  Raises ExportError for the rest."""
    if isinstance(model, DenoisedNet):
        raise ExportError(f"{name} has no memory, and this model denoises; {ELSEWHERE}")
    if isinstance(model, CalibrationNet | PublishedNet):
        slopes = np.concatenate([np.ravel(getattr(model, name)) for name in model.SHAPES if name.startswith("slope")])
        if np.abs(slopes - 1).max() > UNBENT:
            raise ExportError(f"{name} is linear, and this TinyGC-Net bends (slopes {slopes.tolist()}); {ELSEWHERE}")
        linear = LinearModel(np.eye(3) + model.W2 @ model.W1, model.W2 @ model.b1 + model.b2)
    K, k, first_c = np.zeros((3, 3)), np.zeros(3), 25.0
    if model.kind in NETS_BESIDE:
        raise ExportError(f"{name} cannot carry {NETS_BESIDE[model.kind]}; {ELSEWHERE}")
    if isinstance(model, ThermalModel):
        raise ExportError(f"{name} cannot carry a calibration over temperature; px4 and ardupilot carry its zero, c and json all of it")
    if isinstance(model, PhysicsModel):
        unable = [claim.effect.id for claim in model.claims if claim.effect.linear_in not in carries]
        if unable:
            raise ExportError(f"{name} cannot carry {', '.join(unable)}; {ELSEWHERE}")
        for claim in model.claims:
            if claim.effect.linear_in == "force":
                K = K + claim.theta.reshape(3, 3) / G
            else:
                k, first_c = k + claim.theta, model.known.first_temp_c
        linear = model.linear
    if isinstance(model, LinearModel):
        linear = model
    return LinearPart(np.asarray(linear.E, dtype=float), np.asarray(linear.B, dtype=float), K, k, float(first_c))


def words(numbers: ArrayLike) -> str:
    """Numbers as YAML and JSON read them, every digit kept."""
    array = np.asarray(numbers, dtype=float)
    if array.ndim:
        return "[" + ", ".join(words(part) for part in array) + "]"
    text = repr(float(array))
    # YAML 1.1 takes 1e-05 for a word: it wants the point.
    mantissa, e, power = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{power if power[:1] in '+-' or not e else '+' + power}"
