"""What is compared: the sensor against the table, in four kinds of rows, and how every small error enters each.

    force     of each rest:  measured force, corrected, less -R_tb^T e_z, in g                            (Q, 3)
    rotation  of each turn:  rotation vector of (R_i^T R_j)^T Q_gyro, rad                                  (S, 3)
    rate      of each rest:  corrected rate less the Earth's, rad/s                                        (Q, 3)
    within    of each turn of one axis alone: at each edge of a block, the gyroscope's angle about the axis less the reported one, rad, both
              with their ends taken together, so that scale and offset show nothing here                     (S, B - 1)

All rows are recording less prediction.  Two operators take any small error to the rows:

    ``of_attitudes``: rotations phi (Q, 3) of the body at rest missing from the prediction, R_true = R Exp(phi): force phi x R^T e_z,
    rotation phi_j - (R_i^T R_j)^T phi_i;     ``of_rates``: a rate that the gyroscope reads on top of the true one, in blocks and rests.

The sensor's calibration, the mounting, the zero of each axis, the Earth's rate and the latency of the machine's word are always free, with
the priors below: the state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.numeric import UPPER, running_sum
from session.base.rotation import accumulate, cross_matrix, exp, identities, matrix, unit_vectors
from session.base.units import DEG, EARTH_RATE_RPS, G
from tinygc.effects import Effect, Movement
from tinygc.effects.catalogue import catalogue
from tinygc.features.tables.machines.description import (
    LATENCY_SIGMA_S,
    TableErrors,
    body_axes,
    rotations,
    stage_attitudes,
    true_attitudes,
)
from tinygc.features.tables.observed import Observed

#: other errors of a table, with those of theta (P,) as well
Added = Callable[[TableErrors, np.ndarray], TableErrors]

# The state: what is always free, with the sigma of its prior.

#: sigma of each element of an uncalibrated gyroscope's matrix; of its zero, rad/s; those of an accelerometer, in g, are alike
MATRIX_SIGMA, ZERO_RATE_SIGMA = 0.05, 5 * DEG
#: rad: the mounting; the zero of an axis; the play in which an axis hangs before its first motion
MOUNTING_SIGMA, ZERO_SIGMA, BEFORE_SIGMA = 3 * DEG, 1 * DEG, 0.2 * DEG
#: share of the vertical rate of the Earth where the latitude is given
VERTICAL_SHARE = 0.01

#: s: lag of a gyroscope, its axes alike, which no closure shows
LAG_SIGMA_S = 0.02
#: rad that a motor has turned when its turn has begun
BEGUN_RAD = 0.05 * DEG
#: rad of an axis between two edges, below which it stands
STANDS_RAD = 1e-3 * DEG
#: step of a difference of errors, rad
SMALL = 1e-6
#: numbers of the state's parts before those of the axes, and where the mounting is
SIZES, MOUNTED = (9, 3, 6, 3, 3, 3), slice(21, 24)


def parts_of(observed: Observed) -> dict[str, np.ndarray]:
    """Name of each part of the state, and the sigma of each of its numbers."""
    axes, accel, latitude = observed.reported.shape[1], observed.accel_sigma_g, observed.latitude_rad
    earth = (1.0, 1.0) if latitude is None else (np.cos(latitude), VERTICAL_SHARE)
    return {
        "gyroscope's matrix": np.full(9, MATRIX_SIGMA),
        "gyroscope's zero": np.full(3, ZERO_RATE_SIGMA),
        "accelerometer's matrix": np.full(6, accel),
        "accelerometer's zero": np.full(3, accel),
        "mounting": np.full(3, MOUNTING_SIGMA),
        "Earth's rate": EARTH_RATE_RPS * np.array([earth[0], *earth]),
        "zero of an axis": np.full(axes, ZERO_SIGMA),
        "play before the first motion": np.full(axes, BEFORE_SIGMA),
        "latency of the word": np.full(1, LATENCY_SIGMA_S),
        "lag of sensor and word": np.full(1, LAG_SIGMA_S),
        "second order of the lag": np.full(1, LAG_SIGMA_S**2),
    }


def prior_of(observed: Observed) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sigma (P,) of the state's priors."""
    sigma = np.concatenate(list(parts_of(observed).values()))
    mean = np.zeros_like(sigma)
    if observed.latitude_rad is not None:
        mean[sum(SIZES) - 1] = -EARTH_RATE_RPS * np.sin(observed.latitude_rad)
    return mean, sigma


