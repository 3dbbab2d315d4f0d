"""Panels of effects in the stills: zero-rate level, the Earth, gravity's length, creep."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base import rotation
from session.base.rotation import unit_vectors
from session.base.units import DEG, EARTH_RATE_RPS, MDPS, MG
from session.detect.stills import CREEP_RPS, CREEP_SIGMAS, Still
from tinygc.closure.stills import StillSet
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.noise.twin import Variable, variable_of
from tinygc.reporting.pictures.canvas import AFTER, AXES, BEFORE, FLOOR, PALE, legend, value_text, zero_line
from tinygc.reporting.pictures.values import (
    added_in_stills,
    at_constant,
    lengths_per_still,
    rates_per_still,
    recorded_in_stills,
    theta,
    variable_for,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# An effect on the zero-rate level: the rate in each still over the effect's variable, with its law; and over its prediction.

#: inputs of an effect that follows one variable alone
READS = {"attitude": {"force"}, "temperature": {"temperature"}, "time": {"time"}}
#: points of a curve
GRID = 401


def along(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot still rates before (filled) and after (rings), and the law's curve; over gravity along each axis if each axis follows its own.

    "Before" excludes the rest of the fit, including the other columns of a matrix.
    """
    values, variable = theta(e, claim), variable_for(e, claim)
    own = variable.variable == "attitude" and values.size == 3
    if variable.variable == "attitude" and values.size == 9:
        values = np.where(np.arange(9) % 3 == variable.axis, values, 0.0)
    _, left = rates_per_still(e)
    recorded = left + added_in_stills(e, claim, values)
    for i, axis in enumerate("xyz"):
        along_axis = Variable("attitude", i) if own else variable
        x = along_axis.of_stills(e.twin)
        axes.plot(x, recorded[:, i] * 1e3, "o", color=AXES[axis], ms=4)
        axes.plot(x, left[:, i] * 1e3, "o", mfc="none", color=AXES[axis], ms=4)
        # Whether the variable alone determines the effect's contribution to a still.
        effect = claim.effect
        one = variable.variable != "attitude" or values.size in (3, 9)
        if one and not effect.reach and set(effect.inputs) <= READS.get(variable.variable, set()):
            at = np.linspace(x.min(), x.max(), GRID)
            curve = at_constant(claim.effect, values, e.twin.movements[0], along_axis, i, at) / DEG
            axes.plot(at, curve * 1e3, color=AXES[axis], lw=1.5)
        number = i if values.size == 3 else 3 * i + (variable.axis or 0)
        value = value_text(claim, number) if claim.effect.parameter.shape in ((3,), (3, 3)) else ""
        axes.plot([], [], "o-", color=AXES[axis], label=f"{axis}: {value}" if value else axis)
    axes.plot([], [], "o", mfc="none", color="black", label="after")
    zero_line(axes)
    label = "gravity along the same axis" if own else variable.words
    over = "gravity" if variable.variable == "attitude" else variable.words
    axes.set(
        xlabel=f"{label} ({variable.units})",
        ylabel="rate beyond the prediction (mdps)",
        title=f"Where it lives: the rate in each still over {over}, and the law",
    )
    legend(axes, claim.effect.equation)


