"""Test an effect, part by part: columns, inverse, recovery, words and units, picture, live use, C."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError
from session.base.files import write_new
from session.base.numeric import rms_of
from session.base.texts import significant
from session.base.units import DEG, MG, NS_PER_S, G
from session.log.folder import read_session
from session.log.samples import Samples
from tinygc import models
from tinygc.closure.build import build_problem
from tinygc.deploy.calibration import Calibration
from tinygc.deploy.embedded.program import Inputs, program
from tinygc.deploy.embedded.source import FLAGS, SOURCE, source_files
from tinygc.effects import AppliedEffect, CommonDelay, Conditions, Effect, EffectError, NoC, ReferenceConditions
from tinygc.effects.catalogue import having, tried
from tinygc.effects.effect import ANYWHERE
from tinygc.effects.testing import LENGTH_S, hand_movement
from tinygc.explanation.claims import named_claims, readable
from tinygc.explanation.data_repair import repair
from tinygc.explanation.decision import FitClosure, Naming, Prover
from tinygc.explanation.engine import Explanation
from tinygc.explanation.search import NamedEffect
from tinygc.library.simulations import simulate
from tinygc.models.linear import LinearModel
from tinygc.models.physics import PhysicsModel
from tinygc.noise.channels import in_gauge, within_stills
from tinygc.noise.components import first_noise, known_whitener
from tinygc.noise.refit import Refit, refit
from tinygc.noise.turn_gravity import turn_gravity
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import Whitener
from tinygc.reporting.pictures.page import pair_of
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import plan_of

# The result of a check: a line for each part.

PASSED, FAILED, NOT_CHECKED = "passed", "failed", "not checked"


class Wrong(CalibrationError):
    """Raised where a part of a check fails, with one line."""


class NotChecked(Exception):
    """Raised where a part does not apply or cannot be checked on this machine, with the reason."""


@dataclass(frozen=True)
class ProofPart:
    """name; result: passed, failed or not checked; text: the numbers, or why."""

    name: str
    result: str
    text: str


@dataclass(frozen=True)
class Report:
    """id of the effect, and its parts in order."""

    id: str
    parts: tuple[ProofPart, ...]

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the parts that failed."""
        return tuple(part.name for part in self.parts if part.result == FAILED)

    @property
    def ok(self) -> bool:
        """Whether no part failed."""
        return not self.failed

    def __getitem__(self, name: str) -> ProofPart:
        return next(part for part in self.parts if part.name == name)

    def __str__(self) -> str:
        return "\n".join([self.id, *(f"  {part.name:8} {part.result:11}  {part.text}" for part in self.parts)])

    def require(self) -> Report:
        """Return itself; AssertionError with the whole report where a part failed: ``check(EFFECT).require()`` is a test."""
        if not self.ok:
            raise AssertionError(str(self))
        return self


# The inputs: parameters, a hand's movement, a small simulated session with the effect in it, and its fit.

#: share of a parameter's plausible size that a poor sensor has
SIZE = 0.05
SEEDS, SEGMENTS, ODR_HZ = (1, 2, 3), 16, 208.0


def random_theta(effect: Effect, size: float, seed: int) -> np.ndarray:
    """(P,) SI of either sign, 0.5 to 1.5 times ``size``; lags are positive; in a convention's gauge where there is one."""
    rng, gauge = np.random.default_rng(seed), effect.gauge_convention
    theta = size * rng.uniform(0.5, 1.5, effect.parameter.size) * rng.choice((-1.0, 1.0), effect.parameter.size)
    if not isinstance(gauge, CommonDelay):
        return theta if gauge is None else gauge.settle(theta)
    if gauge.never_negative:
        return gauge.late * np.abs(theta)
    # Differences only: the common part is a clock delay, which a simulated session does not have.
    theta[list(gauge.delays)] -= theta[list(gauge.delays)].mean()
    return theta


def shaped(effect: Effect, length_s: float, value: float | None) -> Effect:
    """The effect with its scanned shape, where it has one, at ``value``, SI, or amid what a search would try."""
    if effect.scan is not None and value is None:
        grid, moved = effect.scan.grid, hand_movement(104.0, effect.reference_conditions, length_s)
        value = 0.4 * length_s if grid is None else float(np.median(grid([moved])))
    return effect if value is None else effect.at(value)


