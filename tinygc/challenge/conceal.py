"""Draw what each session hides, and simulate it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tinygc.challenge.concealment import Concealment, Maker, Scene
from tinygc.challenge.other_effects import OTHER_EFFECTS
from tinygc.challenge.outsiders import OUTSIDERS
from tinygc.challenge.rate_effects import RATE_EFFECTS
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.simulate import Distort, Disturb, Simulation, plan_of, simulate_session
from tinygc.simulation.write import config_text

STRENGTHS = (1.0, 0.5, 0.2, 0.05)
#: shares of what is hidden: nothing, one effect, two rate effects, one outsider
NOTHING, ONE, TWO = 1 / 5, 1 / 2, 1 / 6
#: what a session must have for an effect to show at all
NEEDS = {
    "gyro.thermal_bias": {"warm_up_c": 10.0},
    "gyro.thermal_scale": {"warm_up_c": 10.0},
    "outside.temperature_curve": {"warm_up_c": 10.0},
    "earth.rotation": {"latitude_deg": 60.0, "segments": 80},
}
#: not two of these at once: what they share is a delay of all axes, and nobody could say which has it
DELAYS = {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew", "timing.gyro_accel_offset"}
MAKERS: dict[str, Maker] = {**RATE_EFFECTS, **OTHER_EFFECTS, **OUTSIDERS}


@dataclass(frozen=True)
class Case:
    """What one session hides: ids, their strength (None where nothing is hidden), the session's options, a seed for the rest."""

    name: str
    ids: tuple[str, ...]
    strength: float | None
    options: SimulationOptions
    seed: int


def draw_cases(count: int, seed: int, segments: int | None = None) -> list[Case]:
    """``count`` cases in random order; effects and strengths take turns, so that few cases show as much as they can."""
    rng = np.random.default_rng(seed)
    nothing, one, two = (round(share * count) for share in (NOTHING, ONE, TWO))
    two = min(two, count - nothing - one)
    singles = _taking_turns([*RATE_EFFECTS, *OTHER_EFFECTS], one, rng)
    outside = _taking_turns(list(OUTSIDERS), count - nothing - one - two, rng)
    hidden: list[tuple[str, ...]] = [*[()] * nothing, *((name,) for name in singles + outside), *(_pair(rng) for _ in range(two))]
    # Side by side, each effect goes through all strengths before it repeats one, and so do all together.
    hidden.sort(key=lambda ids: (len(ids), ids))
    strengths = [STRENGTHS[i] for i in rng.permutation(len(STRENGTHS))]
    drawn: list[tuple[tuple[str, ...], float | None]] = []
    for i, ids in enumerate(hidden):
        drawn.append((ids, None if not ids else 1.0 if ids == ("earth.rotation",) else strengths[i % len(strengths)]))
    order = rng.permutation(len(drawn))
    return [_case(number, *drawn[int(i)], rng, segments) for number, i in enumerate(order)]


def _taking_turns(items: list[str], count: int, rng: np.random.Generator) -> list[str]:
    rounds = -(-count // len(items))
    return [items[i] for _ in range(rounds) for i in rng.permutation(len(items))][:count]


def _pair(rng: np.random.Generator) -> tuple[str, ...]:
    while True:
        pair = tuple(str(name) for name in rng.choice(list(RATE_EFFECTS), 2, replace=False))
        if not DELAYS.issuperset(pair):
            return pair


def _case(number: int, ids: tuple[str, ...], strength: float | None, rng: np.random.Generator, segments: int | None) -> Case:
    needs = {name: value for effect in ids for name, value in NEEDS.get(effect, {}).items()}
    drawn: dict[str, Any] = {
        "segments": int(rng.integers(30, 51)),
        "seed": int(rng.integers(2**31)),
        "vigour": float(rng.uniform(0.8, 1.2)),
        "gyro_noise_dps_rthz": float(rng.uniform(0.004, 0.007)),
        "warm_up_c": float(rng.uniform(0.5, 5)),
    }
    chosen = drawn | needs | ({} if segments is None else {"segments": segments})
    return Case(f"case{number + 1:03d}", ids, strength, SimulationOptions(closure_s=0.0, **chosen), int(rng.integers(2**31)))


def conceal(case: Case) -> tuple[Simulation, str, dict[str, dict]]:
    """The session of a case, its session.toml, and the truth: id -> parameters."""
    rng, plan = np.random.default_rng(case.seed), plan_of(case.options)
    # Without a strength nothing is hidden, and no scene is asked for one.
    strength = 0.0 if case.strength is None else case.strength
    hidden = [MAKERS[name](Scene(rng, strength, case.options, plan)) for name in case.ids]
    for one in hidden:
        plan = one.movement(plan) if one.movement else plan
    simulation = simulate_session(case.options, _distort(hidden), plan=plan, disturb=_disturb(hidden))
    truth = {one.id: dict(one.truth) for one in hidden}
    for one in hidden:
        if one.spoil:
            log, more = one.spoil(simulation.log)
            simulation = replace(simulation, log=log)
            truth[one.id] |= more
    return simulation, _silent(simulation, any(one.without_latitude for one in hidden)), truth


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


def _silent(simulation: Simulation, without_latitude: bool) -> str:
    """session.toml without its remarks, which would tell how to make the session again."""
    lines = config_text(simulation, concealed=False).split("\n")
    return "\n".join(
        line for line in lines if not line.startswith("#") and not (without_latitude and line.startswith(("latitude_deg", "heading_deg")))
    )


def options_chosen(options: SimulationOptions) -> dict:
    """Those that are not the default, for the truth file."""
    return {field.name: getattr(options, field.name) for field in fields(options) if getattr(options, field.name) != field.default}
