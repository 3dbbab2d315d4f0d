"""A fitted model in use: arrays of a whole log, a log piece by piece, or one sample after another as they come.

    omega = model(raw, acc, temp)

raw is the measured rate in rad/s (register x sensitivity), acc the pre-calibrated specific force in m/s^2, temp in degC, omega the true
rate in rad/s.  acc and temp may be left out where the model does not use them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.common.errors import CalibrationError
from session.common.units import NS
from session.log.samples import Samples
from tinygc import models
from tinygc.effects import Claim
from tinygc.effects.reach import NOWHERE, Reach

#: half the temperature's mean over a second, with which a log by itself is calibrated, and some more
TEMPERATURE_REACH = Reach.around(samples=2, seconds=0.55)
#: what an effect's input is called here
TOLD = {"force": "acc", "vibration": "acc", "temperature": "temp"}


class Calibration:
    """A model file, ready for use.  ``kind`` as in the file; ``model`` what ``tinygc.models.load`` gives; ``needs`` in words."""

    def __init__(self, model, rate_hz: float | None = None):
        """``rate_hz``: the sampling rate, which a model needs whose physics has a time in it."""
        self.model, self.rate_hz = model, rate_hz
        physics = getattr(model, "physics", model)
        self._claims: tuple[Claim, ...] = getattr(physics, "claims", ())
        self.effects: tuple[str, ...] = tuple(claim.effect.id for claim in self._claims)
        self._conditions: tuple[str, ...] = getattr(getattr(model, "net", None), "names", ())
        self._live: Stream | None = None

    @property
    def needs(self) -> tuple[str, ...]:
        """What the model must be told beside the rate."""
        inputs = {*self._conditions, *(name for claim in self._claims for name in claim.effect.inputs)}
        told = {TOLD[name] for name in inputs if name in TOLD}
        if any(claim.effect.needs_rate_hz for claim in self._claims):
            told.add("rate_hz")
        return tuple(what for what in ("acc", "temp", "rate_hz") if what in told)

    @property
    def looks_ahead(self) -> tuple[str, ...]:
        """Ids of the effects that are undone from what comes after a sample, and so not while only the past is known."""
        return tuple(sorted(claim.effect.id for claim in self._claims if claim.effect.looks(claim.theta).is_ahead))

    def around(self, live: bool) -> tuple[int, int]:
        """How many samples before and after one its rate depends on."""
        reach = sum((claim.effect.looks(claim.theta) for claim in self._claims), NOWHERE)
        if "temp" in self.needs and not live:
            reach += TEMPERATURE_REACH
        return reach.rows(self.rate_hz or 1.0)

    def __call__(self, raw, acc=None, temp=None) -> np.ndarray:
        """Calibrated rate, rad/s, of the shape of ``raw``: (N, 3), a log by itself; or (3,), the next sample of a live stream.

        A live stream begins with the first single sample, or after ``reset``.  Raises CalibrationError where the model needs what is
        not given, and where it cannot go live because it looks at what comes after.
        """
        raw = np.asarray(raw, dtype=float)
        if raw.ndim not in (1, 2) or raw.shape[-1] != 3:
            raise CalibrationError(f"raw has shape {raw.shape}, expected (N, 3) or (3,), rad/s")
        if raw.ndim == 2:
            stream = self.stream()
            return np.concatenate([stream.push(raw, acc, temp), stream.flush()])
        if self._live is None:
            self._live = Stream(self, live=True)
        one = (None if value is None else np.asarray(value, dtype=float)[None] for value in (acc, temp))
        return self._live.push(raw[None], *one)[0]

    @property
    def uses_rate(self) -> bool:
        """Whether ``rate_hz`` matters: it must be given, or it lets the temperature be averaged over a second, as in the fit."""
        return "rate_hz" in self.needs or "temp" in self.needs

    def stream(self) -> Stream:
        """A log by itself, piece by piece.  Raises CalibrationError where the model needs a rate and has none."""
        return Stream(self)

    def reset(self) -> None:
        """Forget what a live stream has seen."""
        self._live = None


class Stream:
    """One log, piece by piece, in constant memory: ``push`` gives what is certain by now, ``flush`` the rest."""

    def __init__(self, calibration: Calibration, live: bool = False):
        self._calibration, self._model = calibration, calibration.model
        self._whole = hasattr(self._model, "calibrate")  # physics: it looks at time, force, temperature
        self._live = live
        if live and (ahead := calibration.looks_ahead):
            raise CalibrationError(f"{', '.join(ahead)} is undone from what comes after a sample: no live use; give whole arrays")
        self._behind, self._ahead = calibration.around(live)
        if "rate_hz" in calibration.needs and calibration.rate_hz is None:
            raise CalibrationError(f"{', '.join(calibration.effects)}: time matters to this model; load it with rate_hz=")
        self._denoiser = getattr(self._model, "denoiser", None)
        self._tail: np.ndarray | None = None  # what the denoiser remembers: calibrated rates
        self._held = _Rows.none()
        self._before = 0  # of the held rows: how many are given out already
        self._first = 0  # number of the first held row in the log

    def push(self, raw: np.ndarray, acc=None, temp=None) -> np.ndarray:
        """The next rows (N, 3) rad/s, with force (N, 3) m/s^2 and temperature (N,) degC where needed; (M, 3), those now calibrated."""
        if self._denoiser is not None:
            return self._denoised(raw)
        if not self._whole:
            return self._model(raw)
        self._held = self._held.plus(_Rows.of(raw, acc, temp, self._calibration.needs))
        ready = len(self._held.raw) - self._ahead
        # A piece at least as long as its margins, or the margins would be computed again and again; live each sample is wanted at once.
        long_enough = 0 if self._live else max(self._ahead, self._behind)
        return self._give(ready) if ready - self._before >= long_enough else np.zeros((0, 3))

    def _denoised(self, raw: np.ndarray) -> np.ndarray:
        """Causal: each rate from its window, the log's first rate standing before it."""
        if not len(raw):
            return np.zeros((0, 3))
        rate, reach = self._model.calibration(raw), self._denoiser.reach
        before = np.repeat(rate[:1], reach, axis=0) if self._tail is None else self._tail
        held = np.concatenate([before, rate])
        self._tail = held[len(held) - reach :]
        return self._denoiser.windowed(held)

    def flush(self) -> np.ndarray:
        """What was still waiting for its neighbours, at the end of the log."""
        return self._give(len(self._held.raw)) if self._whole else np.zeros((0, 3))

    def _give(self, stop: int) -> np.ndarray:
        if stop <= self._before:
            return np.zeros((0, 3))
        rate_hz = self._calibration.rate_hz or 1.0
        omega = self._held.calibrated(self._model, rate_hz, self._first / rate_hz, self._live)[self._before : stop]
        drop = max(stop - self._behind, 0)
        self._held, self._before, self._first = self._held.since(drop), stop - drop, self._first + drop
        return omega