def log(odr_hz: float, at: ReferenceConditions, noise: float = 0.0) -> Samples:
    """The same movement as a log, with noise of so many rad/s, and m/s^2."""
    moved, rng = hand_movement(odr_hz, at), np.random.default_rng(0)
    stamps = np.rint(np.arange(len(moved.t_s)) * (NS_PER_S / odr_hz)).astype(np.int64)
    gyro, accel = (true + noise * rng.normal(size=true.shape) for true in (moved.rate, moved.force_g * G))
    return Samples(stamps, gyro, accel, moved.temp_c)


def _inject(effect: Effect, folder: Path, size: float, seed: int, value: float | None = None) -> AppliedEffect:
    """Simulate a session with an effect of the rate; returns what is in it."""
    warm_c = 10.0 if "temperature" in effect.inputs else 1.5
    options = SimulationOptions(segments=SEGMENTS, closure_s=0.0, odr_hz=ODR_HZ, seed=seed, warm_up_c=warm_c)
    here, theta, parameter = shaped(effect, plan_of(options).log_s, value), random_theta(effect, size, seed), effect.parameter
    hidden = {parameter.name: (theta / parameter.si).reshape(parameter.shape).tolist(), **here.shape}
    with having(effect):
        simulate(options, effects={effect.id: hidden}).save(folder)
    return AppliedEffect(here, theta)


@dataclass(frozen=True, eq=False)
class FittedProof:
    """A fit with the effect: what was injected, twin, whitener, and the fits without and with it, in its gauge."""

    injected: AppliedEffect
    twin: Twin
    whiten: Whitener
    first: Refit
    fit: Refit

    @property
    def claim(self) -> AppliedEffect:
        """The effect as it was fitted."""
        return self.fit.state.claims[0]


def fitted(injected: AppliedEffect, folder: Path) -> FittedProof:
    """Fit the linear model and the effect, with the injected shape, together."""
    twin = Twin(build_problem(read_session(folder)))
    whiten = known_whitener(twin)
    first, fit = (refit(twin, whiten, effects, twin.start()) for effects in ([], [injected.effect]))
    return FittedProof(injected, twin, whiten, first, in_gauge(twin, whiten, fit))


def _explanation_of(found: FittedProof) -> Explanation:
    """The explanation of a session by this effect alone, without a search for others."""
    twin, whiten, fit, problem = found.twin, found.whiten, found.fit, found.twin.problem
    named = [NamedEffect(found.claim.effect, 0.0, found.first.chi_square - fit.chi_square, 1.0)]
    naming = Naming(found.first, 0.0, fit, named, whiten, first_noise(twin, whiten))
    proof, gravity = Prover(problem, twin, FitClosure.of(problem))(whiten, fit), turn_gravity(twin, fit)
    claimed = named_claims(fit, named, found.first.chi_square)
    e = Explanation(problem.session, problem, repair(problem), twin, naming, gravity, proof, "explained", 0.0, claimed)
    e.within = within_stills(twin)
    return e


@dataclass(frozen=True, eq=False)
class EffectTrial:
    """original: the effect as it was given; size and value of what is injected; effect and theta (P,), SI: of what is tried without."""

    original: Effect
    size: float
    value: float | None
    effect: Effect
    theta: np.ndarray

    @property
    def at(self) -> ReferenceConditions:
        """Full scale and first temperature."""
        return self.original.reference_conditions

    @property
    def model(self) -> PhysicsModel:
        """A model that inverts this effect alone."""
        known = Conditions(duration_s=LENGTH_S, fs_rps=self.at.fs_rps, first_temp_c=self.at.first_temp_c)
        return PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(self.effect, self.theta),), known)

    @cached_property
    def sessions(self) -> list[FittedProof]:
        """Simulated sessions with the effect, fitted."""
        if "vibration" in self.original.inputs or self.original.derived or self.at != ANYWHERE:
            raise NotChecked("not proven: no session is simulated for vibration, a derived number, another full scale or temperature")
        with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
            paths = [(seed, Path(folder) / str(seed)) for seed in SEEDS]
            return [fitted(_inject(self.original, path, self.size, seed, self.value), path) for seed, path in paths]


# Columns, ``distort`` and ``correct`` agree.

