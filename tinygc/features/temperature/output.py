"""Output of a fit over temperature: picture, text, JSON and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.files import result_folder
from session.base.numeric import sigmas_in
from session.base.records import write_whole
from session.base.texts import fixed, measured, probability, significant
from session.base.units import DEG, MDPS, MG
from tinygc import models
from tinygc.features.temperature.axis_fit import AxisFit, Hysteresis
from tinygc.features.temperature.rest_fit import NoiseOverTemperature, RestFit, zero_of_blocks
from tinygc.features.temperature.sessions_fit import APART_C, SessionsFit, ThermalFit, zero_terms
from tinygc.models.linear import BIAS, MATRIX, scale_factor_errors
from tinygc.models.model import accelerometer_table
from tinygc.reporting.drawing import Axis, Panel, Picture, saved
from tinygc.reporting.facts import Table, screen
from tinygc.reporting.tables import finding_lines
from tinygc.reporting.terminal import Group, one_line

# The picture of a fit over temperature: each axis' zero, up and down; the residuals; E where sessions determine it.


def picture_of(fit: ThermalFit) -> Picture:
    """The picture."""
    panels, rests = [], fit.rests
    if rests is not None:
        panels = [draw(rests, axis) for axis in range(3) for draw in (_zero, _left)]
    if fit.sessions is not None:
        panels.append(_scale(fit))
    return Picture(panels, f"{fit.name}: over temperature")


def _ways(rests: RestFit) -> list[tuple[str, str, np.ndarray]]:
    """Name, colour and knots of each direction of the temperature."""
    direction = rests.knots.direction
    ways = [(name, kind, direction == way) for name, kind, way in (("up", "x", 1), ("down", "z", -1), ("", "quiet", 0))]
    return [each for each in ways if each[2].any()]


def _zero(rests: RestFit, axis: int) -> Panel:
    """Draw the means of knots, with each log's own zero shifted to the common one, and the model."""
    knots, fit = rests.knots, rests.gyro[axis]
    values = knots.mean(np.concatenate([log.gyro[:, axis] for log in knots.logs])) / DEG
    panel = Panel(Axis("temperature (°C)"), Axis("rate at rest (dps)"), f"{'xyz'[axis]}: zero over temperature")
    for name, kind, which in _ways(rests):
        panel.points(knots.temp_c[which], values[which], kind, ring=True, radius=2.5, name=name)
    at = np.linspace(*rests.range_c, 200)
    curve = np.polynomial.polynomial.polyval(at - knots.reference_c, fit.terms) / DEG
    return panel.line(at, curve, "ink", name=f"order {fit.order}" + (f", lag {fit.tau_s:.0f} s" if fit.tau_s else ""))


def _left(rests: RestFit, axis: int) -> Panel:
    """Draw the residuals against the element's temperature, with the held-out error."""
    knots, fit = rests.knots, rests.gyro[axis]
    element = knots.mean(knots.element_c(fit.tau_s))
    left = knots.mean(np.concatenate([log.gyro[:, axis] for log in knots.logs]) - zero_of_blocks(knots, fit)) / DEG
    for number in range(len(knots.logs)):
        left[knots.of == number] -= left[knots.of == number].mean()
    panel = Panel(Axis("temperature of the element (°C)"), Axis("left (dps)"), f"{'xyz'[axis]}: what the model leaves")
    if np.isfinite(band := fit.held_out / DEG):
        panel.area([-np.inf, np.inf], -band, band, "quiet", name=f"held out, {significant(band, 2)} dps rms")
    for name, kind, which in _ways(rests):
        for sweep in np.unique(knots.sweep[which]):
            here = knots.sweep == sweep
            panel.line(element[here], left[here], kind, "thin").points(element[here], left[here], kind, ring=True, radius=2.5, name=name)
    return panel


