"""What a fit by known turns has found: scales, asymmetry, bias, and the model of them; its text, JSON and files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from session import VERSION
from session.base.files import result_folder
from session.base.records import plain, write_whole
from session.base.texts import degrees, printable, probability, significant
from session.base.units import DEG
from session.log.folder import Session
from tinygc import models
from tinygc.features.turns.angles import TERMS, LogOfTurns, RestNoise, TurnAngle
from tinygc.features.turns.estimate import SURE, Component, TurnsEstimate
from tinygc.library.records import Shown
from tinygc.models.linear import MATRIX, NAMES, PRIOR_SIGMA, LinearModel
from tinygc.models.model import sensor_table
from tinygc.reporting.facts import Part, Table, screen
from tinygc.reporting.terminal import Group, one_line

SCHEMA = "tinygc-turns/1"
MODEL, FIGURES = "model_turns.json", "turns.json"
SENSES = {1: "+", -1: "−", 0: "±"}
#: turns of one cell of the table of repeats turn at rates within this of their median
ALIKE = 0.2
#: a miss is explained by gaps where the two agree within so many sigmas
EXPLAINED = 3.0


@dataclass(frozen=True, eq=False)
class RestBias:
    """What the gyroscope reads at rest, each (3,) rad/s: mean over the rests, its sigma, and wander, the scatter from rest to rest.  The
    Earth's rotation, at most 0.0042 dps, is in it."""

    mean: np.ndarray
    sigma: np.ndarray
    wander: np.ndarray
    rests: int


@dataclass(frozen=True, eq=False)
class AxisScale:
    """A scale factor error, measured / true - 1: of one sense (1 or -1), or of both (0), their mean; its sigma; turns that it is from; and
    by how much the scale of the sensor's own axis may differ (1 sigma, ``TurnFit.axis_bound``)."""

    axis: int
    sense: int
    value: float
    sigma: float
    turns: int
    axis_bound: float


