"""Columns, ``distort`` and ``correct`` say the same."""

from __future__ import annotations

import numpy as np

from tinygc.effect_checks.report import NotChecked, Wrong
from tinygc.effect_checks.scene import Trial, movement

#: Hz: a lag far below the sampling period is a backward difference
FINE_HZ, USUAL_HZ = 3332.0, 833.0
#: shares of the greatest that may differ: one-sided differences, and a derivative by central differences at 2 Hz
COLUMNS_WITHIN, UNDONE_WITHIN = 5e-3, 5e-3
STEP = 1e-4
ENDS = 50
#: rad/s: above the rounding of a rate at full scale, a millionth of what a step of any parameter of the catalogue does
ROUNDING = 1e-12


def columns(trial: Trial) -> str:
    """Against finite differences of ``distort`` at zero: for a rate effect; none for what bends something else."""
    effect, moved = trial.effect, movement(FINE_HZ, trial.at, 10.0)
    size = effect.parameter.size
    found = effect.columns(effect.shown(moved))
    if np.shape(found) != (*moved.rate.shape, size):
        raise Wrong(f"columns give shape {np.shape(found)}, expected (N, 3, {size})")
    if effect.kind != "rate":
        if np.any(found):
            raise Wrong(f"columns add to the rate, which an effect of kind {effect.kind} does not")
        return f"none, as of kind {effect.kind}"
    step = STEP * effect.parameter.plausible
    numeric = np.stack([(effect.distort(moved, step * e) - moved.rate) / step for e in np.eye(size)], axis=-1)
    greatest = np.abs(numeric).max(axis=(0, 1))
    if not (step * greatest > ROUNDING).all():
        raise Wrong(f"parameter {int(np.argmin(greatest))} changes nothing on a hand's movement")
    off = float((np.abs(numeric - found)[ENDS:-ENDS].max(axis=(0, 1)) / greatest).max())
    if not off < COLUMNS_WITHIN:
        raise Wrong(f"columns differ from the finite differences of distort by {100 * off:.2g} % (at most {100 * COLUMNS_WITHIN:g} %)")
    return f"within {100 * off:.2g} % of the finite differences of distort"


def undo(trial: Trial) -> str:
    """``correct`` gives the true rate back, and does nothing without parameters."""
    effect, moved = trial.effect, movement(USUAL_HZ, trial.at, 10.0)
    if effect.kind != "rate":
        raise NotChecked(f"of kind {effect.kind}: it is not undone in the rate")
    distorted = effect.distort(moved, trial.theta)
    done = float(np.abs(distorted - moved.rate).max())
    back = effect.correct(distorted, moved.with_rate(distorted), trial.theta)
    left = float(np.abs(back - moved.rate)[ENDS:-ENDS].max()) / done if done > 0 else np.inf
    if not left < UNDONE_WITHIN:
        raise Wrong(f"correct leaves {100 * left:.2g} % of what distort did (at most {100 * UNDONE_WITHIN:g} %)")
    zero = np.zeros_like(trial.theta)
    if np.abs(effect.correct(moved.rate, moved, zero) - moved.rate).max() > 1e-12:
        raise Wrong("correct changes the rate although all parameters are zero")
    return f"correct leaves {100 * left:.2g} % of what distort did"
