"""Inject effects into a user's recording."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from session.io.errors import DataError
from session.io.files import naming, result_folder
from session.io.folder import Session, read_session
from session.io.reader import Reader
from session.io.registers import RegisterUnits
from session.io.samples import Samples
from session.io.units import G
from tinygc.annexes.challenge.cases import STRENGTHS
from tinygc.annexes.challenge.other_effects import BURST_SAMPLES, BURSTS, CLIPPED, GLITCH_RPS, GLITCH_SAMPLES, GLITCHES, OUTSIDERS
from tinygc.annexes.challenge.rate_effects import OFFSET_S, Scene
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem, conditions
from tinygc.effects import CommonDelay, Effect, Movement, catalogue, movement_of

# A recording that receives an injected effect: its measured movement, and the step of its readings.

#: quantile of the differences between neighbouring values of a log that is one step; rare values differ by several
STEP_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class HostRecording:
    """A session and its problem, as a ``Place`` and a ``Course``."""

    problem: Problem

    @property
    def session(self) -> Session:
        """The session as it was read."""
        return self.problem.session

    @property
    def log_s(self) -> float:
        """Length of all logs, s."""
        return float(self.problem.began_s[-1])

    @property
    def turns(self) -> tuple[tuple[float, float], ...]:
        """(start, stop) of each used segment, s of the session."""
        began = self.problem.began_s
        return tuple((began[each.log] + each.start_s, began[each.log] + each.start_s + each.duration_s) for each in self.problem.used)

    @property
    def gyro_fs_dps(self) -> float:
        """Full scale, dps."""
        return self.session.config.sensor.gyro_fs_dps

    @property
    def latitude_deg(self) -> float:
        """Latitude as given, else the equator's."""
        return self.session.config.site.latitude_deg or 0.0

    @cached_property
    def movements(self) -> list[Movement]:
        """Movement of each log: the rate E m + B of the recording's linear model, as measured."""
        known, first = conditions(self.problem), self.problem.first
        pairs = zip(self.problem.logs, self.problem.began_s, strict=False)
        return [movement_of(log.samples, first(log.samples.gyro), known, float(began)) for log, began in pairs]

    @property
    def has_temperature(self) -> bool:
        """Whether every log has a temperature."""
        return all(log.samples.temp_c is not None for log in self.session.logs)

    @property
    def odr_hz(self) -> float:
        """Data rate, by the stamps."""
        return 1 / float(np.median([movement.dt_s for movement in self.movements]))

    @property
    def temperature_start_c(self) -> float:
        """Temperature at the first sample, degC; 25 without a thermometer."""
        return float(self.movements[0].first_temp_c) if self.has_temperature else 25.0

    @property
    def warm_up_c(self) -> float:
        """Change from the first sample to the last, degC."""
        return float(self.movements[-1].temp_c[-1]) - self.temperature_start_c if self.has_temperature else 0.0

    def force(self, log: int) -> np.ndarray:
        """Pre-calibrated specific force, (N, 3) m/s^2."""
        return self.movements[log].force_g * G


@dataclass(frozen=True)
class Steps:
    """One step of a log's readings: gyro rad/s, accel m/s^2; and whether each is in registers."""

    gyro: float
    accel: float
    gyro_raw: bool
    accel_raw: bool


def steps_of(session: Session, log: int) -> Steps:
    """Steps of one log: a register's, or estimated from the values of a log in physical units."""
    layout, samples, sensor = (
        Reader(session.logs[log].path, None, session.config.sensor.wanted).layout,
        session.logs[log].samples,
        session.config.sensor,
    )
    gyro_raw, accel_raw = (triad is not None and triad.unit.si is None for triad in (layout.gyro, layout.accel))
    return Steps(
        sensor.register_units.gyro_rps if gyro_raw else _step(samples.gyro),
        sensor.register_units.accel_mps2 if accel_raw else _step(samples.accel),
        gyro_raw,
        accel_raw,
    )


def recording_of(folder: Path) -> HostRecording:
    """The recording of a session folder.  Raises what ``read_session`` and ``prepare`` raise, and DataError where it has truth files."""
    session = read_session(folder)
    if session.config.protocol.reference == "truth":
        raise DataError(
            f"{folder}: a recording beside truth files is not supported; give one whose stills are compared with gravity or dials"
        )
    return HostRecording(prepare(session).problem)


def with_gyro(samples: Samples, gyro: np.ndarray) -> Samples:
    """The same samples with other readings of the gyroscope (N, 3) rad/s."""
    return Samples(samples.t_ns, gyro, samples.accel, samples.temp_c)