#: Hz: a lag far below the sampling period is a backward difference
FINE_HZ, USUAL_HZ = 3332.0, 833.0
#: largest differences as a share of the maximum: one-sided differences, and a derivative by central differences at 2 Hz
SHARE_WITHIN, STEP, ENDS = 5e-3, 1e-4, 50
#: rad/s: above the rounding of a rate at full scale, a millionth of the effect of one step of any parameter in the catalogue
ROUNDING = 1e-12


def columns(trial: EffectTrial) -> str:
    """Compare columns with finite differences of ``distort`` at zero."""
    effect, moved = trial.effect, hand_movement(FINE_HZ, trial.at, 10.0)
    found, step = effect.columns(effect.shown(moved)), STEP * effect.parameter.plausible
    numeric = np.stack([(effect.distort(moved, step * e) - moved.rate) / step for e in np.eye(effect.parameter.size)], axis=-1)
    greatest = np.abs(numeric).max(axis=(0, 1))
    if not (step * greatest > ROUNDING).all():
        raise Wrong(f"parameter {int(np.argmin(greatest))} changes nothing on a hand's movement")
    off = float((np.abs(numeric - found)[ENDS:-ENDS].max(axis=(0, 1)) / greatest).max())
    if not off < SHARE_WITHIN:
        raise Wrong(
            f"columns differ from the finite differences of distort by {significant(100 * off, 2)} % (at most {100 * SHARE_WITHIN:g} %)"
        )
    return f"within {significant(100 * off, 2)} % of the finite differences of distort"


def inverse(trial: EffectTrial) -> str:
    """Check that ``correct`` restores the true rate, and changes nothing without parameters."""
    effect, moved, theta = trial.effect, hand_movement(USUAL_HZ, trial.at, 10.0), trial.theta
    bent = effect.distort(moved, theta)
    off = np.abs(effect.correct(bent, moved.with_rate(bent), theta) - moved.rate)[ENDS:-ENDS]
    left = float(off.max() / np.abs(bent - moved.rate).max())
    if not left < SHARE_WITHIN:
        raise Wrong(f"correct leaves {significant(100 * left, 2)} % of what the effect did (at most {100 * SHARE_WITHIN:g} %)")
    if np.abs(effect.correct(moved.rate, moved, 0 * theta) - moved.rate).max() > ROUNDING:
        raise Wrong("correct changes something although all parameters are zero")
    return f"correct leaves {significant(100 * left, 2)} % of what the effect did"


# Inject and recover: the errors of the fitted parameters in simulated sessions agree with their stated sigmas.

#: most that one number may be off, in sigmas and shares of its size together: what any model of an effect simplifies (filters, sampling)
MOST_SIGMAS, MODEL_SHARE = 4.5, 0.01
#: least rms of the errors in their sigmas: below it the sigmas are too large
LEAST_RMS = 0.1
#: sigma as a share of the size above which most parameters are not significant, so that their errors are uninformative
HARDLY_SEEN = 1 / 3


def recover(trial: EffectTrial) -> str:
    """Check the errors of all parameters in all sessions."""
    error, sigma, size = (np.concatenate(column) for column in zip(*map(_errors, trial.sessions), strict=True))
    rms, worst = rms_of(error / sigma), float((np.abs(error) / size).max())
    text = f"{len(SEEDS)} sessions, {len(error)} numbers: errors {rms:.2f} sigma rms, at most {significant(100 * worst, 2)} % of the size"
    if (np.abs(error) > MOST_SIGMAS * np.hypot(sigma, MODEL_SHARE * size)).any():
        raise Wrong(f"{text}: more than the stated sigmas and {100 * MODEL_SHARE:g} % allow")
    if rms < LEAST_RMS:
        raise Wrong(f"{text}: the stated sigmas are too large")
    return text + ("; hardly seen at this size: give a larger size=" if np.median(sigma / size) > HARDLY_SEEN else "")


def _errors(one: FittedProof) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (n,) and stated sigmas (n,) of the JSON's numbers, and the injected size (n,)."""
    claim, truth, parameter = one.claim, one.injected.theta, one.claim.effect.parameter
    sigma = np.ravel(readable(claim, one.fit.theta_covariance(0) * one.fit.widened)[2][parameter.name]) * parameter.si
    keep = sigma > 0  # a convention fixes one entry exactly
    return (claim.theta - truth)[keep], sigma[keep], np.full(int(keep.sum()), np.sqrt(np.mean(truth**2)))


