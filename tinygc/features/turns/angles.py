"""The angle of each turn as the gyroscope alone has it, with its variance, term by term.

Between two rests the table turns about one axis, which is fixed in the sensor: u.  An ideal triad reads rate * u, and one with the errors S
reads rate * (1 + S) u.  The integral of the readings, less the bias, is the vector theta = angle * (1 + S) u: its direction is u but for
S, and its length is angle * (1 + u' S u) but for S squared.  So the length needs no mounting: it shows the scale along the table's axis,
however that leans in the sensor.  The component along the sensor's axis would have the cosine of the lean in it.  The scale along u
differs from that of the sensor's own axis k by (S_kj + S_jk) u_j, which turns do not separate from a lean of the table (``axis_bound``).

The Earth's rotation and gravity have a constant component along a fixed axis, and go with the bias.

Terms of the variance of an angle over T seconds, by the name that the results have (a: per axis, projected on u):

    rests      T^2 (w_a^2 v_a + w_b^2 v_b), v the variance of the mean of the rest before and behind, w their weights at the turn's middle
    drift      of a bias that wanders by K between the two: K^2 (T^2 p + T^3/3 - T^2 (p + T/2)^2 / D), p from one middle to the turn, D to
               the other middle: a Brownian bridge
    white      N^2 T, N from the block means of all rests
    vibration  dt^2 n (s^2 - r^2), s the scatter of single readings while it turns, from their second differences, r at rest: a movement
               faster than half the data rate is not seen, and each reading is wrong by itself, at most
    ends       the movement between the samples at which it begins and ends: sum of (second difference dt)^2 / 24, less what the scatter
               makes; a step of rate W gives (W dt)^2 / 12, a rectangular distribution over one interval
    rounding   T^2 (R_rest / 2 + R_turn): what rounding leaves in a mean of readings (``rests.py``).  The other half of R_rest is
               taken to be alike in all turns of an axis: whether it is depends on how the bias moves from log to log
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc

from session.base.units import DEG
from session.detect.rounding import lsb_of, rounding_variance
from session.detect.stills import block_size
from session.log.folder import Session
from session.log.logfile import NAME, KnownTurn, Log
from tinygc.features.turns.clock import SampleTimes, as_stamped, sample_times
from tinygc.features.turns.folder import sensor_axis
from tinygc.features.turns.rests import Movement, Rest, find_turns

#: of the stated axis, from the measured one: as for turns next to gravity (docs/formats/logs.md)
AXIS_WITHIN = 30 * DEG
#: of a full scale: a reading beyond was clipped
CLIPPED = 0.999
#: a rest that scatters as much by chance less often than this has its own scatter
OWN_SCATTER = 1e-3
#: median of chi-square with one degree of freedom
MEDIAN_CHI2 = 0.4549
#: two readings of the stamps are separated where turns repeat so many times worse, mean square: with 8 turns of one kind 2 in 100 by
#: chance, were the two independent (Fisher's F of 7 and 7 degrees of freedom)
MUCH_WORSE = 5.0
TERMS = ("rests", "drift", "white", "vibration", "ends", "rounding")


@dataclass(frozen=True, eq=False)
class TurnAngle:
    """A stated turn, and what the gyroscope has of it.

    axis 0 to 2 and sense of what is stated, and stated_rad, positive; measured_rad about the table's axis, positive in the stated sense;
    direction (3,) of the table's axis in the stated sense, body axes; duration_s; rate_rps, the usual one while it turns; variance rad^2 by
    term; shared_rps2: variance of a rate that is alike in all turns of the axis; rests: (number of the rest in the session, d angle /
    d its bias in s, variance rad^2/s^2) of the two; lost_s that gaps have lost; problem: why it is not used, or None.
    """

    turn: KnownTurn
    log: str
    axis: int
    sense: int
    stated_rad: float
    measured_rad: float = np.nan
    direction: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    duration_s: float = np.nan
    rate_rps: float = np.nan
    period_s: float = np.nan
    variance: dict[str, float] = field(default_factory=dict)
    shared_rps2: float = 0.0
    rests: tuple[tuple[int, float, float], ...] = ()
    lost_s: float = 0.0
    problem: str | None = None

    @property
    def lean_rad(self) -> float:
        """Angle from the stated sensor axis to the table's axis."""
        return float(np.arccos(np.clip(self.sense * self.direction[self.axis], -1, 1)))

    @property
    def gyro_variance(self) -> float:
        """rad^2, all terms but vibration, of which the share that counts is estimated."""
        return sum(value for name, value in self.variance.items() if name != "vibration")