def _step(values: np.ndarray) -> float:
    gaps = np.concatenate([np.diff(np.unique(axis)) for axis in values.T])
    return float(np.quantile(gaps, STEP_SHARE)) if len(gaps) else 1e-9


# Write a recording with other readings as a session folder: the same session.toml, the logs in their original units.

GZIP_LEVEL = 1


def write_spoilt(session: Session, logs: tuple[Samples, ...], folder: Path) -> None:
    """Write the session with other samples in its logs, without results and closure runs, which ``explain`` does not read."""
    with result_folder(folder), naming(folder):
        for name in ("session.toml", "attitudes.csv", "turns.csv"):
            if (session.folder / name).exists():
                shutil.copyfile(session.folder / name, folder / name)
        for number, (log, samples) in enumerate(zip(session.logs, logs, strict=True)):
            comment = " ".join(f"{key}={value}" for key, value in log.comments.items())
            text = (f"# {comment}\n" if comment else "") + _text(samples, steps_of(session, number), _thermometer(session))
            data = text.encode("utf-8")
            (folder / log.path.name).write_bytes(gzip.compress(data, GZIP_LEVEL, mtime=0) if log.path.suffix == ".gz" else data)


def _thermometer(session: Session) -> RegisterUnits | None:
    """Temperature units of register logs; None where there are none, or the temperature's scale is unknown."""
    if not all(log.raw for log in session.logs):
        return None
    units = session.config.sensor.register_units
    return units if units.thermometer is not None else None


def _text(samples: Samples, steps: Steps, units: RegisterUnits | None) -> str:
    names, formats, columns = ["t_ns"], ["%d"], [samples.t_ns]
    for letter, unit, values, step, raw in (
        ("g", "rps", samples.gyro, steps.gyro, steps.gyro_raw),
        ("a", "mps2", samples.accel, steps.accel, steps.accel_raw),
    ):
        names += [f"{letter}{axis}" + ("" if raw else f"_{unit}") for axis in "xyz"]
        formats += ["%d" if raw else "%.9g"] * 3
        columns += list(np.rint(values / step).astype(int).T if raw else values.T)
    if samples.temp_c is not None:
        raw = steps.gyro_raw and steps.accel_raw and units is not None
        names.append("temp" if raw else "temp_c")
        formats.append("%d" if raw else "%.7g")
        registers = None if units is None else units.temperature_lsb(samples.temp_c, len(samples))
        columns.append(np.rint(registers).astype(int) if raw and registers is not None else samples.temp_c)
    row = ",".join(formats) + "\n"
    return ",".join(names) + "\n" + "".join(row % values for values in zip(*(column.tolist() for column in columns), strict=True))


# The injected effects and their sizes: multiples of ``explain``'s detection limits, else the blind test's strengths.

#: multiples of ``detection_limit``, in order of priority where not all can be tried
MULTIPLES = (2.0, 4.0, 1.0, 8.0, 0.5)
#: share of an effect's generous sigma: its strong size where this recording has no detection limit
STRONG_SHARE = 0.05
#: effects injected in spite of not changing the rate; the remaining ones, the site and moving stills, cannot be injected into readings
BY_STRENGTH = ("timing.gyro_accel_offset", "gyro.saturation", "data.glitches", "timing.dropped_samples")
STRONG = "of the strong size"
#: id, size, unit, detection_limit
Drawn = tuple[str, float, str, float | None]


@dataclass(frozen=True)
class InjectionTrial:
    """One injected effect: id; size and its unit, or ``STRONG``; detection_limit, in that unit, or None; a seed for
    directions and moments."""

    name: str
    id: str
    size: float
    unit: str
    detection_limit: float | None
    seed: int


def draw_trials(
    detection_limits: dict[str, float], excluded: Collection[str], has_temperature: bool, count: int | None, seed: int
) -> list[InjectionTrial]:
    """Draw trials in random order.

    detection_limits: effect id -> detection limit in its parameter's unit, of those observable in this recording; excluded: effects
    that are not injected, such as the recording's own; count: most trials, each effect once before any is tried at another size.
    """
    rng = np.random.default_rng(seed)
    sized: list[list[Drawn]] = []
    for name in sorted({*catalogue(), *OUTSIDERS} - set(excluded)):
        effect = catalogue().get(name)
        if not _can_be_concealed(name, effect, has_temperature):
            continue
        sized.append(
            [
                (name, size, unit, detection_limits.get(name) if unit != STRONG else None)
                for size, unit in _sizes(name, effect, detection_limits)
            ]
        )
    in_turn = [
        each for turn in range(max(map(len, sized), default=0)) for each in _shuffled([s for s in sized if turn < len(s)], turn, rng)
    ]
    chosen = in_turn[:count]
    trials = []
    for place, i in enumerate(rng.permutation(len(chosen)).tolist()):
        name, size, unit, promised = chosen[i]
        trials.append(InjectionTrial(f"case{place + 1:03d}", name, size, unit, promised, int(rng.integers(2**31))))
    return trials


