"""What is known of a unit, read once: a calibration with its uncertainty, the session it was fitted to, its noise, its other sessions.

``fit --history``, ``verify``, ``watch``, ``history``, and a new bias start from this record.  How far the unit's numbers are others
in another session has one answer, ``spread_of``: by its other sessions, else as session.toml, its lot or its model's file have it,
else as usual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, DataError, FitError, FormatError
from session.base.names import CLOCKS, is_session, refuse_special
from session.base.records import json_text
from session.base.results import read_json_text
from session.base.texts import command_line, printable
from session.base.units import DEG, DEG_PER_HOUR, MG, G
from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.log.config import Accelerometer, Config, read_config
from session.log.folder import Session, input_hashes
from tinygc import models
from tinygc.closure.joint import GIVEN_SIGMA_MG
from tinygc.estimation.accelerometer import JOINT_NAMES, AccelerometerFit, into_frame_of
from tinygc.estimation.between_sessions import course
from tinygc.estimation.session_times import Moment, moment_of, times_of
from tinygc.estimation.spread import ACCELEROMETER, COUNT, GYROSCOPE, USUAL, ZERO, Spread
from tinygc.fitting.fit_file import model_tables, read_fit
from tinygc.fitting.fit_file import to_json as fit_to_json
from tinygc.fitting.results import FitResult
from tinygc.inference.solve import root
from tinygc.models.linear import BIAS, MATRIX, NAMES, PARAMETERS, LinearModel
from tinygc.models.model import Model, accelerometer_of, certain
from tinygc.models.physics import PhysicsModel
from tinygc.noise.components import REFERENCE, STILL_RATE, TURN, WANDER
from tinygc.noise.figures import FILE, NoiseFigures, read_figures

#: p-value below which a disagreement is significant
DIFFERS_P = 0.01
#: mode of an accelerometer's fit -> in words
MODES = {"given": "taken as given", "fit": "estimated from its own stills and turns", "prior": "given, and sharpened by its own stills"}
#: m/s^2 of each number of a given accelerometer calibration, at zero g and at one g
GIVEN_MPS2 = GIVEN_SIGMA_MG * MG
#: components of a fit's noise -> their unit in SI
COMPONENTS = {WANDER: DEG_PER_HOUR, STILL_RATE: DEG, TURN: DEG, REFERENCE: MG}
#: a fit's file that a session of a history must have
MODEL = Path("fit") / "model_least_squares.json"
_JOINT = np.diag(np.r_[np.full(6, GIVEN_MPS2 / G), np.full(3, GIVEN_MPS2)] ** 2)


@dataclass(frozen=True, eq=False)
class UnitState:
    """path of a model's file, as it is named in messages; model; table: all that the file holds; fit: ``fit.json`` next to it, empty where
    there is none; folder, config: the session that it was fitted to and its session.toml, None where they do not lie around it; figures:
    the unit's noise at rest, None where not known."""

    path: Path
    model: Model
    table: dict[str, Any] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    config: Config | None = None
    figures: NoiseFigures | None = None

    # What it is a calibration of.

    @property
    def name(self) -> str:
        """The folder of its session, or its session, or its file."""
        return printable(self.folder.resolve().name if self.folder is not None else str(self.table.get("session") or self.path.name))

    @property
    def sensor(self) -> dict[str, Any]:
        """``sensor`` of the file."""
        found = self.table.get("sensor")
        return found if isinstance(found, dict) else {}

    @cached_property
    def accelerometer(self) -> Accelerometer | None:
        """The calibration that its references came from, None where the file has none."""
        return accelerometer_of(self.table, str(self.path))

    @property
    def clock(self) -> str:
        """By which clock its scale is."""
        return str(self.table.get("clock", CLOCKS[0]))

    @property
    def logs(self) -> set[str]:
        """Hashes of the logs that it was fitted to."""
        return hashes_in(self.table)

    @property
    def settings(self) -> Config:
        """``session.toml`` of a fitted session."""
        assert self.config is not None
        return self.config

    @cached_property
    def moment(self) -> Moment | None:
        """When its session was recorded."""
        return None if self.folder is None else moment_of(self.folder, self.config)

    @property
    def temperature_c(self) -> float | None:
        """Mean temperature of its session, °C; None where the file does not state it."""
        return None if self.table.get("temperature_c") is None else float(self.table["temperature_c"])

    # The calibration, and what is not known of it.

    @property
    def linear(self) -> LinearModel:
        """The linear calibration; of another kind of model, of what it returns: no correction."""
        return self.model if isinstance(self.model, LinearModel) else LinearModel(np.eye(3), np.zeros(3))

    @property
    def bias(self) -> np.ndarray:
        """(3,) rad/s: its B; of a model without one, zero, so that a new one is a correction."""
        return self.model.linear.B if isinstance(self.model, PhysicsModel) else self.linear.B

    @property
    def vector(self) -> np.ndarray:
        """(12,): E and B."""
        return self.linear.vector

    @cached_property
    def covariance(self) -> np.ndarray:
        """(12, 12) of a linear model; empty where the file has none."""
        return _matrix(self.table.get("covariance"))

    @property
    def of_given(self) -> np.ndarray | None:
        """(12, 12): part of the covariance from the accelerometer's given calibration; None without one."""
        return None if "accelerometer_covariance" not in self.table else _matrix(self.table["accelerometer_covariance"])

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Parameters that its session does not show."""
        return tuple(name for name in NAMES if name in (self.table.get("unobserved") or ()))

    @cached_property
    def triad(self) -> AccelerometerFit:
        """The accelerometer's calibration."""
        lines = self.fit.get("accelerometer") or {}
        calibration = self.accelerometer or (Accelerometer(source="none") if self.config is None else self.config.accelerometer)
        left = [name for name in ACCELEROMETER_NAMES if name in (lines.get("unobserved") or [])]
        return AccelerometerFit(lines.get("mode", "given"), calibration, self._of_joint("matrix"), tuple(left))

    @cached_property
    def triad_of_given(self) -> np.ndarray | None:
        """(9, 9): part of the triad's covariance from a given calibration; None without a joint estimate."""
        return self._of_joint("shared")

    def _of_joint(self, key: str) -> np.ndarray | None:
        """The accelerometer's part (9, 9) of a joint covariance."""
        if (joint := self.table.get("joint_covariance")) is None:
            return None
        matrix = _matrix(joint.get(key) if isinstance(joint, dict) else None)
        if matrix.ndim != 2 or min(matrix.shape) < ACCELEROMETER.stop or not np.isfinite(matrix).all():
            raise FormatError(f"{self.path}: joint_covariance.{key} is not 21 x 21; run `{command_line('fit')}` again")
        return matrix[ACCELEROMETER, ACCELEROMETER]

    @property
    def own_lengths(self) -> bool:
        """Whether the accelerometer was given: then its error is in gravity's length, and E has taken up what it does to the turns."""
        joint = self.table.get("joint_covariance")
        return not isinstance(self.model, LinearModel) or joint is None or np.shape(joint["matrix"]) != (COUNT, COUNT)

    @property
    def has_covariance(self) -> bool:
        """Whether the file states that of E and B."""
        return len(self.covariance) >= PARAMETERS and isinstance(self.model, LinearModel | PhysicsModel)

    @cached_property
    def joint(self) -> np.ndarray:
        """(21, 21) of the accelerometer's correction and of E and B, as far as today's references do not share it; of a usual session of 40
        turns where the file has none."""
        if not self.own_lengths:
            return _matrix(self.table["joint_covariance"]["matrix"])
        found = np.zeros((COUNT, COUNT))
        found[ACCELEROMETER, ACCELEROMETER] = _JOINT
        from tinygc.planning.proposals import TARGETS  # late: no fit asks for it

        found[GYROSCOPE, GYROSCOPE] = np.diag(TARGETS**2)
        if self.has_covariance:
            own = self.covariance[:PARAMETERS, :PARAMETERS]
            if isinstance(self.model, LinearModel) and self.of_given is not None and self.of_given.shape == own.shape:
                # That error is in today's references as well; rounding may leave a difference of two with eigenvalues below zero
                own = np.linalg.matrix_power(root(own - self.of_given), 2)
            if isinstance(self.model, PhysicsModel):
                slope = _of_calibrated(self.model.linear)
                own = slope @ own @ slope.T
            found[GYROSCOPE, GYROSCOPE] = own
        return found

    @property
    def missing_words(self) -> list[str]:
        """What the file does not state, a sentence each."""
        lines = []
        if not self.has_covariance:
            lines.append(
                "the model file has no covariance: that of a usual session of 40 turns is assumed, 50 ppm and 0.002 dps; fit it again"
            )
        elif isinstance(self.model, PhysicsModel):
            lines.append("of the model's covariance, that of E and B is taken; that of its effects is not")
        if self.accelerometer is None:
            lines.append(
                "the model file has no accelerometer calibration: today's is taken, E must be in its frame, and gravity's "
                "length is not tested"
            )
        return lines

    @property
    def notes(self) -> list[str]:
        """What to know of its sigmas and its scale."""
        lines = []
        if (found := self.fit.get("goodness")) is not None and found["p_value"] < DIFFERS_P:
            lines.append("its closure is above its noise floor: its sigmas are widened for that, and `explain` shows why")
        if self.clock != CLOCKS[0]:
            lines.append(f"its scale is by the computer's clock (--clock {self.clock})")
        return lines

    def required(self) -> UnitState:
        """Itself, a linear model with a sound covariance and fit.  Raises FormatError for any other."""
        again = f"run `{command_line('fit', *([] if self.folder is None else [self.folder]))}` again"
        covariance = self.covariance
        if not isinstance(self.model, LinearModel) or covariance.shape != (12, 12) or not np.isfinite(covariance).all():
            raise FormatError(f"{self.path}: no linear model with a covariance of 12 x 12; {again}")
        if certain(covariance) or np.linalg.eigvalsh(covariance / np.sqrt(np.outer(*[np.diag(covariance)] * 2))).min() <= 0:
            raise FormatError(f"{self.path}: the covariance is not positive definite; {again}")
        if self.of_given is not None and (self.of_given.shape != (12, 12) or not np.isfinite(self.of_given).all()):
            raise FormatError(f"{self.path}: accelerometer_covariance is not 12 x 12; {again}")
        lines = self.fit.get("accelerometer") or {}
        mode, left = lines.get("mode", "given"), lines.get("unobserved") or []
        joint = self.table.get("joint_covariance")
        if mode not in MODES or not isinstance(left, list) or (mode != "given" and self.triad.covariance is None and joint is not None):
            raise FormatError(f"{self.path}: fit.json next to it states nothing sound of the accelerometer; {again}")
        return self

    # Its noise, as its own fit found it.

    @property
    def goodness(self) -> tuple[float, int] | None:
        """Chi-square and degrees of freedom of the fit's own closure, None where no fit.json lies next to it."""
        found = self.fit.get("goodness")
        return None if found is None else (float(found["chi_square"]), int(found["freedom"]))

    @property
    def at_rest(self) -> dict[str, tuple[float, float]]:
        """Of the components that rates at rest show, as far as the fit has estimated them: mean square of the size, (rad/s)^2, and the
        degrees of freedom of a variance of the same relative spread."""
        found = {name: self.component(name) for name in (WANDER, STILL_RATE)}
        return {name: variance_and_freedom(*each) for name, each in found.items() if each is not None}

    def component(self, name: str) -> tuple[float, float] | None:
        """Size of a component of the noise and its sigma, SI; None where the fit has not estimated it."""
        for each in (self.fit.get("noise") or {}).get("components") or ():
            if each.get("name") == name:
                return COMPONENTS[name] * float(each.get("size") or 0.0), COMPONENTS[name] * float(each.get("sigma") or 0.0)
        return None

    def largest(self, name: str) -> float | None:
        """Size of a component of the noise, SI, or its sigma where that is larger: what its stills do not show may be so large."""
        found = self.component(name)
        return None if found is None else max(found)

    # The same with another zero.

    def with_bias_moved(self, change: np.ndarray) -> Model:
        """The model with its calibrated rate increased by ``change`` (3,) rad/s.  Raises CalibrationError for a kind without a bias."""
        if isinstance(self.model, PhysicsModel):
            return replace(self.model, linear=self.model.linear.with_bias_moved(change))
        return self.model.with_bias_moved(change)

    def table_with_bias(self, change: np.ndarray, words: str, session: str, **more: Any) -> dict:
        """``tinygc-model/1`` of the model with its bias moved by ``change`` (3,) rad/s; words: of the method; session: whose zero it is."""
        table = self.table
        before = table["stored"] if isinstance(table.get("stored"), dict) else table
        kept = {name: table[name] for name in ("sensor", "accelerometer", "clock") if name in table}  # E is in that one's body frame
        stored = {name: before.get(name) for name in ("method", "session", "sha256")}
        return models.to_dict(self.with_bias_moved(change), method=words, session=session, stored=stored, version=VERSION, **kept, **more)


