"""Draw what each session hides: a law, nothing, an effect of the catalogue, or that and a law."""

from __future__ import annotations

import numpy as np

from tinygc.challenge.cases import LEAST_HZ, NEEDS, STRENGTHS, TOLD, Case, case_of, taking_turns
from tinygc.challenge.discover.laws.drawn import DRAWN
from tinygc.challenge.discover.laws.table import BY_HAND
from tinygc.challenge.rate_effects import RATE_EFFECTS

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
        "drawn": list(DRAWN) * number["drawn"],
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
