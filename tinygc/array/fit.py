"""``fit`` of an array: from its recording to every unit's calibration and place, and to what its turns miss by, in common and alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_triangular

from session.checks.findings import Finding
from session.detect.stills import Noise
from session.log.array_session import ArraySession
from session.log.config import Accelerometer
from session.log.folder import Session
from tinygc.array.ages.ages import SampleAges, ages_of, corrected
from tinygc.array.fused.from_fit import array_model_of
from tinygc.array.fused.model import ArrayModel
from tinygc.array.joint.joint import Joint, estimate
from tinygc.array.joint.parameters import unit_block, units_covariance
from tinygc.array.joint.position import positions
from tinygc.array.joint.same_stills import SameStills, same_stills
from tinygc.array.joint.split import Split, split_of
from tinygc.array.joint.state import MOUNTING
from tinygc.array.joint.unit_rows import accelerometer_after
from tinygc.array.joint.units import ArrayUnit, LeftOutUnit, prepare_units
from tinygc.array.places.place import UnitPlace
from tinygc.array.places.places import clock_fits, places_of
from tinygc.closure.bias_wander import BiasInstability
from tinygc.closure.least_squares import OBSERVED_BELOW
from tinygc.closure.residual import closure_angles
from tinygc.explanation.noise.undersampling import undersampling
from tinygc.explanation.twin.twin import Twin
from tinygc.fitting.bias_choice import BETTER_P, less_by_chance
from tinygc.models.linear import NAMES, PARAMETERS, PRIOR_SIGMA, LinearModel
from tinygc.problem.closure_run import ClosureRun, read_closure_runs

if TYPE_CHECKING:
    from tinygc.closure.floor import Floor

#: where each turn's bias is from; auto: the stills, where the units' own errors are less by more than chance
BIASES = ("auto", "ends", "stills")


@dataclass(frozen=True, eq=False)
class UnitFit:
    """Of one unit.

    number; session as recorded; place: clock, mounting and position, refined; model: omega = E m + B in the unit's body frame, in
    seconds of the array's clock; accelerometer; covariance (24, 24) of E, B, the accelerometer's nine and the mounting's three (rad about
    the array's axes); alone: the same twelve by the unit's own gravity alone, and its covariance_alone (12, 12); own_rad: tilt, rms a
    turn, by which it misses alone beyond noise, with its sigma; closure_rad, floor_rad: rms of tilt by its own calibration alone, and what
    white noise makes of it; noise; instability; warnings of its first look; runs: its closure runs, each with the error (3,) rad at
    its end.
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
    warnings: tuple[Finding, ...]
    runs: tuple[tuple[ClosureRun, np.ndarray], ...] = ()

    @property
    def sigma(self) -> np.ndarray:
        """(12,) of the model's numbers."""
        return np.sqrt(np.diag(self.covariance))[:PARAMETERS]

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Names of the model's numbers that neither this unit's turns nor the others tell."""
        return tuple(name for name, s, prior in zip(NAMES, self.sigma, PRIOR_SIGMA, strict=True) if s > OBSERVED_BELOW * prior)

    @property
    def sigma_alone(self) -> np.ndarray:
        """(12,) of the same by the unit's own gravity alone."""
        return np.sqrt(np.diag(self.covariance_alone))

    @property
    def best_gain(self) -> float:
        """By how much less the array's sigma is, in that direction of the twelve in which the others tell most: yaw about the vertical."""
        factor = np.linalg.cholesky(self.covariance[:PARAMETERS, :PARAMETERS])
        white = solve_triangular(factor, self.covariance_alone, lower=True)
        return float(np.sqrt(np.linalg.eigvalsh(solve_triangular(factor, white.T, lower=True))[-1]))