def _scale(fit: ThermalFit) -> Panel:
    """Draw the scale factor errors of the sessions, and the model with one sigma."""
    assert fit.sessions is not None
    at = np.linspace(*fit.model.range_c, 60)
    mid = scale_factor_errors(fit.model.E(at)) * 1e6
    sigma = np.array([np.diag(fit.sigma_at(float(temp_c))[0]) for temp_c in at]) * 1e6
    panel = Panel(Axis("temperature (°C)"), Axis("scale factor error (ppm)"), "Scale factor error over temperature")
    for i, axis in enumerate("xyz"):
        panel.area(at, mid[:, i] - sigma[:, i], mid[:, i] + sigma[:, i], axis).line(at, mid[:, i], axis, name=axis)
        for point in fit.sessions.points:
            value, error = scale_factor_errors(point.values[MATRIX].reshape(3, 3))[i], np.sqrt(point.covariance[4 * i, 4 * i])
            panel.points(point.temp_c, value * 1e6, axis, sigma=error * 1e6, labels=[point.name])
    return panel


# The terminal report of a fit over temperature; nothing is printed here.

#: sigmas above which a hysteresis is reported
SEEN = 3.0
ORDERS = ("constant", "straight line", "parabola", "cubic")


def order_word(order: int) -> str:
    """Of a polynomial."""
    return ORDERS[order] if order < len(ORDERS) else f"order {order}"


def temperature_report(fit: ThermalFit) -> Group:
    """How far the zero and the scale follow temperature, and what the model leaves."""
    parts: list[Any] = [one_line(answer(fit), "bold"), one_line(_inputs(fit))]
    if fit.rests is not None:
        problems = [finding for finding in fit.rests.findings if finding.level != "ok"]
        parts += [finding_lines(problems)] if problems else []
        parts.append(_axes(fit.rests, "gyro"))
        parts += [_axes(fit.rests, "accel")] if any(axis.order for axis in fit.rests.accel) else []
    if fit.sessions is not None:
        rows = []
        for point in fit.sessions.points:
            off = point.values[BIAS] - fit.sessions.model.zero(np.full((1, 3), point.temp_c))[0]
            at_c = f"{point.temp_c:.1f} ({point.low_c:.1f} to {point.high_c:.1f})"
            rows.append([point.name, point.segments, at_c, *(fixed(value / MDPS, 2) for value in off)])
        parts.append(Table("Sessions: zero less the model, mdps", ("", "turns", "°C", "x", "y", "z"), rows))
        parts.append(_over_temperature(fit))
    return screen([*parts, *remarks(fit)])


def answer(fit: ThermalFit) -> str:
    """What the model leaves of the zero, held out; of sessions alone, whether the scale follows temperature."""
    low, high = fit.model.range_c
    if fit.rests is None:
        assert fit.sessions is not None
        return _scale_line(fit.sessions)
    left, before = (max(getattr(axis, name) for axis in fit.rests.gyro) / MDPS for name in ("held_out", "held_out_constant"))
    begin = f"Zero from {low:.0f} to {high:.0f} °C"
    if not any(axis.order for axis in fit.rests.gyro):
        return f"{begin}: no effect of temperature found."
    if not np.isfinite(left):
        return f"{begin}: model made, its error not known (one sweep)."
    return f"{begin}: {significant(left, 2)} of {significant(before, 2)} mdps rms left (held out)."


def _scale_line(found: SessionsFit) -> str:
    cold, warm = (way(point.temp_c for point in found.points) for way in (min, max))
    if warm - cold <= APART_C:
        return f"Scale is that of {cold:.0f} °C everywhere: add sessions at other temperatures."
    order, p = len(found.model.E_terms) - 1, probability(found.p_constant)
    what = f"follows temperature ({order_word(order)}, {p})" if order else f"does not follow temperature ({p})"
    return f"Scale from {cold:.0f} to {warm:.0f} °C: {what}."


