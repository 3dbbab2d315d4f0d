"""The result of a fit, and its files: ``fit.json``, models, methods that a later fit reuses."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.files import result_folder
from session.base.numeric import rms_of
from session.base.results import Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Shape, Text, read_required, require, write_whole
from session.base.units import DEG, G
from session.detect.check_stills import NO_STILLS
from session.detect.check_time import looks_counted
from session.detect.findings import Finding
from session.detect.signatures import FILTER, TRACKED
from session.log.config import NominalRate
from session.log.folder import Session, file_key, input_hashes
from session.log.requirements import Requirements, read_requirements
from tinygc import models
from tinygc.closure.prior import PriorUse
from tinygc.closure.problem import Problem
from tinygc.closure.runs import ClosureRun
from tinygc.closure.uncertainty import GoodnessOfFit, goodness
from tinygc.estimation.accelerometer import JOINT_NAMES, USUAL_SPREAD, AccelerometerFit, AnySession, accelerometer_fit
from tinygc.estimation.bias import BiasChoice
from tinygc.estimation.choice import AgainstRaw, ModelToUse, closure_figures, model_to_use, run_figures
from tinygc.estimation.model_tests import GRAVITY, ModelTest, model_tests
from tinygc.estimation.options import METHODS, FitOptions, MethodFit
from tinygc.estimation.physics import PART_NAMED, errors_with_physics, rate_covariance, rows_of_rates
from tinygc.estimation.promise import promise_of
from tinygc.estimation.repeatability import BiasRepeatability
from tinygc.estimation.sources import Source
from tinygc.estimation.stated_noise import StatedNoise
from tinygc.estimation.systematic import Systematic
from tinygc.estimation.verdict import Acceptance, JudgedFit, decide, run_p_values, too_good, too_wide
from tinygc.models.linear import BIAS, LinearModel
from tinygc.models.model import accelerometer_table, sensor_table

if TYPE_CHECKING:
    from tinygc.estimation.physics import PhysicsFit


#: findings of the first look beside which a pass is weak evidence: not all of the log was used, or not all turns are alike
DOUBTED = (NO_STILLS, FILTER, TRACKED)

# The versions that made a result.

PACKAGES = ("numpy", "scipy")
ROOT = Path(__file__).resolve().parents[2]


def versions(by_torch: bool = False) -> dict[str, str]:
    """Return the versions of this project, its commit if it runs from a checkout, Python, and the numerical packages; by_torch: whether
    PyTorch trained what they are of."""
    found = {"TinyGC": VERSION}
    if commit := _commit():
        found["commit"] = commit
    found["Python"] = platform.python_version()
    for name in (*PACKAGES, *(["torch"] if by_torch else [])):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _commit() -> str | None:
    """Return the commit of the checkout that contains this file, marked if it has changed since; None without a checkout."""
    if not (ROOT / ".git").exists() or not (ROOT / "calibrate.py").exists():
        return None
    try:
        said = subprocess.run(
            ["git", "-C", str(ROOT), "describe", "--always", "--dirty=, changed since", "--abbrev=12", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return said.stdout.strip() or None


# The result of a fit.

#: suffix of a model as of its session's end, valid at any time, where another model follows the session's time
AT_END = "_at_end"
#: methods that are fitted to the problem of the named physics
PHYSICS = ("physics", "tinygc_physics")


@dataclass(frozen=True, eq=False)
class FitResult:
    """The result of a fit.

    methods by name; runs with errors_rad by file and method; covariance (12, 12) of least squares' parameters, already scaled by
    ``widened``, the variance inflation that no noise explains; accelerometer_covariance (12, 12): its part from the accelerometer's
    pre-calibration; noise estimated from the recording, None where it is not; bias_from: source of the bias; fit_other_choice: fits least
    squares with the opposite choice of still rates; against_raw: whether the fits are better than raw rates; first_order_rad: the largest
    error of the paper's integrator on these segments; warnings of the first check; physics that was fitted as well, or None; reused:
    methods taken from saved files instead of being fitted; bias_sigma_rps (3,): spread of the logs' biases, where each had its own;
    joint_covariance (21, 21): of both sensors (``accelerometer.JOINT_NAMES``), inflated as well, where they were estimated jointly, and
    joint_sources that it is the sum of; joint_shared (21, 21): its part from a given calibration; lot: the use of an external prior, None
    without one; not_run: why a requested method cannot run on this session, by name; allowed: how far one effect that the recording still
    allows moves the parameters, None where the noise is not estimated; repeatability: spread of the bias between sessions, None where
    nothing tells it; accelerometer_between: the same of the accelerometer; sources: the parts that ``covariance`` is the sum of.
    """

    problem: Problem
    options: FitOptions
    methods: dict[str, MethodFit]
    runs: list[ClosureRun]
    run_errors: list[dict[str, np.ndarray]]
    goodness: GoodnessOfFit
    linear: MethodFit
    covariance: np.ndarray
    widened: float
    bias_from: BiasChoice
    fit_other_choice: Callable[[], MethodFit]
    against_raw: AgainstRaw
    first_order_rad: float
    warnings: list[Finding]
    physics: PhysicsFit | None = None
    reused: tuple[str, ...] = ()
    bias_sigma_rps: np.ndarray | None = None
    noise: StatedNoise | None = None
    accelerometer_covariance: np.ndarray | None = None
    joint_covariance: np.ndarray | None = None
    joint_sources: tuple[Source, ...] = ()
    joint_shared: np.ndarray | None = None
    lot: PriorUse | None = None
    not_run: dict[str, str] = field(default_factory=dict)
    allowed: Systematic | None = None
    repeatability: BiasRepeatability | None = None
    accelerometer_between: AnySession = USUAL_SPREAD
    sources: tuple[Source, ...] = ()

    def __repr__(self) -> str:
        return f"<FitResult {self.session.name}: {', '.join(self.methods)}>"

    @property
    def accelerometer(self) -> AccelerometerFit:
        """The accelerometer's calibration that the references depend on."""
        config = self.session.config
        gravity_mps2 = config.site.expected_gravity_mps2
        found = accelerometer_fit(config.accelerometer, self.problem.joint, self.joint_covariance, gravity_mps2, self.joint_sources)
        return replace(found, between=self.accelerometer_between)

    @property
    def session(self) -> Session:
        """The fitted session."""
        return self.problem.session

    @property
    def systematic(self) -> np.ndarray | None:
        """(12,) how far any one effect of the catalogue, of a size that the recording still allows, moves each parameter; else None."""
        return None if self.allowed is None else self.allowed.sigma

    @property
    def nominal_rate(self) -> NominalRate | None:
        """The data rate that stands for a clock: the scale common to all axes is no better known.  None where stamps are measured."""
        return self.session.nominal_rate

    @cached_property
    def other_choice(self) -> MethodFit:
        """Least squares with the opposite choice of still rates; FitError where it does not settle."""
        return self.fit_other_choice()

    @cached_property
    def use(self) -> ModelToUse:
        """The model to use, and why."""
        problems = {name: self.physics.problem if self.physics and name in PHYSICS else self.problem for name in self.methods}
        return model_to_use(self.methods, self.against_raw, {name: [s.number for s in p.used] for name, p in problems.items()})

    @cached_property
    def judged(self) -> JudgedFit:
        """The figures that the verdict looks at: those of named physics where that is the model to use, else of least squares."""
        physics, name = self.physics, self.use.method
        if physics is not None and name in PHYSICS:
            state = physics.fit.state
            vector, covariance = state.vector[rows_of_rates(state)], rate_covariance(physics.fit, self.session.clock)
            errors = errors_with_physics(physics.model.claims, physics.model.known, state.earth_t)
            problem, held_out, freedom = physics.problem, self.methods[name].held_out, None
            closure_p = physics.fit.p_value
        else:
            model = self.linear.model
            assert isinstance(model, LinearModel)
            used = self.methods.get(name or "", self.linear)
            problem, held_out, vector, covariance = self.problem, used.held_out, model.vector, self.covariance
            closure_p, freedom = self.goodness.p_value, self.goodness.freedom

            def errors(trial: np.ndarray, run: ClosureRun) -> np.ndarray:
                return run.errors(LinearModel.from_vector(trial), self.options.integrator)

        left = [errors(vector, run) for run in self.runs]
        if name in self.methods:  # another than least squares closes by its own errors, and within the same uncertainties
            left = [found[name] for found in self.run_errors]
        return JudgedFit(
            angles=held_out,
            numbers=[segment.number for segment in problem.used],
            vector=vector,
            floor_rms=problem.floor.tilt_rms,
            closure_p=closure_p,
            closure_freedom=freedom,
            run_errors=left,
            run_p=run_p_values(self.problem, self.runs, vector, covariance, errors, self.repeatability, left),
            run_losses=[""] * len(self.runs),
            run_floors=[run.floor_rad for run in self.runs],
            covariance=covariance,
            sources=self.sources,
            unobserved=tuple(self.linear.notes.get("unobserved", ())),
            allowed=None if physics is not None and name in PHYSICS else self.allowed,
        )

    @cached_property
    def doubts(self) -> list[str]:
        """Reasons, besides the closure's, for which a pass of this session is weak evidence."""
        nominal, linear = self.nominal_rate, self.linear.model
        assert isinstance(linear, LinearModel)
        known = [] if nominal is None else [nominal.doubt]
        if not self.against_raw.held_out:
            known.append("no method was fitted: ask for least_squares")
        if counted := [log.path.name for log in self.session.logs if looks_counted(log, self.session.config.sensor)]:
            known.append(f"{counted[0]}: the stamps look counted, so the scale common to all axes is not known; give sensor.odr_sigma")
        known += [f"{w.where}: {w.what} {w.says}" for w in self.warnings if w.what in DOUBTED]
        return known + too_good(goodness(self.problem.batch, self.problem.floor, linear).p_value)

    def linear_doubts(self, limit_deg: float | None = None) -> list[str]:
        """``doubts``, and whether an effect that the linear model lacks may have moved it too far."""
        wide = [] if self.allowed is None else too_wide(self.allowed.tilt_rms, limit_deg, self.against_raw)
        return self.doubts + wide

    def verdict(self, limit_deg: float | None = None) -> Acceptance:
        """PASS, NOT DECIDED or FAIL, with the rule and the reasons."""
        if limit_deg not in self._verdicts:
            is_linear = self.use.method not in PHYSICS
            more = [PART_NAMED] if not is_linear and self.physics is not None and self.physics.refused else []
            self._verdicts[limit_deg] = self.decided(self.judged, is_linear, limit_deg, more)
        return self._verdicts[limit_deg]

    @cached_property
    def _verdicts(self) -> dict[float | None, Acceptance]:
        """By limit, deg: the screen, the files and the exit code have the same."""
        return {}

    def decided(self, judged: JudgedFit, is_linear: bool, limit_deg: float | None = None, doubts: Sequence[str] = ()) -> Acceptance:
        """The verdict on a calibration of this session.  is_linear: whether it is the linear model, of which ``tests`` are; doubts beside
        this session's own."""
        return decide(
            judged,
            [run.file for run in self.runs],
            limit_deg,
            self.against_raw,
            self.accelerometer,
            [*(self.linear_doubts(limit_deg) if is_linear else self.doubts), *doubts],
            self.requirements,
            [test for test in self.tests if is_linear or test.name == GRAVITY],
            promise_of(self.problem),
        )

    @cached_property
    def without_physics(self) -> FitResult:
        """The fit without the physics that were named in it: ``explain`` takes it so, since its verdict is on what is to be explained."""
        if self.physics is None:
            return self
        methods = {name: fit for name, fit in self.methods.items() if name not in PHYSICS}
        errors = [{name: error[name] for name in methods} for error in self.run_errors]
        held_out = {name: tilt for name, tilt in self.against_raw.held_out.items() if name in methods}
        raw = replace(self.against_raw, held_out=held_out)
        return replace(self, physics=None, methods=methods, run_errors=errors, against_raw=raw)

    @cached_property
    def tests(self) -> tuple[ModelTest, ...]:
        """Whether the recording contradicts the linear model."""
        runs = dict(zip((run.file for run in self.runs), self.without_physics.judged.run_p, strict=True))
        return model_tests(self.goodness, runs, self.noise, self.allowed, self.accelerometer)

    @cached_property
    def requirements(self) -> Requirements | None:
        """Limits of the options' file, else of session.toml; None without any.  Raises FormatError for a file that holds none."""
        path = self.options.requirements
        return self.session.config.requirements if path is None else read_requirements(path)

    @property
    def file_to_use(self) -> str | None:
        """The name of that model's file; where it follows its session's time, that of the model for any time."""
        name, physics = self.use.method, self.physics
        if name is None:
            return None
        return f"model_{name}{AT_END if physics and name in PHYSICS and physics.model.session_s is not None else ''}.json"