def variance_and_freedom(size: float, sigma: float) -> tuple[float, float]:
    """Mean square of a normal size with this mean and sigma; degrees of freedom of a variance of the same relative spread, 2 mean^2 / var.

    mean = size^2 + sigma^2, var = 4 size^2 sigma^2 + 2 sigma^4.  A size that was not seen, of 0, has one.
    """
    mean, spread = size**2 + sigma**2, 4 * size**2 * sigma**2 + 2 * sigma**4
    return mean, 2 * mean**2 / spread if spread > 0 else float("inf")


def _matrix(entry: Any) -> np.ndarray:
    """Return an array of numbers; an empty one where the entry is not one."""
    try:
        return np.asarray([] if entry is None else entry, dtype=float)
    except (TypeError, ValueError):
        return np.empty(0)


def hashes_in(table: Mapping[str, Any]) -> set[str]:
    """Hashes of logs in ``sha256`` of a model's file."""
    found = table.get("sha256")
    return {each for name, each in found.items() if name != "session.toml" and isinstance(each, str)} if isinstance(found, dict) else set()


def _of_calibrated(linear: LinearModel) -> np.ndarray:
    """(12, 12): what a change of a linear model's vector is to a correction of its calibrated rates, omega' = E' omega + B'."""
    inverse = np.linalg.inv(linear.E)
    slope = np.zeros((PARAMETERS, PARAMETERS))
    slope[MATRIX, MATRIX] = np.kron(np.eye(3), inverse.T)
    # dE m + dB with m = E^-1 (omega - B): dE E^-1 omega + dB - dE E^-1 B.
    slope[BIAS, BIAS] = np.eye(3)
    slope[BIAS, MATRIX] = -np.kron(np.eye(3), inverse @ linear.B)
    return slope