class _Rows:
    """Rows of a log: raw (N, 3), acc (N, 3) and temp (N,), NaN where they are neither given nor needed."""

    def __init__(self, raw: np.ndarray, acc: np.ndarray, temp: np.ndarray):
        self.raw, self.acc, self.temp = raw, acc, temp

    @classmethod
    def none(cls) -> _Rows:
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))

    @classmethod
    def of(cls, raw, acc, temp, needs: tuple[str, ...]) -> _Rows:
        parts = {"acc": (acc, (len(raw), 3), "m/s^2, pre-calibrated"), "temp": (temp, (len(raw),), "degC")}
        arrays = []
        for name, (value, shape, unit) in parts.items():
            if value is None and name in needs:
                raise CalibrationError(f"the model needs {name} of shape {shape}, {unit}")
            array = np.full(shape, np.nan) if value is None else np.asarray(value, dtype=float)
            if array.shape != shape:
                raise CalibrationError(f"{name} has shape {array.shape}, expected {shape}, {unit}")
            arrays.append(array)
        return cls(raw, *arrays)

    def plus(self, more: _Rows) -> _Rows:
        return _Rows(*(np.concatenate(pair) for pair in zip(self._parts, more._parts, strict=True)))

    def since(self, start: int) -> _Rows:
        return _Rows(*(part[start:] for part in self._parts))

    @property
    def _parts(self) -> tuple[np.ndarray, ...]:
        return self.raw, self.acc, self.temp

    def calibrated(self, model, rate_hz: float, began_s: float, live: bool) -> np.ndarray:
        step_ns = 1 / rate_hz / NS
        stamps = np.rint(np.arange(len(self.raw) + 1) * step_ns).astype(np.int64)
        samples = Samples(stamps[:-1], self.raw, np.nan_to_num(self.acc), None if np.isnan(self.temp).all() else self.temp)
        samples.__dict__["period_s"] = 1 / rate_hz  # of the log, not of the piece
        return model.calibrate(samples, began_s, live)


def load(path: Path | str, rate_hz: float | None = None) -> Calibration:
    """Read a model file for use.  Raises FormatError for what is no model."""
    return Calibration(models.load(path), rate_hz)
