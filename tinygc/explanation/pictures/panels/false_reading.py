"""False readings: one of them with its bridge, and all of them over the session."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from tinygc.explanation.mends.false_readings import find_glitches, without_glitches
from tinygc.explanation.pictures.panels.palette import AXES, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.events import reading_s
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AROUND = 12  #: samples on either side


def one_reading(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The greatest: as read, false samples marked, and the bridge across them."""
    runs = _runs(e, claim)
    log, first, count, _ = max(runs, key=lambda run: np.abs(run[3]).max())
    read, bridged = e.session.logs[log].samples.gyro / DEG, _bridged(e, log)
    rows = np.arange(max(first - AROUND, 0), min(first + count + AROUND, len(read)))
    false = np.arange(first, first + count)
    for i, axis in enumerate("xyz"):
        axes.plot(rows, read[rows, i], ".-", color=AXES[axis], lw=0.8, label=axis)
        axes.plot(false, read[false, i], "X", color=AXES[axis], ms=9, label="false" if i == 0 else None)
        across = np.arange(first - 1, first + count + 1)
        axes.plot(across, bridged[across, i], "o--", mfc="none", color=AXES[axis], label="bridge" if i == 0 else None)
    axes.axvspan(first - 0.5, first + count - 0.5, color=FLOOR, alpha=0.15)
    axes.set(
        xlabel=f"row of {e.session.logs[log].path.name}", ylabel="rate (dps)", title=f"Where it lives: a false reading of {count} samples"
    )
    axes.legend(fontsize=8, ncols=2)


def all_readings(e: Explanation, claim: Claim, axes: Axes) -> None:
    """How far each is off its bridge, over the session."""
    t_s = reading_s(e, np.array(claim.parameters["at"], dtype=int))
    size = np.array([off[np.argmax(np.abs(off), axis=0), range(3)] for _, _, _, off in _runs(e, claim)])
    for i, axis in enumerate("xyz"):
        axes.vlines(t_s, 0, size[:, i], color=AXES[axis], lw=1)
        axes.plot(t_s, size[:, i], "o", color=AXES[axis], label=axis)
    axes.axhline(0, color=FLOOR, lw=0.8)
    axes.set(xlabel="time of the session (s)", ylabel="false less bridge (dps)", title=f"All {len(t_s)} false readings")
    axes.legend(ncols=3)


def _bridged(e: Explanation, log: int) -> np.ndarray:
    """(N, 3) dps, the rate with its false readings bridged."""
    samples = e.session.logs[log].samples
    glitches = find_glitches(samples)
    return (samples if glitches is None else without_glitches(samples, glitches)).gyro / DEG


def _runs(e: Explanation, claim: Claim) -> list[tuple[int, int, int, np.ndarray]]:
    """(log, first row in it, samples, readings less bridge (samples, 3) dps) of each false reading, in order."""
    found, began = [], 0
    for log, each in enumerate(e.session.logs):
        glitches = find_glitches(each.samples)
        if glitches is not None:
            off = each.samples.gyro / DEG - _bridged(e, log)
            runs = zip(glitches.rows.tolist(), glitches.samples.tolist(), strict=True)
            found += [(log, row, count, off[row : row + count]) for row, count in runs if row + began in claim.parameters["at"]]
        began += len(each.samples)
    return found
