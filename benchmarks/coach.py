"""Does the coach help?  Coached sessions against random turning, with the same number of segments, on the same table.

Both are simulated sessions of one hand on one three-gimbal table, with the same sensor and the same noise.  Random turning is the
simulator's own hand: one to three gimbals at once, by 90 to 300 degrees each, either way.  "One axis" is a hand that turns one gimbal at a
time, as random.  The coached hand does what it is told, as well as a hand does: it turns about the axis until the side that was named is
up, all gimbals astray by 5 degrees (1 sigma), times off by 13 %; where no gimbal points the way that is asked for, another one is turned
about the vertical first.  ``--by-angle``: it turns by the angle alone, off by 10 %, and never looks which side is up.  Compared is the
worst sigma beside its target, of ``parameter_covariance`` on the recorded session.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from common import in_parallel, markdown

from session.bench.messages import AcceptedTurn, Progress
from session.bench.progress import LiveAccelerometerFit
from session.detect.segments import Segment
from session.detect.stills import Noise, Still
from session.io.config import Accelerometer, Config, Protocol, Sensor, Site
from session.io.folder import Session
from session.io.logfile import Log
from session.io.registers import DEFAULT, RegisterUnits, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.io.samples import Samples
from session.io.units import DEG, MDPS, MG, G
from tinygc.closure.build import build_problem
from tinygc.closure.floor import BiasWander, Floor
from tinygc.closure.uncertainty import parameter_covariance
from tinygc.planning.coach import Coach
from tinygc.planning.proposals import TARGETS
from tinygc.planning.turns import Turn, TurnPart
from tinygc.simulation import movement as motion
from tinygc.simulation.movement import PEAK_RPS, TURN_SPREAD, MovementPlan, not_faster, rest_s, stroke
from tinygc.simulation.options import SimulatedUnit, SimulationOptions, draw_unit
from tinygc.simulation.simulator import _streams, plan_of, simulate_session

COUNTS = (8, 12, 20, 28, 40)
RAW_MG = 30.0
ANGLE_SPREAD, STRAY_RAD = 0.10, 5 * DEG
NEAR = 0.8  #: cosine: a gimbal whose axis is further from the one that is asked for will not do
NOISE = Noise(np.full(3, 5 * MDPS), np.full(3, 0.06 * MG))


class CoachedHand:
    """Three gimbals, outer middle inner, and a hand that does what it is told.  own: an accelerometer that nobody has calibrated."""

    def __init__(self, options: SimulationOptions, own: LiveAccelerometerFit | None = None, by_angle: bool = False):
        self.own, self._unit, self._by_angle = own, simulate_unit(options), by_angle
        self._taken_turns, self._stills = [], []
        self._options, self._rng = options, np.random.default_rng([options.seed, 77])
        random = plan_of(options)
        self._start, self._clock_s = random.start_rad, random.turns[0][0]
        self._strokes, self._turns = [], []
        self._angles = self._start.copy()
        self.coach = Coach()
        first = [s for s in random.strokes if s.start_s < random.turns[0][1]]  # nobody has advice for the first turn
        self._do(first, random.turns[0][1] - random.turns[0][0])

    def plan(self, segments: int) -> MovementPlan:
        """A session of so many turns."""
        while len(self._turns) < segments:
            self._do(*self._obeyed(self.coach.best_turn(self._force(self._angles))))
        return MovementPlan(self._start, tuple(self._strokes), tuple(self._turns), self._clock_s, None, self._clock_s)

    def _obeyed(self, turn: Turn) -> tuple[list, float]:
        """The strokes of the gimbals that come nearest to the turn, and how long they take."""
        strokes, angles, begin_s = [], self._angles.copy(), self._clock_s
        for part in turn.parts:
            seconds = part.seconds * self._rng.uniform(1 - TURN_SPREAD, 1 + TURN_SPREAD)
            movement = self._part(part, angles, begin_s, seconds)
            for one in movement:
                angles[one.gimbal] += one.change_rad
            if not self._by_angle:
                missing = self._missing(angles, part.up)
                movement = movement + [stroke(gimbal, begin_s, seconds, missing[gimbal - 1], self._rng) for gimbal in (1, 2)]
                angles[1:] += missing
            strokes, begin_s = strokes + movement, begin_s + seconds
        seconds = begin_s - self._clock_s
        for gimbal in range(3):
            strokes.append(stroke(gimbal, self._clock_s, seconds, STRAY_RAD * self._rng.standard_normal(), self._rng))
        return not_faster(strokes, PEAK_RPS), seconds

    @staticmethod
    def _missing(angles: np.ndarray, up: np.ndarray) -> np.ndarray:
        """(2,) what the middle and the inner gimbal must still turn by, so that what points up is ``up``."""
        found = np.zeros(2)
        for _ in range(8):
            there, *moved = (
                motion.table_to_body((angles + np.append(0, found + step))[:, None], np.array([0.0, 0.0, -1.0]))[0]
                for step in (np.zeros(2), *(1e-6 * np.eye(2)))
            )
            slope = (np.array(moved) - there).T / 1e-6
            found += np.clip(np.linalg.lstsq(slope, up - there, rcond=1e-3)[0], -0.5, 0.5)
        return found

    def _part(self, part: TurnPart, angles: np.ndarray, begin_s: float, seconds: float) -> list:
        strokes = []
        along = self._axes(angles) @ part.axis
        if np.abs(along).max() < NEAR and abs(np.cos(angles[1])) < 0.5:
            # x stands upright: turned about it, the middle gimbal's axis comes to lie where it is wanted.
            about_x = (np.arctan2(-part.axis[2], part.axis[1]) - angles[2] + np.pi / 2) % np.pi - np.pi / 2
            strokes.append(stroke(2, begin_s, seconds / 3, about_x, self._rng))
            begin_s, seconds = begin_s + seconds / 3, seconds * 2 / 3
            along = self._axes(angles + np.array([0, 0, about_x])) @ part.axis
        gimbal = int(np.argmax(np.abs(along)))
        angle = part.angle_rad * (1 + (ANGLE_SPREAD * self._rng.standard_normal() if self._by_angle else 0.0))
        return [*strokes, stroke(gimbal, begin_s, seconds, angle * np.sign(along[gimbal]), self._rng)]

    def _do(self, strokes, seconds: float) -> None:
        before = self._angles.copy()
        for one in strokes:
            self._angles[one.gimbal] += one.change_rad
        begin_s = self._clock_s
        self._strokes += strokes
        self._turns.append((begin_s, begin_s + seconds))
        self._clock_s += seconds + rest_s(self._options, self._rng)
        turn = self._taken(strokes, before, begin_s, seconds)
        self._taken_turns.append(turn)
        for still in turn.segment.stills[len(self._stills) > 0 :]:
            self._stills.append(still)
            if self.own is not None:
                self.own.add(still)
        own = self.own is not None
        self.coach.look(Progress(tuple(self._taken_turns), tuple(self._stills), own, self.own.accelerometer if own else None))

    def _taken(self, strokes, before, begin_s: float, seconds: float) -> AcceptedTurn:
        """What the guide would hand over, but for noise and the sensor's errors."""
        t_s = np.arange(begin_s - 1.0, begin_s + seconds + 1.0, 1 / 50)
        moved = motion.move(MovementPlan(before, tuple(strokes), (), 0.0, None, 0.0), t_s)
        ends = [
            Still(0, 1, 0.0, 2.0, np.zeros(3), np.zeros(3), self._force(a), np.zeros(3), np.zeros(3), 25.0) for a in (before, self._angles)
        ]
        samples = Samples(np.rint(t_s * 1e9).astype(np.int64), moved.rate, np.zeros_like(moved.rate))
        segment = Segment(0, 0, *ends, 0, len(t_s), t_s[0], t_s[-1] - t_s[0], seconds, 90.0)
        return AcceptedTurn(segment, samples, NOISE, 1, float(t_s.mean()))

    @staticmethod
    def _axes(angles) -> np.ndarray:
        """(3, 3) the gimbals' axes in the body."""
        down = motion.table_to_body(angles[:, None], np.array([0.0, 0.0, 1.0]))[0]
        return np.array([down, [0.0, np.cos(angles[2]), -np.sin(angles[2])], [1.0, 0.0, 0.0]])

    def _force(self, angles) -> np.ndarray:
        """What the accelerometer reads there, but for noise."""
        force = motion.table_to_body(angles[:, None], np.array([0.0, 0.0, -G]))
        return (force if self.own is None else self._unit.measured_force(force))[0]