@dataclass(frozen=True, eq=False, repr=False)
class TurnFit(Shown):
    """What ``tinygc.fit_turns`` returns: ``scales``, ``axis_scales``, ``asymmetry``, ``bias``, ``model``; text, JSON and files.

    angles: each stated turn, with what was measured; estimate: scales, play, and which turns are lost; bias; noise of the rests.
    """

    session: Session
    sha256: dict[str, str]
    angles: tuple[TurnAngle, ...]
    logs: tuple[LogOfTurns, ...]
    noise: RestNoise
    estimate: TurnsEstimate
    bias: RestBias

    def __repr__(self) -> str:
        found = ", ".join(f"{'xyz'[s.axis]}{' +-'[s.sense]} {100 * s.value:.3f} ± {100 * s.sigma:.3f} %" for s in self.scales)
        return f"<TurnFit of {self.session.name}: {found}>"

    @cached_property
    def scales(self) -> tuple[AxisScale, ...]:
        """One of each axis and sense that was turned, in the order of axes, + before -."""
        return tuple(self._scale([g]) for g in range(len(self.estimate.groups)))

    def _scale(self, mine: list[int]) -> AxisScale:
        """Of some groups of one axis, their mean."""
        found, (axis, sense) = self.estimate, self.estimate.groups[mine[0]]
        sigma = float(np.sqrt(self.covariance[np.ix_(mine, mine)].mean()))
        turns = sum(found.turns[g] for g in mine)
        return AxisScale(axis, sense if len(mine) == 1 else 0, float(np.mean(found.scale[mine])), sigma, turns, self.axis_bound)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(G, G) of ``scales``; where samples were counted at a nominal rate, its uncertainty is in all of them."""
        rate = self.session.nominal_rate
        return self.estimate.covariance + (0 if rate is None else rate.covariance(1 + self.estimate.scale))

    @cached_property
    def axis_scales(self) -> tuple[AxisScale, ...]:
        """One of each axis that was turned, of both senses the mean."""
        axes = [axis for axis, _ in self.estimate.groups]
        return tuple(self._scale([g for g, own in enumerate(axes) if own == axis]) for axis in sorted(set(axes)))

    @cached_property
    def asymmetry(self) -> dict[int, tuple[float, float]]:
        """Of each axis that was turned both ways: (gain of + less gain of -) / their mean, and its sigma."""
        found = {}
        groups = {group: g for g, group in enumerate(self.estimate.groups)}
        for axis in range(3):
            if (axis, 1) in groups and (axis, -1) in groups:
                gain = np.zeros(len(groups))
                gain[groups[axis, 1]], gain[groups[axis, -1]] = 1, -1
                mean = 1 + float(np.abs(gain) @ self.estimate.scale) / 2
                found[axis] = float(gain @ self.estimate.scale) / mean, float(np.sqrt(gain @ self.covariance @ gain)) / mean
        return found

    @property
    def used(self) -> list[TurnAngle]:
        """The turns that the scales are from."""
        return [angle for angle, good in zip(self.angles, self.estimate.used, strict=True) if good]

    @cached_property
    def axis_bound(self) -> float:
        """Of (S_kj + S_jk) u_j, were misalignments and leans as large as the leans that show: sqrt(2) times their mean square, of axes."""
        leans = [np.mean([turn.lean_rad**2 for turn in self.used if turn.axis == axis]) for axis in {turn.axis for turn in self.used}]
        return float(np.sqrt(2) * np.mean(leans))

    @cached_property
    def model(self) -> LinearModel:
        """omega = E m + B: the scale of each axis that was turned, the zero of all; an axis that was not turned has the scale 1."""
        gain = np.ones(3)
        for scale in self.axis_scales:
            gain[scale.axis] += scale.value
        return LinearModel(np.diag(1 / gain), -self.bias.mean / gain)

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Parameters of ``model`` that no turn shows, by their names."""
        shown = {f"E_{'xyz'[scale.axis]}{'xyz'[scale.axis]}" for scale in self.axis_scales}
        return tuple(name for name in NAMES[MATRIX] if name not in shown)

    @cached_property
    def model_covariance(self) -> np.ndarray:
        """(12, 12) of ``model``; what no turn shows has its prior's variance."""
        variance = PRIOR_SIGMA**2
        E = np.diag(self.model.E)
        variance[9:] = (E * self.bias.sigma) ** 2
        for scale in self.axis_scales:
            variance[4 * scale.axis] = (scale.sigma * E[scale.axis] ** 2) ** 2
        return np.diag(variance)

    @property
    def page(self) -> Group:
        """What ``fit`` prints, as a rich renderable."""
        estimate = self.estimate
        used, stated = int(estimate.used.sum()), len(self.angles)
        parts: list[Part] = [one_line(f"{self.session.name}: a gyroscope alone, {used} of {stated} stated turns used", "bold")]
        rows = [
            [
                f"{'xyz'[each.axis]} {SENSES[each.sense]}",
                100 * each.value,
                100 * each.sigma,
                each.turns,
                significant(100 * each.axis_bound, 2),
            ]
            for each in self.scales
        ]
        parts.append(Table("Scale factor error, measured / true − 1", ("axis", "%", "± (1 σ)", "turns", "own axis ± (1 σ)"), rows))
        for axis, (value, sigma) in self.asymmetry.items():
            parts.append(f"asymmetry of {'xyz'[axis]}, (+ − −) / mean: {significant(100 * value)} ± {significant(100 * sigma, 2)} %")
        rest = [self.bias.mean / DEG, self.bias.sigma / DEG, self.bias.wander / DEG]
        rows = [[name, *(significant(float(x[axis]), 2) for x in rest)] for axis, name in enumerate("xyz")]
        parts.append(Table(f"At rest, {self.bias.rests} rests", ("axis", "dps", "± (1 σ)", "from rest to rest"), rows))
        if estimate.dof:
            fits = "explain the spread" if estimate.p_value > 0.01 else "do not explain the spread"
            chi_square = f"chi-square {significant(estimate.chi2)} of {estimate.dof}, {probability(estimate.p_value)}"
            parts.append(f"stated sigmas and the gyroscope's own errors {fits}: {chi_square}")
            parts.append(f"play, a further error of each turn: {_component(estimate.play, DEG, '°')}")
            parts.append(f"repeat, a further error that grows with the angle: {_component(estimate.repeat, 0.01, ' %')}")
        else:
            parts.append("no turn repeats another: play is not known, and the stated sigmas are taken as they are")
        if cells := repeats(self):
            rows = [
                [
                    f"{c['axis']} {c['sense'].replace('-', SENSES[-1])}",
                    c["stated_deg"],
                    c["rate_dps"],
                    c["turns"],
                    (c["mean_deg"], c["std_deg"]),
                ]
                for c in cells
            ]
            parts.append(Table("Repeats", ("axis", "stated °", "dps", "turns", "mean ± std, °"), rows))
        return screen([*parts, *remarks(self)])

    def to_json(self) -> dict:
        """``tinygc-turns/1`` (docs/formats.md)."""
        estimate = self.estimate

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
            for i, angle in enumerate(self.angles)
        ]
        return plain(
            {
                "schema": SCHEMA,
                "version": VERSION,
                "session": self.session.name,
                "sha256": self.sha256,
                "scale": [
                    {
                        "axis": "xyz"[scale.axis],
                        "sense": "+" if scale.sense > 0 else "-",
                        "error_ppm": scale.value * 1e6,
                        "sigma_ppm": scale.sigma * 1e6,
                        "own_axis_within_ppm": scale.axis_bound * 1e6,
                        "turns": scale.turns,
                    }
                    for scale in self.scales
                ],
                "scale_covariance_ppm2": self.covariance * 1e12,
                "asymmetry": [
                    {"axis": "xyz"[axis], "value_ppm": value * 1e6, "sigma_ppm": sigma * 1e6}
                    for axis, (value, sigma) in self.asymmetry.items()
                ],
                "bias": {
                    "mean_dps": self.bias.mean / DEG,
                    "sigma_dps": self.bias.sigma / DEG,
                    "wander_dps": self.bias.wander / DEG,
                    "rests": self.bias.rests,
                },
                "play_deg": component(estimate.play, DEG),
                "repeat_ppm": component(estimate.repeat, 1e-6),
                "chi_square": {"value": estimate.chi2, "dof": estimate.dof, "p": estimate.p_value},
                "repeats": repeats(self),
                "turns": turns,
                "remarks": remarks(self),
            }
        )

    def save(self, folder: Path | str | None = None) -> Path:
        """Write model and figures into a folder (``fit`` in the session's by default); returns it.  StorageError where that fails."""
        folder = self.session.own_folder("fit") if folder is None else Path(folder)
        sensor = sensor_table(self.session.config.sensor)
        model = models.to_dict(
            self.model,
            method="turns",
            session=self.session.name,
            sha256=self.sha256,
            version=VERSION,
            sensor={name: value for name, value in sensor.items() if value == value},  # no full scale of an accelerometer that is not there
            covariance=self.model_covariance,
            covariance_of=NAMES,
            unobserved=self.unobserved,
        )
        with result_folder(folder):
            write_whole(folder / MODEL, model)
            write_whole(folder / FIGURES, self.to_json())
        return folder


