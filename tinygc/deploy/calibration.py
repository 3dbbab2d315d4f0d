"""A fitted model in use: on whole logs, on a log piece by piece, or on one sample after another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import CalibrationError
from session.base.records import write_whole
from session.base.texts import significant
from session.base.units import MG, NS, SI, G, beyond_any_sensor
from session.log.arrays import refuse_degrees, si_of
from session.log.config import Accelerometer, Config, Sensor, read_config
from session.log.folder import sha256_of
from session.log.samples import Samples
from tinygc import models
from tinygc.effects.movement import NOWHERE, Reach
from tinygc.models.model import KnownSensor, Model, accelerometer_of, accelerometer_table, sensor_of

# Inputs of a model other than the rate, and the samples around one that it depends on, from the declarations of its effects.

#: half of the one-second average of temperature used in offline calibration, with a margin
TEMPERATURE_REACH = Reach.around(samples=2, seconds=0.55)
#: input of an effect -> argument of a call of the model
ARGUMENTS = {"force": "acc", "vibration": "acc", "temperature": "temp"}


def effects_of_session_time(model: Model) -> tuple[str, ...]:
    """Return the ids of the effects that depend on the time since the start of the model's own session."""
    return tuple(sorted(claim.effect.id for claim in model.undone if claim.effect.of_one_session))


# What a model needs and a log alone does not contain: full scales, and the applicable calibration of the accelerometer.
#
# The references of a fit rest on one calibration of the accelerometer, often a better one than session.toml had, because the fit refines
# a given calibration and estimates a missing one.  E maps into the body frame of that calibration, so the model's own calibration has
# priority.  A session that the user names and that is not the model's own describes another day: its calibration is used, rotated into
# the model's body frame.


@dataclass(frozen=True)
class Surroundings:
    """sensor: full scales and meaning of the registers, None where unknown; accelerometer: its calibration, None where there is none;
    source: ``model``, ``session`` or ``none``; description: the same as text."""

    sensor: KnownSensor | Sensor
    accelerometer: Accelerometer | None
    source: str
    description: str


def surroundings(table: dict, model_path: Path, log: Path, session: Path | None) -> Surroundings:
    """Collect the context of a log for a model (``table``: its file); session: the folder named by the user, else that of the log.

    Raises FormatError for a session.toml or a model file that cannot be read.
    """
    own, stated = accelerometer_of(table, str(model_path)), sensor_of(table, str(model_path))
    path = (session or log.parent) / "session.toml"
    config = read_config(path) if session is not None or (log.is_file() and path.exists()) else None
    sensor = stated if config is None else config.sensor
    given = None if config is None or config.accelerometer.source == "none" else config.accelerometer
    if given is not None and (own is None or (session is not None and not _is_own(table, path))):
        accelerometer, text = given, f"calibrated as {path} states"
        if own is not None:
            accelerometer, turned_rad = in_frame_of(own, given)
            text += f", in the model's body frame ({significant(1e3 * turned_rad, 2)} mrad from its own)"
        return Surroundings(sensor, accelerometer, "session", text)
    if own is None:
        return Surroundings(sensor, None, "none", "as measured: neither the model nor a session.toml calibrates it")
    text = f"calibrated as in the model's fit ({SOURCE_TEXTS[own.source]})"
    if given is not None and config is not None and not _is_own(table, path):
        turned, turned_rad = in_frame_of(own, given)
        text += f"; that of {path} differs by {significant(difference_mg(own, turned, config), 2)} mg at one g"
        text += f" and by {significant(1e3 * turned_rad, 2)} mrad of the body frame: --session takes it"
    return Surroundings(sensor, own, "model", text)


#: source of a calibration -> text for the user
SOURCE_TEXTS = {
    "given": "as it was given",
    "prior": "the given one, sharpened by stills and turns",
    "stills": "from its own stills and turns",
}


def in_frame_of(own: Accelerometer, other: Accelerometer) -> tuple[Accelerometer, float]:
    """Rotate another calibration of the same triad into the body frame of ``own``; return it and the angle of the rotation, rad."""
    turn = own.frame @ other.frame.T
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    return replace(other, matrix=turn @ other.matrix), angle