@dataclass(frozen=True, eq=False)
class ArrayFit:
    """array; units that were used, and left_out; covariance (24 N, 24 N) of all units' numbers; bias: where it is from, and bias_p of the
    stills being better by chance, None where it was asked for; joint; split."""

    array: ArraySession
    units: tuple[UnitFit, ...]
    left_out: tuple[LeftOutUnit, ...]
    covariance: np.ndarray
    bias: str
    bias_p: float | None
    joint: Joint
    split: Split
    prepared: tuple[ArrayUnit, ...]
    ages: tuple[SampleAges, ...] = ()

    def __repr__(self) -> str:
        return f"<ArrayFit {self.array.name}: units {', '.join(str(unit.number) for unit in self.units)}>"

    @property
    def same(self) -> SameStills:
        """Stills and turns that the units have in common."""
        return self.joint.same

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Of the units that were used."""
        return tuple(unit.number for unit in self.units)

    @cached_property
    def fused(self) -> ArrayModel:
        """All units as one gyroscope."""
        return array_model_of(self.array, self.units, self.covariance)


def fit_array(
    array: ArraySession,
    *,
    places: tuple[UnitPlace, ...] | None = None,
    bias: str = "auto",
    with_ages: bool = True,
    use_earth: bool = True,
    accelerometer: str = "auto",
    progress: Callable[[str], None] = lambda what: None,
) -> ArrayFit:
    """Estimate all units jointly.

    places: where clocks and mountings are known already; with_ages: whether ages of readings that beat against the reader are taken off
    their stamps; bias: of ``BIASES``; accelerometer as of ``prepare``.  Raises the errors of
    ``places_of``, and FitError where fewer than two units can be used or their turns are not the same.
    """
    progress("clocks and mountings")
    ages = ages_of(array, clock_fits(array)) if with_ages and places is None and _one_reader(array) else ()
    sampled = corrected(array, ages) if any(each.found for each in ages) else array
    units, left = prepare_units(sampled, places or places_of(sampled), use_earth=use_earth, accelerometer=accelerometer, progress=progress)
    same = same_stills(units)
    progress("motion beyond the data rate")
    missed = missed_between(units, same)
    chosen, p_value, joint = _by_bias(units, same, missed, bias, use_earth, progress)
    progress("positions")
    where = positions(units, joint)
    covariance = units_covariance(units, joint)
    split = split_of(joint)
    recorded = dict(zip(array.numbers, array.units, strict=True))
    found = []
    for i, unit in enumerate(units):
        progress(f"unit {unit.number} alone")
        alone, apart = _alone(unit, chosen, use_earth)
        block = unit_block(covariance, i)
        known = where[i]
        place = replace(
            unit.place,
            mounting=joint.state.mountings[i] if i else np.eye(3),
            mounting_covariance=block[MOUNTING, MOUNTING] if i else np.zeros((3, 3)),
            position_m=None if known is None else known[0],
            position_covariance=None if known is None else known[1],
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
                closure_rad=_rms(closure_angles(problem.batch, problem.first)),
                floor_rad=_floor(problem.floor),
                noise=problem.noise,
                instability=problem.instability,
                warnings=tuple(unit.prepared.warnings),
                runs=tuple((run, run.errors(joint.models[i])) for run in read_closure_runs(problem)),
            )
        )
    return ArrayFit(
        array,
        tuple(found),
        tuple(left),
        covariance,
        chosen,
        p_value,
        joint,
        split,
        tuple(units),
        tuple(each for each in ages if each.found),
    )


def _one_reader(array: ArraySession) -> bool:
    """Whether all units have the very same stamps: then one reader gave them, and readings may be older than they say."""
    first = array.units[0].logs
    return all(
        len(unit.logs) == len(first)
        and all(np.array_equal(one.samples.t_ns, other.samples.t_ns) for one, other in zip(first, unit.logs, strict=True))
        for unit in array.units[1:]
    )


def missed_between(units: list[ArrayUnit], same: SameStills) -> np.ndarray:
    """(Q-1,) rad of each angle: tilt that motion beyond the data rate is predicted to make each unit miss, the mean of all units' own."""
    square, count = np.zeros(len(same) - 1), np.zeros(len(same) - 1)
    for i, unit in enumerate(units):
        each = undersampling(Twin(unit.problem)).predicted_rad
        for row, a, b in zip(same.turns[i], same.first[i], same.last[i], strict=True):
            square[a:b] += each[row] ** 2 / (b - a)
            count[a:b] += 1
    return np.sqrt(square / np.maximum(count, 1))


def _by_bias(
    units: list[ArrayUnit], same: SameStills, missed: np.ndarray, bias: str, use_earth: bool, progress: Callable[[str], None]
) -> tuple[str, float | None, Joint]:
    """The biases' source, p-value of the stills being better by chance, and the estimate with it."""
    if bias != "auto":
        return bias, None, estimate(units, same, missed, bias=bias, use_earth=use_earth, progress=progress)
    both = {name: estimate(units, same, missed, bias=name, use_earth=use_earth, progress=progress) for name in ("ends", "stills")}
    left = {name: np.concatenate([joint.solution.blocks(rows)[1] for rows in joint.where.closure]) for name, joint in both.items()}
    p_value = less_by_chance(left["ends"], left["stills"])
    chosen = "stills" if p_value < BETTER_P else "ends"
    return chosen, p_value, both[chosen]


def _alone(unit: ArrayUnit, bias: str, use_earth: bool) -> tuple[LinearModel, np.ndarray]:
    """The same estimate of one unit, for which no other unit is a reference."""
    by_itself = replace(unit, place=UnitPlace(unit.number))
    same = same_stills([by_itself])
    joint = estimate([by_itself], same, np.zeros(len(same) - 1), bias=bias, alone=True, use_earth=use_earth)
    return joint.models[0], units_covariance([by_itself], joint)[:PARAMETERS, :PARAMETERS]


def _rms(angles: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(angles[:, :2] ** 2, axis=1))))


def _floor(floor: Floor) -> float:
    return floor.tilt_rms
