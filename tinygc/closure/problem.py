"""The problem that every method solves: the same segments, references, Earth and floor for all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from session.detect.accelerometer import IDENTITY, NAMES, PARAMETERS, SCALES, corrected
from session.detect.bridging import GAP
from session.detect.findings import Finding
from session.detect.segments import FoundTurn, Segment
from session.detect.stills import Noise, SessionStills, Still, UnusedRest
from session.io.config import Accelerometer
from session.io.folder import Session
from session.io.logfile import Bridge
from session.io.samples import start_times
from session.io.units import DEG, MG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.earth import EarthRate
from tinygc.attitude.rotation import Array
from tinygc.closure.allan import bias_instability_of
from tinygc.closure.floor import BiasInstability, BiasWander, Floor
from tinygc.closure.least_squares import OBSERVED_BELOW, StillRates
from tinygc.closure.prior import GaussianPrior
from tinygc.closure.residual import Batch
from tinygc.closure.stills import StillSet
from tinygc.effects import Conditions
from tinygc.models import linear
from tinygc.models.linear import LinearModel

# Why a segment is not used, in words that a report prints.

#: why a segment is not used
LEFT_OUT, CLIPPED = "left out by request", "its rates stand at a ceiling"


# What an estimation of accelerometer and gyroscope together gives, and the linear system where it ended.

#: where the accelerometer's numbers, the gyroscope's and gravity's length stand among what is estimated
ACCELEROMETER = slice(0, PARAMETERS)
GYROSCOPE = slice(PARAMETERS, PARAMETERS + linear.PARAMETERS)
GRAVITY = GYROSCOPE.stop
COUNT = GRAVITY + 1
#: a number that differs from what it was by so many sigmas is said
SAID_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class JointSystem:
    """The linear system where the search ended.

    design (n, COUNT), values (n,): rows of the closure, S d of them, then of the lengths, in rad and m/s^2; root (n,) of their weights;
    prior (COUNT,) sigmas; x (COUNT,) where it was linearised, from the prior's centre; vague: whether the prior says nothing of the
    accelerometer, and only bounds what no row tells.
    """

    design: np.ndarray
    values: np.ndarray
    root: np.ndarray
    prior: np.ndarray
    x: np.ndarray
    vague: bool

    def solve(self, root: np.ndarray | None = None) -> np.ndarray:
        """(COUNT,) from the prior's centre.

        What noise alone lets a direction seem to do is no observation: where the prior is vague, it stays there.
        """
        root = self.root if root is None else root
        left, strength, right = np.linalg.svd(self.design * root[:, None] * self.prior, full_matrices=False)
        aim = left.T @ (root * (self.design @ self.x - self.values)) * strength / (strength**2 + 1)
        rank = int(np.sum(strength**2 > OBSERVED_BELOW**-2 - 1)) if self.vague else COUNT
        return self.prior * (aim[:rank] @ right[:rank])

    @property
    def covariance(self) -> np.ndarray:
        """(COUNT, COUNT), as if the rows erred independently."""
        scaled = self.design * self.root[:, None] * self.prior
        return np.linalg.inv(scaled.T @ scaled + np.eye(COUNT)) * np.outer(self.prior, self.prior)

    @property
    def response(self) -> np.ndarray:
        """(COUNT, n): how the estimate follows an error of each row."""
        return -self.covariance @ (self.design * self.root[:, None] ** 2).T

    @property
    def leaning(self) -> np.ndarray:
        """(COUNT, COUNT): how the estimate follows an error of what is known beforehand."""
        return self.covariance / self.prior**2


@dataclass(frozen=True, eq=False)
class JointFit:
    """mode: ``fit`` or ``prior``; accelerometer: what was found; x (9,): its correction of the one before; unobserved: names of the numbers
    that neither lengths nor turns tell; p_value: of a given calibration's lengths and closures by chance, None where it was not asked for;
    system; first, last (S,): the stills of each used segment; force (Q, 3) m/s^2 under the new calibration; before, after (Q,) m/s^2 by
    which lengths miss gravity's."""

    mode: str
    accelerometer: Accelerometer
    x: np.ndarray
    model: LinearModel
    unobserved: tuple[str, ...]
    p_value: float | None
    system: JointSystem
    first: np.ndarray
    last: np.ndarray
    force: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @property
    def prior(self) -> np.ndarray:
        """(9,) sigmas of what is known of ``x`` beforehand."""
        return self.system.prior[ACCELEROMETER]

    @property
    def beforehand(self) -> np.ndarray:
        """(9, 10): how ``x`` follows one sigma of what is known of each of its numbers beforehand, and of gravity's length."""
        known = [*range(PARAMETERS), GRAVITY]
        return self.system.leaning[ACCELEROMETER][:, known] * self.system.prior[known]

    @property
    def covariance(self) -> np.ndarray:
        """(9, 9) of ``x``, as if lengths and turns erred independently."""
        return self.system.covariance[ACCELEROMETER, ACCELEROMETER]

    @property
    def words(self) -> str:
        """The numbers that differ from those before by more than three sigmas, mg at one g; the largest, where none does.

        Scales against their mean: what all axes share is gravity's length, which is not known as well.
        """
        told = np.eye(PARAMETERS)
        told[np.ix_(SCALES, SCALES)] -= 1 / 3
        scale = np.concatenate([np.full(6, 1e-3), np.full(3, MG)])
        off, sigma = told @ (self.x - IDENTITY) / scale, np.sqrt(np.diag(told @ self.covariance @ told.T)) / scale
        sure = np.abs(off) > SAID_SIGMAS * sigma
        sure[np.argmax(np.abs(off) / sigma)] = True
        found = zip(NAMES, off, sigma, sure, strict=True)
        return ", ".join(f"{name} by {value:.2g} ± {s:.1g} mg" for name, value, s, there in found if there)

    def moved(self, force: np.ndarray) -> np.ndarray:
        """Forces (..., 3) m/s^2 of the calibration before under the new one."""
        return corrected(self.x, force)

    def without(self, left_out: np.ndarray, batch: Batch) -> Batch:
        """A batch of the same segments with the references that an estimation without the closure of some (S,) bool gives."""
        root = self.system.root.copy()
        root[: len(left_out) * batch.angles][np.repeat(left_out, batch.angles)] = 0.0
        moved = self.system.solve(root)[ACCELEROMETER] - self.system.solve()[ACCELEROMETER]
        return bent(batch, self.first, self.last, corrected(IDENTITY + moved, self.force))


