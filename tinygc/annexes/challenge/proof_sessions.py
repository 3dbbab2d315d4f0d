"""Test an effect on simulated sessions: inject it, recover its parameters, and detect it alone."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import butter, sosfiltfilt
from scipy.stats import chi2

from session.io.folder import read_session
from session.io.registers import require_profile
from session.io.samples import Samples
from session.io.units import DEG, NS_PER_S, G
from tinygc.closure.build import build_problem
from tinygc.effects import AppliedEffect, CommonDelay, Conditions, Convention, Derived, Effect, Movement, ReferenceConditions
from tinygc.effects.effect import ANYWHERE
from tinygc.effects.movement import vibration
from tinygc.explanation.claims import named_claims, readable
from tinygc.explanation.data_repair import repair
from tinygc.explanation.decision import Naming, prove
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import selection_of, sharpened
from tinygc.explanation.search import NamedEffect
from tinygc.models.linear import LinearModel
from tinygc.models.physics import PhysicsModel
from tinygc.noise.candidates import scanned
from tinygc.noise.channels import in_gauge, within_stills
from tinygc.noise.components import first_noise, known_whitener
from tinygc.noise.refit import Refit, Replay, refit
from tinygc.noise.turn_gravity import turn_gravity
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import PRECALIBRATION_MPS2, Whitener
from tinygc.simulation.movement import MovementPlan, earth_rate_table
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import Disturb, plan_of, simulate_session, temperature
from tinygc.simulation.write import config_text, write_files

# The result of a check: a line for each part.

PASSED, FAILED, NOT_CHECKED = "passed", "failed", "not checked"


class Wrong(Exception):
    """Raised where a part of a check fails, with one line."""


class NotChecked(Exception):
    """Raised where a part does not apply or cannot be checked on this machine, with the reason."""


@dataclass(frozen=True)
class ProofPart:
    """name; result: passed, failed or not checked; says: the numbers, or why."""

    name: str
    result: str
    says: str

    @property
    def ok(self) -> bool:
        """Whether the part did not fail."""
        return self.result != FAILED


@dataclass(frozen=True)
class Report:
    """id of the effect, and its parts in order."""

    id: str
    parts: tuple[ProofPart, ...]

    @property
    def ok(self) -> bool:
        """Whether no part failed."""
        return all(part.ok for part in self.parts)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the parts that failed."""
        return tuple(part.name for part in self.parts if not part.ok)

    def __getitem__(self, name: str) -> ProofPart:
        return next(part for part in self.parts if part.name == name)

    def __str__(self) -> str:
        return "\n".join([self.id, *(f"  {part.name:8} {part.result:11}  {part.says}" for part in self.parts)])

    def require(self) -> Report:
        """Return itself; AssertionError with the whole report where a part failed: ``check(EFFECT).require()`` is a test."""
        if not self.ok:
            raise AssertionError(str(self))
        return self


# The inputs of tests without a session: a hand movement, a parameter size, a model that inverts the effect.

WARMING_C_PER_S = 0.8
#: share of a parameter's plausible size that a poor sensor has
SIZE = 0.05


@dataclass(frozen=True, eq=False)
class EffectTrial:
    """effect: with a value of its scanned shape, where it has one; original: as it was given; theta (P,) SI, a strong one."""

    effect: Effect
    original: Effect
    theta: np.ndarray

    def model(self) -> PhysicsModel:
        """A model that inverts this effect alone."""
        return PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(self.effect, self.theta),), self.known)

    @property
    def at(self) -> ReferenceConditions:
        """Full scale and first temperature of the scene."""
        return self.original.reference_conditions

    @property
    def known(self) -> Conditions:
        """Conditions to which the model refers."""
        return Conditions(duration_s=LENGTH_S, fs_rps=self.at.fs_rps, first_temp_c=self.at.first_temp_c)


LENGTH_S = 20.0


def trial(effect: Effect, size: float, seed: int, value: float | None = None) -> EffectTrial:
    """Draw parameters of either sign, 0.5 to 1.5 times ``size``; lags are positive; the scanned shape at ``value``, or mid-grid."""
    here = effect
    if effect.scan is not None:
        here = effect.at(middle_value(effect, [movement(104.0, effect.reference_conditions)]) if value is None else value)
    return EffectTrial(here, effect, random_theta(effect, size, seed))


def random_theta(effect: Effect, size: float, seed: int) -> np.ndarray:
    """(P,) SI, in a convention's gauge where there is one."""
    rng, gauge = np.random.default_rng(seed), effect.gauge_convention
    theta = size * rng.uniform(0.5, 1.5, effect.parameter.size) * rng.choice((-1.0, 1.0), effect.parameter.size)
    if isinstance(gauge, CommonDelay):
        if gauge.never_negative:
            return gauge.late * np.abs(theta)
        # Differences only: the common part is a clock delay, which a simulated session does not have.
        theta[list(gauge.delays)] -= theta[list(gauge.delays)].mean()
        return theta
    return theta if gauge is None else gauge.settle(theta)


