"""Turns that an operator can make, and the information in each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from session.base import rotation
from session.base.numeric import sigma_of
from session.base.units import DEG, G
from session.bench.messages import AxisMove
from session.detect.accelerometer import PARAMETERS, UPPER, WANDERS_MPS2, force_of, length_columns
from session.detect.stills import Noise, Still
from session.log.config import Accelerometer
from tinygc.closure import residual
from tinygc.closure.joint import tilt_columns
from tinygc.closure.residual import Batch
from tinygc.effects import Movement
from tinygc.models import linear

# Resting attitudes: on one of the board's six sides, or on an edge between two of them.
#
# A person can align the board's axes with the vertical and the level, but with nothing in between.

SIDES = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
EDGES = np.array([(a + b) / np.sqrt(2) for a, b in product(SIDES, SIDES) if np.argmax(np.abs(a)) < np.argmax(np.abs(b))])


def nearest_up(accel: np.ndarray, with_edges: bool = False) -> np.ndarray:
    """Return the unit vector (3,) of the board that would point up if it were set straight; accel (3,): its accelerometer's reading."""
    among = np.concatenate([SIDES, EDGES]) if with_edges else SIDES
    return among[int(np.argmax(among @ accel))]


def up_words(up: np.ndarray) -> str:
    """Describe an up direction: ``-x``; on an edge ``x and -z``."""
    return " and ".join(f"{'-' if part < 0 else ''}{name}" for name, part in zip("xyz", up, strict=True) if abs(part) > 0.1)


def on_a_side(up: np.ndarray) -> bool:
    """Whether the board lies on a side, and not on an edge."""
    return bool(np.abs(up).max() > 0.9)


def straight(up: np.ndarray) -> np.ndarray:
    """Return the up direction (3,) of a board turned by quarters or eighths, without rounding errors."""
    return nearest_up(up, with_edges=True)


# The information of a turn and of its stills on an uncalibrated accelerometer: nine more parameters, linear as well.
#
# The force is f = M (m - b), M upper triangular, in the order and by the derivatives of ``session.detect.accelerometer``.  In every still
# its length is gravity's: one row.  Its direction gives the attitude at both ends of a turn: an error of f at the start rotates the
# predicted end attitude, one at the end rotates the measured one.

#: a tilt of 0.05 mrad, as the target of the gyroscope's misalignments
TARGETS = np.array([50e-6] * 6 + [50e-6 * G] * 3)
#: prior sigma of an uncalibrated accelerometer: 10 %, and 0.6 g (an MPU-9250 had 0.5 g)
PRIOR_SIGMA = np.array([0.1] * 6 + [0.6 * G] * 3)
SPARE = 6  #: stills beyond nine that this estimate needs
UNCALIBRATED = Accelerometer(source="none")


@dataclass(frozen=True, eq=False)
class OwnAccelerometer:
    """The accelerometer as estimated so far (M upper triangular), or uncalibrated; sigma_mps2: of a still beyond white noise, each axis."""

    accelerometer: Accelerometer
    sigma_mps2: float

    @property
    def x(self) -> np.ndarray:
        """Parameters (9,) in the order of ``session.detect.accelerometer``."""
        return np.concatenate([self.accelerometer.matrix[UPPER], self.accelerometer.bias_mps2])

    def length_rows(self, force: np.ndarray) -> np.ndarray:
        """Return the derivative (S, 9) m/s^2 per unit of the length of forces (S, 3), by each parameter."""
        return length_columns(self.x, self.accelerometer.measured(force))

    def tilt_rows(self, first: np.ndarray, last: np.ndarray, q_first: np.ndarray, q_last: np.ndarray) -> np.ndarray:
        """Return the derivative (S, 2, 9) rad per unit of the predicted end attitude, relative to that from gravity, by each parameter.

        first, last (S, 3) m/s^2: the estimated force at both ends; q_first, q_last (S, 4): the attitudes there, of which the second
        is the predicted one.
        """
        start, end = (tilt_columns(q, self.x, self.accelerometer.measured(force)) for q, force in ((q_first, first), (q_last, last)))
        return (start - end)[:, :2]


def as_known(accelerometer: Accelerometer | None, stills: tuple[Still, ...]) -> OwnAccelerometer:
    """Return the accelerometer estimated from the stills (None: not yet), with its sigma from their residuals of gravity's length."""
    if accelerometer is None or len(stills) < PARAMETERS + SPARE:
        return OwnAccelerometer(accelerometer or UNCALIBRATED, WANDERS_MPS2)
    length = np.linalg.norm(accelerometer.correct(force_of(stills)), axis=1)
    miss = float(sigma_of(length - np.median(length))) * np.sqrt(len(length) / (len(length) - PARAMETERS))
    return OwnAccelerometer(accelerometer, miss)