def difference_mg(one: Accelerometer, other: Accelerometer, config: Config) -> float:
    """Greatest difference of the two forces, mg, over gravity along the positive and negative axes."""
    gravity = np.concatenate([np.eye(3), -np.eye(3)]) * (config.site.gravity_mps2 or G)
    measured = one.measured(gravity)
    return float(np.abs(one.correct(measured) - other.correct(measured)).max()) / MG


def _is_own(table: dict, path: Path) -> bool:
    """Whether the model's E was fitted with this session.toml."""
    stored = table.get("stored")
    hashes = (stored if isinstance(stored, dict) else table).get("sha256")
    return isinstance(hashes, dict) and hashes.get("session.toml") == sha256_of(path)


# Start time of a log within the session of a model that follows that session's time; other logs have none.


def began_in_session(model: Model, table: dict, model_path: Path, log: Path) -> float:
    """Return the time, in s of the model's session, at which this log began, from the hashes and times in the model's file.

    Raises CalibrationError for a log of another session, whose time has no relation to the drift.
    """
    hashes, began = table.get("sha256"), table.get("began_s")
    if log.is_file() and isinstance(hashes, dict) and isinstance(began, dict):
        digest = sha256_of(log)
        for name, moment in began.items():
            if hashes.get(name) == digest and isinstance(moment, int | float):
                return float(moment)
    bygone = ", ".join(effects_of_session_time(model))
    raise CalibrationError(
        f"{log}: no log of the session whose time {model_path.name} follows ({bygone}); apply {model_path.stem}_at_end.json next to it, "
        "or fit without physics"
    )


# One log through a model, piece by piece, in constant memory.


class Stream:
    """One log, piece by piece, in constant memory: ``push`` returns the rows that are complete, ``flush`` the rest."""

    def __init__(self, calibration: Calibration, began_s: float | None = None, live: bool = False):
        """began_s: s of the model's session when the log began, needed only by a model that follows its session's time.

        Raises CalibrationError where a needed rate or start time is missing, or where a model that needs later samples is used live.
        """
        self._model, self._needs, self._rate_hz = calibration.model, calibration.needs, calibration.rate_hz
        self._live = live
        if live and (ahead := calibration.looks_ahead):
            raise CalibrationError(f"{', '.join(ahead)} is undone from what comes after a sample: no live use; give whole arrays")
        reach = sum((claim.effect.total_reach(claim.theta) for claim in self._model.undone), NOWHERE)
        if "temp" in self._needs and not live:
            reach += TEMPERATURE_REACH
        #: samples before and after a sample on which its rate depends
        self._behind, self._ahead = reach.rows(self._rate_hz or 1.0)
        self._own = self._model.stream(self._rate_hz)
        if self._own is not None:
            self._behind, self._ahead = 0, 0
        if "rate_hz" in self._needs and self._rate_hz is None:
            raise CalibrationError(f"{', '.join(calibration.effects)}: time matters to this model; load it with rate_hz=")
        if (bygone := effects_of_session_time(self._model)) and began_s is None:
            raise CalibrationError(
                f"{', '.join(bygone)} follows the time of the model's own session, {self._model.session_s:.1f} s: give began_s= for rows "
                "of it; for any other log take at_end() of the model"
            )
        self._began_s = began_s or 0.0
        self._held = _rows(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), ())
        self._before = 0  # held rows that have been returned already
        self._first = 0  # number in the log of the first held row

    def push(self, raw: np.ndarray, acc: ArrayLike | None = None, temp: ArrayLike | None = None) -> np.ndarray:
        """Add rows (N, 3) rad/s, with force (N, 3) m/s^2 and temperature (N,) degC where needed; return the rows (M, 3) now calibrated."""
        if self._own is not None:
            rates, _, celsius = _rows(raw, acc, temp, self._needs) if self._needs else (raw, None, None)
            return self._own(rates, celsius)
        more = _rows(raw, acc, temp, self._needs)
        self._held = tuple(np.concatenate(pair) for pair in zip(self._held, more, strict=True))
        ready = len(self._held[0]) - self._ahead
        # A piece at least as long as its margins avoids recomputing them; a live stream needs each sample at once.
        long_enough = 0 if self._live else max(self._ahead, self._behind)
        return self._give(ready) if ready - self._before >= long_enough else np.zeros((0, 3))

    def flush(self) -> np.ndarray:
        """Return the rows that were waiting for later samples, at the end of the log."""
        return self._give(len(self._held[0]))

    def _give(self, stop: int) -> np.ndarray:
        if stop <= self._before:
            return np.zeros((0, 3))
        rate_hz = self._rate_hz or 1.0
        raw, acc, temp = self._held
        stamps = np.rint((self._first + np.arange(len(raw))) * (1 / rate_hz / NS)).astype(np.int64)
        samples = Samples(stamps, raw, np.nan_to_num(acc), None if np.isnan(temp).all() else temp)
        samples.__dict__["period_s"] = 1 / rate_hz  # of the log, not of the piece
        omega = self._model.calibrate(samples, self._began_s + self._first / rate_hz, self._live)[self._before : stop]
        drop = max(stop - self._behind, 0)
        self._held, self._before, self._first = tuple(part[drop:] for part in self._held), stop - drop, self._first + drop
        return omega