class Comparison:
    """An observed session at one state (P,), with the errors of the table that are known so far: residuals, and the operators of further
    small errors there.

    errors: tilt, skew and wobble, and in ``lost`` of an axis the angles (Q,) rad at rest on top of the reported ones; they enter exactly.
    """

    def __init__(self, observed: Observed, state: np.ndarray | None = None, errors: TableErrors | None = None):
        self.observed = observed
        self.state = prior_of(observed)[0] if state is None else state
        self._errors = TableErrors.none(observed.table) if errors is None else errors
        parts = np.split(self.state, np.cumsum([*SIZES, *[observed.reported.shape[1]] * 2]))
        self.matrix, self._zero = np.eye(3) + parts[0].reshape(3, 3), parts[1]
        self._accel = np.eye(3)
        self._accel[UPPER] += parts[2]
        self._accel_zero, self._mounting, self._earth, self._axis_zero, self._before, (self.latency_s, *self._lag) = parts[3:]

    @cached_property
    def angles(self) -> np.ndarray:
        """(Q, K) rad: the word at rest, with the zeros of the state and what is known to be added to it."""
        lost = np.stack([np.broadcast_to(each.lost, len(self.observed.reported)) for each in self._errors.axes], axis=1)
        return self.observed.reported + self._axis_zero + self.unmoved * self._before + lost

    @cached_property
    def unmoved(self) -> np.ndarray:
        """(Q, K): 1 where an axis has not moved yet."""
        return (self.observed.senses == 0).astype(float)

    @cached_property
    def mounting(self) -> np.ndarray:
        """(3, 3), body to the innermost stage."""
        return self.observed.table.mounting @ Rotation.from_rotvec(self._mounting).as_matrix()

    def attitudes(self, angles: np.ndarray) -> np.ndarray:
        """R_tb (N, 3, 3) of angles (N, K) rad."""
        return stage_attitudes([axis.direction for axis in self.observed.table.axes], angles) @ self.mounting

    @cached_property
    def at_rest(self) -> np.ndarray:
        """R_tb (Q, 3, 3).  The zero of the outermost axis turns the base with it, so that a tilt is in the frame of the reported angles."""
        table, axes = self.observed.table, tuple(replace(each, lost=0.0) for each in self._errors.axes)
        outermost = self._axis_zero * (np.arange(len(axes)) == 0)
        stage = true_attitudes(table, replace(self._errors, axes=axes), self.angles - outermost)
        return rotations(table.axes[0].direction, outermost[0]) @ stage @ table.mounting.T @ self.mounting

    @cached_property
    def down(self) -> np.ndarray:
        """(Q, 3): the vertical in the body."""
        return self.at_rest[:, 2]

    @cached_property
    def turned(self) -> np.ndarray:
        """R_i^T R_j (S, 3, 3)."""
        seen = self.observed
        return self.at_rest[seen.first].transpose(0, 2, 1) @ self.at_rest[seen.last]

    @cached_property
    def earth_in_blocks(self) -> np.ndarray:
        """(S, B, 3, 3): R_tb^T in the middle of each block."""
        seen = self.observed
        middle = (seen.reported_edges[:, 1:] + seen.reported_edges[:, :-1]) / 2
        flat = self.attitudes(middle.reshape(-1, middle.shape[-1]))
        return flat.reshape(*middle.shape[:2], 3, 3).transpose(0, 1, 3, 2)

    @cached_property
    def rates(self) -> np.ndarray:
        """(S, B, 3) rad/s: true rates against the table, by the state; zero beyond a turn's last block."""
        found = self.observed.rates @ self.matrix.T + self._zero - self.earth_in_blocks @ self._earth
        return np.where(self.observed.inside[..., None], found, 0.0)

    @cached_property
    def turning(self) -> np.ndarray:
        """``rates``, zero where the machine reports that nothing moves: what a column is made of must not hold the noise that it is held
        against."""
        moves = np.abs(np.diff(self.observed.reported_edges, axis=1)).max(axis=2) > STANDS_RAD
        return np.where(moves[..., None], self.rates, 0.0)

    @cached_property
    def _so_far(self) -> np.ndarray:
        """(S, B, 3, 3): begin of a turn to the end of each block, by the gyroscope."""
        return matrix(accumulate(exp(self.rates * self.observed.block_s[:, None, None])))

    @property
    def by_gyro(self) -> np.ndarray:
        """(S, 3, 3): begin to end, R_i^T R_j by the gyroscope."""
        return self._so_far[:, -1]

    @cached_property
    def to_end(self) -> np.ndarray:
        """(S, B, 3, 3) s: rotation of the end, in its own axes, per rate in a block."""
        within = _right_jacobian(self.rates * self.observed.block_s[:, None, None])
        after = self.by_gyro.transpose(0, 2, 1)[:, None] @ self._so_far
        return after @ within * (self.observed.inside * self.observed.block_s[:, None])[..., None, None]

    @cached_property
    def axis(self) -> np.ndarray:
        """(S, 3) unit: the axis that turns alone, in the body; zero where several turn."""
        seen = self.observed
        axes = body_axes(seen.table, self.angles[seen.first]) @ (seen.table.mounting.T @ self.mounting)
        return np.where(seen.alone[:, None] >= 0, axes[np.arange(len(axes)), seen.alone], 0.0)

    @cached_property
    def inner(self) -> np.ndarray:
        """(S, B - 1) bool: the edges that rows ``within`` have, those between the blocks of a turn of one axis alone."""
        seen = self.observed
        count = seen.rates.shape[1]
        return (np.arange(1, count) < seen.blocks[:, None]) & ((seen.alone >= 0) & ~seen.blind)[:, None]

    @cached_property
    def reported_way(self) -> np.ndarray:
        """(S, B + 1) rad: what the machine reports that the axis has turned since the begin, at each edge, ``latency_s`` later."""
        seen = self.observed
        way = (seen.reported_edges - seen.reported_edges[:, :1])[np.arange(len(seen.first)), :, seen.alone]
        last = way.shape[1] - 1
        at = np.clip((self.latency_s / seen.block_s)[:, None] + np.arange(last + 1), 0, last) + 1
        padded = np.pad(way, ((0, 0), (1, 2)), mode="edge")
        return np.stack([cubic_weights(some, last + 4) @ each for each, some in zip(padded, at, strict=True)])

    def pinned(self, way: np.ndarray) -> np.ndarray:
        """Rows ``within`` (W, …) of an angle (S, B + 1, …) at the edges: without its begin, and with its end shared as the reported angle
        has it."""
        share = self.share
        tail = (1,) * (way.ndim - 2)
        way = way - way[:, :1]
        return (way - share.reshape(*share.shape, *tail) * way[:, -1:])[:, 1:-1][self.inner]

    @cached_property
    def share(self) -> np.ndarray:
        """(S, B + 1): of the reported angle of a turn, at each edge."""
        end = self.reported_way[:, -1:]
        return np.where(np.abs(end) > 0, self.reported_way / np.where(np.abs(end) > 0, end, 1.0), 0.0)

    def residuals(self) -> np.ndarray:
        """(n,): recording less prediction."""
        seen = self.observed
        along = np.einsum("sbi,si->sb", self.rates, self.axis) * seen.block_s[:, None]
        rows = self._rows(
            1,
            force=seen.force @ self._accel.T + self._accel_zero + self.down,
            rotation=Rotation.from_matrix(self.turned.transpose(0, 2, 1) @ self.by_gyro).as_rotvec(),
            rate=seen.rate @ self.matrix.T + self._zero - np.einsum("qji,j->qi", self.at_rest, self._earth),
            within=self.pinned(running_sum(along, axis=1)) - self.pinned(self.reported_way),
        )
        return rows[:, 0] - self.of_lag() @ self._lag

    def _rows(self, size: int, **parts: np.ndarray) -> np.ndarray:
        """(n, P) of force, rotation, rate and within, zero where a part is not given."""
        rest, turns = 3 * len(self.observed.reported), 3 * len(self.observed.first)
        counts = {"force": rest, "rotation": turns, "rate": rest, "within": int(self.inner.sum())}
        return np.concatenate([parts.get(name, np.zeros((count, size))).reshape(count, size) for name, count in counts.items()])

    # Operators: small errors to rows (n, P).

    def of_attitudes(self, phi: np.ndarray) -> np.ndarray:
        """Rows of rotations phi (Q, 3, P) rad of the body at rest on top of the prediction; nothing within turns."""
        seen = self.observed
        rotation = phi[seen.last] - np.einsum("sji,sjp->sip", self.turned, phi[seen.first])
        return self._rows(phi.shape[2], force=np.cross(phi, self.down[:, :, None], axis=1), rotation=rotation)

    def of_rates(self, turns: np.ndarray, rests: np.ndarray) -> np.ndarray:
        """Rows of a rate that the gyroscope reads on top of the true one: (S, B, 3, P) in blocks, (Q, 3, P) at rest, rad/s."""
        seen = self.observed
        rotation = np.einsum("sbij,sbjp->sip", self.to_end, turns)
        along = np.einsum("sbip,si->sbp", turns, self.axis) * (seen.inside * seen.block_s[:, None])[..., None]
        return self._rows(rests.shape[2], rotation=rotation, rate=rests, within=self.pinned(running_sum(along, axis=1)))

    def of_forces(self, force: np.ndarray) -> np.ndarray:
        """Rows of (Q, 3, P) g that the accelerometer reads on top of the truth."""
        return self._rows(force.shape[2], force=force)

    def of_angles(self, at_rest: np.ndarray) -> np.ndarray:
        """Rows of angles at rest on top of the reported ones, (Q, K, P) rad."""
        return self.of_attitudes(np.einsum("qki,qkp->qip", self.about, at_rest))

    @cached_property
    def about(self) -> np.ndarray:
        """(Q, K, 3) unit: each axis in the body, at rest."""
        return body_axes(self.observed.table, self.angles) @ (self.observed.table.mounting.T @ self.mounting)

    # Columns of the state and of the table's errors.

    def of_state(self) -> np.ndarray:
        """(n, P): rows per unit that the truth lies beyond the state, by ``moved``."""
        seen, rest, axes = self.observed, len(self.observed.reported), self.observed.reported.shape[1]
        basis = np.eye(9).reshape(9, 3, 3)
        gyro = (
            np.einsum("pij,sbj->sbip", basis, seen.rates @ self.matrix.T),
            np.einsum("pij,qj->qip", basis, seen.rate @ self.matrix.T),
        )
        zero = identities(*seen.rates.shape[:2]), identities(rest)
        earth = -self.earth_in_blocks, -self.at_rest.transpose(0, 2, 1)
        upper = np.zeros((rest, 3, 6))
        for number, (i, j) in enumerate(zip(*UPPER, strict=True)):
            upper[:, i, number] = -seen.force[:, j]
        about = self.about.transpose(0, 2, 1).copy()
        about[:, :, 0] = self.at_rest.transpose(0, 2, 1) @ self.observed.table.axes[0].direction
        columns = [
            *(-self.of_rates(*pair) for pair in (gyro, zero)),
            *(self.of_forces(force) for force in (upper, -identities(rest))),
            self.of_attitudes(identities(rest)),
            -self.of_rates(*earth),
            self.of_attitudes(about),
            self.of_angles(np.eye(axes) * self.unmoved[:, None]),
            self.of_latency(),
            self.of_lag(),
        ]
        return np.concatenate(columns, axis=1)

    def of_latency(self) -> np.ndarray:
        """(n, 1) of a word that is 1 s late: rad within turns."""
        rate = np.gradient(self.reported_way, axis=1) / self.observed.block_s[:, None]
        return self._rows(1, within=self.pinned(rate[..., None]))

    def of_lag(self) -> np.ndarray:
        """(n, 2) of a gyroscope whose axes all read the rate of 1 s before, to first order, and of a word that is as late; and of the
        second order of a filter's lag, of 1 s^2: it rounds off the begin and the end of a turn."""
        seen, block_s = self.observed, self.observed.block_s[:, None, None]
        slope = np.gradient(self.turning, axis=1) / block_s
        late = np.where(seen.inside[..., None, None], np.stack([-slope, np.gradient(slope, axis=1) / block_s], axis=-1), 0.0)
        return self.of_rates(late, np.zeros((len(seen.reported), 3, 2))) + self.of_latency() * [1.0, 0.0]

    def of_errors(self, added: Added, size: int) -> np.ndarray:
        """(n, P) of errors that move the body at rest, each of ``size`` numbers: slopes at what is known already."""
        moved = np.array([Comparison(self.observed, self.state, added(self._errors, SMALL * each)).at_rest for each in np.eye(size)])
        turn = Rotation.from_matrix((self.at_rest.transpose(0, 2, 1) @ moved).reshape(-1, 3, 3)).as_rotvec() / SMALL
        return self.of_attitudes(np.moveaxis(turn.reshape(size, -1, 3), 0, -1))

    def of_angle_function(self, axis: int, function: np.ndarray, edges: Callable[[], np.ndarray]) -> np.ndarray:
        """(n, P) of an axis' angle on top of the reported one: (Q, P) rad at rest, (S, B + 1, P) at the edges of its own turns."""
        at_rest = np.zeros((*self.observed.reported.shape, function.shape[1]))
        at_rest[:, axis] = function
        own = (self.observed.alone == axis)[:, None, None]
        within = self.pinned(np.where(own, edges(), 0.0))
        return self.of_angles(at_rest) + self._rows(function.shape[1], within=within)

    def play_at_edges(self, axis: int) -> np.ndarray:
        """(S, B + 1, 1) rad of an axis' angle, of a play of 1 rad: its stage hangs half of it behind, on the side of its last motion."""
        senses = self.observed.senses[:, axis]
        before, after = senses[self.observed.first], senses[self.observed.last]
        # A turn that reverses the sense takes up the play first: as soon as the motor turns, the stage hangs as it will at the end.
        begun = np.abs(self.reported_way) > BEGUN_RAD
        return -np.where(begun, after[:, None], np.where(before != 0, before, after)[:, None])[..., None] / 2

    def of_dropped(self, turn: int) -> np.ndarray:
        """(n, 1) of an angle about the axis of a turn that the gyroscope alone has lost, rad."""
        rotation = np.zeros((len(self.axis), 3, 1))
        rotation[turn, :, 0] = -self.axis[turn] * np.sign(self.reported_way[turn, -1])
        return self._rows(1, rotation=rotation)