# Words, units and JSON.

#: SI size of a unit's first word; the divisors below count as one here
UNITS = dict.fromkeys(["s", "fraction", "1", "rad", "rad/s"], 1.0) | {"dps": DEG, "deg": DEG, "°": DEG, "mdps": 1e-3 * DEG}
UNITS |= {"mg": MG, "ms": 1e-3, "us": 1e-6, "%": 1e-2, "ppm": 1e-6, "min": 60.0}
PER = {"g", "g²", "s", "°C", "°C²"}


def units(trial: EffectTrial) -> str:
    """Check one sentence with a number, units of their declared size, and a round trip of names and numbers through a model file."""
    effect, parameter, scan = trial.effect, trial.effect.parameter, trial.effect.scan
    words = effect.describe(trial.theta)
    if "\n" in words or not re.search(r"\d", words) or "nan" in words:
        raise Wrong(f"describe gives {words!r:.120}, expected one sentence with a number")
    found = [_unit(parameter.unit, parameter.si), *([] if scan is None else [_unit(scan.unit, scan.si)])]
    if effect.kind == "rate":
        text = json.dumps(models.to_dict(trial.model), allow_nan=False)
        with having(trial.original):
            (claim,) = models.from_dict(json.loads(text)).undone
        (entry,) = json.loads(text)["effects"]
        shown = np.ravel(entry[parameter.name]) * parameter.si
        shapes = effect.shape == claim.effect.shape == {name: entry[name] for name in effect.shape}
        if not (shapes and np.array_equal(claim.theta, trial.theta) and np.allclose(shown, trial.theta, rtol=1e-12)):
            raise Wrong(f"its model file gives {claim.theta.tolist()}, {entry} back for {trial.theta.tolist()}, {effect.shape}")
        found.append("its model file gives the same numbers back")
    return "; ".join(found)


def _unit(unit: str, si: float) -> str:
    """Check that si is the size of the unit; an unknown unit is accepted."""
    first, *per = unit.partition(" ")[0].split("/")
    if first not in UNITS or not PER.issuperset(per):
        return f"unit {unit!r} is not known here and taken at its word, {si:g} SI"
    if not np.isclose(si, UNITS[first], rtol=1e-9):
        raise Wrong(f"unit {unit!r} is {UNITS[first]:.6g} in SI, and si is {si:.6g}")
    return f"unit {unit!r} is {si:.6g} SI"


def picture(trial: EffectTrial) -> str:
    """Check that both panels have data and axis labels."""
    e = _explanation_of(trial.sessions[0])
    for name, panel in zip(("left", "right"), pair_of(e, e.claimed[0]), strict=True):
        if not (panel.marks and panel.x.label and panel.y.label):
            raise Wrong(f"the {name} panel is empty, or has an axis without a label")
    return "both panels drawn"


# Use on whole logs, on pieces and sample by sample.  Live use takes the temperature as it arrives, so the whole log does, too.

RATE_HZ, PIECE = 100.0, 300  #: its period is whole nanoseconds, so no stamp is rounded
#: rad/s: a hundred-thousandth of a sensor's noise
WITHIN = 1e-9


def live(trial: EffectTrial) -> str:
    """Check in pieces and sample by sample against the whole log, or that live use is refused where it needs later samples."""
    samples, calibration = log(RATE_HZ, trial.at), Calibration(trial.model, RATE_HZ)
    began_s = 0.0 if trial.effect.of_one_session else None
    whole = calibration(samples.gyro, samples.accel, samples.temp_c, began_s=began_s)
    stream, parts = calibration.stream(began_s), [samples.between(start, start + PIECE) for start in range(0, len(samples), PIECE)]
    pieces = [stream.push(part.gyro, part.accel, part.temp_c) for part in parts]
    _same(np.concatenate([*pieces, stream.flush()]), whole, "in pieces")
    try:
        one_at_a_time = calibration.live()
    except CalibrationError as error:
        if trial.effect.id in str(error) and (calibration.looks_ahead or trial.effect.of_one_session):
            return f"in pieces as whole; refused live: {error}"
        raise Wrong(f"cannot go live: {error}") from None
    assert samples.temp_c is not None  # as ``log`` makes them
    one_by_one = np.array([one_at_a_time(*sample) for sample in zip(samples.gyro, samples.accel, samples.temp_c, strict=True)])
    _same(one_by_one, trial.model.calibrate(samples, live=True), "sample by sample")
    return "sample by sample, in pieces and whole agree"


