"""``fit`` of an array: calibration and extrinsics of every unit, and the residuals of its turns, split into common and individual parts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from session import VERSION
from session.base.files import result_folder
from session.base.numeric import rms_of, sigmas_in
from session.base.progress import Reporter, no_report
from session.base.records import in_unit, plain, write_whole
from session.base.units import DEG, DEG_PER_HOUR, NS, G
from session.log.config import Accelerometer
from session.log.folder import hash_of_log, input_hashes
from tinygc import models
from tinygc.closure.least_squares import OBSERVED_BELOW
from tinygc.closure.residual import closure_angles
from tinygc.closure.runs import ClosureRun, read_closure_runs
from tinygc.estimation.bias import closes_better, less_by_chance, tilt_rms
from tinygc.estimation.choice import run_figures
from tinygc.features.arrays.clocks import UnitPlace
from tinygc.features.arrays.events import ArrayEvent
from tinygc.features.arrays.extrinsics import clock_fits, places_of
from tinygc.features.arrays.joint import Joint, estimate, unit_block, units_covariance
from tinygc.features.arrays.latency import SampleAges, ages_of, corrected
from tinygc.features.arrays.model import ArrayModel, FusedUnit, with_best_weights
from tinygc.features.arrays.positions import ArrayMotion, positions
from tinygc.features.arrays.recording import ArraySession
from tinygc.features.arrays.split import Split
from tinygc.features.arrays.system import MOUNTING, PER_UNIT, accelerometer_after
from tinygc.features.arrays.units import ArrayUnit, SameStills, prepare_units, same_stills
from tinygc.inference.choose import Statement
from tinygc.library.records import Shown
from tinygc.models.linear import BIAS, MATRIX, NAMES, PARAMETERS, PRIOR_SIGMA, LinearModel
from tinygc.models.model import accelerometer_table, sensor_table
from tinygc.noise.components import undersampling
from tinygc.noise.twin import Twin
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.terminal import Group, Text, one_line

SCHEMA = "tinygc-array-fit/2"
NAME = "array.json"
#: all units as one gyroscope
FUSED = "model_array.json"
MODEL = "model_least_squares.json"
#: most steps of readings that are listed one by one
MOST_STEPS = 12


@dataclass(frozen=True, eq=False)
class UnitFit(ArrayUnit):
    """Result of one unit, of its session as recorded, with its place refined.

    model: omega = E m + B in the unit's body frame, in seconds of the array's clock; accelerometer; covariance (24, 24) of E, B, the
    accelerometer's nine and the mounting's three (rad about the array's axes); alone: the same twelve by the unit's own gravity alone, and
    its covariance_alone (12, 12); runs: its closure runs, each with the error (3,) rad at its end.
    """

    model: LinearModel
    accelerometer: Accelerometer
    covariance: np.ndarray
    alone: LinearModel
    covariance_alone: np.ndarray
    runs: tuple[tuple[ClosureRun, np.ndarray], ...] = ()

    @cached_property
    def closure_rad(self) -> float:
        """Return the rms of tilt by its own calibration alone."""
        return tilt_rms(closure_angles(self.problem.batch, self.problem.first))

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

    def fused(self) -> FusedUnit:
        """Return it as one of the units of a fused gyroscope, whose weights are yet to be found."""
        return FusedUnit(
            **vars(self.place),
            E=self.model.E,
            B=self.model.B,
            covariance=self.covariance[:PARAMETERS, :PARAMETERS],
            noise_density_rps_rthz=np.asarray(self.problem.noise.gyro, dtype=float),
            bias_instability_rps=np.full(3, self.problem.instability.rps) if self.problem.instability.rps > 0 else None,
            accel_noise_density_mps2_rthz=rms_of(self.problem.noise.accel) or None,
            weights=np.eye(3),
            sha256=tuple(hash_of_log(log) for log in (*self.session.logs, *self.session.closures)),
            sensor=self.session.config.sensor,
            accelerometer=None if self.accelerometer.source == "none" else self.accelerometer,
        )


@dataclass(frozen=True, eq=False, repr=False)
class ArrayFit(Shown):
    """Result of an array's fit, in SI; ``summary()``, ``to_json()``, ``save(folder)``.

    array; units that were used; left_out: the reason why one was not, by number; covariance (24 N, 24 N) of all units' numbers; bias: its
    source, and bias_p, the p-value of the stills' advantage, None if the source was requested; joint; split; ages of the units'
    readings, where one reader stamped them.
    """

    array: ArraySession
    units: tuple[UnitFit, ...]
    left_out: dict[int, str]
    covariance: np.ndarray
    bias: str
    bias_p: float | None
    joint: Joint
    split: Split
    ages: tuple[SampleAges, ...] = ()

    def __repr__(self) -> str:
        return f"<ArrayFit {self.array.name}: units {', '.join(map(str, self.numbers))}>"

    @property
    def same(self) -> SameStills:
        """Return the stills and turns that the units have in common."""
        return self.joint.same

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the units that were used."""
        return tuple(unit.number for unit in self.units)

    @property
    def begins_s(self) -> float:
        """Return the time of the first sample, s of the array's clock."""
        return float(self.array.units[0].logs[0].samples.t_ns[0]) * NS

    @cached_property
    def fused(self) -> ArrayModel:
        """Return all units as one gyroscope."""
        rows = np.concatenate([np.arange(PARAMETERS) + PER_UNIT * i for i in range(len(self.units))])
        rate_hz = 1 / self.units[0].session.logs[0].samples.period_s
        return with_best_weights([unit.fused() for unit in self.units], rate_hz, self.covariance[np.ix_(rows, rows)], self.array.name)

    @property
    def page(self) -> Group:
        """Return the command's output: extrinsics, closure, common errors, events, and what was left out."""
        return _page(self)

    def to_json(self) -> dict:
        """Return ``tinygc-array-fit/2`` (docs/formats.md); angles in degrees, times in s of the array's clock from its first sample."""
        common, sigma, own = self.split.turns()
        at_s = self.same.time_s[self.same.spans[:, 0], 1] - self.begins_s
        lengths = (at_s, np.linalg.norm(common, axis=1) / DEG, np.linalg.norm(sigma, axis=1) / DEG, own / DEG)
        names = ("at_s", "common_deg", "common_sigma_deg", "own_deg")
        return plain(
            {
                "schema": SCHEMA,
                "array": self.array.name,
                "units": [_unit(unit, self.split, i) for i, unit in enumerate(self.units)],
                "left_out": self.left_out_table,
                "turns_used": [len(rows) for rows in self.same.turns],
                "bias_from": {"used": self.bias, "p_value": self.bias_p},
                "read_latency": [{"number": n, "beat_hz": hz, "period_s": period_s} for n, hz, period_s in self.beats],
                "split": self.split.table(),
                "turns": [dict(zip(names, row, strict=True)) for row in zip(*lengths, strict=True)],
                "events": [event.table(self.begins_s) for event in self.joint.events],
                "version": VERSION,
            }
        )

    @property
    def beats(self) -> list[tuple[int, float, float]]:
        """Return the number, the beat, Hz, and the period, s, of each unit whose readings wait for their reader."""
        return [(each.number, each.track.beat[0], each.period_s) for each in self.ages if each.track is not None]

    @property
    def left_out_table(self) -> list[dict]:
        """Return ``left_out`` of the JSON."""
        return [{"number": number, "why": why} for number, why in self.left_out.items()]

    def save(self, folder: Path | str | None = None) -> Path:
        """Write ``array.json``, ``model_array.json``, and each unit's ``unit3/model_least_squares.json``, into a folder (``fit`` in the
        array's); return it."""
        folder = self.array.own_folder("fit") if folder is None else Path(folder)
        with result_folder(folder):
            for unit in self.units:
                with result_folder(folder / f"unit{unit.number}"):
                    write_whole(folder / f"unit{unit.number}" / MODEL, _model_table(unit, self.array.name))
            write_whole(folder / FUSED, self.fused)
            write_whole(folder / NAME, self.to_json())
        return folder


def fit_array(
    array: ArraySession,
    *,
    bias: str = "auto",
    use_earth: bool = True,
    accelerometer: str = "auto",
    progress: Reporter = no_report,
) -> ArrayFit:
    """Estimate all units jointly.

    The latencies of readings that beat against the reader are subtracted from their stamps.  bias: source of each turn's bias, ends, stills
    or auto: the stills, if they reduce the units' own errors significantly; accelerometer as in ``prepare``.  Raises the errors of
    ``places_of``, and FitError where fewer than two units can be used or they have no turns in common.
    """
    progress("clocks and mountings")
    ages = ages_of(array, clock_fits(array)) if of_one_reader(array) else ()
    sampled = corrected(array, ages) if any(each.track for each in ages) else array
    units, left = prepare_units(sampled, places_of(sampled), use_earth=use_earth, accelerometer=accelerometer, progress=progress)
    same = same_stills(units)
    progress("motion beyond the data rate")
    missed = missed_between(units, same)
    chosen, p_value, joint = _by_bias(units, same, missed, bias, use_earth, progress)
    progress("positions")
    where = positions(ArrayMotion.of(units, joint))
    covariance = units_covariance(units, joint)
    recorded = dict(zip(array.numbers, array.units, strict=True))
    found = []
    for i, unit in enumerate(units):
        progress(f"unit {unit.number} alone")
        block = unit_block(covariance, i)
        position_m, spread = where[i] or (None, None)
        place = replace(unit.place, position_m=position_m, position_covariance=spread)
        if i:
            place = replace(place, mounting=joint.state.mountings[i], mounting_covariance=block[MOUNTING, MOUNTING])
        found.append(
            UnitFit(
                unit.number,
                recorded[unit.number],
                place,
                unit.prepared,
                joint.models[i],
                accelerometer_after(unit, joint.state.accelerometers[i]),
                block,
                *fit_alone(unit, chosen, use_earth),
                runs=tuple((run, run.errors(joint.models[i])) for run in read_closure_runs(unit.problem)),
            )
        )
    split = Split(joint, tuple(unit.number for unit in units), np.array([unit.problem.floor.tilt_rms for unit in found]))
    return ArrayFit(array, tuple(found), left, covariance, chosen, p_value, joint, split, ages)


def of_one_reader(array: ArraySession) -> bool:
    """Return whether all units have identical stamps: one reader stamped them, and readings may be older than their stamps."""
    stamps = [[log.samples.t_ns for log in unit.logs] for unit in array.units]
    return all(len(mine) == len(stamps[0]) and all(map(np.array_equal, mine, stamps[0])) for mine in stamps)


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
    units: list[ArrayUnit], same: SameStills, missed: np.ndarray, bias: str, use_earth: bool, progress: Reporter
) -> tuple[str, float | None, Joint]:
    """Return the biases' source, the p-value of the stills' advantage, and the estimate with that source."""
    names = ("ends", "stills") if bias == "auto" else (bias,)
    both = {name: estimate(units, same, missed, bias=name, use_earth=use_earth, progress=progress) for name in names}
    if bias != "auto":
        return bias, None, both[bias]
    ends, stills = (np.concatenate([joint.solution.blocks(rows)[1] for rows in joint.layout.closure]) for joint in both.values())
    chosen = "stills" if closes_better(ends, stills) else "ends"
    return chosen, less_by_chance(ends, stills), both[chosen]