def cubic_weights(at: np.ndarray, count: int) -> np.ndarray:
    """(W, N): what each of N values has in those at places (W,) between them: cubic convolution (Keys 1981), whose slope at a value is the
    central difference of its neighbours, as that of ``of_latency`` and ``of_lag``."""
    d = np.abs(at[:, None] - np.arange(count))
    return np.where(d < 1, (1.5 * d - 2.5) * d**2 + 1, np.where(d < 2, ((2.5 - 0.5 * d) * d - 4) * d + 2, 0.0))


def harmonic(angle: np.ndarray, *cycles: int) -> np.ndarray:
    """(…, 2 C): sine and cosine, each of ``cycles`` a turn, of an angle (…) rad."""
    return np.stack([function(each * angle) for each in cycles for function in (np.sin, np.cos)], axis=-1)


def moved(state: np.ndarray, step: np.ndarray) -> np.ndarray:
    """A state (P,) further by a step (P,): the gyroscope's matrix (I + V) E, the mounting M Exp(v), the others by their sum.

    The mounting, the gyroscope's frame and the accelerometer's turn together as one; what separates them is weak against what holds their
    sum, so the columns have to be the exact slopes of this.
    """
    found = state + step
    matrix = np.eye(3) + state[:9].reshape(3, 3)
    change = step[:9].reshape(3, 3)
    turn = (change - change.T) / 2
    turned = Rotation.from_rotvec([turn[2, 1], turn[0, 2], turn[1, 0]]).as_matrix() @ (np.eye(3) + (change + change.T) / 2)
    found[:9] = (turned @ matrix - np.eye(3)).ravel()
    found[MOUNTED] = (Rotation.from_rotvec(state[MOUNTED]) * Rotation.from_rotvec(step[MOUNTED])).as_rotvec()
    return found