#: argument of a call -> measured quantity
KINDS = {"raw": "gyro", "acc": "accel", "measured": "accel", "temp": "temp"}


def as_numbers(name: str, values: ArrayLike) -> np.ndarray:
    """Convert to a float64 array; raises CalibrationError for other than numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise CalibrationError(f"{name} is not made of numbers") from None


def refuse_gaps(name: str, array: np.ndarray) -> None:
    """Raise CalibrationError, with the row, where a value is not finite or exceeds any sensor's range."""
    if not np.isfinite(array).all():
        row = int(np.argmin(np.isfinite(array).reshape(len(array), -1).all(axis=1)))
        raise CalibrationError(f"{name}[{row}] is not finite; give numbers, or leave such rows out")
    if (far := beyond_any_sensor(array, 1.0, KINDS[name])).any():
        row = int(np.argmax(far.reshape(len(array), -1).any(axis=1)))
        raise CalibrationError(f"{name}[{row}] is {np.abs(array[row]).max():g} {SI[KINDS[name]]}, beyond any sensor; is its unit right?")


def rates_in_si(raw: np.ndarray, unit: str, full_scale_dps: float | None) -> tuple[np.ndarray, float]:
    """Return rates (N, 3) in rad/s, and rad/s per ``unit``, in which they are given.

    Raises CalibrationError for an unknown unit, a rate that is not finite, and one beyond what the full scale, or any usual one, allows.
    """
    si = si_of("unit", "gyro", unit)
    rates = raw if si == 1 else raw * si
    refuse_gaps("raw", rates)
    do = 'are the rates in degrees? give unit="dps"' if si == 1 else "is the unit another?"
    refuse_degrees("raw", rates, full_scale_dps, f"{do}, or a model of a sensor that is as fast")
    return rates, si