def middle_value(effect: Effect, movements: list[Movement]) -> float:
    """A value of the scanned shape, SI, between two of its grid."""
    if effect.scan is None or effect.scan.grid is None:
        return 0.4 * movements[0].duration_s
    values = np.asarray(effect.scan.grid(movements), dtype=float)
    at = len(values) // 2
    return float(values[max(at - 1, 0) : at + 1].mean())


def movement(odr_hz: float, at: ReferenceConditions, length_s: float = LENGTH_S) -> Movement:
    """A hand movement: rest, movement up to two fifths of full scale and 2 Hz, rest; with all inputs, each of its own shape."""
    t_s = np.arange(0, length_s, 1 / odr_hz)
    vibration = 0.2 * np.exp(-(((t_s / length_s - 0.5) * 10) ** 2))
    temp_c = at.first_temp_c + WARMING_C_PER_S * t_s
    rate = at.fs_rps * _rate(t_s, length_s)
    return Movement(t_s, 1 / odr_hz, rate, _turned(t_s), temp_c, vibration, length_s, at.fs_rps, at.first_temp_c)


def log(odr_hz: float, at: ReferenceConditions, length_s: float = LENGTH_S) -> Samples:
    """The same movement as a log without noise."""
    moved = movement(odr_hz, at, length_s)
    stamps = np.rint(np.arange(len(moved.t_s)) * (NS_PER_S / odr_hz)).astype(np.int64)
    return Samples(stamps, moved.rate, moved.force_g * G, moved.temp_c)


def _rate(t_s: np.ndarray, length_s: float) -> np.ndarray:
    """(N, 3) of full scale; the window is a B-spline of degree 7, six times differentiable."""
    window = BSpline.basis_element(np.linspace(0.2, 0.8, 9) * length_s, extrapolate=False)
    waves = np.stack([np.sin(2 * np.pi * f * t_s + p) for f, p in ((0.5, 0.3), (0.9, 1.1), (2.0, 2.0))], axis=-1)
    return np.nan_to_num(window(t_s))[:, None] * waves


def _turned(t_s: np.ndarray) -> np.ndarray:
    """(N, 3) g: gravity, and up to a fifth of it from the hand's acceleration."""
    gravity = np.stack([np.sin(0.7 * t_s), np.cos(0.7 * t_s) * np.sin(0.4 * t_s), -np.cos(0.7 * t_s) * np.cos(0.4 * t_s)], axis=-1)
    return (1 + 0.2 * np.sin(1.9 * t_s))[:, None] * gravity


# Small simulated sessions with the effect injected, and the explanation that must report it alone.

SEGMENTS, ODR_HZ, WARM_UP_C = 16, 208.0, 10.0
#: factor that limits the hand's speed against the usual one, and range of the first temperature in degC
MOST_VIGOUR, FIRST_C = 4.0, (-30.0, 80.0)
#: least full scale of the simulated sensor as a share of that to which an effect's constants belong, possibly another sensor's
RANGE_WITHIN = 0.95
#: rms in g of each axis, and its band: in every other turn, where an effect follows vibration
VIBRATION_G, VIBRATION_HZ = 0.4, (20.0, 45.0)


@dataclass(frozen=True, eq=False)
class Injected:
    """A session folder with an effect in it: theta (P,) SI; value of its scanned shape, SI, or None."""

    folder: Path
    theta: np.ndarray
    value: float | None


@dataclass(frozen=True, eq=False)
class FittedProof:
    """A fit with the effect: twin, whitener, and the fits without and with it, in its gauge."""

    injected: Injected
    twin: Twin
    whiten: Whitener
    first: Refit
    fit: Refit

    @property
    def claim(self) -> AppliedEffect:
        """The effect as it was fitted."""
        return self.fit.state.claims[0]


