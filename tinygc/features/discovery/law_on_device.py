"""The C of a law that a device can undo, with the NumPy that does the same in single precision; or the reason why there is none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from tinygc.effects import Conditions, Cost, NoC, StageC, signals
from tinygc.effects.device import MOST_PASSES, InC, where
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.words import jumps

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
    "temperature_rate": "it follows the last ten seconds of the temperature, and C is not told the data rate",
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
SHARE_COST = Cost(10, 3, 2)


def why_not(form: LawForm) -> str:
    """Why a device cannot undo it, or empty."""
    for factor in form.factors:
        if factor.quantity in WHY_NOT:
            return WHY_NOT[factor.quantity]
    if any(factor.lag_s is not None for factor in form.factors):
        return "it remembers by a lag, and C is not told the data rate"
    if any(factor.through.memory for factor in form.factors):
        return "it follows its session from the beginning"
    if jumps(form):
        return "where it jumps a reading may belong to two rates, which takes the samples before to tell"
    try:
        [factor.through.on(InC("x"), InC("c"), IN_C) for factor in form.factors]
    except (AttributeError, TypeError):
        return "it asks for a root, an exponential or a sine, whose last bits differ from one processor to another"
    return ""


def device_of(form: LawForm, name: str, passes: int | None, fs_rps: float | None = None, first_temp_c: float | None = None) -> StageC | NoC:
    """The stage that undoes a law; name: of the law; passes: of rate <- measured - added(rate) that do so, None where none do; fs_rps,
    first_temp_c: those that it refers to, None: those of the session."""
    if why := why_not(form):
        return NoC(why)
    if passes is None:
        return NoC(f"it is so strong that {MOST_PASSES} passes do not undo it")
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
    once = sum([*(text.cost for text in texts)] * 3, Cost(form.size * count, form.size)) + (SHARE_COST if of_rate else Cost())

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

    formula, cost = f"r -= the law discovered.{name}", sum([once] * passes, Cost(add=len(warm)))
    return StageC(formula, "\n".join(lines), constants, run, cost)