def _shuffled(sized: list[list[Drawn]], turn: int, rng: np.random.Generator) -> list[Drawn]:
    return [sized[i][turn] for i in rng.permutation(len(sized))]


def _can_be_concealed(name: str, effect: Effect | None, has_temperature: bool) -> bool:
    if not has_temperature and ((effect is not None and "temperature" in effect.inputs) or name == "outside.temperature_curve"):
        return False
    return effect is None or effect.kind in ("rate", "force") or name in BY_STRENGTH


def _sizes(name: str, effect: Effect | None, detection_limits: dict[str, float]) -> list[tuple[float, str]]:
    if effect is None or name in BY_STRENGTH:
        return [(strength, STRONG) for strength in STRENGTHS]
    parameter = effect.parameter
    if name in detection_limits:
        return [(multiple * detection_limits[name], parameter.unit) for multiple in MULTIPLES]
    return [(strength * STRONG_SHARE * parameter.plausible / parameter.si, parameter.unit) for strength in STRENGTHS]


# Inject an effect into a recording's readings: only its change is added, the rest stays as recorded.


@dataclass(frozen=True, eq=False)
class Spoilt:
    """logs of the session with an injected effect, and its truth: parameters by the names of docs/formats.md."""

    logs: tuple[Samples, ...]
    truth: dict


def inject(recording: HostRecording, trial: InjectionTrial) -> Spoilt:
    """The recording with a trial's effect; the trial's seed determines directions, signs and moments."""
    rng = np.random.default_rng(trial.seed)
    logs = tuple(log.samples for log in recording.session.logs)
    steps = [steps_of(recording.session, number) for number in range(len(logs))]
    if trial.id in FAULTS:
        return FAULTS[trial.id](logs, steps, trial.size, rng)
    if trial.id in catalogue() and catalogue()[trial.id].kind == "force":
        return _of_force(recording, logs, steps, trial, rng)
    changes, truth = rate_changes(recording, trial, rng)
    spoilt = [with_gyro(log, requantised(log.gyro, change, step.gyro, rng)) for log, change, step in zip(logs, changes, steps, strict=True)]
    return Spoilt(tuple(spoilt), truth)


def rate_changes(recording: HostRecording, trial: InjectionTrial, rng: np.random.Generator) -> tuple[list[np.ndarray], dict]:
    """Change of the readings of each log (N, 3), rad/s: E^-1 (distorted less true rate); and the truth."""
    if trial.id in OUTSIDERS:
        hidden = OUTSIDERS[trial.id](Scene(rng, trial.size, recording, recording))
        distort, truth = hidden.distort, dict(hidden.truth)
        assert distort is not None  # all effects outside the catalogue change the rate
        distorted = [distort(m.t_s, m.rate, recording.force(log), m.temp_c) for log, m in enumerate(recording.movements)]
    elif trial.id == "timing.gyro_accel_offset":
        seconds = trial.size * OFFSET_S * float(rng.choice((-1.0, 1.0)))
        truth = {"seconds": seconds}
        distorted = [np.stack([np.interp(m.t_s - seconds, m.t_s, axis) for axis in m.rate.T], axis=-1) for m in recording.movements]
    else:
        effect = catalogue()[trial.id]
        if effect.scan is not None:
            values = effect.scan.grid(recording.movements) if effect.scan.grid else recording.log_s * rng.uniform(0.25, 0.75, 1)
            effect = effect.at(float(rng.choice(values)))
        shown = drawn_parameter(effect, trial.size, rng)
        truth = {effect.parameter.name: shown.reshape(effect.parameter.shape).tolist(), **effect.shape}
        distorted = [effect.distort(m, shown * effect.parameter.si) for m in recording.movements]
    back = np.linalg.inv(recording.problem.first.E).T
    return [(each - m.rate) @ back for each, m in zip(distorted, recording.movements, strict=True)], truth