# A fit's errors on turns whose angle is known beforehand.


def known_turns_json(result: FitResult) -> list[dict]:
    """Return ``known_turns`` of ``tinygc-fit/2``: every row of turns.csv; errors of least squares, predicted less stated."""
    problem, found = result.problem, []
    row = {segment.number: i for i, segment in enumerate(problem.used)}
    for turn in problem.known_turns:
        i = row.get(turn.segment.number) if turn.problem is None and turn.segment is not None else None
        third = None if i is None else (result.linear.angles[i, 2], result.linear.held_out[i, 2])
        found.append(
            {
                "turn": turn.known.turn,
                "log": turn.known.log,
                "segment": None if turn.segment is None else turn.segment.number,
                "axis": turn.known.axis.tolist(),
                "angle_deg": turn.known.angle_rad / DEG,
                "sigma_deg": turn.known.sigma_rad / DEG,
                "gyro_deg": None if turn.reads is None else turn.along_rad / DEG,
                "used": i is not None,
                "why_not": turn.problem,
                "error_deg": None if third is None else float(third[0]) / DEG,
                "holdout_error_deg": None if third is None else float(third[1]) / DEG,
            }
        )
    return found


def known_turns_words(result: FitResult) -> str:
    """Summarise them in one line for the terminal; empty where no turn has a known angle."""
    turns = known_turns_json(result)
    if not turns:
        return ""
    used = [turn for turn in turns if turn["used"]]
    unused = f"; {len(turns) - len(used)} of {len(turns)} not used" if len(used) < len(turns) else ""
    if not used:
        where = "turns=" if result.session.in_memory else "turns.csv"
        return f"{where}: none of {len(turns)} turns of known angle is used, see the first look"
    each = ", ".join(f"{t['segment']} ({t['angle_deg']:g}° ± {t['sigma_deg']:g}°, left {t['error_deg']:+.3f}°)" for t in used)
    return f"turns of known angle: segment{'s' * (len(used) != 1)} {each}{unused}"