def _inputs(fit: ThermalFit) -> str:
    """``day1: 1 rest log, 2.00 h, 2 times up and 2 down; 1 session with turns``."""
    found = []
    if fit.rests is not None:
        hours = sum(log.duration_s for log in fit.rests.logs) / 3600
        up, down = (sum(sweep.direction == way for sweep in fit.rests.sweeps) for way in (1, -1))
        found.append(f"{len(fit.rests.logs)} rest log{'s' * (len(fit.rests.logs) != 1)}, {hours:.2f} h, {up} times up and {down} down")
    if fit.sessions is not None:
        count = len(fit.sessions.points)
        found.append(f"{count} session{'s' * (count != 1)} with turns")
    return f"{fit.name}: {'; '.join(found)}"


def _over_temperature(fit: ThermalFit) -> Table:
    """Scale factors and zeros at five temperatures."""
    rows = []
    for temp_c in np.linspace(*fit.model.range_c, 5):
        off, zero = scale_factor_errors(fit.model.E(np.array([temp_c]))[0]), fit.model.zero(np.full((1, 3), temp_c))[0]
        rows.append([f"{temp_c:.1f}", *(fixed(1e6 * each, 0) for each in off), *(fixed(each / DEG, 4) for each in zero)])
    header = ("°C", "scale x, ppm", "y", "z", "zero x, dps", "y", "z")
    return Table("Model over temperature", header, rows)


def _axes(rests: RestFit, kind: str) -> Table:
    fits: tuple[AxisFit, ...] = getattr(rests, kind)
    unit, word = (MDPS, "mdps") if kind == "gyro" else (1e-3 * MG, "µg")
    header = ("", "model", f"slope at {rests.knots.reference_c:g} °C, {word}/°C", "lag, s", f"constant, {word}", "model")
    rows = []
    for axis, fit in zip("xyz", fits, strict=True):
        slope = (fit.terms[1] / unit, fit.sigma[1] / unit) if fit.order else None
        model = order_word(fit.order)
        if fit.line is not None:
            slope = (fit.line.slope / unit, fit.line.sigma / unit)
            model = f"{order_word(fit.line.order)} or walk" if fit.line.order else model
        held = [significant(value / unit, 2) if np.isfinite(value) else None for value in (fit.held_out_constant, fit.held_out)]
        rows.append([axis, model, slope, (fit.tau_s, fit.sigma[-1]) if fit.tau_s else None, *held])
    by = "sweeps" if fits[0].folds == "sweeps" else "stretches of time"
    title = f"{'Zero' if kind == 'gyro' else 'Accelerometer'}: last two columns, rms error of left-out {by}"
    return Table(title, header, rows, left=(0, 1))


def remarks(fit: ThermalFit) -> list[str]:
    """Remarks on the model, in sentences."""
    found = _of_rests(fit.rests) if fit.rests is not None else []
    if fit.sessions is None:
        found.append("Nothing was turned: no scale; the zero includes the Earth's rate (up to 4 mdps).")
    else:
        found += _of_sessions(fit.sessions, fit.rests is not None)
    return [line for line in found if line]


def _of_rests(rests: RestFit) -> list[str]:
    found = [_hysteresis(axis, axis_fit) for axis, axis_fit in zip("xyz", rests.gyro, strict=True)]
    found += [
        f"{axis}: {order_word(fit.line.order)} or walk, not separable: neither is in the model."
        for axis, fit in zip("xyz", rests.gyro, strict=True)
        if fit.line is not None and fit.line.order
    ]
    if rests.sweeps and len({sweep.direction for sweep in rests.sweeps}) == 1:
        found.append("The temperature went one way only: let it go back, to see lag and hysteresis.")
    spread = [axis_fit.turn_on for axis_fit in rests.gyro]
    if np.isfinite(spread).all():
        found.append(f"Zero from log to log: {', '.join(significant(value / MDPS, 2) for value in spread)} mdps rms (x, y, z).")
    return found


