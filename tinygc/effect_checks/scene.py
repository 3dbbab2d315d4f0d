"""What an effect is tried on without a session: a hand's movement, a size of its parameters, a model that undoes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from session.common.units import NS_PER_S, G
from session.log.samples import Samples
from tinygc.effects import AppliedEffect, CommonDelay, Conditions, Effect, FoundAt, Movement
from tinygc.models.linear import LinearModel
from tinygc.models.physics import PhysicsModel

WARMING_C_PER_S = 0.8
#: of a parameter's plausible size: what a poor sensor has
SIZE = 0.05


@dataclass(frozen=True, eq=False)
class Trial:
    """effect: with a value of its scanned shape, where it has one; original: as it was given; theta (P,) SI, a strong one."""

    effect: Effect
    original: Effect
    theta: np.ndarray

    def model(self) -> PhysicsModel:
        """That undoes it and nothing else."""
        return PhysicsModel(LinearModel(np.eye(3), np.zeros(3)), (AppliedEffect(self.effect, self.theta),), self.known)

    @property
    def at(self) -> FoundAt:
        """Full scale and first temperature of the scene."""
        return self.original.found_at

    @property
    def known(self) -> Conditions:
        """What the model refers to."""
        return Conditions(duration_s=LENGTH_S, fs_rps=self.at.fs_rps, first_temp_c=self.at.first_temp_c)


LENGTH_S = 20.0


def trial(effect: Effect, size: float, seed: int, value: float | None = None) -> Trial:
    """Parameters of either sign, 0.5 to 1.5 times ``size``; lags are positive; the scanned shape at ``value``, or amid its grid."""
    here = effect
    if effect.scan is not None:
        here = effect.at(middle_value(effect, [movement(104.0, effect.found_at)]) if value is None else value)
    return Trial(here, effect, random_theta(effect, size, seed))


def random_theta(effect: Effect, size: float, seed: int) -> np.ndarray:
    """(P,) SI, of a convention's gauge where there is one."""
    rng, gauge = np.random.default_rng(seed), effect.gauge
    theta = size * rng.uniform(0.5, 1.5, effect.parameter.size) * rng.choice((-1.0, 1.0), effect.parameter.size)
    if isinstance(gauge, CommonDelay):
        if gauge.never_negative:
            return gauge.late * np.abs(theta)
        # Only the differences: what is common is a delay of the clock, which a simulated session has none of.
        theta[list(gauge.delays)] -= theta[list(gauge.delays)].mean()
        return theta
    return theta if gauge is None else gauge.settle(theta)


def middle_value(effect: Effect, movements: list[Movement]) -> float:
    """A value of the scanned shape, SI, between two of its grid."""
    if effect.scan is None or effect.scan.grid is None:
        return 0.4 * movements[0].duration_s
    values = np.asarray(effect.scan.grid(movements), dtype=float)
    at = len(values) // 2
    return float(values[max(at - 1, 0) : at + 1].mean())


def movement(odr_hz: float, at: FoundAt, length_s: float = LENGTH_S) -> Movement:
    """A hand's: at rest, movement up to two fifths of full scale and 2 Hz, at rest again; all inputs there, each of its own shape."""
    t_s = np.arange(0, length_s, 1 / odr_hz)
    vibration = 0.2 * np.exp(-(((t_s / length_s - 0.5) * 10) ** 2))
    temp_c = at.first_temp_c + WARMING_C_PER_S * t_s
    rate = at.fs_rps * _rate(t_s, length_s)
    return Movement(t_s, 1 / odr_hz, rate, _turned(t_s), temp_c, vibration, length_s, at.fs_rps, at.first_temp_c)


def log(odr_hz: float, at: FoundAt, length_s: float = LENGTH_S) -> Samples:
    """The same movement as a log without noise."""
    moved = movement(odr_hz, at, length_s)
    stamps = np.rint(np.arange(len(moved.t_s)) * (NS_PER_S / odr_hz)).astype(np.int64)
    return Samples(stamps, moved.rate, moved.force_g * G, moved.temp_c)


def _rate(t_s: np.ndarray, length_s: float) -> np.ndarray:
    """(N, 3) of full scale; the window is a B-spline of degree 7, six times differentiable."""
    window = BSpline.basis_element(np.linspace(0.2, 0.8, 9) * length_s, extrapolate=False)
    waves = np.stack([np.sin(2 * np.pi * f * t_s + p) for f, p in ((0.5, 0.3), (0.9, 1.1), (2.0, 2.0))], axis=-1)
    return np.nan_to_num(window(t_s))[:, None] * waves


def _turned(t_s: np.ndarray) -> np.ndarray:
    """(N, 3) g: gravity, and up to a fifth of it that the hand's acceleration adds or takes off."""
    gravity = np.stack([np.sin(0.7 * t_s), np.cos(0.7 * t_s) * np.sin(0.4 * t_s), -np.cos(0.7 * t_s) * np.cos(0.4 * t_s)], axis=-1)
    return (1 + 0.2 * np.sin(1.9 * t_s))[:, None] * gravity