def worst_sigmas(options: SimulationOptions, plan: MovementPlan | None) -> list[float]:
    """The worst sigma beside its target after each of COUNTS segments of a recorded session."""
    simulation = simulate_session(options, plan=plan)
    log, unit = simulation.log, simulation.unit
    gyro, accel = log.gyro * gyro_rps_per_lsb(options.gyro_fs_dps), log.accel * accel_mps2_per_lsb(options.accel_fs_g)
    samples = Samples(log.t_us * 1000, gyro, accel, RegisterUnits(DEFAULT, None, None).temperature_c(log.temp.astype(float)))
    config = Config(
        Sensor("ASM330LHH", "", options.odr_hz, options.gyro_fs_dps, options.accel_fs_g),
        Accelerometer(unit.accel_matrix, unit.accel_bias),
        Site(options.latitude_deg, options.gravity_mps2),
        Protocol(options.still_s),
    )
    problem = build_problem(Session(Path(f"seed{options.seed}"), config, (Log(Path("log0001.csv"), samples),), ()))
    found = []
    for count in COUNTS:
        first = slice(0, count)
        floor = Floor(problem.floor.own[first], problem.floor.shared[: count - 1])
        covariance = parameter_covariance(
            problem.batch.pick(first),
            floor,
            problem.first,
            problem.earth,
            wander=BiasWander(problem.middle_s[first], problem.instability.rps),
        )
        found.append(float(np.max(np.sqrt(np.diag(covariance)) / TARGETS)))
    return found


