"""Panels of effects in the stills: zero-rate level, the Earth, gravity's length, creep."""

from __future__ import annotations

import numpy as np

from session.base import rotation
from session.base.rotation import unit_vectors
from session.base.units import DEG, EARTH_RATE_RPS, MDPS, MG
from session.detect.stills import CREEP_RPS, CREEP_SIGMAS, Still
from tinygc.closure.stills import StillSet
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import is_refitted
from tinygc.noise.twin import Variable, variable_of
from tinygc.reporting.drawing import Axis, Panel
from tinygc.reporting.pictures.values import (
    added_in_stills,
    at_constant,
    lengths_per_still,
    rates_per_still,
    recorded_in_stills,
    value_text,
)

BEYOND = "rate beyond the prediction (mdps)"


def in_time(e: Explanation) -> Panel:
    """Draw the rate in each still over the session, which shows drifts and steps."""
    before, after = rates_per_still(e)
    t_s, refitted = Variable("time").of_stills(e.twin), is_refitted(e)
    title = "Rate in the stills over time" + (": lines before, circles after" if refitted else "")
    panel = Panel(Axis("time (s)"), Axis(BEYOND), title).zero()
    for i, axis in enumerate("xyz"):
        if refitted:
            panel.line(t_s, before[:, i] * 1e3, axis, "thin", name=axis)
        panel.points(t_s, after[:, i] * 1e3, axis, ring=True, name=axis)
    return panel


def length_in_time(e: Explanation) -> Panel:
    """Draw the length of gravity in each still over the session."""
    panel = Panel(Axis("time (s)"), Axis("beyond one value (mg)"), "Length of gravity in the stills over time").zero()
    return panel.points(Variable("time").of_stills(e.twin), lengths_per_still(e)[1] / MG, "after", ring=True)


# An effect on the zero-rate level: the rate in each still over the effect's variable, with its law; and over its prediction.

#: inputs of an effect that follows one variable alone
READS = {"attitude": {"force"}, "temperature": {"temperature"}, "time": {"time"}}
#: points of a curve
GRID = 401


def along(e: Explanation, claim: Claim) -> Panel:
    """Draw still rates before (filled) and after (rings), and the law's curve; over gravity along each axis if each axis follows its own.

    "Before" excludes the rest of the fit, including the other columns of a matrix.
    """
    values, variable, effect = claim.theta, variable_of(claim.effect, claim.theta), claim.effect
    is_attitude = variable.variable == "attitude"
    own = is_attitude and values.size == 3
    if is_attitude and values.size == 9:
        values = np.where(np.arange(9) % 3 == variable.axis, values, 0.0)
    left = rates_per_still(e)[1] * 1e3
    recorded = left + added_in_stills(e, claim, values) * 1e3
    label = "gravity along the same axis" if own else variable.words
    title = f"Where it lives: the rate in each still over {'gravity' if is_attitude else variable.words}, and the law"
    panel = Panel(Axis(f"{label} ({variable.units})"), Axis(BEYOND), title, legend=effect.equation).zero()
    # Whether the variable alone determines the effect's contribution to a still.
    has_curve = (
        (not is_attitude or values.size in (3, 9)) and not effect.reach and set(effect.inputs) <= READS.get(variable.variable, set())
    )
    for i, axis in enumerate("xyz"):
        along_axis = Variable("attitude", i) if own else variable
        x, number = along_axis.of_stills(e.twin), i if values.size == 3 else 3 * i + (variable.axis or 0)
        value = value_text(claim, number) if effect.parameter.shape in ((3,), (3, 3)) else ""
        name = f"{axis}: {value}" if value else axis
        panel.points(x, recorded[:, i], axis, name=name).points(x, left[:, i], axis, ring=True)
        if has_curve:
            at = np.linspace(x.min(), x.max(), GRID)
            panel.line(at, at_constant(effect, values, e.twin.movements[0], along_axis, i, at) / MDPS, axis, name=name)
    return panel.points([], [], "ink", ring=True, name="after")


def against_explained(e: Explanation, claim: Claim) -> Panel:
    """Draw recorded over predicted rates, which lie on the line if the effect is the only cause."""
    predicted, recorded = added_in_stills(e, claim) * 1e3, recorded_in_stills(e, claim) * 1e3
    return on_slope_one(claim, {axis: (predicted[:, i], recorded[:, i]) for i, axis in enumerate("xyz")}, "mdps")


def on_slope_one(claim: Claim, series: dict[str, tuple[np.ndarray, np.ndarray]], unit: str) -> Panel:
    """Draw what was recorded in the stills over what an effect predicts, by colour, with the line of slope one."""
    x, y = Axis(f"{claim.effect.id} predicts ({unit})"), Axis(f"recorded in the still ({unit})")
    panel = Panel(x, y, "Recorded against explained")
    for kind, (predicted, recorded) in series.items():
        panel.points(predicted, recorded, kind, name=kind if len(series) > 1 else "")
    ends = np.concatenate([np.ravel(pair) for pair in series.values()])
    span = [ends.min(), ends.max()]
    return panel.line(span, span, "floor", "dash", name="slope 1")


# A rate fixed in the world: the stills' rates, rotated into the table's frame, cluster at one nonzero value.


