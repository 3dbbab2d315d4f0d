"""Effects of a lot: what pooling finds of what no unit shows by itself, and how often it names something in a lot with nothing in it.

Whole simulated sessions, each explained; the same units are drawn into many lots for the false alarms.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from common import in_parallel, markdown, simulated

from session.io.units import DEG, G
from tinygc.annexes.lots.effects import pooled
from tinygc.annexes.lots.explanation import effects_of
from tinygc.annexes.lots.lot import NAMES, UnitResult
from tinygc.explanation.engine import explain_session
from tinygc.simulation.options import SimulationOptions


def _asymmetric(t_s, rate, force, temp_c):
    return rate + np.abs(rate) * [6e-5, 0.0, 0.0]


def _g_sensitive(t_s, rate, force, temp_c):
    return rate + np.outer(force[:, 0] / G, [0.0014 * DEG, 0.0, 0.0])


#: what is in all units, 1.4 to 1.7 sigmas of one session's estimate
INJECTED: dict[str, Callable] = {"gyro.scale_asymmetry, 60 ppm of x": _asymmetric, "gyro.g_sensitivity, 1.4 mdps/g of x": _g_sensitive}


@dataclass(frozen=True)
class Job:
    what: str
    seed: int
    segments: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=50, help="of each lot (%(default)s)")
    parser.add_argument("--nothing", type=int, default=200, help="units with nothing in them (%(default)s)")
    parser.add_argument("--lots", type=int, default=200, help="that are drawn from these (%(default)s)")
    parser.add_argument("--segments", type=int, default=16, help="per session (%(default)s)")
    args = parser.parse_args()
    rows = []
    for number, what in enumerate(INJECTED):
        jobs = [Job(what, 1000 * (number + 1) + i, args.segments) for i in range(args.units)]
        found = in_parallel(one_unit, jobs, what)
        effects = pooled([unit for unit, _ in found])
        alone = sum(bool(named) for _, named in found)
        rows.append([what, len(found), alone, "; ".join(_words(*each) for each in effects.items()) or "nothing"])
    print(markdown(["in each unit", "units", "named alone in", "found in the lot"], rows))
    if not args.nothing:
        return
    none = in_parallel(one_unit, [Job("", 9000 + i, args.segments) for i in range(args.nothing)], "nothing")
    units, rng = [unit for unit, _ in none], np.random.default_rng(0)
    apart = [units[i : i + args.units] for i in range(0, len(units) - args.units + 1, args.units)]
    drawn = [[units[i] for i in rng.choice(len(units), min(args.units, len(units)), replace=False)] for _ in range(args.lots)]
    print(
        f"\nNothing in {len(units)} units: together {'something is' if pooled(units) else 'nothing is'} named; of {len(apart)} lots of "
        f"{args.units} without a unit in common {sum(bool(pooled(lot)) for lot in apart)} name something; of {len(drawn)} that are drawn "
        f"from them {sum(bool(pooled(lot)) for lot in drawn)}"
    )


def _words(name: str, effect) -> str:
    first = next(iter(effect.mean))
    as_well = f", or {', '.join(effect.equivalent)}" if effect.equivalent else ""
    return f"{name}{as_well}: p = {effect.p_value:.1g}, {first} = {effect.mean[first]:.3g}, {effect.share:.0%} of the units"


def one_unit(job: Job) -> tuple[UnitResult, list[str]]:
    """What one session tells, and what it names alone."""
    options = SimulationOptions(segments=job.segments, closure_s=0.0, seed=job.seed, odr_hz=104.0)
    with simulated(options, INJECTED.get(job.what)) as folder:
        explanation = explain_session(folder)
    empty = np.full((len(NAMES),) * 2, np.nan)
    unit = UnitResult(f"{job.seed}", f"{job.seed}", f"{job.seed}", empty[0], empty, effects=effects_of(explanation))
    return unit, [claim.effect.id for claim in explanation.claimed]


if __name__ == "__main__":
    main()
