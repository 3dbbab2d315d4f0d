"""What the hand does in a session: still - turn - still - … - still, then the closure run.  Data; ``motion`` moves along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.stroke import GimbalTurn, Stroke, gimbal_angles

# The hand: estimates from turning a small three-axis table; peak rates of 60 to 350 dps come out of them.
TURN_SPREAD = 0.13  #: a turn lasts its usual time, give or take this fraction
DEAD_TIME = 1.0  #: of still_s, at most: what the hand waits between two turns beyond the two stills
GIMBALS_AT_ONCE = (0.4, 0.35, 0.25)  #: how often a turn moves one, two, three gimbals
LATE_S = 0.25  #: a second gimbal sets off up to this later and stops up to this earlier
TURN_CHANGE_RAD = (90 * DEG, 300 * DEG)  #: a gimbal's change in a turn
TRAVEL_RAD = 400 * DEG  #: a turn that would end further from a gimbal's zero goes the other way: cables
PEAK_RPS = 350 * DEG  #: the fastest that a hand turns the table
PEAK_FULL_SCALE = 0.85  #: of full scale; room for bias and sensitivity below 0.9
# Irregularity of a stroke: slow waves in proportion to its change, tremor in rad (physiological tremor: 4 to 12 Hz).
SLOW_WAVES, SLOW_HZ, SLOW_FRACTION = 3, (0.5, 1.6), 0.03
TREMOR_WAVES, TREMOR_HZ, TREMOR_RAD = 2, (4.0, 9.0), 0.06 * DEG
# Closure run: every gimbal in strokes that overlap by half, so that the table never rests before the end.
CLOSURE_STILL = (1.2, 2.0)  #: of still_s, at both ends
CLOSURE_STROKE_S = 1.5  #: from the start of one stroke to that of the next, about
CLOSURE_RANGE_RAD = 120 * DEG  #: how far a gimbal wanders from where it began

CHECK_S = 5e-3  #: grid on which a movement's peak rate is looked for; short beside the tremor


@dataclass(frozen=True, eq=False)
class Plan:
    """Rests and turns of one session, in s since the log's first sample.

    start_rad (3,) the gimbals' first angles, outer middle inner; turns (start, stop) of each movement in the log; log_s the log's
    length; closure (start, stop) of the closure run's movement, or None; duration_s the whole, log and closure run.
    """

    start_rad: np.ndarray
    strokes: tuple[GimbalTurn, ...]
    turns: tuple[tuple[float, float], ...]
    log_s: float
    closure: tuple[float, float] | None
    duration_s: float


def hand_plan(options: SimulationOptions, rng: np.random.Generator) -> Plan:
    """Draw a plan: random targets that cover the attitudes, turns in both senses about one, two or three gimbals at once."""
    log_rng, closure_rng = rng.spawn(2)  # the closure run does not change with the number of segments
    limit_rps = min(PEAK_RPS * options.vigour, PEAK_FULL_SCALE * options.gyro_fs_dps * DEG)
    start_rad = log_rng.uniform(-np.pi, np.pi, 3)
    if options.with_heading:
        # A heading is of use only to a session that begins at the table's index: outer gimbal at zero, not upside down.
        start_rad *= 0.0, 0.5, 1.0
    angles, strokes, turns = start_rad.copy(), [], []
    clock_s = rest_s(options, log_rng)
    for _ in range(options.segments):
        duration_s = options.turn_s * log_rng.uniform(1 - TURN_SPREAD, 1 + TURN_SPREAD)
        movement = not_faster(_turn(angles, clock_s, duration_s, options.vigour, log_rng), limit_rps)
        for stroke in movement:
            angles[stroke.gimbal] += stroke.change_rad
        strokes += movement
        turns.append((clock_s, clock_s + duration_s))
        clock_s += duration_s + rest_s(options, log_rng)
    log_s, closure = clock_s, None
    if options.closure_s > 0:
        before_s, after_s = options.still_s * closure_rng.uniform(*CLOSURE_STILL, 2)
        closure = (log_s + before_s, log_s + options.closure_s - after_s)
        strokes += not_faster(_closure_run(*closure, options.vigour, closure_rng), limit_rps)
    return Plan(start_rad, tuple(strokes), tuple(turns), log_s, closure, log_s + options.closure_s)


def rest_s(options: SimulationOptions, rng: np.random.Generator) -> float:
    """The still that ends one turn, the still that begins the next, and some dead time, s."""
    return options.still_s * (2 + rng.uniform(0, DEAD_TIME))


def _turn(angles_rad: np.ndarray, start_s: float, duration_s: float, vigour: float, rng: np.random.Generator) -> list[Stroke]:
    count = 1 + rng.choice(3, p=GIMBALS_AT_ONCE)
    strokes: list[Stroke] = []
    for gimbal in rng.permutation(3)[:count]:
        change = vigour * rng.uniform(*TURN_CHANGE_RAD) * rng.choice((-1, 1))
        if abs(angles_rad[gimbal] + change) > TRAVEL_RAD:
            change = -change
        # The first gimbal spans the turn: its bounds are the movement's.
        late_s, early_s = rng.uniform(0, min(LATE_S, 0.1 * duration_s), 2) if strokes else (0.0, 0.0)
        strokes.append(stroke(int(gimbal), start_s + late_s, duration_s - late_s - early_s, change, rng))
    return strokes


def _closure_run(start_s: float, stop_s: float, vigour: float, rng: np.random.Generator) -> list[Stroke]:
    """Strokes whose changes add up to nothing, gimbal by gimbal."""
    strokes = []
    for gimbal in range(3):
        steps = rng.uniform(0.7, 1.3, max(4, round((stop_s - start_s) / CLOSURE_STROKE_S)))
        knots = start_s + (stop_s - start_s) * np.concatenate([[0], np.cumsum(steps) / steps.sum()])
        targets = vigour * rng.uniform(-CLOSURE_RANGE_RAD, CLOSURE_RANGE_RAD, len(knots) - 3)
        changes = np.diff(targets, prepend=0, append=0)
        strokes += [
            stroke(gimbal, first, last - first, change, rng) for first, last, change in zip(knots[:-2], knots[2:], changes, strict=True)
        ]
    return strokes


def stroke(gimbal: int, start_s: float, duration_s: float, change_rad: float, rng: np.random.Generator) -> Stroke:
    """A stroke with its irregularity drawn: change_rad between start_s and start_s + duration_s."""
    slow_rad = abs(change_rad) * SLOW_FRACTION * rng.uniform(0, 1, SLOW_WAVES)
    tremor_rad = TREMOR_RAD * rng.uniform(0, 1, TREMOR_WAVES)
    hertz = np.concatenate([rng.uniform(*SLOW_HZ, SLOW_WAVES), rng.uniform(*TREMOR_HZ, TREMOR_WAVES)])
    phase = rng.uniform(0, 2 * np.pi, SLOW_WAVES + TREMOR_WAVES)
    return Stroke(gimbal, start_s, duration_s, change_rad, np.concatenate([slow_rad, tremor_rad]), hertz, phase)


def not_faster(strokes: list[Stroke], limit_rps: float) -> list[Stroke]:
    """The same movement, made smaller if it would exceed the limit.  The gimbals' rates add up to no less than the body's."""
    start_s, stop_s = min(stroke.start_s for stroke in strokes), max(stroke.stop_s for stroke in strokes)
    rates = gimbal_angles(np.zeros(3), tuple(strokes), np.arange(start_s, stop_s, CHECK_S))[1]
    factor = limit_rps / np.abs(rates).sum(axis=0).max()
    return strokes if factor >= 1 else [stroke.scaled(factor) for stroke in strokes]
