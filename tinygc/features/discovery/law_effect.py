"""A form as an effect: for the search, and with its numbers and its C as a written law, so that all code for effects accepts it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from session.base.numeric import rms_of
from session.base.units import DEG
from tinygc.effects import (
    Conditions,
    Convention,
    Effect,
    Movement,
    NoC,
    Parameter,
    ReferenceConditions,
    Scan,
    StageC,
    StatedNumbers,
    axis_of,
    largest,
    signals,
)
from tinygc.effects.device import MOST_PASSES, PASSES, InC, where
from tinygc.effects.effect import SCALE_LAW
from tinygc.effects.inversion import JUMPS_REACH, undone_with_jumps
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.words import coefficient_unit, constants_of, follows, jumps, known_to, observable_in, regime, splits
from tinygc.features.discovery.words import equation as equation_of

#: rad/s rms: no working gyroscope has a larger error
PLAUSIBLE_RPS = 5 * DEG


def columns_of(form: LawForm, movement: Movement) -> np.ndarray:
    """Rate added by one rad/s of each coefficient, (N, 3, P)."""
    values = {factor: factor.values(movement) for factor in form.factors}
    terms = form.terms()
    found = np.zeros((len(movement.rate), 3, len(terms)))
    for number, (axis, parts) in enumerate(terms):
        product = np.ones(len(movement.rate))
        for factor, component in parts:
            product = product * values[factor][:, component]
        found[:, axis, number] = product
    return found


def distorted(form: LawForm, movement: Movement, theta: np.ndarray) -> np.ndarray:
    """Rate with the law, (N, 3) rad/s; as ``columns_of`` times theta (P,), without the zeros."""
    values = {factor: factor.values(movement) for factor in form.factors}
    found = movement.rate.copy()
    for (axis, (first, *others)), coefficient in zip(form.terms(), theta, strict=True):
        product = coefficient * values[first[0]][:, first[1]]
        for factor, component in others:
            product *= values[factor][:, component]
        found[:, axis] += product
    return found


def added(effect: Effect, theta: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """Rate added by an effect, (N, 3) rad/s over all logs concatenated."""
    return np.concatenate([effect.columns(effect.shown(movement)) @ theta for movement in movements])


def left_by_calibration(rate: np.ndarray, movements: Sequence[Movement]) -> np.ndarray:
    """The part of an added rate (N, 3) that no E m + B gives: each axis less its regression on one and the three rates."""
    measured = np.concatenate([movement.rate for movement in movements])
    q, _ = np.linalg.qr(np.column_stack([np.ones(len(measured)), measured]))
    return rate - q @ (q.T @ rate)


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """Correlation of two added rates (N, 3), about zero, all axes together; 0 where one of them is zero."""
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.sum(first * second)) / size if size > 0 else 0.0


def as_effect(form: LawForm, name: str = "discovered.law", rms: float = 1.0, equation: str = "") -> Effect:
    """The form as an effect; rms: of its products in the recording, which sets its plausible size."""
    unit, text = form.coefficient_unit, equation or equation_of(form)
    return Effect(
        id=name,
        equation=text,
        parameter=Parameter("coefficients", (form.size,), unit, DEG, plausible=PLAUSIBLE_RPS / max(rms, 1e-12)),
        observable_in=("still", "turn"),
        columns=lambda movement: columns_of(form, movement),
        describe=lambda theta: f"follows {text} (up to {np.abs(theta).max() / DEG:.3g} {unit})",
        discriminating_motion=splits(form),
        conditions=regime(form),
        inputs=form.inputs,
        reach=form.reach,
        exact_distort=lambda movement, theta: distorted(form, movement, theta),
        device=NoC("no C has been written for it"),
    )


# The C of a law that a device can invert, with the NumPy that does the same in single precision; or the reason why there is none.
#
# A device knows the rate and the temperature of the sample.  Only sums, products and comparisons give the same bits in single precision on
# every processor, so a law of other functions has no C.

#: quantity -> why a device cannot compute it
WHY_NOT = {
    **dict.fromkeys(("level", "world"), "it follows the heading, which the device does not know"),
    **dict.fromkeys(("acceleration", "acceleration_size", "speed_slope", "jerk", "vibration"), "it needs samples that are yet to come"),
    "time": "it belongs to the time of that one session",
    "turned": "it follows the angle turned since its session began",
    **dict.fromkeys(("rest", "sense"), "it follows its session from the beginning"),
    "force": "it follows a mean of the force, to which samples belong that are yet to come",
    "temperature_rate": "it follows the last ten seconds of the temperature, and C does not know the data rate",
    "rate_size": "it asks for a square root, which C has no code for here",
}
#: NumPy's functions that C has
IN_C = SimpleNamespace(
    abs=abs,
    clip=lambda x, low, high: where(x < low, low, where(x > high, high, x)),
    maximum=lambda x, least: where(x > least, x, least),
    where=where,
)
#: a factor's argument in C: the rate as a share of full scale, or the temperature since the first sample
ARGUMENTS = {"rate": InC("u"), "temperature": InC("t")}
#: of 1 dps and more, by which the rate counts as a turn's
SHARE = """\
    const float s = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - {0}_STILL[0]) * {0}_TURNS[0];
    const float m = s < 0.0f ? 0.0f : (s > 1.0f ? 1.0f : s);