# A fit as ``tinygc-fit/2``.

SCHEMA = "tinygc-fit/2"


def to_json(result: FitResult, limit_deg: float | None = None) -> dict:
    """Return the result as ``tinygc-fit/2`` (docs/formats.md); limit_deg: of the verdict."""
    problem = result.problem
    rejected = [segment for segment in problem.segments if not segment.accepted]
    earth = problem.earth
    return {
        "schema": SCHEMA,
        "session": result.session.name,
        "stills": len(problem.stills),
        "nominal_rate": None if result.nominal_rate is None else asdict(result.nominal_rate),
        "segments": {
            "found": len(problem.segments),
            "used": len(problem.used),
            "rejected": [{"segment": segment.number, "why": segment.problem} for segment in rejected],
            "notes": [{"segment": s.number, "note": s.note} for s in problem.segments if s.accepted and s.note],
            "variance_inflation": [each.to_json() for each in problem.widened],
        },
        "rests_not_used": [
            {"log": log, "at_s": round(rest.start_s, 3), "duration_s": round(rest.duration_s, 3), "cause": rest.cause, "why": rest.why}
            for log, rest in problem.unused_rests
        ],
        "noise": {
            "gyro_dps_rthz": (problem.noise.gyro / DEG).tolist(),
            "accel_g_rthz": (problem.noise.accel / G).tolist(),
            **problem.instability.to_json(),
            **({} if problem.at_rest is None else {"at_rest": problem.at_rest.to_json()}),
            "closure_floor_rms_deg": problem.floor.tilt_rms / DEG,
            "closure_all_rms_deg": None if result.noise is None else result.noise.tilt_rms / DEG,
            "components": [] if result.noise is None else result.noise.to_json(),
            **({} if result.physics is None else {"closure_floor_repaired_rms_deg": result.physics.problem.floor.tilt_rms / DEG}),
        },
        "accelerometer": {**result.accelerometer.to_json(), "effects": [] if result.physics is None else list(result.physics.of_force)},
        "goodness": vars(result.goodness),
        "bias_any_session": None if result.repeatability is None else result.repeatability.to_json(result.covariance[BIAS, BIAS]),
        "systematic": None if result.allowed is None else result.allowed.to_json(),
        "sources": [source.to_json() for source in result.sources],
        "bias_from": result.bias_from.to_json(),
        "lot": None if result.lot is None else result.lot.to_json(),
        "known_turns": known_turns_json(result),
        "truth": _truth_table(result.session),
        "unobserved": result.linear.notes.get("unobserved", []),
        "earth": {
            "source": earth.source,
            "heading_deg": None if earth.heading_rad is None or earth.source == "unknown" else earth.heading_rad / DEG,
            "heading_sigma_deg": earth.heading_sigma_rad / DEG if earth.source == "estimated" else None,
        },
        "methods": {
            name: {
                "parameters": fit.parameters,
                "seconds": round(fit.seconds, 3),
                "train": closure_figures(fit.angles),
                "holdout": closure_figures(fit.held_out),
                **({"denoiser": fit.notes["denoiser"]} if "denoiser" in fit.notes else {}),
            }
            for name, fit in result.methods.items()
        },
        "not_run": [{"method": name, "why": why} for name, why in result.not_run.items()],
        "use": {**result.use.to_json(), "model": result.file_to_use},
        "against_raw": result.against_raw.to_json(),
        "verdict": result.verdict(limit_deg).to_json(),
        "closure_runs": [
            {
                "file": run.file,
                "duration_s": run.duration_s,
                "floor_rmse_deg": rms_of(run.floor_rad) / DEG,
                "earth": run.earth.source,
                **({} if result.physics is None else {"lost_at_s": np.round(result.physics.lost_s[number], 3).tolist()}),
                **{name: run_figures(error) for name, error in errors.items()},
            }
            for number, (run, errors) in enumerate(zip(result.runs, result.run_errors, strict=True))
        ],
        "still_rates": {"used": result.options.still_rates, "other_choice_holdout": closure_figures(result.other_choice.held_out)},
        "options": {
            "seed": result.options.seed,
            "folds": min(result.options.folds, len(problem.used)),
            "as_in_paper": result.options.as_in_paper,
            "bias_per_log": result.options.bias_per_log,
            "bias": result.options.bias,
            "accelerometer": result.options.accelerometer,
            "clock": result.options.clock,
        },
        "version": VERSION,
    }