def repeats(fit: TurnFit) -> list[dict]:
    """``repeats`` of the JSON: cells of two turns or more of one axis, sense, stated angle and rate, in this order, that are used."""
    cells: list[list[TurnAngle]] = []
    for angle in sorted(fit.used, key=lambda angle: (angle.axis, -angle.sense, round(angle.stated_rad / DEG, 6), angle.rate_rps)):
        first = cells[-1][0] if cells else None
        same = (
            first is not None and (first.axis, first.sense) == (angle.axis, angle.sense) and abs(first.stated_rad - angle.stated_rad) < 1e-6
        )
        if first is not None and same and angle.rate_rps <= (1 + ALIKE) * first.rate_rps:
            cells[-1].append(angle)
        else:
            cells.append([angle])
    return [
        {
            "axis": "xyz"[cell[0].axis],
            "sense": "+" if cell[0].sense > 0 else "-",
            "stated_deg": cell[0].stated_rad / DEG,
            "rate_dps": float(np.median([angle.rate_rps for angle in cell])) / DEG,
            "turns": len(cell),
            "mean_deg": float(np.mean([angle.measured_rad for angle in cell])) / DEG,
            "std_deg": float(np.std([angle.measured_rad for angle in cell], ddof=1)) / DEG,
        }
        for cell in cells
        if len(cell) > 1
    ]


def lost_words(fit: TurnFit, number: int) -> str:
    """What is known of a turn that is lost, or may be: its miss, its probability, and what could be the cause."""
    angle, estimate = fit.angles[number], fit.estimate
    miss, sigma, lost = (float(values[number]) for values in (estimate.residual_rad, estimate.predicted_rad, estimate.lost))
    name = f"{angle.turn.name} ({angle.turn.description})"
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


def remarks(fit: TurnFit) -> list[str]:
    """What is not claimed, and why; turns that were left out; what was done to the stamps."""
    estimate = fit.estimate
    named = [not used or lost > 0.5 for used, lost in zip(estimate.used, estimate.lost, strict=True)]
    lines = [lost_words(fit, i) for i, angle in enumerate(fit.angles) if angle.problem is None and named[i]]
    lines += [f"{angle.turn.name} ({angle.turn.description}): not used: {angle.problem}" for angle in fit.angles if angle.problem]
    turned = {axis: [sense for other, sense in estimate.groups if other == axis] for axis in range(3)}
    if still := [name for axis, name in enumerate("xyz") if not turned[axis]]:
        lines.append(f"scale of {', '.join(still)}: not known, no turn about it")
    if single := [f"{name} ({SENSES[-turned[axis][0]]})" for axis, name in enumerate("xyz") if len(turned[axis]) == 1]:
        lines.append(f"not known, since not turned: the other sense of {', '.join(single)}, and so the asymmetry")
    if estimate.groups and not any(len(senses) > 1 for senses in turned.values()):
        lines.append(
            "backlash of the table: not known, since turns of one sense take it up once; the play above is another error of each turn"
        )
    lines.append("misalignments, and what follows gravity: not known, no turn separates them from the table's lean")
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


def _component(found: Component, unit: float, name: str) -> str:
    if found.low <= found.median / 10:
        return f"below {significant(found.upper / unit, 2)}{name} (95 %)"
    median, low, high = (significant(x / unit, 2) for x in (found.median, found.low, found.high))
    return f"{median}{name} ({low} to {high})"