def in_the_table(e: Explanation, claim: Claim, as_the_earths: bool = False) -> Panel:
    """Draw the horizontal component along the estimated rate's, and the vertical; with a circle of the Earth's rate."""
    turn, fixed = rotation.matrix(e.twin.q_tb), claim.theta
    size = np.hypot(*fixed[:2])
    ahead = np.array([*fixed[:2], 0]) / size if size > 0 else np.array([1.0, 0, 0])
    panel = Panel(
        Axis("horizontal, northward where it is the Earth (mdps)"),
        Axis("down (mdps)", down=True),
        "Where it lives: one rate, fixed in the table's frame",
        is_equal=True,
    )
    panel.zero().upright(0.0, "quiet", "hair")
    for kind, rates in (("before", recorded_in_stills(e, claim)), ("after", rates_per_still(e)[1])):
        in_table = np.einsum("qij,qj->qi", turn, rates) * 1e3
        x, y = in_table @ ahead, in_table[:, 2]
        panel.points(x, y, kind, ring=kind == "after", opacity=0.6, name=kind)
        panel.points(x.mean(), y.mean(), kind, radius=7, name=f"mean {kind}")
    if as_the_earths:
        angle, earth = np.linspace(0, 2 * np.pi, 200), EARTH_RATE_RPS / MDPS
        panel.line(earth * np.cos(angle), earth * np.sin(angle), "floor", "dash", name="the Earth's rate, 15.04 °/h")
    return panel


# An outdated pre-calibration: the length of gravity in each still, over attitude, and over the bias's prediction.

LENGTH = "length of gravity beyond one value (mg)"


def over_attitude(e: Explanation, claim: Claim) -> Panel:
    """Draw gravity's length over attitude: a bias increases it one way up, and decreases it the other.

    For each axis the bias of the others is removed; before (filled), after (rings), and the line of the bias.
    """
    after, down = lengths_per_still(e)[1], unit_vectors(e.twin.force)
    title = "Where it lives: gravity's length changes with attitude"
    panel = Panel(Axis("gravity along the same axis (g)"), Axis(LENGTH), title, legend=claim.effect.equation).zero()
    for number, (axis, bias) in enumerate(zip("xyz", claim.theta, strict=False)):
        x, name = Variable("attitude", number).of_stills(e.twin), f"{axis}: {value_text(claim, number)}"
        ends = np.array([x.min(), x.max()])
        panel.points(x, (after + down[:, number] * bias) / MG, axis, name=name).points(x, after / MG, axis, ring=True)
        panel.line(ends, -ends * bias / MG, axis, name=name)
    return panel.points([], [], "ink", ring=True, name="after")


def _length_explained(e: Explanation, claim: Claim) -> np.ndarray:
    """(Q,) m/s^2 that an effect of the accelerometer adds to gravity's length in each still."""
    down = unit_vectors(e.twin.force)
    return np.sum(down * (e.twin.bent(claim.effect, e.twin.rests) @ claim.theta), axis=1)


def length_over_conditions(e: Explanation, claim: Claim) -> Panel:
    """Draw gravity's length in each still along the effect's variable, before (filled) and after (rings)."""
    variable = variable_of(claim.effect, claim.theta)
    x, after = variable.of_stills(e.twin), lengths_per_still(e)[1] / MG
    axes = Axis(f"{variable.words} ({variable.units})"), Axis(LENGTH)
    panel = Panel(*axes, "Where it lives: gravity's length in each still", legend=claim.effect.equation).zero()
    panel.points(x, after + _length_explained(e, claim) / MG, "before", name="before")
    return panel.points(x, after, "after", ring=True, name="after")


def length_against_explained(e: Explanation, claim: Claim) -> Panel:
    """Draw the recorded over the predicted change of gravity's length in each attitude."""
    predicted = _length_explained(e, claim) / MG
    return on_slope_one(claim, {"after": (predicted, predicted + lengths_per_still(e)[1] / MG)}, "mg")


# Stills with movement: the angle by which the body turns in each, and its rate against the threshold.


def turned_angle(e: Explanation, claim: Claim) -> Panel:
    """Draw the integral of the gyro less its usual zero-rate level in each still; it drifts away in those that were not still."""
    axes = Axis("time within the still (s)"), Axis("turned since it began (°)")
    panel = Panel(*axes, "Where it lives: the body turns while it should be still")
    stills, moving, zero = list(enumerate(_stills(e))), set(claim.parameters["stills"]), _zero(e, claim)
    for number, (log, still) in sorted(stills, key=lambda each: each[0] in moving):
        rate = log.samples.gyro[still.start : still.stop] - zero
        angle = np.linalg.norm(np.cumsum(rate, axis=0), axis=1) * log.samples.period_s / DEG
        look = {"kind": "bad", "name": "not still"} if number in moving else {"kind": "quiet", "style": "thin", "name": "still"}
        panel.line(np.arange(len(angle)) * log.samples.period_s, angle, **look)
    return panel


def rate_against_bar(e: Explanation, claim: Claim) -> Panel:
    """Draw rates from gravity and from the gyro, and the threshold for noise of gravity."""
    zero, stills = _zero(e, claim), _stills(e)
    numbers = np.arange(len(stills))
    bad = np.isin(numbers, claim.parameters["stills"])
    by_gravity = np.array([np.linalg.norm(still.tilt_rate) for _, still in stills]) / DEG
    by_gyro = np.array([np.linalg.norm(still.gyro_mean - zero) for _, still in stills]) / DEG
    panel = Panel(Axis("still"), Axis("turns at (dps)", log=True), "Rate within each still")
    for which, kind, name in ((~bad, "after", "still"), (bad, "bad", "not still")):
        panel.points(numbers[which], by_gyro[which], kind, name=f"{name}, by the gyro")
        panel.points(numbers[which], by_gravity[which], kind, ring=True, name=f"{name}, by gravity")
    bars = np.repeat([_bar(log, still) / DEG for log, still in stills], 2)
    return panel.line(np.repeat(np.arange(len(stills) + 1) - 0.5, 2)[1:-1], bars, "floor", "dash", name="bar for gravity")


def _stills(e: Explanation) -> list[tuple[StillSet, Still]]:
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
