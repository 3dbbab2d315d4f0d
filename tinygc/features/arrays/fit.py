"""``fit`` of an array: calibration and extrinsics of every unit, and the result as JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from session import VERSION
from session.base.files import result_folder
from session.base.numeric import rms_of, sigma_of, sigmas_in
from session.base.progress import Told, untold
from session.base.records import plain, write_whole
from session.base.rotation import cross_matrix
from session.base.units import DEG, DEG_PER_HOUR, NS, G
from session.detect.accelerometer import corrected as corrected_force
from session.detect.events import register_end_dps
from session.detect.stills import Noise
from session.log.config import Accelerometer
from session.log.folder import Session, hash_of_log, input_hashes
from tinygc import models
from tinygc.closure.floor import BiasInstability
from tinygc.closure.least_squares import OBSERVED_BELOW
from tinygc.closure.residual import closure_angles
from tinygc.closure.runs import ClosureRun, read_closure_runs
from tinygc.estimation.bias import closes_better, less_by_chance, tilt_rms
from tinygc.estimation.choice import run_figures
from tinygc.features.arrays.clocks import UnitPlace, rates_of
from tinygc.features.arrays.extrinsics import clock_fits, places_of
from tinygc.features.arrays.fusion import with_best_weights
from tinygc.features.arrays.joint import ArrayEvent, Joint, VarianceSplit, estimate, split_of, unit_block, units_covariance
from tinygc.features.arrays.latency import SampleAges, ages_of, corrected
from tinygc.features.arrays.model import ArrayModel, FusedUnit
from tinygc.features.arrays.recording import ArraySession
from tinygc.features.arrays.system import MOUNTING, PER_UNIT, accelerometer_after, force_problem
from tinygc.features.arrays.units import ArrayUnit, SameStills, prepare_units, same_stills
from tinygc.inference.solve import inverse as covariance_of
from tinygc.models.linear import BIAS, MATRIX, NAMES, PARAMETERS, PRIOR_SIGMA, LinearModel
from tinygc.models.model import accelerometer_table, sensor_table
from tinygc.noise.components import undersampling
from tinygc.noise.twin import Twin

# Position of each unit's accelerometer on the body, from its force relative to the first unit's while the body turns.
#
# a_i - a_0 = alpha x r + omega x (omega x r) + offset, in the array's axes: linear in r. The rate is the mean of all units' calibrated
# rates, its derivative that of a spline. The accelerometers' filters are not the gyroscopes': the rates are read at the delay that leaves
# the least, since 8 ms of it (MPU-9150) moves a position by half its length. That delay's remaining error is one more column, and a delay
# of one accelerometer against the other another one: the derivative of the force. The covariance is from the scatter between turns (the
# sandwich, White 1980, turns as clusters), since errors of filters and clocks are common to a turn.

#: m: a position with a larger sigma counts as unknown
KNOWN_M = 0.05
FEWEST_TURNS = 5
#: s: the largest delay of force against rate, several times those of such sensors' filters, and how well it must be found
MOST_DELAY_S, DELAY_STEP_S = 0.02, 1e-5
#: relative error of a position from differing filters of gyroscope and accelerometer (benchmarks/array_fit.py)
FILTERS = 0.005
#: rows with a residual beyond this many typical residuals are down-weighted
BAR = 2.0
ROUNDS = 6


def positions(motion: _ArrayMotion) -> list[tuple[np.ndarray, np.ndarray] | None]:
    """Return each unit's position (3,) m from the first, in the array's axes, and its covariance (3, 3) m^2.

    None where the motion does not determine it.  The first unit's is zero.
    """
    from scipy.optimize import minimize_scalar

    found: list[tuple[np.ndarray, np.ndarray] | None] = [(np.zeros(3), np.zeros((3, 3)))]
    begun = {i: solved for i in range(1, len(motion.force)) if (solved := _solve_position(motion.rows(i, 0.0))) is not None}
    if not begun:
        return found + [None] * (len(motion.force) - 1)
    scales = {i: BAR * float(sigma_of(np.concatenate(each.left))) for i, each in begun.items()}

    def left(delay_s: float) -> float:
        at = {i: _solve_position(motion.rows(i, delay_s)) for i in begun}
        if any(each is None for each in at.values()):
            return math.inf
        return sum(float(np.log1p((np.concatenate(each.left) / scales[i]) ** 2).sum()) for i, each in at.items() if each is not None)

    bounds = (-MOST_DELAY_S, MOST_DELAY_S)
    delay_s = float(minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": DELAY_STEP_S}).x)
    for i in range(1, len(motion.force)):
        first = _solve_position(motion.rows(i, delay_s))
        whole = None if first is None else _solve_position(motion.rows(i, delay_s, first.x[:3]))
        found.append(None if whole is None else whole.position)
    return found


@dataclass(frozen=True, eq=False)
class _ArrayMotion:
    """Splines of each unit's calibrated rate and force, by log, in the array's axes; turns: log and times (N,) s of each."""

    rate: list[list[CubicSpline]]
    force: list[list[CubicSpline]]
    turns: list[tuple[int, np.ndarray]]

    @classmethod
    def of(cls, units: list[ArrayUnit], joint: Joint) -> _ArrayMotion:
        """The motion of a fitted array."""
        rate, force = ([_of_logs(unit, joint, i, what) for i, unit in enumerate(units)] for what in ("rate", "force"))
        anchor, turns = units[joint.same.anchor].problem, []
        for segment in anchor.used:
            samples = anchor.logs[segment.log].samples
            first, last = segment.stills
            turns.append((segment.log, samples.t_ns[first.stop : last.start + 1] * NS))
        return cls(rate, force, turns)

    def rows(self, i: int, delay_s: float, position: np.ndarray | None = None) -> list[tuple[np.ndarray, np.ndarray]]:
        """Design (3 N, 7) and values (3 N,) of unit i in each turn, the rates read ``delay_s`` before the forces; with a position (3,) m,
        one more column: what a longer delay changes."""
        found = []
        for log, t_s in self.turns:
            parts = [part for each in (self.rate, self.force) for part in (each[0][log], each[i][log])]
            inside = [(t_s - MOST_DELAY_S >= part.x[0]) & (t_s + MOST_DELAY_S <= part.x[-1]) for part in parts]
            t_s = t_s[np.all(inside, axis=0)]
            if len(t_s) < 4:
                continue
            splines = [each[log] for each in self.rate]
            omega, alpha, jerk = (np.mean([spline(t_s - delay_s, order) for spline in splines], axis=0) for order in range(3))
            A = cross_matrix(alpha) + cross_matrix(omega) @ cross_matrix(omega)
            columns = [A, np.broadcast_to(np.eye(3), A.shape), self.force[0][log](t_s, 1)[..., None]]
            if position is not None:
                changed = cross_matrix(jerk) + cross_matrix(alpha) @ cross_matrix(omega) + cross_matrix(omega) @ cross_matrix(alpha)
                columns.append((changed @ position)[..., None])
            values = self.force[i][log](t_s) - self.force[0][log](t_s)
            found.append((np.concatenate(columns, axis=2).reshape(values.size, -1), values.reshape(-1)))
        return found


def _of_logs(unit: ArrayUnit, joint: Joint, i: int, what: str) -> list[CubicSpline]:
    """Return splines of calibrated rate or force, in the array's axes, of each log over the array's time; invalid readings are left out."""
    M, x, model = joint.state.mountings[i], joint.state.accelerometers[i], joint.models[i]
    found = []
    for log, given in zip(unit.problem.logs, force_problem(unit).logs, strict=True):
        samples = log.samples
        good = rates_of(samples, register_end_dps(unit.problem.session.config.sensor, np.asarray(samples.gyro))).good
        t_s = samples.t_ns * NS
        values = model(np.asarray(samples.gyro)) if what == "rate" else corrected_force(x, np.asarray(given.samples.accel))
        found.append(CubicSpline(t_s[good], values[good] @ M.T))
    return found


class SolvedPosition(NamedTuple):
    """Numbers x (P,) of the design; left: residuals (n,) m/s^2 of each turn; position (3,) m with its covariance (3, 3), None where it
    is not determined."""

    x: np.ndarray
    left: list[np.ndarray]
    position: tuple[np.ndarray, np.ndarray] | None


def _solve_position(turns: list[tuple[np.ndarray, np.ndarray]]) -> SolvedPosition | None:
    """Solve design (n, P) and values (n,) of each turn, in m/s^2, the position (3,) m first; None with too few turns or directions."""
    if len(turns) < FEWEST_TURNS:
        return None
    design, values = zip(*turns, strict=True)
    weights = [np.ones(len(v)) for v in values]
    size = design[0].shape[1]
    x = np.zeros(size)
    for _ in range(ROUNDS):
        normal = sum((D * w[:, None]).T @ D for D, w in zip(design, weights, strict=True))
        if not np.isfinite(np.diag(covariance_of(normal))).all():
            return None
        x = np.linalg.solve(normal, sum(D.T @ (w * v) for D, v, w in zip(design, values, weights, strict=True)))
        left = [v - D @ x for D, v in zip(design, values, strict=True)]
        bar = BAR * float(sigma_of(np.concatenate(left)))
        weights = [1 / (1 + (e / max(bar, 1e-12)) ** 2) for e in left]
    scores = np.array([D.T @ (w * e) for D, w, e in zip(design, weights, left, strict=True)])
    inverse = np.linalg.inv(normal)
    count = len(turns)
    covariance = (inverse @ (scores.T @ scores) @ inverse)[:3, :3] * count / (count - 2)
    covariance += np.eye(3) * (FILTERS * float(np.linalg.norm(x[:3]))) ** 2
    known = np.sqrt(np.linalg.eigvalsh(covariance)[-1]) <= KNOWN_M
    return SolvedPosition(x, left, (x[:3], covariance) if known else None)


# Fit of an array: each unit's calibration and extrinsics, and the residuals of its turns, split into common and individual parts.


@dataclass(frozen=True, eq=False)
class UnitFit:
    """Result of one unit.

    number; session as recorded; place: clock, mounting and position, refined; model: omega = E m + B in the unit's body frame, in seconds
    of the array's clock; accelerometer; covariance (24, 24) of E, B, the accelerometer's nine and the mounting's three (rad about the
    array's axes); alone: the same twelve by the unit's own gravity alone, and its covariance_alone (12, 12); own_rad: tilt beyond noise,
    rms a turn, by which this unit alone misses, with its sigma; closure_rad, floor_rad: rms of tilt by its own calibration alone, and the
    part that white noise explains; noise; instability; runs: its closure runs, each with the error (3,) rad at its end.
    """

    number: int
    session: Session
    place: UnitPlace
    model: LinearModel
    accelerometer: Accelerometer
    covariance: np.ndarray
    alone: LinearModel
    covariance_alone: np.ndarray
    own_rad: tuple[float, float]
    minus_mean_rad: float
    closure_rad: float
    floor_rad: float
    noise: Noise
    instability: BiasInstability
    runs: tuple[tuple[ClosureRun, np.ndarray], ...] = ()

    @property
    def sigma(self) -> np.ndarray:
        """Return the sigmas (12,) of the model's numbers."""
        return sigmas_in(self.covariance)[:PARAMETERS]

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Return the names of the model's numbers that neither this unit's turns nor the others determine."""
        return tuple(name for name, s, prior in zip(NAMES, self.sigma, PRIOR_SIGMA, strict=True) if s > OBSERVED_BELOW * prior)

    @property
    def sigma_alone(self) -> np.ndarray:
        """Return the sigmas (12,) by the unit's own gravity alone."""
        return sigmas_in(self.covariance_alone)


