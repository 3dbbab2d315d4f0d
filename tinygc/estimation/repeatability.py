"""The bias and the accelerometer of another session: their spread over switch-ons and days, from session.toml, the unit's other sessions,
or a prior.

A fit's covariance is that of this session.  A number that is another one after the next switch-on is off by the difference of two draws
from the spread between sessions, so its sigma in any other session is sqrt(covariance + 2 spread^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.results import read_json
from session.base.texts import command_line
from session.base.units import DEG
from session.detect.accelerometer import NAMES as ACCELEROMETER
from session.log.config import read_config
from session.log.folder import Session, input_hashes
from tinygc.estimation.accelerometer import AccelerometerFit, AnySession
from tinygc.estimation.between_sessions import ONE_SIGMA, Course, course
from tinygc.estimation.session_times import Moment, moment_of, times_of
from tinygc.models.files import load_with_table
from tinygc.models.linear import BIAS, LinearModel
from tinygc.models.model import accelerometer_of


@dataclass(frozen=True, eq=False)
class BiasRepeatability:
    """Spread of the bias between sessions.

    scatter_rps (3,): of each axis, one sigma as it was estimated; source, in words; freedom (3,): its degrees of freedom, infinite where
    it is known.
    """

    scatter_rps: np.ndarray
    source: str
    freedom: np.ndarray = field(default_factory=lambda: np.full(3, np.inf))

    @property
    def rps(self) -> np.ndarray:
        """(3,) one sigma of B of each axis: the scatter, widened as Student's t is, so that 68 % of the next sessions lie within it."""
        return widened(self.scatter_rps, self.freedom)

    def sigma(self, own: np.ndarray) -> np.ndarray:
        """(3,) rad/s: one sigma of B in any other session, where ``own`` (3, 3) is its covariance in the fit."""
        return np.sqrt(np.diag(own) + 2 * self.rps**2)

    def any_session(self, covariance: np.ndarray) -> np.ndarray:
        """(12, 12) covariance of a fit's vector as that of another session, from its own (12, 12)."""
        other = np.array(covariance, dtype=float)
        other[BIAS, BIAS] += np.diag(2 * self.rps**2)
        return other

    def to_json(self, own: np.ndarray) -> dict:
        """Return ``bias_any_session`` of ``tinygc-fit/2``; own (3, 3): covariance of B in the fit."""
        return {
            "spread_dps": self.rps / DEG,
            "degrees_of_freedom": self.freedom,
            "sigma_dps": self.sigma(own) / DEG,
            "source": self.source,
        }