@dataclass(frozen=True, eq=False)
class LogOfTurns:
    """A log: its times, its rests and its turns; lsb, rad/s, that its readings are rounded to; other: where stamps may be those of bursts
    or of samples with others lost between, what the reading that was not taken makes of its turns."""

    log: Log
    gyro: np.ndarray
    times: SampleTimes
    rests: list[Rest]
    turns: list[Movement]
    lsb: float
    other: OtherReading | None = None


@dataclass(frozen=True, eq=False)
class OtherReading:
    """apart_rad: by how much a turn differs at most, and in its own sigmas; worse: mean square by which turns of one axis and sense differ
    among themselves, over that of the reading which was taken; 1 where none repeats another."""

    apart_rad: float
    apart_sigmas: float
    worse: float

    @property
    def is_open(self) -> bool:
        """Whether it may be right as well, and would make other angles."""
        return self.apart_sigmas > 1 and self.worse < MUCH_WORSE


@dataclass(frozen=True, eq=False)
class RestNoise:
    """Of all rests of a session, each (3,): white noise N^2, rad^2/s; wandering of the bias K^2, rad^2/s^3; single readings, rad^2/s^2."""

    white: np.ndarray
    drift: np.ndarray
    single: np.ndarray


def _bridge_variance(drift: float | np.ndarray, lead_s: float, duration_s: float, apart_s: float) -> float | np.ndarray:
    """rad^2: of the integral over a turn of a random walk that is known at both middles, with ``drift`` rad^2/s^3.

    lead_s from the first middle to the turn, apart_s between the middles.
    """
    middle = lead_s + duration_s / 2
    return drift * (duration_s**2 * lead_s + duration_s**3 / 3 - (duration_s * middle) ** 2 / apart_s)


def measured_turns(session: Session) -> tuple[list[TurnAngle], list[LogOfTurns], RestNoise]:
    """Each stated turn in the order of the file, the logs, and the noise of the rests.  Raises FormatError for an oblique axis."""
    logs = [_log_of_turns(log, _smallest_angle(session.turns, log.path.name), sample_times) for log in session.logs]
    if not any(log.times.bursts for log in logs):
        return _all_measured(session, logs)
    stamped = [
        _log_of_turns(log.log, _smallest_angle(session.turns, log.log.path.name), as_stamped) if log.times.bursts else log for log in logs
    ]
    even, as_written = (_all_measured(session, each)[0] for each in (logs, stamped))
    chosen = [_better(one, other, even, as_written) if one.times.bursts else one for one, other in zip(logs, stamped, strict=True)]
    return _all_measured(session, chosen)


def _all_measured(session: Session, logs: list[LogOfTurns]) -> tuple[list[TurnAngle], list[LogOfTurns], RestNoise]:
    noise = _rest_noise(logs)
    return [_measured(session, turn, logs, noise) for turn in session.turns], logs, noise


def _better(even: LogOfTurns, stamped: LogOfTurns, evenly: Sequence[TurnAngle], as_written: Sequence[TurnAngle]) -> LogOfTurns:
    """Of two readings of a log's stamps the one whose turns repeat better; where none repeats another, bursts are spaced evenly."""
    name = even.log.path.name
    both = [pair for pair in zip(evenly, as_written, strict=True) if pair[0].log == name and all(each.problem is None for each in pair)]
    if not both:
        return even
    squares = [_scatter([pair[which] for pair in both]) for which in (0, 1)]
    apart = np.array([abs(one.measured_rad - other.measured_rad) for one, other in both])
    sigma = np.sqrt([max(one.gyro_variance, np.finfo(float).tiny) for one, _ in both])
    kept, best, other = (stamped, squares[1], squares[0]) if squares[1] < squares[0] else (even, squares[0], squares[1])
    return replace(kept, other=OtherReading(float(apart.max()), float((apart / sigma).max()), other / best if best > 0 else 1.0))


