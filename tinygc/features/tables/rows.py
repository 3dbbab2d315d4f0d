"""What is compared: the sensor against the table, in four kinds of rows, and how every small error enters each.

    force     of each rest:  measured force, corrected, less -R_tb^T e_z, in g                            (Q, 3)
    rotation  of each turn:  rotation vector of (R_i^T R_j)^T Q_gyro, rad                                  (S, 3)
    rate      of each rest:  corrected rate less the Earth's, rad/s                                        (Q, 3)
    within    of each turn of one axis alone: at each edge of a block, the gyroscope's angle about the axis less the said one, rad, both
              with their ends taken together, so that scale and offset say nothing here                     (S, B - 1)

All rows are recording less prediction.  Two operators take any small error to the rows:

    ``of_attitudes``: rotations phi (Q, 3) of the body at rest that the prediction lacks, R_true = R Exp(phi): force phi x R^T e_z,
    rotation phi_j - (R_i^T R_j)^T phi_i;     ``of_rates``: a rate that the gyroscope reads beside the true one, in blocks and rests.

The sensor's calibration, the mounting, the zero of each axis, the Earth's rate and the latency of the machine's word are always free, with
the priors below: the state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.spatial.transform import Rotation

from session.base.numeric import UPPER, running_sum
from session.base.rotation import cross_matrix, identities
from session.base.units import DEG, EARTH_RATE_RPS, G
from tinygc.effects import Effect, Movement
from tinygc.effects.catalogue import catalogue
from tinygc.features.tables.machines.description import (
    LATENCY_SIGMA_S,
    TableErrors,
    body_axes,
    normals,
    rotations,
    stage_attitudes,
    true_attitudes,
)
from tinygc.features.tables.observed import Observed

# The state: what is always free, with the sigma of its prior.

#: sigma of each element of an uncalibrated gyroscope's matrix; of its zero, rad/s; of shear and scale of an accelerometer, per its zero
MATRIX_SIGMA, ZERO_RATE_SIGMA, PER_ZERO = 0.05, 5 * DEG, 1.0
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
#: names of the state's parts, and their sizes for K axes
PARTS = ("gyroscope's matrix", "gyroscope's zero", "accelerometer's matrix", "accelerometer's zero", "mounting", "Earth's rate")
SIZES = (9, 3, 6, 3, 3, 3)


def part_names(axes: int) -> list[str]:
    """Name of the part to which each number of the state belongs (P,)."""
    own = [name for name, size in zip(PARTS, SIZES, strict=True) for _ in range(size)]
    own += ["zero of an axis"] * axes + ["play before the first motion"] * axes
    return [*own, "latency of the word", "lag of sensor and word", "second order of the lag"]


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals or columns, stacked: force, rotation, rate, within (n, ...)."""

    force: np.ndarray
    rotation: np.ndarray
    rate: np.ndarray
    within: np.ndarray

    def stacked(self) -> np.ndarray:
        """(3 Q + 3 S + 3 Q + W, …)."""
        tail = self.force.shape[2:]
        return np.concatenate([part.reshape(-1, *tail) for part in (self.force, self.rotation, self.rate)] + [self.within])


