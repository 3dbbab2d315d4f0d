"""Panels of register faults: clipping, false readings, lost samples."""

from __future__ import annotations

import numpy as np

from session.base.units import DEG
from session.detect.segments import Segment
from session.log.samples import start_times
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.faulty_readings import find_glitches, without_glitches
from tinygc.explanation.result import reading_s
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.pictures.values import closure_as_recorded, closure_by_segment

# Clipping: readings at the clipping level, and their effect on closure.


def one_turn(e: Explanation, claim: Claim) -> Panel:
    """Draw the turn that stays at the clipping level longest, with the level."""
    level = claim.parameters["dps"]
    least = level - claim.std["dps"]

    def at_level(segment: Segment) -> np.ndarray:
        rate = _rate_dps(e, segment)
        return (np.abs(rate) >= least).sum(axis=0)

    segment = max(e.problem.segments, key=lambda segment: at_level(segment).max())
    t_s, rate, axis = _t_s(e, segment), _rate_dps(e, segment), int(np.argmax(at_level(segment)))
    number = f"segment {segment.number}, log {segment.log + 1}" if len(e.problem.logs) > 1 else f"segment {segment.number}"
    axes = Axis(f"time in {number} (s)"), Axis("rate as read (dps)")
    panel = Panel(*axes, f"Where it lives: {'xyz'[axis]} stops at {level:.4g} dps")
    for sign in (-1, 1):
        panel.across(sign * level, name=f"±{level:.4g} dps")
    for i, name in enumerate("xyz"):
        panel.line(t_s, rate[:, i], name, "line" if i == axis else "thin", name=name)
    stuck = np.abs(rate[:, axis]) >= least
    return panel.points(t_s[stuck], rate[stuck, axis], "ink", name=f"{'xyz'[axis]} at the level")


def closure_over_peak(e: Explanation, claim: Claim) -> Panel:
    """Draw each segment's closure as recorded over its largest reading: clipped segments do not close."""
    level, closure = claim.parameters["dps"], closure_as_recorded(e)
    left = {segment.number for segment in e.twin.segments}
    peak = np.array([np.abs(_rate_dps(e, segment)).max() for segment in e.problem.used])
    y = np.array([closure[segment.number] for segment in e.problem.used])
    out = np.array([segment.number not in left for segment in e.problem.used])
    axes = Axis("greatest reading of the segment (dps)"), Axis("closure as recorded (°)", log=True)
    panel = Panel(*axes, "Segments at the level do not close")
    panel.upright(level, name=f"{level:.4g} dps").across(e.proof.floor_rms / DEG, style="thin", name="noise floor")
    return panel.points(peak[~out], y[~out], "after", name="used").points(peak[out], y[out], "bad", name="left out")


def _rate_dps(e: Explanation, segment: Segment) -> np.ndarray:
    return e.problem.logs[segment.log].samples.gyro[segment.start : segment.stop] / DEG


def _t_s(e: Explanation, segment: Segment) -> np.ndarray:
    t_s = e.problem.logs[segment.log].samples.t_s[segment.start : segment.stop]
    return t_s - t_s[0]


# False readings: one of them with its interpolation, and all of them over the session.

AROUND = 12  #: samples on either side


def one_reading(e: Explanation, claim: Claim) -> Panel:
    """Draw the largest false reading: as read, false samples marked, and the interpolation across them."""
    log, first, count, _ = max(_runs(e, claim), key=lambda run: np.abs(run[3]).max())
    read, bridged = e.session.logs[log].samples.gyro / DEG, _bridged(e, log)
    rows = np.arange(max(first - AROUND, 0), min(first + count + AROUND, len(read)))
    false, across = np.arange(first, first + count), np.arange(first - 1, first + count + 1)
    axes = Axis(f"row of {e.session.logs[log].path.name}"), Axis("rate (dps)")
    panel = Panel(*axes, f"Where it lives: a false reading of {count} samples")
    panel.area([first - 0.5, first + count - 0.5], -np.inf, np.inf, "floor", is_measure=False)
    for i, axis in enumerate("xyz"):
        panel.line(rows, read[rows, i], axis, "thin", name=axis).points(rows, read[rows, i], axis, radius=1.6, name=axis)
        panel.points(false, read[false, i], axis, radius=4.5, name="false")
        panel.line(across, bridged[across, i], axis, "dash").points(across, bridged[across, i], axis, ring=True, name="bridge")
    return panel


