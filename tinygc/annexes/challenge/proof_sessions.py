"""The sessions of the proof of an effect: a hand's movement, a simulated session with the effect in it, its fit and its explanation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from session.io.folder import read_session
from session.io.registers import require_profile
from session.io.samples import Samples
from session.io.units import DEG, NS_PER_S, G
from tinygc.annexes.challenge.rate_effects import Scene, shaking
from tinygc.closure.build import build_problem
from tinygc.effects import AppliedEffect, CommonDelay, Conditions, Effect, Movement, ReferenceConditions
from tinygc.effects.effect import ANYWHERE
from tinygc.effects.movement import vibration
from tinygc.explanation.claims import named_claims
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


class NotChecked(Exception):
    """Raised where a part does not apply or cannot be checked on this machine, with the reason."""


# The inputs of tests without a session: a hand movement, a parameter size, a model that inverts the effect.

LENGTH_S = 20.0
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
        known = Conditions(duration_s=LENGTH_S, fs_rps=self.at.fs_rps, first_temp_c=self.at.first_temp_c)
        return PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(self.effect, self.theta),), known)

    @property
    def at(self) -> ReferenceConditions:
        """Full scale and first temperature of the scene."""
        return self.original.reference_conditions


def trial(effect: Effect, size: float, value: float | None = None) -> EffectTrial:
    """Draw parameters of about a size; the scanned shape at ``value``, or mid-grid."""
    here = effect
    if effect.scan is not None:
        here = effect.at(middle_value(effect, [movement(104.0, effect.reference_conditions)]) if value is None else value)
    return EffectTrial(here, effect, random_theta(effect, size, 1))


def random_theta(effect: Effect, size: float, seed: int) -> np.ndarray:
    """(P,) SI of either sign, 0.5 to 1.5 times ``size``; lags are positive; in a convention's gauge where there is one."""
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
    shaken_g2 = 0.2 * np.exp(-(((t_s / length_s - 0.5) * 10) ** 2))
    temp_c = at.first_temp_c + WARMING_C_PER_S * t_s
    rate = at.fs_rps * _rate(t_s, length_s)
    return Movement(t_s, 1 / odr_hz, rate, _turned(t_s), temp_c, shaken_g2, length_s, at.fs_rps, at.first_temp_c)


def log(odr_hz: float, at: ReferenceConditions) -> Samples:
    """The same movement as a log without noise."""
    moved = movement(odr_hz, at)
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
    clean = _Simulated(effect, plan, options, _shaken(effect, plan, options))
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


def _shaken(effect: Effect, plan: MovementPlan, options: SimulationOptions) -> Disturb | None:
    """Vibration of half of the turns, where the effect follows vibration."""
    scene = Scene(np.random.default_rng(options.seed), 1.0, options, plan)
    return shaking(scene).disturb if "vibration" in effect.inputs else None


@dataclass(frozen=True, eq=False)
class _Simulated:
    effect: Effect
    plan: MovementPlan
    options: SimulationOptions
    shaken: Disturb | None

    def distorted(self, t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray, theta: np.ndarray) -> np.ndarray:
        felt = self.shaken(t, force) if self.shaken else force
        return self.effect.distort(self.movement(t, rate, felt, temp), theta)

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
        if self.effect.kind != "force":
            return self.shaken
        # A fit allows for errors of an unknown pre-calibration; this one has errors of that size.
        rng = np.random.default_rng(self.options.seed)
        bias, matrix = (PRECALIBRATION_MPS2 * rng.standard_normal(shape) for shape in (3, (3, 3)))
        start_c, warm_up_c = self.options.temperature_start_c, self.options.warm_up_c

        def bent(t: np.ndarray, force: np.ndarray) -> np.ndarray:
            moved = self.movement(t, np.zeros_like(force), force, temperature(t, start_c, warm_up_c))
            return self.effect.distort_force(moved, theta) * G + bias + force @ matrix.T / G

        return bent


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
