"""Panels of register faults: clipping, false readings, lost samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base.units import DEG
from session.detect.segments import Segment
from session.log.samples import start_times
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.faulty_readings import find_glitches, without_glitches
from tinygc.explanation.result import reading_s
from tinygc.reporting.pictures.canvas import AFTER, AXES, BEFORE, FLOOR, zero_line
from tinygc.reporting.pictures.values import closure_as_recorded, closure_by_segment

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Clipping: readings at the clipping level, and their effect on closure.


def one_turn(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot the turn that stays at the clipping level longest, with the level."""
    level = claim.parameters["dps"]
    least = level - claim.std["dps"]

    def at_level(segment: Segment) -> np.ndarray:
        rate = _rate_dps(e, segment)
        return (np.abs(rate) >= least).sum(axis=0)

    segment = max(e.problem.segments, key=lambda segment: at_level(segment).max())
    t_s, rate, axis = _t_s(e, segment), _rate_dps(e, segment), int(np.argmax(at_level(segment)))
    for i, name in enumerate("xyz"):
        axes.plot(t_s, rate[:, i], color=AXES[name], lw=1.5 if i == axis else 0.8, alpha=1.0 if i == axis else 0.5, label=name)
    stuck = np.abs(rate[:, axis]) >= least
    axes.plot(t_s[stuck], rate[stuck, axis], "o", color="black", ms=4, label=f"{'xyz'[axis]} at the level")
    for sign in (-1, 1):
        axes.axhline(sign * level, color=FLOOR, ls="--", lw=1, label=f"±{level:.4g} dps" if sign > 0 else None)
    number = f"segment {segment.number}, log {segment.log + 1}" if len(e.problem.logs) > 1 else f"segment {segment.number}"
    axes.set(xlabel=f"time in {number} (s)", ylabel="rate as read (dps)", title=f"Where it lives: {'xyz'[axis]} stops at {level:.4g} dps")
    axes.legend(fontsize=8)


def closure_over_peak(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot each segment's closure as recorded over its largest reading: clipped segments do not close."""
    level, closure = claim.parameters["dps"], closure_as_recorded(e)
    left = {segment.number for segment in e.twin.segments}
    peak = np.array([np.abs(_rate_dps(e, segment)).max() for segment in e.problem.used])
    y = np.array([closure[segment.number] for segment in e.problem.used])
    out = np.array([segment.number not in left for segment in e.problem.used])
    axes.semilogy(peak[~out], y[~out], "o", color=AXES["z"], label="used")
    axes.semilogy(peak[out], y[out], "o", color=BEFORE, label="left out")
    axes.axvline(level, color=FLOOR, ls="--", lw=1, label=f"{level:.4g} dps")
    axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls=":", lw=1, label="floor")
    axes.set(xlabel="greatest reading of the segment (dps)", ylabel="closure as recorded (°)", title="Segments at the level do not close")
    axes.legend(fontsize=8)


def _rate_dps(e: Explanation, segment: Segment) -> np.ndarray:
    return e.problem.logs[segment.log].samples.gyro[segment.start : segment.stop] / DEG


def _t_s(e: Explanation, segment: Segment) -> np.ndarray:
    t_s = e.problem.logs[segment.log].samples.t_s[segment.start : segment.stop]
    return t_s - t_s[0]


# False readings: one of them with its interpolation, and all of them over the session.

AROUND = 12  #: samples on either side


