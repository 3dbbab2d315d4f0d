"""Test an effect, part by part: words, columns, C, live use, picture."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.io.errors import CalibrationError
from session.io.samples import Samples
from session.io.units import DEG, MG, NS_PER_S
from tinygc import models
from tinygc.annexes.challenge.proof_sessions import (
    SIZE,
    EffectTrial,
    FittedProof,
    NotChecked,
    explanation_of,
    fitted,
    inject,
    log,
    movement,
    trial,
)
from tinygc.deploy.calibration import Calibration
from tinygc.deploy.embedded.program import Program, program
from tinygc.deploy.embedded.source import FLAGS, SOURCE, source_files
from tinygc.deploy.embedded.stages import Inputs
from tinygc.effects import Derived, Effect, EffectError, NoC, ReferenceConditions
from tinygc.effects.catalogue import having, tried
from tinygc.explanation.claims import readable
from tinygc.reporting.pictures.canvas import pair_of_panels
from tinygc.reporting.pictures.panels import draw_claim

if TYPE_CHECKING:
    from tinygc.reporting.pictures.canvas import Axes, FigureCanvasAgg

# The result of a check: a line for each part.

PASSED, FAILED, NOT_CHECKED = "passed", "failed", "not checked"


class Wrong(Exception):
    """Raised where a part of a check fails, with one line."""


@dataclass(frozen=True)
class ProofPart:
    """name; result: passed, failed or not checked; says: the numbers, or why."""

    name: str
    result: str
    says: str


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
        return "\n".join([self.id, *(f"  {part.name:8} {part.result:11}  {part.says}" for part in self.parts)])

    def require(self) -> Report:
        """Return itself; AssertionError with the whole report where a part failed: ``check(EFFECT).require()`` is a test."""
        if not self.ok:
            raise AssertionError(str(self))
        return self


# Words, units and JSON.

#: SI size of a unit's first word; its divisors g, s, degC and their powers count as one here
UNITS = {
    **dict.fromkeys(["s", "fraction", "samples", "1", "", "Hz", "rad", "rad/s", "m", "g", "°C", "%/100"], 1.0),
    **{"dps": DEG, "deg": DEG, "°": DEG, "mdps": 1e-3 * DEG, "mg": MG, "ms": 1e-3, "us": 1e-6, "%": 1e-2, "ppm": 1e-6, "min": 60.0},
}
PER = {"g": 1.0, "g²": 1.0, "°C": 1.0, "°C²": 1.0, "s": 1.0, "dps": DEG, "dps²": DEG**2, "Hz": 1.0, "V": 1.0, "1000s": 1000.0, "h": 3600.0}
LONGEST = 300
RESERVED = ("id", "equation", "theta_si")


def units(trial: EffectTrial) -> str:
    """Check one sentence with a number, units of their declared size, and a round trip of names and numbers through a model file."""
    _sentence(trial)
    said = [_unit(trial.effect.parameter.unit, trial.effect.parameter.si)]
    if (scan := trial.effect.scan) is not None:
        said.append(_unit(scan.unit, scan.si))
    names = [trial.effect.parameter.name, *trial.effect.shape]
    if clash := [name for name in names if name in RESERVED or names.count(name) > 1 or not name.isidentifier()]:
        raise Wrong(f"{clash[0]!r} cannot be a parameter's name in the JSON: it is taken, or no name")
    if trial.effect.kind == "rate":
        _round_trip(trial)
        said.append("its model file gives the same numbers back")
    return "; ".join(said)


def _sentence(trial: EffectTrial) -> None:
    says = trial.effect.describe(trial.theta)
    if not isinstance(says, str) or "\n" in says or not re.search(r"\d", says) or "nan" in says or len(says) > LONGEST:
        raise Wrong(f"describe gives {says!r:.120}, expected one sentence with a number")


def _unit(unit: str, si: float) -> str:
    """Check that si is the size of the unit; an unknown unit is accepted."""
    first, *per = unit.split(" ")[0].split("/")
    if unit.split(" ")[0] in UNITS:
        size = UNITS[unit.split(" ")[0]]
    elif first in UNITS and all(word in PER for word in per):
        size = UNITS[first] / float(np.prod([PER[word] for word in per]))
    else:
        return f"unit {unit!r} is not known here and taken at its word, {si:g} SI"
    if not np.isclose(si, size, rtol=1e-9):
        raise Wrong(f"unit {unit!r} is {size:.6g} in SI, and si says {si:.6g}")
    return f"unit {unit!r} is {si:.6g} SI"


def _round_trip(trial: EffectTrial) -> None:
    parameter = trial.effect.parameter
    text = json.dumps(models.to_dict(trial.model()), allow_nan=False)
    with having(trial.original):
        try:
            (claim,) = models.from_dict(json.loads(text)).undone
        except Exception as error:
            raise Wrong(f"its model file cannot be read again: {error}") from None
    (entry,) = json.loads(text)["effects"]
    shown = np.ravel(entry[parameter.name]) * parameter.si
    if not (np.array_equal(claim.theta, trial.theta) and np.allclose(shown, trial.theta, rtol=1e-12)):
        raise Wrong(f"its model file gives {claim.theta.tolist()}, {shown.tolist()} back for {trial.theta.tolist()}")
    if claim.effect.shape != trial.effect.shape or any(entry[name] != value for name, value in trial.effect.shape.items()):
        raise Wrong(f"its model file gives the shape {claim.effect.shape} back for {trial.effect.shape}")


# Columns, ``distort`` and ``correct`` agree.

#: Hz: a lag far below the sampling period is a backward difference
FINE_HZ, USUAL_HZ = 3332.0, 833.0
#: largest differences as shares of the maximum: one-sided differences, and a derivative by central differences at 2 Hz
COLUMNS_WITHIN, UNDONE_WITHIN = 5e-3, 5e-3
STEP = 1e-4
ENDS = 50
#: rad/s: above the rounding of a rate at full scale, a millionth of the effect of one step of any parameter in the catalogue
ROUNDING = 1e-12


def columns(trial: EffectTrial) -> str:
    """Compare columns with finite differences of ``distort`` at zero: only for a rate effect."""
    effect, moved = trial.effect, movement(FINE_HZ, trial.at, 10.0)
    size = effect.parameter.size
    found = effect.columns(effect.shown(moved))
    if np.shape(found) != (*moved.rate.shape, size):
        raise Wrong(f"columns give shape {np.shape(found)}, expected (N, 3, {size})")
    if effect.kind != "rate":
        if np.any(found):
            raise Wrong(f"columns add to the rate, which an effect of kind {effect.kind} does not")
        return f"none, as of kind {effect.kind}"
    step = STEP * effect.parameter.plausible
    numeric = np.stack([(effect.distort(moved, step * e) - moved.rate) / step for e in np.eye(size)], axis=-1)
    greatest = np.abs(numeric).max(axis=(0, 1))
    if not (step * greatest > ROUNDING).all():
        raise Wrong(f"parameter {int(np.argmin(greatest))} changes nothing on a hand's movement")
    off = float((np.abs(numeric - found)[ENDS:-ENDS].max(axis=(0, 1)) / greatest).max())
    if not off < COLUMNS_WITHIN:
        raise Wrong(f"columns differ from the finite differences of distort by {100 * off:.2g} % (at most {100 * COLUMNS_WITHIN:g} %)")
    return f"within {100 * off:.2g} % of the finite differences of distort"


def undo(trial: EffectTrial) -> str:
    """Check that ``correct`` restores the true rate, or ``correct_force`` the force, and changes nothing without parameters."""
    effect, moved, theta = trial.effect, movement(USUAL_HZ, trial.at, 10.0), trial.theta
    if effect.kind not in ("rate", "force"):
        raise NotChecked(f"of kind {effect.kind}: it is not undone in the rate")
    if effect.kind == "force":
        name, true, bent = "correct_force", moved.force_g, effect.distort_force(moved, theta)
        back, idle = effect.correct_force(moved.with_force(bent), theta), effect.correct_force(moved, 0 * theta)
    else:
        name, true, bent = "correct", moved.rate, effect.distort(moved, theta)
        back, idle = effect.correct(bent, moved.with_rate(bent), theta), effect.correct(moved.rate, moved, 0 * theta)
    done = float(np.abs(bent - true).max())
    left = float(np.abs(back - true)[ENDS:-ENDS].max()) / done if done > 0 else np.inf
    if not left < UNDONE_WITHIN:
        raise Wrong(f"{name} leaves {100 * left:.2g} % of what the effect did (at most {100 * UNDONE_WITHIN:g} %)")
    if np.abs(idle - true).max() > 1e-12:
        raise Wrong(f"{name} changes something although all parameters are zero")
    return f"{name} leaves {100 * left:.2g} % of what the effect did"


# Inject and recover: the errors of the fitted parameters in simulated sessions agree with their stated sigmas.

SESSIONS = 3
#: most that one number may be off, in sigmas and shares of its size together: what any model of an effect simplifies (filters, sampling)
MOST_SIGMAS, MODEL_SHARE = 4.5, 0.01
#: least rms of the errors in their sigmas: below it the sigmas are too large
LEAST_RMS = 0.1
#: sigma as a share of the size above which most parameters are not significant, so that their errors are uninformative
HARDLY_SEEN = 1 / 3


def recover(sessions: Sequence[FittedProof]) -> str:
    """Check the errors of all parameters in all sessions."""
    error, sigma, size = (np.concatenate(column) for column in zip(*map(_errors, sessions), strict=True))
    rms, worst = float(np.sqrt(np.mean((error / sigma) ** 2))), float((np.abs(error) / size).max())
    says = f"{len(sessions)} sessions, {len(error)} numbers: errors {rms:.2f} sigma rms, at most {100 * worst:.2g} % of the size"
    if (np.abs(error) > MOST_SIGMAS * np.hypot(sigma, MODEL_SHARE * size)).any():
        raise Wrong(f"{says}: more than the stated sigmas and {100 * MODEL_SHARE:g} % allow")
    if rms < LEAST_RMS:
        raise Wrong(f"{says}: the stated sigmas are too large")
    return says + ("; hardly seen at this size: give a larger size=" if np.median(sigma / size) > HARDLY_SEEN else "")


def _errors(one: FittedProof) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (n,) and stated sigmas (n,) of the JSON's numbers, and the injected size (n,)."""
    claim, truth, effect = one.claim, one.injected.theta, one.claim.effect
    widen = max(1.0, one.fit.chi_square / max(len(one.fit.r) - one.fit.J.shape[1], 1))
    _, parameters, std = readable(claim, one.fit.theta_covariance(0) * widen)
    if isinstance(effect.derived, Derived):
        name, true = effect.derived.name, effect.derived.of(truth)
        return np.array([parameters[name] - true]), np.array([std[name]]), np.abs([true])
    sigma = np.ravel(std[effect.parameter.name]) * effect.parameter.si
    keep = sigma > 0  # a convention fixes one entry exactly
    return (claim.theta - truth)[keep], sigma[keep], np.full(int(keep.sum()), np.sqrt(np.mean(truth**2)))


