"""The vote of an array: false alarms, and how soon each fault is found, by the thresholds of ``tinygc/annexes/arrays/voting.py``.

    python benchmarks/array_votes.py                    # simulated hours, faults, and ../shared/mimu
    python benchmarks/array_votes.py --quick

False alarms: simulated units whose noise is as stated, in motion and at rest; then eight real units over four recordings of ten minutes,
the last 100 s of each shaken by hand up to the end of the range (none of them is at fault).  A model learns how much units differ from
one recording and is tried on the others, their biases taken from each one's first rest.  SLOW and FAST are halved and doubled as sigmas
(FAST is a square).  Set aside: samples beyond ASIDE that are left out of one rate without a vote.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from common import markdown

from session.io.units import DEG
from tinygc.annexes.arrays import voting
from tinygc.annexes.arrays.model import ArrayModel
from tinygc.annexes.arrays.voting import LiveArray

HERE = Path(__file__).resolve().parent.parent
SHARED = HERE.parent / "shared" / "mimu"
sys.path.insert(0, str(HERE / "tests"))
FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0)


def with_factor(factor: float) -> None:
    """Bars of the mean and of the mean square, in sigmas, times a factor."""
    from tinygc.annexes.arrays.voting import FAST, SLOW

    voting.SLOW, voting.FAST = SLOW * factor, FAST * factor**2  # type: ignore[attr-defined]


def false_votes(model: ArrayModel, raw: np.ndarray) -> tuple[int, float, float]:
    """Units voted out, or two that disagree; share of a unit's samples that are set aside; share of the time that a unit is out."""
    live = LiveArray(model)
    fused = live(raw)
    ends = np.isinf(fused.sigma).any(axis=1)
    out = np.zeros(raw.shape[:2], dtype=bool)
    for event in fused.events:
        if event.unit is not None:
            out[event.sample + 1 :, model.numbers.index(event.unit)] = event.what == "out"
    aside = ~fused.used & ~out & ~ends[:, None]
    return sum(event.what in ("out", "disagree") for event in fused.events), float(aside.mean()), float(out.mean())


def simulated(hours: float) -> None:
    """False votes of units that are as stated."""
    from simulated_array import RATE_HZ, measured, model_of, motion, units

    rows = []
    samples = round(1800 * RATE_HZ)
    for count in (2, 3, 8):
        model = model_of(units(count))
        for factor in FACTORS[:3]:
            with_factor(factor)
            votes, aside = 0, 0.0
            rounds = max(round(hours * 2), 1)
            for seed in range(rounds):
                raw = measured(model, motion(samples, seed=seed), seed=100 + seed)
                found = false_votes(model, raw)
                votes, aside = votes + found[0], aside + found[1] / rounds
            unit_hours = count * rounds / 2
            most = f"{votes / unit_hours:.2g}" if votes else f"< {3 / unit_hours:.2g} (95 %)"
            rows.append([str(count), f"{factor:g}", f"{unit_hours:g}", str(votes), most, f"{1e6 * aside:.2g}"])
    with_factor(1.0)
    print("\n## Simulated units, none at fault\n")
    print(markdown(["N", "bars times", "unit hours", "voted out", "per unit hour", "set aside, ppm"], rows))


def faults() -> None:
    """How soon, and by what, in one of three and in one of eight units."""
    from array_faults import FAULTS, with_fault
    from simulated_array import RATE_HZ, measured, model_of, motion, units

    rows = []
    begin, end = 6000, 9000
    for name in FAULTS:
        row = [name]
        for count in (3, 8):
            model = model_of(units(count))
            omega = motion(12000, seed=7)
            clean = measured(model, omega, seed=8)
            live = LiveArray(model)
            fused = live(with_fault(clean, 1, name, begin, end))
            outs = [event for event in fused.events if event.what == "out"]
            first = next((event for event in outs if event.unit == 1), None)
            others = sorted({str(event.unit) for event in outs if event.unit != 1})
            worst = np.nanmax(np.abs(fused.rate - omega)[begin:end]) / DEG
            believed = LiveArray(model, vote=False)(with_fault(clean, 1, name, begin, end))
            unvoted = np.nanmax(np.abs(believed.rate - omega)[begin:end]) / DEG
            said = "never" if first is None else f"{(first.sample - begin) / RATE_HZ:.2f} s, {first.reason}"
            back = [event.sample for event in fused.events if event.what == "in" and event.unit == 1 and event.sample >= end]
            row += [
                said,
                f"{unvoted:.3g} → {worst:.2g}",
                f"{(back[0] - end) / RATE_HZ:.1f} s" if back else "was in",
                ", ".join(others) or "–",
            ]
        rows.append(row)
    head = [
        "fault",
        "of 3: out after",
        "worst error, dps",
        "in again after",
        "others out",
        "of 8: out after",
        "worst",
        "in again",
        "others",
    ]
    print("\n## One unit at fault for 30 s (noise 0.07 dps a sample, motion up to 200 dps)\n")
    print(markdown(head, rows))


def real(quick: bool) -> None:
    """False votes over mimu, the model learnt on another recording."""
    from real_array import aligned, at_rest, recordings

    read = recordings(SHARED)
    models = {number: aligned(raw) for number, raw in read.items()}
    rows = []
    for learnt, model in models.items():
        apart = model.disagreement
        row = [str(learnt), f"{apart.bias_rps / DEG:.3f}", f"{100 * apart.scale:.2f}", f"{1e3 * apart.delay_s:.2f}"]
        for factor in (1.0,) if quick else FACTORS:
            with_factor(factor)
            found = [false_votes(at_rest(model, raw), raw) for number, raw in read.items() if number != learnt]
            votes, aside, out = sum(each[0] for each in found), np.mean([each[1] for each in found]), np.mean([each[2] for each in found])
            row.append(f"{votes} ({100 * out:.2f} %; {100 * aside:.2f} %)")
        rows.append(row)
    with_factor(1.0)
    head = ["learnt on", "bias, dps", "scale, %", "delay, ms", *(f"bars × {factor:g}" for factor in ((1.0,) if quick else FACTORS))]
    print("\n## mimu: three other recordings, 8 units, 10 min each (4 unit hours): voted out (share of time out; samples set aside)\n")
    print(markdown(head, rows))


def main() -> None:
    """Tables."""
    command = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    command.add_argument("--quick", action="store_true")
    args = command.parse_args()
    simulated(0.5 if args.quick else 3)
    faults()
    if SHARED.exists():
        real(args.quick)
    else:
        print(f"{SHARED} is not there")


if __name__ == "__main__":
    main()
