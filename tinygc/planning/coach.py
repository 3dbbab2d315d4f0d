"""The coach: after each segment, the least certain parameter, and the movement from here that reduces the uncertainty most.

It uses the segments through the linear sensitivity (``residual.sensitivity``): each adds two angles, linear in the 12 parameters.
An uncalibrated accelerometer has nine more, which the length of gravity in each still observes as well.
A movement is rated by the sigmas, relative to their targets, that its two angles and the still at its end would leave, if it were made
from the present attitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.rotation import unit_vectors
from session.base.units import DEG, DEG_PER_HOUR, MG, G
from session.bench.messages import AcceptedTurn, Advice, Progress, RequestedTurn
from session.detect.accelerometer import force_of, units
from tinygc.closure import residual
from tinygc.closure.floor import BiasWander, Floor, gyro_variance, still_tilt_variance
from tinygc.closure.joint import GIVEN_SIGMA_MG, GRAVITY_SIGMA_MPS2
from tinygc.closure.residual import Batch
from tinygc.closure.uncertainty import covariance_from_columns
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.models import linear
from tinygc.planning import turns as accel
from tinygc.planning.proposals import TARGETS, parameter_words
from tinygc.planning.turns import EIGHTHS, QUARTERS, OwnAccelerometer, Turn, as_known, columns, ends, length_information, turns_from

UNKNOWN = 10.0  #: sigma over target above which the coach is D-optimal (the determinant of the covariance)
UNSEEN = 100.0
#: rad/s, the bias instability that a session is planned with, for any sensor: there is no recording yet to estimate it from, and no
#: reported uncertainty uses it
PLANNED_INSTABILITY_RPS = 3 * DEG_PER_HOUR
#: peak of a requested turn as a share of full scale: ``record`` warns at 0.85, and a hand may be 1.4 times quicker than requested
PLANNED_FULL_SCALE = 0.6
SHARPNESS = 6  #: afterwards: power of the sigmas in the criterion: 2 weighs all equally, a large one only the worst
#: the same of a machine, whose gain counts by its time: they reach all targets soonest on tables of two and three axes
MACHINE_UNKNOWN, MACHINE_SHARPNESS = 3.0, 6
MOVED = np.cos(0.5 * DEG)  #: attitudes that the updated accelerometer changed by more are recomputed
STILL_S = 2.0  #: duration of the still at the end of a proposed turn
MOST_TO_GO = 40  #: longest plan for the number of turns to go
#: what is left of a sigma after twice as many turns: of one that turns no longer show; at least, where turns of the same kind repeat (0.7)
STALLED, FALLS = 0.9, 0.6
MOST_WORTH = 400  #: turns of the same kind
FEWEST_STUCK = 16  #: turns before which a machine's session has not been everywhere
#: rad, of a turn's angle, and m/s^2, of a still's length, before any turn was seen: the data sheet's noise over 5 s and ``STILL_S``
PLANNED_SIGMA_RAD, PLANNED_TURN_S, PLANNED_SIGMA_MPS2 = 2e-4, 5.0, 0.05 * MG
#: rad/s: a machine's turns are rated again where the reading at rest has changed by more
ZERO_MOVED_RPS = 0.05 * DEG


@dataclass(frozen=True, eq=False)
class _Seen:
    """A segment: the force at its ends from which its columns were computed, columns (2, 21), noise (2, 2), its middle."""

    turn: AcceptedTurn
    ends: np.ndarray
    columns: np.ndarray
    own: np.ndarray


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """The session that a machine would make from now on: its turns, and the sigmas (P,) after each, in units of their targets."""

    turns: tuple[Turn, ...]
    sigmas: tuple[np.ndarray, ...]

    @property
    def unseen(self) -> np.ndarray:
        """(P,) whether no turn of it shows a parameter: it is above its target, and more turns change nothing."""
        return _stalled(self.sigmas[len(self.sigmas) // 2], self.sigmas[-1], len(self.sigmas))


class Coach:
    """A callable that returns ``Advice`` for the session so far.

    targets (12,) of the gyroscope's parameters.  machine: what turns the table, whose ``turns_from(angles, most_rps)`` are its
    turns from there; None: an operator.  Of a machine the gain per time counts, and what none of its turns shows does not.
    """

    def __init__(
        self,
        targets: np.ndarray = TARGETS,
        machine: Any = None,
    ):
        self._gyro_targets, self._machine = targets, machine
        self._seen: dict[int, _Seen] = {}
        self._progress = Progress(())
        self._accelerometer = as_known(None, ())
        self._own: OwnAccelerometer | None = None  # where the session calibrates its accelerometer
        self._zero_rps = np.zeros(3)  # of a machine's session: what the gyroscope reads at rest, which its scales multiply
        self._columns: dict[bytes, np.ndarray] = {}  # of a machine's turns, by where they begin and what they are
        self._turns: dict[int, tuple[list[Turn], bytes]] = {}  # the key of each list of turns, by its identity

    def __call__(self, progress: Progress) -> Advice:
        """Return advice from all segments so far (at least one)."""
        self.look(progress)
        sigma = self.sigma
        worst = np.argsort(-sigma)
        missing = tuple(_described(i, sigma[i]) for i in worst if sigma[i] > 1)
        if missing and not (sigma[~self._stuck] > 1).any():
            never = ", ".join(parameter_name(i) for i in worst if sigma[i] > 1)
            reason = f"all that this table can show has reached its target, or changes no more; it cannot show {never}"
            return Advice("", reason, True, missing, sigmas=_named(sigma))
        if not missing:
            reason = f"every parameter has reached its target; the worst is at {sigma[worst[0]]:.2f} of it"
            beyond = () if self._machine is None or not progress.stills else self.best_turn(progress.stills[-1].accel_mean).moves
            return Advice("", reason, reached=True, sigmas=_named(sigma), moves=beyond)
        # The board lies as in the last still, which need not be the end of an accepted turn.
        lies = progress.stills[-1] if progress.stills else progress.turns[-1].segment.stills[1]
        turn = self.best_turn(lies.accel_mean)
        reason = f"it helps the {_described(worst[0], sigma[worst[0]])}"
        moves = tuple(RequestedTurn(_vector(part.axis), part.angle_rad, words) for part, words in zip(turn.parts, turn.steps, strict=True))
        return Advice(turn.words, reason, False, missing, moves, _named(sigma), _vector(turn.up), turn.moves)

    @property
    def _stuck(self) -> np.ndarray:
        """(P,) whether a machine's turns show no more of a parameter: the second half of them has changed next to nothing of its sigma."""
        count = len(self._seen)
        if self._machine is None or count < FEWEST_STUCK:
            return np.zeros(len(self.targets), dtype=bool)
        return _stalled(self._sigma_of(count // 2), self.sigma, count)

    def rehearse(self, own: bool, most: int = MOST_TO_GO) -> Rehearsal:
        """Choose turn after turn of the machine, before any was made; own: whether the accelerometer is not calibrated.  It ends
        where every target is met."""
        alone = Coach(self._gyro_targets, machine=self._machine)
        alone._own, alone._zero_rps = alone._accelerometer if own else None, self._zero_rps
        prior = np.concatenate([linear.PRIOR_SIGMA, alone._accelerometer_prior])
        information, force, angles = np.diag((alone._units / prior) ** 2), np.array([0.0, 0.0, -G]), None
        turns, sigmas = list[Turn](), list[np.ndarray]()
        while len(turns) < most and not (sigmas and sigmas[-1].max() <= 1):
            turn, rows = alone._best(information, force, angles)
            information, force, angles = information + rows.T @ rows, turn.carries(force), turn.angles
            turns.append(turn)
            sigmas.append(sigmas_in(np.linalg.inv(information))[: len(alone.targets)])
        return Rehearsal(tuple(turns), tuple(sigmas))

    def look(self, progress: Progress) -> None:
        """Update the columns from the session so far."""
        self._progress = progress
        self._accelerometer = as_known(progress.accelerometer, progress.stills)
        self._own = self._accelerometer if progress.own else None
        if self._machine is not None and progress.turns:
            zero_rps = progress.turns[-1].segment.stills[1].gyro_mean
            if np.abs(zero_rps - self._zero_rps).max() > ZERO_MOVED_RPS:
                self._zero_rps, self._columns = zero_rps, {}
        before, self._seen = self._seen, {}
        for turn in progress.turns:
            found = before.get(id(turn))
            if found is None or (found.ends * self._directions(turn)).sum(axis=1).min() < MOVED:
                found = self._of(turn)
            self._seen[id(turn)] = found

    @property
    def targets(self) -> np.ndarray:
        """Targets (12,), or (21,) where the session also calibrates its accelerometer."""
        return self._gyro_targets if self._own is None else self._units

    @property
    def _units(self) -> np.ndarray:
        """(21,) in which the parameters of both sensors are computed: their targets."""
        return np.concatenate([self._gyro_targets, accel.TARGETS])

    @property
    def _accelerometer_prior(self) -> np.ndarray:
        """(9,) sigma of the accelerometer's parameters before the session."""
        given_mps2 = (self._progress.given_sigma_mg or GIVEN_SIGMA_MG) * MG
        return given_mps2 * units(G) if self._own is None else accel.PRIOR_SIGMA

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (21, 21) of both sensors, the accelerometer within its prior, as the sum of ``uncertainty.covariance_parts``, without
        errors shared by neighbours and the Earth's heading."""
        return self._covariance_of(len(self._seen))

    def _covariance_of(self, count: int) -> np.ndarray:
        """The same of the first turns alone."""
        seen = list(self._seen.values())[:count]
        own = np.array([each.own for each in seen])
        floor = Floor(own, np.zeros((len(own) - 1, 2, 2)))
        middle_s = np.array([each.turn.middle_s for each in seen])
        design, wander = np.array([each.columns for each in seen]), BiasWander(middle_s, PLANNED_INSTABILITY_RPS)
        gravity_mps2 = GRAVITY_SIGMA_MPS2 if self._own is None else 0.0  # a given calibration has a scale of its own
        lengths = np.zeros((design.shape[-1],) * 2)
        if self._progress.stills:
            of_stills = length_information(self._accelerometer, self._progress.stills, seen[-1].turn.noise, gravity_mps2)
            lengths[linear.PARAMETERS :, linear.PARAMETERS :] = of_stills
        return covariance_from_columns(design, floor, wander, self._accelerometer_prior, lengths)

    @property
    def sigma(self) -> np.ndarray:
        """One sigma (P,) of each parameter in units of its target."""
        return self._sigma_of(len(self._seen))

    def _sigma_of(self, count: int) -> np.ndarray:
        return sigmas_in(self._covariance_of(count))[: len(self.targets)] / self.targets

    def best_turn(self, measured: np.ndarray) -> Turn:
        """Return the best turn from where the accelerometer reads ``measured`` (3,) m/s^2."""
        force = self._accelerometer.accelerometer.correct(measured)
        return self._best(np.linalg.inv(self.covariance / np.outer(self._units, self._units)), force, None)[0]

    def _best(self, information: np.ndarray, force: np.ndarray, angles: np.ndarray | None) -> tuple[Turn, np.ndarray]:
        """Return the best rated turn, and its rows (3, 21), from where a session stands: information (21, 21) in units of the targets;
        force (3,) m/s^2 and angles (K,) rad, None: the present ones.

        The gain of a turn is the logarithm of what it makes of the criterion, and counts by its time.
        """
        most_rps = PLANNED_FULL_SCALE * self._progress.gyro_fs_rps
        if self._machine is None:
            turns = turns_from(force, QUARTERS if self._own is None else EIGHTHS, most_rps)
        else:
            turns = self._machine.turns_from(angles, most_rps)
            force = turns[0].up * np.linalg.norm(force)  # as the machine's angles have it: then the columns of a place are always the same
        rows = self._rows(force, turns) * self._units
        both = np.concatenate([information[None], information + rows.swapaxes(-1, -2) @ rows])  # without a turn, and with each
        covariance = np.linalg.inv(both)
        left = np.diagonal(covariance, axis1=-2, axis2=-1)
        # What no turn of a machine shows would keep it D-optimal for ever.
        shown = np.flatnonzero(~self._stuck if (~self._stuck).any() else np.ones(len(self.targets), dtype=bool))
        sigma = np.sqrt(left[0])
        unknown, sharpness = (UNKNOWN, SHARPNESS) if self._machine is None else (MACHINE_UNKNOWN, MACHINE_SHARPNESS)
        if sigma[shown].max() > unknown:
            criterion = np.linalg.slogdet(covariance[:, shown[:, None], shown])[1]
        elif shown[sigma[shown].argmax()] >= linear.PARAMETERS:
            # The accelerometer is least certain: choose the attitude for its worst parameter.
            criterion = np.log(left[:, shown[shown >= linear.PARAMETERS]].max(-1))
        else:
            criterion = np.log((left[:, shown] ** (sharpness / 2)).sum(-1))
        rating = (criterion[0] - criterion[1:]) / np.array([turn.cost_s for turn in turns])
        best = int(np.argmax(rating))
        return turns[best], rows[best]

    def _rows(self, force: np.ndarray, turns: list[Turn]) -> np.ndarray:
        """Return rows (M, 3, 21) of each turn over its noise: its two angles, and the length of gravity in the still after it."""
        seen = list(self._seen.values())
        variance = float(np.mean([np.trace(each.own) / 2 for each in seen])) if seen else PLANNED_SIGMA_RAD**2
        angle: np.ndarray | float = np.sqrt(variance)
        if self._machine is None:
            gyro = columns(force, turns, self._zero_rps) / angle
        else:  # its turns last from a second to ten, and white noise grows with time
            usual_s = float(np.mean([each.turn.samples.dt_s.sum() for each in seen])) if seen else PLANNED_TURN_S
            angle = np.sqrt(variance * np.array([turn.cost_s for turn in turns]) / usual_s)[:, None, None]
            if id(turns) not in self._turns:
                # Where a machine's turns begin and what they are, in the body's axes: turns that agree in both have the same columns.
                vectors = [turns[0].up, *(part.axis * part.angle_rad for turn in turns for part in turn.parts)]
                self._turns[id(turns)] = turns, bytes([len(turn.parts) for turn in turns]) + (np.round(vectors, 3) + 0.0).tobytes()
            key = self._turns[id(turns)][1]
            if key not in self._columns:
                self._columns[key] = columns(force, turns, self._zero_rps)
            gyro = self._columns[key] / angle
        q_first, q_last = ends(force, turns)
        last = np.array([turn.carries(force) for turn in turns])
        tilt = self._accelerometer.tilt_rows(np.broadcast_to(force, last.shape), last, q_first, q_last) / angle
        white = float(np.mean(seen[-1].turn.noise.velocity_random_walk ** 2)) / STILL_S if seen else PLANNED_SIGMA_MPS2**2
        length = self._accelerometer.length_rows(last)[:, None] / np.sqrt(white + self._accelerometer.sigma_mps2**2)
        nothing = np.zeros((len(turns), 1, linear.PARAMETERS))
        return np.concatenate([np.concatenate([gyro, tilt], axis=-1), np.concatenate([nothing, length], axis=-1)], axis=1)

    def _directions(self, turn: AcceptedTurn) -> np.ndarray:
        """Return the directions (2, 3) of gravity at both ends, by the estimated accelerometer."""
        force = force_of(turn.segment.stills)
        return unit_vectors(self._accelerometer.accelerometer.correct(force))

    def _of(self, turn: AcceptedTurn) -> _Seen:
        """Return a segment's columns for its two angles and their noise."""
        first, last = turn.segment.stills
        measured = turn.samples.gyro[None]
        bias = (first.gyro_mean + last.gyro_mean) / 2
        force = self._directions(turn)
        start, end = (rotation.from_gravity(direction)[None] for direction in force)
        # The bias is subtracted in place of the Earth's rate: the rest is the turn, accurate enough with sensor errors of 1 %.
        batch = Batch(measured, turn.samples.dt_s[None], np.broadcast_to(bias, measured.shape), start, end, yaw_known=False)
        attitudes = residual.attitudes(batch, measured)
        own = gyro_variance(batch, attitudes, [turn.noise])[0, :2, :2]
        tilt = sum(still_tilt_variance(still, turn.noise) for still in (first, last))
        design = linear.columns(residual.sensitivity(batch, measured), measured)[0, :2]
        lengths = np.array([still.gravity_mps2 for still in (first, last)])[:, None]
        if self._own is not None:
            tilt += 2 * float(np.mean((self._own.sigma_mps2 / lengths) ** 2))
        there = force * lengths
        at_ends = self._accelerometer.tilt_rows(there[:1], there[1:], attitudes[:, 0], attitudes[:, -1])[0]
        return _Seen(turn, force, np.concatenate([design, at_ends], axis=1), own + tilt * np.eye(2))


def _stalled(before: np.ndarray, sigma: np.ndarray, count: int) -> np.ndarray:
    """(P,) whether a sigma after so many turns is above its target, and falls too slowly to reach it."""
    white = (sigma > FALLS * before) & (count * sigma**2 > MOST_WORTH)
    return np.asarray((sigma > 1) & (white | (sigma > STALLED * before)))


def _vector(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _described(parameter: int, sigma: float) -> str:
    """Describe a parameter and how far it is from its target."""
    far = f"over {UNSEEN:.0f} times its target" if sigma >= UNSEEN else f"{sigma:.1f} times its target"
    return f"{parameter_name(parameter)} ({far})"


def parameter_name(parameter: int) -> str:
    """Return the display name of a parameter: the gyroscope's 12, then the accelerometer's nine."""
    gyro = parameter < linear.PARAMETERS
    return parameter_words(linear.NAMES[parameter]) if gyro else JOINT_NAMES[parameter - linear.PARAMETERS]


def _named(sigma: np.ndarray) -> tuple[tuple[str, float], ...]:
    return tuple((parameter_name(i), float(each)) for i, each in enumerate(sigma))