# ``fit.json`` and ``rebiased.json`` as ``export`` and ``compare`` read them; keys that are not used are not checked.

#: dps and g per root Hz: a thousandth of any sensor's range
_DENSITY = Array((3,), Number(0, 1e3))
_TILT_DEG = Maybe(Number(0, 1e4))
_NOISE: dict[str, Shape] = {
    "gyro_dps_rthz": _DENSITY,
    "accel_g_rthz": _DENSITY,
    "gyro_bias_instability_dph": Maybe(Number(0, 1e9)),
    "gyro_bias_instability_source": Maybe(Text()),
    "closure_floor_rms_deg": _TILT_DEG,
}
_ACCELEROMETER: dict[str, Shape] = {
    "mode": Text(("given", "fit", "prior")),
    "unobserved": Maybe(ListOf(Text())),
    "zero_drift": Maybe(Keys(may={"significant": Flag()})),
    "effects": Maybe(ListOf(Keys({"id": Text()}))),
}
FILE_SHAPE = Keys(
    {"schema": Text((SCHEMA,))},
    {
        "session": Text(),
        "segments": Keys(may={"used": Number(0, whole=True)}),
        "noise": Keys(may=_NOISE),
        "accelerometer": Maybe(Keys(may=_ACCELEROMETER)),
        "goodness": Maybe(Keys({"p_value": Number(0, 1)})),
        "methods": MapOf(Keys(may={"holdout": Keys(may={"tilt_rms_deg": _TILT_DEG})})),
        "against_raw": Maybe(Keys(may={"tilt_rms_deg": _TILT_DEG})),
        "verdict": Maybe(Keys(may={"answer": Text(), "headline": Text()})),
        "options": Maybe(Keys(may={"as_in_paper": Flag()})),
        "use": Maybe(Keys(may={"method": Maybe(Text()), "model": Maybe(Text()), "why": Maybe(Text())})),
    },
)