# Reading.


def read_state(where: Path, noise: Path | None = None) -> UnitState:
    """Read a model file, or that of a fitted session folder, with what lies next to it.

    noise: the unit's ``noise.json``, or its folder.  Raises FormatError for what cannot be read, CalibrationError for noise that is
    not there.
    """
    path = where / MODEL if where.is_dir() else where
    if where.is_dir() and not path.exists():
        if is_session(where):
            refuse_special(where)
        raise FormatError(f"{path}: not found; run `{command_line('fit', where)}` first, or give a model file")
    model, table = models.load_with_table(path)
    home = path.parent
    folder = home.parent if home.name == "fit" and (home.parent / "session.toml").is_file() else None
    fit = read_fit(home / "fit.json", f"run `{command_line('fit', where)}` again") if (home / "fit.json").is_file() else {}
    config = None if folder is None else read_config(folder / "session.toml")
    candidates = [home / FILE] if noise is None else [noise, noise / FILE, noise / "fit" / FILE]
    found = next((each for each in candidates if each.is_file()), None)
    if noise is not None and found is None:
        raise CalibrationError(f"{noise}: no {FILE} there; give the file itself, or the folder that holds it")
    return UnitState(path, model, table, fit, folder, config, None if found is None else read_figures(found))


def fitted_state(folder: Path) -> UnitState:
    """Read a fitted session.  Raises FormatError where it is none, or has no linear model with its covariance."""
    read_config(folder / "session.toml")
    return read_state(folder).required()