def inject(effect: Effect, folder: Path, size: float, seed: int, value: float | None = None) -> Injected:
    """Simulate a session with the effect.  NotChecked for one that is found before any fit, and for one that no fit finds."""
    if effect.kind == "motion":
        raise NotChecked("of kind motion: it adds variance to the closure and no rate, so no fit finds it and no effect's code makes it")
    if effect.kind not in ("rate", "force", "earth"):
        raise NotChecked(f"of kind {effect.kind}: it is found before any fit")
    warm = {"warm_up_c": WARM_UP_C} if "temperature" in effect.inputs else {}
    # The Earth's rotation is always present; it is hidden by omitting the table's location.
    bench = {"latitude_deg": 60.0, "segments": 3 * SEGMENTS} if effect.kind == "earth" else {}
    chosen: dict[str, Any] = {"segments": SEGMENTS, "closure_s": 0.0, "odr_hz": ODR_HZ, "seed": seed, "warm_up_c": 1.5} | warm | bench
    options = SimulationOptions(**(chosen | _setting(effect)))
    plan, theta = plan_of(options), random_theta(effect, size, seed)
    clean = _Scene(effect, plan, options)
    if effect.scan is not None:
        value = middle_value(effect, [clean.whole()]) if value is None else value
        clean = replace(clean, effect=effect.at(value))
    distort = (lambda t, rate, force, temp: clean.distorted(t, rate, force, temp, theta)) if effect.kind == "rate" else None
    simulation = simulate_session(options, distort, plan=plan, disturb=clean.disturb(theta))
    text = config_text(simulation, concealed=False)
    if effect.kind == "earth":
        text = "\n".join(line for line in text.split("\n") if not line.startswith(("latitude_deg", "heading_deg")))
        theta = earth_rate_table(options.latitude_deg * DEG, simulation.unit.heading_deg * DEG)
    write_files(simulation, folder, text)
    return Injected(folder, theta, value)


def _setting(effect: Effect) -> dict[str, Any]:
    """Options for a session as fast and as warm as the one to which the effect's constants belong, where these are known."""
    if effect.reference_conditions == ANYWHERE:
        return {}
    full_scale_dps = effect.reference_conditions.fs_rps / DEG
    vigour = float(np.clip(full_scale_dps / SimulationOptions.gyro_fs_dps, 1 / MOST_VIGOUR, MOST_VIGOUR))
    first_c = float(np.clip(effect.reference_conditions.first_temp_c, *FIRST_C))
    ranges = sorted(require_profile(SimulationOptions.sensor).gyro or [])
    own = next((one for one in ranges if one > RANGE_WITHIN * full_scale_dps), ranges[-1])
    return {"gyro_fs_dps": own, "vigour": vigour, "temperature_start_c": first_c}


