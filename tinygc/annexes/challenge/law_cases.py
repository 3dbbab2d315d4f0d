"""Sessions that hide a law, and what was said of them, as curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.io.samples import Samples
from session.io.units import DEG
from tinygc.annexes.challenge.cases import LEAST_HZ, MAKERS, NEEDS, STRENGTHS, TOLD, Case, case_of, drawn, taking_turns
from tinygc.annexes.challenge.laws import BY_HAND, LAWS
from tinygc.annexes.challenge.rate_effects import RATE_EFFECTS
from tinygc.effects import Conditions, Effect, EffectError, Movement, Parts, catalogue, movement_of, using
from tinygc.simulation import simulator
from tinygc.simulation.options import GYRO_LPF2_HZ
from tinygc.simulation.simulator import fine_grid, true_signals, unit_of

# Draw what each session hides: a law, nothing, an effect of the catalogue, or that and a law.

#: shares of what is hidden; ``drawn``: a law from the random grammar
SHARES = {"nothing": 0.25, "catalogue": 0.10, "beside": 0.10, "by hand": 0.37, "drawn": 0.18}
WARM = {"warm_up_c": 10.0}
NEEDED = {
    **NEEDS,
    "law.temperature_rate": WARM,
    "law.package_strain": WARM,
    "law.temperature_curve": WARM,
    "law.warm_gravity": WARM,
    "law.warm_square": WARM,
    "law.random": WARM,
}
#: Hz: tremor and a suspension must pass, and beyond 208 Hz nothing is gained but time
RATES = {104.0: 0.3, 208.0: 0.6, 416.0: 0.1}
LEAST = {**LEAST_HZ, "law.vibration_scale": 208.0, "law.resonance": 208.0}
SEGMENTS = (38, 49)
#: of an effect beside a law, which is to be named, not to be missed
BESIDE = (1.0, 0.5)
#: of the catalogue, beside these: what they share is a delay, a course over time or a bend of the scale, and nobody could say which has it
_DELAYS = {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew", "timing.gyro_accel_offset"}
_COURSES = {"gyro.thermal_bias", "gyro.bias_drift", "gyro.bias_step"}
_GRAVITY = {"gyro.g_sensitivity"}
_BENDS = {"gyro.scale_nonlinearity", "gyro.scale_asymmetry"}
ALIKE = {
    "law.resonance": _DELAYS,
    "law.drive_recovery": _DELAYS | _BENDS,
    **dict.fromkeys(("law.magnetic_zero", "law.gravity_creep", "law.warm_gravity"), _GRAVITY),
    **dict.fromkeys(("law.sag_recovery", "law.temperature_rate", "law.package_strain", "law.temperature_curve", "law.telegraph"), _COURSES),
    **dict.fromkeys(("law.drive_droop", "law.dead_zone", "law.root_scale", "law.soft_limit", "law.warm_square"), _BENDS),
    "law.vibration_scale": {"gyro.vibration_rectification"},
    "law.anisoelastic": {"gyro.g2_sensitivity"},
}


def draw_discover_cases(count: int, seed: int, segments: int | None = None) -> list[Case]:
    """``count`` cases; laws and strengths take turns.  A law comes first: it bends the true rate.

    A case depends on its place and the seed, not on how many follow: fewer cases are the first of more.
    """
    kinds = _kinds(count)
    number = {kind: kinds.count(kind) for kind in SHARES}
    # One stream for each list, so that the length of one moves no other.
    streams = [np.random.default_rng([seed, stream]) for stream in range(5)]
    turns = [STRENGTHS[i] for i in streams[0].permutation(len(STRENGTHS))]
    told = taking_turns(list(TOLD), count, streams[1])
    firsts = {
        "by hand": taking_turns(list(BY_HAND), number["by hand"], streams[2]),
        "beside": taking_turns(list(BY_HAND), number["beside"], streams[3]),
        "catalogue": taking_turns(list(RATE_EFFECTS), number["catalogue"], streams[4]),
        "drawn": ["law.random"] * number["drawn"],
    }
    given = dict.fromkeys(SHARES, 0)
    cases = []
    for place, kind in enumerate(kinds):
        rng, turn = np.random.default_rng([seed, len(streams), place]), given[kind]
        given[kind] += 1
        ids: tuple[str, ...] = (firsts[kind][turn],) if kind in firsts else ()
        strengths: tuple[float, ...] = (turns[turn % len(turns)],) if kind in firsts else ()
        if kind == "beside":
            other = str(rng.choice([name for name in RATE_EFFECTS if name not in ALIKE.get(ids[0], ())]))
            ids, strengths = (*ids, other), (*strengths, float(rng.choice(BESIDE)))
        length = int(rng.integers(*SEGMENTS)) if segments is None else segments
        cases.append(case_of(place, ids, strengths, told[place], rng, length, NEEDED, RATES, LEAST))
    return cases


def _kinds(count: int) -> list[str]:
    """Of each place, the kind that is furthest behind its share: whatever the count, all are there as often as they should."""
    kinds: list[str] = []
    for place in range(count):
        kinds.append(max(SHARES, key=lambda kind: SHARES[kind] * (place + 1) - kinds.count(kind)))
    return kinds


# What a case's concealments add to the rate, as the sensor's samples would show it without noise.

#: all that may be hidden
ALL = {**MAKERS, **LAWS}


@dataclass(frozen=True, eq=False)
class AddedRate:
    """At the recorded samples, behind the chip's low-pass: the true movement, without noise and without what is hidden of the rate; what
    the law adds (N, 3), zero where none is hidden, and what effects of the catalogue add after it, by id; rad/s."""

    movement: Movement
    law: np.ndarray
    catalogue: dict[str, np.ndarray]


def added_rate(case: Case) -> AddedRate:
    """The same draws as in ``conceal``."""
    hidden, plan = drawn(case, ALL)
    options, unit = case.options, unit_of(case.options)
    t, factor, run_up = fine_grid(unit.odr_hz, int(np.ceil(plan.log_s * unit.odr_hz)))
    rate, force, temp = true_signals(options, unit, plan, t)

    def sampled(values: np.ndarray, hz: float = GYRO_LPF2_HZ[options.odr_hz]) -> np.ndarray:
        return simulator.low_pass(values, hz, 0.0, unit.odr_hz, factor, np.random.default_rng(0))[run_up:]

    felt = force
    for one in hidden:
        felt = felt if one.disturb is None else one.disturb(t, felt)
    law, catalogue, now = np.zeros((len(t) // factor - run_up, 3)), {}, rate
    for one in hidden:
        if one.distort is None:
            continue
        after = one.distort(t, now, force, temp)
        if one.id in LAWS:
            law = law + sampled(after - now)
        else:
            catalogue[one.id] = sampled(after - now)
        now = after
    samples = Samples(
        np.rint(1e9 * t[run_up * factor :: factor]).astype(np.int64),
        sampled(rate),
        sampled(felt, simulator.ACCEL_BANDWIDTH_ODR * unit.odr_hz),
        temp[run_up * factor :: factor],
    )
    known = Conditions(plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c)
    return AddedRate(movement_of(samples, samples.gyro, known), law, catalogue)


# What was said of a session, as a curve: what its laws, or the names of the catalogue, add to the rate of a movement.

#: of an explain folder
EFFECTS = "effects"


def added_by_laws(laws: Sequence[dict], folder: Path, movement: Movement) -> list[np.ndarray]:
    """Of each law of ``discovery.laws``, (N, 3) rad/s; folder: the explain folder with their files, which are run as Python.

    Raises EffectError for a file that is missing or broken, or holds another id or other parameters than were said.
    """
    if not laws:
        return []
    places = {str((folder / law["file"]).parent) for law in laws}
    with using(sorted(places)):
        known = catalogue()
        missing = [law["id"] for law in laws if law["id"] not in known]
        if missing:
            raise EffectError(f"{folder}: no file defines {', '.join(missing)}")
        constants = [{name: each["value"] for name, each in law.get("constants", {}).items()} for law in laws]
        return [added(known[law["id"]], own | law["parameters"], movement) for law, own in zip(laws, constants, strict=True)]


def added_by_names(effects: Sequence[dict], movement: Movement) -> np.ndarray | None:
    """Of all ``effects`` of ``tinygc-explain/1`` that bend the rate, together (N, 3) rad/s; None where there is none."""
    known = catalogue()
    curves = [
        added(known[each["id"]], each["parameters"], movement)
        for each in effects
        if each["id"] in known and known[each["id"]].kind == "rate"
    ]
    return sum(curves[1:], curves[0]) if curves else None


def added(effect: Effect, told: dict, movement: Movement) -> np.ndarray:
    """(N, 3) rad/s of an effect with parameters by their JSON names, in their units."""
    if effect.scan is not None and effect.scan.name in told:
        effect = effect.at(float(np.ravel(told[effect.scan.name])[0]) * effect.scan.si)
    for form in (effect, effect.wider, effect.of_readings):
        theta = None if form is None else _theta(form, told)
        if form is not None and theta is not None:
            return form.distort(movement, theta) - movement.rate
    raise EffectError(f"{effect.id}: its parameters are {', '.join(told)}, expected {effect.parameter.size} of {effect.parameter.name}")


def _theta(effect: Effect, told: dict) -> np.ndarray | None:
    """(P,) SI; None where what was told is of another form."""
    if isinstance(effect.derived, Parts):
        return effect.derived.theta(told) if all(name in told for name, _, _ in effect.derived.parts) else None
    value = told.get(effect.parameter.name)
    if value is None or np.size(value) != effect.parameter.size:
        return None
    return np.ravel(value).astype(float) * effect.parameter.si
