"""What each unit of an array brings to the joint estimate, and where its search begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.accelerometer.parameters import IDENTITY, PARAMETERS, after
from session.common.units import MG
from session.log.config import Accelerometer
from tinygc import closure
from tinygc.array.joint.rows import HELD, UnitRows, accelerometer_prior, rotation_of
from tinygc.array.joint.same_stills import SameStills
from tinygc.array.joint.state import State
from tinygc.array.joint.units import ArrayUnit
from tinygc.attitude import rotation
from tinygc.attitude.earth import EarthRate, estimate_heading, with_heading
from tinygc.closure.floor import gyro_variance
from tinygc.models.linear import LinearModel
from tinygc.problem.joint import GIVEN_SIGMA_MG, SPREAD_MPS2
from tinygc.problem.problem import Problem
from tinygc.problem.still_bias import bias_shares, rest_biases


def start_state(units: list[ArrayUnit], rows: list[UnitRows], same: SameStills) -> State:
    """Each unit's own first fit, its mounting as it is known beforehand, and the attitudes that the anchor has carried."""
    anchor = units[same.anchor]
    carried = np.array([q for log in anchor.problem.logs for q, s in zip(log.q_tb, log.stills, strict=True) if s.problem is None])
    gravity = units[0].problem.session.config.site.expected_gravity_mps2
    return State(
        tuple(LinearModel.from_vector(unit.centre) for unit in rows),
        np.tile(IDENTITY, (len(units), 1)),
        np.array([unit.place.mounting for unit in units]),
        rotation.multiply(carried, rotation_of(anchor.place.mounting.T)),
        gravity,
    )


def unit_rows(unit: ArrayUnit, index: int, same: SameStills, bias: str) -> UnitRows:
    """Of the index-th unit; bias: ``ends`` of the turns, or ``stills`` around each."""
    problem, given = unit.problem, force_problem(unit)
    turns = same.turns[index]
    batch, rest = replace(problem.batch, turns=None, yaw_known=True), None
    centre = problem.first.vector
    if bias == "stills":
        rest, apart = bias_apart(problem)
        batch = replace(batch, rate=batch.rate - rest - apart)
        centre = replace(problem.first, B=np.zeros(3)).vector
    batch = batch.pick(turns).trimmed()
    at = closure.attitudes(problem.batch, problem.first(problem.batch.rate))
    noises = [problem.logs[segment.log].noise for segment in problem.used]
    floor = np.diagonal(gyro_variance(problem.batch, at, noises), axis1=1, axis2=2).mean(axis=1)
    floor = (floor + _of_still_rates(problem) if bias == "stills" else floor)[turns]
    forces = {id(still): twin for still, twin in zip(_references(problem), _references(given), strict=True)}
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
        prior=accelerometer_prior(_spread(unit), gravity),
        centre=centre,
    )


def bias_apart(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """The mean bias (3,) rad/s, as it is measured, and by how much that of each sample of each used turn (S, T, 3) is apart from it: what
    the stills around the turn show."""
    bias = rest_biases(problem)
    mean = bias.mean(axis=0)
    first, last, share = bias_shares(problem)
    return mean, bias[first][:, None] * (1 - share[..., None]) + bias[last][:, None] * share[..., None] - mean


def _of_still_rates(problem: Problem) -> np.ndarray:
    """(S,) rad^2 of each angle that the white noise of the stills' rates makes of each used turn."""
    first, last, share = bias_shares(problem)
    batch = replace(problem.batch, turns=None, yaw_known=True)
    sensitivity = closure.sensitivity(batch, problem.first(batch.rate))
    square = problem.still_rates.sigma**2
    total = np.zeros(len(batch))
    for still, part in ((first, 1 - share), (last, share)):
        turned = np.einsum("st,stij->sij", part, sensitivity)
        total += np.einsum("sij,sj->s", turned**2, square[still]) / 3
    return total


def force_problem(unit: ArrayUnit) -> Problem:
    """The problem whose stills' forces are under the calibration that the prior is about: a given one, or the one from the stills."""
    joint = unit.problem.joint
    return unit.prepared.as_given().problem if joint is not None and joint.mode == "prior" else unit.problem


def accelerometer_before(unit: ArrayUnit) -> Accelerometer:
    """The calibration that those forces are under."""
    return force_problem(unit).session.config.accelerometer


def accelerometer_after(unit: ArrayUnit, x: np.ndarray) -> Accelerometer:
    """What a correction x (9,) makes of it; the same where it is taken as given."""
    before, joint = accelerometer_before(unit), unit.problem.joint
    return before if joint is None else after(x, before, "stills" if joint.mode == "fit" else "prior")


def _spread(unit: ArrayUnit) -> np.ndarray:
    """(9,) m/s^2 at one g that the accelerometer's numbers are open by."""
    joint = unit.problem.joint
    if joint is None:
        return np.full(PARAMETERS, HELD)
    if joint.mode == "fit":
        return SPREAD_MPS2
    return np.full(PARAMETERS, (accelerometer_before(unit).sigma_mg or GIVEN_SIGMA_MG) * MG)


def _references(problem: Problem) -> list:
    return [still for log in problem.logs for still in log.stills if still.problem is None]


def common_earth(units: list[ArrayUnit], state: State, same: SameStills) -> dict[int, EarthRate]:
    """The Earth in the frame of each yaw group: the anchor's, its heading from what all units' stills show."""
    anchor = units[same.anchor].problem
    found = dict(anchor.earths)
    latitude = anchor.session.config.site.latitude_deg
    for group, earth in found.items():
        if earth.source not in ("estimated", "unknown") or latitude is None:
            continue
        headings = []
        for index, unit in enumerate(units):
            rates = unit.problem.still_rates
            index_of = {id(still): row for row, still in enumerate(_references(unit.problem))}
            pairs = [(q, index_of[id(s)]) for q, s in enumerate(same.stills[index]) if s is not None and same.group[q] == group]
            if len(pairs) < 3:
                continue
            q, row = (np.array(column) for column in zip(*pairs, strict=True))
            attitude = rotation.multiply(state.q_tb[q], rotation_of(state.mountings[index]))
            one = estimate_heading(latitude, attitude, unit.model(rates.rate[row]), rates.sigma[row])
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


def with_earth(rows: UnitRows, model: LinearModel, mounting: np.ndarray, state: State, group: np.ndarray, earths: dict) -> UnitRows:
    """The unit's turns with the Earth's rate by the array's attitudes."""
    q_bu = rotation_of(mounting)
    batch = replace(rows.batch, start=rotation.multiply(state.q_tb[rows.first], q_bu))
    at = closure.attitudes(batch, model(batch.rate))
    earth = np.empty_like(batch.rate)
    for s, q in enumerate(rows.first):
        earth[s] = earths[int(group[q])].in_body(at[s])
    return replace(rows, batch=replace(batch, earth=earth))