def _of_sessions(sessions: SessionsFit, with_rests: bool) -> list[str]:
    found = [_scale_line(sessions)] if with_rests else []  # else it is the answer
    found += ["Beyond the sessions the scale is extrapolated."] if len(sessions.model.E_terms) > 1 else []
    if sessions.widened > 1:
        found.append(f"Sigmas of the scale × {np.sqrt(sessions.widened):.2f}, by the scatter of the sessions.")
    if np.isfinite(sessions.turn_on_rps) and sessions.turn_on_rps > 0:
        found.append(f"Zero from session to session: {significant(sessions.turn_on_rps / MDPS, 2)} mdps beyond noise and temperature.")
    elif not with_rests and len(sessions.model.zero_terms) > 1:
        found.append("The zero's slope may hold changes between switch-ons: add rest logs.")
    return found


def _hysteresis(axis: str, fit: AxisFit) -> str:
    before, after = fit.hysteresis_before, fit.hysteresis_after
    if before is None or after is None:
        return ""
    differ, left = (f"{measured(abs(size) / MDPS, sigma / MDPS)} mdps" for size, sigma, _ in (before.largest, after.largest))
    if fit.tau_s and _seen(before):
        return f"{axis}: up and down differ by {differ}; a lag of {fit.tau_s:.0f} s leaves {left}."
    if _seen(after):
        return f"{axis}: up and down differ by {left}, and no lag removes it."
    return ""


def _seen(found: Hysteresis) -> bool:
    return bool(abs(found.largest[0]) > SEEN * found.largest[1])


# ``tinygc-temperature/2`` (docs/formats.md).

SCHEMA = "tinygc-temperature/2"


def to_json(fit: ThermalFit) -> dict:
    """Return all results, in the units of the format."""
    model = fit.model
    table: dict[str, Any] = {
        "schema": SCHEMA,
        "session": fit.name,
        "version": VERSION,
        "reference_c": model.reference_c,
        "range_c": model.range_c,
        "remaining_dps": fit.remaining_rps / DEG,
    }
    table["model"] = {
        "E_per_c": model.E_terms,
        "zero_dps_per_c": model.zero_terms / DEG,
        "lag_s": model.lag_s,
        "parameters": [
            {"name": name, "value": float(value), "std": float(sigma)}
            for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True)
        ],
    }
    if fit.rests is not None:
        table |= of_rests(fit.rests)
    if fit.sessions is not None:
        table |= of_sessions(fit.sessions)
    return table


def of_sessions(sessions: SessionsFit) -> dict:
    """Return the results of sessions with turns."""
    return {
        "sessions": [
            {
                "name": point.name,
                "temperature_c": [point.low_c, point.temp_c, point.high_c],
                "segments": point.segments,
                "E": point.values[MATRIX].reshape(3, 3),
                "zero_dps": point.values[BIAS] / DEG,
                "zero_std_dps": sigmas_in(point.covariance)[BIAS] / DEG,
            }
            for point in sessions.points
        ],
        "E_goodness": {
            "chi_square": sessions.chi_square,
            "freedom": sessions.freedom,
            "p_value": sessions.p_value,
            "variance_inflation": sessions.widened,
        },
        "E_constant_p_value": sessions.p_constant,
        "turn_on_dps": sessions.turn_on_rps / DEG,
    }


def of_rests(rests: RestFit) -> dict:
    """Return the results of rest logs."""
    return {
        "rests": [
            {
                "file": log.path.name,
                "samples": log.samples,
                "duration_s": log.duration_s,
                "rate_hz": 1 / log.period_s,
                "left_out_s": (len(log) - len(kept)) * log.block_s,
                "temperature_c": [log.temp_c.min(), log.temp_c.max()],
            }
            for log, kept in zip(rests.logs, rests.knots.logs, strict=True)
        ],
        "sweeps": {name: sum(s.direction == way for s in rests.sweeps) for name, way in (("up", 1), ("down", -1))},
        "gyro": [_axis(axis, fit, DEG, "dps") for axis, fit in zip("xyz", rests.gyro, strict=True)],
        "accel": [_axis(axis, fit, MG, "mg") for axis, fit in zip("xyz", rests.accel, strict=True)],
        "noise": [] if rests.noise is None else [_noise_table(rests.noise, axis) for axis in range(3)],
    }