def bent(batch: Batch, first: np.ndarray, last: np.ndarray, force: np.ndarray) -> Batch:
    """A batch with the tilt at its ends that forces (Q, 3) of the stills give, each with the yaw that it had."""
    tilt = rotation.from_gravity(force)
    return replace(batch, start=closure.nearest_yaw(batch.start, tilt[first]), end=closure.nearest_yaw(batch.end, tilt[last]))


# Segments that are less certain than their noise says, each with its cause: what was bridged in them, or an impact that no reading shows.
#
# The extra variance belongs to the end attitude of that segment alone, and stands in the floor (``Floor.wider``).


@dataclass(frozen=True)
class Widening:
    """segment: its number; cause: ``gap``, ``clipped`` or ``impact``; sigma_rad: rms of tilt that it adds; says: what happened, where."""

    segment: int
    cause: str
    sigma_rad: float
    says: str

    @property
    def words(self) -> str:
        """For a table: what happened, and what it costs."""
        return f"{self.says}: weighed down, ± {self.sigma_rad / DEG:.2g}° of tilt more"

    def to_json(self) -> dict:
        """One of ``segments.widened`` of ``tinygc-fit/1``."""
        return {"segment": self.segment, "cause": self.cause, "sigma_deg": self.sigma_rad / DEG, "says": self.says}


def weighed_down(session: str, widened: Sequence[Widening]) -> list[Finding]:
    """What is to be said of a session's segments that are less certain than the others, one line a cause."""
    found = []
    for cause in dict.fromkeys(each.cause for each in widened):
        mine = [each for each in widened if each.cause == cause]
        worst = max(mine, key=lambda each: each.sigma_rad)
        many = f"{len(mine)} segments, most of all segment" if len(mine) > 1 else "segment"
        says = f"{many} {worst.segment}: {worst.words}"
        found.append(Finding("note", session, f"weighed down ({cause})", says, "what they miss beyond that is looked at"))
    return found


def widened_by_bridges(
    segments: Sequence[Segment], bridges: Sequence[tuple[Bridge, ...]], attitudes: np.ndarray
) -> tuple[np.ndarray, list[Widening]]:
    """(S, 3, 3) rad^2 that bridged readings (of each log) add to the ends of S segments with attitudes q_tb (S, T, 4), table axes."""
    more, said = np.zeros((len(segments), 3, 3)), []
    for i, segment in enumerate(segments):
        for cause, inside in _inside(segment, bridges[segment.log]).items():
            added = np.zeros((3, 3))
            for bridge in inside:
                turn = rotation.matrix(attitudes[i, bridge.row - segment.start])
                added += turn @ np.diag(bridge.sigma_rad**2) @ turn.T
            more[i] += added
            said.append(Widening(segment.number, cause, float(np.sqrt(added[0, 0] + added[1, 1])), _words(cause, inside)))
    return more, said