#: figures that the export of a model requires: its held-out closure, the number of turns, and the sensor's noise
_JUDGED: dict[str, Shape] = {
    "session": Text(),
    "segments": Keys({"used": Number(0, whole=True)}),
    "noise": Keys({"gyro_dps_rthz": _DENSITY, "accel_g_rthz": _DENSITY}),
    "methods": MapOf(Keys({"holdout": Keys({"tilt_rms_deg": _TILT_DEG})})),
}
#: ``rebiased.json`` includes the stored calibration as a method, and has no raw rates
JUDGED, REBIASED = Keys(_JUDGED | {"against_raw": Keys({"tilt_rms_deg": _TILT_DEG})}), Keys(_JUDGED)


def read_judged(path: Path, do: str, method: str, *, rebiased: bool = False) -> dict:
    """Read the figures of a fit that decide whether its model of that method may be exported.  A method that ``fit`` does not have, for
    another program's model, may be absent.  Raises FormatError as ``read_fit``."""
    fit = read_fit(path, do)
    require(fit, REBIASED if rebiased else JUDGED, str(path), do)
    if not rebiased and method in METHODS and method not in fit["methods"]:
        raise FormatError(f"{path}: methods.{method} is missing, expected how well that model closes held-out turns; {do}")
    return fit


def read_fit(path: Path, do: str = "fit again") -> dict:
    """Read the figures of a fit.  Raises FormatError with the key, what was expected there, and ``do``."""
    return read_required(path, FILE_SHAPE, do)