def _scatter(angles: Sequence[TurnAngle]) -> float:
    """Sum of squares of what turns measure for each stated rad, about the mean of their axis and sense; 0 where none repeats another."""
    groups: dict[tuple[int, int], list[float]] = {}
    for angle in angles:
        groups.setdefault((angle.axis, angle.sense), []).append(angle.measured_rad / angle.stated_rad)
    return float(sum(np.sum((np.array(each) - np.mean(each)) ** 2) for each in groups.values()))


def _smallest_angle(turns: Sequence[KnownTurn], name: str) -> float:
    mine = [abs(turn.angle_rad) for turn in turns if turn.log in (None, name)]
    return min(mine or [abs(turn.angle_rad) for turn in turns])


def _log_of_turns(log: Log, least_rad: float, times_of: Callable[[np.ndarray], SampleTimes]) -> LogOfTurns:
    gyro, times = np.asarray(log.samples.gyro), times_of(log.samples.t_ns)
    return LogOfTurns(log, gyro, times, *find_turns(times, gyro, least_rad), lsb_of(gyro))


def _rest_noise(logs: Sequence[LogOfTurns]) -> RestNoise:
    rests = [rest for log in logs for rest in log.rests]
    if not rests:
        return RestNoise(np.zeros(3), np.zeros(3), np.zeros(3))
    steps = [np.diff(rest.blocks, axis=0) ** 2 / 2 * rest.block_s for rest in rests]
    single = np.average([rest.variance for rest in rests], axis=0, weights=[rest.count - 1 for rest in rests])
    white = np.concatenate(steps).mean(axis=0)
    squares = []
    for log in logs:
        for a, b in pairwise(log.rests):
            known = sum(_mean_variance(rest, white, log) + rest.rounding / 2 for rest in (a, b))
            squares.append(((b.mean - a.mean) ** 2 - known) / (b.middle_s - a.middle_s))
    return RestNoise(white, np.maximum(np.mean(squares, axis=0), 0) if squares else np.zeros(3), single)


def _mean_variance(rest: Rest, white: np.ndarray, log: LogOfTurns) -> np.ndarray:
    """(3,) rad^2/s^2 of a rest's mean: from the noise of all rests, or its own where it scatters beyond chance."""
    pooled, dof = white / (rest.count * log.times.period_s), len(rest.blocks) - 1
    own = rest.blocks.var(axis=0, ddof=1) / len(rest.blocks)
    beyond = chdtrc(dof, dof * own / np.maximum(pooled, np.finfo(float).tiny)) < OWN_SCATTER
    return np.where(beyond, own, pooled)


