"""The digital twin: it predicts every channel from the recorded motion and the current physical model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from session.base import rotation
from session.base.numeric import median_length
from session.base.rotation import unit_vectors
from session.base.units import DEG, G
from session.detect.accelerometer import IDENTITY, force_columns, force_of, units
from tinygc.closure import residual
from tinygc.closure.problem import ACCELEROMETER, Problem
from tinygc.closure.residual import Batch
from tinygc.effects import AppliedEffect, Effect, Movement
from tinygc.inference.solve import solve
from tinygc.models import linear
from tinygc.models.linear import PARAMETERS, LinearModel
from tinygc.noise.thinned import AT_ONCE, StillMeans, conditions, movement_in, thinned

# Positions of the parameters in ``State.vector``, and so in the columns and covariance of a ``Refit``.
#
# The order is: 12 of the linear model, 2 of the Earth's horizontal correction, the length of gravity, then each claim's theta.

LINEAR = slice(0, PARAMETERS)
EARTH = slice(LINEAR.stop, LINEAR.stop + 2)
GRAVITY = EARTH.stop  #: one number
FIRST_CLAIM = GRAVITY + 1


def claim_slice(claims: Sequence[AppliedEffect], number: int) -> slice:
    """Position of the theta of claim ``number``.  Raises IndexError if there is no such claim."""
    start = FIRST_CLAIM + sum(len(claim.theta) for claim in claims[:number])
    return slice(start, start + len(claims[number].theta))


# The state of a twin's physical model, and the channels in which it is compared with the recording.


@dataclass(frozen=True, eq=False)
class State:
    """State of the physical model: the linear model; horizontal (2,) rad/s, a correction of the Earth's horizontal rate along axes (2, 3):
    in the direction of a heading error, and across; gravity_mps2; the claimed effects."""

    model: LinearModel
    horizontal: np.ndarray
    gravity_mps2: float
    axes: np.ndarray
    claims: tuple[AppliedEffect, ...] = ()

    @property
    def earth_t(self) -> np.ndarray:
        """(3,) rad/s correction of the problem's Earth rate."""
        claimed = sum((claim.theta for claim in self.claims if claim.effect.kind == "earth"), np.zeros(3))
        return self.horizontal[0] * self.axes[0] + self.horizontal[1] * self.axes[1] + claimed

    @property
    def bends(self) -> bool:
        """Whether the pre-calibration leaves residual errors."""
        return any(claim.theta.any() for claim in self.claims if claim.effect.kind == "force")

    @property
    def vector(self) -> np.ndarray:
        """All parameters: 12 linear, 2 of the Earth, gravity, and those of each claim, in order."""
        return np.concatenate([self.model.vector, self.horizontal, [self.gravity_mps2], *(claim.theta for claim in self.claims)])

    def with_vector(self, vector: np.ndarray) -> State:
        """Replace the parameters and keep the claims."""
        claims = (replace(claim, theta=vector[claim_slice(self.claims, number)]) for number, claim in enumerate(self.claims))
        model = LinearModel.from_vector(vector[LINEAR])
        return State(model, vector[EARTH], float(vector[GRAVITY]), self.axes, tuple(claims))


@dataclass(frozen=True, eq=False)
class Channels:
    """Stacked residuals or columns: closure (S, d, …) rad, still (Q, 3, …) rad/s, length (Q, …) m/s^2."""

    closure: np.ndarray
    still: np.ndarray
    length: np.ndarray

    def stacked(self) -> np.ndarray:
        """(S d + 3 Q + Q, …)."""
        tail = self.length.shape[1:]
        return np.concatenate([self.closure.reshape(-1, *tail), self.still.reshape(-1, *tail), self.length])


# The digital twin predicts every channel from the recorded motion and the current physical model.
#
# The stacked channels are the closure residual of each segment, and the mean rate and the length of gravity of each still.  Residuals are
# recording minus prediction.  Each parameter and each effect contributes linear columns to all channels, and exact residuals for refitting.