def against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot recorded over predicted rates, which lie on the line if the effect is the only cause."""
    says, recorded = added_in_stills(e, claim) * 1e3, recorded_in_stills(e, claim) * 1e3
    for i, axis in enumerate("xyz"):
        axes.plot(says[:, i], recorded[:, i], "o", color=AXES[axis], label=axis, ms=4)
    span = [np.min([says, recorded]), np.max([says, recorded])]
    axes.plot(span, span, color=FLOOR, lw=0.8, label="slope 1")
    axes.set(xlabel=f"{claim.effect.id} says (mdps)", ylabel="recorded in the still (mdps)", title="Recorded against explained")
    axes.legend()


# A rate fixed in the world: the stills' rates, rotated into the table's frame, cluster at one nonzero value.


def in_the_table(e: Explanation, claim: Claim, axes: Axes, as_the_earths: bool = False) -> None:
    """Plot the horizontal component along the estimated rate's, and the vertical; with a circle of the Earth's rate."""
    turn, fixed = rotation.matrix(e.twin.q_tb), theta(e, claim)
    size = np.hypot(*fixed[:2])
    ahead = np.array([*fixed[:2], 0]) / size if size > 0 else np.array([1.0, 0, 0])
    _, left = rates_per_still(e)
    for name, colour, fill, rates in (("before", BEFORE, BEFORE, recorded_in_stills(e, claim)), ("after", AFTER, "none", left)):
        in_table = np.einsum("qij,qj->qi", turn, rates) * 1e3
        x, y = in_table @ ahead, in_table[:, 2]
        axes.plot(x, y, "o", color=colour, mfc=fill, ms=4, alpha=0.6)
        axes.plot(x.mean(), y.mean(), "P", color=colour, mec="black", ms=13, label=f"mean {name}")
    if as_the_earths:
        angle = np.linspace(0, 2 * np.pi, 200)
        earth = EARTH_RATE_RPS / MDPS
        axes.plot(earth * np.cos(angle), earth * np.sin(angle), color=FLOOR, ls="--", label="the Earth's rate, 15.04 °/h")
    axes.axhline(0, color=FLOOR, lw=0.6)
    axes.axvline(0, color=FLOOR, lw=0.6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set(
        xlabel="horizontal, northward where it is the Earth (mdps)",
        ylabel="down (mdps)",
        title="Where it lives: one rate, fixed in the table's frame",
    )
    axes.legend(fontsize=8)


# An outdated pre-calibration: the length of gravity in each still, over attitude, and over the bias's prediction.


def over_attitude(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot gravity's length over attitude: a bias increases it one way up, and decreases it the other.

    For each axis the bias of the others is removed; before (filled), after (rings), and the line of the bias.
    """
    _, after = lengths_per_still(e)
    down = unit_vectors(e.twin.force)
    for number, (axis, colour) in enumerate(AXES.items()):
        bias = theta(e, claim)[number]
        x = Variable("attitude", number).of_stills(e.twin)
        axes.plot(x, (after + down[:, number] * bias) / MG, "o", color=colour, ms=4)
        axes.plot(x, after / MG, "o", mfc="none", color=colour, ms=4)
        ends = np.array([x.min(), x.max()])
        axes.plot(ends, -ends * bias / MG, "-", color=colour, lw=1.5, label=f"{axis}: {value_text(claim, number)}")
    axes.plot([], [], "o", mfc="none", color="black", label="after")
    zero_line(axes)
    axes.set(
        xlabel="gravity along the same axis (g)",
        ylabel="length of gravity beyond one value (mg)",
        title="Where it lives: gravity's length changes with attitude",
    )
    legend(axes, claim.effect.equation)


def _length_explained(e: Explanation, claim: Claim) -> np.ndarray:
    """(Q,) m/s^2 that an effect of the accelerometer adds to gravity's length in each still."""
    down = unit_vectors(e.twin.force)
    return np.sum(down * (e.twin.bent(claim.effect, e.twin.rests) @ theta(e, claim)), axis=1)


