"""Output of a gyroscope's fit by known turns: text, JSON and files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session import VERSION
from session.base.files import result_folder
from session.base.records import plain, write_whole
from session.base.texts import degrees, printable, probability, significant
from session.base.units import DEG
from tinygc import models
from tinygc.features.turns.angles import TERMS, TurnAngle
from tinygc.features.turns.estimate import SURE, Component
from tinygc.features.turns.result import AxisScale, TurnsResult
from tinygc.models.linear import NAMES
from tinygc.models.model import sensor_table
from tinygc.reporting.terminal import Group, RenderableType, Text, plain_table

SCHEMA = "tinygc-turns/1"
MODEL, FIGURES = "model_turns.json", "turns.json"
SENSES = {1: "+", -1: "−", 0: "±"}
#: turns of one cell of the table of repeats turn at rates within this of their median
ALIKE = 0.2
#: a miss is explained by gaps where the two agree within so many sigmas
EXPLAINED = 3.0


@dataclass(frozen=True, eq=False)
class Repeats:
    """Turns of one axis, sense, stated angle and rate that are used: how many, their mean and standard deviation, rad."""

    axis: int
    sense: int
    stated_rad: float
    rate_rps: float
    count: int
    mean_rad: float
    sigma_rad: float


def repeats(fit: TurnsResult) -> list[Repeats]:
    """Cells of two turns or more, in the order of axis, sense, angle and rate."""
    cells: list[list[TurnAngle]] = []
    used = [angle for angle, good in zip(fit.angles, fit.estimate.used, strict=True) if good]
    for angle in sorted(used, key=lambda angle: (angle.axis, -angle.sense, round(angle.stated_rad / DEG, 6), angle.rate_rps)):
        first = cells[-1][0] if cells else None
        same = (
            first is not None and (first.axis, first.sense) == (angle.axis, angle.sense) and abs(first.stated_rad - angle.stated_rad) < 1e-6
        )
        if first is not None and same and angle.rate_rps <= (1 + ALIKE) * first.rate_rps:
            cells[-1].append(angle)
        else:
            cells.append([angle])
    return [
        Repeats(
            cell[0].axis,
            cell[0].sense,
            cell[0].stated_rad,
            float(np.median([angle.rate_rps for angle in cell])),
            len(cell),
            float(np.mean([angle.measured_rad for angle in cell])),
            float(np.std([angle.measured_rad for angle in cell], ddof=1)),
        )
        for cell in cells
        if len(cell) > 1
    ]


def lost_words(fit: TurnsResult, number: int) -> str:
    """What is known of a turn that is lost, or may be: its miss, its probability, and what could be the cause."""
    angle, estimate = fit.angles[number], fit.estimate
    miss, sigma, lost = (float(values[number]) for values in (estimate.residual_rad, estimate.predicted_rad, estimate.lost))
    name = f"{angle.turn.name} ({angle.turn.says})"
    sure = "above 0.9999" if lost > 0.9999 else significant(lost, 2)
    if not np.isfinite(miss):
        return f"{name}: reads {degrees(angle.measured_rad)}, and no turn of its axis and sense is good"
    text = f"{name}: misses by {significant(miss / DEG)} ± {significant(sigma / DEG, 2)}°, lost with probability {sure}: "
    if estimate.used[number]:
        return f"{text}used, since that is not {SURE:g} times as probable as that it is good"
    if miss > 0:
        return f"{text}it turned by more than is stated; is the stated angle right?"
    seconds = -miss / angle.rate_rps
    amount = f"{significant(seconds, 2)} s at its {significant(angle.rate_rps / DEG)} dps, {seconds / angle.period_s:.0f} samples"
    if angle.lost_s and abs(angle.lost_s - seconds) < EXPLAINED * sigma / angle.rate_rps + angle.period_s:
        return f"{text}{amount}; gaps in its stamps lack {significant(angle.lost_s, 2)} s: lost samples"
    gap = f"gaps in its stamps lack only {significant(angle.lost_s, 2)} s" if angle.lost_s else "no gap in its stamps"
    return f"{text}{amount}, {gap}: lost samples or lost steps of the table, undecided"


def remarks(fit: TurnsResult) -> list[str]:
    """What is not claimed, and why; turns that were left out; what was done to the stamps."""
    estimate = fit.estimate
    named = [not used or lost > 0.5 for used, lost in zip(estimate.used, estimate.lost, strict=True)]
    lines = [lost_words(fit, i) for i, angle in enumerate(fit.angles) if angle.problem is None and named[i]]
    lines += [f"{angle.turn.name} ({angle.turn.says}): not used: {angle.problem}" for angle in fit.angles if angle.problem]
    turned = {axis: [sense for other, sense in estimate.groups if other == axis] for axis in range(3)}
    if still := [name for axis, name in enumerate("xyz") if not turned[axis]]:
        lines.append(f"scale of {', '.join(still)}: not known, no turn about it")
    if single := [f"{name} ({SENSES[-turned[axis][0]]})" for axis, name in enumerate("xyz") if len(turned[axis]) == 1]:
        lines.append(f"not known, since not turned: the other sense of {', '.join(single)}, and so the asymmetry")
    if estimate.groups and not any(len(senses) > 1 for senses in turned.values()):
        lines.append(
            "backlash of the table: not known, since turns of one sense take it up once; the play above is another error of each turn"
        )
    lines.append("misalignments, and what follows gravity: not known, no turn tells them from the table's lean")
    if (rate := fit.session.nominal_rate) is not None:
        lines.append(rate.doubt)
    if bursts := sum(log.times.bursts for log in fit.logs):
        lines.append(f"stamps of {bursts} log{'s' * (bursts != 1)} came in bursts: samples were spaced evenly between gaps")
    for log in fit.logs:
        if log.other is not None and log.other.is_open:
            taken, other = ("bursts", "lost samples") if log.times.bursts else ("lost samples", "bursts")
            apart = f"{log.other.apart_rad / DEG:.2g}°"
            lines.append(
                f"{log.log.path.name}: its stamps are taken for those of {taken}; as {other} turns differ by up to {apart}, undecided"
            )
        elif log.other is not None and not log.times.bursts:
            lines.append(f"{log.log.path.name}: samples are lost, none came in bursts: as stamped its turns repeat better")
    return [printable(line) for line in lines]  # a log may have any name


def turns_report(fit: TurnsResult) -> Group:
    """The report of ``fit`` for the terminal."""
    estimate = fit.estimate
    used, stated = int(estimate.used.sum()), len(fit.angles)
    parts: list[RenderableType] = [Text(f"{fit.session.name}: a gyroscope alone, {used} of {stated} stated turns used", "bold")]
    table = plain_table("Scale factor error, measured / true − 1", "axis", "%", "± (1 σ)", "turns", "own axis ± (1 σ)", right=True)
    for scale in fit.scales:
        row = (scale.value, scale.sigma)
        table.add_row(_axis(scale), *(significant(100 * x) for x in row), str(scale.turns), significant(100 * scale.axis_bound, 2))
    parts.append(table)
    for axis, (value, sigma) in fit.asymmetry.items():
        parts.append(Text(f"asymmetry of {'xyz'[axis]}, (+ − −) / mean: {significant(100 * value)} ± {significant(100 * sigma, 2)} %"))
    bias = plain_table(f"At rest, {fit.bias.rests} rests", "axis", "dps", "± (1 σ)", "from rest to rest", right=True)
    for axis, name in enumerate("xyz"):
        bias.add_row(name, *(significant(float(x[axis]) / DEG, 2) for x in (fit.bias.mean, fit.bias.sigma, fit.bias.wander)))
    parts.append(bias)
    if estimate.dof:
        fits = "explain the spread" if estimate.p_value > 0.01 else "do not explain the spread"
        parts.append(
            Text(
                f"stated sigmas and the gyroscope's own errors {fits}: chi-square {significant(estimate.chi2)} of {estimate.dof}, "
                f"{probability(estimate.p_value)}"
            )
        )
        parts.append(Text(f"play, a further error of each turn: {_component(estimate.play, DEG, '°')}"))
        parts.append(Text(f"repeat, a further error that grows with the angle: {_component(estimate.repeat, 0.01, ' %')}"))
    else:
        parts.append(Text("no turn repeats another: play is not known, and the stated sigmas are taken as they are"))
    if cells := repeats(fit):
        table = plain_table("Repeats", "axis", "stated °", "dps", "turns", "mean °", "std °", right=True)
        for cell in cells:
            words = (significant(cell.stated_rad / DEG), significant(cell.rate_rps / DEG), str(cell.count), f"{cell.mean_rad / DEG:.2f}")
            table.add_row(f"{'xyz'[cell.axis]} {SENSES[cell.sense]}", *words, significant(cell.sigma_rad / DEG, 2))
        parts.append(table)
    return Group(*parts, *(Text(line) for line in remarks(fit)))


def _axis(scale: AxisScale) -> str:
    return f"{'xyz'[scale.axis]} {SENSES[scale.sense]}"


def _component(found: Component, unit: float, name: str) -> str:
    if found.low <= found.median / 10:
        return f"below {significant(found.upper / unit, 2)}{name} (95 %)"
    median, low, high = (significant(x / unit, 2) for x in (found.median, found.low, found.high))
    return f"{median}{name} ({low} to {high})"


def to_json(fit: TurnsResult) -> dict:
    """``tinygc-turns/1``."""
    estimate = fit.estimate

    def component(found: Component, unit: float) -> dict | None:
        names = ("median", "low", "high", "upper")
        return {name: getattr(found, name) / unit for name in names} if found.estimated else None

    turns = [
        {
            "log": angle.log,
            "turn": angle.turn.turn,
            "axis": angle.turn.words,
            "stated_deg": angle.turn.angle_rad / DEG,
            "stated_sigma_deg": angle.turn.sigma_rad / DEG,
            "measured_deg": np.sign(angle.turn.angle_rad) * angle.measured_rad / DEG,
            "table_axis": None if angle.problem else angle.direction,
            "rate_dps": angle.rate_rps / DEG,
            "duration_s": angle.duration_s,
            "miss_deg": estimate.residual_rad[i] / DEG,
            "miss_sigma_deg": estimate.predicted_rad[i] / DEG,
            "lost_probability": estimate.lost[i],
            "lost_s": angle.lost_s,
            "used": bool(estimate.used[i]),
            "problem": angle.problem,
            "gyro_sigma_deg": {name: float(np.sqrt(angle.variance[name])) / DEG for name in TERMS} if angle.variance else None,
        }
        for i, angle in enumerate(fit.angles)
    ]
    return plain(
        {
            "schema": SCHEMA,
            "version": VERSION,
            "session": fit.session.name,
            "sha256": fit.sha256,
            "scale": [
                {
                    "axis": "xyz"[scale.axis],
                    "sense": "+" if scale.sense > 0 else "-",
                    "error_ppm": scale.value * 1e6,
                    "sigma_ppm": scale.sigma * 1e6,
                    "own_axis_within_ppm": scale.axis_bound * 1e6,
                    "turns": scale.turns,
                }
                for scale in fit.scales
            ],
            "scale_covariance_ppm2": fit.covariance * 1e12,
            "asymmetry": [
                {"axis": "xyz"[axis], "value_ppm": value * 1e6, "sigma_ppm": sigma * 1e6} for axis, (value, sigma) in fit.asymmetry.items()
            ],
            "bias": {
                "mean_dps": fit.bias.mean / DEG,
                "sigma_dps": fit.bias.sigma / DEG,
                "wander_dps": fit.bias.wander / DEG,
                "rests": fit.bias.rests,
            },
            "play_deg": component(estimate.play, DEG),
            "repeat_ppm": component(estimate.repeat, 1e-6),
            "chi_square": {"value": estimate.chi2, "dof": estimate.dof, "p": estimate.p_value},
            "repeats": [
                {
                    "axis": "xyz"[cell.axis],
                    "sense": "+" if cell.sense > 0 else "-",
                    "stated_deg": cell.stated_rad / DEG,
                    "rate_dps": cell.rate_rps / DEG,
                    "turns": cell.count,
                    "mean_deg": cell.mean_rad / DEG,
                    "std_deg": cell.sigma_rad / DEG,
                }
                for cell in repeats(fit)
            ],
            "turns": turns,
            "remarks": remarks(fit),
        }
    )


def model_table(fit: TurnsResult) -> dict:
    """``tinygc-model/1``, linear, with its covariance and what no turn shows."""
    sensor = sensor_table(fit.session.config.sensor)
    return models.to_dict(
        fit.model,
        method="turns",
        session=fit.session.name,
        sha256=fit.sha256,
        version=VERSION,
        sensor={name: value for name, value in sensor.items() if value == value},  # no full scale of an accelerometer that is not there
        covariance=fit.model_covariance,
        covariance_of=NAMES,
        unobserved=fit.unobserved,
    )


def save_turns(fit: TurnsResult, folder: Path) -> Path:
    """Write the model and the figures into a folder; return it.  Raises StorageError for files that cannot be written."""
    with result_folder(folder):
        write_whole(folder / MODEL, model_table(fit))
        write_whole(folder / FIGURES, to_json(fit))
    return folder
