"""What a calibration that holds may differ by from today: parts of variance, each with its source and its degrees of freedom.

calibration     covariance of the old fit, of both sensors
switch-on       2 spread^2 of each number: then and today are one draw each (``unit_state.spread_of``)
wander          of B within one switch-on, where the unit's noise figures say it
temperature     (coefficient x difference)^2 of B and of the accelerometer
references      the Earth's unknown rate, gravity's length, a data rate that nobody measured
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.numeric import sigmas_in
from session.base.units import DEG, G
from tinygc.estimation.spread import (
    ACCELEROMETER,
    COUNT,
    END_S,
    GYROSCOPE,
    USUAL_ACCEL_PER_K,
    USUAL_PER_K,
    ZERO,
    Spread,
    drift_between,
    walk_variance,
)
from tinygc.features.unit.verification.rows import LENGTH, Rows, columns_of
from tinygc.fitting.unit_state import UnitState
from tinygc.noise.whitening import PRECALIBRATION_MPS2


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


def expected_parts(old: UnitState, rows: Rows, spread: Spread, *, switched_on: bool = True, elapsed_s: float | None = None) -> list[Part]:
    """Parts of what r may be without a fault, beside noise; spread: between sessions; switched_on: whether the sensor was, or may have
    been, switched off since then; elapsed_s: how long ago that was, None where not known."""
    instability = rows.twin.problem.instability if rows.twin is not None else None
    both = 0.0
    if not switched_on and elapsed_s is not None and instability is not None:  # the old session is taken to be as long as today's
        span, none = rows.duration_s, np.zeros(1)
        both = drift_between(none, none + span, span + elapsed_s, span, instability.rps).both
    parts, warmer_k = _of_calibration(old, rows, both), rows.warmer_than(old) or 0.0

    def add(name: str, which: slice, sigma: np.ndarray, source: str, assumed: bool, freedom: float = float("inf")) -> None:
        into = np.zeros((COUNT, len(sigma)))
        into[which] = np.diag(sigma)
        parts.append(Part(name, rows.parameters @ into, into, freedom, source, assumed))

    if warmer_k:
        add(
            "temperature",
            ZERO,
            np.full(3, USUAL_PER_K * abs(warmer_k)),
            f"{abs(warmer_k):.1f} K apart, {USUAL_PER_K / DEG:g} dps/K as usual",
            True,
        )
    if not switched_on and old.figures is not None:
        add("wander", ZERO, np.sqrt(walk_variance(END_S if elapsed_s is None else elapsed_s, old.figures)), "drift since then", False)
    for k in np.flatnonzero(spread.scatter > 0) if switched_on else ():
        one, number = spread.at(slice(k, k + 1)), slice(k, k + 1)
        add("switch-on", number, np.sqrt(2) * one.scatter, one.source, one.is_usual, float(one.freedom[0]))
    allowed = max(PRECALIBRATION_MPS2, USUAL_ACCEL_PER_K * abs(warmer_k))
    sigma = np.r_[np.full(6, allowed / G), np.full(3, allowed)]
    add("accelerometer's temperature", ACCELEROMETER, sigma, "0.1 mg/K as usual", True)
    return [*parts, Part("references", rows.known, np.zeros((COUNT, rows.known.shape[1])))]


def _of_calibration(old: UnitState, rows: Rows, both: float = 0.0) -> list[Part]:
    """The old fit's own uncertainty.  The error of a given accelerometer is in gravity's length alone: E has taken up its other part.

    both: covariance, (rad/s)^2, of the drift in the old session and today: the old fit and today's noise each hold it once, and the
    difference of both has it not.
    """
    known = old.joint.copy()
    known[ZERO, ZERO] -= 2 * both * np.eye(3)
    if not old.own_lengths:
        into = columns_of(known)
        return [Part("calibration", rows.parameters @ into, into, source="the old fit")]
    gyroscope, accelerometer = np.zeros((COUNT, 12)), np.zeros((COUNT, 9))
    gyroscope[GYROSCOPE] = columns_of(known[GYROSCOPE, GYROSCOPE])
    accelerometer[ACCELEROMETER] = np.diag(sigmas_in(known[ACCELEROMETER, ACCELEROMETER]))
    in_lengths = np.zeros_like(rows.parameters)
    in_lengths[rows.kinds[LENGTH]] = rows.parameters[rows.kinds[LENGTH]]
    return [
        Part("calibration", rows.parameters @ gyroscope, gyroscope, source="the old fit"),
        Part("accelerometer's calibration", in_lengths @ accelerometer, accelerometer, source="0.1 mg, as given ones usually are"),
    ]
