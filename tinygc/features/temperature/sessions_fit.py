"""Sessions at several temperatures, and rest logs, in one model by generalised least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc

from session.base.errors import FitError
from session.base.numeric import sigmas_in
from session.base.progress import Progress, no_report
from session.log.config import Accelerometer
from session.log.folder import Session
from session.log.logfile import Log
from tinygc.estimation.accelerometer import into_frame_of
from tinygc.estimation.options import FitOptions
from tinygc.features.temperature.axis_fit import WIDE, AxisFit
from tinygc.features.temperature.model import ThermalModel
from tinygc.features.temperature.rest_fit import RestFit
from tinygc.fitting.fit import fit_session
from tinygc.inference.noise import estimate
from tinygc.inference.solve import solve
from tinygc.models.linear import BIAS, MATRIX, LinearModel

# Parameters of a model over temperature in one vector: E's terms, the zero's, the lags.


def zero_terms(fits: tuple[AxisFit, ...]) -> np.ndarray:
    """(Q + 1, 3) per degC^n, zeros beyond an axis' own order."""
    terms = np.zeros((max(fit.order for fit in fits) + 1, 3))
    for axis, fit in enumerate(fits):
        terms[: fit.order + 1, axis] = fit.terms
    return terms


def zero_covariance(fits: tuple[AxisFit, ...], order: int) -> np.ndarray:
    """(3 (order + 1) + 3, …): of ``zero_terms`` order by order, then of the lags; axes are independent."""
    size = 3 * (order + 1) + 3
    whole = np.zeros((size, size))
    for axis, fit in enumerate(fits):
        rows = [3 * n + axis for n in range(fit.order + 1)] + [size - 3 + axis]
        whole[np.ix_(rows, rows)] = fit.covariance
    return whole


def usable_range(rests: RestFit) -> tuple[float, float]:
    """Temperature range of the model; where none was logged, the chip's own 25 degC."""
    low, high = rests.range_c
    return (low, high) if np.isfinite(low) else (25.0, 25.0)


# A session with turns as one point over temperature: E and zero at its mean temperature, with their covariance.


@dataclass(frozen=True, eq=False)
class _SessionPoint:
    """name; temp_c: mean over its logs, from low_c to high_c; values (12,): E row by row, then the zero b = -E^-1 B, rad/s; covariance
    (12, 12) of them; segments used; accelerometer: the calibration on which the fit is based, in whose body frame E is."""

    name: str
    temp_c: float
    low_c: float
    high_c: float
    values: np.ndarray
    covariance: np.ndarray
    segments: int
    accelerometer: Accelerometer = field(default_factory=lambda: Accelerometer(source="none"))


def point_of(session: Session, shape: ThermalModel | None, progress: Progress = no_report) -> _SessionPoint:
    """Fit one session by least squares; shape: zero over temperature from rest logs, which refers readings to the mean temperature.

    Raises FitError where a log has no temperature, and the errors of a fit.
    """
    temps = []
    for log in session.logs:
        if log.samples.temp_c is None:
            raise FitError(
                f"{session.name}: {log.path.name} has no temperature, which a model over temperature needs; leave the session out"
            )
        temps.append(log.samples.temp_c)
    temp = np.concatenate(temps)
    mean_c = float(temp.mean())
    if shape is not None:
        session = replace(session, logs=tuple(_brought_to(log, shape, mean_c) for log in session.logs), closures=())
    options = FitOptions(methods=("least_squares",))
    found = fit_session(session, options, lambda what, done, of: progress(f"{session.name}: {what}", done, of))
    values, covariance = _zero_form(found.linear.linear, found.covariance)
    low, high = np.quantile(temp, [0.005, 0.995])
    own = found.accelerometer.calibration
    return _SessionPoint(session.name, mean_c, float(low), float(high), values, covariance, len(found.problem.used), own)