@dataclass(frozen=True, eq=False)
class ArrayFit:
    """Result of an array's fit.

    array; units that were used; left_out: the reason why one was not, by number; covariance (24 N, 24 N) of all units' numbers; bias: its
    source, and bias_p, the p-value of the stills' advantage, None if the source was requested; joint; split.
    """

    array: ArraySession
    units: tuple[UnitFit, ...]
    left_out: dict[int, str]
    covariance: np.ndarray
    bias: str
    bias_p: float | None
    joint: Joint
    split: VarianceSplit
    prepared: tuple[ArrayUnit, ...]
    ages: tuple[SampleAges, ...] = ()

    def __repr__(self) -> str:
        return f"<ArrayFit {self.array.name}: units {', '.join(str(unit.number) for unit in self.units)}>"

    @property
    def same(self) -> SameStills:
        """Return the stills and turns that the units have in common."""
        return self.joint.same

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the units that were used."""
        return tuple(unit.number for unit in self.units)

    @cached_property
    def fused(self) -> ArrayModel:
        """Return all units as one gyroscope."""
        units = [
            FusedUnit(
                **vars(unit.place),
                E=unit.model.E,
                B=unit.model.B,
                covariance=unit.covariance[:PARAMETERS, :PARAMETERS],
                noise_density_rps_rthz=np.asarray(unit.noise.gyro, dtype=float),
                bias_instability_rps=np.full(3, unit.instability.rps) if unit.instability.rps > 0 else None,
                accel_noise_density_mps2_rthz=rms_of(unit.noise.accel) or None,
                weights=np.eye(3),  # until the best are known
                sha256=tuple(hash_of_log(log) for log in (*unit.session.logs, *unit.session.closures)),
                sensor=unit.session.config.sensor,
                accelerometer=None if unit.accelerometer.source == "none" else unit.accelerometer,
            )
            for unit in self.units
        ]
        rows = np.concatenate([np.arange(PARAMETERS) + PER_UNIT * i for i in range(len(units))])
        rate_hz = 1 / self.units[0].session.logs[0].samples.period_s
        return with_best_weights(units, rate_hz, self.covariance[np.ix_(rows, rows)], self.array.name)


def fit_array(
    array: ArraySession,
    *,
    bias: str = "auto",
    use_earth: bool = True,
    accelerometer: str = "auto",
    progress: Told = untold,
) -> ArrayFit:
    """Estimate all units jointly.

    The latencies of readings that beat against the reader are subtracted from their stamps.  bias: source of each turn's bias, ends, stills
    or auto: the stills, if they reduce the units' own errors significantly; accelerometer as in ``prepare``.  Raises the errors of
    ``places_of``, and FitError where fewer than two units can be used or they have no turns in common.
    """
    progress("clocks and mountings")
    ages = ages_of(array, clock_fits(array)) if of_one_reader(array) else ()
    sampled = corrected(array, ages) if any(each.found for each in ages) else array
    units, left = prepare_units(sampled, places_of(sampled), use_earth=use_earth, accelerometer=accelerometer, progress=progress)
    same = same_stills(units)
    progress("motion beyond the data rate")
    missed = missed_between(units, same)
    chosen, p_value, joint = _by_bias(units, same, missed, bias, use_earth, progress)
    progress("positions")
    where = positions(_ArrayMotion.of(units, joint))
    covariance = units_covariance(units, joint)
    split = split_of(joint)
    recorded = dict(zip(array.numbers, array.units, strict=True))
    found = []
    for i, unit in enumerate(units):
        progress(f"unit {unit.number} alone")
        alone, apart = fit_alone(unit, chosen, use_earth)
        block = unit_block(covariance, i)
        position_m, position_covariance = where[i] or (None, None)
        place = replace(
            unit.place,
            mounting=joint.state.mountings[i] if i else np.eye(3),
            mounting_covariance=block[MOUNTING, MOUNTING] if i else np.zeros((3, 3)),
            position_m=position_m,
            position_covariance=position_covariance,
        )
        problem = unit.problem
        found.append(
            UnitFit(
                number=unit.number,
                session=recorded[unit.number],
                place=place,
                model=joint.models[i],
                accelerometer=accelerometer_after(unit, joint.state.accelerometers[i]),
                covariance=block,
                alone=alone,
                covariance_alone=apart,
                own_rad=(float(split.own[i, 0]), float(split.own[i, 1])),
                minus_mean_rad=float(split.minus_mean_of[i]),
                closure_rad=tilt_rms(closure_angles(problem.batch, problem.first)),
                floor_rad=problem.floor.tilt_rms,
                noise=problem.noise,
                instability=problem.instability,
                runs=tuple((run, run.errors(joint.models[i])) for run in read_closure_runs(problem)),
            )
        )
    return ArrayFit(
        array,
        tuple(found),
        left,
        covariance,
        chosen,
        p_value,
        joint,
        split,
        tuple(units),
        tuple(each for each in ages if each.found),
    )


def of_one_reader(array: ArraySession) -> bool:
    """Return whether all units have identical stamps: one reader stamped them, and readings may be older than their stamps."""
    first = array.units[0].logs
    return all(
        len(unit.logs) == len(first)
        and all(np.array_equal(one.samples.t_ns, other.samples.t_ns) for one, other in zip(first, unit.logs, strict=True))
        for unit in array.units[1:]
    )


def missed_between(units: list[ArrayUnit], same: SameStills) -> np.ndarray:
    """Return (Q-1,) rad of each angle: the predicted tilt error of each unit from motion beyond the data rate, averaged over all units."""
    square, count = np.zeros(len(same) - 1), np.zeros(len(same) - 1)
    for i, unit in enumerate(units):
        each = undersampling(Twin(unit.problem)).predicted_rad
        for row, a, b in zip(same.turns[i], same.first[i], same.last[i], strict=True):
            square[a:b] += each[row] ** 2 / (b - a)
            count[a:b] += 1
    return np.sqrt(square / np.maximum(count, 1))


def _by_bias(
    units: list[ArrayUnit], same: SameStills, missed: np.ndarray, bias: str, use_earth: bool, progress: Told
) -> tuple[str, float | None, Joint]:
    """Return the biases' source, the p-value of the stills' advantage, and the estimate with that source."""
    if bias != "auto":
        return bias, None, estimate(units, same, missed, bias=bias, use_earth=use_earth, progress=progress)
    both = {name: estimate(units, same, missed, bias=name, use_earth=use_earth, progress=progress) for name in ("ends", "stills")}
    left = {name: np.concatenate([joint.solution.blocks(rows)[1] for rows in joint.where.closure]) for name, joint in both.items()}
    p_value = less_by_chance(left["ends"], left["stills"])
    chosen = "stills" if closes_better(left["ends"], left["stills"]) else "ends"
    return chosen, p_value, both[chosen]


def fit_alone(unit: ArrayUnit, bias: str, use_earth: bool) -> tuple[LinearModel, np.ndarray]:
    """Estimate one unit in the same way, without the other units as reference."""
    by_itself = replace(unit, place=UnitPlace(unit.number))
    same = same_stills([by_itself])
    joint = estimate([by_itself], same, np.zeros(len(same) - 1), bias=bias, alone=True, use_earth=use_earth)
    return joint.models[0], units_covariance([by_itself], joint)[:PARAMETERS, :PARAMETERS]


# An array's fit as ``tinygc-array-fit/2`` (docs/formats.md), and each unit's model as ``tinygc-model/1``.

SCHEMA = "tinygc-array-fit/2"
NAME = "array.json"
#: all units as one gyroscope
FUSED = "model_array.json"
MODEL = "model_least_squares.json"


def array_to_json(fit: ArrayFit) -> dict:
    """Return the whole result, JSON-ready; angles in degrees, times in seconds of the array's clock from its first sample."""
    begins = begins_s(fit)
    return plain(
        {
            "schema": SCHEMA,
            "array": fit.array.name,
            "units": [_unit(unit, float(p)) for unit, p in zip(fit.units, fit.split.own_p, strict=True)],
            "left_out": [{"number": number, "why": why} for number, why in fit.left_out.items()],
            "turns_used": [len(rows) for rows in fit.same.turns],
            "bias_from": {"used": fit.bias, "p_value": fit.bias_p},
            "read_latency": [{"number": each.number, "beat_hz": each.beat_hz, "period_s": each.period_s} for each in fit.ages],
            "split": split_to_json(fit.split),
            "turns": [
                {
                    "at_s": float(fit.same.time_s[turn.first, 1]) - begins,
                    "common_deg": float(np.linalg.norm(turn.common_rad)) / DEG,
                    "common_sigma_deg": float(np.linalg.norm(turn.sigma_rad)) / DEG,
                    "own_deg": [None if np.isnan(size) else size / DEG for size in turn.own_rad],
                }
                for turn in fit.split.turns
            ],
            "events": [event_to_json(event, fit) for event in fit.joint.events],
            "version": VERSION,
        }
    )