def all_readings(e: Explanation, claim: Claim) -> Panel:
    """Draw the deviation of each false reading from its interpolation, over the session."""
    t_s = reading_s(e, np.array(claim.parameters["at"], dtype=int))
    size = np.array([off[np.argmax(np.abs(off), axis=0), range(3)] for _, _, _, off in _runs(e, claim)])
    panel = Panel(Axis("time of the session (s)"), Axis("false less bridge (dps)"), f"All {len(t_s)} false readings").zero()
    for i, axis in enumerate("xyz"):
        panel.line(np.repeat(t_s, 3), np.stack([0 * t_s, size[:, i], np.nan * t_s], axis=1).ravel(), axis, "thin")
        panel.points(t_s, size[:, i], axis, name=axis)
    return panel


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


def one_loss(e: Explanation, claim: Claim) -> Panel:
    """Draw the loss with the largest jump: black dots as stamped, lines at the true times, rings for the filled samples."""
    count = claim.parameters["length"]
    log, row, before = max(_losses(e, claim), key=lambda loss: _jump(e, loss[0], loss[1], count))
    read, repaired = e.session.logs[log].samples, e.repaired.problem.session.logs[log].samples
    stamped = np.arange(max(row - before - AROUND_LOSS, 0), min(row - before + AROUND_LOSS, len(read)))
    moved_s = before * read.period_s  # shift of the later stamps by earlier losses of this log
    whole = np.arange(max(row - AROUND_LOSS, 0), min(row + count + AROUND_LOSS, len(repaired)))
    between, zero_s = np.arange(row + 1, row + 1 + count), repaired.t_s[row]
    x = Axis(f"time from the loss at {claim.parameters['at_s'][_number(e, claim, log, row)]:.1f} s (ms)")
    panel = Panel(x, Axis("rate (dps)"), f"Where it lives: {count} samples missing, and no gap in the stamps")
    panel.area(1e3 * (repaired.t_s[[row, row + count + 1]] - zero_s), -np.inf, np.inf, "floor", is_measure=False)
    for i, axis in enumerate("xyz"):
        panel.line(1e3 * (repaired.t_s[whole] - zero_s), repaired.gyro[whole, i] / DEG, axis, name=axis)
        panel.points(1e3 * (read.t_s[stamped] + moved_s - zero_s), read.gyro[stamped, i] / DEG, "ink", radius=1.8, name="as stamped")
        panel.points(1e3 * (repaired.t_s[between] - zero_s), repaired.gyro[between, i] / DEG, axis, ring=True, name="put between")
    return panel


def closure_over_losses(e: Explanation, claim: Claim) -> Panel:
    """Draw closure as recorded and with the losses filled, over the number of losses in a segment."""
    losses = [(log, row - before) for log, row, before in _losses(e, claim)]
    inside = {
        segment.number: sum(log == segment.log and segment.start <= row < segment.stop - 1 for log, row in losses)
        for segment in e.problem.segments
    }
    x = Axis("losses in the segment", ticks=[(count, str(count)) for count in range(max(inside.values()) + 1)])
    panel = Panel(x, Axis("closure (°)", log=True), "Segments with a loss close once it is filled")
    panel.across(e.proof.floor_rms / DEG, name="noise floor")
    for name, kind, shift, closure in (
        ("as recorded", "before", -0.06, closure_as_recorded(e)),
        ("filled", "after", 0.06, closure_by_segment(e)[1]),
    ):
        panel.points([inside[number] + shift for number in closure], list(closure.values()), kind, ring=shift > 0, name=name)
    return panel


def _losses(e: Explanation, claim: Claim) -> list[tuple[int, int, int]]:
    """(log, last repaired row before the loss, samples filled before it in this log) of each loss, in order."""
    logs = [log.samples for log in e.repaired.problem.session.logs]
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
    gyro = e.repaired.problem.session.logs[log].samples.gyro
    return float(np.linalg.norm(gyro[min(row + count + 1, len(gyro) - 1)] - gyro[row]))