def length_over_conditions(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot gravity's length in each still along the effect's variable, before (filled) and after (rings)."""
    variable = variable_of(claim.effect, theta(e, claim))
    x, after = variable.of_stills(e.twin), lengths_per_still(e)[1] / MG
    axes.plot(x, after + _length_explained(e, claim) / MG, "o", color=BEFORE, ms=4, label="before")
    axes.plot(x, after, "o", color=AFTER, mfc="none", ms=4, label="after")
    zero_line(axes)
    axes.set(
        xlabel=f"{variable.words} ({variable.units})",
        ylabel="length of gravity beyond one value (mg)",
        title="Where it lives: gravity's length in each still",
    )
    legend(axes, claim.effect.equation)


def length_against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot the recorded over the predicted change of gravity's length in each attitude."""
    says = _length_explained(e, claim) / MG
    recorded = says + lengths_per_still(e)[1] / MG
    axes.plot(says, recorded, "o", color=AFTER, ms=4)
    span = [min(says.min(), recorded.min()), max(says.max(), recorded.max())]
    axes.plot(span, span, color=FLOOR, lw=0.8)
    axes.set(xlabel=f"{claim.effect.id} says (mg)", ylabel="recorded in the still (mg)", title="Recorded against explained")


# Stills with movement: the angle by which the body turns in each, and its rate against the threshold.


def turned_angle(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot the integral of the gyro less its usual zero-rate level in each still; it drifts away in those that were not still."""
    moving, zero = set(claim.parameters["stills"]), _zero(e, claim)
    for number, (log, still) in enumerate(_stills(e)):
        rate = log.samples.gyro[still.start : still.stop] - zero
        angle = np.linalg.norm(np.cumsum(rate, axis=0), axis=1) * log.samples.period_s / DEG
        bad = number in moving
        t_s = np.arange(len(angle)) * log.samples.period_s
        axes.plot(t_s, angle, color=BEFORE if bad else PALE, lw=1.4 if bad else 0.8, zorder=2 if bad else 1, label=_label(axes, bad))
    axes.set(
        xlabel="time within the still (s)",
        ylabel="turned since it began (°)",
        title="Where it lives: the body turns while it should be still",
    )
    axes.legend(fontsize=8)


def rate_against_bar(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot rates from gravity and from the gyro, and the threshold for noise of gravity."""
    zero, stills = _zero(e, claim), _stills(e)
    numbers = np.arange(len(stills))
    bad = np.isin(numbers, claim.parameters["stills"])
    by_gravity = np.array([np.linalg.norm(still.tilt_rate) for _, still in stills]) / DEG
    by_gyro = np.array([np.linalg.norm(still.gyro_mean - zero) for _, still in stills]) / DEG
    for which, colour, name in ((~bad, AFTER, "still"), (bad, BEFORE, "not still")):
        axes.semilogy(numbers[which], by_gyro[which], "o", color=colour, label=f"{name}, by the gyro")
        axes.semilogy(numbers[which], by_gravity[which], "^", mfc="none", color=colour, label=f"{name}, by gravity")
    axes.step(numbers, [_bar(log, still) / DEG for log, still in stills], where="mid", color=FLOOR, ls="--", label="bar for gravity")
    axes.set(xlabel="still", ylabel="turns at (dps)", title="Rate within each still")
    axes.legend(fontsize=8, ncols=2)


def _stills(e: Explanation) -> list[tuple]:
    """(log, still) pairs of all logs, in the order of their numbers."""
    return [(log, still) for log in e.problem.logs for still in log.stills]


def _zero(e: Explanation, claim: Claim) -> np.ndarray:
    """Median reading of the gyro at rest, (3,) rad/s."""
    good = [still.gyro_mean for number, (_, still) in enumerate(_stills(e)) if number not in claim.parameters["stills"]]
    return np.median(good or [still.gyro_mean for _, still in _stills(e)], axis=0)


def _bar(log: StillSet, still: Still) -> float:
    """Threshold of the first look for gravity's rate of turn by noise in this still, rad/s (``session.detect.stills``)."""
    sigma = float(log.noise.velocity_random_walk.max()) * np.sqrt(12 / still.duration_s**3) / still.gravity_mps2
    return max(CREEP_SIGMAS * sigma, CREEP_RPS)


def _label(axes: Axes, bad: bool) -> str | None:
    name = "not still" if bad else "still"
    return None if name in axes.get_legend_handles_labels()[1] else name
