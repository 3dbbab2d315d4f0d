"""The terminal report of a fit over temperature, as rich renderables: it returns them, and prints nothing."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from session.common.units import DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MDPS, MG
from tinygc.closure.allan import angle_random_walk, bias_instability
from tinygc.models.field_parameters import scale_factor_errors
from tinygc.models.linear import BIAS
from tinygc.report.first_look_text import findings_table
from tinygc.report.fit_text import _table
from tinygc.temperature.axis_fit import AxisFit
from tinygc.temperature.hysteresis import Hysteresis
from tinygc.temperature.rest_fit import RestFit
from tinygc.temperature.sessions_fit import APART_C, SessionsFit
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
    if fit.sessions is not None:
        parts += [_sessions(fit.sessions), _over_temperature(fit)]
    parts += [Text(line) for line in remarks(fit)]
    return Group(*parts)


def _headline(fit: ThermalFit) -> Text:
    low, high = fit.model.range_c
    text = Text(f"{fit.name}: ", "bold")
    if fit.rests is not None:
        hours = sum(log.duration_s for log in fit.rests.logs) / 3600
        up, down = (sum(sweep.direction == way for sweep in fit.rests.sweeps) for way in (1, -1))
        text.append(f"{len(fit.rests.logs)} rest log{'s' * (len(fit.rests.logs) != 1)}, {hours:.2f} h, ")
        coldest, warmest = fit.rests.range_c
        text.append(f"{coldest:.1f} to {warmest:.1f} °C, {up} times up and {down} times down" if np.isfinite(coldest) else "no temperature")
    if fit.sessions is not None:
        count = len(fit.sessions.points)
        text.append(
            f"{'; ' if fit.rests is not None else ''}{count} session{'s' * (count != 1)} with turns; model from {low:.1f} to {high:.1f} °C"
        )
    return text


def _sessions(found: SessionsFit) -> RenderableType:
    table = _table("Sessions", "session", "segments", "°C", "zero, dps (x, y, z)", "less the model, mdps")
    for point in found.points:
        zero, there = point.values[BIAS], found.model.zero(np.full((1, 3), point.temp_c))[0]
        said = ", ".join(f"{value / DEG:+.4f}" for value in zero)
        off = ", ".join(f"{value / MDPS:+.2f}" for value in zero - there)
        table.add_row(point.name, str(point.segments), f"{point.temp_c:.1f} ({point.low_c:.1f} to {point.high_c:.1f})", said, off)
    return table


def _over_temperature(fit: ThermalFit) -> RenderableType:
    """Scale factors and zeros at five temperatures, with their sigmas."""
    table = _table("Over temperature", "°C", "scale factor error, ppm (x, y, z)", "zero, dps (x, y, z)")
    for temp_c in np.linspace(*fit.model.range_c, 5):
        sigma_E, sigma_zero = fit.sigma_at(float(temp_c))
        E, zero = fit.model.E(np.array([temp_c]))[0], fit.model.zero(np.full((1, 3), temp_c))[0]
        too_far = scale_factor_errors(E)
        scale = "  ".join(pm(1e6 * too_far[i], 1e6 * sigma_E[i, i]) for i in range(3))
        table.add_row(f"{temp_c:.1f}", scale, "  ".join(pm(zero[i] / DEG, sigma_zero[i] / DEG) for i in range(3)))
    table.caption = "± one sigma of the fit; the remaining uncertainty of the rest logs comes on top of the zero"
    table.caption_justify = "left"
    return table


def _axes(rests: RestFit, kind: str) -> RenderableType:
    fits: tuple[AxisFit, ...] = getattr(rests, kind)
    unit, word = (DEG, "dps") if kind == "gyro" else (MG, "mg")
    title = "Zero over temperature" if kind == "gyro" else "Accelerometer at rest over temperature, zero and scale in one"
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
    by = "sweeps" if fits[0].examined.by == "sweeps" else "stretches of time"
    table.caption = f"the last two: rms of what {by} that were left out differ from the prediction, {word}"
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
    said = _of_rests(fit.rests) if fit.rests is not None else []
    if fit.sessions is None:
        said.append("Nothing was turned: E is the identity, and the zero holds what the Earth's rotation adds (up to 4 mdps).")
    else:
        said += _of_sessions(fit.sessions, fit.rests is not None)
    return [line for line in said if line]


def _of_rests(rests: RestFit) -> list[str]:
    said = [_hysteresis(axis, axis_fit) for axis, axis_fit in zip("xyz", rests.gyro, strict=True)]
    ways = {sweep.direction for sweep in rests.sweeps}
    if rests.sweeps and len(ways) == 1:
        said.append(
            "The temperature went one way only: neither a lag nor a hysteresis can be told, and what time does is not told from what "
            "temperature does. Let it go back as well."
        )
    spread = [axis_fit.turn_on for axis_fit in rests.gyro]
    if np.isfinite(spread).all():
        said.append(f"From log to log the zero changes by {_three(spread, MDPS)} mdps rms (x, y, z) at the same temperature.")
    return said


def _of_sessions(found: SessionsFit, with_rests: bool) -> list[str]:
    said = []
    order = len(found.model.E_terms) - 1
    cold, warm = (way(point.temp_c for point in found.points) for way in (min, max))
    if warm - cold <= APART_C:
        said.append(f"E is that of {cold:.0f} °C, and is taken to be the same elsewhere: sessions at other temperatures would tell.")
    elif order == 0:
        said.append(f"E does not follow temperature as far as these sessions show (p = {found.p_constant:.2g}).")
    else:
        said.append(
            f"E follows temperature ({ORDERS[order]}); by chance with p = {found.p_constant:.1g}. Beyond the sessions it is extrapolated."
        )
    if found.widened > 1:
        said.append(f"E scatters more than its sigmas say (p = {found.p_value:.2g}): they are widened by {np.sqrt(found.widened):.2f}.")
    if np.isfinite(found.turn_on_rps):
        said.append(f"From session to session the zero changes by {found.turn_on_rps / MDPS:.2g} mdps beyond noise and temperature.")
    elif not with_rests and len(found.model.zero_terms) > 1:
        said.append("What the zero changes from one switch-on to the next is not known here, and may stand in its slope: add rest logs.")
    return said


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
