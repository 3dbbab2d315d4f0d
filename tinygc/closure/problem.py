"""The problem that every method solves, with the same segments, references, Earth and floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.records import Count, Key, Share, Size
from session.base.results import Maybe, Number, Text
from session.base.texts import measured, probability, significant
from session.base.units import DEG, MG
from session.detect.accelerometer import DRIFTS, IDENTITY, NAMES, PARAMETERS, SCALES, ZeroDrift, corrected
from session.detect.bridging import GAP
from session.detect.findings import Finding
from session.detect.segments import FoundTurn, Segment
from session.detect.stills import Noise, SessionStills, Still, UnusedRest, references
from session.log.config import Accelerometer
from session.log.folder import Session
from session.log.logfile import Bridge
from session.log.samples import start_times
from tinygc.closure.earth import EarthRate
from tinygc.closure.floor import BiasInstability, BiasWander, Floor, bias_instability_of
from tinygc.closure.least_squares import OBSERVED_BELOW, GaussianPrior, StillRates
from tinygc.closure.residual import Batch
from tinygc.closure.stills import StillSet
from tinygc.models import linear
from tinygc.models.linear import LinearModel

# Noise figures of the unit that were measured at rest, for a session: the prior that they give, and whether the session agrees.
#
# ``tinygc.noise.measured`` makes these records of ``noise.json``.

#: a session contradicts the figures at rest where chance makes as much of a difference in one of a thousand, and it is this large: a
#: session's temperature, range and data rate are not those of the rest
CONTRADICTED_P, CONTRADICTED_RATIO = 1e-3, 1.1
WHAT = "noise at rest"
#: an interval that begins below the first ratio is stated as a limit; one that ends beyond the second, as two ratios
LEAST_RATIO, FAR = 0.1, 2.0


@dataclass(frozen=True)
class NoiseComparison:
    """Noise of a session over that at rest, rms: ratio, its 95 % interval low to high, and the p-value (two-sided) of the ratio 1."""

    written = ("ratio", "low", "high", "p_value", "contradicted")
    ratio: Size
    low: Size
    high: Size
    p_value: Share

    @property
    def contradicted(self) -> bool:
        """Whether the session contradicts the figures at rest."""
        return self.p_value < CONTRADICTED_P and not 1 / CONTRADICTED_RATIO < self.ratio < CONTRADICTED_RATIO

    @property
    def within(self) -> str:
        """How far from the figures at rest the session may be (95 %), in words."""
        if self.low < LEAST_RATIO:
            return f"at most {significant(self.high, 2)} times as large (95 %)"
        if self.high > FAR:
            return f"{significant(self.low, 2)} to {significant(self.high, 2)} times as large (95 %)"
        return f"within {significant(100 * max(1 - self.low, self.high - 1), 2)} % (95 %)"


@dataclass(frozen=True, eq=False)
class MeasuredNoise:
    """Noise figures at rest, in use for a session.

    path of the file, sha256 of it; instability: prior of the session's bias drift, None where the figures set none or are contradicted;
    white: of each axis, empty where the session shows none; drift: of all axes together, None where the session or the figures show none.
    """

    written = ("file", "sha256", "white", "drift")
    path: Path
    sha256: str
    instability: BiasInstability | None
    white: tuple[NoiseComparison, ...] = ()
    drift: NoiseComparison | None = None

    @property
    def file(self) -> str:
        """Name of the file."""
        return self.path.name

    @property
    def words(self) -> str:
        """Whether the session agrees with the figures, in one line."""
        parts = []
        if self.white and not any(each.contradicted for each in self.white):
            parts.append(f"white noise {max(self.white, key=lambda each: each.high - each.low).within}")
        if self.drift is not None and not self.drift.contradicted:
            parts.append(f"bias drift {self.drift.within}")
        return f"Noise at rest ({self.file}), not contradicted by this session: {'; '.join(parts)}." if parts else ""

    def findings(self, where: str) -> list[Finding]:
        """A warning for each figure that the session contradicts; a note for those that it does not."""
        found = []
        differs = [(each, f"white noise of the stills on {axis}") for each, axis in zip(self.white, "xyz", strict=False)]
        differs = [pair for pair in differs if pair[0].contradicted]
        if differs:
            found.append(_warning(where, *min(differs, key=lambda pair: pair[0].p_value), self.file, SHAKES))
        if self.drift is not None and self.drift.contradicted:
            found.append(_warning(where, self.drift, "bias drift from still to still", self.file, DRIFTS_DO, "; no prior of this session"))
        return found + ([Finding("note", where, WHAT, self.words)] if self.words else [])


SHAKES = "does the table shake? put it on a quiet floor"
DRIFTS_DO = "let the board warm up, fasten it and its cable, and hold it still for longer"


def _warning(where: str, found: NoiseComparison, what: str, file: str, do: str, more: str = "") -> Finding:
    ratio, low, high = (significant(value, 3) for value in (found.ratio, found.low, found.high))
    text = f"{what}: {ratio} times that of {file} (95 %: {low} to {high}; {probability(found.p_value)}){more}"
    of_file = f"is {file} of this unit, in this range? measure it again with noise record"
    return Finding("warning", where, WHAT, text, f"{do}; {of_file}" if found.ratio > 1 else of_file)


# Reasons for rejecting a segment, as the report prints them.

#: reasons for rejecting a segment
LEFT_OUT, CLIPPED, NOT_TAKEN = "left out by request", "its rates stand at a ceiling", "others stand for it"


# The joint estimate of accelerometer and gyroscope, and its final linear system.

#: positions of the accelerometer's parameters, the gyroscope's and gravity's length in the joint vector
ACCELEROMETER = slice(0, PARAMETERS)
GYROSCOPE = slice(PARAMETERS, PARAMETERS + linear.PARAMETERS)
GRAVITY = GYROSCOPE.stop
COUNT = GRAVITY + 1
#: those of a drift of the accelerometer's zero, m/s^2 over the session, behind them where one is fitted
DRIFT = slice(COUNT, COUNT + DRIFTS)
#: sigmas by which a parameter must change to be reported
REPORTED_SIGMAS = 3.0


@dataclass(frozen=True, eq=False)
class JointSystem:
    """The linear system at the end of the search.

    P is COUNT, or three more where a drift of the accelerometer's zero is fitted (``DRIFT``).
    design (n, P), values (n,): S d rows of the closure, then those of the lengths, in rad and m/s^2; root (n,): square roots of their
    weights; prior (P,) sigmas; x (P,): point of linearisation, relative to the prior's centre; vague: whether the prior is
    uninformative on the accelerometer and only bounds what no row observes.
    """

    design: np.ndarray
    values: np.ndarray
    root: np.ndarray
    prior: np.ndarray
    x: np.ndarray
    vague: bool

    def solve(self, root: np.ndarray | None = None) -> np.ndarray:
        """Solution (P,) relative to the prior's centre.

        With a vague prior, directions not observed above the noise stay at the prior's centre.
        """
        root = self.root if root is None else root
        left, strength, right = np.linalg.svd(self.design * root[:, None] * self.prior, full_matrices=False)
        aim = left.T @ (root * (self.design @ self.x - self.values)) * strength / (strength**2 + 1)
        rank = int(np.sum(strength**2 > OBSERVED_BELOW**-2 - 1)) if self.vague else len(self.x)
        return self.prior * (aim[:rank] @ right[:rank])

    @property
    def covariance(self) -> np.ndarray:
        """(P, P) covariance for independent errors of the rows."""
        scaled = self.design * self.root[:, None] * self.prior
        return np.linalg.inv(scaled.T @ scaled + np.eye(len(self.x))) * np.outer(self.prior, self.prior)

    @property
    def response(self) -> np.ndarray:
        """(P, n) derivative of the estimate with respect to the error of each row."""
        return -self.covariance @ (self.design * self.root[:, None] ** 2).T


@dataclass(frozen=True, eq=False)
class JointFit:
    """Joint estimate of accelerometer and gyroscope.

    mode: ``fit`` or ``prior``; accelerometer: the new calibration; x (9,): its correction of the previous one; unobserved: names of the
    parameters observed by neither lengths nor turns; p_value: of the given calibration, None if it was not computed; system; first, last
    (S,): the stills of each used segment; force (Q, 3) m/s^2 under the new calibration; before, after (Q,) m/s^2: length errors.
    drift: of the accelerometer's zero, None where it was not fitted; share (Q,): the stills' times
    as shares of the session from its middle.
    """

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
    share: np.ndarray
    drift: ZeroDrift | None = None

    @property
    def own(self) -> np.ndarray:
        """Indices (9,), or (12,) where a drift is fitted, of the accelerometer's numbers in the joint vector."""
        return np.r_[ACCELEROMETER, COUNT : len(self.system.x)]

    @property
    def prior(self) -> np.ndarray:
        """(9,) prior sigmas of ``x``."""
        return self.system.prior[ACCELEROMETER]

    @property
    def beforehand(self) -> np.ndarray:
        """(9, 10): change of ``x`` for one prior sigma of each of its parameters and of gravity's length; with a drift (12, 13)."""
        known = [*self.own, GRAVITY]
        return self.system.covariance[self.own][:, known] / self.system.prior[known]

    @property
    def covariance(self) -> np.ndarray:
        """(9, 9) covariance of ``x`` for independent errors of lengths and turns."""
        return self.system.covariance[ACCELEROMETER, ACCELEROMETER]

    @property
    def words(self) -> str:
        """The parameters that changed by more than three sigmas, mg at one g; if none did, the most significant one.

        Scales are relative to their mean: a scale common to all axes is not separated from gravity's length.
        """
        observed = np.eye(PARAMETERS)
        observed[np.ix_(SCALES, SCALES)] -= 1 / 3
        scale = np.concatenate([np.full(6, 1e-3), np.full(3, MG)])
        off, sigma = observed @ (self.x - IDENTITY) / scale, sigmas_in(observed @ self.covariance @ observed.T) / scale
        sure = np.abs(off) > REPORTED_SIGMAS * sigma
        sure[np.argmax(np.abs(off) / sigma)] = True
        found = zip(NAMES, off, sigma, sure, strict=True)
        return ", ".join(f"{name} by {measured(value, s)} mg" for name, value, s, there in found if there)

    def moved(self, force: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Convert forces (Q, 3) m/s^2 from the previous calibration to the new one, at these shares (Q,) of the session."""
        return corrected(self.x, force - share[:, None] * self._drift(self.system.x))

    def _drift(self, x: np.ndarray) -> np.ndarray:
        """(3,) m/s^2 over the session of a joint vector, in the force of the previous calibration; zeros where none is fitted."""
        return x[DRIFT] if len(x) > COUNT else np.zeros(DRIFTS)

    def without(self, left_out: np.ndarray, batch: Batch) -> Batch:
        """The batch with references from an estimate without the closure of the segments ``left_out`` (S,) bool."""
        root = self.system.root.copy()
        root[: len(left_out) * batch.angles][np.repeat(left_out, batch.angles)] = 0.0
        return self.shifted(batch, self.system.solve(root) - self.system.solve())

    def shifted(self, batch: Batch, moved: np.ndarray) -> Batch:
        """The batch with references from a joint vector that is another by ``moved`` (P,)."""
        force = self.force - self.share[:, None] * self._drift(moved)
        return bent(batch, self.first, self.last, corrected(IDENTITY + moved[ACCELEROMETER], force))


def bent(batch: Batch, first: np.ndarray, last: np.ndarray, force: np.ndarray) -> Batch:
    """A batch with the tilt at its ends from forces (Q, 3) of the stills; the yaw is kept."""
    tilt = rotation.from_gravity(force)
    return replace(batch, start=rotation.nearest_yaw(batch.start, tilt[first]), end=rotation.nearest_yaw(batch.end, tilt[last]))


# Segments less certain than their noise, each with its cause: bridged readings, or an impact not resolved by the readings.
#
# The extra variance applies to the end attitude of that segment alone and is part of the floor (``Floor.wider``).


@dataclass(frozen=True)
class Widening:
    """Extra uncertainty of one segment.

    segment: its number; cause: ``gap``, ``clipped`` or ``impact``; sigma_rad: added rms tilt; description: with its place.
    """

    segment: Count
    cause: Annotated[str, Text(("gap", "clipped", "impact"))]
    sigma_rad: Annotated[float, Maybe(Number(0)), Key("sigma_deg", DEG)]
    description: str

    @property
    def words(self) -> str:
        """Description with the added uncertainty, for a table."""
        return f"{self.description}: weighed down, ± {significant(self.sigma_rad / DEG, 2)}° of tilt more"


def weighed_down(session: str, widened: Sequence[Widening]) -> list[Finding]:
    """Findings on a session's segments of lower weight, one line per cause."""
    found = []
    for cause in dict.fromkeys(each.cause for each in widened):
        mine = [each for each in widened if each.cause == cause]
        worst = max(mine, key=lambda each: each.sigma_rad)
        many = f"{len(mine)} segments, most of all segment" if len(mine) > 1 else "segment"
        text = f"{many} {worst.segment}: {worst.words}"
        found.append(Finding("note", session, f"weighed down ({cause})", text, "what they miss beyond that is looked at"))
    return found


def widened_by_bridges(
    segments: Sequence[Segment], bridges: Sequence[tuple[Bridge, ...]], attitudes: np.ndarray
) -> tuple[np.ndarray, list[Widening]]:
    """(S, 3, 3) rad^2, table axes, that bridged readings add to the ends of S segments with attitudes q_tb (S, T, 4), and the causes."""
    more, found = np.zeros((len(segments), 3, 3)), []
    for i, segment in enumerate(segments):
        for cause, inside in _inside(segment, bridges[segment.log]).items():
            added = np.zeros((3, 3))
            for bridge in inside:
                turn = rotation.matrix(attitudes[i, bridge.row - segment.start])
                added += turn @ np.diag(bridge.sigma_rad**2) @ turn.T
            more[i] += added
            found.append(Widening(segment.number, cause, float(np.sqrt(added[0, 0] + added[1, 1])), _words(cause, inside)))
    return more, found


def bridged_sigma(segments: Sequence[Segment], bridges: Sequence[tuple[Bridge, ...]]) -> np.ndarray:
    """(S,) rad: uncertainty that bridged readings add to each of S segments, over all directions; no attitude is needed."""
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


# The problem that every method solves.


@dataclass(frozen=True, eq=False)
class Problem:
    """The data of a fit.

    segments: all of them, accepted or not; batch: the accepted ones, in order; floor of the batch; earths by yaw group; logs: stills
    by log; first: the linear fit that carried the yaw; still_rates of every reference still; found: the session's stills as detected,
    for its closure runs; rest_rps: the mean bias (3,) rad/s, in measured units, if the bias of each turn is fixed from its stills
    (``build.with_still_bias``), else None; joint: the joint estimate behind the references, if any; known_turns: those of ``turns.csv``,
    used or with the reason for rejection; widened: used segments that are less certain than their noise, with causes; prior: of the
    gyroscope, None for the weak default prior; at_rest: noise figures of the unit, None where none were measured;
    folds: the problem for each fold, where what was taken out of its readings was fitted without the fold's segments.
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
    at_rest: MeasuredNoise | None = None
    folds: tuple[Problem, ...] = ()

    def __repr__(self) -> str:
        return f"<Problem {self.session.name}: {len(self.stills)} stills, {len(self.used)} of {len(self.segments)} segments used>"

    @property
    def earth(self) -> EarthRate:
        """The Earth's rate of the yaw group with the most stills."""
        groups = np.concatenate([log.references.group for log in self.logs])
        return self.earths[int(np.bincount(groups, minlength=1).argmax())]

    @property
    def references(self) -> list[tuple[int, Still]]:
        """The stills that are references, each with the number of its log."""
        return [(number, still) for number, log in enumerate(self.logs) for still in references(log.stills)]

    @cached_property
    def used(self) -> list[Segment]:
        """The accepted segments, in order."""
        return [segment for segment in self.segments if segment.accepted]

    @property
    def began_s(self) -> np.ndarray:
        """(logs + 1,) session time at which each log begins and the last one ends, s."""
        return start_times(log.samples for log in self.logs)

    @property
    def middle_s(self) -> np.ndarray:
        """(S,) session time at the middle of each used segment, s; logs follow each other."""
        began = self.began_s
        return np.array([began[segment.log] + segment.start_s + segment.duration_s / 2 for segment in self.used])

    @cached_property
    def instability(self) -> BiasInstability:
        """Bias instability of the gyro: measured at rest, given, typical of the sensor model, or estimated from the stills."""
        if self.at_rest is not None and self.at_rest.instability is not None:
            return self.at_rest.instability
        return bias_instability_of(self.session.config.sensor, self.logs, self.earths)

    def changed(self, **fields: Any) -> Problem:
        """Replace fields; a bias instability that is already computed is kept."""
        other = replace(self, **fields)
        if "instability" in self.__dict__ and "at_rest" not in fields:
            other.__dict__["instability"] = self.instability
        return other

    def without(self, held: np.ndarray, why: str = LEFT_OUT) -> Problem:
        """The problem without the used segments held (S,) bool, and without the stills that only they touch; its bias instability is
        estimated from its own stills where possible."""
        used = self.used
        left, kept = ([used[i] for i in np.flatnonzero(which)] for which in (held, ~held))
        ends, others = ({id(still) for segment in part for still in (segment.first, segment.last)} for part in (left, kept))
        gone = (ends - others) | {id(segment) for segment in left}

        def marked(parts: list[Any]) -> list[Any]:
            return [replace(part, problem=why) if id(part) in gone else part for part in parts]

        return replace(
            self,
            segments=marked(self.segments),
            batch=self.batch.pick(~held),
            floor=self.floor.pick(~held),
            logs=[replace(log, stills=marked(log.stills)) for log in self.logs],
            still_rates=self.still_rates.pick(np.array([id(still) not in gone for _, still in self.references], dtype=bool)),
        )

    @property
    def wander(self) -> BiasWander:
        """Bias drift between the used segments."""
        return BiasWander(self.middle_s, self.instability.rps)

    @property
    def stills(self) -> list[Still]:
        """The stills of all logs, in order."""
        return [still for log in self.logs for still in log.stills]

    @property
    def unused_rests(self) -> list[tuple[str, UnusedRest]]:
        """Rests that are no reference, with their log's file, in order; none with a further reference."""
        if self.session.reference is not None:
            return []
        return [(log.path.name, rest) for log in self.session.logs for rest in self.found.of(log).unused]

    @property
    def noise(self) -> Noise:
        """Noise of all logs, averaged with the duration of their stills as weights; equal weights if there are none."""
        weights = [sum(still.duration_s for still in log.stills) for log in self.logs]
        weights = weights if any(weights) else [1.0] * len(weights)
        power = (np.average([getattr(log.noise, name) ** 2 for log in self.logs], axis=0, weights=weights) for name in ("gyro", "accel"))
        return Noise(*map(np.sqrt, power))


#: adds noise figures at rest to a problem; None where there are none
AtRest = Callable[[Problem], MeasuredNoise | None]
