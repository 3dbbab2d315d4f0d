"""Movement of a simulated session: strokes of the hand, the plan of turns, exact kinematics of three gimbals."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from session.base.units import DEG, EARTH_RATE_RPS
from session.bench.guide import PEAK_FULL_SCALE
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.sensor import Motion, self_heating

# One push of the hand at one gimbal, as a function of time with exact derivatives.
#
# A hand that moves from rest to rest follows nearly a minimum-jerk profile (Flash and Hogan 1985):
# ``s(u) = u^3 (10 - 15 u + 6 u^2)``, u from 0 to 1 over the stroke.  Its irregularities, waves of half a hertz up to the
# tremor of several hertz, are added under a window ``w(u) = (4 u (1 - u))^3`` that vanishes at both ends.  So rate and
# angular acceleration begin and end at zero, and all derivatives are exact.  Longer movements are sums of overlapping strokes.


@dataclass(frozen=True, eq=False)
class Stroke:
    """A change of one gimbal's angle between start_s and start_s + duration_s.

    gimbal 0 outer, 1 middle, 2 inner; change_rad the net change; wave_rad, wave_hz, wave_phase (K,) the irregularity:
    amplitudes rad, frequencies Hz, phases rad; none by default.
    """

    gimbal: int
    start_s: float
    duration_s: float
    change_rad: float
    wave_rad: np.ndarray = field(default_factory=partial(np.zeros, 0))
    wave_hz: np.ndarray = field(default_factory=partial(np.zeros, 0))
    wave_phase: np.ndarray = field(default_factory=partial(np.zeros, 0))

    @property
    def stop_s(self) -> float:
        """End time, s since the session's first sample."""
        return self.start_s + self.duration_s

    def scaled(self, factor: float) -> Stroke:
        """The same stroke with all angles times ``factor``."""
        return replace(self, change_rad=self.change_rad * factor, wave_rad=self.wave_rad * factor)

    def angle(self, t_s: np.ndarray) -> np.ndarray:
        """(3, N): angle since the start, rad, and its two derivatives, rad/s and rad/s^2, at t_s (N,) s within the stroke."""
        since = t_s - self.start_s
        u = since / self.duration_s
        v = 1 - u
        profile = u**3 * (10 - 15 * u + 6 * u**2), 30 * (u * v) ** 2, 60 * u * v * (v - u)
        window = (4 * u * v) ** 3, 192 * (u * v) ** 2 * (v - u), 384 * u * v * ((v - u) ** 2 - u * v)
        wave = np.zeros((3, len(since)))
        for amplitude, hertz, phase in zip(self.wave_rad, self.wave_hz, self.wave_phase, strict=True):
            pulsation = 2 * np.pi * hertz
            sine = amplitude * np.sin(pulsation * since + phase)
            wave[0] += sine
            wave[1] += amplitude * pulsation * np.cos(pulsation * since + phase)
            wave[2] -= pulsation**2 * sine
        rate, acceleration = 1 / self.duration_s, 1 / self.duration_s**2  # du/dt and its square
        return np.stack(
            [
                self.change_rad * profile[0] + window[0] * wave[0],
                (self.change_rad * profile[1] + window[1] * wave[0]) * rate + window[0] * wave[1],
                (self.change_rad * profile[2] + window[2] * wave[0]) * acceleration + 2 * window[1] * rate * wave[1] + window[0] * wave[2],
            ]
        )


def gimbal_angles(start_rad: np.ndarray, strokes: Sequence[Stroke], t_s: np.ndarray) -> np.ndarray:
    """Angles, rates and accelerations of gimbals moved by strokes.

    start_rad (3,) rad, outer middle inner, before the first stroke; t_s (N,) s, increasing.
    Returns (3, 3, N): [0] angles rad, [1] rates rad/s, [2] accelerations rad/s^2, each outer, middle, inner.
    """
    angles, before = np.zeros((3, 3, len(t_s))), np.array(start_rad, dtype=float)
    over = list(itertools.takewhile(lambda stroke: len(t_s) and stroke.stop_s <= t_s[0], strokes))
    for stroke in over:
        before[stroke.gimbal] += stroke.change_rad
    angles[0] = before[:, None]
    for stroke in strokes[len(over) :]:
        if len(t_s) and stroke.start_s > t_s[-1]:
            continue
        first, last = np.searchsorted(t_s, (stroke.start_s, stroke.stop_s))
        angles[:, stroke.gimbal, first:last] += stroke.angle(t_s[first:last])
        angles[0, stroke.gimbal, last:] += stroke.change_rad
    return angles


# Plan of the hand's movement: still - turn - still - … - still, then the closure run.  ``move`` computes the motion along it.