def length_information(own: OwnAccelerometer, stills: tuple[Still, ...], noise: Noise, gravity_sigma_mps2: float) -> np.ndarray:
    """Return the information (9, 9) of gravity's length in the stills; gravity_sigma_mps2: of that length itself."""
    force = own.accelerometer.correct(force_of(stills))
    white = float(np.mean(noise.velocity_random_walk**2)) / np.array([still.duration_s for still in stills])
    root = 1 / np.sqrt(white + own.sigma_mps2**2)
    rows = own.length_rows(force) * root[:, None]
    common = root @ rows * gravity_sigma_mps2  # a length that is not known is a further number, common to all stills
    return rows.T @ rows - np.outer(common, common) / (1 + (root @ root) * gravity_sigma_mps2**2)


# The turns that an operator can make from an attitude, and their columns of the linear sensitivity.
#
# One movement, or two without a rest between, each by quarter turns about an axis that a person can identify: the board's upright axis, or
# a level one.  The board is assumed to be set straight before, on the side that it lies nearest to, and it ends on a side.  So
# "by 90° about y" and "until -x is up" are the same turn, and the errors of the last turn do not accumulate.  The words, the picture
# and the estimate describe this one turn.

QUARTERS = (90, 180, 270, 360)
#: an accelerometer's nonorthogonality is observable only between the sides: such a turn ends on an edge, or begins there
EIGHTHS = (45, 90, 135, 180, 225, 270, 315, 360)
MOST_DEG = 360  #: total of two movements that one hand can make
SINGLE_S, PAIR_S = 3.0, 4.0  #: duration of one movement; of two, divided by their angles; longer where the full scale is small
SLANTED_RAD = 20 * DEG  #: tilt from straight above which the operator is to set the board straight
PEAK = 2.0  #: peak over mean rate of a smooth turn
STRAIGHT_S = 1.0  #: duration of setting it straight, where the estimate includes it
STILL_S, RATE_HZ = 1.0, 20.0
LEVEL = 0.1  #: cosine, on sides and edges: below it an axis is level


@dataclass(frozen=True, eq=False)
class TurnPart:
    """A movement about one axis (3,), a unit vector of the body; words: what to do, and what is up then; up (3,): in body axes; ramp_s: of
    a machine's constant accelerations at both ends, 0 of a hand's smooth movement."""

    axis: np.ndarray
    angle_rad: float
    seconds: float
    words: str
    up: np.ndarray
    ramp_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Turn:
    """A turn between two stills.  straightened: the movement that sets the board straight first; up (3,) unit: what points up then.

    cost_s: the time by which its gain is divided, from still to still; 1 of a hand, whose time does not count.  moves: the parts for a
    machine, and its angles (K,) rad after them.
    """

    straightened: TurnPart
    parts: tuple[TurnPart, ...]
    cost_s: float = 1.0
    moves: tuple[AxisMove, ...] = ()
    angles: np.ndarray | None = None

    @property
    def up(self) -> np.ndarray:
        """The up direction (3,), a unit vector, where the movements begin."""
        return self.straightened.up

    @property
    def words(self) -> str:
        """Instructions for the operator."""
        moves = ", then at once ".join(part.words for part in self.parts)
        return f"{self.straightened.words}turn {moves} ({sum(part.seconds for part in self.parts):.0f} s)"

    @property
    def steps(self) -> tuple[str, ...]:
        """Instructions for each part alone."""
        return tuple(f"{self.straightened.words if part is self.parts[0] else ''}turn {part.words}" for part in self.parts)

    def carries(self, accel: np.ndarray) -> np.ndarray:
        """Return the reading after the turn of an accelerometer at rest that read accel (3,) before it."""
        return self.parts[-1].up * np.linalg.norm(accel)


