"""A fitted model in use: arrays of a whole log, a log piece by piece, or one sample after another as they come.

    model = tinygc.load("fit/model_least_squares.json")
    omega = model(raw, acc, temp)                    # arrays: a log by itself, nothing is remembered
    live = model.live(); omega = live(raw, acc, temp)    # one sample after another

raw is the measured rate in rad/s (register x sensitivity), acc the calibrated specific force in m/s^2, temp in degC, omega the true
rate in rad/s.  acc and temp may be left out where the model does not use them.  ``model.force(measured)`` gives acc, by the calibration
of the accelerometer that the fit rests on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from session.common.errors import CalibrationError
from session.files.results import write_whole
from session.log.config import Accelerometer
from tinygc import models
from tinygc.deploy.live import Live
from tinygc.deploy.needs import Needs
from tinygc.deploy.stream import Stream, as_numbers, refuse_gaps
from tinygc.models.accelerometer import accelerometer_of, accelerometer_table
from tinygc.models.model import Model


class Calibration:
    """A model, ready for use.  ``model``: what was fitted; ``rate_hz``: the sampling rate it is used at, or None; ``effects``: ids of those
    that it undoes; ``needs``: what it must be told beside the rate, some of ``acc``, ``temp``, ``rate_hz``; ``accelerometer``: the
    calibration that the fit rests on, None where the model's file has none."""

    def __init__(self, model: Model, rate_hz: float | None = None, table: dict | None = None, accelerometer: Accelerometer | None = None):
        """rate_hz: the sampling rate, which a model needs whose physics has a time in it; table: of its file, where more stands in it
        than the model itself; accelerometer: the calibration that the fit rests on, where no table says it."""
        if rate_hz is not None and not (isinstance(rate_hz, int | float) and 0 < rate_hz < float("inf")):
            raise CalibrationError(f"rate_hz is {rate_hz!r}, expected samples a second")
        self.model, self.rate_hz = model, rate_hz
        self._table, self._needs = table, Needs(model)
        self.accelerometer = accelerometer if table is None else accelerometer_of(table)
        self.effects, self.needs = self._needs.effects, self._needs.told

    def __repr__(self) -> str:
        undone = f", undoes {', '.join(self.effects)}" if self.effects else ""
        return f"<Calibration {self.model.kind}, {self.model.parameters} parameters{undone}>"

    def __call__(
        self, raw: ArrayLike, acc: ArrayLike | None = None, temp: ArrayLike | None = None, *, began_s: float | None = None
    ) -> np.ndarray:
        """Calibrated rates (N, 3) rad/s of a log by itself: raw (N, 3) rad/s, acc (N, 3) m/s^2, temp (N,) degC.

        began_s: s of the model's own session at which the rows begin; only a model that follows that session's time asks for it.
        Nothing is remembered: the same arrays give the same answer.  A single sample (3,) is given to ``live()``.  Raises
        CalibrationError where the model needs what is not given, and for other shapes.
        """
        rates = as_numbers("raw", raw)
        if rates.shape == (3,):
            raise CalibrationError("raw is one sample (3,); live() takes one after another, and arrays are (N, 3)")
        if rates.ndim != 2 or rates.shape[-1] != 3:
            raise CalibrationError(f"raw has shape {rates.shape}, expected (N, 3), rad/s")
        refuse_gaps("raw", rates)
        stream = self.stream(began_s)
        return np.concatenate([stream.push(rates, acc, temp), stream.flush()])

    def force(self, measured: ArrayLike) -> np.ndarray:
        """Calibrated specific force, of one sample (3,) or of many (N, 3), m/s^2, from what the accelerometer measured.

        It is in the body frame of the calibrated rates, and is what ``acc`` stands for.  Raises CalibrationError where the model's file
        has no calibration of the accelerometer, and for other shapes.
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
        """Whether ``rate_hz`` matters: it must be given, or it lets the temperature be averaged over a second, as in the fit."""
        return "rate_hz" in self.needs or "temp" in self.needs

    @property
    def looks_ahead(self) -> tuple[str, ...]:
        """Ids of the effects that are undone from what comes after a sample, so that there is no live stream."""
        return self._needs.looks_ahead

    def at_end(self) -> Calibration:
        """The same for logs of any time: what follows the session's time stands still as it was at the session's end."""
        return self if self.model.session_s is None else Calibration(self.model.at_end(), self.rate_hz, None, self.accelerometer)

    def stream(self, began_s: float | None = None) -> Stream:
        """A log by itself, piece by piece; began_s as of a call.  Raises CalibrationError where the model needs a rate and has none, or
        follows its session's time and is not told when the log began."""
        return Stream(self.model, self._needs, self.rate_hz, began_s)

    def live(self) -> Live:
        """One sample after another.  Raises CalibrationError where the model looks at what comes after, follows the time of its session,
        or needs a rate and has none."""
        return Live(self.model, self._needs, self.rate_hz)

    def to_json(self) -> dict:
        """``tinygc-model/1`` (docs/formats.md)."""
        if self._table is not None:
            return dict(self._table)
        more = {} if self.accelerometer is None else {"accelerometer": accelerometer_table(self.accelerometer)}
        return models.to_dict(self.model, **more)

    def save(self, path: Path | str) -> Path:
        """Write the model file, whole or not at all; returns its path."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, self.to_json())
        return path


def load(path: Path | str, rate_hz: float | None = None) -> Calibration:
    """Read a model file for use.  Raises FormatError for what is no model."""
    model, table = models.load_with_table(path)
    return Calibration(model, rate_hz, table)