def bridged_sigma(segments: Sequence[Segment], bridges: Sequence[tuple[Bridge, ...]]) -> np.ndarray:
    """(S,) rad of each of S segments, whichever way it lies: the same before any attitude is known."""
    inside = [[bridge for each in _inside(s, bridges[s.log]).values() for bridge in each] for s in segments]
    return np.array([np.sqrt(sum(float(bridge.sigma_rad @ bridge.sigma_rad) for bridge in own)) for own in inside])


def _inside(segment: Segment, bridges: tuple[Bridge, ...]) -> dict[str, list[Bridge]]:
    found: dict[str, list[Bridge]] = {}
    for bridge in bridges:
        if segment.start <= bridge.row < segment.stop:
            found.setdefault(bridge.what, []).append(bridge)
    return found


def _words(cause: str, bridges: list[Bridge]) -> str:
    count, where = sum(bridge.count for bridge in bridges), f"at {bridges[0].at_s:.2f} s"
    where += f" and {len(bridges) - 1} more place{'s' * (len(bridges) != 2)}" if len(bridges) > 1 else ""
    if cause == GAP:
        return f"{count} sample{'s are' if count > 1 else ' is'} missing {where}, put in from the neighbours"
    return f"{count} reading{'s' * (count > 1)} at the register's end {where}, what was beyond estimated from the neighbours"


# What every method solves: the same segments, references, Earth and floor for all.


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted.

    segments: all of them, accepted or not; batch: the accepted ones, in order; floor of the batch; earths by yaw group; logs: stills
    by log; first: the linear fit that carried the yaw; still_rates of every reference still; found: the session's stills as they were
    found, for its closure runs; rest_rps: the mean bias (3,) rad/s, as it is measured, where the batch has every turn at it by the
    stills on either side (``still_bias.py``), else None; joint: the estimation of both sensors that its references are of, if there
    was one; known_turns: those of ``turns.csv``, used or with the reason why not; widened: used segments that are less certain than
    their noise, and why; prior: what is known of the gyroscope beforehand, None for no more than that a fit must not wander.
    """

    session: Session
    segments: list[Segment]
    batch: Batch
    floor: Floor
    earths: dict[int, EarthRate]
    logs: list[StillSet]
    first: LinearModel
    still_rates: StillRates
    found: SessionStills
    rest_rps: np.ndarray | None = None
    joint: JointFit | None = None
    known_turns: tuple[FoundTurn, ...] = ()
    widened: tuple[Widening, ...] = ()
    prior: GaussianPrior | None = None

    def __repr__(self) -> str:
        return f"<Problem {self.session.name}: {len(self.stills)} stills, {len(self.used)} of {len(self.segments)} segments used>"

    @property
    def earth(self) -> EarthRate:
        """Of the yaw group with the most stills."""
        groups = np.concatenate([log.group[[still.problem is None for still in log.stills]] for log in self.logs])
        return self.earths[int(np.bincount(groups, minlength=1).argmax())]

    @property
    def used(self) -> list[Segment]:
        """The accepted segments, in order."""
        return [segment for segment in self.segments if segment.accepted]

    @property
    def began_s(self) -> np.ndarray:
        """(logs + 1,) s of the session at which each log begins, and at which the last one ends."""
        return start_times(log.samples for log in self.logs)

    @property
    def middle_s(self) -> np.ndarray:
        """(S,) s of the session at the middle of each used segment, logs one after the other."""
        began = self.began_s
        return np.array([began[segment.log] + segment.start_s + segment.duration_s / 2 for segment in self.used])

    @cached_property
    def instability(self) -> BiasInstability:
        """Of the gyro's bias: given, typical of the model, or estimated from the stills."""
        return bias_instability_of(self.session.config.sensor, self.logs, self.earths)

    def changed(self, **fields: Any) -> Problem:
        """Of the same recording, whose bias instability it shares if that is known already."""
        other = replace(self, **fields)
        if "instability" in self.__dict__:
            other.__dict__["instability"] = self.instability
        return other

    @property
    def wander(self) -> BiasWander:
        """Of the bias between the used segments."""
        return BiasWander(self.middle_s, self.instability.rps)

    @property
    def stills(self) -> list[Still]:
        """Of all logs, in order."""
        return [still for log in self.logs for still in log.stills]

    @property
    def unused_rests(self) -> list[tuple[str, UnusedRest]]:
        """Rests of the logs that are no reference, with their log's file, in order; none where the reference is a truth file."""
        if self.session.truths is not None:
            return []
        return [(log.path.name, rest) for log in self.session.logs for rest in self.found.of(log).unused]

    @property
    def noise(self) -> Noise:
        """Of all logs together, by how much stillness each has, or all alike where there is none."""
        weights = [sum(still.duration_s for still in log.stills) for log in self.logs]
        weights = weights if any(weights) else [1.0] * len(weights)
        power = (np.average([getattr(log.noise, name) ** 2 for log in self.logs], axis=0, weights=weights) for name in ("gyro", "accel"))
        return Noise(*map(np.sqrt, power))


