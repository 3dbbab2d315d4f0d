"""Extrinsics of the units of an array: clock and mounting of each relative to the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.base.errors import CalibrationError
from session.base.rotation import nearest_rotation, unit_vectors
from session.base.units import NS
from session.detect.check_references import with_own_accelerometer
from session.detect.stills import SessionStills, references
from session.log.folder import Session
from tinygc.features.arrays.clocks import ClockFit, Rates, UnitClock, UnitPlace, fit_clock, session_rates
from tinygc.features.arrays.recording import ArraySession

# Mounting of a unit relative to the first one, from gravity in the stills of both and from the rates of both.
#
# Gravity gives the rotation between the accelerometers' triads, which are the body frames; it needs two distinct directions. The rates give
# the rotation between the gyroscopes' triads, about all axes, but a gyroscope's triad is aligned with the accelerometer's only to the
# maker's tolerance. Both are weighted by their sigmas (Wahba's problem; Markley, J. Astronaut. Sci. 36, 1988).

#: rad; misalignment of a gyroscope's triad against the accelerometer of its chip: data sheets state cross-axis sensitivities of 2 %
TRIADS_RAD = 0.02
#: rad; sigma of gravity's direction by an uncalibrated accelerometer: zero offsets of some 30 mg
DIRECTION_RAD = 0.03
#: rad; smallest sigma of a direction: a 16-bit register of 2 g has steps of 6e-5 g
LEAST_RAD = 1e-5
ROUNDS = 20


def fit_mounting(first_force: np.ndarray, unit_force: np.ndarray, rate_matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate a unit's mounting (3, 3), which takes vectors of its body frame to the array's, and its covariance (3, 3) rad^2, of a turn
    about the array's axes.

    first_force, unit_force (K, 3): mean specific force in the same stills, each in its own body frame, any unit of length; rate_matrix (3,
    3): the unit's rates from the first unit's.  K may be 0.
    """
    from_rates = nearest_rotation(np.linalg.inv(rate_matrix))
    ours, theirs = (unit_vectors(force) for force in (first_force, unit_force))
    count = len(ours)
    mounting, sigma = from_rates, DIRECTION_RAD
    for _ in range(ROUNDS):
        # Each direction of gravity has this sigma; the rates' three axes have the sigma TRIADS_RAD.
        axes = np.eye(3)
        weights = np.concatenate([np.full(len(ours), sigma**-2), np.full(3, TRIADS_RAD**-2 / 2)])
        to, of = np.concatenate([ours, axes @ from_rates.T]), np.concatenate([theirs, axes])
        mounting = nearest_rotation((weights[:, None, None] * to[:, :, None] * of[:, None, :]).sum(axis=0))
        information = weights.sum() * np.eye(3) - np.einsum("k,ki,kj->ij", weights, to, to)
        before, freedom = sigma, 2 * count - 3
        if freedom > 0:
            sigma = max(float(np.sqrt(np.square(ours - theirs @ mounting.T).sum() / freedom)), LEAST_RAD)
        if abs(sigma - before) <= 1e-6 * before:
            break
    return mounting, np.linalg.inv(information)


# Extrinsics of the units of an array: clock and mounting of each, from their rates and from gravity in their stills.

#: least overlap of two stills that are one, of the shorter of them
LEAST_SHARED = 0.5
#: share of a period of the readings by which clocks of units polled in turn may seem apart; sensors sample far oftener than they are read
ONE_READER = 0.1


def places_of(array: ArraySession) -> tuple[UnitPlace, ...]:
    """Estimate clock and mounting of every unit against the first; positions are not estimated.

    Raises CalibrationError, which names the unit, where a unit did not feel the same motion, or has mirrored axes.
    """
    rates = [session_rates(unit) for unit in array.units]
    fits = clock_fits(array, rates)
    for number, fit in zip(array.numbers, fits, strict=True):
        if not fit.map_is_known:
            raise CalibrationError(
                f"{array.name}: the motion does not show how unit {number} is mounted: the body turned about too few axes; turn it about "
                "all three"
            )
    forces = [_forces(unit) for unit in array.units]
    places = [UnitPlace(array.numbers[0])]
    for number, fit, mine in zip(array.numbers[1:], fits[1:], forces[1:], strict=True):
        places.append(UnitPlace(number, fit.clock, *fit_mounting(*_common(forces[0], mine, fit.clock), fit.matrix)))
    return tuple(places)


def clock_fits(array: ArraySession, rates: list[tuple[Rates, ...]] | None = None) -> list[ClockFit]:
    """Estimate the clock of every unit; the first one's is exact.  rates: of each unit, if available.  Raises CalibrationError."""
    rates = rates if rates is not None else [session_rates(unit) for unit in array.units]
    names = [f"{array.name}: unit {number}" for number in array.numbers]
    for mine, name in zip(rates, names, strict=True):
        still = np.all([np.ptp(each.rate, axis=0) == 0 for each in mine], axis=0)
        if still.all():
            raise CalibrationError(f"{name} reads one and the same rate throughout: it is dead; take that unit out")
        if still.any():
            axes = ", ".join(axis for axis, is_dead in zip("xyz", still, strict=True) if is_dead)
            raise CalibrationError(
                f"{name} reads one and the same rate about {axes} throughout: take that unit out, or look at its columns"
            )
    fits = [ClockFit(UnitClock(), np.eye(3), np.zeros((3, 3)), np.zeros((len(rates[0]), 3)), 1.0, 0.0)]
    for mine, name in zip(rates[1:], names[1:], strict=True):
        try:
            fit = _as_stamped(fit_clock(rates[0], mine, name), rates[0], mine)
        except CalibrationError:
            _blame_first(rates, names, mine)
            raise
        fits.append(fit)
    _refuse_mirrored(fits, names)
    return fits