def _rows(raw: np.ndarray, acc: ArrayLike | None, temp: ArrayLike | None, needs: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Return raw (N, 3), acc (N, 3) and temp (N,), NaN where neither given nor needed."""
    parts = {"acc": (acc, (len(raw), 3), "m/s^2, calibrated"), "temp": (temp, (len(raw),), "degC")}
    arrays = [raw]
    for name, (value, shape, unit) in parts.items():
        if value is None and name in needs:
            raise CalibrationError(f"the model needs {name} of shape {shape}, {unit}")
        array = np.full(shape, np.nan) if value is None else as_numbers(name, value)
        if array.shape != shape:
            raise CalibrationError(f"{name} has shape {array.shape}, expected {shape}, {unit}")
        if name in needs:
            refuse_gaps(name, array)
        arrays.append(array)
    return tuple(arrays)


# A model applied to one sample after another, as in a driver; it keeps the state.


class Live:
    """One live stream: ``omega = live(raw, acc, temp)`` for each sample.  After a pause, start a new object."""

    def __init__(self, calibration: Calibration):
        """Raises CalibrationError where the model needs later samples or its session's time, or has no rate."""
        if bygone := effects_of_session_time(calibration.model):
            raise CalibrationError(f"{', '.join(bygone)} follows the time of a past session: no live use; take at_end() of the model")
        self._stream, self._full_scale_dps = Stream(calibration, live=True), calibration.full_scale_dps

    def __call__(self, raw: ArrayLike, acc: ArrayLike | None = None, temp: ArrayLike | None = None, *, unit: str = "rad/s") -> np.ndarray:
        """Return the calibrated rate (3,), in the unit that raw (3,) is in: rad/s, or ``unit="dps"``; acc (3,) m/s^2, temp degC.

        Raises CalibrationError for other shapes, and for a rate that no such gyroscope reads.
        """
        sample = as_numbers("raw", raw)
        if sample.shape != (3,):
            raise CalibrationError(f"raw has shape {sample.shape}, expected (3,), rad/s: a live stream takes one sample at a time")
        rates, si = rates_in_si(sample[None], unit, self._full_scale_dps)
        acc, temp = (None if value is None else as_numbers(name, value)[None] for name, value in (("acc", acc), ("temp", temp)))
        return self._stream.push(rates, acc, temp)[0] / si


# A fitted model in use: arrays of a whole log, a log piece by piece, or one sample after another.
#
#     model = tinygc.load("fit/model_least_squares.json")
#     omega = model(raw, acc, temp)                    # arrays: one complete log, without state
#     live = model.live(); omega = live(raw, acc, temp)    # one sample after another
#
# raw is the measured rate in rad/s (register x sensitivity), acc the calibrated specific force in m/s^2, temp in degC, omega the true
# rate in rad/s.  acc and temp may be omitted where the model does not use them.  ``model.force(measured)`` returns acc, by the calibration
# of the accelerometer on which the fit is based.


class Calibration:
    """A model ready for use.  ``model``: the fitted model; ``rate_hz``: its sampling rate in use, or None; ``effects``: ids of the effects
    that it corrects; ``needs``: inputs other than the rate, among ``acc``, ``temp``, ``rate_hz``; ``accelerometer``: the calibration that
    the fit is based on, None where the model's file has none."""

    def __init__(self, model: Model, rate_hz: float | None = None, table: dict | None = None, accelerometer: Accelerometer | None = None):
        """rate_hz: the sampling rate, needed where the physics depends on time; table: the content of the model file, which may hold more
        than the model itself; accelerometer: the calibration on which the fit is based, where no table contains it."""
        if rate_hz is not None and not (isinstance(rate_hz, int | float) and 0 < rate_hz < float("inf")):
            raise CalibrationError(f"rate_hz is {rate_hz!r}, expected samples a second")
        self.model, self.rate_hz, self._table = model, rate_hz, table
        self.accelerometer = accelerometer if table is None else accelerometer_of(table)
        #: full scale of the gyroscope that was fitted, dps; None where no table has it
        self.full_scale_dps = None if table is None else sensor_of(table).gyro_fs_dps
        effects = [claim.effect for claim in model.undone]
        self.effects = tuple(effect.id for effect in effects)
        inputs = {*model.conditions, *(name for effect in effects for name in effect.inputs)}
        arguments = {ARGUMENTS[name] for name in inputs if name in ARGUMENTS}
        if any(effect.needs_rate_hz for effect in effects):
            arguments.add("rate_hz")
        self.needs = tuple(what for what in ("acc", "temp", "rate_hz") if what in arguments)

    def __repr__(self) -> str:
        undone = f", corrects {', '.join(self.effects)}" if self.effects else ""
        return f"<Calibration {self.model.kind}, {self.model.parameters} parameters{undone}>"

    def __call__(
        self,
        raw: ArrayLike,
        acc: ArrayLike | None = None,
        temp: ArrayLike | None = None,
        *,
        unit: str = "rad/s",
        began_s: float | None = None,
    ) -> np.ndarray:
        """Return calibrated rates (N, 3) of one log, in the unit that raw (N, 3) is in; acc (N, 3) m/s^2, temp (N,) degC.

        unit: of the rates that are given, and of those that are returned: ``rad/s``, ``dps``, ``mdps`` and the like.
        began_s: s of the model's own session at which the rows begin, needed only by a model that follows that session's time.
        The call has no state: the same arrays give the same result.  For single samples (3,) use ``live()``.  Raises CalibrationError
        where a needed input is missing, for other shapes, and for rates beyond 1.2 times the full scale of the fitted sensor, or beyond
        4000 dps where the model's file has none: they are in degrees.
        """
        rates = as_numbers("raw", raw)
        if rates.shape == (3,):
            raise CalibrationError("raw is one sample (3,); live() takes one after another, and arrays are (N, 3)")
        if rates.ndim != 2 or rates.shape[-1] != 3:
            raise CalibrationError(f"raw has shape {rates.shape}, expected (N, 3), rad/s")
        rates, si = rates_in_si(rates, unit, self.full_scale_dps)
        stream = self.stream(began_s)
        omega = np.concatenate([stream.push(rates, acc, temp), stream.flush()])
        return omega if si == 1 else omega / si

    def force(self, measured: ArrayLike) -> np.ndarray:
        """Return calibrated specific force, m/s^2, from the measured force of one sample (3,) or of many (N, 3).

        It is in the body frame of the calibrated rates, and is the ``acc`` of a call.  Raises CalibrationError where the model's file has
        no calibration of the accelerometer, and for other shapes.
        """
        if self.accelerometer is None:
            raise CalibrationError("the model's file has no calibration of the accelerometer; fit again, or calibrate the force yourself")
        force = as_numbers("measured", measured)
        if force.ndim not in (1, 2) or force.shape[-1] != 3:
            raise CalibrationError(f"measured has shape {force.shape}, expected (N, 3) or (3,), m/s^2")
        refuse_gaps("measured", np.atleast_2d(force))
        return self.accelerometer.correct(force)

    @property
    def uses_rate(self) -> bool:
        """Whether ``rate_hz`` matters: the model needs it, or it allows the one-second average of temperature that the fit used."""
        return "rate_hz" in self.needs or "temp" in self.needs

    @property
    def looks_ahead(self) -> tuple[str, ...]:
        """Ids of the effects whose correction needs later samples, so that a live stream is impossible."""
        reaches = ((claim.effect.id, claim.effect.total_reach(claim.theta)) for claim in self.model.undone)
        return tuple(sorted(name for name, reach in reaches if reach.after_samples > 0 or reach.after_s > 0))

    def at_end(self) -> Calibration:
        """Return the model for logs of any time: effects of session time are held at their values at the session's end."""
        if self.model.session_s is None:
            return self
        ended = Calibration(self.model.at_end(), self.rate_hz, None, self.accelerometer)
        ended.full_scale_dps = self.full_scale_dps
        return ended

    def stream(self, began_s: float | None = None) -> Stream:
        """Return a stream for one log, piece by piece; began_s as in a call.  Raises CalibrationError where a needed rate is missing, or
        the start time that a model with session time needs."""
        return Stream(self, began_s)

    def live(self) -> Live:
        """Return a live stream, one sample after another.  Raises CalibrationError where the model needs later samples or its session's
        time, or has no rate."""
        return Live(self)

    def to_json(self) -> dict:
        """``tinygc-model/1`` (docs/formats.md)."""
        if self._table is not None:
            return dict(self._table)
        more = {} if self.accelerometer is None else {"accelerometer": accelerometer_table(self.accelerometer)}
        return models.to_dict(self.model, **more)

    def save(self, path: Path | str) -> Path:
        """Write the model file, complete or not at all, and return its path."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, self.to_json())
        return path


def load(path: Path | str, rate_hz: float | None = None) -> Calibration:
    """Read a model file for use.

    Parameters
    ----------
    path : str or Path
        A model file (``tinygc-model/1``), as ``Fit.save`` and ``Calibration.save`` write it.
    rate_hz : float, optional
        Samples a second of the logs to calibrate, Hz; needed where the model's physics depends on time.

    Returns
    -------
    Calibration
        ``omega = model(raw)`` calibrates rates (N, 3), rad/s, in the body axes of the fitted log; ``model(raw, unit="dps")`` takes and
        gives dps.

    Raises
    ------
    CalibrationError
        For a file that cannot be read or is not a model (FormatError), and for a ``rate_hz`` that is not a positive number.

    Examples
    --------
    >>> import tempfile, tinygc
    >>> path = tempfile.mkdtemp() + "/gyro.json"
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> _ = tinygc.fit(session, methods=("least_squares",)).model.save(path)
    >>> tinygc.load(path)([[0.1, 0.0, 0.0]]).shape
    (1, 3)

    """
    model, table = models.load_with_table(path)
    return Calibration(model, rate_hz, table)