def _measured(session: Session, turn: KnownTurn, logs: list[LogOfTurns], noise: RestNoise) -> TurnAngle:
    axis, sense = sensor_axis(turn)
    log, number = _place(turn, logs)
    found = TurnAngle(turn, log.log.path.name if log else turn.log or "", axis, sense, abs(turn.angle_rad))
    if log is None:
        return replace(found, problem=f"{NAME} counts more turns than the logs hold ({sum(len(each.turns) for each in logs)})")
    if number >= len(log.turns):
        held = f"holds {len(log.turns)} turn{'s' * (len(log.turns) != 1)}"
        return replace(found, problem=f"{found.log} {held if log.rests else 'holds no rest'}; turns are counted from 0, from rest to rest")
    move = log.turns[number]
    if move.before is None or move.after is None:
        return replace(
            found, problem=f"no rest {'before' if move.before is None else 'behind'} it: it may not be whole, and its bias is not known"
        )
    rows = slice(move.start, move.stop + 1)
    gyro, t_s = log.gyro[rows], log.times.t_s[rows]
    if (np.abs(gyro) >= CLIPPED * session.config.sensor.gyro_fs_dps * DEG).any():
        return replace(found, problem=f"its rate reaches the full scale of {session.config.sensor.gyro_fs_dps:g} dps")
    duration_s = float(t_s[-1] - t_s[0])
    apart_s, lead_s = move.after.middle_s - move.before.middle_s, float(t_s[0]) - move.before.middle_s
    late = (lead_s + duration_s / 2) / apart_s
    bias = (1 - late) * move.before.mean + late * move.after.mean
    theta = np.trapezoid(gyro - bias, t_s, axis=0)
    length = float(np.linalg.norm(theta))
    direction = theta / length if length else np.eye(3)[axis] * sense
    if sense * direction[axis] < np.cos(AXIS_WITHIN):
        about = ", ".join(f"{value:.2f}" for value in direction)
        return replace(
            found, problem=f"the gyroscope turned by {length / DEG:.1f} deg about ({about}), which is not {turn.words} in the stated sense"
        )
    each = _variances(log, move, noise, duration_s, lead_s, apart_s, late)
    along = direction**2
    across = float(sum(term for term in each.values()) @ (1 - along))
    first = sum(len(other.rests) for other in logs[: logs.index(log)])
    rests = [
        (first + log.rests.index(rest), -sense * weight * duration_s, float(_mean_variance(rest, noise.white, log) @ along))
        for rest, weight in ((move.before, 1 - late), (move.after, late))
    ]
    along_axis, size = (gyro - bias) @ direction, min(block_size(log.times.period_s), len(gyro))
    blocks = along_axis[: len(gyro) // size * size].reshape(-1, size).mean(axis=1)
    shared = float((move.before.rounding + move.after.rounding) @ along) / 4
    return replace(
        found,
        measured_rad=length - across / (2 * length),  # noise across makes the sum of squares larger
        direction=direction,
        duration_s=duration_s,
        rate_rps=float(np.median(blocks[blocks >= blocks.max() / 2])),
        period_s=log.times.period_s,
        variance={name: float(term @ along) for name, term in each.items()},
        shared_rps2=shared,
        rests=tuple(rests),
        lost_s=log.times.lost_between(move.start, move.stop),
    )


def _place(turn: KnownTurn, logs: list[LogOfTurns]) -> tuple[LogOfTurns | None, int]:
    """The log of a turn and its number within it."""
    if turn.log is not None:
        return next(log for log in logs if log.log.path.name == turn.log), turn.turn
    number = turn.turn
    for log in logs:
        if number < len(log.turns):
            return log, number
        number -= len(log.turns)
    return None, number


def _variances(
    log: LogOfTurns,
    move: Movement,
    noise: RestNoise,
    duration_s: float,
    lead_s: float,
    apart_s: float,
    late: float,
) -> dict[str, np.ndarray]:
    """{term: (3,) rad^2}, in the order of ``TERMS``."""
    assert move.before is not None and move.after is not None  # noqa: PT018  # the caller refused a turn without
    ends = [(move.before, 1 - late), (move.after, late)]
    around = slice(max(move.start - 1, 0), move.stop + 2)  # a movement may begin with its first sample
    second, t_s = np.diff(log.gyro[around], 2, axis=0), log.times.t_s[around]
    wide = (t_s[2:] - t_s[:-2])[:, None] / 2
    scatter = np.median(second**2, axis=0) / (6 * MEDIAN_CHI2)
    edges = np.sum((second**2 - 6 * np.maximum(scatter, noise.single)) * wide**2, axis=0) / 24
    turning = np.sqrt(np.maximum(scatter - log.lsb**2 / 12, 0))
    return {
        "rests": duration_s**2 * np.sum([w**2 * _mean_variance(rest, noise.white, log) for rest, w in ends], axis=0),
        "drift": np.asarray(_bridge_variance(noise.drift, lead_s, duration_s, apart_s)),
        "white": noise.white * duration_s,
        "vibration": np.maximum(scatter - noise.single, 0) * np.sum(wide**2),
        "ends": np.maximum(edges, 0),
        "rounding": duration_s**2 * (np.mean([rest.rounding for rest, _ in ends], axis=0) / 2 + rounding_variance(log.lsb, turning)),
    }