# Use on whole logs, on pieces and sample by sample, within the declared reach.
#
# Live use takes the temperature as it arrives, so the whole log that it is compared with does, too.

RATE_HZ = 100.0  #: its period is whole nanoseconds, so no stamp is rounded
PIECE = 300
#: rad/s: a hundred-thousandth of a sensor's noise
WITHIN = 1e-9


def live(trial: EffectTrial) -> str:
    """Check sample by sample against the whole log, or a one-line refusal where it needs later samples; and the declared reach."""
    if trial.effect.kind != "rate":
        raise NotChecked(f"of kind {trial.effect.kind}: no model undoes it")
    samples, calibration = log(RATE_HZ, trial.at), Calibration(trial.model(), RATE_HZ)
    began_s = 0.0 if trial.effect.of_one_session else None
    whole = calibration(samples.gyro, samples.accel, samples.temp_c, began_s=began_s)
    if not np.isfinite(whole).all():
        raise Wrong("the rate is not finite")
    stream, pieces = calibration.stream(began_s), []
    for start in range(0, len(samples), PIECE):
        part = samples.between(start, start + PIECE)
        pieces.append(stream.push(part.gyro, part.accel, part.temp_c))
    _same(np.concatenate([*pieces, stream.flush()]), whole, "in pieces")
    _looks_no_farther(trial, samples)
    if calibration.looks_ahead:
        return f"refused live, since it looks ahead: {_refusal(calibration, trial.effect.id, 'looks ahead')}"
    if trial.effect.of_one_session:
        return f"refused live, since it follows its session's time: {_refusal(calibration, trial.effect.id, 'follows its session')}"
    assert samples.temp_c is not None  # as ``log`` makes them
    try:
        one_at_a_time = calibration.live()
        one_by_one = np.array([one_at_a_time(*sample) for sample in zip(samples.gyro, samples.accel, samples.temp_c, strict=True)])
    except CalibrationError as error:
        raise Wrong(f"cannot go live: {error}") from None
    _same(one_by_one, trial.model().calibrate(samples, live=True), "sample by sample")
    return "sample by sample, in pieces and whole agree"