def _axis(axis: str, fit: AxisFit, unit: float, word: str) -> dict:
    terms = np.arange(fit.order + 1)
    lagged = fit.tau_s != 0
    return {
        "axis": axis,
        "order": int(terms[-1]),
        f"terms_{word}": fit.terms / unit,
        f"terms_std_{word}": fit.sigma[:-1] / unit,
        "lag_s": fit.tau_s if lagged else None,
        "lag_std_s": float(fit.sigma[-1]) if lagged else None,
        "p_value": fit.p_value,
        "held_out_by": fit.folds,
        f"held_out_{word}": fit.held_out / unit,
        f"held_out_constant_{word}": fit.held_out_constant / unit,
        f"left_{word}": fit.left / unit,
        f"turn_on_{word}": fit.turn_on / unit,
        f"line_{word}": None if fit.line is None else fit.line.slope / unit,
        f"line_std_{word}": None if fit.line is None else fit.line.sigma / unit,
        "line_or_walk": fit.line is not None and fit.line.order > 0,
        "hysteresis": {
            name: None if found is None else _hysteresis_table(found, unit, word)
            for name, found in (("before", fit.hysteresis_before), ("after", fit.hysteresis_after))
        },
    }


def _hysteresis_table(found: Hysteresis, unit: float, word: str) -> dict:
    largest, sigma, at_c = found.largest
    return {f"largest_{word}": largest / unit, f"std_{word}": sigma / unit, "at_c": at_c, f"rms_{word}": found.rms / unit}


def _noise_table(over: NoiseOverTemperature, axis: int) -> dict:
    return {
        "axis": "xyz"[axis],
        "rms_per_c": float(over.per_c[axis]),
        "rms_std_per_c": float(over.sigma[axis]),
        "rms_at_c": over.at_c,
        "rms_dps": over.rms[:, axis] / DEG,
    }


# A fit over temperature as files: the model, the figures, the picture.

#: in the folder with the models of the other methods
MODEL, FIGURES, PICTURE = "model_thermal.json", "temperature.json", "temperature.svg"
UNITS = "E: 1/degC^n, zero: rad/s/degC^n, lag: s; product of the two parameters' units"


def save_thermal(fit: ThermalFit, folder: Path) -> Path:
    """Write the model, the figures and the picture into a folder; return the folder.

    Raises StorageError for files that cannot be written.
    """
    with result_folder(folder):
        write_whole(folder / MODEL, model_table(fit))
        write_whole(folder / FIGURES, to_json(fit))
        saved(picture_of(fit), folder / PICTURE)
    return folder


def model_table(fit: ThermalFit) -> dict:
    """Return ``tinygc-model/1`` with the covariance, the accelerometer calibration of E's body frame, and the accelerometer's change."""
    more = {
        "method": "thermal",
        "session": fit.name,
        "sha256": fit.sha256,
        "version": VERSION,
        "covariance": fit.covariance,
        "covariance_of": fit.names,
        "covariance_units": UNITS,
        "remaining_rps": fit.remaining_rps,
    }
    if fit.sessions is not None:
        # All sessions were rotated into the first one's frame.  Without turns E is the identity, and has no frame.
        more["accelerometer"] = accelerometer_table(fit.sessions.points[0].accelerometer)
    if fit.rests is not None:
        # At a single attitude, changes of scale and of zero cannot be separated, and the constant is gravity.
        more["accel_change_mps2"] = zero_terms(fit.rests.accel)[1:]
    return models.to_dict(fit.model, **more)
