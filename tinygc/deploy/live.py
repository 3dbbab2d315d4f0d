"""A model fed one sample after another, as a driver does: it remembers what it was given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from session.common.errors import CalibrationError
from tinygc.deploy.needs import Needs
from tinygc.deploy.stream import Stream, as_numbers, refuse_gaps
from tinygc.models.model import Model


class Live:
    """One live stream: ``omega = live(raw, acc, temp)`` for each sample as it comes; a stream after a pause is a new object."""

    def __init__(self, model: Model, needs: Needs, rate_hz: float | None):
        """Raises CalibrationError where the model looks at what comes after a sample, follows its session's time, or lacks a rate."""
        if bygone := needs.of_one_session:
            raise CalibrationError(f"{', '.join(bygone)} follows the time of a past session: no live use; take at_end() of the model")
        self._stream = Stream(model, needs, rate_hz, live=True)

    def __call__(self, raw: ArrayLike, acc: ArrayLike | None = None, temp: ArrayLike | None = None) -> np.ndarray:
        """Calibrated rate (3,) rad/s of the next sample: raw (3,) rad/s, acc (3,) m/s^2, temp degC; CalibrationError for other shapes."""
        sample = as_numbers("raw", raw)
        if sample.shape != (3,):
            raise CalibrationError(f"raw has shape {sample.shape}, expected (3,), rad/s: a live stream takes one sample at a time")
        refuse_gaps("raw", sample[None])
        acc, temp = (None if value is None else as_numbers(name, value)[None] for name, value in (("acc", acc), ("temp", temp)))
        return self._stream.push(sample[None], acc, temp)[0]