def _refusal(calibration: Calibration, name: str, why: str) -> str:
    """The one line that refuses live use before any sample and names the effect."""
    try:
        calibration.live()
    except CalibrationError as error:
        says = str(error)
        if name not in says or "\n" in says:
            raise Wrong(f"the refusal to go live is not one line that names {name}: {' '.join(says.split())}") from None
        return says
    raise Wrong(f"it {why}, and yet goes live")


def _same(one: np.ndarray, whole: np.ndarray, how: str) -> None:
    off = np.abs(one - whole).max(axis=1)
    if not off.max() < WITHIN:
        at = int(np.argmax(off))
        raise Wrong(f"{how} it differs from the whole log by {off[at]:.2g} rad/s at sample {at}: does reach say all that it looks at?")


def _looks_no_farther(trial: EffectTrial, samples: Samples) -> None:
    """Check that samples beyond the declared reach do not change a sample's rate."""
    middle = len(samples) // 2
    behind, ahead = trial.effect.total_reach(trial.theta).rows(RATE_HZ)
    model, rng = trial.model(), np.random.default_rng(0)
    base = model.calibrate(samples, live=True)[middle]
    beyond = np.ones(len(samples), dtype=bool)
    beyond[max(middle - behind, 0) : middle + ahead + 1] = False
    if not beyond.any():
        return
    shake = beyond[:, None] * rng.normal(size=(len(samples), 3))
    assert samples.temp_c is not None
    other = replace(samples, gyro=samples.gyro + 0.3 * shake, accel=samples.accel + shake, temp_c=samples.temp_c + 3 * beyond)
    off = float(np.abs(model.calibrate(other, live=True)[middle] - base).max())
    if not off < WITHIN:
        raise Wrong(f"samples farther than {behind} before and {ahead} after move the rate by {off:.2g} rad/s: declare a larger reach")