def turns_from(accel: np.ndarray, singles_deg: tuple[int, ...] = QUARTERS, most_rps: float = np.inf) -> list[Turn]:
    """Return all turns from a still in which the accelerometer reads accel (3,); singles_deg: the angles; most_rps: largest peak rate."""
    up = nearest_up(accel, with_edges=singles_deg != QUARTERS)
    # The shortest rotation from where lies (3,) points up to where ``up`` does.
    lies = accel / np.linalg.norm(accel)
    axis, angle = np.cross(up, lies), float(np.arccos(np.clip(up @ lies, -1.0, 1.0)))
    length = np.linalg.norm(axis)
    axis = axis / length if length > 0 else axis
    how = f"with {up_words(up)} set straight up" if on_a_side(up) else f"on its edge with {up_words(up)} up"
    words = f"{how}, " if angle > SLANTED_RAD else ""
    straightened = TurnPart(axis, angle, STRAIGHT_S, words, up)
    together = [pair for pair in product([degrees for degrees in singles_deg if degrees < 300], repeat=2) if sum(pair) <= MOST_DEG]

    def duration_s(degrees: int, least_s: float) -> float:
        return max(least_s, PEAK * degrees * DEG / most_rps)

    singles = [Turn(straightened, (part,)) for degrees in singles_deg for part in parts_from(up, degrees, duration_s(degrees, SINGLE_S))]
    pairs = [
        Turn(straightened, (first, second))
        for one, other in together
        for first in parts_from(up, one, duration_s(one + other, PAIR_S) * one / (one + other))
        for second in parts_from(first.up, other, duration_s(one + other, PAIR_S) * other / (one + other), "its")
        if abs(first.axis @ second.axis) < LEVEL  # about the same axis it would be one turn
    ]
    return singles + pairs


def columns(accel: np.ndarray, turns: list[Turn], zero_rps: np.ndarray | float = 0.0) -> np.ndarray:
    """Return columns (M, 2, 12) rad per unit of each parameter, of turns begun where the accelerometer reads accel (3,).

    zero_rps (3,): what the gyroscope reads at rest.
    """
    movements = [(turn.straightened, *turn.parts) for turn in turns]
    lengths = np.array([sum(part.seconds for part in parts) for parts in movements])[:, None] + 2 * STILL_S
    t = np.arange(0, lengths.max(), 1 / RATE_HZ)
    rate = np.zeros((len(turns), len(t), 3))
    began = np.full((len(turns), 1), STILL_S)
    for parts in _abreast(movements):
        angle, seconds, ramp = (np.array([getattr(part, name) for part in parts])[:, None] for name in ("angle_rad", "seconds", "ramp_s"))
        smooth = PEAK / seconds * np.sin(np.pi * np.clip((t - began) / seconds, 0, 1)) ** 2
        to_end = np.minimum(t - began, began + seconds - t)
        even = np.clip(to_end / np.where(ramp > 0, ramp, 1.0), 0, 1) / np.maximum(seconds - ramp, 1e-9)
        speed = angle * np.where(ramp > 0, even, smooth)
        rate += speed[..., None] * np.array([part.axis for part in parts])[:, None]
        began = began + seconds
    dt = (t[1:] <= lengths) / RATE_HZ
    start = np.broadcast_to(rotation.from_gravity(accel), (len(turns), 4))
    batch = Batch(rate, dt, np.zeros_like(rate), start, start, yaw_known=False)
    return linear.columns(residual.sensitivity(batch, rate), rate + zero_rps)[:, :2]


def ends(accel: np.ndarray, turns: list[Turn]) -> tuple[np.ndarray, np.ndarray]:
    """Return attitudes (M, 4) before and after each turn, begun where the accelerometer reads accel (3,)."""
    first = np.broadcast_to(rotation.from_gravity(accel), (len(turns), 4))
    last = first
    for parts in _abreast([(turn.straightened, *turn.parts) for turn in turns]):
        last = rotation.multiply(last, rotation.exp(np.array([part.axis * part.angle_rad for part in parts])))
    return first, last


_NOTHING = TurnPart(np.zeros(3), 0.0, 1.0, "", np.zeros(3))


def _abreast(movements: list[tuple[TurnPart, ...]]) -> list[list[TurnPart]]:
    """Return the first parts of all, then the second parts, and so on."""
    most = max(map(len, movements))
    return [[parts[number] if number < len(parts) else _NOTHING for parts in movements] for number in range(most)]


def parts_from(up: np.ndarray, degrees: int, seconds: float, whose: str = "the board's") -> list[TurnPart]:
    """Return turns about the upright axis and about level axes, in both senses.  up (3,): the up direction before."""
    return list(_parts_from(tuple(up.tolist()), degrees, seconds, whose))


