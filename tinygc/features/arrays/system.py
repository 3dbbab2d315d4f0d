"""Linear system of an array: closure and force rows of every unit, variance components, priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.units import MG, G
from session.detect.accelerometer import IDENTITY, PARAMETERS, SPREAD_MPS2, after, corrected, force_columns, units
from session.detect.accelerometer import PARAMETERS as OF_ACCELEROMETER
from session.detect.stills import references
from session.log.config import Accelerometer
from tinygc.closure import residual
from tinygc.closure.build import bias_apart, bias_shares
from tinygc.closure.earth import EarthRate, estimate_heading, with_heading
from tinygc.closure.floor import gyro_variance
from tinygc.closure.joint import GIVEN_SIGMA_MG
from tinygc.closure.problem import Problem
from tinygc.closure.residual import Batch
from tinygc.features.arrays.units import ArrayUnit, SameStills
from tinygc.inference.noise import Cost, lowest
from tinygc.inference.solve import inverse
from tinygc.models import linear
from tinygc.models.linear import PRIOR_SIGMA, LinearModel

# Layout of an array's parameters.

#: order of a unit's numbers: the gyroscope's twelve, the accelerometer's nine, its mounting's three
GYROSCOPE = slice(0, linear.PARAMETERS)
ACCELEROMETER = slice(GYROSCOPE.stop, GYROSCOPE.stop + OF_ACCELEROMETER)
MOUNTING = slice(ACCELEROMETER.stop, ACCELEROMETER.stop + 3)
PER_UNIT = MOUNTING.stop


@dataclass(frozen=True, eq=False)
class Layout:
    """Positions of the parameters and of the rows, for units N and stills Q.

    Parameters, after the units' numbers: the magnitude of gravity; attitudes (Q, 3) rad of the stills about the table's axes; level (Q, 2)
    m/s^2, the acceleration common to all units along the table's x and y; common (Q - 1, 2) rad, the tilt error common to all units of each
    interval between two stills.  Rows: of each unit its closure (S, 3) and force (K, 3); those of the common errors, of_common (Q - 1, 2)
    and of_level (Q, 2).

    Components, the rows of ``System.V``: each unit's closure, each unit's forces, what is common to all in a turn, what is in proportion to
    the motion beyond the data rate, and the level acceleration.
    """

    gravity: int
    attitudes: np.ndarray
    level: np.ndarray
    common: np.ndarray
    closure: tuple[np.ndarray, ...]
    force: tuple[np.ndarray, ...]
    of_common: np.ndarray
    of_level: np.ndarray

    @classmethod
    def of(cls, turns: Sequence[int], forces: Sequence[int], stills: int) -> Layout:
        """Place everything in turn; turns, forces: how many each unit has."""

        def placed(begin: int, shapes: Sequence[tuple[int, int]]) -> list[np.ndarray]:
            ends = begin + np.cumsum([rows * columns for rows, columns in shapes])
            return [np.arange(end - rows * columns, end).reshape(rows, columns) for end, (rows, columns) in zip(ends, shapes, strict=True)]

        units = len(turns)
        rows = placed(0, [*((count, 3) for count in (*turns, *forces)), (stills - 1, 2), (stills, 2)])
        attitudes, level, common = placed(units * PER_UNIT + 1, [(stills, 3), (stills, 2), (stills - 1, 2)])
        closure, force = tuple(rows[:units]), tuple(rows[units:-2])
        return cls(units * PER_UNIT, attitudes, level, common, closure, force, rows[-2], rows[-1])

    def unit(self, number: int, part: slice = slice(0, PER_UNIT)) -> slice:
        """Slice of the number-th used unit."""
        return slice(number * PER_UNIT + part.start, number * PER_UNIT + part.stop)

    @property
    def count(self) -> int:
        """Number of all parameters."""
        return int(self.common[-1, -1]) + 1


@dataclass(frozen=True, eq=False)
class ArrayState:
    """Point of linearisation.

    models, accelerometers (N, 9) relative to those used for the forces, mountings (N, 3, 3) from unit to array; q_tb (Q, 4) of the array's
    body in each still; gravity_mps2.  Random unknowns are not part of it.
    """

    models: tuple[LinearModel, ...]
    accelerometers: np.ndarray
    mountings: np.ndarray
    q_tb: np.ndarray
    gravity_mps2: float

    def moved(self, change: np.ndarray, layout: Layout) -> ArrayState:
        """Return the state after a change (count,) of all numbers."""
        units = change[: layout.gravity].reshape(-1, PER_UNIT)
        turned = rotation.exp(change[layout.attitudes])
        return replace(
            self,
            models=tuple(LinearModel.from_vector(m.vector + c[GYROSCOPE]) for m, c in zip(self.models, units, strict=True)),
            accelerometers=self.accelerometers + units[:, ACCELEROMETER],
            mountings=rotation.matrix(rotation.exp(units[:, MOUNTING])) @ self.mountings,
            q_tb=rotation.multiply(turned, self.q_tb),
            gravity_mps2=self.gravity_mps2 + float(change[layout.gravity]),
        )


# Linear system of an array: rows with variances of several components, unknowns with priors; its solution and its likelihood.
#
# A row k, a_k x + v_k = error, has the variance base_k + sum_g t_g V_gk, t_g >= 0 the variance components. A random unknown in x (the part
# common to all units) has a row of its own, value 0, whose variance is that component, so all components are variances of rows.


#: drop of -2 log likelihood that ends the search: limits are differences of it
SETTLED = 1e-8


@dataclass(frozen=True, eq=False)
class System:
    """Rows and priors.

    design (n, P), values (n,), base (n,) variances; V (G, n): weight of each component in them; prior (P,) sigmas about pull (P,): the
    prior's centre relative to this state; out (n,) bool: rejected rows.
    """

    design: np.ndarray
    values: np.ndarray
    base: np.ndarray
    V: np.ndarray
    prior: np.ndarray
    pull: np.ndarray
    out: np.ndarray

    def solved(self, t: np.ndarray) -> Solution:
        """Solve for given components t (G,)."""
        variance = self.base + t @ self.V
        root = np.where(self.out, 0.0, 1 / np.sqrt(variance))
        scaled = self.design * root[:, None] * self.prior
        normal = scaled.T @ scaled + np.eye(len(self.prior))
        factor = cho_factor(normal, lower=True)
        aim = -scaled.T @ (root * self.values) + self.pull / self.prior
        x = cho_solve(factor, aim)
        residual = self.values + self.design @ (self.prior * x)
        taken = solve_triangular(factor[0], scaled.T, lower=True)
        leverage = np.sum(taken**2, axis=0)
        apart = x - self.pull / self.prior
        counted = ~self.out
        value = float(
            np.sum(np.log(variance[counted])) + 2 * np.sum(np.log(np.diag(factor[0]))) + np.sum((residual * root) ** 2) + apart @ apart
        )
        return Solution(self, t, self.prior * x, residual, variance, leverage, taken, factor, value)

    def estimated(self, t: np.ndarray, held: Mapping[int, float] | None = None) -> Solution:
        """Estimate the components by restricted maximum likelihood, by the engine's search from t (G,); held: those with given values.

        All components are variances of single rows, which makes value, slope and information cheap: they are given to the search.
        """
        least, most = np.zeros(len(t)), np.full(len(t), np.inf)
        for k, value in (held or {}).items():
            least[k] = most[k] = value

        def cost(t: np.ndarray) -> Cost:
            found = self.solved(t)
            slope, information = found.score()
            return Cost(found.value, -2 * slope, 2 * information)

        return self.solved(lowest(cost, np.clip(t, least, most), least, most, settled=SETTLED)[0])


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of the system.

    t (G,) the components; x (P,) the change; residual (n,) after it; variance (n,), and leverage (n,): how much of a row's own error the
    solution follows; value: -2 log of the restricted likelihood, up to a constant.
    """

    system: System
    t: np.ndarray
    x: np.ndarray
    residual: np.ndarray
    variance: np.ndarray
    leverage: np.ndarray
    taken: np.ndarray
    factor: tuple[np.ndarray, bool]
    value: float

    @property
    def covariance(self) -> np.ndarray:
        """Return (P, P) of x."""
        inverse = cho_solve(self.factor, np.eye(len(self.x)))
        return inverse * np.outer(self.system.prior, self.system.prior)

    def held(self, values: Mapping[int, float]) -> Solution:
        """Return the solution where components have these values, all others estimated again."""
        return self.system.estimated(self.t, values)

    def score(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (G,) slope of the log likelihood by each component, and (G, G) its information, for independent rows."""
        counted = np.where(self.system.out, 0.0, 1.0)
        V, left = self.system.V * counted, 1 - self.leverage
        slope = V @ (self.residual**2 / self.variance**2 - left / self.variance) / 2
        weight = (left / self.variance) ** 2 / 2
        return slope, (V * weight) @ V.T

    def sigma(self) -> np.ndarray:
        """Return the sigmas (G,) of the components, by the expected information."""
        counted = ~self.system.out
        root = 1 / np.sqrt(self.variance[counted])
        taken = self.taken[:, counted]
        P = (np.eye(counted.sum()) - taken.T @ taken) * root[:, None] * root
        V = self.system.V[:, counted]
        information = np.einsum("gi,ij,hj->gh", V, P**2, V, optimize=True) / 2
        return sigmas_in(inverse(information))

    def blocks(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return chi-square (B,) and error (B, d) of blocks of rows (B, d), each as predicted by all other rows.

        The block itself has no part in the prediction; also for rejected rows.
        """
        design = self.system.design * self.system.prior
        error, chi = np.empty(rows.shape), np.empty(len(rows))
        for b, row in enumerate(rows):
            known = solve_triangular(self.factor[0], design[row].T, lower=True)
            inner = known.T @ known
            own = np.diag(self.variance[row])
            if self.system.out[row].all():
                error[b], spread = self.residual[row], own + inner
            else:  # block removed again: residual = (1 - H) error of prediction
                spread = own - inner
                error[b] = own @ np.linalg.solve(spread, self.residual[row])
                spread = own @ np.linalg.solve(spread, own)
            chi[b] = float(error[b] @ np.linalg.solve(spread, error[b]))
        return chi, error


# Rows of an array's linear system: closure of every unit's turns, force of every unit's stills, and the common errors.
#
# The array's body has one attitude in each still; every unit's gyroscope must lead from one to the next, and every unit's gravity must
# point down in it. Tilt is measured by all accelerometers together; yaw at a turn's end is unknown, but one for all units, so the units are
# references for each other. To first order, about the table's axes, of a turn from still a to still b and a force f in still q::
#
#     e + A dtheta_i + (R_a - R_b) mu_i + delta_a - delta_b + gamma_ab = the unit's own error          (3 rows)
#     R_q M_i f + g z + dx columns + (mu_i, delta_q turned) + level_q = the unit's own error           (3 rows)
#
# gamma, the tilt error of a turn common to all units, and level, the acceleration common to all in a still, are random: they have rows.

#: rad, prior sigma of an attitude or a mounting about its point of linearisation
ATTITUDE_RAD, MOUNTING_RAD = 1.0, 1.0
HELD = 1e-9
DOWN = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class UnitRows:
    """Data of one unit.

    batch of its turns that are the array's, ends by number of still; floor (S, 3) rad^2 of its gyro's white noise; stills (K,) numbers of
    those that it has, their mean force (K, 3) and its white variance (K,); rest (3,) where its bias is taken from the stills, else None;
    prior (9,) sigmas of its accelerometer's numbers; centre (12,) of its gyroscope's.
    """

    batch: Batch
    first: np.ndarray
    last: np.ndarray
    floor: np.ndarray
    stills: np.ndarray
    force: np.ndarray
    white: np.ndarray
    rest: np.ndarray | None
    prior: np.ndarray
    centre: np.ndarray


def array_system(
    state: ArrayState, start: ArrayState, rows: list[UnitRows], same: SameStills, missed_rad: np.ndarray, gravity_sigma: float
) -> tuple[System, Layout]:
    """Linearise at a state.

    start: centre of the priors; missed_rad (Q-1,): predicted tilt error, by fast motion, of all units between two stills; gravity_sigma
    m/s^2.
    """
    layout = Layout.of([len(unit.batch) for unit in rows], [len(unit.stills) for unit in rows], len(same))
    count = int(layout.of_level[-1, -1]) + 1
    design, values, base = np.zeros((count, layout.count)), np.zeros(count), np.zeros(count)
    V = np.zeros((2 * len(rows) + 3, count))
    R = rotation.matrix(state.q_tb)
    attitude, level, common = layout.attitudes, layout.level, layout.common
    for i, unit in enumerate(rows):
        M = state.mountings[i]
        q_bu = rotation.from_matrix(M)
        batch = replace(
            unit.batch, start=rotation.multiply(state.q_tb[unit.first], q_bu), end=rotation.multiply(state.q_tb[unit.last], q_bu)
        )
        end, sensitivity = residual.end_and_sensitivity(batch, state.models[i](batch.rate))
        at = layout.closure[i]
        values[at] = residual.error_angles(residual.batch_residual(batch, end))
        base[at] = unit.floor
        V[i, at] = 1.0
        put(design, at, layout.unit(i, GYROSCOPE), linear.columns(sensitivity, batch.rate))
        put(design, at, layout.unit(i, MOUNTING), R[unit.first] - R[unit.last])
        for s, (a, b) in enumerate(zip(unit.first, unit.last, strict=True)):
            design[at[s], attitude[a]] += 1.0
            design[at[s], attitude[b]] -= 1.0
            for k in range(a, b):
                design[at[s][:2], common[k]] += 1.0
        at = layout.force[i]
        seen = corrected(state.accelerometers[i], unit.force) @ M.T
        R_q = R[unit.stills]
        level_force = np.einsum("qij,qj->qi", R_q, seen)
        values[at] = level_force + state.gravity_mps2 * DOWN
        base[at] = unit.white[:, None]
        V[len(rows) + i, at] = 1.0
        put(design, at, layout.unit(i, ACCELEROMETER), R_q @ M @ force_columns(state.accelerometers[i], unit.force))
        put(design, at, layout.unit(i, MOUNTING), -R_q @ rotation.cross_matrix(seen))
        turned = -rotation.cross_matrix(level_force)
        for k, q in enumerate(unit.stills):
            design[np.ix_(at[k], attitude[q])] = turned[k]
            design[at[k][:2], level[q]] = 1.0
        design[at[:, 2], layout.gravity] = 1.0
    design[layout.of_common, common] = 1.0
    design[layout.of_level, level] = 1.0
    V[-3, layout.of_common] = 1.0
    V[-2, layout.of_common] = missed_rad[:, None] ** 2
    V[-1, layout.of_level] = 1.0
    # rad^2 and (m/s^2)^2: keeps the variance positive when a component is zero
    base[layout.of_common], base[layout.of_level] = 1e-16, 1e-12
    prior, pull = _priors(state, start, rows, same, layout, gravity_sigma)
    return System(design, values, base, V, prior, pull, np.zeros(count, dtype=bool)), layout


def _priors(
    state: ArrayState, start: ArrayState, rows: list[UnitRows], same: SameStills, layout: Layout, gravity_sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    prior, pull = np.full(layout.count, np.nan), np.zeros(layout.count)
    for i, unit in enumerate(rows):
        gyroscope = PRIOR_SIGMA.copy()
        if unit.rest is not None:
            gyroscope[linear.BIAS] *= HELD
        prior[layout.unit(i)] = np.concatenate([gyroscope, unit.prior, np.full(3, HELD if i == 0 else MOUNTING_RAD)])
        pull[layout.unit(i)][: PER_UNIT - 3] = np.concatenate([unit.centre - state.models[i].vector, IDENTITY - state.accelerometers[i]])
    prior[layout.gravity] = gravity_sigma
    pull[layout.gravity] = start.gravity_mps2 - state.gravity_mps2
    attitude = np.full((len(same), 3), ATTITUDE_RAD)
    attitude[np.unique(same.group, return_index=True)[1], 2] = HELD  # the yaw of a group's first still defines its frame
    prior[layout.attitudes] = attitude
    prior[layout.level], prior[layout.common] = G, 1.0
    return prior, pull


def put(design: np.ndarray, rows: np.ndarray, columns: slice, blocks: np.ndarray) -> None:
    """Write blocks (B, d, p) into rows (B, d) and p columns."""
    design[rows.ravel(), columns] = blocks.reshape(rows.size, -1)


# Each unit's contribution to the joint estimate, and the start of the search.


def start_state(units: list[ArrayUnit], rows: list[UnitRows], same: SameStills) -> ArrayState:
    """Return the start: each unit's own first fit, its prior mounting, and the attitudes integrated by the anchor."""
    anchor = units[same.anchor]
    carried = np.concatenate([log.references.q_tb for log in anchor.problem.logs])
    gravity = units[0].problem.session.config.site.expected_gravity_mps2
    return ArrayState(
        tuple(LinearModel.from_vector(unit.centre) for unit in rows),
        np.tile(IDENTITY, (len(units), 1)),
        np.array([unit.place.mounting for unit in units]),
        rotation.multiply(carried, rotation.from_matrix(anchor.place.mounting.T)),
        gravity,
    )


def unit_rows(unit: ArrayUnit, index: int, same: SameStills, bias: str) -> UnitRows:
    """Return the rows of the index-th unit; bias: ``ends`` of the turns, or ``stills`` around each."""
    problem, given = unit.problem, force_problem(unit)
    turns = same.turns[index]
    batch, rest = replace(problem.batch, turns=None, yaw_known=True), None
    centre = problem.first.vector
    if bias == "stills":
        rest, apart = bias_apart(problem)
        batch = replace(batch, rate=batch.rate - rest - apart)
        centre = replace(problem.first, B=np.zeros(3)).vector
    batch = batch.pick(turns).trimmed()
    at = residual.attitudes(problem.batch, problem.first(problem.batch.rate))
    noises = [problem.logs[segment.log].noise for segment in problem.used]
    floor = np.diagonal(gyro_variance(problem.batch, at, noises), axis1=1, axis2=2).mean(axis=1)
    floor = (floor + _of_still_rates(problem) if bias == "stills" else floor)[turns]
    forces = {id(still): twin for still, twin in zip(references(problem.stills), references(given.stills), strict=True)}
    mine = [(q, still, forces[id(still)]) for q, still in enumerate(same.stills[index]) if still is not None]
    walk = {id(s): np.mean(log.noise.velocity_random_walk**2) for log in problem.logs for s in log.stills}
    gravity = problem.session.config.site.expected_gravity_mps2
    return UnitRows(
        batch=batch,
        first=same.first[index],
        last=same.last[index],
        floor=np.repeat(floor[:, None], 3, axis=1),
        stills=np.array([q for q, _, _ in mine]),
        force=np.array([still.accel_mean for _, _, still in mine]),
        white=np.array([walk[id(own)] / own.duration_s for _, own, _ in mine]),
        rest=rest,
        prior=_spread(unit) * units(gravity),
        centre=centre,
    )


def _of_still_rates(problem: Problem) -> np.ndarray:
    """Return (S,) rad^2 of each angle, from white noise of the stills' rates, for each used turn."""
    first, last, share = bias_shares(problem)
    batch = replace(problem.batch, turns=None, yaw_known=True)
    sensitivity = residual.sensitivity(batch, problem.first(batch.rate))
    square = problem.still_rates.sigma**2
    total = np.zeros(len(batch))
    for still, part in ((first, 1 - share), (last, share)):
        turned = np.einsum("st,stij->sij", part, sensitivity)
        total += np.einsum("sij,sj->s", turned**2, square[still]) / 3
    return total


def force_problem(unit: ArrayUnit) -> Problem:
    """Return the problem whose forces use the prior's calibration: a given one, or the one from the stills."""
    joint = unit.problem.joint
    return unit.prepared.as_given().problem if joint is not None and joint.mode == "prior" else unit.problem


def accelerometer_after(unit: ArrayUnit, x: np.ndarray) -> Accelerometer:
    """Return the calibration after a correction x (9,); unchanged where it is taken as given."""
    before, joint = force_problem(unit).session.config.accelerometer, unit.problem.joint
    return before if joint is None else after(x, before, "stills" if joint.mode == "fit" else "prior")


def _spread(unit: ArrayUnit) -> np.ndarray:
    """Return prior sigmas (9,) m/s^2 at one g of the accelerometer's numbers."""
    joint = unit.problem.joint
    if joint is None:
        return np.full(PARAMETERS, HELD)
    if joint.mode == "fit":
        return SPREAD_MPS2
    return np.full(PARAMETERS, (force_problem(unit).session.config.accelerometer.sigma_mg or GIVEN_SIGMA_MG) * MG)


def common_earth(units: list[ArrayUnit], state: ArrayState, same: SameStills) -> dict[int, EarthRate]:
    """Return the Earth rate in the frame of each yaw group: the anchor's, with its heading from all units' stills."""
    anchor = units[same.anchor].problem
    found = dict(anchor.earths)
    latitude = anchor.session.config.site.latitude_deg
    for group, earth in found.items():
        if earth.source not in ("estimated", "unknown") or latitude is None:
            continue
        headings = []
        for index, unit in enumerate(units):
            rates = unit.problem.still_rates
            index_of = {id(still): row for row, still in enumerate(references(unit.problem.stills))}
            pairs = [(q, index_of[id(s)]) for q, s in enumerate(same.stills[index]) if s is not None and same.group[q] == group]
            if len(pairs) < 3:
                continue
            q, row = (np.array(column) for column in zip(*pairs, strict=True))
            attitude = rotation.multiply(state.q_tb[q], rotation.from_matrix(state.mountings[index]))
            one = estimate_heading(latitude, attitude, unit.problem.first(rates.rate[row]), rates.sigma[row])
            if one.source == "estimated" and one.heading_rad is not None:
                headings.append((one.heading_rad, one.heading_sigma_rad))
        if len(headings) > 1:
            angle, sigma = np.array(headings).T
            mean = np.sum(np.exp(1j * angle) / sigma**2)
            known = with_heading(latitude, float(np.degrees(np.angle(mean))))
            left = float(1 / np.sqrt(np.sum(1 / sigma**2)))
            shrunk = known.rate_t * [np.exp(-(left**2) / 2)] * np.array([1.0, 1.0, 0.0]) + known.rate_t * np.array([0.0, 0.0, 1.0])
            found[group] = EarthRate(shrunk, known.heading_rad, left, "estimated")
    return found


def with_earth(rows: UnitRows, model: LinearModel, mounting: np.ndarray, state: ArrayState, group: np.ndarray, earths: dict) -> UnitRows:
    """Return the unit's turns with the Earth's rate by the array's attitudes."""
    q_bu = rotation.from_matrix(mounting)
    batch = replace(rows.batch, start=rotation.multiply(state.q_tb[rows.first], q_bu))
    at = residual.attitudes(batch, model(batch.rate))
    earth = np.empty_like(batch.rate)
    for s, q in enumerate(rows.first):
        earth[s] = earths[int(group[q])].in_body(at[s])
    return replace(rows, batch=replace(batch, earth=earth))
