"""Why a calibration does not hold: causes, each a few numbers of a physical size, compared by the evidence for them.

    r = -A d - X theta + noise,        theta ~ N(0, s^2 D^2),   s equally probable at every scale up to 1
    p(r | cause) = mean over s of N(r; 0, S + s^2 X D^2 X')

theta is what the sensor does: an axis that reads too much has a scale above zero.  S holds what is expected without a fault, and
today's noise, whose components are estimated again with each cause: variance that a cause takes over from the noise counts for it.  A
cause has the prior odds of an effect in ``explain``, and so has each further one; up to ``MOST`` are combined.  One that is sought at many
times pays for them.  This recording does not separate the best set from sets within ``AS_PROBABLE`` of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.texts import command_line, measured
from session.base.units import DEG, MG
from session.detect.accelerometer import BIASES
from session.detect.accelerometer import SCALES as SCALES_OF_ACCELEROMETER
from tinygc.closure.motion import MINUTE_S
from tinygc.estimation.spread import ACCELEROMETER, COUNT, GYROSCOPE, ZERO
from tinygc.features.unit.verification.questions import ExpectedPart
from tinygc.features.unit.verification.rows import Rows
from tinygc.fitting.unit_state import UnitState
from tinygc.inference.choose import AS_PROBABLE, PRIOR_ODDS, climb, log_evidence, rivals_of, scales_of, weights_of
from tinygc.inference.solve import solve_lower
from tinygc.models.linear import MATRIX, LinearModel

#: causes in one explanation at most
MOST = 3
#: times of a step that are tried at most, and time constants of a warm-up, as shares of the session
MOST_STEPS, WARM_UP_SHARES = 12, (0.1, 0.2, 0.4, 0.8, 1.6)
#: physical sizes of each cause, one sigma of a large one
ZERO_RPS = 2 * DEG
PER_K = 0.1 * DEG
SCALE, COMMON_SCALE, ROTATION_RAD, SHEAR_RAD = 0.02, 0.5, 0.05, 0.01
ACCEL_ZERO_MPS2, ACCEL_SCALE = 50 * MG, 0.02
BANDWIDTH_S2 = 1e-4
#: causes a part of which is expected: their place among the 21 parameters, and the sign of what the sensor does
WITH_USUAL: dict[str, tuple[Any, int]] = {"bias": (ZERO, -1), "accelerometer's bias": (BIASES, 1)}


@dataclass(frozen=True, eq=False)
class Cause:
    """A cause: name; claim: what has changed; columns (n, k) of the rows for one plausible size of each number; into (21, k) that of the
    parameters, in the first minute of today's motion where it changes with time; unit and si of the numbers; sizes (k,), SI; at: time of a
    step or time constant, s; numbers: what theta's numbers are called; advice: what to do; price: ln of how many times were tried for it;
    of_correction: whether theta is how much less the correction is, so that the sensor reads 1 / (1 - theta) as much."""

    name: str
    claim: str
    columns: np.ndarray
    into: np.ndarray
    sizes: np.ndarray
    unit: str | tuple[str, ...]
    si: float | np.ndarray
    numbers: tuple[str, ...]
    advice: str
    at: float | None = None
    price: float = 0.0
    of_correction: bool = False

    def stated(self, theta: np.ndarray, sigma: np.ndarray) -> StatedCause:
        """The cause with its numbers."""
        if self.of_correction:
            theta, sigma = 1 / (1 - theta) - 1, sigma / (1 - theta) ** 2
        units, si = self.unit, self.si
        if units == "ppm" and np.max(np.abs(theta)) >= 1e-3:
            units, si = "%", 0.01
        each = units if isinstance(units, tuple) else (units,) * len(theta)
        rows = zip(self.numbers, theta / si, sigma / si, each, strict=True)
        numbers = [f"{name} {'+' if value > 0 else ''}{measured(value, s)} {unit}".strip() for name, value, s, unit in rows]
        when = "" if self.at is None else f" at {self.at:.0f} s" if self.name == "step" else f" in {self.at:.0f} s"
        largest = numbers[int(np.argmax(np.abs(theta) / sigma))]
        shown = [number for number, moved in zip(numbers, np.abs(theta) >= sigma, strict=True) if moved or number == largest]
        return StatedCause(f"{self.claim}{when}", largest, tuple(shown))


class StatedCause(NamedTuple):
    """What has changed; the most significant of its numbers; those beyond one sigma, with their units."""

    claim: str
    largest: str
    numbers: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Explanation:
    """Causes together: log_evidence, with their prior odds; theta (K,), SI, of all causes and its covariance; change (21,) of the
    parameters and its covariance, of causes and of what is expected without them; noise sizes (C,)."""

    causes: tuple[Cause, ...]
    log_evidence: float
    theta: np.ndarray
    theta_covariance: np.ndarray
    change: np.ndarray
    covariance: np.ndarray
    sizes: np.ndarray

    @property
    def score(self) -> float:
        """-2 log of evidence times prior."""
        return -2 * self.log_evidence

    @property
    def ids(self) -> frozenset[str]:
        """Names of its causes, as a set."""
        return frozenset(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its causes, in their order."""
        return tuple(cause.name for cause in self.causes)

    def of(self, name: str) -> np.ndarray:
        """Theta of one of its causes, SI; empty without that cause."""
        edges = np.cumsum([0, *(len(cause.sizes) for cause in self.causes)])
        return self.theta[edges[self.names.index(name)] : edges[self.names.index(name) + 1]] if name in self.names else np.zeros(0)

    @property
    def stated(self) -> list[StatedCause]:
        """Each cause with its numbers."""
        found, at = [], 0
        sigma = sigmas_in(self.theta_covariance)
        for cause in self.causes:
            own = slice(at, at + len(cause.sizes))
            if cause.name in WITH_USUAL and len(self.causes) == 1:  # not separable from its usual part
                which, sign = WITH_USUAL[cause.name]
                found.append(cause.stated(sign * self.change[which], np.sqrt(np.diag(self.covariance)[which])))
            else:
                found.append(cause.stated(self.theta[own], sigma[own]))
            at = own.stop
        return found


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """best: the most probable explanation; probability: of best among all that were compared; rivals: in place of each cause of best,
    those that this recording does not separate from it; alone: log evidence of each single cause against none."""

    best: Explanation
    probability: float
    rivals: dict[str, tuple[str, ...]]
    alone: dict[str, float]