# Saved methods of ``fit``, reused where they were made from the same files, with the same options, by the same version.

SAVED_NAME, SAVED_SCHEMA = "fitted.json", "tinygc-fitted/1"
#: options that do not affect the numbers of a method
IRRELEVANT = ("methods", "physics", "checkpoints", "resume", "history", "noise", "requirements")
_ANGLES = Array((None, None))
_METHOD = Keys({"fitted_rad": _ANGLES, "held_out_rad": _ANGLES, "seconds": Number(0), "notes": Keys()})
SAVED_SHAPE = Keys({"schema": Text((SAVED_SCHEMA,)), "key": Keys(), "methods": MapOf(_METHOD)})


def key(options: FitOptions, hashes: dict[str, str]) -> dict:
    """Return what must be equal for reuse, JSON-ready."""
    chosen = {
        name: list(value) if isinstance(value, tuple) else str(value) if isinstance(value, Path) else value
        for name, value in asdict(options).items()
        if name not in IRRELEVANT
    }
    return {"options": chosen, "inputs": hashes, "version": VERSION}


def inputs_of(problem: Problem) -> dict[str, str]:
    """Return file -> SHA-256 of what a method's numbers follow from: the session's files, and noise figures at rest if there are any."""
    return input_hashes(problem.session) | ({} if problem.at_rest is None else {problem.at_rest.file: problem.at_rest.sha256})


def made_from(options: FitOptions, hashes: dict[str, str], methods: dict[str, MethodFit]) -> dict:
    """Return the inputs of a fit, and for each method the error angles of each segment, rad, its seconds and its notes; JSON-ready."""
    entries = {
        name: {"fitted_rad": fit.angles.tolist(), "held_out_rad": fit.held_out.tolist(), "seconds": fit.seconds, "notes": fit.notes}
        for name, fit in methods.items()
    }
    return {"schema": SAVED_SCHEMA, "key": key(options, hashes), "methods": entries}


def saved_methods(folder: Path, problem: Problem, options: FitOptions, hashes: dict[str, str]) -> dict[str, MethodFit]:
    """Read the requested methods that a folder of ``fit`` contains for this problem; none where anything differs or cannot be read."""
    try:
        table = read_required(folder / SAVED_NAME, SAVED_SHAPE)
        if table["key"] != key(options, hashes):
            return {}
        found = {name: _read(folder, name, table["methods"][name], problem) for name in options.methods if name in table["methods"]}
    except CalibrationError:
        return {}
    if "tinygc_denoised" in options.methods and "tinygc_denoised" not in found:
        found.pop("tinygc", None)  # the denoiser is trained on the fits of the folds, which are not saved
    return found