def drawn_parameter(effect: Effect, size: float, rng: np.random.Generator) -> np.ndarray:
    """(P,) numbers of this size in a random direction.

    Of delays the size is that of what differs between the axes, which alone the closure observes and a detection limit promises; lags begin
    at zero.
    """
    direction, gauge = rng.standard_normal(effect.parameter.size), effect.gauge_convention
    delays = list(getattr(gauge, "delays", ()))
    if delays:
        direction[delays] -= direction[delays].mean()
    shown = size * direction / np.linalg.norm(direction)
    if isinstance(gauge, CommonDelay) and gauge.never_negative:
        shown[delays] -= shown[delays].min()
    return shown


def requantised(old: np.ndarray, change: np.ndarray, step: float, rng: np.random.Generator) -> np.ndarray:
    """Readings with a change, in whole steps from the old ones: a fraction of a step is rounded up with a probability equal to it, since
    the old reading's place between two steps is unknown."""
    return old + step * np.floor(change / step + rng.uniform(size=change.shape))


def _of_force(
    recording: HostRecording, logs: tuple[Samples, ...], steps: list[Steps], trial: InjectionTrial, rng: np.random.Generator
) -> Spoilt:
    """An effect of the accelerometer, of this size in a random direction: the readings of which the calibration makes its force."""
    effect = catalogue()[trial.id]
    parameter, direction = effect.parameter, rng.standard_normal(effect.parameter.size)
    shown = trial.size * direction / np.linalg.norm(direction)
    back = np.linalg.inv(recording.session.config.accelerometer.matrix).T
    changes = [(effect.distort_force(m, shown * parameter.si) - m.force_g) * G @ back for m in recording.movements]
    changed = [
        log.with_accel(requantised(log.accel, change, step.accel, rng)) for log, change, step in zip(logs, changes, steps, strict=True)
    ]
    return Spoilt(tuple(changed), {parameter.name: shown.reshape(parameter.shape).tolist()})


# Faults of the registers; strengths are of the strong size of ``other_effects``


def _saturation(logs: tuple[Samples, ...], steps: list[Steps], strength: float, rng: np.random.Generator) -> Spoilt:
    step = steps[0].gyro
    level = step * round((1 - CLIPPED * strength) * max(np.abs(log.gyro).max() for log in logs) / step)
    return Spoilt(tuple(with_gyro(log, np.clip(log.gyro, -level, level)) for log in logs), {"dps": float(np.rad2deg(level))})


def _glitches(logs: tuple[Samples, ...], steps: list[Steps], strength: float, rng: np.random.Generator) -> Spoilt:
    spoilt, at, before = [], [], 0
    for log, step in zip(logs, steps, strict=True):
        number = max(1, round(GLITCHES * len(log) / sum(map(len, logs))))
        gap, gyro = len(log) // (number + 1), log.gyro.copy()
        jump = step.gyro * max(1, round(strength * GLITCH_RPS / step.gyro))
        for row in gap * np.arange(1, number + 1) + rng.integers(-gap // 3, gap // 3, number):
            gyro[row : row + GLITCH_SAMPLES] += jump * rng.choice((-1, 1), 3)
            at.append(before + int(row))
        spoilt.append(with_gyro(log, gyro))
        before += len(log)
    return Spoilt(tuple(spoilt), {"at": at, "samples": GLITCH_SAMPLES})


def _dropped(logs: tuple[Samples, ...], steps: list[Steps], strength: float, rng: np.random.Generator) -> Spoilt:
    """Bursts are lost while the body turns, and the later samples have the stamps of the earlier ones."""
    length, spoilt = max(1, round(BURST_SAMPLES * strength)), []
    for log in logs:
        speed = np.linalg.norm(log.gyro - np.median(log.gyro, axis=0), axis=1)
        fast = np.flatnonzero(speed > np.quantile(speed, 0.75))
        number = max(1, round(BURSTS * len(log) / sum(map(len, logs))))
        rows = [int(rng.choice(part)) for part in np.array_split(fast, number) if len(part)]
        lost = np.unique(np.add.outer(rows, np.arange(length)).clip(0, len(log) - 1))
        kept = np.delete(np.arange(len(log)), lost)
        temp_c = None if log.temp_c is None else log.temp_c[kept]
        spoilt.append(replace(log, t_ns=log.t_ns[: len(kept)], gyro=log.gyro[kept], accel=log.accel[kept], temp_c=temp_c))
    return Spoilt(tuple(spoilt), {"length": length})


FAULTS = {"gyro.saturation": _saturation, "data.glitches": _glitches, "timing.dropped_samples": _dropped}