def widened(scatter: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """(n,): scatters (n,) of these degrees of freedom (n,), times the 68 % of Student's t."""
    if np.isinf(freedom).all():
        return scatter
    from scipy.special import stdtrit  # late: most sessions have no history

    return scatter * np.where(np.isfinite(freedom), stdtrit(freedom, (1 + ONE_SIGMA) / 2), 1.0)


def repeatability_of(session: Session, history: Sequence[Path] = ()) -> BiasRepeatability | None:
    """Spread of B between sessions of this unit: from fitted sessions, else from session.toml; None where neither tells.

    history: fitted session folders of this unit.  Raises FormatError for one that is not fitted, or of another unit.
    """
    given = session.config.sensor.gyro_bias_repeatability_dps
    if not history:
        return None if given is None else BiasRepeatability(np.full(3, given * DEG), "given in session.toml")
    # Raise FormatError where a folder of the history holds a log of this session, or of another one: a copy shows no spread.
    if not session.config.sensor.serial:
        raise FormatError(f"--history: {session.folder} names no serial number; give sensor.serial, so that it is the same unit")
    if len({folder.resolve() for folder in history}) < len(history):
        raise FormatError("--history: a folder is given twice; give other sessions of this unit, each once")
    seen = {digest: str(session.folder) for name, digest in input_hashes(session).items() if name != "session.toml"}
    for folder in history:
        path = folder / "fit" / "model_least_squares.json"
        hashes = read_json(path).get("sha256") if path.exists() else None
        for name, digest in (hashes or {}).items():
            if name != "session.toml" and seen.setdefault(digest, str(folder)) != str(folder):
                raise FormatError(f"--history {folder}: holds the same log as {seen[digest]}; give other sessions of this unit")
    vectors, covariances = zip(*(_fitted(folder, session) for folder in history), strict=True)
    if len(vectors) < 2:
        raise FormatError(
            f"--history: one session does not show a spread; give two or more other sessions of {session.config.sensor.serial}"
        )
    return between_sessions(np.array(vectors), np.array(covariances), [_moment(folder) for folder in history])


def between_sessions(
    biases: np.ndarray, covariances: np.ndarray, moments: Sequence[Moment | None], source: str = "other sessions of this unit"
) -> BiasRepeatability:
    """The spread of the biases (n, 3) of one unit with their covariances (n, 3, 3), n of at least 2, recorded at these moments.

    A drift, of four sessions or more, and steps that are significant are taken out (``between_sessions.course``); sessions without dates
    count as they come.
    """
    scatter, freedom, less = _scatters(biases, covariances, moments)
    return BiasRepeatability(scatter, f"{len(biases)} {source}{less}", freedom)


def _scatters(values: np.ndarray, own: np.ndarray, moments: Sequence[Moment | None]) -> tuple[np.ndarray, np.ndarray, str]:
    """Scatter and freedom (q,) of values (n, q) with covariances own (n, q, q), and what is taken out of it, in words."""
    order, at = times_of(moments)
    courses = [course(values[order, number], own[order, number, number], at) for number in range(values.shape[1])]
    scatter, freedom = (np.array([getattr(each.model, name) for each in courses], dtype=float) for name in ("counted", "freedom"))
    return scatter, freedom, taken_out(courses)


def taken_out(courses: Sequence[Course]) -> str:
    """``, less drift and 1 step``: what the scatter of these courses leaves out, in words."""
    steps = sum(len(each.steps) for each in courses)
    taken = [*(["drift"] if courses[0].has_drift else []), *([f"{steps} step{'s' * (steps > 1)}"] if steps else [])]
    return f", less {' and '.join(taken)}" if taken else ""


def accelerometer_between(history: Sequence[Path]) -> AnySession | None:
    """Spread of the accelerometer's nine numbers over fitted sessions of one unit; None where fewer than two have estimated them.

    Raises FormatError for one that is not fitted.
    """
    read = [(folder, _triad(folder)) for folder in history]
    found = [(folder, *triad) for folder, triad in read if triad is not None]
    if len(found) < 2:
        return None
    folders, values, own = zip(*found, strict=True)
    scatter, freedom, less = _scatters(np.array(values), np.array(own), [_moment(folder) for folder in folders])
    return AnySession(widened(scatter, freedom), f"{len(found)} other sessions of this unit{less}")


def _triad(folder: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """The nine numbers (9,) of a fitted session's accelerometer, with their covariance (9, 9); None where it did not estimate them."""
    path = folder / "fit" / "model_least_squares.json"
    _, table = load_with_table(path)
    calibration, joint = accelerometer_of(table, str(path)), table.get("joint_covariance")
    if calibration is None or joint is None:
        return None
    covariance = np.asarray(joint["matrix"], dtype=float)[: len(ACCELEROMETER), : len(ACCELEROMETER)]
    fit = AccelerometerFit("fit", calibration, covariance)
    return fit.values, fit.jacobian @ covariance @ fit.jacobian.T


def _moment(folder: Path) -> Moment | None:
    path = folder / "session.toml"
    return moment_of(folder, read_config(path) if path.exists() else None)


def _fitted(folder: Path, session: Session) -> tuple[np.ndarray, np.ndarray]:
    """B (3,) of a fitted session of the same unit, with its covariance (3, 3)."""
    path, fit = folder / "fit" / "model_least_squares.json", command_line("fit", folder)
    if not path.exists():
        raise FormatError(f"{path}: not found; fit the session first: {fit}")
    model, table = load_with_table(path)
    sensor, own = table.get("sensor", {}), session.config.sensor
    if (sensor.get("model"), sensor.get("serial")) != (own.model, own.serial):
        raise FormatError(f"{path}: of {sensor.get('model')} {sensor.get('serial')!r}, expected {own.model} {own.serial!r}, this session's")
    covariance = np.asarray(table.get("covariance") or np.nan, dtype=float)
    if not isinstance(model, LinearModel) or not np.isfinite(covariance).all():
        raise FormatError(f"{path}: no linear model with a covariance; fit the session again: {fit}")
    return model.vector[BIAS], covariance[BIAS, BIAS]