def candidate_causes(rows: Rows, old: UnitState) -> list[Cause]:
    """All causes that today's recording may show."""
    E, xyz = old.linear.E, ("x", "y", "z")
    found: list[Cause] = []

    def add(
        name: str,
        claim: str,
        into: np.ndarray,
        size: float | np.ndarray,
        unit: Any,
        si: Any,
        numbers: Sequence[str],
        advice: str,
        columns: np.ndarray | None = None,
        at: float | None = None,
    ) -> None:
        """into (21, k): of the parameters by one of each number; columns (n, k): the same of the rows, where it changes with time."""
        sizes = np.broadcast_to(size, into.shape[1]) * 1.0
        columns = (rows.parameters @ into if columns is None else columns) * sizes
        correction = name in ("common scale", "scale")
        found.append(Cause(name, claim, columns, into * sizes, sizes, unit, si, tuple(numbers), advice, at, of_correction=correction))

    def of_matrix(change: Callable[[np.ndarray], np.ndarray], count: int) -> np.ndarray:
        into = np.zeros((COUNT, count))
        into[GYROSCOPE][MATRIX] = np.stack([change(one).ravel() for one in np.eye(count)], axis=1)
        return into

    zero = np.zeros((COUNT, 3))
    zero[ZERO] = -np.eye(3)  # what the sensor reads, which B takes away
    add("bias", "bias moved", zero, ZERO_RPS, "dps", DEG, xyz, "use the new bias")
    if warmer := rows.warmer_than(old):
        claim = f"bias follows the temperature ({warmer:+.1f} K)"
        advice = f"use the new bias at this temperature, or run `{command_line('temperature')}`"
        add("temperature", claim, zero * warmer, PER_K, "dps/K", DEG, xyz, advice)
    if rows.turns:  # else what is read at rest is the bias, whatever else has changed
        advice = "check the range, the data rate and the clock, then fit again"
        claim = "all rates are off by one factor"
        add("common scale", claim, -of_matrix(lambda theta: E * theta[0], 1), COMMON_SCALE, "%", 0.01, ("",), advice)
        add("scale", "scale is off", -of_matrix(lambda theta: E @ np.diag(theta), 3), SCALE, "ppm", 1e-6, xyz, "fit again")
        dials = rows.session.config.protocol.reference == "table"
        reference = "the table's dials" if dials else "the accelerometer"
        if rows.session.reference is not None:
            reference = rows.session.reference.body
        turned = of_matrix(lambda theta: rotation.cross_matrix(theta) @ E, 3)
        turned[ZERO] = np.stack([rotation.cross_matrix(axis) @ old.linear.B for axis in np.eye(3)], axis=1)
        claim = f"gyroscope is turned against {reference}"
        add("rotation", claim, turned, ROTATION_RAD, "mrad", 1e-3, xyz, "look at the mounting, then fit again")
        # xy, yz, zx: half of each of the two elements
        lean = of_matrix(lambda theta: np.array([[0, theta[0], theta[2]], [theta[0], 0, theta[1]], [theta[2], theta[1], 0]]) / 2 @ E, 3)
        units = ("mrad",) * 3 + ("dps",) * 3
        shock, sizes, of_one = np.concatenate([-lean, zero], axis=1), np.repeat([SHEAR_RAD, ZERO_RPS], 3), np.repeat([1e-3, DEG], 3)
        claim = "axes and bias moved, as by a shock"
        add("shock", claim, shock, sizes, units, of_one, ("xy", "yz", "zx", *xyz), "look for loose parts; fit again")
    if rows.stills and old.accelerometer is not None:  # whose calibration is known, and stills show gravity's length
        advice = f"calibrate the accelerometer again (`{command_line('fit', 'DIR', '--accelerometer', 'alone')}`), then fit"
        for which, claim, places, sign, size, unit, si in (
            ("bias", "bias moved", BIASES, 1, ACCEL_ZERO_MPS2, "mg", MG),
            ("scale", "scale is off", SCALES_OF_ACCELEROMETER, -1, ACCEL_SCALE, "ppm", 1e-6),
        ):
            into = np.zeros((COUNT, 3))
            into[ACCELEROMETER][places, [0, 1, 2]] = sign
            add(f"accelerometer's {which}", f"accelerometer's {claim}", into, size, unit, si, xyz, advice)
    # Changes of B within today's session: a step at each of a few times, a warm-up with each of a few time constants
    for at in rows.steps_s[:: -(-len(rows.steps_s) // MOST_STEPS) or 1]:
        if 0 < at < rows.duration_s:
            columns = rows.in_time(partial(lambda at, t_s: np.asarray((t_s >= at).astype(float)), float(at)))
            advice = "look for a shock or a supply change then, and record again"
            share = max(0.0, 1 - float(at) / MINUTE_S)
            add("step", "bias jumped", zero * share, ZERO_RPS, "dps", DEG, xyz, advice, columns, float(at))
    for share in WARM_UP_SHARES if rows.stills > 2 or rows.turns else ():
        tau = share * rows.duration_s
        columns = rows.in_time(partial(lambda tau, t_s: np.asarray(np.exp(-t_s / tau)), tau))
        mean = tau / MINUTE_S * -np.expm1(-MINUTE_S / tau)
        claim = "bias drifts as it warms up"
        add("warm-up", claim, zero * mean, ZERO_RPS, "dps", DEG, xyz, "let it warm up, then verify again", columns, float(tau))
    if rows.turns and (bent := rows.effect("gyro.bandwidth")) is not None:
        numbers = xyz if bent.shape[1] == 3 else ("",)
        advice = "check the filter's settings, then fit again"
        add("filter", "gyroscope's filter differs", np.zeros((COUNT, bent.shape[1])), BANDWIDTH_S2, "ms²", 1e-6, numbers, advice, bent)
    return found


def beyond_linear(old: LinearModel, turned_rad: np.ndarray) -> np.ndarray:
    """(21,) change of the parameters by a rotation vector (3,) beyond that of the cause's linear columns."""
    rest = rotation.matrix(rotation.exp(turned_rad)) - np.eye(3) - rotation.cross_matrix(turned_rad)
    return np.r_[np.zeros(ACCELEROMETER.stop), LinearModel(rest @ old.E, rest @ old.B).vector]


class Evidence:
    """Evidence of sets of causes for one recording, each evaluated once."""

    def __init__(self, rows: Rows, parts: Sequence[ExpectedPart], quiet: np.ndarray | None = None):
        """quiet: sizes of the noise's components with all parameters free."""
        self.rows = rows
        self._columns = np.concatenate([np.zeros((len(rows.r), 0)), *(part.columns for part in parts)], axis=1)
        self._into = np.concatenate([np.zeros((COUNT, 0)), *(part.into for part in parts)], axis=1)
        self._starts = [quiet]

    def of(self, causes: Sequence[Cause], sizes: np.ndarray | None = None) -> Explanation:
        """Evaluate causes together, each with a scale of its own; sizes: of the noise's components, estimated where they are not given."""
        rows, columns = self.rows, self._columns
        X, into, units = (
            np.concatenate([first, *(getattr(cause, name) for cause in causes)], axis=-1)
            for first, name in ((np.zeros((len(rows.r), 0)), "columns"), (np.zeros((COUNT, 0)), "into"), (np.zeros(0), "sizes"))
        )
        if sizes is None:
            # The likelihood may have two maxima: all as noise, or all as a change.  A search starts near each.
            J = np.concatenate([columns, X], axis=1)
            found = (rows.noise.estimated(rows.white, rows.r, J, start) for start in self._starts)
            sizes = min(found, key=lambda each: each.value).s
            self._starts = [*self._starts[:1], sizes] if len(self._starts) == 1 else self._starts
        covariance = rows.covariance(replace(rows.noise, s=sizes))
        factor = np.linalg.cholesky(covariance + columns @ columns.T)
        white, w = solve_lower(factor, X), solve_lower(factor, rows.r)
        base = -float(np.sum(np.log(np.diag(factor)))) - float(w @ w) / 2 - self._penalty(sizes) / 2
        scales = scales_of([len(cause.sizes) for cause in causes])
        gains = log_evidence(white.T @ white, white.T @ w, scales)
        scale = scales[int(np.argmax(gains))]
        # Posterior of the causes and of the expected parts, each number in its own sigma.
        inner = np.linalg.cholesky(covariance)
        J, y = solve_lower(inner, np.concatenate([X * scale, columns], axis=1)), solve_lower(inner, rows.r)
        posterior = np.linalg.inv(J.T @ J + np.eye(J.shape[1]))
        z, k = -posterior @ (J.T @ y), len(scale)
        into, units = np.concatenate([into * scale, self._into], axis=1), units * scale
        return Explanation(
            causes=tuple(causes),
            log_evidence=base
            + float(logsumexp(gains) - np.log(len(gains)))
            + sum(float(np.log(PRIOR_ODDS)) - each.price for each in causes),
            theta=z[:k] * units,
            theta_covariance=posterior[:k, :k] * np.outer(units, units),
            change=into @ z,
            covariance=into @ posterior @ into.T,
            sizes=sizes,
        )

    def _penalty(self, sizes: np.ndarray) -> float:
        """-2 log of the priors of the noise's sizes, as ``inference.noise`` has it."""
        pairs = zip(sizes, self.rows.noise.components, strict=True)
        return sum(c.prior.apart(float(max(s, 1e-12 * c.usual)))[0] ** 2 for s, c in pairs if c.prior is not None)


def diagnose(evidence: Evidence, causes: Sequence[Cause]) -> Diagnosis:
    """Look for the causes with the most evidence, one after the other, and for those that stand in for each."""
    nothing = evidence.of([])
    compared, extended = [nothing], dict[frozenset[str], list[Explanation]]()

    def near(fixed: Explanation) -> list[Explanation]:
        if fixed.ids not in extended:
            extended[fixed.ids] = _best_of_each(evidence, fixed, causes)
            compared.extend(extended[fixed.ids])
        return extended[fixed.ids]

    best = climb(nothing, lambda each: near(each) if len(each.causes) < MOST else [])
    alone = {trial.names[-1]: trial.log_evidence - nothing.log_evidence for trial in near(nothing)}
    rivals: dict[str, tuple[str, ...]] = {}
    for cause in best.causes:
        others = tuple(each for each in best.causes if each is not cause)
        near(evidence.of(others) if others else nothing)
        worse = rivals_of(compared, best, cause.name)
        rivals[cause.name] = tuple(name for name in sorted(worse, key=worse.__getitem__) if worse[name] < 2 * AS_PROBABLE)
    unique = {each.ids: each for each in sorted(compared, key=lambda each: -each.score)}
    probability = weights_of([each.score for each in unique.values()])[[*unique].index(best.ids)]
    return Diagnosis(best, float(probability), rivals, alone)


def _best_of_each(evidence: Evidence, fixed: Explanation, causes: Sequence[Cause]) -> list[Explanation]:
    """The best variant of each further cause, added to those that are fixed; a scanned one pays for its trials, which are compared with the
    noise of what is fixed."""
    found = []
    for name in dict.fromkeys(cause.name for cause in causes):
        if name in fixed.names:
            continue
        variants = [cause for cause in causes if cause.name == name]
        odds = np.array([evidence.of((*fixed.causes, each), fixed.sizes).log_evidence for each in variants] if variants[1:] else [0.0])
        price = float(odds.max() - logsumexp(odds) + np.log(len(odds)))
        found.append(evidence.of((*fixed.causes, replace(variants[int(np.argmax(odds))], price=price))))
    return found
