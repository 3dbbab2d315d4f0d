"""One log through a model, piece by piece, in constant memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from session.common.errors import CalibrationError
from session.common.plausible import SI, beyond_any_sensor
from session.common.units import NS
from session.log.samples import Samples
from tinygc.deploy.needs import Needs
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.model import Model
from tinygc.models.thermal import ThermalModel, ThermalStream


class Stream:
    """One log, piece by piece, in constant memory: ``push`` gives what is certain by now, ``flush`` the rest."""

    def __init__(self, model: Model, needs: Needs, rate_hz: float | None, began_s: float | None = None, live: bool = False):
        """began_s: s of the model's session when the log began, which only a model that follows its time asks for.

        Raises CalibrationError where the model needs a rate and has none, or that moment, or looks ahead and is to go live.
        """
        self._model, self._needs, self._rate_hz = model, needs, rate_hz
        self._whole = not model.rates_only  # physics: it looks at time, force, temperature
        self._live = live
        if live and (ahead := needs.looks_ahead):
            raise CalibrationError(f"{', '.join(ahead)} is undone from what comes after a sample: no live use; give whole arrays")
        self._behind, self._ahead = needs.around(rate_hz, live)
        self._thermal: ThermalStream | None = None  # it remembers by itself, and looks at nothing ahead
        if isinstance(model, ThermalModel):
            if model.lag_s.any() and rate_hz is None:
                raise CalibrationError("the model follows temperature with a lag: time matters to it; load it with rate_hz=")
            self._thermal, self._behind, self._ahead = model.follower(1 / (rate_hz or 1.0)), 0, 0
        if "rate_hz" in needs.told and rate_hz is None:
            raise CalibrationError(f"{', '.join(needs.effects)}: time matters to this model; load it with rate_hz=")
        if (bygone := needs.of_one_session) and began_s is None:
            raise CalibrationError(
                f"{', '.join(bygone)} follows the time of the model's own session, {model.session_s:.1f} s: give began_s= for rows of it; "
                "for any other log take at_end() of the model"
            )
        self._began_s = began_s or 0.0
        self._denoiser = model.denoiser if isinstance(model, DenoisedNet) else None
        self._tail: np.ndarray | None = None  # what the denoiser remembers: calibrated rates
        self._held = _Rows.none()
        self._before = 0  # of the held rows: how many are given out already
        self._first = 0  # number of the first held row in the log

    def push(self, raw: np.ndarray, acc: ArrayLike | None = None, temp: ArrayLike | None = None) -> np.ndarray:
        """The next rows (N, 3) rad/s, with force (N, 3) m/s^2 and temperature (N,) degC where needed; (M, 3), those now calibrated."""
        if self._denoiser is not None:
            return self._denoised(raw, self._denoiser)
        if not self._whole:
            return self._model(raw)
        if self._thermal is not None:
            rows = _Rows.of(raw, acc, temp, self._needs.told)
            return self._thermal(rows.raw, rows.temp)
        self._held = self._held.plus(_Rows.of(raw, acc, temp, self._needs.told))
        ready = len(self._held.raw) - self._ahead
        # A piece at least as long as its margins, or the margins would be computed again and again; live each sample is wanted at once.
        long_enough = 0 if self._live else max(self._ahead, self._behind)
        return self._give(ready) if ready - self._before >= long_enough else np.zeros((0, 3))

    def _denoised(self, raw: np.ndarray, denoiser: Denoiser) -> np.ndarray:
        """Causal: each rate from its window, the log's first rate standing before it."""
        if not len(raw):
            return np.zeros((0, 3))
        rate, reach = self._model.without_denoiser()(raw), denoiser.reach
        before = np.repeat(rate[:1], reach, axis=0) if self._tail is None else self._tail
        held = np.concatenate([before, rate])
        self._tail = held[len(held) - reach :]
        return denoiser.windowed(held)

    def flush(self) -> np.ndarray:
        """What was still waiting for its neighbours, at the end of the log."""
        return self._give(len(self._held.raw)) if self._whole else np.zeros((0, 3))

    def _give(self, stop: int) -> np.ndarray:
        if stop <= self._before:
            return np.zeros((0, 3))
        rate_hz = self._rate_hz or 1.0
        omega = self._held.calibrated(self._model, rate_hz, self._began_s + self._first / rate_hz, self._live)[self._before : stop]
        drop = max(stop - self._behind, 0)
        self._held, self._before, self._first = self._held.since(drop), stop - drop, self._first + drop
        return omega


#: array of a call -> what it measures
KINDS = {"raw": "gyro", "acc": "accel", "measured": "accel", "temp": "temp"}


def as_numbers(name: str, values: ArrayLike) -> np.ndarray:
    """An array of float64; CalibrationError for what is not made of numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise CalibrationError(f"{name} is not made of numbers") from None


def refuse_gaps(name: str, array: np.ndarray) -> None:
    """CalibrationError, with the row, where a value is not finite, or beyond any sensor: it would pass for a rate."""
    if not np.isfinite(array).all():
        row = int(np.argmin(np.isfinite(array).reshape(len(array), -1).all(axis=1)))
        raise CalibrationError(f"{name}[{row}] is not finite; give numbers, or leave such rows out")
    if (far := beyond_any_sensor(array, 1.0, KINDS[name])).any():
        row = int(np.argmax(far.reshape(len(array), -1).any(axis=1)))
        raise CalibrationError(f"{name}[{row}] is {np.abs(array[row]).max():g} {SI[KINDS[name]]}, beyond any sensor; is its unit right?")


class _Rows:
    """Rows of a log: raw (N, 3), acc (N, 3) and temp (N,), NaN where they are neither given nor needed."""

    def __init__(self, raw: np.ndarray, acc: np.ndarray, temp: np.ndarray):
        self.raw, self.acc, self.temp = raw, acc, temp

    @classmethod
    def none(cls) -> _Rows:
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))

    @classmethod
    def of(cls, raw: np.ndarray, acc: ArrayLike | None, temp: ArrayLike | None, needs: tuple[str, ...]) -> _Rows:
        parts = {"acc": (acc, (len(raw), 3), "m/s^2, calibrated"), "temp": (temp, (len(raw),), "degC")}
        arrays = []
        for name, (value, shape, unit) in parts.items():
            if value is None and name in needs:
                raise CalibrationError(f"the model needs {name} of shape {shape}, {unit}")
            array = np.full(shape, np.nan) if value is None else as_numbers(name, value)
            if array.shape != shape:
                raise CalibrationError(f"{name} has shape {array.shape}, expected {shape}, {unit}")
            if name in needs:
                refuse_gaps(name, array)
            arrays.append(array)
        return cls(raw, *arrays)

    def plus(self, more: _Rows) -> _Rows:
        return _Rows(*(np.concatenate(pair) for pair in zip(self._parts, more._parts, strict=True)))

    def since(self, start: int) -> _Rows:
        return _Rows(*(part[start:] for part in self._parts))

    @property
    def _parts(self) -> tuple[np.ndarray, ...]:
        return self.raw, self.acc, self.temp

    def calibrated(self, model: Model, rate_hz: float, began_s: float, live: bool) -> np.ndarray:
        step_ns = 1 / rate_hz / NS
        stamps = np.rint(np.arange(len(self.raw) + 1) * step_ns).astype(np.int64)
        samples = Samples(stamps[:-1], self.raw, np.nan_to_num(self.acc), None if np.isnan(self.temp).all() else self.temp)
        samples.__dict__["period_s"] = 1 / rate_hz  # of the log, not of the piece
        return model.calibrate(samples, began_s, live)