def _same(one: np.ndarray, whole: np.ndarray, how: str) -> None:
    off = np.abs(one - whole).max(axis=1)
    if not off.max() < WITHIN:
        at = int(np.argmax(off))
        raise Wrong(
            f"{how} it differs from the whole log by {significant(off[at], 2)} rad/s at sample {at}: does reach cover all that it reads?"
        )


#: noise of the readings that its C gets, rad/s and m/s^2
C_NOISE = 0.5
#: relative to the rate, or to 1 rad/s
DOUBLE_WITHIN = 1e-5


def c(trial: EffectTrial) -> str:
    """Compare its NumPy with ``correct``, and compile its C for the vectors of its self-test; a stated reason where there is no C."""
    if isinstance(trial.effect.device, NoC):
        return f"none: {trial.effect.device.why}"
    model, samples = trial.model, log(RATE_HZ, trial.at, C_NOISE)
    chosen, double = program(model), model.calibrate(samples, live=True)
    single = chosen.run(Inputs.of(samples.gyro, samples.accel, samples.temp_c))
    off = float((np.abs(single - double) / (1 + np.abs(double))).max())
    if not (single.dtype == np.float32 and off < DOUBLE_WITHIN):
        raise Wrong(
            f"its NumPy gives {single.dtype} and differs from correct by {significant(off, 2)} of the rate (at most {DOUBLE_WITHIN:g})"
        )
    if shutil.which("gcc") is None:
        raise NotChecked(f"no gcc on this machine; its NumPy is within {significant(off, 2)} of correct")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in source_files(chosen, None, "A check of an effect.", {}).items():
            write_new(Path(folder) / name, text)
        words = [*FLAGS.split(), "-O2", "-shared", "-fPIC", SOURCE, "-o", "model.so"]
        made = subprocess.run(["gcc", *words], capture_output=True, text=True, check=False, cwd=folder)
        if made.returncode:
            raise Wrong(f"its C does not compile: {' '.join(made.stderr.split())[:200]}")
        library, worst = ctypes.CDLL(str(Path(folder) / "model.so")), ctypes.c_float(-1)
    if library.tinygc_self_test(ctypes.byref(worst)) or worst.value != 0:
        raise Wrong(f"its C differs from its NumPy by up to {significant(worst.value, 2)} rad/s")
    return f"its C is its NumPy bit for bit in its self-test, and within {significant(off, 2)} of correct"


# All parts of the test of an effect, in order.

PARTS = {part.__name__: part for part in (columns, inverse, recover, units, picture, live, c)}


def check(effect: Effect, *, size: float | None = None, value: float | None = None, parts: Sequence[str] = tuple(PARTS)) -> Report:
    """See ``tinygc.effects.testing.check``."""
    if unknown := [name for name in parts if name not in PARTS]:
        raise EffectError(f"{unknown[0]!r} is no part of a check; choose among {', '.join(PARTS)}")
    tried(effect, "check")
    if size is not None and not (size > 0 and isfinite(size)):
        raise EffectError(f"size is {size!r}, expected more than 0, in SI units: the size of the injected parameters")
    strength = SIZE * effect.parameter.plausible if size is None else size
    trial = EffectTrial(effect, strength, value, shaped(effect, LENGTH_S, value), random_theta(effect, strength, 1))
    return Report(effect.id, tuple(_part(name, trial) for name in PARTS if name in parts))


def _part(name: str, trial: EffectTrial) -> ProofPart:
    try:
        if trial.effect.kind != "rate" and name not in ("units", "c"):
            raise NotChecked(f"not proven: of kind {trial.effect.kind}, and only an effect of the rate is tried")
        return ProofPart(name, PASSED, PARTS[name](trial))
    except NotChecked as why:
        return ProofPart(name, NOT_CHECKED, str(why))
    except Exception as error:  # the effect's own code is tested: any exception is a failure of this part
        kind = "" if isinstance(error, CalibrationError) else f"{type(error).__name__}: "
        return ProofPart(name, FAILED, kind + " ".join(str(error).split()))
