"""Simulated rests of known noise, by formulas that the estimator does not share."""

import numpy as np
from scipy.signal import lfilter

from session.io.samples import Samples
from tinygc.annexes.noise.summary import RestSums


def noisy(count, dt, rng, *, N=0.0, Q=0.0, B=0.0, K=0.0, R=0.0, G=0.0, T=1.0):
    """Readings (count,), each a mean over its period; flicker by fractional differences (Kasdin 1995)."""
    x = N / np.sqrt(dt) * rng.standard_normal(count) + R * dt * np.arange(count)
    if Q:
        x += Q / dt * np.diff(rng.standard_normal(count + 1))
    if K:
        steps = np.sqrt(dt) * rng.standard_normal(count)
        x += K * (np.cumsum(steps) - steps / 2 + np.sqrt(dt / 12) * rng.standard_normal(count))
    if G:
        keep = np.exp(-dt / T)
        steps = G * np.sqrt(1 - keep**2) * rng.standard_normal(count)
        steps[0] = G * rng.standard_normal()
        x += lfilter([1.0], [1.0, -keep], steps)
    if B:
        many = 4 * count
        k = np.arange(1, many)
        response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
        spectrum = np.fft.rfft(rng.standard_normal(many), 2 * many) * np.fft.rfft(response, 2 * many)
        x += B * np.fft.irfft(spectrum)[many - 2 * count : many].reshape(count, 2).mean(axis=1)
    return x


def six(count, dt, seed, **sizes):
    rng = np.random.default_rng(seed)
    return np.column_stack([noisy(count, dt, rng, **sizes) for _ in range(6)])


def samples_of(values, dt, temp_c=None, start_s=0.0):
    t_ns = np.round((np.arange(len(values)) * dt + start_s) * 1e9).astype(np.int64)
    return Samples(t_ns, values[:, :3], values[:, 3:], temp_c)


def sums_of(values, dt, temp_c=None):
    sums = RestSums(1 / dt)
    sums.add(samples_of(values, dt, temp_c))
    return sums
