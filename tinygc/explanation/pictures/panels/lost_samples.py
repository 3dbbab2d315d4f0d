"""Lost samples behind closed-up stamps: one loss as stamped and as it was, and closure over the losses in a segment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from session.log.samples import start_times
from tinygc.explanation.pictures.channel_values import closure_as_recorded, closure_by_segment
from tinygc.explanation.pictures.panels.palette import AFTER, AXES, BEFORE, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AROUND = 15  #: samples on either side


def one_loss(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The loss with the greatest jump: black crosses as stamped, dots where they belong, rings what was put between."""
    count = claim.parameters["length"]
    log, row, before = max(_losses(e, claim), key=lambda loss: _jump(e, loss[0], loss[1], count))
    read, mended = e.session.logs[log].samples, e.mended.problem.session.logs[log].samples
    start, stop = max(row - before - AROUND, 0), row - before + AROUND
    zero_s = mended.t_s[row]
    stamped = np.arange(start, min(stop, len(read)))
    moved_s = before * read.period_s  # what earlier losses of this log moved the later stamps by
    whole = np.arange(max(row - AROUND, 0), min(row + count + AROUND, len(mended)))
    between = np.arange(row + 1, row + 1 + count)
    for i, axis in enumerate("xyz"):
        axes.plot(
            1e3 * (read.t_s[stamped] + moved_s - zero_s),
            read.gyro[stamped, i] / DEG,
            "x",
            color="black",
            ms=5,
            label=_once(i, "as stamped"),
        )
        axes.plot(1e3 * (mended.t_s[whole] - zero_s), mended.gyro[whole, i] / DEG, ".-", color=AXES[axis], lw=0.8, label=axis)
        axes.plot(
            1e3 * (mended.t_s[between] - zero_s),
            mended.gyro[between, i] / DEG,
            "o",
            mfc="white",
            color=AXES[axis],
            label=_once(i, "put between"),
        )
    axes.axvspan(*(1e3 * (mended.t_s[[row, row + count + 1]] - zero_s)), color=FLOOR, alpha=0.15)
    axes.set(
        xlabel=f"time from the loss at {claim.parameters['at_s'][_number(e, claim, log, row)]:.1f} s (ms)",
        ylabel="rate (dps)",
        title=f"Where it lives: {count} samples missing, and no gap in the stamps",
    )
    axes.legend(fontsize=8, ncols=2)


def closure_over_losses(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Closure as recorded and with the losses filled, over how many losses a segment has."""
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
    """(log, last mended row before the loss, samples put back before it in this log) of each loss, in order."""
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
    """How far the gyro's readings on either side of a loss are apart, rad/s."""
    gyro = e.mended.problem.session.logs[log].samples.gyro
    return float(np.linalg.norm(gyro[min(row + count + 1, len(gyro) - 1)] - gyro[row]))


def _once(i: int, label: str) -> str | None:
    return label if i == 0 else None
