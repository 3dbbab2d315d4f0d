"""The linear model omega = E m + B, 12 parameters (docs/model.md), and its sensor errors in the field's terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from session.base import rotation
from session.base.numeric import derivative
from session.base.units import DEG
from tinygc.inference.decide import Fact
from tinygc.inference.solve import Source, effective_freedom, known_sources
from tinygc.models.model import Model

# The linear model every calibration begins with: omega = E m + B, 12 parameters (docs/model.md).

#: positions of E, row by row, and of B in ``LinearModel.vector``
MATRIX, BIAS = slice(0, 9), slice(9, 12)
PARAMETERS = BIAS.stop
#: sigma of the prior around "no correction": 20 % for each element of E, 20 dps for the bias
PRIOR_SIGMA = np.array([0.2] * 9 + [20 * DEG] * 3)
NAMES = (*(f"E_{i}{j}" for i in "xyz" for j in "xyz"), "B_x", "B_y", "B_z")


def mapped(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Product (..., n) of a matrix (n, m) with vectors (..., m), each component contiguous in memory."""
    components = np.moveaxis(vectors, -1, 0)
    return np.moveaxis((matrix @ components.reshape(len(components), -1)).reshape(len(matrix), *components.shape[1:]), 0, -1)


@dataclass(frozen=True, eq=False)
class LinearModel(Model):
    """omega = E m + B with m the measured rate (register x sensitivity): E (3, 3), B (3,) rad/s."""

    kind: ClassVar[str] = "linear"
    SHAPES: ClassVar[dict[str, tuple[int, ...]]] = {"E": (3, 3), "B": (3,)}

    E: np.ndarray
    B: np.ndarray

    @classmethod
    def from_vector(cls, vector: np.ndarray) -> LinearModel:
        """Build from 12 parameters: E row by row, then B."""
        return cls(np.asarray(vector[MATRIX], dtype=float).reshape(3, 3), np.asarray(vector[BIAS], dtype=float))

    @property
    def parameters(self) -> int:
        """Number of parameters: 12."""
        return PARAMETERS

    @property
    def vector(self) -> np.ndarray:
        """(12,): E row by row, then B."""
        return np.concatenate([self.E.ravel(), self.B])

    def __call__(self, rate: np.ndarray) -> np.ndarray:
        """Calibrated rate (..., 3) rad/s from the measured one."""
        found = mapped(self.E, rate)
        found += self.B
        return found

    def with_bias_moved(self, change: np.ndarray) -> LinearModel:
        """Increase B by ``change`` (3,) rad/s."""
        return replace(self, B=self.B + change)


def bias_only(still_rate: np.ndarray | None = None) -> LinearModel:
    """Identity with the bias from a still's mean rate (3,), if given."""
    return LinearModel(np.eye(3), np.zeros(3) if still_rate is None else -np.asarray(still_rate))


