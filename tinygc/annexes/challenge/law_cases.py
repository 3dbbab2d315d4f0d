"""Draw sessions with a hidden law, and compute the added rates of the truth and of the answers."""

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

# Draw the hidden effect of each session: a law, nothing, an effect of the catalogue, or one together with a law.

#: shares of sessions by hidden effects; ``drawn``: a law from the random grammar
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
#: Hz: tremor and a suspension must pass, and rates beyond 208 Hz only take more time
RATES = {104.0: 0.3, 208.0: 0.6, 416.0: 0.1}
LEAST = {**LEAST_HZ, "law.vibration_scale": 208.0, "law.resonance": 208.0}
SEGMENTS = (38, 49)
#: strengths of an effect hidden with a law: large enough to be named
BESIDE = (1.0, 0.5)
#: catalogue effects not hidden with these laws: they share a delay, a trend in time or a bend of the scale and cannot be distinguished
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
    """Draw ``count`` cases; laws and strengths alternate.  A law comes first, as it acts on the true rate.

    A case depends on its place and the seed alone: fewer cases are the first of more.
    """
    kinds = _kinds(count)
    number = {kind: kinds.count(kind) for kind in SHARES}
    # One stream for each list, so that the length of one does not affect the others.
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
    """For each place, the kind that is furthest below its share, so that any count has the right proportions."""
    kinds: list[str] = []
    for place in range(count):
        kinds.append(max(SHARES, key=lambda kind: SHARES[kind] * (place + 1) - kinds.count(kind)))
    return kinds


# The rate added by a case's hidden effects, at the sensor's samples and without noise.

#: all effects that may be hidden
ALL = {**MAKERS, **LAWS}


@dataclass(frozen=True, eq=False)
class AddedRate:
    """Signals at the recorded samples, after the chip's low-pass.  movement: the true one, without noise and hidden rate effects;
    law (N, 3): rate added by the law, zero where none is hidden; catalogue: by id, rate added by catalogue effects after it; rad/s."""

    movement: Movement
    law: np.ndarray
    catalogue: dict[str, np.ndarray]


def added_rate(case: Case) -> AddedRate:
    """Compute the added rates, with the same draws as ``conceal``."""
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


# The answer for a session as a curve: the rate that its laws, or its catalogue effects, add to a movement.

#: name of an explain folder
EFFECTS = "effects"


def added_by_laws(laws: Sequence[dict], folder: Path, movement: Movement) -> list[np.ndarray]:
    """Rate added by each law of ``discovery.laws``, (N, 3) rad/s; folder: the explain folder with their files, which are run as Python.

    Raises EffectError for a file that is missing or broken, or whose id or parameters differ from the answer.
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
    """Rate added by all ``effects`` of ``tinygc-explain/1`` together, (N, 3) rad/s; None where none changes the rate."""
    known = catalogue()
    curves = [
        added(known[each["id"]], each["parameters"], movement)
        for each in effects
        if each["id"] in known and known[each["id"]].kind == "rate"
    ]
    return sum(curves[1:], curves[0]) if curves else None


def added(effect: Effect, told: dict, movement: Movement) -> np.ndarray:
    """Rate added by an effect with parameters by their JSON names, in their units, (N, 3) rad/s."""
    if effect.scan is not None and effect.scan.name in told:
        effect = effect.at(float(np.ravel(told[effect.scan.name])[0]) * effect.scan.si)
    for form in (effect, effect.wider, effect.of_readings):
        theta = None if form is None else _theta(form, told)
        if form is not None and theta is not None:
            return form.distort(movement, theta) - movement.rate
    raise EffectError(f"{effect.id}: its parameters are {', '.join(told)}, expected {effect.parameter.size} of {effect.parameter.name}")


def _theta(effect: Effect, told: dict) -> np.ndarray | None:
    """(P,) SI; None where the parameters have another form."""
    if isinstance(effect.derived, Parts):
        return effect.derived.theta(told) if all(name in told for name, _, _ in effect.derived.parts) else None
    value = told.get(effect.parameter.name)
    if value is None or np.size(value) != effect.parameter.size:
        return None
    return np.ravel(value).astype(float) * effect.parameter.si