@cache  # there are 18 resting attitudes, and each advice needs some hundred movements
def _parts_from(lies: tuple[float, ...], degrees: int, seconds: float, whose: str) -> tuple[TurnPart, ...]:
    up, angle, found = np.array(lies), degrees * DEG, []
    if degrees % 90 == 0:
        axis_words = f"{whose} {up_words(up).removeprefix('-')} axis" if on_a_side(up) else "the vertical"
        for sense, side in ((1.0, "left"), (-1.0, "right")):
            words = f"{degrees}° to the {side} about {axis_words}, {up_words(up)} {'stays' if on_a_side(up) else 'stay'} up"
            found.append(TurnPart(sense * up, angle, seconds, words, up))
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        if abs(axis @ up) > LEVEL:
            continue
        for sense in (1.0, -1.0):
            first, last = (_turned(up, sense * axis, each) for each in (90 if on_a_side(up) else 45, degrees))
            passes = "" if np.array_equal(first, last) else f", {up_words(first)} up first,"
            words = f"{degrees}° about {whose} {name} axis (level){passes} until {up_words(last)} {'is' if on_a_side(last) else 'are'} up"
            found.append(TurnPart(sense * axis, angle, seconds, words, last))
    return tuple(found)


def _turned(up: np.ndarray, axis: np.ndarray, degrees: int) -> np.ndarray:
    """Return the up direction after a turn about a level axis of the board."""
    return straight(rotation.matrix(rotation.exp(axis * degrees * DEG)).T @ up)


# Candidate turns sample by sample, for the response of competing laws to each.
#
# A single turn from a side, as in the plan of a session, slowly and quickly, with a still before and after it.

SPLITTING_STILL_S, SPLITTING_RATE_HZ = 1.0, 25.0
#: durations of one turn: brisk, usual, slow
TURNS_S = (1.5, 3.0, 8.0)
#: largest peak rate of a turn as a share of full scale
MOST_OF_SCALE = 0.8


@dataclass(frozen=True, eq=False)
class CandidateTurn:
    """A turn: words for the operator; movement, still at both ends; sensitivity (N, 2, 3) s of its closure; stills: rows before, after."""

    words: str
    movement: Movement
    sensitivity: np.ndarray
    stills: tuple[slice, slice]


def trials(like: Movement) -> list[CandidateTurn]:
    """Return turns by quarters from each side; like: a log of the sensor with the full scale, temperature and vibration to use."""
    found = []
    for seconds in TURNS_S:
        moves = [
            (up, part)
            for up, degrees in product(SIDES, QUARTERS)
            for part in parts_from(up, degrees, seconds)
            if PEAK * part.angle_rad / seconds <= MOST_OF_SCALE * like.fs_rps
        ]
        if moves:
            found += _together(moves, seconds, like)
    return found


def _together(moves: list[tuple[np.ndarray, TurnPart]], seconds: float, like: Movement) -> list[CandidateTurn]:
    """Return the turns of one duration."""
    t = np.arange(0, seconds + 2 * SPLITTING_STILL_S, 1 / SPLITTING_RATE_HZ)
    speed = PEAK / seconds * np.sin(np.pi * np.clip((t - SPLITTING_STILL_S) / seconds, 0, 1)) ** 2
    rate = speed[:, None] * np.array([part.axis * part.angle_rad for _, part in moves])[:, None]
    start = rotation.from_gravity(np.array([up for up, _ in moves]))
    dt = np.full((len(moves), len(t) - 1), 1 / SPLITTING_RATE_HZ)
    batch = Batch(rate, dt, np.zeros_like(rate), start, start, yaw_known=False)
    turn = rotation.matrix(residual.attitudes(batch, rate))
    up_t = np.einsum("sij,sj->si", rotation.matrix(start), np.array([up for up, _ in moves]))
    force = np.einsum("stji,sj->sti", turn, up_t)
    sensitivity = residual.sensitivity(batch, rate)[:, :, :2]
    count = round(SPLITTING_STILL_S * SPLITTING_RATE_HZ)
    stills = slice(count), slice(len(t) - count, len(t))
    # The movement at the log's median temperature and vibration; its time begins with the log.
    return [
        CandidateTurn(
            f"from a still with {up_words(up)} up, turn {part.words} ({part.seconds:g} s)",
            Movement(
                t_s=like.t_s[0] + t,
                dt_s=1 / SPLITTING_RATE_HZ,
                rate=rate[number],
                force_g=force[number],
                temp_c=np.full(len(t), np.median(like.temp_c)),
                vibration_g2=np.full(len(t), np.median(like.vibration_g2)),
                duration_s=like.duration_s,
                fs_rps=like.fs_rps,
                first_temp_c=like.first_temp_c,
            ),
            sensitivity[number],
            stills,
        )
        for number, (up, part) in enumerate(moves)
    ]