def clocks_found(array: ArraySession) -> tuple[dict[int, UnitClock], dict[int, str]]:
    """Return the clocks by number, and a one-line reason for each unit without one; units may have failed in the recording.

    Raises CalibrationError where no unit follows the first one.
    """
    rates = [session_rates(unit) for unit in array.units]
    clocks, why = {array.numbers[0]: UnitClock()}, {}
    for i, number in list(enumerate(array.numbers))[1:]:
        pair = replace(array, numbers=(array.numbers[0], number), units=(array.units[0], array.units[i]))
        try:
            clocks[number] = clock_fits(pair, [rates[0], rates[i]])[1].clock
        except CalibrationError as error:
            why[number] = str(error)
    if len(clocks) == 1:
        raise CalibrationError(next(iter(why.values())))
    return clocks, why


def _refuse_mirrored(fits: list[ClockFit], names: list[str]) -> None:
    """Raise CalibrationError for the first mirrored unit; for the array's first unit where most of the others are mirrored against it."""
    known = [i for i, fit in enumerate(fits) if i and fit.map_is_known]
    mirrored = [i for i in known if np.linalg.det(fits[i].matrix) <= 0]
    if not mirrored:
        return
    name, whose = names[mirrored[0]], "the first unit's"
    if len(mirrored) > 1 and 2 * len(mirrored) > len(known):
        name, whose = names[0], "most of the others'"
    raise CalibrationError(f"{name} has mirrored axes (its rates follow {whose} as in a mirror); correct the signs in its log")


def _as_stamped(fit: ClockFit, first: tuple[Rates, ...], mine: tuple[Rates, ...]) -> ClockFit:
    """Replace a clock that the motion does not separate from the first unit's by an exact one, if the stamps are identical.

    Identical stamps are one reader's; what remains is the latency of each reading (``latency``).
    """
    same = all(np.array_equal(one.t_s, other.t_s) for one, other in zip(first, mine, strict=True))
    apart = max(float(np.abs(fit.clock.array_time(each.t_s[[0, -1]]) - each.t_s[[0, -1]]).max() / each.period_s) for each in mine)
    if not same or apart > ONE_READER:
        return fit
    return replace(fit, clock=replace(fit.clock, offset_s=0.0, rate=0.0))


def _blame_first(rates: list[tuple[Rates, ...]], names: list[str], mine: tuple[Rates, ...]) -> None:
    """Raise CalibrationError for the first unit where the others agree with each other, and none of them with it."""
    others = [each for each in rates[1:] if each is not mine]
    for other in others:
        try:
            fit_clock(other, mine)
        except CalibrationError:
            continue
        try:
            fit_clock(rates[0], other, names[0])
        except CalibrationError as error:
            text = str(error).replace("the array's first unit", "the others").replace("the first unit's", "theirs")
            raise CalibrationError(text) from None


def _forces(session: Session) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the log (K,), the span (K, 2) s of the unit's clock and the mean specific force (K, 3) m/s^2 of each reference still, with the
    best available calibration of the accelerometer."""
    found = SessionStills(session)
    session, _ = with_own_accelerometer(session, looked_at=found)
    found = found.under(session)
    rows = [
        (number, start_s := float(log.samples.t_ns[0]) * NS + still.start_s, start_s + still.duration_s, *still.accel_mean)
        for number, log in enumerate(session.logs)
        for still in references(found.of(log).stills)
    ]
    table = np.array(rows).reshape(-1, 6)
    return table[:, 0], table[:, 1:3], table[:, 3:]


def _common(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...], clock: UnitClock) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean specific force (K, 3) of both units in the stills that both have."""
    logs, spans, forces = ours
    match = np.array([best_overlap(log, clock.array_time(span), logs, spans) for log, span, _ in zip(*theirs, strict=True)], dtype=int)
    return forces[match[match >= 0]], theirs[2][match >= 0]


def best_overlap(log: int, span: np.ndarray, logs: np.ndarray, spans: np.ndarray) -> int:
    """Return which of the stills, by their log (K,) and span (K, 2), has most in common with a still; -1 where none has enough."""
    shared = np.minimum(spans[:, 1], span[1]) - np.maximum(spans[:, 0], span[0])
    least = LEAST_SHARED * np.minimum(spans[:, 1] - spans[:, 0], span[1] - span[0])
    shared = np.where((shared > least) & (logs == log), shared, -1.0)
    return int(np.argmax(shared)) if shared.max(initial=-1.0) > 0 else -1