# What effects refer to, of a whole session.


def conditions(problem: Problem) -> Conditions:
    """Of a session."""
    first = problem.logs[0].samples
    return Conditions(
        duration_s=float(problem.began_s[-1]),
        fs_rps=problem.session.config.sensor.gyro_fs_dps * DEG,
        first_temp_c=float("nan") if first.temp_c is None else float(first.temp_c[: max(1, round(1 / first.period_s))].mean()),
    )


# Sequences of m parts with an end reference each (the paper's Figure 4): the attitude is carried from part to part, not begun anew.
#
# A part is a segment; parts are joined where one begins where the other has ended.  A single segment is a sequence of one part.
# Carried, an error that each part leaves adds up where a segment alone would show it once, and what the inner references cost in noise
# is spent once; no reference is new.


def consecutive(segments: Sequence[Segment]) -> np.ndarray:
    """(S,) numbers that count on by one where a segment begins with the still, or the moment, that the one before ended with."""
    numbers = [0]
    for before, after in pairwise(segments):
        joined = before.log == after.log and (before.last is after.first if after.first is not None else before.stop == after.start + 1)
        numbers.append(numbers[-1] + (1 if joined else 2))
    return np.array(numbers[: len(segments)], dtype=int)


def previous(order: np.ndarray, parts: int) -> np.ndarray:
    """(S,) the row that each part goes on from, -1 where a sequence begins: at every ``parts``-th number, and after a gap."""
    rows = np.arange(len(order))
    joined = np.zeros(len(order), dtype=bool)
    joined[1:] = (np.diff(order) == 1) & (order[1:] % parts != 0)
    return np.where(joined, rows - 1, -1)


def place(before: np.ndarray) -> np.ndarray:
    """(S,) the place of each part within its sequence, from 0."""
    at = np.zeros(len(before), dtype=int)
    for row, one in enumerate(before):
        at[row] = 0 if one < 0 else at[one] + 1
    return at


def residuals(batch: Batch, rate: Array, before: np.ndarray, integrator: str = "exact") -> Array:
    """As ``closure.segment_residuals``, each part begun at the attitude that the one before was predicted to end with; NumPy or torch."""
    return residuals_of_turns(batch, closure.turned(batch, rate, integrator), before)


def residuals_of_turns(batch: Batch, turn: Array, before: np.ndarray) -> Array:
    """The same of what the body turns by (S, 4) in each part."""
    start, first = (closure.like(turn, array) for array in (batch.start, (before < 0)[:, None]))
    end = rotation.multiply(start, turn)
    xp = rotation.namespace(turn)
    rows = np.maximum(before, 0)
    for _ in range(int(place(before).max())):
        end = rotation.multiply(xp.where(first > 0, start, end[rows]), turn)
    return closure.batch_residual(batch, end, turn)


def carried(design: np.ndarray, before: np.ndarray, turns_known: bool = False) -> np.ndarray:
    """(S, d, P) of each part with what it carries from those before: errors add up in the table frame, to first order.

    turns_known: the third component is a turn's angle about its own axis, which carries nothing.
    """
    total, d = design.copy(), 2 if turns_known else design.shape[1]
    for row, one in enumerate(before):
        if one >= 0:
            total[row, :d] += total[one, :d]
    return total


def carried_sigma(sigma: np.ndarray, before: np.ndarray, turns_known: bool = False) -> np.ndarray:
    """(S, …) rad: as if the parts' noises were independent."""
    return np.sqrt(carried(sigma**2, before, turns_known))
