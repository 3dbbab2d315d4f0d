"""Page of pictures with a truth file as reference: missing rate over time, before and after; noise, neighbours, frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base.units import DEG, MG
from tinygc.features.truth.evidence import TruthExplanation, neighbours
from tinygc.reporting.pictures.canvas import AFTER, AXES, BEFORE, FLOOR, canvas, zero_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: segments in the running median, which shows slow variation
SLOW_SEGMENTS = 9


def figure_of(e: TruthExplanation) -> Figure:
    """Draw the page as a matplotlib figure.  Raises CalibrationError if matplotlib is missing."""
    headline = f"{e.problem.session.name}: {e.verdict.replace('_', ' ')}"
    ids, says = [claim.effect.id for claim in e.claimed], [claim.says for claim in e.claimed]
    figure, grid = canvas(3, headline, ids, says)
    _rate_in_time(e, e.angles[0], grid[0, 0], f"before, {e.closure_rms[0] / DEG:.3f}° rms")
    _rate_in_time(e, e.angles[1], grid[0, 1], f"after, {e.closure_rms[1] / DEG:.3f}° rms" if e.claimed else "the same: nothing was named")
    grid[0, 1].sharey(grid[0, 0])
    _growth(e, grid[1, 0])
    _neighbours(e, grid[1, 1])
    _frame(e, grid[2, 0])
    _force(e, grid[2, 1])
    return figure


def _rate_in_time(e: TruthExplanation, angles: np.ndarray, axes: Axes, when: str) -> None:
    """Plot the rate, (S, 3), that would close each segment, and its slow variation; mark wrong times in the truth file."""
    t_s = e.problem.middle_s
    rate = angles / np.array([segment.duration_s for segment in e.problem.used])[:, None] / DEG
    for i, axis in enumerate("xyz"):
        axes.plot(t_s, rate[:, i], ".", color=AXES[axis], ms=3, alpha=0.5, label=axis)
        if len(t_s) >= SLOW_SEGMENTS:
            windows = np.lib.stride_tricks.sliding_window_view(rate[:, i], SLOW_SEGMENTS)
            half = SLOW_SEGMENTS // 2
            axes.plot(t_s[half : len(t_s) - half], np.median(windows, axis=1), color=AXES[axis], lw=1.5)
    began = e.problem.began_s
    for number, (log, at) in enumerate(e.jumps):
        axes.axvline(began[log] + at, color=FLOOR, ls=":", label=None if number else "wrong moment of truth, left out")
    zero_line(axes)
    # The limits ignore outlying segments, which would hide the others.
    limit = 1.3 * np.quantile(np.abs(e.angles[0]).max(axis=1) / [segment.duration_s for segment in e.problem.used], 0.98) / DEG
    axes.set_ylim(-limit, limit)
    axes.set(xlabel="time (s)", ylabel="closure over duration (dps)", title=f"Rate that the segments miss about the truth's axes, {when}")
    axes.legend(fontsize=8, title="lines: running median" if len(t_s) >= SLOW_SEGMENTS else None, title_fontsize=8)


def _growth(e: TruthExplanation, axes: Axes) -> None:
    """Plot closure against length: the truth's noise does not depend on it, the gyro's grows as its root, a bias in proportion."""
    axes.set(xlabel="length of a segment (s)", ylabel="closure per angle (°)", title="Closure against length, about the truth's axes")
    if not len(e.lengths_s):
        _nothing(axes, "too few moments of truth")
        return
    for i, axis in enumerate("xyz"):
        axes.loglog(e.lengths_s, e.closure_rad[:, i] / DEG, "o", mfc="none", color=AXES[axis], label=axis)
    if np.isfinite(e.truth_rad) and e.truth_rad > 0:
        axes.axhline(np.sqrt(2) * e.truth_rad / DEG, color=BEFORE, ls="--", lw=1, label=f"truth, {e.truth_rad / DEG:.3f}° a moment")
    if np.isfinite(e.walk_rad) and e.walk_rad > 0:
        label = f"random walk, {e.walk_rad / DEG:.3f} °/√s"
        axes.loglog(e.lengths_s, e.walk_rad * np.sqrt(e.lengths_s) / DEG, color=AFTER, ls="--", lw=1, label=label)
    if len(e.problem.stills):
        axes.loglog(e.lengths_s, e.gyro_rad * np.sqrt(e.lengths_s) / DEG, color=FLOOR, lw=1, label="the gyro's own noise at rest")
    axes.set_xticks(e.lengths_s, [f"{length:g}" for length in e.lengths_s])
    axes.minorticks_off()
    axes.legend(fontsize=8)


def _neighbours(e: TruthExplanation, axes: Axes) -> None:
    """Plot each segment's closure against its predecessor's: slow variation on the rising line, the truth's noise on the falling one."""
    axes.set(xlabel="closure of a segment (°)", ylabel="closure of the next (°)", title="Neighbouring segments")
    at = neighbours(e.problem)
    if len(at) < 5:
        _nothing(axes, "too few neighbours")
        return
    for angles, colour, when, correlation in zip(e.angles, (BEFORE, AFTER), ("before", "after"), e.neighbours, strict=True):
        x, y = angles[at].ravel() / DEG, angles[at + 1].ravel() / DEG
        axes.plot(x, y, ".", color=colour, ms=4, alpha=0.5, label=f"{when}, correlation {correlation:+.2f}")
    limit = 1.2 * np.quantile(np.abs(e.angles[0]), 0.98) / DEG
    for slope, name in ((1, "something slow"), (-1, "the truth's noise")):
        axes.axline((0, 0), slope=slope, color=FLOOR, ls="--" if slope > 0 else ":", lw=0.8, label=name)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit))
    axes.legend(fontsize=8)


