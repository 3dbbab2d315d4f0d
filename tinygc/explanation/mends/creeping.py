"""Stills that are none: gravity moves in them, or they turn about the vertical, which only the gyro sees."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from session.detect.stills import CREEP_SIGMAS
from tinygc.attitude import rotation
from tinygc.explanation.noise.session_noise import known_whitener
from tinygc.explanation.twin.refit import refit
from tinygc.explanation.twin.twin import Twin
from tinygc.problem.problem import Problem

#: a still that turns about the vertical shows only in the gyro: its rate must stand out by this much from stills that agree
#: (not critical: benchmarks/thresholds.py)
OUTLIER_SIGMAS = 10.0
#: and lie within 18 degrees of it
VERTICAL = 3.0


def chance_of_creep(problem: Problem) -> float:
    """Bound of the chance that noise alone makes one of the stills seem to creep."""
    return min(1.0, len(problem.stills) * float(chi2.sf(CREEP_SIGMAS**2, 3)))


def about_the_vertical(problem: Problem) -> list[int]:
    """Numbers of the stills whose rate stands out from the others', along gravity."""
    twin = Twin(problem)
    whiten = known_whitener(twin)
    reference = [i for i, still in enumerate(problem.stills) if still.problem is None]
    still_rows = np.arange(whiten.parts["still"].start, whiten.parts["still"].stop).reshape(-1, 3)
    good = np.ones(len(reference), dtype=bool)
    fit = None
    for _ in range(8):
        rows = np.ones(whiten.parts["length"].stop, dtype=bool)
        rows[still_rows[~good].ravel()] = False
        fit = refit(twin, whiten, [], fit.state if fit else twin.start(), rows=rows, max_steps=4)
        rate = twin.residuals(fit.state).still
        spread = np.median(np.linalg.norm(rate, axis=1)) / 1.54
        size = np.linalg.norm(rate, axis=1) / max(spread, 1e-12)
        now = size < OUTLIER_SIGMAS
        if (now == good).all() or now.sum() < len(now) / 2:
            break
        good = now
    in_table = np.einsum("qij,qj->qi", rotation.matrix(twin.q_tb), rate)
    vertical = np.abs(in_table[:, 2]) > VERTICAL * np.linalg.norm(in_table[:, :2], axis=1)
    return [number for number, fine, along in zip(reference, good, vertical, strict=True) if not fine and along]