# Its C against its declared NumPy, bit for bit, and both against the model in double precision.

RANDOM = 2000
#: relative to the rate, or to 1 rad/s
DOUBLE_WITHIN = 1e-5


def c(trial: EffectTrial) -> str:
    """Compile it with the host's gcc and compare; a stated reason where there is no C."""
    code = trial.effect.device
    if isinstance(code, NoC):
        if not code.why.strip() or "\n" in code.why:
            raise Wrong("there is no C, and no reason in one line")
        return f"none: {code.why}"
    model = trial.model()
    chosen = program(model)
    samples = _samples(trial.at)
    inputs = Inputs.of(samples.gyro, samples.accel, samples.temp_c)
    single = chosen.run(inputs)
    if single.dtype != np.float32 or single.shape != (len(samples), 3):
        raise Wrong(f"its NumPy gives {single.dtype} of shape {single.shape}, expected float32 of {(len(samples), 3)}")
    double = model.calibrate(samples, live=True)
    off = float((np.abs(single - double) / (1 + np.abs(double))).max())
    if not off < DOUBLE_WITHIN:
        raise Wrong(f"its NumPy in single precision differs from correct by {off:.2g} of the rate (at most {DOUBLE_WITHIN:g})")
    if shutil.which("gcc") is None:
        raise NotChecked(f"no gcc on this machine; its NumPy is within {off:.2g} of correct")
    differ = int(np.count_nonzero(_compiled(chosen, inputs).view(np.uint32) != single.view(np.uint32)))
    if differ:
        raise Wrong(f"its C differs from its NumPy in {differ} of {single.size} rates")
    return f"its C is its NumPy bit for bit over {len(samples)} samples, and within {off:.2g} of correct"


def _samples(at: ReferenceConditions) -> Samples:
    """A hand movement, followed by independent random readings."""
    moved, rng = log(RATE_HZ, at), np.random.default_rng(0)
    assert moved.temp_c is not None  # as ``log`` makes it
    rate, force = rng.uniform(-at.fs_rps, at.fs_rps, (RANDOM, 3)), 9.8 * rng.normal(size=(RANDOM, 3))
    stamps = moved.t_ns[-1] + np.rint(np.arange(1, RANDOM + 1) * (NS_PER_S / RATE_HZ)).astype(np.int64)
    temp_c = np.concatenate([moved.temp_c, at.first_temp_c + rng.uniform(-15, 15, RANDOM)])
    t_ns, gyro, accel = (np.concatenate(pair) for pair in ((moved.t_ns, stamps), (moved.gyro, rate), (moved.accel, force)))
    return Samples(t_ns, gyro, accel, temp_c)