def _frame(e: TruthExplanation, axes: Axes) -> None:
    """Plot the rotation from the gyro's axes to the truth's."""
    axes.set(ylabel="rotation (°)", title="Truth's frame against the gyro's, ± one sigma")
    turned, sigma = e.alignment.turned, e.alignment.turned_sigma
    if not np.isfinite([turned, sigma]).all():
        _nothing(axes, "too few segments")
        return
    for i, axis in enumerate("xyz"):
        axes.errorbar(i, turned[i] / DEG, sigma[i] / DEG, fmt="o", color=AXES[axis], capsize=6)
    zero_line(axes)
    axes.set_xticks(range(3), ["about x", "about y", "about z"])
    offset_ms, sigma_ms = 1e3 * e.alignment.offset_s, 1e3 * e.alignment.offset_sigma_s
    axes.set_xlabel(f"clock of the truth against the gyro's: {offset_ms:+.2f} ± {sigma_ms:.2f} ms")


def _force(e: TruthExplanation, axes: Axes) -> None:
    """Plot the accelerometer's error against the truth's vertical, as given and after the rotation estimated by the gyro."""
    axes.set(ylabel="apparent bias (mg)", title="Accelerometer against the truth's vertical, ± one sigma")
    if e.force is None:
        _nothing(axes, "no 20 s in one piece, over which a vehicle averages out")
        return
    at = np.arange(3)
    for shift, values, colour, name in (
        (-0.18, e.force.bias, BEFORE, "as it stands"),
        (0.18, e.force.turned, AFTER, "turned as the gyro asks"),
    ):
        axes.bar(at + shift, values / MG, 0.34, yerr=e.force.sigma / MG, color=colour, capsize=4, label=name)
    zero_line(axes)
    axes.set_xticks(at, list("xyz"))
    axes.legend(fontsize=8)


def _nothing(axes: Axes, why: str) -> None:
    axes.text(0.5, 0.5, f"not known: {why}", ha="center", va="center", transform=axes.transAxes, color=FLOOR)
    axes.set(xticks=[], yticks=[])