# The hand: estimates from turning a small three-axis table; they give peak rates of 60 to 350 dps.
TURN_SPREAD = 0.13  #: relative spread of a turn's duration
DEAD_TIME = 1.0  #: of still_s, at most: pause between two turns in addition to the two stills
GIMBALS_AT_ONCE = (0.4, 0.35, 0.25)  #: probabilities that a turn moves one, two, three gimbals
LATE_S = 0.25  #: a second gimbal starts up to this later and stops up to this earlier
TURN_CHANGE_RAD = (90 * DEG, 300 * DEG)  #: a gimbal's change in a turn
TRAVEL_RAD = 400 * DEG  #: a turn that would end further from a gimbal's zero goes the other way, because of cables
PEAK_RPS = 350 * DEG  #: fastest rate of a table turned by hand
# Irregularity of a stroke: slow waves in proportion to its change, tremor in rad (physiological tremor: 4 to 12 Hz).
SLOW_WAVES, SLOW_HZ, SLOW_FRACTION = 3, (0.5, 1.6), 0.03
TREMOR_WAVES, TREMOR_HZ, TREMOR_RAD = 2, (4.0, 9.0), 0.06 * DEG
# Closure run: strokes of every gimbal overlap by half, so that the table never rests before the end.
CLOSURE_STILL = (1.2, 2.0)  #: of still_s, at both ends
CLOSURE_STROKE_S = 1.5  #: approximate time between the starts of consecutive strokes
CLOSURE_RANGE_RAD = 120 * DEG  #: largest departure of a gimbal from its initial angle

CHECK_S = 5e-3  #: grid on which a movement's peak rate is searched; short compared with the tremor


@dataclass(frozen=True, eq=False)
class MovementPlan:
    """Rests and turns of one session, in s since the log's first sample.

    start_rad (3,) the gimbals' first angles, outer middle inner; turns (start, stop) of each movement in the log; log_s the log's
    length; closure (start, stop) of the closure run's movement, or None; duration_s the whole, log and closure run.
    """

    start_rad: np.ndarray
    strokes: tuple[Stroke, ...]
    turns: tuple[tuple[float, float], ...]
    log_s: float
    closure: tuple[float, float] | None
    duration_s: float


def hand_plan(options: SimulationOptions, rng: np.random.Generator) -> MovementPlan:
    """Draw a plan: random targets that cover the attitudes, turns in both senses about one, two or three gimbals at once."""
    log_rng, closure_rng = rng.spawn(2)  # the closure run does not change with the number of segments
    limit_rps = min(PEAK_RPS * options.vigour, PEAK_FULL_SCALE * options.gyro_fs_dps * DEG)
    start_rad = log_rng.uniform(-np.pi, np.pi, 3)
    if options.with_heading:
        # A heading is useful only if the session begins at the table's index: outer gimbal at zero, table not upside down.
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
    return MovementPlan(start_rad, tuple(strokes), tuple(turns), log_s, closure, log_s + options.closure_s)


def rest_s(options: SimulationOptions, rng: np.random.Generator) -> float:
    """Duration of the still after a turn, the still before the next, and a pause, s."""
    return options.still_s * (2 + rng.uniform(0, DEAD_TIME))


def _turn(angles_rad: np.ndarray, start_s: float, duration_s: float, vigour: float, rng: np.random.Generator) -> list[Stroke]:
    count = 1 + rng.choice(3, p=GIMBALS_AT_ONCE)
    strokes: list[Stroke] = []
    for gimbal in rng.permutation(3)[:count]:
        change = vigour * rng.uniform(*TURN_CHANGE_RAD) * rng.choice((-1, 1))
        if abs(angles_rad[gimbal] + change) > TRAVEL_RAD:
            change = -change
        # The first gimbal spans the whole movement.
        late_s, early_s = rng.uniform(0, min(LATE_S, 0.1 * duration_s), 2) if strokes else (0.0, 0.0)
        strokes.append(stroke(int(gimbal), start_s + late_s, duration_s - late_s - early_s, change, rng))
    return strokes


def _closure_run(start_s: float, stop_s: float, vigour: float, rng: np.random.Generator) -> list[Stroke]:
    """Draw strokes whose changes sum to zero for each gimbal."""
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
    """Draw a stroke with its irregularity: change_rad between start_s and start_s + duration_s."""
    slow_rad = abs(change_rad) * SLOW_FRACTION * rng.uniform(0, 1, SLOW_WAVES)
    tremor_rad = TREMOR_RAD * rng.uniform(0, 1, TREMOR_WAVES)
    hertz = np.concatenate([rng.uniform(*SLOW_HZ, SLOW_WAVES), rng.uniform(*TREMOR_HZ, TREMOR_WAVES)])
    phase = rng.uniform(0, 2 * np.pi, SLOW_WAVES + TREMOR_WAVES)
    return Stroke(gimbal, start_s, duration_s, change_rad, np.concatenate([slow_rad, tremor_rad]), hertz, phase)


def not_faster(strokes: list[Stroke], limit_rps: float) -> list[Stroke]:
    """The same movement, scaled down if it would exceed the limit.  The body's rate is at most the sum of the gimbals' rates."""
    start_s, stop_s = min(stroke.start_s for stroke in strokes), max(stroke.stop_s for stroke in strokes)
    rates = gimbal_angles(np.zeros(3), tuple(strokes), np.arange(start_s, stop_s, CHECK_S))[1]
    factor = limit_rps / np.abs(rates).sum(axis=0).max()
    return strokes if factor >= 1 else [stroke.scaled(factor) for stroke in strokes]