class Comparison:
    """An observed session at one state (P,), with the errors of the table that are known so far: residuals, and the operators of further
    small errors there.

    errors: tilt, skew and wobble, and in ``lost`` of an axis the angles (Q,) rad at rest beside the said ones; they enter exactly.
    """

    def __init__(self, observed: Observed, state: np.ndarray | None = None, errors: TableErrors | None = None):
        self.observed = observed
        self.state = start_of(observed) if state is None else state
        self._errors = TableErrors.none(observed.table) if errors is None else errors
        parts = np.split(self.state, np.cumsum([*SIZES, *[observed.said.shape[1]] * 2]))
        self.matrix, self._zero = np.eye(3) + parts[0].reshape(3, 3), parts[1]
        self._accel = np.eye(3)
        self._accel[UPPER] += parts[2]
        self._accel_zero, self._mounting, self._earth, self._axis_zero, self._before, (self.latency_s, *self._lag) = parts[3:]

    @cached_property
    def angles(self) -> np.ndarray:
        """(Q, K) rad: the word at rest, with the zeros of the state and what is known to lie beside it."""
        beside = np.stack([np.broadcast_to(each.lost, len(self.observed.said)) for each in self._errors.axes], axis=1)
        return self.observed.said + self._axis_zero + self.unmoved * self._before + beside

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
        """R_tb (Q, 3, 3).  The zero of the outermost axis turns the base with it, so that a tilt is in the frame of the said angles."""
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
        middle = (seen.said_edges[:, 1:] + seen.said_edges[:, :-1]) / 2
        flat = self.attitudes(middle.reshape(-1, middle.shape[-1]))
        return flat.reshape(*middle.shape[:2], 3, 3).transpose(0, 1, 3, 2)

    @cached_property
    def rates(self) -> np.ndarray:
        """(S, B, 3) rad/s: true rates against the table, by the state; zero beyond a turn's last block."""
        found = self.observed.rates @ self.matrix.T + self._zero - self.earth_in_blocks @ self._earth
        return np.where(self.observed.inside[..., None], found, 0.0)

    @cached_property
    def turning(self) -> np.ndarray:
        """``rates``, zero where the machine says that nothing moves: what a column is made of must not hold the noise that it is held
        against."""
        moves = np.abs(np.diff(self.observed.said_edges, axis=1)).max(axis=2) > STANDS_RAD
        return np.where(moves[..., None], self.rates, 0.0)

    @cached_property
    def _steps(self) -> np.ndarray:
        """(S, B, 3, 3)."""
        vectors = self.rates * self.observed.block_s[:, None, None]
        return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape[:2], 3, 3)

    @cached_property
    def to_end(self) -> np.ndarray:
        """(S, B, 3, 3) s: rotation of the end, in its own axes, per rate in a block."""
        within = _right_jacobian(self.rates * self.observed.block_s[:, None, None])
        found, after = np.empty_like(self._steps), identities(len(self._steps))
        for block in reversed(range(self._steps.shape[1])):
            found[:, block] = after.transpose(0, 2, 1) @ within[:, block]
            after = self._steps[:, block] @ after
        return found * (self.observed.inside * self.observed.block_s[:, None])[..., None, None]

    @cached_property
    def by_gyro(self) -> np.ndarray:
        """(S, 3, 3): begin to end, R_i^T R_j by the gyroscope."""
        whole = identities(len(self._steps))
        for block in range(self._steps.shape[1]):
            whole = whole @ self._steps[:, block]
        return whole

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
    def said_way(self) -> np.ndarray:
        """(S, B + 1) rad: what the machine says that the axis has turned since the begin, at each edge, ``latency_s`` later."""
        seen = self.observed
        way = (seen.said_edges - seen.said_edges[:, :1])[np.arange(len(seen.first)), :, seen.alone]
        edges = np.arange(way.shape[1])
        shifts = (self.latency_s / seen.block_s)[:, None] + edges
        return np.stack([Akima1DInterpolator(edges, each)(at.clip(0, edges[-1])) for each, at in zip(way, shifts, strict=True)])

    def pinned(self, way: np.ndarray) -> np.ndarray:
        """Rows ``within`` (W, …) of an angle (S, B + 1, …) at the edges: without its begin, and with its end shared as the said angle has
        it."""
        share = self.share
        tail = (1,) * (way.ndim - 2)
        way = way - way[:, :1]
        return (way - share.reshape(*share.shape, *tail) * way[:, -1:])[:, 1:-1][self.inner]

    @cached_property
    def share(self) -> np.ndarray:
        """(S, B + 1): of the said angle of a turn, at each edge."""
        end = self.said_way[:, -1:]
        return np.where(np.abs(end) > 0, self.said_way / np.where(np.abs(end) > 0, end, 1.0), 0.0)

    def residuals(self) -> Rows:
        """Recording less prediction."""
        seen = self.observed
        force = seen.force @ self._accel.T + self._accel_zero + self.down
        rotation = Rotation.from_matrix(self.turned.transpose(0, 2, 1) @ self.by_gyro).as_rotvec()
        rate = seen.rate @ self.matrix.T + self._zero - np.einsum("qji,j->qi", self.at_rest, self._earth)
        along = np.einsum("sbi,si->sb", self.rates, self.axis) * seen.block_s[:, None]
        way = running_sum(along, axis=1)
        within = self.pinned(way) - self.pinned(self.said_way)
        for size, late in zip(self._lag, (self.of_lag(), self.of_lag_squared()), strict=True):
            rotation, within = rotation - size * late.rotation[..., 0], within - size * late.within[:, 0]
        return Rows(force, rotation, rate, within)

    # Operators: small errors to rows.

    def of_attitudes(self, phi: np.ndarray) -> Rows:
        """Rows of rotations phi (Q, 3, P) rad of the body at rest beside the prediction; nothing within turns."""
        seen = self.observed
        force = np.cross(phi, self.down[:, :, None], axis=1)
        rotation = phi[seen.last] - np.einsum("sji,sjp->sip", self.turned, phi[seen.first])
        return Rows(force, rotation, np.zeros_like(force), np.zeros((int(self.inner.sum()), phi.shape[2])))

    def of_rates(self, turns: np.ndarray, rests: np.ndarray) -> Rows:
        """Rows of a rate that the gyroscope reads beside the true one: (S, B, 3, P) in blocks, (Q, 3, P) at rest, rad/s."""
        seen = self.observed
        rotation = np.einsum("sbij,sbjp->sip", self.to_end, turns)
        along = np.einsum("sbip,si->sbp", turns, self.axis) * (seen.inside * seen.block_s[:, None])[..., None]
        way = np.concatenate([np.zeros_like(along[:, :1]), np.cumsum(along, axis=1)], axis=1)
        return Rows(np.zeros_like(rests), rotation, rests, self.pinned(way))

    def of_angles(self, at_rest: np.ndarray, at_edges: np.ndarray | None = None) -> Rows:
        """Rows of angles beside the said ones: (Q, K, P) rad at rest, and of the turning axis (S, B + 1, P) at the edges."""
        rows = self.of_attitudes(np.einsum("qki,qkp->qip", self.about, at_rest))
        return rows if at_edges is None else Rows(rows.force, rows.rotation, rows.rate, self.pinned(at_edges))

    @cached_property
    def about(self) -> np.ndarray:
        """(Q, K, 3) unit: each axis in the body, at rest."""
        return body_axes(self.observed.table, self.angles) @ (self.observed.table.mounting.T @ self.mounting)

    def outside(self, axis: int) -> np.ndarray:
        """(Q, 3, 3): the frame that carries an axis, to the table."""
        directions = [each.direction for each in self.observed.table.axes[:axis]]
        return stage_attitudes(directions, self.angles[:, :axis])

    # Columns of the state and of the table's errors.

    def of_state(self) -> np.ndarray:
        """(n, P): rows per unit that the truth lies beyond the state, by ``moved``."""
        seen, rest, axes = self.observed, len(self.observed.said), self.observed.said.shape[1]
        basis = np.eye(9).reshape(9, 3, 3)
        gyro = (
            np.einsum("pij,sbj->sbip", basis, seen.rates @ self.matrix.T),
            np.einsum("pij,qj->qip", basis, seen.rate @ self.matrix.T),
        )
        zero = identities(*seen.rates.shape[:2]), identities(rest)
        earth = -self.earth_in_blocks, -self.at_rest.transpose(0, 2, 1)
        columns = [-self.of_rates(*pair).stacked() for pair in (gyro, zero)]
        upper = np.zeros((rest, 3, 6))
        for number, (i, j) in enumerate(zip(*UPPER, strict=True)):
            upper[:, i, number] = -seen.force[:, j]
        for force in (upper, np.broadcast_to(-np.eye(3), (rest, 3, 3))):
            columns.append(self.of_forces(force))
        columns.append(self.of_attitudes(identities(rest)).stacked())
        columns.append(-self.of_rates(*earth).stacked())
        each = np.broadcast_to(np.eye(axes), (rest, axes, axes))
        about = self.about.transpose(0, 2, 1).copy()
        about[:, :, 0] = self.at_rest.transpose(0, 2, 1) @ self.observed.table.axes[0].direction
        columns += [self.of_attitudes(about).stacked(), self.of_angles(each * self.unmoved[:, None]).stacked()]
        columns += [self.of_latency(), self.of_lag().stacked(), self.of_lag_squared().stacked()]
        return np.concatenate(columns, axis=1)

    def of_lag(self) -> Rows:
        """Rows of a gyroscope whose axes all read the rate of 1 s before, to first order, and of a word that is as late."""
        late = np.stack([-np.gradient(each, block, axis=0) for each, block in zip(self.turning, self.observed.block_s, strict=True)])
        rows = self.of_rates(np.where(self.observed.inside[..., None], late, 0.0)[..., None], np.zeros((len(self.observed.said), 3, 1)))
        return replace(rows, within=rows.within + self.of_latency()[-len(rows.within) :] if len(rows.within) else rows.within)

    def of_lag_squared(self) -> Rows:
        """Rows of the second order of a filter's lag, of 1 s^2, its axes alike: it rounds off the begin and the end of a turn."""
        seen = self.observed
        turns = zip(self.turning, seen.block_s, strict=True)
        bent = [np.gradient(np.gradient(each, block, axis=0), block, axis=0) for each, block in turns]
        return self.of_rates(np.where(seen.inside[..., None], np.stack(bent), 0.0)[..., None], np.zeros((len(seen.said), 3, 1)))

    def of_forces(self, force: np.ndarray) -> np.ndarray:
        """(n, P) of (Q, 3, P) g that the accelerometer reads beside the truth."""
        nothing = np.zeros((len(self.observed.first), 3, force.shape[2]))
        return Rows(force, nothing, np.zeros_like(force), np.zeros((int(self.inner.sum()), force.shape[2]))).stacked()

    def of_latency(self) -> np.ndarray:
        """(n, 1) of a word that is 1 s late: rad within turns."""
        seen = self.observed
        rate = np.gradient(self.said_way, axis=1) / seen.block_s[:, None]
        rest = len(seen.said), seen.said.shape[1], 1
        return self.of_angles(np.zeros(rest), rate[..., None]).stacked()

    def of_tilt(self) -> np.ndarray:
        """(n, 2) of the base's tilt about the table's x and y, rad."""
        return self.of_attitudes(self.at_rest.transpose(0, 2, 1)[:, :, :2]).stacked()

    def of_angle_function(self, axis: int, function: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """(n, P) of an axis' angle beside the said one: (Q, P) rad at rest, (S, B + 1, P) at the edges of its own turns."""
        at_rest = np.zeros((*self.observed.said.shape, function.shape[1]))
        at_rest[:, axis] = function
        own = (self.observed.alone == axis)[:, None, None]
        return self.of_angles(at_rest, np.where(own, edges, 0.0)).stacked()

    def of_harmonic(self, axis: int, *cycles: int) -> np.ndarray:
        """(n, 2 C) of sine and cosine, each of ``cycles`` a turn, of an axis' angle."""
        at_rest, edges = self.observed.said[:, axis], self.observed.said_edges[:, :, axis]
        return self.of_angle_function(axis, harmonic(at_rest, *cycles), harmonic(edges, *cycles))

    def play_at_rest(self, axis: int) -> np.ndarray:
        """(Q, 1) rad of an axis' angle, of a play of 1 rad."""
        return -self.observed.senses[:, axis, None] / 2

    def of_backlash(self, axis: int) -> np.ndarray:
        """(n, 1) of the play of an axis, rad: its stage hangs half of it behind, on the side of its last motion."""
        seen = self.observed
        senses = seen.senses
        before, after = senses[seen.first, axis], senses[seen.last, axis]
        # A turn that reverses the sense takes up the play first: as soon as the motor turns, the stage hangs as it will at the end.
        begun = np.abs(self.said_way) > BEGUN_RAD
        edges = -np.where(begun, after[:, None], np.where(before != 0, before, after)[:, None]) / 2
        return self.of_angle_function(axis, self.play_at_rest(axis), edges[..., None])

    def lost_at_rest(self, axis: int, turn: int) -> np.ndarray:
        """(Q, 1) rad of an axis' angle, of a motor that falls behind by 1 rad in a turn, for good."""
        seen = self.observed
        later = np.arange(len(seen.said)) >= seen.last[turn]
        return np.where(later, -np.sign(seen.turned[turn, axis]), 0.0)[:, None]

    def of_lost(self, axis: int, turn: int) -> np.ndarray:
        """(n, 1) of an angle by which a motor falls behind in a turn, for good, rad; where in the turn is not asked."""
        return self.of_angle_function(axis, self.lost_at_rest(axis, turn), np.zeros((*self.observed.said_edges.shape[:2], 1)))

    def of_dropped(self, turn: int) -> np.ndarray:
        """(n, 1) of an angle about the axis of a turn that the gyroscope alone has lost, rad."""
        rows = self.of_rates(np.zeros((*self.observed.rates.shape, 1)), np.zeros((len(self.observed.said), 3, 1)))
        rows.rotation[turn, :, 0] = -self.axis[turn] * np.sign(self.said_way[turn, -1])
        return rows.stacked()

    def of_skew(self, axis: int) -> np.ndarray:
        """(n, 1): the angle between an axis and the one that carries it is larger by 1 rad than declared."""
        carrier, own = self.observed.table.axes[axis - 1].direction, self.observed.table.axes[axis].direction
        away = np.cross(carrier, own)
        away = away / np.linalg.norm(away)
        turn = rotations(own, self.angles[:, axis])
        outside = self.outside(axis)
        # Exp(d) Rot(a) Exp(-d), with d about the normal of both axes.
        moved = outside @ (np.eye(3) - turn) @ away
        return self.of_attitudes(np.einsum("qji,qj->qi", self.at_rest, moved)[..., None]).stacked()

    def of_wobble(self, axis: int) -> np.ndarray:
        """(n, 4) of an axis' wobble, as ``AxisErrors.wobble``."""
        alpha, (e1, e2) = self.angles[:, axis], normals(self.observed.table.axes[axis].direction)
        cos, sin = np.cos(alpha), np.sin(alpha)
        vectors = np.stack([np.outer(cos, e1), np.outer(sin, e2), np.outer(cos, e2), np.outer(sin, e1)], axis=-1)
        phi = np.einsum("qji,qjk,qkp->qip", self.at_rest, self.outside(axis), vectors)
        return self.of_attitudes(phi).stacked()


def harmonic(angle: np.ndarray, *cycles: int) -> np.ndarray:
    """(…, 2 C): sine and cosine, each of ``cycles`` a turn, of an angle (…) rad."""
    return np.stack([function(each * angle) for each in cycles for function in (np.sin, np.cos)], axis=-1)


def moved(state: np.ndarray, step: np.ndarray) -> np.ndarray:
    """A state (P,) further by a step (P,): the gyroscope's matrix (I + V) E, the mounting M Exp(v), the others by their sum.

    The mounting, the gyroscope's frame and the accelerometer's turn together as one; what tells them apart is weak against what holds their
    sum, so the columns have to be the exact slopes of this.
    """
    found = state + step
    matrix = np.eye(3) + state[:9].reshape(3, 3)
    change = step[:9].reshape(3, 3)
    turn = (change - change.T) / 2
    turned = Rotation.from_rotvec([turn[2, 1], turn[0, 2], turn[1, 0]]).as_matrix() @ (np.eye(3) + (change + change.T) / 2)
    found[:9] = (turned @ matrix - np.eye(3)).ravel()
    at = slice(sum(SIZES[:4]), sum(SIZES[:5]))
    found[at] = (Rotation.from_rotvec(state[at]) * Rotation.from_rotvec(step[at])).as_rotvec()
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


def start_of(observed: Observed) -> np.ndarray:
    """The state before any fit: what is declared."""
    state = np.zeros(len(part_names(observed.said.shape[1])))
    state[:] = prior_of(observed)[0]
    return state


def prior_of(observed: Observed) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sigma (P,) of the state's priors."""
    axes, accel = observed.said.shape[1], observed.accel_sigma_g
    latitude = observed.latitude_rad
    horizontal = EARTH_RATE_RPS if latitude is None else EARTH_RATE_RPS * np.cos(latitude)
    vertical = EARTH_RATE_RPS if latitude is None else VERTICAL_SHARE * EARTH_RATE_RPS
    sizes = (MATRIX_SIGMA, ZERO_RATE_SIGMA, PER_ZERO * accel, accel, MOUNTING_SIGMA)
    sigma = np.concatenate(
        [
            *(np.full(size, value) for size, value in zip(SIZES, sizes, strict=False)),
            [horizontal, horizontal, vertical],
            np.full(axes, ZERO_SIGMA),
            np.full(axes, BEFORE_SIGMA),
            [LATENCY_SIGMA_S, LAG_SIGMA_S, LAG_SIGMA_S**2],
        ]
    )
    mean = np.zeros_like(sigma)
    if latitude is not None:
        mean[sum(SIZES) - 1] = -EARTH_RATE_RPS * np.sin(latitude)
    return mean, sigma


# Candidates: each error that a table may have, and each that its sensor may have beyond the linear calibration, as columns of the rows.
#
# A table's errors are those of ``tinygc.features.tables.machines.description``; a sensor's are the catalogue's
# (``tinygc/effects/entries``), by their own columns.  What the recording cannot show of a candidate (its sigma is larger than the size that
# it may plausibly have) takes no part.

TABLE, SENSOR = "table", "sensor"

INDEX, WOBBLE, RIPPLE, SKEW = "table.index", "table.wobble", "table.rate_ripple", "table.nonorthogonal"
TILT, BACKLASH, LOST, LATENCY, DROPPED = "table.tilt", "table.backlash", "table.lost_steps", "table.latency", "timing.dropped_samples"
#: sizes that a table's errors may have, one sigma, SI
PLAUSIBLE = {
    INDEX: 0.2 * DEG,
    WOBBLE: 0.1 * DEG,
    RIPPLE: 0.1 * DEG,
    SKEW: 0.3 * DEG,
    TILT: 0.5 * DEG,
    BACKLASH: 0.3 * DEG,
    LOST: 2 * DEG,
    DROPPED: 2 * DEG,
}
#: a play that is negative cannot be
ONE_SIDED = (BACKLASH,)
#: cycles a turn from which an angle's error is a ripple; up to which it is looked for; of those that a turn's blocks resolve
FIRST_RIPPLE, LAST_RIPPLE, RESOLVED = 3, 100, 0.8
#: degC: temperatures that range over less say nothing
LEAST_WARMED_C = 1.0

Added = Callable[[TableErrors, np.ndarray], TableErrors]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One form of an error: id; whose it is; where (an axis, a turn); make: its columns; plausible (P,) SI; parts: JSON name,
    unit's size in SI and indices of each quantity; shape: numbers that are no parameters; tried: how many forms of this id are weighed;
    added: other errors of the table with this one of theta (P,), however large, None where only the columns are known; one_sided: none is
    negative."""

    id: str
    whose: str
    where: str
    make: Callable[[], np.ndarray]
    plausible: np.ndarray
    parts: tuple[tuple[str, float, tuple[int, ...]], ...]
    shape: dict[str, float | int | str]
    tried: int = 1
    added: Added | None = None
    one_sided: bool = False

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
    axes, said = comparison.observed.table.axes, comparison.observed.said

    def candidate(
        id: str, where: str, make: Callable[[], np.ndarray], added: Added, *parts: tuple[str, float, tuple[int, ...]], **shape: float | str
    ) -> Candidate:
        size = sum(len(at) for _, _, at in parts)
        return Candidate(id, TABLE, where, make, np.full(size, PLAUSIBLE[id]), parts, dict(shape), added=added, one_sided=id in ONE_SIDED)

    yield candidate(TILT, "base", comparison.of_tilt, _tilted, ("tilt_deg", DEG, (0, 1)))
    for number, axis in enumerate(axes):
        at, angle = f"axis {axis.name}", said[:, number]
        quantities = ("once_deg", DEG, (0, 1)), ("twice_deg", DEG, (2, 3))
        index = partial(comparison.of_harmonic, number, 1, 2), partial(_beside, number, harmonic(angle, 1, 2))
        yield candidate(INDEX, at, *index, *quantities, axis=axis.name)
        wobble = partial(comparison.of_wobble, number), partial(_wobbling, number)
        yield candidate(WOBBLE, at, *wobble, ("wobble_deg", DEG, (0, 1, 2, 3)), axis=axis.name)
        play = partial(comparison.of_backlash, number), partial(_beside, number, comparison.play_at_rest(number))
        yield candidate(BACKLASH, at, *play, ("backlash_deg", DEG, (0,)), axis=axis.name)
        if number and np.linalg.norm(np.cross(axes[number - 1].direction, axis.direction)) > 0.1:
            between = f"axes {axes[number - 1].name}, {axis.name}"
            away = np.cross(np.cross(axes[number - 1].direction, axis.direction), axis.direction)
            skew = partial(comparison.of_skew, number), partial(_skewed, number, away / np.linalg.norm(away))
            yield candidate(SKEW, between, *skew, ("skew_deg", DEG, (0,)), axis=axis.name)
        for cycles in range(FIRST_RIPPLE, _most_cycles(comparison.observed, number) + 1):
            ripple = partial(comparison.of_harmonic, number, cycles), partial(_beside, number, harmonic(angle, cycles))
            yield candidate(RIPPLE, at, *ripple, ("ripple_deg", DEG, (0, 1)), axis=axis.name, cycles=cycles)


def _tilted(errors: TableErrors, theta: np.ndarray) -> TableErrors:
    return replace(errors, tilt=errors.tilt + np.append(theta, 0.0))


def _of_axis(errors: TableErrors, axis: int, **changed: np.ndarray) -> TableErrors:
    return replace(errors, axes=(*errors.axes[:axis], replace(errors.axes[axis], **changed), *errors.axes[axis + 1 :]))


def _beside(axis: int, function: np.ndarray, errors: TableErrors, theta: np.ndarray) -> TableErrors:
    """With angles at rest beside the said ones, function (Q, P) rad per rad."""
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
    steps = np.abs(np.diff(observed.said_edges[own, :, axis], axis=1))
    return int(min(LAST_RIPPLE, RESOLVED * np.pi / np.median(steps.max(axis=1))))


def _lost_in_turns(comparison: Comparison) -> Iterator[Candidate]:
    seen = comparison.observed
    plausible = np.array([PLAUSIBLE[LOST]])
    for turn, alone in enumerate(seen.alone.tolist()):
        moved = np.flatnonzero(np.abs(seen.turned[turn]) > 0.5 * DEG) if alone < 0 else [alone]
        for axis in map(int, moved):
            shape: dict[str, float | int | str] = {"axis": seen.table.axes[axis].name, "turn": turn}
            parts = (("lost_deg", DEG, (0,)),)
            added = partial(_beside, axis, comparison.lost_at_rest(axis, turn))
            yield Candidate(LOST, TABLE, f"turn {turn}", partial(comparison.of_lost, axis, turn), plausible, parts, shape, added=added)
            if alone >= 0:
                yield Candidate(DROPPED, SENSOR, f"turn {turn}", partial(comparison.of_dropped, turn), plausible, parts, shape)


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
        yield Candidate(effect.id, SENSOR, "", make, np.full(of.size, of.plausible), parts, {})


def _columns(comparison: Comparison, effect: Effect, rests: Movement, turns: list[Movement]) -> np.ndarray:
    if effect.kind == "force":
        return comparison.of_forces(effect.bent(rests) / G)
    seen = comparison.observed
    in_turns = np.zeros((*seen.rates.shape, effect.parameter.size))
    for number, turn in enumerate(turns):
        in_turns[number, : len(turn.t_s)] = effect.columns(effect.shown(turn))
    # A rest has no neighbours to look at.
    at_rest = np.zeros((len(seen.said), 3, effect.parameter.size)) if effect.reach else effect.columns(effect.shown(rests))
    return comparison.of_rates(in_turns, at_rest).stacked()


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