def _in_frame_of_first(points: Sequence[_SessionPoint]) -> tuple[_SessionPoint, ...]:
    """Rotate all points into the first one's body frame, as ``compare`` does; a zero is the sensor's own reading, and has no frame."""
    found = []
    for point in points:
        turn = np.eye(12)
        turn[MATRIX, MATRIX] = into_frame_of(points[0].accelerometer, point.accelerometer)[MATRIX, MATRIX]
        found.append(replace(point, values=turn @ point.values, covariance=turn @ point.covariance @ turn.T))
    return tuple(found)


def _brought_to(log: Log, shape: ThermalModel, mean_c: float) -> Log:
    """Return the log as if it had been recorded at one temperature, with respect to the zero."""
    samples = log.samples
    assert samples.temp_c is not None
    # Beyond the rest logs' range the shape is constant, which is safer than extrapolating a polynomial.
    element = np.column_stack([follow(samples.temp_c) for follow in shape.elements(samples.period_s)])
    change = shape.zero(element) - shape.zero(np.full((1, 3), mean_c))
    return replace(log, samples=replace(samples, gyro=samples.gyro - change))


def _zero_form(model: LinearModel, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (12,) E row by row and b, where omega = E (m - b), and their covariance, from those of E and B."""
    inverse = np.linalg.inv(model.E)
    zero = -inverse @ model.B
    slope = np.eye(12)
    slope[BIAS, MATRIX] = -np.einsum("ij,k->ijk", inverse, zero).reshape(3, 9)
    slope[BIAS, BIAS] = -inverse
    return np.concatenate([model.E.ravel(), zero]), slope @ covariance @ slope.T


# Sessions at several temperatures, and rest logs, in one model: E(T) and b(T) by generalised least squares.
#
# Each session gives E and its zero with a covariance; E is in the body frame of that session's accelerometer, and is rotated into the
# first one's.  Rest logs give the change of the zero over temperature and its lags with their covariance, but not its level, since a zero
# changes from one switch-on to the next, and a rest log's includes the Earth's rotation.  Scatter of the sessions' zeros beyond
# their sigmas is attributed to switch-on, with a variance of its own; scatter of E widens its sigmas (Birge 1932).  With both, all numbers
# are one solution.

#: highest order of E that is tried: sensitivity over temperature is nearly linear (data sheets state a slope)
MOST_E = 2
#: highest order of the zero that is tried without rest logs
MOST_ZERO = 3
#: p-value below which E, or without rest logs the zero, is reported to depend on temperature
BY_CHANCE = 0.01
#: degC: sessions closer than this count as one temperature
APART_C = 2.0


@dataclass(frozen=True, eq=False)
class SessionsFit:
    """points: the sessions in the body frame of the first; model; covariance of E's terms, the zero's and the lags, in the order of
    ``ThermalFit.names``.

    E: chi_square, freedom, p_value of the sessions' E about the model; widened: inflation factor of E's variance; p_constant: p-value of a
    constant E; turn_on_rps: scatter of the zero between sessions beyond noise, NaN where it cannot be estimated.
    """

    points: tuple[_SessionPoint, ...]
    model: ThermalModel
    covariance: np.ndarray
    chi_square: float
    freedom: int
    p_value: float
    widened: float
    p_constant: float
    turn_on_rps: float


def join(points: Sequence[_SessionPoint], rests: RestFit | None, most_order: int = 5) -> SessionsFit:
    """Fit one model to all.  Raises FitError without sessions."""
    if not points:
        raise FitError("no session with turns: E needs one, and E over temperature two or more")
    points = _in_frame_of_first(points)
    temps, count = np.array([point.temp_c for point in points]), len(points)
    reference = rests.knots.reference_c if rests is not None else float(np.round((temps.min() + temps.max()) / 2))
    most = int(np.count_nonzero(np.diff(np.sort(temps)) > APART_C))
    away = temps - reference
    values, covariance = np.array([point.values for point in points]), np.array([point.covariance for point in points])

    def lowest_order(which: slice, most: int) -> tuple[int, float, float]:
        """The lowest sufficient order of some numbers, its chi-square, and the p-value of the constant."""
        roots = np.linalg.inv(np.linalg.cholesky(covariance[:, which, which]))
        rows, size = np.einsum("sij,sj->si", roots, values[:, which]).ravel(), roots.shape[1]
        each = [x ** np.arange(most + 1) for x in away]
        whole = np.concatenate([np.kron(powers, root) for powers, root in zip(each, roots, strict=True)])
        designs = [whole[:, : size * (order + 1)] for order in range(most + 1)]
        chi = [float(np.sum((rows - design @ solve(design, rows).shortest) ** 2)) for design in designs]
        p_values = [float(chdtrc(size * (most - order), max(each - chi[-1], 0.0))) for order, each in enumerate(chi[:-1])] + [1.0]
        order = next(order for order, p in enumerate(p_values) if p >= BY_CHANCE)
        return order, chi[order], p_values[0]

    of_E, chi_square, p_constant = lowest_order(MATRIX, min(most, MOST_E))
    freedom = 9 * (count - of_E - 1)
    widened = max(chi_square / freedom, 1.0) if freedom else 1.0
    if rests is None:
        order = lowest_order(BIAS, min(most, most_order, MOST_ZERO))[0]
        free = 3 * (order + 1)
        start, prior = np.zeros(free + 3), np.zeros((free + 3,) * 2)
    else:
        terms = zero_terms(rests.gyro)
        order, free = len(terms) - 1, 3  # the level is the sessions' own
        start, prior = np.append(terms, [fit.tau_s for fit in rests.gyro]), zero_covariance(rests.gyro, order)
    n_E, size = 9 * (of_E + 1), 9 * (of_E + 1) + len(start)
    there = np.zeros((count, 12, size))
    there[:, MATRIX, :n_E] = [np.kron(x ** np.arange(of_E + 1), np.eye(9)) for x in away]
    there[:, BIAS, n_E:-3] = [np.kron(x ** np.arange(order + 1), np.eye(3)) for x in away]
    start, known = np.append(np.zeros(n_E), start), slice(n_E + free, size)
    left, prior = values - there @ start, prior[free:, free:]
    zeros = there[:, BIAS].reshape(3 * count, size)
    base = block_diag(*covariance[:, BIAS, BIAS]) + zeros[:, known] @ prior @ zeros[:, known].T
    turn_on = _turn_on(left[:, BIAS].ravel(), base, zeros[:, n_E : known.start]) if len(zeros) > free else float("nan")
    # What the rest logs know: a root of its covariance, times numbers of variance one, which are rows of their own.
    sigma, root = sigmas_in(prior), np.eye(size)
    scale = np.where(sigma > 0, sigma, 1.0)
    strength, axes = np.linalg.eigh(prior / np.outer(scale, scale))
    root[known, known] = sigma[:, None] * axes * np.sqrt(np.maximum(strength, 0))
    wider = np.repeat([np.sqrt(widened), 1.0], [9, 3])
    switched = np.diag(np.repeat([0.0, np.nan_to_num(turn_on) ** 2], [9, 3]))
    white = np.linalg.inv(np.linalg.cholesky(covariance * np.outer(wider, wider) + switched))
    rows = np.concatenate([(white @ there @ root).reshape(12 * count, size), np.eye(size)[known]])
    found = solve(rows, np.append(np.einsum("sij,sj->si", white, left), np.zeros(len(prior))))
    vector = start + root @ found.shortest
    low, high = float(min(p.low_c for p in points)), float(max(p.high_c for p in points))
    if rests is not None:
        cold, warm = usable_range(rests)
        low, high = min(low, cold), max(high, warm)
    E, zero = vector[:n_E].reshape(-1, 3, 3), vector[n_E:-3].reshape(-1, 3)
    model = ThermalModel(E, zero, vector[-3:], reference, (low, high))
    p_value = float(chdtrc(freedom, chi_square)) if freedom else float("nan")
    return SessionsFit(points, model, root @ found.spread @ root.T, chi_square, freedom, p_value, widened, p_constant, turn_on)


def _turn_on(left: np.ndarray, base: np.ndarray, free: np.ndarray) -> float:
    """Scatter of zeros (n,) beyond their covariance, all axes together, by restricted maximum likelihood, with columns (n, p); 0 where
    none is needed."""
    unit, rows = float(np.sqrt(base.diagonal().mean())), len(left)
    wide = WIDE * max(float(np.std(left)), unit) / unit * free / np.abs(free).max(axis=0)
    found = estimate(left / unit, wide, base / unit**2, [np.eye(rows)], np.ones(1), [None], [np.arange(rows)])
    return float(found.s[0]) * unit


# Result of a fit over temperature: the model, the uncertainty of each parameter, and the input data.


@dataclass(frozen=True, eq=False)
class ThermalFit:
    """model with covariance (n, n) of the parameters in ``names``, SI; rests, sessions: the input fits, either may be None; sha256 of the
    files by name; name of the session, or of the first one."""

    name: str
    model: ThermalModel
    covariance: np.ndarray
    rests: RestFit | None
    sessions: SessionsFit | None
    sha256: dict[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of E's terms row by row, then of the zero's, then of the lags."""
        E = [f"E{n}_{i}{j}" for n in range(len(self.model.E_terms)) for i in "xyz" for j in "xyz"]
        return (*E, *(f"zero{n}_{i}" for n in range(len(self.model.zero_terms)) for i in "xyz"), *(f"lag_{i}" for i in "xyz"))

    @property
    def remaining_rps(self) -> np.ndarray:
        """(3,) rms error of predicting held-out sweeps, NaN without rest logs."""
        return np.full(3, np.nan) if self.rests is None else np.array([fit.held_out for fit in self.rests.gyro])

    @property
    def values(self) -> np.ndarray:
        """(n,) in the order of ``names``."""
        return np.concatenate([self.model.E_terms.ravel(), self.model.zero_terms.ravel(), self.model.lag_s])

    def sigma_at(self, temp_c: float) -> tuple[np.ndarray, np.ndarray]:
        """Return one sigma of E (3, 3) and of the zero (3,) rad/s at a constant temperature, by the covariance alone."""
        away = float(self.model.within(np.array([temp_c]))[0]) - self.model.reference_c
        n_E = self.model.E_terms.size
        powers = away ** np.arange(len(self.model.E_terms)), away ** np.arange(len(self.model.zero_terms))
        slopes = np.kron(powers[0], np.eye(9)), np.kron(powers[1], np.eye(3))
        parts = self.covariance[:n_E, :n_E], self.covariance[n_E:-3, n_E:-3]
        E, zero = (np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", S, C, S), 0)) for S, C in zip(slopes, parts, strict=True))
        return E.reshape(3, 3), zero

    @property
    def sigma(self) -> np.ndarray:
        """(n,) sigma of each parameter."""
        return sigmas_in(self.covariance)


def of_rests_alone(name: str, rests: RestFit, sha256: dict[str, str]) -> ThermalFit:
    """Return the fit of rest logs, with the identity as E, because nothing was turned."""
    terms = zero_terms(rests.gyro)
    model = ThermalModel(np.eye(3)[None], terms, np.array([f.tau_s for f in rests.gyro]), rests.knots.reference_c, usable_range(rests))
    covariance = np.zeros((9 + terms.size + 3,) * 2)
    covariance[MATRIX.stop :, MATRIX.stop :] = zero_covariance(rests.gyro, len(terms) - 1)
    return ThermalFit(name, model, covariance, rests, None, sha256)