def _read(folder: Path, name: str, entry: dict, problem: Problem) -> MethodFit:
    angles, held_out = (np.asarray(entry[which], dtype=float) for which in ("fitted_rad", "held_out_rad"))
    shape = (len(problem.batch), problem.batch.angles)
    if angles.shape != shape or held_out.shape != shape:
        raise FormatError(f"{name}: not the angles of {shape[0]} segments")
    return MethodFit(name, models.load(folder / f"model_{name}.json"), angles, held_out, float(entry["seconds"]), dict(entry["notes"]))


# A fit's models and figures as files.


def save_models(result: FitResult, folder: Path | None = None, limit_deg: float | None = None) -> Path:
    """Write each method's model, and the figures, into a folder, the session's ``fit`` by default; returns that folder.

    limit_deg: of the verdict.  Raises CalibrationError where the session has no folder and none is given, and StorageError for what
    cannot be written.
    """
    folder = folder or result.session.own_folder("fit")
    with result_folder(folder):
        tables = model_tables(result)
        for name, table in tables.items():
            write_whole(folder / f"model_{name}.json", table)
            if name + AT_END not in tables:  # from an earlier fit, whose physics followed time
                (folder / f"model_{name}{AT_END}.json").unlink(missing_ok=True)
        made = made_from(result.options, inputs_of(result.problem), result.methods)
        write_whole(folder / "fit.json", to_json(result, limit_deg))
        write_whole(folder / SAVED_NAME, made)
    return folder


def _truth_table(session: Session) -> dict | None:
    if session.alignment is None:
        return None
    from session.detect.truth_alignment import alignment_table  # imported late: it loads SciPy

    return alignment_table(session.alignment)


def model_tables(result: FitResult) -> dict[str, dict]:
    """Return each method's model as ``tinygc-model/1``, with its inputs and its uncertainty.

    Where one follows its session's time, there is a second for any time, NAME_at_end, as of the session's end.
    """
    # Models that use specific force, and users of calibrated force, need it in addition to the rates.
    made_from: dict[str, Any] = {
        "session": result.session.name,
        "sha256": input_hashes(result.session),
        "version": VERSION,
        "clock": result.options.clock,
        "sensor": sensor_table(result.session.config.sensor),
    }
    if (temperature_c := result.session.temperature_c) is not None:
        made_from["temperature_c"] = temperature_c
    tables = {}
    for name, fit in result.methods.items():
        # Models with physics may depend on another calibration of the accelerometer than those without.
        problem = result.physics.problem if result.physics is not None and name in PHYSICS else result.problem
        made_from["accelerometer"] = accelerometer_table(problem.session.config.accelerometer)
        more: dict[str, Any] = {"method": name, **made_from}
        if fit is result.linear:
            if result.lot is not None:
                more["lot"] = {key: result.lot.to_json()[key] for key in ("file", "hash", "used", "belongs_probability")}
            more["covariance"] = result.covariance.tolist()
            if result.accelerometer_covariance is not None:
                more["accelerometer_covariance"] = result.accelerometer_covariance.tolist()
            if result.joint_covariance is not None and result.joint_shared is not None:
                more["joint_covariance"] = {
                    "parameters": list(JOINT_NAMES),
                    "matrix": result.joint_covariance.tolist(),
                    "shared": result.joint_shared.tolist(),
                }
            more["unobserved"] = fit.notes.get("unobserved", [])
        ended: dict[str, Any] = {"method": name + AT_END, **made_from}
        if name == "physics" and result.physics is not None:
            from tinygc.estimation.physics import covariance_at_end, covariance_table

            covariance = rate_covariance(result.physics.fit, result.session.clock)
            more |= covariance_table(result.physics.model.claims, covariance)
            ended |= covariance_at_end(result.physics.model, covariance)
        if result.repeatability is not None:
            more["bias_sigma_rps"] = result.repeatability.rps.tolist()
        if not result.accelerometer_between.usual:
            more["accelerometer_spread"] = result.accelerometer_between.spread.tolist()
        if fit.model.session_s is not None and result.physics is not None:
            more["began_s"] = _began_s(result.physics.problem)
            tables[name + AT_END] = models.to_dict(fit.model.at_end(), **ended)
        tables[name] = models.to_dict(fit.model, **more)
    return tables


def _began_s(problem: Problem) -> dict[str, float]:
    """Return the time, s of the session, at which each log begins."""
    return {file_key(log.path): float(moment) for log, moment in zip(problem.session.logs, problem.began_s[:-1], strict=True)}
