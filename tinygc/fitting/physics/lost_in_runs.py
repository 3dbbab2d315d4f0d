"""Samples lost in a closure run.  A log's losses are mended by its own closure; a run is never fitted, and so nothing in it is mended."""

from __future__ import annotations

import numpy as np

from tinygc.explanation.mends import lost_samples
from tinygc.problem.closure_run import ClosureRun


def lost_in(run: ClosureRun) -> np.ndarray:
    """Moments (L,) in seconds of the run's file after which samples seem to be missing, between its two stills."""
    rows = lost_samples.find_losses(lost_samples.find_jumps(run.samples), run.samples.duration_s)
    inside = rows[(rows >= run.rows.start) & (rows < run.rows.stop - 1)]
    return run.samples.t_s[inside] - run.samples.t_s[0]


def loss_words(lost_s: np.ndarray) -> str:
    """One sentence, or none."""
    if not len(lost_s):
        return ""
    first = ", ".join(f"{moment:.1f}" for moment in lost_s[:3]) + (", …" if len(lost_s) > 3 else "")
    return f"samples seem lost in it, after {first} s; nothing in a closure run is mended, so its errors are not the calibration's"
