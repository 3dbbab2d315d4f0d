"""The accelerometer's calibration in a fit: nine parameters, their uncertainty and their source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from session.base.numeric import derivative, sigmas_in
from session.base.records import in_unit
from session.base.texts import significant
from session.base.units import MG
from session.detect.accelerometer import (
    BIAS,
    BIASES,
    IDENTITY,
    MATRIX,
    NAMES,
    PARAMETERS,
    SCALES,
    SHEARS,
    UPPER,
    LengthFit,
    ZeroDrift,
    after,
    matrix_of,
)
from session.log.config import Accelerometer
from tinygc.closure.least_squares import OBSERVED_BELOW
from tinygc.closure.problem import JointFit
from tinygc.estimation.spread import ACCELEROMETER, USUAL, Spread
from tinygc.inference.decide import Fact
from tinygc.inference.solve import Source, effective_freedom
from tinygc.models import linear

#: names of the accelerometer's nine parameters and the gyroscope's twelve, in the order of a joint covariance
JOINT_NAMES = (*(f"accelerometer {name}" for name in NAMES), *linear.NAMES)
#: display units, and their sizes in SI
UNITS = {"ppm": 1e-6, "mrad": 1e-3, "mg": MG}
#: of three parameters each: key of the JSON, word for their errors, display unit, places
ROWS = (
    ("scale_correction_ppm", "scale factor error", "ppm", SCALES),
    ("nonorthogonality_mrad", "nonorthogonality", "mrad", SHEARS),
    ("bias_mg", "bias", "mg", BIASES),
)
#: a row in its display unit: its key or word, the unit, values (3,), sigmas (3,) if any, and names
Row = tuple[str, str, np.ndarray, np.ndarray | None, list[str]]


@dataclass(frozen=True, eq=False)
class AccelerometerFit:
    """The accelerometer's calibration of a fit.

    mode: ``given``, ``fit`` or ``prior``; calibration in use; covariance (9, 9) of the correction x that led to it, SI, None where
    it was taken as given; unobserved: names of ``values`` that are not estimated; p_value: for a given one, of its agreement with the data;
    misses_mps2: residual of gravity's length in each still, as measured (or with a given calibration), and after the fit; x (9,): the
    correction, which is the identity if it was not stored; drift: of the zero within the session, None where it was not looked for;
    sources (9, 9) of the covariance, where they are separated; between: how far another session moves the parameters.  What is computed
    from them is kept, and not to be written to.
    """

    mode: str
    calibration: Accelerometer
    covariance: np.ndarray | None = None
    unobserved: tuple[str, ...] = ()
    p_value: float | None = None
    misses_mps2: tuple[np.ndarray, np.ndarray] | None = None
    x: np.ndarray = field(default_factory=IDENTITY.copy)
    drift: ZeroDrift | None = None
    sources: tuple[Source, ...] = ()
    between: Spread = field(default_factory=lambda: USUAL.at(ACCELEROMETER))

    @property
    def spread_mps2(self) -> tuple[float, float] | None:
        """The spread of gravity's length over the stills, before and after."""
        return None if self.misses_mps2 is None else (float(np.std(self.misses_mps2[0])), float(np.std(self.misses_mps2[1])))

    @cached_property
    def values(self) -> np.ndarray:
        """Scale correction - 1, nonorthogonality and bias (m/s^2) in the triad's own frame, (9,) in the order of ``NAMES``.

        A full matrix is a rotation of the body frame times an upper triangle (QR); the triangle belongs to the sensor.
        """
        return self.calibration.triad

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Derivative (9, 9) of ``values`` by the correction x.

        x is in the frame of the matrix before it: after a quarter turn, one axis' scale there is that of another axis of the sensor.
        """
        return jacobian(self.calibration, self.x)

    @cached_property
    def sigmas(self) -> np.ndarray | None:
        """Standard deviations (9,) of ``values``."""
        return None if self.covariance is None else sigmas_in(self.jacobian @ self.covariance @ self.jacobian.T)

    @cached_property
    def any_session(self) -> np.ndarray | None:
        """Standard deviations (9,) of ``values`` as those of any other session: both are one draw of the spread."""
        return None if self.sigmas is None else self.between.any_session(self.sigmas**2)

    @property
    def any_session_words(self) -> str:
        """``scale ± 290 ppm, bias ± 2.0 mg (source)``: the largest of three axes, in any other session; empty where it was given."""
        if self.any_session is None:
            return ""
        parts = []
        for word, unit, which in (("scale", "ppm", SCALES), ("bias", "mg", BIASES)):
            seen = [self.any_session[i] for i in which if NAMES[i] not in self.unobserved]
            parts += [f"{word} ± {significant(max(seen) / UNITS[unit], 2)} {unit}"] if seen else []
        return f"{', '.join(parts)} ({self.between.source})" if parts else ""

    def rows(self) -> list[Row]:
        """Rows of the correction, by the keys of the JSON."""
        return _rows(0, self.values, self.sigmas)

    def errors(self) -> list[Row]:
        """Rows of the sensor errors for display, as in ``field_parameters`` for the gyroscope; the numbers in ``rows`` are those of the
        correction."""
        slope = self.slope
        return _rows(1, triad_errors(self.values), None if self.covariance is None else sigmas_in(slope @ self.covariance @ slope.T))

    @property
    def facts(self) -> list[Fact]:
        """The nine sensor errors; those of a calibration that was taken as given have no uncertainty here."""
        freedoms, found = dict(zip(NAMES, self.freedoms.tolist(), strict=True)), []
        for word, unit, values, sigmas, names in self.errors():
            for value, sigma, name in zip(values.tolist(), [np.nan] * 3 if sigmas is None else sigmas.tolist(), names, strict=True):
                found.append(Fact(word, unit, value, sigma, freedoms[name], name not in self.unobserved, name.split()[-1]))
        return found

    @cached_property
    def slope(self) -> np.ndarray:
        """Derivative (9, 9) of the sensor errors by the correction x."""
        return derivative(triad_errors, self.values) @ self.jacobian

    @property
    def freedoms(self) -> np.ndarray:
        """(9,) effective degrees of freedom of the sigmas of ``errors``; infinite where their sources are not separated."""
        parts = [source.variance(self.slope) for source in self.sources]
        freedoms = [source.freedom for source in self.sources]
        return np.array([effective_freedom([part[i] for part in parts], freedoms) for i in range(PARAMETERS)])

    def to_json(self) -> dict:
        """Return ``accelerometer`` of ``tinygc-fit/2``; a number that is not observed is none there, as on the screen."""

        def known(values: np.ndarray | None) -> dict:
            return {
                key: None if values is None else [None if NAMES[i] in self.unobserved else values[i] / UNITS[unit] for i in which]
                for key, _, unit, which in ROWS
            }

        before, after = self.spread_mps2 or (None, None)
        return {
            "mode": self.mode,
            "equation": "f = matrix (measured - bias)",
            "matrix": self.calibration.matrix,
            "bias_mps2": self.calibration.bias_mps2,
            **known(self.values),
            "sigma": known(self.sigmas),
            "any_session": None if self.any_session is None else {"sigma": known(self.any_session), "source": self.between.source},
            "unobserved": self.unobserved,
            "p_value": self.p_value,
            **in_unit(MG, gravity_spread_before_mg=before, gravity_spread_mg=after),
            "zero_drift": None if self.drift is None else drift_json(self.drift),
        }


def _rows(called: int, values: np.ndarray, sigmas: np.ndarray | None) -> list[Row]:
    found = []
    for row in ROWS:
        unit, which = row[2:]
        sigma = None if sigmas is None else sigmas[which] / UNITS[unit]
        found.append((str(row[called]), unit, values[which] / UNITS[unit], sigma, [NAMES[i] for i in which]))
    return found


def drift_json(drift: ZeroDrift) -> dict:
    """Return ``accelerometer.zero_drift`` of ``tinygc-fit/2``."""
    per_1000s = 1000 / drift.duration_s / MG
    return {
        "mg_per_1000s": drift.mps2 * per_1000s,
        "sigma": drift.sigma_mps2 * per_1000s,
        "p_value": drift.p_value,
        "significant": drift.significant,
    }


def triad_errors(values: np.ndarray) -> np.ndarray:
    """Return the errors (9,) SI, in the order of ``NAMES``, of a triad with correction ``values`` (9,): the sensor is m = U^-1 f + b.

    Row i of U^-1 is the response of axis i: its length less 1 is the scale factor error, and 90 deg less the angle between two such rows
    their nonorthogonality; b is the bias.
    """
    upper = np.eye(3)
    upper[UPPER] += values[MATRIX]
    M = np.linalg.inv(upper)
    length = np.linalg.norm(M, axis=1)
    u = M / length[:, None]
    found = np.array(values, dtype=float)
    found[SCALES] = length - 1
    found[SHEARS] = [np.arcsin(u[i] @ u[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    return found


def jacobian(calibration: Accelerometer, x: np.ndarray) -> np.ndarray:
    """Return the derivative (9, 9) of the triad's parameters by the correction x (9,) that led to a calibration."""
    matrix = np.linalg.solve(matrix_of(x), calibration.matrix)
    before = Accelerometer(matrix, calibration.bias_mps2 - np.linalg.solve(matrix, x[BIAS]), calibration.source)
    return derivative(lambda moved: after(moved, before).triad, x)


