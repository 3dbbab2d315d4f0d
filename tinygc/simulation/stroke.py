"""One push of the hand at one gimbal, as a function of time with exact derivatives.

A hand that moves from rest to rest follows nearly a minimum-jerk profile (Flash and Hogan 1985):
``s(u) = u^3 (10 - 15 u + 6 u^2)``, u from 0 to 1 over the stroke.  It is not smooth about it: waves of half a hertz up to the
tremor of several hertz lie on it, under a window ``w(u) = (4 u (1 - u))^3`` that lets them vanish at both ends.  So rate and
angular acceleration begin and end at zero, and all derivatives are exact.  Longer movements are sums of overlapping strokes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Stroke:
    """A change of one gimbal's angle between start_s and start_s + duration_s.

    gimbal 0 outer, 1 middle, 2 inner; change_rad the net change; wave_rad, wave_hz, wave_phase (K,) the irregularity:
    amplitudes rad, frequencies Hz, phases rad.
    """

    gimbal: int
    start_s: float
    duration_s: float
    change_rad: float
    wave_rad: np.ndarray
    wave_hz: np.ndarray
    wave_phase: np.ndarray

    @property
    def stop_s(self) -> float:
        """When it ends, s since the session's first sample."""
        return self.start_s + self.duration_s

    def scaled(self, factor: float) -> Stroke:
        """The same stroke with all angles times ``factor``."""
        return replace(self, change_rad=self.change_rad * factor, wave_rad=self.wave_rad * factor)

    def angle(self, t_s: np.ndarray) -> np.ndarray:
        """(3, N): angle since the start, rad, and its two derivatives, rad/s and rad/s^2, at t_s (N,) s within the stroke."""
        since = t_s - self.start_s
        u = since / self.duration_s
        v = 1 - u
        profile = u**3 * (10 - 15 * u + 6 * u**2), 30 * (u * v) ** 2, 60 * u * v * (v - u)
        window = (4 * u * v) ** 3, 192 * (u * v) ** 2 * (v - u), 384 * u * v * ((v - u) ** 2 - u * v)
        wave = np.zeros((3, len(since)))
        for amplitude, hertz, phase in zip(self.wave_rad, self.wave_hz, self.wave_phase, strict=True):
            pulsation = 2 * np.pi * hertz
            sine = amplitude * np.sin(pulsation * since + phase)
            wave[0] += sine
            wave[1] += amplitude * pulsation * np.cos(pulsation * since + phase)
            wave[2] -= pulsation**2 * sine
        rate, acceleration = 1 / self.duration_s, 1 / self.duration_s**2  # du/dt and its square
        return np.stack(
            [
                self.change_rad * profile[0] + window[0] * wave[0],
                (self.change_rad * profile[1] + window[1] * wave[0]) * rate + window[0] * wave[1],
                (self.change_rad * profile[2] + window[2] * wave[0]) * acceleration + 2 * window[1] * rate * wave[1] + window[0] * wave[2],
            ]
        )


class GimbalTurn(Protocol):
    """What one gimbal does between two moments: a ``Stroke``, or what stands for one."""

    @property
    def gimbal(self) -> int:
        """0 outer, 1 middle, 2 inner."""

    @property
    def start_s(self) -> float:
        """When it begins, s since the session's first sample."""

    @property
    def stop_s(self) -> float:
        """When it ends."""

    @property
    def change_rad(self) -> float:
        """Net change of the angle, rad."""

    def angle(self, t_s: np.ndarray) -> np.ndarray:
        """(3, N): angle since the start, rad, and its two derivatives, at t_s (N,) s between the two moments."""


def gimbal_angles(start_rad: np.ndarray, strokes: Sequence[GimbalTurn], t_s: np.ndarray) -> np.ndarray:
    """Gimbals moved by strokes.

    start_rad (3,) rad, outer middle inner, before the first stroke; t_s (N,) s, increasing.
    Returns (3, 3, N): [0] angles rad, [1] rates rad/s, [2] accelerations rad/s^2, each outer, middle, inner.
    """
    angles = np.zeros((3, 3, len(t_s)))
    angles[0] = np.asarray(start_rad)[:, None]
    for stroke in strokes:
        first, last = np.searchsorted(t_s, (stroke.start_s, stroke.stop_s))
        angles[:, stroke.gimbal, first:last] += stroke.angle(t_s[first:last])
        angles[0, stroke.gimbal, last:] += stroke.change_rad
    return angles