def _right_jacobian(vectors: np.ndarray) -> np.ndarray:
    """(…, 3, 3): Exp(v + d) = Exp(v) Exp(J d) for small d, of rotation vectors (…, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    cross = cross_matrix(vectors)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) - first * cross + second * (cross @ cross)


# Candidates: each error that a table may have, and each that its sensor may have beyond the linear calibration, as columns of the rows.
#
# A table's errors are those of ``tinygc.features.tables.machines.description``; a sensor's are the catalogue's
# (``tinygc/effects/entries``), by their own columns.  What the recording cannot show of a candidate (its sigma is larger than the size that
# it may plausibly have) takes no part.

TABLE, SENSOR = "table", "sensor"

INDEX, WOBBLE, RIPPLE, SKEW = "table.index", "table.wobble", "table.rate_ripple", "table.nonorthogonal"
TILT, BACKLASH, LOST, LATENCY, DROPPED = "table.tilt", "table.backlash", "table.lost_steps", "table.latency", "timing.dropped_samples"
#: sizes that a table's errors may have, one sigma, SI, and the JSON names of their quantities, all in degrees
FORMS = {
    INDEX: (0.2 * DEG, "once_deg", "twice_deg"),
    WOBBLE: (0.1 * DEG, "wobble_deg"),
    RIPPLE: (0.1 * DEG, "ripple_deg"),
    SKEW: (0.3 * DEG, "skew_deg"),
    TILT: (0.5 * DEG, "tilt_deg"),
    BACKLASH: (0.3 * DEG, "backlash_deg"),
    LOST: (2 * DEG, "lost_deg"),
    DROPPED: (2 * DEG, "lost_deg"),
}
#: a play that is negative cannot be
ONE_SIDED = (BACKLASH,)
#: cycles a turn from which an angle's error is a ripple; up to which it is looked for; of those that a turn's blocks resolve
FIRST_RIPPLE, LAST_RIPPLE, RESOLVED = 3, 100, 0.8
#: degC: temperatures that range over less show nothing
LEAST_WARMED_C = 1.0


def whose(id: str) -> str:
    """Whether an error of this id is the table's or the sensor's."""
    return TABLE if id.startswith("table.") else SENSOR


Part = tuple[str, float, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One form of an error: id; where (an axis, a turn); make: its columns; plausible (P,) SI; parts: JSON name,
    unit's size in SI and indices of each quantity; shape: numbers that are no parameters; tried: how many forms of this id are weighed;
    added: other errors of the table with this one of theta (P,), however large, None where only the columns are known; one_sided: none is
    negative."""

    id: str
    where: str
    make: Callable[[], np.ndarray]
    plausible: np.ndarray
    parts: tuple[Part, ...]
    shape: dict[str, float | int | str]
    tried: int = 1
    added: Added | None = None
    one_sided: bool = False

    @property
    def key(self) -> tuple:
        """What separates it from all others."""
        return self.id, self.where, *self.shape.values()

    @cached_property
    def columns(self) -> np.ndarray:
        """(n, P) per SI unit."""
        return self.make()

    def values(self, theta: np.ndarray) -> dict[str, float | list[float]]:
        """JSON quantities of theta (P,), or of its sigmas."""
        found: dict[str, float | list[float]] = {}
        for name, si, at in self.parts:
            some = (theta[list(at)] / si).tolist()
            found[name] = some[0] if len(some) == 1 else some
        return found