def begins_s(fit: ArrayFit) -> float:
    """Return the time of the first sample, s of the array's clock."""
    return float(fit.array.units[0].logs[0].samples.t_ns[0]) * NS


def _unit(unit: UnitFit, own_p: float) -> dict:
    place, clock = unit.place, unit.place.clock
    return {
        "number": unit.number,
        "serial": unit.session.config.sensor.serial,
        "clock": {
            "offset_s": clock.offset_s,
            "offset_sigma_s": clock.offset_sigma_s,
            "rate_ppm": clock.rate * 1e6,
            "rate_sigma_ppm": clock.rate_sigma * 1e6,
            "about_s": clock.about_s,
        },
        "mounting": {
            "rotvec_deg": Rotation.from_matrix(place.mounting).as_rotvec() / DEG,
            "sigma_deg": sigmas_in(place.mounting_covariance) / DEG,
            "matrix": place.mounting,
        },
        "position": {
            "metres": place.position_m,
            "sigma_m": None if place.position_covariance is None else sigmas_in(place.position_covariance),
        },
        "closure": {
            "alone_rms_deg": unit.closure_rad / DEG,
            "floor_rms_deg": unit.floor_rad / DEG,
            "own_rms_deg": unit.own_rad[0] / DEG,
            "own_sigma_deg": unit.own_rad[1] / DEG,
            "own_p_value": own_p,
            "minus_mean_rms_deg": unit.minus_mean_rad / DEG,
        },
        "noise": {
            "gyro_dps_rthz": unit.noise.gyro / DEG,
            "accel_g_rthz": unit.noise.accel / G,
            "bias_instability_dph": unit.instability.rps / DEG_PER_HOUR,
        },
        "E": unit.model.E,
        "B_dps": unit.model.B / DEG,
        "E_sigma": unit.sigma[MATRIX].reshape(3, 3),
        "B_sigma_dps": unit.sigma[BIAS] / DEG,
        "E_sigma_alone": unit.sigma_alone[MATRIX].reshape(3, 3),
        "B_sigma_alone_dps": unit.sigma_alone[BIAS] / DEG,
        "unobserved": unit.unobserved,
        "closure_runs": [
            {"file": run.file, "duration_s": run.duration_s, "rmse_deg": run_figures(error)["rmse_deg"]} for run, error in unit.runs
        ],
        "model": f"unit{unit.number}/{MODEL}",
    }