def one_axis(options: SimulationOptions) -> MovementPlan:
    """The random plan with only the first gimbal of each turn, the one that spans it."""
    plan = plan_of(options)
    return replace(plan, strokes=tuple(one for one in plan.strokes if (one.start_s, one.stop_s) in {(a, b) for a, b in plan.turns}))


def one_seed(seed: int, by_angle: bool = False) -> list[list[float]]:
    """Worst sigmas of random, of one-axis and of coached turning."""
    options = SimulationOptions(segments=max(COUNTS), closure_s=0.0, seed=seed)
    coached = CoachedHand(options, by_angle=by_angle).plan(max(COUNTS))
    return [worst_sigmas(options, plan) for plan in (None, one_axis(options), coached)]


def simulate_unit(options: SimulationOptions) -> SimulatedUnit:
    """The sensor of these options."""
    return draw_unit(options, _streams(options)[0])


def falling(seed: int) -> list[list[tuple[float, float]]]:
    """Random and coached: the worst sigma of the gyroscope's twelve and of a raw accelerometer's nine, beside their targets."""
    options = SimulationOptions(segments=max(COUNTS), closure_s=0.0, seed=seed, accel_bias_mg=RAW_MG)
    found = []
    for coached in (False, True):
        hand, sigmas = CoachedHand(options, LiveAccelerometerFit(G)), []
        random = [[one for one in plan_of(options).strokes if a <= one.start_s < b] for a, b in plan_of(options).turns]
        for count in range(1, max(COUNTS) + 1):
            if coached:
                hand.plan(count)
            elif count > 1:
                shift = hand._clock_s - min(one.start_s for one in random[count - 1])
                strokes = [replace(one, start_s=one.start_s + shift) for one in random[count - 1]]
                hand._do(strokes, max(one.stop_s for one in strokes) - hand._clock_s)
            if count in COUNTS:
                sigma = hand.coach.sigma
                sigmas.append((float(sigma[:12].max()), float(sigma[12:].max())))
        found.append(sigmas)
    return found


def main() -> None:
    command = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    command.add_argument("--seeds", type=int, default=50)
    command.add_argument("--first", type=int, default=1000, help="first seed")
    command.add_argument("--raw-accelerometer", action="store_true", help="sigmas of a session that calibrates its accelerometer, too")
    command.add_argument("--by-angle", action="store_true", help="the coached hand heeds the angle, and not the side that is to be up")
    args = command.parse_args()
    if args.raw_accelerometer:
        print_falling(np.array(in_parallel(falling, range(args.first, args.first + args.seeds), "seed")))
        return
    found = np.array(in_parallel(partial(one_seed, by_angle=args.by_angle), range(args.first, args.first + args.seeds), "seed"))
    rows = []
    for i, count in enumerate(COUNTS):
        random, single, coached = found[:, :, i].T
        sigmas = [f"{np.median(sigma):.2f}" for sigma in (random, single, coached)]
        rows.append((count, *sigmas, *_share(random / coached), *_share(single / coached)))
    header = ("segments", "random", "one axis", "coached", "random / coached", "≥ 2", "one axis / coached", "≥ 2")
    print(markdown(header, rows))


def print_falling(found: np.ndarray) -> None:
    """found (seeds, 2 hands, counts, 2)."""
    rows = []
    for i, count in enumerate(COUNTS):
        cells = [f"{np.median(found[:, hand, i, k]):.2f}" for hand in (0, 1) for k in (0, 1)]
        reached = [f"{100 * np.mean(found[:, hand, i].max(axis=-1) <= 1):.0f} %" for hand in (0, 1)]
        rows.append((count, *cells, *reached))
    kinds = ("gyroscope, random", "accelerometer, random", "gyroscope, coached", "accelerometer, coached")
    print(markdown(("segments", *kinds, "enough, random", "enough, coached"), rows))


def _share(ratio: np.ndarray) -> tuple[str, str]:
    return f"{np.median(ratio):.2f} ({np.quantile(ratio, 0.1):.2f}–{np.quantile(ratio, 0.9):.2f})", f"{100 * np.mean(ratio >= 2):.0f} %"


if __name__ == "__main__":
    main()