def _compiled(chosen: Program, inputs: Inputs) -> np.ndarray:
    """Output of the compiled C, sample after sample, (N, 3) float32."""
    files = source_files(chosen, None, "A check of an effect.", {})
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="ascii")
        library = Path(folder) / "model.so"
        command = ["gcc", *FLAGS.split(), "-O2", "-shared", "-fPIC", str(Path(folder) / SOURCE), "-o", str(library)]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            raise Wrong(f"its C does not compile: {' '.join(made.stderr.split())[:200]}")
        loaded = ctypes.CDLL(str(library))
    told = re.search(r"state_is_(\d+)_bytes", files[SOURCE])
    assert told is not None  # ``source_files`` writes it
    size = int(told[1])
    state = ctypes.create_string_buffer(b"\xa5" * size, size)  # the former content of memory must not matter
    loaded.tinygc_start(state)
    table = np.ascontiguousarray(np.column_stack([inputs.rate, inputs.force, inputs.temp_c]), dtype=np.float32)
    rates = np.zeros((len(table), 3), np.float32)
    for n in range(len(table)):
        loaded.tinygc_step(state, ctypes.c_void_p(table.ctypes.data + 28 * n), ctypes.c_void_p(rates.ctypes.data + 12 * n))
    return rates


# The picture is drawn and is not empty.

#: least share of a panel's pixels with ink, beyond those of its empty frame
INK = 0.002


def picture(found: FittedProof) -> str:
    """Check that both panels have data, ink and axis labels."""
    try:
        canvas, panels = pair_of_panels()
    except ImportError:
        raise NotChecked("no matplotlib on this machine") from None
    e = explanation_of(found)
    draw_claim(e, e.claimed[0], *panels)
    shares = []
    for name, panel in zip(("left", "right"), panels, strict=True):
        if not panel.has_data():
            raise Wrong(f"the {name} panel is empty")
        if not (panel.get_xlabel() and panel.get_ylabel()):
            raise Wrong(f"the {name} panel has an axis without a label")
        shares.append(_ink(canvas, panel))
        if shares[-1] < INK:
            raise Wrong(f"the {name} panel shows nothing: {100 * shares[-1]:.2g} % of it is ink")
    return f"both panels drawn, {100 * min(shares):.1f} % ink"


def _ink(canvas: FigureCanvasAgg, panel: Axes) -> float:
    """Share of the panel's inner pixels that are not white."""
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    box = panel.get_window_extent()
    height = len(image)
    inner = image[height - int(box.y1) + 3 : height - int(box.y0) - 3, int(box.x0) + 3 : int(box.x1) - 3]
    return float((inner < 250).any(axis=-1).mean())


# All parts of the test of an effect, in order.

PARTS = ("columns", "undo", "recover", "units", "picture", "live", "c")


def check(effect: Effect, *, size: float | None = None, value: float | None = None, parts: Sequence[str] = PARTS) -> Report:
    """See ``tinygc.effects.testing.check``."""
    if unknown := [name for name in parts if name not in PARTS]:
        raise EffectError(f"{unknown[0]!r} is no part of a check; choose among {', '.join(PARTS)}")
    tried(effect, "check")
    if size is not None and not (size > 0 and isfinite(size)):
        raise EffectError(f"size is {size!r}, expected more than 0, in SI units: the size of the injected parameters")
    injected_size = SIZE * effect.parameter.plausible if size is None else size
    strong = trial(effect, injected_size, value)

    @cache
    def session(seed: int) -> FittedProof:
        with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
            return fitted(effect, inject(effect, Path(folder) / "session", injected_size, seed, value))

    run: dict[str, Callable[[], str]] = {
        "columns": lambda: columns(strong),
        "undo": lambda: undo(strong),
        "recover": lambda: recover([session(seed) for seed in range(1, SESSIONS + 1)]),
        "units": lambda: units(strong),
        "picture": lambda: picture(session(1)),
        "live": lambda: live(strong),
        "c": lambda: c(strong),
    }
    return Report(effect.id, tuple(_part(name, run[name]) for name in PARTS if name in parts))


def _part(name: str, run: Callable[[], str]) -> ProofPart:
    try:
        return ProofPart(name, PASSED, run())
    except NotChecked as why:
        return ProofPart(name, NOT_CHECKED, str(why))
    except (Wrong, CalibrationError) as wrong:
        return ProofPart(name, FAILED, str(wrong))
    except Exception as error:  # the effect's own code is tested: any exception is a failure of this part
        return ProofPart(name, FAILED, f"{type(error).__name__}: {' '.join(str(error).split())}")