def _unobserved_values(joint: JointFit) -> tuple[str, ...]:
    """Return the names of the triad's parameters with a tenth or more of their production spread from unobserved parameters of x."""
    left = np.isin(NAMES, joint.unobserved)
    spread = (jacobian(joint.accelerometer, joint.x) * joint.prior) ** 2
    due = np.sqrt(spread[:, left].sum(axis=1) / spread.sum(axis=1))
    return tuple(name for name, share in zip(NAMES, due, strict=True) if share >= OBSERVED_BELOW)


def into_frame_of(first: Accelerometer, other: Accelerometer) -> np.ndarray:
    """Return the transform (12, 12) of E row by row and B, in the body frame that one accelerometer defines, into that of the first one;
    exactly 1 for equal frames."""
    turned = np.eye(linear.PARAMETERS)
    if not np.array_equal(first.matrix, other.matrix):
        turn = first.frame @ other.frame.T
        turned[linear.MATRIX, linear.MATRIX], turned[linear.BIAS, linear.BIAS] = np.kron(turn, np.eye(3)), turn
    return turned


def accelerometer_fit(
    calibration: Accelerometer, joint: JointFit | None, covariance: np.ndarray | None, gravity_mps2: float, sources: Sequence[Source] = ()
) -> AccelerometerFit:
    """Describe a fit's accelerometer; covariance (21, 21) of ``JOINT_NAMES``, where noise was estimated, and its sources; gravity_mps2:
    expected length."""
    if joint is None:
        return AccelerometerFit("given", calibration, unobserved=NAMES if calibration.source == "none" else ())
    own = joint.covariance if covariance is None else covariance[:PARAMETERS, :PARAMETERS]
    before = joint.before
    if joint.mode == "fit":  # before that, it was the first estimate from the lengths
        moved = 0.0 if joint.drift is None else joint.share[:, None] * joint.drift.mps2
        before = np.linalg.norm(calibration.measured(joint.force) + moved, axis=1) - gravity_mps2
    return AccelerometerFit(
        joint.mode,
        calibration,
        own,
        _unobserved_values(joint),
        joint.p_value,
        (before, joint.after),
        joint.x,
        joint.drift,
        tuple(source.of(slice(0, PARAMETERS)) for source in sources),
    )


def of_lengths(found: LengthFit) -> AccelerometerFit:
    """Describe the calibration from gravity's length in the stills alone."""
    spread = found.before, found.after
    return AccelerometerFit("fit", found.accelerometer, found.covariance, found.unobserved, None, spread, found.x, found.drift)
