"""Beside the method of imu_tk (Tedaldi, Pretto & Menegatti 2014, ICRA), as its paper describes it, on the same segments.

Its accelerometer: nine numbers that bring the squared length of gravity in the stills nearest to the site's, all stills alike.  Its
gyroscope: the bias is the mean of the first still; scale and misalignment (nine numbers) bring gravity, carried through each turn, nearest
to the accelerometer's.  The paper integrates by Runge-Kutta of fourth order; here the exact one stands for it, which leaves it better off.
Ours: ``fit`` as it is, without ``[accelerometer]``.  Held out in the same five folds.

    python benchmarks/imu_tk_method.py ../shared/mikov/imu0 ../shared/mikov/imu2 ../shared/mikov/imu4
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import markdown
from scipy.optimize import least_squares

from session.base.units import DEG
from session.detect import accelerometer
from session.detect.accelerometer import force_of
from session.log.config import Accelerometer
from session.log.folder import Session, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.closure.residual import closure_angles
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.models.linear import LinearModel, bias_only

FOLDS = 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, help="session folders")
    rows = []
    for folder in parser.parse_args().folders:
        session = read_session(folder)
        bare = replace(session, config=replace(session.config, accelerometer=Accelerometer(source="none")))
        ours = fit_session(bare, FitOptions(methods=("least_squares",), folds=FOLDS))
        stills = fit_session(bare, FitOptions(methods=("least_squares",), folds=FOLDS, bias="stills"))
        floor = ours.problem.floor.tilt_rms / DEG
        figures = [imu_tk(bare), rms(ours.linear.held_out), rms(stills.linear.held_out), floor]
        rows.append([folder.name, str(len(ours.problem.used)), *(f"{x:.4f}" for x in figures)])
    print(markdown(["recording", "turns", "imu_tk's method", "ours", "ours, `--bias stills`", "noise floor"], rows))


def imu_tk(session: Session) -> float:
    """Held-out tilt, deg rms."""
    begun = prepare(session).problem  # only for which stills and turns there are
    gravity = session.config.site.expected_gravity_mps2
    bare = replace(session, config=replace(session.config, accelerometer=Accelerometer()))
    measured = force_of([still for log in build_problem(bare).logs for still in log.stills if still.problem is None])
    own = by_squares(measured, gravity)
    problem = build_problem(replace(session, config=replace(session.config, accelerometer=own)), use_earth=False)
    assert len(problem.batch) == len(begun.batch)
    return _held_out(problem)


def by_squares(measured: np.ndarray, gravity: float) -> Accelerometer:
    """Nine numbers from stills' mean readings (S, 3), as equation 10 of the paper."""

    def cost(x: np.ndarray) -> np.ndarray:
        return gravity**2 - np.sum(accelerometer.corrected(x, measured) ** 2, axis=1)

    x = least_squares(cost, accelerometer.IDENTITY, x_scale=accelerometer.units(gravity)).x
    return accelerometer.after(x, Accelerometer())


def _held_out(problem: Problem) -> float:
    fold = np.arange(len(problem.batch)) % FOLDS
    angles = np.zeros((len(problem.batch), problem.batch.angles))
    for k in range(FOLDS):
        angles[fold == k] = closure_angles(problem.batch.pick(fold == k), _fit(problem, fold != k))
    return rms(angles)


def _fit(problem: Problem, seen: np.ndarray) -> LinearModel:
    first = next(still for log in problem.logs for still in log.stills if still.problem is None)
    batch = problem.batch.pick(seen)
    return fit_least_squares(batch, np.full(len(batch), 1e-3), bias_only(first.gyro_mean), rest_rps=first.gyro_mean).model


def rms(angles: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(angles[:, :2] ** 2, axis=1)))) / DEG


if __name__ == "__main__":
    main()