"""


def why_not(form: LawForm) -> str:
    """Why a device cannot invert it, or empty."""
    for factor in form.factors:
        if factor.quantity in WHY_NOT:
            return WHY_NOT[factor.quantity]
    if any(factor.lag_s is not None for factor in form.factors):
        return "it remembers by a lag, and C does not know the data rate"
    if any(factor.through.memory for factor in form.factors):
        return "it follows its session from the beginning"
    if jumps(form):
        return "where it jumps a reading may belong to two rates, which only the samples before decide"
    try:
        [factor.through.on(InC("x"), InC("c"), IN_C) for factor in form.factors]
    except (AttributeError, TypeError):
        return "it asks for a root, an exponential or a sine, whose last bits differ from one processor to another"
    return ""


def device_of(form: LawForm, name: str, passes: int | None, fs_rps: float | None = None, first_temp_c: float | None = None) -> StageC | NoC:
    """The stage that inverts a law; name: of the law; passes: of rate <- measured - added(rate) that do so, None where none do; fs_rps,
    first_temp_c: those that it refers to, None: those of the session."""
    if why := why_not(form):
        return NoC(why)
    if passes is None:
        return NoC(f"it is so strong that {MOST_PASSES} passes do not invert it")
    # The prefix of the constants in C is unique among the stages of a program.
    prefix, count, each = f"LAW_{name.upper()}", len(form.factors), form.size // 3
    of_rate, warm = ({factor.quantity for factor in form.factors} & {name} for name in ("rate", "temperature"))
    passes = passes if of_rate else 1
    texts = [factor.through.on(ARGUMENTS[factor.quantity], InC(f"{prefix}_{'AB'[n]}[0]"), IN_C) for n, factor in enumerate(form.factors)]
    places = [[parts[n][1] for _, parts in form.terms()] for n in range(count)]
    products = [" * ".join([f"k[{number}]", *(f"{'xy'[n]}[{places[n][number]}]" for n in range(count))]) for number in range(form.size)]
    lines = [f"const float *k = {prefix};", "float w[3] = {r[0], r[1], r[2]};"]
    lines += [f"const float t = in->temp_c - {prefix}_AT_C[0];"] if warm else []
    lines += [f"for (int pass = 0; pass < {passes}; pass++) {{", f"    float {', '.join(f'{x}[3]' for x in 'xy'[:count])};"]
    lines += [SHARE.format(prefix) + "    for (int i = 0; i < 3; i++) {" if of_rate else "    for (int i = 0; i < 3; i++) {"]
    lines += [f"        const float u = m * w[i] * {prefix}_PER_FS[0];"] if of_rate else []
    lines += [*(f"        {x}[i] = {text.text};" for x, text in zip("xy", texts, strict=False)), "    }"]
    lines += [f"    w[{axis}] = r[{axis}] - ({' + '.join(products[each * axis : each * (axis + 1)])});" for axis in range(3)]
    lines += ["}", "for (int i = 0; i < 3; i++)", "    r[i] = w[i];"]

    def constants(theta: np.ndarray, known: Conditions) -> dict[str, np.ndarray]:
        found = {"": theta} | {f"_{'AB'[n]}": [f.constant] for n, f in enumerate(form.factors) if f.constant is not None}
        if of_rate:
            still, turns = signals.MOVING_RPS**2, signals.FULLY_MOVING_RPS**2
            found |= {"_PER_FS": [1 / (fs_rps or known.fs_rps)], "_STILL": [still], "_TURNS": [1 / (turns - still)]}
        if warm:
            found["_AT_C"] = [known.first_temp_c if first_temp_c is None else first_temp_c]
        return {f"{prefix}{ending}": np.array(values) for ending, values in found.items()}

    def run(c: dict[str, np.ndarray], rate: np.ndarray, inputs: Any) -> np.ndarray:
        w, values = rate, dict[str, np.ndarray]()
        if warm:
            values["temperature"] = (inputs.temp_c - c[f"{prefix}_AT_C"])[:, None]
        for _ in range(passes):
            if of_rate:
                square = w[:, :1] * w[:, :1] + w[:, 1:2] * w[:, 1:2] + w[:, 2:] * w[:, 2:]
                share = np.clip((square - c[f"{prefix}_STILL"]) * c[f"{prefix}_TURNS"], 0, 1)
                values["rate"] = share * w * c[f"{prefix}_PER_FS"]
            added = c[prefix]
            for n, factor in enumerate(form.factors):
                part = factor.through.on(values[factor.quantity], c.get(f"{prefix}_{'AB'[n]}"), np)
                added = added * part.astype(np.float32)[:, places[n]]
            w = rate - sum(added[:, number::each] for number in range(each))
        return w

    return StageC(f"r -= the law discovered.{name}", "\n".join(lines), constants, run)


# A law with its numbers, as its file states them (``effect_file.py``).

#: plausible size over the size found: a proof (``tinygc.effects.testing``) injects a twentieth of it
PLAUSIBLE = 20.0
#: factors on the constant found, at which another unit's own constant is searched
GRID = np.array([0.5, 0.63, 0.8, 1, 1.25, 1.6, 2])


def law_effect(
    name: str,
    form: LawForm,
    theta: np.ndarray,
    covariance: np.ndarray,
    *,
    sigmas: Sequence[float] = (),
    full_scale_dps: float | None = None,
    first_temp_c: float | None = None,
    passes: int = PASSES,
    passes_in_c: int | None = PASSES,
    not_observed: Sequence[Sequence[float]] = (),
) -> Effect:
    """A law as an effect.

    theta (P,) and covariance (P, P) SI: what a session gave, with which another of the unit must agree; sigmas: of the form's constants, in
    their own units; full_scale_dps, first_temp_c: what the law calls FS and T0, in every session, those of each session where None;
    passes: of substitution that invert it, passes_in_c: in C, None where none do; not_observed (q, P): combinations of the coefficients
    that the session did not observe, and that the law is without.
    """
    fs_rps = None if full_scale_dps is None else full_scale_dps * DEG
    known: dict[str, Any] = {key: value for key, value in {"fs_rps": fs_rps, "first_temp_c": first_temp_c}.items() if value is not None}
    seen, jumping, (unit, parameter) = np.eye(form.size), jumps(form), coefficient_unit(form)
    if len(not_observed):
        seen = seen - np.linalg.pinv(np.array(not_observed)) @ np.array(not_observed)

    def at(form: LawForm) -> Effect:
        """What the law does, with these constants."""

        def distort(movement: Movement, theta: np.ndarray) -> np.ndarray:
            return distorted(form, replace(movement, **known), seen @ theta)

        def correct(measured: np.ndarray, movement: Movement, theta: np.ndarray) -> np.ndarray:
            """Where it jumps, a reading may belong to two rates: the one that goes on smoothly."""
            return undone_with_jumps(measured, movement, lambda moved: distort(moved, theta) - moved.rate, passes)

        # Each pass of an inversion that jumps looks back once more; a reach to the log's beginning does not grow.
        reach = form.reach if not jumping else form.reach.times(1 if form.remembers else passes + 2) + JUMPS_REACH
        device = device_of(form, name.partition(".")[2], passes_in_c, fs_rps, first_temp_c)
        return replace(
            as_effect(form, name),
            columns=lambda movement: columns_of(form, replace(movement, **known)) @ seen,
            exact_distort=distort,
            exact_correct=correct if jumping else None,
            reach=reach,
            device=NoC("part of it was not observed, and its C would apply that part") if len(not_observed) else device,
        )

    def anywhere(text: str) -> str:
        """Reword text about one session so that it holds in any."""
        if full_scale_dps is not None:
            text = text.replace("ω / FS", f"ω / ({full_scale_dps:.6g} dps)").replace("of full scale", f"of {full_scale_dps:.6g} dps")
        if first_temp_c is not None:
            text = text.replace("T in °C", f"T in °C, T₀ = {first_temp_c:g} °C")
            text = text.replace("since the session's beginning", f"above {first_temp_c:g} °C")
        return text

    scan, stated = None, None
    if len(form.constants) == 1:
        (constant,), (own,) = constants_of(form, sigmas), form.constants
        stated = None if constant.sigma is None else (own, constant.sigma * constant.si)
        scan = Scan(
            constant.json,
            constant.unit or "fraction",
            make=lambda value: replace(found, **_action(at(form.with_constants((value,))))),
            si=constant.si,
            grid=lambda movements: own * GRID,
            smooth=True,
        )
    found = replace(
        at(form),
        equation=anywhere(equation_of(form)),
        parameter=Parameter(parameter, form.parameter_shape, unit, DEG, plausible=float(f"{PLAUSIBLE * rms_of(theta) / DEG:.2g}") * DEG),
        observable_in=observable_in(form),
        describe=lambda theta: f"the rate is off by {abs(largest(theta)) / DEG:.3g} {unit} on {axis_of(theta)}: {anywhere(follows(form))}",
        passes=None if jumping or passes == PASSES else passes,
        scan=scan,
        reference_conditions=ReferenceConditions(**known),
        gauge_convention=Convention(lambda theta: seen @ theta, lambda theta: seen) if len(not_observed) else None,
        stated=StatedNumbers(np.array(theta), np.array(covariance), stated),
        known_to=known_to(form),
        picture=SCALE_LAW if form.is_scale_law else None,
    )
    return found


def _action(effect: Effect) -> dict:
    return {name: getattr(effect, name) for name in ("columns", "exact_distort", "exact_correct", "reach", "device")}