# Attitude and rate of the table: exact kinematics of three gimbals, without integration.
#
# The outer gimbal turns about the table's vertical, the middle one about the outer's y, the inner one about the middle's x; the
# body is on the inner.  So their angles psi, theta, phi are yaw, pitch, roll: ``R_tb = Rz(psi) Ry(theta) Rx(phi)``, for any
# angle.  The rate of b against t, in b (the textbooks' Euler angle kinematics; the acceleration is its derivative)::
#
#     p = phi' - psi' sin(theta)
#     q = theta' cos(phi) + psi' sin(phi) cos(theta)
#     r = -theta' sin(phi) + psi' cos(phi) cos(theta)


@dataclass(frozen=True, eq=False)
class GimbalMotion:
    """The body's motion against the table.

    t_s (N,); angles (3, N) rad, outer middle inner; rate, acceleration (N, 3): of b against t, in b, rad/s and rad/s^2.
    """

    t_s: np.ndarray
    angles: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


def move(plan: MovementPlan, t_s: np.ndarray) -> GimbalMotion:
    """The plan's motion at times t_s (N,) s, increasing."""
    angles, rates, accelerations = gimbal_angles(plan.start_rad, plan.strokes, t_s)
    _, sin_theta, sin_phi = np.sin(angles)
    _, cos_theta, cos_phi = np.cos(angles)
    psi1, theta1, phi1 = rates
    psi2, theta2, phi2 = accelerations
    # The vertical in b is (-sin theta, side, down); its derivative follows.
    side, down = sin_phi * cos_theta, cos_phi * cos_theta
    side1 = phi1 * down - theta1 * sin_phi * sin_theta
    down1 = -phi1 * side - theta1 * cos_phi * sin_theta
    rate = np.stack([phi1 - psi1 * sin_theta, theta1 * cos_phi + psi1 * side, -theta1 * sin_phi + psi1 * down], axis=-1)
    acceleration = np.stack(
        [
            phi2 - psi2 * sin_theta - psi1 * theta1 * cos_theta,
            theta2 * cos_phi - theta1 * phi1 * sin_phi + psi2 * side + psi1 * side1,
            -theta2 * sin_phi - theta1 * phi1 * cos_phi + psi2 * down + psi1 * down1,
        ],
        axis=-1,
    )
    return GimbalMotion(t_s, angles, rate, acceleration)


def table_to_body(angles: np.ndarray, vector_t: np.ndarray) -> np.ndarray:
    """Components in the body of a vector fixed in the table: ``R_tb^T v``.  angles (3, N) rad, vector_t (3,).  Returns (N, 3)."""
    (sin_psi, sin_theta, sin_phi), (cos_psi, cos_theta, cos_phi) = np.sin(angles), np.cos(angles)
    x, y, z = vector_t
    x, y = cos_psi * x + sin_psi * y, cos_psi * y - sin_psi * x
    x, z = cos_theta * x - sin_theta * z, sin_theta * x + cos_theta * z
    y, z = cos_phi * y + sin_phi * z, cos_phi * z - sin_phi * y
    return np.stack([x, y, z], axis=-1)


def earth_rate_table(latitude_rad: float, heading_rad: float) -> np.ndarray:
    """The Earth's rotation in t (3,) rad/s; heading from true north to t's x axis, ``R_nt = Rz(heading)``."""
    north, down = EARTH_RATE_RPS * np.cos(latitude_rad), -EARTH_RATE_RPS * np.sin(latitude_rad)
    return np.array([north * np.cos(heading_rad), -north * np.sin(heading_rad), down])


def felt(
    options: SimulationOptions, heading_deg: float, rate: np.ndarray, acceleration: np.ndarray, to_body: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Rate against inertial space (N, 3) rad/s and specific force (N, 3) m/s^2, in b, of a sensor at ``options.lever_m`` from what rests.

    rate, acceleration (N, 3) of b against t, in b; to_body: components (N, 3) in b of a vector (3,) in t.
    ``f = R_bn (a - g)``, a = alpha x r + omega x (omega x r).  The Coriolis term of the Earth's rotation (below 1 ug here) is neglected.
    """
    lever_m = np.array(options.lever_m)
    centripetal, tangential = np.cross(rate, np.cross(rate, lever_m)), np.cross(acceleration, lever_m)
    force = to_body(np.array([0.0, 0.0, -options.gravity_mps2])) + tangential + centripetal
    return rate + to_body(earth_rate_table(options.latitude_deg * DEG, heading_deg * DEG)), force


def motion_of(options: SimulationOptions, unit: SimulatedUnit, plan: MovementPlan) -> Motion:
    """What a sensor feels that is fixed to the innermost gimbal and warms up by itself."""

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        moved = move(plan, t_s)
        inputs = felt(options, unit.heading_deg, moved.rate, moved.acceleration, partial(table_to_body, moved.angles))
        return *inputs, self_heating(options, t_s)

    return motion
