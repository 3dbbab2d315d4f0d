"""Small simulated sessions with the effect in them, and the explanation that names it and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from session.common.units import DEG, G
from session.log.folder import read_session
from session.sensor.registers import require_profile
from tinygc.effect_checks.report import NotChecked
from tinygc.effect_checks.scene import middle_value, random_theta
from tinygc.effects import AppliedEffect, Effect, Movement
from tinygc.effects.conditions import vibration
from tinygc.effects.found_at import ANYWHERE
from tinygc.explanation.mends.mending import mend
from tinygc.explanation.naming.candidates import scanned, selection_of, sharpened
from tinygc.explanation.naming.naming import NamedEffect, Naming
from tinygc.explanation.noise.session_noise import known_whitener
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.refit import Refit, refit
from tinygc.explanation.twin.replay import Replay
from tinygc.explanation.twin.turn_gravity import turn_gravity
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import PRECALIBRATION_MPS2, Whitener
from tinygc.explanation.twin.within_stills import within_stills
from tinygc.explanation.verdict.claims import named_claims
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.proof import prove
from tinygc.problem.build import build_problem
from tinygc.simulation.motion import earth_rate_table
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulate import Disturb, plan_of, simulate_session
from tinygc.simulation.table_movement import Plan
from tinygc.simulation.write import config_text, write_files

SEGMENTS, ODR_HZ, WARM_UP_C = 16, 208.0, 10.0
#: a hand is no faster than so many times the usual one, and begins within these degC
MOST_VIGOUR, FIRST_C = 4.0, (-30.0, 80.0)
#: of the full scale to which an effect's constants belong, the least that the simulated sensor has: it may be another sensor's
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
class Found:
    """What a fit with the effect makes of it: twin, whitener, and the fits without and with it, in its gauge."""

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
    """Simulate a session with the effect.  NotChecked for one that is found before any fit, and for what no fit finds."""
    if effect.kind == "motion":
        raise NotChecked("of kind motion: it adds variance to the closure and no rate, so no fit finds it and no effect's code makes it")
    if effect.kind not in ("rate", "force", "earth"):
        raise NotChecked(f"of kind {effect.kind}: it is found before any fit")
    warm = {"warm_up_c": WARM_UP_C} if "temperature" in effect.inputs else {}
    # The Earth is always there: it is hidden by leaving out where the table stands.
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
    """Of a session that goes as fast and is as warm as the one to which the effect's constants belong, where it says one."""
    if effect.found_at == ANYWHERE:
        return {}
    full_scale_dps = effect.found_at.fs_rps / DEG
    vigour = float(np.clip(full_scale_dps / SimulationOptions.gyro_fs_dps, 1 / MOST_VIGOUR, MOST_VIGOUR))
    first_c = float(np.clip(effect.found_at.first_temp_c, *FIRST_C))
    ranges = sorted(require_profile(SimulationOptions.sensor).gyro or [])
    own = next((one for one in ranges if one > RANGE_WITHIN * full_scale_dps), ranges[-1])
    return {"gyro_fs_dps": own, "vigour": vigour, "temperature_start_c": first_c}


@dataclass(frozen=True, eq=False)
class _Scene:
    effect: Effect
    plan: Plan
    options: SimulationOptions

    def distorted(self, t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return self.effect.distort(self.movement(t, rate, self.shaken(t, force), temp), theta)

    def movement(self, t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> Movement:
        dt_s, force_g, options = float(t[1] - t[0]), force / G, self.options
        first_c, full_scale = options.temperature_start_c, options.gyro_fs_dps * DEG
        return Movement(t, dt_s, rate, force_g, temp, vibration(force_g, dt_s), self.plan.log_s, full_scale, first_c)

    def whole(self) -> Movement:
        """The session's length without its movement, for a grid to be laid over."""
        t = np.arange(0, self.plan.log_s, 1 / ODR_HZ)
        still = np.zeros((len(t), 3))
        return self.movement(t, still, still - [0, 0, G], np.full(len(t), self.options.temperature_start_c))

    def disturb(self, theta: np.ndarray) -> Disturb | None:
        """What the accelerometer alone feels."""
        if self.effect.kind == "force":
            # A fit allows for a pre-calibration that nobody knows better than this; so this one is as good, and no better.
            rng = np.random.default_rng(self.options.seed)
            bias, matrix = (PRECALIBRATION_MPS2 * rng.standard_normal(shape) for shape in (3, (3, 3)))
            return lambda t, force: force + theta + bias + force @ matrix.T / G
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


def fitted(effect: Effect, injected: Injected) -> Found:
    """Read the session and fit linear model and effect together, a scanned shape searched for as naming does it."""
    problem = build_problem(read_session(injected.folder))
    twin = Twin(problem)
    whiten = known_whitener(twin)
    first = refit(twin, whiten, [], twin.start())
    if effect.scan is not None:
        variants = effect.variants(scanned(twin, effect))
        gains = selection_of(twin, whiten, first, variants, 0).gains(first.r)
        effect = sharpened(twin, whiten, first, variants[max(gains, key=gains.__getitem__)], Replay(twin, first))
    fit = in_gauge(twin, whiten, refit(twin, whiten, [effect], twin.start()))
    return Found(injected, twin, whiten, first, fit)


def explanation_of(found: Found) -> Explanation:
    """As ``explain`` gives it, with the effect named and nothing else looked for."""
    twin, whiten, fit = found.twin, found.whiten, found.fit
    problem = twin.problem
    naming = Naming(found.first, 0.0, fit, [NamedEffect(found.claim.effect, 0.0, found.first.chi_square - fit.chi_square)])
    mended = mend(problem)
    proof = prove(problem, twin, whiten, fit)
    e = Explanation(problem.session, problem, mended, twin, whiten, naming, turn_gravity(twin, fit), proof, "explained", 0.0)
    e.claimed, e.within = named_claims(fit, naming.named, found.first.chi_square), within_stills(twin)
    return e
