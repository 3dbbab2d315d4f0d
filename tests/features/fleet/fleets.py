"""Fleets for the tests: a few short sessions, an executor without processes, what a table holds; lots of sensors with a known truth."""

from __future__ import annotations

import sqlite3
from collections import deque
from pathlib import Path

import numpy as np

from session.base.units import DEG
from tinygc.features.fleet.fleet_row import FleetOptions, Outcome, compute, empty, packed
from tinygc.features.fleet.fleet_run import run_fleet, session_folders
from tinygc.features.fleet.fleet_table import open_table
from tinygc.features.fleet.lot import NAMES, UnitResult
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import write_session

NAME = "fleet.sqlite"
QUICK, FIT = FleetOptions(steps=("check",)), FleetOptions(steps=("check", "fit"))


def made(where, count=4, segments=8):
    """A folder with so many sessions, each of a unit of its own."""
    for seed in range(count):
        write_session(SimulationOptions(segments=segments, closure_s=0.0, odr_hz=62.5, seed=seed), where / f"unit{seed}")
    return where


class Here:
    """Computes in this very process; ``computed``: what it was given."""

    capacity = 1

    def __init__(self):
        self.computed: list = []
        self._queue: deque = deque()

    def submit(self, job):
        self._queue.append(job)

    def finished(self):
        job = self._queue.popleft()
        self.computed.append(job)
        return [(job, compute(job))]

    def close(self):
        pass


def ran(place, out, options=QUICK, executor=None, **how):
    """The tally of a run, and the names of the folders that were computed for it."""
    executor = executor or Here()
    with open_table(out) as table:
        tally = run_fleet(session_folders([place]), table, executor, options, **how)
    return tally, [Path(job.folder).name for job in getattr(executor, "computed", ())]


def asked(out, sql):
    """Of the table, which is changed where the words say so."""
    connection = sqlite3.connect(out / NAME)
    try:
        with connection:
            return connection.execute(sql).fetchall()
    finally:
        connection.close()


def content(out):
    """All that is compared: results and folders, whoever computed them, in whatever order."""
    return {name: asked(out, f"SELECT * FROM {name} ORDER BY 1") for name in ("results", "folders")}


# Lots of sensors with a known mean, spread, drift and repeatability: sessions as their fits would tell them.

COUNT = len(NAMES)
#: between units, one sigma of each number, SI
SPREAD = np.array([3e-3] * 9 + [0.6 * DEG] * 3 + [2e-3, 1e-3, 1e-3, 2e-3, 1e-3, 2e-3, 0.1, 0.1, 0.1])


def _correlated(rng):
    """(21, 21) of unit variances."""
    A = rng.normal(size=(COUNT, COUNT))
    C = A @ A.T + 10 * np.eye(COUNT)
    size = np.sqrt(np.diag(C))
    return C / np.outer(size, size)


def simulated_lot(units, seed, sessions=1, noise=0.2, drift=0.0, without_accelerometer=0.0):
    """UnitResults; sizes in spreads.  sessions: of each unit, or of some in turn; drift over the whole lot."""
    rng, results = np.random.default_rng(seed), []
    mean = np.where(np.isin(NAMES, ("E_xx", "E_yy", "E_zz")), 1.0, 0.0) + SPREAD * np.random.default_rng(0).normal(size=COUNT)
    root = np.linalg.cholesky(_correlated(np.random.default_rng(1)) * np.outer(SPREAD, SPREAD))
    for u in range(units):
        unit = mean + drift * SPREAD * (u / max(units - 1, 1) - 0.5) + root @ rng.normal(size=COUNT)
        for s in range(sessions if np.isscalar(sessions) else sessions[u % len(sessions)]):
            size = noise * SPREAD * np.exp(0.3 * rng.normal(size=COUNT))
            R = _correlated(rng) * np.outer(size, size)
            values = unit + SPREAD * (0.1 * rng.normal(size=COUNT)) + np.linalg.cholesky(R) @ rng.normal(size=COUNT)
            if rng.random() < without_accelerometer:
                values[12:] = R[12:] = R[:, 12:] = np.nan
            name = f"{u:05d}-{s}"
            results.append(UnitResult(name, f"serial {u:05d}", name, values, R, order=float(len(results))))
    return results


def put(table, folder, key, **row):
    """A row of a session that is done, as ``fleet`` writes it."""
    row = empty() | {"status": "done"} | row
    table.put(Outcome(key, row), row, [folder])


def written_fleet(folder, first_model, drift=0.0):
    """A fleet's table of simulated results, the first of which may be of another model."""
    folder.mkdir()
    with open_table(folder) as table:
        for number, result in enumerate(simulated_lot(20, 5, [1, 2], drift=drift)):
            row = {"model": "ASM330LHH" if number else first_model, "serial": result.serial, "held_out_deg": 0.02, "floor_deg": 0.02}
            sigmas = np.sqrt(np.diag(result.covariance))
            row |= {name: float(value) for name, value in zip(NAMES, result.values, strict=True)}
            row |= {f"sigma_{name}": float(sigma) for name, sigma in zip(NAMES, sigmas, strict=True)}
            put(table, folder / result.session, result.key, covariance=packed(result.covariance), **row)
    return folder