def columns(sensitivity: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(S, d, 12) rad per unit: rotation of the end attitude per parameter, from sensitivity (S, T, d, 3) and m (S, T, 3)."""
    segments, samples, angles = sensitivity.shape[:3]
    by_time = sensitivity.transpose(0, 2, 3, 1).reshape(segments, 3 * angles, samples)
    matrix = (by_time @ rate).reshape(segments, angles, 9)
    return np.concatenate([matrix, by_time.sum(-1).reshape(segments, angles, 3)], axis=-1)


# The sensor errors in the field's terms, derived from the linear calibration.
#
# The calibration is omega = E m + B.  The sensor is its inverse, m = M omega + b with M = E^-1 and b = -E^-1 B.  Row i of M is the
# response of axis i: its length is the scale factor (1 by the data sheet), its direction u_i the input axis (IEEE 528, 1431).
#
#     scale factor error      |M_i| - 1                                      relative excess of the reading
#     misalignment i to j     angle by which input axis i leans towards reference axis j: atan2(u_ij, u_ii)
#     nonorthogonality ij     90 deg less the angle between input axes i and j: asin(u_i . u_j)
#     triad rotation          rotation vector from the reference axes to the nearest right-angled triad of the input axes (polar)
#     bias                    b, the output at no rate
#
# The reference axes are those of the pre-calibrated accelerometer.  Six misalignments are three nonorthogonalities and one rotation.

#: a quantity that changes by this much per unit of an unobserved parameter is not observed either
DEPENDS = 0.1

#: word, components, unit, unit in SI
WORDS = (
    ("scale factor error", ("x", "y", "z"), "ppm", 1e-6),
    ("misalignment", ("x to y", "x to z", "y to x", "y to z", "z to x", "z to y"), "mrad", 1e-3),
    ("nonorthogonality", ("xy", "yz", "zx"), "mrad", 1e-3),
    ("triad rotation", ("x", "y", "z"), "mrad", 1e-3),
    ("bias", ("x", "y", "z"), "dps", DEG),
)


def scale_factor_errors(E: np.ndarray) -> np.ndarray:
    """(…, 3): scale factor error of each axis under calibrations E (…, 3, 3)."""
    return np.linalg.norm(np.linalg.inv(E), axis=-1) - 1


def field_vector(vector: np.ndarray) -> np.ndarray:
    """(18,) SI, in the order of ``WORDS``, from ``LinearModel.vector`` (12,).  Raises numpy's LinAlgError for a singular E."""
    E, B = vector[MATRIX].reshape(3, 3), vector[BIAS]
    M = np.linalg.inv(E)
    length = np.linalg.norm(M, axis=1)
    u = M / length[:, None]
    lean = [np.arctan2(u[i, j], u[i, i]) for i in range(3) for j in range(3) if i != j]
    skew = [np.arcsin(np.clip(u[i] @ u[j], -1, 1)) for i, j in ((0, 1), (1, 2), (2, 0))]
    left, _, right = np.linalg.svd(u)
    triad = left @ right  # rows: the right-angled triad nearest to the input axes
    turn = rotation.log(rotation.from_matrix(triad.T)) if np.linalg.det(triad) > 0 else np.full(3, np.nan)
    return np.concatenate([length - 1, lean, skew, turn, -M @ B])


def field_jacobian(vector: np.ndarray) -> np.ndarray:
    """(18, 12) Jacobian of ``field_vector``, by central differences."""
    return derivative(field_vector, vector)


def field_facts(
    vector: np.ndarray,
    covariance: np.ndarray,
    unobserved: tuple[str, ...] = (),
    moved: Callable[[np.ndarray], np.ndarray] | None = None,
    sources: Sequence[Source] = (),
) -> list[Fact]:
    """18 sensor errors of a linear model (12,) with its covariance (12, 12), each with the freedom of its own mixture of sources.

    unobserved: names of the unobserved parameters; moved: how far one effect may have moved quantities with a derivative (Q, 12), which is
    taken as known, as ``Systematic.of``.
    """
    values, jacobian = field_vector(vector), field_jacobian(vector)
    further = np.full(len(values), np.nan) if moved is None else moved(jacobian)
    known = known_sources(sources, covariance)
    parts = np.array([*(np.maximum(source.variance(jacobian), 0.0) for source in known), np.nan_to_num(further) ** 2])
    freedoms = [*(source.freedom for source in known), np.inf]
    hidden = [i for i, name in enumerate(NAMES) if name in unobserved]
    facts: list[Fact] = []
    for word, components, unit, si in WORDS:
        for component in components:
            at = len(facts)
            shown = not (np.abs(jacobian[at, hidden]) > DEPENDS).any()
            sigma, freedom = np.sqrt(parts[:-1, at].sum()) / si, effective_freedom(parts[:, at].tolist(), freedoms)
            value, moves = float(values[at] / si), float(further[at] / si)
            facts.append(Fact(word, unit, value, float(sigma), freedom, bool(shown), component, moved=moves))
    return facts