@dataclass(frozen=True, eq=False)
class _Scene:
    effect: Effect
    plan: MovementPlan
    options: SimulationOptions

    def distorted(self, t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return self.effect.distort(self.movement(t, rate, self.shaken(t, force), temp), theta)

    def movement(self, t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> Movement:
        dt_s, force_g, options = float(t[1] - t[0]), force / G, self.options
        first_c, full_scale = options.temperature_start_c, options.gyro_fs_dps * DEG
        return Movement(t, dt_s, rate, force_g, temp, vibration(force_g, dt_s), self.plan.log_s, full_scale, first_c)

    def whole(self) -> Movement:
        """The session's length without its movement, for the shape's grid."""
        t = np.arange(0, self.plan.log_s, 1 / ODR_HZ)
        still = np.zeros((len(t), 3))
        return self.movement(t, still, still - [0, 0, G], np.full(len(t), self.options.temperature_start_c))

    def disturb(self, theta: np.ndarray) -> Disturb | None:
        """The disturbance felt by the accelerometer alone."""
        if self.effect.kind == "force":
            # A fit allows for errors of an unknown pre-calibration; this one has errors of that size.
            rng = np.random.default_rng(self.options.seed)
            bias, matrix = (PRECALIBRATION_MPS2 * rng.standard_normal(shape) for shape in (3, (3, 3)))
            start_c, warm_up_c = self.options.temperature_start_c, self.options.warm_up_c

            def bent(t: np.ndarray, force: np.ndarray) -> np.ndarray:
                movement = self.movement(t, np.zeros_like(force), force, temperature(t, start_c, warm_up_c))
                return self.effect.distort_force(movement, theta) * G + bias + force @ matrix.T / G

            return bent
        return self.shaken if "vibration" in self.effect.inputs else None

    def shaken(self, t: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(N, 3) m/s^2 with every other turn vibrated, where the effect follows vibration."""
        if "vibration" not in self.effect.inputs:
            return force
        noise = np.random.default_rng(self.options.seed).standard_normal(force.shape)
        noise = sosfiltfilt(butter(2, VIBRATION_HZ, "bandpass", fs=1 / (t[1] - t[0]), output="sos"), noise, axis=0)
        rms = np.zeros(len(t))
        for start, stop in self.plan.turns[::2]:
            first, last = np.searchsorted(t, (start, stop))
            along = np.linspace(0, 1, last - first)
            rms[first:last] = VIBRATION_G * np.clip(10 * np.minimum(along, 1 - along), 0, 1)
        return force + G * rms[:, None] * noise / noise.std(axis=0)


def fitted(effect: Effect, injected: Injected) -> FittedProof:
    """Read the session and fit the linear model and the effect together, with the same search for a scanned shape as in model selection."""
    problem = build_problem(read_session(injected.folder))
    twin = Twin(problem)
    whiten = known_whitener(twin)
    first = refit(twin, whiten, [], twin.start())
    if effect.scan is not None:
        variants = effect.variants(scanned(twin, effect))
        gains = selection_of(twin, whiten, first, variants, 0).gains(first.r)
        effect = sharpened(twin, whiten, first, variants[max(gains, key=gains.__getitem__)], Replay(twin, first))
    fit = in_gauge(twin, whiten, refit(twin, whiten, [effect], twin.start()))
    return FittedProof(injected, twin, whiten, first, fit)


def explanation_of(found: FittedProof) -> Explanation:
    """The explanation of a session by this effect alone, without a search for others."""
    twin, whiten, fit = found.twin, found.whiten, found.fit
    problem = twin.problem
    named = [NamedEffect(found.claim.effect, 0.0, found.first.chi_square - fit.chi_square, 1.0)]
    naming = Naming(found.first, 0.0, fit, named, whiten, first_noise(twin, whiten))
    mended = repair(problem)
    proof = prove(problem, twin, whiten, fit)
    e = Explanation(problem.session, problem, mended, twin, naming, turn_gravity(twin, fit), proof, "explained", 0.0)
    e.claimed, e.within = named_claims(fit, naming.named, found.first.chi_square), within_stills(twin)
    return e


# Inject and recover: over simulated sessions, the errors of the fitted parameters must agree with their stated sigmas.

#: two-sided probability of the errors under their sigmas at which the check fails
CHANCE = 1e-4
#: share of the injected size added to each sigma, for what any model of an effect simplifies (filters, sampling)
MODEL_SHARE = 0.01
#: sigma as a share of the size above which most parameters are not significant, so that their errors are uninformative
HARDLY_SEEN = 1 / 3


def recover(effect: Effect, size: float, seeds: int, value: float | None = None) -> tuple[str, FittedProof]:
    """Test the squared errors in stated sigmas, summed over parameters and sessions, against chi-square."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, seeds + 1):
            found.append(fitted(effect, inject(effect, Path(folder) / str(seed), size, seed, value)))
    return _verdict(found), found[0]


def _verdict(found: list[FittedProof]) -> str:
    looks = [_look(one) for one in found]
    error, sigma = (np.concatenate([look[i] for look in looks]) for i in (0, 1))
    count = len(error)
    # Correlated errors count as fewer independent ones (Satterthwaite): the sum of squares is a scaled chi-square of that freedom.
    freedom = count**2 / sum(float(np.sum(look[2] ** 2)) for look in looks)
    allowed = MODEL_SHARE * np.concatenate([look[3] for look in looks])
    strict, loose = (float(np.sum(error**2 / variance)) * freedom / count for variance in (sigma**2, sigma**2 + allowed**2))
    bounds = chi2.ppf([CHANCE, 1 - CHANCE], freedom)
    sizes = np.concatenate([look[3] for look in looks])
    worst = float((np.abs(error) / sizes).max())
    numbers = (
        f"{len(found)} sessions, {count} numbers: errors {np.sqrt(np.mean((error / sigma) ** 2)):.2f} sigma rms, "
        f"at most {100 * worst:.2g} % of the size"
    )
    if loose > bounds[1]:
        raise Wrong(f"{numbers}: more than the stated sigmas and {100 * MODEL_SHARE:g} % allow (chance {CHANCE:g})")
    if strict < bounds[0]:
        raise Wrong(f"{numbers}: the stated sigmas are too large (chance {CHANCE:g})")
    weak = "; hardly seen at this size: give a larger size=" if np.median(sigma / sizes) > HARDLY_SEEN else ""
    return numbers + weak


def _look(one: FittedProof) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Errors (n,) and stated sigmas (n,) of the JSON's numbers, their correlation (n, n), and the injected size (n,)."""
    claim, truth = one.claim, one.injected.theta
    effect = claim.effect
    widen = max(1.0, one.fit.chi_square / max(len(one.fit.r) - one.fit.J.shape[1], 1))
    covariance = one.fit.theta_covariance(0) * widen
    _, parameters, std = readable(claim, covariance)
    if isinstance(effect.derived, Derived):
        name = effect.derived.name
        error = np.array([parameters[name] - effect.derived.of(truth)])
        return error, np.array([std[name]]), np.eye(1), np.abs([effect.derived.of(truth)])
    sigma = np.ravel(std[effect.parameter.name]) * effect.parameter.si
    keep = sigma > 0  # a convention fixes one entry exactly
    if isinstance(effect.gauge_convention, Convention):
        slope = effect.gauge_convention.slope(claim.theta)
        covariance = slope @ covariance @ slope.T
    own = np.sqrt(np.diag(covariance)[keep])
    correlation = covariance[np.ix_(keep, keep)] / np.outer(own, own)
    size = np.full(int(keep.sum()), np.sqrt(np.mean(truth**2)))
    return (claim.theta - truth)[keep], sigma[keep], correlation, size
