"""What a calibration that holds may differ by from today: parts of variance, each with its source and its degrees of freedom.

    calibration     covariance of the old fit, of both sensors
    switch-on       2 spread^2 of B: then and today are one draw each; likewise E and the accelerometer where sessions or a lot show it
    temperature     (coefficient x difference)^2 of B and of the accelerometer's zero
    references      the Earth's unknown rate, gravity's length, a data rate that nobody measured

The spread comes from other sessions of the unit (``--history``), session.toml, a lot, the model file, or is that of usual gyroscopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.base import features
from session.base.errors import CalibrationError, FormatError
from session.base.numeric import sigmas_in
from session.base.units import DEG, G
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.estimation.accelerometer import USUAL_SPREAD as USUAL_ACCELEROMETER
from tinygc.estimation.between_sessions import course
from tinygc.estimation.expected_zero import (
    USUAL_ACCEL_PER_K,
    USUAL_PER_K,
    USUAL_SPREAD,
    drift_between,
    expected_zero,
)
from tinygc.estimation.repeatability import taken_out
from tinygc.estimation.session_times import moment_of, times_of
from tinygc.features.unit.calibrated import in_one_frame, read_calibrated
from tinygc.features.unit.verification.old import ACCELEROMETER, COUNT, GYROSCOPE, OldCalibration
from tinygc.features.unit.verification.rows import LENGTH, Rows, columns_of
from tinygc.models.linear import BIAS
from tinygc.noise.figures import NoiseFigures
from tinygc.noise.whitening import PRECALIBRATION_MPS2

#: B in the 21 parameters
ZERO = slice(GYROSCOPE.start + BIAS.start, GYROSCOPE.start + BIAS.stop)
#: the accelerometer's zero in them
ACCELEROMETER_ZERO = slice(ACCELEROMETER.start + 6, ACCELEROMETER.start + 9)
#: source of a spread that the model file has
STATED = "stated in the model file"


@dataclass(frozen=True, eq=False)
class Part:
    """One source: name; columns (n, k) of the rows for one sigma of each of its k numbers; into (21, k): the same of the parameters;
    freedom: degrees of freedom of its size; source, in words; assumed: whether its size is not this unit's own."""

    written = ("name", "source", "freedom", "assumed")
    name: str
    columns: np.ndarray
    into: np.ndarray
    freedom: float = float("inf")
    source: str = ""
    assumed: bool = False


@dataclass(frozen=True, eq=False)
class Spread:
    """Variance (21,) between sessions of one unit, NaN where nothing shows it; degrees of freedom (21,) and source of each, in words;
    note: what else the sessions say."""

    variance: np.ndarray
    freedom: np.ndarray
    sources: Sequence[str]
    note: str = ""


def spread_of_unit(old: OldCalibration, rows: Rows, history: Sequence[Path] = (), lot: Path | None = None) -> Spread:
    """Spread between sessions.  Raises FormatError for a history that shows none, and the errors of a lot."""
    if history:
        return _of_history(old, rows, history)
    variance, freedom, sources = np.full(COUNT, np.nan), np.full(COUNT, np.inf), [""] * COUNT

    def fill(which: slice, sigma: np.ndarray | float | None, words: str, its_freedom: float = np.inf) -> None:
        """Take what an earlier source does not have."""
        if sigma is None:
            return
        own = np.full(COUNT, np.nan)
        own[which] = np.square(sigma)
        for new in np.flatnonzero(np.isnan(variance) & np.isfinite(own)):
            variance[new], freedom[new], sources[new] = own[new], its_freedom, words

    given = rows.session.config.sensor.gyro_bias_repeatability_dps
    fill(ZERO, None if given is None else given * DEG, "given in session.toml")
    if lot is not None:
        if (known := features.first("spread of a production lot", lot, rows.session.config.sensor.model)) is None:
            raise CalibrationError("verify has no option --lot: no feature reads a lot")
        repeatability, shown, lot_freedom = known
        fill(slice(COUNT), np.r_[repeatability[12:], repeatability[:12]], shown, lot_freedom)
    fill(ACCELEROMETER, old.table.get("accelerometer_spread"), STATED)
    fill(ZERO, old.table.get("bias_sigma_rps"), STATED)
    fill(ZERO, USUAL_SPREAD.rps, USUAL_SPREAD.source)
    return Spread(variance, freedom, sources)


def _of_history(old: OldCalibration, rows: Rows, history: Sequence[Path]) -> Spread:
    if len({folder.resolve() for folder in history}) < max(2, len(history)):
        raise FormatError("--history: give two or more other fitted sessions of this unit, each once: one session does not show a spread")
    read = [read_calibrated(folder) for folder in history]
    order, at = times_of([moment_of(each.folder, each.config) for each in read])
    sessions = [read[place] for place in order]
    serial = old.sensor.get("serial") or rows.session.config.sensor.serial
    for each in sessions:
        if serial and each.config.sensor.serial and each.config.sensor.serial != serial:
            raise FormatError(f"--history {each.folder}: of {each.config.sensor.serial!r}, expected {serial!r}, the unit that is verified")
    vectors, stated, _ = in_one_frame(sessions, old.accelerometer or sessions[0].triad.calibration)
    courses = {GYROSCOPE.start + q: course(vectors[:, q], stated[:, q, q], at) for q in range(vectors.shape[1])}
    fits = [each.triad for each in sessions if each.triad.covariance is not None]
    if len(fits) == len(sessions):
        values = np.array([fit.values for fit in fits])
        own = np.array([fit.jacobian @ np.asarray(fit.covariance) @ fit.jacobian.T for fit in fits])
        courses |= {ACCELEROMETER.start + q: course(values[:, q], own[:, q, q], at) for q in range(values.shape[1])}
    variance, freedom = np.full(COUNT, np.nan), np.full(COUNT, np.inf)
    moved: dict[int, list[str]] = {}
    for number, found in courses.items():
        variance[number], freedom[number] = found.model.counted**2, found.model.freedom
        for step in found.steps:
            moved.setdefault(step.before, []).append(JOINT_NAMES[number])
    steps = [f"{', '.join(names)} between {sessions[k].name} and {sessions[k + 1].name}" for k, names in sorted(moved.items())]
    note = f"the other sessions show a step in {'; '.join(steps)}: it is taken out, and is no scatter between switch-ons" if steps else ""
    return Spread(variance, freedom, [f"{len(sessions)} other sessions of this unit{taken_out(list(courses.values()))}"] * COUNT, note)


