"""Draw the hidden effects of each session, and simulate it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from session.io.units import MDPS, MG
from tinygc.annexes.challenge.other_effects import OTHER_EFFECTS, OUTSIDERS
from tinygc.annexes.challenge.rate_effects import RATE_EFFECTS, Concealment, Maker, Scene
from tinygc.simulation.movement import MovementPlan
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulator import Distort, Disturb, Simulation, plan_of, simulate_session
from tinygc.simulation.write import config_text

# Draw the hidden effects, their sizes and the session's options; nothing is simulated yet.

STRENGTHS = (1.0, 0.5, 0.2, 0.05)
#: shares of sessions by number of hidden catalogue effects; outside: one unknown to any catalogue, beside: with one or two of the catalogue
SHARES = {"nothing": 0.20, "one": 0.35, "two": 0.10, "three": 0.10, "four": 0.07, "outside": 0.08, "beside": 0.10}
HOW_MANY = {"two": 2, "three": 3, "four": 4}
#: of three and more, one is strong; weighted strengths of the others: the weakest of STRENGTHS is below the residuals of three others
OTHERS, OTHERS_WEIGHT = (1.0, 0.5, 0.2), (0.3, 0.4, 0.3)
#: session options without which an effect is not observable
NEEDS = {
    "gyro.thermal_bias": {"warm_up_c": 10.0},
    "gyro.thermal_scale": {"warm_up_c": 10.0},
    "outside.temperature_curve": {"warm_up_c": 10.0},
    "earth.rotation": {"latitude_deg": 60.0, "segments": 80},
}
#: never two of these at once: all contain a common delay of the axes, so they cannot be distinguished
DELAYS = {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew", "timing.gyro_accel_offset"}
#: nor of these: in a log of minutes a warm-up is nearly a straight line, a jump nearly an oscillation, one bend nearly the other
ALIKE = (
    DELAYS,
    {"gyro.bias_drift", "gyro.thermal_bias", "outside.temperature_curve"},
    {"gyro.bias_drift", "gyro.bias_step", "outside.oscillation", "outside.telegraph"},
    {"gyro.scale_nonlinearity", "outside.root_scale"},
    {"gyro.scale_asymmetry", "outside.root_scale"},
    {"data.glitches", "timing.dropped_samples"},
)
#: effects that may be hidden with others: all that change the rate, the reference, and one fault of the registers
TOGETHER = (*RATE_EFFECTS, "reference.accelerometer", "data.glitches", "timing.dropped_samples")
#: nominal data rate, Hz -> share of the sessions
RATES = {62.5: 0.15, 104.0: 0.25, 208.0: 0.40, 416.0: 0.13, 833.0: 0.07}
#: least Hz at which an effect is observable: vibration must pass the accelerometer's filter, and a burst must be shorter than a turn's ramp
LEAST_HZ = {
    **dict.fromkeys(DELAYS, 104.0),
    "gyro.vibration_rectification": 208.0,
    "data.glitches": 104.0,
    "timing.dropped_samples": 104.0,
}
MOST_INSTABILITY_DPH = 10.0
#: the bias instability in session.toml: the drawn value; a model, whose typical value is another; or nothing
INSTABILITY_SOURCES = ("stated", "model", "nothing")
SEGMENTS, SEGMENTS_OF_MANY = (30, 51), (40, 61)


@dataclass(frozen=True)
class Case:
    """The hidden effects of one session: ids, the strength of each, the session's options, a seed for the rest, and what its session.toml
    has of the bias instability, one of ``INSTABILITY_SOURCES``."""

    name: str
    ids: tuple[str, ...]
    strengths: tuple[float, ...]
    options: SimulationOptions
    seed: int
    instability_source: str = "model"

    @property
    def strength(self) -> float | None:
        """Strength of the weakest effect; None where nothing is hidden."""
        return min(self.strengths, default=None)


def draw_cases(count: int, seed: int, segments: int | None = None) -> list[Case]:
    """Draw ``count`` cases in random order; effects and strengths alternate, so that few cases cover as much as possible."""
    rng = np.random.default_rng(seed)
    number = shared_out(count, SHARES)
    alone: list[tuple[str, ...]] = [(name,) for name in taking_turns([*RATE_EFFECTS, *OTHER_EFFECTS], number["one"], rng)]
    alone += [(name,) for name in taking_turns(list(OUTSIDERS), number["outside"], rng)]
    alone += [_together((), 2, RATE_EFFECTS, rng) for _ in range(number["two"])]
    # In sorted order, each effect takes every strength before it repeats one, and so do all together.
    alone.sort(key=lambda ids: (len(ids), ids))
    turns = [STRENGTHS[i] for i in rng.permutation(len(STRENGTHS))]
    hidden: list[tuple[tuple[str, ...], tuple[float, ...]]] = [((), ())] * number["nothing"]
    for i, ids in enumerate(alone):
        hidden.append((ids, (1.0 if ids == ("earth.rotation",) else turns[i % len(turns)],) * len(ids)))
    for kind in ("three", "four"):
        for _ in range(number[kind]):
            ids = _together((), HOW_MANY[kind], TOGETHER, rng)
            hidden.append((ids, _one_strong(len(ids), rng)))
    for outsider in taking_turns(list(OUTSIDERS), number["beside"], rng):
        ids = _together((outsider,), int(rng.integers(2, 4)), TOGETHER, rng)
        hidden.append((ids, _one_strong(len(ids), rng)))
    source = [INSTABILITY_SOURCES[i] for i in rng.permutation(np.arange(len(hidden)) % len(INSTABILITY_SOURCES))]
    order = rng.permutation(len(hidden))
    return [case_of(place, *hidden[int(i)], source[int(i)], rng, segments) for place, i in enumerate(order)]


def shared_out(count: int, shares: Mapping[str, float]) -> dict[str, int]:
    """Number of sessions of each kind, ``count`` in all, by largest remainders."""
    number = {kind: int(share * count + 1e-9) for kind, share in shares.items()}
    by_remainder = sorted(shares, key=lambda kind: number[kind] - shares[kind] * count)
    for kind in by_remainder[: count - sum(number.values())]:
        number[kind] += 1
    return number


def taking_turns(items: list[str], count: int, rng: np.random.Generator) -> list[str]:
    """``count`` of the items, each once in random order before any is repeated."""
    rounds = -(-count // len(items))
    return [items[i] for _ in range(rounds) for i in rng.permutation(len(items))][:count]


def _together(first: tuple[str, ...], count: int, among: Any, rng: np.random.Generator) -> tuple[str, ...]:
    """``count`` ids that can be distinguished: ``first``, and others of ``among``."""
    ids = first
    for name in rng.permutation(list(among)):
        if len(ids) < count and not any(str(name) in group and group & set(ids) for group in ALIKE):
            ids = (*ids, str(name))
    return ids


def _one_strong(count: int, rng: np.random.Generator) -> tuple[float, ...]:
    strengths = rng.choice(OTHERS, count, p=OTHERS_WEIGHT)
    strengths[rng.integers(count)] = 1.0
    return tuple(map(float, strengths))


def case_of(
    place: int,
    ids: tuple[str, ...],
    strengths: tuple[float, ...],
    source: str,
    rng: np.random.Generator,
    segments: int | None,
    needed: Mapping[str, Mapping[str, float]] = NEEDS,
    rates: Mapping[float, float] = RATES,
    least_hz: Mapping[str, float] = LEAST_HZ,
) -> Case:
    """The case at a place with its hidden effects and drawn options; needed, least_hz: options and data rate that an id requires;
    rates: nominal Hz -> share."""
    needs = {name: value for effect in ids for name, value in needed.get(effect, {}).items()}
    drawn: dict[str, Any] = {
        "segments": int(rng.integers(*(SEGMENTS if len(ids) < 3 else SEGMENTS_OF_MANY))),
        "seed": int(rng.integers(2**31)),
        "vigour": float(rng.uniform(0.8, 1.2)),
        "gyro_noise_dps_rthz": float(rng.uniform(0.004, 0.007)),
        "warm_up_c": float(rng.uniform(0.5, 5)),
        "bias_instability_dph": round(float(rng.uniform(0, MOST_INSTABILITY_DPH)), 2),
        "odr_hz": _data_rate(ids, rng, rates, least_hz),
    }
    chosen = drawn | needs | ({} if segments is None else {"segments": segments})
    options = SimulationOptions(closure_s=0.0, **chosen)
    return Case(f"case{place + 1:03d}", ids, strengths, options, int(rng.integers(2**31)), source)


def _data_rate(ids: tuple[str, ...], rng: np.random.Generator, rates: Mapping[float, float], least_hz: Mapping[str, float]) -> float:
    least = max((least_hz.get(name, 0.0) for name in ids), default=0.0)
    enough = {hz: share for hz, share in rates.items() if hz >= least}
    return float(rng.choice(list(enough), p=np.array(list(enough.values())) / sum(enough.values())))


# Simulate a case: the session, its session.toml, and the truth.

MAKERS: dict[str, Maker] = {**RATE_EFFECTS, **OTHER_EFFECTS, **OUTSIDERS}
MODEL_LINE = 'model = "ASM330LHH"'


def drawn(case: Case, makers: Mapping[str, Maker] = MAKERS) -> tuple[list[Concealment], MovementPlan]:
    """The hidden effects of a case, in the order in which they change the rate, and the movement that they were drawn for."""
    rng, plan = np.random.default_rng(case.seed), plan_of(case.options)
    hidden = [makers[name](Scene(rng, strength, case.options, plan)) for name, strength in zip(case.ids, case.strengths, strict=True)]
    return hidden, plan


def conceal(case: Case, makers: Mapping[str, Maker] = MAKERS) -> tuple[Simulation, str, dict[str, dict]]:
    """The session of a case, its session.toml, and the truth: id -> parameters."""
    hidden, plan = drawn(case, makers)
    for one in hidden:
        plan = one.movement(plan) if one.movement else plan
    simulation = simulate_session(case.options, _distort(hidden), plan=plan, disturb=_disturb(hidden))
    truth = {one.id: dict(one.truth) for one in hidden}
    for one in hidden:
        if one.spoil:
            log, more = one.spoil(simulation.log)
            simulation = replace(simulation, log=log)
            truth[one.id] |= more
    return simulation, _silent(simulation, case.instability_source, any(one.without_latitude for one in hidden)), truth


def _distort(hidden: list[Concealment]) -> Distort | None:
    functions = [one.distort for one in hidden if one.distort]

    def distort(t: np.ndarray, rate: np.ndarray, force: np.ndarray, temp: np.ndarray) -> np.ndarray:
        for function in functions:
            rate = function(t, rate, force, temp)
        return rate

    return distort if functions else None


def _disturb(hidden: list[Concealment]) -> Disturb | None:
    functions = [one.disturb for one in hidden if one.disturb]

    def disturb(t: np.ndarray, force: np.ndarray) -> np.ndarray:
        for function in functions:
            force = function(t, force)
        return force

    return disturb if functions else None


def _silent(simulation: Simulation, source: str, without_latitude: bool) -> str:
    """session.toml without its remarks, from which the session could be reproduced; source: of the bias instability, as in ``Case``."""
    stated = f"\ngyro_bias_instability_dph = {simulation.options.bias_instability_dph!r}" if source == "stated" else ""
    sensor = MODEL_LINE if source == "model" else f'model = "unnamed"{stated}\n{_units_stated(simulation.options)}'
    lines = config_text(simulation, concealed=False).replace(MODEL_LINE, sensor).split("\n")
    return "\n".join(
        line for line in lines if not line.startswith("#") and not (without_latitude and line.startswith(("latitude_deg", "heading_deg")))
    )


def _units_stated(options: SimulationOptions) -> str:
    """Register units of an unspecified sensor."""
    units, thermometer = options.register_units, options.register_units.thermometer
    stated = {"gyro_mdps_per_lsb": round(units.gyro_rps / MDPS, 9), "accel_mg_per_lsb": round(units.accel_mps2 / MG, 9)}
    if thermometer is not None:
        stated |= {"temp_lsb_per_c": thermometer.lsb_per_c, "temp_at_zero_c": thermometer.at_zero_c}
    return "\n".join(f"{key} = {value!r}" for key, value in stated.items())


def options_chosen(options: SimulationOptions) -> dict:
    """Options that differ from the default, for the truth file."""
    return {field.name: getattr(options, field.name) for field in fields(options) if getattr(options, field.name) != field.default}