def one_reading(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot the largest false reading: as read, false samples marked, and the interpolation across them."""
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
    """Plot the deviation of each false reading from its interpolation, over the session."""
    t_s = reading_s(e, np.array(claim.parameters["at"], dtype=int))
    size = np.array([off[np.argmax(np.abs(off), axis=0), range(3)] for _, _, _, off in _runs(e, claim)])
    for i, axis in enumerate("xyz"):
        axes.vlines(t_s, 0, size[:, i], color=AXES[axis], lw=1)
        axes.plot(t_s, size[:, i], "o", color=AXES[axis], label=axis)
    zero_line(axes)
    axes.set(xlabel="time of the session (s)", ylabel="false less bridge (dps)", title=f"All {len(t_s)} false readings")
    axes.legend(ncols=3)


def _bridged(e: Explanation, log: int) -> np.ndarray:
    """Rate, (N, 3) dps, with its false readings interpolated."""
    samples = e.session.logs[log].samples
    glitches = find_glitches(samples)
    return (samples if glitches is None else without_glitches(samples, glitches)).gyro / DEG


def _runs(e: Explanation, claim: Claim) -> list[tuple[int, int, int, np.ndarray]]:
    """(log, first row, number of samples, readings less interpolation (samples, 3) dps) of each false reading, in order."""
    found, began = [], 0
    for log, each in enumerate(e.session.logs):
        glitches = find_glitches(each.samples)
        if glitches is not None:
            off = each.samples.gyro / DEG - _bridged(e, log)
            found += [(log, row, count, off[row : row + count]) for row, count, _ in glitches if row + began in claim.parameters["at"]]
        began += len(each.samples)
    return found


# Lost samples in a log whose stamps show no gap: one loss as stamped and as it was, and closure over the losses per segment.

AROUND_LOSS = 15  #: samples on either side


def one_loss(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot the loss with the largest jump: black crosses as stamped, dots at the true times, rings for the filled samples."""
    count = claim.parameters["length"]
    log, row, before = max(_losses(e, claim), key=lambda loss: _jump(e, loss[0], loss[1], count))
    read, mended = e.session.logs[log].samples, e.mended.problem.session.logs[log].samples
    start, stop = max(row - before - AROUND_LOSS, 0), row - before + AROUND_LOSS
    zero_s = mended.t_s[row]
    stamped = np.arange(start, min(stop, len(read)))
    moved_s = before * read.period_s  # shift of the later stamps by earlier losses of this log
    whole = np.arange(max(row - AROUND_LOSS, 0), min(row + count + AROUND_LOSS, len(mended)))
    between = np.arange(row + 1, row + 1 + count)
    for i, axis in enumerate("xyz"):
        axes.plot(
            1e3 * (read.t_s[stamped] + moved_s - zero_s),
            read.gyro[stamped, i] / DEG,
            "x",
            color="black",
            ms=5,
            label="as stamped" if i == 0 else None,
        )
        axes.plot(1e3 * (mended.t_s[whole] - zero_s), mended.gyro[whole, i] / DEG, ".-", color=AXES[axis], lw=0.8, label=axis)
        axes.plot(
            1e3 * (mended.t_s[between] - zero_s),
            mended.gyro[between, i] / DEG,
            "o",
            mfc="white",
            color=AXES[axis],
            label="put between" if i == 0 else None,
        )
    axes.axvspan(*(1e3 * (mended.t_s[[row, row + count + 1]] - zero_s)), color=FLOOR, alpha=0.15)
    axes.set(
        xlabel=f"time from the loss at {claim.parameters['at_s'][_number(e, claim, log, row)]:.1f} s (ms)",
        ylabel="rate (dps)",
        title=f"Where it lives: {count} samples missing, and no gap in the stamps",
    )
    axes.legend(fontsize=8, ncols=2)


def closure_over_losses(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot closure as recorded and with the losses filled, over the number of losses in a segment."""
    losses = [(log, row - before) for log, row, before in _losses(e, claim)]
    inside = {
        segment.number: sum(log == segment.log and segment.start <= row < segment.stop - 1 for log, row in losses)
        for segment in e.problem.segments
    }
    recorded, (_, after) = closure_as_recorded(e), closure_by_segment(e)
    for name, colour, face, shift, closure in (("as recorded", BEFORE, BEFORE, -0.06, recorded), ("filled", AFTER, "none", 0.06, after)):
        axes.semilogy([inside[number] + shift for number in closure], list(closure.values()), "o", color=colour, mfc=face, label=name)
    axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls="--", label="floor")
    axes.set_xticks(range(max(inside.values()) + 1))
    axes.set(xlabel="losses in the segment", ylabel="closure (°)", title="Segments with a loss close once it is filled")
    axes.legend()


def _losses(e: Explanation, claim: Claim) -> list[tuple[int, int, int]]:
    """(log, last repaired row before the loss, samples filled before it in this log) of each loss, in order."""
    logs = [log.samples for log in e.mended.problem.session.logs]
    began = start_times(logs)[:-1]
    found: list[tuple[int, int, int]] = []
    for at_s in claim.parameters["at_s"]:
        log = int(np.searchsorted(began, at_s, side="right")) - 1
        row = int(np.argmin(np.abs(logs[log].t_s - (at_s - began[log]))))
        found.append((log, row, sum(each[0] == log for each in found) * claim.parameters["length"]))
    return found


def _number(e: Explanation, claim: Claim, log: int, row: int) -> int:
    return [loss[:2] for loss in _losses(e, claim)].index((log, row))


def _jump(e: Explanation, log: int, row: int, count: int) -> float:
    """Jump of the gyro's readings across a loss, rad/s."""
    gyro = e.mended.problem.session.logs[log].samples.gyro
    return float(np.linalg.norm(gyro[min(row + count + 1, len(gyro) - 1)] - gyro[row]))
