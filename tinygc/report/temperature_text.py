"""The terminal report of a fit over temperature, as rich renderables: it returns them, and prints nothing."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from session.common.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MDPS, MG
from tinygc.closure.allan import angle_random_walk, bias_instability
from tinygc.report.fit_text import _table, findings_table
from tinygc.temperature.axis_fit import AxisFit
from tinygc.temperature.hysteresis import Hysteresis
from tinygc.temperature.rest_fit import RestFit
from tinygc.temperature.thermal_fit import ThermalFit

#: sigmas from which on a hysteresis is there
SEEN = 3.0
ORDERS = ("constant", "straight line", "parabola", "cubic", "order 4", "order 5")


def temperature_report(fit: ThermalFit) -> Group:
    """What temperature does to each axis, what is left, and the noise."""
    parts: list[RenderableType] = [_headline(fit)]
    if fit.rests is not None:
        told = [finding for finding in fit.rests.findings if finding.level != "ok"]
        parts += [findings_table(told)] if told else []
        parts += [_axes(fit.rests, "gyro"), _noise(fit.rests)]
        parts += [_axes(fit.rests, "accel")] if fit.rests.accel else []
        parts += [Text(line) for line in remarks(fit)]
    return Group(*parts)


def _headline(fit: ThermalFit) -> Text:
    low, high = fit.model.range_c
    text = Text(f"{fit.name}: ", "bold")
    if fit.rests is not None:
        hours = sum(log.duration_s for log in fit.rests.logs) / 3600
        up, down = (sum(sweep.direction == way for sweep in fit.rests.sweeps) for way in (1, -1))
        text.append(f"{len(fit.rests.logs)} rest log{'s' * (len(fit.rests.logs) != 1)}, {hours:.2f} h, ")
        text.append(f"{low:.1f} to {high:.1f} °C, {up} times up and {down} times down")
    return text


def _axes(rests: RestFit, kind: str) -> RenderableType:
    fits: tuple[AxisFit, ...] = getattr(rests, kind)
    unit, word = (DEG, "dps") if kind == "gyro" else (MG, "mg")
    title = (
        "Zero over temperature"
        if kind == "gyro"
        else "Accelerometer at rest over temperature (zero and scale in one: the attitude was one)"
    )
    reference = rests.knots.reference_c
    table = _table(
        title,
        "axis",
        "model",
        f"at {reference:g} °C, {word}",
        f"slope there, {word}/°C",
        "lag, s",
        "over the range",
        "constant",
        "this model",
    )
    for axis, fit in zip("xyz", fits, strict=True):
        slope = pm(fit.terms[1] / unit, fit.sigma[1] / unit) if fit.order else "–"
        lag = pm(fit.tau_s, fit.sigma[-1]) if fit.tau_s else "–"
        held = [f"{value / unit:.2g}" if np.isfinite(value) else "–" for value in (fit.held_out_of(0, False), fit.held_out)]
        zero = pm(fit.terms[0] / unit, fit.sigma[0] / unit)
        table.add_row(axis, ORDERS[fit.order], zero, slope, lag, f"{_extent(rests, fit) / unit:.3g} {word}", *held)
    table.caption = f"the last two: rms of what {'sweeps' if fits[0].examined.by == 'sweeps' else 'stretches of time'} that were left out differ from the prediction, {word}"
    table.caption_justify = "left"
    return table


def _extent(rests: RestFit, fit: AxisFit) -> float:
    if not fit.order:
        return 0.0
    at = np.linspace(*rests.range_c, 200) - rests.knots.reference_c
    return float(np.ptp(np.polynomial.polynomial.polyval(at, fit.terms)))


def _noise(rests: RestFit) -> RenderableType:
    table = _table("Noise at rest", "axis", "angle random walk, °/√h", "bias instability, °/h", "rms of a reading over temperature")
    for axis in range(3):
        if rests.allan is None:
            break
        walk, floor = angle_random_walk(rests.allan, axis), bias_instability(rests.allan, axis)
        wander = "not observed"
        if floor.observed:
            wander = pm(floor.value / DEG_PER_HOUR, floor.sigma / DEG_PER_HOUR)
        elif np.isfinite(floor.at_most):
            wander = f"at most {floor.at_most / DEG_PER_HOUR:.2g}"
        over = "–" if rests.noise is None else f"{pm(100 * rests.noise.per_c[axis], 100 * rests.noise.sigma[axis])} %/°C"
        table.add_row("xyz"[axis], pm(walk.value / DEG_PER_SQRT_HOUR, walk.sigma / DEG_PER_SQRT_HOUR), wander, over)
    return table


def remarks(fit: ThermalFit) -> list[str]:
    """What to know of the model, in sentences."""
    rests = fit.rests
    assert rests is not None
    said = [_hysteresis(axis, axis_fit) for axis, axis_fit in zip("xyz", rests.gyro, strict=True)]
    ways = {sweep.direction for sweep in rests.sweeps}
    if rests.sweeps and len(ways) == 1:
        said.append(
            "The temperature went one way only: neither a lag nor a hysteresis can be told, and what time does is not told from what "
            "temperature does. Let it go back as well."
        )
    if fit.joint is None:
        said.append("Nothing was turned: E is the identity, and the zero holds what the Earth's rotation adds (up to 4 mdps).")
    spread = [axis_fit.turn_on for axis_fit in rests.gyro]
    if np.isfinite(spread).all():
        said.append(f"From log to log the zero changes by {_three(spread, MDPS)} mdps rms (x, y, z) at the same temperature.")
    return [line for line in said if line]


def _hysteresis(axis: str, fit: AxisFit) -> str:
    before, after = fit.hysteresis_before, fit.hysteresis_after
    if before is None or after is None:
        return ""
    size, sigma, at_c = after.largest
    remains = f"held out, {fit.held_out / DEG:.2g} dps rms remain, which is this axis' uncertainty"
    if fit.tau_s and _seen(before):
        gone = (
            f"{axis}: up and down differ by {pm(abs(before.largest[0]) / DEG, before.largest[1] / DEG)} dps at {before.largest[2]:.0f} °C"
        )
        by = f"a lag of {pm(fit.tau_s, fit.sigma[-1])} s leaves {pm(abs(size) / DEG, sigma / DEG)} dps"
        return f"{gone}; {by}; {remains}."
    if _seen(after):
        return f"{axis}: up and down differ by {pm(abs(size) / DEG, sigma / DEG)} dps at {at_c:.0f} °C, and no lag removes it; {remains}."
    return ""


def _seen(found: Hysteresis) -> bool:
    return bool(abs(found.largest[0]) > SEEN * found.largest[1])


def pm(value: float, sigma: float) -> str:
    """Value ± sigma, with two digits of the sigma."""
    if not np.isfinite(sigma) or sigma <= 0:
        return f"{value:.4g}"
    digits = max(0, 1 - int(np.floor(np.log10(sigma))))
    return f"{value:.{digits}f} ± {sigma:.{digits}f}" if digits < 8 else f"{value:.3g} ± {sigma:.2g}"


def _three(values: list[float], unit: float) -> str:
    return ", ".join(f"{value / unit:.2g}" for value in values)