def expected_parts(
    old: OldCalibration,
    rows: Rows,
    spread: Spread,
    *,
    temp_then_c: float = float("nan"),
    switched_on_since: bool = True,
    elapsed_s: float | None = None,
    figures: NoiseFigures | None = None,
) -> list[Part]:
    """Parts of what r may be without a fault, beside noise; temp_then_c: of the old session, NaN where not known."""
    instability = rows.twin.problem.instability if rows.twin is not None else None
    both = 0.0
    if not switched_on_since and elapsed_s is not None and instability is not None:  # the old session is taken to be as long as today's
        span, none = rows.duration_s, np.zeros(1)
        both = drift_between(none, none + span, span + elapsed_s, span, instability.rps).both
    parts = _of_calibration(old, rows, both)
    warmer_k = rows.temp_c - temp_then_c if np.isfinite(rows.temp_c - temp_then_c) else None
    by_cause, assumed = expected_zero(
        np.zeros((3, 3)),
        elapsed_s=elapsed_s,
        switched_on_since=switched_on_since,
        figures=figures,
        warmer_k=warmer_k,
    )
    sources = {"temperature": f"{abs(warmer_k or 0):.1f} K apart, {USUAL_PER_K / DEG:g} dps/K as usual", "wander": "drift since then"}
    for name, covariance in by_cause.items():
        if name in sources and covariance.any():
            parts.append(_of_parameters(rows, name, ZERO, sigmas_in(covariance), np.inf, sources[name], name in assumed))
    for number in range(COUNT) if switched_on_since else ():
        if np.isfinite(spread.variance[number]):
            sigma = np.sqrt(2 * spread.variance[number : number + 1])
            one, source = slice(number, number + 1), spread.sources[number]
            freedom = float(spread.freedom[number])
            parts.append(_of_parameters(rows, "switch-on", one, sigma, freedom, source, source == USUAL_SPREAD.source))
    hidden = ~np.isfinite(spread.variance[ACCELEROMETER])
    if switched_on_since and hidden.any():
        sigma = np.sqrt(2) * USUAL_ACCELEROMETER.spread * hidden
        parts.append(_of_parameters(rows, "accelerometer's switch-on", ACCELEROMETER, sigma, np.inf, USUAL_ACCELEROMETER.source, True))
    allowed = max(PRECALIBRATION_MPS2, USUAL_ACCEL_PER_K * abs(warmer_k or 0.0))
    sigma = np.r_[np.full(6, allowed / G), np.full(3, allowed)]
    parts.append(_of_parameters(rows, "accelerometer's temperature", ACCELEROMETER, sigma, np.inf, "0.1 mg/K as usual", True))
    parts.append(Part("references", rows.known, np.zeros((COUNT, rows.known.shape[1]))))
    return parts


def _of_parameters(rows: Rows, name: str, which: slice, sigma: np.ndarray, freedom: float, source: str, assumed: bool) -> Part:
    into = np.zeros((COUNT, len(sigma)))
    into[which] = np.diag(sigma)
    return Part(name, rows.parameters @ into, into, freedom, source, assumed)


def _of_calibration(old: OldCalibration, rows: Rows, both: float = 0.0) -> list[Part]:
    """The old fit's own uncertainty.  The error of a given accelerometer is in gravity's length alone: E has taken up its other part.

    both: covariance, (rad/s)^2, of the drift in the old session and today: the old fit and today's noise each hold it once, and the
    difference of both has it not.
    """
    known = old.covariance.copy()
    known[ZERO, ZERO] -= 2 * both * np.eye(3)
    if not old.own_lengths:
        into = columns_of(known)
        return [Part("calibration", rows.parameters @ into, into, source="the old fit")]
    gyroscope, accelerometer = np.zeros((COUNT, 12)), np.zeros((COUNT, 9))
    gyroscope[GYROSCOPE] = columns_of(known[GYROSCOPE, GYROSCOPE])
    accelerometer[ACCELEROMETER] = np.diag(sigmas_in(old.covariance[ACCELEROMETER, ACCELEROMETER]))
    in_lengths = np.zeros_like(rows.parameters)
    in_lengths[rows.kinds[LENGTH]] = rows.parameters[rows.kinds[LENGTH]]
    return [
        Part("calibration", rows.parameters @ gyroscope, gyroscope, source="the old fit"),
        Part("accelerometer's calibration", in_lengths @ accelerometer, accelerometer, source="0.1 mg, as given ones usually are"),
    ]