def candidates_of(comparison: Comparison) -> list[Candidate]:
    """All of one comparison."""
    found = [*_of_table(comparison), *_lost_in_turns(comparison), *_of_sensor(comparison)]
    count = {id: sum(each.id == id for each in found) for id in {each.id for each in found}}
    return [replace(each, tried=count[each.id]) for each in found]


def _of_table(comparison: Comparison) -> Iterator[Candidate]:
    axes, seen = comparison.observed.table.axes, comparison.observed
    yield _at_rest(comparison, TILT, "base", _tilted, 2)
    for number, axis in enumerate(axes):
        at, of_angle = f"axis {axis.name}", partial(_of_angle, comparison, number)
        angles = seen.reported[:, number], seen.reported_edges[:, :, number]
        yield of_angle(INDEX, at, harmonic(angles[0], 1, 2), partial(harmonic, angles[1], 1, 2))
        yield _at_rest(comparison, WOBBLE, at, partial(_wobbling, number), 4, axis=axis.name)
        yield of_angle(BACKLASH, at, -seen.senses[:, number, None] / 2, partial(comparison.play_at_edges, number))
        away = np.cross(axes[number - 1].direction, axis.direction)
        if number and np.linalg.norm(away) > 0.1:
            skewed = partial(_skewed, number, unit_vectors(np.cross(away, axis.direction)))
            yield _at_rest(comparison, SKEW, f"axes {axes[number - 1].name}, {axis.name}", skewed, 1, axis=axis.name)
        for cycles in range(FIRST_RIPPLE, _most_cycles(seen, number) + 1):
            yield of_angle(RIPPLE, at, harmonic(angles[0], cycles), partial(harmonic, angles[1], cycles), cycles=cycles)


