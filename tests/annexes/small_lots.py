"""Lots of a few units and two or three known numbers, made from arrays; and what a Gaussian with every entry written out makes of them."""

import numpy as np

from tinygc.annexes.lots.hierarchy import Belief
from tinygc.annexes.lots.lot import COUNT, UnitResult, lot_sessions


def small_lot(counts, known=(0, 10), seed=0):
    """A lot whose units have so many sessions each, and only these of the 21 numbers; stated covariances differ from session to session."""
    rng, results = np.random.default_rng(seed), []
    for unit, count in enumerate(counts):
        at = rng.normal(size=len(known))
        for session in range(count):
            values, covariance = np.full(COUNT, np.nan), np.full((COUNT, COUNT), np.nan)
            root = 0.3 * np.eye(len(known)) + 0.1 * rng.normal(size=(len(known),) * 2)
            values[list(known)] = 3 + at + 0.5 * rng.normal(size=len(known))
            covariance[np.ix_(known, known)] = root @ root.T
            results.append(UnitResult(f"{unit}-{session}", f"u{unit:02d}", f"s{unit}-{session}", values, covariance, order=unit))
    return lot_sessions(results)


def filled(block, known=(0, 10)):
    """(21, 21) with a block of the known numbers, in scales."""
    whole = np.zeros((COUNT, COUNT))
    whole[np.ix_(known, known)] = block
    return whole


def believed(spread, repeatability, known=(0, 10), mean=0.0, drift=0.0, **more):
    """A belief in scales; mean and drift of every known number."""
    beta = np.zeros((2, COUNT))
    beta[0, list(known)], beta[1, list(known)] = mean, drift
    more.setdefault("beta_covariance", np.zeros((2 * COUNT,) * 2))
    return Belief(beta, spread=filled(spread, known), repeatability=filled(repeatability, known), **more)


class Dense:
    """All sessions of a lot as one Gaussian, in scales: y (n,), design (n, 2 k) of mean and drift, covariance (n, n)."""

    def __init__(self, lot, spread, repeatability, known=(0, 10)):
        k, unit = len(known), lot.unit
        rows = np.ix_(known, known)
        self.y = np.concatenate([((lot.values - lot.centre) / lot.scale)[s, list(known)] for s in range(lot.sessions)])
        along = (lot.place / (lot.units - 1) - 0.5)[unit]
        self.design = np.vstack([np.hstack([np.eye(k), a * np.eye(k)]) for a in along])
        self.noise = np.zeros((len(self.y),) * 2)
        for s in range(lot.sessions):
            self.noise[k * s : k * s + k, k * s : k * s + k] = lot.covariance(slice(s, s + 1))[0][rows]
        self.again = np.kron(np.eye(lot.sessions), repeatability)
        self.units = np.kron(unit[:, None] == unit, spread)
        self.C = self.noise + self.again + self.units

    def solved(self, columns=slice(None)):
        """Generalised least squares on some columns: what is found, and its covariance."""
        X = self.design[:, columns]
        covariance = np.linalg.inv(X.T @ np.linalg.solve(self.C, X))
        return covariance @ X.T @ np.linalg.solve(self.C, self.y), covariance

    def restricted(self):
        """The logarithm of the restricted likelihood, up to a constant."""
        found, covariance = self.solved()
        r = self.y - self.design @ found
        logs = np.linalg.slogdet(self.C)[1] - np.linalg.slogdet(covariance)[1]
        return -0.5 * (logs + r @ np.linalg.solve(self.C, r))