def fit_alone(unit: ArrayUnit, bias: str, use_earth: bool) -> tuple[LinearModel, np.ndarray]:
    """Estimate one unit in the same way, without the other units as reference: its model, and the covariance (12, 12) of its numbers."""
    by_itself = replace(unit, place=UnitPlace(unit.number))
    same = same_stills([by_itself])
    joint = estimate([by_itself], same, np.zeros(len(same) - 1), bias=bias, alone=True, use_earth=use_earth)
    return joint.models[0], units_covariance([by_itself], joint)[:PARAMETERS, :PARAMETERS]


# An array's fit as JSON, and each unit's model as ``tinygc-model/1``.


def _unit(unit: UnitFit, split: Split, i: int) -> dict:
    place, clock = unit.place, unit.place.clock
    own, sigma = split.own_rad[i]
    angles = {"alone_rms_deg": unit.closure_rad, "floor_rms_deg": unit.problem.floor.tilt_rms, "own_rms_deg": own, "own_sigma_deg": sigma}
    return {
        "number": unit.number,
        "serial": unit.session.config.sensor.serial,
        "clock": {
            **{name: getattr(clock, name) for name in ("offset_s", "offset_sigma_s", "about_s")},
            "rate_ppm": clock.rate * 1e6,
            "rate_sigma_ppm": clock.rate_sigma * 1e6,
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
        "closure": in_unit(DEG, **angles, minus_mean_rms_deg=split.minus_mean_rad[i]) | {"own_p_value": split.own_p[i]},
        "noise": {
            "gyro_dps_rthz": unit.problem.noise.gyro / DEG,
            "accel_g_rthz": unit.problem.noise.accel / G,
            "bias_instability_dph": unit.problem.instability.rps / DEG_PER_HOUR,
        },
        "E": unit.model.E,
        "E_sigma": unit.sigma[MATRIX].reshape(3, 3),
        "E_sigma_alone": unit.sigma_alone[MATRIX].reshape(3, 3),
        **in_unit(DEG, B_dps=unit.model.B, B_sigma_dps=unit.sigma[BIAS], B_sigma_alone_dps=unit.sigma_alone[BIAS]),
        "unobserved": unit.unobserved,
        "closure_runs": [
            {"file": run.file, "duration_s": run.duration_s, "rmse_deg": run_figures(error)["rmse_deg"]} for run, error in unit.runs
        ],
        "model": f"unit{unit.number}/{MODEL}",
    }


def _model_table(unit: UnitFit, array: str) -> dict:
    """Return ``tinygc-model/1`` of one unit, as the fit of a single session writes it: for its own log, in seconds of its own clock, whose
    rate may differ from the array's."""
    pace = 1 + unit.place.clock.rate
    return models.to_dict(
        LinearModel(unit.model.E * pace, unit.model.B * pace),
        method="least_squares",
        session=array,
        sha256=input_hashes(unit.session),
        version=VERSION,
        sensor=sensor_table(unit.session.config.sensor),
        accelerometer=accelerometer_table(unit.accelerometer),
        covariance=unit.covariance[:PARAMETERS, :PARAMETERS] * pace**2,
        unobserved=unit.unobserved,
    )


# Terminal output of an array's fit.


def _page(fit: ArrayFit) -> Group:
    split, units = fit.split, fit.units
    closures, floors = (
        [value / DEG for value in sizes] for sizes in zip(*((u.closure_rad, u.problem.floor.tilt_rms) for u in units), strict=True)
    )
    alone = rms_of([rms_of(sigmas_in(unit.in_array(unit.noise_density_rps_rthz))) for unit in fit.fused.units])
    answer = (
        f"{len(units)} units: closure {min(closures):.4f} to {max(closures):.4f}° (floor {rms_of(floors):.4f}°); "
        f"together {alone / rms_of(fit.fused.noise_density):.2f} × less noise"
    )
    header: tuple[str, ...] = ("unit", "clock, ms", "rate, ppm", "mounting x, y, z, °", "± °", "position, mm", "± mm", "serial")
    rows = [[units[0].number, "0", "0", "0, 0, 0", None, "0, 0, 0", None, units[0].session.config.sensor.serial], *map(_place, units[1:])]
    places = Table("Units against the first", header, rows, left=(0, 7), minor=(4, 6, 7))
    header = ("unit", "closure, °", "floor", "own error", "scale alone, ppm", "in the array")
    rows = []
    for unit, closure, floor, own in zip(units, closures, floors, split.own_rad, strict=True):
        scales = (f"± {rms_of(s[[0, 4, 8]]) * 1e6:.0f}" for s in (unit.sigma_alone, unit.sigma))
        rows.append([unit.number, f"{closure:.4f}", f"{floor:.4f}", tuple(own / DEG), *scales])
    lines = [sentence(split.common)]
    for unit in units:
        runs = ", ".join(f"{run_figures(error)['rmse_deg']:.4f}°" for _, error in unit.runs)
        lines += [f"Closure of unit {unit.number} over the closure run: {runs}."] if runs else []
        lines += [f"Unit {unit.number}: not observed: {', '.join(unit.unobserved)}."] if unit.unobserved else []
    if fit.beats:
        ages = ", ".join(f"unit {number} ({hz:.3g} Hz)" for number, hz, _ in fit.beats)
        lines.append(f"Readings wait for the reader, and their ages beat: {ages}; the stamps were corrected.")
    tables = [places, Table("", header, rows)]
    return screen([one_line(answer, "bold"), *tables, *map(one_line, lines), *events_and_left_out(fit)])


def _place(unit: UnitFit) -> list[Any]:
    place, clock = unit.place, unit.place.clock
    turn = Rotation.from_matrix(place.mounting).as_rotvec() / DEG
    where, known = "not observed", None
    if place.position_m is not None and place.position_covariance is not None:
        where = ", ".join(f"{x * 1e3:.1f}" for x in place.position_m)
        known = f"{rms_of(sigmas_in(place.position_covariance)) * 1e3:.1f}"
    return [
        unit.number,
        (clock.offset_s * 1e3, clock.offset_sigma_s * 1e3),
        (clock.rate * 1e6, clock.rate_sigma * 1e6),
        ", ".join(f"{x:.3f}" for x in turn),
        f"{rms_of(sigmas_in(place.mounting_covariance)) / DEG:.3f}",
        where,
        known,
        unit.session.config.sensor.serial,
    ]


def sentence(statement: Statement) -> str:
    """A statement as a sentence."""
    return f"{statement.words[0].upper()}{statement.words[1:]}."


def events_and_left_out(fit: ArrayFit, steps: tuple[ArrayEvent, ...] = ()) -> list[Text]:
    """Return a line for each step and event, one for several units with events in one turn or still, and one for each unit left out."""
    events = fit.joint.events
    lines = [f"{each.at_s - fit.begins_s:.2f} s: {each.words(events, len(fit.units))}." for each in (*steps[:MOST_STEPS], *events)]
    lines += [f"and {len(steps) - MOST_STEPS} moments more, in array.json."] if len(steps) > MOST_STEPS else []
    left_out = (f"Left out: unit {number}: {why}" for number, why in fit.left_out.items())
    return [*(one_line(line, "yellow") for line in dict.fromkeys(lines)), *(one_line(line, "bold red") for line in left_out)]