def split_to_json(split: VarianceSplit) -> dict:
    """Return ``split``: the tilt error common to all units, rms a turn, and its part predicted from fast motion."""
    return {
        "common_rms_deg": split.common / DEG,
        "common_p_value": split.p_value,
        "common_upper95_deg": split.common_upper / DEG,
        "equal_in_all_turns_deg": {"size": split.turn[0] / DEG, "sigma": split.turn[1] / DEG},
        "undersampled_deg": {
            "size": split.fast[0] / DEG,
            "sigma": split.fast[1] / DEG,
            "predicted": split.predicted / DEG,
        },
        "level_acceleration_mg": {"size": 1e3 * split.level_mps2[0] / G, "sigma": 1e3 * split.level_mps2[1] / G},
        "is_fast_motion": split.is_fast_motion,
        "minus_mean_rms_deg": split.minus_mean_rad / DEG,
        "description": split.words,
    }


def event_to_json(event: ArrayEvent, fit: ArrayFit) -> dict:
    """Return one of ``events``: turns in degrees, stills in mg; unit is null for an event of all."""
    turn = "turn" in event.what
    return {
        "what": event.what,
        "unit": None if event.unit is None else fit.units[event.unit].number,
        "rival": None if event.rival is None else fit.units[event.rival].number,
        "at_s": float(fit.same.time_s[event.first, 1 if turn else 0]) - begins_s(fit),
        "size": event.size / DEG if turn else 1e3 * event.size / G,
        "unit_of_size": "deg" if turn else "mg",
        "p_value": event.p_value,
    }


def unit_table(fit: ArrayFit, unit: UnitFit) -> dict:
    """Return ``tinygc-model/1`` of one unit, as the fit of a single session writes it: for its own log, in seconds of its own clock, whose
    rate may differ from the array's."""
    pace = 1 + unit.place.clock.rate
    return models.to_dict(
        LinearModel(unit.model.E * pace, unit.model.B * pace),
        method="least_squares",
        session=fit.array.name,
        sha256=input_hashes(unit.session),
        version=VERSION,
        sensor=sensor_table(unit.session.config.sensor),
        accelerometer=accelerometer_table(unit.accelerometer),
        covariance=unit.covariance[:PARAMETERS, :PARAMETERS] * pace**2,
        unobserved=unit.unobserved,
    )


def save_array(fit: ArrayFit, folder: Path) -> Path:
    """Write ``array.json``, ``model_array.json``, and each unit's ``unit3/model_least_squares.json``, into a folder; return it."""
    with result_folder(folder):
        for unit in fit.units:
            with result_folder(folder / f"unit{unit.number}"):
                write_whole(folder / f"unit{unit.number}" / MODEL, unit_table(fit, unit))
        write_whole(folder / FUSED, fit.fused)
        write_whole(folder / NAME, array_to_json(fit))
    return folder