#: step of the finite differences in a still's specific force: m/s^2; 1e-4 of g, with a nonlinearity of 1e-8 and rounding of 1e-12
SMALL_FORCE = 1e-3
#: the step as a share of a parameter's plausible size
SMALL_SHARE = 1e-3


@dataclass(eq=False)
class _Replayed:
    """What is known of the last state, which the next fit begins at and the search replays: its key and rates (N, 3) of each log; the batch
    and the rotation (S, 4) of the body over each segment; the sensitivity (S, T, d, 3)."""

    key: tuple
    rates: list[np.ndarray]
    turned: tuple[Batch, np.ndarray] | None = None
    sensitivity: np.ndarray | None = None


def _key(state: State) -> tuple:
    return state.vector.tobytes(), tuple(claim.effect for claim in state.claims)


class Twin:
    """A problem prepared for prediction."""

    #: the reference's own errors, which compete with the sensor's; and a slow bias, where no still shows it
    errors: tuple[Effect, ...] = ()
    slow: tuple[Effect, ...] = ()
    #: of these, the offset of the reference's clock, where it is unknown: a delay common to all axes is then this offset
    clock: Effect | None = None

    def __init__(self, problem: Problem):
        self.problem, self.batch = problem, problem.batch
        #: what ``fit`` solves
        self.original = problem
        self._known_taken_up: dict[Effect, np.ndarray] = {}
        self._last = _Replayed((), [])
        self.seen, self._thinnings = thinned(problem)
        problem = self.seen  # in the rows passed to effects
        self.segments = problem.used
        at_rest = all(segment.first is not None for segment in self.segments)  # with a further reference no still is a reference
        self.stills = problem.references if at_rest else []
        self.force = force_of([still for _, still in self.stills])
        self.q_tb = np.concatenate([log.references.q_tb for log in problem.logs]) if at_rest else np.zeros((0, 4))
        index = {id(still): number for number, (_, still) in enumerate(self.stills)}
        self.first, self.last = np.array([[index.get(id(s.first), -1), index.get(id(s.last), -1)] for s in self.segments]).T

    def is_impossible(self, claim: AppliedEffect) -> bool:
        """Whether no sensor and no reference has the effect at this size, so that it stands for something else."""
        return False

    @cached_property
    def movements(self) -> list[Movement]:
        """Motion of each log, as passed to effects."""
        return [movement_in(self.problem, self.seen, self._thinnings, log) for log in range(len(self.problem.logs))]

    @cached_property
    def rests(self) -> Movement:
        """The Q stills as the rows of one movement: mean force and temperature, the middle of each still, no rate."""
        known, began = conditions(self.problem), self.problem.began_s
        return Movement(
            t_s=np.array([began[log] + still.start_s + still.duration_s / 2 for log, still in self.stills]),
            dt_s=self.problem.logs[0].samples.period_s,
            rate=np.zeros_like(self.force),
            force_g=self.force / G,
            temp_c=np.array([still.temp_c for _, still in self.stills]),
            vibration_g2=np.zeros(len(self.force)),
            **vars(known),
        )

    def freed(self, state: State, movement: Movement) -> np.ndarray:
        """Specific force (N, 3) m/s^2 of a movement without the accelerometer's errors that a state claims."""
        errors = (-self.bent(claim.effect, movement) @ claim.theta for claim in state.claims if claim.effect.kind == "force")
        return sum(errors, movement.force_g * G)

    def bent(self, effect: Effect, movement: Movement) -> np.ndarray:
        """(N, 3, P) m/s^2 that each parameter of an effect of kind "force" adds to a movement's specific force.

        An accelerometer that was calibrated by these very stills has taken up a part of the effect in its nine parameters.  Naming the
        effect takes that part back.
        """
        own = effect.bent(movement)
        if not self.own_accelerometer or not len(self.force):
            return own
        return own - force_columns(IDENTITY, movement.force_g * G) @ self._taken_up(effect)

    @property
    def own_accelerometer(self) -> bool:
        """Whether the accelerometer was calibrated by the stills of this recording."""
        accelerometer = self.problem.session.config.accelerometer
        return accelerometer.source == "stills" or bool(accelerometer.own_stills)

    def _taken_up(self, effect: Effect) -> np.ndarray:
        """(9, P): what one unit of each parameter of an effect leaves in an accelerometer's nine parameters."""
        if effect in self._known_taken_up:
            return self._known_taken_up[effect]
        joint, own = self.problem.joint, effect.bent(self.rests)
        closure_rows = len(self.segments) * self.batch.angles
        if joint is not None and joint.system.design.shape[0] == closure_rows + len(self.force):
            start = self.start()
            moved = self._bending(start, self.rates(start), np.moveaxis(own, 2, 0))
            rows = np.concatenate([moved.closure.reshape(closure_rows, -1), moved.length])
            found = joint.system.response[ACCELEROMETER] @ rows
        else:  # from the lengths alone
            down = unit_vectors(self.force)
            nine, own = (np.einsum("qi,qip->qp", down, columns) for columns in (force_columns(IDENTITY, self.force), own))
            found = solve(nine, own).shortest
        self._known_taken_up[effect] = found
        return found

    def rows(self, log: int, rows: slice) -> slice:
        """Position of a turn's rows among the rows passed to effects."""
        if self._thinnings is None:
            return rows
        start = self._thinnings[log].row(rows.start)
        return slice(start, start + rows.stop - rows.start)

    def start(self) -> State:
        """The initial state: the linear model alone."""
        here = self.problem.session.config.site.expected_gravity_mps2
        length = median_length(self.force) if self.stills else here
        north = self.problem.earth.rate_t * [1, 1, 0]
        size = np.linalg.norm(north)
        along = np.cross([0, 0, 1], north / size) if size > 0 else np.array([1.0, 0, 0])
        return State(self.problem.first, np.zeros(2), length, np.stack([along, np.cross(along, [0, 0, 1])]))

    def rates(self, state: State) -> list[np.ndarray]:
        """Estimated true rates (N, 3) of each log: linear model applied, effects removed."""
        if self._last.key != (key := _key(state)):
            self._last = _Replayed(key, [self._undone(state, number, len(state.claims)) for number in range(len(self.problem.logs))])
        return self._last.rates

    def _undone(self, state: State, log: int, count: int) -> np.ndarray:
        """Rates (N, 3) of one log with the first ``count`` claims removed."""
        readings = np.asarray(self.seen.logs[log].samples.gyro)
        for claim in state.claims[:count]:
            if claim.effect.on_readings:
                readings = claim.effect.correct(readings, self.movements[log].with_rate(readings), claim.theta)
        rate = state.model(readings)
        for claim in state.claims[:count]:
            if claim.effect.kind == "rate" and not claim.effect.on_readings:
                rate = claim.effect.correct(rate, self.movements[log].with_rate(rate), claim.theta)
        return rate

    def residuals(self, state: State, rates: list[np.ndarray] | None = None) -> Channels:
        """Residuals: recording minus prediction."""
        rates = self.rates(state) if rates is None else rates
        batch, turned = self._turned(state, rates)
        angles = residual.error_angles(residual.batch_residual(batch, rotation.multiply(batch.start, turned)))
        earth = self.problem.still_rates.earth[: len(self.stills)] + np.einsum("qji,j->qi", rotation.matrix(self.q_tb), state.earth_t)
        lengths = np.linalg.norm(self.freed(state, self.rests), axis=1) - state.gravity_mps2
        return Channels(angles, self.still_means(rates) - earth, lengths)

    def _known(self, state: State, rates: list[np.ndarray]) -> _Replayed:
        return self._last if self._last.rates is rates and self._last.key == _key(state) else _Replayed((), rates)

    def _turned(self, state: State, rates: list[np.ndarray]) -> tuple[Batch, np.ndarray]:
        """The batch at a state, and the rotation (S, 4) of the body over each segment at these rates."""
        last = self._known(state, rates)
        if last.turned is None:
            batch = self.batch_at(state)
            last.turned = batch, residual.turned(batch, self.padded(rates))
        return last.turned

    def batch_at(self, state: State) -> Batch:
        """The batch with the state's reference attitudes and Earth."""
        batch = self.batch
        if state.bends:
            bent = self._tilted(self.freed(state, self.rests))
            batch = replace(batch, start=bent[self.first], end=bent[self.last])
        if state.earth_t.any():
            (x, y, z), turn = state.earth_t, self._turns
            earth = np.empty_like(batch.earth)
            for some in residual.parts(len(batch)):
                of = turn[some]
                earth[some] = batch.earth[some] + (x * of[:, :, 0] + y * of[:, :, 1] + z * of[:, :, 2])
            batch = replace(batch, earth=earth)
        return batch

    @cached_property
    def _turns(self) -> np.ndarray:
        """(S, T, 3, 3) from body to table by the first linear fit, to within a degree, which is enough for the Earth's rate."""
        return rotation.matrix(residual.attitudes(self.batch, self.problem.first(self.batch.rate)))

    @cached_property
    def axes(self) -> np.ndarray:
        """Axes (S, 3, 3) of the closure in the table frame, as ``residual.directions``, by the first linear fit."""
        return residual.directions(self.batch, residual.attitudes(self.batch, self.problem.first(self.batch.rate))[:, -1])

    @cached_property
    def level_axes(self) -> list[np.ndarray]:
        """(N, 6) of each log: the table's x and y axes in the body at each sample, by the first linear fit; between segments those of the
        next still."""
        found = []
        for log, movement in enumerate(self.movements):
            axes = np.full((len(movement.t_s), 6), np.nan)
            for (number, still), q in zip(self.stills, self.q_tb, strict=True):
                if number == log:
                    axes[still.start : still.stop] = rotation.matrix(q)[:2].ravel()
            for segment, turn in zip(self.segments, self._turns, strict=True):
                if segment.log == log:
                    axes[segment.start : segment.stop] = turn[: segment.stop - segment.start, :2].reshape(-1, 6)
            known = np.isfinite(axes[:, 0])
            if not known.any():  # no segment of this log is used
                found.append(np.zeros_like(axes))
                continue
            found.append(axes[known][np.searchsorted(np.flatnonzero(known), np.arange(len(axes))).clip(0, known.sum() - 1)])
        return found

    def _tilted(self, force: np.ndarray) -> np.ndarray:
        """Attitudes (Q, 4) of the stills from their forces (Q, 3) m/s^2, with the carried yaw."""
        return rotation.nearest_yaw(self.q_tb, rotation.from_gravity(force))

    def padded(self, rates: list[np.ndarray]) -> np.ndarray:
        """Arrange rates (N, 3) rad/s of each log as those of the batch, (S, T, 3)."""
        padded = np.zeros_like(self.batch.rate)
        for row, segment in zip(padded, self.segments, strict=True):
            count = segment.stop - segment.start
            row[:count] = rates[segment.log][segment.start : segment.stop]
        return padded

    def still_means(self, by_log: list[np.ndarray]) -> np.ndarray:
        """Means (Q, …) over the stills of samples (N, …) of each log."""
        return self._still_means([values.__getitem__ for values in by_log])

    def _still_means(self, by_log: Sequence[Callable[[np.ndarray], np.ndarray]]) -> np.ndarray:
        """``still_means`` of functions of the rows of each log."""
        return np.concatenate([mean(values) for values, mean in zip(by_log, self._means, strict=True)])

    @cached_property
    def _means(self) -> list[StillMeans]:
        logs = range(len(self.problem.logs))
        return [StillMeans([still for number, still in self.stills if number == log], self.counts(log)) for log in logs]

    @cached_property
    def has_thermometer(self) -> bool:
        """Whether all logs have temperatures."""
        return all(np.isfinite(movement.temp_c).all() for movement in self.movements)

    def counts(self, log: int) -> np.ndarray | None:
        """(N,) number of readings averaged in each row of a log; None if it is one."""
        return None if self._thinnings is None else self._thinnings[log].counts

    def sensitivity(self, state: State, rates: list[np.ndarray]) -> np.ndarray:
        """(S, T, d, 3) s: sensitivity of the closure; the row of an unobserved angle is omitted to save memory."""
        last = self._known(state, rates)
        if last.sensitivity is None:
            batch, padded, angles = self.batch_at(state), self.padded(rates), self.batch.angles
            last.sensitivity = np.empty((len(batch), angles, 3, padded.shape[1])).transpose(0, 3, 1, 2)
            for some in residual.parts(len(batch)):
                last.sensitivity[some] = residual.sensitivity(batch.pick(some), padded[some])[:, :, :angles]
        return last.sensitivity

    def linear_columns(self, sensitivity: np.ndarray) -> Channels:
        """Columns of the 12 linear parameters."""
        design = linear.columns(sensitivity, self.batch.rate)
        still = np.zeros((len(self.stills), 3, linear.PARAMETERS))
        mean = self._mean_readings
        for axis in range(3):
            still[:, axis, 3 * axis : 3 * axis + 3] = mean
            still[:, axis, linear.BIAS.start + axis] = 1.0
        return Channels(design, still, np.zeros((len(self.stills), linear.PARAMETERS)))

    @cached_property
    def _mean_readings(self) -> np.ndarray:
        """(Q, 3) rad/s as read."""
        return self.still_means([np.asarray(log.samples.gyro) for log in self.seen.logs])

    def earth_columns(self) -> Channels:
        """Columns of the Earth's rate in table axes, (3,): it rotates the prediction by -w times the segment's duration."""
        design = -self.batch.duration_s[:, None, None] * self.axes[:, : self.batch.angles]
        still = -rotation.matrix(self.q_tb).transpose(0, 2, 1)
        return Channels(design, still, np.zeros((len(self.stills), 3)))

    def gravity_columns(self) -> Channels:
        """Columns of the length of gravity."""
        return Channels(
            np.zeros((len(self.segments), self.batch.angles, 1)), np.zeros((len(self.stills), 3, 1)), -np.ones((len(self.stills), 1))
        )

    def force_columns(self, effect: Effect, state: State, rates: list[np.ndarray]) -> Channels:
        """Columns of an effect of kind "force"."""
        return self._bending(state, rates, np.moveaxis(self.bent(effect, self.rests), 2, 0))

    def precalibration_columns(self, state: State, rates: list[np.ndarray]) -> Channels:
        """Columns of the accelerometer's bias (3) and matrix (9), all in m/s^2; the matrix as an error at one g."""
        down = unit_vectors(self.force)
        bias = np.broadcast_to(np.eye(3)[:, None], (3, len(self.stills), 3))
        matrix = np.einsum("ai,qj->ajqi", np.eye(3), down).reshape(9, len(self.stills), 3)
        return self._bending(state, rates, np.concatenate([bias, matrix]))

    def own_columns(self) -> np.ndarray:
        """(n, 9) stacked columns of the accelerometer's nine parameters, in m/s^2 at one g, at the initial state."""
        start, nine = self.start(), force_columns(IDENTITY, self.force) * units(G)
        return self._bending(start, self.rates(start), np.moveaxis(nine, 2, 0)).stacked()

    def _bending(self, state: State, rates: list[np.ndarray], patterns: np.ndarray) -> Channels:
        """Columns of P patterns (P, Q, 3) subtracted from the stills' force, by finite differences of the reference attitudes."""
        force, (base, turned) = self.freed(state, self.rests), self._turned(state, rates)

        def look(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            bent = self._tilted(force)
            start, end = bent[..., self.first, :], bent[..., self.last, :]
            angles = residual.batch_residual(replace(base, start=start, end=end), rotation.multiply(start, turned))
            return residual.error_angles(angles), np.linalg.norm(force, axis=-1)

        moved = look(force - SMALL_FORCE * patterns)
        design, length = (np.stack((there - now) / SMALL_FORCE, axis=-1) for there, now in zip(moved, look(force), strict=True))
        return Channels(design, np.zeros((len(self.stills), 3, len(patterns))), length)

    def _added(self, effect: Effect, state: State, rates: list[np.ndarray], log: int) -> Callable[[slice | np.ndarray], np.ndarray]:
        """Derivative of the rate with respect to an effect's parameters, (n, 3, P), at a state, as a function of n rows of a log.

        A claimed effect with memory (a lag) is differentiated through its correction: linear columns from the corrected rate would not
        show the part common to all axes.
        """
        claimed = next((i for i, claim in enumerate(state.claims) if claim.effect.id == effect.id), None)
        movement, readings = self.movements[log], np.asarray(self.seen.logs[log].samples.gyro)
        if claimed is None or effect.exact_correct is None:
            of_readings = claimed is None and effect.on_readings
            movement = movement.with_rate(readings if of_readings else rates[log])
            columns = _of_rows(effect, effect.columns, movement)
            return (lambda rows: np.einsum("ij,njp->nip", state.model.E, columns(rows))) if of_readings else columns
        theta, before = state.claims[claimed].theta, readings if effect.on_readings else self._undone(state, log, claimed)
        movement = movement.with_rate(before)
        here = effect.correct(before, movement, theta)
        small = SMALL_SHARE * effect.parameter.plausible
        moved = np.stack([(here - effect.correct(before, movement, theta + step)) / small for step in small * np.eye(len(theta))], axis=-1)
        return (np.einsum("ij,njp->nip", state.model.E, moved) if effect.on_readings else moved).__getitem__

    def effect_columns(self, effect: Effect, state: State, sensitivity: np.ndarray, rates: list[np.ndarray]) -> Channels:
        """Columns of an effect's parameters: change of the residuals when each is added to the state's corrections."""
        if effect.kind == "force":
            return self.force_columns(effect, state, rates)
        if effect.kind == "earth":
            return self.earth_columns()
        if effect.basis is not None:
            return self._basis_columns(effect, effect.basis, sensitivity)
        by_log = [self._added(effect, state, rates, log) for log in range(len(self.movements))]
        d, size = self.batch.angles, effect.parameter.size
        design = np.empty((len(self.segments), d, size))
        for number, part in self._by_segment(by_log):
            turn = sensitivity[number, : len(part)].transpose(1, 0, 2).reshape(d, -1)
            design[number] = turn @ part.reshape(-1, size)
        return Channels(-design, -self._still_means(by_log), np.zeros((len(self.stills), size)))

    def _by_segment(self, by_log: list[Callable[[slice | np.ndarray], np.ndarray]]) -> Iterator[tuple[int, np.ndarray]]:
        """Number of each segment, and the values (n, …) at its samples, of functions of the rows of each log, some at a time."""
        for some in residual.parts(len(self.segments)):
            for log, group in groupby(range(len(self.segments))[some], key=lambda number: self.segments[number].log):
                numbers = list(group)
                first = min(self.segments[number].start for number in numbers)
                values = by_log[log](slice(first, max(self.segments[number].stop for number in numbers)))
                for number in numbers:
                    yield number, values[self.segments[number].start - first : self.segments[number].stop - first]

    def _basis_columns(self, effect: Effect, basis: Callable[[Movement], np.ndarray], sensitivity: np.ndarray) -> Channels:
        """``effect_columns`` of an effect with basis functions: each function is summed once for all axes."""
        by_log = [_of_rows(effect, basis, movement) for movement in self.movements]
        d, size = self.batch.angles, effect.parameter.size
        curves = size // 3
        design = np.empty((len(self.segments), d, curves, 3))
        for number, part in self._by_segment(by_log):
            summed = sensitivity[number, : len(part)].reshape(len(part), -1).T @ part
            design[number] = summed.reshape(d, 3, curves).transpose(0, 2, 1)
        mean = self._still_means(by_log)
        still = mean[:, None, :, None] * np.eye(3)[:, None]
        if effect.has_rows:
            design, still = design.swapaxes(2, 3), still.swapaxes(2, 3)
        return Channels(-design.reshape(-1, d, size), -still.reshape(-1, 3, size), np.zeros((len(self.stills), size)))


def _of_rows(effect: Effect, of: Callable[[Movement], np.ndarray], movement: Movement) -> Callable[[slice | np.ndarray], np.ndarray]:
    """Function of rows of a movement, of an effect's columns (N, …): some rows alone where the log is long and each is of its own sample,
    as all columns at once would be the session's largest array."""
    if len(movement.t_s) <= AT_ONCE or effect.needs_rate_hz:
        return of(movement).__getitem__
    return lambda rows: of(movement.part(rows))


def twin_of(problem: Problem) -> Twin:
    """The twin of a problem: that of its reference, which has rows and errors of its own, or of gravity and dials."""
    reference = problem.session.reference
    found: Twin = Twin(problem) if reference is None else reference.twin(problem)
    return found


# The variable of an effect for each sample, still and segment: the same for JSON, page and plot.
#
# Gravity along an axis is +1 g where that axis points down: the specific force with its sign reversed.

X, Y, Z = range(3)
#: quantities of a movement, (N,) or (N, 3) in display units, with the unit
READ: dict[str, tuple[Callable[[Movement], np.ndarray], str]] = {
    "time": (lambda m: m.t_s, "s"),
    "temperature": (lambda m: m.temp_c, "°C"),
    "vibration": (lambda m: m.vibration_g2, "g²"),
    "rate": (lambda m: np.abs(m.rate) / DEG, "dps"),
    "angular acceleration": (lambda m: np.abs(m.acceleration), "rad/s²"),
    "attitude": (lambda m: -m.force_g, "g"),
}


@dataclass(frozen=True)
class Variable:
    """A variable of ``READ``; axis 0 to 2 where it is one component of a vector, None for a scalar or the greatest component."""

    variable: str
    axis: int | None = None

    @property
    def units(self) -> str:
        """Name of the unit."""
        return READ[self.variable][1]

    @property
    def words(self) -> str:
        """``gravity along x``, ``temperature``, ``rate about y``."""
        if self.axis is None:
            return self.variable
        return f"gravity along {'xyz'[self.axis]}" if self.variable == "attitude" else f"{self.variable} about {'xyz'[self.axis]}"

    def of_samples(self, movement: Movement) -> np.ndarray:
        """(N,) value at each sample of a log."""
        values = READ[self.variable][0](movement)
        if values.ndim == 1:
            return values
        return values.max(axis=1) if self.axis is None else values[:, self.axis]

    def of_stills(self, twin: Twin) -> np.ndarray:
        """(Q,) mean over each still."""
        values = [self.of_samples(movement) for movement in twin.movements]
        return np.array([values[log][still.start : still.stop].mean() for log, still in twin.stills])

    def of_segments(self, twin: Twin) -> np.ndarray:
        """(S,) maximum in each segment."""
        values = [self.of_samples(movement) for movement in twin.movements]
        return np.array([values[segment.log][segment.start : segment.stop].max() for segment in twin.segments])


def variable_of(effect: Effect | None, theta: np.ndarray | None = None) -> Variable:
    """Variable of an effect with parameters theta (P,): its axis is that of a matrix's strongest column or a vector's strongest entry.

    Time is used for an effect whose variable a movement does not contain, and for None.
    """
    variable = effect.conditions[0] if effect is not None and effect.conditions else "time"
    if variable not in READ:
        return Variable("time")
    if theta is not None and np.size(theta) == 9 and variable in ("attitude", "rate", "angular acceleration"):
        return Variable(variable, int(np.argmax(np.linalg.norm(np.reshape(theta, (3, 3)), axis=0))))
    if variable != "attitude":
        return Variable(variable)
    if effect is None or theta is None or np.size(theta) != 3 or effect.kind == "earth":
        return Variable(variable, Z)
    return Variable(variable, int(np.argmax(np.abs(theta))))