def _candidate(id: str, where: str, make: Callable[[], np.ndarray], size: int, added: Added | None, shape: dict) -> Candidate:
    plausible, *names = FORMS[id]
    each = size // len(names)
    parts = tuple((str(name), DEG, tuple(range(number * each, number * each + each))) for number, name in enumerate(names))
    return Candidate(id, where, make, np.full(size, plausible), parts, shape, added=added, one_sided=id in ONE_SIDED)


def _at_rest(comparison: Comparison, id: str, where: str, added: Added, size: int, **shape: float | str) -> Candidate:
    return _candidate(id, where, partial(comparison.of_errors, added, size), size, added, shape)


def _of_angle(
    comparison: Comparison, axis: int, id: str, where: str, function: np.ndarray, edges: Callable[[], np.ndarray], **shape: float
) -> Candidate:
    """An error of an axis' angle, by ``of_angle_function``: rad per rad at rest, and at the edges."""
    make = partial(comparison.of_angle_function, axis, function, edges)
    name = comparison.observed.table.axes[axis].name
    return _candidate(id, where, make, function.shape[1], partial(_with_angles, axis, function), {"axis": name, **shape})


def _tilted(errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return replace(errors, tilt=errors.tilt + np.append(theta, 0.0))


def _of_axis(errors: TableErrors, axis: int, **changed: np.ndarray) -> TableErrors:
    return replace(errors, axes=(*errors.axes[:axis], replace(errors.axes[axis], **changed), *errors.axes[axis + 1 :]))


def _with_angles(axis: int, function: np.ndarray, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    """With angles at rest on top of the reported ones, function (Q, P) rad per rad."""
    return _of_axis(errors, axis, lost=errors.axes[axis].lost + function @ theta)


def _wobbling(axis: int, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return _of_axis(errors, axis, wobble=errors.axes[axis].wobble + theta)


def _skewed(axis: int, away: np.ndarray, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return _of_axis(errors, axis, skew=errors.axes[axis].skew + np.tan(theta[0]) * away)


def _most_cycles(observed: Observed, axis: int) -> int:
    """The fastest ripple, cycles a turn, that the blocks of most turns of an axis resolve; 0 where it never turns alone."""
    own = observed.alone == axis
    if not own.any():
        return 0
    steps = np.abs(np.diff(observed.reported_edges[own, :, axis], axis=1))
    return int(min(LAST_RIPPLE, RESOLVED * np.pi / np.median(steps.max(axis=1))))


def _lost_in_turns(comparison: Comparison) -> Iterator[Candidate]:
    """A motor that falls behind in a turn, for good, at any place in the turn; a gyroscope that misses a part of one."""
    seen = comparison.observed
    no_edges = partial(np.zeros, (*seen.reported_edges.shape[:2], 1))
    for turn, alone in enumerate(seen.alone.tolist()):
        moved = np.flatnonzero(np.abs(seen.turned[turn]) > 0.5 * DEG) if alone < 0 else [alone]
        for axis in map(int, moved):
            lost = np.where(np.arange(len(seen.reported)) >= seen.last[turn], -np.sign(seen.turned[turn, axis]), 0.0)[:, None]
            found = _of_angle(comparison, axis, LOST, f"turn {turn}", lost, no_edges, turn=turn)
            yield found
            if alone >= 0:
                yield _candidate(DROPPED, found.where, partial(comparison.of_dropped, turn), 1, None, found.shape)


def _of_sensor(comparison: Comparison) -> Iterator[Candidate]:
    rests, turns = _movements(comparison)
    warmed = np.ptp(rests.temp_c) if np.isfinite(rests.temp_c).all() else 0.0
    for effect in catalogue().values():
        if effect.kind not in ("rate", "force") or effect.scan is not None or "vibration" in effect.inputs:
            continue
        if "temperature" in effect.inputs and warmed < LEAST_WARMED_C:
            continue
        make = partial(_columns, comparison, effect, rests, turns)
        of = effect.parameter
        parts = ((of.name, of.si, tuple(range(of.size))),)
        yield Candidate(effect.id, "", make, np.full(of.size, of.plausible), parts, {})


def _columns(comparison: Comparison, effect: Effect, rests: Movement, turns: list[Movement]) -> np.ndarray:
    if effect.kind == "force":
        return comparison.of_forces(effect.bent(rests) / G)
    seen = comparison.observed
    in_turns = np.zeros((*seen.rates.shape, effect.parameter.size))
    for number, turn in enumerate(turns):
        in_turns[number, : len(turn.t_s)] = effect.columns(effect.shown(turn))
    # A rest has no neighbours to look at.
    at_rest = np.zeros((len(seen.reported), 3, effect.parameter.size)) if effect.reach else effect.columns(effect.shown(rests))
    return comparison.of_rates(in_turns, at_rest)


def _movements(comparison: Comparison) -> tuple[Movement, list[Movement]]:
    """The rests, and the blocks of each turn, as movements that the catalogue reads."""
    seen = comparison.observed
    first_c, duration_s = float(seen.temp_c[0]), float(seen.rest_s[-1] + seen.rest_span_s[-1])

    def movement(t_s: np.ndarray, dt_s: float, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray) -> Movement:
        return Movement(t_s, dt_s, rate, force, temp_c, np.zeros(len(t_s)), duration_s, seen.fs_rps, first_c)

    rests = movement(seen.rest_s, float(np.median(seen.rest_span_s)), np.zeros_like(seen.rate), seen.force, seen.temp_c)
    turns = []
    for number, count in enumerate(seen.blocks.tolist()):
        block_s = float(seen.block_s[number])
        t_s = seen.turn_s[number] + (np.arange(count) - (count - 1) / 2) * block_s
        force = -comparison.earth_in_blocks[number, :count, :, 2]
        temp_c = np.interp(t_s, seen.rest_s, seen.temp_c)
        turns.append(movement(t_s, block_s, comparison.turning[number, :count], force, temp_c))
    return rests, turns
