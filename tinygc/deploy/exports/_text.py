"""Helpers of text formats: matrix and bias of a model, comment lines, YAML, the autopilots' terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from session.base.texts import comment
from session.base.units import DEG, G
from session.log.config import Sensor
from tinygc.deploy import ExportError, feature_exports
from tinygc.deploy.calibration import Calibration
from tinygc.deploy.exports._context import Context
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.linear import LinearModel
from tinygc.models.model import Model
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel

# What formats with a matrix and a bias can carry of a model, and a refusal of the rest.

#: slopes this near to 1 differ from it only by the rounding of a fit
UNBENT = 1e-9
ELSEWHERE = "export --to json carries every model, or choose another with --model"


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
        """Forward matrix of the sensor, m = M (omega + K a + k (T - T0)) + bias."""
        return np.linalg.inv(self.E)

    @property
    def bias(self) -> np.ndarray:
        """Sensor output (3,) rad/s at rest, at T0 and without gravity."""
        return -self.M @ self.B

    def example(self) -> str:
        """One vector before and after, to check an implementation."""
        m, a = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -9.0])
        omega = self.E @ m + self.B - self.K @ a
        force = f" with specific force {words(a)} m/s^2" if self.K.any() else ""
        return f"Try: measured {words(m)} rad/s{force} must give {words(np.round(omega, 9))} rad/s."


def linear_part(model: Model, name: str, carries: tuple[str, ...] = ()) -> LinearPart:
    """Return a model that is linear but for effects ``linear_in`` what the format ``carries``.  Raises ExportError for others."""
    if isinstance(model, DenoisedNet):
        raise ExportError(f"{name} has no memory, and this model denoises; {ELSEWHERE}")
    if isinstance(model, CalibrationNet):
        if np.abs(model.slope - 1).max() > UNBENT:
            raise ExportError(f"{name} is linear, and this TinyGC-Net bends (slopes {model.slope.tolist()}); {ELSEWHERE}")
        linear = LinearModel(np.eye(3) + model.W2 @ model.W1, model.W2 @ model.b1 + model.b2)
    K, k, first_c = np.zeros((3, 3)), np.zeros(3), 25.0
    if isinstance(model, CarriedNet):
        raise ExportError(f"{name} cannot carry a net behind physics; {ELSEWHERE}")
    if (feature := feature_exports(model)) is not None:
        raise ExportError(f"{name} cannot carry {feature.CARRIED}")
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


def lower(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, C): matrix = M C, M lower-triangular with a positive diagonal, C a rotation."""
    Q, R = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(R))
    return np.tril((signs[:, None] * R).T), (Q * signs).T


def words(numbers: ArrayLike) -> str:
    """Format numbers for YAML and JSON with every digit."""
    array = np.asarray(numbers, dtype=float)
    if array.ndim:
        return "[" + ", ".join(words(part) for part in array) + "]"
    text = repr(float(array))
    # YAML 1.1 reads 1e-05 as a string: it needs a decimal point.
    mantissa, e, power = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{power if power[:1] in '+-' or not e else '+' + power}"


# Comment lines at the start of every text format: content, source, frame.
#
# Names and serial numbers are untrusted text: ``comment`` makes each line one line.

FRAME = (
    "Frame: the sensor's own axes, right-handed, exactly as in the log that was calibrated (this project's b: forward, right, down,",
    "where they are so mounted).  If your driver turns the axes before this is applied (REP 103: forward, left, up), turn it too:",
    "E' = R E R^T, B' = R B with R from logged to driver's axes.",
)
FRAME_OF_NOISE = ("Frame: the sensor's own axes x, y, z, right-handed, exactly as in the log at rest.",)


def remarks(context: Context, *lines: str, mark: str = "#", longest: int | None = None) -> str:
    """Return source and frame, then the format's own lines, as comments; longest: bytes of a line, where a reader splits longer ones."""
    sensor = context.config.sensor
    what = (
        f"calibration of session {context.session}, method {context.method}"
        if context.method is not None
        else f"noise at rest of {context.session}"
    )
    head = (
        f"TinyGC {what}: {sensor.model} {sensor.serial}".rstrip(": "),
        *(f"sha256 {digest}  {name}" for name, digest in context.hashes.items()),
        *(FRAME_OF_NOISE if context.method is None else FRAME),
        *lines,
    )
    written = [comment(line) for line in head]
    if longest is not None:
        written = [piece for line in written for piece in _pieces(line, longest - len(mark) - 1)]
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in written)


def _pieces(line: str, most: int) -> list[str]:
    """Split into pieces of at most so many bytes of UTF-8, at blanks where possible."""
    for width in (most, most // 2, most // 4):  # no character has more than four bytes
        pieces = wrap(line, width, subsequent_indent="  ", break_on_hyphens=False)
        if all(len(piece.encode()) <= most for piece in pieces):
            break
    return pieces


# A short log and the model's output for it, to check other implementations.

#: longer than any model's memory
SAMPLES = 64
SEED = 20240302
#: share of the full scale
FILLED = 0.8


def self_test(model: Model, sensor: Sensor, samples: int = SAMPLES) -> dict:
    """Draw consecutive samples at the nominal data rate with a fixed seed: inputs and outputs, all SI."""
    rng = np.random.default_rng(SEED)
    full_scale = sensor.gyro_fs_dps * DEG
    raw = rng.uniform(-FILLED * full_scale, FILLED * full_scale, (samples, 3))
    raw[0] = 0.0
    force = rng.uniform(-G, G, (samples, 3))
    temperature = 25 + np.linspace(0, 2, samples)
    omega = Calibration(model, sensor.odr_hz)(raw, force, temperature)
    return {
        "rate_hz": sensor.odr_hz,
        "measured_rps": raw.tolist(),
        "specific_force_mps2": force.tolist(),
        "temperature_c": temperature.tolist(),
        "omega_rps": omega.tolist(),
    }


# YAML by PyYAML: one key per line, lists of numbers and rows of a matrix on one line each, every digit kept.


def yaml_text(table: Mapping[str, Any], remarks: Mapping[str, str] | None = None) -> str:
    """Format keys in their order, arrays as lists; remarks: comments after the lines of these top-level keys.

    YAML 1.1 reads 1e-05 as a string: the writer adds the decimal point.
    """
    import yaml

    class Writer(yaml.SafeDumper):
        """A writer that never puts a table on one line, and indents the rows of a matrix, without which OpenCV cannot read them."""

        def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
            super().increase_indent(flow, False)

    Writer.add_representer(dict, lambda writer, value: writer.represent_mapping("tag:yaml.org,2002:map", value.items(), flow_style=False))
    lines = []
    for key, value in table.items():
        text = yaml.dump({key: _plain(value)}, Dumper=Writer, default_flow_style=None, width=float("inf"), allow_unicode=True)
        lines.append(f"{text.removesuffix(chr(10))}  # {remarks[key]}\n" if remarks and key in remarks else text)
    return "".join(lines)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
