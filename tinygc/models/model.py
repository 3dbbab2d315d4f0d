"""What every calibration offers, whatever kind it is of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from session.common.errors import CalibrationError

if TYPE_CHECKING:
    from session.log.samples import Samples
    from tinygc.effects.applied_effect import AppliedEffect


@runtime_checkable
class Model(Protocol):
    """A map from measured rates to calibrated ones.

    kind: its name in the model file (``tinygc/models/files.py``); pointwise: whether each rate is calibrated by itself, so that the model
    may be called on rates (..., 3) of NumPy or torch; rates_only: whether it needs nothing beside rates (a denoiser remembers some of
    them, and is called on (..., N, 3) in the order of time); parameters: how many numbers were fitted; undone: the effects that it takes
    off; conditions: names of what it is told beside the rate; made_for_hz: the sampling rate that it was made for, None for any; delay_s:
    by which its answers come late; session_s: seconds of its session, where it holds for that session's time alone, None for any time.
    """

    kind: ClassVar[str]
    pointwise: ClassVar[bool]
    rates_only: ClassVar[bool]

    def __call__(self, rate: Any) -> Any:
        """Calibrated rate (..., 3) rad/s from the measured one; CalibrationError of a kind that needs whole samples."""

    @property
    def parameters(self) -> int:
        """How many numbers were fitted."""

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """Effects that it takes off, in the order in which it does."""

    @property
    def conditions(self) -> tuple[str, ...]:
        """What it is told beside the rate."""

    @property
    def made_for_hz(self) -> float | None:
        """The sampling rate that it was made for; None for any."""

    @property
    def delay_s(self) -> float:
        """Seconds by which an answer comes late."""

    @property
    def session_s(self) -> float | None:
        """Seconds of the session whose time alone it holds for; None for any time."""

    def at_end(self) -> Model:
        """The same for any time, as it stood at its session's end."""

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log, each at its own sample; CalibrationError for other times than it holds for."""

    def undelayed(self, rate: Any) -> Any:
        """Its answer (N, 3) rad/s to measured rates (N, 3), each at the sample that it belongs to."""

    def without_denoiser(self) -> Model:
        """The calibration alone."""

    def with_bias_moved(self, change: np.ndarray) -> Model:
        """The same model, its calibrated rate greater by ``change`` (3,) rad/s everywhere."""


class BaseModel:
    """What most kinds have in common; a kind overrides what is otherwise with it."""

    kind: ClassVar[str]
    pointwise: ClassVar[bool] = True
    rates_only: ClassVar[bool] = True

    @property
    def undone(self) -> tuple[AppliedEffect, ...]:
        """Effects that the model takes off, in the order in which it does."""
        return ()

    @property
    def conditions(self) -> tuple[str, ...]:
        """What the model is told beside the rate: ``temperature``, ``force``."""
        return ()

    @property
    def made_for_hz(self) -> float | None:
        """The sampling rate that the model was made for; None for any."""
        return None

    @property
    def delay_s(self) -> float:
        """Seconds by which an answer comes late."""
        return 0.0

    @property
    def session_s(self) -> float | None:
        """Seconds of the session whose time alone the model holds for; None for any time."""
        return None

    def at_end(self) -> Model:
        """The same for any time, as it stood at its session's end."""
        return self  # type: ignore[return-value]

    def __call__(self, rate: Any) -> Any:
        """Calibrated rate (..., 3) rad/s from the measured one; only of a kind that is pointwise or has a memory of rates alone."""
        raise CalibrationError(f"a model of kind {self.kind} needs whole samples, not rates alone; use calibrate")

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log, each at its own sample; samples with the pre-calibrated force; began_s of the session when
        the log began; live: only the past is known, and the temperature is taken as it comes."""
        return self.undelayed(samples.gyro)

    def undelayed(self, rate: Any) -> Any:
        """The model's answer (N, 3) rad/s to measured rates (N, 3), each at the sample that it belongs to."""
        return self(rate)

    def without_denoiser(self) -> Model:
        """The calibration alone."""
        return self  # type: ignore[return-value]

    def with_bias_moved(self, change: np.ndarray) -> Self:
        """The same model, its calibrated rate greater by ``change`` (3,) rad/s everywhere.  CalibrationError where it has no such bias."""
        raise CalibrationError("the stored model is of a kind whose bias cannot be moved; give a linear model or a TinyGC-Net")
