"""What the likelihood's sigmas miss because it takes windows and levels as independent.

The estimate of a composite likelihood has the covariance H^-1 J H^-1 (Godambe 1960), H its expected curvature, J the covariance of its
slope, which is 2 H where all is independent.  Here J also counts, for every two neighbouring levels, what a window of the coarser one and
the windows inside it have in common, and what these have among themselves.  For white noise both vanish; a walk makes the sigma of K up to
a quarter larger.
"""

from __future__ import annotations

import numpy as np

from tinygc.features.noise.choice import Chosen, Search
from tinygc.features.noise.likelihood import LOG_STEP, autocovariance, line_autocovariance
from tinygc.features.noise.scales import Group
from tinygc.features.noise.summary import contrasts

#: means of a coarser window that are looked at; of more the ends matter less
MOST_MEANS = 16


def sandwich(search: Search, chosen: Chosen) -> np.ndarray:
    """Return the covariance of ln s^2 of a set, and of ln T of a Gauss-Markov term last, windows and levels not being independent."""
    bread = chosen.fitted.covariance
    # J less 2 H, of ln s^2 (and ln T)
    count = len(chosen.fitted.information)
    total = np.zeros((count, count))
    by_size = sorted(search.groups, key=lambda group: group.size)
    for child in by_size:
        inside = len(child.at)
        for parent in by_size:
            if parent.size == child.size * inside and not child.top:
                total += _of_pair(search, chosen, child, parent)
    return np.asarray(bread + bread @ total @ bread / 4)


def _of_pair(search: Search, chosen: Chosen, child: Group, parent: Group) -> np.ndarray:
    inside, windows = len(child.at), min(len(parent.at), MOST_MEANS)
    parents = parent.count * len(parent.at) / windows
    H, wide = contrasts(inside), contrasts(windows)
    rows = np.concatenate([np.kron(np.eye(windows), H.T), np.kron(wide.T, np.full((1, inside), 1 / inside))])
    mean_s = child.size * search.period_s
    x = chosen.fitted.x
    every = [_covariance(search, chosen, name, inside * windows, mean_s) for name in chosen.names]
    C = rows @ sum(size * own for size, own in zip(x, every, strict=True)) @ rows.T
    parts = [size * own for size, own in zip(x, every, strict=True)]
    if "G" in chosen.names:
        time = chosen.fitted.correlation_s
        later = _gauss_markov(inside * windows, mean_s, time * np.exp(LOG_STEP))
        parts.append(x[-1] * (later - _gauss_markov(inside * windows, mean_s, time)) / LOG_STEP)
    d, n = inside - 1, (inside - 1) * windows
    own, over = C[:d, :d], C[n:, n:]
    of_child = [_between(own, H.T @ part[:inside, :inside] @ H) for part in parts]
    of_parent = [_between(over, rows[n:] @ part @ rows[n:].T) for part in parts]
    among = C[:n, :n].reshape(windows, d, windows, d).transpose(0, 2, 1, 3).copy()
    among[np.arange(windows), np.arange(windows)] = 0.0  # each window with itself is in H
    across = C[:n, n:]
    more = np.zeros((len(parts), len(parts)))
    for i, first in enumerate(of_child):
        for j, second in enumerate(of_child):
            more[i, j] += float(np.sum((first @ among @ second) * among))
        for j, second in enumerate(of_parent):
            common = float(np.sum((np.kron(np.eye(windows), first) @ across @ second) * across))
            more[i, j] += common
            more[j, i] += common
    return 2 * parents * more


def _between(C: np.ndarray, V: np.ndarray) -> np.ndarray:
    """C^-1 V C^-1."""
    left = np.linalg.solve(C, V)
    return np.asarray(np.linalg.solve(C, left.T).T)


def _covariance(search: Search, chosen: Chosen, name: str, count: int, mean_s: float) -> np.ndarray:
    """Covariance (n, n) of neighbouring means for a term of size 1."""
    lag = np.arange(count)
    if name == "R":
        return np.outer(lag, lag) * mean_s**2
    if name == "G":
        return _gauss_markov(count, mean_s, chosen.fitted.correlation_s)
    if name.startswith("line"):
        return _toeplitz(line_autocovariance(search.lines_hz[int(name[4:])], lag, mean_s))
    return _toeplitz(autocovariance(name, lag, mean_s))


def _gauss_markov(count: int, mean_s: float, correlation_s: float) -> np.ndarray:
    return _toeplitz(autocovariance("G", np.arange(count), mean_s, correlation_s))


def _toeplitz(by_lag: np.ndarray) -> np.ndarray:
    lag = np.arange(len(by_lag))
    return by_lag[np.abs(lag[:, None] - lag)]