def state_of(result: FitResult, config: Config) -> UnitState:
    """The same of a fit that need not lie in a folder; config: of the session as it was given to the fit.

    Raises FitError where least squares was not fitted.
    """
    table = model_tables(result).get("least_squares")
    if table is None:
        raise FitError(f"{result.session.name}: least_squares was not fitted, and only that is compared; fit it as well")
    path, fit = Path(f"{result.session.name}: model_least_squares.json"), read_json_text(json_text(fit_to_json(result)), "fit.json")
    return UnitState(path, models.from_dict(table), table, fit, result.session.folder, config).required()


# Sessions of one unit.


def all_given_the_same(sessions: Sequence[UnitState]) -> bool:
    """Whether one given calibration of the accelerometer was used in all sessions: its error is then the same in all of them."""
    one = sessions[0].settings.accelerometer
    return all(each.triad.mode != "fit" and each.settings.accelerometer.is_as(one) for each in sessions)


def in_one_frame(sessions: Sequence[UnitState], frame: Accelerometer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vectors (n, 12) and covariances (n, 12, 12) in the body frame that an accelerometer defines, whole, and without the shared error of
    one given calibration of the accelerometer."""
    alike, turns = all_given_the_same(sessions), [into_frame_of(frame, each.triad.calibration) for each in sessions]
    apart = [s.covariance - s.of_given if alike and s.of_given is not None else s.covariance for s in sessions]
    whole, own = (
        np.array([turn @ each @ turn.T for turn, each in zip(turns, of, strict=True)]) for of in ([s.covariance for s in sessions], apart)
    )
    return np.array([turn @ s.vector for turn, s in zip(turns, sessions, strict=True)]), whole, own


def refuse_same(sessions: Sequence[UnitState]) -> None:
    """Raise DataError where two sessions hold the same log."""
    for i, one in enumerate(sessions):
        for other in sessions[:i]:
            if one.logs & other.logs:
                raise DataError(f"{other.folder} and {one.folder} hold the same log: a recording agrees with itself; give another")


def spread_over(history: Sequence[Path], session: Session, frame: Accelerometer | None = None) -> Spread:
    """The spread over two or more other fitted sessions of a session's unit, as far as they show it; frame: whose body frame it is for.

    A drift, of four sessions or more, and steps that are significant are taken out (``between_sessions.course``); sessions without dates
    count as they come.  Raises FormatError for a session that is not fitted, of another unit, twice, or a copy.
    """
    sensor = session.config.sensor
    if not sensor.serial:
        raise FormatError(f"--history: {session.folder} names no serial number; give sensor.serial, so that it is the same unit")
    if len({folder.resolve() for folder in history}) < len(history):
        raise FormatError("--history: a folder is given twice; give other sessions of this unit, each once")
    if len(history) < 2:
        raise FormatError(f"--history: one session does not show a spread; give two or more other sessions of {sensor.serial}")
    seen = dict.fromkeys(hashes_in({"sha256": input_hashes(session)}), str(session.folder))
    read = [fitted_state(folder) for folder in history]
    for folder, state in zip(history, read, strict=True):
        own = state.sensor
        if (own.get("model"), own.get("serial")) != (sensor.model, sensor.serial):
            expected = f"expected {sensor.model} {sensor.serial!r}, this session's"
            raise FormatError(f"--history {folder}: of {own.get('model')} {own.get('serial')!r}, {expected}")
        for digest in state.logs:
            if seen.setdefault(digest, str(folder)) != str(folder):
                raise FormatError(f"--history {folder}: holds the same log as {seen[digest]}; give other sessions of this unit")
    return spread_between(read, frame or read[0].triad.calibration, "other sessions of this unit")


def spread_between(read: Sequence[UnitState], frame: Accelerometer, words: str) -> Spread:
    """The spread over two or more sessions of one unit, in any order, of the accelerometer over those that estimated it; words: what
    they are."""
    vectors, stated, _ = in_one_frame(read, frame)
    found = spread_of_values(GYROSCOPE, vectors, stated, read, words)
    estimated = [each for each in read if each.triad.covariance is not None]
    if len(estimated) < 2:
        return found
    own = [each.triad.jacobian @ np.asarray(each.triad.covariance) @ each.triad.jacobian.T for each in estimated]
    more = spread_of_values(ACCELEROMETER, np.array([each.triad.values for each in estimated]), np.array(own), estimated, words)
    return replace(found.or_else(more), note="; ".join(filter(None, (found.note, more.note))))


def spread_of_values(which: slice, values: np.ndarray, own: np.ndarray, sessions: Sequence[Any], words: str) -> Spread:
    """Spread of q of the 21 numbers over n sessions, each with its name and moment; values (n, q), and their covariances (n, q, q)."""
    order, at = times_of([each.moment for each in sessions])
    courses = [course(values[order, q], own[order, q, q], at) for q in range(values.shape[1])]
    scatter, freedom = (np.array([getattr(each.model, name) for each in courses], dtype=float) for name in ("counted", "freedom"))
    names = [sessions[place].name for place in order]
    moved: dict[int, list[str]] = {}
    for name, each in zip(JOINT_NAMES[which], courses, strict=True):
        for before in each.steps:
            moved.setdefault(before, []).append(name)
    count = sum(len(each.steps) for each in courses)
    taken = [*(["drift"] if courses[0].has_drift else []), *([f"{count} step{'s' * (count > 1)}"] if count else [])]
    source = f"{len(sessions)} {words}{', less ' * bool(taken)}{' and '.join(taken)}"
    steps = [f"{', '.join(numbers)} between {names[k]} and {names[k + 1]}" for k, numbers in sorted(moved.items())]
    note = f"the other sessions show a step in {'; '.join(steps)}: it is taken out, and is no scatter between switch-ons" if steps else ""
    return replace(Spread.of(which, scatter, source, freedom), note=note)


def spread_of(
    config: Config | None, table: Mapping[str, Any] | None = None, *, between: Spread | None = None, lot: Spread | None = None
) -> Spread:
    """How far each number of a unit is another one in another session.

    The first that has it of: its other sessions (between), session.toml, its lot, its model's file (table), what is usual.
    """
    found = between or Spread.of([], [], "")
    if config is not None and (given := config.sensor.gyro_bias_repeatability_dps) is not None:
        found = found.or_else(Spread.of(ZERO, given * DEG, "given in session.toml"))
    found = found if lot is None else found.or_else(lot)
    for key, which in (("accelerometer_spread", ACCELEROMETER), ("bias_sigma_rps", ZERO)):
        if (sigma := (table or {}).get(key)) is not None:
            found = found.or_else(Spread.of(which, sigma, "stated in the model file"))
    return found.or_else(USUAL)
